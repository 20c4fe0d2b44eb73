"""Measure how long a wrong initial state causes force errors in the full and simplified laws.

The paper claims that the simplified model has no initial-value problem. In small loops it has one,
like the full law, and in both the error decays. ``benchmarks/initial_state.py`` measures the same
quantities on a fitted model.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from anhyst.compensate.block import Kind
from tests.actuators import CURRENTS, GAPS, WIDE, magnet
from tests.repository import ROOT

if TYPE_CHECKING:
    from initial_state import Actuator, Outcome

BENCHMARKS = ROOT / "benchmarks"
KINDS: tuple[Kind, ...] = ("full", "simplified", "euler")


class Bench:
    """Functions of the benchmark for the hand-made magnet; each study runs once."""

    def __init__(self) -> None:
        import initial_state

        self.module = initial_state
        gaps = (GAPS[0], GAPS[-1])
        self.actuator: Actuator = initial_state.make_actuator(magnet(), gaps, WIDE, CURRENTS[1])
        self._done: dict[tuple[Kind, float, bool, bool], Outcome] = {}

    def outcome(
        self, kind: Kind, low: float, high: float, conditioned: bool = False, at_random: bool = False
    ) -> Outcome:
        key = (kind, low, conditioned, at_random)
        if key not in self._done:
            prelude = self.module.conditioning_currents(self.actuator, 1) if conditioned else None
            demand = self.module.triangle_demand(low, high)[: 6 * self.module.SAMPLES_PER_CYCLE]
            self._done[key] = self.module.study(self.actuator, kind, demand, prelude, at_random)
        return self._done[key]

    def cycles(self, outcome: Outcome) -> float:
        """Maximum number of cycles until all errors are below 1 % of the largest force."""
        return float(outcome.samples[:, 0].max()) / self.module.SAMPLES_PER_CYCLE


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        yield Bench()


@pytest.mark.first(2)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("low", "high"), [(0.05, 0.95), (0.3, 0.7)])
def test_a_wrong_start_is_forgotten_within_a_cycle(bench: Bench, kind: Kind, low: float, high: float) -> None:
    assert bench.cycles(bench.outcome(kind, low, high)) <= 1.0


@pytest.mark.parametrize("kind", KINDS)
def test_small_loops_take_longer_to_forget(bench: Bench, kind: Kind) -> None:
    small = bench.cycles(bench.outcome(kind, 0.45, 0.55))
    assert small >= bench.cycles(bench.outcome(kind, 0.05, 0.95))
    assert small < 5.0


def test_a_memory_at_random_costs_the_full_law_more(bench: Bench) -> None:
    """The simplified law has only one, bounded state, which limits its error."""
    full, simple = (bench.outcome(kind, 0.3, 0.7, at_random=True) for kind in ("full", "simplified"))
    assert full.largest_error > 2.0 * simple.largest_error
    assert bench.cycles(full) > bench.cycles(simple)


@pytest.mark.first(1)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("low", "high"), [(0.05, 0.95), (0.3, 0.7), (0.45, 0.55)])
def test_conditioning_removes_a_wrong_initial_state(
    bench: Bench, kind: Kind, low: float, high: float
) -> None:
    for at_random in (False, True):
        outcome = bench.outcome(kind, low, high, conditioned=True, at_random=at_random)
        assert outcome.largest_error < bench.module.TOLERANCES[1]


@pytest.mark.parametrize("kind", KINDS)
def test_every_law_depends_on_its_initial_state_on_minor_loops(bench: Bench, kind: Kind) -> None:
    outcome = bench.outcome(kind, 0.3, 0.7)
    assert outcome.largest_error > 3.0 * bench.module.TOLERANCES[0]
    assert bench.cycles(outcome) > 0.0


@pytest.mark.parametrize(("low", "high"), [(0.05, 0.95), (0.3, 0.7), (0.45, 0.55)])
def test_the_simplified_law_forgets_no_later_than_the_full_one(bench: Bench, low: float, high: float) -> None:
    """The valid part of the claim: the error decays at least as fast as with the full law."""
    full, simple = (bench.outcome(kind, low, high) for kind in ("full", "simplified"))
    assert bench.cycles(simple) <= bench.cycles(full)


def test_only_the_full_law_meets_the_demand_after_settling(bench: Bench) -> None:
    full = bench.outcome("full", 0.05, 0.95)
    simple = bench.outcome("simplified", 0.05, 0.95)
    assert full.settled_error < 0.002
    assert simple.settled_error > 3.0 * full.settled_error
