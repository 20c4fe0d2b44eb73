"""Resonances and lags are distinguished from hysteresis for many frequencies and noise levels."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim, lfilter

from anhyst.data import Loop, Loops
from anhyst.data.coil_lag import describe_coil_lag
from anhyst.data.inspection import inspect
from anhyst.data.resonance import describe_dynamics, find_dynamics
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.data.test_clean import play

DRIVES = ("multisine", "chirp", "random", "triangle", "steps")


def drive_of(kind: str, time: FloatArray, hz: float, rng: np.random.Generator) -> FloatArray:
    """Return an input of unit amplitude that excites frequencies around one."""
    span, step = float(time[-1]), float(time[1])
    if kind == "chirp":
        lowest, high = 0.05 * hz, 2.5 * hz
        return np.sin(2.0 * np.pi * (lowest * time + (high - lowest) * time**2 / (2.0 * span)))
    if kind == "random":
        kept = np.exp(-2.0 * np.pi * 2.0 * hz * step)
        drive = np.asarray(lfilter([1.0 - kept], [1.0, -kept], rng.standard_normal(time.size)))
    elif kind == "steps":
        place = (time * hz / 6.0).astype(int)
        drive = rng.uniform(-1.0, 1.0, place.max() + 1)[place]
    elif kind == "triangle":
        drive = 2.0 * np.abs(2.0 * ((time * hz / rng.uniform(2.2, 6.0)) % 1.0) - 1.0) - 1.0
    else:
        lines = np.linspace(0.05, 1.6, 40) * hz
        phases = rng.uniform(0.0, 2.0 * np.pi, lines.size)
        drive = np.sin(2.0 * np.pi * np.outer(time, lines) + phases).sum(axis=1)
    return np.asarray(drive / np.abs(drive).max())


def resonator(drive: FloatArray, step: float, hz: float, damping: float) -> FloatArray:
    own = 2.0 * np.pi * hz
    system = ([[0.0, 1.0], [-(own**2), -2.0 * damping * own]], [[0.0], [own**2]])
    matrices = tuple(map(np.array, (*system, [[1.0, 0.0]], [[0.0]])))
    return np.asarray(dlsim(cont2discrete(matrices, step, "foh"), drive)[1][:, 0])


def loops(drive: FloatArray, output: FloatArray, time: FloatArray | None, name: str) -> Loops:
    voltage, answer = QUANTITIES["voltage"], QUANTITIES[name]
    return Loops((Loop("1", drive, output, None, time),), voltage, answer)


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", DRIVES)
def test_resonance_is_found_within_a_tenth(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    hz = float(np.exp(rng.uniform(np.log(20.0), np.log(200.0))))
    damping = float(np.exp(rng.uniform(np.log(0.005), np.log(0.1))))
    rate = hz * float(np.exp(rng.uniform(np.log(8.0), np.log(120.0))))
    time = np.arange(0.0, rng.uniform(40.0, 150.0) / hz, 1.0 / rate)
    drive = drive_of(kind, time, hz, rng)
    pushed = drive + rng.uniform(0.0, 1.0) * play(drive, 0.2)
    output = resonator(pushed, 1.0 / rate, hz, damping)
    output += rng.choice([0.0, 0.01, 0.05]) * output.std() * rng.standard_normal(time.size)
    found = find_dynamics(loops(50.0 * drive, 1e-5 * output, time, "displacement"))
    assert found is not None
    assert found.frequency == pytest.approx(hz, rel=0.1)


@pytest.mark.first(1)
@pytest.mark.parametrize("kind", [*DRIVES, "sine", "decaying"])
def test_hysteresis_creep_and_lag_are_no_resonance(kind: str) -> None:
    for seed in range(12):
        rng = np.random.default_rng(seed)
        hz = float(np.exp(rng.uniform(np.log(0.05), np.log(50.0))))
        time = np.arange(0.0, rng.uniform(3.0, 12.0), 1.0 / rng.uniform(30.0, 600.0)) / hz
        sine = np.sin(2.0 * np.pi * hz * time)
        own = {"sine": sine, "decaying": sine * np.linspace(1.0, 0.1, time.size)}
        drive = own[kind] if kind in own else drive_of(kind, time, hz, rng)
        if np.ptp(drive) == 0.0:
            continue
        output = drive + rng.uniform(0.3, 2.0) * play(drive, rng.uniform(0.02, 0.4))
        kept = np.exp(-2.0 * np.pi * hz * time[1] * rng.uniform(0.5, 10.0))
        if seed % 3 == 1:
            output = np.asarray(lfilter([1.0 - kept], [1.0, -kept], output))
        if seed % 3 == 2:
            output += 0.1 * np.asarray(lfilter([0.02], [1.0, -0.98], output))
        output += rng.choice([0.0, 0.01, 0.1]) * output.std() * rng.standard_normal(time.size)
        assert find_dynamics(loops(50.0 * drive, 1e-5 * output, time, "displacement")) is None


@pytest.mark.parametrize("damping", [0.3, 0.5, 0.65])
@pytest.mark.parametrize("kind", ["multisine", "chirp", "random"])
def test_damped_oscillation_is_found(kind: str, damping: float) -> None:
    time = np.arange(0.0, 3.0, 1e-3)
    drive = drive_of(kind, time, 35.0, np.random.default_rng(3))
    measured = loops(drive, 1e-5 * resonator(drive, 1e-3, 35.0, damping), time, "displacement")
    assert "like a damped oscillator" in describe_dynamics(measured)


def test_dead_time_is_found() -> None:
    time = np.arange(0.0, 3.0, 1e-3)
    drive = drive_of("random", time, 35.0, np.random.default_rng(3))
    output = np.roll(drive + play(drive, 0.2), 20)[20:]
    measured = loops(drive[20:], 1e-5 * output, time[20:], "displacement")
    assert "dead time of about 20 ms" in describe_dynamics(measured)


def test_a_resonance_gives_an_unknown_verdict() -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    drive = drive_of("random", time, 35.0, np.random.default_rng(3))
    measured = loops(drive, 1e-5 * resonator(drive, 1e-3, 35.0, 0.02), time, "displacement")
    verdict = inspect(measured).verdict
    assert verdict.level == "unknown"
    assert not verdict.worthwhile
    assert "the output resonates near 35 Hz; measure more slowly" in verdict.sentences[-1]


def coil(seed: int, *, lag: float, hysteresis: float) -> tuple[Loops, float]:
    """Return the force of a coil over its voltage, and the lag, relative to cycle and range."""
    rng = np.random.default_rng(seed)
    hz, samples = float(np.exp(rng.uniform(np.log(0.1), np.log(20.0)))), int(rng.integers(150, 900))
    time = np.arange(0.0, 5.0, 1.0 / samples) / hz
    cycle = (time * hz).astype(int)
    drive = 12.0 * np.array([1.0, 0.6, 0.8, 0.4, 0.9])[cycle]
    drive = drive * (1.0 - np.abs(2.0 * ((time * hz) % 1.0) - 1.0))
    current, lag_s = drive, lag / hz
    if lag:
        kept = np.exp(-time[1] / lag_s)
        current = np.asarray(lfilter([1.0 - kept], [1.0, -kept], drive))
    flux = (1.0 - hysteresis) * current + hysteresis * play(current, 0.6)
    force = flux**2 + 0.1 * rng.standard_normal(time.size)
    return loops(drive, force, time, "force"), lag_s


@pytest.mark.parametrize("seed", range(8))
def test_lag_of_a_coil_is_not_hysteresis(seed: int) -> None:
    measured, lag = coil(seed, lag=0.03, hysteresis=0.0)
    line = describe_coil_lag(measured)
    assert "record the current instead" in line
    stated = float(line.split("about ")[1].split(" ms")[0]) * 1e-3
    assert stated == pytest.approx(lag, rel=0.3)
    assert inspect(measured).verdict.level == "unknown"
    assert describe_coil_lag(coil(seed, lag=0.03, hysteresis=0.4)[0])


@pytest.mark.parametrize("seed", range(8))
def test_hysteresis_of_a_coil_is_no_lag(seed: int) -> None:
    measured, _ = coil(seed, lag=0.0, hysteresis=0.5)
    assert describe_coil_lag(measured) == ""
    assert inspect(measured).verdict.level == "yes"


def test_a_coil_lag_is_not_estimated_for_other_quantities() -> None:
    measured, _ = coil(0, lag=0.03, hysteresis=0.0)
    for drive, answer in (("current", "force"), ("voltage", "displacement")):
        other = Loops(measured.loops, QUANTITIES[drive], QUANTITIES[answer])
        assert describe_coil_lag(other) == ""
