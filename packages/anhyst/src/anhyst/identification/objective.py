"""Compute the residuals between measured and modelled loops over all loops and gaps.

:class:`Objective` evaluates residuals, gradient and normal matrix for a least-squares fit.
:class:`CellResponder` computes the outputs of play cells with derivatives, in the gauge-free form
of :mod:`.response`. For play cells, a steady-state cycle is exact after one pass.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from anhyst.identification.cell_kernel import CellPath, SimulatedCells
from anhyst.identification.fit_records import FitRecord
from anhyst.identification.response import (
    ParameterSet,
    Responder,
    ResponseForm,
    interpolate_over_gaps,
    output_derivatives,
    require_steepness,
)
from anhyst.identification.space import CoordinateSpace
from anhyst.support.errors import NoResponseError
from anhyst.support.numeric import FloatArray

_MAX_SAMPLES_PER_CALL = 20_000
"""Approximate number of samples per call; more would need more memory without gain in speed."""


class CellResponder:
    """Simulator of input records from the demagnetised state, with a cache of their groups."""

    def __init__(self) -> None:
        self._groups: dict[tuple[int, ...], list[_RecordGroup]] = {}
        self._grouped: Sequence[FitRecord] = ()

    def outputs(
        self, form: ResponseForm, sets: Sequence[ParameterSet], records: Sequence[FitRecord]
    ) -> list[FloatArray]:
        """Return the output of every record, SI."""
        outputs = []
        for cells, group in self._group_cells(form, sets, records):
            omega, r, _ = group.cell_inputs(sets)
            x, m = cells.follow(omega, r, group.record_starts)
            for record, samples in zip(group.records, group.record_slices, strict=True):
                parameter_set = sets[record.gap]
                b = m[samples] + parameter_set.h * x[samples]
                outputs.append(parameter_set.gain * b**form.power + parameter_set.out_0)
        return outputs

    def derivatives(
        self, form: ResponseForm, sets: Sequence[ParameterSet], records: Sequence[FitRecord]
    ) -> Iterator[tuple[int, FloatArray, FloatArray]]:
        """Yield gap, output and derivatives, shape (n, parameters), of every record."""
        for cells, group in self._group_cells(form, sets, records):
            omega, r, scale = group.cell_inputs(sets)
            # The dependence of the history on the circuit at other gaps is neglected.
            r_t = np.stack([-r * group.is_record_gap / scale, -group.is_record_gap / scale], axis=1)
            path = cells.follow_with_derivatives(omega, r, group.is_record_gap, r_t, group.record_starts)
            path = CellPath(*(values[group.sample_indices] for values in path))
            output, local_derivatives = output_derivatives(form, sets, group.gaps, path)
            for gap, samples in group.gap_slices:
                yield gap, output[samples], local_derivatives[samples]

    def _group_cells(
        self, form: ResponseForm, sets: Sequence[ParameterSet], records: Sequence[FitRecord]
    ) -> Iterator[tuple[SimulatedCells, _RecordGroup]]:
        """Yield each group of records with the cells that its records share."""
        assert form.cells is not None
        require_steepness(sets)
        try:
            cells = [form.cells.make_simulated_cells(parameter_set.law) for parameter_set in sets]
        except ValueError as error:
            raise NoResponseError(str(error)) from error
        if records is not self._grouped:
            self._groups, self._grouped = {}, records
        cell_indices = tuple(
            next(i for i, weights in enumerate(cells) if weights is gap_cells) for gap_cells in cells
        )
        if cell_indices not in self._groups:
            self._groups[cell_indices] = list(_group_records(records, cell_indices))
        for group in self._groups[cell_indices]:
            yield cells[group.records[0].gap], group


@dataclass(frozen=True, eq=False)
class _RecordGroup:
    """Concatenated input records, each preceded by its history."""

    records: Sequence[FitRecord]
    inputs: FloatArray  # SI; shape (n,)
    gap_position: FloatArray  # index of the gap of each sample; shape (n,)
    is_record_gap: FloatArray  # 1 at the gap of the record, else 0; shape (n,)
    record_starts: NDArray[np.int64]  # index of the first sample of each record with its history
    record_slices: Sequence[slice]  # samples of each record

    @cached_property
    def sample_indices(self) -> NDArray[np.intp]:
        """Indices of the record samples, without the histories."""
        return np.concatenate([np.arange(samples.start, samples.stop) for samples in self.record_slices])

    @cached_property
    def gap_slices(self) -> list[tuple[int, slice]]:
        """Gaps, and the slice of each gap in the samples of all records."""
        spans, begin = [], 0
        for gap, gap_records in groupby(self.records, lambda record: record.gap):
            end = begin + sum(record.input.size for record in gap_records)
            spans.append((gap, slice(begin, end)))
            begin = end
        return spans

    @cached_property
    def gaps(self) -> NDArray[np.intp]:
        """Gap of each sample of a record."""
        record_sizes = [record.input.size for record in self.records]
        return np.repeat([record.gap for record in self.records], record_sizes)

    def cell_inputs(self, sets: Sequence[ParameterSet]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return omega, the right side of the cell equation, and the input scale of each sample."""
        omega, scale, in_0 = interpolate_over_gaps(sets, self.gap_position)
        return omega, (self.inputs - in_0) / scale, scale


