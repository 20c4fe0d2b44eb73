"""Cleaning steps remove the disturbances of test data and change nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anhyst.data import History, Loop, Loops, estimates
from anhyst.data.clean import DEFAULT_STEPS, STEPS, clean, thin_loops
from anhyst.data.delay import estimate_delay
from anhyst.data.estimates import estimate_noise
from anhyst.data.path import find_turning_points
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.refusals import refused

SAMPLES = 400


def play(drive: FloatArray, half_width: float) -> FloatArray:
    """Return a play operator, the simplest hysteresis."""
    answer = np.empty_like(drive)
    state = 0.0
    for place, value in enumerate(drive.tolist()):
        state = min(max(state, value - half_width), value + half_width)
        answer[place] = state
    return answer


def iron(cycles: float = 3.0, samples: int = SAMPLES) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return field, flux density and time of a soft iron that starts at rest and then settles."""
    time = np.arange(int(cycles * samples)) / samples
    field = 100.0 * np.sin(2.0 * np.pi * time)
    flux = sum(0.25 * np.tanh(play(field, width) / 40.0) for width in (2.0, 6.0, 12.0))
    return field, 0.4 * np.tanh(field / 60.0) + np.asarray(flux), time


def record(field: FloatArray, flux: FloatArray, time: FloatArray | None = None) -> Loops:
    loop = Loop("1", field, flux, None, time, History("settled"))
    return Loops((loop,), QUANTITIES["field"], QUANTITIES["flux_density"])


def test_unknown_step_is_refused_with_the_known_ones() -> None:
    with refused("unknown-cleaning-step polish"):
        clean(record(*iron()), ["polish"])


@pytest.mark.parametrize("step", [name for name in STEPS if name not in {"offset", "drift"}])
def test_a_clean_record_is_unchanged(step: str) -> None:
    loops = record(*iron())
    assert clean(loops, [step]) is loops


def test_default_steps_do_not_touch_values_of_short_records() -> None:
    loops = record(*iron())
    assert clean(loops) is loops
    assert set(DEFAULT_STEPS) == {"dedupe", "holes", "ripple", "denoise", "thin"}


def test_repeated_samples_are_removed() -> None:
    field, flux, time = iron()
    repeated = [np.repeat(values, 2) for values in (field, flux, time)]
    cleaned = clean(record(*repeated), ["dedupe"])
    assert np.array_equal(cleaned.loops[0].output, flux)
    assert cleaned.repairs == (f"dedupe: {field.size} repeated samples dropped",)


def test_constant_samples_at_later_times_are_not_removed() -> None:
    time = np.arange(6.0)
    values = np.array([0.0, 1.0, 1.0, 1.0, 0.0, 0.5])
    assert clean(record(values, values, time), ["dedupe"]).loops[0].n == 6


def test_spikes_are_removed_and_tips_are_kept() -> None:
    field, flux, time = iron()
    spoiled = flux.copy()
    spoiled[[60, 333, 650]] += [0.3, -0.2, 0.1]
    cleaned = clean(record(field, spoiled, time), ["spikes"])
    assert cleaned.repairs == ("spikes: 3 samples dropped",)
    assert np.array_equal(cleaned.loops[0].output, np.delete(flux, [60, 333, 650]))


def test_cycles_of_two_kinds_in_turn_are_no_drift() -> None:
    drive = np.tile(np.concatenate([np.linspace(0, 1, 40), np.linspace(1, 0, 40)]), 20)
    size = np.repeat(np.arange(20) % 2, 80)
    assert estimates.estimate_drift(record(drive, drive**2 * (1.0 + size)).loops[0]) is None


def test_drift_is_found_and_removed() -> None:
    field, flux, _ = iron()
    field, flux = field[SAMPLES:], flux[SAMPLES:]
    share = np.linspace(-0.5, 0.5, field.size)
    cleaned = clean(record(field, flux + 0.08 * share), ["drift"])
    assert cleaned.repairs[0].startswith("drift: 0.08")
    assert np.max(np.abs(cleaned.loops[0].output - flux)) < 2e-4


def test_offsets_of_symmetric_loops_are_found() -> None:
    field, flux, _ = iron()
    field, flux = field[SAMPLES:], flux[SAMPLES:]
    found = estimates.estimate_offsets(record(field + 1.5, flux - 0.02).loops[0])
    assert found is not None
    assert found[0] == pytest.approx(1.5, abs=0.05)
    assert found[1] == pytest.approx(-0.02, abs=1e-3)
    cleaned = clean(record(field + 1.5, flux - 0.02), ["offset"])
    assert np.max(np.abs(cleaned.loops[0].output - flux)) < 1e-3


