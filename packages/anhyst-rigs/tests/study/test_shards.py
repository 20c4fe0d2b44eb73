"""Test that the shards of a Monte Carlo run give the files of one run, and that wrong ones are refused."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from anhyst.cli.app import main
from anhyst_rigs.study.engine.monte_carlo import Plants, Shard, merge_shards, monte_carlo, run_numbers
from anhyst_rigs.study.plants import piezo_plants
from tests.refusals import refused
from tests.study import piezos

COUNT = 5


@pytest.fixture(scope="module")
def plants() -> Plants:
    return piezo_plants(piezos.rig())


@pytest.fixture(scope="module")
def whole(plants: Plants, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the results of one run."""
    path = tmp_path_factory.mktemp("whole") / "p.jsonl"
    monte_carlo(plants, path, COUNT, jobs=1)
    return path


@pytest.fixture(scope="module")
def parts(plants: Plants, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of two shards."""
    folder = tmp_path_factory.mktemp("parts")
    for text in ("2/2", "1/2"):
        shard = Shard.parse(text, COUNT, folder / "p.jsonl")
        run_numbers(plants, shard.path, shard.numbers, jobs=1)
    return folder


@pytest.fixture
def folder(parts: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(parts, tmp_path / "parts"))


def test_the_merged_file_equals_that_of_one_run(plants: Plants, whole: Path, folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == ["p.1-of-2.jsonl", "p.2-of-2.jsonl"]
    for _ in range(2):
        merge_shards(plants, folder / "p.jsonl", COUNT)
        assert (folder / "p.jsonl").read_bytes() == whole.read_bytes()


def test_the_order_of_the_work_does_not_change_the_file(plants: Plants, whole: Path, tmp_path: Path) -> None:
    header, *rows = whole.read_text().splitlines(keepends=True)
    (tmp_path / "p.jsonl").write_text(header + "".join(rows[3:1:-1]))
    run_numbers(plants, tmp_path / "p.jsonl", range(COUNT), jobs=1)
    assert (tmp_path / "p.jsonl").read_bytes() == whole.read_bytes()


def change_nothing(_: Path) -> None:
    """Keep all shards; the number of plants is wrong."""


def remove_shard(folder: Path) -> None:
    (folder / "p.2-of-2.jsonl").unlink()


def remove_plant(folder: Path) -> None:
    rows = (folder / "p.1-of-2.jsonl").read_text().splitlines(keepends=True)
    (folder / "p.1-of-2.jsonl").write_text("".join(rows[:-1]) + rows[-1][:-9])


def add_other_division(folder: Path) -> None:
    shutil.copy(folder / "p.2-of-2.jsonl", folder / "p.2-of-3.jsonl")


def double_plant(folder: Path) -> None:
    rows = (folder / "p.1-of-2.jsonl").read_text().splitlines(keepends=True)
    (folder / "p.1-of-2.jsonl").write_text("".join([*rows, rows[-1]]))


def change_seed(folder: Path) -> None:
    header, rows = (folder / "p.2-of-2.jsonl").read_text().split("\n", 1)
    (folder / "p.2-of-2.jsonl").write_text(json.dumps(json.loads(header) | {"seed": 99}) + "\n" + rows)


@pytest.mark.parametrize(
    ("change", "count", "said"),
    [
        (remove_shard, COUNT, "shards-differ: has 3 of 5 plants; plant 1 is missing; run its shard again"),
        (remove_plant, COUNT, "shards-differ: has 4 of 5 plants; plant 4 is missing; run its shard again"),
        (
            change_nothing,
            COUNT - 1,
            "shards-differ: 4 of 4 plants; 1 others; plant 4 is not expected; --monte-carlo",
        ),
        (change_nothing, COUNT + 1, "shards-differ: has 5 of 6 plants; plant 5 is missing"),
        (add_other_division, COUNT, "shards-differ: p.2-of-3.jsonl; plant 1 is in another shard too"),
        (double_plant, COUNT, "damaged-results: p.1-of-2.jsonl; line 5; plant: 4 is there twice"),
        (change_seed, COUNT, "other-results seed: p.2-of-2.jsonl; is 99 in the file"),
    ],
)
def test_wrong_shards_are_refused_and_nothing_is_written(
    plants: Plants, folder: Path, change: Callable[[Path], object], count: int, said: str
) -> None:
    change(folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with refused(said):
        merge_shards(plants, folder / "p.jsonl", count)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("text", ["0/2", "3/2", "2", "1/6", "a/b", "-1/2", ""])
def test_a_part_that_does_not_exist_is_refused(text: str, tmp_path: Path) -> None:
    with refused("bad-shard --shard: 5 plants; give I/N"):
        Shard.parse(text, COUNT, tmp_path / "p.jsonl")


@pytest.mark.slow
def test_the_command_writes_the_files_of_one_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written = {}
    commands: dict[str, list[list[str]]] = {
        "one": [[]],
        "shards": [["--shard", "2/2"], ["--shard", "1/2"], ["--merge"]],
    }
    run = ["simulate", str(piezos.EXAMPLE / "rig.toml"), "--monte-carlo", "3", "--out", "p.jsonl"]
    for name, steps in commands.items():
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        assert [main([*run, *step]) for step in steps] == [0] * len(steps)
        files = ("p.jsonl", "montecarlo.json", "report.html")
        written[name] = [(tmp_path / name / file).read_bytes() for file in files]
    assert written["one"] == written["shards"]
    assert main([*run, "--shard", "1/2", "--merge"]) == 2
    assert main([*run[:2], "--out", "p.csv", "--shard", "1/2"]) == 2
