"""The C of the core: where it stands, and which of its files a compensator needs."""

from __future__ import annotations

import re
from collections.abc import Iterable

from anhyst.compensate.block import Kind
from anhyst.support.core_folder import core_folder

SOURCES: dict[Kind, tuple[str, ...]] = {
    "full": ("block.c", "full_block.c", "full.c", "compensator.c"),
    "simplified": ("block.c", "closed.c", "simplified.c", "compensator.c"),
    "euler": ("block.c", "closed.c", "euler.c", "compensator.c"),
}
"""Sources of each kind in fixed point."""

SINGLE: dict[Kind, tuple[str, ...]] = {
    "full": ("full_f32.c", "compensator_f32.c"),
    "simplified": ("simplified_f32.c", "compensator_f32.c"),
}
"""The same for single precision."""

CONTROL = (
    "factor.c",
    "pidd2.c",
    "map.c",
    "force_controller.c",
    "supervisor.c",
    "levitation.c",
    "position.c",
)
"""What a controller of the position needs beyond a compensator."""

INCLUDE = "include"
SRC = "src"

_INCLUDED = re.compile(r'^#include "([^"]+)"$', re.M)


def read_core(name: str) -> str:
    """Return the text of one file of the core, such as ``port/anhyst_port_cortex_m4.h``."""
    return (core_folder() / name).read_text(encoding="utf-8")


def core_files(sources: Iterable[str]) -> dict[str, str]:
    """Return sources of the core with every header that they include, as they are.

    Parameters
    ----------
    sources : iterable of str
        Names of C files in ``src``.

    Returns
    -------
    dict of str to str
        Content by path below the core: ``src/full.c``, ``include/anhyst/fixed.h``.
    """
    files: dict[str, str] = {}
    waiting = [f"{SRC}/{name}" for name in sources]
    while waiting:
        name = waiting.pop()
        if name not in files:
            files[name] = read_core(name)
            waiting += [_place(included) for included in _INCLUDED.findall(files[name])]
    return dict(sorted(files.items()))


def _place(included: str) -> str:
    """Return where a header stands: the core's own ones name it from ``src`` on."""
    return f"{INCLUDE if included.startswith('anhyst/') else SRC}/{included}"
