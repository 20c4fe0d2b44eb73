"""Force over current and gap around an operating point, measured; and what is left at a reversal.

Just after a reversal only the reversible part of the iron answers. A controller that works in small
movements meets that slope and not the one of the whole loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from anhyst.support.arrays import FloatArray

PATHOLOGICAL = 0.25
"""Share of the static gain below which an iron is called pathological just after a reversal."""

_CYCLES = 3  # until a loop has settled
_SAMPLES = 400  # a branch
_AROUND = 0.05  # of the range, to either side: where the static slopes are taken
_TURN = 0.0005  # of the range: how far the current goes back


@dataclass(frozen=True)
class Slopes:
    """Force and its slopes at an operating point."""

    force: float  # N
    k_i: float  # for each ampere, N/A
    k_s: float  # for each metre that the gap closes, N/m


@dataclass(frozen=True)
class Reversal:
    """Slopes of a magnet with a memory."""

    static: Slopes  # of the middle between the rising and the falling branch of the settled loop
    after_rise: float  # force for each ampere just after the current was turned, N/A
    after_fall: float

    @property
    def share(self) -> float:
        """The lesser slope after a reversal, in parts of the static one."""
        return min(self.after_rise, self.after_fall) / self.static.k_i

    @property
    def label(self) -> Literal["regular", "pathological"]:
        """What that makes of the iron."""
        return "pathological" if self.share < PATHOLOGICAL else "regular"


def measure_reversal(
    step: Callable[[float, float], float],
    current: float,
    gap: float,
    low: float,
    high: float,
    gap_step: float,
) -> Reversal:
    """Measure the slopes of a magnet with a memory on its settled loop."""
    around, turn = _AROUND * (high - low), _TURN * (high - low)
    if not low + around < current < high - around:
        raise ValueError(f"the current of {current:g} A is not well within {low:g}..{high:g} A")
    below, at, above = (
        _middle(step, current, place, low, high) for place in (gap - gap_step, gap, gap + gap_step)
    )
    _settle(step, gap, low, high)
    rising = _go(step, gap, low, current)[-1]
    after_rise = (rising - step(current - turn, gap)) / turn
    _go(step, gap, current - turn, high)
    falling = _go(step, gap, high, current)[-1]
    after_fall = (step(current + turn, gap) - falling) / turn
    k_s = (below[0] - above[0]) / (2.0 * gap_step)
    return Reversal(Slopes(at[0], at[1], k_s), float(after_rise), float(after_fall))


def _go(step: Callable[[float, float], float], gap: float, start: float, end: float) -> FloatArray:
    """Go from one current to another and return the forces on the way."""
    return np.array([step(float(x), gap) for x in np.linspace(start, end, _SAMPLES + 1)[1:]])


def _settle(step: Callable[[float, float], float], gap: float, low: float, high: float) -> None:
    for _ in range(_CYCLES):
        _go(step, gap, low, high)
        _go(step, gap, high, low)


def _middle(
    step: Callable[[float, float], float], current: float, gap: float, low: float, high: float
) -> tuple[float, float]:
    """Return force and slope over the current of the middle of both branches."""
    _settle(step, gap, low, high)
    rising, falling = _go(step, gap, low, high), _go(step, gap, high, low)
    grid = np.linspace(low, high, _SAMPLES + 1)
    middle = 0.5 * (rising[:-1] + falling[-2::-1])  # at grid[1:-1]
    off = grid[1:-1] - current
    near = np.abs(off) <= _AROUND * (high - low)
    # A parabola, so that the bend of the curve does not tilt its slope.
    bend = np.polynomial.Polynomial.fit(off[near], middle[near], 2).convert().coef
    return float(bend[0]), float(bend[1])
