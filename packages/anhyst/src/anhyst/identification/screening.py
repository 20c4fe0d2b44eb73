"""Generate start parameters for a search, and select those with the smallest residual.

For a Jiles-Atherton law, the core simulates many parameter sets at one gap in one batch. Offset and
gain of the output follow by linear regression, so that only pinning, reversibility, interaction and
the input scale are sampled. For play cells, normalised parameters are sampled: the drive relative
to the width of the curve, pinning and its spread, the reversible part, and the fraction of the
drive across the iron. Scale, gain and the gap-dependent parameters then follow in closed form from
the largest output at every gap.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anhyst._core import batch, batch_levels
from anhyst.data.path import thin_rows
from anhyst.identification.cell_kernel import CellKernel
from anhyst.identification.fit_records import FitRecord, FitRecords
from anhyst.identification.response import MAX_FLATNESS, PARAMETER_NAMES, ParameterSet, ResponseForm
from anhyst.identification.space import SERIES_MAPS, CoordinateSpace
from anhyst.laws.cells import Shape
from anhyst.support.errors import InputError, NoUsableStartError
from anhyst.support.numeric import FloatArray

# environment variable that selects the instruction set of the batch
INSTRUCTION_SET_VARIABLE = "ANHYST_DISPATCH"
# for omega <= -3, the magnetisation may jump; the batch does not support this
JUMP_INTERACTION = 3.0

_MIN_OMEGA = -2.95

_SCAN_VALUES = 32  # values tried for a parameter at one gap
_WARM_UP_CYCLES = 2  # repetitions of a cycle before the comparison; enough to rank sets
_MAX_BIAS_RATIO = 1.5  # largest sampled input offset, relative to the largest input

_MIN_SIDE_RATIO = 0.3
"""Smallest ratio of the smaller to the larger side of a bipolar input."""

_SCREENING_SAMPLES = 64  # maximum number of samples per loop in the screening


def read_instruction_set() -> str:
    """Return the best instruction set of the batch, or that of the environment variable."""
    instruction_sets = batch_levels()
    instruction_set = os.environ.get(INSTRUCTION_SET_VARIABLE)
    if instruction_set is None:
        return instruction_sets[-1]
    if instruction_set not in instruction_sets:
        raise InputError(
            f"{INSTRUCTION_SET_VARIABLE}: there is no level {instruction_set!r} on this processor; set one of "
            f"{', '.join(instruction_sets)}, or unset it for the best",
            code="unknown-level",
            key=INSTRUCTION_SET_VARIABLE,
        )
    return instruction_set


def sample_unit_cube(dimensions: int, count: int, seed: int) -> FloatArray:
    """Return evenly distributed points of the unit cube, shape (dimensions, count).

    The points are multiples of powers of the root of ``x**(d+1) = x + 1``, the golden ratio in d
    dimensions (Roberts 2018), from a random start. Sobol's sequence is not better here, and
    importing SciPy's takes longer than the whole search.
    """
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1.0)
    start = np.random.default_rng(seed).random(dimensions)
    return np.asarray((start[:, None] + steps[:, None] * np.arange(count)) % 1.0)


def sample_sets(
    records: FitRecords, count: int, seed: int, is_interacting: bool = True, is_biased: bool = False
) -> FloatArray:
    """Sample kappa, c, omega, scale and in_0 evenly in normalised ranges.

    The ranges cover the visible properties of loops: largest effective field (0.3 to 30,
    logarithmic), pinning relative to that field (0.01 to 3, logarithmic), reversibility (0 to
    0.95), and omega + 3 (0.1 to 300, logarithmic) unless omega is zero. in_0 is zero, or, if
    biased, up to 1.5 times the largest input in both directions, most densely near zero.
    """
    draws = sample_unit_cube(5 if is_biased else 4, count, seed)
    max_field = 0.3 * 100.0 ** draws[0]
    pinning_ratio = np.clip(max_field * 0.01 * 300.0 ** draws[1], 5e-3, 2e2)
    c = 0.95 * draws[2]
    omega = 0.1 * 3000.0 ** draws[3] - JUMP_INTERACTION if is_interacting else np.zeros(count)
    langevin_at_max = 1.0 / np.tanh(max_field) - 1.0 / max_field
    drive = np.maximum(max_field + omega * langevin_at_max, 0.1 * max_field)
    largest_input = max(float(np.max(np.abs(record.input))) for record in records.loops)
    in_0 = _MAX_BIAS_RATIO * largest_input * (2.0 * draws[4] - 1.0) ** 3 if is_biased else np.zeros(count)
    return np.stack([pinning_ratio, c, omega, largest_input / drive, in_0])


def screen_sets(
    form: ResponseForm, records: FitRecords, sets: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the cost of many sets at one gap, with the best gain and offset of each."""
    moments, total = _regression_moments(form, records, sets[:4], sets[4])
    weight_sum, sum_b, sum_bb, sum_y, sum_by = moments
    determinant = weight_sum * sum_bb - sum_b**2
    gain = (weight_sum * sum_by - sum_b * sum_y) / np.where(determinant > 0.0, determinant, np.inf)
    out_0 = (sum_y - gain * sum_b) / weight_sum
    return np.where(gain > 0.0, _regression_cost(moments, total, gain, out_0), np.inf), gain, out_0


