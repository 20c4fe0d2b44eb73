"""Irons of virtual magnets that share neither a law nor code with the package.

``TellinenIron`` is the rate-independent model of Tellinen (1998): the slope between the limiting
branches is proportional to the distance from the branch ahead. For a single direction, this linear
differential equation has a closed solution, so steps of any size are exact. ``PreisachIron`` is a
Preisach plane whose thresholds are log-normal and whose interaction width depends on the threshold.
``LosslessIron`` has no hysteresis. All of them saturate softly and start demagnetised.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.stats import norm

from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0

_TABLE_KNOTS = 30001
_MAX_FIELD = 1e7
"""Largest field of the tables of Tellinen's iron, A/m; a magnet reaches at most a tenth of it."""
_THRESHOLDS = 48


class Iron(Protocol):
    """An iron in the demagnetised state."""

    field: float
    """Field of the last committed step, A/m."""

    def find_density(self, field: float) -> tuple[float, float]:
        """Return flux density, T, and its slope, H/m, of a trial step."""

    def commit(self, field: float) -> None:
        """Move to a field."""


@dataclass(frozen=True)
class Saturation:
    """Odd curve of polarisation over field with a fast and a slow part."""

    polarisation: float  # T
    fast_field: float  # A/m
    slow_field: float  # A/m
    slow_fraction: float

    def at(self, field: float) -> tuple[float, float]:
        """Return polarisation, T, and its slope, H/m."""
        fast = math.tanh(field / self.fast_field)
        root = math.hypot(field, self.slow_field)
        fast_size = self.polarisation * (1.0 - self.slow_fraction)
        slow_size = self.polarisation * self.slow_fraction
        slope = fast_size * (1.0 - fast * fast) / self.fast_field + slow_size * self.slow_field**2 / root**3
        return fast_size * fast + slow_size * field / root, slope

    def along(self, field: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return polarisations and slopes at many fields."""
        values = np.array([self.at(float(value)) for value in field])
        return values[:, 0], values[:, 1]


class LosslessIron:
    """An iron whose flux density depends only on its field."""

    def __init__(self, saturation: Saturation) -> None:
        self._saturation = saturation
        self.field = 0.0

    def find_density(self, field: float) -> tuple[float, float]:
        """Return flux density, T, and its slope, H/m."""
        polarisation, slope = self._saturation.at(field)
        return polarisation + MU_0 * field, slope + MU_0

    def commit(self, field: float) -> None:
        """Move to a field."""
        self.field = field


class TellinenIron:
    """An iron of Tellinen between two limiting branches that are shifted by the coercive field.

    On a rising path, the distance of the polarisation from the rising branch decays by
    exp(-P(H)), where P' is the slope of this branch divided by the distance between both branches.
    """

    def __init__(self, saturation: Saturation, coercive_field: float) -> None:
        self._saturation = saturation
        self._coercive_field = coercive_field
        self._span = math.asinh(_MAX_FIELD / coercive_field)
        position = np.linspace(-self._span, self._span, _TABLE_KNOTS)
        field = coercive_field * np.sinh(position)
        rising, slope = saturation.along(field - coercive_field)
        falling, _ = saturation.along(field + coercive_field)
        rate = slope / np.maximum(falling - rising, 1e-9 * saturation.polarisation)
        decay = cumulative_simpson(
            rate * coercive_field * np.cosh(position), dx=position[1] - position[0], initial=0.0
        )
        self._decay, self._rate = decay.tolist(), rate.tolist()
        self.field = self._polarisation = 0.0

    def _look_up(self, field: float) -> tuple[float, float]:
        place = (math.asinh(field / self._coercive_field) + self._span) / (2.0 * self._span)
        place *= _TABLE_KNOTS - 1
        knot = min(max(int(place), 0), _TABLE_KNOTS - 2)
        fraction = place - knot
        first, second = self._decay[knot], self._decay[knot + 1]
        return first + fraction * (second - first), self._rate[knot]

    def _move(self, field: float) -> tuple[float, float]:
        """Return polarisation, T, and its slope, H/m, after a step."""
        sign = 1.0 if field >= self.field else -1.0
        start, end = sign * self.field, sign * field
        rising, slope = self._saturation.at(end - self._coercive_field)
        distance = sign * self._polarisation - self._saturation.at(start - self._coercive_field)[0]
        end_decay, rate = self._look_up(end)
        distance *= math.exp(self._look_up(start)[0] - end_decay)
        return sign * (rising + distance), slope - distance * rate

    def find_density(self, field: float) -> tuple[float, float]:
        """Return flux density, T, and its slope, H/m, of a trial step."""
        polarisation, slope = self._move(field)
        return polarisation + MU_0 * field, slope + MU_0

    def commit(self, field: float) -> None:
        """Move to a field."""
        self._polarisation, _ = self._move(field)
        self.field = field


class PreisachIron:
    """A Preisach plane with log-normal thresholds, and a reversible soft part."""

    def __init__(
        self,
        saturation: Saturation,
        coercive_field: float,
        threshold_spread: float,
        interaction_growth: float,
    ) -> None:
        quantiles = (np.arange(_THRESHOLDS) + 0.5) / _THRESHOLDS
        thresholds = coercive_field * np.exp(threshold_spread * norm.ppf(quantiles))
        widths = saturation.fast_field * (1.0 + interaction_growth * thresholds / coercive_field)
        self._thresholds, self._inverse_widths = thresholds, 1.0 / widths
        self._hysteretic = saturation.polarisation * (1.0 - saturation.slow_fraction)
        self._reversible = Saturation(
            saturation.polarisation * saturation.slow_fraction,
            saturation.slow_field,
            saturation.slow_field,
            0.5,
        )
        self._states = np.zeros(_THRESHOLDS)
        self.field = 0.0

    def find_density(self, field: float) -> tuple[float, float]:
        """Return flux density, T, and its slope, H/m, of a trial step."""
        states = np.minimum(np.maximum(self._states, field - self._thresholds), field + self._thresholds)
        values = np.tanh(states * self._inverse_widths)
        moving_slopes = (1.0 - values * values) * self._inverse_widths * (states != self._states)
        reversible, reversible_slope = self._reversible.at(field)
        scale = self._hysteretic / _THRESHOLDS
        return (
            scale * float(values.sum()) + reversible + MU_0 * field,
            scale * float(moving_slopes.sum()) + reversible_slope + MU_0,
        )

    def commit(self, field: float) -> None:
        """Move to a field."""
        self._states = np.minimum(
            np.maximum(self._states, field - self._thresholds), field + self._thresholds
        )
        self.field = field


def find_root(residual: Callable[[float], tuple[float, float]], start: float, largest: float) -> float:
    """Return the root of a rising function by Newton steps inside a bracket.

    ``residual`` returns value and slope at a field, A/m.
    """
    low, high = -largest, largest
    field = start
    for _ in range(200):
        value, slope = residual(field)
        if value > 0.0:
            high = field
        else:
            low = field
        step = -value / slope
        if abs(step) < 1e-10 * (abs(field) + 1.0):
            return field + step
        field += step
        if not low < field < high:
            field = 0.5 * (low + high)
    return field
