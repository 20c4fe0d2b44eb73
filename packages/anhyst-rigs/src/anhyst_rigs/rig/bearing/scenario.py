"""Build scenarios of a bearing tick by tick, from references, loads, commands and disturbances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from anhyst.control.controller_file import ControllerTable
from anhyst.support.numeric import FloatArray, first_order_share, sine
from anhyst.support.states import Command
from anhyst_rigs.rig.body import BodyRig, step_ends
from anhyst_rigs.rig.loop import ReferenceStep, Scenario
from anhyst_rigs.rig.tables import DisturbanceTable

SELFTEST_TICKS = 25
"""Smallest number of ticks of the self-test: settling of the filter, then plausible samples."""

MIN_LIFT_S = 0.45
"""Shortest time from power-on until the armature counts as levitated and settled, s."""

MIN_LAND_S = 0.5
"""Shortest time from the landing command until the armature counts as landed, s."""

_SELFTEST_S = 0.005
_REST_S = 0.1  # time until the last current has decayed to zero, s
_MIN_SETTLE_S = 0.07
_MAX_SETTLE_S = 1.0
_SETTLE_INTEGRAL_TIMES = 10.0  # settling time of the integral, in multiples of K_p/K_i


@dataclass
class ScenarioBuilder:
    """Builds a scenario step by step."""

    rig: BodyRig  # rig with the tick rate, the load and its disturbances
    gap: float  # present reference, m
    load: float | None = None  # force of the load drive, N; default: that of the rig file
    _target: list[FloatArray] = field(default_factory=list)
    _load: list[FloatArray] = field(default_factory=list)
    _inject: list[FloatArray] = field(default_factory=list)
    _marks: list[tuple[int, int]] = field(default_factory=list)
    _steps: list[ReferenceStep] = field(default_factory=list)
    _lift_end_tick: int = 0
    ticks: int = 0

    def __post_init__(self) -> None:
        if self.load is None:
            self.load = self.rig.settings.load.force_N

    def tick_count(self, seconds: float) -> int:
        """Return the number of ticks in a time, s; at least 1."""
        return max(round(seconds * self.rig.settings.timing.rate_Hz), 1)

    def command(self, command: int, ticks: int = 1) -> ScenarioBuilder:
        """Put a command into the next ticks; the scenario does not become longer."""
        self._marks += [(self.ticks + tick, command) for tick in range(ticks)]
        return self

    def lift_off(self, controller: ControllerTable) -> ScenarioBuilder:
        """Power on, declare the iron demagnetised, lift off and settle.

        The commands follow the self-test, whose duration is given in ticks.
        """
        end = self.ticks + self.tick_count(lift_time(self.rig, controller, self.gap))
        self._add_segment(np.full(_selftest_ticks(self.rig), self.gap), None)
        self.command(Command.DEMAGNETISED).hold(0.001).command(Command.LIFT)
        self._add_segment(np.full(end - self.ticks, self.gap), None)
        self._lift_end_tick = self.ticks
        return self

    def hold(self, seconds: float, inject: FloatArray | None = None) -> ScenarioBuilder:
        """Keep the reference constant for a time, s; optionally add a signal to the readings."""
        count = self.tick_count(seconds) if inject is None else inject.size
        return self._add_segment(np.full(count, self.gap), inject)

    def step(self, gap: float, seconds: float) -> ScenarioBuilder:
        """Step the reference to a gap, m, and keep it there."""
        begin, old_gap, self.gap = self.ticks, self.gap, gap
        self.hold(seconds)
        self._steps.append(ReferenceStep(begin, self.ticks, old_gap, gap))
        return self

    def follow(self, target: FloatArray) -> ScenarioBuilder:
        """Move the reference along a trajectory of gaps, m."""
        self.gap = float(target[-1])
        return self._add_segment(np.asarray(target, dtype=np.float64), None)

    def set_load(self, force: float) -> ScenarioBuilder:
        """Change the load to a force in one step, N."""
        self.load = force
        return self

    def _add_segment(self, target: FloatArray, inject: FloatArray | None) -> ScenarioBuilder:
        assert self.load is not None
        self._target.append(target)
        self._load.append(np.full(target.size, self.load))
        self._inject.append(np.zeros(target.size) if inject is None else inject)
        self.ticks += target.size
        return self

    def build(self) -> Scenario:
        """Return the scenario, including the disturbances of the rig file."""
        command = np.zeros(self.ticks, dtype=np.uint32)
        for tick, value in self._marks:
            command[tick] |= value
        added_force = np.concatenate(self._load)
        for number, disturbance in enumerate(self.rig.settings.load.disturbance):
            added_force = added_force + _disturbance_force(self.rig, disturbance, self.ticks, number)
        return Scenario(
            target=np.concatenate(self._target),
            load=added_force,
            inject=np.concatenate(self._inject),
            command=command,
            steps=tuple(self._steps),
            lift_end_tick=self._lift_end_tick,
        )


def lift_time(rig: BodyRig, controller: ControllerTable, gap: float) -> float:
    """Return the longest duration of a lift-off with self-test, force ramp, motion and settling, s."""
    gains, ramp = controller.pidd2_gains(), controller.lift_off
    settling_time = _MIN_SETTLE_S
    if gains.K_i > 0.0:
        settling_time = max(settling_time, min(_SETTLE_INTEGRAL_TIMES * gains.K_p / gains.K_i, _MAX_SETTLE_S))
    # If the drive gives less force than demanded, the armature lifts off later, but at the latest
    # when the largest force is demanded. If it still rests then, the controller reports this.
    force_time = controller.limits.force_high_N / ramp.force_rate_N_per_s
    travel_time = max(rig.settings.body.stop_high_m - gap, 0.0) / ramp.speed_m_per_s
    selftest_time = _selftest_ticks(rig) * rig.dt + max(0.001, rig.dt)
    return max(selftest_time + force_time + travel_time + settling_time, MIN_LIFT_S)


def land_time(rig: BodyRig, controller: ControllerTable) -> float:
    """Return the longest duration of a landing with motion, force ramp and decay of the current, s."""
    body, ramp = rig.settings.body, controller.landing
    limits = controller.limits
    travel_time = (body.stop_high_m - body.stop_low_m) / ramp.speed_m_per_s
    force_time = (limits.force_high_N - min(limits.force_low_N, 0.0)) / ramp.force_rate_N_per_s
    return max(travel_time + force_time + _REST_S, MIN_LAND_S)


def _selftest_ticks(rig: BodyRig) -> int:
    return max(round(_SELFTEST_S / rig.dt), SELFTEST_TICKS)


def plan_steps(
    rig: BodyRig,
    controller: ControllerTable,
    gap: float,
    heights: Sequence[float],
    load: float | None = None,
    final_hold_time: float = 0.0,
) -> Scenario:
    """Plan a lift-off, then steps up and down by every height, centred on a gap."""
    hold_time = rig.settings.step.hold_s
    builder = ScenarioBuilder(rig, gap, load).lift_off(controller)
    for height in heights:
        lower, upper = step_ends(gap, height)
        builder.follow(np.linspace(builder.gap, lower, builder.tick_count(hold_time / 2.0))).hold(hold_time)
        builder.step(upper, hold_time).step(lower, hold_time)
    if final_hold_time > 0.0:
        builder.hold(final_hold_time)
    return builder.build()


def plan_recorded_run(rig: BodyRig, controller: ControllerTable) -> tuple[Scenario, Scenario, int]:
    """Plan a lift-off, steps, load steps and a landing; return the landing tick too."""
    cases, load = rig.settings, rig.settings.load.force_N
    steps = plan_steps(rig, controller, cases.gap_m, cases.step.heights_m)
    builder = ScenarioBuilder(rig, float(steps.target[-1]))
    for step in cases.load_steps_N:
        builder.set_load(load + step).hold(0.15).set_load(load).hold(0.15)
    landing_tick = steps.ticks + builder.ticks
    builder.command(Command.LAND).hold(land_time(rig, controller))
    return steps, builder.build(), landing_tick


def _disturbance_force(rig: BodyRig, table: DisturbanceTable, ticks: int, number: int) -> FloatArray:
    time = np.arange(ticks) * rig.dt - table.start_s
    is_active = time >= 0.0
    if table.kind == "step":
        return np.where(is_active, table.force_N, 0.0)
    assert table.frequency_Hz is not None
    if table.kind == "sine":
        wave: FloatArray = table.force_N * sine(table.frequency_Hz * time) * is_active
        return wave
    from scipy.signal import lfilter  # imported here because it loads slowly and is rarely used

    smoothing = first_order_share(2.0 * math.pi * table.frequency_Hz * rig.dt)
    white_noise = np.random.default_rng([rig.settings.seed, 99, number]).standard_normal(ticks)
    filtered_noise = lfilter([smoothing], [1.0, smoothing - 1.0], white_noise)
    # In each tick, a first-order low-pass moves by the fraction `smoothing` of the difference. It
    # passes the fraction smoothing/(2 - smoothing) of the power of white noise.
    return np.asarray(table.force_N * filtered_noise * math.sqrt((2.0 - smoothing) / smoothing) * is_active)
