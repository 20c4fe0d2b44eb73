"""Simulate a bearing and its firmware interactively; both advance together tick by tick."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anhyst._core import POSITION_MAGNETS, BusController, Plant
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray, sine
from anhyst.support.states import Command, Fault, Flag, Phase, State
from anhyst_rigs.link.client import ControllerLink
from anhyst_rigs.link.frames import PlantDrive, PlantSample, StatusAnswer, TargetRequest
from anhyst_rigs.link.virtual_boards import Q30, Q31, VIRTUAL_BOARDS, Exchange, LibraryBoard, Reading
from anhyst_rigs.link.wire import LinkPort
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bench.injection import (
    CURRENT_TO_MAX_CURRENT,
    MOTION_TO_GAP,
    InjectedSignal,
    InjectionPort,
    SignalLimit,
)
from anhyst_rigs.rig.bench.pace import Heartbeat, LockStepBench
from anhyst_rigs.rig.bench.protocol import (
    BEARING_COMMANDS,
    DemandRange,
    Knobs,
    Parameter,
    Signal,
    current_signals,
)
from anhyst_rigs.rig.bench.settings import (
    ControllerSettings,
    check_values,
    position_settings,
    set_expected_amplifier,
)
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.loop import ClosedLoop, Scenario
from anhyst_rigs.rig.plant import current_controllers, make_plant
from anhyst_rigs.rig.recording import Recording, column_name


class LoadDrive:
    """A load drive of a bearing with force, damping, stiffness and a sinusoidal disturbance."""

    def __init__(self, rig: BodyRig, bearing: Plant) -> None:
        load, mass = rig.settings.load, rig.settings.body.mass_kg
        self.force = load.force_N
        self._bearing = bearing
        self._dt = rig.dt
        self._phase_zero_tick = 0  # tick at which the phase of the disturbance is zero
        # The drive produces damping and stiffness with a lag. Larger values relative to its
        # bandwidth would make the drive unstable.
        max_damping = mass * 2.0 * math.pi * load.velocity_bandwidth_Hz / 4.0
        max_stiffness = mass * (2.0 * math.pi * load.bandwidth_Hz / 10.0) ** 2
        max_frequency = rig.settings.timing.rate_Hz / 4.0
        max_force = max(abs(load.force_N), mass * 9.81)
        damping_doc = "damping that the load drive renders"
        stiffness_doc = "stiffness that it renders about "
        stiffness_doc += "the operating gap"
        amplitude_doc = "amplitude of a sine added to its force"
        self._knobs = Knobs(
            Parameter(
                "load_damping", "N s/m", -max_damping, max_damping, damping_doc, load.damping_N_s_per_m
            ),
            Parameter(
                "load_stiffness", "N/m", -max_stiffness, max_stiffness, stiffness_doc, load.stiffness_N_per_m
            ),
            Parameter("disturbance_force", "N", 0.0, max_force, amplitude_doc, 0.0),
            Parameter("disturbance_frequency", "Hz", 0.0, max_frequency, "frequency of this sine", 10.0),
        )
        self.parameters = self._knobs.parameters

    def apply(self, values: Mapping[str, float], tick: int) -> None:
        """Set values that apply from a tick on; unknown parameter names are ignored."""
        self._knobs.apply(values)
        if "disturbance_frequency" in values:
            self._phase_zero_tick = tick
        self._bearing.set_load(self._knobs["load_damping"], self._knobs["load_stiffness"])

    def forces(self, first_tick: int, ticks: int) -> FloatArray:
        """Return the commanded force at the next ticks, N, shape (ticks,)."""
        amplitude = self._knobs["disturbance_force"]
        if amplitude == 0.0:
            return np.full(ticks, self.force)
        ticks_since = np.arange(
            first_tick - self._phase_zero_tick, first_tick - self._phase_zero_tick + ticks
        )
        phase = self._knobs["disturbance_frequency"] * self._dt * ticks_since
        wave: FloatArray = self.force + amplitude * sine(phase)
        return wave


_PLANT_SIGNALS = {
    "gap_m": Signal("gap", "m", "true gap"),
    "gap_read_m": Signal("gap_read", "m", "measured gap"),
    "velocity_m_per_s": Signal("velocity", "m/s", "true rate of change of the gap"),
    "reference_m": Signal("reference", "m", "reference gap"),
    "demand_N": Signal("demand", "N", "demanded net force"),
    "force_N": Signal("force", "N", "true net force of the magnets"),
    "load_N": Signal("load", "N", "true force of the load drive"),
    **current_signals(1, 1),
    "current_read_A": Signal("current_read", "A", "measured current of magnet 1"),
    "voltage_V": Signal("voltage", "V", "voltage at the first winding"),
    "flux_Wb": Signal("flux", "Wb", "flux linkage of the first winding"),
    "flux_density_T": Signal("flux_density", "T", "flux density in the gap of the first magnet"),
    **current_signals(2, POSITION_MAGNETS),
}
"""Signals of the plant, keyed by the columns of a simulated loop."""
_FIRMWARE_SIGNALS = (
    Signal("expected", "N", "force that the first magnet's model predicts after the tick"),
    Signal("model_flux", "", "flux of this model, as a fraction of its full scale"),
    Signal("state", "", "state of the controller: State of anhyst.support.states"),
    Signal("phase", "", "phase of the controller: Phase"),
    Signal("fault", "", "latched fault: Fault"),
    Signal("flags", "", "flags of this tick: Flag"),
)
"""Signals that only the firmware provides."""
_FULL_SCALE_NAMES = ("gap_middle", "position_full", "current_full", "demand_full", "load_full", "flux_full")
_STATE_COLUMN = 1 + len(_PLANT_SIGNALS) + [signal.name for signal in _FIRMWARE_SIGNALS].index("state")
"""Index of the controller state in the rows of a bench; the fault is two columns after it."""
_WORD_INDEX = {field.name: at for at, field in enumerate(fields(PlantDrive))}
_TickFunction = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)


class BusTap:
    """An exchange with a firmware that can change sensor samples or withhold them."""

    def __init__(self, exchange: Exchange) -> None:
        # function that changes a sensor sample; None: unchanged
        self.change_sample: Callable[[PlantSample], PlantSample] | None = None
        self.ticks_to_skip = 0  # number of the next samples that are withheld from the firmware
        self.exchange, self._call = exchange, _TickFunction(self._exchange_tick)
        self._last_answer = PlantDrive(*(0 for _ in fields(PlantDrive)))

    @property
    def tick(self) -> tuple[int, int]:
        """Addresses of the tick function and its memory (0), for the BusController of the core."""
        return ctypes.cast(self._call, ctypes.c_void_p).value or 0, 0

    def _exchange_tick(self, memory: int | None, sample: int, drive: int) -> None:
        del memory  # not used: the exchange object refers to the firmware's memory
        ctypes.memset(drive, 0, PlantDrive.FIXED.size)  # no answer yet
        sample_bytes = ctypes.string_at(sample, PlantSample.FIXED.size)
        plant_sample = PlantSample(*PlantSample.FIXED.unpack(sample_bytes))
        if self.ticks_to_skip:
            self.ticks_to_skip -= 1
            self._last_answer = replace(self._last_answer, tick=plant_sample.tick)
        else:
            changed_sample = plant_sample if self.change_sample is None else self.change_sample(plant_sample)
            try:
                self._last_answer = self.exchange(changed_sample)
            except (OSError, ValueError):
                return  # The closed loop detects that the answer is missing.
        answer = self._last_answer.FIXED.pack(*vars(self._last_answer).values())
        ctypes.memmove(drive, answer, len(answer))


_VOLTAGE_TO_SUPPLY = 0.6
"""Largest change of the voltage by this signal, relative to the supply voltage."""
_STEP_TO_MAX_STEP = 0.5
"""Largest step of an injected signal, relative to the largest plausible step of the position."""
_LIMITED = Flag.DEMAND_LIMITED | Flag.CURRENT_LIMITED | Flag.FLUX_LIMITED | Flag.SAMPLE_IMPLAUSIBLE


def make_injection_port(setup: BearingSetup) -> InjectionPort:
    """Return the port of a bearing; the input of its plant is the current reference."""
    settings, limits = setup.rig.settings, setup.controller.limits
    body, supply = settings.body, settings.amplifier.supply
    is_pair = len(settings.body_magnets) == 2
    return InjectionPort(
        reading={"gap_read": -1.0},
        plant_input={"command": 0.5, "command_2": -0.5} if is_pair else {"command": 1.0},
        input_unit="A",
        max_motion=MOTION_TO_GAP * settings.gap_m,
        max_changes={
            "command": CURRENT_TO_MAX_CURRENT * limits.current_high_A,
            "voltage": _VOLTAGE_TO_SUPPLY * supply,
        },
        max_step=_STEP_TO_MAX_STEP * limits.step_m,
        held_values={"state": State.RUN, "phase": Phase.HOVER, "fault": Fault.NONE},
        limits=(
            SignalLimit("gap", body.stop_low_m, body.stop_high_m, "the armature touched an end stop"),
            SignalLimit("voltage", -supply, supply, "the amplifier reached its supply voltage"),
        ),
        forbidden_flags=_LIMITED,
    )


class _NoPlant:
    """Placeholder for the plant of a board's bus; the closed loop simulates the plant instead."""

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        raise NotImplementedError


