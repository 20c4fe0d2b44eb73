"""Test a piezo stage from its file: its own response, and its compensator."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst._core import PiezoLoop
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.piezo import controller_arguments, copy_at_rest, read_piezo_rig
from anhyst_rigs.study.piezo import (
    first_evaluated_tick,
    follow_reference,
    make_reference,
    measure_stage_loops,
)
from tests.refusals import refused
from tests.study import piezos


@pytest.mark.parametrize("resonance", [480.0, 3000.0])
def test_a_stage_rings_at_its_resonance_however_high(resonance: float) -> None:
    changes = {"flexure.resonance_Hz": resonance, "flexure.damping_ratio": 0.01}
    rig = replace(piezos.rig(), settings=piezos.rig().settings.with_changes(changes))
    dt = 1e-5
    place = rig.make_motion(dt).run(np.full(4000, 20.0))
    late = place[2000:] - np.convolve(place, np.ones(200) / 200, "same")[2000:]
    crossings = np.flatnonzero((late[:-1] < 0.0) & (late[1:] >= 0.0))[1:-1]
    parts = crossings - late[crossings] / (late[crossings + 1] - late[crossings])
    period = (parts[-1] - parts[0]) / (len(parts) - 1) * dt
    assert 1.0 / period == pytest.approx(resonance, rel=3e-3)


def still(load: float, ticks: int = 4000) -> FloatArray:
    """Return the positions of a stage that its controller holds at 20 um under a load."""
    rig, drive = piezos.rig(), copy_at_rest(piezos.inverses()["full"])
    loop = PiezoLoop(rig.make_motion(rig.dt), rig.settings.position_sensor.step_m)
    loop.control(drive.native, **controller_arguments(rig, drive))
    wanted, none = np.full(ticks, 20e-6), np.zeros(ticks)
    loop.run(wanted, wanted, none, none)
    places: FloatArray = loop.run(wanted, wanted, none, none + load)[:, 0]
    return places


def test_a_load_displaces_the_stage_until_the_integrator_corrects_it() -> None:
    deviation = still(1e-6) - still(0.0)
    overshoot = deviation.max() / 1e-6
    assert deviation[0] == 0.0
    assert 1.5 < overshoot < 1.95  # a step on a weakly damped resonance
    assert abs(deviation[-100:].mean()) < 3e-9


def test_a_loop_without_a_controller_does_not_run() -> None:
    rig, none = piezos.rig(), np.zeros(3)
    loop = PiezoLoop(rig.make_motion(rig.dt), rig.settings.position_sensor.step_m)
    with pytest.raises(ValueError, match="no controller is in force"):
        loop.run(none, none, none, none)


def test_a_compensator_that_follows_a_voltage_knows_the_stack_as_one_that_drove_it() -> None:
    drove, followed = (copy_at_rest(piezos.inverses()["full"]) for _ in range(2))
    way = np.concatenate([np.linspace(5e-6, 3e-5, 500), np.linspace(3e-5, 1e-5, 400)])
    voltages = drove.run(way)
    expected = followed.follow(voltages, np.zeros(way.size))
    assert np.abs(expected - way).max() < 2e-9
    assert followed.solve(2e-5) == pytest.approx(drove.solve(2e-5), abs=1e-3)
    assert abs(followed.solve(2e-5) - copy_at_rest(drove).solve(2e-5)) > 0.5  # without a history


@pytest.mark.parametrize(
    ("code", "was", "now"),
    [
        ("too-many-creeps stack[1]", "[0.15, 1.2, 11.0, 90.0]", str([1.0] * 9)),
        ("greater-than-equal stack[1].creep_times_s[1]", "[0.15,", "[1e-6,"),
        ("greater-than-equal case[1].cycles", "cycles = 6", "cycles = 2"),  # no cycle would be evaluated
        ("too-long case[1]", "corner_s = 4.2e-3", "corner_s = 0.06"),
        ("out-of-range case[1].frequency_Hz", "rate_Hz = 10000.0", "rate_Hz = 100.0"),
        ("less-than-equal body[1].resonance_Hz", "resonance_Hz = 480.0", "resonance_Hz = 9e9"),
        ("less-than-equal body[1].damping_ratio", "damping_ratio = 0.03", "damping_ratio = 20.0"),
        ("greater-than amplifier[1].high_V", "high_V = 150.0", "high_V = 0.0"),
    ],
)
def test_references_that_cannot_be_followed_or_evaluated_are_refused(
    code: str, was: str, now: str, tmp_path: Path
) -> None:
    text = (piezos.EXAMPLE / "rig.toml").read_text(encoding="utf-8")
    if "creeps" in code:
        text = text.replace("[0.007, 0.006, 0.006, 0.008]", str([0.001] * 9))
    assert was in text
    (tmp_path / "rig.toml").write_text(text.replace(was, now), encoding="utf-8")
    with refused(code):
        read_piezo_rig(tmp_path / "rig.toml")


def test_a_stack_that_runs_away_is_named() -> None:
    settings = piezos.rig().settings.with_changes({"stack.beta_per_V": 1e6})
    with refused("stack-leaves-all-bounds stack[1]"):
        measure_stage_loops(replace(piezos.rig(), settings=settings))


def test_a_position_that_no_converter_rounds_is_read_as_it_is() -> None:
    settings = piezos.rig().settings.with_changes({"position_sensor.step_m": 0.0})
    rig = replace(piezos.rig(), settings=settings)
    run = follow_reference(rig, make_reference(rig), piezos.inverses()["full"])
    assert not run.loss_text
    assert rms(run["error_m"][first_evaluated_tick(rig) :]) < 3e-8
