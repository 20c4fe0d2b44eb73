"""``verify`` rejects an unsuitable folder, target or machine."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from tests.refusals import says

from .command import ENVIRONMENT, anhyst, contents, quick, refused, said_in_one_line
from .records import model


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("verify")
    (place / "model.toml").write_text(model())
    given = ("--rate", "1e4", "--accuracy", "5", "--out", "c")
    completed = quick("compile", "model.toml", *given, cwd=place)
    assert completed.returncode == 0, completed.stderr
    return place


@pytest.fixture
def folder(compiled: Path, tmp_path: Path) -> Path:
    shutil.copytree(compiled, tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_an_unknown_target(folder: Path) -> None:
    message = refused("verify", "c", "--on", "host,cortex-m5", cwd=folder)
    assert says(message, "unknown-target")
    assert says(refused("verify", "c", "--on", ",", cwd=folder), "no-target")


@pytest.mark.first(2)
@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("avr", "avr-gcc (apt install gcc-avr avr-libc)"),
        ("msp430", "mspdebug (apt install mspdebug)"),
        ("cortex-m3-qemu", "qemu-system-arm (apt install qemu-system-arm)"),
    ],
)
def test_a_tool_that_is_not_installed_names_its_package(
    folder: Path, monkeypatch: pytest.MonkeyPatch, target: str, message: str
) -> None:
    (folder / "empty").mkdir()
    monkeypatch.setitem(ENVIRONMENT, "PATH", str(folder / "empty"))
    before = contents(folder)
    result = anhyst("verify", "c", "--on", target, cwd=folder)
    assert says(said_in_one_line(result), f"no-target: {target}: {message}")
    assert contents(folder) == before


def test_a_folder_that_compile_did_not_write(folder: Path) -> None:
    (folder / "other").mkdir()
    assert says(refused("verify", "other", cwd=folder), "no-manifest: other")
    assert says(refused("verify", "none", cwd=folder), "no-such-folder: none")
    assert says(
        refused("verify", "model.toml", cwd=folder), "wrong-kind: model.toml; this is a model; verify"
    )


def test_a_manifest_that_was_edited(folder: Path) -> None:
    place = folder / "c" / "manifest.json"
    right = json.loads(place.read_text())
    for wrong, message in (
        ("{", "damaged-manifest: c/manifest.json"),
        (json.dumps({**right, "format": 1}), "damaged-manifest format: c/manifest.json"),
        (json.dumps({**right, "io": "q7"}), "not-verifiable io: c/manifest.json; q7"),
        (json.dumps({**right, "files": {}}), "damaged-manifest files: c/manifest.json; magnet_parameters.h"),
        (
            json.dumps({**right, "files": {**right["files"], "src/compensator/full.c": "0"}}),
            "changed-since: c/src/compensator/full.c",
        ),
    ):
        place.write_text(wrong)
        assert says(refused("verify", "c", cwd=folder), message)


def test_c_that_was_edited_is_not_verified(folder: Path) -> None:
    parameters = folder / "c" / "magnet_parameters.c"
    parameters.write_text(parameters.read_text() + "\n")
    message = refused("verify", "c", cwd=folder)
    assert says(message, "changed-since: c/magnet_parameters.c")
