"""Test the sensor models of gap, current, force and flux density."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from anhyst._core import Plant
from anhyst.support.numeric import FloatArray
from tests.plant.rigs import GAP, OPEN_LOOP, bearing

STILL: dict[str, Any] = OPEN_LOOP | {"body.mass_kg": 1e12}
"""Too heavy to be accelerated by a magnet, but with an initial speed."""
SHARP: dict[str, Any] = STILL | {
    "gap_sensor.noise_m": 0.0,
    "gap_sensor.step_m": 1e-13,
    "gap_sensor.bandwidth_Hz": 1e9,
    "gap_sensor.delay_s": 0.0,
}
QUIET: dict[str, Any] = STILL | {
    "current_sensor.noise_A": 0.0,
    "force_sensor.noise_N": 0.0,
    "hall_probe.noise_T": 0.0,
    "gap_sensor.noise_m": 0.0,
}
NAMES = ("gap", "current", "flux", "force")


def seen(plant: Plant) -> tuple[float, float, float, float]:
    """Return the sensor readings of a bearing with one magnet, by the names above."""
    (gap,), (current,), (flux,), force = plant.read()
    return gap, current, flux, force


def test_readings_lie_on_the_grid_of_the_sensor_next_to_the_truth() -> None:
    for place in np.linspace(0.36e-3, 0.54e-3, 40).tolist():
        plant = bearing(QUIET)
        plant.place([place], [0.0])
        steps = (seen(plant)[0] - 0.05e-3) / 50e-9
        assert steps == pytest.approx(round(steps), abs=1e-6)
        assert seen(plant)[0] == pytest.approx(place, abs=25.1e-9)


def test_converters_of_current_force_and_flux_have_the_steps_of_their_bits() -> None:
    grids = ((1, -0.5, 5.5 / 65535), (2, -2.0, 4.0 / 65535), (3, -50.0, 500.0 / 16383))
    steps_seen: list[set[int]] = [set() for _ in grids]
    for current in np.linspace(0.5, 4.0, 23).tolist():
        plant = bearing(QUIET)
        plant.place([GAP], [0.0])
        plant.hold(current, 0)
        read = seen(plant)
        for (number, low, step), steps in zip(grids, steps_seen, strict=True):
            place = (read[number] - low) / step
            assert place == pytest.approx(round(place), abs=1e-5)
            steps.add(round(place))
        assert read[1] == pytest.approx(current, abs=0.51 * 5.5 / 65535)
        assert read[3] == pytest.approx(plant.force, abs=0.51 * 500.0 / 16383)
    assert all(len(steps) == 23 for steps in steps_seen)


def test_a_sensor_saturates_at_its_range() -> None:
    plant = bearing(QUIET | {"current_sensor.high_A": 2.0, "gap_sensor.low_m": 0.5e-3})
    plant.place([GAP], [0.0])
    plant.hold(3.0, 0)
    gap, current, *_ = seen(plant)
    assert (gap, current) == (0.5e-3, 2.0)


@pytest.mark.parametrize("substeps", [0, 1, 3, 10])
def test_a_delayed_sensor_reads_the_value_of_earlier_sub_steps(substeps: int) -> None:
    plant = bearing(SHARP | {"gap_sensor.delay_s": substeps * 12.5e-6})
    plant.place([GAP], [1e-3])
    for _ in range(10):
        plant.advance([0.0], 0.0)
    assert plant.gap == pytest.approx(GAP + 10 * 50e-9, abs=1e-15)
    assert plant.gap - seen(plant)[0] == pytest.approx(substeps * 12.5e-9, abs=1e-12)


def test_a_slow_sensor_lags_behind_a_ramp_by_its_time_constant() -> None:
    plant = bearing(SHARP | {"gap_sensor.bandwidth_Hz": 1000.0})
    plant.place([GAP], [1e-3])
    for _ in range(100):
        plant.advance([0.0], 0.0)
    lag = 1e-3 / (2.0 * math.pi * 1000.0)
    assert plant.gap - seen(plant)[0] == pytest.approx(lag, rel=2e-3)


def phasor(values: FloatArray, turn: float) -> complex:
    """Return amplitude and phase of a sine over whole periods."""
    return complex(np.mean(values * np.exp(-1j * turn * np.arange(values.size)))) * 2.0


@pytest.mark.parametrize("bandwidth", [250.0, 1000.0])
def test_at_its_bandwidth_a_sensor_has_gain_0_7_and_45_degrees_lag(bandwidth: float) -> None:
    plant = bearing(QUIET | {"current_sensor.bandwidth_Hz": bandwidth, "timing.rate_Hz": 200e3})
    plant.place([GAP], [0.0])
    plant.hold(2.5, 0)
    turn = 2.0 * math.pi * bandwidth / 200e3
    flows, read = [], []
    for tick in range(6 * round(200e3 / bandwidth)):
        plant.advance([2.5 + math.sin(turn * tick)], 0.0)
        flows.append(plant.current)
        read.append(seen(plant)[1])
    last = slice(len(flows) // 2, None)
    ratio = phasor(np.array(read[last]), turn) / phasor(np.array(flows[last]), turn)
    assert abs(ratio) == pytest.approx(math.sqrt(0.5), rel=0.01)
    assert math.degrees(math.atan2(ratio.imag, ratio.real)) == pytest.approx(-45.0, abs=1.0)


def readings(seed: int, changes: dict[str, Any], count: int) -> FloatArray:
    plant = bearing(changes, seed)
    plant.place([GAP], [0.0])
    plant.hold(2.5, 0)
    rows = []
    for _ in range(count):
        plant.advance([2.5], 0.0)
        rows.append(seen(plant))
    return np.array(rows)


FINE = {
    "current_sensor.adc_bits": 24,
    "force_sensor.adc_bits": 24,
    "hall_probe.adc_bits": 24,
    "gap_sensor.step_m": 1e-12,
}


def test_noise_is_normal_white_and_as_large_as_it_should_be() -> None:
    read = readings(3, STILL | FINE, 6000)
    expected = {0: 5e-9, 1: 0.0005, 2: 0.0002, 3: 0.5}
    noises = []
    for number, deviation in expected.items():
        noise = (read[:, number] - np.mean(read[:, number])) / deviation
        noises.append(noise)
        assert np.std(noise) == pytest.approx(1.0, rel=0.04)
        assert np.mean(noise**4) == pytest.approx(3.0, rel=0.12)
        assert abs(np.mean(noise[1:] * noise[:-1])) < 0.05
        assert abs(np.mean(noise**3)) < 0.15
    cross = np.corrcoef(noises)
    assert np.max(np.abs(cross - np.eye(4))) < 0.05  # independent noise of all sensors


def test_equal_seeds_give_equal_bits_and_other_seeds_others() -> None:
    first, again, other = (readings(seed, STILL, 50) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    noisy = [NAMES.index(name) for name in ("current", "flux", "force")]
    assert np.all(np.mean(first[:, noisy] != other[:, noisy], axis=0) > 0.5)


def test_without_noise_the_seed_does_not_matter() -> None:
    assert np.array_equal(readings(1, QUIET, 20), readings(2, QUIET, 20))