def follow_sets(
    record: FitRecord, sample_indices: NDArray[np.intp], sets: FloatArray, offset: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Simulate one record with many parameter sets at the same time."""
    pinning_ratio, c, omega = (np.ascontiguousarray(row) for row in sets[:3])
    scale = 1.0 / sets[3]
    x, y = np.zeros(pinning_ratio.size), np.zeros(pinning_ratio.size)
    inputs = np.ascontiguousarray(record.input[sample_indices])
    # The path to the first sample uses small steps, because long linear steps are not exact.
    initial_path = np.concatenate(
        [np.linspace(0.0, next_input, 16)[1:] for next_input in (*record.history.inputs, inputs[0])]
    )
    simulate = partial(batch, pinning_ratio, c, omega, scale, offset, x=x, y=y, level=read_instruction_set())
    simulate(drive=initial_path, keep=False)
    for _ in range(_WARM_UP_CYCLES if record.is_cycle else 0):
        simulate(drive=inputs, keep=False)
    m, xi = simulate(drive=inputs)
    return m, xi


def _regression_moments(
    form: ResponseForm, records: FitRecords, sets: FloatArray, offset: FloatArray
) -> tuple[FloatArray, float]:
    """Return weighted sums over all samples, from which the cost of any gain and offset follows.

    With the output b for gain 1 and the measured output y, these are 1, b, b^2, y, b*y; and the sum
    of y^2.
    """
    moments = np.zeros((5, sets.shape[1]))
    total = 0.0
    for record in records.loops:
        sample_indices = thin_rows(record.input, _SCREENING_SAMPLES)
        m, x_out = follow_sets(record, sample_indices, sets, offset)
        shape = (m + form.h * x_out) ** form.power
        weight = record.weight**2 * record.input.size / sample_indices.size
        measured_samples = record.output[sample_indices]
        moments[0] += weight * sample_indices.size
        moments[1] += weight * shape.sum(axis=0)
        moments[2] += weight * np.einsum("ij,ij->j", shape, shape)
        moments[3] += weight * measured_samples.sum()
        moments[4] += weight * (measured_samples @ shape)
        total += weight * float(measured_samples @ measured_samples)
    return moments, total


def _regression_cost(moments: FloatArray, total: float, gain: FloatArray, out_0: FloatArray) -> FloatArray:
    weight_sum, sum_b, sum_bb, sum_y, sum_by = moments
    square = total + gain**2 * sum_bb + out_0**2 * weight_sum
    return np.asarray(square + 2.0 * (gain * out_0 * sum_b - gain * sum_by - out_0 * sum_y))


def screen_starts(space: CoordinateSpace, count: int, max_starts: int, seed: int) -> list[ParameterSet]:
    """Return the best sets of a screening at a single gap, with a minimum distance between them."""
    is_interacting = "omega" not in space.fixed
    start_sets = _select_best_sets(space, sample_sets(space.records, count, seed, is_interacting), max_starts)
    # A bias is visible only if the output is even in the flux and the drive is bipolar.
    low = min(float(loop.input.min()) for loop in space.records.loops)
    high = max(float(loop.input.max()) for loop in space.records.loops)
    is_bipolar = low < -_MIN_SIDE_RATIO * high and high > -_MIN_SIDE_RATIO * low
    if "in_0" not in space.fixed and space.form.power == 2 and is_bipolar:
        start_sets += _select_best_sets(
            space, sample_sets(space.records, count, seed, is_interacting, is_biased=True), max_starts
        )
    if not start_sets:
        raise NoUsableStartError
    return start_sets


def _select_best_sets(space: CoordinateSpace, sets: FloatArray, max_starts: int) -> list[ParameterSet]:
    cost, gain, out_0 = screen_sets(space.form, space.records, sets)
    features = np.stack([np.log(sets[0]), 3.0 * sets[1], np.log(sets[2] + JUMP_INTERACTION)])
    chosen: list[int] = []
    for index in np.argsort(cost):
        if not np.isfinite(cost[index]) or len(chosen) == max_starts:
            break
        if all(np.linalg.norm(features[:, index] - features[:, earlier]) > 0.7 for earlier in chosen):
            chosen.append(int(index))
    if "out_0" in space.fixed:
        out_0 = np.zeros(out_0.size)
    pinning_ratio, c, omega, scale, in_0 = sets
    best_sets = np.stack([pinning_ratio, c, omega, scale, gain, in_0, out_0], axis=1)[chosen]
    return [space.form.make_set(values) for values in best_sets.tolist()]


def scan_gap(
    space: CoordinateSpace, gap: int, start_sets: list[ParameterSet]
) -> tuple[list[ParameterSet], FloatArray]:
    """Find the best gap-dependent parameter at one gap, with all other parameters fixed."""
    count = len(start_sets)
    table = np.repeat(_parameter_table(start_sets), _SCAN_VALUES, axis=1)
    if space.gap_map in SERIES_MAPS:
        input_per_field = table[3] * (1.0 - space.form.h * table[2])
        log_omegas = np.linspace(np.log(0.05), np.log(300.0), _SCAN_VALUES)
        table[2] = np.tile(np.exp(log_omegas) - JUMP_INTERACTION, count)
        table[3] = input_per_field / np.maximum(1.0 - space.form.h * table[2], 0.01)
    else:
        table[3] *= np.tile(5.0 ** np.linspace(-1.0, 1.0, _SCAN_VALUES), count)
    cost = _table_cost(space, gap, table).reshape(count, _SCAN_VALUES)
    best_indices = np.argmin(cost, axis=1)
    best_columns = best_indices + _SCAN_VALUES * np.arange(count)
    sets = [
        replace(parameter_set, omega=float(table[2, index]), scale=float(table[3, index]))
        for parameter_set, index in zip(start_sets, best_columns, strict=True)
    ]
    return sets, cost[np.arange(count), best_indices]


def cost_at_gap(space: CoordinateSpace, gap: int, sets: list[ParameterSet]) -> FloatArray:
    """Return the cost of each set at one gap, without fitting it, shape (len(sets),)."""
    return _table_cost(space, gap, _parameter_table(sets))


def _parameter_table(sets: list[ParameterSet]) -> FloatArray:
    """Return the sets as columns, with the parameters as rows in the order of PARAMETER_NAMES."""
    return np.array([[getattr(parameter_set, name) for parameter_set in sets] for name in PARAMETER_NAMES])


def _table_cost(space: CoordinateSpace, gap: int, table: FloatArray) -> FloatArray:
    pinning_ratio, c, omega, scale, gain, in_0, out_0 = table
    sets = np.stack([pinning_ratio, c, np.maximum(omega, _MIN_OMEGA), scale])
    moments, total = _regression_moments(space.form, space.records.at_gap(gap), sets, in_0)
    return _regression_cost(moments, total, gain, out_0)


CURVE_SLOPES: dict[Shape, float] = {"tanh": 1.0, "langevin": 1.0 / 3.0}
"""Slope of each curve at its middle."""

_LARGEST_FIELD_RANGE = (0.4, 8.0)
"""Largest effective field, relative to the width of the first population divided by the initial
slope of its curve."""

_PINNING_RANGE = (0.02, 1.0)  # pinning of a population, relative to the largest effective field

_SPREAD_RANGE = (0.7, 5.0)
_REVERSIBLE_SHARE_RANGE = (0.02, 1.5)  # reversible saturation, relative to the first population

_REVERSIBLE_WIDTH_RANGE = (0.3, 6.0)
_FURTHER_SATURATION_RANGE = (0.1, 1.5)
_FURTHER_WIDTH_RANGE = (0.2, 8.0)
"""Ranges of saturation and width of a further population, relative to the first population."""

_IRON_DRIVE_SHARE_WITH_GAP = (0.02, 0.9)
_IRON_DRIVE_SHARE_WITHOUT_GAP = (0.3, 4.0)
"""Ranges of the fraction of the drive across the iron, with a gap and without one. Without a gap,
interaction may increase the field."""

_MAX_INTERACTION_RATIO = 0.8  # largest interaction, relative to the value at which M jumps

_CURVE_SAMPLES = 200


class CellStart(NamedTuple):
    """Start point: law parameters, largest effective field, drive fraction across the iron."""

    law: tuple[float, ...]
    max_field: float
    iron_drive_share: float


def sample_cell_starts(kernel: CellKernel, count: int, seed: int, has_gap: bool) -> list[CellStart]:
    """Sample starts evenly over the logarithms of their ranges."""
    first_ranges = [_REVERSIBLE_SHARE_RANGE, _REVERSIBLE_WIDTH_RANGE, _PINNING_RANGE, _SPREAD_RANGE]
    further_ranges = [_FURTHER_SATURATION_RANGE, _FURTHER_WIDTH_RANGE, _PINNING_RANGE, _SPREAD_RANGE]
    ranges = [
        _LARGEST_FIELD_RANGE,
        _IRON_DRIVE_SHARE_WITH_GAP if has_gap else _IRON_DRIVE_SHARE_WITHOUT_GAP,
        *first_ranges,
        *further_ranges * (kernel.population_count - 1),
    ]
    low, high = np.log(np.array(ranges)).T[:, :, None]
    samples = low + (high - low) * sample_unit_cube(len(ranges), count, seed)
    starts = []
    for scaled_field, iron_drive_share, *law in np.exp(samples).T.tolist():
        max_field = scaled_field / CURVE_SLOPES[kernel.shape]
        law[2::4] = [pinned * max_field for pinned in law[2::4]]
        starts.append(CellStart(tuple(law), max_field, iron_drive_share))
    return starts


def scale_to_loops(space: CoordinateSpace, start: CellStart) -> list[ParameterSet]:
    """Return a parameter set for each gap whose curve passes through the largest output there."""
    form = space.form
    field = np.linspace(0.0, 3.0 * start.max_field, _CURVE_SAMPLES)
    assert space.form.cells is not None
    field, curve = space.form.cells.make_simulated_cells(start.law).follow(np.zeros(field.size), field)
    largest_inputs, outputs = _largest_by_gap(space)
    reference = space.records.reference_gap
    max_magnetisation = float(np.interp(start.max_field, field, curve))
    omega = start.max_field * (1.0 / start.iron_drive_share - 1.0) / max_magnetisation
    omega = max(omega, -_MAX_INTERACTION_RATIO / float(np.max(np.diff(curve) / np.diff(field))))
    scale = largest_inputs[reference] / (start.max_field + omega * max_magnetisation)
    gain = outputs[reference] / max_magnetisation**form.power
    sets = []
    for largest_input, output in zip(largest_inputs, outputs, strict=True):
        m = (output / gain) ** (1.0 / form.power)
        x = float(np.interp(m, curve, field))
        omega_and_scale = (omega, scale)
        if space.gap_map in SERIES_MAPS:
            omega_and_scale = (max((largest_input / scale - x) / m, 0.0), scale)
        elif len(largest_inputs) > 1:
            omega_and_scale = (omega, largest_input / (x + omega * m))
        sets.append(form.make_set([*start.law, *omega_and_scale, gain, 0.0, 0.0]))
    return sets


def has_valid_scales(sets: Sequence[ParameterSet]) -> bool:
    """Whether scales and gains of a start are positive, and its curve is not too flat."""
    return all(
        parameter_set.scale > 0.0
        and parameter_set.gain > 0.0
        and parameter_set.h * parameter_set.omega < MAX_FLATNESS
        for parameter_set in sets
    )


def _largest_by_gap(space: CoordinateSpace) -> tuple[FloatArray, FloatArray]:
    """Return input and output at the largest output of each gap, as absolute values."""
    drives, outputs = np.zeros(space.records.gap_count), np.zeros(space.records.gap_count)
    for record in space.records.loops:
        row = int(np.argmax(np.abs(record.output)))
        if abs(record.output[row]) > outputs[record.gap]:
            drives[record.gap] = abs(record.input[row])
            outputs[record.gap] = abs(record.output[row])
    return drives, outputs
