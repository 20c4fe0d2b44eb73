"""A whole virtual bearing as a component: the plant of ``anhyst simulate`` and its controller."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from anhyst.compilation.output import compile_actuator
from anhyst.compilation.toolchain import core_files
from anhyst.support.atomic import PathLike, shipped_folder
from anhyst.support.errors import InputError
from anhyst.support.states import Command
from anhyst_exchange.part import (
    CORE_OF_LAWS,
    WRAPPER,
    Part,
    Variable,
    array,
    compiled_sources,
    header,
    kernel_of,
    row,
)
from anhyst_rigs.rig.bearing.loop import compiled_model
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.parts.iron import CURVE, AnySteel, CellSteel, PreisachSteel, everett
from anhyst_rigs.rig.parts.magnet import Solid, circuit_numbers
from anhyst_rigs.rig.plant import current_loops, noise_seed, plant_numbers
from anhyst_rigs.rig.recording import column
from anhyst_rigs.study.bearing.ready import make_ready, read_files

FORMATS = ("f32", "f64")
CORE_OF_PLANT = (
    *CORE_OF_LAWS,
    *(f"compensator/{name}_{of}.c" for name in ("full", "cells", "simplified") for of in FORMATS),
    *(
        f"compensator/{name}_{of}.c"
        for name in ("block", "compensator", "map", "play_map")
        for of in FORMATS
    ),
    *("compensator/play_map.c", *(f"compensator/force_controller_{of}.c" for of in FORMATS)),
    *(f"control/{name}_{of}.c" for name in ("pidd2", "position") for of in FORMATS),
)
"""What the plant and its adapters name beyond a compiled controller."""


def bearing_part(rig_path: PathLike) -> Part:
    """Return a bearing with its position controller: wanted gap and load in; gap, force, currents out.

    It ticks at the rate of the controller, whose file lies beside the rig's.
    """
    rig, controller = read_files(rig_path, None)
    ready = make_ready(rig, controller)
    compensation = controller.settings.compensation
    if compensation.variant not in {"full", "simplified"} or compensation.format != "fixed":
        raise InputError(
            f"{controller.path}: an FMU holds the compiled controller: variant full or simplified "
            f"in format fixed, not {compensation.variant} in {compensation.format}; change [compensation]",
            code="not-compiled-controller",
            key="compensation",
        )
    refuse_plant(ready.rig)
    with tempfile.TemporaryDirectory(prefix="anhyst-part-") as scratch:
        folder = Path(scratch) / "controller"
        compile_actuator(
            compiled_model(ready.rig, ready.knowledge(), compensation.variant),
            folder,
            kind="full" if compensation.variant == "full" else "simplified",
            io="q31",
            controller=controller.path,
        )
        manifest, sources = compiled_sources(folder)
    own = ("bearing.c", "bearing_controller.c", "bearing_controller.h", "virtual_plant.h")
    sources = plant_sources("axes|piezo|held", CORE_OF_PLANT, own) | sources
    sources["bearing_numbers.h"] = numbers_of_plant(ready.rig).encode()
    sources["controller_numbers.h"] = _names(manifest["name"]).encode()
    title = rig.settings.name
    text = f"{title}, controlled by '{controller.settings.name}', {compensation.variant} in fixed point"
    rate, limits = rig.settings.timing.rate_Hz, controller.settings.limits
    variables = _variables(ready.rig, (limits.gap_low_m, limits.gap_high_m))
    return Part(title, text, rate, variables, sources)


def refuse_plant(rig: BodyRig) -> None:
    """Refuse a magnet that no FMU holds."""
    if rig.settings.magnet.kind == "law":
        raise InputError(
            f"{rig.path}: an FMU of a rig knows a magnet of iron; give [[iron]] in place of "
            'kind = "law"',
            code="law-not-exported",
            key="magnet.kind",
        )


def plant_sources(
    others: str, core: Iterable[str] = (), own: Iterable[str] = (), memories: int = 1
) -> dict[str, bytes]:
    """Return all of the plant but what moves other rigs, sources of the core, and a part's own."""
    found = {path: text.encode() for path, text in core_files(core, memories).items()}
    found |= {name: (WRAPPER / name).read_bytes() for name in own}
    folder = shipped_folder("anhyst_exchange", "plant", "_plant", "include/anhyst_plant/body.h")
    for path in sorted(folder.rglob("*.[ch]")):
        name = path.relative_to(folder).as_posix()
        if path.name != "bus.c" and not re.search(others, name):
            found[name.replace("src/", "plant/", 1)] = path.read_bytes()
    return found


