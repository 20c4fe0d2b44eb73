"""Measure the errors of a stage in a run, and simulate the loss of magnets and position heads.

The measures are servo error, moving average over a slit, settling time and force error. In the
study of losses, each amplifier or head fails in a separate run. When the controller detects the
loss, set-point and long stroke brake to rest, unless the remaining magnets suffice.
"""

# ruff: noqa: N815 - names carry units

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from anhyst.support.numeric import FloatArray, rms
from anhyst.support.states import Command, Phase, State
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.case_table import LossCase
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.loop import FIRST_FAILURE_BIT, HEAD_FAULT_BITS, SHORT_CIRCUIT_BIT, SimulatedLoop
from anhyst_rigs.rig.recording import Recording, column_name, moving_statistics, peak_deviation, settling_tick
from anhyst_rigs.rig.stage.drives import spare_magnets, usual_allocation, wrench_layout
from anhyst_rigs.rig.stage.geometry import (
    axis_unit,
    error_columns,
    inverses_without_head,
    magnet_rows,
    scan_direction,
    stop_distances,
)
from anhyst_rigs.rig.stage.loop import (
    Feedforward,
    StageSetup,
    feedforward_force,
    feedforward_wrench,
    scan_scenario,
)
from anhyst_rigs.rig.stage.recording import axis_columns, recording_columns
from anhyst_rigs.rig.stage.setpoint import (
    STROKE_ERROR_DELAY_S,
    SetPoint,
    motion_ticks,
    plan_braking,
    scan_motion,
    stroke_error_from_acceleration,
    tick_times,
)
from anhyst_rigs.study.engine.table import Metric

SETTLING_BANDS_M = (50e-9, 10e-9)
"""Error bands for the settling times, m."""
EXPOSURE_DELAY_S = 5e-3
"""Time from the end of the acceleration until the moving average begins, s."""


PEAK_ERROR = Metric("peak_m", "peak", "nm", 1e9)
MOVING_AVERAGE = Metric("average_m", "moving average", "nm", 1e9)
SETTLING_TIME = Metric("settling_50_s", "settling to 50 nm", "ms", 1e3)
METRICS = (
    PEAK_ERROR,
    MOVING_AVERAGE,
    Metric("deviation_m", "deviation over the slit", "nm", 1e9),
    SETTLING_TIME,
    Metric("settling_10_s", "settling to 10 nm", "ms", 1e3),
    Metric("force_peak_N", "force error, largest", "N"),
    Metric("force_rms_N", "force error, rms", "N"),
)
"""Metrics of a run, in the order of all tables."""


@dataclass(frozen=True)
class Measures:
    """Measures of a run, from the second scan on, because the first scan begins demagnetised."""

    peak_m: float  # largest error
    rms_m: float  # rms error
    # largest moving average and standard deviation over the slit, in windows that begin at least 5
    # ms after the acceleration and end with the phase of constant speed
    average_m: float
    deviation_m: float
    # time from the end of the acceleration until the error stays within 50 or 10 nm, mean over the
    # scans; for a scan that does not settle, the whole phase of constant speed
    settling_50_s: float
    settling_10_s: float
    force_peak_N: float  # largest difference between the force and the delayed demand
    force_rms_N: float

    @property
    def is_lost(self) -> bool:
        """Whether control was lost in the run."""
        return math.isinf(self.peak_m)


LOST_MEASURES = Measures(*[float("inf")] * 8)
"""Measures of a run that lost control."""


def cross_talk_metrics(file: RigFile) -> list[Metric]:
    """Return the metrics that :func:`cross_talk` measures."""
    units = {axis: axis_unit(axis) for axis in stationary_axes(file)}
    return [Metric(f"{axis}_{u}", f"{axis}, largest", f"n{u}", 1e9) for axis, u in units.items()]


