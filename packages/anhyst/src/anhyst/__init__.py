"""Identify models of actuators from measured loops, and compile them to verified C.

Every command is a function with the same option names and defaults. The exported classes are the
types of the results. Each name is imported when it is first used::

    import anhyst

    loops = anhyst.read_loops("loops.csv")
    print(anhyst.inspect(loops))
    model = anhyst.identify(loops).model
    force = model(current, gap)
    current = model.inverse(force, gap)
    model.save("model.toml")
    anhyst.compile(model, "controller", rate=20e3)
    anhyst.verify("controller")

Commands of other installed packages are available too, such as ``anhyst.simulate`` of anhyst-rigs.
The types of such results must be imported from the other package.

Every result has ``to_dataframe()``, ``plot(ax=None)`` and ``save(path)``, and a short text form.
Bad input raises `InputError`, and a negative result `NegativeResult`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from anhyst.support.lazy import lazy_names
from anhyst.support.verbs import missing_package as _missing_package
from anhyst.support.verbs import modules as _modules

if TYPE_CHECKING:  # types for editors; commands of other packages have none here
    __version__: str

    from anhyst.compilation.compiled_stage import CompiledStage as CompiledStage
    from anhyst.compilation.output import Compiled as Compiled
    from anhyst.compilation.play import CompiledPlay as CompiledPlay
    from anhyst.data.clean import clean as clean
    from anhyst.data.convert import Conversion as Conversion
    from anhyst.data.examples import CopiedExample as CopiedExample
    from anhyst.data.examples import example_files as example_files
    from anhyst.data.inspection import Inspection as Inspection
    from anhyst.data.loops import Loop as Loop
    from anhyst.data.loops import Loops as Loops
    from anhyst.data.reading import read_loops as read_loops
    from anhyst.identification.run import IdentifyResult as IdentifyResult
    from anhyst.model.actuator import Model as Model
    from anhyst.model.actuator import read_model as read_model
    from anhyst.model.diff import ModelDiff as ModelDiff
    from anhyst.model.predict_file import RunSummary as RunSummary
    from anhyst.model.prediction import Prediction as Prediction
    from anhyst.support.errors import InputError as InputError
    from anhyst.support.errors import NegativeResult as NegativeResult
    from anhyst.verbs.compile import compile as compile  # noqa: A004
    from anhyst.verbs.convert import convert as convert
    from anhyst.verbs.diff import diff as diff
    from anhyst.verbs.example import example as example
    from anhyst.verbs.identify import identify as identify
    from anhyst.verbs.inspect import inspect as inspect
    from anhyst.verbs.invert import invert as invert
    from anhyst.verbs.predict import predict as predict
    from anhyst.verbs.report import report as report
    from anhyst.verbs.verify import verify as verify
    from anhyst.verification.result import Verification as Verification

_MODULES_BY_NAME = {
    "Compiled": "compilation.output",
    "CompiledPlay": "compilation.play",
    "CompiledStage": "compilation.compiled_stage",
    "Conversion": "data.convert",
    "CopiedExample": "data.examples",
    "IdentifyResult": "identification.run",
    "InputError": "support.errors",
    "Inspection": "data.inspection",
    "Loop": "data.loops",
    "Loops": "data.loops",
    "Model": "model.actuator",
    "ModelDiff": "model.diff",
    "NegativeResult": "support.errors",
    "Prediction": "model.prediction",
    "RunSummary": "model.predict_file",
    "Verification": "verification.result",
    "clean": "data.clean",
    "example_files": "data.examples",
    "read_loops": "data.reading",
    "read_model": "model.actuator",
}
"""Module of each exported name that is not a command."""

_own_names, _find_name = lazy_names("anhyst", _MODULES_BY_NAME)


def __getattr__(name: str) -> Any:
    """Import a name when it is first used; a command can belong to another package."""
    if name in _own_names or name.startswith("_"):
        return _find_name(name)
    if name in _modules():
        return getattr(import_module(_modules()[name]), name)
    if package := _missing_package(name):
        raise AttributeError(f"anhyst.{name} is in the package {package}: pip install {package}")
    return _find_name(name)


def __dir__() -> list[str]:
    return __all__


__all__ = sorted({*_own_names, *_modules(is_project_only=True)})  # noqa: PLE0605
