"""The whole chain with default options, for foreign magnets."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from anhyst.compensate.block import DemandLimits, TableSizes
from anhyst.compensate.builder import build_block
from anhyst.compensate.plan import find_limits, find_scales
from anhyst.model.actuator import read_model
from anhyst.verification import verify
from tests.actuators import reversals
from tests.cli.command import Result, quick
from tests.foreign.identified import identified_once
from tests.foreign.magnets import MAGNETS
from tests.swaps import current_jump_at_swap

RATE = 20000
BEARINGS = {"u": (20.0, 150.0, 0.45e-3), "hard": (8.0, 80.0, 0.4e-3), "soft": (0.1, 1.0, 0.25e-3)}
"""Mass, kg; load, N; gap, m."""
TRIES = 15
"""Number of gain sets that `tune` tries, a tenth of the default. It must meet the aims anyway."""


MARKS = {"hard": [pytest.mark.slow], "soft": [pytest.mark.slow, pytest.mark.campaign]}
STRAIGHT = [pytest.param(name, marks=MARKS.get(name, [])) for name in sorted(MAGNETS)]


def run(folder: Path, *arguments: object) -> Result:
    """Run a command that must succeed."""
    completed = quick(*arguments, cwd=folder, patience=1800.0)
    assert completed.returncode == 0, (arguments, completed.stdout, completed.stderr)
    assert "Traceback" not in completed.stderr
    return completed


@pytest.fixture(scope="module", params=STRAIGHT)
def magnet(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the loops and the identified model of a magnet."""
    folder = tmp_path_factory.mktemp(request.param)
    known = identified_once(tmp_path_factory, request.param)
    shutil.copytree(known, folder, dirs_exist_ok=True)
    run(folder, "inspect", "loops.csv")
    return folder


@pytest.mark.needs("gcc")
def test_an_identified_model_is_compiled_and_verified(magnet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(magnet, "compile", "model.toml", "--rate", RATE, "--out", "controller")
    monkeypatch.setattr("anhyst.verification.targets.HOST_COMPILERS", {"gcc": "gcc"})
    found = verify(magnet / "controller", "host", host_steps=50_000)
    assert found.passed, found.first_failure()
    assert len(found.results) == 4


@pytest.mark.slow
def test_a_swap_of_the_current_limit_causes_no_step(magnet: Path) -> None:
    run(magnet, "identify", "loops.csv", "--law", "effective-field", "--out", "paper.toml")
    model = read_model(magnet / "paper.toml")
    limits = find_limits(model)
    scales = find_scales(model, limits)
    (low, high), demand = limits.current, limits.demand[1]
    narrow = DemandLimits(limits.demand, (0.8 * low, 0.8 * high))
    here, there = (
        build_block(model, "full", scales, each, TableSizes(iterations=10)) for each in (limits, narrow)
    )
    path = reversals(0.02 * demand, 0.15 * demand, 25, 1)  # within the narrower limit
    for gap in (scales.gap_low, 0.5 * (scales.gap_low + scales.gap_high)):
        assert current_jump_at_swap(here, there, path, gap) < 4e-4
        assert current_jump_at_swap(there, here, path, gap) < 4e-4


@pytest.mark.parametrize("magnet", ["hard", pytest.param("soft", marks=pytest.mark.campaign)], indirect=True)
@pytest.mark.slow
def test_a_bearing_is_set_up_and_tuned(magnet: Path) -> None:
    name = magnet.name.rstrip("0123456789")
    mass, load, gap = BEARINGS[name]
    where = ("--mass", mass, "--load", load, "--gap", gap)
    run(magnet, "init", "loops.csv", *where, "--out", "bearing")
    run(magnet, "tune", "bearing/rig.toml", "--out", "tuned", "--budget", TRIES)
