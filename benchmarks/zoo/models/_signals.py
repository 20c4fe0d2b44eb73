"""Signals that learned models see: normalised inputs, steps of equal travel, and play operators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..records import FloatArray, Path, Record

IntArray = NDArray[np.int64]

WITHHELD_SHARE = 0.15
"""Share of the scored samples that is withheld from the training, to stop it early."""

WITHHELD_PIECES = 4
"""Number of withheld pieces of each record."""

WARP_KNOTS = 2001
"""Number of knots of the warped input over the range of the input."""


@dataclass(frozen=True)
class Scaling:
    """Scales of the training records."""

    input_centre: float
    input_half: float  # half of the range
    output_centre: float
    output_half: float
    time_step: float  # median step of time, s; 0 if no time is recorded
    input_step: float  # rms change of the normalised input between samples
    warped: FloatArray  # warped input at equal distances of the normalised input

    @classmethod
    def of(cls, records: Sequence[Record]) -> Scaling:
        """Return the scales of training records."""
        u = np.concatenate([record.input for record in records])
        y = np.concatenate([record.output[is_usable(record)] for record in records])
        times = [np.median(np.diff(record.time)) for record in records if record.time is not None]
        centre, half = _centre_and_half(u)
        return cls(
            centre,
            half,
            *_centre_and_half(y),
            float(np.exp(np.mean(np.log(times)))) if len(times) == len(records) else 0.0,
            float(np.sqrt(np.mean(np.concatenate([np.diff(record.input) for record in records]) ** 2))) / half
            or 1.0,
            _warped_input(records, centre, half),
        )

    @property
    def zero_input(self) -> float:
        """The normalised input that is zero in its unit."""
        return -self.input_centre / self.input_half

    def scale_input(self, u: FloatArray) -> FloatArray:
        """Return the input, -1 to 1 in the training records."""
        return (u - self.input_centre) / self.input_half

    def warp(self, scaled: FloatArray) -> FloatArray:
        """Return the normalised input, stretched where the output of the training records is steep."""
        knots = np.linspace(-1.0, 1.0, WARP_KNOTS)
        inside = np.clip(scaled, -1.0, 1.0)
        return np.interp(inside, knots, self.warped) + (scaled - inside)

    def unwarp(self, warped: FloatArray) -> FloatArray:
        """Return the normalised input of a warped input."""
        knots = np.linspace(-1.0, 1.0, WARP_KNOTS)
        inside = np.clip(warped, -1.0, 1.0)
        return np.interp(inside, self.warped, knots) + (warped - inside)

    def scale_output(self, y: FloatArray) -> FloatArray:
        """Return the output, -1 to 1 in the training records."""
        return (y - self.output_centre) / self.output_half

    def output_of(self, scaled: FloatArray) -> FloatArray:
        """Return the output in its unit."""
        return self.output_centre + self.output_half * scaled

    def time_steps(self, path: Path) -> FloatArray | None:
        """Return the time step before each sample, relative to the usual one, or None."""
        if self.time_step == 0.0 or path.time is None:
            return None
        steps = np.diff(path.time) / self.time_step
        return np.concatenate([steps[:1], steps])


def _centre_and_half(values: FloatArray) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    return (low + high) / 2.0, (high - low) / 2.0 or 1.0


def _warped_input(records: Sequence[Record], centre: float, half: float) -> FloatArray:
    """Return the mean of the input and of the share of the output's travel below this input."""
    knots = np.linspace(-1.0, 1.0, WARP_KNOTS)
    share = np.zeros(WARP_KNOTS)
    for record in records:
        y = record.output
        middle = ((record.input[1:] + record.input[:-1]) / 2.0 - centre) / half
        travel = np.where(np.isfinite(np.diff(y)) & (np.diff(record.input) != 0.0), np.abs(np.diff(y)), 0.0)
        order = np.argsort(middle)
        below = np.concatenate([[0.0], np.cumsum(travel[order])])
        at = np.concatenate([[-1.0], middle[order]])
        share += np.interp(knots, at, below) / (below[-1] or 1.0)
    share -= share[0]
    return (knots + 2.0 * share / (share[-1] or 1.0) - 1.0) / 2.0


def is_usable(record: Record) -> NDArray[np.bool_]:
    """Return the mask of the samples to train on."""
    return record.scored & np.isfinite(record.output)


def split(record: Record) -> tuple[FloatArray, FloatArray]:
    """Return the weights of the samples of a record in the training and in the validation."""
    usable = is_usable(record)
    if not usable.any():
        return np.zeros(usable.size), np.zeros(usable.size)
    position = np.cumsum(usable) / usable.sum() * WITHHELD_PIECES
    withheld = usable & (np.abs(position % 1.0 - 0.6) < WITHHELD_SHARE / 2.0)
    kept = usable & ~withheld
    return kept / max(1, kept.sum()), withheld / max(1, withheld.sum())


def range_weight(record: Record, scaling: Scaling) -> float:
    """Return the weight of a record: the range of all outputs relative to its own, at most 30.

    The sum of squares over all samples would neglect small loops, and errors relative to the range of
    each record would overestimate them.
    """
    y = record.output[is_usable(record)]
    own = float(np.ptp(y)) / 2.0 if y.size else 0.0
    return min(30.0, scaling.output_half / max(own, 1e-12 * scaling.output_half))


@dataclass(frozen=True)
class Travel:
    """A path in steps of at most equal travel, and the place of each sample of the path in it."""

    input: FloatArray
    before: IntArray  # index of the step at or before each sample
    fraction: FloatArray  # position of the sample between this step and the next


def by_travel(u: FloatArray, step: float) -> Travel:
    """Return a path in steps of travel, with a step at each reversal of the input.

    Travel is the path length of the input. A model that runs over these steps is independent of the
    rate and of the sampling.
    """
    du = np.diff(u)
    travel = np.concatenate([[0.0], np.cumsum(np.abs(du))])
    moving = np.flatnonzero(du)
    reversals = moving[1:][np.sign(du[moving[1:]]) != np.sign(du[moving[:-1]])]
    ends = np.unique(np.concatenate([[0.0], travel[reversals], travel[-1:]]))
    counts = np.maximum(1, np.ceil(np.diff(ends) / step).astype(int))
    pieces = [
        start + (end - start) * np.arange(count) / count
        for start, end, count in zip(ends[:-1], ends[1:], counts, strict=True)
    ]
    places = np.concatenate([*pieces, ends[-1:]])
    before = np.clip(np.searchsorted(places, travel, side="right") - 1, 0, max(0, places.size - 2))
    following = np.minimum(before + 1, places.size - 1)
    width = places[following] - places[before]
    fraction = np.where(width > 0.0, (travel - places[before]) / np.where(width > 0.0, width, 1.0), 0.0)
    return Travel(np.interp(places, travel, u), before, np.clip(fraction, 0.0, 1.0))
