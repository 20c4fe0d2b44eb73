"""Trained models and the records of their training.

A learned model is trained with PyTorch. Its fitted arrays are stored in
``record/MODEL/KEY.npz``, where the key is a hash of the training records. Therefore, a model predicts
without PyTorch, and a record of other training data is never used by mistake.
"""

from __future__ import annotations

import hashlib
import importlib.util
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..model import Refusal
from ..records import FloatArray, Record
from ._over_schedule import OverSchedule
from ._signals import Scaling

FOLDER = Path(__file__).resolve().parents[1] / "record"

HASHED_DIGITS = 6
"""Digits of the values that the key contains, so that rounding on another machine does not matter."""

Arrays = dict[str, FloatArray]


class LearnedModel(ABC):
    """A model whose arrays are trained once and then recorded.

    A subclass sets `name` and `settings`, and defines `_train` and ``predict``.

    Parameters
    ----------
    is_retrained
        Whether `fit` trains even if there is a record.

    Attributes
    ----------
    recorded_fit_s
        Processor time of the training when the record was made, s.
    """

    name: ClassVar[str]
    settings: ClassVar[str]

    def __init__(self, is_retrained: bool = False) -> None:
        self.recorded_fit_s = 0.0
        self._is_retrained = is_retrained
        self._arrays: Arrays = {}

    def fit(self, records: Sequence[Record]) -> None:
        """Read the recorded training of these records, or train if there is no record.

        Raises
        ------
        Refusal
            There is no record, and PyTorch is not installed.
        """
        file = self._file(records)
        if self._is_retrained or not file.exists():
            self.train(records)
        self._scaling = Scaling.of(records)
        with np.load(file) as stored:
            self._arrays = {key: np.asarray(stored[key], float) for key in stored.files}
        self.recorded_fit_s = float(self._arrays.pop("fit_s"))

    def train(self, records: Sequence[Record]) -> Path:
        """Train with PyTorch, and return the file of the record.

        Raises
        ------
        Refusal
            PyTorch is not installed.
        """
        if importlib.util.find_spec("torch") is None:
            raise Refusal(
                f"there is no recorded training of {self.name} for these records; "
                f'install torch, then python -m benchmarks.zoo train --model "{self.name}"'
            )
        start = time.process_time()
        self._scaling = Scaling.of(records)
        arrays = self._train(records)
        file = self._file(records)
        file.parent.mkdir(parents=True, exist_ok=True)
        fit_s = np.array(round(time.process_time() - start, 1))
        np.savez_compressed(file, **_in_single_precision(arrays), fit_s=fit_s)
        return file

    def n_parameters(self) -> int:
        """Return how many numbers were trained."""
        return sum(array.size for array in self._arrays.values())

    @abstractmethod
    def predict(self, record: Record) -> FloatArray:
        """Return the output at each sample."""

    @abstractmethod
    def _train(self, records: Sequence[Record]) -> Arrays:
        """Return the trained arrays."""

    def _file(self, records: Sequence[Record]) -> Path:
        folder = FOLDER / self.name.lower().replace(" ", "_")
        return folder / f"{key_of(records, self.settings)}.npz"


class LearnedOverSchedule(OverSchedule):
    """A learned model for each scheduling value, interpolated over the schedule."""

    @property
    def recorded_fit_s(self) -> float:
        """Processor time of the recorded trainings, s."""
        return sum(model.recorded_fit_s for model in self._models if isinstance(model, LearnedModel))


def key_of(records: Sequence[Record], settings: str) -> str:
    """Return the key of training records: a hash of their values and histories, and of settings."""
    digest = hashlib.sha256(settings.encode())
    for record in records:
        digest.update(f"{record.name} {record.history}".encode())
        for values in (record.input, record.output, record.schedule, record.time, record.is_scored):
            digest.update(b"none" if values is None else _hashed(np.asarray(values, float)))
    return digest.hexdigest()[:16]


def _hashed(values: FloatArray) -> bytes:
    """Return the values relative to the largest, in whole numbers."""
    relative = np.nan_to_num(values / (np.nanmax(np.abs(values), initial=0.0) or 1.0), nan=2.0)
    hashed: bytes = np.rint(relative * 10**HASHED_DIGITS).astype("<i8").tobytes()
    return hashed


def _in_single_precision(arrays: Mapping[str, FloatArray]) -> dict[str, Any]:
    return {key: np.asarray(array, np.float32) for key, array in arrays.items()}
