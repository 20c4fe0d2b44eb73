"""Check that a controller file fits the rig file of a bearing."""

from __future__ import annotations

from collections.abc import Iterator

from anhyst.control.controller_file import ControllerFile, ControllerTable
from anhyst.support.kinds import FLUX_PROBE_METHODS
from anhyst.support.toml_file import FileFault, faults_error
from anhyst_rigs.rig.bearing.loop import pair_table
from anhyst_rigs.rig.bearing.scenario import land_time, lift_time
from anhyst_rigs.rig.body import BodyRig, step_ends

MAX_RAMP_S = 60.0
"""Longest duration of lift-off or landing, s."""


def check_controller(controller: ControllerFile, rig: BodyRig) -> None:
    """Raise an error that lists all conflicts between a controller file and a rig."""
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
    if len(rig.settings.body_magnets) == 1 and limits.force_low_N < 0.0:
        text = "a single magnet cannot push; raise it to 0 or more"
        yield FileFault(("limits", "force_low_N"), text, code="cannot-push")
    if len(rig.settings.body_magnets) == 1 and not rig.static_load < limits.force_high_N:
        text = f"{limits.force_high_N:g} N cannot lift the load of {rig.path}, {rig.static_load:g} N"
        yield FileFault(("limits", "force_high_N"), f"{text}; raise it", code="load-not-lifted")
    variant = settings.compensation.variant
    if variant in FLUX_PROBE_METHODS and plant.flux_sensor is None:
        text = f'"{variant}" needs a [[sensor]] of = "flux" in {rig.path}; add it'
        yield FileFault(("compensation", "variant"), text, code="no-hall-probe")
    yield from _amplifier_faults(settings, rig)
    steps = ((gap, height) for gap in plant.step_gaps_m for height in plant.step.heights_m)
    low_gaps = [step_ends(gap, height)[1] for gap, height in steps]
    lowest_gap = min(low_gaps + [plant.gap_m - case.amplitude_m for case in plant.trajectories])
    highest_gap = plant.body.stop_high_m
    if not limits.gap_low_m < lowest_gap:
        text = f"the armature of {rig.path} moves to a gap of {lowest_gap:.5g} m; lower it"
        yield FileFault(("limits", "gap_low_m"), text, code="gaps-not-covered")
    step = plant.gap_sensor.resolution
    if limits.step_m < step:
        text = f"the position sensor of {rig.path} has a resolution of {step:.4g} m; raise it"
        yield FileFault(("limits", "step_m"), text, code="step-too-fine")
    if not limits.gap_high_m > highest_gap:
        text = f"the armature of {rig.path} rests at a gap of {highest_gap:.5g} m; raise it"
        yield FileFault(("limits", "gap_high_m"), text, code="gaps-not-covered")
    yield from _ramp_faults(settings, rig, lowest_gap)


def _ramp_faults(settings: ControllerTable, rig: BodyRig, lowest_gap: float) -> Iterator[FileFault]:
    """Find a lift-off or landing ramp that would take too long to simulate."""
    travel = rig.settings.body.stop_high_m - lowest_gap
    for table, action, ramp, seconds in (
        ("lift_off", "lifting off", settings.lift_off, lift_time(rig, settings, lowest_gap)),
        ("landing", "landing", settings.landing, land_time(rig, settings)),
    ):
        if seconds > MAX_RAMP_S:
            force_ramp_s = settings.limits.force_high_N / ramp.force_rate_N_per_s
            is_force_slower = force_ramp_s > travel / ramp.speed_m_per_s
            key = "force_rate_N_per_s" if is_force_slower else "speed_m_per_s"
            text = f"{action} takes {seconds:.4g} s, but at most {MAX_RAMP_S:g} s are simulated"
            yield FileFault((table, key), f"{text}; raise it", code="too-slow")


def _amplifier_faults(settings: ControllerTable, rig: BodyRig) -> Iterator[FileFault]:
    """Find conflicts about the converter of the amplifier and about the second magnet of a pair."""
    converter, amplifier = settings.converter, rig.settings.amplifier
    if converter is not None:
        amplifier_values = {
            "low_A": amplifier.current_low_A,
            "high_A": amplifier.current_high_A,
            "bits": amplifier.dac_bits,
        }
        for key, value in amplifier_values.items():
            if getattr(converter, key) != value:
                text = f"the amplifier of {rig.path} has {value:g}; make them equal"
                yield FileFault(("converter", key), text, code="differs-from-rig")
    rig_pair = pair_table(rig)
    if settings.pair is not None and rig_pair is None:
        text = f"{rig.path} has a single magnet; remove it"
        yield FileFault(("pair",), text, code="differs-from-rig")
    elif settings.pair is not None and rig_pair is not None:
        for key in type(rig_pair).model_fields:
            value = getattr(rig_pair, key)
            if getattr(settings.pair, key) != value:
                text = f"is {value:g} in {rig.path}; make them equal"
                yield FileFault(("pair", key), text, code="differs-from-rig")
