"""Delay, missing stretches, ripple and input noise are found where they exist, and only there."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from anhyst.data import History, Loop, Loops
from anhyst.data.clean import clean
from anhyst.data.delay import estimate_delay
from anhyst.data.filtering import average_over_ripple, denoise
from anhyst.data.holes import cut_holes, find_holes
from anhyst.data.inspection import inspect
from anhyst.data.reading import read_loops
from anhyst.data.verdict import loop_width_and_height
from anhyst.identification.fit_records import read_rest_offsets
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.data.test_clean import play


def triangles(rate_Hz: float, period_s: float, delay_s: float, seed: int) -> Loop:
    """Return four bipolar triangles of growing size, with a delayed output and 0.1 % of noise."""
    margin = 0.1 * period_s
    time = np.arange(-margin, 4.0 * period_s + margin, 1.0 / rate_Hz)
    phase = time / period_s
    size = 0.6 + 0.1 * np.clip(np.floor(phase + 0.25), 0, 3)
    drive = size * (2.0 * np.abs(2.0 * ((phase - 0.25) % 1.0) - 1.0) - 1.0)
    flux = sum(np.tanh(play(drive, width) / 0.8) for width in (0.02, 0.05, 0.08)) / 3.0
    inside = time[(time >= 0.0) & (time < 4.0 * period_s)]
    delay = np.interp(inside - delay_s, time, np.asarray(flux) + 0.1 * drive)
    noisy = delay + np.random.default_rng(seed).normal(0.0, 1e-3, delay.size)
    return Loop("1", np.interp(inside, time, drive), noisy, None, inside, History("settled"))


@pytest.mark.parametrize("delay_s", [0.01, -0.02, 0.05])
@pytest.mark.parametrize("rate_Hz", [200.0, 5e3, 1e5])
def test_delay_is_found_in_seconds_at_any_sampling_rate(rate_Hz: float, delay_s: float) -> None:
    found = estimate_delay(triangles(rate_Hz, 1.0, delay_s, seed=1))
    assert found is not None
    assert found / rate_Hz == pytest.approx(delay_s, abs=max(0.05 * abs(delay_s), 1.0 / rate_Hz))


def test_no_delay_is_claimed_in_records_without_one() -> None:
    alarms = [estimate_delay(triangles(500.0, 1.0, 0.0, seed)) for seed in range(20)]
    assert not any(alarms)


def test_a_delay_is_removed_and_reported_in_seconds() -> None:
    loop = triangles(2e3, 1.0, 0.02, seed=2)
    loops = Loops((loop,), QUANTITIES["field"], QUANTITIES["flux_density"])
    assert inspect(loops).as_dict()["loops"][0]["skew_s"] == pytest.approx(0.02, rel=0.05)
    cleaned = clean(loops, ["skew"])
    assert " s (" in cleaned.repairs[-1]
    assert not estimate_delay(cleaned.loops[0])


def forces(noise_A: float, ripple_A: float, seed: int = 0) -> Loops:
    """Return two unipolar cycles of 2 A in 4 s at 2 kHz, with noise or a ripple of 200 Hz."""
    time = np.arange(16000) / 2000.0
    phase = time / 4.0
    drive = 1.0 - np.cos(2.0 * np.pi * phase)
    drive = drive + ripple_A * np.sin(2.0 * np.pi * 200.0 * time)
    force = 5.0 * play(drive, 0.12) ** 2
    rng = np.random.default_rng(seed)
    drive = drive + rng.normal(0.0, noise_A, drive.size) if noise_A else drive
    force = force + rng.normal(0.0, 0.01, force.size)
    loop = Loop("1", drive, force, None, time, History("settled"))
    return Loops((loop,), QUANTITIES["current"], QUANTITIES["force"])


def test_ripple_is_named_and_removed() -> None:
    cleaned = average_over_ripple(forces(0.0, 0.04))
    assert "200 Hz" in cleaned.repairs[-1]
    assert "0.038 A" in cleaned.repairs[-1]
    assert cleaned.loops[0].reversals == 3
    # The force ripples too. Play operators with threshold r act like operators with r - 0.04 A over
    # the mean current. The edge of the ripple restores the loop of the iron.
    assert "the force ripples too" in cleaned.repairs[-1]
    width, _ = loop_width_and_height(cleaned.loops[0], is_even=True)
    assert width == pytest.approx(0.24, abs=0.015)


def test_aliased_ripple_is_removed() -> None:
    loops = forces(0.0, 0.04)
    (loop,) = loops.loops
    assert loop.time is not None
    rows = slice(None, None, 9)  # 200 Hz sampled at 222 Hz appears at 22 Hz
    coarse = Loop("1", loop.input[rows], loop.output[rows], None, loop.time[rows])
    cleaned = average_over_ripple(loops.with_loops([coarse]))
    assert "22.22 Hz" in cleaned.repairs[-1]
    assert cleaned.loops[0].reversals == 3


def test_minor_loops_staircases_and_dither_that_fades_are_no_ripple() -> None:
    time = np.arange(8000) / 1000.0
    slow_drive = 1.0 - np.cos(2.0 * np.pi * time / 4.0)
    drives: list[FloatArray] = [
        slow_drive + 0.1 * np.sin(2.0 * np.pi * 5.0 * time),  # ten minor loops for each branch
        np.floor(slow_drive * 100.0) / 100.0,
        slow_drive + 0.2 * np.exp(-time) * np.sin(2.0 * np.pi * 100.0 * time),
    ]
    for drive in drives:
        loop = Loop("1", drive, play(drive, 0.1), None, time, History("settled"))
        loops = Loops((loop,), QUANTITIES["current"], QUANTITIES["flux_density"])
        assert average_over_ripple(loops) is loops


def test_noise_of_the_input_is_reduced_without_a_shift_of_its_tips() -> None:
    clear, noisy = forces(0.0, 0.0).loops[0], forces(0.01, 0.0).loops[0]
    smooth = denoise(Loops((noisy,), QUANTITIES["current"], QUANTITIES["force"])).loops[0]
    error = smooth.input - clear.input
    assert error.std() < 0.4 * 0.01
    assert abs(smooth.input.max() - 2.0) < 0.01
    assert denoise(forces(0.0, 0.0)).repairs == ()


@pytest.mark.parametrize("noise_A", [0.5e-3, 2e-3])
def test_offset_of_the_input_is_within_its_interval(noise_A: float) -> None:
    covered, offsets = 0, []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        ramp = np.interp(np.arange(1200), [0, 200, 400, 600, 800, 1000, 1200], [0, 2, 0, 2, 0, 2, 0])
        loops = tuple(
            Loop(
                "1",
                ramp + 0.012 + rng.normal(0.0, noise_A, ramp.size),
                ramp**2,
                np.full(ramp.size, gap),
                np.arange(ramp.size) / 1000.0,
            )
            for gap in (5e-4, 8e-4, 1.2e-3)
        )
        three = Loops(loops, QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])
        reading = read_rest_offsets(denoise(three)).input
        if reading.offset:
            offsets.append(reading.offset)
        covered += abs(reading.offset - 0.012) <= reading.half_width
    assert np.mean(offsets) == pytest.approx(0.012, abs=2e-4)
    assert covered >= 180


def test_reversals_of_minor_loops_are_not_pauses() -> None:
    turns = [0.0, 3.0, 1.0, 2.5, 1.5, 3.0, 0.0, 3.0, 1.2, 3.0, 0.0]
    drive = np.concatenate([np.linspace(a, b, 40)[1:] for a, b in itertools.pairwise(turns)])
    loops = Loops(
        tuple(
            Loop(label, drive, 12.0 * play(drive, 0.05) ** 2, None, None, History("settled"))
            for label in ("first", "second", "third")
        ),
        QUANTITIES["current"],
        QUANTITIES["force"],
        None,
    )
    assert read_rest_offsets(loops).input.offset == 0.0


def test_record_is_cut_at_a_missing_stretch() -> None:
    loops = forces(0.0, 0.0)
    whole_loop = loops.loops[0]
    assert whole_loop.time is not None
    is_kept = (whole_loop.time < 2.5) | (whole_loop.time > 3.1)
    holed = Loop("1", whole_loop.input[is_kept], whole_loop.output[is_kept], None, whole_loop.time[is_kept])
    (hole,) = find_holes(holed.time)
    assert hole.time_s == pytest.approx(2.5, abs=1e-3)
    assert hole.duration_s == pytest.approx(0.6, abs=2e-3)
    cut = cut_holes(loops.with_loops([holed]))
    assert "are missing after sample 5000" in cut.repairs[-1]
    later = cut.loops[1]
    assert later.time is not None
    assert later.time[0] == pytest.approx(4.0, abs=0.15)  # wipes out the remaining history
    assert str(later.history).startswith("conditioned:0.0,2.0")


def test_uneven_clock_of_a_slow_logger_has_no_holes() -> None:
    steps = np.random.default_rng(0).exponential(1.0, 400)
    assert find_holes(np.cumsum(steps)) == []


def test_cases_are_read_right(cases: Path) -> None:
    late = inspect(read_loops([cases / "delay10ms.csv"])).loops[0]
    assert late.skew_s == pytest.approx(0.01, rel=0.05)
    floored = inspect(read_loops([cases / "floored_force.csv"]))
    assert not floored.loops[0].skew
    missing = inspect(read_loops([cases / "missing.csv"]))
    assert any("0.595 s are missing after sample 301" in text for text in missing.warnings)
    assert json.dumps(missing.as_dict())
