"""Test the fit of a piezo stack: a known one, a real one, and loops that are rejected."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import anhyst
import anhyst_rigs
from anhyst._core import PiezoMotion
from anhyst.cli.app import main
from anhyst.data import Loop, Loops
from anhyst.data.path import History
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from anhyst_rigs.draft.piezo import FittedStack, bouc_wen_state, fit_stack
from anhyst_rigs.rig.piezo import read_piezo_rig
from anhyst_rigs.study.piezo import make_reference, simulate_tracking
from tests.refusals import refused
from tests.repository import ROOT

EXAMPLES = ROOT / "examples"
TURNS = (0.0, 100.0, 0.0, 100.0, 20.0, 80.0, 30.0, 60.0, -10.0, 100.0, 0.0)
KNOWN_STACK = {"stroke": 0.3e-6, "bend": -0.4e-9, "slope": 0.1e-6, "beta": 0.02, "gamma": 0.006}


def path(each: int, turns: tuple[float, ...] = TURNS) -> FloatArray:
    """A drive from turning point to turning point, V."""
    places = np.arange(0.0, len(turns) - 1, 1.0 / each)
    return np.asarray(np.interp(places, np.arange(len(turns)), turns))


def plant(drive: FloatArray, step: float = 1e-3, shares: tuple[float, ...] = ()) -> FloatArray:
    """Displacement of the virtual stack on a stage without lag, m, by the plant's C code."""
    times = np.array([0.3, 3.0][: len(shares)])
    numbers = {
        **{
            "stroke_per_volt": KNOWN_STACK["stroke"],
            "bend": KNOWN_STACK["bend"],
            "slope": KNOWN_STACK["slope"],
        },
        **{"beta": KNOWN_STACK["beta"], "gamma": KNOWN_STACK["gamma"], "omega": 1.0 / step, "damping": 0.5},
        **{"kept": 0.0, "step": step, "steps": 1},
    }
    motion = PiezoMotion(numbers, times, np.array(shares))
    return motion.run(np.append(drive, drive[-1]))[1:]


def loops(drive: FloatArray, answer: FloatArray, time: FloatArray | None = None) -> Loops:
    """One record from long rest at 0 V."""
    record = Loop("1", drive, answer, None, time, History.parse("conditioned:0"))
    return Loops((record,), QUANTITIES["voltage"], QUANTITIES["displacement"])


def check_known(stack: FittedStack, rel: float) -> None:
    numbers = stack.numbers
    assert numbers["stroke_m_per_V"] == pytest.approx(KNOWN_STACK["stroke"], rel=rel)
    assert numbers["bend_m_per_V2"] == pytest.approx(KNOWN_STACK["bend"], rel=2 * rel)
    assert numbers["slope_m_per_V"] == pytest.approx(KNOWN_STACK["slope"], rel=rel)
    assert numbers["beta_per_V"] == pytest.approx(KNOWN_STACK["beta"], rel=2 * rel)
    assert numbers["gamma_per_V"] == pytest.approx(KNOWN_STACK["gamma"], rel=8 * rel)


@pytest.mark.parametrize("ratio", [0.0, 0.3, 1.0, 2.5])
def test_the_hysteresis_in_closed_form_is_that_of_the_plant(ratio: float) -> None:
    drive = path(20_000, (0.0, 1.0, -0.4, 0.7, 0.7, -1.0, 0.2))
    numbers = {
        **dict.fromkeys(("stroke_per_volt", "bend", "kept"), 0.0),
        **{"slope": 1.0, "beta": 3.0, "gamma": 3.0 * ratio, "omega": 1.0, "damping": 0.5},
        **{"step": 1.0, "steps": 1},
    }
    stepped = -PiezoMotion(numbers, np.zeros(0), np.zeros(0)).run(np.append(drive, drive[-1]))[1:]
    closed = bouc_wen_state(drive, 3.0, ratio)
    assert np.max(np.abs(closed - stepped)) < 1e-3 * np.ptp(stepped)


def test_a_known_stack_comes_back_from_its_loops() -> None:
    drive = path(200)
    fine = plant(path(200 * 50))[::50]
    rng = np.random.default_rng(5)
    stack = fit_stack(loops(drive, 5e-6 + fine + rng.normal(0.0, 4e-9, fine.size)))
    check_known(stack, 0.01)
    assert stack.rms < 6e-9
    assert (stack.low, stack.high, stack.creep_times) == (-10.0, 100.0, ())
    # The fitted remaining displacement at the lowest voltage is that of the plant.
    back = plant(path(40_000, (0.0, 100.0, -10.0)))
    assert stack.remains == pytest.approx(back[-1], abs=0.05e-6)


