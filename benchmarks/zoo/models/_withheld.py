"""What the classical models share: scaling, thinning, and pieces of the training records to withhold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..records import BoolArray, FloatArray, Record

MIN_RECORDS = 4
"""Number of records from which on complete records are withheld, and pieces of records below it."""

PIECES = 16
"""Number of pieces that a record is cut into."""


@dataclass(frozen=True)
class Scaling:
    """Scales of input and output. The input keeps its zero, because the state at rest refers to it."""

    input: float
    output: float
    offset: float

    @classmethod
    def of(cls, records: Sequence[Record]) -> Scaling:
        """Return the scales of the training records."""
        outputs = np.concatenate([record.output[record.scored] for record in records])
        largest = max(float(np.max(np.abs(record.input))) for record in records)
        return cls(largest or 1.0, float(np.std(outputs)) or 1.0, float(np.mean(outputs)))

    def normalise(self, record: Record) -> Record:
        """Return a record with an input of at most 1 and an output of standard deviation 1."""
        return replace(
            record, input=record.input / self.input, output=(record.output - self.offset) / self.output
        )

    def restore(self, output: FloatArray) -> FloatArray:
        """Return an output in the units of the task."""
        restored: FloatArray = self.offset + self.output * output
        return restored


def thin(records: Sequence[Record], count: int) -> list[Record]:
    """Return the records with about a given number of samples altogether; reversals are retained."""
    step = -(-sum(record.input.size for record in records) // count)
    return [_thin_record(record, step) for record in records]


def _thin_record(record: Record, step: int) -> Record:
    """Return a record with every sample of a given step, and all samples where the input reverses."""
    u = record.input
    rows = np.zeros(u.size, np.bool_)
    rows[::step] = True
    rows[-1] = True
    change = np.diff(u)
    moving = np.flatnonzero(change)
    reversal = np.flatnonzero(np.diff(np.sign(change[moving])))
    if reversal.size < u.size // 8:  # a noisy input reverses everywhere
        rows[moving[reversal] + 1] = True
    return replace(
        record,
        input=u[rows],
        output=record.output[rows],
        time=None if record.time is None else record.time[rows],
        is_scored=record.scored[rows],
    )


def withheld(records: Sequence[Record], fold: int, folds: int) -> list[BoolArray]:
    """Return for each record the samples that are withheld in a fold.

    Complete records are withheld if there are enough of them, except the record with the largest
    input, because no model of hysteresis extrapolates. Otherwise, every record is cut into pieces.
    """
    if len(records) >= MIN_RECORDS:
        largest = int(np.argmax([np.max(np.abs(record.input)) for record in records]))
        return [
            np.full(record.input.size, index != largest and index % folds == fold)
            for index, record in enumerate(records)
        ]
    return [np.arange(record.input.size) * PIECES // record.input.size % folds == fold for record in records]


def from_rest(path_input: FloatArray) -> FloatArray:
    """Return the input of a path with a zero before it, where the state without a history is defined."""
    return np.concatenate([[0.0], path_input])


def grid_lines(records: Sequence[Record], count: int) -> FloatArray:
    """Return the lines of a grid over the input, denser where input and output change, shape (count + 1,).

    Each interval has the same share of a mixture of the range of the input, of its travel and of
    the travel of the output.
    """
    low = min(float(np.min(record.input)) for record in records)
    high = max(float(np.max(record.input)) for record in records)
    edges = np.linspace(low, high, 4001)
    middles = np.concatenate([(record.input[1:] + record.input[:-1]) / 2.0 for record in records])
    steps = [
        np.concatenate([np.abs(np.diff(values)) for values in kind])
        for kind in ([record.input for record in records], [_smooth(record.output) for record in records])
    ]
    density = np.full(4000, 1.0 / 4000)
    for step in steps:
        share = np.histogram(middles, edges, weights=step)[0]
        share = np.convolve(share, np.full(41, 1.0 / 41), "same")
        density += share / max(float(np.sum(share)), 1e-300)
    cumulated = np.concatenate([[0.0], np.cumsum(density)])
    lines: FloatArray = np.interp(np.linspace(0.0, cumulated[-1], count + 1), cumulated, edges)
    return lines


def _smooth(values: FloatArray) -> FloatArray:
    """Return a moving mean over five samples, so that noise does not count as travel."""
    if values.size < 10:
        return values
    padded = np.concatenate([np.full(2, values[0]), values, np.full(2, values[-1])])
    return np.convolve(padded, np.full(5, 0.2), "valid")


def hats(u: FloatArray, knots: FloatArray) -> FloatArray:
    """Return the hat functions of the knots at each input, continued linearly outside."""
    piece = np.clip(np.searchsorted(knots, u, side="right") - 1, 0, knots.size - 2)
    share = (u - knots[piece]) / (knots[piece + 1] - knots[piece])
    values = np.zeros((u.size, knots.size))
    rows = np.arange(u.size)
    values[rows, piece] = 1.0 - share
    values[rows, piece + 1] = share
    return values
