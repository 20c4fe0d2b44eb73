"""Test the file of a stage with one coordinate: any axis, and rejected files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anhyst_rigs.rig.calibration import stage_parameter_names
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.loop import Feedforward, track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.tracking.calibrate import calibrate
from anhyst_rigs.study.tracking.excitation import find_move
from tests.refusals import refused
from tests.study import bearings, stages

TEXT = (stages.EXAMPLE / "rig.toml").read_text(encoding="utf-8")
ALONG_Z = {
    "mass_kg = 10.0": 'mass_kg = 10.0\nfree = ["z"]\ngravity_m_per_s2 = 9.81',
    'iron = "core"\n': 'iron = "core"\ndirection = [0.0, 0.0, -1.0]\n',
    "direction = [1.0, 0.0, 0.0]": "direction = [0.0, 0.0, 1.0]",
    'of = "position"': 'of = "position"\ndirection = [0.0, 0.0, 1.0]',
    "speed_m_per_s = 0.5": "direction = [0.0, 0.0, 1.0]\nspeed_m_per_s = 0.25",
    "cruise_s = 0.05": "cruise_s = 0.03",
    "[22.0, 16.0, 8.0, 20.0, 12.0]": "[12.0, 8.0]",
    "[22.0, 10.0, 18.0, 6.0, 14.0, 22.0]": "[12.0, 6.0, 10.0]",
}
"""The example along z: the second magnet carries the weight."""


def rig_file(folder: Path, changes: dict[str, str]) -> Path:
    """Write the example with some changed lines."""
    text = TEXT
    for old, new in changes.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    (folder / "loops.csv").write_bytes((stages.EXAMPLE / "loops.csv").read_bytes())
    return path


def test_a_file_without_lines_of_action_means_x() -> None:
    rig = read_stage(stages.EXAMPLE / "rig.toml")
    lines = rig.lines_of_action
    (x,) = lines.coordinates
    assert x.axis == 0
    assert (x.low, x.high) == pytest.approx((-1e-4, 1e-4))
    assert [line["d"] for line, _ in lines.magnets] == [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    assert [line["d"] for line, _ in lines.heads] == [[1.0, 0.0, 0.0]]
    assert rig.parameter_names == stage_parameter_names(2)


def test_a_stage_that_carries_its_weight_asks_for_it_and_holds_its_place(tmp_path: Path) -> None:
    rig = read_stage(rig_file(tmp_path, ALONG_Z))
    scan = rig.settings.scan
    run = track(
        make_stage(rig, bearings.knowledge(), "full"), scan_motion(scan, scan.test_m_per_s2), Feedforward(), 1
    )
    assert run.loss is None
    assert run["demand_N"][0] == pytest.approx(98.1, rel=1e-3)
    begun = round(0.01 / run.dt)
    assert np.abs(run["error_m"][begun:]).max() < 1e-6
    moved = np.gradient(np.gradient(run["position_m"], run.dt), run.dt)
    error = 10.0 * moved - run["force_N"] + 98.1
    assert np.sqrt(np.mean(error[begun:-2] ** 2)) < 0.5


@pytest.mark.slow
def test_the_planned_motion_calibrates_the_stage(tmp_path: Path) -> None:
    rig = read_stage(rig_file(tmp_path, ALONG_Z))
    move = find_move(rig, bearings.knowledge())
    found = calibrate(rig, move.run, magnet=bearings.knowledge(), methods=["full"])
    (full,) = found.file.method
    assert full.fits
    assert all(abs(one.value) < 0.5 * one.prior for one in full.parameter)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"mass_kg = 10.0": "mass_kg = 10.0\ngravity_m_per_s2 = 9.81"},
            "without-effect body[1].gravity_m_per_s2: free in x",
        ),
        ({"mass_kg = 10.0": "mass_kg = 12.0"}, "load-too-large case[1].train_m_per_s2: 12 kg need 264 N"),
        (
            ALONG_Z | {"[22.0, 16.0, 8.0, 20.0, 12.0]": "[16.0, 8.0]"},
            "load-too-large case[1].train_m_per_s2: in addition to the weight",
        ),
        (
            {"stop_high_m = 0.55e-3": "stop_high_m = 0.458e-3"},
            "range-too-narrow frame.stray_m: 8e-06 m in both directions",
        ),
        (
            {'of = "position"': 'of = "position"\ndirection = [0.0, 1.0, 0.0]'},
            "axis-not-seen sensor: cannot separate x",
        ),
        ({"mass_kg = 10.0": 'mass_kg = 10.0\nfree = ["y"]'}, "missing magnet[1].direction: free in y"),
        (
            {"direction = [1.0, 0.0, 0.0]": "direction = [-1.0, 0.0, 0.0]"},
            "axis-not-held magnet: no magnet pushes along +x",
        ),
    ],
)
def test_impossible_bodies_are_refused_with_a_reason(
    tmp_path: Path, changes: dict[str, str], said: str
) -> None:
    with refused(said):
        read_stage(rig_file(tmp_path, changes))
