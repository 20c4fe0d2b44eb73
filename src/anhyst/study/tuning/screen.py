"""A cheap look at many gains at once: the loop linearised at every gap and load.

Nothing of hysteresis and noise is in it; limits only in so far as the force that the largest step
asks for is known. It finds where a search should begin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from cmaes import CMA

from anhyst.rig.bearing.loop import BearingSetup
from anhyst.rig.body import BodyRig
from anhyst.rig.drift import changed
from anhyst.study.bearing.linear import LinearLoop
from anhyst.study.bearing.operating import find_operating_point, linear_loop
from anhyst.study.tuning.aims import MISSED, Aims
from anhyst.study.tuning.trial import Condition
from anhyst.support.numeric import FloatArray


class Strategy:
    """Draws points around a mean, and moves mean and spread to where the better ones lie."""

    def __init__(self, mean: FloatArray, sigma: float, seed: list[int], children: int) -> None:
        box = np.tile([0.0, 1.0], (mean.size, 1))
        number = int(np.random.SeedSequence(seed).generate_state(1)[0])
        self._search = CMA(mean, sigma, bounds=box, seed=number, population_size=children)
        self._asked: list[FloatArray] = []

    def ask(self) -> FloatArray:
        """Return the points of the next generation, shape (children, n)."""
        self._asked = [self._search.ask() for _ in range(self._search.population_size)]
        return np.array(self._asked)

    def tell(self, costs: FloatArray) -> None:
        """Take the costs of the points asked for, in the same order."""
        self._search.tell(list(zip(self._asked, costs.tolist(), strict=True)))


_FREQUENCIES = 72
_LOOK_EVERY = 4  # ticks
_BAND = 0.02

SPREAD = 1024
"""Places that are spread over the box at first; a power of two."""
REFINED = (24, 32)
"""Generations, and places in each, in which the best of them is improved."""


@dataclass(frozen=True)
class Screened:
    """What linear loops do with n sets of gains, worst of all conditions."""

    # settling is infinite where it takes longer than was looked at, or for ever; shape (n,)
    overshoot_percent: FloatArray
    settling_time_s: FloatArray
    peak_sensitivity: FloatArray
    # force that the largest step asks for, in parts of what there is; shape (n,)
    effort: FloatArray

    def costs(self, aims: Aims, horizon: float) -> FloatArray:
        """Return costs as :meth:`Aims.cost` gives them, of what is known here, shape (n,)."""
        missed = np.zeros(self.peak_sensitivity.size)
        limits = {"overshoot_percent": aims.overshoot_percent, "effort": 1.0}
        for name, limit in (limits | {"peak_sensitivity": aims.peak_sensitivity}).items():
            over = getattr(self, name) / limit - 1.0
            missed += np.clip(np.nan_to_num(over, nan=100.0, posinf=100.0), 0.0, 100.0)
        settled = np.isfinite(self.settling_time_s)
        missed += np.where(settled, 0.0, 10.0)
        time = np.where(settled, self.settling_time_s, horizon)
        return np.where(missed > 0.0, MISSED + missed, time)


class Screen:
    """Linear loops at several conditions, around which gains are tried."""

    def __init__(
        self, loops: Sequence[LinearLoop], reserves: Sequence[float], horizon: float
    ) -> None:
        self.loops = tuple(loops)
        self.horizon = horizon
        self._reserves = tuple(reserves)
        rate = loops[0].chain.rate
        self._rate = rate
        frequency = np.geomspace(rate / 1000.0, rate / 2.5, _FREQUENCIES)
        self._z = np.exp(2j * np.pi * frequency / rate)
        self._plants = [loop.plant_response(frequency) for loop in loops]

    def around(self, loops: Sequence[LinearLoop]) -> Screen:
        """Return a screen with other loops at the same conditions."""
        return Screen(loops, self._reserves, self.horizon)

    def of(self, places: Iterable[int]) -> Screen:
        """Return a screen of some of the loops."""
        some = list(places)
        reserves = [self._reserves[place] for place in some]
        return Screen([self.loops[place] for place in some], reserves, self.horizon)

    def stronger(self, factor: float) -> Screen:
        """Return a screen whose largest step has so many times the force."""
        return Screen(self.loops, [factor * one for one in self._reserves], self.horizon)

    def look(self, per_tick: FloatArray) -> Screened:
        """Judge gains, as rows of :attr:`anhyst.control.Pidd2.per_tick`, shape (n, 11)."""
        peak = np.max([self._peak(at, per_tick) for at in range(len(self.loops))], axis=0)
        steps = [self._step(at, per_tick) for at in range(len(self.loops))]
        return Screened(
            overshoot_percent=np.max([one[0] for one in steps], axis=0),
            settling_time_s=np.max([one[1] for one in steps], axis=0),
            peak_sensitivity=peak,
            effort=np.max([one[2] for one in steps], axis=0),
        )

    def _peak(self, at: int, per_tick: FloatArray) -> FloatArray:
        p, k, d, e, _, _, s, t, _ = (column[:, None] for column in per_tick.T[:9])
        step = self._z - 1.0
        first = s * step / (step + s)
        second = t * step / (step + t) * first
        feedback = p + k / step + d * first + e * second
        compensation = self.loops[at].compensation
        gain = (feedback + compensation.k_s) / compensation.k_i * self._plants[at]
        return np.asarray(np.max(1.0 / np.abs(1.0 + gain), axis=1))

    def _step(self, at: int, per_tick: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return overshoot, %, settling time, s, and effort of a step of the reference."""
        loop = self.loops[at]
        matrix, into = closed_loop(loop, per_tick)
        for _ in range(int(np.log2(_LOOK_EVERY))):
            into = (matrix @ into[..., None])[..., 0] + into
            matrix = matrix @ matrix
        c = np.concatenate([loop.plant[2], np.zeros(3)])
        asks, jump = _demand(loop, per_tick)
        count = round(self.horizon * self._rate / _LOOK_EVERY)
        state = np.zeros_like(into)
        seen = np.empty((count, into.shape[0]))
        force = np.abs(jump)
        with np.errstate(all="ignore"):  # what is unstable leaves all bounds
            for tick in range(count):
                state = (matrix @ state[..., None])[..., 0] + into
                seen[tick] = state @ c
                force = np.maximum(force, np.abs(np.sum(state * asks, axis=1) + jump))
            seen = np.nan_to_num(seen, nan=1e9, posinf=1e9, neginf=-1e9)
            overshoot = 100.0 * np.maximum(seen.max(axis=0) - 1.0, 0.0)
            outside = np.abs(seen - 1.0) > _BAND
        last = count - 1 - np.argmax(outside[::-1], axis=0)
        time = np.where(outside.any(axis=0), (last + 1) * _LOOK_EVERY / self._rate, 0.0)
        return overshoot, np.where(outside[-1], np.inf, time), force / self._reserves[at]


