"""A complete virtual stage as a component: its plant and its controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from anhyst.compilation.toolchain import KIND_SOURCES
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst_exchange.bearing_part import (
    FLOAT_FORMATS,
    PLANT_CORE_FILES,
    c_initialiser,
    magnet_variables,
    plant_header,
    plant_sources,
    require_iron_magnet,
)
from anhyst_exchange.part import Causality, Part, Variable, c_array_literal, header_text, kernel_expression
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.recording import column_name
from anhyst_rigs.rig.stage.drives import (
    axis_yield_weights,
    min_single_force,
    monitoring_settings,
    opposing_magnets,
)
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.geometry import axis_unit, magnet_rows
from anhyst_rigs.rig.stage.loop import StageSetup, controller_matrices, controller_settings, parameter_blocks
from anhyst_rigs.study.tracking.simulate import check_calibration

_STAGE_CORE_FILES = (
    *(name for name in PLANT_CORE_FILES if not name.startswith("control/")),
    *(f"compensator/{name}_{of}.c" for name in ("force_corrected", "force_coded") for of in FLOAT_FORMATS),
    *(f"control/{name}_{of}.c" for name in ("axes", "wrench") for of in FLOAT_FORMATS),
    *(name for kind in KIND_SOURCES.values() for name in kind),
    *("compensator/map.c", "compensator/force_controller.c"),
    *(f"control/{name}_{of}.c" for name in ("allocation", "biquad") for of in FLOAT_FORMATS),
)
"""C files of the core that the plant of a stage and its controller need."""


def stage_part(rig_path: PathLike) -> Part:
    """Return a stage with its controller as a component.

    The inputs are the set-point and the feedforward; the outputs are the position and the force.
    The component runs at the rate of the controller. The compensator is ``full``, in the format of
    the rig file.
    """
    rig = read_stage(rig_path)
    _refuse_stage(rig)
    require_iron_magnet(rig)
    stage_setup = make_stage(rig, identify_stage_magnet(rig), "full")
    memory_count = max(block.memory_count for block in parameter_blocks(stage_setup))
    files = ("stage.c", "stage_controller.c", "stage_controller.h", "virtual_plant.h")
    sources = plant_sources("piezo|position|held", _STAGE_CORE_FILES, files, memory_count)
    sources["bearing_numbers.h"] = plant_header(rig).encode()
    sources["stage_numbers.h"] = _controller_header(stage_setup, _compensator_macros(stage_setup)).encode()
    title = rig.settings.name
    precision_text = "fixed point" if stage_setup.compensator.format == "fixed" else "double precision"
    text = f"{title}, controlled by PID and feedforward, full in {precision_text}"
    return Part(title, text, rig.settings.timing.rate_Hz, _stage_variables(rig), sources)


def _refuse_stage(rig: BodyRig) -> None:
    control = rig.settings.tracking
    if control.format == "f32":
        raise InputError(
            f"{rig.path}: an FMU contains compensators in fixed point or in double precision; write "
            'format = "fixed" or "f64"',
            code="not-compiled-controller",
            key="control.format",
        )
    if rig.settings.has_ground_heads:
        raise InputError(
            f"{rig.path}: sensor.stands: an FMU of a stage does not support heads on the ground; remove the key",
            code="not-compiled-controller",
            key="sensor.stands",
        )
    if control.calibrate:
        raise InputError(
            f"{rig.path}: control.calibrate: an FMU of a stage does not calibrate itself; name the "
            "file of anhyst calibrate as control.calibration",
            code="learning-not-exported",
            key="control.calibrate",
        )
    check_calibration(rig)


def _compensator_macros(setup: StageSetup) -> dict[str, object]:
    """Return the parameter blocks of the compensators as macros; equal magnets share a block."""
    blocks, numbers = parameter_blocks(setup), controller_settings(setup)
    is_fixed = blocks[0].is_fixed
    words_of_magnets = [tuple(block.words.tolist()) for block in blocks]
    words: list[float] = []
    first_index: dict[tuple[float, ...], int] = {}
    for block_words in dict.fromkeys(words_of_magnets):
        first_index[block_words] = len(words)
        words += block_words
    scales = ("demand_full", "current_full", "flux_full", "gap_low", "gap_high")
    kernel = f"anhyst_kernel_{blocks[0].kind}{'' if is_fixed else '_f64'}"
    macros: dict[str, object] = {
        "STAGE_KERNEL": kernel_expression(kernel, "words"),
        "STAGE_WORD": blocks[0].c_type,
        "STAGE_WORDS": c_initialiser(words if is_fixed else [repr(word) for word in words]),
        "STAGE_BLOCKS": c_initialiser([[first_index[block], len(block)] for block in words_of_magnets]),
    }
    if is_fixed:
        macros["STAGE_CODES"] = c_array_literal([float(numbers[name]) for name in scales])
    return macros


def _controller_header(setup: StageSetup, compensators: Mapping[str, object]) -> str:
    """Return the header with the parameters of the controller."""
    settings, count = controller_settings(setup), len(setup.rig.settings.body_magnets)
    corrections = [[1.0, 0.0, 1.0, 0.0]] * count
    if setup.correction_rows is not None:
        corrections = setup.correction_rows.tolist()
    file, numbers = setup.rig.settings, {key: repr(float(value)) for key, value in settings.items()}
    allocation = {"idle": numbers["idle"], "kind": int(settings["allocation"])}
    rows = controller_matrices(setup)
    control_law = _axes_settings(file, rows, allocation) | monitoring_settings(setup.rig)
    control_law |= {f"current_{name}": numbers[f"current_{name}"] for name in ("low", "high", "step")}
    return header_text(
        "stage_numbers",
        {
            "STAGE_DRIVES": count,
            "STAGE_HEADS": len(file.position_sensors),
            **compensators,
            "STAGE_CORRECTIONS": c_initialiser([*map(c_array_literal, corrections)]),
            **{f"STAGE_{name.upper()}": c_array_literal(rows[name].ravel()) for name in ("see", "at")},
            "STAGE_SETTINGS": c_initialiser(control_law),
        },
    )


def _axes_settings(
    file: RigFile, rows: Mapping[str, FloatArray], allocation: Mapping[str, object]
) -> dict[str, object]:
    """Return the settings of the controller, without its current limits."""
    pull_rows = magnet_rows(file)
    return {
        "layout": {
            "axes": pull_rows.shape[1],
            "drives": pull_rows.shape[0],
            "pull": f"(const double[]){c_array_literal(pull_rows.ravel())}",
            "against": f"(const uint16_t[]){c_initialiser(opposing_magnets(file))}",
            "pair": allocation,
            "least": min_single_force(file),
            "most": file.tracking.force_max_N,
            "yields": f"(const double[]){c_array_literal(axis_yield_weights(file))}",
        },
        "heads": len(file.position_sensors),
        **{
            name: f"(const double[]){c_array_literal(rows[name].ravel())}"
            for name in ("see", "decouple", "weigh", "reach", "land", "lift", "without")
        },
        "pid": f"(const anhyst_biquad_f64[]){c_initialiser([*map(biquad_initialiser, rows['pid'].tolist())])}",
    }


def biquad_initialiser(numbers: Sequence[float]) -> dict[str, str]:
    """Return the C initialiser of a second-order filter."""
    return {"forward": c_array_literal(numbers[:3]), "back": c_array_literal(numbers[3:])}


def _stage_variables(rig: BodyRig) -> list[Variable]:
    """Return the inputs and outputs, per coordinate or magnet, with the names of recordings."""
    file = rig.settings
    count = len(file.body_magnets)

    def variables_of_axes(
        signal: str, causality: Causality, text: str, units: _AxisUnits = _POSITION_UNITS
    ) -> list[Variable]:
        units_of_axes = ((axis, units[axis_unit(axis) == "rad"]) for axis in file.body.free)
        return [
            Variable(f"{signal}_{axis}_{name_suffix}", causality, unit, text, 0.0)
            for axis, (name_suffix, unit) in units_of_axes
        ]

    stroke_text = "position of the long stroke at the end of the tick"
    gap = "gap at the magnet, reading of its sensor at the last tick"
    # for a single coordinate, force_N is the wrench
    wrench_variables = (
        variables_of_axes("wrench", "output", "wrench of the magnets", _WRENCH_UNITS)
        if len(file.body.free) > 1
        else []
    )
    controller_states = {
        "state": "state of the controller: 16*state + phase + 256*(highest lost magnet)",
        "flags": "flags of the controller",
    }
    state_variables = [Variable(name, "output", "1", text) for name, text in controller_states.items()]
    return [
        *variables_of_axes("reference", "input", "demanded position"),
        *variables_of_axes("feedforward", "input", "net force of the feedforward", _WRENCH_UNITS),
        *variables_of_axes("frame", "input", f"{stroke_text}; initial position"),
        Variable("load_N", "input", "N", "force on the body along the set-point"),
        *variables_of_axes("position_noise", "input", "noise that is added to the pose reading"),
        Variable("command", "input", "1", _COMMAND_TEXT, 0.0, 0.0, 7.0),
        *variables_of_axes("pose", "output", "true position"),
        *variables_of_axes("pose_read", "output", "position in the controller at the last tick"),
        *(
            Variable(column_name("gap_read", "m", number), "output", "m", gap)
            for number in range(1, count + 1)
        ),
        *variables_of_axes("demand", "output", "demanded net force", _WRENCH_UNITS),
        *state_variables,
        *variables_of_axes("velocity", "output", "velocity of the body", _VELOCITY_UNITS),
        *wrench_variables,
        *magnet_variables("net force of the magnets along the set-point", count),
    ]


_COMMAND_TEXT = "command, which acts when it changes: " + ", ".join(
    f"{code.value} {code.name.lower()}" for code in (Command.NONE, Command.LIFT, Command.LAND, Command.IDLE)
)

_AxisUnits = tuple[tuple[str, str], tuple[str, str]]
"""Units of a linear and of an angular quantity: each with its suffix in names and its unit for
tools."""
_POSITION_UNITS: _AxisUnits = (("m", "m"), ("rad", "rad"))
_VELOCITY_UNITS: _AxisUnits = (("m_per_s", "m/s"), ("rad_per_s", "rad/s"))
_WRENCH_UNITS: _AxisUnits = (("N", "N"), ("N_m", "N.m"))
