"""Test the virtual bench of a piezo stage: repeated triangles, and changes while it runs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray, rms
from anhyst.support.states import Command, Fault, State
from anhyst_rigs.rig.bench.piezo import PiezoBench
from anhyst_rigs.rig.bench.protocol import controller_status, describe_next_step, refusal_reason
from anhyst_rigs.rig.drift import drifted_file, sample_plant
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.piezo import follow_reference, make_reference
from tests.refusals import refused
from tests.study import piezos

SIGNALS = [signal.name for signal in PiezoBench.signals]
PERIOD = 1000
"""Ticks of a period of the triangle."""


def column(rows: FloatArray, name: str) -> FloatArray:
    values: FloatArray = rows[:, 1 + SIGNALS.index(name)]
    return values


def running(periods: int = 2) -> PiezoBench:
    """Return a bench in the middle of a period."""
    bench = piezos.bench()
    bench.command(Command.RUN)
    bench.advance(periods * PERIOD + PERIOD // 2)
    return bench


def is_like(rows: FloatArray, run: Recording) -> bool:
    names = ("reference_m", "position_m", "error_m", "voltage_V")
    return all(np.array_equal(column(rows, name.rpartition("_")[0]), run[name]) for name in names)


def test_the_first_periods_agree_with_a_simulation_bit_for_bit() -> None:
    run = follow_reference(piezos.rig(), make_reference(piezos.rig()), piezos.inverses()["full"])
    bench = piezos.bench()
    bench.command(Command.RUN)
    rows = bench.advance(len(run))
    assert is_like(rows, run)
    assert set(column(rows, "lap")) == {1.0, 2.0, 3.0, 4.0, 5.0, 6.0}


def test_a_drawn_plant_is_that_of_a_monte_carlo_bit_for_bit() -> None:
    rig = piezos.rig()
    drift, noise = sample_plant(rig.settings, rig.settings.seed, 1)
    plant = replace(rig, settings=drifted_file(rig.settings, drift))
    run = follow_reference(rig, make_reference(rig), piezos.inverses()["single-valued"], plant, noise)
    bench = piezos.bench()
    bench.advance(100)
    assert bench.apply({"plant": 2.0, "compensation": 0.0}) == 101
    bench.command(Command.RUN)
    assert is_like(bench.advance(len(run)), run)


def test_rows_do_not_depend_on_how_they_are_cut() -> None:
    benches = piezos.bench(), piezos.bench()
    parts = []
    for bench in benches:
        bench.command(Command.RUN)
        bench.demand(3e-6)
        bench.apply({"disturbance_stroke": 1e-7, "disturbance_frequency": 33.0})
        parts.append([bench.advance(1234)])
        bench.apply({"frequency": 7.7, "stroke": 1e-5, "compensation": 0.0})
    parts[0] += [benches[0].advance(count) for count in (1, 2, 333, 5, 1000, 2659)]
    parts[1].append(benches[1].advance(4000))
    assert np.array_equal(np.concatenate(parts[0]), np.concatenate(parts[1]))


@pytest.mark.parametrize("to", [0.0, 1.0])
def test_compensation_is_switched_at_a_period_start_without_a_bump(to: float) -> None:
    benches = running(), running()
    for bench in benches:
        if to == 1.0:
            bench.apply({"compensation": 0.0})
            bench.advance(2 * PERIOD)
    due = benches[0].apply({"compensation": to})
    before = benches[0].tick
    rows, same = (bench.advance(2 * PERIOD) for bench in benches)
    differs = np.flatnonzero(column(rows, "voltage") != column(same, "voltage"))
    assert due - before == PERIOD // 2 + 1
    assert rows[differs[0], 0] == due
    steps = np.abs(np.diff(column(rows, "voltage")))
    assert steps[differs[0] - 1] < 1.2 * np.abs(np.diff(column(same, "voltage"))).max()
    named = {parameter.name: parameter.value for parameter in benches[0].parameters()}
    assert named["compensation"] == to


def test_the_compensator_has_less_than_a_fifth_of_the_error_of_the_curve() -> None:
    bench = running()
    bench.advance(PERIOD // 2)
    on = column(bench.advance(2 * PERIOD), "error")
    bench.apply({"compensation": 0.0})
    bench.advance(3 * PERIOD)
    error = column(bench.advance(2 * PERIOD), "error")
    assert rms(on) < 0.2 * rms(error)


def test_a_bandwidth_change_causes_no_bump() -> None:
    benches = running(), running()
    benches[0].apply({"bandwidth": 80.0})
    rows, same = (bench.advance(PERIOD) for bench in benches)
    deviation = column(rows, "error") - column(same, "error")
    assert 1e-9 < np.abs(deviation).max() < 3e-8


def test_a_stop_holds_the_position_and_a_run_continues_from_it() -> None:
    bench = running()
    fastest = np.abs(np.diff(column(bench.advance(PERIOD), "reference"))).max()
    bench.advance(PERIOD // 4)
    bench.command(Command.STOP)
    rows = bench.advance(PERIOD)
    held = column(rows, "reference")[-1]
    assert np.abs(column(rows, "reference")[60:] - held).max() < 1e-18
    assert 5e-6 < held < 33e-6
    assert rms(column(rows, "error")[-200:]) < 5e-9
    bench.command(Command.RUN)
    rows = bench.advance(PERIOD)
    assert np.abs(np.diff(column(rows, "reference"))).max() < 1.001 * fastest
    assert np.abs(column(rows, "error")).max() < 1.5e-7
    assert set(column(rows, "state")) == {float(State.RUN)}


def test_a_place_is_demanded_with_rounded_corners_and_without_ringing() -> None:
    bench = piezos.bench()
    bench.advance(5000)
    bench.demand(20e-6)
    rows = bench.advance(3000)
    place = column(rows, "position")
    assert abs(place[-500:].mean() - 24e-6) < 2e-9
    assert place.max() < 24e-6 + 0.3e-6
    assert np.ptp(column(rows, "reference")[50:]) < 1e-15


def test_a_slow_disturbance_is_rejected_and_a_fast_one_is_not() -> None:
    left = []
    for frequency in (2.0, 150.0):
        bench = piezos.bench()
        bench.advance(5000)
        bench.apply({"disturbance_stroke": 1e-6, "disturbance_frequency": frequency})
        rows = bench.advance(10000)
        assert column(rows, "disturbance").max() == pytest.approx(1e-6)
        left.append(math.sqrt(2.0) * rms(column(rows, "error")[5000:]))
    assert left[0] < 0.05e-6
    assert 0.6e-6 < left[1] < 3e-6


def test_a_loop_that_is_lost_has_no_voltage_until_it_is_cleared() -> None:
    bench = running()
    bench.apply({"bandwidth": 500.0})
    rows = bench.advance(60 * PERIOD)
    assert np.array_equal(np.diff(rows[:, 0]), np.ones(len(rows) - 1))
    assert column(rows, "state")[-1] == State.FAULT
    assert column(rows, "fault")[-1] == Fault.POSITION_RANGE
    assert column(rows, "voltage")[-1] == 0.0
    with refused("wrong-state"):
        bench.apply({"bandwidth": 100.0})
    with refused("wrong-state run"):
        bench.command(Command.RUN)
    bench.command(Command.STOP)
    bench.command(Command.CLEAR)
    bench.apply({"bandwidth": 100.0})
    bench.command(Command.RUN)
    assert np.abs(column(bench.advance(3 * PERIOD), "error")[2 * PERIOD :]).max() < 1e-7


def test_impossible_values_are_refused_and_change_nothing() -> None:
    bench, other = running(), running()
    for wrong in ({"compensation": 0.5}, {"stroke": math.nan}, {"frequency": 1e6}, {"gain": 1.0}):
        code = "unknown-parameter" if "gain" in wrong else "out-of-range"
        with refused(code):
            bench.apply(wrong)
    for place in (math.nan, 1.0, -5e-6):
        with refused("out-of-range demand"):
            bench.demand(place)
    with refused("out-of-range"):
        bench.demand(15e-6)  # in addition to a triangle of 30 um
    bench.demand(5e-6)
    with refused("out-of-range"):
        bench.apply({"stroke": 36e-6})
    bench.demand(0.0)
    for command in (Command.RUN, Command.CLEAR, Command.LIFT):
        with refused(f"wrong-state {command.name.lower()}"):
            bench.command(command)
    with refused("option-not-for-this"):
        bench.load(1.0)
    assert np.array_equal(bench.advance(PERIOD), other.advance(PERIOD))


@pytest.mark.parametrize("state", [State.READY, State.RUN, State.FAULT])
def test_disabled_commands_are_refused_and_the_next_step_leads_to_run(state: State) -> None:
    bench = piezos.bench() if state is State.READY else running()
    if state is State.FAULT:
        bench.apply({"bandwidth": 500.0})
        bench.advance(60 * PERIOD)
    pressed: list[str] = []
    while (
        now := controller_status(dict(zip(SIGNALS, bench.advance(1)[0, 1:], strict=True)))
    ).state is not State.RUN:
        assert now.state is state or pressed
        for command in set(bench.commands) - {Command.STOP}:
            if refusal_reason(command, now):
                with refused("wrong-state"):
                    bench.command(command)
        name = describe_next_step(bench.commands, now).removeprefix("press ").split(",")[0]
        pressed.append(name)
        bench.command(Command[name.upper()])
    assert pressed == {State.READY: ["run"], State.RUN: [], State.FAULT: ["clear", "run"]}[state]


@pytest.mark.slow
def test_minutes_at_rest_and_thousands_of_periods_do_not_change_the_error() -> None:
    bench = running()
    bench.command(Command.STOP)
    rows = bench.advance(2_000_000)
    assert rms(column(rows, "error")[-10_000:]) < 3e-9
    bench.command(Command.RUN)
    bench.advance(2_000_000)
    rows = bench.advance(2 * PERIOD)
    assert rms(column(rows, "error")) < 3e-8
    assert column(rows, "lap")[-1] == pytest.approx(2005, abs=1)
