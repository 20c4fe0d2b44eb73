"""Test a compensator with a correction by the measured flux, in every format."""

from __future__ import annotations

import math

import numpy as np
import pytest

from anhyst._core import FixedForceController, ForceController, ForceControllerF32
from anhyst.support.numeric import FloatArray
from tests.actuators import (
    SIZES,
    WIDE,
    RealKind,
    RealSignalFormat,
    closed_form,
    compiled,
    magnet,
    ranges,
    real_block,
    reversals,
)

ONE, NO_FLUX, NAN = 2**31, -(2**31), math.nan
CURRENT_LIMITED = 2
KINDS: tuple[RealKind, ...] = ("full", "simplified")
DENSITY = 0.8  # flux density of the largest force, T
GAPS = (0.3e-3, 0.6e-3)
Real = ForceController | ForceControllerF32


def plain(kind: RealKind, single: bool = False) -> tuple[Real, float]:
    """Return a compensator, and its largest force, N."""
    law = closed_form("reluctance") if kind == "simplified" else None
    io: RealSignalFormat = "f32" if single else "f64"
    block = real_block(io, magnet(), kind, *ranges("reluctance"), SIZES, law=law)
    made: Real = (
        ForceControllerF32.compensator(kind, block.words)
        if single
        else ForceController.compensator(kind, block.words)
    )
    return made, block.scales.demand


def fused(kind: RealKind, *loop: float, single: bool = False, high: float = 2.0, most: float = 9.0) -> Real:
    """Return the compensator with a flux loop."""
    made, full = plain(kind, single)
    table = np.tile([0.0, DENSITY], (2, 1))
    made.fuse(table, np.array(loop), most, 0.0, full, *GAPS, 0.0, high)
    return made


def wanted(demand: float, full: float) -> float:
    return DENSITY * math.sqrt(demand / full)


