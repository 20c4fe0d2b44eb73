"""Test the position controller: lift-off, levitation, landing, and a lost position."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from anhyst.support.kinds import NumberFormat
from anhyst.support.states import Command, Fault, Flag, Phase, State
from tests.control.levitating import (
    CONTROL,
    FORMATS,
    LOAD,
    PAIR,
    RATE,
    REST,
    TARGET,
    Rig,
    Tick,
    make,
    path,
    place,
)

LEVITATING = (Phase.RISE, Phase.HOVER, Phase.DESCEND)
each_format = pytest.mark.parametrize("number_format", FORMATS)


@each_format
def test_lifts_hovers_steps_and_lands(number_format: NumberFormat) -> None:
    rig = Rig(make(number_format))
    rows = rig.hover()
    assert path(rows) == [
        (State.SELFTEST, Phase.REST),
        (State.IDLE, Phase.REST),
        (State.READY, Phase.REST),
        (State.RUN, Phase.BREAKAWAY),
        (State.RUN, Phase.RISE),
        (State.RUN, Phase.HOVER),
    ]
    assert rig.gap == pytest.approx(TARGET, abs=20e-9)
    step = rig.run(4000, TARGET - 20e-6)
    assert path(step) == [(State.RUN, Phase.HOVER)]
    assert step[0][2] == pytest.approx(TARGET - 20e-6, abs=1e-10)
    assert rig.gap == pytest.approx(TARGET - 20e-6, abs=20e-9)
    landing = rig.run(8000, TARGET - 20e-6, Command.LAND)
    assert path(landing) == [
        (State.RUN, Phase.DESCEND),
        (State.RUN, Phase.SET_DOWN),
        (State.READY, Phase.REST),
    ]
    assert rig.gap == REST
    assert landing[-1][:2] == (0.0, 0.0)
    assert not any(row[5] for row in rows + step + landing)


@each_format
def test_ramps_keep_their_rates(number_format: NumberFormat) -> None:
    rig = Rig(make(number_format))
    rows = rig.hover() + rig.run(8000, command=Command.LAND)
    for phase, column, rate in (
        (Phase.BREAKAWAY, 3, 1000.0),
        (Phase.SET_DOWN, 3, -1000.0),
        (Phase.RISE, 2, -2e-3),
        (Phase.DESCEND, 2, 2e-3),
    ):
        values = np.array([row[column] for row in rows if place(row)[1] == phase])
        # The last step of a ramp is shorter, because it ends at its target.
        assert np.diff(values)[1:-1] == pytest.approx(rate / RATE, rel=1e-3)
        assert len(values) > 400


def at(rows: list[Tick], phase: Phase) -> int:
    return next(i for i, row in enumerate(rows) if place(row)[1] == phase)


@each_format
def test_control_begins_with_the_force_of_the_breakaway(number_format: NumberFormat) -> None:
    rows = Rig(make(number_format)).hover()
    first = at(rows, Phase.RISE)
    before, after = rows[first - 1][3], rows[first][3]
    assert before > LOAD
    if number_format == "fixed":
        # PIDD2 adds in q28: the transferred value is truncated to a multiple of 8 codes.
        assert round(after / 300.0 * 2**31) == round(before / 300.0 * 2**31) // 8 * 8
    else:
        assert after == pytest.approx(before, rel=1e-12 if number_format == "f64" else 3e-7)


@each_format
def test_a_dropped_sample_is_bridged(number_format: NumberFormat) -> None:
    rig = Rig(make(number_format))
    rig.hover()
    steady = rig.tick()
    rig.hidden = lambda _: math.nan
    missing = rig.run(3)
    rig.hidden = lambda gap: gap
    after = rig.run(2000)
    assert path(missing + after) == [(State.RUN, Phase.HOVER)]
    assert [row[5] for row in missing] == [Flag.SAMPLE_IMPLAUSIBLE] * 3
    assert missing[-1][3] == pytest.approx(steady[3], abs=0.1)
    assert not any(row[5] for row in after)
    assert rig.gap == pytest.approx(TARGET, abs=20e-9)


@each_format
def test_a_lost_position_reduces_the_force_in_two_stages(number_format: NumberFormat) -> None:
    rig = Rig(make(number_format))
    last = rig.hover()[-1]
    rig.hidden = lambda _: math.nan
    rows = rig.run(3 + 201 + 2000)
    assert path(rows) == [(State.RUN, Phase.HOVER), (State.FAULT, Phase.FALL), (State.FAULT, Phase.REST)]
    assert rig.controller.fault == Fault.POSITION_MISSING
    falls = [row for row in rows if place(row)[1] == Phase.FALL]
    assert len(falls) == 200
    assert rows[2][0] == pytest.approx(last[0], abs=5e-3)
    step = CONTROL.converter.step
    assert rows[3][0] == pytest.approx(0.875 * rows[2][0] - 45.0 / RATE, abs=2 * step)
    falling = np.diff([row[0] for row in rows[3:]])
    assert np.all(falling <= 0.0)
    assert np.min(falling) == pytest.approx(-45.0 / RATE, abs=step)
    assert rows[-1][0] == 0.0
    rig.hidden = lambda gap: gap
    assert rig.run(1, command=Command.LIFT)[0][5] & Flag.COMMAND_REFUSED
    cleared = rig.run(30, command=Command.CLEAR)
    assert path(cleared) == [(State.SELFTEST, Phase.REST), (State.IDLE, Phase.REST)]
    assert rig.controller.fault == Fault.NONE


@each_format
def test_position_that_comes_back_lands(number_format: NumberFormat) -> None:
    rig = Rig(make(number_format))
    rig.hover()
    rig.hidden = lambda _: math.nan
    lost = rig.run(12)
    rig.hidden = lambda gap: gap
    rows = rig.run(8000)
    assert path(lost + rows) == [
        (State.RUN, Phase.HOVER),
        (State.FAULT, Phase.FALL),
        (State.FAULT, Phase.DESCEND),
        (State.FAULT, Phase.SET_DOWN),
        (State.FAULT, Phase.REST),
    ]
    assert rows[0][3] == pytest.approx(lost[-1][3], rel=1e-6)
    assert rig.gap == REST
    assert rows[-1][0] == 0.0


@each_format
@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (0.575e-3, Fault.POSITION_RANGE),
        (0.325e-3, Fault.POSITION_RANGE),
        (5.0, Fault.POSITION_RANGE),
        (-math.inf, Fault.POSITION_RANGE),
        (0.345e-3, Fault.POSITION_STEP),
    ],
)
def test_impossible_positions_are_rejected(number_format: NumberFormat, wrong: float, reason: Fault) -> None:
    rig = Rig(make(number_format))
    rig.hover()
    rig.hidden = lambda _: wrong
    rows = rig.run(4)
    # Infinity is not a number in floating point, and is the end of the range in fixed point.
    reasons = {reason, Fault.POSITION_MISSING} if math.isinf(wrong) else {reason}
    assert [place(row)[0] for row in rows] == [State.RUN] * 3 + [State.FAULT]
    assert rig.controller.fault in reasons
    assert all(abs(row[3] - LOAD) < 1.0 for row in rows)


@each_format
def test_a_moving_armature_may_have_moved_while_unseen(number_format: NumberFormat) -> None:
    """Each missing sample allows one more step of the position."""
    rig = Rig(make(number_format))
    rig.hover()
    unseen = iter([math.nan, math.nan, TARGET + 55e-6])
    rig.hidden = lambda _: next(unseen)
    assert [row[5] for row in rig.run(3)][-1] == 0
    unseen = iter([math.nan, math.nan, TARGET - 10e-6])
    assert rig.run(3)[-1][5] & Flag.SAMPLE_IMPLAUSIBLE


@each_format
def test_too_heavy_a_load_is_given_up(number_format: NumberFormat) -> None:
    rig = Rig(make(number_format), load=310.0)
    rig.run(30)
    rig.run(10, command=Command.DEMAGNETISED)
    rows = rig.run(13000, command=Command.LIFT)
    assert path(rows) == [
        (State.RUN, Phase.BREAKAWAY),
        (State.FAULT, Phase.SET_DOWN),
        (State.FAULT, Phase.REST),
    ]
    assert rig.controller.fault == Fault.NO_LIFT
    assert max(row[3] for row in rows) == pytest.approx(300.0, rel=1e-6)
    assert rows[-1][0] == 0.0


@each_format
def test_stop_lands_and_stays_in_fault(number_format: NumberFormat) -> None:
    rig = Rig(make(number_format))
    rig.hover()
    rows = rig.run(8000, command=Command.STOP)
    assert path(rows)[0] == (State.FAULT, Phase.DESCEND)
    assert path(rows)[-1] == (State.FAULT, Phase.REST)
    assert rig.controller.fault == Fault.STOPPED
    assert rig.gap == REST


def test_land_in_breakaway_sets_down() -> None:
    rig = Rig(make("fixed"))
    rig.run(30)
    rig.run(10, command=Command.DEMAGNETISED)
    rig.run(1000, command=Command.LIFT)
    rows = rig.run(1200, command=Command.LAND)
    assert path(rows) == [(State.RUN, Phase.SET_DOWN), (State.READY, Phase.REST)]
    assert rig.gap == REST


def test_position_lost_in_breakaway_sets_down() -> None:
    rig = Rig(make("fixed"))
    rig.run(30)
    rig.run(10, command=Command.DEMAGNETISED)
    rig.run(1000, command=Command.LIFT)
    rig.hidden = lambda _: math.nan
    rows = rig.run(1200)
    assert path(rows) == [
        (State.RUN, Phase.BREAKAWAY),
        (State.FAULT, Phase.SET_DOWN),
        (State.FAULT, Phase.REST),
    ]


IN_THE_AIR = {
    "breakaway": (2500, Command.NONE),
    "set down": (2500, Command.LAND),
    "hover": (9000, Command.NONE),
    "stopped": (9000, Command.STOP),
}


@pytest.mark.first(1)
@pytest.mark.parametrize(("ticks", "begin"), IN_THE_AIR.values(), ids=IN_THE_AIR.keys())
def test_no_pair_of_commands_lets_the_current_jump(ticks: int, begin: Command) -> None:
    """No two commands within a few ticks can bypass a ramp of the current.

    There is no sensor noise here, so that the controller itself changes the current only slightly.
    """
    start = Rig(make("fixed"))
    start.run(30)
    start.run(10, command=Command.DEMAGNETISED)
    start.run(ticks, command=Command.LIFT)
    carried = start.run(5, command=begin)[-1][0]
    assert carried > 1.0
    for first in Command:
        for second in Command:
            rig = Rig(make("fixed"))
            rig.run(30)
            rig.run(10, command=Command.DEMAGNETISED)
            rig.run(ticks, command=Command.LIFT)
            rows = rig.run(5, command=begin)
            rows += rig.run(7, command=first)
            rows += rig.run(60, command=second)
            steps = np.abs(np.diff([row[0] for row in rows]))
            assert steps.max() < 0.01 * carried, (first, second)
            assert rows[-1][0] > 0.8 * carried, (first, second)


def test_commands_out_of_place_are_refused() -> None:
    rig = Rig(make("fixed"))
    resting = {Command.CONDITION, Command.DEMAGNETISED, Command.IDLE}
    for way, state, allowed in (
        ([], State.SELFTEST, set[Command]()),
        (rig_runs(30), State.IDLE, resting | {Command.ARM}),
        ([Command.DEMAGNETISED, *rig_runs(9)], State.READY, resting | {Command.LIFT}),
        ([Command.LIFT, *rig_runs(9000)], State.RUN, {Command.LAND, Command.STOP}),
        ([Command.STOP, *rig_runs(8000)], State.FAULT, {Command.CLEAR}),
    ):
        for command in way:
            rig.tick(command=command)
        for wrong in set(Command) - {Command.NONE} - allowed:
            answer = rig.tick(command=wrong)
            assert answer[5] == Flag.COMMAND_REFUSED
            assert place(answer)[0] == state
        assert rig.tick(command=99)[5] == Flag.COMMAND_REFUSED
        assert rig.tick()[5] == 0


def rig_runs(ticks: int) -> list[Command]:
    return [Command.NONE] * ticks


@each_format
def test_currents_are_codes_of_the_converter(number_format: NumberFormat) -> None:
    coarse = replace(CONTROL, converter=replace(CONTROL.converter, low=-0.1, high=4.9, bits=12))
    rows = Rig(make(number_format, coarse)).hover()
    steps = np.array([(row[0] + 0.1) / coarse.converter.step for row in rows])
    assert np.max(np.abs(steps - np.round(steps))) < (1e-3 if number_format == "f32" else 1e-5)
    assert len(set(np.round(steps))) > 500
    assert min(row[0] for row in rows) >= 0.0


@each_format
def test_a_pair_divides_the_force_around_its_bias(number_format: NumberFormat) -> None:
    rig = Rig(make(number_format, PAIR), load=40.0, gap_total=0.9e-3)
    rig.hover()
    above = rig.run(2000)[-1]
    assert rig.gap == pytest.approx(TARGET, abs=30e-9)
    # A load in the opposite direction swaps the roles of the magnets.
    rig.load = -40.0
    below = rig.run(4000)[-1]
    assert rig.gap == pytest.approx(TARGET, abs=30e-9)
    assert above[:2] == pytest.approx(below[1::-1], abs=2e-3)
    assert above[0] > below[0] > 1.0
    pulls = [150.0 * (row[0] / 2.25) ** 2 for row in (above, below)]
    assert pulls == pytest.approx([95.0, 55.0], abs=0.3)


def saturate(measured: float | None) -> float:
    """Hold the armature below its reference until the current is at its limit; return the demand.

    `measured`: real current, if the controller uses it.
    """
    control = replace(
        CONTROL, uses_measured_currents=measured is not None, limits=replace(CONTROL.limits, current_high=2.9)
    )
    rig = Rig(make("f64", control))
    rig.hover()
    shown = 0.0 if measured is None else measured
    for _ in range(3000):
        answer = rig.controller.tick(TARGET, TARGET - 10e-6, current=(shown, 0.0))
    assert answer[0] == pytest.approx(2.9, abs=1e-4)
    assert answer[5] & Flag.CURRENT_LIMITED
    return answer[3]


def test_integral_follows_the_current_that_was_applied() -> None:
    driven, same, less = saturate(None), saturate(2.9), saturate(2.8)
    limit = 150.0 * (2.9 / 2.25) ** 2
    # At rest, the contribution of the error per tick equals the anti-windup: K_p e above the limit.
    above = CONTROL.pidd2.K_p * 10e-6
    assert driven == pytest.approx(limit + above, rel=1e-3)
    assert same == pytest.approx(driven, rel=1e-4)
    assert less == pytest.approx(limit * (2.8 / 2.9) ** 2 + above, rel=1e-3)


def test_formats_agree_in_the_air() -> None:
    runs = {}
    for number_format in FORMATS:
        rig = Rig(make(number_format))
        rig.hover()
        gaps = []
        for _ in range(2000):
            rig.tick(TARGET - 20e-6)
            gaps.append(rig.gap)
        runs[number_format] = np.array(gaps)
    assert np.ptp(runs["f64"]) > 20e-6
    assert np.max(np.abs(runs["f32"] - runs["f64"])) < 5e-9
    # Gains are rounded to 2e-5 and the map has 16 bits.
    assert np.max(np.abs(runs["fixed"] - runs["f64"])) < 50e-9


@each_format
def test_load_is_fed_forward(number_format: NumberFormat) -> None:
    rig = Rig(make(number_format))
    rig.hover()
    before = rig.tick(feed=0.0)[3]
    assert rig.tick(feed=20.0)[3] - before == pytest.approx(20.0, rel=2e-3)
    # NaN adds no feedforward and has no later effect.
    assert rig.tick(feed=math.nan)[3] == pytest.approx(before, abs=0.5)
