"""What a compensator of certain sizes costs: how far its output is from the demand, part by part.

Each part is switched on alone, everything else exact. The currents go through the exact model in
double precision, and what comes out is compared with what was demanded.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.block import Block, DemandLimits, TableSizes
from anhyst.compensate.builder import FINE, Builder
from anhyst.compensate.circuit import arms_of, flux_unit, iron_of, nodes
from anhyst.compensate.force_controller import Io, twin_of
from anhyst.compensate.paths import Path
from anhyst.model.actuator import Model
from anhyst.support.block_words import Scales
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0

LOSS_EVERY = 4
"""On the path with losses the amplifier gives what was wanted but for one tick in so many."""

LOSS_SEED = 3


@dataclass(frozen=True)
class PathRun:
    """One path under one compensator."""

    path: Path  # what was demanded
    current: FloatArray  # what was applied, in units of the input; shape (n,)
    output: FloatArray  # what the exact model makes of it; shape (n,)
    judged: NDArray[np.bool_]  # samples at which the current was the compensator's own; shape (n,)


@dataclass(frozen=True, slots=True)
class OutputDeviation:
    """Worst and root-mean-square deviation of the output, in its unit, and where the worst was."""

    worst: float
    rms: float
    path: str


def run_twin(model: Model, block: Block, io: Io, path: Path) -> PathRun:
    """Run a compensator along a path, and the exact model with its currents."""
    current = twin_of(block, io).run(path.demand, path.gap)
    return PathRun(path, current, exact_output(model, current, path), np.ones(current.size, bool))


def run_with_losses(model: Model, block: Block, io: Io, path: Path) -> PathRun:
    """Run a compensator whose amplifier now and then gives something else, as `run_twin`."""
    size = path.demand.size
    judged = np.arange(size) % LOSS_EVERY != LOSS_EVERY - 1
    loss = 0.1 * np.random.default_rng(LOSS_SEED + size).standard_normal(size)
    current = twin_of(block, io).run_with_losses(path.demand, path.gap, np.where(judged, 0.0, loss))
    return PathRun(path, current, exact_output(model, current, path), judged)


def exact_output(model: Model, current: FloatArray, path: Path) -> FloatArray:
    """Return what the model makes of a current along a path."""
    return model.predict(current, path.gap, history="demagnetised").output


def off_demand(run: PathRun, limits: DemandLimits, resolution: float) -> FloatArray:
    """Return output minus demand; at a limit of the current only what is on its wrong side."""
    error = run.output - run.path.demand
    low, high = limits.current
    bottom, top = run.current <= low + resolution, run.current >= high - resolution
    error[bottom] = np.minimum(error[bottom], 0.0)
    error[top] = np.maximum(error[top], 0.0)
    return np.where(run.judged, error, 0.0)


def deviation(errors: Iterable[tuple[str, FloatArray]]) -> OutputDeviation:
    """Sum up errors over several paths, given with their names."""
    kept = [(name, np.abs(error)) for name, error in errors]
    worst = max(kept, key=lambda item: float(item[1].max()))
    squares = np.concatenate([error for _, error in kept]) ** 2
    return OutputDeviation(float(worst[1].max()), float(np.sqrt(squares.mean())), worst[0])


def resolution(scales: Scales) -> float:
    """Return two steps of the words that hold the limits of the current, in units of the input."""
    return scales.current * 2.0**-14


def against_demand(
    model: Model, block: Block, io: Io, paths: Sequence[Path]
) -> tuple[OutputDeviation, list[tuple[PathRun, FloatArray]]]:
    """Run a compensator along all paths, the first of the random ones with losses as well."""
    step = resolution(block.scales)
    runs = [run_twin(model, block, io, path) for path in paths]
    lossy = next(path for path in paths if path.name == "reversals")
    title = "random reversals, the amplifier not following"
    runs.append(run_with_losses(model, block, io, replace(lossy, name="losses", title=title)))
    judged = [(run, off_demand(run, block.limits, step)) for run in runs]
    return deviation((run.path.name, error) for run, error in judged), judged


def between(
    model: Model, tested: tuple[Block, Io], reference: tuple[Block, Io], paths: Sequence[Path]
) -> OutputDeviation:
    """Compare two compensators: what the exact model makes of their currents."""
    first, second = (outputs(model, *each, paths) for each in (tested, reference))
    return apart(paths, first, second)


def outputs(model: Model, block: Block, io: Io, paths: Sequence[Path]) -> list[FloatArray]:
    """Return what the exact model makes of a compensator's currents, path by path."""
    return [run_twin(model, block, io, path).output for path in paths]


def apart(
    paths: Sequence[Path], tested: Sequence[FloatArray], reference: Sequence[FloatArray]
) -> OutputDeviation:
    """Return how far two compensators are apart, from their outputs on each path."""
    both = zip(paths, tested, reference, strict=True)
    return deviation((path.name, first - second) for path, first, second in both)


