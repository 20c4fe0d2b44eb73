"""Read a numpydoc docstring: summary, parameters and examples, as the help of a verb needs them.

The type field of a parameter also says how the command line spells it::

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

_LIMIT = re.compile(r"at least ([\d.e+-]+)|([\d.e+-]+) to ([\d.e+-]+)")
_SPELLED = re.compile(r"``(--[\w-]+)? ?([^`]*)``")
_NAME = re.compile(r"(?<!`)`(\w+)`(?!`)")
_HEAD = re.compile(r"^(\S.*)\n(-{3,})$", re.MULTILINE)


@dataclass(frozen=True)
class Described:
    """A parameter as a docstring describes it."""

    kind: str = ""  # the type field
    text: str = ""
    flag: str | None = None  # the option, if it has another name than the parameter
    metavar: str | None = None  # the placeholder of the value
    low: float | None = None  # the least and the largest number
    high: float | None = None


def _described(kind: str, text: str) -> Described:
    spelled, limit = _SPELLED.search(kind), _LIMIT.search(kind)
    flag, metavar = spelled.groups() if spelled else (None, None)
    ends = (limit[1] or limit[2], limit[3]) if limit else (None, None)
    low, high = (_number(end) if end else None for end in ends)
    return Described(kind, text, flag, metavar or None, low, high)


def _number(text: str) -> float:
    return int(text) if text.isdigit() else float(text)


@dataclass(frozen=True)
class Docstring:
    """What a docstring says."""

    about: str  # summary and extended summary
    parameters: Mapping[str, Described]
    examples: tuple[str, ...]


def read_docstring(function: Callable[..., object]) -> Docstring:
    """Read the docstring of a function."""
    text = inspect.getdoc(function) or ""
    heads = [*_HEAD.finditer(text)]
    ends = [*(head.start() for head in heads), len(text)]
    sections = {
        head[1]: text[head.end() : end].strip("\n")
        for head, (_, end) in zip(heads, pairwise(ends), strict=True)
    }
    return Docstring(
        about=text[: ends[0]].strip(),
        parameters=_parameters(sections.get("Parameters", "")),
        examples=tuple(filter(None, map(str.strip, sections.get("Examples", "").split("\n")))),
    )


def _parameters(text: str) -> dict[str, Described]:
    """Return the parameters by their names; several names may share a text."""
    found: dict[str, Described] = {}
    for block in re.split(r"\n(?=\S)", text):
        head, _, rest = block.partition("\n")
        names, _, kind = head.partition(" : ")
        described = _described(kind, " ".join(rest.split()))
        found |= {name.strip(): described for name in names.split(",")}
    return found


def with_options(text: str, flags: Mapping[str, str]) -> str:
    """Return a text of a docstring in the words of the command line: `name` becomes --name."""
    named = _NAME.sub(lambda found: flags.get(found[1], f"'{found[1]}'"), text)
    return named.replace("``", "")
