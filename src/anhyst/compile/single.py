"""The core's C in one number format: what is written once for several, written out.

Sources under ``generic/`` name their number format by macros, which is right for a core that keeps
the formats side by side and a nuisance to read in a project that needs one. Here the macros are
replaced by what they mean, and what the layout lined up is lined up again.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

_TOKENS = re.compile(
    r"ANHYST_NAME\((?P<name>\s*\w+)\)|\bR\((?P<number>-?[0-9.e+-]+)\)|(?P<real>\bANHYST_REAL\b)"
    r"|(?P<eps>\bANHYST_EPS\b)"
)
_BOTH = re.compile(
    r'#include "anhyst/f64\.h"\n#include "[^"]+"\n'
    r'#include "anhyst/f32\.h"\n#include "(?P<file>[^"]+)"\n(?:#include "anhyst/no_format\.h"\n)?'
)
_FIXED = re.compile(
    r'#include "anhyst/q31\.h"\n(?P<between>(?:.*\n)*?)'
    r'#include "(?P<file>(?:anhyst/)?generic/[^"]+)"\n(?:#include "anhyst/no_format\.h"\n)?'
)
_LICENCE = re.compile(r"^/\* SPDX-License-Identifier: [^*]*\*/\n+")
_COMMENT = re.compile(r"^(\s*\S.*?)( +)(/\*.*)$")
EPSILON = "1.1920929e-7f"
REAL = {"f32": "float", "q31": "int32_t"}
"""What a number is in each format."""
WIDTH = 100


def generic_of(text: str) -> str | None:
    """Return the file that a source includes for its number formats, or None."""
    found = _BOTH.search(text) or _FIXED.search(text)
    return found["file"] if found else None


def with_generic(text: str, generic: str) -> str:
    """Put the text of a generic file where a source includes it.

    In single precision where the source has it in both precisions, else in fixed point.
    """
    body = _LICENCE.sub("", generic)
    if _BOTH.search(text):
        return _BOTH.sub(lambda _: in_format(body, "f32"), text)
    return _FIXED.sub(lambda found: found["between"] + in_format(body, "q31"), text)


def in_format(text: str, number_format: str) -> str:
    """Write a generic source out in one number format.

    Parameters
    ----------
    text : str
        C that uses ``ANHYST_REAL``, ``ANHYST_NAME()``, ``ANHYST_EPS`` and ``R()``, laid out.
    number_format : str
        ``"f32"`` or ``"q31"``.

    Returns
    -------
    str
        The same with its type and with names that end in it; comments behind code and lines that
        continue an expression stand below each other as before.
    """
    # A name that the layout broke inside its brackets goes onto one line.
    text = re.sub(r"ANHYST_NAME\(\s+", "ANHYST_NAME(", text)
    rows = [_Row.of(line, number_format) for line in text.split("\n")]
    _line_up_comments(rows)
    lines: list[str] = []
    for place, row in enumerate(rows):
        row.indent(_indent(rows[:place], row))
        if lines and _continues(lines[-1], row.new):
            gap = "" if lines[-1].endswith("(") else " "
            row.indent(len(lines[-1]) + len(gap))
            lines[-1] += gap + row.new.lstrip(" ")
        else:
            lines.append(row.new)
    return "\n".join(lines)


@dataclass
class _Row:
    """A line before and after, and where each column went: (old column, shift) in order."""

    old: str
    new: str
    shifts: list[tuple[int, int]]

    @classmethod
    def of(cls, line: str, number_format: str) -> _Row:
        parts: list[str] = []
        shifts = [(0, 0)]
        end = shift = 0
        for found in _TOKENS.finditer(line):
            word = _written_out(found, number_format)
            parts += [line[end : found.start()], word]
            end = found.end()
            shift += len(word) - len(found[0])
            shifts.append((end, shift))
        return cls(line, "".join(parts) + line[end:], shifts)

    def moved(self, column: int) -> int:
        """Where an old column stands now."""
        return column + next(shift for start, shift in reversed(self.shifts) if start <= column)

    def push(self, column: int, by: int) -> None:
        """Move what stands from an old column on."""
        if by == 0:
            return
        at = self.moved(column)
        self.new = (
            self.new[:at] + " " * by + self.new[at:]
            if by > 0
            else (self.new[: at + by] + self.new[at:])
        )
        before = next(shift for start, shift in reversed(self.shifts) if start <= column)
        self.shifts = [s for s in self.shifts if s[0] < column] + [(column, before + by)]

    def indent(self, width: int) -> None:
        """Begin at another column."""
        here = _width(self.new)
        if self.new.strip() and width != here:
            self.new = " " * width + self.new[here:]
            self.shifts = [(start, shift + width - here) for start, shift in self.shifts]

    @property
    def comment(self) -> int | None:
        """Old column of a comment behind code."""
        found = _COMMENT.match(self.old)
        return None if found is None or found[1].lstrip().startswith("/*") else found.start(3)


def _written_out(found: re.Match[str], number_format: str) -> str:
    if found["name"]:
        return f"{found['name'].strip()}_{number_format}"
    if found["number"]:
        return f"{found['number']}f"
    return REAL[number_format] if found["real"] else EPSILON


def _width(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _continues(line: str, following: str) -> bool:
    """Tell whether a line was only broken because it was longer before."""
    code, more = line.strip(), following.strip()
    if not code or not more or "/*" in code or "*/" in code or "/*" in more:
        return False
    whole = code[-1] in ";{}:" or code[0] == "#" or more[0] in "{}#"
    return not whole and len(line) + 1 + len(more) <= WIDTH


def _line_up_comments(rows: list[_Row]) -> None:
    """Put comments behind lines that follow each other into one column."""
    group: list[_Row] = []
    column = -1
    for row in [*rows, _Row("", "", [(0, 0)])]:
        at = row.comment
        if at is not None:
            group.append(row)
            column = at
        elif not (group and _width(row.old) == column + 3):  # not a comment's second line
            _line_up(group)
            group = []


def _line_up(group: list[_Row]) -> None:
    columns = [(row, row.comment or 0) for row in group]
    ends = [len(row.new[: row.moved(column)].rstrip()) for row, column in columns]
    for row, column in columns:
        row.push(column, max(ends) + 1 - row.moved(column))


def _indent(above: list[_Row], row: _Row) -> int:
    """Where a line begins: below what it was lined up with, if it was with anything."""
    width = _width(row.old)
    for earlier in reversed(above):
        if not earlier.old.strip() or _width(earlier.old) >= width:
            continue
        if (
            width < len(earlier.old)
            and earlier.old[width] != " "
            and (earlier.old[width - 1] in " (" or earlier.old[width - 3 : width] == "/* ")
        ):
            return earlier.moved(width)
        break
    return width