def fields(numbers: object) -> str:
    """Return structures, arrays and what is in them as C."""
    if isinstance(numbers, Mapping):
        return (
            "{" + ", ".join(f".{name} = {fields(number)}" for name, number in numbers.items()) + "}"
        )
    if isinstance(numbers, list):
        return "{" + ", ".join(map(fields, numbers)) + "}"
    return str(numbers)


def _iron(steel: AnySteel) -> tuple[str, str]:
    """Return the iron of all magnets as a structure, and the arrays to which it points."""
    numbers, table = steel.numbers(), ""
    own: dict[str, object] = {key: value for key, value in numbers.items() if key not in CURVE}
    own["curve"] = {key: numbers[key] for key in CURVE}
    slack = 0.0
    if isinstance(steel, CellSteel):
        family = "cells"
        thresholds, weights = row(steel.thresholds), row(steel.weights)
        own |= {"cells": steel.cells + 1, "threshold": thresholds, "weight": weights}
    elif isinstance(steel, PreisachSteel):
        family, relays = "preisach", everett(steel, True)
        table = array("bearing_everett", relays.ravel())
        own |= {"everett": "bearing_everett", "nodes": len(relays)}
        saturation = numbers["sharp"] + numbers["slow"]
        slack = abs(numbers["feedback"]) * (float(relays.max()) + 2.0 * saturation)
    else:
        family, slack = "duhem", 4.0 * numbers["coercivity"]
    described = {"family": f"&anhyst_plant_of_{family}", "slack": slack, "steel": {family: own}}
    return fields(described), table


def _names(name: str) -> str:
    """Return the header that gives the component the names of its controller."""
    macro = name.upper()
    scales = [
        f"{macro}_CONTROLLER_GAP_MIDDLE_M",
        *(
            f"{macro}_CONTROLLER_FULL_SCALE_{name}"
            for name in ("POSITION_M", "CURRENT_A", "DEMAND_N")
        ),
    ]
    defined = {
        "CONTROLLER_SCALES": "{" + ", ".join([*scales, "1.0", "1.0"]) + "}",
        "CONTROLLER": f"{name}_controller",
        "CONTROLLER_INIT": f"{name}_controller_init",
        "CONTROLLER_LIMITS": f"{name}_controller_limits",
        "CONTROLLER_SETTINGS": f"{name}_controller_settings",
        "CONTROLLER_KERNEL": kernel_of(f"{macro}_KERNEL", f"{name}_parameters"),
        "CONTROLLER_PARAMETERS": f"{name}_parameters",
    }
    return header("controller_numbers", defined, f'#include "{name}_controller.h"\n\n')


def magnet_text(
    steel: AnySteel,
    circuit: Mapping[str, float],
    solid: Solid | None,
    cone: Mapping[str, float] | None = None,
) -> tuple[str, str]:
    """Return a magnet as a structure, and the lines that define what it points to."""
    iron, everett_table = _iron(steel)
    numbers: dict[str, object] = dict(circuit)
    winding = {key: numbers.pop(key) for key in ("turns", "resistance")}
    text, own = everett_table, {"iron": iron, **numbers}
    if solid is not None:
        share, drag = solid.numbers()
        part = solid.length / circuit["iron_length"]
        slab = {"volumes": solid.volumes, "part": part, "share": row(share), "drag": row(drag)}
        text += f"static const anhyst_plant_solid magnet_solid = {fields(slab)};\n"
        own["solid"] = "&magnet_solid"
    if cone is not None:
        text += f"static const anhyst_plant_cone magnet_cone = {fields(cone)};\n"
        own["cone"] = "&magnet_cone"
    text += f"static const anhyst_plant_circuit magnet_circuit = {fields(own)};\n"
    return fields({"circuit": "&magnet_circuit", **winding}), text