def snapped(paths: Sequence[Path], model: Model, scales: Scales, sizes: TableSizes) -> list[Path]:
    """Return the paths with every gap moved to the nearest entry of the tables over it."""
    if not model.needs_schedule:
        return list(paths)
    at = nodes(model, scales, sizes)
    middles = 0.5 * (at[1:] + at[:-1])

    def moved(path: Path) -> Path:
        assert path.gap is not None
        return replace(path, gap=at[np.searchsorted(middles, path.gap)])

    return [moved(path) for path in paths]


def interpolation(
    model: Model, scales: Scales, limits: DemandLimits, sizes: TableSizes, paths: Sequence[Path]
) -> OutputDeviation:
    """Return what straight lines between the entries over the gap cost, everything else exact."""
    if not model.needs_schedule:
        return OutputDeviation(0.0, 0.0, "")
    at = nodes(model, scales, sizes)
    arms = arms_of(model, at)
    unit, power = flux_unit(model), model.power
    circuit = model.circuit(at, np.zeros(at.size))
    alpha = iron_of(model)["alpha"]

    def error(path: Path) -> FloatArray:
        gap = path.gap
        assert gap is not None

        def over(values: FloatArray) -> FloatArray:
            return np.interp(gap, at, values)

        part = path.demand - over(circuit.out_0)
        gain = over((1.0 / circuit.c_out) ** (1.0 / power)) / unit
        flux = gain * (np.sqrt(np.maximum(part, 0.0)) if power == 2 else part)
        exact = model.circuit(gap, np.zeros(gap.size))
        reached = model.invert(exact.output(flux * unit), gap, history="demagnetised")
        x = (1.0 - alpha) * reached.field + alpha * reached.flux_density / MU_0
        current = over(arms.bias) + over(arms.flux_arm) * flux + over(arms.field_arm) * x
        current = np.clip(current, *limits.current)
        run = PathRun(path, current, exact_output(model, current, path), np.ones(x.size, bool))
        return off_demand(run, limits, 1e-9 * scales.current)

    return deviation((path.name, error(path)) for path in paths)


SEED = 2
LENGTH = 4

CROSSING = 0.5
"""Seconds in which the demand of the part 'sample rate' crosses its range, and the gap its own."""

MOST_TICKS = 400
"""Of a crossing that are simulated; at higher rates the deviation shrinks in proportion."""


@dataclass(frozen=True, slots=True)
class BudgetPart:
    """One line of the budget, in units of the output."""

    name: str  # key, and what a reader sees
    title: str
    worst: float | None  # deviations; None where there is nothing to measure
    rms: float | None
    note: str  # what was switched on, and where it was worst


