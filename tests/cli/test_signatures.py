"""Every verb of the command line is a function of the package, with the same names and defaults."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import pytest
import typer

import anhyst
from anhyst.cli.app import app

VERBS: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]

READING = frozenset(
    {"columns", "sidecar", "schedule", "loop", "constants", "history", "scale", "flip", "drop"}
)
"""How files are read: of `read_loops`, where a function takes loops."""

OWN = {
    "excite": {"calibrate"},  # another function's: excite_to_calibrate
    "identify": {"out", "clean", *READING},  # its result has save; the others go to read_loops
    "inspect": {"plot", "clean", *READING},  # its result has plot
    "predict": {"out"},  # without it nothing is written, and the result holds the columns
    "invert": {"out"},
    "simulate": {"out"},  # without it nothing is written, and the result has save
}
"""What is the command line's alone, besides ``--json`` and ``--verbose``."""

FLAGS = {"as_json": "--json", "_verbose": "--verbose", "as_": "--as", "known": "--rig"}
"""Options whose names are no names of Python, or another argument's."""


def options_of(verb: str) -> dict[str, Any]:
    """Return what a verb takes, with its defaults as a function has them; `empty` for none."""
    found = {}
    for one in VERBS[verb].params:
        default = str(one.default) if isinstance(one.default, Path) else one.default
        found[one.name] = inspect.Parameter.empty if one.required else default
    return found


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_is_a_function_with_the_same_names_and_defaults(verb: str) -> None:
    function = getattr(anhyst, verb.replace("-", "_"))
    takes = {name: one.default for name, one in inspect.signature(function).parameters.items()}
    own = {"as_json", "_verbose", *OWN.get(verb, ())}
    wanted = {name: value for name, value in options_of(verb).items() if name not in own}
    assert {name: takes.get(name, "missing") for name in wanted} == wanted
    required = {
        name
        for name, one in inspect.signature(function).parameters.items()
        if one.default is inspect.Parameter.empty and one.kind is not one.VAR_KEYWORD
    }
    assert required <= wanted.keys()


def test_how_files_are_read_is_said_to_read_loops_by_the_same_names() -> None:
    takes = inspect.signature(anhyst.read_loops).parameters
    assert {name: takes[name].default for name in READING} == dict.fromkeys(READING)


@pytest.mark.parametrize("verb", VERBS)
def test_an_option_is_called_as_the_argument_of_the_function(verb: str) -> None:
    for one in VERBS[verb].params:
        if one.param_type_name == "option":
            flag = FLAGS.get(one.name, f"--{one.name.replace('_', '-')}")
            assert flag in one.opts, one.name
