"""The C of the core: where it stands, and which of its files a compensator needs."""

from __future__ import annotations

import re
from collections.abc import Iterable

from anhyst.compensate.block import Kind
from anhyst.support.folder import core_folder

_COMPENSATOR = ("compensator/block.c", "compensator/compensator.c")

SOURCES: dict[Kind, tuple[str, ...]] = {
    "full": (*_COMPENSATOR, "compensator/full_block.c", "compensator/full.c"),
    "simplified": (*_COMPENSATOR, "compensator/closed.c", "compensator/simplified.c"),
    "cells": (*_COMPENSATOR, "compensator/cells_block.c", "compensator/cells.c"),
    "euler": (*_COMPENSATOR, "compensator/closed.c", "compensator/euler.c"),
}
"""Sources of each kind in fixed point."""

LAYERS = ("compensator/solid.c",)
"""What solid iron needs beyond that, in fixed point."""

SINGLE: dict[Kind, tuple[str, ...]] = {
    "full": ("compensator/full_f32.c", "compensator/compensator_f32.c"),
    "cells": ("compensator/cells_f32.c", "compensator/compensator_f32.c"),
    "simplified": ("compensator/simplified_f32.c", "compensator/compensator_f32.c"),
}
"""The same for single precision."""

PIDD2 = ("control/pidd2.c",)
"""PIDD2 alone, in fixed point."""

CONTROL = (
    *PIDD2,
    *("compensator/map.c", "compensator/force_controller.c"),
    *("control/supervisor.c", "control/levitation.c", "control/position.c"),
)
"""What a controller of the position needs beyond a compensator."""

AXES = (
    *("control/allocation_real.c", "control/biquad_real.c"),
    *("control/wrench.c", "control/axes.c"),
)
"""What a controller of several coordinates needs in single precision beyond its force controllers."""

AXES_FIXED = ("control/allocation.c", "control/wrench_fixed.c", "control/axes_fixed.c")
"""The same in fixed point."""

FORCE_REAL = (
    *("compensator/force_controller_real.c", "compensator/map_real.c"),
    "compensator/compensator_f32.c",
)
FORCE_FIXED = (*_COMPENSATOR, "compensator/force_controller.c", "compensator/map.c")
FORCE_CODED = (*FORCE_FIXED, "compensator/force_coded_real.c")
"""These in single precision, in fixed point, and in fixed point behind single precision, beyond the
kernel of a law."""

PLAY_MAP = ("compensator/play_map.c", "compensator/force_by_play.c")
PLAY_MAP_REAL = ("compensator/play_map_real.c", "compensator/force_by_play_real.c")
CORRECTED_REAL = ("compensator/force_corrected_real.c",)
"""And where a map with one play finds the current, or calibration corrects it."""

INCLUDE = "include"
SRC = "src"

_INCLUDED = re.compile(r'^#include "([^"]+)"$', re.M)


def read_core(name: str) -> str:
    """Return the text of one file of the core, such as ``port/anhyst_port_cortex_m4.h``."""
    return (core_folder() / name).read_text(encoding="utf-8")


ROOM = f"{INCLUDE}/anhyst/compensator/plays.h"
"""Says how many memories of its law a compensator has room for."""


def core_files(sources: Iterable[str], memories: int = 1) -> dict[str, str]:
    """Return sources of the core with every header that they include, as they are.

    With more than one memory the header that says so is made to.
    """
    files: dict[str, str] = {}
    waiting = [f"{SRC}/{name}" for name in sources]
    while waiting:
        name = waiting.pop()
        if name not in files:
            files[name] = read_core(name)
            waiting += [_place(name, included) for included in _INCLUDED.findall(files[name])]
    if memories > 1:
        files[ROOM] = files[ROOM].replace("ANHYST_MEMORIES 1", f"ANHYST_MEMORIES {memories}")
    return dict(sorted(files.items()))


_DOUBLE = re.compile(
    r'#include "anhyst/numeric/f64\.h"\n.*?(?=#include "anhyst/numeric/f32\.h"\n)', re.S
)


def single_precision(files: dict[str, str]) -> dict[str, str]:
    """Return the same without the code in double precision of sources that hold both formats."""
    return {
        name: _DOUBLE.sub("", text) if name.endswith(".c") else text for name, text in files.items()
    }


def _place(file: str, included: str) -> str:
    """Return where a header stands that a file names: a public one, or one beside the file."""
    if included.startswith("anhyst/"):
        return f"{INCLUDE}/{included}"
    return f"{file.rpartition('/')[0]}/{included}"
