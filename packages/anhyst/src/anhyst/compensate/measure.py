"""Measure each contribution to the error of a compensator with the exact model.

Each contribution is measured alone, while everything else is exact. The currents of the compensator
are applied to the exact model in double precision. The error is the model's output minus the
demand.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.block import Block, DemandLimits, TableSizes
from anhyst.compensate.builder import FINE_SIZES, BlockBuilder
from anhyst.compensate.circuit import current_coefficients, flux_unit, gap_knots, iron_parameters
from anhyst.compensate.force_controller import SignalFormat, make_twin
from anhyst.compensate.paths import DemandPath
from anhyst.model.actuator import Model
from anhyst.support.block_words import Scales
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0

LOSS_PERIOD_TICKS = 4
"""On the path with losses, the amplifier delivers a wrong current once in this number of ticks."""

LOSS_SEED = 3


@dataclass(frozen=True)
class PathRun:
    """Result of one path with one compensator."""

    path: DemandPath  # demands
    current: FloatArray  # applied current, in units of the input; shape (n,)
    output: FloatArray  # output of the exact model; shape (n,)
    # whether the applied current was that of the compensator; shape (n,)
    is_evaluated: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class OutputDeviation:
    """Worst and root-mean-square deviation of the output, in its unit, and the worst path."""

    worst: float
    rms: float
    path: str


def run_twin(model: Model, block: Block, io: SignalFormat, path: DemandPath) -> PathRun:
    """Run a compensator along a path, and the exact model with its currents."""
    current = make_twin(block, io).run(path.demand, path.gap)
    return PathRun(path, current, predict_output(model, current, path), np.ones(current.size, bool))


def run_with_losses(model: Model, block: Block, io: SignalFormat, path: DemandPath) -> PathRun:
    """Do the same as `run_twin` with an amplifier that deviates from the demand in some ticks."""
    size = path.demand.size
    is_evaluated = np.arange(size) % LOSS_PERIOD_TICKS != LOSS_PERIOD_TICKS - 1
    loss = 0.1 * np.random.default_rng(LOSS_SEED + size).standard_normal(size)
    current = make_twin(block, io).run_with_losses(path.demand, path.gap, np.where(is_evaluated, 0.0, loss))
    return PathRun(path, current, predict_output(model, current, path), is_evaluated)


def predict_output(model: Model, current: FloatArray, path: DemandPath) -> FloatArray:
    """Return the output of the model for a current along a path."""
    return model.predict(current, path.gap, history="demagnetised").output


def demand_error(run: PathRun, limits: DemandLimits, resolution: float) -> FloatArray:
    """Return output minus demand.

    At a current limit, only an error that a current within the limits could reduce is counted.
    """
    error = run.output - run.path.demand
    low, high = limits.current
    is_at_low_limit, is_at_high_limit = run.current <= low + resolution, run.current >= high - resolution
    error[is_at_low_limit] = np.minimum(error[is_at_low_limit], 0.0)
    error[is_at_high_limit] = np.maximum(error[is_at_high_limit], 0.0)
    return np.where(run.is_evaluated, error, 0.0)


def summarise_errors(errors: Iterable[tuple[str, FloatArray]]) -> OutputDeviation:
    """Return worst and root-mean-square error of several paths, given with their names."""
    magnitudes = [(name, np.abs(error)) for name, error in errors]
    worst_path = max(magnitudes, key=lambda item: float(item[1].max()))
    squares = np.concatenate([error for _, error in magnitudes]) ** 2
    return OutputDeviation(float(worst_path[1].max()), float(np.sqrt(squares.mean())), worst_path[0])


def current_resolution(scales: Scales) -> float:
    """Return two LSB of the words of the current limits, in units of the input."""
    return scales.current * 2.0**-14


def compare_with_demand(
    model: Model, block: Block, io: SignalFormat, paths: Sequence[DemandPath]
) -> tuple[OutputDeviation, list[tuple[PathRun, FloatArray]]]:
    """Run a compensator along all paths; the first random path is repeated with losses."""
    step = current_resolution(block.scales)
    runs = [run_twin(model, block, io, path) for path in paths]
    loss_path = next(path for path in paths if path.name == "reversals")
    title = "random reversals with an amplifier that deviates"
    runs.append(run_with_losses(model, block, io, replace(loss_path, name="losses", title=title)))
    runs_with_errors = [(run, demand_error(run, block.limits, step)) for run in runs]
    return summarise_errors((run.path.name, error) for run, error in runs_with_errors), runs_with_errors


def compare_compensators(
    model: Model,
    tested: tuple[Block, SignalFormat],
    reference: tuple[Block, SignalFormat],
    paths: Sequence[DemandPath],
) -> OutputDeviation:
    """Return the difference of the model's outputs between two compensators."""
    first, second = (predict_outputs(model, *compensator, paths) for compensator in (tested, reference))
    return compare_outputs(paths, first, second)


