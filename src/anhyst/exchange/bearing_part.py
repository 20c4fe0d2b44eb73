"""A whole virtual bearing or stage as a component: the plant of ``anhyst simulate`` and its controller."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from anhyst.compilation.core import LAYERS, SOURCES, core_files
from anhyst.compilation.floating_source import memories
from anhyst.compilation.verb import compile_actuator
from anhyst.control.controller_file import ControllerFile
from anhyst.control.states import Command
from anhyst.exchange.part import WRAPPER, Part, Variable, header, kernel_of, row
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.make_setup import compiled_model
from anhyst.rig.bearing.plant import current_loops, noise_seed, plant_numbers
from anhyst.rig.parts.iron import CellSteel
from anhyst.rig.parts.magnet import circuit_numbers
from anhyst.rig.stage.file import StageRig, read_stage
from anhyst.rig.stage.loop import (
    StageSetup,
    block_of,
    controller_settings,
    identify_stage,
    make_stage,
    pid,
)
from anhyst.study.bearing.ready import make_ready, read_files
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.folder import plant_folder

_FORMATS = ("f32", "f64")
_CORE = (
    "numeric/elementary.c",
    *(f"law/{name}.c" for name in ("langevin", "branch", "operator", "solver")),
    *(f"law/{name}.c" for name in ("circuit", "layers")),
    *(f"law/{name}.c" for name in ("lag_exact", "lag_linear", "lag_1986", "law_lag")),
    *(f"law/{name}.c" for name in ("cell_shape", "cell_table", "cells", "law_cells")),
    *(f"compensator/{name}_{of}.c" for name in ("full", "cells", "simplified") for of in _FORMATS),
    *(f"compensator/compensator_{of}.c" for of in _FORMATS),
    *(f"compensator/{name}.c" for name in ("map_real", "play_map", "play_map_real")),
    *("compensator/force_controller_real.c", "control/pidd2_real.c", "control/position_real.c"),
)
"""What the plant and its adapters name beyond a compiled controller."""
_CORE_OF_STAGE = (
    *(name for name in _CORE if not name.startswith("control/")),
    *(name for kind in SOURCES.values() for name in kind),
    *LAYERS,
    *("compensator/map.c", "compensator/force_controller.c", "control/pidd2.c"),
    *(
        f"control/{name}{of}.c"
        for name in ("allocation", "biquad", "tracking")
        for of in ("", "_real")
    ),
)
"""What the plant of a stage and its tracking controller name."""


def bearing_part(rig_path: PathLike) -> Part:
    """Return a bearing with its position controller: wanted gap and load in; gap, force, currents out.

    It ticks at the rate of the controller, whose file lies beside the rig's.
    """
    rig, controller = read_files(rig_path, None)
    ready = make_ready(rig, controller)
    wanted = controller.settings.compensation
    if wanted.variant not in {"full", "simplified"} or wanted.format != "fixed":
        raise InputError(
            f"{controller.path}: an FMU holds the compiled controller: variant full or simplified "
            f"in format fixed, not {wanted.variant} in {wanted.format}; change [compensation]",
            code="not-compiled-controller",
            key="compensation",
        )
    _refuse_plant(ready.rig)
    with tempfile.TemporaryDirectory(prefix="anhyst-part-") as scratch:
        folder = Path(scratch) / "controller"
        compile_actuator(
            compiled_model(ready.rig, ready.knowledge(), wanted.variant),
            folder,
            kind="full" if wanted.variant == "full" else "simplified",
            io="q31",
            controller=controller.path,
        )
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        name = manifest["name"]
        own = [path for place in ("include", "src") for path in (folder / place).rglob("*.[ch]")]
        own += [
            folder / f"{name}_{of}.{end}" for of in ("parameters", "controller") for end in "ch"
        ]
        sources = {path.relative_to(folder).as_posix(): path.read_bytes() for path in own}
    sources = {path: text.encode() for path, text in core_files(_CORE).items()} | sources
    sources |= _plant_sources("tracking|piezo")
    for own_file in (
        "bearing.c",
        "bearing_controller.c",
        "bearing_controller.h",
        "virtual_plant.h",
    ):
        sources[own_file] = (WRAPPER / own_file).read_bytes()
    sources["bearing_numbers.h"] = _numbers(ready.rig).encode()
    sources["controller_numbers.h"] = _names(name).encode()
    title = rig.settings.name
    text = f"{title}, controlled by '{controller.settings.name}', {wanted.variant} in fixed point"
    rate = rig.settings.timing.rate_Hz
    return Part(title, text, rate, _variables(ready.rig, controller, manifest), sources)


def stage_part(rig_path: PathLike) -> Part:
    """Return a stage with its tracking controller: set-point and feedforward in; position, force out.

    It ticks at the rate of the controller; the compensator is ``full``, as the rig file has it.
    """
    rig = read_stage(rig_path)
    _refuse_stage(rig)
    _refuse_plant(rig.bearing)
    setup = make_stage(rig, identify_stage(rig), "full")
    sources = {
        path: text.encode()
        for path, text in core_files(_CORE_OF_STAGE, memories(block_of(setup))).items()
    }
    sources |= _plant_sources("piezo|position")
    for own_file in ("stage.c", "stage_controller.c", "stage_controller.h", "virtual_plant.h"):
        sources[own_file] = (WRAPPER / own_file).read_bytes()
    sources["bearing_numbers.h"] = _numbers(rig.bearing).encode()
    sources["stage_numbers.h"] = _controller_numbers(setup).encode()
    title = rig.settings.name
    text = f"{title}, led by PID and feedforward, full in fixed point"
    return Part(title, text, rig.settings.timing.rate_Hz, _stage_variables(rig), sources)


def _refuse_stage(rig: StageRig) -> None:
    control = rig.settings.tracking
    if rig.settings.several:
        raise InputError(
            f"{rig.path}: body.free: an FMU of a stage has one coordinate; leave body.free out",
            code="one-coordinate-only",
            key="body.free",
        )
    if control.format != "fixed":
        raise InputError(
            f'{rig.path}: an FMU holds compensators in fixed point; write format = "fixed"',
            code="not-compiled-controller",
            key="control.format",
        )
    for key in ("calibrate", "calibration"):
        if getattr(control, key):
            raise InputError(
                f"{rig.path}: control.{key}: an FMU of a stage corrects nothing; leave it out",
                code="calibration-not-exported",
                key=f"control.{key}",
            )


def _controller_numbers(setup: StageSetup) -> str:
    """Return the controller of a stage as structures, and the words of its compensators."""
    block, settings = block_of(setup), controller_settings(setup)
    numbers = {name: repr(float(value)) for name, value in settings.items()}
    forward, back = (list(pid(setup.rig).values())[part] for part in (slice(3), slice(3, None)))
    scales = ("error_full", "forward_full", "demand_full", "current_full", "flux_full")
    defined = {
        "STAGE_DRIVES": len(setup.rig.bearing.magnets),
        "STAGE_KERNEL": kernel_of(f"anhyst_kernel_{block.kind}", "stage_words"),
        "STAGE_GAP_TOTAL": numbers["gap_total"],
        "STAGE_SCALES": _fields([numbers[name] for name in (*scales, "gap_low", "gap_high")]),
        "STAGE_SETTINGS": _fields(
            {
                "pid": {"forward": row(forward), "back": row(back)},
                "allocation": {"idle": numbers["idle"], "kind": int(settings["allocation"])},
                **{
                    f"current_{name}": numbers[f"current_{name}"]
                    for name in ("low", "high", "step")
                },
            }
        ),
    }
    words = ", ".join(map(str, block.words.tolist()))
    return header(
        "stage_numbers",
        defined,
        f"#include <stdint.h>\n\nstatic const int16_t stage_words[] = {{{words}}};\n\n",
    )


def _refuse_plant(rig: BearingRig) -> None:
    if rig.settings.magnet.kind == "law" or not isinstance(rig.settings.steel.steel(), CellSteel):
        raise InputError(
            f'{rig.path}: an FMU of a rig knows an iron of cells; give force = "cells" with '
            "[[iron]]",
            code="not-iron-of-cells",
            key="iron",
        )


def _plant_sources(others: str) -> dict[str, bytes]:
    """Return all of the plant but what moves other rigs."""
    folder = plant_folder()
    found = {}
    for path in sorted(folder.rglob("*.[ch]")):
        place = path.relative_to(folder).as_posix()
        if path.name != "bus.c" and not re.search(others, place):
            found[place.replace("src/", "plant/", 1)] = path.read_bytes()
    return found


def _fields(numbers: object) -> str:
    """Return structures, arrays and what is in them as C."""
    if isinstance(numbers, Mapping):
        return "{" + ", ".join(f".{name} = {_fields(one)}" for name, one in numbers.items()) + "}"
    if isinstance(numbers, list):
        return "{" + ", ".join(map(_fields, numbers)) + "}"
    return str(numbers)


def _iron(rig: BearingRig) -> str:
    steel = rig.settings.steel.steel()
    assert isinstance(steel, CellSteel)
    curve = _fields(steel.curve())
    thresholds, weights = row(steel.thresholds), row(steel.weights)
    cells = {"cells": steel.cells + 1, "threshold": thresholds, "weight": weights, "curve": curve}
    steels = _fields({"cells": _fields(cells)})
    return _fields({"family": "&anhyst_plant_of_cells", "slack": 0.0, "steel": steels})


def _names(name: str) -> str:
    """Return the header that gives the component the names of its controller."""
    macro = name.upper()
    scales = [
        f"{macro}_CONTROLLER_GAP_MIDDLE_M",
        *(
            f"{macro}_CONTROLLER_FULL_SCALE_{one}"
            for one in ("POSITION_M", "CURRENT_A", "DEMAND_N")
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


def _numbers(rig: BearingRig) -> str:
    """Return the plant as structures."""
    settings, numbers = rig.settings, plant_numbers(rig)
    circuit = circuit_numbers(settings.magnet.poles, settings.magnet.eddy_time_s,
                              settings.gap_m)  # fmt: skip
    winding = {key: circuit.pop(key) for key in ("turns", "resistance")}
    solid = settings.magnet.solid_iron
    slab: dict[str, object] = {"volumes": 0}
    if solid is not None:
        share, drag = solid.numbers()
        part = solid.length / settings.magnet.poles.iron_length
        slab = {"volumes": solid.volumes, "part": part, "share": row(share), "drag": row(drag)}
    magnet = _fields({"circuit": "&bearing_circuit", "law": "NULL", **winding})
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
        f"static const anhyst_plant_solid bearing_solid = {_fields(slab)};\n"
        "static const anhyst_plant_circuit bearing_circuit = "
        f"{_fields({'iron': _iron(rig), **circuit, 'solid': '&bearing_solid' if solid else 'NULL'})};\n"
        f"static const anhyst_plant_actuator bearing_actuators[] = {_fields(actuators)};\n"
        f"static const anhyst_plant_head bearing_heads[] = {_fields(numbers.heads)};\n"
        f"static const anhyst_plant_body bearing = {_fields(bearing)};\n\n"
    )
    defined = {
        "BEARING_MAGNETS": len(rig.magnets),
        "BEARING_VOLUMES": max(1, solid.volumes if solid else 0),
        "BEARING_SEED": f"UINT64_C({noise_seed(rig, 0)})",
        "BEARING_HEADS": len(numbers.heads),
        "BEARING_CURRENT_LOOPS": _fields(current_loops(rig)),
    }
    return header("bearing_numbers", defined, text)


def _variables(
    rig: BearingRig, controller: ControllerFile, manifest: Mapping[str, Any]
) -> list[Variable]:
    limits, load = controller.settings.limits, rig.settings.load
    codes = ", ".join(f"{one.value} {one.name.lower()}" for one in Command)
    middle, ends = rig.settings.gap_m, (limits.gap_low_m, limits.gap_high_m)
    found = [
        Variable("target_gap", "input", "m", "wanted gap", middle, *ends),
        Variable("load", "input", "N", "of the load drive; opens the gap", load.force_N),
        Variable("command", "input", "1", f"acts when it changes: {codes}", 0.0, 0.0, 6.0),
        Variable("gap_read", "output", "m", "as the position sensor said at the last tick"),
        Variable("reference_gap", "output", "m", "to which is controlled"),
        Variable("demand", "output", "N", "wanted net force"),
        Variable("state", "output", "1", "of the controller: 16*state + phase"),
        Variable("flags", "output", "1", "of the controller"),
        Variable("gap", "output", "m", "true gap"),
        Variable("velocity", "output", "m/s", "of the armature; the gap opens"),
        Variable("force", "output", "N", "of the magnets, net"),
    ]
    return found + _of_magnets(manifest["controller"]["magnets"])


def _stage_variables(rig: StageRig) -> list[Variable]:
    begin, gap = -rig.gap, "gap of the first magnet"
    found = [
        Variable("reference", "input", "m", "wanted position"),
        Variable("feedforward", "input", "N", "net force that is fed forward"),
        Variable(
            "frame", "input", "m", "of the long stroke at the end of the tick; begins here", begin
        ),
        Variable("load", "input", "N", "pushes the body towards larger positions"),
        Variable("position_noise", "input", "m", "added to the position that is read"),
        Variable("position", "output", "m", "true position"),
        Variable("position_read", "output", "m", "as the controller had it at the last tick"),
        Variable("gap_read", "output", "m", f"{gap}, as its sensor said at the last tick"),
        Variable("demand", "output", "N", "wanted net force; the first magnet pulls along it"),
        Variable("gap", "output", "m", f"true {gap}"),
        Variable("velocity", "output", "m/s", "of the body"),
        Variable("force", "output", "N", "of the magnets, net, with the sign of the demand"),
    ]
    return found + _of_magnets(len(rig.bearing.magnets))


def _of_magnets(count: int) -> list[Variable]:
    found = []
    for number in range(1, count + 1):
        which = f"of magnet {number}"
        found += [
            Variable(f"current_{number}", "output", "A", which),
            Variable(f"flux_density_{number}", "output", "T", f"in the gap, {which}"),
            Variable(f"command_current_{number}", "output", "A", f"reference {which}"),
        ]
    return found
