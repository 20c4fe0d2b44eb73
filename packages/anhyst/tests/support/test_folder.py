"""A folder is written completely, or the old one is unchanged."""

from __future__ import annotations

from pathlib import Path

import pytest

from anhyst.support.atomic import atomic_folder, check_folder_writable, json_text, relative_path, write_files
from tests.refusals import refused

OLD = {"kept.txt": "old", "sub/other.txt": "old"}
NEW = {"sub/other.txt": "new", "sub/deeper/more.txt": "new"}


def contents(folder: Path) -> dict[str, str]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_text() for path in files}


@pytest.mark.parametrize(("replace", "expected"), [(True, NEW), (False, {**OLD, **NEW})])
def test_a_finished_folder_appears_at_its_final_path(
    tmp_path: Path, replace: bool, expected: dict[str, str]
) -> None:
    write_files(tmp_path / "out", OLD)
    with atomic_folder(tmp_path / "out", replace=replace) as draft:
        write_files(draft, NEW)
        assert contents(tmp_path / "out").items() >= OLD.items(), "nothing moves before the end"
    assert contents(tmp_path) == {f"out/{name}": text for name, text in expected.items()}


def interrupted(out: Path, replace: bool) -> None:
    with atomic_folder(out, replace=replace) as draft:
        write_files(draft, NEW)
        raise KeyboardInterrupt


@pytest.mark.parametrize("there", [True, False])
@pytest.mark.parametrize("replace", [True, False])
def test_a_failure_leaves_the_folder_unchanged(tmp_path: Path, there: bool, replace: bool) -> None:
    if there:
        write_files(tmp_path / "out", OLD)
    with pytest.raises(KeyboardInterrupt):
        interrupted(tmp_path / "out", replace)
    assert contents(tmp_path) == ({f"out/{name}": text for name, text in OLD.items()} if there else {})
    assert (tmp_path / "out").exists() == there


def test_a_failed_move_reverts_earlier_moves(tmp_path: Path) -> None:
    write_files(tmp_path / "out", {"z/in_the_way": "a file below a folder of that name"})
    with refused("cannot-be-written EISDIR"), atomic_folder(tmp_path / "out") as draft:
        write_files(draft, {"a/first.txt": "new", "z": "a file of the same name as a folder"})
    assert list(contents(tmp_path / "out")) == ["z/in_the_way"]
    assert not (tmp_path / "out" / "a").exists()


@pytest.mark.parametrize("replace", [True, False])
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("file", "is-a-file: name a folder"),
        ("file/out", "cannot-be-written ENOTDIR"),
        ("o" * 300, "cannot-be-written ENAMETOOLONG: shorten it"),
        ("/proc/out", "cannot-be-written: /proc/out"),
    ],
)
def test_an_impossible_folder_is_refused_before_the_work(
    tmp_path: Path, name: str, said: str, replace: bool
) -> None:
    (tmp_path / "file").write_text("a file")
    with refused(said):
        check_folder_writable(tmp_path / name, replace=replace)


@pytest.mark.parametrize("replace", [True, False])
@pytest.mark.parametrize("name", ["there", "new", "new/deeper"])
def test_the_check_of_a_folder_leaves_nothing(tmp_path: Path, name: str, replace: bool) -> None:
    (tmp_path / "there").mkdir()
    check_folder_writable(tmp_path / name, replace=replace)
    assert [path.name for path in tmp_path.rglob("*")] == ["there"]


def test_a_file_in_the_way_is_named(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with refused("is-a-file"), atomic_folder(tmp_path / "out"):
        pass


def test_json_has_null_for_non_finite_numbers() -> None:
    assert json_text({"a": [1.5, float("inf")], "b": ({"c": float("nan")},)}) == (
        '{\n  "a": [\n    1.5,\n    null\n  ],\n  "b": [\n    {\n      "c": null\n    }\n  ]\n}\n'
    )


def test_a_file_is_named_as_the_system_finds_it_from_a_folder_behind_a_link(tmp_path: Path) -> None:
    (tmp_path / "rig").mkdir()
    (tmp_path / "rig" / "loops.csv").write_text("measured")
    far = tmp_path / "other" / "disk" / "tuned"
    far.mkdir(parents=True)
    link = tmp_path / "rig" / "tuned"
    link.symlink_to(far)
    named = relative_path(link, tmp_path / "rig" / "loops.csv")
    assert (link / named).read_text() == "measured"
    assert relative_path(tmp_path / "rig", tmp_path / "rig" / "loops.csv") == "loops.csv"
