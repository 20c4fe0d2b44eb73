"""Measure how far a held output drifts while gap or sensors repeat small movements.

A Jiles-Atherton law accommodates with the travel of the field. Any difference between compiled law
and model accumulates. Even table errors under a vibrating gap are enough. The simulation holds a
demand while the gap vibrates or walks randomly, or while the sensors are noisy. At each return of
demand and gap to their nominal values, the simulation compares the output with that of the first
return. The change due to the first movement is not drift; the accuracy budget includes it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from anhyst.compensate.force_controller import make_twin
from anhyst.compensate.paths import OutputRange
from anhyst.compensate.plan import Plan
from anhyst.model.actuator import Model
from anhyst.support.numeric import FloatArray

HOLD_TIME_S = 60.0
"""Time for which a demand is held, at standstill or with a vibrating gap."""

NOISE_TIME_S = 10.0
"""Time for which a demand is held with sensor noise or with a random walk of the gap."""

MAX_SIMULATED_RATE_HZ = 20_000.0
"""Maximum simulated sample rate. A faster controller divides the same movements more finely."""

RETURN_PERIOD_S = 0.01
"""Period after which gap and demand return exactly to nominal values: a vibration of 100 Hz."""

MIN_RETURN_TICKS = 16
"""Minimum number of ticks of a return period. A slow controller gets a slower vibration."""

RETURNS_PER_BATCH = 20
"""Number of returns that are computed in one batch."""

DEMAND_LEVELS = (0.2, 0.5, 0.8)
"""Held outputs, as fractions of the reachable range."""

VIBRATION_AMPLITUDES = (1.0 / 60.0, 1.0 / 6.0)
"""Amplitudes of the vibration, as fractions of the range of the gap: 5 and 50 um for 0.3 mm."""

WALK_SPREAD = 1.0 / 12.0
"""Spread of the random walk of the gap between two returns, as a fraction of its range. The walk is
clipped at three times this value."""

DEMAND_NOISE = 5e-4
"""Standard deviation of the demand, as a fraction of its range: a position controller amplifies
the noise of its sensor to this size."""

GAP_NOISE = 5e-4
"""Standard deviation of the measured gap, as a fraction of its range."""

SEED = 5
APPROACH_RAMP_TICKS = 100
"""Ticks of each of two ramps before a hold: up to the largest demand and down to the held one.
Without the detour over the largest demand, a single ramp has twice as many ticks."""

_STATE_TOLERANCE = 1e-12

Movement = Callable[[np.random.Generator, int], tuple[FloatArray, FloatArray]]
"""Changes of demand and gap from their nominal values in one period, as fractions of their ranges.
"""


@dataclass(frozen=True, slots=True)
class HeldDemand:
    """Result for one held demand."""

    title: str  # description of the movement
    demand: float  # held demand, in units of the output
    seconds: float  # duration, s
    drift: float  # largest change of the output since the first return, in its unit


@dataclass(frozen=True, slots=True)
class _HoldCase:
    title: str
    movement: Movement
    seconds: float
    is_periodic: bool
    gap_amplitude: float = 0.0  # largest movement of the gap, as a fraction of its range


def measure_drift(plan: Plan) -> list[HeldDemand]:
    """Hold demands with the compensator of a plan, and measure the drift of the model's output."""
    return [
        _hold_demand(plan, plan.builder.output_range, case, level)
        for case in _list_hold_cases(plan.model.needs_schedule)
        for level in DEMAND_LEVELS
    ]


def _list_hold_cases(has_gap: bool) -> list[_HoldCase]:
    noise = _HoldCase("the demand is noisy", _sample_noise, NOISE_TIME_S, False)
    standstill = _HoldCase("nothing moves", lambda _, ticks: (np.zeros(ticks),) * 2, HOLD_TIME_S, True)
    if not has_gap:
        return [standstill, noise]
    vibrations = [
        _HoldCase(
            f"the gap vibrates by {amplitude:.2g} of its range",
            _make_vibration(amplitude),
            HOLD_TIME_S,
            True,
            amplitude,
        )
        for amplitude in VIBRATION_AMPLITUDES
    ]
    walk = _HoldCase("the gap walks at random", _sample_walk, NOISE_TIME_S, False, 3.0 * WALK_SPREAD)
    noise = _HoldCase("demand and gap are noisy", _sample_noise, NOISE_TIME_S, False)
    return [standstill, *vibrations, walk, noise]


def _make_vibration(amplitude: float) -> Movement:
    def movement(_: np.random.Generator, ticks: int) -> tuple[FloatArray, FloatArray]:
        gap = amplitude * np.sin(2.0 * np.pi * np.arange(1, ticks + 1) / ticks)
        gap[-1] = 0.0
        return np.zeros(ticks), gap

    return movement


