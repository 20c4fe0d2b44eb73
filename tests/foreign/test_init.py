"""A drafted rig levitates: for magnets that nobody here made the package for, and the bundled ones."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from anhyst.control.controller_file import read_controller
from anhyst.rig.bearing.loop import check_controller
from anhyst.rig.body import read_bearing
from anhyst.rig.force.file import read_rig
from tests.cli.command import quick
from tests.foreign.magnets import MAGNETS

PATIENCE = 1200.0
"""Seconds for half a minute of processor time, on a machine with much else to do."""

EXAMPLES = Path(__file__).parents[2] / "examples"
BUNDLED = ("bearing", "electromagnet", "solenoid")
GIVEN: dict[str, tuple[object, ...]] = {
    "u": ("--mass", 20, "--load", 200),
    "soft": ("--mass", 0.1, "--load", 1, "--gap", 0.25e-3),
}
"""What is said of a machine; of the others nothing at all."""

LEFT = ("hard", "bearing", "electromagnet", "solenoid")
"""Those that a campaign flies: like others of these, or bundled."""

LAGGING = ("hard", "u", "electromagnet")
"""Those whose hysteresis is more than what drafted instruments and plant are off."""


@pytest.fixture(scope="module", params=[*sorted(MAGNETS), *BUNDLED])
def drafted(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the draft of a bearing, moved away from where it was made."""
    name, folder = request.param, tmp_path_factory.mktemp(request.param)
    loops = EXAMPLES / name / "loops.csv"
    if name in MAGNETS:
        loops = MAGNETS[name].write_loops(folder / f"{name}.csv")
    done = quick("init", loops, *GIVEN.get(name, ()), "--out", "made", cwd=folder)
    assert done.returncode == 0, done.stderr
    return (folder / "made").rename(folder / "my")


@pytest.mark.parametrize(
    "drafted",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name in LEFT))
        for name in [*sorted(MAGNETS), *BUNDLED]
    ],
    indirect=True,
)
def test_a_draft_of_any_magnet_fits_its_schemas(drafted: Path) -> None:
    rig, controller = (
        read_bearing(drafted / "rig.toml"),
        read_controller(drafted / "controller.toml"),
    )
    check_controller(controller, rig)
    assert rig.load < controller.settings.limits.force_high_N
    assert len(rig.measured.files) >= 1


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
    done = quick("simulate", "rig.toml", "--out", "run.csv", cwd=drafted, patience=PATIENCE)
    assert done.returncode == 0, done.stderr
    figures: dict[str, Any] = json.loads((drafted / "figures.json").read_text())
    assert figures["lost_in"] == []
    mine = [step for step in figures["steps"] if step["variant"] == "full"]
    assert max(step["overshoot_percent"]["mean"] for step in mine) < 30.0
    assert figures["sensitivity"]["full"]["peak"] < 4.0
    standstill = figures["standstill"]["full"]["rms_m"]["mean"]
    assert standstill < 0.05 * min(step["height_m"] for step in mine)


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
    done = quick("init", loops, "--force-control", "--out", "my", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rig = read_rig(tmp_path / "my" / "rig.toml").settings
    ends = [rig.held.gaps_m[0], rig.held.gaps_m[-1]]
    shortened(tmp_path / "my" / "rig.toml", gaps_m=f"{ends}")
    done = quick("force-control", "my/rig.toml", "--out", "run", cwd=tmp_path, patience=PATIENCE)
    assert done.returncode == 0, done.stderr
    figures: dict[str, Any] = json.loads((tmp_path / "run" / "figures.json").read_text())
    assert figures["ticks_that_differ"] == 0
    assert figures["summary"]["positions"]["full"]["of_single"] < (1.0 if name in LAGGING else 1.6)
