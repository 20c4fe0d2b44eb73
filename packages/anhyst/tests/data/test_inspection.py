"""Inspection: figures, warnings, impossible records and the verdict."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from anhyst.data import History, Loop, Loops
from anhyst.data.initial_history import propose_histories
from anhyst.data.inspection import inspect, plot_inspection
from anhyst.data.reading import read_loops
from anhyst.data.verdict import GAIN_ADVICE, assess_loops, fit_monotone
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.refusals import refused


def magnet(gap: float = 3e-4, width: float = 0.06, noise: float = 0.0, *, bipolar: bool = False) -> Loop:
    """Return a settled force-current loop of a magnet: a square law over a play operator."""
    angle = np.linspace(0.0, 6.0 * np.pi, 1500)
    current = 2.0 * np.sin(angle) if bipolar else 1.0 - np.cos(angle)
    state, flux = 0.0, np.empty_like(current)
    for place, value in enumerate(current.tolist()):
        state = min(max(state, value - width), value + width)
        flux[place] = 0.5 * (state + value)
    force = (3e-3 / gap) * flux**2 + noise * np.random.default_rng(1).normal(size=flux.size)
    start = 500  # the first cycle is a transient
    schedule = np.full(1000, gap)
    return Loop("1", current[start:], force[start:], schedule, None, History("settled"))


def loopset(*loops: Loop) -> Loops:
    current, force, gap = (QUANTITIES[name] for name in ("current", "force", "gap"))
    return Loops(loops, current, force, gap)


def changed(loop: Loop, drive: FloatArray, answer: FloatArray) -> Loops:
    return loopset(Loop("1", drive, answer, loop.schedule, None, loop.history))


def test_inspect_reports_the_values_of_the_record() -> None:
    found = inspect(loopset(magnet(3e-4, noise=0.02), magnet(6e-4, noise=0.02)))
    assert found.schedule_values == (3e-4, 6e-4)
    first = found.loops[0]
    assert first.samples == 1000
    assert first.cycles == 2.0
    assert (first.input_low, first.input_high) == pytest.approx((0.0, 2.0), abs=1e-4)
    assert first.noise == pytest.approx(0.02, rel=0.1)
    assert first.width == pytest.approx(0.06, rel=0.1)
    assert first.proposed.kind == "settled"
    assert first.input_offset is None
    assert found.warnings == ()


def test_inspection_is_ready_for_json_with_units_in_keys() -> None:
    found = inspect(loopset(magnet()))
    text = json.dumps(found.as_dict(), allow_nan=False)
    back = json.loads(text)
    assert back["loops"][0]["noise_N"] == found.loops[0].noise
    assert back["loops"][0]["width_A"] == found.loops[0].width
    assert back["loops"][0]["schedule_m"] == 3e-4
    assert back["loops"][0]["history"] == "settled"
    assert back["verdict"]["single_mean_N"] == found.verdict.single_mean
    assert back["verdict"]["worthwhile"] is True


def test_wide_loops_are_worth_a_model() -> None:
    verdict = assess_loops(loopset(magnet(width=0.1, noise=0.02)))
    assert verdict.level == "yes"
    assert verdict.worthwhile
    assert verdict.gain > 0.8
    assert verdict.single_worst > verdict.single_mean > verdict.noise_mean
    assert "worth it" in verdict.sentences[-1]


def test_loops_lost_in_noise_are_not_worth_a_model() -> None:
    verdict = assess_loops(loopset(magnet(width=1e-4, noise=0.05)))
    assert verdict.level == "no"
    assert not verdict.worthwhile
    assert verdict.gain < 0.3
    assert "is not worth it" in verdict.sentences[-2]
    assert verdict.sentences[-1].lower() == f"{GAIN_ADVICE}.".lower()


def test_width_of_even_force_is_found_with_both_signs_of_current() -> None:
    one = assess_loops(loopset(magnet(width=0.05, bipolar=True)))
    assert one.width == pytest.approx(0.05, rel=0.15)
    assert one.single_mean_relative < 0.05


def test_one_gap_only_is_reported() -> None:
    found = inspect(loopset(magnet()))
    assert "only one gap: the dependence on it cannot be identified" in found.warnings


def test_loops_with_a_moving_gap_are_checked_like_others() -> None:
    moving = replace(magnet(noise=0.02), schedule=np.linspace(3e-4, 3.2e-4, 1000))
    assert inspect(loopset(moving)).schedule_values == ()
    with refused("force-negative"):
        inspect(loopset(replace(moving, output=-moving.output)))


def test_force_of_flipped_sign_is_refused() -> None:
    loop = magnet(noise=0.02)
    with refused("force-negative loop '1' at gap 0.3 mm"):
        inspect(changed(loop, loop.input, -loop.output))


@pytest.mark.parametrize("bipolar", [False, True])
def test_swapped_current_and_force_are_refused(*, bipolar: bool) -> None:
    loop = magnet(noise=0.02, bipolar=bipolar)
    with refused("columns-swapped loop '1' at gap 0.3 mm"):
        inspect(changed(loop, loop.output, loop.input))


@pytest.mark.parametrize(("seed", "offset"), [(4, 0.0), (18, 0.0), (3, -0.9)])
def test_small_loops_do_not_decide_whether_columns_or_signs_are_wrong(seed: int, offset: float) -> None:
    """In a small loop, remanence, offset and noise can exceed the effect of the current."""
    whole_loop = magnet(noise=0.1)
    small_loop = 0.1 * np.abs(np.sin(np.linspace(0.0, 4.0 * np.pi, 80)))
    force = 10.0 * (0.5 * small_loop + 0.08) ** 2
    force += 0.1 * np.random.default_rng(seed).normal(size=80) + offset
    assert whole_loop.schedule is not None
    minor_loop = Loop("2", small_loop, force, whole_loop.schedule[:80], None, whole_loop.history)
    measured = loopset(replace(whole_loop, output=whole_loop.output + offset), minor_loop)
    assert not any("swapped" in text for text in inspect(measured).warnings)


def test_saturated_and_tared_magnets_are_not_reported_as_swapped() -> None:
    loop = magnet(noise=0.02)
    saturated = 100.0 * np.tanh(2.5 * np.sqrt(np.maximum(loop.output, 0.0) / 40.0)) ** 2
    assert not any("swapped" in text for text in inspect(changed(loop, loop.input, saturated)).warnings)
    tared = changed(loop, loop.input, loop.output - 12.0)
    assert not any("swapped" in text for text in inspect(tared).warnings)


def test_biased_magnet_follows_the_sign_of_its_current() -> None:
    loop = magnet(bipolar=True, width=0.05)
    force = 20.0 * loop.output / loop.output.max() * np.sign(loop.input) + 30.0
    found = inspect(changed(loop, loop.input, force))
    assert found.verdict.width < 0.3
    assert found.verdict.single_mean_relative < 0.05


def test_flux_that_falls_with_its_field_is_refused() -> None:
    loop = magnet(bipolar=True)
    flux = -np.tanh(loop.input)
    falling = Loops((Loop("1", loop.input, flux),), QUANTITIES["field"], QUANTITIES["flux_density"])
    with refused("flux-falls loop '1'"):
        inspect(falling)


def test_loop_that_would_win_energy_is_warned_of() -> None:
    loop = magnet()
    found = inspect(changed(loop, loop.input[::-1], loop.output[::-1]))
    assert any("the wrong direction" in text for text in found.warnings)


@pytest.mark.parametrize("seed", range(20))
def test_noise_of_a_loop_without_width_wins_no_energy(seed: int) -> None:
    loop = magnet(width=0.0)
    noise = 1.0 * np.random.default_rng(seed).normal(size=67)
    short_record = Loop(
        "1", loop.input[::15], loop.output[::15] + noise, np.full(67, 3e-4), None, loop.history
    )
    found = inspect(loopset(short_record))
    assert not any("the wrong direction" in text for text in found.warnings)


def test_offset_of_a_small_loop_to_both_sides_wins_no_energy() -> None:
    current = 0.2 * np.sin(np.linspace(np.pi, 3.0 * np.pi, 400))
    force = 100.0 * current**2
    small_loop = Loop("2", current + -0.01, force, np.full(400, 3e-4), None, History("settled"))
    found = inspect(loopset(magnet(bipolar=True), small_loop))
    assert not any("the wrong direction" in text for text in found.warnings)


def test_record_that_never_reverses_is_warned_of() -> None:
    rise = np.linspace(0.0, 2.0, 200)
    found = inspect(loopset(Loop("1", rise, rise**2, np.full(200, 3e-4))))
    assert any("never reverses" in text for text in found.warnings)
    assert found.loops[0].closure is None


def test_drift_is_warned_of() -> None:
    loop = magnet()
    drifting = loop.output + np.linspace(0.0, 2.0, loop.n)
    assert any("drifts by" in text for text in inspect(changed(loop, loop.input, drifting)).warnings)


def test_monotone_fit_is_the_best_one() -> None:
    rng = np.random.default_rng(2)
    values = np.cumsum(rng.normal(0.1, 1.0, 60))
    weights = rng.uniform(0.5, 2.0, 60)
    fit = fit_monotone(values, weights)
    assert np.all(np.diff(fit) >= 0.0)
    cost = np.sum(weights * (fit - values) ** 2)
    for _ in range(200):
        other = np.sort(fit + rng.normal(0.0, 0.3, 60))
        assert cost <= np.sum(weights * (other - values) ** 2)


def test_pictures_have_units_and_legends() -> None:
    loops = loopset(magnet(3e-4), magnet(6e-4))
    ax = loops.plot()
    assert ax.get_xlabel() == "current I [A]"
    assert ax.get_ylabel() == "force F [N]"
    legend = ax.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["gap 0.3 mm", "gap 0.6 mm"]
    figure = plot_inspection(inspect(loops), loops)
    assert isinstance(figure, Figure)
    assert loops.plot(figure.axes[0]) is figure.axes[0]
    figure.canvas.draw()


def test_a_steep_cycle_without_its_last_sample_comes_back_to_its_start() -> None:
    drive = 1.0 - np.abs(2.0 * np.arange(200) / 200 - 1.0)
    rising = np.arange(200) <= 100
    force = np.where(rising, drive**2, 0.45 * drive + 0.55 * drive**2) + 0.03
    assert propose_histories([Loop("1", drive, force)], is_even=True)[0][0].kind == "settled"


@pytest.mark.parametrize(("limit", "is_clipped"), [(60.0, True), (1e9, False)])
def test_clipped_output_is_named(limit: float, is_clipped: bool) -> None:
    current = 1.5 - 1.5 * np.cos(np.linspace(0.0, 4.0 * np.pi, 801))
    force = np.minimum(12.0 * current**2, limit)
    loop = Loop("1", current, force, None, None, History("settled"))
    warnings = inspect(Loops((loop,), QUANTITIES["current"], QUANTITIES["force"])).warnings
    assert any("the force is constant at 60 N" in text for text in warnings) == is_clipped


def test_record_without_hysteresis_is_judged(tmp_path: Path) -> None:
    """Repeated cycles without noise and without a loop have no scatter."""
    path = tmp_path / "line.csv"
    ramp = np.r_[np.linspace(0, 3, 60), np.linspace(3, 0, 60)[1:]]
    current = np.r_[ramp, ramp[1:]]
    rows = [f"{i / 100},{value:.6f},{20 * value:.6f},0.5" for i, value in enumerate(current)]
    path.write_text("\n".join(["t_s,I_A,F_N,gap_mm", *rows]) + "\n")
    assert inspect(read_loops(path)).verdict.level == "no"
