"""From the rig file to the plant: what :mod:`anhyst._core` steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from anhyst._core import Magnet, Plant
from anhyst.support.numeric import passed
from anhyst_rigs.rig.body import BodyRig, travel_m
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.tables import AXES

STOP_RESONANCE = 1600.0
"""Of the mass on an end stop, Hz; half of critical damping while it touches."""

CURRENT_RESET = 0.1
"""Corner of the integral of a current controller, as a part of its bandwidth."""

DIGITAL_CROSSOVER = 0.4
"""Of a current controller that computes, times its delay, rad."""

_Line = Mapping[str, list[float]]
_OPENS: _Line = {"r": [0.0, 0.0, 0.0], "d": [1.0, 0.0, 0.0]}
_CLOSES: _Line = {"r": [0.0, 0.0, 0.0], "d": [-1.0, 0.0, 0.0]}
"""Lines along the one coordinate, the gap of the first magnet."""

ON_FRAME, ON_BODY, ON_GROUND = range(3)
"""What a head is fixed to: ``anhyst_plant_base``."""


def make_plant(
    rig: BodyRig, seed: int, *magnets: Magnet, numbers: PlantNumbers | None = None
) -> Plant:
    """Return the plant of a rig, at rest on the stop of the largest gap; its numbers may be others.

    Where fewer magnets are given than it has, all others are like the first.
    """
    own = magnets or (rig.magnet,)
    numbers = numbers or plant_numbers(rig)
    return Plant(
        numbers.body,
        numbers.actuators,
        numbers.heads,
        numbers.load,
        (*own, *(own[0] for _ in numbers.actuators[len(own) :])),
        noise_seed(rig, seed),
    )


def noise_seed(rig: BodyRig, seed: int) -> int:
    """Return what the noise of all sensors begins with: the seed of the file, and of a run."""
    return (rig.settings.seed << 32) + seed


@dataclass(frozen=True, slots=True)
class PlantNumbers:
    """All of a plant but its irons, by the names of ``plant/include/anhyst_plant/body.h``."""

    body: dict[str, Any]
    actuators: list[dict[str, Any]]
    heads: list[dict[str, Any]]
    load: dict[str, Any]


def plant_numbers(rig: BodyRig) -> PlantNumbers:
    """Return the numbers of a plant.

    Its one coordinate is the gap of the first magnet. Several are displacements from where the body
    works, with weight along -z; heads are a gap sensor for each magnet then, and the position
    sensors, which do not ride on the frame.
    """
    file, sensors = rig.settings, _sensors(rig)
    magnets: list[tuple[_Line, float | None]] = [(_CLOSES, 0.0), (_OPENS, file.gap_total_m)]
    gaps, position_heads = [(_OPENS, magnets[0][1])], []
    del magnets[len(file.placed) :]
    if file.several:
        magnets = [({"r": one.position_m, "d": one.direction}, one.gap_m) for one in file.placed]
        gaps = [({**line, "d": [-part for part in line["d"]]}, gap) for line, gap in magnets]
        position_heads = [
            {
                "line": {"r": sensor.position_m, "d": sensor.direction},
                "zero": 0.0,
                "sensor": _bare((-1.0, 1.0), sensor.noise_m)
                | {"gain": 1.0 + sensor.air, "offset": sensor.air * sensor.dead_path_m},
                "base": ON_GROUND if sensor.stands else ON_BODY,
            }
            for sensor in file.position_sensors
        ]
    actuators = [
        {
            "line": line,
            "gap_zero": gap,  # with the body at the origin
            "amplifier": _amplifier(rig),
            "current_sensor": sensors["current"],
            "flux_probe": sensors["hall"],
            "has_probe": int(file.hall_probe is not None),
        }
        for line, gap in magnets
    ]
    gap_heads = [
        {"line": line, "zero": gap, "sensor": sensors["gap"], "base": ON_FRAME}
        for line, gap in gaps
    ]
    body = _body(rig, sensors["force"])
    return PlantNumbers(body, actuators, gap_heads + position_heads, _load(rig))


def _coordinates(file: RigFile) -> list[dict[str, float]]:
    """Return the coordinates in which a body is free, with their end stops."""
    body, omega = file.body, 2.0 * math.pi * STOP_RESONANCE
    inertia = body.inertia_kg_m2 or [0.0, 0.0, 0.0]

    def coordinate(axis: int, low: float, high: float, rest: float = 0.0) -> dict[str, float]:
        moved = body.mass_kg if axis < 3 else inertia[axis - 3]
        return {
            "axis": axis,
            "rest": rest,
            "damping": body.damping_N_s_per_m if axis < 3 else 0.0,
            "stop_low": low,
            "stop_high": high,
            "stop_stiffness": moved * (omega * omega),
            "stop_damping": moved * omega,
        }

    if not file.several:
        return [coordinate(0, body.stop_low_m, body.stop_high_m, body.stop_high_m)]
    ends = [travel_m(file) if axis < 3 else body.tilt_rad for axis in range(len(AXES))]
    axes = [AXES.index(axis) for axis in body.free]
    return [coordinate(axis, -ends[axis], ends[axis]) for axis in axes]


def current_loops(rig: BodyRig) -> list[dict[str, float]]:
    """Return the digital current controllers that stand before amplifiers of voltage."""
    gain, reset = current_gains(rig)
    loop = {
        "resistance": rig.settings.magnet.poles.resistance,
        "gain": gain if rig.settings.amplifier.mode == "voltage" else 0.0,
        "reset": reset * rig.dt,
        "limit": rig.settings.amplifier.supply,
    }
    return [loop] * len(rig.settings.magnets)


def current_gains(rig: BodyRig) -> tuple[float, float]:
    """Return gain, V/A, and integral, V/(A s), of the current controller.

    An analogue one has the bandwidth of the amplifier. A digital one, before an amplifier of
    voltage, is no faster than its delay allows.
    """
    settings = rig.settings
    omega = 2.0 * math.pi * settings.amplifier.bandwidth_Hz
    if settings.amplifier.mode == "voltage":
        late = rig.late + settings.amplifier.delay_s
        omega = min(omega, DIGITAL_CROSSOVER / late)
    gain = omega * settings.magnet.poles.inductance(settings.gap_m)
    return gain, CURRENT_RESET * omega * gain


def _body(rig: BodyRig, force_sensor: Mapping[str, float]) -> dict[str, Any]:
    file, body, timing = rig.settings, rig.settings.body, rig.settings.timing
    late = timing.delay_ticks * timing.substeps + file.amplifier.delay_s / rig.step
    weight = body.gravity_m_per_s2
    return {
        "coordinate": _coordinates(file),
        "mass": body.mass_kg,
        "centre": body.centre_m,
        "inertia": np.diag(body.inertia_kg_m2 or [0.0, 0.0, 0.0]).tolist(),
        "gravity": [0.0, 0.0, -weight] if file.several else [weight, 0.0, 0.0],
        "force_along": file.scan.direction if file.several else _CLOSES["d"],
        "force_sensor": force_sensor,
        "cable": {
            "at": body.cable_m,
            "stiffness": body.cable_N_per_m,
            "damping": body.cable_N_s_per_m,
        },
        "tick": rig.dt,
        "substeps": timing.substeps,
        "delay": round(late),
    }


def _amplifier(rig: BodyRig) -> dict[str, float]:
    amplifier = rig.settings.amplifier
    gain, reset = current_gains(rig)
    by_current = amplifier.mode == "current"
    low = amplifier.current_low_A if by_current else -amplifier.supply
    high = amplifier.current_high_A if by_current else amplifier.supply
    return {
        "limit": amplifier.supply,
        "gain": gain if by_current else 0.0,
        "reset": reset if by_current else 0.0,
        "low": low,
        "high": high,
        "step": (high - low) / ((1 << amplifier.dac_bits) - 1),
    }


def _load(rig: BodyRig) -> dict[str, Any]:
    load = rig.settings.load
    return {
        "line": _OPENS,
        "share": _share(load.bandwidth_Hz, rig.step),
        "damping": load.damping_N_s_per_m,
        "stiffness": load.stiffness_N_per_m,
        "rest": rig.settings.gap_m,
        "encoder_step": load.encoder_step_m,
        "velocity_share": _share(load.velocity_bandwidth_Hz, rig.dt),
    }


def _sensors(rig: BodyRig) -> dict[str, Mapping[str, float]]:
    file = rig.settings
    tables = {"gap": file.gap_sensor, "current": file.current_sensor, "force": file.force_sensor}
    sensors: dict[str, Mapping[str, float]] = {
        name: table.numbers(rig.step) for name, table in tables.items()
    }
    probe = file.hall_probe
    return sensors | {"hall": _bare((0.0, 0.0), 0.0) if probe is None else probe.numbers(rig.step)}


def _bare(ends: tuple[float, float], noise: float) -> dict[str, float]:
    """Sensor without converter, lag and errors of gain or zero."""
    low, high = ends
    zeros = {"step": 0.0, "offset": 0.0, "delay": 0}
    return {
        "low": low,
        "high": high,
        "noise": noise,
        "gain": 1.0,
        "share": passed(math.inf),
        **zeros,
    }


def _share(bandwidth: float, seconds: float) -> float:
    """Share of a step that a low-pass of first order passes in so many seconds."""
    return passed(2.0 * math.pi * bandwidth * seconds)