def _sample_walk(random: np.random.Generator, ticks: int) -> tuple[FloatArray, FloatArray]:
    walk = np.cumsum(random.standard_normal(ticks)) / np.sqrt(ticks)
    random_bridge = 2.0 * WALK_SPREAD * (walk - walk[-1] * np.arange(1, ticks + 1) / ticks)
    return np.zeros(ticks), np.clip(random_bridge, -3.0 * WALK_SPREAD, 3.0 * WALK_SPREAD)


def _sample_noise(random: np.random.Generator, ticks: int) -> tuple[FloatArray, FloatArray]:
    demand, gap = random.standard_normal((2, ticks))
    demand[-1] = gap[-1] = 0.0
    return DEMAND_NOISE * demand, GAP_NOISE * gap


def _hold_demand(plan: Plan, output_range: OutputRange, case: _HoldCase, level: float) -> HeldDemand:
    """Hold one demand after an ascending and after a descending ramp; return the larger drift."""
    scales = plan.block.scales
    span, nominal_gap = scales.gap_span, 0.5 * (scales.gap_low + scales.gap_high)
    extreme_gaps = np.array(
        [nominal_gap - case.gap_amplitude * span, nominal_gap, nominal_gap + case.gap_amplitude * span]
    )
    lowest_demand = float(output_range.demand(np.zeros(3), extreme_gaps, above_remanence=True).max())
    highest_demand = float(output_range.demand(np.ones(3), extreme_gaps).min())
    demand = lowest_demand + level * (highest_demand - lowest_demand)
    after_ascent = np.linspace(lowest_demand, demand, 2 * APPROACH_RAMP_TICKS)
    after_descent = np.concatenate(
        [
            np.linspace(lowest_demand, highest_demand, APPROACH_RAMP_TICKS),
            np.linspace(highest_demand, demand, APPROACH_RAMP_TICKS),
        ]
    )
    drift = max(
        _max_drift(plan, nominal_gap, case, approach_path, highest_demand - lowest_demand)
        for approach_path in (after_ascent, after_descent)
    )
    return HeldDemand(case.title, demand, case.seconds, drift)


def _max_drift(
    plan: Plan, nominal_gap: float, case: _HoldCase, approach_path: FloatArray, demand_span: float
) -> float:
    """Return the largest change of the output since the first return, in its unit.

    A periodic movement ends early if compensator and model have returned to the same states.
    """
    random = np.random.default_rng(SEED)
    rate = min(plan.request.rate, MAX_SIMULATED_RATE_HZ)
    ticks = max(round(RETURN_PERIOD_S * rate), MIN_RETURN_TICKS)
    pair = _CompensatedModel(plan, nominal_gap)
    pair.run(approach_path, np.full(approach_path.size, nominal_gap))
    demand, span = float(approach_path[-1]), plan.block.scales.gap_span
    first_output: float | None = None
    drift, memory = 0.0, pair.memory
    for _ in range(max(round(case.seconds * rate / (RETURNS_PER_BATCH * ticks)), 1)):
        demand_change, gap_change = np.hstack(
            [case.movement(random, ticks) for _ in range(RETURNS_PER_BATCH)]
        )
        returned_outputs = pair.run(demand + demand_span * demand_change, nominal_gap + span * gap_change)[
            ticks - 1 :: ticks
        ]
        first_output = float(returned_outputs[0]) if first_output is None else first_output
        drift = max(drift, float(np.abs(returned_outputs - first_output).max()))
        if case.is_periodic and pair.has_returned(memory):
            break
        memory = pair.memory
    return drift


class _CompensatedModel:
    """A compensator and the exact model that receives its currents; both retain their states."""

    def __init__(self, plan: Plan, nominal_gap: float) -> None:
        self.model: Model = plan.model
        self.twin = make_twin(plan.static_block, plan.request.io)
        self.iron = plan.model.iron_at(nominal_gap if plan.model.needs_schedule else None)
        self.state = np.zeros(plan.model.operator_law.states)

    def run(self, demand: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the outputs of the model."""
        used_gap = gap if self.model.needs_schedule else None
        current = self.twin.run(demand, used_gap)
        circuit = self.model.circuit(used_gap, np.zeros(demand.size))
        fields, _, self.state, status, _ = self.iron.forward(
            circuit.magnetomotive(current), circuit.rho, np.zeros(demand.size), self.state
        )
        assert status == 0
        return circuit.output(fields)

    @property
    def memory(self) -> tuple[FloatArray, FloatArray]:
        """Hysteresis states of compensator and model."""
        return np.array(self.twin.memory, dtype=np.float64), self.state.copy()

    def has_returned(self, earlier_states: tuple[FloatArray, FloatArray]) -> bool:
        """Whether both states are those of an earlier return; all further returns then repeat."""
        twin_memory, model_state = self.memory
        return np.array_equal(twin_memory, earlier_states[0]) and np.allclose(
            model_state, earlier_states[1], _STATE_TOLERANCE, _STATE_TOLERANCE
        )
