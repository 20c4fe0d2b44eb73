"""Test the exchange with python-control: equal responses, and gains that survive a round trip."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst._core import Controller, FixedController
from anhyst.control import FullScales, Pidd2, design, from_control, to_control
from anhyst.support.numeric import FloatArray
from tests.refusals import refused

RATE = 20e3
GAINS = Pidd2(
    rate=RATE,
    **vars(design(2.0, 120.0, 1.0, virtual_mass=0.3)),
    K_load=-0.8,
    cutoff=2000.0,
    cutoff_2=1500.0,
    weight=0.3,
)
Row = FloatArray


def signals(n: int = 3000) -> tuple[Row, Row, Row]:
    """Return steps of the reference, a noisy oscillating position and a load; all begin at zero."""
    rng = np.random.default_rng(3)
    t = np.arange(n) / RATE
    reference = 20e-6 * np.sign(np.sin(2 * np.pi * 31 * t))
    position = 15e-6 * np.sin(2 * np.pi * 83 * t) + 10e-9 * rng.standard_normal(n)
    load = 20.0 * np.sin(2 * np.pi * 17 * t)
    position[0] = 0.0
    return reference, position, load


def by_python_control(controller: Pidd2, inputs: tuple[Row, Row, Row]) -> Row:
    transfer = to_control(controller)
    answers = [
        np.asarray(control.forced_response(transfer[0, j], inputs=row).outputs)
        for j, row in enumerate(inputs)
    ]
    return np.asarray(np.sum(answers, axis=0))


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"K_dd": 0.0},
        {"K_i": 0.0},
        {"cutoff": math.inf},
        {"cutoff_2": math.inf},
        {"cutoff": math.inf, "cutoff_2": math.inf},
        {"K_i": 0.0, "K_d": 0.0, "K_dd": 0.0},
        {"K_d": 0.0},
        {"weight": 0.0, "K_load": 0.0},
    ],
)
def test_the_core_agrees_with_python_control(changes: dict[str, float]) -> None:
    gains = replace(GAINS, **changes)
    inputs = signals()
    expected = by_python_control(gains, inputs)
    core = Controller(gains.per_tick)
    found = np.empty_like(expected)
    for i, tick in enumerate(zip(*(row.tolist() for row in inputs), strict=True)):
        found[i] = core.solve(*tick)
        core.commit(found[i])
    assert np.max(np.abs(expected)) > 10.0
    assert np.max(np.abs(found - expected)) < 1e-9 * np.max(np.abs(expected))


def test_a_wrong_gain_would_be_seen() -> None:
    inputs = signals()
    expected = by_python_control(GAINS, inputs)
    other = by_python_control(replace(GAINS, K_i=GAINS.K_i * (1.0 + 1e-6)), inputs)
    assert np.max(np.abs(other - expected)) > 1e-9 * np.max(np.abs(expected))


def test_fixed_point_agrees_with_python_control_for_its_words() -> None:
    scales = FullScales(position=0.4e-3, output=1024.0, load=200.0)
    fixed = GAINS.fixed(scales)
    full = (scales.position, scales.position, scales.load)
    codes = [np.round(row / one * 2**31).astype(int) for row, one in zip(signals(), full, strict=True)]
    inputs = tuple(row * (one / 2**31) for row, one in zip(codes, full, strict=True))
    transfer = to_control(fixed)
    expected = sum(
        np.asarray(control.forced_response(transfer[0, j], inputs=row).outputs)
        for j, row in enumerate(inputs)
    )
    core = FixedController(fixed.words)
    found = np.empty(len(codes[0]))
    for i, tick in enumerate(zip(*(row.tolist() for row in codes), strict=True)):
        output = core.solve(*tick)
        core.commit(output)
        found[i] = output * (scales.output / 2**31)
    assert np.max(np.abs(expected)) < scales.output  # no limit was reached
    # pidd2.h bounds the error of a solve by the rounding times the factors of the derivative, and
    # the drift of the integral by about one q30 per tick.
    factors = {name: m / 65536.0 * 2.0**s for name, (m, s) in fixed.factors.items()}
    bound = 5 + 2 * factors["proportional"] + 3 * factors["derivative"] + 8 * factors["second"]
    drift = (1.0 + factors["integral"]) * len(found) / 2**30
    assert np.max(np.abs(found - expected)) < scales.output * (bound / 2**28 + drift)


def test_the_transfer_function_has_signal_names_and_the_sampling_time() -> None:
    transfer = to_control(GAINS)
    assert transfer.input_labels == ["reference", "position", "load"]
    assert transfer.output_labels == ["demand"]
    assert transfer.dt == 1.0 / RATE


def test_the_static_gain_follows_from_the_gains() -> None:
    without = to_control(replace(GAINS, K_i=0.0))
    at_rest = [float(np.real(without[0, j](1.0))) for j in range(3)]
    assert at_rest == pytest.approx([0.3 * GAINS.K_p, -GAINS.K_p, -0.8])


ranges = st.fixed_dictionaries(
    {
        "K_p": st.floats(1e3, 1e7),
        "K_i": st.sampled_from([0.0, 1e6, 3e8]),
        "K_d": st.sampled_from([0.0, 300.0, 5e3]),
        "K_dd": st.sampled_from([0.0, 0.1, 2.0]),
        "K_load": st.sampled_from([0.0, -0.8]),
        "cutoff": st.sampled_from([300.0, 2000.0, 5000.0, math.inf]),
        "cutoff_2": st.sampled_from([200.0, 2000.0, 4000.0, math.inf]),
        "weight": st.sampled_from([0.0, 0.3, 1.0]),
    }
)


@pytest.mark.slow
@settings(max_examples=60)
@given(ranges)
def test_gains_survive_a_round_trip_through_python_control(values: dict[str, float]) -> None:
    gains = Pidd2(rate=RATE, **values)
    back = from_control(to_control(gains), RATE)
    z = np.exp(2j * np.pi * np.array([1.0, 30.0, 400.0, 5e3, 9e3]) / RATE)
    for j in range(3):
        before, after = to_control(gains)[0, j](z), to_control(back)[0, j](z)
        assert after == pytest.approx(before, rel=1e-6, abs=1e-6)
    assert [back.K_p, back.K_i, back.weight] == pytest.approx(
        [gains.K_p, gains.K_i, gains.weight], rel=1e-6, abs=1e-8
    )
    if gains.K_dd == 0.0 or gains.cutoff >= gains.cutoff_2:
        assert [back.K_d, back.K_dd] == pytest.approx([gains.K_d, gains.K_dd], rel=1e-5, abs=1e-6)


def test_a_controller_of_one_input_is_read_with_a_given_weight() -> None:
    tick = 1.0 / RATE
    z = control.TransferFunction([1.0, 0.0], [1.0], tick)
    pid = 3e6 + 8e8 * tick / (z - 1) + 4e3 * (z - 1) / tick / z
    back = from_control(pid, RATE, weight=0.25)
    assert (back.K_p, back.K_i, back.K_d) == pytest.approx((3e6, 8e8, 4e3))
    assert (back.K_dd, back.cutoff, back.weight) == (0.0, math.inf, 0.25)


def _function(num: list[float], den: list[float], tick: float = 1.0 / RATE) -> object:
    return control.TransferFunction(num, den, tick)


@pytest.mark.parametrize(
    ("transfer", "reported"),
    [
        (control.TransferFunction([1.0], [1.0, 1.0]), "not-discrete"),
        (_function([1.0], [1.0, -1.0], 1e-3), "tick-differs: 0.001 s"),
        (_function([1.0], [1.0, -1.0, 0.5]), "complex-poles"),
        (_function([1.0], [1.0, -1.2]), "poles-out-of-range: 1.2"),
        (_function([1.0], [1.0, 0.4]), "poles-out-of-range: -0.4"),
        (_function([1.0], np.poly([1.0, 1.0, 0.3]).tolist()), "too-many-poles"),
        (_function([1.0], np.poly([1.0, 0.1, 0.2, 0.3]).tolist()), "too-many-poles"),
        (_function([1.0, 0.0, 0.0], [1.0, -1.0]), "looks-ahead"),
        (_function([-1.0, 2.0], [1.0, -1.0]), "gain-signs-differ K_i"),
        (to_control(GAINS)[0, :2], "signals-wrong"),
    ],
)
def test_a_transfer_function_that_is_not_a_pidd2_is_refused(transfer: object, reported: str) -> None:
    with refused(reported):
        from_control(transfer, RATE)


def test_a_reference_that_passes_otherwise_is_refused() -> None:
    good = to_control(GAINS)
    num = [[np.array(row) for row in good.num[0]]]
    den = [[np.array(row) for row in good.den[0]]]
    num[0][0] = num[0][0] * 1.5
    with refused("not-a-pidd2 reference"):
        from_control(control.TransferFunction(num, den, dt=1.0 / RATE), RATE)


def test_without_python_control_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with refused("not-installed control"):
        to_control(GAINS)