def volumes_of(solid: Solid | None) -> int:
    """Return for how many volumes of solid iron an array has place, one at least."""
    return 1 if solid is None else solid.volumes


def numbers_of_plant(rig: BodyRig) -> str:
    """Return the plant as structures."""
    settings = rig.settings
    numbers = plant_numbers(rig)
    circuit = circuit_numbers(settings.magnet.poles, settings.magnet.eddy_time_s, settings.gap_m)
    magnet, circuits = magnet_text(settings.steel, circuit, settings.magnet.solid_iron)
    actuators = [{"magnet": magnet, **actuator} for actuator in numbers.actuators]
    bearing = {
        **numbers.body,
        "coordinates": len(numbers.body["coordinate"]),
        "magnets": len(actuators),
        "actuator": "bearing_actuators",
        "heads": len(numbers.heads),
        "head": "bearing_heads",
        "load": numbers.load,
    }
    text = (
        '#include "anhyst_plant/body.h"\n\n'
        f"{circuits}"
        f"static const anhyst_plant_actuator bearing_actuators[] = {fields(actuators)};\n"
        f"static const anhyst_plant_head bearing_heads[] = {fields(numbers.heads)};\n"
        f"static const anhyst_plant_body bearing = {fields(bearing)};\n\n"
    )
    defined = {
        "BEARING_MAGNETS": len(actuators),
        "BEARING_COORDINATES": bearing["coordinates"],
        "BEARING_VOLUMES": volumes_of(settings.magnet.solid_iron),
        "BEARING_SEED": f"UINT64_C({noise_seed(rig, 0)})",
        "BEARING_HEADS": len(numbers.heads),
        "BEARING_CURRENT_LOOPS": fields(current_loops(rig)),
    }
    return header("bearing_numbers", defined, text)


def _variables(rig: BodyRig, gaps: tuple[float, float]) -> list[Variable]:
    codes = ", ".join(f"{command.value} {command.name.lower()}" for command in Command)
    middle, load = rig.settings.gap_m, rig.settings.load
    return [
        Variable("target_m", "input", "m", "wanted gap", middle, *gaps),
        Variable("load_N", "input", "N", "of the load drive; opens the gap", load.force_N),
        Variable("command", "input", "1", f"acts when it changes: {codes}", 0.0, 0.0, 6.0),
        Variable("gap_read_m", "output", "m", "as the position sensor said at the last tick"),
        Variable("reference_m", "output", "m", "gap to which is controlled"),
        Variable("demand_N", "output", "N", "wanted net force"),
        Variable("state", "output", "1", "of the controller: 16*state + phase"),
        Variable("flags", "output", "1", "of the controller"),
        Variable("velocity_m_per_s", "output", "m/s", "of the armature; the gap opens"),
        *magnet_variables("of the magnets, net", len(rig.settings.placed)),
    ]


def magnet_variables(net: str, count: int) -> list[Variable]:
    """Return net force and what is known of each magnet, in the order of ``show_plant``."""
    signals = (
        ("gap", "m", "true gap"),
        ("current", "A", "current"),
        ("flux_density", "T", "in the gap"),
        ("command", "A", "reference of the current"),
    )
    return [
        Variable("force_N", "output", "N", net),
        *(
            Variable(column(signal, unit, number), "output", unit, f"{text}, magnet {number}")
            for number in range(1, count + 1)
            for signal, unit, text in signals
        ),
    ]
