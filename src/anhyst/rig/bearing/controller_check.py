"""Whether a controller file belongs to the rig that it is to control."""

from __future__ import annotations

from anhyst.compensate.methods import PROBED
from anhyst.control.controller_file import ControllerFile, ControllerTable, PairTable
from anhyst.rig.bearing.file import BearingRig, step_ends
from anhyst.rig.bearing.scenario import land_time, lift_time
from anhyst.support.toml_file import FileFault, faults_error

LONGEST_RAMP_S = 60.0
"""Longest time that lifting off or landing may take, s."""


def pair_of(rig: BearingRig) -> PairTable | None:
    """Return what a controller has to know of a second magnet, or None where there is none."""
    bias, total = rig.settings.bias_N, rig.settings.gap_total_m
    if bias is None or total is None:
        return None
    return PairTable(bias_force_N=bias, gap_total_m=total)


def check_controller(controller: ControllerFile, rig: BearingRig) -> None:
    """Refuse a controller that does not belong to the rig."""
    faults = _rig_faults(controller.settings, rig)
    if faults:
        raise faults_error(controller.path, faults)


def _rig_faults(settings: ControllerTable, rig: BearingRig) -> list[FileFault]:
    faults: list[FileFault] = []
    rate, plant = rig.settings.timing.rate_Hz, rig.settings
    if settings.rate_Hz != rate:
        text = f"is {settings.rate_Hz:g} Hz here and {rate:g} Hz in {rig.path}; make them equal"
        faults.append(FileFault(("rate_Hz",), text, code="differs-from-rig"))
    limits, amplifier = settings.limits, plant.amplifier
    if limits.current_low_A < amplifier.current_low_A:
        text = f"the amplifier of {rig.path} begins at {amplifier.current_low_A:g} A; raise it"
        faults.append(FileFault(("limits", "current_low_A"), text, code="beyond-amplifier"))
    if limits.current_high_A > amplifier.current_high_A:
        text = f"the amplifier of {rig.path} ends at {amplifier.current_high_A:g} A; lower it"
        faults.append(FileFault(("limits", "current_high_A"), text, code="beyond-amplifier"))
    if len(rig.magnets) == 1 and limits.force_low_N < 0.0:
        text = "a single magnet cannot push; raise it to 0 or more"
        faults.append(FileFault(("limits", "force_low_N"), text, code="cannot-push"))
    if len(rig.magnets) == 1 and not rig.load < limits.force_high_N:
        text = f"{limits.force_high_N:g} N do not lift the load of {rig.path}, {rig.load:g} N"
        faults.append(
            FileFault(("limits", "force_high_N"), f"{text}; raise it", code="load-not-lifted")
        )
    variant = settings.compensation.variant
    if variant in PROBED and plant.hall_probe is None:
        text = f'"{variant}" needs the table [hall_probe], {rig.path} has none; add it'
        faults.append(FileFault(("compensation", "variant"), text, code="no-hall-probe"))
    faults += _amplifier_faults(settings, rig)
    cases = rig.settings
    gaps = [cases.gap_m, *cases.step.also_gaps_m]
    lowest = min(step_ends(gap, height)[1] for gap in gaps for height in cases.step.heights_m)
    for trajectory in cases.trajectories:
        lowest = min(lowest, cases.gap_m - trajectory.amplitude_m)
    highest = cases.body.stop_high_m
    if not limits.gap_low_m < lowest:
        text = f"{rig.path} goes to a gap of {lowest:.5g} m; lower it"
        faults.append(FileFault(("limits", "gap_low_m"), text, code="gaps-not-covered"))
    step = plant.gap_sensor.sensor().step
    if limits.step_m < step:
        text = f"the position sensor of {rig.path} has steps of {step:.4g} m; raise it"
        faults.append(FileFault(("limits", "step_m"), text, code="step-too-fine"))
    if not limits.gap_high_m > highest:
        text = f"{rig.path} rests at a gap of {highest:.5g} m; raise it"
        faults.append(FileFault(("limits", "gap_high_m"), text, code="gaps-not-covered"))
    return [*faults, *_ramp_faults(settings, rig, lowest)]


def _ramp_faults(settings: ControllerTable, rig: BearingRig, lowest: float) -> list[FileFault]:
    """Find ramps so slow that nobody waits for them."""
    way = rig.settings.body.stop_high_m - lowest
    faults: list[FileFault] = []
    for table, what, ramp, seconds in (
        ("lift_off", "lifting off", settings.lift_off, lift_time(rig, settings, lowest)),
        ("landing", "landing", settings.landing, land_time(rig, settings)),
    ):
        if seconds > LONGEST_RAMP_S:
            forces = settings.limits.force_high_N / ramp.force_rate_N_per_s
            longer = forces > way / ramp.speed_m_per_s
            key = "force_rate_N_per_s" if longer else "speed_m_per_s"
            text = f"{what} takes {seconds:.4g} s, at most {LONGEST_RAMP_S:g} s are simulated"
            faults.append(FileFault((table, key), f"{text}; raise it", code="too-slow"))
    return faults


def _amplifier_faults(settings: ControllerTable, rig: BearingRig) -> list[FileFault]:
    """Say where the file contradicts the rig on amplifiers or a second magnet."""
    faults: list[FileFault] = []
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
                faults.append(FileFault(("converter", key), text, code="differs-from-rig"))
    pair = pair_of(rig)
    if settings.pair is not None and pair is None:
        faults.append(
            FileFault(
                ("pair",),
                f"the magnet of {rig.path} is a single one; take it out",
                code="differs-from-rig",
            )
        )
    elif settings.pair is not None and pair is not None:
        for key in type(pair).model_fields:
            value = getattr(pair, key)
            if getattr(settings.pair, key) != value:
                text = f"is {value:g} in {rig.path}; make them equal"
                faults.append(FileFault(("pair", key), text, code="differs-from-rig"))
    return faults
