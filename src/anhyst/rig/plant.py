"""From the rig file to the plant: what :mod:`anhyst._core` steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst._core import Coil, Magnet, Plant
from anhyst.data.table import DataTable, read_columns
from anhyst.model.actuator import Model, read_model
from anhyst.rig.body import BodyRig, travel_m
from anhyst.rig.file import RigFile
from anhyst.rig.magnet_table import LAW
from anhyst.rig.parts.magnet import FluxTable, flux_table_of, iron_magnet, law_magnet
from anhyst.rig.tables import AXES
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray, passed

Numbers = NDArray[np.int_]


def read_flux_table(path: PathLike) -> FluxTable:
    """Read a flux table."""
    table = read_columns(path)
    current = table.need("current", "I_A")
    gap = table.need("gap", "gap_m")
    psi = table.need("flux_linkage", "psi_Wb")
    currents, column = np.unique(current, return_inverse=True)
    gaps, row = np.unique(gap, return_inverse=True)
    for name, values in (("current", currents), ("gap", gaps)):
        if values.size < 2:
            raise InputError(
                f"{table.path}: has a single {name}; measure at least two",
                code="too-few-values",
                key=name,
            )
    if currents[0] != 0.0:
        text = f"currents begin at {currents[0]:g} A; begin at 0, the flux is taken as odd in it"
        raise InputError(
            f"{table.where(int(np.argmin(current)))}: {text}",
            code="currents-not-from-zero",
            key="I_A",
        )
    numbers = np.full((gaps.size, currents.size), -1)
    for number, cell in enumerate(zip(row.tolist(), column.tolist(), strict=True)):
        if numbers[cell] >= 0:
            point = _point(gap[number], current[number])
            raise InputError(
                f"{table.where(number)}: {point} comes twice; remove one", code="value-again"
            )
        numbers[cell] = number
    _check_full(table.path, gaps, currents, numbers)
    made = FluxTable(currents, gaps, psi[numbers])
    _check_monotone(table, made, numbers)
    return made


def check_flux_range(
    path: PathLike, table: FluxTable, gap_low: float, gap_high: float, current_high: float
) -> None:
    """Refuse a flux table that ends before the plant does."""
    low, high = float(table.gap[0]), float(table.gap[-1])
    if not (low <= gap_low and gap_high <= high):
        raise InputError(
            f"{path}: gap_m runs from {low:g} to {high:g} m and must hold the travel, "
            f"{gap_low:g} to {gap_high:g} m; add gaps",
            code="gaps-not-covered",
            key="gap_m",
        )
    if table.current[-1] < current_high:
        raise InputError(
            f"{path}: I_A ends at {table.current[-1]:g} A and the amplifier at {current_high:g} A; "
            "add currents",
            code="currents-not-covered",
            key="I_A",
        )


def _check_full(path: str, gaps: FloatArray, currents: FloatArray, numbers: Numbers) -> None:
    holes = np.argwhere(numbers < 0)
    if len(holes):
        first = _point(gaps[holes[0, 0]], currents[holes[0, 1]])
        more = f" and at {len(holes) - 1} other points" if len(holes) > 1 else ""
        raise InputError(
            f"{path}: has a hole at {first}{more}; {gaps.size} gaps and {currents.size} currents "
            "must make a full grid, add what is missing",
            code="grid-has-holes",
        )


def _check_monotone(table: DataTable, made: FluxTable, numbers: Numbers) -> None:
    flat = np.add(np.argwhere(np.diff(made.psi, axis=1) <= 0.0), (0, 1))
    widens = np.add(np.argwhere(np.diff(made.psi[:, 1:], axis=0) >= 0.0), (1, 1))
    for places, text in (
        (np.argwhere(made.psi[:, :1] != 0.0), "psi is not 0 without current"),
        (flat, "psi does not rise with the current"),
        (widens, "psi does not fall as the gap opens"),
    ):
        if len(places):
            g, i = places[0].tolist()
            point = _point(made.gap[g], made.current[i])
            where = table.where(int(numbers[g, i]))
            raise InputError(f"{where}: {text} at {point}; correct this point", code="not-monotone")


def _point(gap: float, current: float) -> str:
    return f"{gap * 1e3:g} mm, {current:g} A"


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

ROWS = 129
"""Places over the gap at which a law's gap map is looked at."""


def make_magnet(rig: BodyRig, law: Model | None = None) -> Magnet:
    """Return the magnet of a rig."""
    settings, middle = rig.settings.magnet, rig.settings.gap_m
    if settings.kind != LAW:
        steel = rig.settings.steel
        return iron_magnet(settings.poles, steel, settings.eddy_time_s, middle, settings.solid_iron)
    table = flux_table(rig)
    model = law or law_of(rig)
    at = np.linspace(float(table.gap[0]), float(table.gap[-1]), ROWS)
    names = ("c_H", "rho", "c_out", "out_0", "in_0")
    rows = np.column_stack([model.over_schedule(name, at) for name in names])
    eddy = float(model.over_schedule("gamma", np.array([middle]))[0])
    return law_magnet(settings.poles, model.iron_at(middle), rows, eddy, table)


def law_of(rig: BodyRig) -> Model:
    """Return the identified law that makes a rig's force."""
    assert rig.model is not None
    model = read_model(rig.model)
    if model.layers is not None:
        raise InputError(
            f"{rig.model}: a virtual magnet of a law has no layers; take out its [layers]",
            code="layers-not-in-plant",
            key="model",
        )
    if model.fixed_gap_only or not model.needs_schedule or model.power != 2:
        raise InputError(
            f"{rig.model}: a bearing needs a model of force over current whose gap may move; "
            "identify one from loops at several gaps",
            code="not-current-to-force",
        )
    return model


def flux_table(rig: BodyRig) -> FluxTable:
    """Return the flux table of a rig, as measured or made from its magnet."""
    if rig.flux_table is not None:
        table = read_flux_table(rig.flux_table)
        body, high = rig.settings.body, rig.settings.amplifier.current_high_A
        check_flux_range(rig.flux_table, table, body.stop_low_m, body.stop_high_m, high)
        return table
    settings = rig.settings
    ends = (0.8 * settings.body.stop_low_m, 1.2 * settings.body.stop_high_m)
    high = 1.5 * settings.amplifier.current_high_A
    return flux_table_of(settings.magnet.poles, settings.steel, high, ends)


def static_map(
    rig: BodyRig, current: FloatArray, gap: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return force, flux linkage and flux density of a path so slow that nothing is induced."""
    columns = Coil(make_magnet(rig)).run(np.ascontiguousarray(current), np.ascontiguousarray(gap))
    return columns[:, 0].copy(), columns[:, 1].copy(), columns[:, 2].copy()


def make_plant(
    rig: BodyRig, seed: int, *magnets: Magnet, numbers: PlantNumbers | None = None
) -> Plant:
    """Return the plant of a rig, at rest on the stop of the largest gap; its numbers may be others.

    Where fewer magnets are given than it has, all others are like the first.
    """
    own = magnets or (make_magnet(rig),)
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
