"""Convert the gains of a PIDD2 controller from SI units to the numbers of the C core.

A PIDD2 has proportional, integral, first and second derivative parts. `design` calculates its gains
from mass, bandwidth and damping. `Pidd2` gives the gains per tick for floating point, and
`FixedPidd2` gives the words for fixed point. `notch` and `integrator` return second-order filters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from anhyst.support.errors import InputError, wrong_key
from anhyst.support.numeric import FloatArray, first_order_share, to_factor, to_smoothing_factor

_FACTOR_ORDER = ("proportional", "integral", "derivative", "second", "load", "back")
_Q31 = 2.0**31


@dataclass(frozen=True)
class FullScales:
    """Full scale (1.0) of each signal."""

    position: float  # half of the position range, m, > 0
    output: float  # force, N, > 0
    load: float = 1.0  # feedforward load, in its own unit, > 0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0.0):
                text = f"full scale of {field.name}: {value} is not above zero"
                raise InputError(text, code="not-above-zero", key=field.name)


@dataclass(frozen=True)
class FixedPidd2:
    """Gains of a PIDD2 as the words of ``anhyst_pidd2_gains_q31``, and their values."""

    # mantissa and shift of every gain factor, in the order of the structure
    factors: Mapping[str, tuple[int, int]]
    unweighted: int  # setpoint weight and output limits, as in the C structure
    low: int
    high: int
    scales: FullScales
    rate: float  # sample rate, Hz

    @property
    def words(self) -> NDArray[np.int32]:
        """All members of the structure except the reserved member, in order, shape (19,)."""
        factor_words = [number for factor in self.factors.values() for number in factor]
        return np.array([*factor_words, self.unweighted, self.low, self.high], dtype=np.int32)

    @property
    def per_tick(self) -> FloatArray:
        """Gains that the words represent exactly, in the order of :attr:`Pidd2.per_tick`."""
        value = {name: m / 65536.0 * 2.0**s for name, (m, s) in self.factors.items()}
        units = _factor_units(self.scales)
        row = [value[name] / units[name] for name in _FACTOR_ORDER]
        row += [-value["smoothing"], -value["smoothing_2"], 1.0 + self.unweighted / 32768.0]
        output = self.scales.output / _Q31
        return np.array([*row, self.low * output, self.high * output])


@dataclass(frozen=True)
class Pidd2:
    """PIDD2 position controller in SI units."""

    rate: float  # sample rate, Hz
    K_p: float  # n/m
    K_i: float = 0.0  # N/(m s); with the sign of K_p
    K_d: float = 0.0  # N s/m
    K_dd: float = 0.0  # N s^2/m
    K_load: float = 0.0  # output per unit of the feedforward load
    # cutoff of the low-pass of the first and of the second derivative, Hz; infinite: no filter
    cutoff: float = math.inf
    cutoff_2: float = math.inf
    weight: float = 1.0  # weight of the setpoint in the proportional part, 0..1
    low: float = -math.inf  # limits of the output, N
    high: float = math.inf
    # time constant with which the integral follows a limited output, s; None: K_p/K_i
    tracking: float | None = None

    def __post_init__(self) -> None:
        for name in ("rate", "K_p", "K_i", "K_d", "K_dd", "K_load"):
            if not math.isfinite(getattr(self, name)):
                raise wrong_key(name, f"{getattr(self, name)} is not a finite number", code="not-finite")
        for name in ("rate", "cutoff", "cutoff_2"):
            if not getattr(self, name) > 0.0:
                raise wrong_key(name, f"{getattr(self, name)} Hz is not above zero", code="not-above-zero")
        if not 0.0 <= self.weight <= 1.0:
            raise wrong_key("weight", f"{self.weight} is not within 0..1", code="out-of-range")
        if self.K_p * self.K_i < 0.0:
            text = "must have the sign of K_p, otherwise the loop is unstable"
            raise wrong_key("K_i", text, code="gain-signs-differ")
        if not self.low <= self.high:
            raise wrong_key("low", f"{self.low} N is above high, {self.high} N", code="range-reversed")
        if self.tracking is not None and not self.tracking > 0.0:
            raise wrong_key("tracking", f"{self.tracking} s is not above zero", code="not-above-zero")

    @property
    def tick(self) -> float:
        """Control period, s."""
        return 1.0 / self.rate

    @property
    def tracking_share(self) -> float:
        """Fraction of the excess of a limited output that the integral removes in one tick, 0..1."""
        if self.tracking is not None:
            return min(1.0, self.tick / self.tracking)
        if self.K_i == 0.0:
            return 0.0
        return min(1.0, self.tick * self.K_i / self.K_p) if self.K_p else 1.0

    @property
    def per_tick(self) -> FloatArray:
        """Members of ``anhyst_pidd2_gains_f64`` in their order, shape (11,)."""
        tick = self.tick
        gains = [self.K_p, self.K_i * tick, self.K_d / tick, self.K_dd / (tick * tick), self.K_load]
        shares = [
            self.tracking_share,
            _filter_share(self.cutoff, tick),
            _filter_share(self.cutoff_2, tick),
            self.weight,
        ]
        return np.array([*gains, *shares, self.low, self.high])

    def fixed(self, scales: FullScales) -> FixedPidd2:
        """Convert the gains to fixed-point words with given full scales."""
        row = self.per_tick
        units = _factor_units(scales)
        factors = {
            name: to_factor(name, value * units[name])
            for name, value in zip(_FACTOR_ORDER, row[:6].tolist(), strict=True)
        }
        factors["smoothing"] = to_smoothing_factor("cutoff", float(row[6]))
        factors["smoothing_2"] = to_smoothing_factor("cutoff_2", float(row[7]))
        return FixedPidd2(
            factors=factors,
            unweighted=-round((1.0 - self.weight) * 32768.0),
            low=_limit_code("low", self.low, scales),
            high=_limit_code("high", self.high, scales),
            scales=scales,
            rate=self.rate,
        )


def _filter_share(cutoff: float, tick: float) -> float:
    """Return the fraction of a step that a first-order low-pass passes in one tick."""
    return first_order_share(2.0 * math.pi * cutoff * tick)


def _factor_units(scales: FullScales) -> dict[str, float]:
    """Return the factors that convert gains per tick to fixed-point factors; see pidd2.h."""
    position_per_output = scales.position / scales.output
    return {
        "proportional": position_per_output / 4.0,
        "integral": position_per_output,
        "derivative": position_per_output / 4.0,
        "second": position_per_output / 4.0,
        "load": scales.load / scales.output / 8.0,
        "back": 4.0,
    }


def _limit_code(name: str, value: float, scales: FullScales) -> int:
    """Return a limit of the output as a q31 code."""
    share = value / scales.output
    if math.isfinite(value) and abs(share) > 1.0:
        text = f"{value} N is beyond the full scale of {scales.output} N"
        raise wrong_key(name, text, code="beyond-full-scale")
    return int(max(-_Q31, min(_Q31 - 1.0, round(share * _Q31) if math.isfinite(share) else share * 2)))


@dataclass(frozen=True)
class Gains:
    """Gains of a PIDD2 in SI units, named as in :class:`anhyst.control.Pidd2`."""

    K_p: float  # n/m
    K_i: float  # n/(m s)
    K_d: float  # N s/m
    K_dd: float  # N s^2/m


def design(mass: float, bandwidth: float, damping: float, virtual_mass: float = 0.0) -> Gains:
    """Place the poles of a mass that a PIDD2 controls.

    >>> gains = design(mass=2.0, bandwidth=120.0, damping=1.0)
    >>> f"{gains.K_p:.4g} N/m, {gains.K_i:.4g} N/(m s), {gains.K_d:.4g} N s/m"
    '3.411e+06 N/m, 8.573e+08 N/(m s), 4524 N s/m'
    """
    given_values = {"mass": (mass, " kg"), "bandwidth": (bandwidth, " Hz"), "damping": (damping, "")}
    for name, (value, unit) in given_values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise wrong_key(name, f"{value}{unit} is not above zero", code="not-above-zero")
    if not (math.isfinite(virtual_mass) and mass + virtual_mass > 0.0):
        raise wrong_key(
            "virtual_mass",
            f"{virtual_mass} kg cancels the mass of {mass} kg; give a value above minus the mass",
            code="virtual-mass-too-negative",
        )
    w = 2.0 * math.pi * bandwidth
    total = mass + virtual_mass
    return Gains(
        K_p=total * (w * w) * (1.0 + 2.0 * damping),
        K_i=total * (w * w * w),
        K_d=total * w * (1.0 + 2.0 * damping),
        K_dd=virtual_mass,
    )


def notch(frequency: float, damping: float, new_damping: float, dt: float) -> FloatArray:
    """Return a filter that replaces a resonance (Hz, damping ratio) by one with another damping.

    The result is b0, b1, b2, a1 and a2 of ``(b0 + b1/z + b2/z^2)/(1 + a1/z + a2/z^2)``, the members
    of ``anhyst_biquad_f64``.
    """
    w = math.tan(math.pi * frequency * dt)
    middle, pole_term, new_term = 2.0 * (w * w - 1.0), 2.0 * damping * w, 2.0 * new_damping * w
    parts = [1.0 + pole_term + w * w, middle, 1.0 - pole_term + w * w, middle, 1.0 - new_term + w * w]
    return np.array(parts) / (1.0 + new_term + w * w)


def integrator(gain: float) -> FloatArray:
    """Return a filter that sums all inputs and multiplies by a gain; see :func:`notch`."""
    return np.array([gain, 0.0, 0.0, -1.0, 0.0])
