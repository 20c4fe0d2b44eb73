"""Read a numpydoc docstring: summary, parameters and examples for the help of a command.

The type field of a parameter also defines its spelling on the command line::

    rate : float, at least 1, ``HZ``, optional
    known : path-like, ``--rig FILE``, optional
    jobs : int, optional, only in Python
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

_LIMIT_PATTERN = re.compile(r"at least ([\d.e+-]+)|([\d.e+-]+) to ([\d.e+-]+)")
_OPTION_PATTERN = re.compile(r"``(--[\w-]+)? ?([^`]*)``")
_NAME_PATTERN = re.compile(r"(?<!`)`(\w+)`(?!`)")
_SECTION_PATTERN = re.compile(r"^(\S.*)\n(-{3,})$", re.MULTILINE)


@dataclass(frozen=True)
class ParameterDoc:
    """The description of a parameter in a docstring."""

    type_text: str = ""  # type field
    text: str = ""
    flag: str | None = None  # option, if its name differs from the parameter
    metavar: str | None = None  # placeholder of the value in the help
    minimum: float | None = None  # limits of a number
    maximum: float | None = None


def _parse_parameter(type_text: str, text: str) -> ParameterDoc:
    option_match, limit_match = _OPTION_PATTERN.search(type_text), _LIMIT_PATTERN.search(type_text)
    flag, metavar = option_match.groups() if option_match else (None, None)
    limits = (limit_match[1] or limit_match[2], limit_match[3]) if limit_match else (None, None)
    minimum, maximum = (_number(end) if end else None for end in limits)
    return ParameterDoc(type_text, text, flag, metavar or None, minimum, maximum)


def _number(text: str) -> float:
    return int(text) if text.isdigit() else float(text)


@dataclass(frozen=True)
class Docstring:
    """The parts of a docstring that the help of a command shows."""

    summary: str  # summary and extended summary
    parameters: Mapping[str, ParameterDoc]
    examples: tuple[str, ...]


def read_docstring(function: Callable[..., object]) -> Docstring:
    """Read the docstring of a function."""
    text = inspect.getdoc(function) or ""
    headings = [*_SECTION_PATTERN.finditer(text)]
    section_ends = [*(head.start() for head in headings), len(text)]
    sections = {
        head[1]: text[head.end() : end].strip("\n")
        for head, (_, end) in zip(headings, pairwise(section_ends), strict=True)
    }
    return Docstring(
        summary=text[: section_ends[0]].strip(),
        parameters=_parse_parameters(sections.get("Parameters", "")),
        examples=tuple(filter(None, map(str.strip, sections.get("Examples", "").split("\n")))),
    )


def _parse_parameters(text: str) -> dict[str, ParameterDoc]:
    """Return the descriptions by parameter name. Several names can share one description."""
    parameters: dict[str, ParameterDoc] = {}
    for block in re.split(r"\n(?=\S)", text):
        head, _, description_lines = block.partition("\n")
        names, _, type_field = head.partition(" : ")
        description = _parse_parameter(type_field, " ".join(description_lines.split()))
        parameters |= {name.strip(): description for name in names.split(",")}
    return parameters


def use_option_names(text: str, flags: Mapping[str, str]) -> str:
    """Replace parameters by options in a text: `name` becomes --name."""
    text_with_options = _NAME_PATTERN.sub(lambda match: flags.get(match[1], f"'{match[1]}'"), text)
    return text_with_options.replace("``", "")
