"""Search controller gains for stated aims.

The search has three parts. First, a screen evaluates many gains in loops that are linearised at
every gap and load, and finds initial guesses. It neglects hysteresis and noise, and limits the
force demand of the largest step. Then, a CMA evolution strategy improves the gains in the nonlinear
loop. Finally, a check runs the best gains with all noise seeds. If the check misses an aim, the
search continues with tighter limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from operator import call
from typing import Any, Protocol

import numpy as np
from cmaes import CMA

from anhyst.support.errors import NegativeResult
from anhyst.support.jobs import Progress, map_ordered
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.drift import change_rig
from anhyst_rigs.study.bearing.linear import LinearLoop
from anhyst_rigs.study.bearing.operating import find_operating_point, make_linear_loop
from anhyst_rigs.study.tuning.aims import MISSED_AIM_COST, Aims, GainFigures
from anhyst_rigs.study.tuning.trial import (
    BearingCondition,
    CheckResult,
    GainOutcome,
    SearchBox,
    Tunable,
    run_trial,
)


class CmaStrategy:
    """A CMA evolution strategy in the unit box, with an ask-and-tell interface."""

    def __init__(self, mean: FloatArray, sigma: float, seed: list[int], population_size: int) -> None:
        unit_box = np.tile([0.0, 1.0], (mean.size, 1))
        cma_seed = int(np.random.SeedSequence(seed).generate_state(1)[0])
        self._optimiser = CMA(mean, sigma, bounds=unit_box, seed=cma_seed, population_size=population_size)
        self._points: list[FloatArray] = []

    def ask(self) -> FloatArray:
        """Return the points of the next generation, shape (population_size, n)."""
        self._points = [self._optimiser.ask() for _ in range(self._optimiser.population_size)]
        return np.array(self._points)

    def tell(self, costs: FloatArray) -> None:
        """Update the strategy with the costs of the last points, in the same order."""
        self._optimiser.tell(list(zip(self._points, costs.tolist(), strict=True)))


_FREQUENCY_COUNT = 72
_OUTPUT_INTERVAL_TICKS = 4  # must be a power of two
_SETTLING_BAND = 0.02  # settling band, relative to the step height

SOBOL_POINTS = 1024
"""Number of Sobol points that are evaluated first; a power of two."""
REFINEMENT_GENERATIONS = 24
"""Number of generations that improve the best Sobol point."""
REFINEMENT_POPULATION = 32
"""Number of points in each of these generations."""


@dataclass(frozen=True)
class ScreenResult:
    """Metrics of linear loops for n sets of gains, the worst values of all conditions."""

    # All arrays have the shape (n,). A settling time beyond the horizon is infinite.
    overshoot_percent: FloatArray
    settling_time_s: FloatArray
    peak_sensitivity: FloatArray
    # force demand of the largest step, relative to the available force
    effort: FloatArray

    def costs(self, aims: Aims, horizon_s: float) -> FloatArray:
        """Return a cost like that of :meth:`Aims.cost` for each set of gains, shape (n,)."""
        excess = np.zeros(self.peak_sensitivity.size)
        limits = {"overshoot_percent": aims.overshoot_percent, "effort": 1.0}
        for name, limit in (limits | {"peak_sensitivity": aims.peak_sensitivity}).items():
            relative_excess = getattr(self, name) / limit - 1.0
            excess += np.clip(np.nan_to_num(relative_excess, nan=100.0, posinf=100.0), 0.0, 100.0)
        is_settled = np.isfinite(self.settling_time_s)
        excess += np.where(is_settled, 0.0, 10.0)
        settling_time_s = np.where(is_settled, self.settling_time_s, horizon_s)
        return np.where(excess > 0.0, MISSED_AIM_COST + excess, settling_time_s)


class Screen:
    """Linear loops at several conditions, with which gains are evaluated quickly."""

    def __init__(self, loops: Sequence[LinearLoop], reserves: Sequence[float], horizon_s: float) -> None:
        self.loops = tuple(loops)
        self.horizon_s = horizon_s
        self._reserves = tuple(reserves)
        rate = loops[0].timing.rate
        self._rate = rate
        frequency = np.geomspace(rate / 1000.0, rate / 2.5, _FREQUENCY_COUNT)
        self._z = np.exp(2j * np.pi * frequency / rate)
        self._plants = [loop.plant_response(frequency) for loop in loops]

    def with_loops(self, loops: Sequence[LinearLoop]) -> Screen:
        """Return a screen with other loops for the same conditions."""
        return Screen(loops, self._reserves, self.horizon_s)

    def select_loops(self, indices: Iterable[int]) -> Screen:
        """Return a screen that contains only some of the loops."""
        selected_loops = list(indices)
        reserves = [self._reserves[index] for index in selected_loops]
        return Screen([self.loops[index] for index in selected_loops], reserves, self.horizon_s)

    def with_scaled_force(self, factor: float) -> Screen:
        """Return a screen in which the available force is multiplied by a factor."""
        return Screen(self.loops, [factor * reserve for reserve in self._reserves], self.horizon_s)

    def evaluate(self, per_tick: FloatArray) -> ScreenResult:
        """Evaluate n sets of gains, as rows of `anhyst.control.Pidd2.per_tick`, shape (n, 11)."""
        peak = np.max([self._peak_sensitivity(index, per_tick) for index in range(len(self.loops))], axis=0)
        steps = [self._evaluate_step(index, per_tick) for index in range(len(self.loops))]
        return ScreenResult(
            overshoot_percent=np.max([result[0] for result in steps], axis=0),
            settling_time_s=np.max([result[1] for result in steps], axis=0),
            peak_sensitivity=peak,
            effort=np.max([result[2] for result in steps], axis=0),
        )

    def _peak_sensitivity(self, index: int, per_tick: FloatArray) -> FloatArray:
        p, k, d, e, _, _, s, t, _ = (column[:, None] for column in per_tick.T[:9])
        z_minus_1 = self._z - 1.0
        first_derivative = s * z_minus_1 / (z_minus_1 + s)
        second_derivative = t * z_minus_1 / (z_minus_1 + t) * first_derivative
        feedback = p + k / z_minus_1 + d * first_derivative + e * second_derivative
        compensation = self.loops[index].compensation
        loop_gain = (feedback + compensation.k_s) / compensation.k_i * self._plants[index]
        return np.asarray(np.max(1.0 / np.abs(1.0 + loop_gain), axis=1))

    def _evaluate_step(self, index: int, per_tick: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return overshoot (%), settling time (s) and force ratio for a step of the reference."""
        loop = self.loops[index]
        matrix, input_vector = closed_loop_matrices(loop, per_tick)
        for _ in range(int(np.log2(_OUTPUT_INTERVAL_TICKS))):
            input_vector = (matrix @ input_vector[..., None])[..., 0] + input_vector
            matrix = matrix @ matrix
        c = np.concatenate([loop.plant[2], np.zeros(3)])
        p, _, d, e, _, _, s, t, weight = per_tick.T[:9]
        controller_output = np.stack([d * s + e * s * t, e * t, np.ones(p.size)], axis=1)
        position_output = (-p - d * s - e * s * t)[:, None] * loop.plant[2]
        output_rows = np.concatenate([position_output, controller_output], axis=1)
        # response of the force demand to a step of the reference in the same tick, N/m
        feedthrough = weight * p
        count = round(self.horizon_s * self._rate / _OUTPUT_INTERVAL_TICKS)
        state = np.zeros_like(input_vector)
        position = np.empty((count, input_vector.shape[0]))
        force = np.abs(feedthrough)
        with np.errstate(all="ignore"):  # Unstable loops overflow.
            for tick in range(count):
                state = (matrix @ state[..., None])[..., 0] + input_vector
                position[tick] = state @ c
                force = np.maximum(force, np.abs(np.sum(state * output_rows, axis=1) + feedthrough))
            position = np.nan_to_num(position, nan=1e9, posinf=1e9, neginf=-1e9)
            overshoot = 100.0 * np.maximum(position.max(axis=0) - 1.0, 0.0)
            is_outside = np.abs(position - 1.0) > _SETTLING_BAND
        last_outside = count - 1 - np.argmax(is_outside[::-1], axis=0)
        settling_time_s = np.where(
            is_outside.any(axis=0), (last_outside + 1) * _OUTPUT_INTERVAL_TICKS / self._rate, 0.0
        )
        return (overshoot, np.where(is_outside[-1], np.inf, settling_time_s), force / self._reserves[index])