def demands(full: float, amplitude: float = 0.25) -> FloatArray:
    return np.asarray(0.4 * full + amplitude * full * np.sin(np.linspace(0.0, 12.0, 240)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("single", "bound"), [(False, 1e-9), (True, 2e-4)])
def test_an_expected_flux_does_not_change_the_currents_of_the_compensator(
    kind: RealKind, single: bool, bound: float
) -> None:
    share, density = 0.4, 0.0
    drive, (law, full) = fused(kind, 0.5, 0.1, 0.2, share, single=single), plain(kind, single)
    for demand in demands(full).tolist():
        current = drive.solve(demand, WIDE, density)
        assert current == pytest.approx(law.solve(demand, WIDE, NAN), abs=bound)
        drive.commit(current, WIDE)
        law.commit(current, WIDE)
        density += share * (wanted(demand, full) - density)


@pytest.mark.parametrize("kind", KINDS)
def test_the_flux_loop_corrects_an_error_of_the_law(kind: RealKind) -> None:
    """The iron gives 10 % less flux than the law."""
    drive, (law, full) = fused(kind, 0.2, 0.1, 0.2, 1.0), plain(kind)
    demand, density = 0.4 * full, 0.0
    needed = law.solve(demand, WIDE, NAN)
    for _ in range(600):
        current = drive.solve(demand, WIDE, density)
        drive.commit(current, WIDE)
        density = 0.9 * wanted(demand, full) * current / needed
    assert density == pytest.approx(wanted(demand, full), rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_the_flux_correction_is_not_committed_to_the_iron(kind: RealKind) -> None:
    """A constant offset of the current, as of an amplifier, does not change the hysteresis state."""
    drive, (law, full) = fused(kind, 0.0, 0.02, 0.2, 1.0), plain(kind)
    for demand in demands(full).tolist():
        current = drive.solve(demand, WIDE, 0.97 * wanted(demand, full))
        by_law = law.solve(demand, WIDE, NAN)
        applied = 0.98 * current
        expected = drive.commit(applied, WIDE)
        assert expected == pytest.approx(law.commit(applied - (current - by_law), WIDE), rel=1e-9)
    assert current - by_law > 0.05


@pytest.mark.parametrize("kind", KINDS)
def test_without_a_sample_the_fixed_one_is_its_compensator_bit_for_bit(kind: RealKind) -> None:
    block = compiled(kind)
    drive = FixedForceController.compensator(block.kind, block.words)
    law = FixedForceController.compensator(block.kind, block.words)
    table = np.tile(np.array([0, 26000], dtype=np.int16), (2, 1))
    loop = np.array([[20000, 0], [20000, -3], [20000, 0], [-30000, 1]], dtype=np.int16)
    drive.fuse(table, loop, ONE - 1, -ONE, ONE - 1)
    for demand in reversals(0.1, 0.8, 60, 9).tolist():
        code, gap = int(demand * ONE), ONE // 3
        current = drive.solve(code, gap, NO_FLUX)
        assert current == law.solve(code, gap, NO_FLUX)
        applied = current & ~0xFFFF
        assert drive.commit(applied, gap) == law.commit(applied, gap)


@pytest.mark.parametrize("kind", KINDS)
def test_any_input_in_fixed_point_gives_a_current_within_its_limits(kind: RealKind) -> None:
    """All currents are within the limits, a second solve changes nothing, and the loop recovers."""
    block = compiled(kind)
    drive = FixedForceController.compensator(block.kind, block.words)
    table = np.tile(np.array([0, 26000], dtype=np.int16), (2, 1))
    loop = np.array([[20000, 0], [20000, -3], [20000, 0], [-30000, 1]], dtype=np.int16)
    low, high = -ONE // 8, ONE // 2
    drive.fuse(table, loop, ONE - 1, low, high)
    rng = np.random.default_rng(5)
    limited = 0
    for demand, gap, flux, other in rng.integers(-ONE, ONE, (3000, 4)).tolist():
        current = drive.solve(demand, gap, flux)
        assert low <= current <= high
        assert current == drive.solve(demand, gap, flux)
        limited += bool(drive.flags & CURRENT_LIMITED)
        drive.commit(other, gap)
    assert limited > 1000
    root = int(26000 / 32768 * math.sqrt(0.2) * ONE)
    for _ in range(4000):
        current = drive.solve(ONE // 5, ONE // 3, root)
        drive.commit(current, ONE // 3)
    assert low < current < high


@pytest.mark.parametrize("flux", [0.0, 0.7])
def test_a_probe_that_is_stuck_adds_no_more_than_was_allowed(flux: float) -> None:
    drive, (law, full) = fused("full", 0.2, 0.1, 0.2, 1.0, most=0.07), plain("full")
    for demand in demands(full).tolist():
        current, by_law = drive.solve(demand, WIDE, flux), law.solve(demand, WIDE, NAN)
        assert abs(current - by_law) <= 0.07 + 1e-12
        drive.commit(current, WIDE)
        law.commit(by_law, WIDE)
    # and recovers in the same time
    for _ in range(40):
        drive.commit(drive.solve(demand, WIDE, wanted(demand, full) + 0.05), WIDE)
        law.commit(law.solve(demand, WIDE, NAN), WIDE)
    assert drive.solve(demand, WIDE, NAN) < law.solve(demand, WIDE, NAN)


def test_it_does_not_wind_up_while_the_current_is_limited() -> None:
    def after(ticks: int) -> float:
        drive, (_, full) = fused("full", 0.0, 0.1, 0.5, 1.0, high=0.8), plain("full")
        for _ in range(ticks):
            current = drive.solve(0.95 * full, WIDE, 0.3)
            assert current == 0.8
            drive.commit(current, WIDE)
        return drive.solve(0.1 * full, WIDE, NAN)

    assert after(20) == pytest.approx(after(3000), abs=0.02)


def test_a_loop_that_is_not_valid_is_refused_and_changes_nothing() -> None:
    drive, (law, full) = plain("full")[0], plain("full")
    table, loop = np.tile([0.0, DENSITY], (2, 1)), np.array([0.1, 0.1, 0.1, 1.0])
    for wrong, largest, low, high in (
        (np.array([NAN, 0.1, 0.1, 1.0]), 1.0, 0.0, 2.0),
        (np.array([0.1, 0.1, 2.0, 1.0]), 1.0, 0.0, 2.0),
        (loop, -1.0, 0.0, 2.0),
        (loop, 1.0, 2.0, 0.0),
        (loop, 1.0, NAN, 2.0),
    ):
        with pytest.raises(ValueError, match="not valid"):
            drive.fuse(table, wrong, largest, 0.0, full, *GAPS, low, high)
    assert drive.solve(0.3 * full, WIDE, 0.0) == law.solve(0.3 * full, WIDE, 0.0)
