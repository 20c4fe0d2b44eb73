"""Round numbers: what a person would have written."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

ONE_TWO_FIVE = (1.0, 2.0, 5.0, 10.0)
_SLACK = 1e-9


def nearest(value: float, digits: int = 2) -> float:
    """Return the nearest number of so many digits."""
    return float(f"{value:.{digits - 1}e}")


def up(value: float, digits: int = 2) -> float:
    """Return the least number of so many digits that is not below a positive value."""
    return _shifted(value, digits, math.ceil, -_SLACK)


def down(value: float, digits: int = 2) -> float:
    """Return the largest number of so many digits that is not above a positive value."""
    return _shifted(value, digits, math.floor, _SLACK)


def step_up(value: float, steps: Sequence[float] = ONE_TWO_FIVE) -> float:
    """Return the least of 1, 2, 5, 10, 20, ... that is not below a positive value."""
    decade = math.floor(math.log10(value) + _SLACK)
    least = next(step for step in steps if step * (1.0 + _SLACK) >= value / 10.0**decade)
    return float(f"{least:g}e{decade}")


def step_down(value: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, ... that is not above a positive value."""
    decade = math.floor(math.log10(value) + _SLACK)
    share = value / 10.0**decade * (1.0 + _SLACK)
    return float(f"{max(step for step in ONE_TWO_FIVE if step <= share):g}e{decade}")


def _shifted(value: float, digits: int, whole: Callable[[float], int], slack: float) -> float:
    decade = math.floor(math.log10(value)) - digits + 1
    return float(f"{whole(value / 10.0**decade * (1.0 + slack))}e{decade}")
