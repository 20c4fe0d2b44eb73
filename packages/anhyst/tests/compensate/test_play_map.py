"""Test the map with one play: oracle, loop width, state and formats."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from anhyst.compensate.current_map import (
    PlayMap,
    fit_play_map,
    fit_radius,
    fit_single_valued_map,
    limit_slope,
    predict_forces,
)
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.sources import Sources
from anhyst.data.surface import fit_surface
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray
from tests.actuators import GAPS
from tests.compensate.test_methods import POINT, RANGE, WIDTH, around, known, roots

LAST = 2.0**-15
"""Last digit of a table entry, relative to full scale."""


class Oracle:
    """The law with tables by numpy and the commit by bisection of the force."""

    def __init__(self, play: PlayMap) -> None:
        self.play, self.b = play, 0.0

    def at(self, table: FloatArray, force: float, gap: float) -> float:
        scales = self.play.scales
        force_steps = np.linspace(0.0, scales.demand, table.shape[1])
        place = (gap - scales.gap_low) / (scales.gap_high - scales.gap_low) * (table.shape[0] - 1)
        place = min(max(place, 0.0), table.shape[0] - 1.0)
        first = min(int(place), table.shape[0] - 2)
        row = table[first] + (place - first) * (table[first + 1] - table[first])
        return float(np.interp(force, force_steps, row))

    def solve(self, force: float, gap: float) -> float:
        i = self.at(self.play.map.entries, force, gap)
        share = float(np.clip((i - self.b) / self.play.radius, -1.0, 1.0))
        return i + self.at(self.play.half_width, force, gap) * share

    def commit(self, current: float, gap: float) -> float:
        low, high = 0.0, self.play.scales.demand
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.solve(middle, gap) <= current else (low, middle)
        i = self.at(self.play.map.entries, low, gap)
        self.b = float(np.clip(self.b, i - self.play.radius, i + self.play.radius))
        return low


@cache
def fitted() -> PlayMap:
    return fit_play_map(Sources(POINT, known()[0]), "f64")


def controller(number_format: NumberFormat, play: PlayMap | None = None) -> ForceController:
    return ForceController("play", number_format, play or fitted())


def walk(ticks: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return demands, gaps, and deviations of the amplifier: small, and occasionally large."""
    rng = np.random.default_rng(5)
    place = np.arange(ticks)
    force = 45.0 + 44.0 * np.sin(0.031 * place) * np.sin(0.0071 * place)
    force += rng.standard_normal(ticks)
    gap = POINT.gap + 0.08e-3 * np.sin(0.013 * place)
    off = np.where(place % 9 == 0, 0.2, 2e-4) * rng.standard_normal(ticks)
    return force, gap, off


@pytest.mark.first(2)
@pytest.mark.parametrize(("number_format", "bound"), [("f64", 1e-9), ("f32", 2e-6), ("fixed", 1.5 * LAST)])
def test_every_format_is_the_law_as_it_is_written(number_format: NumberFormat, bound: float) -> None:
    """Currents and expected forces agree for hundreds of ticks without a reset."""
    drive, oracle, scales = controller(number_format), Oracle(fitted()), fitted().scales
    for force, gap, off in zip(*(row.tolist() for row in walk(200)), strict=True):
        wanted = drive.solve(force, gap)
        assert wanted == pytest.approx(
            min(oracle.solve(force, gap), POINT.current_max), rel=0.0, abs=bound * scales.current
        )
        applied = min(max(wanted + off, 0.0), POINT.current_max)
        expected = drive.commit(applied, gap)
        right = oracle.commit(applied, gap)
        # Where the map is flat, the force depends strongly on the current, so currents are
        # compared.
        assert expected == pytest.approx(right, rel=0.0, abs=40.0 * bound * scales.demand)


def test_without_width_it_is_the_single_valued_map_bit_for_bit() -> None:
    flat = replace(fitted(), half_width=np.zeros_like(fitted().half_width))
    map_alone = fit_single_valued_map(Sources(POINT, known()[0]), "f64")
    formats: tuple[NumberFormat, ...] = ("f64", "f32", "fixed")
    for number_format in formats:
        with_play = controller(number_format, replace(flat, map=map_alone))
        without = ForceController("single-valued", number_format, map_alone)
        for force, gap, off in zip(*(row.tolist() for row in walk(300)), strict=True):
            current = with_play.solve(force, gap)
            assert current == without.solve(force, gap)
            with_play.commit(current + off, gap)


