"""Test the current limits of a position controller for any inputs."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst.support.kinds import NumberFormat
from anhyst.support.states import Command
from tests.control.levitating import CONTROL, FORMATS, PAIR, make

ANY = st.floats(allow_nan=True, allow_infinity=True)
GAPS = st.floats(0.32e-3, 0.58e-3) | ANY
SAMPLES = st.tuples(GAPS, GAPS, ANY, st.tuples(ANY, ANY), st.tuples(ANY, ANY), st.integers(0, 9))
QUICK = replace(
    CONTROL,
    limits=replace(CONTROL.limits, selftest=1, max_missing_samples=0, step=1e-3, current_low=-0.7, hold=2),
    levitation=replace(CONTROL.levitation, lift_rate=1e6, set_down_rate=1e6),
    converter=replace(CONTROL.converter, low=-1.0),
)


@pytest.mark.first(1)
@pytest.mark.parametrize("number_format", FORMATS)
@pytest.mark.parametrize("magnets", [1, 2])
@given(samples=st.lists(SAMPLES, min_size=1, max_size=30), measured=st.booleans())
@settings(max_examples=100)
def test_no_signal_leads_beyond_the_limits(
    number_format: NumberFormat, magnets: int, samples: list[tuple[float, ...]], measured: bool
) -> None:
    control = replace(QUICK, uses_measured_currents=measured)
    if magnets == 2:
        control = replace(control, pidd2=PAIR.pidd2, bias=PAIR.bias, gap_total=PAIR.gap_total)
    controller = make(number_format, control)
    step = control.converter.step
    rounding = 1e-6 if number_format == "f32" else 1e-8
    for begin in (0, Command.DEMAGNETISED, Command.LIFT):
        controller.tick(0.55e-3, 0.45e-3, command=begin)
    for gap, target, load, current, flux, command in samples:
        answer = controller.tick(gap, target, load, current, flux, command)  # type: ignore[arg-type]
        for driven in answer[:magnets]:
            assert -0.7 - rounding <= driven <= 4.5 + rounding
            steps = (driven + 1.0) / step
            assert abs(steps - round(steps)) < (0.05 if number_format == "f32" else 1e-3)
        assert all(math.isfinite(value) for value in answer[:4])
