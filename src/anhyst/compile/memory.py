"""Memory that a compensator takes on a controller with pointers of 32 bits."""

from __future__ import annotations

import re
from functools import cache

from anhyst.compile.core import read_core
from anhyst.compile.floating import RealBlock
from anhyst.compile.measure import AnyBlock

REAL_STATE_BYTES = 64
"""Of ``anhyst_compensator_f32``."""

COMMON_BYTES = 3 * 4 + 9 * 4 + 4 + 4 * 2
"""Of ``anhyst_parameters_f32``: pointers to the law, numbers, pointer to the rows, counts."""

LAW_BYTES = {"full": 5 * 4 + 4 * 2 + 3 * 4, "simplified": 4 * 4 + 4 * 2 + 4}
"""Of ``anhyst_full_law_f32`` and ``anhyst_simplified_law_f32``: numbers, counts, pointers."""


def parameters_bytes(block: AnyBlock) -> int:
    """Return the size of everything that is constant."""
    if isinstance(block, RealBlock):
        return 4 * block.entries + COMMON_BYTES + LAW_BYTES[block.kind]
    return block.size


def state_bytes(block: AnyBlock) -> int:
    """Return the size of everything that changes."""
    return REAL_STATE_BYTES if isinstance(block, RealBlock) else _fixed_state_bytes()


@cache
def _fixed_state_bytes() -> int:
    """Add up the members of ``anhyst_compensator``; they are ordered so that nothing is padded."""
    header = read_core("include/anhyst/compensator.h")
    sizes = {"int32_t": 4, "uint16_t": 2}
    for members, name in re.findall(r"typedef struct \{([^}]*)\} (\w+);", header):
        declared = re.findall(r"^  (?:const )?(\w+) (\*?)\w+;", members, re.M)
        sizes[name] = sum(4 if pointer else sizes.get(kind, 0) for kind, pointer in declared)
    return sizes["anhyst_compensator"]
