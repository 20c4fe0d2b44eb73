"""Test the files and claims of the virtual piezo stage and rod; the files must be reproducible."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.data.reading import read_loops
from anhyst.identification import identify
from anhyst.model.actuator import find_compile_obstacle
from anhyst_rigs.rig.piezo import read_piezo_rig
from tests.cli.command import quick, unwrapped
from tests.identification.truths import noisy

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PIEZO = EXAMPLES / "piezo"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["piezo", "magnetostrictive"])
def test_the_files_are_reproduced_byte_for_byte(name: str, tmp_path: Path) -> None:
    script = EXAMPLES / name / "make_loops.py"
    subprocess.run([sys.executable, script, "--out", tmp_path], check=True)
    made = sorted(tmp_path.iterdir())
    assert made
    for path in made:
        assert path.read_bytes() == (EXAMPLES / name / path.name).read_bytes(), path.name


def test_the_virtual_stack_has_a_loop_creeps_and_rings() -> None:
    rig = read_piezo_rig(PIEZO / "rig.toml")
    dt = 1e-4
    held = rig.make_motion(dt).run(np.full(40_000, 100.0))
    early_mean, final_mean = held[200:1000].mean(), held[-1000:].mean()
    assert 1.005 < final_mean / early_mean < 1.02
    ringing = held[5:60] - early_mean
    turns = np.flatnonzero(np.diff(np.sign(ringing)))
    assert 0.5 / (np.diff(turns).mean() * dt) == pytest.approx(rig.settings.flexure.resonance_Hz, rel=0.05)
    slow = 75.0 * (1.0 - np.cos(2.0 * np.pi * np.arange(2000) / 2000))
    found = rig.make_motion(1e-3).run(slow)
    assert found[1500] - found[500] == pytest.approx(5.2e-6, rel=0.15)


def test_a_constant_voltage_leaves_the_stage_at_rest() -> None:
    stage = read_piezo_rig(PIEZO / "rig.toml").make_motion(1e-4)
    assert np.all(stage.run(np.zeros(10)) == 0.0)


@pytest.mark.slow
def test_random_reversals_are_predicted_four_times_as_well_as_by_a_curve() -> None:
    loops = read_loops(PIEZO / "loops.csv")
    model = identify(loops).model
    unseen = read_loops(PIEZO / "unseen.csv").loops[0]
    made = model.predict(unseen.input, time=unseen.time, history="conditioned:0").output
    error = float(np.sqrt(np.mean((made - unseen.output) ** 2)))
    curve = np.polynomial.Polynomial.fit(loops.loops[0].input, loops.loops[0].output, 5)
    plain = float(np.sqrt(np.mean((curve(unseen.input) - unseen.output) ** 2)))
    assert error < 0.013 * np.ptp(unseen.output)
    assert error < plain / 3.0


@pytest.mark.slow
def test_the_model_reports_its_fastest_fitted_rate(tmp_path: Path) -> None:
    completed = quick("identify", PIEZO / "loops.csv", "--out", "slow.toml", cwd=tmp_path)
    assert "the loops run at up to 1.5 Hz; faster runs were not measured" in unwrapped(completed.stdout)
    options = ("--history", "conditioned:0", "--out", "rates.csv")
    completed = quick("predict", "slow.toml", PIEZO / "rates.csv", *options, cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    assert "loops up to 300 V/s were fitted" in unwrapped(completed.stderr)


@pytest.mark.slow
def test_a_triangle_is_followed_with_a_fifth_of_the_error(tmp_path: Path) -> None:
    completed = quick("simulate", PIEZO / "rig.toml", "--out", "run.csv", "--json", cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    said = json.loads(completed.stdout)
    assert said["rms_with_over_without"] <= 0.2
    assert said["worst_with_over_without"] <= 0.2
    assert (tmp_path / "run.svg").read_text(encoding="utf-8").startswith("<?xml")


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 4e-4])
def test_the_bias_of_a_rod_is_found_and_a_prestress_between_predicted(noise: float) -> None:
    here = EXAMPLES / "magnetostrictive"
    rng = np.random.default_rng(1)
    loops = noisy(read_loops(here / "loops.csv"), noise, seed=0)
    restless = [
        replace(loop, input=loop.input + 7.0 * (noise > 0.0) * rng.standard_normal(loop.n))
        for loop in loops.loops
    ]
    model = identify(loops.with_loops(restless)).model
    assert model.output.name == "magnetostriction"
    assert model.parameters["in_0"] == pytest.approx(-30e3, rel=0.06)
    assert find_compile_obstacle(model) is None  # also as a function of the prestress
    off, largest = [], 0.0
    for loop in read_loops(here / "unseen.csv").loops:
        made = model.predict(loop.input, loop.schedule, None, loop.history).output
        off.append(np.abs(made - loop.output))
        largest = max(largest, float(loop.output.max()))
    assert float(np.mean(np.concatenate(off))) < 0.008 * largest
