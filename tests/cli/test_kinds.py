"""Test each command with each kind of file: it accepts the file or names the commands that do.

To show that a command accepts a kind, the test gives it a file of this kind with one misspelt key.
Only the reader of this kind then names the line. Other tests run the commands completely.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import typer

import anhyst
from anhyst.cli.app import app, main
from anhyst.data.formats import FORMATS
from anhyst.support.errors import InputError
from anhyst.support.kinds import MEASUREMENT_SUFFIXES, UNKNOWN_FILE, accepted_kinds, file_kind, rig_kinds
from anhyst_rigs.rig.body import read_bearing
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.rig.piezo import read_piezo_rig
from anhyst_rigs.rig.stage.file import read_stage

from .records import model

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
FILES = {
    "bearing": EXAMPLES / "bearing" / "rig.toml",
    "stage": EXAMPLES / "stage" / "rig.toml",
    "planar": EXAMPLES / "planar" / "rig.toml",
    "piezo": EXAMPLES / "piezo" / "rig.toml",
    "force": EXAMPLES / "solenoid" / "rig.toml",
    "controller": EXAMPLES / "bearing" / "controller.toml",
    "measurement": EXAMPLES / "bearing" / "loops.csv",
}
CALLED = {
    "bearing": "a bearing",
    "stage": "a stage",
    "planar": "a stage",
    "piezo": "a piezo stage",
    "force": "a rig of force control",
    "model": "a model",
    "controller": "a controller file",
    "compiled": "a compiled folder",
    "measurement": "a measurement",
}
MEASURED, MODEL, STAGES = {"measurement"}, {"model"}, {"stage", "planar"}
RIGS = {"bearing", *STAGES, "piezo", "force"}
WORKS = {
    "inspect": MEASURED,
    "convert": MEASURED,
    "identify": MEASURED,
    "fleet": MEASURED,
    "init": MEASURED,
    "predict": MODEL,
    "invert": MODEL,
    "report": MODEL,
    "diff": MODEL,
    "compile": MODEL | STAGES,
    "watch": MODEL,
    "export": {"model", *RIGS},
    "verify": {"compiled"},
    "simulate": RIGS,
    "calibrate": {"bearing", *STAGES},
    "tune": {"bearing", *STAGES, "piezo"},
    "force-control": MEASURED | {"force"},
    "excite": RIGS,
    "live": RIGS | {"compiled"},
    "xcp": set[str](),
}
"""Kinds of file that each command must accept. It must reject all others."""
OPTIONS = {
    "inspect": [],
    "convert": ["out.mat"],
    "predict": ["drive.csv", "--out", "out.csv"],
    "invert": ["drive.csv", "--out", "out.csv"],
    "diff": ["model.toml"],
    "compile": ["--rate", "1000", "--out", "out"],
    "watch": ["drive.csv"],
    "export": ["--as", "simulink", "--out", "out"],
    "verify": [],
    "simulate": ["--out", "out.csv"],
    "calibrate": ["run.csv", "--out", "out.toml"],
    "excite": ["--out", "out.csv"],
    "live": ["--listen", "0"],
    "xcp": [],
}
"""Arguments after the file. Commands that are not listed get ``--out out``."""


def written(kind: str, folder: Path) -> Path:
    """Write a valid file of a kind, with the files that it refers to."""
    if kind == "model":
        path = folder / "model.toml"
        path.write_text(model())
    elif kind == "compiled":
        path = folder / "compiled"
        path.mkdir()
        (path / "manifest.json").write_text('{"product": "anhyst-compiled"}')
    else:
        path = folder / FILES[kind].name
        shutil.copy(FILES[kind], path)
        if kind in RIGS - {"piezo"}:
            for name in ("loops.csv", "loops.toml", "controller.toml", "solenoid.toml"):
                if (FILES[kind].parent / name).exists():
                    shutil.copy(FILES[kind].parent / name, folder)
    return path


def spoil(path: Path) -> str:
    """Make a file invalid for the reader of its kind; return the start of the expected message."""
    if path.is_dir():
        return str(path)
    if path.suffix == ".csv":
        path.write_text("")
        return str(path)
    lines = path.read_text().splitlines()
    format_line = next(n for n, line in enumerate(lines) if line.startswith("format"))
    lines.insert(format_line + 1, "misspelt = 1")
    path.write_text("\n".join(lines) + "\n")
    return f"{path.name}:{format_line + 2}: misspelt"


def refusal(
    verb: str, path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> str:
    """Run a command on a file in the folder of the file; return its one line of exit code 2."""
    monkeypatch.chdir(path.parent)
    assert main([verb, path.name, *OPTIONS.get(verb, ["--out", "out"])]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line.removeprefix("anhyst: error: ")


CELLS = [(verb, kind) for verb in WORKS for kind in CALLED]


@pytest.mark.parametrize(("verb", "kind"), [cell for cell in CELLS if cell[1] not in WORKS[cell[0]]])
def test_a_good_file_of_another_kind_is_refused_by_its_name(
    verb: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(kind, tmp_path)
    files_before = sorted(tmp_path.iterdir())
    complaint = refusal(verb, path, monkeypatch, capsys)
    assert complaint.startswith(f"{path.name}: this is {CALLED[kind]}; {verb} is for ")
    for other_verb, kinds in WORKS.items():
        if kind in kinds:
            assert other_verb in complaint.rpartition(";")[2]
    assert sorted(tmp_path.iterdir()) == files_before


@pytest.mark.parametrize(("verb", "kind"), [cell for cell in CELLS if cell[1] in WORKS[cell[0]]])
def test_every_accepted_kind_reaches_its_reader(
    verb: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(kind, tmp_path)
    (tmp_path / "drive.csv").write_text("t_s,I_A,F_N,gap_m\n0,0,0,5e-4\n1,1,1,5e-4\n")
    if (verb, kind) == ("export", "model"):
        monkeypatch.setitem(OPTIONS, "export", [*OPTIONS["export"], "--rate", "1000"])
    expected = spoil(path)
    complaint = refusal(verb, path, monkeypatch, capsys)
    assert "this is " not in complaint
    assert Path(expected).name in complaint if kind in {"compiled", "measurement"} else expected in complaint
    assert not list(tmp_path.glob("out*"))


@pytest.mark.parametrize(
    ("verb", "kind", "reason"),
    [
        ("tune", "force", "open loop"),
        ("calibrate", "piezo", "no magnets"),
        ("force-control", "piezo", "not to a force"),
        ("compile", "bearing", "--controller"),
    ],
)
def test_a_verb_that_physics_forbids_is_refused_with_the_reason(
    verb: str,
    kind: str,
    reason: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert reason in refusal(verb, written(kind, tmp_path), monkeypatch, capsys)
    for record in rig_kinds().values():
        assert not set(record.verbs) & set(record.reasons)


def test_the_page_lists_the_rigs_of_each_verb() -> None:
    page = (EXAMPLES.parent / "docs" / "commands.md").read_text()
    rows = re.findall(
        r"^\| `([\w-]+)` \|(.*)\|$", page.partition("### What a rig")[2].partition("\n## ")[0], re.M
    )
    columns = [rig_kinds()[word] for word in ("levitation", "tracking", "displacement", "force")]
    assert {verb for verb, _ in rows} == {verb for kind in columns for verb in kind.verbs}
    for verb, cells in rows:
        accepted_flags = [cell.strip() == "yes" for cell in cells.split("|")]
        assert accepted_flags == [kind in accepted_kinds(verb) for kind in columns], verb


def test_every_verb_has_its_row() -> None:
    assert set(typer.main.get_command(app).commands) - {"example"} == set(WORKS)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("read", "kind"),
    [
        (read_bearing, "stage"),
        (read_stage, "bearing"),
        (read_piezo_rig, "model"),
        (read_rig, "piezo"),
        (anhyst.read_model, "force"),
        (anhyst.simulate, "model"),
    ],
)
def test_readers_and_functions_name_the_kind_as_the_verbs_do(
    read: Callable[[Path], object], kind: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        read(written(kind, tmp_path))
    assert f"this is {CALLED[kind]}; " in str(caught.value)


def test_a_file_without_a_kind_is_refused_for_that_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written("stage", tmp_path)
    complete_text = path.read_text()
    for old_text, new_text, key in (
        ('"anhyst-rig"', '"anhyst-rug"', "format"),
        ('"tracking"', '"trackin"', "control.kind"),
    ):
        path.write_text(complete_text.replace(old_text, new_text))
        for verb in ("simulate", "tune", "excite", "force-control"):
            complaint = refusal(verb, path, monkeypatch, capsys)
            assert f": {key}: must be " in complaint
            assert "also wrong" not in complaint


def test_an_ending_of_measurements_is_one_that_is_read() -> None:
    assert set(FORMATS) - {".txt", ".dat"} == MEASUREMENT_SUFFIXES


def test_a_folder_without_manifest_and_a_missing_file_are_of_no_kind(tmp_path: Path) -> None:
    assert file_kind(tmp_path) is UNKNOWN_FILE
    assert file_kind(tmp_path / "none.toml") is UNKNOWN_FILE
