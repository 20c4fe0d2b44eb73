"""Test the measured frequency response of a running loop against the linear loop."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import anhyst_rigs
from anhyst.compensate.methods import make_compensator
from anhyst.compensate.sources import Sources
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.bearing.loop import BearingSetup, operating_point
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import change_iron, change_rig
from anhyst_rigs.study.bearing.linear import find_zone
from anhyst_rigs.study.bearing.operating import find_operating_point, make_linear_loop
from anhyst_rigs.study.response.measurement import PERIOD_S, measure_response
from anhyst_rigs.study.response.multisine import Multisine, choose_lines, with_random_phases
from anhyst_rigs.study.response.result import FrequencyResponse, ResponseName, read_response
from tests.refusals import refused
from tests.study import bearings
from tests.study.simulated_seat import SimulatedSeat, deviations, linear_responses

SUBSTEPS = 16
"""Sub-steps of the simulated plant. With the 4 of the example, its amplifier lags by 1.7 us more."""


def linear_setup(rig: BodyRig, bandwidth: float = 120.0) -> BearingSetup:
    """A bearing with an iron without hysteresis, and constants as compensation, which are linear."""
    rig = change_iron(change_rig(rig, {"timing.substeps": SUBSTEPS}), 1.0)
    table, settings = bearings.controller().settings, rig.settings
    assert table.design is not None
    design = table.design.model_copy(update={"mass_kg": settings.body.mass_kg, "bandwidth_Hz": bandwidth})
    controller = table.model_copy(update={"design": design, "rate_Hz": settings.timing.rate_Hz})
    loops = bearings.knowledge().loops
    known = operating_point(rig, controller, loops)
    return BearingSetup(rig, make_compensator("linearised", Sources(known, loops), "fixed"), controller)


def drawn_setup(number: int) -> BearingSetup:
    """A bearing with a drawn mass, gap, rate and controller bandwidth."""
    rng = np.random.default_rng([54, number])
    rates = [12_000.0, 16_000.0, 20_000.0, 25_000.0]
    changes = {
        "body.mass_kg": float(rng.uniform(1.0, 4.0)),
        "gap_m": float(rng.uniform(0.42e-3, 0.48e-3)),
        "timing.rate_Hz": float(rng.choice(rates)),
    }
    return linear_setup(change_rig(bearings.example(), changes), float(rng.uniform(90.0, 130.0)))


@cache
def measured(number: int) -> tuple[BearingSetup, FrequencyResponse]:
    """A drawn bearing and its frequency response, measured with the sensors of the example."""
    setup = drawn_setup(number)
    return setup, measure_response(SimulatedSeat(setup, number))


@pytest.mark.slow
@pytest.mark.first(1)
@pytest.mark.parametrize("number", [10, 0, 1, 2, 3, 4, 11, 12, 13, 14])
def test_exact_points_of_drawn_bearings_equal_the_linear_loop(number: int) -> None:
    """The design of the measurement is based on the numbers 0 to 9; 10 to 14 were drawn afterwards."""
    setup, response = measured(number)
    expected = linear_responses(setup, response.frequency)
    assert len(response.frequency) == 200
    assert response.frequency[[0, -1]] == pytest.approx([1.0, 5000.0], rel=2e-3)
    assert response.duration < 20.0
    fewest_points: dict[ResponseName, int] = {"sensitivity": 195, "closed_loop": 140, "plant": 145}
    for name, fewest in fewest_points.items():
        decibel, degrees, count = deviations(response, expected, name)
        assert count >= fewest, name
        assert decibel < 0.33, name
        assert degrees < 2.1, name


def test_stated_uncertainties_cover_the_deviations() -> None:
    setup, response = measured(10)
    expected = linear_responses(setup, response.frequency)
    for name, one in response.responses.items():
        deviation = np.abs(20.0 * np.log10(np.abs(one.values / expected[name])))
        has_value = np.isfinite(one.values)
        assert has_value.sum() >= 195
        assert np.mean(deviation[has_value] <= one.uncertainty_decibel[has_value]) > 0.98


def test_margins_equal_those_of_the_linear_loop() -> None:
    setup, response = measured(10)
    linear = make_linear_loop(setup, find_operating_point(setup.rig)).margins
    margins = response.margins
    assert margins.gain_up == pytest.approx(linear.gain_up, rel=0.02)
    assert margins.gain_down == pytest.approx(linear.gain_down, rel=0.03)
    assert margins.phase == pytest.approx(linear.phase, abs=1.0)
    assert margins.crossover == pytest.approx(linear.crossover, rel=0.01)
    assert margins.peak == pytest.approx(linear.peak, rel=0.02)
    assert margins.modulus == pytest.approx(1.0 / linear.peak, rel=0.02)
    assert response.zone == find_zone(linear.peak)


def test_a_noisy_sensor_leaves_fewer_exact_points_and_no_wrong_ones() -> None:
    setup = drawn_setup(10)
    noisy = BearingSetup(
        change_rig(setup.rig, {"gap_sensor.noise_m": 200e-9}), setup.compensator, setup.controller
    )
    response = measure_response(SimulatedSeat(noisy, 1))
    expected = linear_responses(noisy, response.frequency)
    exact = measured(10)[1].responses["plant"].exact_points
    assert response.responses["plant"].exact_points < 0.8 * exact
    assert not np.isfinite(response.responses["plant"].values).all()
    for name in response.responses:
        decibel, degrees, _ = deviations(response, expected, name)
        assert decibel < 0.33, name
        assert degrees < 2.1, name


def test_the_plant_equals_linearise_as_objects_of_python_control(tmp_path: Path) -> None:
    pytest.importorskip("control")
    setup, response = measured(10)
    found = read_response(response.save(tmp_path / "response.csv"))
    plant = found.to_control("plant")
    assert (plant.input_labels, plant.output_labels) == (["current"], ["position"])
    model = anhyst_rigs.linearise(setup.rig, drive="reference")
    assert model.dt == pytest.approx(plant.dt)
    is_exact = found.responses["plant"].uncertainty_decibel <= 0.3
    omega = 2.0 * np.pi * found.frequency[is_exact]
    ratio = plant(1j * omega, squeeze=True) / model(np.exp(1j * omega * model.dt), squeeze=True)
    assert np.max(np.abs(20.0 * np.log10(np.abs(ratio)))) < 0.33
    with refused("unknown-name name"):
        found.to_control("loop")  # type: ignore[arg-type]


def test_a_saved_response_is_read_back(tmp_path: Path) -> None:
    _, response = measured(10)
    found = read_response(response.save(tmp_path / "response.csv"))
    for name, one in response.responses.items():
        again = found.responses[name]
        assert np.allclose(again.values, one.values, rtol=1e-12, equal_nan=True)
        assert np.array_equal(again.averaged, one.averaged)
    assert found.facts() == response.facts()
    assert (found.rate, found.plant_unit, found.motion) == (response.rate, "m/A", response.motion)
    (tmp_path / "other.csv").write_text("t_s,I_A\n0,1\n")
    with refused("not-a-response: other.csv"):
        read_response(tmp_path / "other.csv")


def test_motion_and_current_stay_within_their_limits() -> None:
    setup = drawn_setup(11)
    seat = SimulatedSeat(setup, 1)
    rows: list[np.ndarray] = []
    advance = seat.advance
    seat.advance = lambda ticks: rows.append(advance(ticks)) or rows[-1]  # type: ignore[method-assign, func-returns-value]
    response = measure_response(seat, 1e-6)
    assert response.motion < 1.1e-6
    names = [signal.name for signal in seat.signals]
    table = np.concatenate(rows)[:, 1:]
    current = table[:, names.index("command")]
    assert np.abs(current - np.median(current)).max() < 0.07 * 4.5
    assert np.abs(table[-100:, names.index("gap_read")] - setup.rig.gap).max() < 1e-6


def test_the_injected_signal_fades_without_a_step() -> None:
    """Before its first and after its last period, the signal is the same period with smaller values."""
    seat = SimulatedSeat(drawn_setup(10), 1)
    signals: list[FloatArray] = []
    inject = seat.inject
    seat.inject = lambda signal: signals.append(signal) or inject(signal)  # type: ignore[method-assign, func-returns-value]
    measure_response(seat)
    signal, period_ticks = max(signals, key=len), round(PERIOD_S * seat.rate)
    for smaller, whole in (
        (signal[:period_ticks], signal[period_ticks : 2 * period_ticks]),
        (signal[-period_ticks:], signal[-2 * period_ticks : -period_ticks]),
    ):
        assert np.all(smaller * whole >= 0.0)
        assert np.all(np.abs(smaller) <= np.abs(whole) * 1.000_001)
    assert np.abs(signal[[0, -1]]).max() < 1e-3 * np.abs(signal).max()


@pytest.mark.parametrize("motion", [0.0, -1e-6, 1e-4, math.nan, math.inf])
def test_a_motion_outside_its_range_is_refused(motion: float) -> None:
    with refused("out-of-range motion: at most 4.51 um"):
        measure_response(SimulatedSeat(drawn_setup(0)), motion)


def test_a_loop_that_reaches_a_limit_is_refused() -> None:
    seat = SimulatedSeat(drawn_setup(0))
    seat.injection_port = replace(seat.injection_port, max_motion=1e-4, max_changes={"command": 9.0})
    with refused("not-linear response"):
        measure_response(seat)


def test_a_multisine_has_odd_lines_with_detection_lines_between() -> None:
    lines = choose_lines(200, 5.0, 25_000.0)
    assert len(lines) == len(set(lines.tolist())) == 200
    assert (lines[0], lines[-1]) == (5, 24_999)
    assert set((lines % 8).tolist()) == {1, 5, 7}
    signal = Multisine(lines, with_random_phases(np.ones(200)), 100_000)
    assert np.abs(signal.respond()).max() < 4.5 * math.sqrt(100.0)
    assert signal.amplitudes_of(signal.respond()) == pytest.approx(signal.amplitudes)


def test_no_point_is_above_half_the_rate() -> None:
    rig = change_rig(bearings.example(), {"timing.rate_Hz": 4000.0})
    response = measure_response(SimulatedSeat(linear_setup(rig, 60.0)))
    assert response.frequency.max() < 2000.0
    assert len(response.frequency) == 200
