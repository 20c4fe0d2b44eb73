"""What compensation must reach in the bundled bearing; the whole table is benchmarks/bearing.py."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from anhyst.simulate.controllerfile import Format, Variant
from anhyst.simulate.experiments import Trial, stand_still
from anhyst.simulate.responses import Cell, compare
from anhyst.simulate.setup import Setup

from . import bearings
from .bearings import GAP

HEIGHTS = (10e-6, 20e-6, 50e-6, 100e-6)
SEEDS = range(3)


@cache
def cells(variant: Variant, number_format: Format, fraction: float) -> list[Cell]:
    setup = bearings.single(variant, number_format, fraction)
    found = compare([setup], [GAP], HEIGHTS, [150.0], SEEDS, jobs=1)
    assert [cell.height for cell in found] == list(HEIGHTS)
    assert not any(cell.lost for cell in found)
    return found


def overshoot(
    variant: Variant, number_format: Format = "fixed", fraction: float = 0.15
) -> list[float]:
    return [
        cell.figures["overshoot_percent"].mean for cell in cells(variant, number_format, fraction)
    ]


@pytest.mark.parametrize("fraction", [0.15, 0.3])
def test_full_overshoots_at_most_half_as_much_as_ratio(fraction: float) -> None:
    full, ratio = overshoot("full", fraction=fraction), overshoot("ratio", fraction=fraction)
    for height, mine, other in zip(HEIGHTS, full, ratio, strict=True):
        assert mine <= 0.5 * other, f"{height:g} m"
    assert min(ratio) > 2.0


def test_steps_arrive() -> None:
    """The paper found settling and the error that stays almost unchanged; both are told apart."""
    for cell in cells("full", "fixed", 0.15):
        assert abs(cell.figures["steady_error_m"].mean) < 20e-9
        assert 0.0 < cell.figures["rise_time_s"].mean < 10e-3
        assert cell.figures["settling_in_noise_s"].mean <= cell.figures["settling_time_s"].mean


def quiet(setup: Setup) -> Setup:
    """With a sensor of 5 nm rms instead of the encoder."""
    bandwidth = setup.rig.settings.position_sensor.sensor().bandwidth
    sensor = bearings.sensor("capacitive", noise_m=5e-9, bandwidth_Hz=bandwidth)
    return bearings.with_rig(setup, {"position_sensor": sensor})


def standstill(setup: Setup) -> float:
    """Mean rms over the seeds, m; no limit cycle in any."""
    found = [stand_still(Trial(setup, seed)) for seed in SEEDS]
    assert not any(one.lost for one in found)
    assert [one.figures["limit_cycle_m"] for one in found] == [0.0] * len(SEEDS)
    return float(np.mean([one.figures["rms_m"] for one in found]))


@pytest.mark.parametrize("fraction", [0.15, 0.3])
def test_it_stands_still_to_ten_nanometres_without_a_limit_cycle(fraction: float) -> None:
    assert standstill(quiet(bearings.single("full", fraction=fraction))) <= 10e-9


def test_fixed_point_does_as_f64() -> None:
    both = zip(overshoot("full", "fixed"), overshoot("full", "f64"), strict=True)
    assert max(abs(one - other) for one, other in both) <= 0.5
    for change in (lambda setup: setup, quiet):
        setups = [change(bearings.single("full", name)) for name in ("fixed", "f64")]
        fixed, double = (standstill(setup) for setup in setups)
        assert fixed == pytest.approx(double, rel=0.1)
