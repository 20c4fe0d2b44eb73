"""Test PIDD2: the core against textbook equations, and fixed point against double precision."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from anhyst._core import Controller, ControllerF32, FixedController
from anhyst.control import FullScales, Pidd2
from anhyst.support.errors import InputError
from tests.control.pidd2_oracle import respond
from tests.refusals import refused

SCALES = FullScales(position=0.5e-3, output=400.0, load=200.0)
GAINS = Pidd2(
    rate=10e3, K_p=6e5, K_i=2e7, K_d=900.0, K_dd=0.12, K_load=-0.8, cutoff=1500.0, cutoff_2=1000.0, weight=0.7
)
Q28, Q30, Q31 = 2.0**28, 2.0**30, 2.0**31
LOW, HIGH = -(2**31), 2**31 - 1


Rows = tuple[NDArray[Any], ...]


def record(n: int = 4000, size: float = 0.2) -> Rows:
    """Return reference, position and load as q31: steps, sines and sensor noise."""
    rng = np.random.default_rng(7)
    t = np.arange(n) / GAINS.rate
    reference = size * np.sign(np.sin(2 * np.pi * 11 * t))
    position = size * (0.8 * np.sin(2 * np.pi * 23 * t) + 2e-4 * rng.standard_normal(n))
    load = 0.5 * np.sin(2 * np.pi * 5 * t)
    return tuple(np.round(x * Q31).astype(np.int64) for x in (reference, position, load))


def physical(rows: Rows) -> list[NDArray[Any]]:
    scales = (SCALES.position, SCALES.position, SCALES.load)
    return [row * (scale / Q31) for row, scale in zip(rows, scales, strict=True)]


@pytest.mark.parametrize("kind", [Controller, ControllerF32])
def test_core_follows_the_textbook_in_floating_point(kind: type[Controller]) -> None:
    gains = replace(GAINS, low=-120.0, high=150.0)
    rows = physical(record())
    expected, _ = respond(gains, *rows)
    controller = kind(gains.per_tick)
    controller.start(rows[1][0], rows[1][0], 0.0, gains.K_p * (gains.weight - 1) * rows[1][0])
    found = np.empty_like(expected)
    for i, signals in enumerate(zip(*rows, strict=True)):
        found[i] = controller.solve(*signals)
        controller.commit(found[i])
    assert np.ptp(expected) == pytest.approx(270.0)
    # Second differences of a position amplify its rounding by K_dd/T^2.
    eps = 2.3e-16 if kind is Controller else 1.2e-7
    bound = eps * 40 * GAINS.K_dd * GAINS.rate**2 * np.max(np.abs(rows[1])) + 100 * eps * 400
    assert np.max(np.abs(found - expected)) < bound


def test_derivatives_have_the_transfer_functions_they_should() -> None:
    tick = 1.0 / GAINS.rate
    rows = physical(record())
    y = rows[1] - rows[1][0]
    keep = math.exp(-2 * math.pi * GAINS.cutoff * tick)
    keep_2 = math.exp(-2 * math.pi * GAINS.cutoff_2 * tick)
    first = signal.lfilter([1 - keep, keep - 1], [tick, -keep * tick], y)
    second = signal.lfilter([1 - keep_2, keep_2 - 1], [tick, -keep_2 * tick], first)
    integral = signal.lfilter([0.0, tick], [1.0, -1.0], -y)
    loads = np.zeros_like(y)
    for name, answer in (("K_d", -first), ("K_dd", -second), ("K_p", -y), ("K_i", integral)):
        alone = Pidd2(rate=GAINS.rate, cutoff=1500.0, cutoff_2=1000.0, **{"K_p": 0.0, name: 1.0})
        found, _ = respond(alone, loads, y, loads)
        assert np.allclose(found, answer, rtol=1e-9, atol=1e-9 * np.max(np.abs(answer)))


def test_fixed_point_stays_within_its_stated_bound() -> None:
    fixed = GAINS.fixed(SCALES)
    rows = record()
    core = FixedController(fixed.words)
    exact = Controller(fixed.per_tick)
    core.start(0, int(rows[1][0]), 0, 0)
    exact.start(0.0, float(physical(rows)[1][0]), 0.0, 0.0)
    size = {name: abs(m) / 65536 * 2.0**s for name, (m, s) in fixed.factors.items()}
    bound = 5 + 2 * size["proportional"] + 3 * size["derivative"] + 8 * size["second"]
    worst = 0.0
    values = np.column_stack(physical(rows))
    for i, words in enumerate(zip(*rows, strict=True)):
        core.commit(core.solve(*map(int, words)))
        exact.commit(exact.solve(*values[i]))
        error = abs(core.wanted - exact.wanted / SCALES.output * Q28)
        fallen_behind = (i + 1) * (1 + size["integral"]) / 4
        assert error <= bound + fallen_behind
        worst = max(worst, error)
    assert worst > 1  # otherwise there was no rounding
    assert (bound + fallen_behind) / Q28 < 2e-4


def test_words_are_near_the_gains() -> None:
    wanted, got = GAINS.per_tick, GAINS.fixed(SCALES).per_tick
    assert np.allclose(got[:9], wanted[:9], rtol=1e-3)
    assert got[8] == pytest.approx(GAINS.weight, abs=2e-5)
    exact = replace(GAINS, cutoff=math.inf, weight=0.0, low=-400.0, high=200.0).fixed(SCALES)
    assert exact.factors["smoothing"] == (-32768, 1)
    assert (exact.unweighted, exact.low, exact.high) == (-32768, LOW, 2**30)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"K_dd": 5000.0}, "too-large-for-fixed-point second"),
        ({"K_load": 1e-9}, "too-small-for-fixed-point load"),
        ({"cutoff": 0.5}, "too-small-for-fixed-point cutoff"),
        ({"high": 500.0}, "beyond-full-scale high: 500.0 N"),
    ],
)
def test_gains_that_do_not_fit_are_refused(change: dict[str, float], text: str) -> None:
    with refused(text):
        replace(GAINS, **change).fixed(SCALES)


@pytest.mark.parametrize(
    "change", [{"rate": 0.0}, {"K_i": -1.0}, {"weight": 1.1}, {"cutoff_2": math.nan}, {"low": 2, "high": 1}]
)
def test_gains_without_a_meaning_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(InputError):
        replace(GAINS, **change)


def test_core_refuses_gains_out_of_range() -> None:
    words = replace(GAINS, low=-100.0).fixed(SCALES).words
    for place, wrong in ((1, 17), (1, -16), (12, 5), (16, 1), (18, LOW)):
        broken = words.copy()
        broken[place] = wrong
        with pytest.raises(ValueError, match="out of its range"):
            FixedController(broken)


def ticks_at_the_limit(gains: Pidd2) -> int:
    """Hold an error against a limited output for a second, reverse it, and count the ticks."""
    core = FixedController(replace(gains, low=-100.0, high=100.0, K_dd=0.0).fixed(SCALES).words)
    core.start(0, 0, 0, 0)
    far = int(0.4 * Q31)
    for _ in range(10_000):
        core.commit(core.solve(far, 0, 0))
    assert core.solve(far, 0, 0) == 2**29
    ticks = 0
    while core.solve(-far, 0, 0) == 2**29 and ticks < 1000:
        core.commit(2**29)
        ticks += 1
    return ticks


def test_integral_does_not_wind_up() -> None:
    assert ticks_at_the_limit(GAINS) == 0
    assert ticks_at_the_limit(replace(GAINS, tracking=10.0)) > 100


def test_the_integral_follows_a_limit_outside_the_controller() -> None:
    core = FixedController(GAINS.fixed(SCALES).words)
    core.start(0, 0, 0, 0)
    for _ in range(10_000):
        core.commit(min(core.solve(2**28, 0, 0), 2**27))
    # When the integral is at rest, the anti-windup correction equals the contribution of the error.
    fixed = GAINS.fixed(SCALES).per_tick
    at_rest = 2**24 + fixed[1] / fixed[5] * 2**28 / Q31 * SCALES.position / SCALES.output * Q28
    assert core.wanted == pytest.approx(at_rest, rel=1e-5)


def test_change_of_gains_does_not_move_the_output() -> None:
    rows = record(600)
    other = replace(GAINS, K_p=3e5, K_i=6e6, K_d=400.0, K_dd=0.05, cutoff=700.0, weight=0.3)
    core = FixedController(GAINS.fixed(SCALES).words)
    core.start(0, 0, 0, 0)
    for signals in zip(*rows, strict=True):
        core.commit(core.solve(*map(int, signals)))
    now = [int(row[-1]) for row in rows]
    core.solve(*now)
    before = core.wanted
    core.change(other.fixed(SCALES).words, *now)
    core.solve(*now)
    assert core.wanted == before
    core.change(GAINS.fixed(SCALES).words, *now)
    core.solve(*now)
    assert core.wanted == before


def test_start_takes_over_a_given_output() -> None:
    core = FixedController(GAINS.fixed(SCALES).words)
    core.start(2**27, 2**26, -(2**28), 2**29)
    assert core.solve(2**27, 2**26, -(2**28)) == 2**29


def test_nothing_wraps_at_the_ends_of_the_formats() -> None:
    """At the ends of the formats, the output follows the demand and never changes its sign."""
    strong = replace(GAINS, K_p=6e7, K_i=3e9, K_d=9e4, K_dd=0.0, K_load=0.0, weight=1.0)
    core = FixedController(strong.fixed(SCALES).words)
    core.start(0, 0, 0, 0)
    for i in range(2000):
        upwards = i // 100 % 2 == 0
        reference, position = (HIGH, LOW) if upwards else (LOW, HIGH)
        output = core.solve(reference, position, 0)
        core.commit(output)
        # The derivative acts against the jump; after some ticks, position and integral dominate.
        if i % 100 > 20:
            assert output == (HIGH if upwards else LOW)
        assert all(LOW <= word <= HIGH for word in core.state)
