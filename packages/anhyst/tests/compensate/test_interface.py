"""Test that all methods and number formats have the same contract for the user."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from anhyst.compensate.current_map import fit_ratio, fit_single_valued
from anhyst.compensate.force_controller import Compensator, FixedTwin, RealTwin
from anhyst.compensate.methods import METHODS
from tests.actuators import compiled, magnet, ranges, real_block
from tests.compensate.test_methods import FORMATS, POINT, fitted, known

DEMANDS = [20.0, 75.0, 40.0, 60.0, 35.0]


def _compensators() -> dict[str, Callable[[], Compensator]]:
    made: dict[str, Callable[[], Compensator]] = {
        f"{name}, {form}": lambda name=name, form=form: fitted(name, form)  # type: ignore[misc]
        for name in METHODS
        for form in FORMATS
    }
    for io in ("q15", "q31"):
        made[f"twin, {io}"] = lambda io=io: FixedTwin(compiled("full"), io)  # type: ignore[misc]
    for real in ("f32", "f64"):
        made[f"twin, {real}"] = lambda real=real: RealTwin(  # type: ignore[misc]
            real_block(real, magnet(), "full", *ranges("reluctance"))
        )
    made["ratio of the loops"] = lambda: fit_ratio(known()[0], 90.0)
    made["single-valued of the loops"] = lambda: fit_single_valued(known()[0], 90.0)
    return made


@pytest.mark.first(3)
@pytest.mark.parametrize("name", _compensators())
def test_solve_keeps_the_state_and_commit_advances_it(name: str) -> None:
    compensator, gap = _compensators()[name](), POINT.gap
    undisturbed = compensator.reset_copy()
    for demand in DEMANDS:
        for other in (90.0, 5.0, 50.0):
            compensator.solve(other, gap)
        current = compensator.solve(demand, gap)
        assert current == compensator.solve(demand, gap) == undisturbed.solve(demand, gap)
        expected = compensator.commit(current, gap)
        assert expected == undisturbed.commit(current, gap)
        assert expected == pytest.approx(demand, abs=0.02)


@pytest.mark.first(1)
@pytest.mark.parametrize("name", _compensators())
def test_a_run_alternates_solve_and_commit_and_a_copy_starts_anew(name: str) -> None:
    compensator, gap = _compensators()[name](), POINT.gap
    along = compensator.run(DEMANDS, gap)
    again = compensator.reset_copy()
    steps = []
    for demand in DEMANDS:
        steps.append(again.solve(demand, gap))
        again.commit(steps[-1], gap)
    assert np.array_equal(along, steps)
    assert np.array_equal(compensator.reset_copy().run(DEMANDS, gap), along)
