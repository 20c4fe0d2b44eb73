"""Counts in words, and messages in the form of their reader: options of a command or arguments.

Messages name options as the command line does: ``--columns "I=I_A"``. A reader who works in Python
gets the same message with arguments: ``columns={"I": "I_A"}``.
"""

from __future__ import annotations

import json
import multiprocessing
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

_ARGUMENTS = {"as": "as_", "rig": "known"}
"""Arguments that have another name than their option."""
_LISTS = frozenset({"clean", "flip"})
"""Options whose value is a list in Python."""
_CHOICES = frozenset(
    {"auto", "default", "paper", "free", "reluctance", "scaling", "circuit", "none", "invalid"}
    | {"full", "simplified", "play", "host", "bearing", "solenoid", "stage", "piezo", "settled"}
    | {"dedupe", "spikes", "steady", "drift", "offset", "skew", "thin", "demagnetised"}
)
"""Words that are the value of an option, and not the next word of the sentence."""

_OPTION = re.compile(
    r"""(?<![\w-])--(?P<name>[a-z][a-z-]*[a-z])
    (?:[ ](?P<value>"[^"]*"|'(?:[^']|'"'"')*'|[^\s"';]+))?""",
    re.VERBOSE,
)
_COMMAND = re.compile(r"'anhyst (?P<verb>[a-z-]+)(?P<options>(?: [^']*)?)'")
_PAIR = re.compile(r"""\s*((?:"[^"]*"|[^,"])+?)\s*(?:,|$)""")

_is_command_line = False


@contextmanager
def command_line() -> Iterator[None]:
    """Keep messages in the form of the command line."""
    global _is_command_line  # noqa: PLW0603 - who reads is the same in all threads
    before, _is_command_line = _is_command_line, True
    try:
        yield
    finally:
        _is_command_line = before


def worded(text: str) -> str:
    """Return a message in the form of its reader.

    A worker process leaves it unchanged, because its parent knows the reader.
    """
    if _is_command_line or multiprocessing.parent_process() is not None:
        return text
    return in_python(text)


def in_python(text: str) -> str:
    """Return a message with arguments of Python in place of options.

    >>> in_python('map it: --columns "I=I_A,F [kN]=F_N"; or leave --rate out')
    'map it: columns={"I": "I_A", "F [kN]": "F_N"}; or leave rate out'
    >>> in_python("use --gap-map auto, or --clean drift,thin")
    'use gap_map="auto", or clean=["drift", "thin"]'
    >>> in_python("see 'anhyst inspect --plot'")
    'see anhyst.inspect(...) and plot'
    """
    return _OPTION.sub(_argument, _COMMAND.sub(_call, text))


def _call(match: re.Match[str]) -> str:
    options = match["options"].strip()
    call = f"anhyst.{match['verb'].replace('-', '_')}(...)"
    return f"{call} and {options.removeprefix('--')}" if options.startswith("--") else call


def _argument(match: re.Match[str]) -> str:
    option = match["name"]
    if option.startswith("no-"):
        return f"{option.removeprefix('no-').replace('-', '_')}=False"
    name = _ARGUMENTS.get(option, option.replace("-", "_"))
    given = match["value"]
    if given is None:
        return name
    value = given.rstrip(",.:)")
    tail = given[len(value) :]
    if not _is_value(value):
        return f"{name} {given}"
    return f"{name}={_literal(option, value)}{tail}"


def _is_value(text: str) -> bool:
    """Whether a word after an option is its value: quoted, a pair, a figure or a known choice."""
    if text[:1] in {'"', "'"} or "=" in text or "-" in text or text.isupper():
        return True
    return any(sign.isdigit() for sign in text) or set(text.split(",")) <= _CHOICES


def _literal(option: str, value: str) -> str:
    if value[:1] in {'"', "'"}:
        value = value[1:-1].replace("'\"'\"'", "'")
    if option in {"columns", "constants", "scale"} or (option != "listen" and "=" in value):
        return _mapping(value, numbers=option != "columns")
    if option in _LISTS:
        return json.dumps(value.split(","), ensure_ascii=False)
    return value if _is_number(value) else json.dumps(value, ensure_ascii=False)


def _mapping(text: str, *, numbers: bool) -> str:
    pairs = []
    for part in _PAIR.findall(text):
        name, _, value = part.rpartition("=")
        name = name[1:-1] if name[:1] == name[-1:] == '"' else name
        shown = value if numbers and _is_number(value) else json.dumps(value, ensure_ascii=False)
        pairs.append(f"{json.dumps(name, ensure_ascii=False)}: {shown}")
    return f"{{{', '.join(pairs)}}}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


_IRREGULAR = {"history": "histories", "series": "series"}


def list_written(out: object, files: Sequence[str], most: int = 6) -> str:
    """Say what was written into a folder; of many files the first ones are named."""
    named, others = ", ".join(files[:most]), len(files) - most
    return f"written to {out}: {named}" + f" and {others} more" * (others > 0)


def count_of(count: int, noun: str) -> str:
    """Return a count with its noun in the right number.

    >>> count_of(1, "loop"), count_of(2, "loop"), count_of(0, "warning")
    ('1 loop', '2 loops', '0 warnings')
    """
    if count == 1:
        return f"1 {noun}"
    return f"{count} {_IRREGULAR.get(noun, f'{noun}s')}"