class BearingBench(LockStepBench):
    """A bearing and the firmware that levitates it; both advance together tick by tick.

    The firmware runs in this process, or with a :class:`BusTap` on one of
    :data:`anhyst_rigs.link.virtual_boards.VIRTUAL_BOARDS`. Its heartbeat timeout is in ticks.
    """

    signals = (*_PLANT_SIGNALS.values(), *_FIRMWARE_SIGNALS)
    commands = BEARING_COMMANDS
    _bus: BusController
    state = State.INIT  # state of the controller after the last tick
    fault = Fault.NONE  # fault of the controller after the last tick
    gap = math.nan  # gap at the last tick, m
    sends_heartbeat = True  # whether the bench sends the heartbeats of the operator

    def __init__(
        self, setup: BearingSetup, firmware: Path, board: str = "", bearing: Plant | None = None
    ) -> None:
        rig = setup.rig
        self.rate = float(rig.settings.timing.rate_Hz)
        self._scales = setup.position_control.settings("fixed")
        self.bearing = bearing or make_plant(rig, 0)
        self.load_drive = LoadDrive(rig, self.bearing)
        limits, gap = setup.controller.limits, rig.settings.gap_m
        stops = rig.settings.body
        gap_low, gap_high = (
            max(limits.gap_low_m, stops.stop_low_m),
            min(limits.gap_high_m, stops.stop_high_m),
        )
        self.demand_range = DemandRange("gap", "reference", "m", gap_low, gap_high, gap)
        self.max_load, self.rest_load = limits.force_high_N, rig.settings.load.force_N
        self._injected = InjectedSignal()
        self.injection_port = make_injection_port(setup)
        self._target_code: int | None = None
        self._resources = ExitStack()
        try:
            source: LibraryBoard | BusTap
            port: str | LinkPort
            if board:
                running_firmware = self._resources.enter_context(VIRTUAL_BOARDS[board](firmware, _NoPlant()))
                self.tap = source = BusTap(running_firmware.bus.exchange)
                port = running_firmware.link
            else:
                port = source = LibraryBoard(firmware)
                self._resources.callback(source.switch_off)
            self.link = self._resources.enter_context(ControllerLink(port))
            self._heartbeat = Heartbeat(self.link)
            slew = rig.settings.amplifier.supply / rig.settings.magnet.poles.inductance(gap)
            set_expected_amplifier(self.link, rig.settings, slew, self._scales["current_full"])
            pidd2 = setup.controller.pidd2()
            gains = pidd2.K_p, pidd2.K_i, pidd2.K_d, pidd2.K_dd
            self._settings = ControllerSettings(self.link, position_settings(gains))
            self._bus = BusController(*source.tick, {name: self._scales[name] for name in _FULL_SCALE_NAMES})
            self._resources.callback(self._bus.end)
            self._loop = ClosedLoop(self.bearing, self._bus, current_controllers(rig), tuple(_PLANT_SIGNALS))
            self.demand(gap)
        except BaseException:
            self._resources.close()
            raise

    def advance(self, ticks: int) -> FloatArray:
        """Simulate some ticks and return their rows."""
        load = self.load_drive.forces(self.tick + 1, ticks)
        # The reading is a gap, and the injected signal a position, which reduces the gap.
        return self._run_with_heartbeat(Scenario(np.zeros(ticks), load, -self._injected.take(ticks)))

    def step(self) -> dict[str, float]:
        """Advance by one tick and return its signals, keyed by their names."""
        names = (signal.name for signal in self.signals)
        return dict(zip(names, self.advance(1)[0, 1:].tolist(), strict=True))

    def run(self, scenario: Scenario, progress: Progress | None = None) -> Recording:
        """Run a scenario; its targets and commands are sent over the link.

        The recording has the columns of a simulated loop for the plant, and those of the firmware.
        """
        is_unchanged = np.diff(scenario.target, prepend=np.nan) == 0.0
        change_ticks = np.flatnonzero(~is_unchanged | (scenario.command & 0xFF > 0)).tolist()
        rows = []
        for begin, end in pairwise([*change_ticks, scenario.ticks]):
            command = Command(int(scenario.command[begin]) & 0xFF)
            if command is not Command.NONE:
                self.command(command)
            self.demand(float(scenario.target[begin]))
            rows.append(self._run_with_heartbeat(scenario.slice_ticks(begin, end)))
            if progress is not None:
                progress(end, scenario.ticks)
        firmware_columns = [column_name(signal.name, signal.unit) for signal in _FIRMWARE_SIGNALS]
        return Recording.from_table(np.concatenate(rows), ["tick", *_PLANT_SIGNALS, *firmware_columns])

    def _run_with_heartbeat(self, scenario: Scenario) -> FloatArray:
        """Run a scenario without targets and commands, and send each heartbeat when it is due."""
        recordings, begin = [], 0
        while begin < scenario.ticks:
            remaining_ticks = scenario.ticks - begin
            tick_count = (
                self._heartbeat.count_ticks(remaining_ticks) if self.sends_heartbeat else remaining_ticks
            )
            recordings.append(self._run(scenario.slice_ticks(begin, begin + tick_count)))
            begin += tick_count
        return np.concatenate(recordings)

    def _run(self, scenario: Scenario) -> FloatArray:
        first_tick = self.tick + 1
        run = self._loop.run(scenario)
        if len(run) < scenario.ticks:
            raise InputError(f"the controller did not answer tick {self.tick}", code="no-answer")
        tick_numbers = np.arange(first_tick, first_tick + len(run), dtype=np.float64)
        rows = np.column_stack((tick_numbers, run.table, self._firmware_columns(self._bus.take())))
        self.gap = float(run["gap_m"][-1])
        self.state = State(int(rows[-1, _STATE_COLUMN]))
        self.fault = Fault(int(rows[-1, _STATE_COLUMN + 2]))
        return rows

    def _firmware_columns(self, answer_words: NDArray[np.uint32]) -> FloatArray:
        """Return one column for each signal of the firmware, from the words of its answers."""
        signed_words = answer_words.view(np.int32).astype(np.float64)
        state, mode = answer_words[:, _WORD_INDEX["state"]], answer_words[:, _WORD_INDEX["mode"]]
        return np.column_stack(
            (
                signed_words[:, _WORD_INDEX["expected"]] / Q31 * self._scales["demand_full"],
                signed_words[:, _WORD_INDEX["flux"]] / Q30,
                state & 0xFF,
                mode >> 16,
                state >> 8 & 0xFF,
                mode & 0xFFFF,
            )
        )

    def command(self, command: Command) -> None:
        """Send a command over the link."""
        if command is Command.STOP:
            self._injected.start(np.zeros(0))
        self.link.command(command)
        self._heartbeat.restart()

    def demand(self, value: float) -> None:
        """Demand a gap, m."""
        self.demand_range.check(value)
        position_code = (self._scales["gap_middle"] - value) / self._scales["position_full"]
        code = max(-(1 << 31), min((1 << 31) - 1, math.floor(position_code * Q31 + 0.5)))
        if code != self._target_code:
            self.link.request(TargetRequest(code), StatusAnswer)
            self._target_code = code
            self._heartbeat.restart()

    def inject(self, signal: FloatArray) -> int:
        """Add a signal, m, to the position reading; return its first tick."""
        self._injected.start(signal)
        return self.tick + 1

    def load(self, force: float) -> None:
        """Command a force of the load drive, N; positive opens the gap."""
        self.load_drive.force = force

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the parameters of the controller and of the load drive."""
        return (*self._settings.parameters(), *self.load_drive.parameters())

    def apply(self, values: Mapping[str, float]) -> int:
        """Set parameters, all from the next tick on, and return this tick."""
        check_values(values, self.parameters())
        self._settings.write(values, is_running=True)
        self._heartbeat.restart()
        self.load_drive.apply(values, self.tick + 1)
        return self.tick + 1
