"""Files are written completely or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from anhyst.support.atomic import atomic_writer, check_writable, write_bytes
from tests.refusals import refused


def test_a_file_appears_only_when_complete(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    with atomic_writer(path) as stream:
        stream.write("half")
        stream.flush()
        assert not path.exists()
    assert path.read_text() == "half"
    assert os.listdir(tmp_path) == ["model.toml"]


@pytest.mark.parametrize("failure", [KeyboardInterrupt, MemoryError, ValueError])
def test_a_failure_leaves_only_the_old_file(tmp_path: Path, failure: type[BaseException]) -> None:
    path = tmp_path / "model.toml"
    path.write_text("old")

    def fail_half_way() -> None:
        with atomic_writer(path) as stream:
            stream.write("new")
            raise failure

    with pytest.raises(failure):
        fail_half_way()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["model.toml"]


def test_a_full_disk_is_reported_in_one_line() -> None:
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full to play a full disk")

    def write_much() -> None:
        with atomic_writer("/dev/full") as stream:
            stream.write("x" * 100_000)

    with refused("cannot-be-written ENOSPC"):
        write_much()


def test_a_folder_is_not_written_over(tmp_path: Path) -> None:
    for attempt in (check_writable, lambda path: atomic_writer(path).__enter__()):
        with refused("cannot-be-written EISDIR"):
            attempt(tmp_path)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with refused("cannot-be-written ENOENT"):
        check_writable(tmp_path / "none" / "model.toml")


def test_probing_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text("old")
    check_writable(path)
    check_writable(tmp_path / "new.toml")
    check_writable("/dev/null")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["model.toml"]


def test_symbolic_links_and_file_modes_are_kept(tmp_path: Path) -> None:
    real, link = tmp_path / "real.toml", tmp_path / "link.toml"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real)
    with atomic_writer(link) as stream:
        stream.write("new")
    assert link.is_symlink()
    assert real.read_text() == "new"
    assert real.stat().st_mode & 0o777 == 0o640


def test_a_picture_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    write_bytes(tmp_path / "loops.png", b"\x89PNG")
    assert (tmp_path / "loops.png").read_bytes() == b"\x89PNG"
    with refused("cannot-be-written ENOENT"):
        write_bytes(tmp_path / "none" / "loops.png", b"\x89PNG")
    write_bytes("/dev/null", b"gone")
    assert os.listdir(tmp_path) == ["loops.png"]