def _group_records(records: Sequence[FitRecord], cell_key: Sequence[int]) -> Iterator[_RecordGroup]:
    """Group successive records whose gaps use the same cells, about 20,000 samples per group."""
    for _, gap_records in groupby(records, lambda record: cell_key[record.gap]):
        group: list[FitRecord] = []
        for record in gap_records:
            group.append(record)
            if sum(record.input.size for record in group) > _MAX_SAMPLES_PER_CALL:
                yield _join_records(group)
                group = []
        if group:
            yield _join_records(group)


def _join_records(records: Sequence[FitRecord]) -> _RecordGroup:
    input_parts, gap_columns, gap_parts, starts, record_slices = [], [], [], [], []
    end = 0
    for record in records:
        history, n = record.remembered_history, record.input.size
        input_parts += [history.inputs, record.input]
        gap_columns += [history.gap_position, np.full(n, float(record.gap))]
        gap_parts += [(history.gap_position == record.gap).astype(np.float64), np.ones(n)]
        starts.append(end)
        end += history.inputs.size + n
        record_slices.append(slice(end - n, end))
    drive, gaps, is_own_gap = (np.concatenate(values) for values in (input_parts, gap_columns, gap_parts))
    return _RecordGroup(
        tuple(records), drive, gaps, is_own_gap, np.array(starts, dtype=np.int64), record_slices
    )


PRIOR_COST = 1e-8
"""Cost of a parameter that is one prior standard deviation from its prior mean, relative to the
largest output squared: the cost of a residual of 1e-4."""

DRIFT_STD = 0.003
"""Prior standard deviation of the drift of the output sensor in a record, relative to full scale.
"""

_MAX_PIECE_SAMPLES = 20_000
"""Maximum number of samples whose derivatives are stored at the same time, to limit memory. A
Jiles-Atherton cycle is never split, because its steady state needs the whole cycle; it has few
parameters."""