def predict_outputs(
    model: Model, block: Block, io: SignalFormat, paths: Sequence[DemandPath]
) -> list[FloatArray]:
    """Return the outputs of the model with a compensator, for each path."""
    return [run_twin(model, block, io, path).output for path in paths]


def compare_outputs(
    paths: Sequence[DemandPath], tested: Sequence[FloatArray], reference: Sequence[FloatArray]
) -> OutputDeviation:
    """Return the deviation between outputs of two compensators on the same paths."""
    pairs = zip(paths, tested, reference, strict=True)
    return summarise_errors(
        (path.name, tested_output - reference_output) for path, tested_output, reference_output in pairs
    )


def move_gaps_to_knots(
    paths: Sequence[DemandPath], model: Model, scales: Scales, sizes: TableSizes
) -> list[DemandPath]:
    """Return the paths with every gap moved to the nearest knot of the gap tables."""
    if not model.needs_schedule:
        return list(paths)
    knots = gap_knots(model, scales, sizes)
    middles = 0.5 * (knots[1:] + knots[:-1])

    def move_gap_to_knot(path: DemandPath) -> DemandPath:
        assert path.gap is not None
        return replace(path, gap=knots[np.searchsorted(middles, path.gap)])

    return [move_gap_to_knot(path) for path in paths]


def measure_gap_interpolation(
    model: Model, scales: Scales, limits: DemandLimits, sizes: TableSizes, paths: Sequence[DemandPath]
) -> OutputDeviation:
    """Return the error due to linear interpolation over the gap, with everything else exact."""
    if not model.needs_schedule:
        return OutputDeviation(0.0, 0.0, "")
    knots = gap_knots(model, scales, sizes)
    coefficients = current_coefficients(model, knots)
    unit, power = flux_unit(model), model.power
    circuit = model.circuit(knots, np.zeros(knots.size))
    alpha = iron_parameters(model)["alpha"]

    def error(path: DemandPath) -> FloatArray:
        gap = path.gap
        assert gap is not None

        def interpolate(values: FloatArray) -> FloatArray:
            return np.interp(gap, knots, values)

        demand_above_offset = path.demand - interpolate(circuit.out_0)
        gain = interpolate((1.0 / circuit.c_out) ** (1.0 / power)) / unit
        flux = gain * (np.sqrt(np.maximum(demand_above_offset, 0.0)) if power == 2 else demand_above_offset)
        circuit_at_knots = model.circuit(gap, np.zeros(gap.size))
        reached_record = model.invert(circuit_at_knots.output(flux * unit), gap, history="demagnetised")
        x = (1.0 - alpha) * reached_record.field + alpha * reached_record.flux_density / MU_0
        current = (
            interpolate(coefficients.bias)
            + interpolate(coefficients.flux) * flux
            + interpolate(coefficients.field) * x
        )
        current = np.clip(current, *limits.current)
        run = PathRun(path, current, predict_output(model, current, path), np.ones(x.size, bool))
        return demand_error(run, limits, 1e-9 * scales.current)

    return summarise_errors((path.name, error(path)) for path in paths)


BUDGET_SEED = 2
BUDGET_PATH_LENGTH = 4

CROSSING_TIME_S = 0.5
"""Time in which demand and gap cross their ranges when the error 'sample rate' is measured."""

MAX_CROSSING_TICKS = 400
"""Maximum number of simulated ticks of a crossing. At higher sample rates the error is scaled down
in proportion."""


@dataclass(frozen=True, slots=True)
class BudgetPart:
    """One row of the budget, in units of the output."""

    name: str  # identifier of the row
    title: str
    worst: float | None  # errors; None if there is nothing to measure
    rms: float | None
    note: str  # active error sources, and the path of the worst error