def _demand(loop: LinearLoop, per_tick: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what the controller asks for: for each state, shape (n, m), and at once, N/m."""
    p, _, d, e, _, _, s, t, weight = per_tick.T[:9]
    feedback = -p - d * s - e * s * t
    own = np.stack([d * s + e * s * t, e * t, np.ones(p.size)], axis=1)
    asks: FloatArray = np.concatenate([feedback[:, None] * loop.plant[2], own], axis=1)
    return asks, np.asarray(weight * p)


def closed_loop(loop: LinearLoop, per_tick: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return matrices of closed loops over a tick, and what a reference of 1 adds."""
    a, b, c = loop.plant
    n, m = per_tick.shape[0], a.shape[0]
    p, k, d, e, _, _, s, t, weight = per_tick.T[:9]
    own = np.zeros((n, 3, 3))
    own[:, 0, 0], own[:, 1, 0], own[:, 1, 1] = 1.0 - s, -s * t, 1.0 - t
    own[:, 2, 2] = 1.0
    out = np.stack([d * s + e * s * t, e * t, np.ones(n)], axis=1)
    share = 1.0 / loop.compensation.k_i
    through = share * (-p - d * s - e * s * t - loop.compensation.k_s)
    matrix = np.zeros((n, m + 3, m + 3))
    matrix[:, :m, :m] = a + through[:, None, None] * np.outer(b, c)
    matrix[:, :m, m:] = share * b[:, None] * out[:, None, :]
    matrix[:, m:, :m] = np.stack([s, s * t, -k], axis=1)[:, :, None] * c
    matrix[:, m:, m:] = own
    into = np.zeros((n, m + 3))
    into[:, :m] = (share * weight * p)[:, None] * b
    into[:, m + 2] = k
    return matrix, into


def spread_over(size: int, seed: int) -> FloatArray:
    """Return :data:`SPREAD` places spread evenly over the unit box."""
    from scipy.stats import qmc  # slow to load, and used here alone

    places: FloatArray = qmc.Sobol(size, rng=np.random.default_rng([seed, 1])).random(SPREAD)
    return places


def refine(costs: Callable[[FloatArray], FloatArray], size: int, seed: int) -> FloatArray:
    """Return the place of a box that costs least, beginning at the best of many places."""
    places = spread_over(size, seed)
    found = costs(places)
    best: FloatArray = places[int(np.argmin(found))]
    least = float(np.min(found))
    strategy = Strategy(best, 0.1, [seed, 2], REFINED[1])
    for _ in range(REFINED[0]):
        tried = strategy.ask()
        found = costs(tried)
        strategy.tell(found)
        if float(np.min(found)) < least:
            best, least = tried[int(np.argmin(found))], float(np.min(found))
    return best


HORIZON_S = 0.03
"""How long linear steps are looked at, s."""


FIRMNESS = (0.3, 0.5, 0.75)
"""Of softened loops: how much small steps feel of the pinning is not known beforehand."""


def at_condition(rig: BodyRig, condition: Condition) -> BodyRig:
    """Return the rig with its operating point there."""
    return changed(rig, {"gap_m": condition.gap, "load.force_N": condition.load})


def make_screen(
    setup: BearingSetup, conditions: Sequence[Condition], firmness: float = FIRMNESS[1]
) -> Screen:
    """Linearise a setup at every condition: along the static slope, and softened by pinning.

    Small steps turn the current, and just after a turn only the reversible part of the iron
    answers. A loop whose magnet gives a slope between the two stands for such steps.
    """
    limits = setup.controller.limits
    largest = max(setup.rig.settings.step.heights_m)
    loops: list[LinearLoop] = []
    reserves: list[float] = []
    for condition in conditions:
        rig = at_condition(setup.rig, condition)
        at = find_operating_point(rig)
        own = linear_loop(replace(setup, rig=rig), at)
        share = min(max(at.slopes.share, 0.0), 1.0)
        soft = share + firmness * (1.0 - share)
        loops += [own, replace(own, point=replace(own.point, k_i=soft * own.point.k_i))]
        reserve = min(limits.force_high_N - rig.load, rig.load - limits.force_low_N)
        if len(rig.magnets) > 1:
            reserve = limits.force_high_N - abs(rig.load)
        reserves += [max(reserve, 1e-3 * limits.force_high_N) / largest] * 2
    return Screen(loops, reserves, HORIZON_S)
