"""Test the force controllers of the core in every format: solve, commit, limits and flux loop."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from anhyst._core import (
    Compensator,
    FixedCompensator,
    FixedForceController,
    ForceController,
    ForceControllerF32,
)
from anhyst.support.numeric import FloatArray
from tests.actuators import (
    CURRENTS,
    GAPS,
    SIZES,
    WIDE,
    RealKind,
    RealSignalFormat,
    closed_form,
    compiled,
    largest_force,
    magnet,
    ranges,
    real_block,
    reversals,
)

ONE = 2**31
NO_FLUX = -ONE
FORCE, GAP_LOW, GAP_HIGH = 200.0, 0.3e-3, 0.6e-3
LOW, HIGH = 0.1, 3.0
NAN = math.nan
DEMAND_LIMITED, CURRENT_LIMITED = 1, 2
KINDS: tuple[RealKind, ...] = ("full", "simplified")
Real = ForceController | ForceControllerF32


def table(rows: int = 5, columns: int = 9) -> FloatArray:
    """Return currents that are curved over the force and increase with the gap, A."""
    force, gap = np.linspace(0.0, 1.0, columns), np.linspace(1.0, 2.0, rows)
    return np.ascontiguousarray(gap[:, None] * (0.3 * force + 1.2 * force**2))


def densities(rows: int = 5, columns: int = 9) -> FloatArray:
    """Return flux densities proportional to the root of the force, equal at every gap, T."""
    return np.ascontiguousarray(np.tile(0.8 * np.linspace(0.0, 1.0, columns), (rows, 1)))


def of_map(drive: type[ForceController] | type[ForceControllerF32]) -> Real:
    return drive.map(table(), 0.0, FORCE, GAP_LOW, GAP_HIGH, LOW, HIGH)


def of_flux(*loop: float, high: float = HIGH) -> ForceController:
    return ForceController.flux(
        table(), densities(), np.array(loop), 0.0, FORCE, GAP_LOW, GAP_HIGH, 0.0, high
    )  # fmt: skip


def block_words(kind: RealKind, io: RealSignalFormat) -> NDArray[Any]:
    law = closed_form("reluctance") if kind == "simplified" else None
    return real_block(io, magnet(), kind, *ranges("reluctance"), SIZES, law=law).words


def every_real() -> list[Real]:
    drives: list[Real] = [of_map(ForceController), of_map(ForceControllerF32), of_flux(0.5, 0.1, 0.2, 0.5)]
    for kind in KINDS:
        drives += [
            ForceController.compensator(kind, block_words(kind, "f64")),
            ForceControllerF32.compensator(kind, block_words(kind, "f32")),
        ]
    return drives


def words(values: FloatArray, one: float) -> NDArray[np.int16]:
    return np.rint(values / one * 32768.0).astype(np.int16)


def every_fixed() -> list[FixedForceController]:
    entries, wanted = words(table(), 4.0), words(densities(), 1.0)
    loop = np.array([[20000, 0], [20000, -3], [20000, 0], [-30000, 1]], dtype=np.int16)
    drives = [
        FixedForceController.map(entries, 0, ONE - 1),
        FixedForceController.flux(entries, wanted, loop, 0, 2**30),
    ]
    return drives + [FixedForceController.compensator(kind, compiled(kind).words) for kind in KINDS]


# Maps


@pytest.mark.parametrize(("drive", "bound"), [(ForceController, 1e-14), (ForceControllerF32, 1e-6)])
def test_a_map_is_straight_between_its_entries(
    drive: type[ForceController] | type[ForceControllerF32], bound: float
) -> None:
    axes = np.linspace(GAP_LOW, GAP_HIGH, 5), np.linspace(0.0, FORCE, 9)
    between = RegularGridInterpolator(axes, table())
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(GAP_LOW, GAP_HIGH, 500), rng.uniform(0.0, FORCE, 500)])
    wide = drive.map(table(), 0.0, FORCE, GAP_LOW, GAP_HIGH, -9.0, 9.0)
    found = [wide.solve(force, gap, NAN) for gap, force in points.tolist()]
    assert found == pytest.approx(between(points), abs=bound * 3.0)


@pytest.mark.parametrize("drive", [ForceController, ForceControllerF32])
def test_a_map_is_limited_to_its_table(drive: type[ForceController] | type[ForceControllerF32]) -> None:
    wide = drive.map(table(), 0.0, FORCE, GAP_LOW, GAP_HIGH, -9.0, 9.0)
    corner = wide.solve(FORCE, GAP_HIGH, NAN)
    assert wide.solve(FORCE, 1.0, NAN) == corner == pytest.approx(3.0)
    assert wide.solve(9.0 * FORCE, GAP_HIGH, NAN) == corner
    assert wide.flags == DEMAND_LIMITED
    assert wide.solve(-1.0, GAP_LOW, NAN) == wide.solve(0.0, GAP_LOW, NAN) == 0.0
    assert wide.solve(NAN, NAN, NAN) == 0.0


@pytest.mark.slow
@given(
    st.integers(0, 5),
    st.integers(0, 4),
    st.integers(0, 2**32 - 1),
    st.integers(-ONE, ONE - 1),
    st.integers(-ONE, ONE - 1),
    st.integers(-ONE, ONE - 1),
)
@settings(max_examples=300)
def test_the_fixed_map_against_exact_rational_arithmetic(
    n: int, m: int, seed: int, force: int, gap: int, applied: int
) -> None:
    rng = np.random.default_rng(seed)
    steps = rng.integers(0, 32767 >> (n + 1), (2**m + 1, 2**n + 1), endpoint=True)
    entries = (np.cumsum(steps, axis=1) - rng.integers(0, 16384)).clip(-32767, 32767)
    drive = FixedForceController.map(entries.astype(np.int16), -ONE, ONE - 1)

    def value(at: int) -> Fraction:
        column = _place(at, n)
        low, high = (_over_gap(entries[:, column[0] + i].tolist(), gap, m) for i in (0, 1))
        return low + (high - low) * column[1]

    def _over_gap(column: list[int], at: int, exponent: int) -> Fraction:
        row, part = _place(at, exponent)
        return 65536 * (column[row] + (column[row + 1] - column[row]) * part)

    current = drive.solve(force, gap, NO_FLUX)
    assert abs(current - value(force)) <= 8
    expected = drive.commit(applied, gap)
    if applied == current:
        assert expected == max(force, 0)
        return
    assert 0 <= expected < ONE
    # The expected force agrees with the force of the applied current to within two codes.
    around = value(max(expected - 2, 0)) - 8, value(min(expected + 2, ONE - 1)) + 8
    reachable = min(max(Fraction(applied), value(0)), value(ONE - 1))
    assert around[0] <= reachable <= around[1]


def _place(code: int, exponent: int) -> tuple[int, Fraction]:
    place = Fraction(max(code, 0) << exponent, ONE)
    return int(place), place - int(place)


# The contract


@pytest.mark.parametrize("place", range(len(every_real())))
def test_committing_the_solved_current_gives_the_demand_bit_for_bit(place: int) -> None:
    drive = every_real()[place]
    for demand in reversals(30.0, 90.0, 60, 5).astype(np.float32).tolist():
        current = drive.solve(demand, WIDE, NAN)
        assert drive.flags == 0
        assert drive.commit(current, WIDE) == demand


@pytest.mark.parametrize("place", range(len(every_fixed())))
def test_the_same_in_fixed_point(place: int) -> None:
    drive = every_fixed()[place]
    for demand in (reversals(0.15, 0.45, 60, 5) * ONE).astype(int).tolist():
        current = drive.solve(demand, ONE // 2, NO_FLUX)
        assert drive.flags == 0
        assert drive.commit(current, ONE // 2) == demand


@pytest.mark.parametrize("place", range(len(every_real())))
def test_solving_changes_nothing_and_may_be_repeated(place: int) -> None:
    drive, curious = every_real()[place], every_real()[place]
    for demand in reversals(20.0, 90.0, 60, 5).tolist():
        for other in (5.0, 95.0, -50.0):
            curious.solve(other, GAPS[0], 0.1)
        current = drive.solve(demand, WIDE, 0.3)
        assert curious.solve(demand, WIDE, 0.3) == current
        assert drive.commit(0.9 * current, WIDE) == curious.commit(0.9 * current, WIDE)


@pytest.mark.parametrize("place", range(len(every_fixed())))
def test_committing_the_solved_current_gives_the_demand_in_fixed_point(place: int) -> None:
    drive, curious = every_fixed()[place], every_fixed()[place]
    for demand in (reversals(0.1, 0.5, 60, 5) * ONE).astype(int).tolist():
        for other in (0, -ONE, ONE - 1):
            curious.solve(other, 0, ONE // 8)
        current = drive.solve(demand, ONE // 2, ONE // 4)
        assert curious.solve(demand, ONE // 2, ONE // 4) == current
        assert drive.commit(current // 2, ONE // 2) == curious.commit(current // 2, ONE // 2)


def test_a_current_other_than_the_solved_one_is_reported_as_force() -> None:
    drive = of_map(ForceController)
    current = drive.solve(150.0, WIDE, NAN)
    between = drive.solve(120.0, WIDE, NAN)
    drive.solve(150.0, WIDE, NAN)
    assert drive.commit(between, WIDE) == pytest.approx(120.0, rel=1e-14)
    assert drive.commit(current, WIDE) == pytest.approx(150.0, rel=1e-14)  # without a solve


def test_force_lost_to_a_current_limit_is_reported() -> None:
    drive = of_map(ForceController)
    narrow = ForceController.map(table(), 0.0, FORCE, GAP_LOW, GAP_HIGH, LOW, 1.0)
    largest = narrow.solve(190.0, WIDE, NAN)
    assert (largest, narrow.flags) == (1.0, CURRENT_LIMITED)
    expected = narrow.commit(largest, WIDE)
    assert expected < 150.0
    assert drive.solve(expected, WIDE, NAN) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_a_compensator_in_a_drive_is_that_compensator(kind: RealKind) -> None:
    double = block_words(kind, "f64")
    bare, drive = Compensator(kind, double), ForceController.compensator(kind, double)
    fixed, fixed_drive = (
        FixedCompensator(kind, compiled(kind).words),
        FixedForceController.compensator(kind, compiled(kind).words),
    )
    share = 0.98
    for demand in reversals(5.0, 0.9 * largest_force("reluctance", 0.0, GAPS[-1]), 80, 2).tolist():
        current = bare.solve(demand, WIDE)
        assert drive.solve(demand, WIDE, NAN) == current
        bare.commit(share * current, WIDE)
        drive.commit(share * current, WIDE)
        code = int(demand / 250.0 * ONE)
        steps = fixed.solve_q31(code, ONE // 2)
        assert fixed_drive.solve(code, ONE // 2, NO_FLUX) == steps
        fixed.commit_q31(int(share * steps), ONE // 2)
        fixed_drive.commit(int(share * steps), ONE // 2)


def test_the_expected_force_of_an_applied_current_equals_the_force_of_the_magnet() -> None:
    drive = ForceController.compensator("full", block_words("full", "f64"))
    high = 0.9 * largest_force("reluctance", 0.0, GAPS[-1])
    applied, expected = [], []
    for demand in reversals(0.1 * high, high, 100, 4).tolist():
        current = round(drive.solve(demand, WIDE, NAN) * 500.0) / 500.0  # a coarse converter
        applied.append(current)
        expected.append(drive.commit(current, WIDE))
    force = magnet().predict(applied, WIDE, history="demagnetised").output
    assert np.abs(np.array(expected) - force).max() < 1e-3 * high


@pytest.mark.parametrize("kind", KINDS)
def test_converter_rounding_leaves_no_bias_in_the_expected_force(kind: RealKind) -> None:
    """The conversion from flux to force has few digits in fixed point. If its error reached an
    integral, it would shift the position."""
    drive = FixedForceController.compensator(kind, compiled(kind).words)
    fixed = FixedCompensator(kind, compiled(kind).words)
    rng = np.random.default_rng(3)
    step = ONE >> 15
    ours, plain = [], []
    for demand in (0.3 * ONE + 0.01 * ONE * rng.standard_normal(4000)).astype(int).tolist():
        current = step * round(drive.solve(demand, ONE // 2, NO_FLUX) / step)
        ours.append(drive.commit(current, ONE // 2) - demand)
        fixed.solve_q31(demand, ONE // 2)
        fixed.commit_q31(current, ONE // 2)
        plain.append(fixed.output_q31() - demand)
    assert abs(np.mean(ours)) < 2e-6 * ONE
    assert abs(np.mean(plain)) > 5e-6 * ONE  # value without the limit


def test_conditioning_comes_from_the_compensator_alone() -> None:
    drive = ForceController.compensator("full", block_words("full", "f64"))
    fixed = FixedForceController.compensator("full", compiled("full").words)
    ticks = drive.conditioning_length()
    assert fixed.conditioning_length() == ticks > 0
    currents = [drive.conditioning(tick) for tick in range(ticks)]
    assert (min(currents), max(currents)) == pytest.approx(CURRENTS, rel=1e-15)
    scale = ranges("reluctance")[0].current / ONE
    assert [scale * fixed.conditioning(tick) for tick in range(ticks)] == pytest.approx(currents, abs=2e-4)
    for without in (of_map(ForceController), of_flux(0.5, 0.1, 0.2, 0.5), every_fixed()[0]):
        assert without.conditioning_length() == 0
        assert without.conditioning(0) == 0.0


# The flux loop


def test_the_flux_loop_removes_a_flux_error() -> None:
    """The loop corrects any error of the map: here the iron gives 10 % less flux."""
    drive = of_flux(0.2, 0.1, 0.2, 1.0)
    demand, density = 120.0, 0.0
    wanted = 0.8 * math.sqrt(demand / FORCE)
    for _ in range(600):
        current = drive.solve(demand, WIDE, density)
        drive.commit(current, WIDE)
        density = 0.9 * wanted * current / of_map(ForceController).solve(demand, WIDE, NAN)
    assert density == pytest.approx(wanted, rel=1e-9)


def test_a_flux_that_follows_as_expected_asks_for_no_correction() -> None:
    share = 0.4
    drive, plain = of_flux(0.5, 0.1, 0.2, share), of_map(ForceController)
    density = 0.0
    for demand in reversals(40.0, 120.0, 100, 9).tolist():
        current = drive.solve(demand, WIDE, density)
        assert current == pytest.approx(plain.solve(demand, WIDE, NAN), rel=1e-12)
        drive.commit(current, WIDE)
        density += share * (0.8 * math.sqrt(demand / FORCE) - density)


def test_a_missing_probe_sample_freezes_the_correction() -> None:
    drive, plain = of_flux(0.0, 0.1, 0.2, 1.0), of_map(ForceController)
    for _ in range(50):
        drive.commit(drive.solve(100.0, WIDE, 0.3), WIDE)
    held = drive.solve(100.0, WIDE, NAN)
    assert held > plain.solve(100.0, WIDE, NAN) + 0.1
    for _ in range(50):
        drive.commit(drive.solve(100.0, WIDE, NAN), WIDE)
    assert drive.solve(100.0, WIDE, NAN) == held


def test_the_flux_loop_does_not_wind_up_while_the_current_is_limited() -> None:
    def after(ticks: int) -> float:
        drive = of_flux(0.0, 0.1, 0.5, 1.0, high=1.0)
        for _ in range(ticks):
            current = drive.solve(190.0, WIDE, 0.3)
            assert current == 1.0
            drive.commit(current, WIDE)
        return drive.solve(20.0, WIDE, NAN)

    assert after(20) == pytest.approx(after(5000), abs=1e-3)


@pytest.mark.parametrize("shunt", [1.02, 0.98])
def test_a_wrong_shunt_does_not_change_the_flux(shunt: float) -> None:
    """A measured current below its limits does not affect the integral."""
    drive = of_flux(0.2, 0.1, 0.2, 1.0)
    density = 0.0
    for _ in range(600):
        current = drive.solve(120.0, WIDE, density)
        drive.commit(shunt * current, WIDE)
        density = 0.5 * current / of_map(ForceController).solve(120.0, WIDE, NAN)
    assert density == pytest.approx(0.8 * math.sqrt(120.0 / FORCE), rel=1e-9)


@pytest.mark.parametrize("limit", [1.0, 0.25])
def test_the_fixed_flux_loop_follows_the_floating_one_with_the_same_numbers(limit: float) -> None:
    """Also at limits, and with wrong measured currents."""
    current_scale, flux_scale = 4.0, 1.0
    entries, wanted = words(table(), current_scale), words(densities(), flux_scale)
    loop = np.array([[20000, 0], [20000, -3], [20000, 0], [-30000, 1]], dtype=np.int16)
    factors = loop[:, 0] / 65536.0 * 2.0 ** loop[:, 1]
    across = current_scale / flux_scale
    exact = [factors[0] * across, factors[1] * across, factors[2], -factors[3]]
    fixed = FixedForceController.flux(entries, wanted, loop, 0, int(limit * (ONE - 1)))
    real = ForceController.flux(
        entries / 32768.0 * current_scale,
        wanted / 32768.0 * flux_scale,
        np.array(exact),
        0.0,
        1.0,
        0.0,
        1.0,
        0.0,
        limit * current_scale,
    )
    rng = np.random.default_rng(6)
    worst, limited = 0.0, 0
    # the mean of the demanded value, so that no signal exceeds full scale
    for demand, gap, density in rng.uniform([0.1, 0.1, 0.2], [0.7, 0.7, 0.8], (2000, 3)).tolist():
        code = fixed.solve(int(demand * ONE), int(gap * ONE), int(density * ONE))
        current = real.solve(demand, gap, density)
        worst = max(worst, abs(code / ONE * current_scale - current))
        limited += code == int(limit * (ONE - 1))
        fixed.commit(int(0.98 * code), int(gap * ONE))
        real.commit(0.98 * current, gap)
    # the loop is open, so that differences of the roots add up in the integrals
    assert worst < 1e-6 * current_scale
    assert (limited > 100) == (limit < 1.0)


# Refusals


def test_invalid_parameters_are_refused() -> None:
    falling = table()
    falling[2, 3] = falling[2, 4] + 0.1
    with pytest.raises(ValueError, match="not valid"):
        ForceController.map(falling, 0.0, FORCE, GAP_LOW, GAP_HIGH, LOW, HIGH)
    with pytest.raises(ValueError, match="not valid"):
        ForceController.map(table(), 0.0, FORCE, GAP_HIGH, GAP_LOW, LOW, HIGH)
    with pytest.raises(ValueError, match="not valid"):
        ForceControllerF32.map(table(), 0.0, 0.0, GAP_LOW, GAP_HIGH, LOW, HIGH)
    with pytest.raises(ValueError, match="not valid"):
        ForceController.map(table(), 0.0, FORCE, GAP_LOW, GAP_HIGH, HIGH, LOW)
    with pytest.raises(ValueError, match="2 to 65 rows"):
        ForceController.map(table(rows=1), 0.0, FORCE, GAP_LOW, GAP_HIGH, LOW, HIGH)
    for loop in ((NAN, 0.1, 0.2, 0.5), (0.5, 0.1, 1.2, 0.5), (0.5, 0.1, 0.2, 0.0)):
        with pytest.raises(ValueError, match="not valid"):
            of_flux(*loop)
    with pytest.raises(ValueError, match="2\\^n"):
        FixedForceController.map(words(table(rows=4), 4.0), 0, 1)
    with pytest.raises(ValueError, match="not valid"):
        FixedForceController.compensator("full", np.zeros(60, dtype=np.int16))