def stationary_axes(file: RigFile) -> list[str]:
    """Return the coordinates that the set-point does not move."""
    axis_components = zip(file.body.free, scan_direction(file).tolist(), strict=True)
    return [axis for axis, component in axis_components if component == 0.0]


def cross_talk(run: Recording, motion: SetPoint, stationary: Sequence[str]) -> dict[str, float]:
    """Return the largest error of each coordinate that the set-point does not move, m or rad.

    The keys contain axis and unit. The first scan is skipped.
    """
    names = [f"{axis}_{axis_unit(axis)}" for axis in stationary]
    if run.loss is not None:
        return dict.fromkeys(names, math.inf)
    first_tick = round(motion.pulses[1][0] / run.dt)
    columns = zip(names, error_columns(stationary), strict=True)
    return {name: peak_deviation(run[column][first_tick:]) for name, column in columns}


def cruise_slices(motion: SetPoint, dt: float) -> list[slice]:
    """Return the ticks of each phase at constant speed, except after the first acceleration."""
    pulses = motion.pulses
    cruise_ends = [begin for begin, _, _ in pulses[1:]] + [motion.duration]
    slices = [
        slice(round((begin + length) / dt), round(end / dt))
        for (begin, length, _), end in zip(pulses, cruise_ends, strict=True)
    ]
    return slices[1:]


def settling_times(run: Recording, motion: SetPoint, band: float) -> list[float]:
    """Return, for each scan, the time until the error stays within a band, s."""
    error, dt = run["error_m"], run.dt
    return [dt * settling_tick(error[cruise], band) for cruise in cruise_slices(motion, dt)]


