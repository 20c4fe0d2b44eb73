"""Test that a drift of the magnet is detected, and that noise alone is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anhyst.model.actuator import Model
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.force.file import ForceControlRig, read_rig
from anhyst_rigs.rig.parts.iron import CellSteel
from anhyst_rigs.study.watch import REVERSAL_TO_CURRENT_RANGE, CusumChart, DriftMonitor, Finding, Reference
from tests.refusals import refused
from tests.rig.test_iron_families import EXAMPLES
from tests.truths import truth

RATE = 250
"""Samples per second: every fourth tick of the bundled rig."""
LEARNT = 15
"""Cycles of one second before the drift begins."""


@pytest.fixture(scope="module")
def rig() -> ForceControlRig:
    return read_rig(EXAMPLES / "solenoid" / "rig.toml")


@pytest.fixture(scope="module")
def model() -> Model:
    return truth("solenoid-three-gaps")


def true_force(
    rig: ForceControlRig, current: FloatArray, gap: FloatArray, pinning: float = 1.0
) -> FloatArray:
    """Return the force of the solenoid with changed pinning, from the demagnetised state."""
    file = rig.solenoid_file
    assert file is not None
    scale = file.iron.pinning_scale_A_per_m * pinning  # type: ignore[union-attr]
    iron = file.iron.model_copy(update={"pinning_scale_A_per_m": scale})
    assert isinstance(iron, CellSteel)
    other = replace(rig, solenoid_file=file.model_copy(update={"iron": iron}))
    return other.magnet().run(current, gap)[:, 0].copy()


def sensed(
    rig: ForceControlRig, current: FloatArray, gap: FloatArray, force: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the readings of the rig's sensors with noise."""
    sensors = rig.make_sensors([5], 1.0 / RATE)
    return (sensors["current"].read(current), sensors["gap"].read(gap), sensors["force"].read(force))


def cycles(count: int, low: float, high: float) -> FloatArray:
    """Return a current that cycles once per second, A."""
    time = np.arange(count * RATE) / RATE
    return 0.5 * (low + high) - 0.5 * (high - low) * np.cos(2.0 * np.pi * time)


@pytest.mark.slow
@pytest.mark.parametrize("ends", [(0.1, 1.0), (0.3, 0.8)])
@pytest.mark.parametrize("gap", [1.25e-3, 2.0e-3, None])
def test_a_pinning_increase_of_20_percent_is_found_within_ten_seconds_of_motion(
    rig: ForceControlRig, model: Model, ends: tuple[float, float], gap: float | None
) -> None:
    current = cycles(LEARNT + 12, *ends)
    if gap is None:  # the armature moves along
        at = 1.9e-3 - 0.8e-3 * np.cos(2.0 * np.pi * np.arange(current.size) / RATE)
    else:
        at = np.full(current.size, gap)
    force, ticks = true_force(rig, current, at), np.arange(current.size, dtype=np.float64)
    good = DriftMonitor(model, float(at[0]), "demagnetised").add_samples(
        ticks, *sensed(rig, current, at, force)
    )
    assert good == Finding(LEARNT + 10, False, None)
    begin = LEARNT * RATE
    force[begin:] = true_force(rig, current, at, 1.2)[begin:]
    found = DriftMonitor(model, float(at[0]), "demagnetised").add_samples(
        ticks, *sensed(rig, current, at, force)
    )
    assert found.drift is not None
    assert begin < found.drift.found_tick <= begin + 10 * RATE
    assert found.drift.begin_tick == pytest.approx(begin, abs=2 * RATE)
    assert 0.02 < abs(found.drift.shift) < 0.5
    assert f"{found.drift.shift:+.3g} N" in found.text(RATE)


