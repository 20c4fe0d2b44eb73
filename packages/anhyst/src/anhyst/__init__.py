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

from anhyst import verbs

if TYPE_CHECKING:  # for checkers and editors; a verb that is not here has no type and works
    __version__: str

    from anhyst.compilation.output import Compiled as Compiled
    from anhyst.compilation.play import CompiledPlay as CompiledPlay
    from anhyst.data.clean import clean as clean
    from anhyst.data.inspection import Inspection as Inspection
    from anhyst.data.loops import Loop as Loop
    from anhyst.data.loops import Loops as Loops
    from anhyst.data.reading import read_loops as read_loops
    from anhyst_rigs.draft.drafting import Drafted as Drafted
    from anhyst_rigs.draft.drafting import example_files as example_files
    from anhyst.identification.run import IdentifyResult as IdentifyResult
    from anhyst.model.actuator import Model as Model
    from anhyst.model.actuator import read_model as read_model
    from anhyst.model.diff import ModelDiff as ModelDiff
    from anhyst.model.predict_file import RunSummary as RunSummary
    from anhyst.model.prediction import Prediction as Prediction
    from anhyst_rigs.study.bearing.on_board import BoardComparison as BoardComparison
    from anhyst_rigs.study.bearing.simulate import Simulation as Simulation
    from anhyst_rigs.study.bearing.state_space import linearise as linearise
    from anhyst_rigs.study.benefit import Benefit as Benefit
    from anhyst_rigs.study.engine.monte_carlo import MonteCarlo as MonteCarlo
    from anhyst_rigs.study.excite.excite import Excitation as Excitation
    from anhyst_rigs.study.fleet import Fleet as Fleet
    from anhyst_rigs.study.force_control import ForceControl as ForceControl
    from anhyst_rigs.study.piezo import PiezoTracking as PiezoTracking
    from anhyst_rigs.study.tracking.calibrate import Calibration as Calibration
    from anhyst_rigs.study.tracking.compiled import CompiledStage as CompiledStage
    from anhyst_rigs.study.tracking.excitation import CalibratingMove as CalibratingMove
    from anhyst_rigs.study.tracking.excitation import excite_to_calibrate as excite_to_calibrate
    from anhyst_rigs.study.tracking.simulate import TrackingStudy as TrackingStudy
    from anhyst_rigs.study.tuning.result import Tuning as Tuning
    from anhyst.support.errors import InputError as InputError
    from anhyst.support.errors import NegativeResult as NegativeResult
    from anhyst_rigs.verbs.calibrate import calibrate as calibrate
    from anhyst.verbs.compile import compile as compile  # noqa: A004
    from anhyst.verbs.convert import convert as convert
    from anhyst.verbs.diff import diff as diff
    from anhyst_rigs.verbs.excite import excite as excite
    from anhyst_exchange.verbs.export import export as export
    from anhyst_rigs.verbs.fleet import fleet as fleet
    from anhyst_rigs.verbs.force_control import force_control as force_control
    from anhyst.verbs.identify import identify as identify
    from anhyst_rigs.verbs.init import init as init
    from anhyst.verbs.inspect import inspect as inspect
    from anhyst.verbs.invert import invert as invert
    from anhyst_rigs.verbs.live import live as live
    from anhyst.verbs.predict import predict as predict
    from anhyst.verbs.report import report as report
    from anhyst_rigs.verbs.simulate import simulate as simulate
    from anhyst_rigs.verbs.tune import tune as tune
    from anhyst.verbs.verify import verify as verify
    from anhyst_rigs.verbs.watch import watch as watch
    from anhyst_rigs.verbs.xcp import xcp as xcp
    from anhyst.verification.result import Verification as Verification

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
    "example_files": "draft.drafting",
    "excite_to_calibrate": "study.tracking.excitation",
    "linearise": "study.bearing.state_space",
    "read_loops": "data.reading",
    "read_model": "model.actuator",
}
"""The module of each name that is not a verb."""

__all__ = sorted(["__version__", *_PLACES, *verbs.names()])  # noqa: PLE0605


def __getattr__(name: str) -> object:
    """Import a name when it is first used."""
    if name == "__version__":
        from anhyst.support import running_version

        return running_version()
    place = f"verbs.{name}" if name in verbs.names() else _PLACES.get(name)
    if place is None:
        raise AttributeError(f"module 'anhyst' has no attribute {name!r}")
    found = getattr(import_module(f"anhyst.{place}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return __all__
