"""The C of the core, found and joined: one header and one source for each kind of compensator."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from anhyst.compile.block import Kind
from anhyst.compile.single import generic_of, with_generic
from anhyst.errors import InputError

SOURCES: dict[Kind, tuple[str, ...]] = {
    "full": ("block.c", "full.c", "compensator.c"),
    "simplified": ("block.c", "closed.c", "simplified.c", "compensator.c"),
    "euler": ("block.c", "closed.c", "euler.c", "compensator.c"),
}
"""What is joined, in the order of the file: each function stands before it is used."""

SINGLE: dict[Kind, tuple[str, ...]] = {
    "full": ("full_real.c", "compensator_real.c"),
    "simplified": ("simplified_real.c", "compensator_real.c"),
}
"""The same for single precision."""

CONTROL = ("pidd2.c", "map.c", "drive.c", "supervisor.c", "levitation.c", "position.c")
"""What a controller of the position needs beyond a compensator."""

PUBLIC = "anhyst/"
WIDTH = 100

_INCLUDE = re.compile(r'^#include "([^"]+)"\n', re.M)
_SYSTEM = re.compile(r"^#include <([^>]+)>\n", re.M)
_LICENCE = re.compile(r"^/\* SPDX-License-Identifier: [^*]*\*/\n")
_GUARD = re.compile(r"^#ifndef (ANHYST_\w+_H)\n#define \1\n(.*)^#endif\n\Z", re.M | re.S)
_LINKAGE = re.compile(
    r'^#ifdef __cplusplus\n(?:extern "C" \{|\})\n#endif\n',
    re.M,
)
_INLINE = re.compile(
    r"(?:/\*(?:[^*]|\*(?!/))*\*/\n)?static inline [^\n;{]*?\b(\w+)\([^;{]*\)\n\{\n.*?^\}\n\n?",
    re.M | re.S,
)
_ELSEWHERE = (
    (re.compile(r"\(see\s+core/port/\)"), "(one\n   lies beside this file)"),
    (re.compile(r"\(proved, see docs/proofs\.md\)"), "(proved)"),
)
"""Places in the source tree, told as they look from outside."""

_KERNEL = re.compile(r"^extern const anhyst_kernel(?:_f32)? anhyst_kernel_(\w+?)(?:_f32)?;\n", re.M)


@dataclass(frozen=True, slots=True)
class Joined:
    """The core that a kind of compensator needs.

    Parameters
    ----------
    header, source : str
        Bodies of ``anhyst.h`` and ``anhyst.c``: sections one below the other.
    system : tuple of str
        Standard headers that they need.
    """

    header: str
    source: str
    system: tuple[str, ...]


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


def join(kind: Kind, *, single: bool = False, control: bool = False) -> Joined:
    """Join what a kind of compensator needs of the core.

    Includes of the core's own headers are resolved, each header once; comments are kept.

    Parameters
    ----------
    kind : str
        Kind of compensator.
    single : bool, optional
        In single precision, not in fixed point.
    control : bool, optional
        With the controller of the position, in fixed point.

    Returns
    -------
    Joined
    """
    joint = _Joint(kind)
    for name in (SINGLE if single else SOURCES)[kind] + (CONTROL if control else ()):
        joint.add(f"src/{name}")
    source = _without_unused("\n".join(joint.source))
    return Joined("\n".join(joint.header), source, tuple(sorted(joint.system, key=str)))


def _without_unused(source: str) -> str:
    """Leave out the inline functions that nothing calls: compilers warn of them in a source."""
    while True:
        unused = next(
            (found for found in _INLINE.finditer(source) if _mentions(source, found[1]) == 1), None
        )
        if unused is None:
            return source
        source = source[: unused.start()] + source[unused.end() :]


def _mentions(source: str, name: str) -> int:
    return len(re.findall(rf"\b{name}\b", source))


@dataclass
class _Joint:
    """Sections of the two files as they grow."""

    kind: Kind
    header: list[str] = field(default_factory=list)
    source: list[str] = field(default_factory=list)
    system: list[str] = field(default_factory=list)
    _seen: set[str] = field(default_factory=set)
    _linked: bool = False

    def add(self, name: str) -> None:
        """Put a file behind everything that it includes."""
        if name in self._seen:
            return
        self._seen.add(name)
        text = read_core(name)
        if generic := generic_of(text):
            text = with_generic(text, read_core(f"{_folder(generic)}/{generic}"))
        for included in _INCLUDE.findall(text):
            self.add(f"{_folder(included)}/{included}")
        self.system += [h for h in _SYSTEM.findall(text) if h not in self.system]
        if name.startswith("include/"):
            self._add_header(name, text)
        else:
            self.source.append(section(name, bare(text)))

    def _add_header(self, name: str, text: str) -> None:
        if not self._linked and _LINKAGE.search(text):
            self.header.append('#ifdef __cplusplus\nextern "C" {\n#endif\n')
            self._linked = True
        for place, told in _ELSEWHERE:
            text = place.sub(told, text)
        text = _KERNEL.sub(lambda m: m[0] if m[1] == self.kind else "", bare(text))
        self.header.append(section(name, text))


def _folder(included: str) -> str:
    return "include" if included.startswith(PUBLIC) else "src"


def bare(text: str) -> str:
    """Take off what only a file by itself needs: licence, includes, guard, linkage."""
    text = _LICENCE.sub("", text)
    text = _LINKAGE.sub("", _SYSTEM.sub("", _INCLUDE.sub("", text)))
    # The introduction may stand before the guard.
    guard = re.search(r"^#ifndef (ANHYST_\w+_H)$", text, re.M)
    if guard:
        text = text[: guard.start()] + _GUARD.sub(r"\2", text[guard.start() :])
    return re.sub(r"\n{3,}", "\n\n", text).strip("\n") + "\n"


def section(name: str, text: str) -> str:
    """Put a text under a line with the name of its file."""
    title = f"/* ---- {Path(name).name} "
    return f"{title}{'-' * (WIDTH - len(title) - 3)} */\n\n{text}"


def section_names(joined: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the files that joined texts were made of."""
    return tuple(re.findall(r"^/\* ---- (\S+) -+ \*/$", "\n".join(joined), re.M))
