"""A bearing behind its controller: whether they fit, how a setup is made, whether a run held."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from anhyst._core import FixedPosition, LoopController, Position, PositionF32
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import MODELS
from anhyst.compensate.sources import Operating
from anhyst.control.controller_file import ControllerFile, ControllerTable, PairTable, error_at_key
from anhyst.control.position import PositionControl, ReferenceConverter
from anhyst.data import Loops
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError
from anhyst.support.kinds import PROBED, MethodName, NumberFormat
from anhyst.support.states import Flag
from anhyst.support.toml_file import FileFault, faults_error
from anhyst_rigs.rig.bearing.scenario import land_time, lift_time
from anhyst_rigs.rig.body import BodyRig, step_ends
from anhyst_rigs.rig.fitting import IdentifiedMagnet, calibrated, fit_at
from anhyst_rigs.rig.loop import Scenario, Setup
from anhyst_rigs.rig.recording import (
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
    if len(rig.settings.placed) == 1 and limits.force_low_N < 0.0:
        text = "a single magnet cannot push; raise it to 0 or more"
        yield FileFault(("limits", "force_low_N"), text, code="cannot-push")
    if len(rig.settings.placed) == 1 and not rig.load < limits.force_high_N:
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


_CLASSES = {"f64": Position, "f32": PositionF32, "fixed": FixedPosition}


@dataclass(frozen=True)
class BearingSetup(Setup):
    """All that a run of a bearing needs."""

    recorded = COLUMNS
    controller: ControllerTable  # gains, limits, lift-off

    def make_controller(self, drives: Sequence[ForceController] = ()) -> LoopController:
        """Return the controller, just switched on."""
        number_format, control = self.compensator.format, position_control(self)
        natives = [drive.native for drive in drives or self.fresh()]
        controller: LoopController = _CLASSES[number_format](
            control.gains(number_format), natives, dict(control.settings(number_format))
        )
        return controller


def position_control(setup: BearingSetup) -> PositionControl:
    """Return the controller of a setup in SI units."""
    amplifier, parameters = setup.rig.settings.amplifier, setup.compensator.parameters
    return setup.controller.position_control(
        parameters.scales,
        ReferenceConverter(amplifier.current_low_A, amplifier.current_high_A, amplifier.dac_bits),
        pair_of(setup.rig),
        parameters.flux_full_scale,
    )


def make_setup(
    rig: BodyRig,
    controller: ControllerTable,
    magnet: IdentifiedMagnet,
    variant: MethodName,
    number_format: NumberFormat,
) -> BearingSetup:
    """Fit one variant to what is known, and to what motion taught of it, behind the controller."""
    magnets = calibrated_magnets(rig, magnet, variant)
    each = fit_magnets(rig, controller, magnets, variant, number_format)
    chosen = controller.compensation.model_copy(
        update={"variant": variant, "format": number_format}
    )
    behind = controller.model_copy(update={"compensation": chosen})
    return BearingSetup(rig, each[0], behind, own=tuple(each) if len(each) > 1 else ())


def fit_magnets(
    rig: BodyRig,
    controller: ControllerTable,
    magnets: Sequence[IdentifiedMagnet],
    variant: MethodName,
    number_format: NumberFormat,
) -> list[ForceController]:
    """Fit one variant to what is known of each magnet."""
    where = operating_point(rig, controller, *(magnet.loops for magnet in magnets))
    return fit_at(rig, where, magnets, variant, number_format)


def calibrated_magnets(
    rig: BodyRig, magnet: IdentifiedMagnet, variant: MethodName
) -> list[IdentifiedMagnet]:
    """Return what is known of each magnet by what motion taught of a variant, or of all at once.

    The second magnet's gap is what is left of both: it is read too small by what the first one's is
    read too large.
    """
    calibration = rig.learnt(variant)
    if calibration is None or not calibration.taken:
        return [magnet]
    widths, zero = calibration.widths(len(rig.settings.placed)), calibration.value("gap_zero_m")
    # one range of gaps for both of a pair
    over = 2.0 * abs(zero) if len(widths) > 1 else 0.0
    return [
        calibrated(
            magnet, calibration.value(f"scale_{number + 1}"), (zero, -zero)[number], wider, over
        )
        for number, wider in enumerate(widths)
    ]


def compiled_model(rig: BodyRig, magnet: IdentifiedMagnet, variant: MethodName) -> Model:
    """Return the model of which a block is compiled: with what motion taught of it."""
    magnets = calibrated_magnets(rig, magnet, variant)
    if len(magnets) > 1:
        raise InputError(
            f"{rig.path}: control.calibration: both magnets of a pair share one block, and each was "
            "calibrated for itself; leave it out",
            code="calibration-not-compiled",
            key="control.calibration",
        )
    return magnets[0].model


def make_setups(
    rig: BodyRig,
    controller: ControllerFile,
    magnet: IdentifiedMagnet,
    variants: tuple[MethodName, ...],
) -> Mapping[MethodName, BearingSetup]:
    """Fit several variants in the number format of a controller file that belongs to the rig."""
    table = controller.settings
    setups = {}
    for variant in variants:
        modelled = variant in MODELS and controller.model is not None
        try:
            setups[variant] = make_setup(rig, table, magnet, variant, table.compensation.format)
        except InputError as error:
            raise error.at(controller.model if modelled else rig.measured.text) from error
        with error_at_key(controller):  # where it fits neither its compensator nor its format
            control = position_control(setups[variant])
            control.gains(table.compensation.format)
            control.settings(table.compensation.format)
    return setups


def operating_point(rig: BodyRig, controller: ControllerTable, *loops: Loops) -> Operating:
    """Return where a bearing works, over all loops: each magnet of a pair around its bias."""
    pair = pair_of(rig)
    measured = [gap for loop in loops for gap in loop.by_schedule() if gap is not None]
    return Operating(
        gap=rig.settings.gap_m,
        force=rig.load if pair is None else pair.bias_force_N,
        rate=controller.rate_Hz,
        gap_range=controller.working_gaps(pair, (min(measured), max(measured))),
        force_max=controller.force_max(pair),
        current_max=controller.limits.current_high_A,
    )


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


def levitation_fault(setup: BearingSetup, run: Recording, steps: Scenario) -> str | None:
    """Say why the armature was not held from lift-off to the last step, or None if it was."""
    rig, lifted, run = setup.rig, steps.lifted, run.part(0, steps.ticks)
    lost = lost_at(rig, run, lifted)
    not_lifted = _rejected(setup, run) or _not_lifted(setup, run, lifted)
    if not_lifted is not None:
        return not_lifted
    if lost is None and len(run) < steps.ticks:
        lost = float(run["t_s"][-1])
    if lost is not None:
        return f"levitation was lost at {lost:.4f} s: the gains do not hold this bearing"
    body = rig.settings.body
    swing = float(np.std(run["gap_m"][lifted - lifted // 8 : lifted]))
    if swing > _RESTLESS * (body.stop_high_m - body.stop_low_m):
        return (
            f"the armature oscillates by {1e6 * swing:.3g} um rms at "
            f"{lifted * rig.dt:.2f} s: the gains do not hold this bearing"
        )
    return None


def _not_lifted(setup: BearingSetup, run: Recording, lifted: int) -> str | None:
    """Say what kept the armature from its hover, or None if it rose at all and in time."""
    state, time = run["state"], run["t_s"]
    if not ((state >= RISE) & (state <= HOVER)).any():
        faults = state >= FAULT
        if faults.any():
            force = setup.controller.limits.force_high_N
            return (
                "the armature did not lift: it lay on its rest at "
                f"{time[np.argmax(faults)]:.4f} s, when {force:g} N were demanded; raise "
                "force_high_N or lower the load"
            )
        if (state >= RUN).any():
            return f"the armature had not left its rest at {time[-1]:.4f} s"
        return f"the command to lift was refused, the state is {state[-1]:.0f}"
    if len(run) > lifted and state[lifted] in (BREAKAWAY, RISE):
        text = f"the armature was still rising at {time[lifted]:.4f} s"
        return f"{text}; raise speed_m_per_s or force_rate_N_per_s of [lift_off]"
    return None


def _rejected(setup: BearingSetup, run: Recording) -> str | None:
    """Say whether rejected samples, and no armature out of control, ended the run."""
    implausible = (run["flags"].astype(int) & int(Flag.SAMPLE_IMPLAUSIBLE)) != 0
    missing = setup.controller.safety.max_missing_samples
    # Whether every one of the last samples, and this one, was implausible: the position is lost.
    row = np.convolve(implausible, np.ones(missing + 1), "valid") > missing + 0.5
    if (run["state"] >= RUN).any():
        row &= run["state"][missing:] >= FAULT
    if not row.any():
        return None
    end = int(np.argmax(row)) + missing
    gap, body = run["gap_m"][: end + 1], setup.rig.settings.body
    lifted = gap[int(np.argmax(gap < body.stop_high_m)) :]
    touched = (lifted <= body.stop_low_m) | (lifted >= body.stop_high_m)
    if (gap < body.stop_high_m).any() and touched.any():
        return None
    return (
        f"samples of the gap were rejected at {run['t_s'][end]:.4f} s, {missing + 1} in a "
        "row: see step_m, gap_low_m and gap_high_m of [limits], and the noise of the sensor"
    )


def lost_after_steps(rig: BodyRig, run: Recording, begin: int, landing: int) -> list[str]:
    """Say whether the armature was lost in the load steps or the landing that a recording ends with."""
    loads, landed = run.part(begin, landing), run.part(landing, len(run))
    if len(loads) and lost_at(rig, loads) is not None:
        return ["load steps of the recording"]
    hit = landed["gap_m"] <= rig.settings.body.stop_low_m
    if not len(landed) or landed["state"][-1] != READY or hit.any():
        return ["landing of the recording"]
    return []
