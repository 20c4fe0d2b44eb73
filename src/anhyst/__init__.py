"""From a measured loop to a linear actuator.

Every verb of the command line is a function with the same names and defaults, and the nouns are what
they give; each is imported once it is used::

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

from anhyst.verbs import names as verb_names

if TYPE_CHECKING:
    __version__: str

    from anhyst.compilation.output import Compiled
    from anhyst.compilation.play import CompiledPlay
    from anhyst.dashboard.verb import live
    from anhyst.data.clean import clean
    from anhyst.data.inspection import Inspection, inspect
    from anhyst.data.loops import Loop, Loops
    from anhyst.data.reading import read_loops
    from anhyst.draft.drafting import Drafted, example_files, init
    from anhyst.exchange.export import export
    from anhyst.identification.identify import identify
    from anhyst.identification.run import IdentifyResult
    from anhyst.model.actuator import Model, read_model
    from anhyst.model.diff import ModelDiff, diff
    from anhyst.model.predict_file import RunSummary, invert, predict
    from anhyst.model.prediction import Prediction
    from anhyst.reports.model.page import write_report as report
    from anhyst.reports.verbs import excite_rig as excite
    from anhyst.reports.verbs import simulate_rig as simulate
    from anhyst.study.bearing.on_board import BoardComparison
    from anhyst.study.bearing.simulate import Simulation
    from anhyst.study.bearing.state_space import linearise
    from anhyst.study.benefit import Benefit
    from anhyst.study.engine.monte_carlo import MonteCarlo
    from anhyst.study.excite.excite import Excitation
    from anhyst.study.fleet import Fleet
    from anhyst.study.fleet import judge_fleet as fleet
    from anhyst.study.force_control import ForceControl, force_control
    from anhyst.study.piezo import PiezoTracking
    from anhyst.study.tracking.calibrate import Calibration
    from anhyst.study.tracking.compiled import CompiledStage
    from anhyst.study.tracking.compiled import compile_file as compile  # noqa: A004
    from anhyst.study.tracking.excitation import CalibratingMove, excite_to_calibrate
    from anhyst.study.tracking.simulate import TrackingStudy
    from anhyst.study.tuning.result import Tuning
    from anhyst.support.errors import InputError, NegativeResult
    from anhyst.verbs.calibrate import calibrate
    from anhyst.verbs.convert import convert
    from anhyst.verbs.tune import tune
    from anhyst.verbs.verify import verify
    from anhyst.verbs.watch import watch
    from anhyst.verbs.xcp import xcp
    from anhyst.verification.result import Verification

__all__ = [
    "Benefit",
    "BoardComparison",
    "CalibratingMove",
    "Calibration",
    "Compiled",
    "CompiledPlay",
    "CompiledStage",
    "Drafted",
    "Excitation",
    "Fleet",
    "ForceControl",
    "IdentifyResult",
    "InputError",
    "Inspection",
    "Loop",
    "Loops",
    "Model",
    "ModelDiff",
    "MonteCarlo",
    "NegativeResult",
    "PiezoTracking",
    "Prediction",
    "RunSummary",
    "Simulation",
    "TrackingStudy",
    "Tuning",
    "Verification",
    "__version__",
    "calibrate",
    "clean",
    "compile",
    "convert",
    "diff",
    "example_files",
    "excite",
    "excite_to_calibrate",
    "export",
    "fleet",
    "force_control",
    "identify",
    "init",
    "inspect",
    "invert",
    "linearise",
    "live",
    "predict",
    "read_loops",
    "read_model",
    "report",
    "simulate",
    "tune",
    "verify",
    "watch",
    "xcp",
]

_PLACES = {
    "Benefit": "study.benefit",
    "BoardComparison": "study.bearing.on_board",
    "CalibratingMove": "study.tracking.excitation",
    "Calibration": "study.tracking.calibrate",
    "Compiled": "compilation.output",
    "CompiledPlay": "compilation.play",
    "CompiledStage": "study.tracking.compiled",
    "Drafted": "draft.drafting",
    "Excitation": "study.excite.excite",
    "Fleet": "study.fleet",
    "ForceControl": "study.force_control",
    "IdentifyResult": "identification.run",
    "InputError": "support.errors",
    "Inspection": "data.inspection",
    "Loop": "data.loops",
    "Loops": "data.loops",
    "Model": "model.actuator",
    "ModelDiff": "model.diff",
    "MonteCarlo": "study.engine.monte_carlo",
    "NegativeResult": "support.errors",
    "PiezoTracking": "study.piezo",
    "Prediction": "model.prediction",
    "RunSummary": "model.predict_file",
    "Simulation": "study.bearing.simulate",
    "TrackingStudy": "study.tracking.simulate",
    "Tuning": "study.tuning.result",
    "Verification": "verification.result",
    "clean": "data.clean",
    "compile": "study.tracking.compiled:compile_file",
    "diff": "model.diff",
    "example_files": "draft.drafting",
    "excite": "reports.verbs:excite_rig",
    "excite_to_calibrate": "study.tracking.excitation",
    "export": "exchange.export",
    "fleet": "study.fleet:judge_fleet",
    "force_control": "study.force_control",
    "identify": "identification.identify",
    "init": "draft.drafting",
    "inspect": "data.inspection",
    "invert": "model.predict_file",
    "linearise": "study.bearing.state_space",
    "live": "dashboard.verb",
    "predict": "model.predict_file",
    "read_loops": "data.reading",
    "read_model": "model.actuator",
    "report": "reports.model.page:write_report",
    "simulate": "reports.verbs:simulate_rig",
}
"""Where each name lives, and what it is called there if not the same."""


def __getattr__(name: str) -> object:
    """Import a name when it is first used."""
    if name == "__version__":
        from anhyst.support import running_version

        return running_version()
    if name in verb_names():
        found = getattr(import_module(f"anhyst.verbs.{name}"), name)
        globals()[name] = found
        return found
    if name not in _PLACES:
        raise AttributeError(f"module 'anhyst' has no attribute {name!r}")
    place, _, called = _PLACES[name].partition(":")
    found = getattr(import_module(f"anhyst.{place}"), called or name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)
