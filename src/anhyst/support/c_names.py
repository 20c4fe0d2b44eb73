"""What an actuator is called in C."""

from __future__ import annotations

import re

from anhyst.support.errors import InputError

LONGEST = 31
UNNAMED = "actuator"

_NAME = re.compile(rf"[a-z][a-z0-9_]{{0,{LONGEST - 1}}}")


def c_name(text: str) -> str:
    """Return the nearest name that C takes, in small letters.

    >>> c_name("Magnet 3, upper"), c_name("2nd"), c_name("")
    ('magnet_3_upper', 'actuator_2nd', 'actuator')
    """
    words = re.findall(r"[a-z0-9]+", text.lower())
    if not words or words[0][0].isdigit():
        words.insert(0, UNNAMED)
    return "_".join(words)[:LONGEST].rstrip("_")


def check_name(name: str) -> None:
    """Refuse what cannot begin the names of an actuator's C."""
    if not _NAME.fullmatch(name):
        raise InputError(
            f"--name: '{name}' is no name; give up to {LONGEST} small letters, digits and "
            "underscores, a letter first",
            code="bad-name",
            key="--name",
        )
