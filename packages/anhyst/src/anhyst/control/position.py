"""Define the position controller of a levitated armature, and its numbers for the C core.

The settings are in SI units. ``core/include/anhyst/control/position.h`` runs the controller in
fixed point, and ``position_real.h`` in floating point; ``levitation.h`` describes the sequence of
lift-off and landing. `PositionControl` converts the settings to a number format and returns a
dictionary. The classes ``Position``, ``PositionF32`` and ``FixedPosition`` of the core accept this
dictionary together with the gains and the compensators.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from anhyst.control.pidd2 import FullScales, Pidd2
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError, wrong_key
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray, to_factor, to_q31

Settings = Mapping[str, float]

_Q31 = 2.0**31
# The full scale exceeds the range of possible positions, so that implausible positions are
# detected.
_POSITION_RANGE_SHARE = 0.625
_MIN_STEP_CODES = 500  # codes per step of the converter; its rounding error is then below 0.1 %


@dataclass(frozen=True)
class PositionLimits:
    """Limits of a position controller that do not depend on its gains."""

    gap_low: float  # range of possible gaps, m
    gap_high: float
    step: float  # largest change of the gap per tick, m
    current_low: float  # range of the amplifiers' references, A; it must include zero
    current_high: float
    release: float  # rate at which a current decreases to zero when no controller is active, A/s
    # number of consecutive missing or implausible samples that are replaced by the last one
    max_missing_samples: int
    hold: int  # number of ticks of constant current if the position is lost during levitation
    selftest: int = 20  # consecutive plausible samples for a passed self-test

    def __post_init__(self) -> None:
        _check_above_zero(self, "step", "release", "selftest")
        for name in ("max_missing_samples", "hold", "selftest"):
            if not 0 <= getattr(self, name) <= 65535:
                text = f"{getattr(self, name)} ticks are not within 0..65535"
                raise wrong_key(name, text, code="out-of-range")
        if not 0.0 <= self.gap_low < self.gap_high:
            raise wrong_key("gap_low", "must be below gap_high, and not below zero", code="range-reversed")
        if not self.current_low <= 0.0 < self.current_high:
            text = "zero must lie within the limits of the current"
            raise wrong_key("current_low", text, code="zero-outside-range")


@dataclass(frozen=True)
class Levitation:
    """Speeds and force rates of lift-off and landing."""

    detect: float  # distance from the rest position that counts as lift-off, m
    rise_speed: float  # speed of the reference, m/s
    descend_speed: float
    lift_rate: float  # rate of the force before lift-off and after landing, N/s
    set_down_rate: float

    def __post_init__(self) -> None:
        _check_above_zero(self, *(field.name for field in fields(self)))


@dataclass(frozen=True)
class ReferenceConverter:
    """Digital-to-analogue converter of the current references to the amplifiers."""

    low: float  # range, A
    high: float
    bits: int  # number of bits of the converter

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            text = "the lower end of a converter must be below its upper end"
            raise InputError(text, code="range-reversed", key="low")
        if not 1 <= self.bits <= 20:
            raise wrong_key("bits", f"{self.bits} of a converter are not within 1..20", code="out-of-range")

    @property
    def step(self) -> float:
        """Difference between two adjacent currents, A."""
        return (self.high - self.low) / float(2**self.bits - 1)

    def steps_within(self, low: float, high: float) -> tuple[float, int]:
        """Return the first current within a range, A, and the number of converter steps from it."""
        first = math.ceil((max(low, self.low) - self.low) / self.step - 1e-6)
        last = math.floor((min(high, self.high) - self.low) / self.step + 1e-6)
        if last <= first:
            text = "the limits contain no step of the converter; widen them"
            raise wrong_key("current_high", text, code="range-too-narrow")
        return self.low + first * self.step, last - first


@dataclass(frozen=True)
class PositionControl:
    """Position controller in SI units."""

    pidd2: Pidd2  # gains and sample rate; its output is the net force
    levitation: Levitation
    limits: PositionLimits
    converter: ReferenceConverter
    scales: Scales  # full scales of the compensators, which are equal for both magnets of a pair
    bias: float = 0.0  # force of each magnet of a pair at zero net force, N
    gap_total: float | None = None  # sum of both gaps of a pair, m; None: a single magnet
    # whether measured currents are committed instead of the demanded ones
    uses_measured_currents: bool = False
    flux_full_scale: float = 1.0  # flux density that 1.0 represents in fixed point, T
    load_full_scale: float = 1.0  # feedforward load that 1.0 represents, in its unit

    def __post_init__(self) -> None:
        if not 0.0 <= self.bias <= self.scales.demand:
            text = f"{self.bias} N is not within 0..{self.scales.demand} N"
            raise wrong_key("bias", text, code="out-of-range")
        if not 0.0 < self.pidd2.high < math.inf:
            text = "the largest force must be above zero to lift anything"
            raise wrong_key("high", text, code="not-above-zero")

    @property
    def final_landing_force(self) -> float:
        """Net force at which a landing ends, N; the other magnet of a pair then holds the armature.

        Without this force, nothing would hold the armature, because both currents decrease at the
        same rate and the first is larger.
        """
        return min(0.0, max(self.pidd2.low, -2.0 * self.bias))

    @property
    def gap_middle(self) -> float:
        """Gap at position zero, m."""
        return 0.5 * (self.limits.gap_low + self.limits.gap_high)

    @property
    def position_full(self) -> float:
        """Full scale of the position, m; it exceeds the range of possible gaps on both sides."""
        return _POSITION_RANGE_SHARE * (self.limits.gap_high - self.limits.gap_low)

    def gains(self, number_format: NumberFormat) -> FloatArray | NDArray[np.int32]:
        """Return the gains in the order of the core."""
        if number_format != "fixed":
            return self.pidd2.per_tick
        scales = FullScales(self.position_full, self.scales.demand, self.load_full_scale)
        return self.pidd2.fixed(scales).words

    def settings(self, number_format: NumberFormat) -> Settings:
        """Return all other settings of the core by name."""
        common = self._levitation_settings() | {
            "measured": self.uses_measured_currents,
            "gap_middle": self.gap_middle,
            "position_full": self.position_full,
            "demand_full": self.scales.demand,
        }
        return common | (self._fixed_settings() if number_format == "fixed" else self._real_settings())

    def _levitation_settings(self) -> dict[str, int]:
        """Return the integer settings of every format: positions and demands as q31."""
        tick, limits, levitation = self.pidd2.tick, self.limits, self.levitation

        middle_gap, position_full, force_full = (self.gap_middle, self.position_full, self.scales.demand)
        return {
            "position_low": to_q31((middle_gap - limits.gap_high) / position_full),
            "position_high": to_q31((middle_gap - limits.gap_low) / position_full),
            "position_step": _nonzero_code("step", limits.step / position_full),
            "max_missing_samples": limits.max_missing_samples,
            "hold": limits.hold,
            "selftest": limits.selftest,
            "detect": _nonzero_code("detect", levitation.detect / position_full),
            "rise": _nonzero_code("rise_speed", levitation.rise_speed * tick / position_full),
            "descend": _nonzero_code("descend_speed", levitation.descend_speed * tick / position_full),
            "lift": _nonzero_code("lift_rate", levitation.lift_rate * tick / force_full),
            "set_down": _nonzero_code("set_down_rate", levitation.set_down_rate * tick / force_full),
            "most": _nonzero_code("high", self.pidd2.high / force_full),
            "press": to_q31(self.final_landing_force / force_full),
        }

    def _gap_lines(self) -> list[tuple[float, float]]:
        """Return the gap at position zero, m, and the sign of the position, for each magnet."""
        lines = [(self.gap_middle, -1.0)]
        if self.gap_total is not None:
            lines.append((self.gap_total - self.gap_middle, 1.0))
        return lines

    def _real_settings(self) -> dict[str, float]:
        low, steps = self.converter.steps_within(self.limits.current_low, self.limits.current_high)
        step = self.converter.step
        numbers = {
            "current_low": low,
            "current_high": low + steps * step,
            "current_step": step,
            "release": max(step, self.limits.release * self.pidd2.tick),
            "bias": self.bias,
        }
        for i, (offset, factor) in enumerate(self._gap_lines(), 1):
            numbers |= {f"gap_offset_{i}": offset, f"gap_factor_{i}": factor}
        return numbers

    def _fixed_settings(self) -> dict[str, float]:
        scales, step = self.scales, self.converter.step
        low, steps = self.converter.steps_within(self.limits.current_low, self.limits.current_high)
        step_codes = round(step / scales.current * _Q31)
        if step_codes < _MIN_STEP_CODES:
            text = "the steps of the converter are too small for a full scale of 31 bits"
            raise wrong_key("bits", text, code="converter-too-fine")
        # A step of the converter must be an integer number of codes. Therefore the full scale is
        # changed by less than 0.1 %, and by 2e-5 with 16 bits.
        current = step / step_codes * _Q31
        first = round(low / current * _Q31)
        release = self.limits.release * self.pidd2.tick
        numbers: dict[str, float] = {
            "current_full": current,
            "load_full": self.load_full_scale,
            "flux_full": self.flux_full_scale,
            "current_low": first,
            "current_high": first + min(steps, int((_Q31 - 1.0 - first) // step_codes)) * step_codes,
            "current_step": step_codes,
            "release": max(step_codes, _nonzero_code("release", release / current)),
            "bias": to_q31(self.bias / scales.demand),
        }
        for i, (offset, direction) in enumerate(self._gap_lines(), 1):
            factor = 0.5 * direction * self.position_full / scales.gap_span
            mantissa, shift = to_factor("range of the compensator's gaps", factor)
            if shift > 0:
                text = "the compensator covers too small a part of the possible gaps; narrow them"
                raise wrong_key("gap_high", text, code="range-too-narrow")
            numbers |= {
                f"gap_offset_{i}": to_q31(scales.gap_fraction(offset)),
                f"gap_mantissa_{i}": mantissa,
                f"gap_shift_{i}": shift,
            }
        return numbers


def _check_above_zero(table: object, *names: str) -> None:
    for name in names:
        value = getattr(table, name)
        if not (math.isfinite(value) and value > 0):
            raise wrong_key(name, f"{value} is not above zero", code="not-above-zero")


def _nonzero_code(name: str, fraction: float) -> int:
    """Return the nearest q31 code of a number that must not become zero."""
    code = to_q31(fraction)
    if code < 1:
        raise wrong_key(name, "too small to differ from zero; raise it", code="rate-too-small")
    return code


class Allocation(IntEnum):
    """Methods of ``core/include/anhyst/control/allocation.h`` to distribute a force to two magnets."""

    SINGLE = 1
    BY_HALVES = 2  # class A: equal changes of opposite sign around the bias
    CLASS_AB = 3
