"""A delay of the sensor is found at sharp reversals, whatever eddy currents the iron has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anhyst.data import Loop, Loops
from anhyst.data.path import History, move_plays
from anhyst.data.speeds import group_by_speed
from anhyst.identification import identify
from anhyst.identification.sensor_delay import (
    MIN_SIGMAS,
    SensorDelay,
    estimate_sensor_delay,
    remove_sensor_delay,
)
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES

SAMPLES, FINE = 400, 16
IRONS = ("sheets", "slab", "ring")


def response(iron: str, frequency: FloatArray, lag: float) -> FloatArray:
    """Return the flux over the field of linear iron: sheets, a slab, a shorted turn."""
    s = 2j * np.pi * frequency * lag + 1e-12
    if iron == "slab":
        return np.asarray(np.tanh(np.sqrt(s)) / np.sqrt(s))
    return np.asarray(1.0 / (1.0 + s)) if iron == "ring" else np.ones_like(s)


def cycle(
    iron: str,
    rate: float,
    delay: float,
    random: np.random.Generator,
    *,
    lag: float = 5e-3,
    corner: float = 0.0,
) -> Loop:
    """Return a steady-state triangle of a current whose reversals are rounded by a lag, s."""
    count = SAMPLES * FINE
    time = np.arange(count) / (count * rate)
    frequency = np.fft.rfftfreq(count, time[1])
    triangle = 1.0 - np.abs(2.0 * (np.arange(count) / count) - 1.0)
    current = np.fft.irfft(np.fft.rfft(triangle) / (1.0 + 2j * np.pi * frequency * corner), count)
    thresholds = np.linspace(0.01, 0.3, 30)
    played = move_plays(np.tile(current, 2)[None], thresholds, np.zeros((1, 30)))[count:, 0].mean(axis=1)
    spectrum = np.fft.rfft(0.7 * current + 0.3 * played) * response(iron, frequency, lag)
    flux = np.fft.irfft(spectrum * np.exp(-2j * np.pi * frequency * delay), count)
    noise = 3e-4 * random.normal(size=(2, SAMPLES))
    rows = slice(None, None, FINE)
    return Loop(
        f"{rate:g} Hz",
        current[rows] + 0.3 * noise[0],
        60.0 * ((flux[rows] + 0.1) ** 2 + noise[1]),
        np.full(SAMPLES, 3e-4),
        time[rows],
    )


def estimate(iron: str, delay: float, seed: int, **options: float) -> SensorDelay:
    random = np.random.default_rng(seed)
    found = estimate_sensor_delay([cycle(iron, 50.0, delay, random, **options) for _ in range(3)])
    assert found is not None
    return found


@pytest.mark.parametrize("iron", IRONS)
@pytest.mark.parametrize("delay", [1e-4, 3e-4, 1e-3])
def test_a_delay_is_found(iron: str, delay: float) -> None:
    found = estimate(iron, delay, seed=round(1e6 * delay), lag=1e-3)
    assert found.seconds == pytest.approx(delay, abs=8e-5 if iron == "ring" else 2e-5)
    assert abs(found.seconds - delay) < 2.5 * found.error
    assert found.error < (1.5e-4 if iron == "ring" else 4e-5)
    assert delay < 2e-4 or found.seconds > MIN_SIGMAS * found.error


@pytest.mark.parametrize("iron", IRONS)
@pytest.mark.parametrize("lag", [1e-3, 5e-3, 3e-2])
@pytest.mark.parametrize("corner", [0.0, 1e-4, 5e-4])
def test_lag_of_the_iron_and_rounded_reversals_are_not_a_delay(iron: str, lag: float, corner: float) -> None:
    found = estimate(iron, 0.0, seed=5, lag=lag, corner=corner)
    assert found.seconds < MIN_SIGMAS * found.error


def test_a_last_sample_that_repeats_the_first_does_not_matter() -> None:
    loop = cycle("slab", 50.0, 3e-4, np.random.default_rng(1))
    assert loop.time is not None
    closed = replace(
        loop,
        input=np.append(loop.input, loop.input[0]),
        output=np.append(loop.output, loop.output[0]),
        schedule=np.full(SAMPLES + 1, 3e-4),
        time=np.append(loop.time, 0.02),
    )
    found = estimate_sensor_delay([closed])
    assert found is not None
    assert found.seconds == pytest.approx(3e-4, abs=3e-5)


def test_smooth_or_slow_drives_do_not_show_a_delay() -> None:
    random = np.random.default_rng(1)
    loop = cycle("slab", 50.0, 3e-4, random)
    sine = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(SAMPLES) / SAMPLES)
    assert estimate_sensor_delay([replace(loop, input=sine, output=sine**2)]) is None
    assert estimate_sensor_delay([replace(loop, time=None)]) is None
    slow = estimate_sensor_delay([cycle("slab", 2.0, 3e-4, random)])
    assert slow is None or abs(slow.seconds) < MIN_SIGMAS * slow.error


def measured(delay: float) -> Loops:
    random = np.random.default_rng(2)
    loops = [cycle("slab", rate, delay, random, lag=2e-3) for rate in (0.5, 5.0, 50.0)]
    return Loops(tuple(loops), QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])


def test_the_delay_is_removed_from_cycles_and_from_records_that_end() -> None:
    late, prompt = measured(3e-4), measured(0.0)
    speeds = group_by_speed(late)
    assert speeds is not None
    delay = estimate_sensor_delay(speeds.fast[-1])
    assert delay is not None
    for shifted, loop in zip(remove_sensor_delay(late, delay).loops, prompt.loops, strict=True):
        assert np.abs(shifted.output - loop.output).max() < 0.01 * np.ptp(loop.output)
    ending = [replace(loop, history=History.parse("conditioned:0,1,0")) for loop in late.loops]
    shorter = remove_sensor_delay(late.with_loops(ending), delay).loops[-1]
    assert shorter.n in (SAMPLES - 7, SAMPLES - 6)  # 0.3 ms are 6 steps
    prompt_speeds = group_by_speed(prompt)
    assert prompt_speeds is not None
    prompt_delay = estimate_sensor_delay(prompt_speeds.fast[-1])
    assert prompt_delay is not None
    assert not prompt_delay.is_clear


def test_identify_states_the_delay_and_the_model_does_not_contain_it() -> None:
    late, prompt = identify(measured(3e-4)), identify(measured(0.0))
    assert sum("is later than the input by 0.3" in text for text in late.warnings) == 1
    assert "later than the input by 0.3" in str(late.model.provenance.settings["sensor_delay"])
    assert not any("sharp reversals" in text for text in prompt.warnings)
    assert "sensor_delay" not in prompt.model.provenance.settings
    loop = measured(0.0).loops[-1]
    error = late.model.predict_loop(loop) - prompt.model.predict_loop(loop)
    assert np.abs(error).max() < 0.01 * np.ptp(loop.output)
