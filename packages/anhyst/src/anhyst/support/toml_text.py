"""Write TOML values exactly, and find the line of each key in a TOML text."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping, Sequence

KeyPath = tuple[str | int, ...]

_KEY_PART = re.compile(r"""[ \t]*("(?:\\.|[^"\\])*"|'[^']*'|[A-Za-z0-9_-]+)[ \t]*""")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_BLANK = re.compile(r"(?:[\s\ufeff]|#[^\n]*)*")
# A multi-line string may end with up to two quotes before the closing three.
_TOKEN = re.compile(
    r'''"""(?:\\.|[^\\])*?"""+|"(?:\\.|[^"\\])*"|#[^\n]*|[\[\]{}\n]|[^"'#\[\]{}\n]+'''
    r"""|'''.*?'''+|'[^']*'""",
    re.DOTALL,
)
"""A string, a comment, a bracket, a line end, or the text between them."""


def toml_value(value: object) -> str:
    """Write a value as TOML.

    >>> toml_value([0.1, 2.0, 1e-30]), toml_value({"a b": True})
    ('[0.1, 2.0, 1e-30]', '{ "a b" = true }')
    """
    match value:
        case bool():
            return "true" if value else "false"
        case int():
            return str(value)
        case float():
            return repr(float(value)) if math.isfinite(value) else str(float(value))
        case str():
            return _quote_text(value)
        case Mapping():
            members_text = ", ".join(
                f"{toml_key(key)} = {toml_value(member)}" for key, member in value.items()
            )
            return f"{{ {members_text} }}" if members_text else "{}"
        case Sequence():
            return f"[{', '.join(toml_value(item) for item in value)}]"
    raise TypeError(f"TOML has no {type(value).__name__}")


def toml_key(key: str) -> str:
    """Return a key as TOML, with quotes only if they are necessary."""
    return key if _BARE_KEY.fullmatch(key) else _quote_text(key)


def _quote_text(text: str) -> str:
    # File names can contain bytes that are not UTF-8; TOML cannot.
    valid_text = text.encode("utf-8", "replace").decode("utf-8")
    return json.dumps(valid_text, ensure_ascii=False).replace("\x7f", "\\u007f")


COMMENT_COLUMN = 38
"""Column in which comments begin, if the value is short enough."""


def with_comment(text: str, comment: str) -> str:
    """Return a line of TOML with a comment at the usual column.

    >>> with_comment("a = 1", "first")
    'a = 1                                 # first'
    """
    return f"{text.ljust(COMMENT_COLUMN - 1)} # {comment}"


def split_comment(line: str) -> tuple[str, str]:
    """Return the value of a complete line of TOML as it is written, and its comment.

    >>> split_comment('a = "#1"  # first')
    ('"#1"', 'first')
    """
    for comment_start in (*(index for index, character in enumerate(line) if character == "#"), len(line)):
        try:
            tomllib.loads(line[:comment_start])
        except tomllib.TOMLDecodeError:
            continue
        return line[:comment_start].partition("=")[2].strip(), line[comment_start + 1 :].strip()
    return "", line.rpartition("#")[2].strip() if "#" in line else ""


def key_lines(text: str) -> dict[KeyPath, int]:
    r"""Find the line of every table and key in a valid TOML text.

    >>> key_lines('a = 1\n[[b]]\nc = "x"\n')
    {('a',): 1, ('b', 0): 2, ('b', 0, 'c'): 3}
    """
    return _Scanner(text).scan()


class _Scanner:
    """Scans a valid TOML text key by key."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.position = 0
        self.lines: dict[KeyPath, int] = {}
        self.last_index: dict[KeyPath, int] = {}

    def scan(self) -> dict[KeyPath, int]:
        table: KeyPath = ()
        while (start := _BLANK.match(self.text, self.position)) and start.end() < len(self.text):
            self.position = start.end()
            line = self.text.count("\n", 0, self.position) + 1
            if self.text[self.position] == "[":
                table = self._read_header()
                path = table
            else:
                path = table + tuple(self._read_key())
                self.position += 1  # the equals sign
                self._skip_value()
            self.lines.setdefault(path, line)
        return self.lines

    def _read_header(self) -> KeyPath:
        is_array = self.text.startswith("[[", self.position)
        self.position += 2 if is_array else 1
        key_parts = self._read_key()
        self.position += 2 if is_array else 1
        path: KeyPath = ()
        for key in key_parts:
            path = (*self._with_index(path), key)
        if is_array:
            self.last_index[path] = self.last_index.get(path, -1) + 1
        return self._with_index(path)

    def _with_index(self, path: KeyPath) -> KeyPath:
        """Append the index of the latest element if the path is an array of tables."""
        return (*path, self.last_index[path]) if path in self.last_index else path

    def _read_key(self) -> list[str]:
        key_parts = []
        while match := _KEY_PART.match(self.text, self.position):
            part_text = match[1]
            is_quoted = part_text[0] in "\"'"
            key_parts.append(next(iter(tomllib.loads(f"{part_text} = 0"))) if is_quoted else part_text)
            self.position = match.end()
            if not self.text.startswith(".", self.position):
                break
            self.position += 1
        return key_parts

    def _skip_value(self) -> None:
        depth = 0
        while token := _TOKEN.match(self.text, self.position):
            if token[0] == "\n" and depth == 0:
                return
            depth += token[0] in {"[", "{"}
            depth -= token[0] in {"]", "}"}
            self.position = token.end()
