"""Export a simulated bearing as an FMU: the plant of ``anhyst simulate`` and its controller."""

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
    LAW_CORE_FILES,
    WRAPPER_FOLDER,
    Part,
    Variable,
    c_array_definition,
    c_array_literal,
    compiled_sources,
    header_text,
    kernel_expression,
)
from anhyst_rigs.rig.bearing.loop import model_to_compile
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.parts.iron import CURVE_KEYS, AnySteel, CellSteel, PreisachSteel, everett_table
from anhyst_rigs.rig.parts.magnet import COUPLED, SolidIron, circuit_parameters
from anhyst_rigs.rig.plant import current_controllers, noise_seed, plant_parameters
from anhyst_rigs.rig.recording import column_name
from anhyst_rigs.study.bearing.inputs import check_inputs, read_files

FLOAT_FORMATS = ("f32", "f64")
PLANT_CORE_FILES = (
    *LAW_CORE_FILES,
    *(f"compensator/{name}_{of}.c" for name in ("full", "cells", "simplified") for of in FLOAT_FORMATS),
    *(
        f"compensator/{name}_{of}.c"
        for name in ("block", "compensator", "map", "play_map")
        for of in FLOAT_FORMATS
    ),
    *("compensator/play_map.c", *(f"compensator/force_controller_{of}.c" for of in FLOAT_FORMATS)),
    *(f"control/{name}_{of}.c" for name in ("pidd2", "position") for of in FLOAT_FORMATS),
)
"""C files of the core that the plant needs in addition to the files of a compiled controller."""


def bearing_part(rig_path: PathLike) -> Part:
    """Return a bearing with its position controller as a component.

    The inputs are the demanded gap and the load; the outputs are the gap, the force and the
    currents. The component runs at the rate of the controller, whose file is next to the rig file.
    """
    rig, controller = read_files(rig_path, None)
    checked_inputs = check_inputs(rig, controller)
    compensation = controller.settings.compensation
    if compensation.variant not in {"full", "simplified"} or compensation.format != "fixed":
        raise InputError(
            f"{controller.path}: an FMU requires variant full or simplified and format fixed, "
            f"not {compensation.variant} and {compensation.format}; change [compensation]",
            code="not-compiled-controller",
            key="compensation",
        )
    require_iron_magnet(checked_inputs.rig)
    with tempfile.TemporaryDirectory(prefix="anhyst-part-") as scratch:
        folder = Path(scratch) / "controller"
        compile_actuator(
            model_to_compile(checked_inputs.rig, checked_inputs.identify_magnet(), compensation.variant),
            folder,
            kind="full" if compensation.variant == "full" else "simplified",
            io="q31",
            controller=controller.path,
        )
        manifest, sources = compiled_sources(folder)
    wrapper_files = ("bearing.c", "bearing_controller.c", "bearing_controller.h", "virtual_plant.h")
    sources = plant_sources("axes|piezo|held", PLANT_CORE_FILES, wrapper_files) | sources
    sources["bearing_numbers.h"] = plant_header(checked_inputs.rig).encode()
    sources["controller_numbers.h"] = _controller_header(manifest["name"]).encode()
    title = rig.settings.name
    text = f"{title}, controlled by '{controller.settings.name}', {compensation.variant} in fixed point"
    rate, limits = rig.settings.timing.rate_Hz, controller.settings.limits
    variables = _bearing_variables(checked_inputs.rig, (limits.gap_low_m, limits.gap_high_m))
    return Part(title, text, rate, variables, sources)


def require_iron_magnet(rig: BodyRig) -> None:
    """Raise an error if the magnet is a hysteresis law, which an FMU of a rig does not support."""
    if rig.settings.magnet.kind == "law":
        raise InputError(
            f'{rig.path}: an FMU of a rig needs a magnet of iron; give [[iron]] instead of kind = "law"',
            code="law-not-exported",
            key="magnet.kind",
        )


