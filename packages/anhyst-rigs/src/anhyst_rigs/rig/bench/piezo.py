"""Simulate a piezo stage interactively; the bench repeats the triangle of the rig file.

Changes take effect at the start of a period, or immediately while the stage is held. Disturbances
always take effect immediately.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from anhyst._core import PiezoLoop
from anhyst.compensate.force_controller import ForceController
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray, sine
from anhyst.support.states import Command, Fault, State
from anhyst_rigs.rig.bench.laps import CycleBench
from anhyst_rigs.rig.bench.protocol import (
    CYCLE_COMMANDS,
    STAGE_STATE_SIGNALS,
    DemandRange,
    Knobs,
    Parameter,
    Signal,
    check_stage_command,
)
from anhyst_rigs.rig.bench.settings import MAX_PLANT_NUMBER, check_values
from anhyst_rigs.rig.drift import NO_DRIFT, drifted_file, sample_plant
from anhyst_rigs.rig.piezo import (
    NOISE_SEED,
    PiezoRig,
    controller_arguments,
    copy_at_rest,
    find_piezo_loss,
    round_corners,
    triangle_wave,
)

_PIEZO_SIGNALS = (
    Signal("reference", "m", "reference position: triangle plus target"),
    Signal("expected", "m", "reference, delayed by the expected delay"),
    Signal("position", "m", "true position"),
    Signal("position_read", "m", "measured position"),
    Signal("error", "m", "true position minus expected position"),
    Signal("demand", "m", "demanded displacement of the stack: reference plus correction"),
    Signal("voltage", "V", "commanded voltage, from the next tick on"),
    Signal("disturbance", "m", "static displacement that the load would cause"),
)


class PiezoBench(CycleBench):
    """A piezo stage that repeats its triangle.

    The parameter ``compensation`` is 0 without hysteresis compensation, 1 with the compensator.
    """

    signals = (*_PIEZO_SIGNALS, *STAGE_STATE_SIGNALS)
    commands = CYCLE_COMMANDS

    def __init__(self, rig: PiezoRig, inverses: Sequence[ForceController]) -> None:
        case, rate = rig.settings.displacement_case, float(rig.settings.timing.rate_Hz)
        self.rig, self.rate = rig, rate
        self._inverses = tuple(inverses)
        # largest displacement in the measured loops, m
        self._max_displacement = inverses[0].scales.demand
        self.demand_range = DemandRange(
            "position",
            "reference",
            "m",
            -case.low_m,
            self._max_displacement - case.low_m,
            0.0,
            is_offset=True,
        )
        self._values = {
            "compensation": 1.0,
            "bandwidth": rig.settings.displacement.bandwidth_Hz,
            "stroke": case.stroke_m,
            "frequency": case.frequency_Hz,
            "plant": 0.0,
        }
        self._staged: dict[str, float] = {}
        stroke = case.stroke_m
        self._knobs = Knobs(
            Parameter("disturbance_stroke", "m", 0.0, stroke, "amplitude of a sinusoidal load", 0.0),
            Parameter("disturbance_frequency", "Hz", 0.0, rate / 4.0, "frequency of this sine", 10.0),
        )
        self._phase_zero_tick = 0  # tick at which the phase of the disturbance is zero
        self._cycle_count = 0
        self._offset, self._triangle_height = (
            0.0,
            0.0,
        )  # offset of the target, and height of the triangle above its low end, m
        # number of ticks since the path began, number of complete periods since then, and phase at
        # its start as a fraction of a period
        self._path_ticks, self._whole_periods, self._start_phase = 0, 0, 0.0
        self._reset_plant()

    def _reset_plant(self) -> None:
        """Start with the selected plant, after a long rest at 0 V."""
        settings, plant_number = self.rig.settings, int(self._values["plant"])
        drift, noise = NO_DRIFT, NOISE_SEED
        if plant_number:
            drift, noise = sample_plant(settings, settings.seed, plant_number - 1)
        self._rng = np.random.default_rng(noise)
        plant = replace(self.rig, settings=drifted_file(settings, drift))
        self._loop = PiezoLoop(plant.make_motion(self.rig.dt), settings.position_sensor.step_m)
        self._drives = [copy_at_rest(inverse) for inverse in self._inverses]
        # displacement that each inverse predicts, m
        self._expected_displacements = np.zeros(len(self._drives))
        self._plant_ticks = 0  # number of ticks since the present plant was reset
        self._delay_ticks = math.ceil(self.rig.response_delay * self.rate) + 1
        self._past = np.full(self.rig.corner_ticks + self._delay_ticks, settings.displacement_case.low_m)
        self._triangle_height = 0.0
        self._set_controller(None)

    def _set_controller(self, old_number: int | None) -> None:
        """Activate the selected controller, from rest or by a bumpless transfer from another one."""
        selected_number, output_change = int(self._values["compensation"]), None
        if old_number is not None:
            output_change = float(
                self._expected_displacements[selected_number] - self._expected_displacements[old_number]
            )
        bandwidth = {"control.bandwidth_Hz": self._values["bandwidth"]}
        rig = replace(self.rig, settings=self.rig.settings.with_changes(bandwidth))
        drive = self._drives[selected_number]
        self._loop.control(drive.native, **controller_arguments(rig, drive), change=output_change)

    def _apply_staged(self) -> None:
        if self._state is State.RUN and self._path_ticks:
            if self._period_phases(1).size:
                return
            self._whole_periods += 1
            self._cycle_count += 1
            self._triangle_height = 0.0
        if self._staged:
            self._take_staged_values()
            self._path_ticks = 0
        if self._state is State.RUN and not self._path_ticks:
            stroke = self._values["stroke"]
            # Start on the ascending side of the triangle, at the height at which the stage is held.
            self._start_phase = min(0.5 * self._triangle_height / stroke, 0.5) if stroke else 0.0
            self._whole_periods = 0

    def _take_staged_values(self) -> None:
        old_number, staged_values, self._staged = int(self._values["compensation"]), self._staged, {}
        self._values |= staged_values
        if "plant" in staged_values:
            self._reset_plant()
        elif not staged_values.keys().isdisjoint(("compensation", "bandwidth")):
            self._set_controller(old_number)

    def _period_phases(self, n: int) -> FloatArray:
        """Return the phase of each of the next n ticks, as a fraction of the present period."""
        ticks = np.arange(self._path_ticks, self._path_ticks + n, dtype=np.float64)
        phases: FloatArray = ticks * self._values["frequency"] / self.rate + self._start_phase
        return phases[np.floor(phases) <= self._whole_periods]

    def _run_ticks(self, n: int) -> FloatArray:
        is_running = self._state is State.RUN
        height = np.full(n, self._triangle_height)
        if is_running:
            height = self._values["stroke"] * triangle_wave(self._period_phases(n))
        n, rig, settings = height.size, self.rig, self.rig.settings
        path = np.concatenate([self._past, settings.displacement_case.low_m + height + self._offset])
        reference = round_corners(path, rig.corner_ticks)
        time = rig.dt * np.arange(
            self._plant_ticks - self._delay_ticks, self._plant_ticks + n, dtype=np.float64
        )
        expected_displacement = np.interp(time[self._delay_ticks :] - rig.response_delay, time, reference)
        reference = reference[self._delay_ticks :]
        noise = settings.position_sensor.noise_m * self._rng.standard_normal(n)
        ticks = np.arange(n) + (self.tick + 1 - self._phase_zero_tick)
        wave = sine(self._knobs["disturbance_frequency"] * rig.dt * ticks)
        load = self._knobs["disturbance_stroke"] * wave + 0.0  # avoids -0.0 if there is no load
        table = self._loop.run(reference, expected_displacement, noise, load)
        position, position_read, demand, voltage = table.T.copy()
        error = position - expected_displacement
        loss = find_piezo_loss(rig, error, demand - reference)
        row_count = n if loss is None else loss.tick + 1
        self._past, self._triangle_height = path[n:], float(height[-1])
        self._plant_ticks = self._plant_ticks + n
        self._path_ticks = self._path_ticks + n if is_running else 0
        for number, drive in enumerate(self._drives):
            in_force = number == int(self._values["compensation"])
            self._expected_displacements[number] = (
                demand[-1] if in_force else drive.follow(voltage, np.zeros(n))[-1]
            )
        signals = (reference, expected_displacement, position, position_read, error, demand, voltage, load)
        rows = self._rows(row_count, *(signal[:row_count] for signal in signals))
        if loss is not None:
            self._state, self._fault = State.FAULT, Fault.POSITION_RANGE
        return rows

    def _rows(self, n: int, *signals: FloatArray) -> FloatArray:
        tick_numbers = np.arange(self.tick + 1, self.tick + n + 1, dtype=np.float64)
        cycle = self._cycle_count if self._state is State.RUN else 0
        state_columns = [np.full(n, float(value)) for value in (self._state, self._fault, cycle)]
        self.tick += n
        return np.column_stack([tick_numbers, *signals, *state_columns])

    def _lost_rows(self, n: int) -> FloatArray:  # the stage is at 0 V
        return self._rows(n, *np.zeros((len(_PIEZO_SIGNALS), n)))

    def command(self, command: Command) -> None:
        """Execute a command; in any state, the command STOP holds the stage at its position."""
        if command is Command.STOP:
            if self._state is State.RUN:
                self._state = State.READY
            return
        check_stage_command(command, self.commands, self._state)
        if command is Command.RUN:
            self._state, self._path_ticks, self._offset = State.RUN, 0, 0.0
            self._cycle_count += 1
        else:
            self._state, self._fault = State.READY, Fault.NONE
            self._reset_plant()

    def demand(self, value: float) -> None:
        """Demand an offset, m, from the triangle or from the held position."""
        self.demand_range.check(value)
        self._check_displacement(value, self._staged)
        self._offset = value

    def _check_displacement(self, offset: float, staged_values: Mapping[str, float]) -> None:
        """Raise an InputError if the stack cannot reach the active or staged displacements."""
        active_and_staged_strokes = self._values["stroke"], staged_values.get("stroke", 0.0)
        triangle_height = (
            max(active_and_staged_strokes) if self._state is State.RUN else self._triangle_height
        )
        highest_displacement = self.rig.settings.displacement_case.low_m + triangle_height + offset
        if highest_displacement > self._max_displacement * (1.0 + 1e-9):
            raise InputError(
                f"the stage would go to {1e6 * highest_displacement:.3g} um, the stack to "
                f"{1e6 * self._max_displacement:.3g} um; lower the offset or the stroke",
                code="out-of-range",
            )

    def load(self, force: float) -> None:
        """Raise an InputError; use the parameter ``disturbance_stroke`` as a load."""
        raise InputError("load: a piezo stage has no load drive", code="option-not-for-this")

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all parameters, with the values that will be active from the next period on."""
        settings = self.rig.settings
        case = self.rig.settings.displacement_case
        values = self._values | self._staged
        bandwidth, nominal_frequency = settings.displacement.bandwidth_Hz, case.frequency_Hz
        max_frequency = max(nominal_frequency, min(self.rate / 20.0, 0.25 / max(case.corner_s, self.rig.dt)))
        baseline, compensator = (inverse.method for inverse in self._inverses)
        entries = (
            ("compensation", "", 0.0, 1.0, f"1: {compensator}; 0: {baseline}"),
            ("bandwidth", "Hz", 0.1 * bandwidth, 5.0 * bandwidth, "bandwidth of the integrator"),
            ("stroke", "m", 0.0, self._max_displacement - case.low_m, "stroke of the triangle, peak to peak"),
            ("frequency", "Hz", 0.05 * nominal_frequency, max_frequency, "frequency of the triangle"),
            ("plant", "", 0.0, float(MAX_PLANT_NUMBER), "0: rig file; n: n-th plant of [spread]"),
        )
        return (*(Parameter(*entry, values[entry[0]]) for entry in entries), *self._knobs.parameters())

    def apply(self, values: Mapping[str, float]) -> int:
        """Stage parameters until the next period; disturbances take effect at the next tick."""
        check_values(values, self.parameters(), integer_names=("compensation", "plant"))
        staged_values = {name: value for name, value in values.items() if name in self._values}
        if staged_values and self._state is State.FAULT:
            raise InputError("the stage has lost control: press clear first", code="wrong-state")
        self._check_displacement(self._offset, self._staged | staged_values)
        self._knobs.apply(values)
        if "disturbance_frequency" in values:
            self._phase_zero_tick = self.tick + 1
        self._staged |= staged_values
        return self._next_period_tick if staged_values else self.tick + 1

    @property
    def _next_period_tick(self) -> int:
        """First tick of the next period."""
        if self._state is not State.RUN or not self._path_ticks:
            return self.tick + 1
        period = self.rate / self._values["frequency"]
        return self.tick + 1 + self._period_phases(math.ceil(period) + 1).size
