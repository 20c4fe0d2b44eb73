"""Compute the parameters of the core's plant from a rig file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from anhyst._core import Magnet, Plant
from anhyst.support.numeric import first_order_share
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.parts.coupling import CoupledForces, tabulate_coupling
from anhyst_rigs.rig.parts.magnet import COUPLED

STOP_RESONANCE_HZ = 1600.0
"""Resonance of the body's mass on an end stop, Hz; the damping ratio in contact is 0.5."""

INTEGRAL_CORNER_TO_BANDWIDTH = 0.1
"""Corner frequency of a current controller's integral part, relative to the bandwidth."""

CROSSOVER_DELAY_PHASE_RAD = 0.4
"""Largest product of the crossover and the delay of a digital current controller, rad."""

ON_FRAME = 0
ON_BODY = 1
ON_GROUND = 2
"""Base to which a head is fixed: values of ``anhyst_plant_base``."""


def make_plant(rig: BodyRig, seed: int, *magnets: Magnet, parameters: PlantParameters | None = None) -> Plant:
    """Return the plant of a rig, at rest on the stop of the largest gap.

    By default, the plant has the parameters of the rig. Magnets not given equal the first one.
    """
    given_magnets = magnets or (rig.magnet,)
    parameters = parameters or plant_parameters(rig)
    return Plant(
        parameters.body,
        parameters.actuators,
        parameters.heads,
        parameters.load,
        (*given_magnets, *(given_magnets[0] for _ in parameters.actuators[len(given_magnets) :])),
        noise_seed(rig, seed),
    )


def noise_seed(rig: BodyRig, seed: int) -> int:
    """Return the seed of all sensor noise, from the seed of the rig file and that of a run."""
    return (rig.settings.seed << 32) + seed


@dataclass(frozen=True, slots=True)
class PlantParameters:
    """All parameters of a plant except its irons, by their names in ``anhyst_plant/body.h``."""

    body: dict[str, Any]
    actuators: list[dict[str, Any]]
    heads: list[dict[str, Any]]
    load: dict[str, Any]


def plant_parameters(rig: BodyRig) -> PlantParameters:
    """Return the parameters of a plant; its heads are the gap sensors, then the position sensors."""
    file, sensors, lines = rig.settings, _sensor_parameters(rig), rig.lines_of_action
    sense_turns = (file.coil_sensor and file.coil_sensor.turns) or 0.0
    actuators = [
        {
            "line": line,
            "gap_zero": gap,  # for the body at the origin
            "amplifier": _amplifier_parameters(rig),
            "current_sensor": sensors["current"],
            "flux_probe": sensors["hall"],
            "has_probe": probe_kind(file),
            "sense_turns": sense_turns / file.magnet.poles.turns,
        }
        for line, gap in lines.magnets
    ]
    gap_heads = [
        {"line": line, "zero": gap, "sensor": sensors["gap"], "base": ON_FRAME}
        for line, gap in lines.gap_sensors
    ]
    position_heads = [
        {
            "line": line,
            "zero": 0.0,
            "sensor": _ideal_sensor((-1.0, 1.0), sensor.noise_m)
            | {"gain": 1.0 + sensor.beam_gain_error, "offset": sensor.beam_gain_error * sensor.dead_path_m},
            "base": ON_GROUND if sensor.stands else ON_BODY,
        }
        for line, sensor in lines.heads
    ]
    body = _body_parameters(rig, sensors["force"])
    return PlantParameters(body, actuators, gap_heads + position_heads, _load_parameters(rig))


def probe_kind(file: RigFile) -> int:
    """Return the sensor of the flux, a value of ``anhyst_plant_probe``."""
    if (coil := file.coil_sensor) is not None:
        return 3 if coil.turns is None else 2
    return int(file.hall_probe is not None)


def _coordinate_parameters(rig: BodyRig) -> list[dict[str, float]]:
    """Return the free coordinates of a body, with their end stops."""
    body, omega = rig.settings.body, 2.0 * math.pi * STOP_RESONANCE_HZ
    inertias = [*[body.mass_kg] * 3, *(body.inertia_kg_m2 or [0.0, 0.0, 0.0])]
    return [
        {
            "axis": coordinate.axis,
            "rest": coordinate.initial_position,
            "damping": body.damping_N_s_per_m if coordinate.axis < 3 else 0.0,
            "stop_low": coordinate.low,
            "stop_high": coordinate.high,
            "stop_stiffness": inertias[coordinate.axis] * (omega * omega),
            "stop_damping": inertias[coordinate.axis] * omega,
        }
        for coordinate in rig.lines_of_action.coordinates
    ]


def coupled_forces(rig: BodyRig) -> CoupledForces | None:
    """Return the force map of both currents for two coils on one yoke, or None for separate yokes."""
    file, magnet = rig.settings, rig.settings.magnet
    if magnet.kind != COUPLED:
        return None
    gap_sum = file.gap_total_m or 0.0
    reach = 1.5 * max(file.gap_m - file.body.stop_low_m, file.body.stop_high_m - file.gap_m)
    currents = file.amplifier.current_low_A, file.amplifier.current_high_A
    gaps = 0.5 * gap_sum - reach, 0.5 * gap_sum + reach
    return tabulate_coupling(magnet.poles, file.steel, currents, gaps, gap_sum)


