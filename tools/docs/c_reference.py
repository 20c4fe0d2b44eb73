"""Generate the reference of the C core from its headers."""

from __future__ import annotations

import re
from pathlib import Path

_COMMENT = re.compile(r"/\*(.*?)\*/", re.S)
_DECLARED = re.compile(r"^/\*((?:(?!\*/)[\s\S])*)\*/\n((?:(?!/\*|#|\n).*\n)+)", re.M)
_MACRO_NOISE = re.compile(r"^(#|extern \"C\"|\}$|$)")
FOLDERS = ("compensator", "control", "law", "numeric")


def c_reference(include: Path) -> str:
    """Return a page for all public headers below ``include/anhyst``."""
    parts = [
        "# C\n",
        "C99, no heap, no globals, no clock; each header states format, rounding, saturation and "
        "error bound. Headers in the folders `generic` contain the code that the formats share.\n",
    ]
    for room in FOLDERS:
        parts.append(f"## {room}\n")
        headers = sorted((include / "anhyst" / room).glob("*.h"))
        parts += [_header_section(header, include) for header in headers]
    return "\n".join(parts)


def _header_section(path: Path, include: Path) -> str:
    text = path.read_text(encoding="utf-8")
    comments = [_comment_as_markdown(match.group(1)) for match in _COMMENT.finditer(text)]
    description = next((declaration for declaration in comments if "SPDX" not in declaration), "")
    parts = [f"### {path.relative_to(include)}\n", f"{description}\n"]
    parts += [_declaration_entry(comment, code) for comment, code in _declarations(text)]
    return "\n".join(parts)


def _declarations(text: str) -> list[tuple[str, str]]:
    """Return each comment before a declaration, with that declaration."""
    documented_lines = []
    for match in _DECLARED.finditer(text):
        comment, code = _comment_as_markdown(match.group(1)), match.group(2).strip()
        if "SPDX" not in comment and not _MACRO_NOISE.match(code):
            documented_lines.append((comment, code))
    return documented_lines


def _declaration_entry(comment: str, code: str) -> str:
    return f"```c\n{code}\n```\n\n{comment}\n"


def _comment_as_markdown(comment: str) -> str:
    """Return a comment as a paragraph, with Markdown characters escaped."""
    lines = [line.strip() for line in comment.strip().splitlines()]
    text = "\n".join(lines)
    return re.sub(r"([*_<>\[\]`|$#])", r"\\\1", text)
