"""Test the compensator of a controller against the models in double precision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from anhyst.compensate.block import DemandLimits, TableSizes
from anhyst.compensate.builder import build_block
from anhyst.compensate.force_controller import FixedTwin
from anhyst.model.parameters import GapMap
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from tests.actuators import (
    CURRENTS,
    GAPS,
    WIDE,
    compiled,
    largest_force,
    magnet,
    nested,
    ranges,
    reversals,
    ring,
)
from tests.refusals import refused

RESIDUAL = 0.5
DEMAND_LIMITED, CURRENT_LIMITED = 1, 2
MAGNETS: list[tuple[GapMap, float]] = [
    (gap_map, play) for gap_map in ("scaling", "reluctance", "circuit") for play in (0.0, 40.0)
]
PROMISED = 0.002
"""Error limit, as a fraction of the largest force."""


def jumps(high: float) -> FloatArray:
    """Full-range jumps in one sample, and jumps to random levels."""
    anywhere = np.random.default_rng(5).uniform(0.04, 0.95, 2000) * high
    return np.concatenate([np.tile([0.95 * high, 0.04 * high], 200), anywhere])


DEMANDS: dict[str, Callable[[float], FloatArray]] = {
    "nested loops": nested,
    "random reversals": lambda high: reversals(0.04 * high, 0.95 * high, 150, 3),
    "jumps": jumps,
}


def gap_of(kind: str, samples: int) -> FloatArray:
    """Return a gap that is constant, sweeps the whole range, or is random at each sample."""
    if kind == "standing":
        return np.full(samples, WIDE)
    if kind == "moving":
        middle, half = (GAPS[0] + GAPS[-1]) / 2.0, (GAPS[-1] - GAPS[0]) / 2.0
        return np.asarray(middle + half * np.sin(0.037 * np.arange(samples)))
    return np.random.default_rng(11).uniform(GAPS[0], GAPS[-1], samples)


@pytest.mark.parametrize("io", ["q15", "q31"])
@pytest.mark.parametrize("gap", ["standing", "moving", "anywhere"])
@pytest.mark.parametrize("demand", DEMANDS)
@pytest.mark.parametrize(("gap_map", "play"), MAGNETS)
def test_full_gives_the_demanded_force(gap_map: GapMap, play: float, demand: str, gap: str, io: str) -> None:
    wanted = DEMANDS[demand](largest_force(gap_map, play, GAPS[-1]))
    at = gap_of(gap, wanted.size)
    drive = FixedTwin(compiled("full", gap_map, play), io).run(wanted, at)
    force = magnet(gap_map, play).predict(drive, at, history="demagnetised").output
    largest = largest_force(gap_map, play, GAPS[0])
    assert np.abs(force - wanted).max() < PROMISED * largest


@pytest.mark.parametrize(("gap_map", "play"), MAGNETS)
def test_a_demand_too_slow_for_single_codes_loses_nothing(gap_map: GapMap, play: float) -> None:
    """Ramps of 100,000 steps up and down, each step a fraction of a 16-bit code."""
    high = largest_force(gap_map, play)
    up = np.linspace(0.1 * high, 0.5 * high, 100_000)
    expected = np.concatenate([nested(high), up, up[::-1]])
    drive = FixedTwin(compiled("full", gap_map, play)).run(expected, WIDE)
    at = np.full(expected.size, WIDE)
    force = magnet(gap_map, play).predict(drive, at, history="demagnetised").output
    assert np.abs(force - expected).max() < PROMISED * largest_force(gap_map, play, GAPS[0])


@pytest.mark.parametrize("play", [0.0, 4.0])
def test_full_gives_the_demanded_flux_of_either_sign(play: float) -> None:
    model = ring(play)
    top = float(model.predict([0.0, 150.0], history="demagnetised").output[-1])
    limits = DemandLimits((-top, top), (-150.0, 150.0))
    block = build_block(model, "full", Scales(1.1 * top, 160.0, 0.0, 0.0), limits)
    expected = np.concatenate(
        [reversals(-0.95 * top, 0.95 * top, 150, 7), np.tile([0.95 * top, -0.95 * top], 50)]
    )
    drive = FixedTwin(block).run(expected)
    flux_density = model.predict(drive, history="demagnetised").output
    assert np.abs(flux_density - expected).max() < PROMISED * top


@pytest.mark.parametrize("io", ["q15", "q31"])
@pytest.mark.parametrize(("gap_map", "play"), MAGNETS)
def test_expected_force_is_that_of_the_current_a_slow_amplifier_gave(
    gap_map: GapMap, play: float, io: str
) -> None:
    """The memory follows the applied current, not the requested one."""
    largest = largest_force(gap_map, play, GAPS[0])
    wanted = jumps(largest_force(gap_map, play, GAPS[-1]))[::5]
    at = gap_of("moving", wanted.size)
    twin = FixedTwin(compiled("full", gap_map, play), io)
    applied, expected = np.empty(wanted.size), np.empty(wanted.size)
    current = 0.0
    for i, (demand, gap) in enumerate(zip(wanted.tolist(), at.tolist(), strict=True)):
        aim = twin.solve(demand, gap)
        current += float(np.clip(0.4 * (aim - current), -0.15, 0.15))
        current = round(current / twin.block.scales.current * 2**15) * (twin.block.scales.current / 2**15)
        expected[i] = twin.commit(current, gap)
        applied[i] = current
    force = magnet(gap_map, play).predict(applied, at, history="demagnetised").output
    assert np.abs(applied - FixedTwin(compiled("full", gap_map, play), io).run(wanted, at)).max() > 0.1
    assert np.abs(expected - force).max() < PROMISED * largest


def test_limited_current_leads_to_the_force_it_can_give() -> None:
    """A demand beyond the limits of the current is flagged; its possible force is tracked."""
    wide = 0.999 * largest_force("reluctance", 0.0, GAPS[0])
    twin, model = FixedTwin(compiled("full")), magnet()
    rest = twin.solve(0.3 * wide, GAPS[-1])
    assert twin.flags == 0
    twin.commit(rest, GAPS[-1])
    top = twin.solve(wide, GAPS[-1])
    assert twin.flags & CURRENT_LIMITED
    assert top == pytest.approx(CURRENTS[1], abs=1e-3)
    expected = twin.commit(top, GAPS[-1])
    path = np.array([rest, top])
    force = model.predict(path, np.full(2, GAPS[-1]), history="demagnetised").output[-1]
    assert force < 0.99 * wide
    assert expected == pytest.approx(force, abs=PROMISED * wide)


def test_below_the_residual_force_the_current_removes_the_flux() -> None:
    """A demand of at most the force without flux removes the flux from the iron."""
    twin, model = FixedTwin(compiled("full")), magnet()
    history = [twin.run([60.0], [WIDE])[0], twin.solve(0.2 * RESIDUAL, WIDE)]
    assert twin.flags == DEMAND_LIMITED
    twin.commit(history[1], WIDE)
    assert history[1] < 0.0  # a negative current removes the remanence
    answer = model.predict(history, np.full(2, WIDE), history="demagnetised")
    assert abs(answer.flux_density[-1]) < 0.005 * answer.flux_density[0]
    assert answer.output[-1] == pytest.approx(RESIDUAL, abs=1e-3)
    assert twin.output == pytest.approx(RESIDUAL, abs=0.1)


IRONS = [(a, k, c) for a in (150.0, 1000.0) for k in (0.1, 0.75, 3.0) for c in (0.0, 0.3, 0.8)]


@pytest.mark.parametrize(("a", "kappa", "c"), IRONS)
def test_every_kind_of_iron_is_inverted(a: float, kappa: float, c: float) -> None:
    """Soft and hard irons; without reversible part, the force does not change after a reversal."""
    changed = dict(magnet().parameters) | {"a": a, "k": kappa * a, "c": c}
    model = replace(magnet(), parameters=changed)
    both = np.array([0.0, 1.2])
    low, high = (
        float(model.predict(both, np.full(2, gap), history="demagnetised").output[-1])
        for gap in (GAPS[-1], GAPS[0])
    )
    scales = Scales(1.2 * high, 1.4, GAPS[0], GAPS[-1])
    block = build_block(
        model, "full", scales, DemandLimits((0.0, high), (-1.3, 1.3)), TableSizes(iterations=10)
    )
    first = RESIDUAL + 0.05 * (low - RESIDUAL)
    expected = np.concatenate(
        [reversals(first, 0.95 * low, 60, 1), np.tile([0.95 * low, first], 60), jumps(low)[400:800]]
    )
    expected = np.maximum(expected, first)
    at = gap_of("anywhere", expected.size)
    drive = FixedTwin(block).run(expected, at)
    force = model.predict(drive, at, history="demagnetised").output
    assert np.abs(force - expected).max() < PROMISED * high


def test_a_current_too_strong_for_the_tables_is_refused() -> None:
    changed = dict(magnet().parameters) | {"a": 20.0, "k": 20.0}
    scales, limits = ranges("reluctance")
    with refused("tables-too-steep current"):
        build_block(replace(magnet(), parameters=changed), "full", scales, limits)


def test_the_largest_accepted_current_gives_a_valid_block() -> None:
    changed = dict(magnet().parameters) | {"k": 200.0, "a": 50.0}
    model = replace(magnet(), parameters=changed)
    scales, limits = ranges("reluctance")
    taken = 0
    for current in np.geomspace(0.5, CURRENTS[1], 12).tolist():
        narrowed = DemandLimits(limits.demand, (-0.4, current))
        try:
            block = build_block(model, "full", scales, narrowed)
        except InputError:
            continue
        FixedTwin(block)
        taken += 1
    assert 0 < taken < 12
