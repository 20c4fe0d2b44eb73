"""What ``verify`` says to a folder, a target or a machine that will not do."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from tests.refusals import says

from .command import ENVIRONMENT, anhyst, contents, quick, refused, said_in_one_line
from .records import model

AGAIN = "run 'anhyst compile' again"


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("verify")
    (place / "model.toml").write_text(model())
    given = ("--rate", "1e4", "--accuracy", "5", "--out", "c")
    done = quick("compile", "model.toml", *given, cwd=place)
    assert done.returncode == 0, done.stderr
    return place


@pytest.fixture
def folder(compiled: Path, tmp_path: Path) -> Path:
    shutil.copytree(compiled, tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_an_unknown_target(folder: Path) -> None:
    said = refused("verify", "c", "--on", "host,cortex-m5", cwd=folder)
    assert says(said, "unknown-target")
    assert says(refused("verify", "c", "--on", ",", cwd=folder), "no-target")


@pytest.mark.parametrize(
    ("target", "said"),
    [
        ("avr", "avr-gcc (apt install gcc-avr avr-libc)"),
        ("msp430", "mspdebug (apt install mspdebug)"),
        ("cortex-m3-qemu", "qemu-system-arm (apt install qemu-system-arm)"),
    ],
)
def test_a_tool_that_is_not_installed_names_its_package(
    folder: Path, monkeypatch: pytest.MonkeyPatch, target: str, said: str
) -> None:
    (folder / "empty").mkdir()
    monkeypatch.setitem(ENVIRONMENT, "PATH", str(folder / "empty"))
    before = contents(folder)
    result = anhyst("verify", "c", "--on", target, cwd=folder)
    assert said_in_one_line(result).startswith(f"no target can run; missing is {target}: {said}")
    assert contents(folder) == before


def test_a_folder_that_compile_did_not_write(folder: Path) -> None:
    (folder / "other").mkdir()
    advice = "name the folder 'anhyst compile --out' made"
    assert refused("verify", "other", cwd=folder) == f"other: has no manifest.json; {advice}"
    assert says(refused("verify", "none", cwd=folder), "no-such-folder: none")
    assert says(refused("verify", "model.toml", cwd=folder), "no-such-folder: model.toml")


def test_a_manifest_that_was_edited(folder: Path) -> None:
    place = folder / "c" / "manifest.json"
    right = json.loads(place.read_text())
    for wrong, said in (
        ("{", "c/manifest.json: is not JSON: "),
        (json.dumps({**right, "format": 1}), f"c/manifest.json: key 'format' is not 2; {AGAIN}"),
        (json.dumps({**right, "io": "q7"}), "c/manifest.json: key 'io': q7 cannot be verified"),
        (
            json.dumps({**right, "files": {}}),
            "c/manifest.json: key 'files' does not name magnet_parameters.h",
        ),
        (
            json.dumps({**right, "files": {**right["files"], "src/compensator/full.c": "0"}}),
            f"c/src/compensator/full.c: was changed since it was written (sha256); {AGAIN}",
        ),
    ):
        place.write_text(wrong)
        assert refused("verify", "c", cwd=folder).startswith(said)


def test_c_that_was_edited_is_not_verified(folder: Path) -> None:
    parameters = folder / "c" / "magnet_parameters.c"
    parameters.write_text(parameters.read_text() + "\n")
    said = refused("verify", "c", cwd=folder)
    assert says(said, "changed-since: c/magnet_parameters.c")
