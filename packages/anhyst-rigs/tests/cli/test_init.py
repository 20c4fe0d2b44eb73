"""Test ``anhyst init``: a new rig from measured loops, and rejected inputs."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from pathlib import Path

import pytest

from anhyst.control.controller_file import read_controller
from anhyst_rigs.rig.bearing.checks import check_controller
from anhyst_rigs.rig.body import read_bearing
from tests.refusals import says
from tests.repository import ROOT

from .command import quick, refused, unwrapped
from .test_places import permissions_count

EXAMPLES = ROOT / "examples"
BEARING = EXAMPLES / "bearing" / "loops.csv"
GIVEN = ("--mass", 2, "--load", 150, "--gap", 0.45e-3)

FILES = ("rig.toml", "controller.toml")
HEAD = "I_A,F_N,gap_m,loop\n"


def loops_text(*gaps: float, top: float = 3.0, sign: float = 1.0) -> str:
    """Return triangles of an ideal magnet without hysteresis: 4 N mm^2/A^2."""
    ups = [top * step / 50 for step in range(51)]
    rows = [
        f"{sign * i:.6g},{4e-6 * (i / (gap + 0.1e-3)) ** 2:.6g},{gap},{gap}\n"
        for gap in gaps
        for i in [*ups, *ups[::-1]]
    ]
    return HEAD + "".join(rows)


def init(folder: Path, *arguments: object) -> Path:
    result = quick("init", *arguments, "--out", "my", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    return folder / "my"


def test_a_draft_recovers_the_numbers_of_the_example_bearing(tmp_path: Path) -> None:
    my = init(tmp_path, BEARING, *GIVEN)
    rig, controller = (tomllib.loads((my / name).read_text()) for name in FILES)
    assert rig["timing"]["rate_Hz"] == 20e3
    assert rig["amplifier"][0]["supply_V"] == 150.0
    assert rig["amplifier"][0]["bandwidth_Hz"] == pytest.approx(2500.0, rel=0.1)
    assert rig["amplifier"][0]["current_high_A"] == 4.5
    assert rig["case"][0]["heights_m"] == [10e-6, 20e-6, 50e-6, 100e-6]
    assert controller["design"]["bandwidth_Hz"] == pytest.approx(120.0, rel=0.05)
    assert controller["limits"]["step_m"] == pytest.approx(20e-6, rel=0.1)
    assert controller["limits"]["force_high_N"] == pytest.approx(290.0, rel=0.05)


def test_every_key_of_a_draft_is_explained(tmp_path: Path) -> None:
    my = init(tmp_path, BEARING)
    for name in FILES:
        for line in (my / name).read_text().splitlines():
            if re.match(r"\w+ = |\[", line):
                assert re.search(r" # \w", line), line


def test_given_values_are_not_guesses_and_others_are_marked_as_guesses(tmp_path: Path) -> None:
    keys = ("mass_kg", "force_N", "gap_m")
    my = init(tmp_path, BEARING)
    lines = (my / "rig.toml").read_text().splitlines()
    assert all("guess: " in line for line in lines if line.split(" = ")[0] in keys)
    shutil.rmtree(my)
    given = init(tmp_path, BEARING, *GIVEN)
    lines = (given / "rig.toml").read_text().splitlines()
    mine = [line for line in lines if line.split(" = ")[0] in keys]
    assert len(mine) == 3
    assert not any("guess" in line for line in mine)


def test_guesses_and_next_commands_are_printed(tmp_path: Path) -> None:
    result = quick("init", BEARING, "--mass", 5, "--out", "my", cwd=tmp_path)
    assert "--load 49.1: the weight of the mass" in unwrapped(result.stdout)
    assert "--gap 0.00045: the middle of the measured gaps" in unwrapped(result.stdout)
    assert "--mass" not in result.stdout
    assert "anhyst simulate my/rig.toml --out my/run.csv" in result.stdout
    assert "anhyst tune my/rig.toml --out my/tuned" in result.stdout


def test_the_result_is_available_as_json(tmp_path: Path) -> None:
    result = quick("init", BEARING, "--out", "my", "--json", cwd=tmp_path)
    found = json.loads(result.stdout)
    assert found["files"] == [*FILES, "loops/loops.csv", "loops/loops.toml"]
    assert found["guesses"]["rig.toml"]["body.mass_kg = 12.0"] == "the load is its weight"


def test_a_drafted_folder_can_be_moved(tmp_path: Path) -> None:
    (tmp_path / "loops.csv").write_text(loops_text(0.3e-3, 0.5e-3))
    init(tmp_path, "loops.csv")
    (tmp_path / "loops.csv").unlink()
    moved = (tmp_path / "my").rename(tmp_path / "elsewhere")
    rig, controller = read_bearing(moved / "rig.toml"), read_controller(moved / "controller.toml")
    check_controller(controller, rig)
    loops = rig.measured_loops.read()
    assert list(loops.by_schedule()) == [0.3e-3, 0.5e-3]


def test_several_files_and_folders_are_accepted(tmp_path: Path) -> None:
    (tmp_path / "near").mkdir()
    for place, gap in (("near/a.csv", 0.3e-3), ("near/b.csv", 0.4e-3), ("far.csv", 0.5e-3)):
        (tmp_path / place).write_text(loops_text(gap))
    my = init(tmp_path, "near", "far.csv")
    rig = read_bearing(my / "rig.toml")
    assert list(rig.measured_loops.read().by_schedule()) == [0.3e-3, 0.4e-3, 0.5e-3]


def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    for place, gap in (("a", 0.3e-3), ("b", 0.5e-3)):
        (tmp_path / place).mkdir()
        (tmp_path / place / "loops.csv").write_text(loops_text(gap))
    message = refused("init", "a", "b", "--out", "my", cwd=tmp_path)
    assert says(message, "name-twice: b/loops.csv; a/loops.csv")


def test_reading_options_are_written_to_the_rig(tmp_path: Path) -> None:
    text = loops_text(0.3e-3, 0.5e-3).replace("I_A", "drive").replace("F_N", "U_V")
    (tmp_path / "loops.csv").write_text(text)
    (tmp_path / "columns.toml").write_text('[columns]\ndrive = "I_A"\nU_V = "F_N"\n')
    my = init(tmp_path, "loops.csv", "--columns", "drive=I_A,U_V=F_N", "--history", "demagnetised")
    read = tomllib.loads((my / "rig.toml").read_text())["loops"]
    assert read == {"files": "loops/loops.csv", "columns": "drive=I_A,U_V=F_N", "history": "demagnetised"}
    shutil.rmtree(my)
    init(tmp_path, "loops.csv", "--sidecar", "columns.toml")
    assert read_bearing(my / "rig.toml").measured_loops.read().output.name == "force"


def test_existing_files_are_not_overwritten(tmp_path: Path) -> None:
    init(tmp_path, BEARING)
    for name in ("rig.toml", "controller.toml", "loops"):
        message = refused("init", BEARING, "--out", "my", cwd=tmp_path)
        assert says(message, f"exists-already: my/{name}")
        path = tmp_path / "my" / name
        path.unlink() if path.is_file() else shutil.rmtree(path)
    (tmp_path / "my" / "notes.txt").write_text("mine")
    init(tmp_path, BEARING)
    assert (tmp_path / "my" / "notes.txt").read_text() == "mine"


def test_a_load_that_cannot_be_lifted_is_refused_with_the_forces(tmp_path: Path) -> None:
    # 4 N mm^2/A^2 at 3 A and 0.1 + 0.5 mm: 100 N
    (tmp_path / "loops.csv").write_text(loops_text(0.3e-3, 0.5e-3))
    message = refused("init", "loops.csv", "--load", 120, "--out", "my", cwd=tmp_path)
    found = re.fullmatch(
        r"loops\.csv: load: 120 N cannot be lifted at a gap of 0\.0005 m: there the loops "
        r"reach (\S+) N at 3 A, and 1\.1 times the load, 132 N, are needed; lower the load, .*",
        message,
    )
    assert found
    assert float(found[1]) == pytest.approx(100.0, rel=0.01)
    message = refused("init", "loops.csv", "--mass", 20, "--out", "my", cwd=tmp_path)
    assert says(message, "load-too-large load")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--gap", 0.6e-3), "gaps-not-covered gap: 0.0006 m; 0.0003"),
        (("--gap", 0.45), "gaps-not-covered gap: 0.00031; 0.00049 m; 0.45e-3 m"),
        (("--gap", 450), "gaps-not-covered gap: 450e-6 m"),
        (("--mass", -1), "not-above-zero mass"),
        (("--load", "nan"), "not-above-zero load"),
        (("--mass", 1e-6, "--load", 40), "pole-too-fast mass: 200000"),
        (("--force-control", "--mass", 1), "option-not-for-this --mass"),
    ],
)
def test_numbers_that_cannot_be_are_refused(tmp_path: Path, arguments: tuple[object, ...], text: str) -> None:
    (tmp_path / "loops.csv").write_text(loops_text(0.3e-3, 0.5e-3))
    assert says(refused("init", "loops.csv", *arguments, "--out", "my", cwd=tmp_path), text)


def test_loops_unsuitable_for_a_rig_are_refused(tmp_path: Path) -> None:
    cases = {
        "one.csv": (loops_text(0.3e-3), "single-gap: 0.0003 m"),
        "down.csv": (loops_text(0.3e-3, 0.5e-3, sign=-1.0), "current-negative"),
        "bh.csv": ("H_A_per_m,B_T\n0,0\n1,1\n2,2\n0,0\n", "columns-missing"),
    }
    for name, (text, message) in cases.items():
        (tmp_path / name).write_text(text)
        assert says(refused("init", name, "--out", "my", cwd=tmp_path), message)
    assert says(refused("init", "--out", "my", cwd=tmp_path), "no-loops")
    assert says(refused("init", BEARING, "--out", "one.csv", cwd=tmp_path), "is-a-file: one.csv")


def test_an_unwritable_folder_is_reported_and_no_file_remains(tmp_path: Path) -> None:
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o555)
    if not permissions_count(locked):
        pytest.skip("permissions of folders do not count here")
    for out in ("locked", "locked/my"):
        message = refused("init", BEARING, "--out", out, cwd=tmp_path, ordinary=True)
        assert says(message, f"cannot-be-written: {out}")
