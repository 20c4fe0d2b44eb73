"""Compare pose, PIDs and allocation in fixed point with double precision on random bodies."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from anhyst._core import FixedAxes, FixedWrench, TrackingAxes, WrenchLayout
from anhyst.compensate.force_controller import ForceController
from anhyst.control.fixed_axes import (
    DriveLayout,
    FixedController,
    encode_signals,
    make_feedforward_rows,
    make_fixed_allocation,
    make_fixed_controller,
)
from anhyst.control.position import Allocation
from anhyst.support.numeric import FloatArray
from tests.compilation.test_compile_stage import single
from tests.refusals import refused

FULL = 2.0**31
FORCE, LEAST, MOST = 250.0, 0.5, 240.0
UNIT = 8.0 * FORCE / FULL
"""LSB of the internal force format, N."""


def drawn(rng: np.random.Generator) -> DriveLayout | None:
    """Return random drives, some in pairs, or None if they do not act well on all axes."""
    axes, count = int(rng.integers(1, 7)), int(rng.integers(2, 15))
    pull = rng.uniform(-1.0, 1.0, (count, axes))
    against = list(range(count))
    for first in range(0, 2 * int(rng.integers(0, count // 2 + 1)), 2):
        against[first], against[first + 1] = first + 1, first
        pull[first + 1] = -pull[first]
    units = pull[[one for one in range(count) if against[one] >= one]]
    if len(units) < axes or np.linalg.cond(units) > 30.0:
        return None
    yields = rng.choice([1e-2, 5e-3, 1e-3, 1e-4], axes).tolist()
    return DriveLayout(pull, against, yields, Allocation.CLASS_AB, 5.0, LEAST, MOST)


def bodies(count: int, seed: int) -> list[DriveLayout]:
    rng = np.random.default_rng(seed)
    found: list[DriveLayout] = []
    while len(found) < count:
        one = drawn(rng)
        if one is not None:
            found.append(one)
    return found


class Shared(NamedTuple):
    """Forces for one wrench in both formats."""

    force: FloatArray  # N, in fixed point
    wide: FloatArray  # N, in double precision
    made: bool
    wide_made: bool


def share(one: DriveLayout, wrench: FloatArray, lost: list[int]) -> list[Shared]:
    """Allocate rows of wrenches without the lost drives."""
    full = np.full(len(one.drop_weights), 4096.0)
    fixed = FixedWrench(*make_fixed_allocation(one, full, FORCE))
    wide = WrenchLayout(
        np.ascontiguousarray(one.unit_wrench), one.opponents, one.allocation, one.idle_force,
        one.force_min, one.force_max, yields=one.drop_weights,
    )  # fmt: skip
    for drive in lost:
        fixed.lose(drive)
        wide.lose(drive)
    found = []
    for row in wrench:
        given = encode_signals(row, full).astype(int).tolist()
        force, made = fixed.share(given)
        forces, wide_made = wide.share((np.array(given) / FULL * full).tolist())
        found.append(Shared(np.array(force) / FULL * FORCE, np.array(forces), made, wide_made))
    return found


def missed(one: DriveLayout, shared: Shared, wrench: FloatArray) -> float:
    """Return the largest component of the difference between requested and produced wrench, N."""
    return float(np.abs(shared.force @ one.unit_wrench - wrench).max())


def test_the_reported_wrench_agrees_with_double_precision() -> None:
    rng, agreed, worst, off = np.random.default_rng(3), 0, 0.0, 0.0
    for body in bodies(200, 11):
        wrench = rng.uniform(0.0, 60.0, (12, len(body.unit_wrench))) @ body.unit_wrench
        wrench = encode_signals(wrench, 4096.0) / FULL * 4096.0
        for row, shared in zip(wrench, share(body, wrench, []), strict=True):
            alone = [k for k, opponent in enumerate(body.opponents) if k == opponent]
            assert (shared.force[alone] >= LEAST - 2e-7).all()
            assert (shared.force >= 0.0).all()
            if shared.made and shared.force.max() < FORCE * 0.999:
                worst = max(worst, missed(body, shared, row))
            if shared.made and shared.wide_made and shared.wide.max() < FORCE:
                off = max(off, float(np.abs(shared.force - shared.wide).max()))
            agreed += shared.made == shared.wide_made
    assert worst < 2e-4, "N: 200 units, of up to 240 N"
    assert off < 2e-4
    assert agreed > 0.998 * 2400


def test_fixed_point_with_lost_drives_makes_the_wrench_of_double_precision() -> None:
    rng, differ, count = np.random.default_rng(4), [], 0
    for body in bodies(150, 12):
        lost = rng.choice(len(body.unit_wrench), int(rng.integers(1, 3)), replace=False).tolist()
        wrench = rng.uniform(0.0, 60.0, (8, len(body.unit_wrench))) @ body.unit_wrench
        for row, shared in zip(wrench, share(body, wrench, lost), strict=True):
            assert not shared.force[lost].any()
            assert (shared.force <= FORCE).all()
            alone = [
                k for k, opponent in enumerate(body.opponents)
                if k not in lost and (opponent == k or opponent in lost)
            ]  # fmt: skip
            assert (shared.force[alone] >= LEAST - 2e-7).all()
            if shared.made:
                assert missed(body, shared, row) < 2e-4
            both = [float(np.abs(x @ body.unit_wrench - row).max()) for x in (shared.force, shared.wide)]
            differ.append(both[0] - both[1])
            count += shared.made == shared.wide_made
    assert count > 0.99 * len(differ)
    assert np.mean(np.abs(differ) < 0.05) > 0.98, "N, of what is missed"


class Body(NamedTuple):
    """Parameters of a controller for a random body in both formats."""

    rows: dict[str, FloatArray]
    drives: DriveLayout
    settings: dict[str, float]


@cache
def magnet() -> tuple[ForceController, dict[str, float]]:
    """Return a magnet with a curve without memory, and the controller settings for it."""
    made = single(False, "single-valued", "fixed").compensator
    scales = made.scales
    given = {
        "demand_full": scales.demand,
        "current_full": scales.current,
        "gap_low": scales.gap_low,
        "gap_high": scales.gap_high,
        "idle": 5.0,
        "current_low": 0.0,
        "current_high": 4.5,
        "current_step": 4.5 / 2**18,
    }
    return made, given


def pid_of(crossover: float, rate: float) -> list[float]:
    """Return a PID with lead and roll-off for unit mass, discretised by the trapezoidal rule."""
    omega, fast = 2.0 * math.pi * crossover, 2.0 * rate
    low, lead, high = omega / 10.0, omega / 3.0, 6.0 * omega
    up = (1.0 / lead, 1.0 + low / lead, low)
    down = (1.0 / high, 1.0, 0.0)

    def z(p: tuple[float, float, float]) -> tuple[float, float, float]:
        a, b, c = p[0] * fast**2, p[1] * fast, p[2]
        return a + b + c, 2.0 * (c - a), a - b + c

    numerator, denominator = z(up), z(down)
    gain = omega**2 / 3.0 / denominator[0]
    return [*(gain * one for one in numerator), *(one / denominator[0] for one in denominator[1:])]


def body(one: DriveLayout, rng: np.random.Generator) -> Body:
    """Return a body of random mass and centre, with at least one sensor head per coordinate."""
    axes = len(one.drop_weights)
    at = np.vstack([np.eye(axes), rng.uniform(-1.0, 1.0, (int(rng.integers(0, 4)), axes))])
    apart = np.eye(axes) + np.triu(rng.uniform(-0.01, 0.01, (axes, axes)), 1)
    heads, reach = len(at), rng.uniform(1e-4, 4e-4, (axes, 1))
    mass = np.diag(rng.uniform(0.5, 40.0, axes))
    rows = {
        "at": at,
        "see": np.linalg.pinv(at),
        "without": np.zeros((heads * axes, heads)),
        "decouple": apart,
        "weigh": apart.T @ mass,
        "pid": np.array([pid_of(float(rng.uniform(40.0, 400.0)), 20e3)] * axes),
        "reach": reach,
        "lift": 1e-3 * reach,
        "land": -1e-3 * reach,
    }
    _, given = magnet()
    watched = {"follow": 0.5, "slew": 0.1, "off": 0.0, "jump": 0.0, "off_ticks": 5, "spare": 0}
    watched |= {"land_ticks": 100, "spare_heads": 0, "doubt": 40, "noisy": 1}
    return Body(rows, one, given | watched)


def controllers(made: Body) -> tuple[FixedController, FixedAxes, TrackingAxes]:
    force, _ = magnet()
    fixed = make_fixed_controller(made.rows, made.drives, made.settings)
    drives, count = made.drives, len(made.drives.unit_wrench)
    own = fixed.make_core([force.reset_copy().native for _ in range(count)], 2.0)
    layout = WrenchLayout(
        np.ascontiguousarray(drives.unit_wrench), drives.opponents, drives.allocation, drives.idle_force,
        drives.force_min, drives.force_max, yields=drives.drop_weights,
    )  # fmt: skip
    settings = {key: value for key, value in made.settings.items() if key != "idle"}
    full = {"flux_full": 2.0}
    wide = TrackingAxes(
        [force.reset_copy().native for _ in range(count)],
        layout,
        made.rows | {"ground": np.zeros(0)},
        settings | full,
    )
    return fixed, own, wide


def test_the_wrench_of_any_body_is_that_of_double_precision() -> None:
    """Heads read up to 10 nm for 25 ticks; the limit is 2^-20 of full scale."""
    rng, worst = np.random.default_rng(5), 0.0
    for one in bodies(30, 13):
        made = body(one, rng)
        fixed, own, wide = controllers(made)
        scales, count = fixed.scales, len(one.unit_wrench)
        gap, read = [0] * count, [0] * count
        for _ in range(25):
            head = encode_signals(rng.uniform(-1e-8, 1e-8, len(made.rows["at"])), scales.head)
            forward = encode_signals(0.05 * scales.wrench, scales.wrench)
            _, demand, *_ = own.tick(head.astype(int).tolist(), forward.astype(int).tolist(), gap, read)
            _, expected, *_ = wide.tick(
                (head / FULL * scales.head).tolist(),
                (forward / FULL * scales.wrench).tolist(),
                [made.settings["gap_low"]] * count,
                [0.0] * count,
            )
            error = np.abs(np.array(demand) / FULL - np.array(expected) / scales.wrench)
            worst = max(worst, float(error.max()))
    assert 0.0 < worst < 2.0**-20


def test_unusable_sensor_heads_are_flagged_and_full_scale_saturates() -> None:
    made = body(bodies(1, 14)[0], np.random.default_rng(6))
    fixed, own, _ = controllers(made)
    count, axes, heads = (len(made.drives.unit_wrench), len(made.drives.drop_weights), len(made.rows["at"]))
    none, largest = [0] * count, int(FULL) - 1
    current, demand, flags, _, _ = own.tick([0] * heads, [largest] * axes, none, none)
    assert demand == [largest] * axes
    assert flags & 1
    low, high = fixed.integers["current_low"], fixed.integers["current_high"]
    assert all(low <= one <= high for one in current)
    for wrong in (largest, -largest, -int(FULL)):
        _, held, flags, _, _ = own.tick([wrong] * heads, [0] * axes, none, none)
        assert flags & 8
        assert held == [0] * axes


def test_feedforward_is_the_wrench_of_mass_and_weight() -> None:
    fixed, _, _ = controllers(body(bodies(1, 15)[0], np.random.default_rng(7)))
    scales, axes = fixed.scales, len(fixed.scales.wrench)
    mass = np.diag(np.full(axes, 3.0))
    weight = np.arange(axes, dtype=np.float64) - 2.0
    numbers, shifts, carried = make_feedforward_rows(mass, weight, scales)
    acceleration = encode_signals(np.full(axes, 0.25) * scales.acceleration, scales.acceleration)
    moved = (numbers @ acceleration) / 2.0 ** shifts[:, 0]
    np.testing.assert_allclose(
        (moved - carried) / FULL * scales.wrench,
        0.75 * scales.acceleration - weight,
        atol=1e-6 * scales.wrench.max(),
    )


@pytest.mark.parametrize(("crossover", "code"), [(1e-3, "small"), (2e4, "large")])
def test_gains_beyond_32_bits_are_refused(crossover: float, code: str) -> None:
    made = body(bodies(1, 16)[0], np.random.default_rng(8))
    rows = made.rows | {"pid": np.array([pid_of(crossover, 20e3)] * len(made.drives.drop_weights))}
    if code == "large":
        rows["pid"][:, :3] *= 1e9
    key = "control.integral_ratio" if code == "small" else "control.crossover_Hz"
    with refused(f"too-{code}-for-fixed-point {key}"):
        make_fixed_controller(rows, made.drives, made.settings)
