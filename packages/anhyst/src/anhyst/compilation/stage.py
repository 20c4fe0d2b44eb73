"""Write the controller of a stage as C, with its constants, its magnets and its build files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.block import Block
from anhyst.compensate.current_map import CurrentMap, PlayMap
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import HysteresisInverse
from anhyst.compilation.parameters import (
    define_parameters,
    float_list,
    float_literal,
    table_initialiser,
    wrap_row,
)
from anhyst.compilation.play_source import play_initialiser
from anhyst.compilation.source import PORT_HEADER, escape_comment, render
from anhyst.compilation.toolchain import (
    AXES_SOURCES_F32,
    AXES_SOURCES_FIXED,
    CORRECTED_SOURCES_F32,
    FORCE_SOURCES_CODED,
    FORCE_SOURCES_F32,
    FORCE_SOURCES_FIXED,
    KIND_SOURCES,
    KIND_SOURCES_F32,
    PLAY_MAP_SOURCES_F32,
    PLAY_MAP_SOURCES_FIXED,
    SOURCE_FOLDER,
    core_files,
    read_core,
)
from anhyst.control.fixed_axes import FixedController, make_feedforward_rows
from anhyst.support.block_words import SignalUnits
from anhyst.support.numeric import FloatArray
from anhyst.support.units import Quantity

LOST_MAGNET_ROWS = 200
"""Number of last rows of the golden vectors, in which the first magnet is lost."""
FORCE_CURRENT_UNITS = SignalUnits("N", "A")
GAP_QUANTITY = Quantity("gap", "gap", "m")
TABLE_COMMENTS = {
    "pull": "Wrench of 1 N of each magnet, N and N m, one row per magnet.",
    "see": "Pose from the readings of the heads, one row per coordinate.",
    "decouple": "Error of the centre of mass from the error of the pose, one row per coordinate.",
    "reach": "Largest plausible error of each coordinate, m and rad.",
    "weigh": "Wrench from accelerations of the centre of mass, one row per coordinate.",
    "mass": "Masses and moments of inertia about the reference point of the pose.",
    "weight": "Wrench of the weight, N and N m.",
    "yields": "Relative weight with which each coordinate is given up if a magnet is lost.",
    "land": "Change of the target per tick while the body is set down, m and rad.",
    "lift": "Largest change of the target per tick at lift-off, m and rad.",
    "without": "Pose without each head in turn; zeros if the other heads do not determine it.",
}
"""Tables of the controller with their comments, in the order of the C file."""
FIXED_TABLE_COMMENTS = {
    "whole": "Least-squares forces of a wrench, one row per magnet.",
    "yields": "Least-squares forces if coordinates may be given up, one row per magnet.",
    **{key: TABLE_COMMENTS[key] for key in TABLE_COMMENTS if key not in ("pull", "yields")},
}
"""Tables of a controller in fixed point; their values are codes."""
SHIFT_COMMENT = "Number of fractional bits of each row of this table."
REMAINDER_COMMENT = "Projection of forces onto forces without a wrench, q30, one row per magnet."


@dataclass(frozen=True)
class StageController:
    """All constants of the controller of a stage, in SI units."""

    name: str  # name in C
    rig: str  # name of the rig file
    sha256: str  # SHA-256 of the rig file
    kind: str  # method from force to current
    rate: float  # sample rate, Hz
    feedforward_lead: float  # time by which the feedforward leads the setpoint, s
    free: Sequence[str]  # names of the controlled coordinates
    # tables of TABLE_COMMENTS; `at`: reading of each head for a pose; `pid`: one filter per
    # coordinate
    rows: Mapping[str, FloatArray]
    opponents: Sequence[int]  # index of the opposing magnet; its own index without one
    # allocation, idle force, limits of the currents, and criteria for a lost magnet
    settings: Mapping[str, float]
    force_min: float  # smallest force of a magnet without an opponent, N
    force_max: float  # largest force of each magnet, N
    magnets: Sequence[ForceController]  # force controllers, in single precision or in fixed point
    correction: FloatArray | None  # calibration corrections; one row per magnet
    fixed_controller: FixedController | None = None  # other constants, in fixed point

    @property
    def distinct_magnets(self) -> list[ForceController]:
        """Magnets with different parameters."""
        magnets: list[ForceController] = []
        for magnet in self.magnets:
            if not any(magnet.parameters is earlier_magnet.parameters for earlier_magnet in magnets):
                magnets.append(magnet)
        return magnets

    def parameters_name(self, magnet: ForceController) -> str:
        """Return the C name of the parameters of a magnet."""
        index = [other.parameters is magnet.parameters for other in self.distinct_magnets].index(True)
        return self.name if index == 0 else f"{self.name}_{index + 1}"

    @property
    def is_fixed(self) -> bool:
        """Whether the force controllers use fixed point."""
        return self.magnets[0].format == "fixed"

    @property
    def core_sources(self) -> tuple[str, ...]:
        """Sources of the core."""
        parameters = self.magnets[0].parameters
        law_sources: tuple[str, ...] = ()
        if isinstance(parameters, HysteresisInverse):
            block = parameters.block
            law_sources = (KIND_SOURCES if self.is_fixed else KIND_SOURCES_F32)[block.kind]
        elif isinstance(parameters, PlayMap):
            law_sources = PLAY_MAP_SOURCES_FIXED if self.is_fixed else PLAY_MAP_SOURCES_F32
        if self.fixed_controller is not None:
            return tuple(dict.fromkeys((*AXES_SOURCES_FIXED, *FORCE_SOURCES_FIXED, *law_sources)))
        force = FORCE_SOURCES_CODED if self.is_fixed else FORCE_SOURCES_F32
        correction_sources = () if self.correction is None else CORRECTED_SOURCES_F32
        return tuple(dict.fromkeys((*AXES_SOURCES_F32, *force, *law_sources, *correction_sources)))

    @property
    def parameters_bytes(self) -> int:
        """Size of the parameters of all magnets with 32-bit pointers, bytes."""
        return sum(_parameter_bytes(magnet) for magnet in self.distinct_magnets)


def make_stage_sources(stage: StageController, version: str, vector_rows: int) -> dict[str, str]:
    """Return the C files and build files; the golden vectors have `vector_rows` rows."""
    name = stage.name
    values = _template_values(stage, version) | {"rows": vector_rows}
    files = core_files(stage.core_sources, max(memory_counts(stage)))
    for magnet in stage.distinct_magnets:
        parameters_name = stage.parameters_name(magnet)
        files[f"{parameters_name}_parameters.c"] = (
            f'/* SPDX-License-Identifier: Apache-2.0 */\n#include "{name}_controller.h"\n\n'
            f"/* clang-format off */\n{_parameter_definitions(parameters_name, magnet)}\n"
        )
    if stage.is_fixed:
        files[PORT_HEADER] = read_core(PORT_HEADER)
    return files | {
        f"{name}_controller.h": render("stage_controller.h.j2", values),
        f"{name}_controller.c": render("stage_controller.c.j2", values),
        "main.c": render("stage_main.c.j2", values),
        "anhyst.mk": render("anhyst.mk.j2", values | {"own": values["sources"]}),
        "anhyst.cmake": render("anhyst.cmake.j2", values | {"own": values["sources"]}),
        "DROP_IN.md": render("stage_drop_in.md.j2", values),
    }


def memory_counts(stage: StageController) -> list[int]:
    """Return the number of hysteresis states of each distinct magnet."""
    methods = [magnet.parameters for magnet in stage.distinct_magnets]
    return [m.block.memory_count if isinstance(m, HysteresisInverse) else 1 for m in methods]


def _kernel_name(block: Block) -> str:
    return f"anhyst_kernel_{block.kind}{'' if block.is_fixed else '_f32'}"


def _template_values(stage: StageController, version: str) -> dict[str, object]:
    """Return the values for the templates."""
    settings, scales = stage.settings, stage.magnets[0].scales
    return {
        "name": stage.name,
        "macro": stage.name.upper(),
        "rig": escape_comment(stage.rig),
        "sha256": stage.sha256,
        "version": version,
        "kind": stage.kind,
        "rate": f"{stage.rate:.10g}",
        "ahead_ms": f"{1e3 * stage.feedforward_lead:.6g}",
        "free": list(stage.free),
        "heads": len(stage.rows["at"]),
        "magnets": len(stage.magnets),
        "gap_low": float_literal(scales.gap_low),
        "gap_high": float_literal(scales.gap_high),
        "gap_low_mm": f"{1e3 * scales.gap_low:.6g}",
        "gap_high_mm": f"{1e3 * scales.gap_high:.6g}",
        "force_max": float_literal(stage.force_max),
        **{f"current_{end}": settings[f"current_{end}"] for end in ("low", "high", "step")},
        "watched": settings["off"] > 0.0,
        "off_A": f"{settings['off']:.6g}",
        "dead": LOST_MAGNET_ROWS,
        "at": f"{{{', '.join(_row_text(row, repr) for row in stage.rows['at'].tolist())}}}",
        "against": list(stage.opponents),
        "allocation": f"{int(settings['allocation'])}U",
        "corrected": [] if stage.correction is None else [_row_text(r) for r in stage.correction.tolist()],
        "core": sorted(f"{SOURCE_FOLDER}/{file}" for file in stage.core_sources),
        "real": stage.fixed_controller is None,
        "port": stage.is_fixed,
        "parameters_bytes": stage.parameters_bytes,
        **(
            _real_values(stage)
            if stage.fixed_controller is None
            else _code_values(stage, stage.fixed_controller)
        ),
        **_magnet_values(stage),
    }


INTEGER_SETTINGS = ("off_ticks", "spare", "land_ticks", "spare_heads", "doubt", "noisy")


def _real_values(stage: StageController) -> dict[str, object]:
    """Return the values for pose, PIDs and allocation in single precision."""
    settings = stage.settings
    values = {key: settings[key] for key in ("idle", "follow", "slew", "off", "jump")}
    values |= {end: settings[f"current_{end}"] for end in ("low", "high", "step")}
    return {
        "io": "f32",
        "number": "float",
        "codes": False,
        "tables": [(_table_text(key, stage.rows[key]), doc) for key, doc in TABLE_COMMENTS.items()],
        "pid": [f"{{{_row_text(row[:3])}, {_row_text(row[3:])}}}" for row in stage.rows["pid"].tolist()],
        **{key: float_literal(value) for key, value in values.items()},
        "least": float_literal(stage.force_min),
        "most": f"{stage.name.upper()}_CONTROLLER_FORCE_MAX_N",
        **{key: int(settings[key]) for key in INTEGER_SETTINGS},
    }


def _code_values(stage: StageController, codes: FixedController) -> dict[str, object]:
    """Return the values for pose, PIDs and allocation in fixed point."""
    numbers, scales, words = codes.integers, codes.scales, dict(codes.words)
    feedforward = make_feedforward_rows(stage.rows["mass"], stage.rows["weight"], scales)
    words |= dict(zip(("mass", "mass_shift", "weight"), feedforward, strict=True))
    tables = [(key, key, doc) for key, doc in FIXED_TABLE_COMMENTS.items()]
    tables += [(f"{key}_shift", key, SHIFT_COMMENT) for key in words if f"{key}_shift" in words]
    tables += [(key, key, REMAINDER_COMMENT) for key in ("whole_apart", "yields_apart")]
    return {
        "io": "q31",
        "number": "int32_t",
        "codes": True,
        "full": {
            "head": float_literal(scales.head),
            "acceleration": _row_text(scales.acceleration.tolist()),
            "wrench": _row_text(scales.wrench.tolist()),
            "current": float_literal(scales.current),
        },
        "tables": [(_table_text(name, words[name], is_integer=True), doc) for name, _, doc in tables],
        "pid": [f"{{{', '.join(str(int(word)) for word in row)}}}" for row in words["pid"].tolist()],
        **{key: numbers[f"current_{key}"] for key in ("low", "high", "step")},
        **{key: numbers[key] for key in ("idle", "least", "most", "follow", "slew", "off", "jump")},
        **{key: numbers[key] for key in INTEGER_SETTINGS},
    }


def _magnet_values(stage: StageController) -> dict[str, object]:
    """Return the values for the force controllers."""
    parameters, scales = stage.magnets[0].parameters, stage.magnets[0].scales
    table, number_format = _find_map(parameters), "q31" if stage.is_fixed else "f32"
    low, high = ("", "") if table is None else map(float_literal, table.limits)
    if table is not None and stage.is_fixed:
        low, high = map(str, table.limit_codes())
    by_parameters = [
        (stage.parameters_name(magnet), _word_count(magnet)) for magnet in stage.distinct_magnets
    ]
    by_magnet = [(stage.parameters_name(magnet), _word_count(magnet)) for magnet in stage.magnets]
    block = parameters.block if isinstance(parameters, HysteresisInverse) else None
    play = isinstance(stage.magnets[0].parameters, PlayMap)
    headers = ["force_by_play.h" if stage.is_fixed else "force_by_play_real.h"] * play
    uses_coded_controllers = stage.is_fixed and stage.fixed_controller is None
    headers += ["force_coded_real.h"] * uses_coded_controllers
    headers += ["force_corrected_real.h"] * (stage.correction is not None)
    return {
        "type": _parameter_type(parameters, number_format),
        "play": isinstance(parameters, PlayMap),
        "map": table is not None,
        "map_low": low,
        "map_high": high,
        "fixed": stage.is_fixed,
        "law": number_format,
        "coded": uses_coded_controllers,
        "inner": "inner" if uses_coded_controllers else "magnet",
        "kernel": "" if block is None else _kernel_name(block),
        "memories": 1 if block is None else max(memory_counts(stage)),
        "scales": _row_text((scales.demand, scales.current, 1.0, scales.gap_low, scales.gap_high)),
        "words": [f"{part.upper()}_PARAMETERS_WORDS" for part, words in by_magnet if words],
        "headers": headers,
        "parts": by_parameters,
        "own": [f"{'' if words else '&'}{part}_parameters" for part, words in by_magnet],
        "sources": [f"{part}_parameters.c" for part, _ in by_parameters] + [f"{stage.name}_controller.c"],
    }


def _word_count(magnet: ForceController) -> int:
    """Return the number of words of a block; 0 if the method has no block."""
    if isinstance(magnet.parameters, PlayMap):
        return magnet.parameters.block(magnet.format).size
    block = getattr(magnet.parameters, "block", None)
    return block.words.size if isinstance(block, Block) else 0


def _parameter_type(parameters: object, number_format: str) -> str:
    if isinstance(parameters, HysteresisInverse):
        return parameters.block.c_type
    if isinstance(parameters, PlayMap):
        return "int16_t" if number_format == "q31" else "float"
    return f"anhyst_map_{number_format}"


def _find_map(parameters: object) -> CurrentMap | None:
    if isinstance(parameters, PlayMap):
        return parameters.map
    return parameters if isinstance(parameters, CurrentMap) else None


def _row_text(values: Sequence[float], to_text: object = float_literal) -> str:
    assert callable(to_text)
    return f"{{{', '.join(to_text(value) for value in values)}}}"


def _table_text(name: str, values: FloatArray, *, is_integer: bool = False) -> dict[str, object]:
    lines = values.tolist() if values.ndim == 2 else [values.tolist()]
    rows = [float_list(line) for line in lines]
    kind = "float"
    if is_integer:
        rows = [", ".join(str(int(value)) for value in line) for line in lines]
        kind = "uint16_t" if name.endswith("_shift") else "int32_t"
    return {"name": name, "type": kind, "count": values.size, "rows": rows}


def _parameter_definitions(name: str, magnet: ForceController) -> str:
    """Return the definitions of the parameters of a magnet's method."""
    parameters, is_fixed = magnet.parameters, magnet.format == "fixed"
    if isinstance(parameters, HysteresisInverse):
        word_count_macro = f"{name.upper()}_PARAMETERS_WORDS"
        return define_parameters(name, word_count_macro, parameters.block, FORCE_CURRENT_UNITS, GAP_QUANTITY)
    if isinstance(parameters, PlayMap):
        rows = play_initialiser(parameters.block(magnet.format))
        size, kind = f"{name.upper()}_PARAMETERS_WORDS", "int16_t" if is_fixed else "float"
        return f"const {kind} {name}_parameters[{size}] = {{\n{rows}\n}};"
    table, number_format = _find_map(parameters), "q31" if is_fixed else "f32"
    assert table is not None
    words = table.entry_words() if is_fixed else table.entries
    entries = _table_definition("entries", "Current over force and gap", words)
    return f"{entries}\n\nconst anhyst_map_{number_format} {name}_parameters = {_map_text('entries', table, is_fixed)};"


