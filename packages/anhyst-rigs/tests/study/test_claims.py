"""Test the accuracy targets of compensation with the bundled bearing.

The script benchmarks/bearing.py makes the complete table.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from anhyst.support.kinds import MethodName, NumberFormat
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.study.bearing import responses
from anhyst_rigs.study.bearing.experiments import (
    ExperimentOutcome,
    ExperimentTrial,
    LimitCycle,
    run_standstill,
    run_variants,
)
from anhyst_rigs.study.bearing.responses import StepCell, StepResult, StepRun, compare_steps
from tests.study import bearings
from tests.study.bearings import GAP

HEIGHTS = (10e-6, 20e-6, 50e-6, 100e-6)
SEEDS = range(3)


@cache
def cells(variant: MethodName, number_format: NumberFormat, fraction: float) -> list[StepCell]:
    setup = bearings.single(variant, number_format, fraction)
    found = compare_steps([setup], [GAP], HEIGHTS, [150.0], SEEDS, jobs=1)
    assert [cell.height for cell in found] == list(HEIGHTS)
    assert not any(cell.lost for cell in found)
    return found


def overshoot(
    variant: MethodName, number_format: NumberFormat = "fixed", fraction: float = 0.15
) -> list[float]:
    return [cell.figures["overshoot_percent"].mean for cell in cells(variant, number_format, fraction)]


@pytest.mark.slow
@pytest.mark.parametrize("fraction", [0.15, 0.3])
def test_full_overshoots_at_most_half_as_much_as_ratio(fraction: float) -> None:
    full, ratio = overshoot("full", fraction=fraction), overshoot("ratio", fraction=fraction)
    for height, mine, other in zip(HEIGHTS, full, ratio, strict=True):
        assert mine <= 0.5 * other, f"{height:g} m"
    assert min(ratio) > 2.0


@pytest.mark.slow
def test_steps_arrive() -> None:
    """Check settling and the error that remains after it, because the paper reports both."""
    for cell in cells("full", "fixed", 0.15):
        assert abs(cell.figures["steady_error_m"].mean) < 20e-9
        assert 0.0 < cell.figures["rise_time_s"].mean < 10e-3
        assert cell.figures["settling_in_noise_s"].mean <= cell.figures["settling_time_s"].mean


def quiet(setup: BearingSetup) -> BearingSetup:
    """The setup with a sensor of 5 nm rms instead of the encoder."""
    bandwidth = setup.rig.settings.gap_sensor.bandwidth_Hz
    sensor = bearings.sensor("capacitive", noise_m=5e-9, bandwidth_Hz=bandwidth)
    return bearings.with_rig(setup, {"gap_sensor": sensor})


def standstill(setup: BearingSetup) -> float:
    """Mean rms over the seeds, m; requires that no run has a limit cycle."""
    found = [run_standstill(ExperimentTrial(setup, seed)) for seed in SEEDS]
    held = [one for one in found if one is not None]
    assert [one.cycles for one in held] == [()] * len(SEEDS)
    return float(np.mean([one.figures["rms_m"] for one in held]))


@pytest.mark.slow
@pytest.mark.parametrize("fraction", [0.15, 0.3])
def test_the_standstill_error_is_below_ten_nanometres_without_a_limit_cycle(fraction: float) -> None:
    assert standstill(quiet(bearings.single("full", fraction=fraction))) <= 10e-9


def test_overshoot_is_distinguished_from_noise() -> None:
    """A constant ratio overshoots; the best curve without memory only shows the noise."""
    assert all(cell.has_overshoot for cell in cells("ratio", "fixed", 0.15))
    smallest = cells("single-valued", "fixed", 0.15)[0]
    assert not smallest.has_overshoot
    assert smallest.interval("overshoot_percent").mean == pytest.approx(
        smallest.interval("noise_percent").mean, rel=0.3
    )


def falls_once(trial: ExperimentTrial) -> ExperimentOutcome | None:
    return None if trial.seed == 1 else ExperimentOutcome({"rms_m": 1.0})


def test_a_lost_run_prevents_a_mean_of_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    setup = bearings.single("ratio")
    found = run_variants(falls_once, {"ratio": setup}, SEEDS, None)
    assert found["ratio"].as_dict() == {"lost": 1, "runs": len(SEEDS)}
    real = responses.run_steps

    def but_once(run: StepRun) -> tuple[list[StepResult], float | None]:
        return ([], 0.7) if run.seed == 1 else real(run)

    monkeypatch.setattr(responses, "run_steps", but_once)
    (cell,) = compare_steps([setup], [GAP], [50e-6], [150.0], SEEDS, jobs=1)
    assert (cell.lost, cell.runs, cell.figures) == (1, len(SEEDS), {})
    assert np.isnan(cell.interval("overshoot_percent").mean)
    assert set(cell.as_dict()) == {"variant", "gap_m", "height_m", "load_N", "lost", "runs"}


def cycles_twice(trial: ExperimentTrial) -> ExperimentOutcome:
    cycles = (LimitCycle(100e-9, 8e-3, 0.8), LimitCycle(60e-9, 10e-3, 0.7))
    return ExperimentOutcome({"rms_m": 1.0}, cycles[trial.seed : trial.seed + 1])


def rests(trial: ExperimentTrial) -> ExperimentOutcome:
    del trial
    return ExperimentOutcome({"rms_m": 1.0}, ())


def test_a_limit_cycle_is_reported_by_its_runs_and_not_by_a_mean_with_zeros() -> None:
    setups: dict[MethodName, BearingSetup] = {"ratio": bearings.single("ratio")}
    found = run_variants(cycles_twice, setups, range(5), None)["ratio"].as_dict()
    assert (found["limit_cycles"], found["runs"]) == (2, 5)
    assert found["limit_cycle_m"] == pytest.approx(80e-9)
    assert found["limit_cycle_s"] == pytest.approx(9e-3)
    still = run_variants(rests, setups, range(5), None)["ratio"].as_dict()
    assert (still["limit_cycles"], still["limit_cycle_m"], still["limit_cycle_s"]) == (0, None, None)


@pytest.mark.slow
def test_fixed_point_does_as_f64() -> None:
    both = zip(overshoot("full", "fixed"), overshoot("full", "f64"), strict=True)
    assert max(abs(one - other) for one, other in both) <= 0.5
    for change in (lambda setup: setup, quiet):
        setups = [change(bearings.single("full", name)) for name in ("fixed", "f64")]
        fixed, double = (standstill(setup) for setup in setups)
        # Rounded values stay constant within their steps, whereas f64 follows each count of the
        # encoder.
        assert 0.75 * double <= fixed <= 1.1 * double
