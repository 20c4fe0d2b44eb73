"""Simulate a stage interactively; its plant and its controller advance together tick by tick.

The firmware does not contain a controller of a stage, so the bench runs the controller of the core.
The bench repeats the set-point, forward and backward alternately, with a rest in between. Changes
take effect at one tick while the body rests. Therefore, the hysteresis law, the gains and the
filters never change while force is demanded.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from anhyst.compensate.force_controller import ForceController
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Fault, Phase, State
from anhyst_rigs.rig.bench.body import body_layout, magnet_pulls, resting_values
from anhyst_rigs.rig.bench.injection import (
    CURRENT_TO_MAX_CURRENT,
    MOTION_TO_GAP,
    InjectedSignal,
    InjectionPort,
)
from anhyst_rigs.rig.bench.laps import CycleBench
from anhyst_rigs.rig.bench.protocol import (
    SCAN_SIGNALS,
    STAGE_COMMANDS,
    STAGE_STATE_SIGNALS,
    DemandRange,
    Parameter,
    Signal,
    axis_and_magnet_signals,
    check_stage_command,
)
from anhyst_rigs.rig.bench.settings import check_values, stage_parameters
from anhyst_rigs.rig.drift import NO_DRIFT, drifted_plant, sample_plant
from anhyst_rigs.rig.loop import ClosedLoop
from anhyst_rigs.rig.plant import coupled_forces, current_controllers
from anhyst_rigs.rig.recording import (
    CURRENT_SIGNALS,
    Loss,
    Recording,
    column_name,
    magnet_columns,
    peak_deviation,
)
from anhyst_rigs.rig.stage.capability import largest_wrench_factor
from anhyst_rigs.rig.stage.geometry import scan_direction, scan_wrench
from anhyst_rigs.rig.stage.loop import (
    Feedforward,
    StageSetup,
    feedforward_wrench,
    pid_coefficients,
    scan_scenario,
)
from anhyst_rigs.rig.stage.recording import (
    WRENCH_UNITS,
    axis_columns,
    demand_columns,
    find_stage_loss,
    recording_columns,
)
from anhyst_rigs.rig.stage.setpoint import (
    STROKE_ERROR_DELAY_S,
    SampledMotion,
    SetPoint,
    plan_braking,
    sample_motion,
    scan_motion,
    stroke_error_from_acceleration,
)

INTEGRAL_AVERAGING_TIME_S = 1e-3
"""Averaging time of the integral wrench, from which a new controller starts, s."""
STORED_CYCLES = 4
"""Number of cycles of the set-point whose currents and gaps are stored for new compensators."""
MAX_LOAD_TO_SPARE_FORCE = 0.5
"""Largest force of the load drive, as a fraction of the force that the set-point does not need."""
FEEDFORWARD_GAINS = ("acceleration", "jerk", "snap")
"""Names of the gains of :class:`anhyst_rigs.rig.stage.loop.Feedforward`."""
PHASES_PER_STATE = 16
"""Factor of the controller's state in the recorded column ``state``, to which the phase is added.
"""
MAX_CYCLES = 100
"""Number of cycles in the record of the bench."""


class StageCycle(NamedTuple):
    """A completed or active motion along the set-point."""

    number: int
    first_tick: int
    tick_count: int
    # first tick of the stored currents, before which the iron was demagnetised
    history_start: int
    motion: SetPoint
    settings_and_loads: tuple[
        object, ...
    ]  # all settings and loads except the corrections, such as plant and gains
    setup: StageSetup  # active setup, including its estimated corrections

    @property
    def last_tick(self) -> int:
        """Last tick of the cycle."""
        return self.first_tick + self.tick_count - 1

    @property
    def method(self) -> MethodName:
        """Compensation method of the cycle."""
        return self.setup.method


class StageBench(CycleBench):
    """A stage that repeats its set-point.

    The parameter ``compensation`` selects one of two setups: 0 without hysteresis compensation, 1
    with the compensator. A load that the controller does not know acts along the set-point. The
    parameters that begin with ``push_`` are added immediately to the wrench that the magnets must
    apply. The controller lifts and lands the body. In the state IDLE the body rests without
    current; in the state READY it levitates.
    """

    lift_tick = 0  # tick of the last lift-off from a rest without current
    _is_lifting_or_landing = False  # whether the body is being lifted or landed
    _next_command = Command.NONE  # command to the controller for the next tick
    commands = STAGE_COMMANDS

    def __init__(
        self, setups: Sequence[StageSetup], gains: Sequence[Feedforward] = (Feedforward(), Feedforward())
    ) -> None:
        rig = setups[0].rig
        self.rig, self.rate = rig, 1.0 / rig.dt
        file, self._magnets = rig.settings, len(rig.settings.magnets)
        coordinate_signals = axis_and_magnet_signals(
            file.body.free, [magnet.name for magnet in file.body_magnets]
        )
        phase_signal = Signal("flight", "", "phase of the controller: Phase of anhyst.support.states")
        self.signals = (*SCAN_SIGNALS, *coordinate_signals, phase_signal, *STAGE_STATE_SIGNALS)
        self.cycles: deque[StageCycle] = deque(maxlen=MAX_CYCLES)
        self._max_acceleration = max(file.scan.test_m_per_s2)
        available_force = (
            largest_wrench_factor(rig, scan_wrench(file)) - file.body.mass_kg * self._max_acceleration
        )
        self.max_load = MAX_LOAD_TO_SPARE_FORCE * max(available_force, 0.0)
        axis_directions = zip(file.body.free, np.eye(len(file.body.free)), strict=True)
        self._max_pushes = {
            f"push_{axis}": MAX_LOAD_TO_SPARE_FORCE * largest_wrench_factor(rig, direction)
            for axis, direction in axis_directions
        }
        self._pushes = dict.fromkeys(self._max_pushes, 0.0)  # active value of each push, N or N m
        # A step of the target by this offset immediately demands the largest force.
        max_offset = file.tracking.force_max_N / pid_coefficients(rig)["b0"]
        self.demand_range = DemandRange(
            "position", "reference", "m", -max_offset, max_offset, 0.0, is_offset=True
        )
        self._injected = InjectedSignal()
        self.injection_port = self._make_injection_port()
        self.setups = tuple(setups)  # setups without corrections, as read from the files
        self._setups, self._gains = list(setups), list(gains)
        self._values = {
            "compensation": 1.0,
            "motion": 1.0,
            "crossover": rig.settings.tracking.crossover_Hz,
            "plant": 0.0,
        }
        self._staged: dict[str, float] = {}
        self._corrected_setups: dict[int, StageSetup] = {}
        self._cycle_count, self._cycle_number = 0, 0
        self._offset, self._load, self._next_direction = 0.0, 0.0, 1.0
        # phase of the controller at each of the last ticks
        self._phases = np.zeros(0)
        self._set_motion(1.0)
        self._reset_plant()

    @property
    def body(self) -> Mapping[str, Any]:
        """Data for a picture of the body, SI units."""
        return {**body_layout(self.rig.settings), "way": peak_deviation(self._scan_course.position)}

    @property
    def _setup(self) -> StageSetup:
        return self._setups[int(self._values["compensation"])]

    def _make_injection_port(self) -> InjectionPort:
        """Return the port along the set-point; the input of its plant is the demanded force."""
        file = self.rig.settings
        components = zip(file.body.free, scan_direction(file), strict=True)
        max_change = CURRENT_TO_MAX_CURRENT * file.amplifier.current_high_A
        commands = [column_name("command", "", number) for number in range(1, self._magnets + 1)]
        return InjectionPort(
            reading={f"pose_read_{axis}": float(part) for axis, part in components if part},
            plant_input={"demand": 1.0},
            input_unit="N",
            max_motion=MOTION_TO_GAP * file.gap_m,
            max_changes=dict.fromkeys(commands, max_change),
            max_step=math.inf,
            held_values={"state": State.READY, "flight": Phase.HOVER, "fault": Fault.NONE},
            limits=(),
        )

    def _set_motion(self, acceleration_factor: float) -> None:
        """Multiply the accelerations of the rig file by a factor; the set-point ends at rest."""
        scan = self.rig.settings.scan
        peaks = [acceleration_factor * peak for peak in (*scan.test_m_per_s2, scan.test_m_per_s2[0])]
        self._motion = replace(scan_motion(scan, peaks), has_final_rest=True)
        self._scan_course = sample_motion(self._motion, self.rig.dt, self.rig.loop_delay)

    def _reset_plant(self) -> None:
        """Start with the selected plant at its operating point, at rest and demagnetised."""
        plant_number = int(self._values["plant"])
        settings = self.rig.settings
        drift, noise = NO_DRIFT, 0
        if plant_number:
            drift, noise = sample_plant(settings, settings.seed, plant_number - 1)
        self._cable_stiffness = drift.cable
        self._plant = drifted_plant(self.rig, drift, noise)
        scan_axis, initial_stroke_error = scan_direction(settings), float(self._next_stroke_errors(1, 0.0)[0])
        self._plant.place((-initial_stroke_error * scan_axis).tolist(), [0.0] * scan_axis.size)
        self._active_course: SampledMotion | None = None
        self._course_tick, self._course_start = 0, 0.0
        self._past_accelerations = np.zeros(round(STROKE_ERROR_DELAY_S / self.rig.dt))
        self._history: deque[FloatArray] = deque()
        axis_count = len(self.rig.settings.body.free)
        self._latest_history = np.zeros((0, 2 * (self._magnets + axis_count)))
        self._integral_wrench = np.zeros(axis_count)
        self._history_start = self.plant_tick = self.tick + 1  # first tick with demagnetised iron
        self._set_controller()

    def _set_controller(self) -> None:
        """Activate a controller with the hysteresis states of the magnets and the present integral."""
        rig = self._setup.rig
        settings = rig.settings.with_changes({"control.crossover_Hz": self._values["crossover"]})
        setup = replace(self._setup, rig=replace(rig, settings=settings))
        # The loop refers to the same drives.
        drives = [self._compensator_with_history(setup, magnet) for magnet in range(self._magnets)]
        controller = setup.make_controller(drives)
        self._loop = ClosedLoop(
            self._plant, controller, current_controllers(setup.rig), coupling=coupled_forces(setup.rig)
        )
        if len(self._latest_history):
            demand, feedforward = np.split(self._latest_history[:, 2 * self._magnets :], 2, axis=1)
            self._integral_wrench = np.array([np.mean(values) for values in (demand - feedforward).T])
        # A controller starts in a levitated state.
        self._next_command = Command.IDLE if self._state is State.IDLE else Command.NONE

    def _compensator_with_history(self, setup: StageSetup, magnet: int) -> ForceController:
        """Return a compensator that has processed the past currents and gaps of a magnet."""
        drive = setup.make_compensators()[magnet]
        path = np.concatenate([*self._history, self._latest_history[-1:]])
        if len(path):
            scale, zero = (1.0, 0.0) if setup.correction_rows is None else setup.correction_rows[magnet, :2]
            drive.follow(scale * path[:, magnet], path[:, self._magnets + magnet] - zero)
        return drive

    def _apply_staged(self) -> None:
        if self._active_course is not None:
            if self._course_tick < len(self._active_course):
                return
            self._course_start += float(self._active_course.position[-1])
            if self._cycle_number:
                self._history_start = self.cycles[-1].first_tick
            self._active_course, self._cycle_number = None, 0
        if self._is_lifting_or_landing:
            return
        if self._staged or self._corrected_setups:
            self._take_staged_changes()
        if self._state is State.RUN:
            self._begin_motion(
                self._scan_course if self._next_direction > 0.0 else self._scan_course.reverse()
            )
            self._cycle_count += 1
            self._cycle_number, self._next_direction = self._cycle_count, -self._next_direction
            external_forces = self._load, *self._pushes.values()
            settings_and_loads = (*self._values.values(), *self._gains, *external_forces)
            begin, ticks = self.tick + 1, len(self._scan_course)
            cycle = StageCycle(
                self._cycle_number,
                begin,
                ticks,
                self._history_start,
                self._motion,
                settings_and_loads,
                self._setup,
            )
            self.cycles.append(cycle)

    def _begin_motion(self, course: SampledMotion) -> None:
        self._active_course, self._course_tick = course, 0
        # Minor loops at rest are not stored, because the next cycle wipes them out.
        self._history.append(self._latest_history[-1:])
        while sum(map(len, self._history)) > STORED_CYCLES * len(self._scan_course):
            self._history.popleft()

    def _take_staged_changes(self) -> None:
        parameter_changes, self._staged = self._staged, {}
        setups, self._corrected_setups = self._corrected_setups, {}
        for number, setup in setups.items():
            self._setups[number] = setup
        self._values |= {name: value for name, value in parameter_changes.items() if name in self._values}
        number = int(self._values["compensation"])
        gains = {
            name: parameter_changes[f"gain_{name}"]
            for name in FEEDFORWARD_GAINS
            if f"gain_{name}" in parameter_changes
        }
        self._gains[number] = replace(self._gains[number], **gains)
        if "motion" in parameter_changes:
            self._set_motion(parameter_changes["motion"])
        if "plant" in parameter_changes:
            self._reset_plant()
        elif number in setups or not parameter_changes.keys().isdisjoint(("compensation", "crossover")):
            self._set_controller()

    def _next_feedforward(self, n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the next n + 1 positions, n accelerations and n feedforward forces."""
        course, tick = self._active_course, self._course_tick
        if course is None:
            positions, accelerations, setpoints = np.zeros(n + 1), np.zeros(n), np.zeros((n, 4))
        else:
            positions = course.position[tick : tick + n + 1]
            accelerations = course.acceleration[tick : tick + n]
            setpoints = course.early_derivatives[tick : tick + n]
        setup, gains = self._setup, self._gains[int(self._values["compensation"])]
        mass = setup.assumed_rig.settings.body.mass_kg
        mass_acceleration = setpoints[:, :3] @ [gains.acceleration, gains.jerk, gains.snap]
        feedforward_forces = mass * mass_acceleration + setup.cable_stiffness * (
            self._course_start + setpoints[:, 3]
        )
        return self._course_start + positions, accelerations, feedforward_forces

    def _next_stroke_errors(self, n: int, delayed_acceleration: FloatArray | float) -> FloatArray:
        """Return the path error of the long stroke at the next ticks, m, as in other simulations."""
        ticks = np.arange(self.tick, self.tick + n, dtype=np.float64)
        return stroke_error_from_acceleration(self.rig, delayed_acceleration, self.rig.dt * ticks)

    def _run_ticks(self, n: int) -> FloatArray:
        if self._active_course is not None:
            n = min(n, len(self._active_course) - self._course_tick)
        positions, accelerations, feedforward = self._next_feedforward(n)
        all_accelerations = np.concatenate([self._past_accelerations, accelerations])
        stroke_error = self._next_stroke_errors(n + 1, all_accelerations[: n + 1] / self._max_acceleration)
        signals, history, loss = self._simulate_ticks(positions, stroke_error, feedforward)
        row_count = len(history)
        rows = self._rows(row_count, *signals)
        self._past_accelerations = all_accelerations[row_count : row_count + self._past_accelerations.size]
        self._course_tick = self._course_tick + row_count
        self._record_history(history)
        carry_over_ticks = round(INTEGRAL_AVERAGING_TIME_S / self.rig.dt)
        self._latest_history = np.concatenate([self._latest_history, history])[-carry_over_ticks:]
        if loss is not None:
            self._state, self._fault, self._cycle_number = State.FAULT, Fault.POSITION_RANGE, 0
        return rows

    def _record_history(self, history_rows: FloatArray) -> None:
        """Store currents and gaps for new compensators, except while the body rests."""
        is_driven = bool(self._history) and self._history[-1][-1:, : self._magnets].any()
        if self._active_course is not None or self._is_lifting_or_landing:
            self._history.append(history_rows)
        elif self._state is State.IDLE and is_driven:
            self._history.append(history_rows[-1:])

    def _simulate_ticks(
        self, positions: FloatArray, stroke_error: FloatArray, feedforward: FloatArray
    ) -> tuple[list[FloatArray], FloatArray, Loss | None]:
        """Return the signals of some ticks, the history of the magnets, and a loss of control.

        The history has one row per tick: current and measured gap of each magnet, then the demanded
        and the feedforward wrench of each coordinate.
        """
        rig, axes = self.rig, self.rig.settings.body.free
        wrench = feedforward_wrench(self._setup.assumed_rig, feedforward) + list(self._pushes.values())
        scenario = scan_scenario(rig, positions, stroke_error, wrench + self._integral_wrench, self._offset)
        scenario.command[0], self._next_command = self._next_command, Command.NONE
        inject = np.outer(self._injected.take(len(wrench)), scan_direction(rig.settings))
        load = self._load - self._cable_stiffness * positions[:-1]
        run = self._loop.run(replace(scenario, load=load, inject=inject))
        # A body that is not held may touch a stop.
        is_held = self._state is not State.IDLE and not self._is_lifting_or_landing
        loss = find_stage_loss(rig, run, len(wrench)) if is_held else None
        run = run.slice_ticks(0, len(wrench) if loss is None else loss.tick + 1)
        columns = dict(run.columns) | recording_columns(rig, run, scenario) | self._bench_columns(run)
        demanded_wrench = [run[name] for name in axis_columns("demand", axes, WRENCH_UNITS)]
        currents = [run[name] for name in magnet_columns(CURRENT_SIGNALS[:1], 1, self._magnets)]
        gaps = [run[name] for name in magnet_columns([("gap_read", "m")], 1, self._magnets)]
        history = [*currents, *gaps, *demanded_wrench, wrench[: len(run)]]
        signals = [columns[column_name(signal.name, signal.unit)] for signal in self._loop_signals]
        return signals, np.column_stack(history), loss

    def _bench_columns(self, run: Recording) -> dict[str, FloatArray]:
        """Return the phase, the pull of each magnet, and the wrench of all magnets together."""
        settings = self.rig.settings
        axes = settings.body.free
        wrench = [run[name] for name in axis_columns("wrench", axes, WRENCH_UNITS)]
        wrench_columns = dict(zip(demand_columns(axes, "wrench"), wrench, strict=True))
        self._phases = run["state"] % PHASES_PER_STATE
        if self._is_lifting_or_landing and self._phases[-1] in (Phase.HOVER, Phase.REST):
            self._is_lifting_or_landing = False
            self._state = State.READY if self._phases[-1] == Phase.HOVER else State.IDLE
        return wrench_columns | magnet_pulls(settings, run) | {"flight": self._phases}

    def _rows(self, n: int, *signals: FloatArray) -> FloatArray:
        tick_numbers = np.arange(self.tick + 1, self.tick + n + 1, dtype=np.float64)
        state_columns = [np.full(n, float(value)) for value in (self._fault, self._cycle_number)]
        state = np.full(n, float(self._state))
        if self._state is not State.FAULT:
            state[self._phases != Phase.HOVER] = State.RUN
            state[self._phases == Phase.REST] = State.IDLE
        self.tick += n
        return np.column_stack([tick_numbers, *signals, state, *state_columns])

    def _lost_rows(self, n: int) -> FloatArray:  # the body is on a stop without current
        values = resting_values(self.rig.settings, self._course_start)
        return self._rows(n, *(np.full(n, values.get(signal.name, 0.0)) for signal in self._loop_signals))

    @property
    def _loop_signals(self) -> Sequence[Signal]:
        """Signals that the loop computes; the bench adds the other signals."""
        return self.signals[: -len(STAGE_STATE_SIGNALS)]

    def command(self, command: Command) -> None:
        """Execute a command.

        In any state, the command STOP brakes immediately, and the body is then held. A body that is
        being lifted is landed again.
        """
        if command is Command.STOP:
            self._injected.start(np.zeros(0))
        if command is Command.STOP and self._is_lifting_or_landing:
            self._next_command = Command.LAND
        elif command is Command.STOP:
            self._begin_braking()
        else:
            check_stage_command(command, self.commands, self._state)
            self._execute_command(command)

    def _execute_command(self, command: Command) -> None:
        """Execute a command that the state permits."""
        if command is Command.RUN:
            # The first motion after this leads back to the origin.
            direction = -1.0 if self._course_start > 0.0 else 1.0
            self._state, self._next_direction, self._offset = State.RUN, direction, 0.0
        elif command is Command.CLEAR:
            self._state, self._fault = State.READY, Fault.NONE
            self._reset_plant()
        else:
            if not self._is_lifting_or_landing:
                self._begin_braking()
            self._next_command, self._is_lifting_or_landing = command, command is not Command.IDLE
            self._state = State.RUN if self._is_lifting_or_landing else State.IDLE
            if command is Command.LIFT:
                self._history_start = self.lift_tick = self.tick + 1

    def _begin_braking(self) -> None:
        if self._state is not State.RUN:
            return
        self._state, self._cycle_number = State.READY, 0
        course, dt = self._active_course, self.rig.dt
        if course is not None and self._course_tick < len(course):
            self._course_start += float(course.position[self._course_tick])
            motion = course.motion_at(self._course_tick, dt)
            scan = self.rig.settings.scan  # has the largest acceleration, also for a slower cycle
            hardest_motion = scan_motion(scan, scan.test_m_per_s2)
            self._begin_motion(plan_braking(*motion, hardest_motion, dt, self.rig.loop_delay))

    def demand(self, value: float) -> None:
        """Demand an offset, m, from the set-point."""
        self.demand_range.check(value)
        self._offset = value

    def inject(self, signal: FloatArray) -> int:
        """Add a signal, m, to the position reading along the set-point; return its first tick."""
        self._injected.start(signal)
        return self.tick + 1

    def load(self, force: float) -> None:
        """Push the body towards larger positions by a force, N, which the controller does not know."""
        self._load = min(max(force, -self.max_load), self.max_load)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all parameters, with the values that will be active from the next rest on."""
        crossover = self.rig.settings.tracking.crossover_Hz
        values = {**self._values, **self._staged}
        gains = self._gains[int(values["compensation"])]
        values = {**{f"gain_{name}": getattr(gains, name) for name in FEEDFORWARD_GAINS}, **values}
        baseline_method, compensated_method = (setup.method for setup in self._setups)
        push_parameters = (
            Parameter(
                name,
                WRENCH_UNITS["_r" in name],
                -limit,
                limit,
                "added to the demanded wrench immediately",
                value,
            )
            for (name, limit), value in zip(self._max_pushes.items(), self._pushes.values(), strict=True)
        )
        return (*stage_parameters(values, (baseline_method, compensated_method), crossover), *push_parameters)

    def apply(self, values: Mapping[str, float]) -> int:
        """Stage parameters until the body next rests; pushes take effect at the next tick."""
        check_values(values, self.parameters(), integer_names=("compensation", "plant"))
        push_forces = {name: force for name, force in values.items() if name in self._pushes}
        staged_values = {name: value for name, value in values.items() if name not in self._pushes}
        active_tick = self.tick + 1
        if staged_values or not push_forces:
            if self._is_lifting_or_landing:
                raise InputError("the stage is lifting or landing: wait", code="wrong-state")
            if self._state is State.FAULT:
                raise InputError("the stage has lost control: press clear first", code="wrong-state")
            self._staged |= staged_values
            active_tick = self._next_rest_tick
        self._pushes |= push_forces
        return active_tick

    def correct(self, setup: StageSetup) -> int:
        """Stage a setup with estimated corrections until the body next rests."""
        methods = [setup_in_use.method for setup_in_use in self._setups]
        self._corrected_setups[methods.index(setup.method)] = setup
        return self._next_rest_tick

    @property
    def _next_rest_tick(self) -> int:
        remaining_ticks = 0 if self._active_course is None else len(self._active_course) - self._course_tick
        return self.tick + remaining_ticks + 1
