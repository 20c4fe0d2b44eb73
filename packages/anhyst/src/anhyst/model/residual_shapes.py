"""Compute the shapes that typical causes produce in a residual, and a model of correlated noise.

A shape is a group of columns over all samples. Noise of a filtered sensor, a converter or a slow
supply is correlated from sample to sample and looks smooth over a few samples. The correlation of
the noise is estimated from the part of the residual that no shape explains. The shapes remove the
slow part of the noise first, which reduces the correlation of the remainder. The estimate corrects
for this reduction.
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
"""Degree of the polynomial in the input for a deviation that is common to all loops."""
_WIDTH_DEGREE = 5
"""Degree of the polynomial in the input for the difference of ascending and descending branches."""
_GROUP_OFFSET_DEGREE = 2
"""Degree of the polynomial in the input for the deviation of each gap or each loop size."""
_DECAY_POWERS = (1, 2, 4)
"""Powers of the remaining fraction of the first branch, with which the effect of a wrong history
fades."""
_MIN_INDEPENDENT_SHARE = 1e-6
"""Minimum strength of an independent direction, relative to the strongest direction."""


@dataclass(frozen=True, eq=False)
class Residual:
    """The residual of a fit on one record."""

    drive: FloatArray  # input, SI; shape (n,)
    measured: FloatArray  # measured output, SI; shape (n,)
    deviation: FloatArray  # modelled minus measured output, SI; shape (n,)
    gap: int  # index of the scheduling value of the record
    is_cycle: bool  # whether the record is a cycle that is repeated until it closes

    def keep_every_nth_sample(self, step: int) -> Residual:
        """Return every n-th sample; `step` is n."""
        drive, measured_output, deviation = (
            values[::step] for values in (self.drive, self.measured, self.deviation)
        )
        return Residual(drive, measured_output, deviation, self.gap, self.is_cycle)


def _branch_positions(record: Residual) -> FloatArray:
    """Return the positions of the samples of a record on its branches, shape (4, samples).

    The rows are the direction (1 ascending, -1 descending), the position on the branch from -1 at
    its lower end to 1 at its upper end, half of the range of the branch in units of the input, and
    the remaining part of the first branch, from 1 to 0 and 0 after it.
    """
    drive = record.drive
    branch_list = find_branches(drive)
    direction, position, half_ranges = np.ones(drive.size), np.zeros(drive.size), np.ones(drive.size)
    for branch in branch_list:
        branch_input = drive[branch.rows]
        half_range = max(0.5 * float(np.ptp(branch_input)), 1e-300)
        direction[branch.rows] = 1.0 if branch.is_rising else -1.0
        position[branch.rows] = (branch_input - float(branch_input.min())) / half_range - 1.0
        half_ranges[branch.rows] = half_range
    first_branch_rest = np.zeros(drive.size)
    if not record.is_cycle or len(branch_list) > 2:
        first_rows = branch_list[0].rows
        first_branch_rest[first_rows] = 0.5 * (1.0 - direction[first_rows] * position[first_rows])
    return np.stack([direction, position, half_ranges, first_branch_rest])


def shape_columns(records: Sequence[Residual]) -> dict[Shape, list[FloatArray]]:
    """Return the columns of each cause, shape (samples, ..), with the records one after the other.

    A cause may act equally at all gaps or in proportion to the output, so both variants are
    returned. Differences between gaps or loop sizes do not contain the part that is common to all.
    """
    direction, position, half_ranges, first_branch_rest = np.concatenate(
        [_branch_positions(record) for record in records], axis=1
    )
    drive = np.concatenate([record.drive for record in records])
    mid_input, half_range = 0.5 * float(drive.max() + drive.min()), 0.5 * float(np.ptp(drive))
    scaled_input = (drive - mid_input) / max(half_range, 1e-300)
    sizes = [record.drive.size for record in records]
    gap = np.repeat([record.gap for record in records], sizes)
    largest_outputs = np.zeros(int(gap.max()) + 1)
    for record in records:
        largest_outputs[record.gap] = max(largest_outputs[record.gap], float(np.max(np.abs(record.measured))))
    relative_output = (largest_outputs / max(float(largest_outputs.max()), 1e-300))[gap][:, None]
    weights: list[FloatArray | float] = [1.0, relative_output] if largest_outputs.size > 1 else [1.0]
    curve_columns = legvander(scaled_input, _CURVE_DEGREE)
    width = direction[:, None] * np.hstack([legvander(scaled_input, _WIDTH_DEGREE), legvander(position, 3)])
    start_columns = first_branch_rest[:, None] ** np.array(_DECAY_POWERS)
    common_columns = np.hstack([curve_columns, width])
    record_time = np.concatenate([np.linspace(-1.0, 1.0, size) for size in sizes])
    total_time = np.linspace(-1.0, 1.0, sum(sizes))
    shapes: dict[Shape, list[FloatArray]] = {
        "input": [np.asarray(weight * curve_columns) for weight in weights],
        "direction": [np.asarray(weight * width) for weight in weights],
        "drift": [np.asarray(time[:, None]) for time in (record_time, total_time)[: len(sizes)]],
    }
    if np.any(first_branch_rest):
        shapes["start"] = [weight * start_columns for weight in weights]
    if largest_outputs.size > 1:
        shapes["gap"] = [remove_explained(_columns_by_gap(records, gap, scaled_input), common_columns)]
    if np.ptp(half_ranges) > 0.1 * float(half_ranges.max()):
        shapes["amplitude"] = [
            remove_explained(_columns_by_branch_size(half_ranges, position, direction), common_columns)
        ]
    return shapes


def _columns_by_gap(records: Sequence[Residual], gap: FloatArray, scaled_input: FloatArray) -> FloatArray:
    """Return the columns of each gap: polynomials of the input, and the relative output."""
    # The modelled output is used, because measured output contains the noise and would explain it.
    output = np.concatenate([record.measured + record.deviation for record in records])
    relative_output = output / max(float(np.abs(output).max()), 1e-300)
    shared_columns = np.column_stack([legvander(scaled_input, _GROUP_OFFSET_DEGREE), relative_output])
    return np.hstack([(gap == node)[:, None] * shared_columns for node in np.unique(gap)])


def _columns_by_branch_size(span: FloatArray, position: FloatArray, is_rising: FloatArray) -> FloatArray:
    """Return columns of position and direction, times the relative branch size and its square."""
    size = span / float(span.max())
    shared_columns = legvander(position, _GROUP_OFFSET_DEGREE)
    both_directions = np.hstack([shared_columns, is_rising[:, None] * shared_columns])
    return np.hstack([size[:, None] * both_directions, size[:, None] ** 2 * both_directions])


def orthonormal_basis(columns: FloatArray) -> FloatArray:
    """Return orthonormal columns with the same span, without dependent directions."""
    norms = np.sqrt(np.einsum("nk,nk->k", columns, columns))
    unit_columns = columns[:, norms > 0.0] / norms[norms > 0.0]
    eigenvalues, eigenvectors = np.linalg.eigh(unit_columns.T @ unit_columns)
    is_independent = eigenvalues > _MIN_INDEPENDENT_SHARE * eigenvalues.max(initial=1e-300)
    return np.ascontiguousarray(
        unit_columns @ (eigenvectors[:, is_independent] / np.sqrt(eigenvalues[is_independent]))
    )


def remove_explained(columns: FloatArray, other_columns: FloatArray) -> FloatArray:
    """Subtract the part of columns that other columns explain; drop columns without a remainder."""
    basis = orthonormal_basis(other_columns)
    remaining_columns = columns - basis @ (basis.T @ columns)
    squares_before = np.einsum("nk,nk->k", columns, columns)
    squares_after = np.einsum("nk,nk->k", remaining_columns, remaining_columns)
    kept_columns: FloatArray = remaining_columns[:, squares_after > 1e-4 * squares_before]
    return kept_columns


_MAX_CHANCE_PROBABILITY = 1e-3
"""A shape counts as more than noise if noise alone explains as much with a smaller probability."""
_MAX_ADDED_SIGMAS = 2.5
"""Largest number of standard errors that are added to the estimated correlation of the noise."""
_FREE_SIGMAS = 0.5
"""Number of standard errors up to which a correlation counts as zero, so that nothing is added."""
_MIN_DEGREES_OF_FREEDOM = 8.0
"""Smallest number of degrees of freedom of the noise variance, for the slowest noise."""
_CORRELATION_GRID = np.array([0.0, 0.2, 0.4, 0.6, 0.75, 0.85, 0.92, 0.96, 0.98])


@dataclass(frozen=True, eq=False)
class ColouredNoise:
    """Noise in records of given sizes: its variance, and the correlation of successive samples."""

    sizes: tuple[int, ...]
    variance: float
    correlation: float
    degrees_of_freedom: float

    def expected_squares(self, columns: FloatArray) -> float:
        """Return the sum of squares of the noise that orthonormal columns explain by chance."""
        correlated_columns = _apply_correlation(columns, self.correlation, self.sizes)
        return self.variance * float(np.einsum("nk,nk->", columns, correlated_columns))

    def can_explain(self, explained_squares: float, expected_squares: float, columns: int) -> bool:
        """Whether the noise may cause a sum of squares that a number of columns explains."""
        return (
            float(fdtrc(columns, self.degrees_of_freedom, explained_squares / max(expected_squares, 1e-300)))
            > _MAX_CHANCE_PROBABILITY
        )


def estimate_coloured_noise(deviation: FloatArray, shapes: FloatArray, sizes: Sequence[int]) -> ColouredNoise:
    """Estimate the noise from the part of the residual that orthonormal shapes do not explain."""
    record_sizes = tuple(sizes)
    remaining_deviation = deviation - shapes @ (shapes.T @ deviation)
    square_sum = max(float(remaining_deviation @ remaining_deviation), 1e-300)
    seen_correlation = (
        float(remaining_deviation @ _mean_of_neighbours(remaining_deviation, record_sizes)) / square_sum
    )
    neighbour_means = _mean_of_neighbours(shapes, record_sizes)
    # einsum uses one thread; a threaded product would wait for other threads.
    shape_products = np.einsum("nk,nl->kl", shapes, neighbour_means)

    def expected_sums(correlation: float) -> tuple[float, float]:
        """Return the expected sum of squares, and of products of neighbouring samples."""
        correlated_shapes = _apply_correlation(shapes, correlation, record_sizes)
        projected_shapes = np.einsum("nk,nl->kl", shapes, correlated_shapes)
        product_sum = (
            correlation * (deviation.size - len(record_sizes))
            - 2.0 * float(np.einsum("nk,nk->", neighbour_means, correlated_shapes))
            + float(np.einsum("kl,kl->", shape_products, projected_shapes))
        )
        return deviation.size - float(np.trace(projected_shapes)), product_sum

    expected_by_correlation = [expected_sums(trial_correlation) for trial_correlation in _CORRELATION_GRID]
    apparent_correlation = np.maximum.accumulate(
        [product_sum / expected_power for expected_power, product_sum in expected_by_correlation]
    )
    correlation = float(np.interp(seen_correlation, apparent_correlation, _CORRELATION_GRID))
    degrees_of_freedom = max(deviation.size - shapes.shape[1], 2)
    # Add the uncertainty of the correlation, except for noise that may be white.
    standard_error = float(np.sqrt((1.0 - correlation**2) / degrees_of_freedom))
    added_sigmas = min(max(correlation / standard_error - _FREE_SIGMAS, 0.0), _MAX_ADDED_SIGMAS)
    correlation = min(correlation + added_sigmas * standard_error, float(_CORRELATION_GRID[-1]))
    expected_power, _ = expected_sums(correlation)
    independent_fraction = (1.0 - correlation**2) / (1.0 + correlation**2)
    return ColouredNoise(
        record_sizes,
        square_sum / expected_power,
        correlation,
        max(degrees_of_freedom * independent_fraction, _MIN_DEGREES_OF_FREEDOM),
    )


def _apply_correlation(columns: FloatArray, correlation: float, sizes: tuple[int, ...]) -> FloatArray:
    """Multiply columns by the correlation matrix of the noise, record by record."""
    if correlation == 0.0:
        return columns
    return np.concatenate(
        [
            recursive_sum(record_columns, correlation)
            + recursive_sum(record_columns[::-1], correlation)[::-1]
            - record_columns
            for record_columns in np.split(columns, np.cumsum(sizes)[:-1])
        ]
    )


def _mean_of_neighbours(columns: FloatArray, sizes: tuple[int, ...]) -> FloatArray:
    """Return the mean of the samples before and after each; zeros beyond the ends of a record."""
    neighbour_means = []
    for record_columns in np.split(columns, np.cumsum(sizes)[:-1]):
        neighbour_mean = np.zeros_like(record_columns)
        neighbour_mean[1:] += 0.5 * record_columns[:-1]
        neighbour_mean[:-1] += 0.5 * record_columns[1:]
        neighbour_means.append(neighbour_mean)
    return np.concatenate(neighbour_means)