@dataclass(frozen=True)
class CompensatorTrial:
    """A compensator on trial: what its parts are measured on is built once."""

    builder: Builder
    sizes: TableSizes
    block: Block  # as it is compiled
    still: Block  # without what answers late

    @cached_property
    def exact(self) -> Block:
        """The same tables in double precision, of the iron at rest."""
        return self.builder.exact(self.sizes)

    @cached_property
    def ways(self) -> list[Path]:
        """The paths of the budget, other ones than those of the search."""
        return self.builder.reach.paths(seed=SEED, length=LENGTH)

    @cached_property
    def everything(self) -> tuple[OutputDeviation, list[tuple[PathRun, FloatArray]]]:
        """Everything switched on: the worst of all paths, and the deviation along each."""
        return against_demand(self.builder.model, self.still, self.builder.io, self.ways)

    def parts(self, largest: float) -> list[BudgetPart]:
        """Return what each step from model to C costs; `largest` is the output of 100 %."""
        return [
            *self._law(),
            self._tables(),
            self._quantisation(),
            *self._gap(),
            self._sampling(),
            *self._rate(largest),
        ]

    def compiled(self) -> BudgetPart:
        """Return what all of them cost together."""
        return _worst_in("compiled", "compiled, all at once", *self.everything)

    def _law(self) -> list[BudgetPart]:
        builder = self.builder
        if builder.kind == "full":
            return []
        measured = against_demand(builder.model, builder.exact(FINE), "f64", self.ways)
        part = _worst_in("law", "straight anhysteretic", *measured)
        return [replace(part, note=f"the simplified law with fine tables; {part.note}")]

    def _tables(self) -> BudgetPart:
        builder, model = self.builder, self.builder.model
        at = snapped(self.ways, model, builder.scales, self.sizes)
        if builder.kind == "full":
            part = _worst_in("tables", "tables", *against_demand(model, self.exact, "f64", at))
            note = f"in double precision, at gaps that stand in the tables; {part.note}"
            return replace(part, note=note)
        fine = builder.exact(replace(FINE, gap_segments=self.sizes.gap_segments))
        off = between(model, (self.exact, "f64"), (fine, "f64"), at)
        note = "chosen against fine tables, in double precision, at gaps that stand in the tables"
        return BudgetPart("tables", "tables", off.worst, off.rms, note)

    def _quantisation(self) -> BudgetPart:
        io = self.builder.io
        off = between(self.builder.model, (self.still, io), (self.exact, "f64"), self.ways)
        note = (
            f"{io} and {self.sizes.iterations} iterations against double precision, many "
            "iterations and the same tables"
        )
        if self.builder.kind == "euler":
            note = "Euler's steps and rounding against the closed form in double precision"
        return BudgetPart("quantisation", "quantisation", off.worst, off.rms, note)

    def _gap(self) -> list[BudgetPart]:
        builder, model = self.builder, self.builder.model
        if not model.needs_schedule:
            return []
        if builder.kind == "full":
            lifted = builder.reach.paths(lifted=True, seed=SEED, length=LENGTH)
            off = interpolation(model, builder.scales, builder.limits, self.sizes, lifted)
            note = "straight lines between the entries over the gap, everything else exact"
        else:
            coarse, fine = (
                builder.exact(replace(FINE, gap_segments=n))
                for n in (self.sizes.gap_segments, FINE.gap_segments)
            )
            off = between(model, (coarse, "f64"), (fine, "f64"), self.ways)
            note = "chosen entries over the gap against those of the fit, everything else fine"
        return [BudgetPart("gap_interpolation", "gap interpolation", off.worst, off.rms, note)]

    def _sampling(self) -> BudgetPart:
        """Let every current act two ticks after its demand: one of delay, and the end of its hold."""
        builder = self.builder
        rate, reach = builder.conditioning.rate, builder.reach
        crossing = rate * CROSSING
        ticks = int(np.clip(crossing, 8, MOST_TICKS))
        wave = 1.0 - np.abs((np.arange(4 * ticks) / ticks) % 2.0 - 1.0)  # 0..1, twice to and fro
        gap = builder.scales.gap_at(wave)
        demand = reach.demand(0.05 + 0.9 * np.roll(wave, ticks // 2), gap, lifted=True)
        error = ticks / crossing * _late(builder.model, demand, gap)[2 * ticks :]
        note = (
            f"a current of {rate:g} Hz at the end of its hold, one tick of delay before "
            f"it, while demand and gap cross their ranges in {CROSSING:g} s; half as fast, half as much"
        )
        off = deviation([("sample_rate", error)])
        return BudgetPart("sample_rate", "sample rate", off.worst, off.rms, note)

    def _rate(self, largest: float) -> list[BudgetPart]:
        """Follow demands as fast as was measured, with the layers and without."""
        builder, late = self.builder, self.builder.late
        if late is None:
            return []
        rate, step = builder.conditioning.rate, resolution(builder.scales)
        ways = builder.reach.fast_paths(late.dynamics.fastest if late.dynamics else 0.0, rate)

        def off(used: Block) -> OutputDeviation:
            errors = []
            for path in ways:
                current = twin_of(used, builder.io).run(path.demand, path.gap)
                # A record begins at rest: a sample before the first tick, at which nothing flows.
                drive, gap = np.append(0.0, current), path.gap
                gap = gap if gap is None else np.append(gap[0], gap)
                time = np.arange(drive.size) / rate
                output = late.predict(drive, gap, time, history="demagnetised").output[1:]
                run = PathRun(path, current, output, np.ones(current.size, dtype=bool))
                errors.append((path.name, off_demand(run, builder.limits, step)))
            return deviation(errors)

        moving, still = off(self.block), off(self.still)
        titles = " and ".join(path.title for path in ways)
        note = (
            f"{titles}, against the model with its layers; compiled at rest it would be "
            f"{100.0 * still.worst / largest:.2g} %"
        )
        return [BudgetPart("rate", "rate", moving.worst, moving.rms, note)]


def _worst_in(
    name: str, title: str, off: OutputDeviation, runs: Sequence[tuple[PathRun, FloatArray]]
) -> BudgetPart:
    """Return the part of some runs, which says on which of them it was worst."""
    where = next(run.path.title for run, _ in runs if run.path.name == off.path)
    return BudgetPart(name, title, off.worst, off.rms, f"worst in {where}")


def _late(model: Model, demand: FloatArray, gap: FloatArray) -> FloatArray:
    """Output minus demand where each current acts two ticks late, at the gap of then.

    The iron's memory is advanced at the ticks alone. Between them the gap moves under a current
    that rests and then leaps; iron comes back from such ripples, but the law of the model drifts
    along them a little, at any rate, and this is not to be reported as an error of sampling.
    """
    iron, state = model.iron_at(float(gap[0])), np.zeros(model.operator_law.states)
    circuit = model.circuit(gap, np.zeros(gap.size))
    flux, _ = circuit.flux_density(demand)
    error = np.zeros(gap.size)
    none = np.zeros(1)
    for now in range(gap.size - 2):
        before, then = slice(now, now + 1), slice(now + 2, now + 3)
        drive, _, state, _, _ = iron.inverse(flux[before], circuit.rho[before], none, state)
        # The same current at the gap of two ticks later, where its turns count otherwise.
        later = drive * circuit.turns[then] / circuit.turns[before]
        later = later + circuit.turns[then] * (circuit.in_0[before] - circuit.in_0[then])
        reached, *_ = iron.forward(later, circuit.rho[then], none, state)
        output = circuit.c_out[then] * reached**model.power + circuit.out_0[then]
        error[then] = output - demand[then]
    return error
