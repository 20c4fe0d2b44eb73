"""Test metrics of steps and records against responses in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst_rigs.study.bearing.responses import (
    evaluate_step,
    recovery_time,
    rms_rate_of_change,
    settling_band,
)
from anhyst_rigs.study.engine.table import mean_interval

RATE = 20e3
SENSOR = 5e-9  # resolution, rms, m
Row = FloatArray


def second_order(damping: float, w: float, t: Row) -> Row:
    """Step response of w^2/(s^2 + 2 z w s + w^2)."""
    fast = w * math.sqrt(1.0 - damping**2)
    swing = np.cos(fast * t) + damping * w / fast * np.sin(fast * t)
    return np.asarray(1.0 - np.exp(-damping * w * t) * swing)


def hold(way: Row, before: float, after: float) -> tuple[Row, Row, Row]:
    """Time, reference and gap of a step: one old sample, then a response from 0 to 1."""
    t = np.arange(-1, len(way)) / RATE + 0.3
    reference = np.concatenate([[before], np.full(len(way), after)])
    gap = np.concatenate([[before], before + (after - before) * way])
    return t, reference, gap


@pytest.mark.parametrize("height", [-50e-6, 10e-6])
@pytest.mark.parametrize("damping", [0.3, 0.5, 0.7])
def test_a_system_of_second_order(damping: float, height: float) -> None:
    w = 2.0 * math.pi * 120.0
    t = np.arange(round(0.08 * RATE)) / RATE
    way = second_order(damping, w, t)
    figures = evaluate_step(*hold(way, 0.45e-3, 0.45e-3 + height), SENSOR)
    peak = 100.0 * math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    assert figures.overshoot_percent == pytest.approx(peak, rel=2e-3)
    assert figures.undershoot_percent == 0.0
    fine = np.linspace(0.0, 0.02, 400_001)
    rise = np.interp([0.1, 0.9], *_rising(second_order(damping, w, fine), fine))
    assert figures.rise_time_s == pytest.approx(rise[1] - rise[0], rel=1e-3)
    outside = t[np.abs(way - 1.0) > 0.02][-1]
    assert figures.settling_time_s == pytest.approx(outside + 1.0 / RATE)
    assert figures.settling_time_s == figures.settling_in_noise_s
    assert abs(figures.steady_error_m) < 1e-5 * abs(height)


def _rising(way: Row, t: Row) -> tuple[Row, Row]:
    top = int(np.argmax(way))
    return way[:top], t[:top]


def test_a_way_in_the_wrong_direction_is_reported() -> None:
    t = np.arange(2000) / RATE
    way = 1.0 - np.exp(-t / 2e-3) - 900.0 * t * np.exp(-t / 1e-3)
    figures = evaluate_step(*hold(way, 0.45e-3, 0.40e-3), SENSOR)
    assert figures.undershoot_percent == pytest.approx(-100.0 * way.min())
    assert figures.undershoot_percent > 5.0
    assert figures.overshoot_percent == 0.0


def test_sensor_resolution_does_not_hide_settling() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(4000) / RATE
    way = 1.0 - np.exp(-t / 1e-3) + rng.uniform(-0.03, 0.03, len(t))
    figures = evaluate_step(*hold(way, 0.45e-3, 0.46e-3), 0.17e-6)
    assert figures.standstill_rms_m == pytest.approx(0.03 / math.sqrt(3.0) * 10e-6, rel=0.05)
    assert settling_band(10e-6, 0.17e-6) == pytest.approx(3.0 * 0.17e-6)
    assert figures.settling_time_s > 0.9 * t[-1]
    # With a band of 5.1 % and noise of 3 %, e^-t settles between 2.1 and 8.1 %.
    assert 2.4e-3 < figures.settling_in_noise_s < 4e-3


def test_whoever_trembles_more_does_not_settle_sooner() -> None:
    rng = np.random.default_rng(4)
    t = np.arange(4000) / RATE
    way = 1.0 - np.exp(-t / 1e-3)
    settled = []
    for rms in (0.0, 0.005, 0.01, 0.03):
        noisy = way + rms * rng.standard_normal(len(t))
        figures = evaluate_step(*hold(noisy, 0.45e-3, 0.46e-3), 15e-9)
        assert settling_band(10e-6, 15e-9) == pytest.approx(0.02 * 10e-6)
        settled.append(figures.settling_in_noise_s)
    assert settled == sorted(settled)
    assert settled[-1] > 10.0 * settled[0]


@pytest.mark.parametrize("rms", [0.002, 0.02])
def test_a_step_without_overshoot_reports_its_noise(rms: float) -> None:
    """Deviations to both sides over half the hold are as likely as to one side over all of it."""
    rng = np.random.default_rng(7)
    t = np.arange(2000) / RATE
    way = 1.0 - np.exp(-t / 1e-5)
    rows = [
        evaluate_step(*hold(way + rms * rng.standard_normal(len(t)), 0.45e-3, 0.46e-3), SENSOR)
        for _ in range(200)
    ]
    overshoot, noise = (mean_interval([getattr(row, key) for row in rows]) for key in
                        ("overshoot_percent", "noise_percent"))  # fmt: skip
    assert overshoot.mean == pytest.approx(noise.mean, rel=0.03)
    assert overshoot.mean > 3.0 * 100.0 * rms
    assert not overshoot.exceeds(noise)
    beyond = evaluate_step(*hold(second_order(0.5, 750.0, t), 0.45e-3, 0.46e-3), SENSOR)
    assert beyond.overshoot_percent > 100.0 * beyond.noise_percent


def test_an_unreached_time_is_infinite() -> None:
    t = np.arange(2000) / RATE
    slow = evaluate_step(*hold(0.5 * (1.0 - np.exp(-t / 1e-3)), 0.45e-3, 0.46e-3), SENSOR)
    assert slow.rise_time_s == math.inf
    assert slow.settling_time_s == math.inf
    assert slow.steady_error_m == pytest.approx(-5e-6)
    still = evaluate_step(*hold(0.0 * t, 0.45e-3, 0.46e-3), SENSOR)
    assert still.rise_time_s == math.inf


def test_a_standing_error_is_measured_from_the_reference() -> None:
    t = np.arange(4000) / RATE
    figures = evaluate_step(*hold(1.01 * (1.0 - np.exp(-t / 1e-3)), 0.45e-3, 0.44e-3), SENSOR)
    assert figures.steady_error_m == pytest.approx(-0.01 * 10e-6)
    assert figures.overshoot_percent == pytest.approx(1.0)


def test_a_record_without_a_step_is_refused() -> None:
    t = np.arange(100) / RATE
    with pytest.raises(ValueError, match="must step after the first sample"):
        evaluate_step(t, t, t, SENSOR)


def test_recovery_counts_from_the_end_of_the_disturbance() -> None:
    t = np.arange(4000) / RATE
    error = np.where(t < 0.1, 1.0, np.exp(-(t - 0.1) / 5e-3))
    assert recovery_time(t, -error, 0.1, 0.05) == pytest.approx(5e-3 * math.log(20.0), abs=1 / RATE)
    assert recovery_time(t, error, 0.1, 1e-12) == math.inf
    assert recovery_time(t, 0.0 * error, 0.1, 1e-12) == 0.0


def test_rate_of_change_of_a_sine() -> None:
    t = np.arange(20_000) / RATE
    current = 1.5 + 0.2 * np.sin(2 * np.pi * 100.0 * t)
    expected = 0.2 * 2 * np.pi * 100.0 / math.sqrt(2.0)
    assert rms_rate_of_change(t, current) == pytest.approx(expected, rel=1e-3)


def test_the_interval_has_its_stated_coverage() -> None:
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(2000):
        found = mean_interval(7.0 + rng.standard_normal(5), level=0.9)
        held += abs(found.mean - 7.0) <= found.half_width
    # Normal instead of Student quantiles would contain the mean in 82 % of the cases only.
    assert held / 2000 == pytest.approx(0.9, abs=0.02)


def test_an_interval_over_an_endless_value_is_unknown() -> None:
    found = mean_interval([1.0, math.inf, 2.0])
    assert found.mean == math.inf
    assert math.isnan(found.half_width)
    with pytest.raises(ValueError, match="two values"):
        mean_interval([1.0])
