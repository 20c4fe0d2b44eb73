"""Word messages for their reader: with options of the command line, or with Python arguments.

Messages are written with options: ``--columns "I=I_A"``. In Python, the same message is shown with
arguments: ``columns={"I": "I_A"}``.
"""

from __future__ import annotations

import json
import multiprocessing
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

_ARGUMENT_NAMES = {"as": "as_", "rig": "known"}
"""Python arguments whose name differs from their option."""
_LIST_OPTIONS = frozenset({"clean", "flip"})
"""Options whose value is a list in Python."""
_CHOICE_WORDS = frozenset(
    {"auto", "default", "paper", "free", "reluctance", "scaling", "circuit", "none", "invalid"}
    | {"full", "simplified", "play", "host", "bearing", "solenoid", "stage", "piezo", "settled"}
    | {"dedupe", "spikes", "steady", "drift", "offset", "skew", "thin", "demagnetised"}
)
"""Words that are the value of an option, and not the next word of the sentence."""

_OPTION_PATTERN = re.compile(
    r"""(?<![\w-])--(?P<name>[a-z][a-z-]*[a-z])
    (?:[ ](?P<value>"[^"]*"|'(?:[^']|'"'"')*'|[^\s"';]+))?""",
    re.VERBOSE,
)
_COMMAND_PATTERN = re.compile(r"'anhyst (?P<verb>[a-z-]+)(?P<options>(?: [^']*)?)'")
_PAIR_PATTERN = re.compile(r"""\s*((?:"[^"]*"|[^,"])+?)\s*(?:,|$)""")

_is_command_line = False


@contextmanager
def use_command_line_wording() -> Iterator[None]:
    """Show messages in the form of the command line within this context."""
    global _is_command_line  # noqa: PLW0603 - who reads is the same in all threads
    previous_wording, _is_command_line = _is_command_line, True
    try:
        yield
    finally:
        _is_command_line = previous_wording


def word_for_reader(text: str) -> str:
    """Return a message with options or with Python arguments, depending on its reader.

    A worker process leaves it unchanged, because only its parent knows the reader.
    """
    if _is_command_line or multiprocessing.parent_process() is not None:
        return text
    return word_for_python(text)


def word_for_python(text: str) -> str:
    """Return a message with Python arguments instead of options.

    >>> word_for_python('map it: --columns "I=I_A,F [kN]=F_N"; or leave --rate out')
    'map it: columns={"I": "I_A", "F [kN]": "F_N"}; or leave rate out'
    >>> word_for_python("use --gap-map auto, or --clean drift,thin")
    'use gap_map="auto", or clean=["drift", "thin"]'
    >>> word_for_python("see 'anhyst inspect --plot'")
    'see anhyst.inspect(...) and plot'
    """
    return _OPTION_PATTERN.sub(_python_argument, _COMMAND_PATTERN.sub(_python_call, text))


def _python_call(match: re.Match[str]) -> str:
    options = match["options"].strip()
    call_text = f"anhyst.{match['verb'].replace('-', '_')}(...)"
    return f"{call_text} and {options.removeprefix('--')}" if options.startswith("--") else call_text


def _python_argument(match: re.Match[str]) -> str:
    option = match["name"]
    if option.startswith("no-"):
        return f"{option.removeprefix('no-').replace('-', '_')}=False"
    name = _ARGUMENT_NAMES.get(option, option.replace("-", "_"))
    value_text = match["value"]
    if value_text is None:
        return name
    value = value_text.rstrip(",.:)")
    text_after = value_text[len(value) :]
    if not _is_value(value):
        return f"{name} {value_text}"
    return f"{name}={_python_literal(option, value)}{text_after}"


def _is_value(text: str) -> bool:
    """Whether a word after an option is its value: quoted, a pair, a number or a known choice."""
    if text[:1] in {'"', "'"} or "=" in text or "-" in text or text.isupper():
        return True
    return any(sign.isdigit() for sign in text) or set(text.split(",")) <= _CHOICE_WORDS


def _python_literal(option: str, value: str) -> str:
    if value[:1] in {'"', "'"}:
        value = value[1:-1].replace("'\"'\"'", "'")
    if option in {"columns", "constants", "scale"} or (option != "listen" and "=" in value):
        return _python_mapping(value, has_numbers=option != "columns")
    if option in _LIST_OPTIONS:
        return json.dumps(value.split(","), ensure_ascii=False)
    return value if _is_number(value) else json.dumps(value, ensure_ascii=False)


def _python_mapping(text: str, *, has_numbers: bool) -> str:
    dict_items = []
    for pair_text in _PAIR_PATTERN.findall(text):
        name, _, value = pair_text.rpartition("=")
        name = name[1:-1] if name[:1] == name[-1:] == '"' else name
        value_text = value if has_numbers and _is_number(value) else json.dumps(value, ensure_ascii=False)
        dict_items.append(f"{json.dumps(name, ensure_ascii=False)}: {value_text}")
    return f"{{{', '.join(dict_items)}}}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


_IRREGULAR_PLURALS = {"history": "histories", "series": "series"}


def written_files_text(out: object, files: Sequence[str], max_named: int = 6) -> str:
    """Return a text that names the files written into a folder, or only the first ones of many."""
    first_names, other_count = ", ".join(files[:max_named]), len(files) - max_named
    return f"written to {out}: {first_names}" + f" and {other_count} more" * (other_count > 0)


def count_text(count: int, noun: str) -> str:
    """Return a count with its noun in the singular or plural.

    >>> count_text(1, "loop"), count_text(2, "loop"), count_text(0, "warning")
    ('1 loop', '2 loops', '0 warnings')
    """
    if count == 1:
        return f"1 {noun}"
    return f"{count} {_IRREGULAR_PLURALS.get(noun, f'{noun}s')}"


def capitalise(text: str) -> str:
    """Return a text with a capital first letter; the other letters are unchanged."""
    return text[:1].upper() + text[1:]
