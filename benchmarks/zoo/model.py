"""The interface of a model, and where models come from.

A model of somebody else is a Python file with a dictionary ``MODELS`` of names and factories, or an
entry point of the group ``anhyst.zoo`` that leads to such a dictionary.
"""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Protocol, runtime_checkable

from . import models
from .records import FloatArray, Record

ENTRY_POINTS = "anhyst.zoo"


class Refusal(Exception):  # noqa: N818 - a refusal is an answer, not an error
    """A model declines a task, because its data do not support a result; the text says why."""


@runtime_checkable
class Model(Protocol):
    """A model that is fitted to records and predicts others."""

    def fit(self, records: Sequence[Record]) -> None:
        """Fit the model to the training records of a task; raise `Refusal` to decline it."""

    def predict(self, record: Record) -> FloatArray:
        """Return the output at each sample of a record whose output is unknown, shape (n,)."""

    def n_parameters(self) -> int:
        """Return how many numbers were fitted."""


Factory = Callable[[], Model]


def find_models(files: Sequence[Path] = ()) -> dict[str, Factory]:
    """Return the models of the folder ``models``, of installed packages, and of given files by name."""
    found: dict[str, Factory] = {}
    for module in sorted(pkgutil.iter_modules(models.__path__), key=lambda info: info.name):
        if not module.name.startswith("_"):
            found |= importlib.import_module(f"{models.__name__}.{module.name}").MODELS
    for entry in entry_points(group=ENTRY_POINTS):
        found |= entry.load()
    for file in files:
        found |= load_file(file)
    return found


def load_file(file: Path) -> Mapping[str, Factory]:
    """Return the models of a Python file.

    Raises
    ------
    SystemExit
        The file does not exist or has no ``MODELS``.
    """
    if not file.is_file():
        raise SystemExit(f"{file}: there is no such file")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise SystemExit(f"{file}: this is not a Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    listed: Mapping[str, Factory] | None = getattr(module, "MODELS", None)
    if not listed:
        raise SystemExit(f'{file}: there is no MODELS; write MODELS = {{"my model": MyModel}}')
    return listed
