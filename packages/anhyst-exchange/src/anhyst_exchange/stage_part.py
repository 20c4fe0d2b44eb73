"""A whole virtual stage as a component: its plant and its controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from anhyst.compilation.toolchain import SOURCES
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst_exchange.bearing_part import (
    CORE_OF_PLANT,
    FORMATS,
    fields,
    magnet_variables,
    numbers_of_plant,
    plant_sources,
    refuse_plant,
)
from anhyst_exchange.part import Causality, Part, Variable, header, kernel_of, row
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.recording import column
from anhyst_rigs.rig.stage.drives import least_of, opposed, watch_settings, yields
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage, make_stage
from anhyst_rigs.rig.stage.geometry import pull_rows, unit_of
from anhyst_rigs.rig.stage.loop import StageSetup, axes_rows, blocks_of, controller_settings
from anhyst_rigs.study.tracking.simulate import check_calibration

_CORE_OF_STAGE = (
    *(name for name in CORE_OF_PLANT if not name.startswith("control/")),
    *(
        f"compensator/{name}_{of}.c"
        for name in ("force_corrected", "force_coded")
        for of in FORMATS
    ),
    *(f"control/{name}_{of}.c" for name in ("axes", "wrench") for of in FORMATS),
    *(name for kind in SOURCES.values() for name in kind),
    *("compensator/map.c", "compensator/force_controller.c"),
    *(f"control/{name}_{of}.c" for name in ("allocation", "biquad") for of in FORMATS),
)
"""What the plant of a stage and its controller name."""


def stage_part(rig_path: PathLike) -> Part:
    """Return a stage with its controller: set-point and feedforward in; position, force out.

    It ticks at the rate of the controller; the compensator is ``full``, as the rig file has it.
    """
    rig = read_stage(rig_path)
    _refuse_stage(rig)
    refuse_plant(rig)
    setup = make_stage(rig, identify_stage(rig), "full")
    layers = max(block.memories for block in blocks_of(setup))
    files = ("stage.c", "stage_controller.c", "stage_controller.h", "virtual_plant.h")
    sources = plant_sources("piezo|position|held", _CORE_OF_STAGE, files, layers)
    sources["bearing_numbers.h"] = numbers_of_plant(rig).encode()
    sources["stage_numbers.h"] = _controller_numbers(setup, _words(setup)).encode()
    title = rig.settings.name
    precision = "fixed point" if setup.compensator.format == "fixed" else "double precision"
    text = f"{title}, led by PID and feedforward, full in {precision}"
    return Part(title, text, rig.settings.timing.rate_Hz, _stage_variables(rig), sources)


def _refuse_stage(rig: BodyRig) -> None:
    control = rig.settings.tracking
    if control.format == "f32":
        raise InputError(
            f"{rig.path}: an FMU holds compensators in fixed point or in double precision; write "
            'format = "fixed" or "f64"',
            code="not-compiled-controller",
            key="control.format",
        )
    if rig.settings.heads_stand:
        raise InputError(
            f"{rig.path}: sensor.stands: an FMU of a stage has no heads on the ground; leave it out",
            code="not-compiled-controller",
            key="sensor.stands",
        )
    if control.calibrate:
        raise InputError(
            f"{rig.path}: control.calibrate: an FMU of a stage does not learn; name what anhyst "
            "calibrate found as control.calibration",
            code="learning-not-exported",
            key="control.calibrate",
        )
    check_calibration(rig)


def _words(setup: StageSetup) -> dict[str, object]:
    """Return the words of the compensators as macros, those of like magnets once."""
    blocks, numbers = blocks_of(setup), controller_settings(setup)
    is_fixed = blocks[0].is_fixed
    each = [tuple(block.words.tolist()) for block in blocks]
    words: list[float] = []
    first: dict[tuple[float, ...], int] = {}
    for one in dict.fromkeys(each):
        first[one] = len(words)
        words += one
    scales = ("demand_full", "current_full", "flux_full", "gap_low", "gap_high")
    kernel = f"anhyst_kernel_{blocks[0].kind}{'' if is_fixed else '_f64'}"
    macros: dict[str, object] = {
        "STAGE_KERNEL": kernel_of(kernel, "words"),
        "STAGE_WORD": blocks[0].c_type,
        "STAGE_WORDS": fields(words if is_fixed else [repr(word) for word in words]),
        "STAGE_BLOCKS": fields([[first[one], len(one)] for one in each]),
    }
    if is_fixed:
        macros["STAGE_CODES"] = row([float(numbers[name]) for name in scales])
    return macros


def _controller_numbers(setup: StageSetup, compensators: Mapping[str, object]) -> str:
    """Return the controller of a stage as structures."""
    settings, count = controller_settings(setup), len(setup.rig.settings.placed)
    corrections = [[1.0, 0.0, 1.0, 0.0]] * count
    if setup.correction is not None:
        corrections = setup.correction.tolist()
    file, numbers = setup.rig.settings, {key: repr(float(value)) for key, value in settings.items()}
    pair = {"idle": numbers["idle"], "kind": int(settings["allocation"])}
    rows = axes_rows(setup)
    law = _law_of_axes(file, rows, pair) | watch_settings(setup.rig)
    law |= {f"current_{name}": numbers[f"current_{name}"] for name in ("low", "high", "step")}
    return header(
        "stage_numbers",
        {
            "STAGE_DRIVES": count,
            "STAGE_HEADS": len(file.position_sensors),
            **compensators,
            "STAGE_CORRECTIONS": fields([*map(row, corrections)]),
            **{f"STAGE_{name.upper()}": row(rows[name].ravel()) for name in ("see", "at")},
            "STAGE_SETTINGS": fields(law),
        },
    )


def _law_of_axes(
    file: RigFile, rows: Mapping[str, FloatArray], pair: Mapping[str, object]
) -> dict[str, object]:
    """Return the settings of a controller but its currents."""
    pull = pull_rows(file)
    return {
        "layout": {
            "axes": pull.shape[1],
            "drives": pull.shape[0],
            "pull": f"(const double[]){row(pull.ravel())}",
            "against": f"(const uint16_t[]){fields(opposed(file))}",
            "pair": pair,
            "least": least_of(file),
            "most": file.tracking.force_max_N,
            "yields": f"(const double[]){row(yields(file))}",
        },
        "heads": len(file.position_sensors),
        **{
            name: f"(const double[]){row(rows[name].ravel())}"
            for name in ("see", "decouple", "weigh", "reach", "land", "lift", "without")
        },
        "pid": f"(const anhyst_biquad_f64[]){fields([*map(biquad, rows['pid'].tolist())])}",
    }


def biquad(numbers: Sequence[float]) -> dict[str, str]:
    """Return a filter of second order as a structure."""
    return {"forward": row(numbers[:3]), "back": row(numbers[3:])}


def _stage_variables(rig: BodyRig) -> list[Variable]:
    """Return what goes in and comes out, by the names of recordings: an array a coordinate or magnet."""
    file = rig.settings
    count = len(file.placed)

    def each(
        signal: str, causality: Causality, text: str, units: _Units = _PLACE
    ) -> list[Variable]:
        named = ((axis, units[unit_of(axis) == "rad"]) for axis in file.body.free)
        return [
            Variable(f"{signal}_{axis}_{ending}", causality, unit, text, 0.0)
            for axis, (ending, unit) in named
        ]

    stroke = "of the long stroke at the end of the tick"
    gap = "gap at the magnet, as its sensor said at the last tick"
    # that of a single coordinate is the force
    wrench = each("wrench", "output", "of the magnets", _WRENCH) if len(file.body.free) > 1 else []
    of_controller = {"state": "16*state + phase + 256*(highest magnet lost)", "flags": "flags"}
    states = [
        Variable(name, "output", "1", f"of the controller: {text}")
        for name, text in of_controller.items()
    ]
    return [
        *each("reference", "input", "wanted position"),
        *each("feedforward", "input", "net force that is fed forward", _WRENCH),
        *each("frame", "input", f"{stroke}; begins here"),
        Variable("load_N", "input", "N", "pushes the body along the set-point"),
        *each("position_noise", "input", "added to the pose that is read"),
        Variable("command", "input", "1", _COMMANDS, 0.0, 0.0, 7.0),
        *each("pose", "output", "true position"),
        *each("pose_read", "output", "position as the controller had it at the last tick"),
        *(
            Variable(column("gap_read", "m", number), "output", "m", gap)
            for number in range(1, count + 1)
        ),
        *each("demand", "output", "wanted net force", _WRENCH),
        *states,
        *each("velocity", "output", "of the body", _VELOCITY),
        *wrench,
        *magnet_variables("of the magnets, net, along the set-point", count),
    ]


_COMMANDS = "acts when it changes: " + ", ".join(
    f"{one.value} {one.name.lower()}"
    for one in (Command.NONE, Command.LIFT, Command.LAND, Command.IDLE)
)

_Units = tuple[tuple[str, str], tuple[str, str]]
"""Of a displacement and of an angle, each as names end with it and as tools read it."""
_PLACE: _Units = (("m", "m"), ("rad", "rad"))
_VELOCITY: _Units = (("m_per_s", "m/s"), ("rad_per_s", "rad/s"))
_WRENCH: _Units = (("N", "N"), ("N_m", "N.m"))
