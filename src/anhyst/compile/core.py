"""The C of the core: where it stands, and which of its files a compensator needs."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from anhyst.compile.block import Kind
from anhyst.errors import InputError

SOURCES: dict[Kind, tuple[str, ...]] = {
    "full": ("block.c", "full.c", "compensator.c"),
    "simplified": ("block.c", "closed.c", "simplified.c", "compensator.c"),
    "euler": ("block.c", "closed.c", "euler.c", "compensator.c"),
}
"""Sources of each kind in fixed point."""

SINGLE: dict[Kind, tuple[str, ...]] = {
    "full": ("full_f32.c", "compensator_f32.c"),
    "simplified": ("simplified_f32.c", "compensator_f32.c"),
}
"""The same for single precision."""

CONTROL = ("pidd2.c", "map.c", "drive.c", "levitation.c", "position.c")
"""What a controller of the position needs beyond a compensator."""

INCLUDE = "include"
SRC = "src"

_INCLUDED = re.compile(r'^#include "([^"]+)"$', re.M)


def core_folder() -> Path:
    """Return the folder with ``include/``, ``src/`` and ``port/`` of the core.

    In a source tree it is the one that is edited, otherwise the copy inside the package.

    Raises
    ------
    InputError
        The installation is not complete.
    """
    package = Path(__file__).resolve().parents[1]
    for place in (package.parents[1] / "core", package / "_core" / "c"):
        if (place / "include" / "anhyst" / "compensator.h").is_file():
            return place
    raise InputError(f"{package}: the C sources of the core are missing; install anhyst again")


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
