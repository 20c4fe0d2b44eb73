"""Settled loops of one run depend on the larger loops before them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anhyst.data.joining import add_earlier_loops
from anhyst.data.loops import Loop
from anhyst.data.path import SETTLED, History
from anhyst.model.actuator import Model
from anhyst.support.units import QUANTITIES
from tests.model.test_cells import CIRCUIT, NUMBERS

ENDS = ((0.0, 3.0), (0.0, 1.2), (0.8, 1.8))
NOISE = 2e-3


def loops(
    *, remembered: bool, law: str = "play-cells", gap: float | None = None, clock: float = 0.0
) -> list[Loop]:
    """Return a larger loop and two loops within it, in an iron with or without return-point memory."""
    model = Model("iron", QUANTITIES["current"], QUANTITIES["force"], NUMBERS | CIRCUIT, law=law)
    found: list[Loop] = []
    before: list[float] = []
    rng = np.random.default_rng(3)
    for lowest, high in ENDS:
        drive = np.concatenate([np.linspace(lowest, high, 80), np.linspace(high, lowest, 80)[1:]])
        past = History("settled", tuple(before)) if remembered else SETTLED
        force = model.predict(drive, history=past).output
        force = force + NOISE * np.ptp(force) * rng.standard_normal(force.size)
        time = np.array([clock + 0.01 * place for place in range(drive.size)])
        at = None if gap is None else np.full(drive.size, gap)
        found.append(Loop(f"to {high:g}", drive, force, at, time))
        before += [lowest, high, lowest]
        clock = float(time[-1]) + 5.0
    return found


def test_a_loop_on_the_branch_of_a_larger_one_continues_its_history() -> None:
    first, second, third = add_earlier_loops(loops(remembered=True))
    assert first.history == SETTLED
    assert second.history == History("settled", (0.0, 3.0, 0.0))
    assert third.history.turning_points == (0.0, 3.0, 0.0, 0.0, 1.2, 0.0)


def test_loops_at_another_gap_are_part_of_the_history() -> None:
    near_gap = loops(remembered=True, gap=3e-4)
    far_gap = loops(remembered=True, gap=4e-4, clock=100.0)
    separate, together = (
        add_earlier_loops([*near_gap, *far_gap], across_gaps=over) for over in (False, True)
    )
    assert [one.history for one in separate[3:]] == [one.history for one in separate[:3]]
    assert [one.history for one in together[:3]] == [one.history for one in separate[:3]]
    first, second = (one.history for one in together[3:5])
    assert first.turning_points == (0.0, 3.0, 0.0, 0.0, 1.2, 0.0, 0.8, 1.8, 0.8)
    assert first.schedule == (3e-4,) * 9
    assert second.schedule == (3e-4,) * 9 + (None,) * 3
    assert History.parse(str(second)) == second


def test_a_loop_off_the_branch_of_a_larger_one_has_its_own_history() -> None:
    alone = loops(remembered=False)
    assert add_earlier_loops(alone) == alone


@pytest.mark.parametrize("change", ["no clock", "overlapping clocks", "stated", "smaller first"])
def test_without_a_clear_order_no_earlier_loops_are_assumed(change: str) -> None:
    measured = loops(remembered=True)
    if change == "no clock":
        measured = [replace(loop, time=None) for loop in measured]
    elif change == "overlapping clocks":
        measured = [replace(one, time=np.linspace(0.0, 1.0, one.n)) for one in measured]
    elif change == "stated":
        measured[1] = replace(measured[1], history=History("conditioned", (0.0, 3.0, 0.0)))
    else:
        times = [loop.time for loop in measured]
        measured = [replace(one, time=at) for one, at in zip(measured, reversed(times), strict=True)]
    assert add_earlier_loops(measured) == measured


def test_earlier_loops_matter_only_for_iron_with_return_point_memory() -> None:
    drive = np.concatenate([np.linspace(0.0, 1.2, 60), np.linspace(1.2, 0.0, 60)])
    inside = History("settled", (0.0, 3.0, 0.0))
    numbers = {"play-cells": NUMBERS, "effective-field": {"M_s": 4e5, "a": 40.0, "k": 20.0, "c": 0.2}}
    apart = {}
    for law, iron in numbers.items():
        quantities = QUANTITIES["current"], QUANTITIES["force"]
        model = Model("iron", *quantities, iron | CIRCUIT, law=law)
        one, other = (model.predict(drive, history=past).output for past in (SETTLED, inside))
        apart[law] = float(np.max(np.abs(one - other)) / np.ptp(one))
    assert apart["play-cells"] > 0.01
    assert apart["effective-field"] == 0.0