def closed_loop_matrices(loop: LinearLoop, per_tick: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return, for one tick, the matrices of closed loops and the input vectors of the reference."""
    a, b, c = loop.plant
    n, m = per_tick.shape[0], a.shape[0]
    p, k, d, e, _, _, s, t, weight = per_tick.T[:9]
    controller_matrix = np.zeros((n, 3, 3))
    controller_matrix[:, 0, 0] = 1.0 - s
    controller_matrix[:, 1, 0] = -s * t
    controller_matrix[:, 1, 1] = 1.0 - t
    controller_matrix[:, 2, 2] = 1.0
    controller_output = np.stack([d * s + e * s * t, e * t, np.ones(n)], axis=1)
    inverse_k_i = 1.0 / loop.compensation.k_i
    position_gain = inverse_k_i * (-p - d * s - e * s * t - loop.compensation.k_s)
    matrix = np.zeros((n, m + 3, m + 3))
    matrix[:, :m, :m] = a + position_gain[:, None, None] * np.outer(b, c)
    matrix[:, :m, m:] = inverse_k_i * b[:, None] * controller_output[:, None, :]
    matrix[:, m:, :m] = np.stack([s, s * t, -k], axis=1)[:, :, None] * c
    matrix[:, m:, m:] = controller_matrix
    input_vector = np.zeros((n, m + 3))
    input_vector[:, :m] = (inverse_k_i * weight * p)[:, None] * b
    input_vector[:, m + 2] = k
    return matrix, input_vector


def minimise_cost(costs: Callable[[FloatArray], FloatArray], dimension_count: int, seed: int) -> FloatArray:
    """Return the point of the unit box with the smallest cost, from a Sobol sequence, then CMA."""
    from scipy.stats import qmc  # imported here because it loads slowly

    points = qmc.Sobol(dimension_count, rng=np.random.default_rng([seed, 1])).random(SOBOL_POINTS)
    cost = costs(points)
    best_point: FloatArray = points[int(np.argmin(cost))]
    minimum_cost = float(np.min(cost))
    strategy = CmaStrategy(best_point, 0.1, [seed, 2], REFINEMENT_POPULATION)
    for _ in range(REFINEMENT_GENERATIONS):
        points_tried = strategy.ask()
        cost = costs(points_tried)
        strategy.tell(cost)
        if float(np.min(cost)) < minimum_cost:
            best_point, minimum_cost = points_tried[int(np.argmin(cost))], float(np.min(cost))
    return best_point


class LinearLoops(Protocol):
    """Linear loops in which points of a search range can be evaluated."""

    def costs(self, space: SearchBox, aims: Aims, points: FloatArray) -> FloatArray:
        """Return a cost like that of :meth:`Aims.cost` for each point, from linear loops."""


def find_best_point(loop: LinearLoops, space: SearchBox, seed: int, aims: Aims) -> FloatArray:
    """Return the point with the smallest cost in linear loops."""
    return minimise_cost(partial(loop.costs, space, aims), len(space.axes), seed)


def find_minimum_cost(space: SearchBox, seed: int, changed_problem: tuple[LinearLoops, Aims]) -> float:
    """Return the smallest cost in linear loops, for changed loops and aims."""
    loop, aims = changed_problem
    return float(loop.costs(space, aims, find_best_point(loop, space, seed, aims)[None, :])[0])


SCREEN_HORIZON_S = 0.03
"""Simulated time after a step in the screen, s."""
SLOPE_FRACTIONS = (0.3, 0.5, 0.75)
"""Slopes of softened loops, from 0 for the slope after a reversal to 1 for the static slope. The
effective slope for small steps is not known in advance."""


def make_screen(
    setup: BearingSetup, conditions: Sequence[BearingCondition], slope_fraction: float = SLOPE_FRACTIONS[1]
) -> Screen:
    """Linearise a setup at every condition, with the static slope and with a softened slope.

    A small step reverses the current. Just after a reversal, only the reversible part of the iron
    responds. Therefore, the slope of the magnet is smaller, which the softened loop represents.
    """
    limits = setup.controller.limits
    largest_step_m = max(setup.rig.settings.step.heights_m)
    loops: list[LinearLoop] = []
    reserves: list[float] = []
    for condition in conditions:
        rig = change_rig(setup.rig, {"gap_m": condition.gap, "load.force_N": condition.load})
        operating_point = find_operating_point(rig)
        static_loop = make_linear_loop(replace(setup, rig=rig), operating_point)
        slope_ratio = min(max(operating_point.slopes.slope_ratio, 0.0), 1.0)
        slope_factor = slope_ratio + slope_fraction * (1.0 - slope_ratio)
        loops += [
            static_loop,
            replace(
                static_loop, bearing=replace(static_loop.bearing, k_i=slope_factor * static_loop.bearing.k_i)
            ),
        ]
        reserve_N = min(limits.force_high_N - rig.static_load, rig.static_load - limits.force_low_N)
        if len(rig.settings.body_magnets) > 1:
            reserve_N = limits.force_high_N - abs(rig.static_load)
        reserves += [max(reserve_N, 1e-3 * limits.force_high_N) / largest_step_m] * 2
    return Screen(loops, reserves, SCREEN_HORIZON_S)


DEFAULT_BUDGET = 240
"""Number of sets of gains that are tried in the nonlinear loop."""
POPULATION_SIZE = 10
"""Number of points in a generation; an even number uses two cores equally."""
_INITIAL_SIGMA = 0.1  # initial standard deviation of the points, relative to the range
# number of starting points; the better one continues after each had a third of the budget
_MAX_STARTS = 2
_MIN_START_DISTANCE = 0.15  # smallest distance between starting points, relative to the range
_CHECKS_PER_ROUND = 2  # number of candidates that are checked after every round
_MAX_ROUNDS = 3  # maximum number of rounds; a further round follows if a check misses an aim
_REPEAT_GENERATIONS = 4  # number of generations in a repeated search
_TIGHTENING_FACTOR = 0.98  # additional factor on the limits of missed aims
_CHECK_WORK = 15.0  # work of one check, in units of one trial, for the progress
_LIMITS_WORK = 40.0  # work of finding the limits, in units of one trial


@dataclass(frozen=True, eq=False)
class TriedGains:
    """A set of gains that was tried, and its result."""

    point: FloatArray  # point in the unit box
    outcome: GainOutcome  # result with one noise seed


@dataclass(frozen=True)
class TuningSearchResult:
    """The result of a search for gains."""

    loop: Tunable  # loop with the best gains
    parameters: dict[str, float]  # parameters of the best point
    check: CheckResult | None  # check of the best gains; None after an interruption
    initial_outcome: GainOutcome  # result of the original gains, with one noise seed
    # all gains that were tried at every condition, including the initial guesses
    candidates: tuple[TriedGains, ...]
    tried_count: int  # number of sets of gains that were tried in the nonlinear loop
    interrupted: bool  # whether ctrl-C ended the search

    @property
    def figures(self) -> GainFigures:
        """Metrics of the best gains from the check; if there was no check, from the search."""
        if self.check is not None:
            return self.check.worst
        return self.candidates[0].outcome.worst


@dataclass
class GainSearch:
    """A search for the gains of one variant."""

    loop: Tunable  # loop whose controller gains are searched
    aims: Aims
    budget: int = DEFAULT_BUDGET  # number of sets of gains that are tried before the first check
    seed: int = 0  # seed of the search and of the noise
    progress: Progress | None = None  # function of the completed and the total work
    jobs: int | None = None  # number of processes; None: the number of cores
    _search_loop: Tunable = field(init=False)
    _candidates: list[TriedGains] = field(init=False, default_factory=list)
    _tried_count: int = field(init=False, default=0)
    _work_done: float = field(init=False, default=0.0)
    _total_work: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self._search_loop = self.loop.for_search()
        self._total_work = self.budget + _CHECKS_PER_ROUND * _CHECK_WORK + _LIMITS_WORK

    def run(self) -> TuningSearchResult:
        """Run the search. After ctrl-C, return the best gains up to now."""
        initial = run_trial(self._search_loop, self.loop.conditions, self.aims, seed=self.seed)
        checked: list[tuple[float, TriedGains, CheckResult]] = []
        interrupted = False
        try:
            self._try_initial_guesses()
            self._run_rounds(checked)
        except KeyboardInterrupt:
            if not self._candidates:
                raise
            interrupted = True
        if checked:
            _, best_candidate, best_check = min(checked, key=lambda entry: entry[0])
        else:
            best_candidate, best_check = self._sorted_candidates(self.aims)[0], None
        other_candidates = [candidate for candidate in self._candidates if candidate is not best_candidate]
        return TuningSearchResult(
            loop=self.loop.with_gains_at(best_candidate.point),
            parameters=self.loop.space.parameters(best_candidate.point),
            check=best_check,
            initial_outcome=initial,
            candidates=(best_candidate, *other_candidates),
            tried_count=self._tried_count,
            interrupted=interrupted,
        )

    def _run_rounds(self, checked: list[tuple[float, TriedGains, CheckResult]]) -> None:
        """Search, then check. If the check misses an aim, search again with tighter limits."""
        aims = self.aims
        generations = max(self.budget // POPULATION_SIZE, 1)
        for round_ in range(_MAX_ROUNDS):
            if round_ > 0:
                self._total_work += _REPEAT_GENERATIONS * POPULATION_SIZE + _CHECKS_PER_ROUND * _CHECK_WORK
            self._search_gains(aims, generations if round_ == 0 else _REPEAT_GENERATIONS, round_)
            checked_candidates = [candidate for _, candidate, _ in checked]
            for candidate in [
                candidate
                for candidate in self._sorted_candidates(aims)
                if candidate not in checked_candidates
            ][:_CHECKS_PER_ROUND]:
                result = self.loop.with_gains_at(candidate.point).check(self.jobs)
                checked.append((self.aims.cost(result.worst), candidate, result))
                self._report_progress(_CHECK_WORK)
            _, _, best_check = min(checked, key=lambda entry: entry[0])
            missed_aims = self.aims.missed_by(best_check.worst)
            if not missed_aims:
                return
            aims = aims.with_scaled_limits(
                {name: _TIGHTENING_FACTOR / (1.0 + min(excess, 1.0)) for name, excess in missed_aims.items()}
            )

    def _try_initial_guesses(self) -> None:
        """Evaluate the initial guesses from linear loops."""
        tasks = list(self.loop.initial_guesses(self.aims, self.seed))
        self._total_work += 2.0 * len(tasks)
        points = map_ordered(call, tasks, lambda *_: self._report_progress(1.0), self.jobs)
        self._evaluate_points(np.array(points), self.loop.conditions, self.aims, math.inf)
        if not self._candidates:
            raise NegativeResult(
                f"none of the {len(points)} best sets of gains of linear loops keeps control at all "
                "conditions; run 'anhyst simulate' to see the loss, and check the limits and the load",
                code="no-gains-hold",
            )

    def _search_gains(self, aims: Aims, generations: int, round_: int) -> None:
        """Search from several starting points, then continue from the best one."""
        guesses = self._select_distant_starts(aims, _MAX_STARTS if round_ == 0 else 1)
        paths = [
            _SearchPath(
                CmaStrategy(
                    guess.point, _INITIAL_SIGMA / (1 + 2 * round_), [self.seed, 3, round_, i], POPULATION_SIZE
                )
            )
            for i, guess in enumerate(guesses)
        ]
        early_generations = generations // (_MAX_STARTS + 1) if len(paths) > 1 else 0
        for path in paths:
            self._run_generations(path, aims, early_generations)
        best_path = min(paths, key=lambda path: path.minimum_cost)
        self._run_generations(best_path, aims, generations - early_generations * len(paths))

    def _run_generations(self, path: _SearchPath, aims: Aims, count: int) -> None:
        for _ in range(count):
            # The hardest conditions come first, so that poor gains are abandoned early.
            best_figures = self._sorted_candidates(aims)[0].outcome.figures
            order = sorted(self.loop.conditions, key=lambda condition: -aims.cost(best_figures[condition]))
            points = path.strategy.ask()
            costs = np.array(
                [outcome.cost for outcome in self._evaluate_points(points, order, aims, path.ceiling)]
            )
            path.strategy.tell(costs)
            path.minimum_cost = min(path.minimum_cost, float(costs.min()))
            path.ceiling = float(np.sort(costs)[POPULATION_SIZE // 2 - 1])

    def _select_distant_starts(self, aims: Aims, count: int) -> list[TriedGains]:
        """Return the best candidates that have a minimum distance from each other."""
        chosen_starts: list[TriedGains] = []
        for candidate in self._sorted_candidates(aims):
            if all(
                np.max(np.abs(candidate.point - chosen_start.point)) > _MIN_START_DISTANCE
                for chosen_start in chosen_starts
            ):
                chosen_starts.append(candidate)
        return chosen_starts[:count]

    def _evaluate_points(
        self, points: FloatArray, order: Sequence[Any], aims: Aims, ceiling: float
    ) -> list[GainOutcome]:
        loops = [self._search_loop.with_gains_at(point) for point in points]
        trial = partial(run_trial, conditions=order, aims=aims, ceiling=ceiling, seed=self.seed)
        outcomes = map_ordered(trial, loops, lambda *_: self._report_progress(1.0), self.jobs)
        self._tried_count += len(loops)
        self._candidates += [
            TriedGains(point, outcome)
            for point, outcome in zip(points, outcomes, strict=True)
            if outcome.is_complete
        ]
        return outcomes

    def _sorted_candidates(self, aims: Aims) -> list[TriedGains]:
        """Return all gains that were tried at every condition, sorted by cost."""
        return sorted(self._candidates, key=lambda candidate: aims.cost(candidate.outcome.worst))

    def _report_progress(self, completed_work: float) -> None:
        self._work_done += completed_work
        if self.progress is not None:
            self.progress(self._work_done, self._total_work)


@dataclass
class _SearchPath:
    """A run of the strategy from one starting point."""

    strategy: CmaStrategy
    ceiling: float = math.inf
    minimum_cost: float = math.inf
