"""The ratio of two means and how well it is known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit


@dataclass(frozen=True)
class Quotient:
    """A ratio of means with its confidence interval."""

    value: float  # infinite over a mean of zero
    low: float  # ends of the interval; 0 and infinite where the lower mean may be zero
    high: float


def quotient(upper: ArrayLike, lower: ArrayLike, level: float = 0.95) -> Quotient:
    """Return the ratio of the means of pairs, with Fieller's interval.

    It holds all ratios R for which the mean of ``upper - R lower`` may be zero. So it holds 1
    exactly where the mean of the difference may be zero.
    """
    rows = np.array([upper, lower], dtype=float)
    count = rows.shape[1]
    factor = float(stdtrit(count - 1, 0.5 + 0.5 * level)) ** 2 / count
    a, b = (float(one) for one in rows.mean(axis=1))
    (aa, ab), (_, bb) = (factor * np.cov(rows)).tolist()
    value = a / b if b > 0.0 else math.inf
    # (a - R b)^2 <= aa - 2 R ab + R^2 bb
    square, half, rest = b * b - bb, a * b - ab, a * a - aa
    if square <= 0.0:
        return Quotient(value, 0.0, math.inf)
    root = math.sqrt(max(half * half - square * rest, 0.0))
    return Quotient(value, max((half - root) / square, 0.0), (half + root) / square)