def plant_sources(
    excluded_pattern: str,
    core_paths: Iterable[str] = (),
    wrapper_files: Iterable[str] = (),
    memory_count: int = 1,
) -> dict[str, bytes]:
    """Return the C files of the plant, without files that match a pattern, and further files.

    ``core_paths`` are further files of the core, and ``wrapper_files`` are files of the component.
    """
    sources = {path: text.encode() for path, text in core_files(core_paths, memory_count).items()}
    sources |= {name: (WRAPPER_FOLDER / name).read_bytes() for name in wrapper_files}
    folder = shipped_folder("anhyst_exchange", "plant", "_plant", "include/anhyst_plant/body.h")
    for path in sorted(folder.rglob("*.[ch]")):
        name = path.relative_to(folder).as_posix()
        if path.name != "bus.c" and not re.search(excluded_pattern, name):
            sources[name.replace("src/", "plant/", 1)] = path.read_bytes()
    return sources


def c_initialiser(value: object) -> str:
    """Return a C initialiser for a dictionary (structure), a list (array) or a single value."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f".{name} = {c_initialiser(member)}" for name, member in value.items()) + "}"
    if isinstance(value, list):
        return "{" + ", ".join(map(c_initialiser, value)) + "}"
    return str(value)


def _iron_initialiser(steel: AnySteel) -> tuple[str, str]:
    """Return the C initialiser of the iron of all magnets, and the arrays to which it points."""
    parameters, table = steel.plant_parameters(), ""
    members: dict[str, object] = {key: value for key, value in parameters.items() if key not in CURVE_KEYS}
    members["curve"] = {key: parameters[key] for key in CURVE_KEYS}
    slack = 0.0
    if isinstance(steel, CellSteel):
        family = "cells"
        thresholds, weights = c_array_literal(steel.thresholds), c_array_literal(steel.weights)
        members |= {"cells": steel.cells + 1, "threshold": thresholds, "weight": weights}
    elif isinstance(steel, PreisachSteel):
        family, everett_values = "preisach", everett_table(steel, True)
        table = c_array_definition("bearing_everett", everett_values.ravel())
        members |= {"everett": "bearing_everett", "nodes": len(everett_values)}
        saturation = parameters["sharp"] + parameters["slow"]
        slack = abs(parameters["feedback"]) * (float(everett_values.max()) + 2.0 * saturation)
    else:
        family, slack = "duhem", 4.0 * parameters["coercivity"]
    iron = {"family": f"&anhyst_plant_of_{family}", "slack": slack, "steel": {family: members}}
    return c_initialiser(iron), table


def _controller_header(name: str) -> str:
    """Return the header that defines the names of the compiled controller for the component."""
    macro_prefix = name.upper()
    scale_macros = [
        f"{macro_prefix}_CONTROLLER_GAP_MIDDLE_M",
        *(f"{macro_prefix}_CONTROLLER_FULL_SCALE_{name}" for name in ("POSITION_M", "CURRENT_A", "DEMAND_N")),
    ]
    macros = {
        "CONTROLLER_SCALES": "{" + ", ".join([*scale_macros, "1.0", "1.0"]) + "}",
        "CONTROLLER": f"{name}_controller",
        "CONTROLLER_INIT": f"{name}_controller_init",
        "CONTROLLER_LIMITS": f"{name}_controller_limits",
        "CONTROLLER_SETTINGS": f"{name}_controller_settings",
        "CONTROLLER_KERNEL": kernel_expression(f"{macro_prefix}_KERNEL", f"{name}_parameters"),
        "CONTROLLER_PARAMETERS": f"{name}_parameters",
    }
    return header_text("controller_numbers", macros, f'#include "{name}_controller.h"\n\n')


def magnet_definition(
    steel: AnySteel,
    circuit: Mapping[str, float],
    solid: SolidIron | None,
    cone: Mapping[str, float] | None = None,
) -> tuple[str, str]:
    """Return the C initialiser of a magnet, and the definitions to which it points."""
    iron, everett_table = _iron_initialiser(steel)
    numbers: dict[str, object] = dict(circuit)
    winding = {key: numbers.pop(key) for key in ("turns", "resistance")}
    text, members = everett_table, {"iron": iron, **numbers}
    if solid is not None:
        layer_shares, layer_eddy_drags = solid.layer_parameters()
        length_share = solid.length / circuit["iron_length"]
        solid_members = {
            "volumes": solid.volumes,
            "part": length_share,
            "share": c_array_literal(layer_shares),
            "drag": c_array_literal(layer_eddy_drags),
        }
        text += f"static const anhyst_plant_solid magnet_solid = {c_initialiser(solid_members)};\n"
        members["solid"] = "&magnet_solid"
    if cone is not None:
        text += f"static const anhyst_plant_cone magnet_cone = {c_initialiser(cone)};\n"
        members["cone"] = "&magnet_cone"
    text += f"static const anhyst_plant_circuit magnet_circuit = {c_initialiser(members)};\n"
    return c_initialiser({"circuit": "&magnet_circuit", **winding}), text


def volume_count(solid: SolidIron | None) -> int:
    """Return the array size for the volumes of solid iron, which is at least one."""
    return 1 if solid is None else solid.volumes


def plant_header(rig: BodyRig) -> str:
    """Return the header with the parameters of the plant."""
    settings = rig.settings
    parameters = plant_parameters(rig)
    if settings.magnet.kind == COUPLED:
        text = "an FMU has no force map of both currents; export a rig with another kind of magnet"
        raise InputError(f"{rig.path}: magnet.kind: {text}", code="not-for-this-kind", key="magnet.kind")
    circuit = circuit_parameters(settings.magnet.poles, settings.magnet.eddy_time_s, settings.gap_m)
    magnet, circuits = magnet_definition(settings.steel, circuit, settings.magnet.solid_iron)
    actuators = [{"magnet": magnet, **actuator} for actuator in parameters.actuators]
    bearing = {
        **parameters.body,
        "coordinates": len(parameters.body["coordinate"]),
        "magnets": len(actuators),
        "actuator": "bearing_actuators",
        "heads": len(parameters.heads),
        "head": "bearing_heads",
        "load": parameters.load,
    }
    text = (
        '#include "anhyst_plant/body.h"\n\n'
        f"{circuits}"
        f"static const anhyst_plant_actuator bearing_actuators[] = {c_initialiser(actuators)};\n"
        f"static const anhyst_plant_head bearing_heads[] = {c_initialiser(parameters.heads)};\n"
        f"static const anhyst_plant_body bearing = {c_initialiser(bearing)};\n\n"
    )
    macros = {
        "BEARING_MAGNETS": len(actuators),
        "BEARING_COORDINATES": bearing["coordinates"],
        "BEARING_VOLUMES": volume_count(settings.magnet.solid_iron),
        "BEARING_SEED": f"UINT64_C({noise_seed(rig, 0)})",
        "BEARING_HEADS": len(parameters.heads),
        "BEARING_CURRENT_LOOPS": c_initialiser(current_controllers(rig)),
    }
    return header_text("bearing_numbers", macros, text)


def _bearing_variables(rig: BodyRig, gaps: tuple[float, float]) -> list[Variable]:
    codes = ", ".join(f"{command.value} {command.name.lower()}" for command in Command)
    reference_gap, load = rig.settings.gap_m, rig.settings.load
    return [
        Variable("target_m", "input", "m", "demanded gap", reference_gap, *gaps),
        Variable("load_N", "input", "N", "force of the load drive, which opens the gap", load.force_N),
        Variable("command", "input", "1", f"command, which acts when it changes: {codes}", 0.0, 0.0, 6.0),
        Variable("gap_read_m", "output", "m", "reading of the position sensor at the last tick"),
        Variable("reference_m", "output", "m", "reference of the position controller"),
        Variable("demand_N", "output", "N", "demanded net force"),
        Variable("state", "output", "1", "state of the controller: 16*state + phase"),
        Variable("flags", "output", "1", "flags of the controller"),
        Variable("velocity_m_per_s", "output", "m/s", "velocity of the armature, in the opening direction"),
        *magnet_variables("net force of the magnets", len(rig.settings.body_magnets)),
    ]


def magnet_variables(force_text: str, count: int) -> list[Variable]:
    """Return the variables of net force and of each magnet, in the order of ``write_plant_outputs``."""
    signals = (
        ("gap", "m", "true gap"),
        ("current", "A", "current"),
        ("flux_density", "T", "flux density in the gap"),
        ("command", "A", "reference of the current"),
    )
    return [
        Variable("force_N", "output", "N", force_text),
        *(
            Variable(column_name(signal, unit, number), "output", unit, f"{text}, magnet {number}")
            for number in range(1, count + 1)
            for signal, unit, text in signals
        ),
    ]
