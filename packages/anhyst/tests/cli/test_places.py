"""Outputs that cannot be written are rejected early if possible, and leave no files."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.refusals import says

from .command import COMMAND, ENVIRONMENT, PATIENCE, contents, quick, refused, said_in_one_line
from .records import PLAIN, model, table
from .warm import as_ordinary_user

WRITERS = {
    "identify": (["identify", "loops.csv", *PLAIN, "--out"], "model.toml"),
    "predict": (["predict", "good.toml", "loops.csv", "--out"], "force.csv"),
    "invert": (["invert", "good.toml", "loops.csv", "--out"], "current.csv"),
    "inspect": (["inspect", "loops.csv", "--plot"], "loops.png"),
    "report": (["report", "good.toml", "--out"], "report.html"),
}
LARGE = {verb: call for verb, call in WRITERS.items() if verb != "report"}
"""Commands with large outputs; without the report, which needs measurements."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "loops.csv").write_text(table())
    (tmp_path / "good.toml").write_text(model())
    return tmp_path


@pytest.mark.parametrize("verb", WRITERS)
def test_a_missing_folder_is_reported_at_once(folder: Path, verb: str) -> None:
    start, name = WRITERS[verb]
    message = refused(*start, f"none/{name}", cwd=folder)
    assert says(message, f"cannot-be-written: none/{name}")


@pytest.mark.parametrize("verb", WRITERS)
def test_a_folder_is_not_written_over(folder: Path, verb: str) -> None:
    start, name = WRITERS[verb]
    (folder / name).mkdir()
    message = refused(*start, name, cwd=folder)
    assert says(message, f"cannot-be-written: {name}")


def permissions_count(folder: Path) -> bool:
    """Whether folder permissions keep out a child that is not root."""
    probe = [sys.executable, "-c", "open('probe', 'w')"]
    result = subprocess.run(
        probe, cwd=folder, capture_output=True, preexec_fn=as_ordinary_user(), check=False
    )
    return result.returncode != 0


@pytest.mark.parametrize("verb", WRITERS)
def test_a_read_only_folder_is_reported_at_once(folder: Path, verb: str) -> None:
    start, name = WRITERS[verb]
    locked = folder / "locked"
    locked.mkdir(mode=0o555)
    if not permissions_count(locked):
        pytest.skip("permissions of folders do not count here")
    message = refused(*start, f"locked/{name}", cwd=folder, ordinary=True)
    assert says(message, f"cannot-be-written: locked/{name}")


NO_BYTECODE = {"PYTHONDONTWRITEBYTECODE": "1"}
"""For commands with limited file sizes: Python would leave incomplete bytecode files."""


@pytest.mark.first(3)
@pytest.mark.parametrize("verb", LARGE)
def test_a_full_disk_leaves_the_old_file_unchanged(folder: Path, verb: str) -> None:
    start, name = LARGE[verb]
    (folder / name).write_text("old")
    before = contents(folder)
    result = quick(*start, name, cwd=folder, file_size=2000)
    message = said_in_one_line(result)
    assert says(message, f"cannot-be-written: {name}")
    assert contents(folder) == before


def test_a_disk_without_room_for_a_checkpoint_is_reported(folder: Path) -> None:
    start, name = WRITERS["identify"]
    verb, *rest = start
    paper = [verb, "--search", "paper", *rest]

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))

    # The output of a warm command goes through a file, so that it needs a cold start.
    message = refused(*paper, name, cwd=folder, preexec_fn=limit, variables=NO_BYTECODE)
    assert message.startswith(f"{name}.checkpoint: cannot be written: File too large")


@pytest.mark.first(3)
@pytest.mark.parametrize("verb", LARGE)
def test_a_device_that_is_full_is_reported(folder: Path, verb: str) -> None:
    if not Path("/dev/full").is_char_device():
        pytest.skip("no /dev/full here")
    (folder / "full.png").symlink_to("/dev/full")
    start, _ = LARGE[verb]
    out = "full.png" if verb == "inspect" else "/dev/full"
    result = quick(*start, out, cwd=folder)
    assert result.returncode == 2, result.stderr
    assert says(result.stderr.splitlines()[-1], f"cannot-be-written: {out}")
    assert not list(Path("/dev").glob("full.*"))


def on_a_small_disk(folder: Path, command: list[str], *, read_only: bool) -> str:
    """Run a command in its own file system, 32 KiB large or read-only; list its files afterwards."""
    if os.geteuid() != 0 or shutil.which("unshare") is None:
        pytest.skip("only root can mount a small disk")
    (folder / "disk").mkdir()
    options = "size=32k" + (",ro" if read_only else "")
    script = f'mount -t tmpfs -o {options} none disk || exit 77; "$@"; echo $?; ls -A disk'
    result = subprocess.run(
        ["unshare", "--mount", "sh", "-c", script, "sh", *command],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE,
        env=ENVIRONMENT,
    )
    if result.returncode == 77:
        pytest.skip("mounting is not allowed here")
    code, *left = result.stdout.splitlines()
    assert code == "2", result
    assert left == []
    assert result.stderr.count("\n") == 1
    return result.stderr.strip()


def test_a_disk_that_is_really_full_is_reported(folder: Path) -> None:
    # Forty times the record: more than the disk holds, written in pieces.
    header, *lines = table().splitlines()
    (folder / "long.csv").write_text("\n".join([header, *lines * 40]) + "\n")
    options = ["--columns", "t_s="]
    message = on_a_small_disk(
        folder,
        [*COMMAND, "predict", "good.toml", "long.csv", "--out", "disk/force.csv", *options],
        read_only=False,
    )
    assert says(message, "cannot-be-written: disk/force.csv; No space left on device; free some space")


def test_a_read_only_disk_is_reported(folder: Path) -> None:
    message = on_a_small_disk(
        folder, [*COMMAND, "identify", "loops.csv", "--out", "disk/model.toml"], read_only=True
    )
    assert says(message, "cannot-be-written: disk/model.toml; Read-only file system")
