"""Cumulative sums: whether the mean of a row of numbers has moved, at a stated false-alarm rate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammaincinv

SMALLEST = 0.5
"""Allowance of a chart in standard deviations, at least: it is best for twice that."""
_OVERSHOOT = 1.166
"""Of a random walk of normal steps over its threshold, to both ends (Siegmund 1985)."""
_SURE = 0.05
"""Chance that the scatter is larger than it is taken to be, from the few values that are known."""
_ERRORS = 2.0
"""Standard errors by which the mean may be off."""
_MOST_CORRELATION = 0.9


def threshold(run_length: float, allowance: float = SMALLEST) -> float:
    """Return the threshold of a one-sided chart, in standard deviations.

    >>> round(threshold(465.0), 1)  # tables say 5 for a mean run of 465
    4.8
    """
    wanted = 2.0 * allowance * allowance * run_length
    passed = brentq(lambda x: math.expm1(x) - x - wanted, 1e-9, 700.0)
    return float(max(passed / (2.0 * allowance) - _OVERSHOOT, 0.0))


@dataclass(frozen=True, slots=True)
class Reference:
    """What a row of numbers is like while nothing is wrong."""

    mean: float
    # standard deviation of one value that would have the same effect on a sum if values were
    # independent, from above
    scatter: float
    error: float  # by which the mean may be off

    @classmethod
    def of(cls, values: Sequence[float]) -> Reference:
        """Learn it from values, 4 or more.

        What stays from one value to the next makes a sum scatter more: by the root of
        ``(1 + r)/(1 - r)`` for a correlation r that dies out geometrically.
        """
        rows = np.asarray(values)
        count = rows.size
        away = rows - rows.mean()
        power = float(away @ away)
        if power == 0.0:
            return cls(float(rows.mean()), 0.0, 0.0)
        alike = float(away[1:] @ away[:-1]) / power + 1.0 / count  # a short row looks too little so
        alike = min(max(alike, 0.0), _MOST_CORRELATION)
        least = 2.0 * float(gammaincinv(0.5 * (count - 1), _SURE))  # quantile of chi-squared
        single = math.sqrt(power / least)
        scatter = single * math.sqrt((1.0 + alike) / (1.0 - alike))
        return cls(float(rows.mean()), scatter, _ERRORS * scatter / math.sqrt(count))


@dataclass(slots=True)
class Chart:
    """A two-sided cumulative sum."""

    reference: Reference
    least: float  # smallest shift worth an alarm, in the unit of the values; half of it is allowed
    run_length: float  # mean number of values to a false alarm, of both sides together
    _sums: list[float] = field(default_factory=lambda: [0.0, 0.0])
    _counts: list[int] = field(default_factory=lambda: [0, 0])
    _shifts: list[float] = field(default_factory=lambda: [0.0, 0.0])

    @property
    def allowance(self) -> float:
        """By which a value must be off before it adds to a sum."""
        smallest = max(SMALLEST * self.reference.scatter, 0.5 * self.least)
        return smallest + self.reference.error

    @property
    def limit(self) -> float:
        """Sum from which on it is an alarm.

        A wider allowance than the smallest only makes false alarms rarer.
        """
        return threshold(2.0 * self.run_length) * self.reference.scatter

    def add(self, value: float) -> tuple[float, int] | None:
        """Take the next value."""
        away = value - self.reference.mean
        for side, sign in enumerate((1.0, -1.0)):
            self._sums[side] += sign * away - self.allowance
            if self._sums[side] <= 0.0:
                self._sums[side], self._counts[side], self._shifts[side] = 0.0, 0, 0.0
                continue
            self._counts[side] += 1
            self._shifts[side] += away
            if self._sums[side] > self.limit:
                return self._shifts[side] / self._counts[side], self._counts[side]
        return None
