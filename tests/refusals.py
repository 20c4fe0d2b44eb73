"""Check errors by code, such as ``out-of-range --rate`` or ``not-finite F_N: a.csv; line 4``.

The first word is the code of the error. Its key may follow. After a colon come the parts that the
text of the error must contain, such as a file and a line. Only messages.toml has the full wording.
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
    """Check that a block raises an error with this code, and with this key if one is given."""
    with pytest.raises(error) as caught:
        yield caught
    code, key, held = _parts(what)
    found = caught.value
    text = in_commands(found)
    assert (found.code, found.key if key else "") == (code, key), f"{found.key}: {found}"
    assert [part for part in held if part not in text] == [], text
    assert "\n" not in text


def says(said: str, what: str) -> bool:
    """Whether a line of a command's output has the wording of this error."""
    code, key, held = _parts(what)
    return any(
        all(part in line for part in (key, *held))
        and any(wording.search(line) for wording in _wordings(code))
        for line in said.splitlines()
    )


def _parts(what: str) -> tuple[str, str, list[str]]:
    name, _, held = what.partition(": ")
    code, _, key = name.partition(" ")
    return code, key, held.split("; ") if held else []


@cache
def _wordings(code: str) -> list[re.Pattern[str]]:
    """Return patterns for the wordings of this error code, with any text before and after."""
    texts = tomllib.loads(MESSAGES.read_text(encoding="utf-8")).get(code, [])
    if not texts and code.replace("-", "_") in get_args(ErrorType):
        texts = ["{what pydantic says}"]
    assert texts, f"there is no error with the code {code}"
    clauses = [re.sub(r"^[^ :]*: ", "", text) for text in texts]  # without a place or a key
    holes = [".*".join(map(re.escape, re.split(r"\{[^{}]*\}", text))) for text in clauses]
    return [re.compile(rf"(^|: ){hole}($|; |, is )") for hole in holes]
