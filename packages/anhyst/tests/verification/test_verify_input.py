"""Test bad input of ``anhyst verify``: one line, exit code 2."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from anhyst.cli.app import main
from anhyst.compilation.manifest import check_folder
from anhyst.verification import verify
from tests.refusals import refused, says
from tests.verification.conftest import Compile, sign


def complaint(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main(["verify", *map(str, arguments)]) == 2
    message = capsys.readouterr()
    assert message.out == ""
    assert message.err.startswith("anhyst: error: ")
    assert message.err.count("\n") == 1
    return message.err


@pytest.fixture
def copied(compiled: Compile, tmp_path: Path) -> Path:
    folder = tmp_path / "copy"
    shutil.copytree(compiled("full", "q31"), folder)
    return folder


@pytest.mark.slow
def test_the_command_writes_both_files_and_prints_tables(
    copied: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", str(copied), "--on", "cortex-m4"]) == 0
    message = json.loads((copied / "verify.json").read_text(encoding="utf-8"))
    assert message["passed"] is True
    text = (copied / "verify.md").read_text(encoding="utf-8")
    assert "full, q31, seed 1: identical everywhere." in text
    table = capsys.readouterr().out
    assert "cortex-m4 (port header)" in table
    assert "identical" in table


def test_a_verified_folder_may_be_compiled_again(copied: Path) -> None:
    (copied / "verify.json").write_text("{}", encoding="utf-8")
    (copied / "verify.md").write_text("old", encoding="utf-8")
    check_folder(copied)
    (copied / "notes.md").write_text("mine", encoding="utf-8")
    with refused("folder-holds-other-files"):
        check_folder(copied)


@pytest.mark.slow
def test_an_unknown_target(compiled: Compile, capsys: pytest.CaptureFixture[str]) -> None:
    message = complaint(capsys, compiled("full", "q31"), "--on", "host,cortex-m5")
    assert "cortex-m5" in message
    assert "cortex-m4" in message
    assert says(complaint(capsys, compiled("full", "q31"), "--on", " , "), "no-target")
    assert says(complaint(capsys, compiled("full", "f32"), "--on", "avr"), "target-not-for-this")


def test_a_missing_or_foreign_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert says(complaint(capsys, tmp_path / "none"), "no-such-folder")
    assert says(complaint(capsys, tmp_path), "no-manifest")


def test_a_manifest_that_cannot_be_read(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = copied / "manifest.json"
    right = json.loads(place.read_text(encoding="utf-8"))
    for wrong, expected in (
        ("{", "damaged-manifest"),
        ("[]", "damaged-manifest format"),
        (json.dumps({**right, "format": 99}), "damaged-manifest format"),
        (json.dumps({**right, "files": 3}), "damaged-manifest files"),
        (json.dumps({**right, "files": {}}), "damaged-manifest files"),
        (json.dumps({**right, "io": "q7"}), "not-verifiable io: q7"),
        (json.dumps({**right, "io": None}), "damaged-manifest io"),
    ):
        place.write_text(wrong, encoding="utf-8")
        assert says(complaint(capsys, copied), expected)


def test_a_file_that_was_changed_or_is_missing(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with (copied / "src" / "compensator" / "full.c").open("a", encoding="utf-8") as stream:
        stream.write("/* mine */\n")
    message = complaint(capsys, copied)
    assert says(message, "changed-since: full.c")
    (copied / "src" / "compensator" / "full.c").unlink()
    assert says(complaint(capsys, copied), "damaged-manifest: full.c")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("demand,gap\n1,2\n", "damaged-vectors"),
        ("demand,gap,current\n1,2,x\n", "damaged-vectors"),
        ("demand,gap,current\n1,2\n", "damaged-vectors"),
        ("demand,gap,applied,current\n", "damaged-vectors"),
        ("demand,gap,current\n1,2,99999999999\n", "damaged-vectors"),
    ],
)
def test_golden_codes_that_cannot_be_read(
    copied: Path, capsys: pytest.CaptureFixture[str], text: str, expected: str
) -> None:
    (copied / "vectors.csv").write_text(text, encoding="utf-8")
    sign(copied)
    assert says(complaint(capsys, copied), expected)


@pytest.mark.parametrize("numbers", [(0, 1, 1), (1, 0, 1), (1, 1, 0), (1, 1, 1 << 32)])
def test_numbers_out_of_range(compiled: Compile, numbers: tuple[int, int, int]) -> None:
    with refused("out-of-range"):
        verify(compiled("full", "q31"), "cortex-m4", *numbers)
