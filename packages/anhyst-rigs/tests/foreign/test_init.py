"""A drafted rig levitates: for magnets that nobody here made the package for, and the bundled ones."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from anhyst.control.controller_file import read_controller
from anhyst_rigs.rig.bearing.checks import check_controller
from anhyst_rigs.rig.body import read_bearing
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.loop import track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.tracking.gains import find_gains
from anhyst_rigs.study.tracking.measures import measure
from tests.cli.command import quick
from tests.foreign.magnets import MAGNETS
from tests.repository import ROOT

PATIENCE = 1200.0
"""Seconds for half a minute of processor time, on a machine with much else to do."""

EXAMPLES = ROOT / "examples"
BUNDLED = ("bearing", "electromagnet", "solenoid")
GIVEN: dict[str, tuple[object, ...]] = {
    "u": ("--mass", 20, "--load", 200),
    "soft": ("--mass", 0.1, "--load", 1, "--gap", 0.25e-3),
}
"""Options of `init` for each magnet; the others have no options."""

LEFT = ("hard", "bearing", "electromagnet", "solenoid")
"""Magnets whose levitation only a campaign simulates: similar to others, or bundled."""

LAGGING = ("hard", "u", "electromagnet")
"""Magnets whose hysteresis exceeds the errors of the drafted sensors and of the plant."""


@pytest.fixture(scope="module", params=[*sorted(MAGNETS), *BUNDLED])
def drafted(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the draft of a bearing, moved after it was written."""
    name, folder = request.param, tmp_path_factory.mktemp(request.param)
    loops = EXAMPLES / name / "loops.csv"
    if name in MAGNETS:
        loops = MAGNETS[name].write_loops(folder / f"{name}.csv")
    completed = quick("init", loops, *GIVEN.get(name, ()), "--out", "made", cwd=folder)
    assert completed.returncode == 0, completed.stderr
    return (folder / "made").rename(folder / "my")


@pytest.mark.parametrize(
    "drafted",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in LEFT)) for name in [*sorted(MAGNETS), *BUNDLED]],
    indirect=True,
)
def test_a_draft_of_any_magnet_fits_its_schemas(drafted: Path) -> None:
    rig, controller = (read_bearing(drafted / "rig.toml"), read_controller(drafted / "controller.toml"))
    check_controller(controller, rig)
    assert rig.static_load < controller.settings.limits.force_high_N
    assert len(rig.measured_loops.files) >= 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "drafted",
    [
        pytest.param(name, marks=[pytest.mark.campaign] * (name in LEFT))
        for name in [*sorted(MAGNETS), *BUNDLED]
    ],
    indirect=True,
)
def test_a_draft_of_any_magnet_levitates_at_once(drafted: Path) -> None:
    rig = read_bearing(drafted / "rig.toml").settings
    heights = [rig.step.heights_m[0], rig.step.heights_m[-1]]
    shortened(drafted / "rig.toml", noise_seeds="2", also_gaps_m="[]", heights_m=f"{heights}")
    completed = quick("simulate", "rig.toml", "--out", "run.csv", cwd=drafted, patience=PATIENCE)
    assert completed.returncode == 0, completed.stderr
    figures: dict[str, Any] = json.loads((drafted / "figures.json").read_text())
    assert figures["lost_in"] == []
    mine = [step for step in figures["steps"] if step["variant"] == "full"]
    assert max(step["overshoot_percent"]["mean"] for step in mine) < 30.0
    assert figures["sensitivity"]["full"]["peak"] < 4.0
    standstill = figures["standstill"]["full"]["rms_m"]["mean"]
    assert standstill < 0.05 * min(step["height_m"] for step in mine)


@pytest.mark.parametrize(
    "name", ["u", *(pytest.param(name, marks=pytest.mark.slow) for name in ("hard", "stage"))]
)
def test_two_of_any_magnet_make_a_stage_that_follows_better_with_its_law(tmp_path: Path, name: str) -> None:
    loops = EXAMPLES / name / "loops.csv"
    if name in MAGNETS:
        loops = MAGNETS[name].write_loops(tmp_path / f"{name}.csv")
    completed = quick("init", loops, "--stage", "--out", "my", cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    rig = read_stage(tmp_path / "my" / "rig.toml")
    scan, control = rig.settings.scan, rig.settings.tracking
    assert rig.settings.body.mass_kg * max(scan.test_m_per_s2) < control.force_max_N
    known, motion = identify_stage_magnet(rig), scan_motion(scan, scan.test_m_per_s2)
    average = {}
    for method in ("single-valued", "full"):
        setup = make_stage(rig, known, method)
        gains = find_gains(setup, scan_motion(scan, scan.train_m_per_s2))
        run = track(setup, motion, gains, 1)
        assert run.loss is None
        average[method] = measure(run, motion, scan.slit_s).average_m
    assert average["full"] < 0.5 * average["single-valued"]


def test_a_stage_is_drafted_from_loops_of_several_gaps_alone(tmp_path: Path) -> None:
    loops = EXAMPLES / "stage" / "loops.csv"
    completed = quick("init", loops, "--stage", "--load", 5, "--out", "my", cwd=tmp_path)
    assert completed.returncode == 2
    assert "--stage: accepts only --mass and --gap" in completed.stderr
    completed = quick("init", loops, "--stage", "--gap", 0.9e-3, "--out", "my", cwd=tmp_path)
    assert completed.returncode == 2
    assert "0.0009 m is not between the measured gaps" in completed.stderr
    assert not (tmp_path / "my").exists()


def shortened(path: Path, **values: str) -> None:
    """Write other values into a file."""
    text = path.read_text()
    for key, value in values.items():
        text, count = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.M)
        assert count == 1
    path.write_text(text)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.campaign] * (name != "hard"))
        for name in [*sorted(MAGNETS), *BUNDLED]
    ],
)
def test_the_force_of_any_magnet_is_controlled_at_once(tmp_path: Path, name: str) -> None:
    loops = EXAMPLES / name / "loops.csv"
    if name in MAGNETS:
        loops = MAGNETS[name].write_loops(tmp_path / f"{name}.csv")
    completed = quick("init", loops, "--force-control", "--out", "my", cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    rig = read_rig(tmp_path / "my" / "rig.toml").settings
    ends = [rig.held_case.gaps_m[0], rig.held_case.gaps_m[-1]]
    shortened(tmp_path / "my" / "rig.toml", gaps_m=f"{ends}")
    completed = quick("force-control", "my/rig.toml", "--out", "run", cwd=tmp_path, patience=PATIENCE)
    assert completed.returncode == 0, completed.stderr
    figures: dict[str, Any] = json.loads((tmp_path / "run" / "figures.json").read_text())
    assert figures["ticks_that_differ"] == 0
    assert figures["summary"]["positions"]["full"]["of_single"] < (1.0 if name in LAGGING else 1.6)