# residual for parameters without a solution, relative to the largest output
UNSOLVED_DEVIATION = 10.0


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals near a point to first order, as needed for a least-squares step."""

    deviation: FloatArray  # weighted residuals, shape (samples,)
    gradient: FloatArray  # gradient of half the sum of squares, shape (size,)
    normal: FloatArray  # normal matrix, shape (size, size)

    @property
    def cost(self) -> float:
        """Weighted sum of squares."""
        return float(self.deviation @ self.deviation)


@dataclass
class Objective:
    """Weighted residuals as a function of the coordinates of a space.

    With equal weights of all samples, the sum of squares is the mean square residual relative to
    the largest output squared. ``evaluations`` counts the simulations.

    With ``smoothness`` above zero, differences of coordinates between neighbouring gaps are
    additional residuals, multiplied by its square root. Parameters with a prior mean add residuals
    too (:data:`PRIOR_COST`).

    For play cells, a linear drift of the output since the first sample at a gap is fitted and
    removed, if the clock shows the order of the loops. A Jiles-Atherton law has larger model errors
    than sensor drift, and would fit them with a drift.
    """

    space: CoordinateSpace
    smoothness: float = 0.0
    evaluations: int = 0

    def __post_init__(self) -> None:
        loops = self.space.records.loops
        self._responder: Responder | CellResponder = Responder()
        if self.space.form.cells:
            self._responder = CellResponder()
            loops = tuple(piece for record in loops for piece in record.make_pieces(_MAX_PIECE_SAMPLES))
        self._loops = loops
        self.measured = np.concatenate([record.output for record in loops])
        self.weights = np.concatenate([record.weights for record in loops])
        self._smoothness_rows = np.sqrt(self.smoothness) * _make_smoothness_rows(self.space)
        self._prior_rows, self._prior_targets = _make_prior_rows(self.space)
        self._regularisation = (
            self._smoothness_rows.T @ self._smoothness_rows + self._prior_rows.T @ self._prior_rows
        )
        clocks = np.concatenate([record.clock for record in loops]) * bool(self.space.form.cells)
        self._drift = _Drift(self.space.records.output_span * clocks * self.weights)

    @property
    def unsolved_deviations(self) -> FloatArray:
        """Residuals for parameters without a solution."""
        large_residual = UNSOLVED_DEVIATION * self.space.records.output_span * self.weights
        return np.concatenate(
            [large_residual, np.zeros(1 + self._smoothness_rows.shape[0] + self._prior_targets.size)]
        )

    def outputs(self, sets: list[ParameterSet]) -> FloatArray:
        """Return the modelled outputs of all loops, one after the other, SI."""
        self.evaluations += 1
        return np.concatenate(self._responder.outputs(self.space.form, sets, self._loops))

    def deviations(self, theta: FloatArray) -> FloatArray:
        """Return weighted residuals, (samples,), followed by drift cost and regularisation."""
        try:
            outputs = self.outputs([parameter_set for parameter_set, _ in self.space.unpack(theta)])
        except NoResponseError:
            return self.unsolved_deviations
        residual = (outputs - self.measured) * self.weights
        residual, cost = self._drift.subtract_from(residual)
        return np.concatenate(
            [residual, cost, self._smoothness_rows @ theta, self._prior_rows @ theta - self._prior_targets]
        )

    def normal_equations(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return residuals, gradient of half their sum of squares, and normal matrix.

        The matrices are summed gap by gap. Therefore, parameters of one gap need no computation at
        other gaps, and no product is so large that a library would use several threads.
        """
        self.evaluations += 1
        sets = self.space.unpack(theta)
        numbers = len(self.space.form.names)
        gap_normals = np.zeros((len(sets), numbers, numbers))
        gap_gradients = np.zeros((len(sets), numbers))
        values, gap_drifts = [], np.zeros((len(sets), numbers))
        start, sets_by_gap = 0, [parameter_set for parameter_set, _ in sets]
        responses = self._responder.derivatives(self.space.form, sets_by_gap, self._loops)
        for gap, output, derivatives in responses:
            samples = slice(start, start + output.size)
            weights = self.weights[samples]
            value, weighted_derivatives = (
                (output - self.measured[samples]) * weights,
                derivatives * weights[:, None],
            )
            gap_normals[gap] += weighted_derivatives.T @ weighted_derivatives
            gap_gradients[gap] += value @ weighted_derivatives
            if self._drift.has_drift:
                gap_drifts[gap] += self._drift.drift_direction[samples] @ weighted_derivatives
            start = samples.stop
            values.append(value)
        residual = np.concatenate(values)
        residual_without_drift, cost = self._drift.subtract_from(residual)
        values = [
            residual_without_drift,
            cost,
            self._smoothness_rows @ theta,
            self._prior_rows @ theta - self._prior_targets,
        ]
        gradient = self._smoothness_rows.T @ values[-2] + self._prior_rows.T @ values[-1]
        matrix = self._regularisation
        for (_, coordinate_derivatives), square, slope in zip(sets, gap_normals, gap_gradients, strict=True):
            gradient = gradient + slope @ coordinate_derivatives
            matrix = matrix + coordinate_derivatives.T @ square @ coordinate_derivatives
        if self._drift.has_drift:
            drift_derivatives = np.einsum(
                "gn,gnk->k",
                gap_drifts,
                np.stack([coordinate_derivatives for _, coordinate_derivatives in sets]),
            )
            gradient = gradient - self._drift.slope(residual) * drift_derivatives
            matrix = matrix - np.outer(drift_derivatives, drift_derivatives) / self._drift.squared_norm
        return np.concatenate(values), gradient, matrix

    def linearise(self, theta: FloatArray) -> Linearisation:
        """Linearise at a point; derivatives are zero if the law has no solution there.

        Analytic derivatives are used if the law has them.
        """
        if not self.space.form.kernel.has_derivatives:
            deviation = self.deviations(theta)
            jacobian = self.numerical_jacobian(theta)
            return Linearisation(deviation, deviation @ jacobian, jacobian.T @ jacobian)
        try:
            return Linearisation(*self.normal_equations(theta))
        except NoResponseError:
            zero_jacobian = np.zeros((theta.size, theta.size))
            return Linearisation(self.unsolved_deviations, zero_jacobian[0], zero_jacobian)

    def linearise_if_better(self, theta: FloatArray, cost: float) -> Linearisation | None:
        """Linearise if the cost is below a limit, else return None."""
        if not self.space.form.kernel.has_derivatives:
            deviations = self.deviations(theta)
            if float(deviations @ deviations) >= cost:
                return None
        expansion = self.linearise(theta)
        return expansion if expansion.cost < cost else None

    def numerical_jacobian(self, theta: FloatArray) -> FloatArray:
        """Return central differences, one-sided at the bounds."""
        lower, upper = self.space.bounds
        columns = []
        for index in range(theta.size):
            pair = []
            for step in (-1e-5, 1e-5):
                moved_theta = theta.copy()
                moved_theta[index] = np.clip(moved_theta[index] + step, lower[index], upper[index])
                pair.append((moved_theta[index], self.deviations(moved_theta)))
            columns.append((pair[1][1] - pair[0][1]) / (pair[1][0] - pair[0][0]))
        return np.stack(columns, axis=1)


