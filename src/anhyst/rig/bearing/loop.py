"""A bearing and its controller in lock-step: whether they fit, scenarios, what became of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from anhyst._core import FixedPosition, LoopController, Plant, Position, PositionF32
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import PROBED
from anhyst.control.controller_file import ControllerFile, ControllerTable, PairTable
from anhyst.control.position import PositionControl, ReferenceConverter
from anhyst.rig.bearing.scenario import Script, land_time, lift_time, steps_up_and_down
from anhyst.rig.body import BodyRig, step_ends
from anhyst.rig.loop import ClosedLoop, Scenario
from anhyst.rig.plant import current_loops, make_plant
from anhyst.rig.recording import (
    BREAKAWAY,
    COLUMNS,
    DESCEND,
    FAULT,
    HOVER,
    READY,
    RISE,
    RUN,
    Recording,
    SignalBound,
    find_loss,
)
from anhyst.support.kinds import MethodName
from anhyst.support.states import Command, Flag
from anhyst.support.toml_file import FileFault, faults_error

LONGEST_RAMP_S = 60.0
"""Longest time that lifting off or landing may take, s."""


def pair_of(rig: BodyRig) -> PairTable | None:
    """Return what a controller has to know of a second magnet, or None where there is none."""
    bias, total = rig.settings.bias_N, rig.settings.gap_total_m
    if bias is None or total is None:
        return None
    return PairTable(bias_force_N=bias, gap_total_m=total)


def check_controller(controller: ControllerFile, rig: BodyRig) -> None:
    """Refuse a controller that does not belong to the rig."""
    if faults := list(_rig_faults(controller.settings, rig)):
        raise faults_error(controller.path, faults)


def _rig_faults(settings: ControllerTable, rig: BodyRig) -> Iterator[FileFault]:
    plant, rate = rig.settings, rig.settings.timing.rate_Hz
    if settings.rate_Hz != rate:
        text = f"is {settings.rate_Hz:g} Hz here and {rate:g} Hz in {rig.path}; make them equal"
        yield FileFault(("rate_Hz",), text, code="differs-from-rig")
    limits, amplifier = settings.limits, plant.amplifier
    if limits.current_low_A < amplifier.current_low_A:
        text = f"the amplifier of {rig.path} begins at {amplifier.current_low_A:g} A; raise it"
        yield FileFault(("limits", "current_low_A"), text, code="beyond-amplifier")
    if limits.current_high_A > amplifier.current_high_A:
        text = f"the amplifier of {rig.path} ends at {amplifier.current_high_A:g} A; lower it"
        yield FileFault(("limits", "current_high_A"), text, code="beyond-amplifier")
    if len(rig.magnets) == 1 and limits.force_low_N < 0.0:
        text = "a single magnet cannot push; raise it to 0 or more"
        yield FileFault(("limits", "force_low_N"), text, code="cannot-push")
    if len(rig.magnets) == 1 and not rig.load < limits.force_high_N:
        text = f"{limits.force_high_N:g} N do not lift the load of {rig.path}, {rig.load:g} N"
        yield FileFault(("limits", "force_high_N"), f"{text}; raise it", code="load-not-lifted")
    variant = settings.compensation.variant
    if variant in PROBED and plant.hall_probe is None:
        text = f'"{variant}" needs the table [hall_probe], {rig.path} has none; add it'
        yield FileFault(("compensation", "variant"), text, code="no-hall-probe")
    yield from _amplifier_faults(settings, rig)
    steps = ((gap, height) for gap in plant.step_gaps_m for height in plant.step.heights_m)
    lows = [step_ends(gap, height)[1] for gap, height in steps]
    lowest = min(lows + [plant.gap_m - one.amplitude_m for one in plant.trajectories])
    highest = plant.body.stop_high_m
    if not limits.gap_low_m < lowest:
        text = f"{rig.path} goes to a gap of {lowest:.5g} m; lower it"
        yield FileFault(("limits", "gap_low_m"), text, code="gaps-not-covered")
    step = plant.gap_sensor.step
    if limits.step_m < step:
        text = f"the position sensor of {rig.path} has steps of {step:.4g} m; raise it"
        yield FileFault(("limits", "step_m"), text, code="step-too-fine")
    if not limits.gap_high_m > highest:
        text = f"{rig.path} rests at a gap of {highest:.5g} m; raise it"
        yield FileFault(("limits", "gap_high_m"), text, code="gaps-not-covered")
    yield from _ramp_faults(settings, rig, lowest)


def _ramp_faults(settings: ControllerTable, rig: BodyRig, lowest: float) -> Iterator[FileFault]:
    """Find ramps so slow that nobody waits for them."""
    way = rig.settings.body.stop_high_m - lowest
    for table, what, ramp, seconds in (
        ("lift_off", "lifting off", settings.lift_off, lift_time(rig, settings, lowest)),
        ("landing", "landing", settings.landing, land_time(rig, settings)),
    ):
        if seconds > LONGEST_RAMP_S:
            forces = settings.limits.force_high_N / ramp.force_rate_N_per_s
            longer = forces > way / ramp.speed_m_per_s
            key = "force_rate_N_per_s" if longer else "speed_m_per_s"
            text = f"{what} takes {seconds:.4g} s, at most {LONGEST_RAMP_S:g} s are simulated"
            yield FileFault((table, key), f"{text}; raise it", code="too-slow")


def _amplifier_faults(settings: ControllerTable, rig: BodyRig) -> Iterator[FileFault]:
    """Say where the file contradicts the rig on amplifiers or a second magnet."""
    converter, amplifier = settings.converter, rig.settings.amplifier
    if converter is not None:
        ends = {
            "low_A": amplifier.current_low_A,
            "high_A": amplifier.current_high_A,
            "bits": amplifier.dac_bits,
        }
        for key, value in ends.items():
            if getattr(converter, key) != value:
                text = f"the amplifier of {rig.path} has {value:g}; make them equal"
                yield FileFault(("converter", key), text, code="differs-from-rig")
    pair = pair_of(rig)
    if settings.pair is not None and pair is None:
        text = f"the magnet of {rig.path} is a single one; take it out"
        yield FileFault(("pair",), text, code="differs-from-rig")
    elif settings.pair is not None and pair is not None:
        for key in type(pair).model_fields:
            value = getattr(pair, key)
            if getattr(settings.pair, key) != value:
                text = f"is {value:g} in {rig.path}; make them equal"
                yield FileFault(("pair", key), text, code="differs-from-rig")


@dataclass(frozen=True)
class Setup:
    """Everything one loop needs; goes to other processes."""

    rig: BodyRig  # the plant
    controller: ControllerTable  # gains, limits, lift-off
    compensator: ForceController  # from force to current, as fitted; never run itself
    own: tuple[ForceController, ...] = ()  # of each magnet, where they are not all the same

    @property
    def name(self) -> MethodName:
        """Of its method."""
        return self.compensator.method


_CLASSES = {"f64": Position, "f32": PositionF32, "fixed": FixedPosition}


def make_position(setup: Setup) -> LoopController:
    """Return the controller of a setup, just switched on, with compensators that remember nothing."""
    number_format = setup.compensator.format
    control = position_control(setup)
    each = setup.own or (setup.compensator,) * len(setup.rig.magnets)
    natives = [compensator.fresh().native for compensator in each]
    controller: LoopController = _CLASSES[number_format](
        control.gains(number_format), natives, dict(control.settings(number_format))
    )
    return controller


def check_position(setup: Setup) -> None:
    """Refuse a controller that does not fit its compensator or its number format."""
    control = position_control(setup)
    control.gains(setup.compensator.format)
    control.settings(setup.compensator.format)


def position_control(setup: Setup) -> PositionControl:
    """Return the controller of a setup in SI units."""
    amplifier, parameters = setup.rig.settings.amplifier, setup.compensator.parameters
    return setup.controller.position_control(
        parameters.scales,
        ReferenceConverter(amplifier.current_low_A, amplifier.current_high_A, amplifier.dac_bits),
        pair_of(setup.rig),
        parameters.flux_full_scale,
    )


class SimulatedLoop(ClosedLoop):
    """A bearing from power on; scenarios follow each other."""

    def __init__(
        self, setup: Setup, seed: int = 0, largest_first: bool = False, bearing: Plant | None = None
    ) -> None:
        rig = setup.rig
        bearing = bearing or make_plant(rig, seed)
        if largest_first:
            for magnet in range(len(rig.magnets)):
                for current in (rig.settings.amplifier.current_high_A, 0.0):
                    bearing.hold(current, magnet)
        super().__init__(bearing, make_position(setup), current_loops(rig), COLUMNS)


def lost_at(rig: BodyRig, recording: Recording, since: int = 0) -> float | None:
    """Return when levitation was lost: a stop was touched, or the controller gave up."""
    body = rig.settings.body
    fault = recording["state"] >= FAULT
    if fault.any():
        since = min(since, int(np.argmax(fault)))
    gap, state = recording["gap_m"][since:], recording["state"][since:]
    bounds = (
        SignalBound("an end stop was reached", gap, body.stop_low_m, body.stop_high_m),
        SignalBound("the controller gave up", state, RISE - 1, DESCEND + 1),
    )
    loss = find_loss(bounds, planned=len(gap))
    return None if loss is None else float(recording["t_s"][since + loss.tick])


_RESTLESS = 0.01
"""Part of the travel: an armature that moves by more in its hover, rms, is not held."""


@dataclass(frozen=True)
class LevitationRun:
    """A run from power on until the armature lies again."""

    setup: Setup
    recording: Recording  # lift-off, steps, load steps, landing
    steps: Scenario  # the first part of it: lift-off and steps
    landing: int  # tick of the command to land

    def fault(self) -> str | None:
        """Say why the armature was not held until the end of the steps, or None if it was."""
        rig, lifted = self.setup.rig, self.steps.lifted
        steps = self.recording.part(0, self.steps.ticks)
        lost = lost_at(rig, steps, lifted)
        late = self._late(steps)
        if late is not None:
            return late
        if lost is None and len(steps) < self.steps.ticks:
            lost = float(steps["t_s"][-1])
        if lost is not None:
            return f"levitation was lost at {lost:.4f} s: the gains do not hold this bearing"
        body = rig.settings.body
        hover = steps["gap_m"][lifted - lifted // 8 : lifted]
        if float(np.std(hover)) > _RESTLESS * (body.stop_high_m - body.stop_low_m):
            return (
                f"the armature oscillates by {1e6 * float(np.std(hover)):.3g} um rms at "
                f"{lifted * rig.dt:.2f} s: the gains do not hold this bearing"
            )
        return None

    def _late(self, steps: Recording) -> str | None:
        """Say what kept it from levitating, if it was anything but the gains."""
        state, time = steps["state"], steps["t_s"]
        rejected = self._rejected(steps)
        if rejected is not None:
            return rejected
        if not ((state >= RISE) & (state <= HOVER)).any():
            faults = state >= FAULT
            if faults.any():
                force = self.setup.controller.limits.force_high_N
                return (
                    "the armature did not lift: it lay on its rest at "
                    f"{time[np.argmax(faults)]:.4f} s, when {force:g} N were demanded; raise "
                    "force_high_N or lower the load"
                )
            if (state >= RUN).any():
                return f"the armature had not left its rest at {time[-1]:.4f} s"
            return f"the command to lift was refused, the state is {state[-1]:.0f}"
        if len(steps) > self.steps.lifted and state[self.steps.lifted] in (BREAKAWAY, RISE):
            text = f"the armature was still rising at {time[self.steps.lifted]:.4f} s"
            return f"{text}; raise speed_m_per_s or force_rate_N_per_s of [lift_off]"
        return None

    def _rejected(self, steps: Recording) -> str | None:
        """Say whether rejected samples, and no armature out of control, ended the run."""
        implausible = (steps["flags"].astype(int) & int(Flag.SAMPLE_IMPLAUSIBLE)) != 0
        missing = self.setup.controller.safety.max_missing_samples
        # Whether every one of the last samples, and this one, was implausible: the position is lost.
        row = np.convolve(implausible, np.ones(missing + 1), "valid") > missing + 0.5
        if (steps["state"] >= RUN).any():
            row &= steps["state"][missing:] >= FAULT
        if not row.any():
            return None
        end = int(np.argmax(row)) + missing
        gap, body = steps["gap_m"][: end + 1], self.setup.rig.settings.body
        lifted = gap[int(np.argmax(gap < body.stop_high_m)) :]
        touched = (lifted <= body.stop_low_m) | (lifted >= body.stop_high_m)
        if (gap < body.stop_high_m).any() and touched.any():
            return None
        return (
            f"samples of the gap were rejected at {steps['t_s'][end]:.4f} s, {missing + 1} in a "
            "row: see step_m, gap_low_m and gap_high_m of [limits], and the noise of the sensor"
        )

    def lost_later(self) -> list[str]:
        """Say whether the armature was lost in the load steps or the landing of the recording."""
        after = self.recording.part(self.steps.ticks, self.landing)
        if len(after) and lost_at(self.setup.rig, after) is not None:
            return ["load steps of the recording"]
        landing = self.recording.part(self.landing, len(self.recording))
        state, gap = landing["state"], landing["gap_m"]
        hit = gap <= self.setup.rig.settings.body.stop_low_m
        if not len(landing) or state[-1] != READY or hit.any():
            return ["landing of the recording"]
        return []


def parts_of_run(setup: Setup) -> tuple[Scenario, Scenario, int]:
    """Return the run that a simulation records: lift-off and steps; then loads and a landing."""
    rig = setup.rig
    cases, load = rig.settings, rig.settings.load.force_N
    steps = steps_up_and_down(rig, setup.controller, cases.gap_m, cases.step.heights_m)
    script = Script(rig, float(steps.target[-1]))
    for step in cases.load_steps_N:
        script.set_load(load + step).hold(0.15).set_load(load).hold(0.15)
    landing = steps.ticks + script.ticks
    script.command(Command.LAND).hold(land_time(rig, setup.controller))
    return steps, script.build(), landing


def lost_blocks(figures: Mapping[str, Any]) -> list[str]:
    """Name every block of ``figures.json`` in which its own variant lost levitation."""
    own = figures["variant"]
    lost = {}
    for row in figures["steps"]:
        if row["variant"] == own and row["lost"]:
            lost[f"steps at {1e3 * row['gap_m']:g} mm"] = row["lost"]
    for title, variants in _blocks(figures):
        if variants[own]["lost"]:
            lost[title] = variants[own]["lost"]
    blocks = [f"{title} ({_runs(count)})" for title, count in lost.items()]
    return blocks + (["sensitivity"] if figures["sensitivity"][own] is None else [])


def _blocks(figures: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    yield "standstill", figures["standstill"]
    for row in figures["trajectories"]:
        yield f"{row['kind']} of {1e6 * row['amplitude_m']:g} um", row["variants"]
    for row in figures["load_steps"]:
        yield f"load step of {row['force_N']:g} N", row["variants"]
    yield from figures["events"].items()


def _runs(count: int) -> str:
    return "1 run" if count == 1 else f"{count} runs"
