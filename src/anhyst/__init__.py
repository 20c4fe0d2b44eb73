"""From a measured loop to a linear actuator.

The verbs are functions and the nouns are what they give; each is imported once it is used::

    import anhyst

    loops = anhyst.read_loops("loops.csv")
    print(anhyst.inspect(loops))
    model = anhyst.identify(loops).model
    force = model(current, gap)
    current = model.inverse(force, gap)
    model.save("model.toml")
    anhyst.compile(model, "controller", rate=20e3)
    anhyst.verify("controller")
    anhyst.simulate("rig.toml").plot()

Every result has ``to_dataframe()``, ``plot(ax=None)`` and ``save(path)``, and says in short what it
holds. Bad input raises `InputError`, a negative outcome `NegativeResult`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str

    from anhyst.compilation.output import Compiled
    from anhyst.compilation.verb import compile_actuator as compile  # noqa: A004
    from anhyst.data.inspection import Inspection, inspect
    from anhyst.data.loops import Loop, Loops
    from anhyst.data.reading import read_loops
    from anhyst.draft.examples import example_files
    from anhyst.identification.identify import identify
    from anhyst.identification.result import IdentifyResult
    from anhyst.model.actuator import Model
    from anhyst.model.diff import ModelDiff, diff
    from anhyst.model.file import read_model
    from anhyst.model.prediction import Prediction
    from anhyst.reports.model.page import write_report as report
    from anhyst.study.bearing.simulate import Simulation
    from anhyst.study.bearing.state_space import linearise
    from anhyst.study.force.force_control import force_control
    from anhyst.study.simulate import simulate_rig as simulate
    from anhyst.study.tuning.tuning import tune
    from anhyst.support.errors import InputError, NegativeResult
    from anhyst.verification.result import Verification
    from anhyst.verification.verify import verify

__all__ = [
    "Compiled",
    "IdentifyResult",
    "InputError",
    "Inspection",
    "Loop",
    "Loops",
    "Model",
    "ModelDiff",
    "NegativeResult",
    "Prediction",
    "Simulation",
    "Verification",
    "__version__",
    "compile",
    "diff",
    "example_files",
    "force_control",
    "identify",
    "inspect",
    "linearise",
    "read_loops",
    "read_model",
    "report",
    "simulate",
    "tune",
    "verify",
]

_PLACES = {
    "Compiled": "compilation.output",
    "IdentifyResult": "identification.result",
    "InputError": "support.errors",
    "Inspection": "data.inspection",
    "Loop": "data.loops",
    "Loops": "data.loops:Loops",
    "Model": "model.actuator",
    "ModelDiff": "model.diff",
    "NegativeResult": "support.errors",
    "Prediction": "model.prediction",
    "Simulation": "study.bearing.simulate",
    "Verification": "verification.result",
    "compile": "compilation.verb:compile_actuator",
    "diff": "model.diff",
    "example_files": "draft.examples",
    "force_control": "study.force.force_control",
    "identify": "identification.identify",
    "inspect": "data.inspection",
    "linearise": "study.bearing.state_space",
    "read_loops": "data.reading",
    "read_model": "model.file",
    "report": "reports.model.page:write_report",
    "simulate": "study.simulate:simulate_rig",
    "tune": "study.tuning.tuning",
    "verify": "verification.verify",
}
"""Where each name lives, and what it is called there if not the same."""


def __getattr__(name: str) -> object:
    """Import a name when it is first used."""
    if name == "__version__":
        from anhyst.support.version import running_version

        return running_version()
    if name not in _PLACES:
        raise AttributeError(f"module 'anhyst' has no attribute {name!r}")
    place, _, called = _PLACES[name].partition(":")
    found = getattr(import_module(f"anhyst.{place}"), called or name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)
