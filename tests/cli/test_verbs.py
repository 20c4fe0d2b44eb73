"""Test the commands: each is made from the signature and the docstring of a function."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import get_args

import pytest
import typer

import anhyst
from anhyst import verbs
from anhyst.cli import app as cli
from anhyst.cli.docstring import read_docstring, use_option_names
from anhyst.cli.generate import Verb, add_command, load_verbs
from anhyst.cli.reading import read_options
from anhyst.compensate.block import Kind
from anhyst.compensate.force_controller import SignalFormat
from anhyst.compilation.compiled_stage import StageKind
from anhyst.laws import LAWS
from anhyst.support.registry import PROJECT_PACKAGES
from anhyst.support.verbs import _find_all
from anhyst.verification.verify import HOST_STEPS, TARGET_STEPS
from anhyst_exchange import exporter
from anhyst_rigs.study.tuning import search

VERBS = {verb.name: verb for verb in load_verbs()}


@pytest.mark.parametrize("verb", VERBS.values(), ids=VERBS)
def test_docstring_describes_every_parameter(verb: Verb) -> None:
    described = {name.strip("*") for name in verb.docstring.parameters}
    assert described == inspect.signature(verb.function).parameters.keys()
    assert getattr(anhyst, verb.name) is verb.function
    assert verb.name in anhyst.__all__


@pytest.mark.parametrize("verb", VERBS.values(), ids=VERBS)
def test_command_has_the_parameters_and_defaults_of_the_function(verb: Verb) -> None:
    command = typer.main.get_command(cli.app).commands[verb.command]  # type: ignore[attr-defined]
    defaults = {param.name: param.default for param in command.params if not param.required}
    command_options = {} if verb.is_endless else {"as_json": False, "_verbose": False}
    in_python = {name: parameter.default for name, parameter in verb.parameters.items()}
    assert defaults == {
        name: Path(value) if (verb.name, name) == ("report", "out") else value
        for name, value in (in_python | command_options).items()
        if name in defaults
    }
    assert {param.name for param in command.params} == in_python.keys() | command_options.keys()
    assert all(param.help for param in command.params)


def test_verbs_of_missing_packages_are_listed_completely() -> None:
    for part, names in PROJECT_PACKAGES.items():
        folder = import_module(f"{part.replace('-', '_')}.verbs")
        assert sorted(names) == [verb.name for verb in iter_modules(folder.__path__)]


def test_reading_options_are_the_parameters_of_read_loops() -> None:
    takes = inspect.signature(anhyst.read_loops).parameters
    names = inspect.signature(read_options).parameters.keys() - {"clean"}
    assert {takes[name].default for name in names} == {None}
    assert read_docstring(read_options).parameters.keys() - {"clean"} == names


def test_literals_of_a_signature_are_those_of_the_package() -> None:
    for verb, name, words in (
        ("compile", "SignalFormat", SignalFormat),
        ("compile", "CompensatorKind", StageKind),
        ("fleet", "Kind", Kind),
        ("fleet", "SignalFormat", SignalFormat),
        ("export", "ModelComponent", exporter.ExportedPart),
        ("export", "ExportForm", exporter.ExportForm),
    ):
        assert set(get_args(getattr(VERBS[verb].module, name))) <= set(get_args(words)), verb
    law = VERBS["identify"].docstring.parameters["law"].text
    assert all(name in law for name in LAWS)
    assert VERBS["tune"].parameters["budget"].default == search.DEFAULT_BUDGET
    steps = inspect.signature(anhyst.verify).parameters
    assert steps["host_steps"].default == HOST_STEPS
    assert steps["target_steps"].default == TARGET_STEPS


NEW = '''"""The verb ``weigh_parts``."""

from __future__ import annotations

PLACE = 26, "Use a model"


def weigh_parts(part: PathLike, *, count: int = 1, unit: Unit = "kg", known: str = "") -> dict:
    """Return the mass of some parts.

    Exit code 1 if `count` is too large.

    Parameters
    ----------
    part : path-like
        A file.
    count : int, 1 to 9, ``N``
        Number of parts.
    unit : str
        Unit of the mass.
    known : str, ``--as TEXT``, optional
        What it is called; see `count`.

    Examples
    --------
    anhyst weigh-parts part.step --count 2
    """
    return {"part": part.name, "mass": 2.0 * count, "unit": unit, "name": known}


def as_json(result, given):
    return result


def show(result, given):
    yield f"{result['mass']} {result['unit']}"


def refuse(result, given):
    from anhyst import NegativeResult

    if given["count"] > 5:
        raise NegativeResult("too heavy", code="too-heavy")


from typing import Literal
Unit = Literal["kg", "g"]
'''


@pytest.fixture
def new_verb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Add one file to the folder of the commands, and change nothing else."""
    (tmp_path / "weigh_parts.py").write_text(NEW)
    monkeypatch.setattr(verbs, "__path__", [*verbs.__path__, str(tmp_path)])
    _find_all.cache_clear()
    new_app = typer.Typer(rich_markup_mode="markdown")
    for verb in load_verbs():
        add_command(new_app, verb)
    monkeypatch.setattr(cli, "app", new_app)
    yield
    _find_all.cache_clear()


@pytest.mark.usefixtures("new_verb")
def test_a_new_verb_is_one_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == 0
    assert "Return the mass of some parts." in capsys.readouterr().out
    assert cli.main(["weigh-parts", "--help"]) == 0
    shown = capsys.readouterr().out
    for text in (
        "Exit code 1 if --count is too large.",
        "Example: anhyst weigh-parts part.step --count 2",
        "PART",
        "N [1<=x<=9]",
        "--as",
        "see --count",
        "--json",
        "[default: kg]",
    ):
        assert text in shown
    assert cli.main(["weigh-parts", "a.step", "--count", "3"]) == 0
    assert capsys.readouterr().out == "6.0 kg\n"
    assert cli.main(["weigh-parts", "a.step", "--unit", "g", "--as", "x", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found == {"part": "a.step", "mass": 2.0, "unit": "g", "name": "x"}
    assert cli.main(["weigh-parts", "a.step", "--count", "6"]) == 1
    assert capsys.readouterr().err == "anhyst: too heavy\n"
    assert cli.main(["weigh-parts", "a.step", "--count", "10"]) == 2
    assert "--count" in capsys.readouterr().err
    assert anhyst.weigh_parts(Path("b"))["mass"] == 2.0


def test_texts_are_worded_for_the_command_line() -> None:
    flags = {"known": "--rig", "port": "--port"}
    assert use_option_names("With `port` or `known`: ``x``", flags) == "With --port or --rig: x"
    assert use_option_names("as for `verify`", flags) == "as for 'verify'"
