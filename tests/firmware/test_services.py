"""Test calibration and I^2 t of the firmware against exact and double-precision arithmetic."""

from __future__ import annotations

import ctypes
import subprocess
from fractions import Fraction
from math import floor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.once import made_once

from .build import ROOT, tool

NO_VALUE, MAX_VALUE = -(2**31), 2**31 - 1
CODES = st.integers(NO_VALUE, MAX_VALUE)


class Calibration(ctypes.Structure):
    """The C structure of calibration.h."""

    _fields_ = tuple((name, ctypes.c_int32) for name in ("zero", "mantissa", "shift", "low", "high"))


class Plan(ctypes.Structure):
    """The C structure of thermal.h."""

    _fields_ = (
        ("mantissa", ctypes.c_uint32),
        ("shift", ctypes.c_uint16),
        ("trips", ctypes.c_uint64),
        ("clears", ctypes.c_uint64),
    )


class Thermal(ctypes.Structure):
    """The C structure of thermal.h."""

    _fields_ = (("warmth", ctypes.c_uint64), ("tripped", ctypes.c_int))


@pytest.fixture(scope="module")
def services(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """Build the services as a library of this machine."""

    def build(folder: Path) -> None:
        sources = [f"{ROOT}/firmware/services/{name}.c" for name in ("calibration", "thermal")]
        options = ["-std=c99", "-O1", "-shared", "-fPIC", f"-I{ROOT / 'firmware'}"]
        command = [tool("cc", "gcc"), *options, *sources, "-o", str(folder / "services.so")]
        subprocess.run(command, check=True)

    library = ctypes.CDLL(str(made_once(tmp_path_factory, "services", build) / "services.so"))
    library.calibration_value.restype = ctypes.c_int32
    library.thermal_prepare.argtypes = [ctypes.c_void_p, ctypes.c_uint32, *[ctypes.c_int32] * 2]
    return library


@given(CODES, CODES, st.integers(-(2**30), 2**30).filter(bool), st.integers(0, 46))
def test_a_value_is_the_nearest_to_the_exact_one(
    services: ctypes.CDLL, code: int, zero: int, mantissa: int, shift: int
) -> None:
    line = Calibration(zero, mantissa, shift, NO_VALUE, MAX_VALUE)
    assert services.calibration_is_valid(ctypes.byref(line)) == 1
    exact = Fraction((code - zero) * mantissa, 2**shift)
    nearest = floor(exact + Fraction(1, 2)) if shift else int(exact)
    found = services.calibration_value(ctypes.byref(line), ctypes.c_int32(code))
    assert found == min(max(nearest, -MAX_VALUE), MAX_VALUE)


@given(CODES, CODES, CODES)
def test_a_code_beyond_its_ends_is_no_value(services: ctypes.CDLL, code: int, low: int, high: int) -> None:
    line = Calibration(0, 1, 0, low, high)
    found = services.calibration_value(ctypes.byref(line), ctypes.c_int32(code))
    assert (found == NO_VALUE) == (not low <= code <= high or code == NO_VALUE) or found == -MAX_VALUE


@pytest.mark.parametrize("ticks", [2, 3, 977, 20_000, 2_400_000])
def test_warmth_follows_the_square_of_the_current(services: ctypes.CDLL, ticks: int) -> None:
    """Compare 20,000 ticks with double precision; the longest constant is 2 minutes at 20 kHz."""
    plan, state = Plan(), Thermal()
    assert services.thermal_prepare(ctypes.byref(plan), ticks, 2**29, 2**28) == 1
    assert plan.mantissa / 2.0 ** (30 + plan.shift) == pytest.approx(1.0 / ticks, rel=2.0**-28)
    services.thermal_start(ctypes.byref(state), ctypes.byref(plan))
    rng = np.random.default_rng(ticks)
    level = np.repeat(rng.integers(NO_VALUE, MAX_VALUE, 40, endpoint=True), 500)
    warmth, tripped = 0.25**2, False
    for current in level.tolist():
        found = services.thermal_tick(ctypes.byref(state), ctypes.byref(plan), current)
        warmth += ((current / 2.0**30) ** 2 - warmth) / ticks
        tripped = warmth > 0.25 or (tripped and warmth >= 0.0625)
        assert state.warmth / 2.0**60 == pytest.approx(warmth, abs=4e-9)
        assert bool(found) == tripped