def test_an_offset_of_force_is_not_removed() -> None:
    field, flux, _ = iron()
    loop = Loop("1", field, flux**2)
    loops = Loops((loop,), QUANTITIES["current"], QUANTITIES["force"])
    assert clean(loops, ["offset"]) is loops


def test_unipolar_loops_have_no_centre() -> None:
    field, flux, _ = iron()
    assert estimates.estimate_offsets(record(field + 100.0, flux).loops[0]) is None


@pytest.mark.parametrize("delay", [-2.0, 1.0, 2.5])
def test_delay_between_channels_is_found_in_noise(delay: float) -> None:
    field, flux, _ = iron(6.0)
    rows = np.arange(field.size)
    delayed = np.interp(rows - delay, rows, flux)[10:-10]
    noisy = delayed + np.random.default_rng(3).normal(0.0, 1e-4, delayed.size)
    found = estimate_delay(record(field[10:-10], noisy).loops[0])
    assert found == pytest.approx(delay, abs=0.25)
    cleaned = clean(record(field[10:-10], noisy), ["skew"]).loops[0]
    again = estimate_delay(cleaned)
    assert again is not None
    assert abs(again) < 0.2


def test_no_delay_is_reported_for_undelayed_records() -> None:
    field, flux, _ = iron(6.0)
    noisy = flux + np.random.default_rng(4).normal(0.0, 2e-3, flux.size)
    assert estimate_delay(record(field, noisy).loops[0]) in {0.0, None}


def test_noise_alone_is_no_delay() -> None:
    field, flux, _ = iron(20.0, 4000)
    noisy = flux + np.random.default_rng(4).normal(0.0, 0.05, flux.size)
    assert estimate_delay(record(field, noisy).loops[0]) in {0.0, None}


@pytest.mark.parametrize("sigma", [1e-4, 1e-3, 5e-3])
def test_noise_is_reported_from_the_signal(sigma: float) -> None:
    _, flux, _ = iron(5.0, 1000)
    noisy = flux + np.random.default_rng(5).normal(0.0, sigma, flux.size)
    assert estimate_noise(noisy) == pytest.approx(sigma, rel=0.1)


def test_spikes_do_not_count_as_noise() -> None:
    _, flux, _ = iron(5.0, 1000)
    noisy = flux + np.random.default_rng(5).normal(0.0, 1e-3, flux.size)
    noisy[::100] += 0.5
    assert estimate_noise(noisy) == pytest.approx(1e-3, rel=0.2)


def test_wobbling_gap_is_settled_to_its_median() -> None:
    field, flux, _ = iron()
    gap = 3e-4 + 1e-6 * np.sin(np.arange(field.size))
    loop = Loop("1", field, flux, gap)
    loops = Loops((loop,), QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])
    settled = clean(loops, ["steady"])
    assert len(settled.schedule_values) == 1
    assert settled.schedule_values[0] == pytest.approx(3e-4, abs=2e-7)
    unsteady = replace(loop, schedule=gap * np.linspace(1.0, 1.5, gap.size))
    assert clean(loops.with_loops([unsteady]), ["steady"]).schedule_values == ()


def test_thinning_keeps_reversals_and_the_path() -> None:
    field, flux, time = iron(4.0, 5000)
    loops = record(field, flux, time)
    thinned = thin_loops(loops, 600)
    loop = thinned.loops[0]
    assert 300 < loop.n <= 600
    assert thinned.repairs[0].startswith("thin: 1 loop averaged to 600 samples")
    turns = find_turning_points(field, 1.0)
    assert np.isin(field[turns], loop.input).all()
    assert loop.reverses
    assert loop.time is not None
    assert np.all(np.diff(loop.time) > 0.0)
    # The samples are on the measured path: interpolated in time, they differ by less than a bin.
    assert np.max(np.abs(np.interp(loop.time, time, flux) - loop.output)) < 2e-3


def test_thinning_averages_noise_away() -> None:
    field, flux, time = iron(1.0, 50_000)
    noisy = flux + np.random.default_rng(6).normal(0.0, 0.01, flux.size)
    loop = thin_loops(record(field, noisy, time), 500).loops[0]
    assert loop.time is not None
    residual = loop.output - np.interp(loop.time, time, flux)
    assert np.sqrt(np.mean(residual**2)) < 0.003


def test_steps_run_in_the_order_given_and_are_all_named() -> None:
    field, flux, time = iron()
    spoiled = flux.copy()
    spoiled[60] += 0.3
    repeated = [np.repeat(values, 2) for values in (field, spoiled, time)]
    cleaned = clean(record(*repeated), ["dedupe", "spikes"])
    assert [repair.split(":")[0] for repair in cleaned.repairs] == ["dedupe", "spikes"]