def slit_statistics(
    error: FloatArray, motion: SetPoint, slit: float, dt: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Return moving average and standard deviation of an error over a slit, s, for each scan."""
    delay_ticks, slit_ticks = round(EXPOSURE_DELAY_S / dt), round(slit / dt)
    return [
        moving_statistics(error[cruise.start + delay_ticks : cruise.stop], slit_ticks)
        for cruise in cruise_slices(motion, dt)
    ]


def measure(run: Recording, motion: SetPoint, slit: float) -> Measures:
    """Compute the measures of a run; the length of the slit is in s."""
    if run.loss is not None:
        return LOST_MEASURES
    windows = slit_statistics(run["error_m"], motion, slit, run.dt)
    first_tick = round(motion.pulses[1][0] / run.dt)
    error, force = run["error_m"][first_tick:], run["force_error_N"][first_tick:]
    return Measures(
        peak_m=peak_deviation(error),
        rms_m=rms(error),
        average_m=max(peak_deviation(mean) for mean, _ in windows),
        deviation_m=max(float(deviation.max()) for _, deviation in windows),
        settling_50_s=float(np.mean(settling_times(run, motion, SETTLING_BANDS_M[0]))),
        settling_10_s=float(np.mean(settling_times(run, motion, SETTLING_BANDS_M[1]))),
        force_peak_N=peak_deviation(force),
        force_rms_N=rms(force),
    )


EARLIEST_LOSS_S = 0.01
"""Earliest loss of a magnet, s. Before this time, the magnets take up the weight in one step."""
HOLD_TIME_S = 0.1
"""Time that is simulated after the body has braked, s."""
FINAL_WINDOW_S = 0.02
"""Length of the window of the final error, s."""
LIFT_COMMAND_S = 0.2
"""Time of the command that lifts a body from its stops, s."""
LAND_COMMAND_S = 0.45
"""Time of the command that lands the body, s."""
SLIDE_LIMIT_S = 0.02
"""Time from touchdown until the body counts as at rest, s. The plant has no friction."""
BRAKING_DECELERATION_FRACTIONS = (1.0, 0.5, 0.25, 0.1)
"""Tested decelerations, as fractions of the largest acceleration."""
_LOST_MAGNET_FACTOR = 256
"""Factor by which the number of a lost magnet is multiplied in the recorded state word."""
LOSS_TITLE = "loss of a levitating body's magnet, when it pulls most, or of a head"
LOSS_COLUMNS = (
    "lost",
    "outcome",
    "at ms",
    "A",
    "redundant",
    "detected after ms",
    "largest error",
    "final error",
    "down mm/s",
    "let go",
    "onto any stop mm/s",
    "let go",
)
LOSS_NOTES = (
    "errors in nm and nrad, the largest of all coordinates;",
    "let go: all currents end at the detection; speeds until the body is at rest",
)


@dataclass(frozen=True, kw_only=True)
class LossResult:
    """What happens to a body after the loss of a magnet or a head, or in a lift-off."""

    magnet: str
    at_s: float
    current_A: float | None = None
    spare: bool = False  # whether the remaining magnets or heads are sufficient
    noticed_s: float | None = None  # delay of the detection; None if the loss was not detected
    # "unnoticed", "flies on", "brakes", "lands", "let go", "falls" (the body hit a stop while it
    # was controlled), "lifts off" or "stays"
    outcome: str
    # largest error of each coordinate after the loss, and at the end; empty if the body is down
    error: dict[str, float]
    error_end: dict[str, float]
    # contact speeds relative to the long stroke: downwards, and in any direction at a magnet
    down_m_per_s: float
    touch_m_per_s: float
    # both contact speeds if all currents end at the detection (`let_go`), and if the controller
    # does not detect the loss (`unaware`)
    let_go: tuple[float, float]
    unaware: tuple[float, float]

    def table_cells(self) -> list[str]:
        """Return the row of a table with the columns of :data:`LOSS_COLUMNS`."""

        def format_largest(error: Mapping[str, float]) -> str:
            max_errors = [
                1e9 * max((v for k, v in error.items() if k.endswith(u)), default=0.0) for u in ("_m", "_rad")
            ]
            return ", ".join(f"{max_error:.3g}" for max_error in max_errors) if error else ""

        speeds = [self.down_m_per_s, self.let_go[0], self.touch_m_per_s, self.let_go[1]]
        return [
            self.magnet,
            self.outcome,
            f"{1e3 * self.at_s:.1f}",
            "" if self.current_A is None else f"{self.current_A:.2f}",
            "yes" if self.spare else "no",
            "" if self.noticed_s is None else f"{1e3 * self.noticed_s:.2f}",
            format_largest(self.error),
            format_largest(self.error_end),
            *(f"{1e3 * speed:.1f}" for speed in speeds),
        ]


def _controller_state(run: Recording) -> FloatArray:
    return np.asarray(run["state"] % _LOST_MAGNET_FACTOR // 16)


@dataclass(frozen=True)
class _Plan:
    """A sampled set-point. The feedforward force has one sample less than the position."""

    position: FloatArray  # position, m
    acceleration: FloatArray  # acceleration, m/s2
    feedforward: FloatArray  # feedforward force, N


@dataclass(frozen=True)
class LossFlights:
    """Simulated motions along the test set-point, in each of which a magnet or a head is lost."""

    setup: StageSetup
    gains: Feedforward
    case: LossCase
    seed: int = 1

    def run_all(self) -> list[LossResult]:
        """Simulate the loss of each magnet of the case, then of each head, then the lift-off."""
        file, test_plan, case = self._rig.settings, self._test_plan(), self.case
        magnet_names = [magnet.name for magnet in file.body_magnets]
        nominal_run = self._simulate_plan(test_plan, {})
        losses = [
            self._lose_magnet(magnet_names.index(name), test_plan, nominal_run)
            for name in case.magnets or magnet_names
        ]
        count = len(file.position_sensors)
        head_faults = [(number, fault) for fault in case.heads or [] for number in range(count)]
        losses += [self._lose_head(number, fault, test_plan) for number, fault in head_faults]
        return [*losses, self._run_lift_off(test_plan)] if case.lift else losses

    @property
    def _rig(self) -> BodyRig:
        return self.setup.rig

    def _lose_magnet(self, magnet: int, test_plan: _Plan, nominal_run: Recording) -> LossResult:
        file, first_tick = self._rig.settings, round(EARLIEST_LOSS_S / self._rig.dt)
        density = np.abs(nominal_run[column_name("flux_density", "T", magnet + 1)])
        tick = first_tick + int(np.argmax(density[first_tick:]))
        fault_word = 1 << magnet + FIRST_FAILURE_BIT | (
            SHORT_CIRCUIT_BIT if self.case.circuit == "short" else 0
        )
        loss_result = self._run_failure(file.body_magnets[magnet].name, tick, fault_word, magnet, test_plan)
        current_A = nominal_run[column_name("current", "A", magnet + 1)][
            round(loss_result.at_s / self._rig.dt)
        ]
        return replace(loss_result, current_A=float(current_A), spare=bool(spare_magnets(file) >> magnet & 1))

    def _lose_head(self, head_number: int, fault: str, test_plan: _Plan) -> LossResult:
        tick = int(np.argmax(np.abs(test_plan.acceleration)))
        fault_word = 1 << head_number + FIRST_FAILURE_BIT | HEAD_FAULT_BITS[fault]
        loss_result = self._run_failure(f"head {head_number + 1} {fault}", tick, fault_word, -1, test_plan)
        return replace(loss_result, spare=bool(inverses_without_head(self._rig.settings)[head_number].any()))

    def _run_failure(
        self, name: str, tick: int, fault_word: int, magnet: int, test_plan: _Plan
    ) -> LossResult:
        """Simulate a failure at a tick, or at the time given by the case, and the reaction to it."""
        dt, file = self._rig.dt, self._rig.settings
        if self.case.at_s is not None:
            tick = min(round(self.case.at_s / dt), len(test_plan.feedforward) - 1)
        faults = {tick: fault_word}
        run = self._simulate_plan(test_plan, faults)
        plan, outcome, notice_tick = test_plan, "unnoticed", tick
        noticed_ticks = np.flatnonzero(
            (run["state"] >= _LOST_MAGNET_FACTOR) | (_controller_state(run) == State.FAULT)
        )
        if noticed_ticks.size:
            notice_tick, outcome = int(noticed_ticks[0]), "flies on"
            if _controller_state(run)[-1] == State.FAULT or not self._can_apply_forces(
                magnet, test_plan.feedforward[notice_tick:]
            ):
                plan, outcome = self._braking_plan(magnet, test_plan, notice_tick), "brakes"
                run = self._simulate_plan(plan, faults)
        gap_speed, contact_speed = self._contact_speeds(run)
        if _controller_state(run)[-1] == State.FAULT:
            outcome = "lands" if (run["state"] % 16 == Phase.DESCEND).any() else "let go"
        elif contact_speed > 0.0:
            outcome = "falls"
        names = [] if outcome in ("lands", "let go", "falls") else error_columns(file.body.free)
        detection_off = {"control.lost_A": None, "control.head_m_per_s": None}
        unaware_rig = replace(self._rig, settings=file.with_changes(detection_off))
        flights_without_detection = replace(self, setup=replace(self.setup, rig=unaware_rig))
        all_magnets = (1 << len(file.body_magnets)) - 1 << FIRST_FAILURE_BIT
        return LossResult(
            magnet=name,
            at_s=tick * dt,
            noticed_s=(notice_tick - tick) * dt if noticed_ticks.size else None,
            outcome=outcome,
            error={name: peak_deviation(run[name][tick:]) for name in names},
            error_end={name: peak_deviation(run[name][-round(FINAL_WINDOW_S / dt) :]) for name in names},
            down_m_per_s=gap_speed,
            touch_m_per_s=contact_speed,
            let_go=self._contact_speeds(self._simulate_plan(plan, faults | {notice_tick: all_magnets})),
            unaware=self._contact_speeds(flights_without_detection._simulate_plan(plan, faults)),
        )

    def _run_lift_off(self, test_plan: _Plan) -> LossResult:
        """Simulate how a body without currents is lifted off its stops and landed again."""
        dt, names = self._rig.dt, error_columns(self._rig.settings.body.free)
        lift_tick, land_tick = round(LIFT_COMMAND_S / dt), round(LAND_COMMAND_S / dt)
        zeros = np.zeros(2 * land_tick)
        plan = _Plan(np.zeros(zeros.size + 1), np.zeros(zeros.size + 1), zeros)
        commands = {0: Command.IDLE, lift_tick: Command.LIFT, land_tick: Command.LAND}
        run = self._simulate_plan(plan, {}, commands)
        levitated_ticks = np.flatnonzero(run["state"][lift_tick:land_tick] % 16 == Phase.HOVER) + lift_tick
        fall_speeds = self._contact_speeds(run.slice_ticks(0, lift_tick))
        landing_speeds = self._contact_speeds(run.slice_ticks(lift_tick, len(run)))
        return LossResult(
            magnet="none: lift-off",
            at_s=lift_tick * dt,
            spare=True,
            outcome="lifts off"
            if levitated_ticks.size and _controller_state(run)[-1] == State.READY
            else "stays",
            error={
                name: peak_deviation(run[name][levitated_ticks]) for name in names if levitated_ticks.size
            },
            error_end={
                name: peak_deviation(run[name][land_tick - round(FINAL_WINDOW_S / dt) : land_tick])
                for name in names
            },
            down_m_per_s=landing_speeds[0],
            touch_m_per_s=landing_speeds[1],
            let_go=fall_speeds,
            unaware=fall_speeds,
        )

    def _test_plan(self) -> _Plan:
        rig = self._rig
        motion = scan_motion(rig.settings.scan, rig.settings.scan.test_m_per_s2)
        time = tick_times(rig, motion_ticks(rig, motion) + 1)
        position, acceleration, _, _ = motion.derivatives_at(time)
        return _Plan(position, acceleration, feedforward_force(self.setup, motion, self.gains))

    def _braking_plan(self, magnet: int, test_plan: _Plan, tick: int) -> _Plan:
        """Return a plan that brakes to rest from a tick on, and then holds the position.

        First, the acceleration decreases linearly to zero in a jerk phase of the set-point.
        """
        rig = self._rig
        file = self._rig.settings
        mass_kg = self.setup.assumed_rig.settings.body.mass_kg
        motion = scan_motion(file.scan, file.scan.test_m_per_s2)
        acceleration, jerk_phase = float(test_plan.acceleration[tick]), motion.jerk_phase
        positions = test_plan.position[max(tick - 1, 0) : tick + 2]
        speed = float((positions[-1] - positions[0]) / ((positions.size - 1) * rig.dt))
        time = tick_times(rig, round(jerk_phase / rig.dt) + 1)
        easing_position = (
            test_plan.position[tick]
            + speed * time
            + acceleration * (time**2 / 2.0 - time**3 / (6.0 * jerk_phase))
        )
        advanced_time = time[:-1] + rig.loop_delay
        easing_acceleration = acceleration * np.maximum(1.0 - advanced_time / jerk_phase, 0.0)
        easing_derivatives = np.column_stack(
            [
                easing_acceleration,
                -acceleration / jerk_phase * (advanced_time < jerk_phase),
                0.0 * advanced_time,
            ]
        )
        speed += 0.5 * acceleration * jerk_phase
        candidates = [
            deceleration_fraction * max(motion.peaks)
            for deceleration_fraction in BRAKING_DECELERATION_FRACTIONS
        ]
        feasible_plans = (
            deceleration
            for deceleration in candidates
            if self._can_apply_forces(magnet, np.array([-mass_kg * deceleration * np.sign(speed)]))
        )
        peak_deceleration = next(feasible_plans, candidates[-1])
        braking_motion = plan_braking(
            speed, 0.0, replace(motion, peaks=(peak_deceleration,)), rig.dt, rig.loop_delay
        )
        gains = np.array([self.gains.acceleration, self.gains.jerk, self.gains.snap])
        hold_zeros = np.zeros(round(HOLD_TIME_S / rig.dt))
        braking_position = easing_position[-1] + braking_motion.position
        eased_acceleration = acceleration * (1.0 - time[:-1] / jerk_phase)
        feedforward = mass_kg * (
            np.vstack([easing_derivatives, braking_motion.early_derivatives[:, :3]]) @ gains
        )
        return _Plan(
            np.concatenate(
                [
                    test_plan.position[:tick],
                    easing_position[:-1],
                    braking_position,
                    braking_position[-1] + hold_zeros,
                ]
            ),
            np.concatenate(
                [
                    test_plan.acceleration[:tick],
                    eased_acceleration,
                    braking_motion.acceleration,
                    [0.0],
                    hold_zeros,
                ]
            ),
            np.concatenate([test_plan.feedforward[:tick], feedforward, hold_zeros]),
        )

    def _can_apply_forces(self, magnet: int, feedforward: FloatArray) -> bool:
        """Whether the magnets can apply the feedforward forces without one magnet."""
        file = self._rig.settings
        layout = wrench_layout(file, usual_allocation(file), self._rig.idle_force)
        layout.lose(magnet)
        wrenches = feedforward_wrench(self.setup.assumed_rig, feedforward).tolist()
        return all(layout.share(wrench)[1] for wrench in wrenches)

    def _simulate_plan(
        self, plan: _Plan, faults: Mapping[int, int], commands: Mapping[int, Command] | None = None
    ) -> Recording:
        """Simulate a plan with faults and commands that begin at given ticks."""
        rig, n = self._rig, plan.feedforward.size
        delay_ticks = round(STROKE_ERROR_DELAY_S / rig.dt)
        delayed_acceleration = np.concatenate([np.zeros(delay_ticks), plan.acceleration[:-delay_ticks]])
        stroke_error = stroke_error_from_acceleration(
            rig, delayed_acceleration / max(rig.settings.scan.test_m_per_s2), tick_times(rig, n + 1)
        )
        wrench = feedforward_wrench(self.setup.assumed_rig, plan.feedforward)
        scenario = scan_scenario(rig, plan.position, stroke_error, wrench)
        for tick, fault_word in faults.items():
            scenario.command[tick:] = fault_word
        for tick, fault_word in (commands or {}).items():
            scenario.command[tick] |= fault_word
        run = SimulatedLoop(self.setup, self.seed).run(scenario)
        return Recording(dict(run.columns) | recording_columns(rig, run, scenario))

    def _contact_speeds(self, run: Recording) -> tuple[float, float]:
        """Return the largest contact speeds, downwards and in any direction at a magnet, m/s."""
        file, axes = self._rig.settings, self._rig.settings.body.free
        poses = np.column_stack([run[name] for name in axis_columns("pose", axes)])
        speeds = np.diff(poses, axis=0) / self._rig.dt
        is_contact = np.diff((np.abs(poses) > np.array(stop_distances(file))).astype(int), axis=0) > 0
        at_magnets = np.abs(speeds @ magnet_rows(file).T).max(axis=1)
        gap_speeds = np.zeros(len(speeds))
        if "z" in axes:
            z = axes.index("z")
            is_landing = is_contact[:, z] & (poses[1:, z] < 0.0)
            rest_tick = int(np.argmax(is_landing)) + round(SLIDE_LIMIT_S / self._rig.dt)
            gap_speeds = -speeds[:, z] * is_landing
            is_contact[rest_tick:] &= not is_landing.any()
            gap_speeds[rest_tick:] = 0.0
        contact_speed = (at_magnets * is_contact.any(axis=1)).max(initial=0.0)
        return max(0.0, float(gap_speeds.max(initial=0.0))), float(contact_speed)
