"""Memory that a compensator takes on a controller with pointers of 32 bits."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache

from anhyst._core import POSITION_MAGNETS
from anhyst.compensate.block import Block
from anhyst.compensate.floating import RealBlock
from anhyst.compensate.twin import AnyBlock
from anhyst.compilation.core import read_core
from anhyst.compilation.floating_source import memories

REAL_STATE_BYTES = 112
"""Of ``anhyst_compensator_f32``."""

DEEPER_BYTES = (5 + 12 + 5) * 4
"""Of ``anhyst_deeper_f32``, of each memory of solid iron beyond the first."""

SOLID_BYTES = 6 * 4 + 4
"""Of ``anhyst_solid_f32`` and the pointer to it."""

COMMON_BYTES = 4 * 4 + 9 * 4 + 4 + 4 * 2
"""Of ``anhyst_parameters_f32``: pointers to the law, numbers, pointer to the rows, counts."""

CELLS = 12
"""``ANHYST_CELLS``: plays of the law of cells that a compensator has room for."""

LAW_BYTES = {
    "full": 5 * 4 + 4 * 2 + 3 * 4,
    "simplified": 4 * 4 + 4 * 2 + 4,
    "cells": 3 * 4 + 4 * 2 + 2 * 4,
}
"""Of ``anhyst_full_law_f32`` and the like: numbers, counts, pointers."""


def parameters_bytes(block: AnyBlock) -> int:
    """Return the size of everything that is constant."""
    if isinstance(block, RealBlock):
        solid = SOLID_BYTES if memories(block) > 1 else 0
        return 4 * block.entries + COMMON_BYTES + LAW_BYTES[block.kind] + solid
    return block.size


def state_bytes(block: AnyBlock) -> int:
    """Return the size of everything that changes."""
    if isinstance(block, RealBlock):
        return REAL_STATE_BYTES + DEEPER_BYTES * (memories(block) - 1)
    sizes = _fixed_sizes()
    return sizes["anhyst_compensator"] + sizes["anhyst_deeper"] * (memories(block) - 1)


def controller_bytes(magnets: int, block: Block) -> int:
    """Return the size of everything that changes in a position controller and its force controllers."""
    headers = (
        *("control/supervisor.h", "control/levitation.h", "numeric/factor.h", "control/pidd2.h"),
        *("compensator/compensator.h", "compensator/force_controller.h"),
    )
    generic = ("compensator/generic/force_controller.h", "control/generic/position.h")
    sizes = _structures(
        *(read_core(f"include/anhyst/{name}") for name in headers),
        *(_in_q31(read_core(f"include/anhyst/{name}")) for name in generic),
        MAGNETS=POSITION_MAGNETS,
        CELLS=CELLS,
    )
    deeper = sizes["anhyst_deeper"] * (memories(block) - 1)
    return sizes["anhyst_position_q31"] + magnets * (sizes["anhyst_force_controller_q31"] + deeper)


def _in_q31(text: str) -> str:
    """Return the structures of a generic header as they are in fixed point."""
    return re.sub(r"ANHYST_NAME\((\w+)\)", r"\1_q31", text).replace("ANHYST_REAL", "int32_t")


@cache
def _fixed_sizes() -> dict[str, int]:
    return _structures(read_core("include/anhyst/compensator/compensator.h"), CELLS=CELLS)


def _structures(*texts: str, **numbers: int) -> dict[str, int]:
    """Add up the members of structures, short ones at the end, each a multiple of four bytes."""
    sizes = {"int32_t": 4, "uint16_t": 2, "int16_t": 2}
    for text in texts:
        plain = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
        sizes |= {name: sizes[same] for same, name in re.findall(r"typedef (\w+) (\w+);", plain)}
        for members, name in re.findall(r"typedef struct (?:\w+ )?\{([^}]*)\} (\w+);", plain):
            sizes[name] = -(-sum(_members(members, sizes, numbers)) // 4) * 4
    return sizes


def _members(text: str, sizes: dict[str, int], numbers: dict[str, int]) -> Iterator[int]:
    for kind, pointer, count in re.findall(
        r"(?:const )?(\w+)\s+(\*?)\w+(?:\[ANHYST_(?:POSITION_)?(\w+)\])?;", text
    ):
        yield (4 if pointer else sizes.get(kind, 0)) * (numbers[count] if count else 1)
