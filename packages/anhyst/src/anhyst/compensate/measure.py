"""How far a compensator's output is from the demand, and the paths along which that is measured."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from anhyst._core import FixedCompensator
from anhyst.compensate.block import (
    Block,
    DemandLimits,
    TableSizes,
    arms_of,
    flux_unit,
    iron_of,
    nodes,
)
from anhyst.compensate.force_controller import FixedTwin, Io, RealTwin, twin_of
from anhyst.model.actuator import Model
from anhyst.support.block_words import Scales
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0

MARGIN = 0.98
"""Of the largest output that the largest current gives: a demand must be reachable to be judged."""

STEP = 0.005
"""Of a random walk, in parts of the range: many of them make the way of one reversal."""

GAPS = 33
"""Places over the gap at which it is found out what can be reached."""


CYCLES, MOST_TICKS = 3, 8000
"""Of fast demands: cycles, and ticks of all of them at most."""

BAND = (0.1, 0.6)
"""Of fast demands, in parts of what can be reached at rest: they take more current."""


@dataclass(frozen=True)
class Path:
    """A demand over a gap, sample by sample."""

    name: str  # key of the path
    title: str  # what it is, for a reader
    demand: FloatArray  # in units of the output; shape (n,)
    # scheduling variable, SI; None where the model does not need it; shape (n,)
    gap: FloatArray | None


@dataclass(frozen=True)
class Reach:
    """Range of the output at each gap, for currents within their limits."""

    gaps: FloatArray  # scheduling variable, SI; shape (g,)
    # smallest demand that is asked for, and largest, in units of the output; shape (g,)
    low: FloatArray
    high: FloatArray
    left: FloatArray  # output that the smallest current leaves after the largest; shape (g,)

    def demand(self, part: FloatArray, gap: FloatArray, lifted: bool = False) -> FloatArray:
        """Return demands at parts 0..1 of the range; `lifted` above what a current can leave."""
        bottom = self.left + 0.03 * (self.high - self.left) if lifted else self.low
        low, high = (np.interp(gap, self.gaps, end) for end in (bottom, self.high))
        return np.asarray(low + (high - low) * part)


def find_reach(model: Model, scales: Scales, limits: DemandLimits) -> Reach:
    """Find out which outputs can be reached over the gap."""
    gaps = np.linspace(scales.gap_low, scales.gap_high, GAPS)
    low, high = limits.current
    turns = np.array([high, low, high, low])
    ends = np.array([model.predict(turns, gap, history="demagnetised").output for gap in gaps])
    span = ends[:, 2] - ends[:, 3]
    top = np.minimum(ends[:, 3] + MARGIN * span, limits.demand[1])
    bottom = np.full(GAPS, limits.demand[0])
    if model.power == 2:  # the square of a flux is never negative
        bottom = np.maximum(bottom, model.over_schedule("out_0", gaps))
    else:
        bottom = np.maximum(bottom, ends[:, 2] - MARGIN * span)
    return Reach(gaps, bottom, top, ends[:, 3])


def paths(
    model: Model,
    scales: Scales,
    limits: DemandLimits,
    *,
    lifted: bool = False,
    seed: int = 1,
    length: int = 1,
) -> list[Path]:
    """Return everything that a compensator is measured on."""
    reach = find_reach(model, scales, limits)
    collected = []
    for name, (title, part, share) in _shapes(model.needs_schedule, seed, 1500 * length).items():
        gap = scales.gap_at(share)
        shown = title if model.needs_schedule else title.removesuffix(", gap at rest")
        demand = reach.demand(part, gap, lifted)
        collected.append(Path(name, shown, demand, gap if model.needs_schedule else None))
    return collected


def fast_paths(model: Model, scales: Scales, limits: DemandLimits, rate: float) -> list[Path]:
    """Return demands as fast as the model was seen to hold, and a tenth of it; the gap moves slowly."""
    fastest = model.dynamics.fastest if model.dynamics else 0.0
    fastest = min(fastest or rate / 200.0, rate / 20.0)
    reach = find_reach(model.at_rest, scales, limits)
    collected = []
    for speed in (fastest, 0.1 * fastest):
        ticks = min(round(CYCLES * rate / speed), MOST_TICKS)
        phase = np.arange(ticks) * speed / rate
        part = 1.0 - np.abs(2.0 * (phase % 1.0) - 1.0)
        rise = np.minimum(phase / 0.5, 1.0)  # from rest
        gap = scales.gap_at(0.5 * (1.0 - np.cos(2.0 * np.pi * phase / CYCLES)))
        low, high = (BAND[0] * rise, BAND[0] + (BAND[1] - BAND[0]) * rise)
        demand = reach.demand(low + (high - low) * part, gap)
        title = f"triangles of {speed:.3g} Hz, gap moving"
        collected.append(
            Path(f"fast_{speed:.3g}", title, demand, gap if model.needs_schedule else None)
        )
    return collected


def _shapes(moves: bool, seed: int, size: int) -> dict[str, tuple[str, FloatArray, FloatArray]]:
    """Return title, demand and gap of each path, both 0..1."""
    random = np.random.default_rng(seed)
    shapes = {
        "nested": (
            "nested loops, gap at rest",
            np.resize(_nested(), size),
            _at_rest(random, size, 250),
        ),
        "reversals": (
            "random reversals, gap at rest",
            _reversals(random, size),
            _at_rest(random, size, 200),
        ),
        "jumps": (
            "full-range jumps in one sample, gap at rest",
            _jumps(random, size),
            _at_rest(random, size, 50),
        ),
    }
    if moves:
        shapes["moving"] = (
            "random reversals, gap moving",
            _reversals(random, size),
            _reversals(random, size, 90.0),
        )
        shapes["moving_jumps"] = (
            "jumps of demand and gap in one sample",
            _jumps(random, size),
            _jumps(random, size),
        )
        shapes["walking"] = (
            "demand and gap walking together",
            _walk(random, size),
            _walk(random, size),
        )
    return shapes


def _nested() -> FloatArray:
    """Triangles inside each other, from zero to the largest and around three middles; 0..1."""
    corners = [0.0]
    for middle in (0.5, 0.2, 0.8):
        for half in min(middle, 1.0 - middle) * np.array([1.0, 0.75, 0.5, 0.3, 0.15, 0.05]):
            corners += [middle + half, middle - half]
    corners.append(0.0)
    at = np.linspace(0.0, len(corners) - 1.0, 1500)
    return np.interp(at, np.arange(len(corners)), corners)


def _reversals(random: np.random.Generator, size: int, stride: float = 25.0) -> FloatArray:
    """Return straight lines between random turning points at random times; 0..1."""
    times = np.concatenate([[0.0], np.cumsum(random.exponential(stride, size))])
    levels = random.random(times.size)
    levels[0] = 0.0
    extreme = random.random(times.size) < 0.15
    levels[extreme] = np.round(levels[extreme])
    return np.interp(np.arange(size), times, levels)


def _jumps(random: np.random.Generator, size: int) -> FloatArray:
    """Return another level at every sample, half of them at one of the ends; 0..1."""
    levels = random.random(size)
    ends = random.random(size) < 0.5
    levels[ends] = np.round(levels[ends])
    return levels


def _walk(random: np.random.Generator, size: int) -> FloatArray:
    """Return small random steps on top of each other, turning back at the ends; 0..1."""
    walk = random.random() + np.cumsum(random.normal(0.0, STEP, size))
    return np.abs((walk + 1.0) % 2.0 - 1.0)


def _at_rest(random: np.random.Generator, size: int, length: int) -> FloatArray:
    """Return fractions 0..1 of the gap range, each held for ``length`` samples, both ends included."""
    levels = random.random(-(-size // length))
    levels[:2] = 0.0, 1.0
    return np.repeat(levels, length)[:size]


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
    loss = 0.1 * np.random.default_rng(LOSS_SEED + size).standard_normal(size)
    twin = twin_of(block, io)
    if isinstance(twin, FixedTwin):
        current = _lossy_codes(twin, path, loss) / twin.one * block.scales.current
    else:
        current = _lossy_numbers(twin, path, loss)
    judged = np.arange(size) % LOSS_EVERY != LOSS_EVERY - 1
    return PathRun(path, current, exact_output(model, current, path), judged)


def _lossy_codes(twin: FixedTwin, path: Path, loss: FloatArray) -> FloatArray:
    """Return the applied currents as codes; `loss` is in parts of the range of the current."""
    core = FixedCompensator(twin.block.kind, twin.block.words)
    solve, commit = (
        (core.solve_q15, core.commit_q15) if twin.io == "q15" else (core.solve_q31, core.commit_q31)
    )
    low, high = twin.current_codes(twin.block.limits.current).tolist()
    losses = ((high - low) * loss).round().astype(int).tolist()
    demands = twin.demand_codes(path.demand).tolist()
    gaps = twin.gap_codes(path.gap, loss.size).tolist()
    codes = []
    for index, (demand, gap) in enumerate(zip(demands, gaps, strict=True)):
        code = solve(demand, gap)
        if index % LOSS_EVERY == LOSS_EVERY - 1:
            code = min(max(code + losses[index], low), high)
        commit(code, gap)
        codes.append(code)
    return np.array(codes, dtype=np.float64)


def _lossy_numbers(twin: RealTwin, path: Path, loss: FloatArray) -> FloatArray:
    """Return the applied currents; `loss` is in parts of their range."""
    low, high = twin.block.limits.current
    losses = ((high - low) * loss).tolist()
    gaps = [None] * loss.size if path.gap is None else path.gap.tolist()
    currents = []
    for index, (demand, gap) in enumerate(zip(path.demand.tolist(), gaps, strict=True)):
        current = twin.solve(demand, gap)
        if index % LOSS_EVERY == LOSS_EVERY - 1:
            current = min(max(current + losses[index], low), high)
        twin.commit(current, gap)
        currents.append(current)
    return np.array(currents)


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