def test_the_monitor_does_not_depend_on_the_chunks(rig: ForceControlRig, model: Model) -> None:
    current = cycles(16, 0.2, 0.9)
    at, ticks = np.full(current.size, 1.3e-3), np.arange(current.size, dtype=np.float64)
    rows = (ticks, *sensed(rig, current, at, true_force(rig, current, at)))
    rows[3][13 * RATE :] += 0.3  # N: somebody touched the load cell
    whole = DriftMonitor(model, 1.3e-3, "demagnetised").add_samples(*rows)
    cut = DriftMonitor(model, 1.3e-3, "demagnetised")
    for start in range(0, current.size, 37):
        cut.add_samples(*(row[start : start + 37] for row in rows))
    found = cut.finding.drift
    assert whole.drift is not None
    assert found is not None
    assert (found.kind, found.begin_tick, found.found_tick) == (
        whole.drift.kind,
        whole.drift.begin_tick,
        whole.drift.found_tick,
    )
    assert found.shift == pytest.approx(whole.drift.shift, rel=1e-6)
    assert whole.drift.kind == "level"
    assert whole.drift.shift == pytest.approx(0.3, abs=0.05)
    with refused("time-not-rising"):
        DriftMonitor(model, 1.3e-3).add_samples(rows[0][::-1], *rows[1:])


def test_a_swing_that_is_met_half_way_is_a_cycle_too(model: Model) -> None:
    assert model.valid is not None
    half = 0.7 * REVERSAL_TO_CURRENT_RANGE * np.ptp(model.valid.input)  # amplitude around the initial current
    current = 0.6 + half * np.sin(2.0 * np.pi * np.arange(8 * RATE) / RATE)
    at, ticks = np.full(current.size, 1.3e-3), np.arange(current.size, dtype=np.float64)
    watch = DriftMonitor(model, 1.3e-3)
    assert watch.add_samples(ticks, current, at, np.zeros(current.size)).cycles >= 6


@pytest.mark.slow
def test_an_hour_of_noise_is_no_drift(rig: ForceControlRig, model: Model) -> None:
    few = cycles(4, 0.1, 1.0)
    force = true_force(rig, few, np.full(few.size, 1.25e-3))
    last, before = force[3 * RATE :], force[2 * RATE : 3 * RATE]
    np.testing.assert_allclose(last, before, atol=1e-9)  # steady state: 3600 cycles in an hour
    watch = DriftMonitor(model, 1.25e-3, "demagnetised")
    sensors = rig.make_sensors([6], 1.0 / RATE)
    for minute in range(60):
        ticks = np.arange(60 * RATE, dtype=np.float64) + minute * 60 * RATE
        minute_of = {
            "current": np.tile(few[3 * RATE :], 60),
            "gap": np.full(ticks.size, 1.25e-3),
            "force": np.tile(last, 60),
        }
        read = [sensors[name].read(values) for name, values in minute_of.items()]
        assert watch.add_samples(ticks, *read).drift is None
    assert watch.finding.cycles == 3598


@pytest.mark.slow
@pytest.mark.parametrize("correlation", [0.0, 0.4])
@pytest.mark.parametrize("shift", [0.0, 4.0])
def test_a_chart_keeps_its_run_length_and_finds_a_shift_soon(correlation: float, shift: float) -> None:
    rng = np.random.default_rng(3)
    wanted, runs = 300.0, []
    for _ in range(150):
        row = rng.standard_normal(3000)
        for place in range(1, row.size):
            row[place] = correlation * row[place - 1] + np.sqrt(1 - correlation**2) * row[place]
        chart = CusumChart(Reference.from_values(row[:10].tolist()), 0.0, wanted)
        # The shift is scaled for the correlation, so that its effect equals that on independent
        # values.
        after = row[10:] + shift * np.sqrt((1 + correlation) / (1 - correlation))
        length = next((n for n, one in enumerate(after, 1) if chart.add_value(float(one))), after.size)
        runs.append(length)
    if shift == 0.0:
        assert np.mean(runs) > wanted
    else:
        assert np.median(runs) < 0.05 * wanted
