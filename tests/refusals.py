"""What a refusal is: ``no-such-file``, ``out-of-range --rate``, ``not-finite F_N: a.csv; line 4``.

That is the code of an error; then its key, if that matters; then, after a colon, what its text must
hold, such as a file and a line. How it is worded stands in messages.toml alone.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic_core.core_schema import ErrorType

from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.wording import use_command_line_wording

MESSAGES = Path(__file__).with_name("messages.toml")


def in_commands(error: Exception) -> str:
    """Return the message of an error as the command line prints it."""
    with use_command_line_wording():
        return str(error)


@contextmanager
def refused(
    what: str, error: type[InputError | NegativeResult] = InputError
) -> Iterator[pytest.ExceptionInfo[Any]]:
    """Check that a block ends with an error of this code, and of this key."""
    with pytest.raises(error) as caught:
        yield caught
    code, key, held = _parts(what)
    found = caught.value
    text = in_commands(found)
    assert (found.code, found.key if key else "") == (code, key), f"{found.key}: {found}"
    assert [part for part in held if part not in text] == [], text
    assert "\n" not in text


def says(said: str, what: str) -> bool:
    """Whether a line that a command printed is how this refusal is worded."""
    code, key, held = _parts(what)
    return any(
        all(part in line for part in (key, *held)) and any(one.search(line) for one in _wordings(code))
        for line in said.splitlines()
    )


def _parts(what: str) -> tuple[str, str, list[str]]:
    name, _, held = what.partition(": ")
    code, _, key = name.partition(" ")
    return code, key, held.split("; ") if held else []


@cache
def _wordings(code: str) -> list[re.Pattern[str]]:
    """Patterns for what an error of this code says, whatever stands before and behind it."""
    texts = tomllib.loads(MESSAGES.read_text(encoding="utf-8")).get(code, [])
    if not texts and code.replace("-", "_") in get_args(ErrorType):
        texts = ["{what pydantic says}"]
    assert texts, f"there is no error with the code {code}"
    clauses = [re.sub(r"^[^ :]*: ", "", text) for text in texts]  # without a place or a key
    holes = [".*".join(map(re.escape, re.split(r"\{[^{}]*\}", text))) for text in clauses]
    return [re.compile(rf"(^|: ){hole}($|; |, is )") for hole in holes]