def test_the_loop_has_the_measured_width() -> None:
    """In a cycle over all forces, both branches are half the width from the middle."""
    play = fit_play_map(Sources(POINT, around(roots)), "f64")
    drive = controller("fixed", play)
    gap = 0.4e-3
    up = np.linspace(0.0, 95.0, 400)
    for force in (*up.tolist(), *up[::-1].tolist()):
        drive.commit(drive.solve(force, gap), gap)
    branches: list[list[float]] = []
    for ramp in (up, up[::-1]):
        branches.append([])
        for force in ramp.tolist():
            branches[-1].append(drive.solve(force, gap))
            drive.commit(branches[-1][-1], gap)
    width = np.array(branches[0]) - np.array(branches[1])[::-1]
    middle = (up > 30.0) & (up < 70.0)  # a radius away from the reversal
    assert np.abs(width[middle] - WIDTH).max() < 0.01 * WIDTH
    i = np.array(branches[0])[middle] - 0.5 * WIDTH
    assert np.abs(i - roots(up[middle], gap)).max() < 0.01 * WIDTH


def test_any_two_states_are_one_after_the_current_has_moved_by_two_radii() -> None:
    drives = [controller("fixed") for _ in range(3)]
    gap, radius = POINT.gap, fitted().radius
    for drive, first in zip(drives, (2.0, 0.0, 0.6), strict=True):
        drive.commit(first, gap)
    assert len({drive.solve(50.0, gap) for drive in drives}) > 1
    forces = [20.0, 70.0]
    i = [
        controller("f64", replace(fitted(), half_width=0.0 * fitted().half_width)).solve(f, gap)
        for f in forces
    ]
    assert i[1] - i[0] > 2.0 * radius
    for force in (*forces, 45.0):
        for drive in drives:
            drive.commit(drive.solve(force, gap), gap)
    assert len({drive.solve(50.0, gap) for drive in drives}) == 1


def test_solve_keeps_the_play_and_a_small_cycle_closes() -> None:
    drive = controller("f64")
    gap = POINT.gap
    for force in (0.0, 80.0, 40.0):
        drive.commit(drive.solve(force, gap), gap)
    before = drive.solve(50.0, gap)
    for force in (0.0, 90.0, 10.0):
        drive.solve(force, gap)
    assert drive.solve(50.0, gap) == before
    rounds = []
    for _ in range(3):
        for force in (40.0, 44.0):
            rounds.append(drive.solve(force, gap))
            drive.commit(rounds[-1], gap)
    assert rounds[2:4] == rounds[4:6]


def test_the_half_width_of_the_loops_is_found_and_no_branch_falls() -> None:
    half = fit_play_map(Sources(POINT, around(roots)), "f64").half_width
    inside = slice(20, -20)
    assert np.abs(half[:, inside] - 0.5 * WIDTH).max() < 0.01 * WIDTH
    entries = fitted().map.entries
    for side in (-1.0, 1.0):
        assert np.diff(entries + side * fitted().half_width).min() >= 0.0
    steep = limit_slope(np.array([[5.0, 0.0, 9.0]]), np.array([[1.0, 2.0]]))
    assert steep.tolist() == [[1.0, 0.0, 2.0]]


def test_the_radius_is_the_best_of_all_that_minor_cycles_show() -> None:
    """With another radius, the force error of the records is larger."""
    loops = known()[0]
    surface = fit_surface(loops, (0.0, fitted().scales.demand), (GAPS[0], GAPS[-1]))
    assert fit_radius(surface, loops, POINT) == pytest.approx(fitted().radius)
    inside = [loop for loop in loops.loops if RANGE[0] <= (loop.schedule_value or 0.0) <= RANGE[1]]

    def off(radius: float) -> float:
        play = replace(fitted(), radius=radius)
        errors = np.concatenate([predict_forces(play, one) - one.output for one in inside])
        measured = np.concatenate([one.output for one in inside])
        return float(np.sqrt(np.mean(errors[measured <= POINT.force_max] ** 2)))

    best = off(fitted().radius)
    assert best < 0.95 * off(3.0 * fitted().radius)
    assert best < 0.95 * off(fitted().radius / 5.0)