class _Drift:
    """A linear drift of the residuals, and the residuals without it."""

    def __init__(self, drift: FloatArray) -> None:
        self.drift_direction = drift
        self._prior_weight = np.sqrt(PRIOR_COST) / DRIFT_STD
        self.squared_norm = float(drift @ drift) + self._prior_weight**2
        self.has_drift = bool(np.any(drift))

    def slope(self, deviation: FloatArray) -> float:
        """Return the slope with the lowest cost."""
        return float(self.drift_direction @ deviation / self.squared_norm)

    def subtract_from(self, deviation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residuals without the drift, and the cost of the drift as a residual."""
        slope = self.slope(deviation)
        return deviation - self.drift_direction * slope, np.array([self._prior_weight * slope])


def _make_smoothness_rows(space: CoordinateSpace) -> FloatArray:
    """Return matrix rows for the coordinate differences of neighbouring gaps, without offsets."""
    column_indices = {entry: index for index, entry in enumerate(space.entries)}
    pairs = [
        (column_indices[name, gap], column_indices[name, gap + 1])
        for name, gap in space.entries
        if gap is not None and gap + 1 < space.records.gap_count and name not in {"in_0", "out_0"}
    ]
    rows = np.zeros((len(pairs), space.size))
    for row, (begin, second) in zip(rows, pairs, strict=True):
        row[begin], row[second] = -1.0, 1.0
    return rows


def _make_prior_rows(space: CoordinateSpace) -> tuple[FloatArray, FloatArray]:
    """Return matrix rows that divide coordinates by their prior deviation, and the prior means."""
    rows, targets = [], []
    for row, (name, _) in zip(np.eye(space.size), space.entries, strict=True):
        fit_parameter = space.fit_parameters[name]
        if fit_parameter.prior_mean is not None:
            weight = np.sqrt(PRIOR_COST) / fit_parameter.prior_std
            rows.append(weight * row)
            targets.append(weight * space.to_coordinate(name, fit_parameter.prior_mean))
    return np.array(rows).reshape(-1, space.size), np.array(targets)
