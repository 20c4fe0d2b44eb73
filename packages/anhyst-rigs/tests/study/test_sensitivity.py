"""Test the measured sensitivity of a known linear loop, and its margin zones."""

from __future__ import annotations

import doctest
import importlib
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import cont2discrete

from anhyst._core import Controller
from anhyst.control import Pidd2, design
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.recording import COLUMNS, Recording
from anhyst_rigs.study.bearing.linear import (
    ZONE_LIMITS,
    AnalogueAmplifier,
    Compensation,
    LinearBearing,
    LinearLoop,
    LoopTiming,
    find_zone,
)
from anhyst_rigs.study.bearing.responses import Sensitivity, measure_sensitivity

RATE, STEPS = 20e3, 4
Row = FloatArray
POINT = LinearBearing(2.0, 123.0, 5e5, 20e-3, 1.2)
AMPLIFIER = AnalogueAmplifier(gain=314.0, integral_gain=19e3)
CONTROLLER = Pidd2(rate=RATE, **vars(design(2.0, 120.0, 1.0)), cutoff=2000.0)
LINEAR = LinearLoop(POINT, AMPLIFIER, LoopTiming(RATE, 1.0), CONTROLLER, Compensation(123.0, 4e5))


def bearing(noise: float = 0.0, stick: float = 0.0) -> Callable[[Row], Recording]:
    """Simulate position and winding in quarter ticks with the core's controller and a delay.

    The delay is one tick. `stick` is a nonlinear dead zone of the force around the demand, N.
    """
    k, a = POINT, AMPLIFIER
    motion = [
        [0.0, 1.0, 0.0, 0.0],
        [k.k_s / k.mass, 0.0, k.k_i / k.mass, 0.0],
        [0.0, -k.k_i / k.inductance, -(k.resistance + a.gain) / k.inductance, 1.0 / k.inductance],
        [0.0, 0.0, -a.integral_gain, 0.0],
    ]
    into = [[0.0], [0.0], [a.gain / k.inductance], [a.integral_gain]]
    over, held, *_ = cont2discrete(
        (np.array(motion), np.array(into), np.eye(1, 4), np.zeros((1, 1))), 1.0 / (RATE * STEPS)
    )

    def run(inject: Row) -> Recording:
        rng = np.random.default_rng(1)
        controller = Controller(CONTROLLER.per_tick)
        state, waiting, kept = np.zeros(4), 0.0, 0.0
        table = np.zeros((len(inject), len(COLUMNS)))
        for i, added in enumerate(inject.tolist()):
            # The gap is 0.45 mm minus the position, so that an addition to the gap lowers the
            # position.
            read = 0.45e-3 - float(state[0]) + noise * rng.standard_normal() + added
            table[i, COLUMNS.index("gap_read_m")] = read
            position = 0.45e-3 - read
            demand = controller.solve(0.0, position, 0.0)
            controller.commit(demand)
            kept = min(max(kept, demand - stick), demand + stick)
            current = (kept - 4e5 * position) / 123.0
            for _ in range(STEPS):
                state = over @ state + held[:, 0] * waiting
            waiting = current
        return Recording.from_table(table)

    return run


FREQUENCIES = np.array([8.0, 25.0, 60.0, 113.0, 190.0, 333.3, 700.0, 1500.0, 4000.0])


@pytest.fixture(scope="module")
def clean() -> Sensitivity:
    return measure_sensitivity(bearing(), FREQUENCIES, 1e-6, RATE)


def test_it_is_that_of_the_linear_loop(clean: Sensitivity) -> None:
    expected = LINEAR.sensitivity(FREQUENCIES)
    assert np.max(np.abs(clean.ratio / expected - 1.0)) < 5e-3
    # Injected signals above the loop's bandwidth pass unchanged; the loop suppresses those below.
    assert clean.magnitude[-1] == pytest.approx(1.0, abs=0.1)
    assert clean.peak > 1.2
    assert np.max(clean.residual_ratio) < 5e-3


def test_noise_is_averaged_out_and_reported(clean: Sensitivity) -> None:
    noisy = measure_sensitivity(bearing(noise=100e-9), FREQUENCIES, 1e-6, RATE)
    assert np.max(np.abs(noisy.ratio - clean.ratio)) < 0.05
    assert np.min(noisy.residual_ratio) > 0.05


@pytest.mark.slow
def test_a_dead_zone_makes_the_response_depend_on_the_amplitude(clean: Sensitivity) -> None:
    small = measure_sensitivity(bearing(stick=1.0), FREQUENCIES[:5], 1e-6, RATE)
    large = measure_sensitivity(bearing(stick=1.0), FREQUENCIES[:5], 100e-6, RATE)
    error = [float(np.max(np.abs(x.ratio - clean.ratio[:5]))) for x in (small, large)]
    assert error[0] > 5.0 * error[1]
    assert np.max(small.residual_ratio) > 5.0 * np.max(large.residual_ratio)


def test_the_peak_and_its_zone() -> None:
    ratio = np.array([0.5, -3.2j, 1.0], dtype=np.complex128)
    found = Sensitivity(np.array([10.0, 100.0, 1000.0]), ratio, np.zeros(3), 1e-6)
    assert (found.peak, found.peak_frequency, found.zone) == (3.2, 100.0, "B")
    assert found.decibel[1] == pytest.approx(20.0 * math.log10(3.2))


def test_frequencies_beyond_half_the_rate_are_refused() -> None:
    with pytest.raises(ValueError, match="10000 Hz, half the rate"):
        measure_sensitivity(bearing(), [100.0, 10e3], 1e-6, RATE)


def test_a_run_that_ended_early_is_refused() -> None:
    run = bearing()
    with pytest.raises(ValueError, match="ticks where"):
        measure_sensitivity(lambda inject: run(inject[:-1]), [500.0], 1e-6, RATE)


@pytest.mark.parametrize(
    ("peak", "wanted"), [(1.0, "A"), (3.0, "A"), (3.01, "B"), (4.01, "C"), (5.01, "D"), (math.inf, "D")]
)
def test_zones(peak: float, wanted: str) -> None:
    assert find_zone(peak) == wanted


def test_zones_end_at_the_decibels_of_the_standard() -> None:
    assert [20.0 * np.log10(zone_limit) for zone_limit in ZONE_LIMITS.values()] == pytest.approx(
        [9.5, 12, 14], abs=0.05
    )
    assert find_zone(math.nan) == "D"


def test_the_example_is_true() -> None:
    result = doctest.testmod(importlib.import_module("anhyst_rigs.study.bearing.linear"))
    assert result.attempted > 0
    assert result.failed == 0