def current_controllers(rig: BodyRig) -> list[dict[str, float]]:
    """Return the parameters of the digital current controllers of amplifiers in voltage mode."""
    gain, reset = current_controller_gains(rig)
    loop = {
        "resistance": rig.settings.magnet.poles.resistance,
        "gain": gain if rig.settings.amplifier.mode == "voltage" else 0.0,
        "reset": reset * rig.dt,
        "limit": rig.settings.amplifier.supply,
    }
    return [loop] * len(rig.settings.magnets)


def current_controller_gains(rig: BodyRig) -> tuple[float, float]:
    """Return the proportional gain, V/A, and the integral gain, V/(A s), of a current controller.

    An analogue controller has the bandwidth of the amplifier. The bandwidth of a digital
    controller, which precedes an amplifier in voltage mode, is also limited by its delay.
    """
    settings = rig.settings
    omega = 2.0 * math.pi * settings.amplifier.bandwidth_Hz
    if settings.amplifier.mode == "voltage":
        delay = rig.loop_delay + settings.amplifier.delay_s
        omega = min(omega, CROSSOVER_DELAY_PHASE_RAD / delay)
    gain = omega * settings.magnet.poles.inductance(settings.gap_m)
    return gain, INTEGRAL_CORNER_TO_BANDWIDTH * omega * gain


def _body_parameters(rig: BodyRig, force_sensor: Mapping[str, float]) -> dict[str, Any]:
    file, body, timing = rig.settings, rig.settings.body, rig.settings.timing
    delay_substeps = timing.delay_ticks * timing.substeps + file.amplifier.delay_s / rig.substep
    return {
        "coordinate": _coordinate_parameters(rig),
        "mass": body.mass_kg,
        "centre": body.centre_m,
        "inertia": np.diag(body.inertia_kg_m2 or [0.0, 0.0, 0.0]).tolist(),
        "gravity": rig.lines_of_action.gravity,
        "force_along": rig.lines_of_action.recorded_force_direction,
        "force_sensor": force_sensor,
        "cable": {"at": body.cable_m, "stiffness": body.cable_N_per_m, "damping": body.cable_N_s_per_m},
        "tick": rig.dt,
        "substeps": timing.substeps,
        "delay": round(delay_substeps),
    }


def _amplifier_parameters(rig: BodyRig) -> dict[str, float]:
    amplifier = rig.settings.amplifier
    gain, reset = current_controller_gains(rig)
    is_current_source = amplifier.mode == "current"
    output_low = amplifier.current_low_A if is_current_source else -amplifier.supply
    output_high = amplifier.current_high_A if is_current_source else amplifier.supply
    return {
        "limit": amplifier.supply,
        "gain": gain if is_current_source else 0.0,
        "reset": reset if is_current_source else 0.0,
        "low": output_low,
        "high": output_high,
        "step": (output_high - output_low) / ((1 << amplifier.dac_bits) - 1),
    }


def _load_parameters(rig: BodyRig) -> dict[str, Any]:
    load = rig.settings.load
    return {
        "line": rig.lines_of_action.load,
        "share": _low_pass_coefficient(load.bandwidth_Hz, rig.substep),
        "damping": load.damping_N_s_per_m,
        "stiffness": load.stiffness_N_per_m,
        "rest": rig.lines_of_action.load_rest_position,
        "encoder_step": load.encoder_step_m,
        "velocity_share": _low_pass_coefficient(load.velocity_bandwidth_Hz, rig.dt),
    }


def _sensor_parameters(rig: BodyRig) -> dict[str, Mapping[str, float]]:
    file = rig.settings
    tables = {"gap": file.gap_sensor, "current": file.current_sensor, "force": file.force_sensor}
    sensors: dict[str, Mapping[str, float]] = {
        name: table.plant_parameters(rig.substep) for name, table in tables.items()
    }
    probe = file.flux_sensor
    return sensors | {
        "hall": _ideal_sensor((0.0, 0.0), 0.0) if probe is None else probe.plant_parameters(rig.substep)
    }


def _ideal_sensor(signal_range: tuple[float, float], noise: float) -> dict[str, float]:
    """Return a sensor without converter, lag, gain error or offset."""
    low, high = signal_range
    constants = {"gain": 1.0, "share": first_order_share(math.inf), "step": 0.0, "offset": 0.0, "delay": 0}
    return {"low": low, "high": high, "noise": noise, **constants}


def _low_pass_coefficient(bandwidth: float, seconds: float) -> float:
    """Return the fraction of a step that a first-order low-pass has passed after a time, s."""
    return first_order_share(2.0 * math.pi * bandwidth * seconds)
