"""Test the simplified law in fixed point: its closed form and the paper's Euler form.

The oracle is :class:`tests.oracles.linear_anhysteretic.LinearAnhysteretic`, which solves each step
with the Lambert function in double precision.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from anhyst.compensate.block import Block, DemandLimits, Kind, TableSizes
from anhyst.compensate.builder import build_block
from anhyst.compensate.force_controller import FixedTwin
from anhyst.compensate.simplified import ClosedForm
from anhyst.support.block_words import Scales
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.actuators import reversals, ring
from tests.oracles.linear_anhysteretic import LinearAnhysteretic

LAWS = [
    LinearAnhysteretic(k1=k1, k2=0.0, k=k, c=c, alpha=0.0)
    for k1, k, c in (
        (2000.0, 20.0, 0.1),
        (2000.0, 100.0, 0.5),
        (9000.0, 3.0, 0.05),
        (9000.0, 8.0, 0.98),
        (300.0, 2000.0, 0.03),
        (9000.0, 0.3, 0.5),
    )
]
"""Rates of 0.7 to 148 and nu of 0.02 to 0.97, see the first test."""

UNIT = MU_0 * 4e5 * (1.0 + 2e-5)
"""Flux density of 1.0, T: that of the saturated ring."""

CLAIMED = {3: 1.5e-3, 4: 4.5e-4, 5: 3.5e-4}
"""Error of the bounded state for any steps, by the exponent of the segments per octave."""

TINY = 2.5e-3
"""The same for ten thousands of steps of 1e-6 of full scale, whose rounding adds up."""


def rate_of(law: LinearAnhysteretic) -> float:
    """Distance ``S`` per unit of flux."""
    return UNIT / MU_0 / (law.k * law.lam)


each_law = pytest.mark.parametrize(
    "law", LAWS, ids=[f"rate {rate_of(law):.1f}, nu {law.nu:.2f}" for law in LAWS]
)


@cache
def block_of(
    law: LinearAnhysteretic, kind: Kind = "simplified", segments: int = 4, substeps: int = 1
) -> Block:
    """Return a block whose demand is the flux and whose current is the bounded state."""
    one = np.ones(1)
    form = ClosedForm(rate_of(law), law.nu, 0.0 * one, 0.0 * one, 0.0 * one, one, 0.0, 0.0)
    limits = DemandLimits((-0.999 * UNIT, 0.999 * UNIT), (-1.05, 1.05))
    sizes = TableSizes(octave_segments=segments, substeps=substeps)
    return build_block(ring(), kind, Scales(UNIT, 1.1, 0.0, 0.0), limits, sizes, closed_form=form)


def followed(
    law: LinearAnhysteretic, flux: FloatArray, kind: Kind = "simplified", segments: int = 4
) -> FloatArray:
    """Return the bounded state of the C along a path of the flux (1.0 is `UNIT`)."""
    return FixedTwin(block_of(law, kind, segments)).run(flux * UNIT)


def exact(law: LinearAnhysteretic, flux: FloatArray) -> FloatArray:
    """Return the bounded state of the oracle."""
    return law.inverse(flux * UNIT)[1]


def test_the_laws_cover_the_range() -> None:
    rates, nus = [rate_of(law) for law in LAWS], [law.nu for law in LAWS]
    assert min(rates) < 1.0
    assert max(rates) > 100.0
    assert min(nus) < 0.05
    assert max(nus) > 0.9


@pytest.mark.first(63)
@each_law
@pytest.mark.parametrize("size", [0.002, 0.02, 0.2, 2.0])
@pytest.mark.parametrize("segments", [3, 4, 5])
def test_the_state_is_exact_for_steps_of_any_size(
    law: LinearAnhysteretic, size: float, segments: int
) -> None:
    rng = np.random.default_rng(int(1e3 * size))
    steps = rng.uniform(-size, size, 3000) * rng.uniform(0.0, 1.0, 3000)
    flux = np.abs(np.cumsum(steps) % 3.2 - 1.6) - 0.8  # cycles between -0.8 and 0.8
    error = followed(law, flux, segments=segments) - exact(law, flux)
    assert np.abs(error).max() < CLAIMED[segments]


@each_law
def test_the_state_is_exact_along_ways_jumps_and_reversals(law: LinearAnhysteretic) -> None:
    jumps = np.tile([0.9, -0.9, 0.9, 0.0], 50)
    flux = np.concatenate([reversals(-0.9, 0.9, 200, 4), jumps, reversals(0.3, 0.35, 200, 6)])
    assert np.abs(followed(law, flux) - exact(law, flux)).max() < CLAIMED[4]


@each_law
def test_a_reversal_in_the_dead_band_retraces_its_path(law: LinearAnhysteretic) -> None:
    """Just after a reversal the state is in its dead band; a reversal there is the critical case."""
    hold = (1.0 - law.nu) / rate_of(law)
    ways = 0.4 * hold * np.random.default_rng(8).uniform(-1.0, 1.0, 3000)
    flux = 0.5 + np.concatenate([[0.0], np.cumsum(ways) % (0.8 * hold)])
    assert np.abs(followed(law, flux) - exact(law, flux)).max() < CLAIMED[4]


@each_law
@pytest.mark.parametrize("height", [0.02, 0.3])
def test_a_hundred_thousand_tiny_steps_lose_nothing(law: LinearAnhysteretic, height: float) -> None:
    up = np.linspace(0.0, height, 100_001)[1:]
    down = np.linspace(height, -0.5 * height, 100_001)[1:]
    state = followed(law, np.concatenate([[0.6, 0.0], up, down]))
    corners = exact(law, np.array([0.6, 0.0, height, -0.5 * height]))
    assert abs(state[1 + up.size] - corners[2]) < TINY
    assert abs(state[-1] - corners[3]) < TINY


@each_law
@pytest.mark.parametrize("width", [1e-6, 1e-4, 1e-2])
def test_chatter_creeps_as_that_of_the_law_does(law: LinearAnhysteretic, width: float) -> None:
    """After three thousand small cycles, only the drift of the law itself remains."""
    flux = np.concatenate([[0.8, 0.3], np.tile([0.3 + width, 0.3], 3000)])
    assert np.abs(followed(law, flux) - exact(law, flux)).max() < TINY


def euler(law: LinearAnhysteretic, flux: FloatArray, substeps: int) -> FloatArray:
    """Return the bounded state by Euler's explicit method, from the law's differential equation.

    ``dM_irr/dx = (M_an - M_irr)/k`` in the direction of travel, never backwards, becomes for
    ``u = (M_an - M_irr)/(k*K_1)`` and ``b = B/mu0``: ``du/db = (1 - chi/K_1)/k * dx/db`` with
    ``chi = K_1*max(0, sg*u)``, and ``dx/db = 1/(1 + (1-alpha)*((1-c)*chi + c*K_1))`` from
    ``b = x + (1-alpha)*M``.
    """
    states, u, before = np.empty(flux.size), 0.0, 0.0
    for i, place in enumerate(flux.tolist()):
        change = (place - before) * UNIT / MU_0 / substeps
        sg = 1.0 if change >= 0.0 else -1.0
        for _ in range(substeps):
            pull = max(0.0, sg * u)
            slope = law.k1 * ((1.0 - law.c) * pull + law.c)
            u += change * (1.0 - pull) / law.k / (1.0 + (1.0 - law.alpha) * slope)
            u = min(max(u, -1.0), 1.0)
        states[i], before = u, place
    return states


@each_law
@pytest.mark.parametrize("substeps", [1, 4])
def test_the_euler_form_is_the_papers(law: LinearAnhysteretic, substeps: int) -> None:
    flux = reversals(-0.9, 0.9, 60, 9)
    state = FixedTwin(block_of(law, "euler", substeps=substeps)).run(flux * UNIT)
    # If a step passes the bend of the curve, the rounding of the slope determines the error.
    assert np.abs(state - euler(law, flux, substeps)).max() < 5e-3


def test_the_closed_form_is_exact_and_the_euler_form_is_not() -> None:
    """One Euler step per sample, with ever fewer samples per cycle of a triangle from zero."""
    law = LAWS[0]
    worst: dict[Kind, list[float]] = {"simplified": [], "euler": []}
    for samples in (10_000, 1000, 100):
        phase = np.arange(3 * samples) / samples + 0.25
        flux = 0.8 * (1.0 - 4.0 * np.abs(phase % 1.0 - 0.5))
        for kind, errors in worst.items():
            error = followed(law, flux, kind) - exact(law, flux)
            errors.append(float(np.abs(error).max()))
    assert max(worst["simplified"]) < CLAIMED[4]
    assert worst["euler"] == sorted(worst["euler"])
    assert worst["euler"][0] < 0.01
    assert worst["euler"][-1] > 0.3
