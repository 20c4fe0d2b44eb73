"""Test how the command line starts and exits."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Callable

import pytest
import typer

from anhyst.cli import app as cli
from anhyst.support.errors import InputError, NegativeResult

VERBS = (
    "excite",
    "convert",
    "inspect",
    "identify",
    "predict",
    "invert",
    "report",
    "diff",
    "compile",
    "verify",
    "force-control",
    "simulate",
    "tune",
    "watch",
    "fleet",
    "export",
)


def anhyst(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "anhyst.cli.app", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([verb, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"Example: anhyst {verb} " in text
    assert "--json" in text


def test_every_verb_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f" {verb} " in text for verb in VERBS)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["predict"], ""),
        (["predict", "model.toml", "drive.csv"], "Missing option '--out'"),
        (["predict", "--frce"], "No such option: --frce"),
        (["precict"], "No such command 'precict'"),
        (["identify", "x.csv", "--out", "m.toml", "--seed", "one"], "Invalid value for '--seed'"),
        (["identify", "x.csv", "--out", "m.toml", "--gap-map", "x"], "Invalid value for '--gap-map'"),
    ],
)
def test_wrong_usage_is_bad_input(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(arguments) == 2
    error = capsys.readouterr().err
    if message:
        assert error.startswith(f"anhyst: error: {message}")
        assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("failure", "code", "line"),
    [
        (InputError("f.csv: is\nempty", code="empty-file"), 2, "anhyst: error: f.csv: is empty\n"),
        (NegativeResult("no", code="drifted"), 1, "anhyst: no\n"),
        (KeyboardInterrupt(), 130, "anhyst: interrupted\n"),
        (MemoryError(), 2, "anhyst: error: not enough memory for this; thin the data"),
        (
            OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "m.toml"),
            2,
            "anhyst: error: m.toml: No space left on device; free some space\n",
        ),
    ],
)
def test_every_ending_has_its_code_and_line(
    failure: BaseException,
    code: int,
    line: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    broken = typer.Typer()

    @broken.callback(invoke_without_command=True)
    def fail() -> None:
        raise failure

    monkeypatch.setattr(cli, "app", broken)
    assert cli.main([]) == code
    captured = capsys.readouterr()
    assert captured.err.startswith(line)
    assert captured.err.count("\n") == 1
    assert captured.out.strip() == ""


def test_the_version_is_printed_without_loading_unneeded_modules() -> None:
    result = anhyst("--version")
    assert result.returncode == 0
    assert result.stdout.startswith("anhyst ")
    probe = "import sys, anhyst.cli.app; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", probe], capture_output=True, text=True, check=True
    ).stdout.split()
    assert not {"numpy", "scipy", "matplotlib", "pydantic", "anhyst._core"} & set(loaded)


def _as_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)


@pytest.mark.parametrize(("prepare", "visible"), [(None, False), (_as_terminal, True)])
def test_progress_shows_on_a_terminal_only(
    prepare: Callable[[pytest.MonkeyPatch], None] | None,
    visible: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from anhyst.cli.shared import progress_bar

    if prepare:
        prepare(monkeypatch)
    with progress_bar("reading") as update:
        update(1.0, 2.0)
    message = capsys.readouterr()
    assert message.out == ""
    assert ("reading" in message.err) == visible
    assert ("50 %" in message.err) == visible


def test_an_internal_error_is_one_line_with_exit_code_70(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(**_: object) -> int:
        raise ZeroDivisionError("division by zero")

    monkeypatch.delenv("ANHYST_TRACE", raising=False)
    monkeypatch.setattr(cli, "build_command", lambda verbs: fail)
    assert cli.main(["inspect"]) == 70
    message = capsys.readouterr().err
    assert message.startswith("anhyst: error: ZeroDivisionError: division by zero; ")
    assert message.count("\n") == 1
    monkeypatch.setenv("ANHYST_TRACE", "1")
    with pytest.raises(ZeroDivisionError):
        cli.main(["inspect"])
