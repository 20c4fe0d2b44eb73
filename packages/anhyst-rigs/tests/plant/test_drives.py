"""Test amplifiers, the load drive and the end stops."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from anhyst._core import Plant
from anhyst.support.numeric import FloatArray
from tests.plant.rigs import GAP, OPEN_LOOP, bearing, example_poles

SOFT: dict[str, Any] = {
    "iron.reversible_fraction": 1.0,
    "iron.saturation_sharp_T": 2.0,
    "iron.knee_sharp_A_per_m": 1.0,
    "iron.saturation_slow_T": 0.01,
    "magnet.iron_length_m": 1e-4,
}
"""Iron of infinite permeability, so that the inductance is that of the gaps."""
FIXED: dict[str, Any] = OPEN_LOOP | {"body.mass_kg": 1e200}
"""An armature that cannot move, bit for bit."""


def welded(changes: dict[str, Any], current: float = 0.0) -> Plant:
    plant = bearing(FIXED | changes)
    plant.place([GAP], [0.0])
    plant.hold(current, 0)
    return plant


def test_an_amplifier_follows_as_far_as_its_bandwidth() -> None:
    """A PI controller of a pure inductance has its corner at a tenth of the bandwidth."""
    bandwidth = 2500.0
    for frequency in (250.0, 2500.0, 5000.0):
        plant = welded(SOFT | {"timing.rate_Hz": 200e3}, 1.0)
        turn = 2.0 * math.pi * frequency / 200e3
        at = np.arange(8 * round(200e3 / frequency))
        flows = []
        for tick in at.tolist():
            plant.advance([1.0 + 0.05 * math.sin(turn * tick)], 0.0)
            flows.append(plant.current)
        last = at >= at.size // 2
        swing = 2.0 * abs(complex(np.mean(np.array(flows)[last] * np.exp(-1j * turn * at[last]))))
        s = 1j * frequency / bandwidth
        leak = 1.2 / (2.0 * math.pi * bandwidth * example_poles().inductance(GAP))
        expected = abs((s + 0.1) / (s * s + s * (1.0 + leak) + 0.1))
        assert swing / 0.05 == pytest.approx(expected, rel=0.02)
        if frequency == bandwidth:
            assert 0.7 < swing / 0.05 < 0.76


def test_the_current_rises_no_faster_than_the_supply_drives_it() -> None:
    plant = welded(SOFT)
    flows = [0.0]
    for _ in range(8):
        plant.advance([4.0], 0.0)
        flows.append(plant.current)
    inductance = example_poles().inductance(GAP)
    slew = np.diff(flows[:7]) / 50e-6
    mean = 0.5 * (np.array(flows[1:7]) + np.array(flows[:6]))
    assert slew == pytest.approx((150.0 - 1.2 * mean) / inductance, rel=5e-3)


def test_beyond_the_supply_the_integral_waits() -> None:
    """The overshoot of the current is not larger from far below than from nearby."""
    past = []
    for start in (2.5, 0.0):
        plant = welded(SOFT, start)
        flows = []
        for _ in range(200):
            plant.advance([3.0], 0.0)
            flows.append(plant.current)
        past.append(max(flows) - 3.0)
    assert past[1] < 1.2 * past[0]
    assert past[0] > 0.0


@pytest.mark.parametrize("wanted", [0.0, 0.7, 1.0, 2.9, 4.4])
def test_commands_lie_on_the_grid_of_the_converter(wanted: float) -> None:
    plant = welded({"amplifier.dac_bits": 4})
    for _ in range(400):
        plant.advance([wanted], 0.0)
    assert plant.current == pytest.approx(round(wanted / 0.3) * 0.3, abs=1e-5)


@pytest.mark.parametrize(("wanted", "flows"), [(9.0, 4.5), (-3.0, 0.0)])
def test_commands_beyond_the_range_stay_at_its_end(wanted: float, flows: float) -> None:
    plant = welded({})
    for _ in range(400):
        plant.advance([wanted], 0.0)
    assert plant.current == pytest.approx(flows, abs=1e-5)


@pytest.mark.parametrize(
    ("ticks", "late", "substeps"), [(0.0, 0.0, 0), (0.5, 0.0, 2), (1.0, 0.0, 4), (1.25, 62.5e-6, 10)]
)
def test_a_command_takes_effect_exactly_after_the_delay(ticks: float, late: float, substeps: int) -> None:
    def flows(changes: dict[str, Any], hold: int) -> FloatArray:
        plant = welded(changes)
        rows = []
        for tick in range(8 * hold):
            plant.advance([2.0 if tick // hold == 1 else 1.0], 0.0)
            rows.append(plant.current)
        return np.array(rows)

    slow = {"timing.delay_ticks": ticks, "amplifier.delay_s": late}
    found = flows(slow, 1)
    fine = flows({"timing.rate_Hz": 80e3, "timing.substeps": 1}, 4)
    waited = np.concatenate([np.zeros(substeps), fine])
    assert np.array_equal(found, waited[3:32:4])


def test_in_voltage_mode_the_command_is_the_voltage() -> None:
    plant = welded({"amplifier.mode": "voltage"})
    before = plant.psi
    for _ in range(4):
        plant.advance([30.0], 0.0)
    # 0.2 ms at 30 V, minus the voltage of the winding's resistance.
    assert plant.psi - before == pytest.approx(0.2e-3 * 30.0, rel=0.01)
    for _ in range(6000):
        plant.advance([2.4], 0.0)
    assert plant.current == pytest.approx(2.0, rel=1e-3)


FREE: dict[str, Any] = OPEN_LOOP | {"body.stop_low_m": 0.1e-3, "body.stop_high_m": 0.8e-3}


def run_armature(changes: dict[str, Any], velocity: float, force: float, ticks: int) -> FloatArray:
    """Return gap and velocity without current."""
    plant = bearing(FREE | changes)
    plant.place([GAP], [velocity])
    rows = []
    for _ in range(ticks):
        plant.advance([0.0], force)
        rows.append((plant.gap, plant.velocity))
    return np.array(rows)


def test_the_load_drive_force_lags_by_its_bandwidth() -> None:
    velocity = run_armature({}, 0.0, 20.0, 60)[:, 1]
    at = 50e-6 * np.arange(1, 61)
    lag = 1.0 / (2.0 * math.pi * 500.0)
    expected = 10.0 * (at - lag * -np.expm1(-at / lag))
    assert velocity == pytest.approx(expected, rel=1e-3, abs=1e-6)


QUICK: dict[str, Any] = {"load.bandwidth_Hz": 1e5, "load.velocity_bandwidth_Hz": 1e5}


def test_the_load_drive_renders_damping() -> None:
    velocity = run_armature(QUICK | {"load.damping_N_s_per_m": 200.0}, 5e-3, 0.0, 200)[:, 1]
    fade = np.polynomial.Polynomial.fit(np.arange(200) * 50e-6, np.log(velocity), 1).convert()
    assert fade.coef[1] == pytest.approx(-100.0, rel=0.02)


def test_the_load_drive_renders_stiffness_around_the_operating_gap() -> None:
    spring = QUICK | {"load.stiffness_N_per_m": 2e4}
    gap = run_armature(spring, 5e-3, 0.0, 4000)[:, 0]
    crossings = np.flatnonzero((gap[:-1] < GAP) & (gap[1:] >= GAP))
    period = 50e-6 * float(np.mean(np.diff(crossings)))
    assert period == pytest.approx(2.0 * math.pi * math.sqrt(2.0 / 2e4), rel=0.01)
    pushed = run_armature(spring | {"load.damping_N_s_per_m": 200.0}, 0.0, 1.0, 4000)[-1, 0]
    assert pushed - GAP == pytest.approx(1.0 / 2e4, rel=1e-3)


def test_the_load_drive_knows_the_gap_in_steps_of_its_encoder() -> None:
    """A spring that moves within one encoder step gives a constant force."""
    steps = QUICK | {"load.stiffness_N_per_m": 1e6, "load.encoder_step_m": 1e-6}
    force = []
    for place in (GAP + 0.6e-6, GAP + 1.4e-6, GAP + 1.6e-6):
        plant = bearing(FREE | steps | {"body.mass_kg": 1e3})
        plant.place([place], [0.0])
        plant.advance([0.0], 0.0)
        before = plant.velocity
        plant.advance([0.0], 0.0)
        force.append(1e3 * (plant.velocity - before) / 50e-6)
    assert force == pytest.approx([-1.0, -1.0, -2.0], rel=1e-3)


def test_it_rests_on_the_stop_and_the_stop_holds() -> None:
    plant = bearing(OPEN_LOOP)
    assert plant.gap == 0.55e-3
    plant.place([GAP], [0.0])
    for _ in range(1000):
        plant.advance([0.0], 300.0)
        assert plant.gap < 0.55e-3 + 30e-6
    stiffness = 2.0 * (2.0 * math.pi * 1600.0) ** 2
    assert plant.gap - 0.55e-3 == pytest.approx(300.0 / stiffness, rel=1e-3)
    assert abs(plant.velocity) < 1e-6


def test_the_lower_stop_holds_against_the_magnet() -> None:
    plant = bearing(OPEN_LOOP)
    plant.place([0.4e-3], [0.0])
    for _ in range(1000):
        plant.advance([4.5], 0.0)
        assert plant.gap > 0.35e-3 - 50e-6
    stiffness = 2.0 * (2.0 * math.pi * 1600.0) ** 2
    assert 0.35e-3 - plant.gap == pytest.approx(plant.force / stiffness, rel=1e-2)
    assert plant.force > 300.0
