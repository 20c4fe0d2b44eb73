"""Test small forces: the knee of the root, the residual force, and the flags."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst._core import FixedCompensator
from anhyst.compensate.block import Kind, TableSizes
from anhyst.compensate.force_controller import FixedTwin
from tests.actuators import SIZES, WIDE, compiled, magnet

RESIDUAL = 0.5
"""Force of the magnet without flux, N."""

DEMAND_LIMITED, CURRENT_LIMITED = 1, 2


def block_with(knee: int) -> tuple[FixedTwin, float]:
    """Return a compensator and its full-scale demand."""
    twin = FixedTwin(compiled("full", sizes=TableSizes(iterations=SIZES.iterations, root_knee=knee)))
    return twin, twin.block.scales.demand


@pytest.mark.parametrize("knee", [2, 3, 4, 5, 6, 7, 8])
def test_the_force_deficit_is_bounded_by_the_knee(knee: int) -> None:
    """Below ``2^(-2k)`` of full scale, the force is too small by at most a quarter of that value."""
    twin, full = block_with(knee)
    demand = RESIDUAL + np.linspace(0.0, 2.0, 400) * full * 2.0 ** (-2 * knee)
    drive = twin.run(demand, WIDE)
    force = magnet().predict(drive, np.full(400, WIDE), history="demagnetised").output
    lacking = (demand - force) / full
    assert lacking.max() < 2.0 ** (-2 * knee) / 4.0 + 5e-4
    assert lacking.min() > -5e-4
    if knee <= 4:  # there the line exceeds the other errors
        assert lacking.max() > 0.9 * 2.0 ** (-2 * knee) / 4.0


@pytest.mark.parametrize("knee", [2, 5, 8])
def test_one_unit_of_the_demand_changes_the_current_by_a_bounded_amount(knee: int) -> None:
    """The slope of the root is finite, code by code from the force without flux."""
    twin, _ = block_with(knee)
    codes = int(twin.demand_codes(RESIDUAL)[0]) + 65536 * np.arange(-2, 60)
    core = FixedCompensator("full", twin.block.words)
    gap = int(twin.gap_codes(WIDE)[0])
    currents = np.array([core.solve_q31(int(code), gap) for code in codes.tolist()])
    # A unit of q15 in the demand is at most 2^k units of root; iron and gap turn those to current.
    far = [core.solve_q31(int(0.5 * 2**31 * part), gap) for part in (0.5, 0.5 * (1 + 2**-10))]
    slope = (far[1] - far[0]) / (0.25 * 2**31 * 2**-10)  # where the root's own slope is 1
    assert np.diff(currents).max() < 4.0 * 2.0**knee * slope * 65536
    assert np.diff(currents).min() >= -65536


@pytest.mark.parametrize("kind", ["full", "simplified", "euler"])
def test_a_demand_below_the_residual_force_is_limited_and_reported(kind: Kind) -> None:
    twin = FixedTwin(compiled(kind))
    at_rest = twin.solve(RESIDUAL * 1.01, WIDE)
    assert not twin.flags & DEMAND_LIMITED
    for demand in (0.0, 0.3 * RESIDUAL, 0.98 * RESIDUAL):
        less = twin.solve(demand, WIDE)
        assert twin.flags & DEMAND_LIMITED
        assert less <= at_rest
    twin.commit(twin.solve(0.0, WIDE), WIDE)
    if twin.flags & CURRENT_LIMITED:  # no current within the limits gives zero flux
        assert twin.output > RESIDUAL
        return
    assert twin.output == pytest.approx(RESIDUAL, abs=2e-4 * twin.block.scales.demand)


def test_the_output_is_never_below_the_residual_force() -> None:
    """A force has no sign, even with a negative current."""
    twin = FixedTwin(compiled("full"))
    drive = np.concatenate([np.linspace(0.0, 0.3, 40), np.linspace(0.3, -0.35, 100)])
    force = magnet().predict(drive, np.full(drive.size, WIDE), history="demagnetised").output
    expected = np.array([twin.commit(current, WIDE) for current in drive.tolist()])
    assert expected.min() >= RESIDUAL - 1e-4 * twin.block.scales.demand
    assert np.abs(expected - force).max() < 1e-3 * twin.block.scales.demand
