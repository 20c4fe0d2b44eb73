"""Test the tuning of a piezo stage: its linear loop, its gains with random plants, its files."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import anhyst_rigs
from anhyst.cli.app import main
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.piezo import PiezoRig, make_notch, read_piezo_rig
from anhyst_rigs.rig.recording import peak_deviation
from anhyst_rigs.study import piezo
from anhyst_rigs.study.tuning.aims import Aims
from anhyst_rigs.study.tuning.piezo import (
    CHECK_CONDITIONS,
    NOMINAL,
    RANDOM_PLANTS,
    SEARCH_CONDITIONS,
    PiezoLoop,
)
from anhyst_rigs.study.tuning.search import GainSearch
from tests.refusals import refused
from tests.study.test_excite import piezo as piezo_file


def straight_rig(folder: Path, **keys: float) -> PiezoRig:
    """A piezo stage with resonance, delay and feedback only."""
    none = {"slope_m_per_V": 1e-15, "bend_m_per_V2": 0.0, "noise_m": 1e-6, "step_m": 1e-12}
    rig = read_piezo_rig(piezo_file(folder, **(none | keys)))
    still = rig.settings.with_changes({"stack.creep_shares": [0.0] * 4})
    return replace(rig, settings=still)


def loop_of(rig: PiezoRig) -> PiezoLoop:
    """The loop of this stage with a constant as its inverse."""
    return PiezoLoop(rig, piezo._constant_inverse(piezo.measure_stage_loops(rig), rig))


class Sine:
    """Random generator that returns a sine."""

    def __init__(self, omega: float) -> None:
        self.omega = omega

    def standard_normal(self, size: int) -> FloatArray:
        return np.asarray(np.sin(self.omega * np.arange(size)))


@pytest.mark.parametrize(("resonance", "rate"), [(480.0, 10e3), (150.0, 50e3), (1000.0, 5e3)])
def test_the_linear_loop_has_the_sensitivity_of_the_simulated_one(
    resonance: float, rate: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = straight_rig(tmp_path, resonance_Hz=resonance, rate_Hz=rate, bandwidth_Hz=resonance / 4)
    loop = loop_of(rig)
    size, at = loop.sensitivity_peak([NOMINAL])
    assert 1.1 < size < 4.0
    periods = 40
    ticks = round(periods * rate / at)
    omega = 2.0 * math.pi * periods / ticks
    target = np.full(4 * ticks, 20e-6)
    with monkeypatch.context() as patched:
        patched.setattr(np.random, "default_rng", lambda seed: Sine(omega))
        run = piezo.follow_reference(rig, target, loop.inverse)
    settled = slice(3 * ticks, 4 * ticks)
    read = run["position_m"] - 20e-6 + 1e-6 * np.sin(omega * np.arange(4 * ticks))
    measured = math.sqrt(2.0) * float(np.std(read[settled])) / 1e-6
    assert measured == pytest.approx(size, rel=0.02)


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_the_linear_loop_is_unstable_if_the_simulated_one_is_lost(part: float, tmp_path: Path) -> None:
    rig = straight_rig(tmp_path, noise_m=1e-9)
    loop = loop_of(rig)

    def at(bandwidth: float) -> PiezoLoop:
        changed = loop.rig.settings.with_changes({"control.bandwidth_Hz": bandwidth})
        return replace(loop, rig=replace(rig, settings=changed))

    low, high = 100.0, 5000.0
    for _ in range(30):
        middle = math.sqrt(low * high)
        low, high = (
            (middle, high) if math.isfinite(at(middle).sensitivity_peak([NOMINAL])[0]) else (low, middle)
        )
    tried = at(part * low)
    run = piezo.follow_reference(tried.rig, np.minimum(2e-9 * np.arange(20_000.0), 20e-6), loop.inverse)
    assert (run.loss is not None) is (part > 1.0)
    assert (rms(run["error_m"][-2000:]) < 1e-6) is (part < 1.0)


def test_a_plant_that_rings_elsewhere_has_less_margin(tmp_path: Path) -> None:
    rig = straight_rig(tmp_path, damping_ratio=0.005, bandwidth_Hz=250.0)
    loop = loop_of(rig)
    assert loop.sensitivity_peak(SEARCH_CONDITIONS)[0] > 1.1 * loop.sensitivity_peak([NOMINAL])[0]
    assert not {check_condition.number for check_condition in CHECK_CONDITIONS} & {
        search_condition.number for search_condition in SEARCH_CONDITIONS
    }


@pytest.mark.slow
def test_gains_are_found_that_serve_plants_which_were_not_searched_on(tmp_path: Path) -> None:
    rig = read_piezo_rig(piezo_file(tmp_path))
    loop = loop_of(rig)
    result = GainSearch(loop, Aims(None, 2.0), 20, jobs=1).run()
    assert result.check is not None
    assert result.figures.peak_sensitivity <= 2.0
    before = [loop.figures(check_condition, Aims(None), math.inf, 0) for check_condition in CHECK_CONDITIONS]
    worst = max(one.error_rms_m for one in before if one is not None)
    assert result.check.figures[RANDOM_PLANTS].cost < 0.6 * worst
    limits = result.loop.find_limits(Aims(None, 2.0), result.check, 0, 1)
    assert any(limit.what == "peak_sensitivity" for limit in limits)


def test_the_default_notch_is_at_the_resonance(tmp_path: Path) -> None:
    rig = read_piezo_rig(piezo_file(tmp_path))
    stated = rig.settings.with_changes(
        {"control.notch_Hz": 480.0, "control.notch_damping": 0.03, "control.notch_width": 0.7}
    )
    assert np.array_equal(make_notch(stated), make_notch(rig.settings))
    with refused("rate-too-low timing.rate_Hz: 800; 480 Hz"):
        make_notch(rig.settings.with_changes({"timing.rate_Hz": 800.0}))


def test_options_not_for_a_piezo_stage_are_refused(tmp_path: Path) -> None:
    rig = piezo_file(tmp_path)
    for option in ("controller", "overshoot", "average", "crossover", "settling", "standstill"):
        with refused(f"option-not-for-this --{option}"):
            anhyst_rigs.tune(rig, tmp_path / "out", **{option: 1.0})  # type: ignore[arg-type]
    with refused("rate-too-low timing.rate_Hz: rig.toml"):
        anhyst_rigs.tune(piezo_file(tmp_path, rate_Hz=900.0), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_tuned_piezo_stage_is_simulated_and_its_plants_do_better(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = piezo_file(tmp_path)
    assert main(["tune", path.name, "--out", "tuned", "--budget", "30"]) == 0
    figures = json.loads((tmp_path / "tuned" / "tuning.json").read_text())
    assert figures["variants"]["full"]["met"]
    assert (tmp_path / "tuned" / "pareto.png").read_bytes().startswith(b"\x89PNG")
    rigs = [read_piezo_rig(one) for one in (path, tmp_path / "tuned" / "rig.toml")]
    assert rigs[1].settings.displacement.bandwidth_Hz == pytest.approx(
        figures["variants"]["full"]["gains"]["bandwidth_Hz"]
    )
    errors = []
    for rig in rigs:
        inverse = piezo.find_inverses(rig)["full"]
        drawn = [check_condition.plant(rig.settings)[0] for check_condition in CHECK_CONDITIONS]
        expected = piezo.make_reference(rig)
        runs = [piezo.follow_reference(rig, expected, inverse, replace(rig, settings=one)) for one in drawn]
        assert all(run.loss is None for run in runs)
        errors.append([rms(run["error_m"][piezo.first_evaluated_tick(rig) :]) for run in runs])
        assert all(peak_deviation(run["error_m"][piezo.first_evaluated_tick(rig) :]) < 0.5e-6 for run in runs)
    assert max(errors[1]) < 0.7 * max(errors[0])
    assert np.median(errors[1]) < 0.8 * np.median(errors[0])
