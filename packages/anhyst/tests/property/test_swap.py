"""Test block swaps: the current changes by at most the difference of the two models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst.compensate.block import Block, DemandLimits, TableSizes
from anhyst.compensate.builder import build_block
from anhyst.model.actuator import Model
from anhyst.model.parameters import GapMap
from anhyst.support.numeric import FloatArray
from tests.actuators import GAPS, SIZES, closed_form, largest_force, magnet, ranges, reversals, triangles
from tests.swaps import current_jump_at_swap, largest_current_difference

MAPS = st.sampled_from(["reluctance", "circuit"])
"""With ``circuit`` the flux coefficient is negative."""

FULL_SIZES = TableSizes(iterations=10)
ACCURACY = 3e-4
"""Tolerance relative to full scale: formats, tables and searches of both blocks."""

PLAY = 20.0
REACHES = st.floats(0.75, 1.0)
FACTORS = st.tuples(*[st.floats(0.9, 1.1)] * 5)
SEEDS = st.integers(0, 10**6)
PLACES = st.floats(GAPS[0], GAPS[-1])


def highest(gap_map: GapMap) -> float:
    return 0.75 * largest_force(gap_map, PLAY, GAPS[-1])


def path(gap_map: GapMap, seed: int) -> FloatArray:
    high = highest(gap_map)
    return reversals(0.04 * high, high, 4 + seed % 24, seed)


def cycle(gap_map: GapMap) -> FloatArray:
    high = highest(gap_map)
    return triangles(0.04 * high, high, 100, 1)


def block_of(gap_map: GapMap, model: Model, reach: float) -> Block:
    """Return a block for the magnet's signals with current limits reduced by a factor."""
    scales, limits = ranges(gap_map, PLAY)
    low, high = limits.current
    narrow = DemandLimits(limits.demand, (reach * low, reach * high))
    return build_block(model, "full", scales, narrow, FULL_SIZES)


def drives(model: Model, demand: FloatArray, gap: float) -> FloatArray:
    """Return the currents of the law in double precision, from the demagnetised state."""
    answer = model.invert(demand, np.full(demand.size, gap), history="demagnetised")
    return np.asarray(answer.drive)


@settings(max_examples=40)
@given(MAPS, REACHES, SEEDS, PLACES)
def test_a_swap_of_limits_alone_causes_no_step(gap_map: GapMap, reach: float, seed: int, gap: float) -> None:
    model = magnet(gap_map, PLAY)
    here, there = block_of(gap_map, model, 1.0), block_of(gap_map, model, reach)
    demand = path(gap_map, seed)
    assert current_jump_at_swap(here, there, demand, gap) < ACCURACY
    assert current_jump_at_swap(there, here, demand, gap) < ACCURACY


@settings(max_examples=25)
@given(MAPS, FACTORS, REACHES, SEEDS, PLACES)
def test_a_swap_of_models_steps_the_current_by_less_than_their_difference(
    gap_map: GapMap, factors: tuple[float, ...], reach: float, seed: int, gap: float
) -> None:
    """The limit is the largest difference of both laws in double precision over the whole path."""
    model = magnet(gap_map, PLAY)
    changed = {
        name: factor * np.asarray(model.parameters[name])
        for name, factor in zip(("M_s", "a", "k", "c", "r_d"), factors, strict=True)
    }
    parameters = dict(model.parameters) | {name: float(value) for name, value in changed.items()}
    other = replace(model, parameters=parameters)
    here, there = block_of(gap_map, model, 1.0), block_of(gap_map, other, reach)
    demand = path(gap_map, seed)
    on = np.append(demand, cycle(gap_map))
    difference = np.abs(drives(model, on, gap) - drives(other, on, gap)).max()
    largest = difference / here.scales.current + ACCURACY
    assert current_jump_at_swap(here, there, demand, gap) < largest
    assert current_jump_at_swap(there, here, demand, gap) < largest


@settings(max_examples=40)
@given(st.tuples(*[st.floats(0.85, 1.15)] * 3), st.floats(-3.0, 1.0), SEEDS, PLACES)
def test_a_swap_of_simplified_laws_steps_the_current_by_less_than_their_difference(
    factors: tuple[float, ...], offset: float, seed: int, gap: float
) -> None:
    """Changed rate, width and flux coefficient, and another offset, which belongs to a fit."""
    scales, limits = ranges("reluctance", PLAY)
    law = closed_form("reluctance")
    other = replace(
        law,
        rate=law.rate * factors[0],
        lag_coefficient=law.lag_coefficient * factors[1],
        flux_coefficient=law.flux_coefficient * factors[2],
        offset=np.full(law.gaps.size, offset),
    )
    model = magnet("reluctance", PLAY)
    here, there = (
        build_block(model, "simplified", scales, limits, SIZES, closed_form=each) for each in (law, other)
    )
    demand = path("reluctance", seed)
    largest = largest_current_difference(here, there, np.append(demand, cycle("reluctance")), gap) + ACCURACY
    assert current_jump_at_swap(here, there, demand, gap) < largest
    assert current_jump_at_swap(there, here, demand, gap) < largest


@pytest.mark.parametrize("kind", ["full", "simplified"])
def test_a_swap_to_the_very_same_block_changes_nothing_that_matters(kind: str) -> None:
    model, (scales, limits) = magnet("reluctance", PLAY), ranges("reluctance", PLAY)
    if kind == "full":
        block = build_block(model, "full", scales, limits, FULL_SIZES)
    else:
        block = build_block(model, "simplified", scales, limits, SIZES, closed_form=closed_form("reluctance"))
    for seed in range(20):
        assert current_jump_at_swap(block, block, path("reluctance", seed), GAPS[1]) < 5e-5
