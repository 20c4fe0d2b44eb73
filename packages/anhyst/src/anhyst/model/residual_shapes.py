"""Shapes that what a fit leaves may have, and the noise beside them.

Shapes are columns over all samples, one group a cause. Of noise each sample goes with the one before:
a filtered sensor, the steps of a converter, a slow supply all look smooth over a few samples. How
smooth is taken from what no shape explains. Shapes explain the slow part of such a noise first, so
what is left goes less together than the noise did: by how much is computed, not guessed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.special import fdtrc

from anhyst.data.path import find_branches
from anhyst.support.numeric import FloatArray, recursive_sum

Shape = Literal["input", "direction", "gap", "amplitude", "start", "drift"]

_CURVE_DEGREE = 7
"""Degree in the input of what is common to all loops."""
_WIDTH_DEGREE = 5
"""Degree in the input of the difference of the directions."""
_LEVEL_DEGREE = 2
"""Degree in the input of what each gap, or each size of loop, has for itself."""
_DECAY_POWERS = (1, 2, 4)
"""Powers of what is left of the first branch: a wrong start fades along it."""
_MIN_INDEPENDENT_SHARE = 1e-6
"""Part of a column that others leave of it, below which it says nothing of its own."""


@dataclass(frozen=True, eq=False)
class Residual:
    """The residual of a fit on one record."""

    drive: FloatArray  # shape (n,): input, measured output, and modelled minus measured output, SI
    measured: FloatArray
    deviation: FloatArray
    gap: int  # place of its scheduling value
    is_cycle: bool  # whether the record is a cycle to be repeated until it closes

    def every_nth(self, step: int) -> Residual:
        """Take every so manieth sample."""
        drive, measured, deviation = (
            each[::step] for each in (self.drive, self.measured, self.deviation)
        )
        return Residual(drive, measured, deviation, self.gap, self.is_cycle)


def _branch_positions(record: Residual) -> FloatArray:
    """Return where the samples of a record lie on its branches, shape (4, samples).

    The rows: 1 where the input rises and -1 where it falls; the place on the branch, -1 at its
    lower end and 1 at its upper one; half of what the branch spans, in units of the input; what is
    left of the first branch, from 1 to 0, and 0 after it.
    """
    drive = record.drive
    branch_list = find_branches(drive)
    direction, position, half_span = np.ones(drive.size), np.zeros(drive.size), np.ones(drive.size)
    for branch in branch_list:
        piece = drive[branch.rows]
        half = max(0.5 * float(np.ptp(piece)), 1e-300)
        direction[branch.rows] = 1.0 if branch.is_rising else -1.0
        position[branch.rows] = (piece - float(piece.min())) / half - 1.0
        half_span[branch.rows] = half
    first_branch_rest = np.zeros(drive.size)
    if not record.is_cycle or len(branch_list) > 2:
        first = branch_list[0].rows
        first_branch_rest[first] = 0.5 * (1.0 - direction[first] * position[first])
    return np.stack([direction, position, half_span, first_branch_rest])


def shape_columns(records: Sequence[Residual]) -> dict[Shape, list[FloatArray]]:
    """Columns of each cause, shape (samples, ..), records one after the other.

    Where a cause may act alike on all gaps or in proportion to their outputs, both are given. What
    differs from gap to gap, or from size to size, is that alone: without what is common to all.
    """
    direction, position, half_span, first_branch_rest = np.concatenate(
        [_branch_positions(record) for record in records], axis=1
    )
    drive = np.concatenate([record.drive for record in records])
    middle, half = 0.5 * float(drive.max() + drive.min()), 0.5 * float(np.ptp(drive))
    x = (drive - middle) / max(half, 1e-300)
    sizes = [record.drive.size for record in records]
    gap = np.repeat([record.gap for record in records], sizes)
    largest_outputs = np.zeros(int(gap.max()) + 1)
    for record in records:
        largest_outputs[record.gap] = max(
            largest_outputs[record.gap], float(np.max(np.abs(record.measured)))
        )
    relative_output = (largest_outputs / max(float(largest_outputs.max()), 1e-300))[gap][:, None]
    scales: list[FloatArray | float] = [1.0, relative_output] if largest_outputs.size > 1 else [1.0]
    curve = legvander(x, _CURVE_DEGREE)
    width = direction[:, None] * np.hstack([legvander(x, _WIDTH_DEGREE), legvander(position, 3)])
    start_columns = first_branch_rest[:, None] ** np.array(_DECAY_POWERS)
    common = np.hstack([curve, width])
    record_time = np.concatenate([np.linspace(-1.0, 1.0, size) for size in sizes])
    total_time = np.linspace(-1.0, 1.0, sum(sizes))
    shapes: dict[Shape, list[FloatArray]] = {
        "input": [np.asarray(scale * curve) for scale in scales],
        "direction": [np.asarray(scale * width) for scale in scales],
        "drift": [np.asarray(time[:, None]) for time in (record_time, total_time)[: len(sizes)]],
    }
    if np.any(first_branch_rest):
        shapes["start"] = [scale * start_columns for scale in scales]
    if largest_outputs.size > 1:
        shapes["gap"] = [remove_explained(_columns_by_gap(records, gap, x), common)]
    if np.ptp(half_span) > 0.1 * float(half_span.max()):
        shapes["amplitude"] = [
            remove_explained(_columns_by_branch_size(half_span, position, direction), common)
        ]
    return shapes


def _columns_by_gap(records: Sequence[Residual], gap: FloatArray, x: FloatArray) -> FloatArray:
    """Level, bend and gain of each gap."""
    # Of the modelled output: the measured one has the noise in it, and would explain that.
    output = np.concatenate([record.measured + record.deviation for record in records])
    gain = output / max(float(np.abs(output).max()), 1e-300)
    shared = np.column_stack([legvander(x, _LEVEL_DEGREE), gain])
    return np.hstack([(gap == node)[:, None] * shared for node in np.unique(gap)])


def _columns_by_branch_size(
    half_span: FloatArray, along: FloatArray, rising: FloatArray
) -> FloatArray:
    """Level, bend and width that go with the size of a branch."""
    size = half_span / float(half_span.max())
    shared = legvander(along, _LEVEL_DEGREE)
    both = np.hstack([shared, rising[:, None] * shared])
    return np.hstack([size[:, None] * both, size[:, None] ** 2 * both])


def orthonormal_basis(columns: FloatArray) -> FloatArray:
    """Orthonormal columns that span the same; what is no direction of its own is left out."""
    sizes = np.sqrt(np.einsum("nk,nk->k", columns, columns))
    unit_columns = columns[:, sizes > 0.0] / sizes[sizes > 0.0]
    strength, directions = np.linalg.eigh(unit_columns.T @ unit_columns)
    is_independent = strength > _MIN_INDEPENDENT_SHARE * strength.max(initial=1e-300)
    return np.ascontiguousarray(
        unit_columns @ (directions[:, is_independent] / np.sqrt(strength[is_independent]))
    )


def remove_explained(columns: FloatArray, others: FloatArray) -> FloatArray:
    """Take off columns what others explain of them; those that are nothing but this are left out."""
    span = orthonormal_basis(others)
    remaining = columns - span @ (span.T @ columns)
    before = np.einsum("nk,nk->k", columns, columns)
    after = np.einsum("nk,nk->k", remaining, remaining)
    result: FloatArray = remaining[:, after > 1e-4 * before]
    return result


_MAX_CHANCE_PROBABILITY = 1e-3
"""Chance of what is taken for more than noise."""
_MAX_ADDED_SIGMAS = 2.5
"""Standard errors by which the noise may go together more than it seems to."""
_FREE_SIGMAS = 0.5
"""Standard errors up to which it is taken to be as it seems."""
_MIN_DEGREES_OF_FREEDOM = 8.0
"""Degrees of freedom that the variance of the slowest noise is still given."""
_CORRELATION_GRID = np.array([0.0, 0.2, 0.4, 0.6, 0.75, 0.85, 0.92, 0.96, 0.98])


@dataclass(frozen=True, eq=False)
class ColouredNoise:
    """Noise in records of some sizes: its variance, how much each sample goes with the last."""

    sizes: tuple[int, ...]
    variance: float
    correlation: float
    degrees_of_freedom: float

    def expected_squares(self, way: FloatArray) -> float:
        """Sum of squares that orthonormal columns explain of it by chance."""
        smooth = _apply_correlation(way, self.correlation, self.sizes)
        return self.variance * float(np.einsum("nk,nk->", way, smooth))

    def can_explain(self, squares: float, chance: float, columns: int) -> bool:
        """Whether the noise might have given a sum of squares along some columns."""
        return (
            float(fdtrc(columns, self.degrees_of_freedom, squares / max(chance, 1e-300)))
            > _MAX_CHANCE_PROBABILITY
        )


def estimate_coloured_noise(
    deviation: FloatArray, shapes: FloatArray, sizes: Sequence[int]
) -> ColouredNoise:
    """Estimate the noise from what orthonormal shapes do not explain."""
    lengths = tuple(sizes)
    remaining = deviation - shapes @ (shapes.T @ deviation)
    power = max(float(remaining @ remaining), 1e-300)
    seen_correlation = float(remaining @ _mean_of_neighbours(remaining, lengths)) / power
    shifted = _mean_of_neighbours(shapes, lengths)
    # Products by einsum, on one thread: a library would wait for its others.
    within = np.einsum("nk,nl->kl", shapes, shifted)

    def expected_sums(correlation: float) -> tuple[float, float]:
        """Return the sums of squares, and of products with the sample before, that are left."""
        smooth = _apply_correlation(shapes, correlation, lengths)
        projected = np.einsum("nk,nl->kl", shapes, smooth)
        product_sum = (
            correlation * (deviation.size - len(lengths))
            - 2.0 * float(np.einsum("nk,nk->", shifted, smooth))
            + float(np.einsum("kl,kl->", within, projected))
        )
        return deviation.size - float(np.trace(projected)), product_sum

    expected = [expected_sums(at) for at in _CORRELATION_GRID]
    ratio = np.maximum.accumulate(
        [product_sum / expected_power for expected_power, product_sum in expected]
    )
    correlation = float(np.interp(seen_correlation, ratio, _CORRELATION_GRID))
    degrees_of_freedom = max(deviation.size - shapes.shape[1], 2)
    # Unsure by as much as a correlation is, but for what may as well be white.
    error = float(np.sqrt((1.0 - correlation**2) / degrees_of_freedom))
    added_sigmas = min(max(correlation / error - _FREE_SIGMAS, 0.0), _MAX_ADDED_SIGMAS)
    correlation = min(correlation + added_sigmas * error, float(_CORRELATION_GRID[-1]))
    expected_power, _ = expected_sums(correlation)
    independence = (1.0 - correlation**2) / (1.0 + correlation**2)
    return ColouredNoise(
        lengths,
        power / expected_power,
        correlation,
        max(degrees_of_freedom * independence, _MIN_DEGREES_OF_FREEDOM),
    )


def _apply_correlation(
    columns: FloatArray, correlation: float, sizes: tuple[int, ...]
) -> FloatArray:
    """Columns times the correlations of the noise, record by record."""
    if correlation == 0.0:
        return columns
    return np.concatenate(
        [
            recursive_sum(part, correlation) + recursive_sum(part[::-1], correlation)[::-1] - part
            for part in np.split(columns, np.cumsum(sizes)[:-1])
        ]
    )


def _mean_of_neighbours(columns: FloatArray, sizes: tuple[int, ...]) -> FloatArray:
    """Mean of the samples before and after each, nothing beyond the ends of a record."""
    pairs = []
    for part in np.split(columns, np.cumsum(sizes)[:-1]):
        mean = np.zeros_like(part)
        mean[1:] += 0.5 * part[:-1]
        mean[:-1] += 0.5 * part[1:]
        pairs.append(mean)
    return np.concatenate(pairs)
