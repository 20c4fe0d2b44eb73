"""Test the files that ``simulate`` writes for a stage, and its errors for invalid files."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from anhyst.cli import app as cli
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.loop import Feedforward, track
from anhyst_rigs.study.tracking import calibrate as calibration
from tests.page import Page
from tests.refusals import says
from tests.repository import ROOT
from tests.study import bearings
from tests.study.stages import recorded, setup, training

from .command import quick, refused, unwrapped

EXAMPLE = ROOT / "examples" / "stage"
SECOND = re.findall(r"\[\[magnet\]\]\nname = \"second\".*?\n\n", (EXAMPLE / "rig.toml").read_text(), re.S)[0]
"""Table of the second magnet in the file."""
CASES = ["none", "gap zero", "current scale", "pinning", "Hall gain", "eddy lag", "all"]
"""Error cases of the plants in the example."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("rig.toml", "loops.csv", "loops.toml"):
        shutil.copy(EXAMPLE / name, tmp_path)
    return tmp_path


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert text.count(old) == 1, old
    path.write_text(text.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        pytest.param(SECOND, "", "missing magnet: a second [[magnet]]", id="one magnet"),
        pytest.param(
            "snap_phase_s = 2e-3", "snap_phase_s = 4e-3", "phases-too-long", id="snap longer than jerk"
        ),
        pytest.param(
            "speed_m_per_s = 0.5", "speed_m_per_s = 0.1", "not-reached", id="acceleration out of reach"
        ),
        pytest.param(
            'kind = "electromagnet"',
            'kind = "law"\nmodel = "model.toml"',
            "not-for-this-kind magnet[1].kind: electromagnet",
            id="a law",
        ),
        pytest.param("slit_s = 0.01", "slit_s = 0.06", "too-long", id="slit"),
        pytest.param("stray_m", "stray_mm", "extra-forbidden frame.stray_mm: stray_m", id="misspelt"),
    ],
)
def test_a_stage_that_will_not_do_is_named_by_file_and_key(
    folder: Path, old: str, new: str, message: str
) -> None:
    change(folder / "rig.toml", old, new)
    assert says(refused("simulate", "rig.toml", "--out", "run.csv", cwd=folder), message)
    assert not (folder / "run.csv").exists()


def test_a_stage_refuses_options_of_a_bearing(folder: Path) -> None:
    text = refused("simulate", "rig.toml", "--out", "map.json", "--board", "host", cwd=folder)
    assert says(text, "option-not-for-this")


@pytest.mark.slow
def test_a_stage_is_recorded_measured_and_reported(folder: Path) -> None:
    rig = folder / "rig.toml"
    change(rig, "[22.0, 16.0, 8.0, 20.0, 12.0]", "[22.0, 12.0]")
    change(rig, "[22.0, 10.0, 18.0, 6.0, 14.0, 22.0]", "[22.0, 18.0]")
    change(rig, "noise_seeds = 10", "noise_seeds = 2")
    change(rig, "[loops]", '[loops]\nlaw = "effective-field"')
    (folder / "out").mkdir()
    completed = quick("simulate", "rig.toml", "--out", "out/run.csv", "--verbose", cwd=folder)
    assert completed.returncode == 0, completed.stderr
    assert "against 'single-valued': Worth it" in unwrapped(completed.stdout)
    head = (folder / "out" / "run.csv").read_text().splitlines()[0].split(",")
    assert {"t_s", "reference_m", "position_m", "error_m", "force_N"} <= set(head)
    figures = json.loads((folder / "out" / "figures.json").read_text())
    assert {"single-valued", "full", "flux"} <= set(figures["variants"])
    page = (folder / "out" / "report.html").read_text()
    for key in ("scan", "learning", "limits"):
        assert f'id="{key}"' in page
    Page(page).check_answer_first()
    wrong = quick("simulate", "rig.toml", "--out", "w.jsonl", "--monte-carlo", "2", cwd=folder)
    assert wrong.returncode == 0, wrong.stderr
    found = json.loads((folder / "montecarlo.json").read_text())
    assert [row["error"] for row in found["variants"]["full"]["average_m"]] == CASES


def test_calibrate_without_estimates_exits_with_1_and_writes_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    gently = replace(training(), peaks=(0.5, 0.5), speed=0.01)
    track(setup("full"), gently, Feedforward(), 1).save(folder / "run.csv")
    monkeypatch.setattr(calibration, "identify_stage_magnet", lambda _: bearings.knowledge())
    place = folder / "calibration.toml"
    given = (folder / "rig.toml", folder / "run.csv", "--out", place)
    assert cli.main(["calibrate", *map(str, given)]) == 1
    assert says(capsys.readouterr().err, "nothing-learnt")
    assert not place.exists()


@pytest.mark.slow
def test_calibrate_reports_estimates_and_writes_a_calibration_file(folder: Path) -> None:
    recorded().save(folder / "run.csv")
    command = ("calibrate", "rig.toml", "run.csv", "--out", "calibration.toml", "--verbose")
    completed = quick(*command, cwd=folder)
    assert completed.returncode == 0, completed.stderr
    for text in ("full", "scale_1", "trusted: mass of 10 kg", "fixed", "calibration.toml"):
        assert text in completed.stdout
    change(folder / "rig.toml", "force_max_N = 240.0", 'force_max_N = 240.0\ncalibration = "run.csv"')
    assert "run.csv" in refused("simulate", "rig.toml", "--out", "again.csv", cwd=folder)
    change(folder / "rig.toml", '"run.csv"', '"calibration.toml"')
    rig = read_stage(folder / "rig.toml")
    found = rig.method_calibration("full")
    assert found is not None
    assert found.value("lag_s") > 20e-6
    assert says(
        refused("calibrate", "rig.toml", "run.csv", "--out", "run.csv", cwd=folder), "writes-over-input"
    )
