"""Test the linear loop against python-control and a finer simulation, and its margins."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from scipy.signal import cont2discrete

from anhyst.control import Pidd2, design, to_control
from anhyst_rigs.study.bearing.linear import (
    AnalogueAmplifier,
    Compensation,
    DigitalAmplifier,
    LinearBearing,
    LinearLoop,
    LoopTiming,
    discretise,
)

RATE = 20e3
# The example bearing with an unstable pole of 80 Hz.
POINT = LinearBearing(
    mass=2.0, k_i=123.0, k_s=2.0 * (2.0 * math.pi * 80.0) ** 2, inductance=20e-3, resistance=1.2, damping=3.0
)
# Follows its reference with a first-order lag of 2500 Hz.
AMPLIFIER = AnalogueAmplifier(gain=2.0 * math.pi * 2500.0 * 20e-3, integral_gain=2.0 * math.pi * 2500.0 * 1.2)
CONTROLLER = Pidd2(
    rate=RATE, **vars(design(2.0, 120.0, 1.0, virtual_mass=0.2)), cutoff=2000.0, cutoff_2=2000.0, weight=0.3
)
LOOP = LinearLoop(
    POINT, AMPLIFIER, LoopTiming(RATE, 1.0, 5e3), CONTROLLER, Compensation(POINT.k_i, POINT.k_s)
)
FREQUENCIES = np.geomspace(1.0, 9.9e3, 60)


def by_python_control(loop: LinearLoop) -> tuple[Any, Any]:
    """Two factors of the loop gain with whole ticks of delay, from block diagrams."""
    s = control.TransferFunction([1.0, 0.0], [1.0])
    point, amplifier = loop.bearing, loop.amplifier
    mechanics = 1.0 / (point.mass * s**2 + point.damping * s - point.k_s)
    winding = 1.0 / (point.inductance * s + point.resistance)
    force = control.feedback(winding * point.k_i, mechanics * s * point.k_i) / point.k_i
    current = control.feedback((amplifier.gain + amplifier.integral_gain / s) * force)
    lag = 2.0 * math.pi * loop.timing.sensor_bandwidth
    read = control.minreal(current * point.k_i * mechanics * lag / (s + lag), 1e-6, verbose=False)
    held = control.sample_system(control.tf2ss(read), 1.0 / loop.timing.rate, "zoh")
    wait = control.TransferFunction([1.0], [1.0] + [0.0] * round(loop.timing.delay_ticks), held.dt)
    own = -to_control(loop.controller)[0, 1] + loop.compensation.k_s
    return held, wait * own / loop.compensation.k_i


@pytest.mark.parametrize("delay", [0.0, 1.0, 3.0])
def test_the_loop_gain_is_that_of_python_control(delay: float) -> None:
    loop = replace(LOOP, timing=replace(LOOP.timing, delay_ticks=delay))
    held, rest = by_python_control(loop)
    z = np.exp(2j * np.pi * FREQUENCIES / RATE)
    expected = held(z) * rest(z)
    assert np.max(np.abs(loop.loop_gain(FREQUENCIES) / expected - 1.0)) < 1e-6


def test_the_poles_agree_with_python_control() -> None:
    held, rest = by_python_control(LOOP)
    expected = np.abs(control.feedback(held * control.tf2ss(rest)).poles())
    found = np.abs(LOOP.poles)
    assert np.max(found) == pytest.approx(np.max(expected), abs=1e-7)
    assert LOOP.is_stable
    assert len(found) == len(expected)


@pytest.mark.slow
def test_margins_agree_with_python_control() -> None:
    held, rest = by_python_control(LOOP)
    response = control.frd(held * control.tf2ss(rest), np.geomspace(1.0, 6e4, 20_000), smooth=True)
    gains, phases, _, _, crossings, _ = control.stability_margins(response, returnall=True)
    margins = LOOP.margins
    assert margins.gain_up == pytest.approx(min(g for g in gains if g > 1.0), rel=1e-3)
    assert margins.gain_down == pytest.approx(max(g for g in gains if g < 1.0), rel=1e-3)
    assert margins.phase == pytest.approx(min(abs(p) for p in phases), abs=0.01)
    assert 2.0 * math.pi * margins.crossover == pytest.approx(max(crossings), rel=1e-3)


@pytest.mark.parametrize("delay", [0.25, 0.5, 1.25, 2.75])
def test_a_part_of_a_tick_of_delay_is_exact(delay: float) -> None:
    fine = 4
    loop = replace(LOOP, timing=replace(LOOP.timing, delay_ticks=delay))
    a, b, c = loop.plant
    commands = np.random.default_rng(1).standard_normal(40)
    state, found = np.zeros(len(b)), []
    for command in commands:
        found.append(float(c @ state))
        state = a @ state + b * command
    small_a, small_b, small_c = replace(
        LOOP, timing=LoopTiming(RATE * fine, 0.0, 5e3), controller=replace(CONTROLLER, rate=RATE * fine)
    ).plant
    late = np.concatenate([np.zeros(round(delay * fine)), np.repeat(commands, fine)])
    state, expected = np.zeros(len(small_b)), []
    for i, command in enumerate(late[: fine * len(commands)]):
        if i % fine == 0:
            expected.append(float(small_c @ state))
        state = small_a @ state + small_b * command
    assert np.max(np.abs(expected)) > 0.0
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * float(np.max(np.abs(expected))))


def test_the_magnet_is_unstable_at_the_pole_of_its_stiffness() -> None:
    free = replace(POINT, damping=0.0)
    assert free.current_drive_pole == pytest.approx(80.0)
    damped = 2.0 * math.pi * POINT.current_drive_pole
    assert POINT.mass * damped**2 + POINT.damping * damped == pytest.approx(POINT.k_s)


def test_a_winding_at_constant_voltage_slows_the_pole_down() -> None:
    s = 2.0 * math.pi * POINT.voltage_drive_pole
    motion = POINT.mass * s**2 + POINT.damping * s - POINT.k_s
    assert motion * (POINT.inductance * s + POINT.resistance) == pytest.approx(-(POINT.k_i**2) * s)
    assert 0.0 < POINT.voltage_drive_pole < POINT.current_drive_pole


def test_a_symmetric_pair_is_one_magnet_with_everything_added_up() -> None:
    m, k, L, R = POINT.mass, POINT.k_i, POINT.inductance, POINT.resistance
    pair = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [2.0 * POINT.k_s / m, -POINT.damping / m, k / m, -k / m],
            [0.0, -k / L, -R / L, 0.0],
            [0.0, k / L, 0.0, -R / L],
        ]
    )
    one = replace(POINT, k_i=2 * k, k_s=2 * POINT.k_s, inductance=2 * L, resistance=2 * R)
    expected = np.max(np.linalg.eigvals(pair).real) / (2.0 * math.pi)
    assert one.voltage_drive_pole == pytest.approx(expected)


def test_with_an_ideal_magnet_the_poles_are_those_of_the_design() -> None:
    rate, w = 400e3, 2.0 * math.pi * 120.0
    gains = design(2.0, 120.0, 0.6)
    loop = LinearLoop(
        replace(POINT, damping=0.0),
        AnalogueAmplifier(2.0 * math.pi * 50e3 * 20e-3, 2.0 * math.pi * 50e3 * 1.2),
        LoopTiming(rate, 0.0),
        Pidd2(rate=rate, **vars(gains)),
        Compensation(POINT.k_i, POINT.k_s),
    )
    slow = np.log(loop.poles[np.abs(loop.poles) > 0.9]) * rate
    expected = np.array([-w, *np.roots([1.0, 1.2 * w, w**2])])
    nearest = [complex(slow[np.argmin(np.abs(slow - pole))]) for pole in expected]
    assert np.max(np.abs(np.array(nearest) - expected)) < 0.03 * w


def scaled(loop: LinearLoop, factor: float) -> LinearLoop:
    return replace(loop, compensation=replace(loop.compensation, k_i=loop.compensation.k_i / factor))


@pytest.mark.parametrize("compensation", [Compensation(123.0, POINT.k_s), Compensation(100.0)])
def test_the_loop_becomes_unstable_at_its_margins(compensation: Compensation) -> None:
    loop = replace(LOOP, compensation=compensation)
    margins = loop.margins
    assert margins.stable
    for factor, outwards in ((margins.gain_up, 1.001), (margins.gain_down, 1.0 / 1.001)):
        assert scaled(loop, factor / outwards).is_stable
        assert not scaled(loop, factor * outwards).is_stable


def test_more_delay_than_the_margin_is_unstable() -> None:
    ticks = LOOP.margins.delay * RATE
    for share, stable in ((0.97, True), (1.03, False)):
        later = replace(LOOP.timing, delay_ticks=1.0 + share * ticks)
        assert replace(LOOP, timing=later).is_stable is stable


def test_the_peak_is_not_missed_between_the_points_of_a_grid() -> None:
    around = np.linspace(0.9, 1.1, 20_001) * LOOP.margins.peak_frequency
    sizes = np.abs(LOOP.sensitivity(around))
    assert LOOP.margins.peak == pytest.approx(float(np.max(sizes)), rel=1e-9)
    assert LOOP.margins.peak > 1.0


def test_without_a_controller_the_magnet_falls() -> None:
    loop = replace(LOOP, controller=Pidd2(rate=RATE, K_p=0.0), compensation=Compensation(123.0))
    assert not loop.is_stable
    s = math.log(float(np.max(np.abs(loop.poles)))) * RATE
    # The amplifier lets motion change the current slightly, which slows the fall.
    assert 0.95 * POINT.current_drive_pole < s / (2.0 * math.pi) < POINT.current_drive_pole
    winding = (POINT.inductance * s + POINT.resistance) * (s + 2.0 * math.pi * 2500.0)
    brake = POINT.k_i**2 * s**2 / winding
    assert POINT.mass * s**2 + POINT.damping * s - POINT.k_s == pytest.approx(-brake, rel=1e-6)


@pytest.mark.parametrize("changes", [{"K_dd": 0.0}, {"K_i": 0.0}, {"K_d": 0.0, "K_dd": 0.0}])
def test_parts_that_are_not_used_add_no_poles(changes: dict[str, float]) -> None:
    loop = replace(LOOP, controller=replace(CONTROLLER, **changes))
    held, rest = by_python_control(loop)
    z = np.exp(2j * np.pi * FREQUENCIES / RATE)
    assert np.max(np.abs(loop.loop_gain(FREQUENCIES) / (held(z) * rest(z)) - 1.0)) < 1e-6
    assert len(loop.poles) < len(LOOP.poles)


def test_a_controller_of_another_rate_is_refused() -> None:
    with pytest.raises(ValueError, match="10000 Hz, the loop at 20000 Hz"):
        replace(LOOP, controller=replace(CONTROLLER, rate=10e3))


def test_sampling_of_the_plant_agrees_with_scipy() -> None:
    loop = replace(LOOP, timing=LoopTiming(RATE, 0.0))
    a, _, c = loop.plant
    k = POINT
    amplifier = AMPLIFIER
    motion = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [k.k_s / k.mass, -k.damping / k.mass, k.k_i / k.mass, 0.0],
            [0.0, -k.k_i / k.inductance, -(k.resistance + amplifier.gain) / k.inductance, 1.0 / k.inductance],
            [0.0, 0.0, -amplifier.integral_gain, 0.0],
        ]
    )
    into = np.array([[0.0], [0.0], [amplifier.gain / k.inductance], [amplifier.integral_gain]])
    expected = cont2discrete((motion, into, np.eye(1, 4), np.zeros((1, 1))), 1.0 / RATE)
    assert a == pytest.approx(expected[0], rel=1e-9, abs=1e-12)
    assert c == pytest.approx(expected[2][0])


def in_laplace(point: LinearBearing, amplifier: AnalogueAmplifier, s: complex) -> complex:
    """Transfer function from current reference to position, m/A, solved from the equations."""
    tau = point.eddy_time
    # Unknowns: position, i_m, current, voltage, flux linkage.
    equations = np.array(
        [
            [point.mass * s**2 + point.damping * s - point.k_s, -point.k_i, 0.0, 0.0, 0.0],
            [point.k_i, point.inductance, 0.0, 0.0, -1.0],
            [0.0, 0.0, point.resistance, -1.0, s],
            [0.0, 1.0, -1.0, 0.0, tau / point.inductance * s],
            [0.0, 0.0, amplifier.gain + amplifier.integral_gain / s, 1.0, 0.0],
        ]
    )
    known = np.array([0.0, 0.0, 0.0, 0.0, amplifier.gain + amplifier.integral_gain / s])
    return complex(np.linalg.solve(equations, known)[0])


@pytest.mark.parametrize("eddy_time", [0.0, 30e-6, 300e-6])
def test_the_plant_follows_its_equations(eddy_time: float) -> None:
    rate = 1e6
    point = replace(POINT, eddy_time=eddy_time)
    amplifier = AnalogueAmplifier(300.0, 5e4)
    a, b, c = discretise(point, amplifier, LoopTiming(rate, 0.0))
    for frequency in (3.0, 40.0, 500.0, 4000.0):
        s = 2j * math.pi * frequency
        z = np.exp(s / rate)
        found = complex(c @ np.linalg.solve(z * np.eye(len(b)) - a, b))
        hold = complex((1.0 - 1.0 / z) * rate / s)
        assert found == pytest.approx(hold * in_laplace(point, amplifier, s), rel=1e-5)


def test_a_digital_current_controller_computes_once_a_tick() -> None:
    """Compare with the same control law in a loop over the ticks, around a voltage-driven plant."""
    digital = DigitalAmplifier(feedforward=1.1, gain=150.0, integral_gain=8.0, sensor_bandwidth=10e3)
    chain = LoopTiming(RATE, 1.25, 5e3)
    point, fine = replace(POINT, eddy_time=50e-6), 4
    a, b, c = discretise(point, digital, chain)
    references = np.random.default_rng(2).standard_normal(50)
    state, found = np.zeros(len(b)), []
    for reference in references:
        found.append(float(c @ state))
        state = a @ state + b * reference
    # States: position, velocity, i_m, measured position, measured current.
    held, lags = point.eddy_time / point.inductance, 2.0 * math.pi * np.array([5e3, 10e3])
    share = 1.0 / (1.0 + point.resistance * held)
    motion = np.zeros((5, 5))
    motion[0, 1] = 1.0
    motion[1, :3] = np.array([point.k_s, -point.damping, point.k_i]) / point.mass
    motion[2, 1:3] = -np.array([point.k_i, share * point.resistance]) / point.inductance
    motion[3, [0, 3]] = lags[0], -lags[0]
    motion[4, [2, 4]] = lags[1] * share, -lags[1]
    into = np.array([[0.0], [0.0], [share / point.inductance], [0.0], [lags[1] * share * held]])
    over, by, *_ = cont2discrete((motion, into, np.eye(5), np.zeros((5, 1))), 1.0 / (RATE * fine))
    state, integral, expected, line = np.zeros(5), 0.0, [], [0.0] * 5
    for reference in references:
        expected.append(float(state[3]))
        error = reference - float(state[4])
        voltage = digital.feedforward * reference + digital.gain * error + integral
        integral += digital.integral_gain * error
        for _ in range(fine):
            line.append(voltage)
            state = over @ state + by[:, 0] * line.pop(0)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * float(np.max(np.abs(expected))))


def test_a_current_that_jumps_with_the_voltage_must_be_read_through_a_lag() -> None:
    with pytest.raises(ValueError, match="through a lag"):
        discretise(replace(POINT, eddy_time=1e-4), DigitalAmplifier(1.2, 100.0, 1.0), LoopTiming(RATE, 1.0))
