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

    kind: str  # the type field
    text: str

    @property
    def flag(self) -> str | None:
        """The option, if it has another name than the parameter."""
        found = _SPELLED.search(self.kind)
        return found[1] if found else None

    @property
    def metavar(self) -> str | None:
        """The placeholder of the value."""
        found = _SPELLED.search(self.kind)
        return found[2] or None if found else None

    @property
    def limits(self) -> tuple[float | None, float | None]:
        """The least and the largest number."""
        found = _LIMIT.search(self.kind)
        if found is None:
            return None, None
        low, high = (_number(text) for text in (found[1] or found[2], found[3]))
        return low, high

    @property
    def is_argument(self) -> bool:
        """Whether it is an argument of the command line in any case."""
        return "argument" in self.kind

    @property
    def is_required(self) -> bool:
        """Whether the command line requires what Python may leave out."""
        return "required on the command line" in self.kind

    @property
    def is_hidden(self) -> bool:
        """Whether the command line does not have it."""
        return "only in Python" in self.kind


def _number(text: str | None) -> float | None:
    if text is None:
        return None
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
        described = Described(kind, " ".join(rest.split()))
        found |= {name.strip(): described for name in names.split(",")}
    return found


def with_options(text: str, flags: Mapping[str, str]) -> str:
    """Return a text of a docstring in the words of the command line: `name` becomes --name."""
    named = _NAME.sub(lambda found: flags.get(found[1], f"'{found[1]}'"), text)
    return named.replace("``", "")
