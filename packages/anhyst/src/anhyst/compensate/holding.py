"""How far a held output drifts: small movements that come again and again, for a minute.

A law of the Jiles-Atherton family forgets by the whole way that the field goes, and whatever the
compiled law does otherwise than the model adds up along it: the ripple of a table under a gap that
vibrates is enough. So a demand is held while the gap moves or sensors are noisy, and whenever both
are back at home the output is compared with what it was the first time: the same demand at the same
gap. What the first movement changes is no drift: it is judged with the paths of the budget.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from anhyst.compensate.force_controller import twin_of
from anhyst.compensate.paths import Reach
from anhyst.compensate.plan import Plan
from anhyst.model.actuator import Model
from anhyst.support.numeric import FloatArray

SECONDS, NOISE_SECONDS = 60.0, 10.0
"""For which a demand is held, and for which sensors are noisy or the gap walks at random."""

MOST_RATE = 20_000.0
"""Ticks a second that are simulated at most: faster ones divide the same movements more finely."""

RETURN, LEAST_TICKS = 0.01, 16
"""Seconds after which gap and demand are back at home, exactly, and the ticks of that at least: a
vibration of 100 Hz, or slower at a slow controller."""

TOGETHER = 20
"""Returns that are computed at once."""

LEVELS = (0.2, 0.5, 0.8)
"""Held outputs, in parts of what can be reached."""

AMPLITUDES = (1.0 / 60.0, 1.0 / 6.0)
"""Of the vibration, in parts of the range of the gap: 5 and 50 um of 0.3 mm."""

WALK = 1.0 / 12.0
"""Spread of the gap's random walk between two returns, in parts of its range."""

DEMAND_NOISE, GAP_NOISE = 5e-4, 5e-4
"""Standard deviation, in parts of the ranges: what a position controller makes of its sensor's
noise, and the sensor's own."""

SEED = 5
RISE = 100
"""Half of the ticks in which a demand rises to where it is held, or rises to the largest and falls."""

_CLOSED = 1e-12

Movement = Callable[[np.random.Generator, int], tuple[FloatArray, FloatArray]]
"""From the ticks of one return to what demand and gap move from home, in parts of their ranges."""


@dataclass(frozen=True, slots=True)
class Held:
    """One demand that was held."""

    title: str  # what moved
    demand: float  # in units of the output
    seconds: float  # for how long
    drift: float  # largest change of the output at home since its first return, in its unit


@dataclass(frozen=True, slots=True)
class _Case:
    title: str
    movement: Movement
    seconds: float
    periodic: bool
    widest: float = 0.0  # how far the gap goes, in parts of its range


def hold(plan: Plan) -> list[Held]:
    """Hold demands under a plan's compensator and let the model say what becomes of the output."""
    return [
        _hold(plan, plan.builder.reach, case, level)
        for case in _cases(plan.model.needs_schedule)
        for level in LEVELS
    ]


def _cases(moves: bool) -> list[_Case]:
    noise = _Case("the demand is noisy", _noise, NOISE_SECONDS, False)
    rest = _Case("nothing moves", lambda _, ticks: (np.zeros(ticks),) * 2, SECONDS, True)
    if not moves:
        return [rest, noise]
    vibrations = [
        _Case(f"the gap vibrates by {part:.2g} of its range", _vibration(part), SECONDS, True, part)
        for part in AMPLITUDES
    ]
    walk = _Case("the gap walks at random", _walk, NOISE_SECONDS, False, 3.0 * WALK)
    noise = _Case("demand and gap are noisy", _noise, NOISE_SECONDS, False)
    return [rest, *vibrations, walk, noise]


def _vibration(part: float) -> Movement:
    def movement(_: np.random.Generator, ticks: int) -> tuple[FloatArray, FloatArray]:
        gap = part * np.sin(2.0 * np.pi * np.arange(1, ticks + 1) / ticks)
        gap[-1] = 0.0
        return np.zeros(ticks), gap

    return movement


