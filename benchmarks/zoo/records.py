"""Records of a task: input and output over the samples, and the history before the first sample.

A model is fitted to the training records of a task and predicts its test records. A history is one
of two kinds:

- ``settled``: the record is a closed cycle that was repeated until the output repeated too.
- ``demagnetised``: the record starts at rest, in the state without a history.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
RecordHistory = Literal["settled", "demagnetised"]

LEAD_IN_CYCLES = 2
"""Number of times that a model runs over a settled cycle before the cycle that counts."""


@dataclass(frozen=True)
class Path:
    """The complete input of a record, with the repeated cycles before it."""

    input: FloatArray
    schedule: FloatArray | None
    time: FloatArray | None
    lead_in: int  # number of samples before the record

    def cut(self, output: FloatArray) -> FloatArray:
        """Return the part of an output along this path that belongs to the record."""
        return output[self.lead_in :]


@dataclass(frozen=True, eq=False)
class Record:
    """One measured or simulated record.

    Parameters
    ----------
    name
        Identifies the record in its task.
    input, output
        Shape (n,), in the units of the task. The output of a record that is predicted is NaN.
    schedule
        Gap or temperature at each sample, or ``None``.
    time
        Time of each sample, s, increasing, or ``None`` if it is not recorded.
    history
        State before the first sample.
    is_scored
        Samples that count for the scores, or ``None`` if all count.
    quantities
        Input, output and schedule as headers with units, such as ``I (A)``; set by the task.
    """

    name: str
    input: FloatArray
    output: FloatArray
    schedule: FloatArray | None = None
    time: FloatArray | None = None
    history: RecordHistory = "settled"
    is_scored: BoolArray | None = None
    quantities: tuple[str, str, str] = ("", "", "")

    @property
    def path(self) -> Path:
        """The input that a model runs over: a settled cycle is repeated before the record."""
        if self.history == "demagnetised":
            return Path(self.input, self.schedule, self.time, 0)
        count = LEAD_IN_CYCLES + 1
        time = None
        if self.time is not None:
            period = self.time[-1] - self.time[0] + float(np.median(np.diff(self.time)))
            time = np.concatenate([self.time + cycle * period for cycle in range(count)])
        return Path(
            np.tile(self.input, count),
            None if self.schedule is None else np.tile(self.schedule, count),
            time,
            LEAD_IN_CYCLES * self.input.size,
        )

    @property
    def scored(self) -> BoolArray:
        """Mask of the samples that count."""
        return np.ones(self.input.size, np.bool_) if self.is_scored is None else self.is_scored

    def without_output(self) -> Record:
        """Return the record as a model sees it when it predicts."""
        return replace(self, output=np.full(self.input.size, np.nan))