def test_creep_is_found_in_timed_loops() -> None:
    each, dt = 800, 1e-3
    drive = np.concatenate([path(each), path(10, (0.0, 0.0, 0.0)), path(each // 4)])
    fine = np.interp(np.arange(0, drive.size - 1, 1 / 20), np.arange(drive.size), drive)
    answer = plant(fine, dt / 20, (0.01, 0.015))[::20]
    drive, time = drive[:-1], dt * np.arange(float(answer.size))
    timed = fit_stack(loops(drive, answer, time))
    assert timed.rms < 0.6 * timed.rms_without_creep
    assert 0.01 < sum(timed.creep_shares) < 0.05
    untimed = fit_stack(loops(drive, answer))
    assert (untimed.creep_times, untimed.has_times) == ((), False)
    assert untimed.rms == pytest.approx(timed.rms_without_creep, rel=0.2)


def test_loops_that_are_not_of_a_stack_are_refused() -> None:
    drive, rng = path(60), np.random.default_rng(3)
    straight = 0.3e-6 * drive
    with refused("no-piezo: show no hysteresis"):
        fit_stack(loops(drive, straight))
    with refused("no-piezo: are not those of a stack"):
        fit_stack(loops(drive, straight + rng.normal(0.0, 5e-6, drive.size)))
    with refused("output-falls"):
        fit_stack(loops(drive, -plant(drive)))
    with refused("voltage-negative"):
        fit_stack(loops(-np.abs(drive), plant(drive)))


def test_loops_of_a_stack_become_a_rig_that_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = EXAMPLES / "piezo" / "loops.csv"
    assert main(["init", str(source), "--out", str(tmp_path / "my"), "--json"]) == 0
    drafted = json.loads(capsys.readouterr().out)
    assert drafted["files"] == ["rig.toml", "loops/loops.csv", "loops/loops.toml"]
    assert "% of the stroke" in drafted["found"][1]
    assert any("resonance_Hz" in key for key in drafted["guesses"]["rig.toml"])
    assert not any("stroke_m_per_V" in key for key in drafted["guesses"]["rig.toml"])
    made, own = (read_piezo_rig(one / "rig.toml").settings for one in
                 (tmp_path / "my", EXAMPLES / "piezo"))  # fmt: skip
    assert made.stack.stroke_m_per_V == pytest.approx(own.stack.stroke_m_per_V, rel=0.03)
    assert made.stack.slope_m_per_V == pytest.approx(own.stack.slope_m_per_V, rel=0.1)
    assert made.stack_amplifier.high_V == 150.0
    assert made.position_sensor.noise_m == pytest.approx(4e-9, rel=0.1)
    for line in (tmp_path / "my" / "rig.toml").read_text().splitlines():
        assert not line or line.startswith("#") or "# " in line


def test_options_of_other_rigs_and_other_columns_are_refused(tmp_path: Path) -> None:
    source = EXAMPLES / "piezo" / "loops.csv"
    with refused("option-not-for-this --mass"):
        anhyst_rigs.init(tmp_path / "my", [source], mass=1.0)
    with refused("columns-missing: loops.csv"):
        anhyst_rigs.init(tmp_path / "my", [source], force_control=True)
    (tmp_path / "strain.csv").write_text("u_V,eps_1\n0,0\n1,1e-3\n2,2e-3\n0,0\n")
    with refused("columns-missing: strain.csv; displacement"):
        anhyst_rigs.init(tmp_path / "my", [tmp_path / "strain.csv"])
    assert not (tmp_path / "my").exists()


@pytest.mark.slow
def test_loops_that_excite_designs_give_the_stage_back(tmp_path: Path) -> None:
    rig = EXAMPLES / "piezo" / "rig.toml"
    anhyst_rigs.excite(rig, tmp_path / "loops.csv")
    drafted = anhyst_rigs.init(tmp_path / "my", [tmp_path / "loops.csv"])
    assert len(drafted.found) == 3
    own = read_piezo_rig(rig)
    stack = read_piezo_rig(tmp_path / "my" / "rig.toml").settings.stack
    for key, rel in (
        ("stroke_m_per_V", 0.01),
        ("bend_m_per_V2", 0.03),
        ("slope_m_per_V", 0.03),
        ("beta_per_V", 0.02),
        ("gamma_per_V", 0.1),
    ):
        assert getattr(stack, key) == pytest.approx(getattr(own.settings.stack, key), rel=rel)
    # The stage with the fitted stack is as hard to compensate as the one that was measured.
    other = replace(own, settings=own.settings.with_table_replaced(own.settings.stack, stack))
    for way in ("none", "full"):
        errors = [simulate_tracking(one).errors[way]["rms_m"] for one in (own, other)]
        assert errors[1] == pytest.approx(errors[0], rel=0.1)


@pytest.mark.slow
def test_a_real_stack_becomes_a_stage_that_compensation_is_worth_on(
    tmp_path: Path, measurements: Path
) -> None:
    source = measurements / "piezo_flexure" / "model_run.csv"
    columns = {"V_in": "u_V", "y_um": "x_um"}
    read = anhyst.read_loops(source, columns=columns)
    stack = fit_stack(read)
    assert stack.rms < 0.011 * stack.stroke
    assert stack.stroke == pytest.approx(45.8e-6, rel=0.01)  # without the spike at its begin
    anhyst_rigs.init(tmp_path / "my", [source], columns=columns)
    rig = read_piezo_rig(tmp_path / "my" / "rig.toml")
    assert make_reference(rig).min() > stack.remains
    tracked = simulate_tracking(rig)
    assert not tracked.lost_in
    assert tracked.deviation_ratio() < 0.3