def _walk(random: np.random.Generator, ticks: int) -> tuple[FloatArray, FloatArray]:
    walk = np.cumsum(random.standard_normal(ticks)) / np.sqrt(ticks)
    bridge = 2.0 * WALK * (walk - walk[-1] * np.arange(1, ticks + 1) / ticks)
    return np.zeros(ticks), np.clip(bridge, -3.0 * WALK, 3.0 * WALK)


def _noise(random: np.random.Generator, ticks: int) -> tuple[FloatArray, FloatArray]:
    demand, gap = random.standard_normal((2, ticks))
    demand[-1] = gap[-1] = 0.0
    return DEMAND_NOISE * demand, GAP_NOISE * gap


def _hold(plan: Plan, reach: Reach, case: _Case, level: float) -> Held:
    """Hold one demand after a rise and after a descent; return the larger drift."""
    scales = plan.block.scales
    span, home = scales.gap_span, 0.5 * (scales.gap_low + scales.gap_high)
    farthest = np.array([home - case.widest * span, home, home + case.widest * span])
    bottom = float(reach.demand(np.zeros(3), farthest, lifted=True).max())
    top = float(reach.demand(np.ones(3), farthest).min())
    demand = bottom + level * (top - bottom)
    rise = np.linspace(bottom, demand, 2 * RISE)
    descent = np.concatenate([np.linspace(bottom, top, RISE), np.linspace(top, demand, RISE)])
    drift = max(_drift(plan, home, case, approach, top - bottom) for approach in (rise, descent))
    return Held(case.title, demand, case.seconds, drift)


def _drift(plan: Plan, home: float, case: _Case, approach: FloatArray, height: float) -> float:
    """Return the largest change of the output at home since its first return, in its unit.

    A movement that repeats itself ends as soon as everything repeats itself.
    """
    random = np.random.default_rng(SEED)
    rate = min(plan.request.rate, MOST_RATE)
    ticks = max(round(RETURN * rate), LEAST_TICKS)
    pair = _Pair(plan, home)
    pair.run(approach, np.full(approach.size, home))
    demand, span = float(approach[-1]), plan.block.scales.gap_span
    first: float | None = None
    drift, memory = 0.0, pair.memory
    for _ in range(max(round(case.seconds * rate / (TOGETHER * ticks)), 1)):
        moved, gap = np.hstack([case.movement(random, ticks) for _ in range(TOGETHER)])
        back = pair.run(demand + height * moved, home + span * gap)[ticks - 1 :: ticks]
        first = float(back[0]) if first is None else first
        drift = max(drift, float(np.abs(back - first).max()))
        if case.periodic and pair.is_back(memory):
            break
        memory = pair.memory
    return drift


class _Pair:
    """A compensator, and the exact model that gets its currents, both going on where they are."""

    def __init__(self, plan: Plan, home: float) -> None:
        self.model: Model = plan.model
        self.twin = twin_of(plan.still, plan.request.io)
        self.iron = plan.model.iron_at(home if plan.model.needs_schedule else None)
        self.state = np.zeros(plan.model.operator_law.states)

    def run(self, demand: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the outputs of the model."""
        at = gap if self.model.needs_schedule else None
        current = self.twin.run(demand, at)
        circuit = self.model.circuit(at, np.zeros(demand.size))
        reached, _, self.state, status, _ = self.iron.forward(
            circuit.magnetomotive(current), circuit.rho, np.zeros(demand.size), self.state
        )
        assert status == 0
        return circuit.output(reached)

    @property
    def memory(self) -> tuple[FloatArray, FloatArray]:
        """Memory of compensator and model."""
        return np.array(self.twin.memory, dtype=np.float64), self.state.copy()

    def is_back(self, earlier: tuple[FloatArray, FloatArray]) -> bool:
        """Whether both remember what they remembered then: from there on all repeats itself."""
        own, exact = self.memory
        return np.array_equal(own, earlier[0]) and np.allclose(exact, earlier[1], _CLOSED, _CLOSED)