def _table_definition(name: str, doc: str, values: NDArray[np.int16] | FloatArray) -> str:
    """Return the definition of a table: q15 words or A; one row per gap."""
    if values.dtype == np.int16:
        kind, unit, lines = "int16_t", "q15", [table_initialiser(values.astype(np.int16))]
    else:
        kind, unit = "float", "A"
        lines = [line for row in values.tolist() for line in wrap_row(float_list(row))]
    head = f"/* {doc}, {unit}; one row per gap. */"
    return "\n".join([head, f"static const {kind} {name}[{values.size}] = {{", *lines, "};"])


def _map_text(entries: str, table: CurrentMap, is_fixed: bool) -> str:
    rows, columns = table.entries.shape
    if is_fixed:
        return f"{{{entries}, {(columns - 2).bit_length()}, {(rows - 2).bit_length()}}}"
    return f"{{{entries}, {columns - 1}, {rows - 1}, {', '.join(map(float_literal, table.table_range))}}}"


def _parameter_bytes(magnet: ForceController) -> int:
    parameters, is_fixed = magnet.parameters, magnet.format == "fixed"
    if isinstance(parameters, HysteresisInverse):
        return parameters.block.size
    if isinstance(parameters, PlayMap):
        return parameters.block(magnet.format).nbytes
    table = _find_map(parameters)
    assert table is not None
    return 2 * table.entries.size + 8 if is_fixed else 4 * table.entries.size + 4 + 2 * 2 + 4 * 4