@dataclass(frozen=True)
class CompensatorTrial:
    """Measures all rows of a compensator's error budget; shared results are calculated once."""

    builder: BlockBuilder
    sizes: TableSizes
    block: Block  # compiled block
    static_block: Block  # block without eddy-current lag

    @cached_property
    def exact_block(self) -> Block:
        """Block with the same tables in double precision, without eddy-current lag."""
        return self.builder.exact_block(self.sizes)

    @cached_property
    def paths(self) -> list[DemandPath]:
        """Paths of the budget; they differ from those of the search."""
        return self.builder.output_range.paths(seed=BUDGET_SEED, length=BUDGET_PATH_LENGTH)

    @cached_property
    def compiled_runs(self) -> tuple[OutputDeviation, list[tuple[PathRun, FloatArray]]]:
        """Worst error of the compiled block over all paths, and the error along each path."""
        return compare_with_demand(self.builder.model, self.static_block, self.builder.io, self.paths)

    def measure_parts(self, reference_output: float) -> list[BudgetPart]:
        """Return the error of each step from the model to C; `reference_output` is 100 %."""
        return [
            *self._measure_law(),
            self._measure_tables(),
            self._measure_quantisation(),
            *self._measure_gap_tables(),
            self._measure_sampling(),
            *self._measure_rate(reference_output),
        ]

    def measure_compiled(self) -> BudgetPart:
        """Return the error of all steps together."""
        return _make_part("compiled", "compiled, all at once", *self.compiled_runs)

    def _measure_law(self) -> list[BudgetPart]:
        builder = self.builder
        if builder.kind == "full":
            return []
        measured_deviation = compare_with_demand(
            builder.model, builder.exact_block(FINE_SIZES), "f64", self.paths
        )
        part = _make_part("law", "straight anhysteretic", *measured_deviation)
        return [replace(part, note=f"the simplified law with fine tables; {part.note}")]

    def _measure_tables(self) -> BudgetPart:
        builder, model = self.builder, self.builder.model
        knot_paths = move_gaps_to_knots(self.paths, model, builder.scales, self.sizes)
        if builder.kind == "full":
            part = _make_part(
                "tables", "tables", *compare_with_demand(model, self.exact_block, "f64", knot_paths)
            )
            note = f"in double precision, at the gaps of the tables; {part.note}"
            return replace(part, note=note)
        fine_block = builder.exact_block(replace(FINE_SIZES, gap_segments=self.sizes.gap_segments))
        deviation = compare_compensators(model, (self.exact_block, "f64"), (fine_block, "f64"), knot_paths)
        note = "selected tables compared with fine tables, in double precision, at the gaps of the tables"
        return BudgetPart("tables", "tables", deviation.worst, deviation.rms, note)

    def _measure_quantisation(self) -> BudgetPart:
        io = self.builder.io
        deviation = compare_compensators(
            self.builder.model, (self.static_block, io), (self.exact_block, "f64"), self.paths
        )
        note = (
            f"{io} and {self.sizes.iterations} iterations compared with double precision "
            "and many iterations, on the same tables"
        )
        if self.builder.kind == "euler":
            note = "Euler steps and rounding compared with the closed form in double precision"
        return BudgetPart("quantisation", "quantisation", deviation.worst, deviation.rms, note)

    def _measure_gap_tables(self) -> list[BudgetPart]:
        builder, model = self.builder, self.builder.model
        if not model.needs_schedule:
            return []
        if builder.kind == "full":
            paths = builder.output_range.paths(
                above_remanence=True, seed=BUDGET_SEED, length=BUDGET_PATH_LENGTH
            )
            deviation = measure_gap_interpolation(model, builder.scales, builder.limits, self.sizes, paths)
            note = "linear interpolation over the gap, everything else exact"
        else:
            coarse_sizes, fine_sizes = (
                builder.exact_block(replace(FINE_SIZES, gap_segments=n))
                for n in (self.sizes.gap_segments, FINE_SIZES.gap_segments)
            )
            deviation = compare_compensators(model, (coarse_sizes, "f64"), (fine_sizes, "f64"), self.paths)
            note = "selected gap tables compared with those of the fit, with all other tables fine"
        return [BudgetPart("gap_interpolation", "gap interpolation", deviation.worst, deviation.rms, note)]

    def _measure_sampling(self) -> BudgetPart:
        """Return the error if each current acts two ticks late.

        One tick is the delay, and the second tick is the time for which the current is held.
        """
        builder = self.builder
        rate, output_range = builder.conditioning.rate, builder.output_range
        crossing_ticks = rate * CROSSING_TIME_S
        ticks = int(np.clip(crossing_ticks, 8, MAX_CROSSING_TICKS))
        wave = 1.0 - np.abs((np.arange(4 * ticks) / ticks) % 2.0 - 1.0)  # two cycles 0..1..0
        gap = builder.scales.gap_at(wave)
        demand = output_range.demand(0.05 + 0.9 * np.roll(wave, ticks // 2), gap, above_remanence=True)
        error = ticks / crossing_ticks * _delayed_error(builder.model, demand, gap)[2 * ticks :]
        note = (
            f"{rate:g} Hz: each current acts for one tick after one tick of delay, while demand and "
            f"gap cross their ranges in {CROSSING_TIME_S:g} s; proportional to their speed"
        )
        deviation = summarise_errors([("sample_rate", error)])
        return BudgetPart("sample_rate", "sample rate", deviation.worst, deviation.rms, note)

    def _measure_rate(self, reference_output: float) -> list[BudgetPart]:
        """Return the error for the fastest demands, with and without eddy-current lag."""
        builder, dynamic_model = self.builder, self.builder.dynamic_model
        if dynamic_model is None:
            return []
        rate, step = builder.conditioning.rate, current_resolution(builder.scales)
        paths = builder.output_range.fast_paths(
            dynamic_model.dynamics.fastest if dynamic_model.dynamics else 0.0, rate
        )

        def measure(used_block: Block) -> OutputDeviation:
            errors = []
            for path in paths:
                current = make_twin(used_block, builder.io).run(path.demand, path.gap)
                # A record begins at rest: one sample without field precedes the first tick.
                gap = path.gap
                first_gap = dynamic_model.schedule_or_default(None if gap is None else float(gap[0]))
                offset = dynamic_model.interpolate_parameter("in_0", [first_gap])
                drive = np.append(offset, current)
                gap = gap if gap is None else np.append(gap[0], gap)
                time = np.arange(drive.size) / rate
                output = dynamic_model.predict(drive, gap, time, history="demagnetised").output[1:]
                run = PathRun(path, current, output, np.ones(current.size, dtype=bool))
                errors.append((path.name, demand_error(run, builder.limits, step)))
            return summarise_errors(errors)

        compiled, static_error = measure(self.block), measure(self.static_block)
        titles = " and ".join(path.title for path in paths)
        note = (
            f"{titles}, compared with the model with layers; without eddy currents it would be "
            f"{100.0 * static_error.worst / reference_output:.2g} %"
        )
        return [BudgetPart("rate", "rate", compiled.worst, compiled.rms, note)]


def _make_part(
    name: str, title: str, deviation: OutputDeviation, runs: Sequence[tuple[PathRun, FloatArray]]
) -> BudgetPart:
    """Return the budget row of some runs, with the path of the worst error in its note."""
    worst_path = next(run.path.title for run, _ in runs if run.path.name == deviation.path)
    return BudgetPart(name, title, deviation.worst, deviation.rms, f"worst in {worst_path}")


def _delayed_error(model: Model, demand: FloatArray, gap: FloatArray) -> FloatArray:
    """Return output minus demand if each current is applied two ticks late, at the later gap.

    The hysteresis state is updated at the ticks only. Between ticks, the gap moves under a constant
    current that then jumps. Real iron returns to its state after such ripples. The law of the model
    drifts along such ripples at any sample rate, and this drift is not a sampling error.
    """
    iron, state = model.iron_at(float(gap[0])), np.zeros(model.operator_law.states)
    circuit = model.circuit(gap, np.zeros(gap.size))
    flux, _ = circuit.flux_density(demand)
    error = np.zeros(gap.size)
    no_rate = np.zeros(1)
    for tick in range(gap.size - 2):
        at_tick, two_ticks_later = slice(tick, tick + 1), slice(tick + 2, tick + 3)
        drive, _, state, _, _ = iron.inverse(flux[at_tick], circuit.rho[at_tick], no_rate, state)
        # The same current at the later gap, at which the circuit has other values of its current
        # factor and its offset.
        delayed_drive = drive * circuit.turns[two_ticks_later] / circuit.turns[at_tick]
        delayed_drive = delayed_drive + circuit.turns[two_ticks_later] * (
            circuit.in_0[at_tick] - circuit.in_0[two_ticks_later]
        )
        reached_flux, *_ = iron.forward(delayed_drive, circuit.rho[two_ticks_later], no_rate, state)
        output = circuit.c_out[two_ticks_later] * reached_flux**model.power + circuit.out_0[two_ticks_later]
        error[two_ticks_later] = output - demand[two_ticks_later]
    return error
