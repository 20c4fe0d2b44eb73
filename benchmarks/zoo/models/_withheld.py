"""Scaling, thinning, and withheld pieces of the training records, for the classical models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..records import BoolArray, FloatArray, Record

MIN_RECORDS = 4
"""Minimum number of records for which complete records are withheld instead of pieces."""

MAX_REVERSAL = 0.95
"""Input relative to the largest one below which a loop must not reverse to be odd."""

MIN_SYMMETRY = 0.98
"""Smallest ratio of the extrema of the input of an odd loop."""

MAX_ODD_MISMATCH = 0.01
"""Largest median difference between an odd loop and its mirror image, relative to its standard deviation."""

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


SUBDIVISION = 10


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


def add_mirror_images(records: Sequence[Record]) -> list[Record]:
    """Return the records, and their mirror images if all of them are odd loops.

    The loops of a magnetic material are odd, and a piece that is missing in a record may be in its
    mirror image.
    """
    images = [_mirror_image(record) for record in records]
    return [*records, *(image for image in images if image)] if all(images) else list(records)


def _mirror_image(record: Record) -> Record | None:
    """Return a loop with both signs changed, or nothing if the loop is not odd about its middle."""
    u, y = record.input, record.output
    direction = np.sign(np.roll(u, -1) - np.roll(u, 1))
    largest = float(np.max(np.abs(u)))
    is_inside = np.abs(u) < MAX_REVERSAL * largest
    is_reversal = is_inside & (direction * np.roll(direction, 1) < 0.0)
    is_symmetric = min(np.max(u), -np.min(u)) > MIN_SYMMETRY * largest
    if record.history != "settled" or record.time is not None or np.any(is_reversal) or not is_symmetric:
        return None
    sums = []
    for sign in (-1.0, 1.0):
        branch, opposite = direction == sign, direction == -sign
        order = np.argsort(u[opposite])
        sums.append(y[branch] + np.interp(-u[branch], u[opposite][order], y[opposite][order]))
    doubled_middle = float(np.median(np.concatenate(sums)))
    mismatch = float(np.median(np.abs(np.concatenate(sums) - doubled_middle)))
    if mismatch > MAX_ODD_MISMATCH * float(np.std(y)):
        return None
    return replace(record, input=-u, output=doubled_middle - y)


def start_at_zero(path_input: FloatArray) -> FloatArray:
    """Return the input of a path with a zero before it, where the state without a history is defined."""
    return np.concatenate([[0.0], path_input])


def grid_lines(records: Sequence[Record], count: int) -> FloatArray:
    """Return the lines of a grid over the input, denser where input and output change, shape (count + 1,).

    Each interval has the same share of a mixture of the range of the input, of its travel and of
    the travel of the output.
    """
    lowest = min(float(np.min(record.input)) for record in records)
    high = max(float(np.max(record.input)) for record in records)
    edges = np.linspace(lowest, high, 4001)
    dense = [_subdivide(record) for record in records]
    middles = np.concatenate([(u[1:] + u[:-1]) / 2.0 for u, _ in dense])
    steps = [np.concatenate([np.abs(np.diff(pair[column])) for pair in dense]) for column in (0, 1)]
    density = np.full(4000, 1.0 / 4000)
    for step in steps:
        share = np.histogram(middles, edges, weights=step)[0]
        share = np.convolve(share, np.full(41, 1.0 / 41), "same")
        density += share / max(float(np.sum(share)), 1e-300)
    cumulated = np.concatenate([[0.0], np.cumsum(density)])
    lines: FloatArray = np.interp(np.linspace(0.0, cumulated[-1], count + 1), cumulated, edges)
    return lines


def _subdivide(record: Record) -> tuple[FloatArray, FloatArray]:
    """Return input and smooth output with more samples, so that the travel of a long step is spread."""
    places = np.linspace(0.0, record.input.size - 1.0, SUBDIVISION * (record.input.size - 1) + 1)
    samples = np.arange(record.input.size)
    return np.interp(places, samples, record.input), np.interp(places, samples, _smooth(record.output))


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
