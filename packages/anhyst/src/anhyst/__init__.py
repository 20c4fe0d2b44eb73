"""From a measured loop to verified C.

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

The verbs of other packages are here too, once these are installed: ``anhyst.simulate`` of anhyst-rigs.
For their types, import them from that package.

Every result has ``to_dataframe()``, ``plot(ax=None)`` and ``save(path)``, and says in short what it
holds. Bad input raises `InputError`, a negative outcome `NegativeResult`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from anhyst.support.lazy import lazy_names
from anhyst.support.verbs import missing_package as _package_with
from anhyst.support.verbs import modules as _modules

if TYPE_CHECKING:  # for checkers and editors; a verb that is not here has no type and works
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

_PLACES = {
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
"""The module of each name that is not a verb."""

_own, _find = lazy_names("anhyst", _PLACES)


def __getattr__(name: str) -> Any:
    """Import a name when it is first used; a verb may be one of another package."""
    if name in _own or name.startswith("_"):
        return _find(name)
    if name in _modules():
        return getattr(import_module(_modules()[name]), name)
    if package := _package_with(name):
        raise AttributeError(f"anhyst.{name} is in the package {package}: pip install {package}")
    return _find(name)


def __dir__() -> list[str]:
    return __all__


__all__ = sorted({*_own, *_modules(is_project_only=True)})  # noqa: PLE0605
