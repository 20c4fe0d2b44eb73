"""What a force controller without hysteresis can do, fitted to the same loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from anhyst.compensate.interface import Compensator
from anhyst.data import Loop, Loops
from anhyst.data.verdict import monotone_fit
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

LEVELS = 200
"""Levels of force at which a single-valued curve has its points."""


class Memoryless(Compensator):
    """A compensator of which a commit changes nothing."""

    def solve(self, demand: float, gap: float | None = None) -> float:
        """Return the current that gives `demand`."""
        return float(self.run(demand, gap)[0])

    def fresh(self) -> Self:
        """Return the same: there is nothing to be remembered."""
        return self


@dataclass(frozen=True)
class ConstantRatio(Memoryless):
    """Current in proportion to force: the paper's uncompensated case."""

    nodes: FloatArray  # gaps, m; shape (g,)
    ratio: FloatArray  # N/A; a single one for a ratio that does not know the gap; shape (g,)

    def run(self, demand: ArrayLike, gap: ArrayLike | None = None) -> FloatArray:
        """Return the currents for forces, A, shape (n,)."""
        return np.atleast_1d(np.asarray(demand) / self._at(gap))

    def commit(self, applied: float, gap: float | None = None) -> float:
        """Return the force to expect, N."""
        return float(applied * self._at(gap))

    def _at(self, gap: ArrayLike | None) -> FloatArray:
        if self.nodes.size == 1:
            return np.asarray(self.ratio[0])
        at = self.nodes[0] if gap is None else gap
        return np.asarray(PchipInterpolator(self.nodes, self.ratio)(at))


@dataclass(frozen=True)
class SingleValued(Memoryless):
    """The best curve without memory at every gap."""

    nodes: FloatArray  # gaps, m; shape (g,)
    force: FloatArray  # levels from zero on in equal steps, N; shape (l,)
    table: FloatArray  # current, A; never falls along the force; shape (g, l)

    def run(self, demand: ArrayLike, gap: ArrayLike | None = None) -> FloatArray:
        """Return the currents for forces, A, shape (n,)."""
        force = np.atleast_1d(np.asarray(demand, dtype=np.float64))
        level = np.clip(force / self.force[1], 0.0, self.force.size - 1.0)
        below = np.minimum(level.astype(np.intp), self.force.size - 2)
        share, sample = level - below, np.arange(force.size)
        table = self._over_gap(gap, force.size)
        return np.asarray((1.0 - share) * table[sample, below] + share * table[sample, below + 1])

    def commit(self, applied: float, gap: float | None = None) -> float:
        """Return the force to expect, N."""
        return float(np.interp(applied, self._over_gap(gap, 1)[0], self.force))

    def _over_gap(self, gap: ArrayLike | None, size: int) -> FloatArray:
        """Currents of all levels at every gap, shape (size, l)."""
        if self.nodes.size == 1:
            return np.broadcast_to(self.table[0], (size, self.force.size))
        at = self.nodes[0] if gap is None else gap
        place = np.clip(np.broadcast_to(at, size), self.nodes[0], self.nodes[-1])
        return np.asarray(PchipInterpolator(self.nodes, self.table, axis=0)(place))


def fit_ratio(loops: Loops, force_max: float) -> ConstantRatio:
    """Fit a constant ratio at every gap, least squares of the force up to the largest wanted."""
    groups = loops.by_schedule()
    ratios = []
    for members in groups.values():
        current = np.concatenate([loop.input for loop in members])
        force = np.concatenate([loop.output for loop in members])
        used = force <= force_max
        ratios.append(float(force[used] @ current[used] / (current[used] @ current[used])))
    return ConstantRatio(np.array(list(groups), dtype=np.float64), np.array(ratios))


def fit_single_valued(loops: Loops, force_max: float) -> SingleValued:
    """Fit the best single-valued current over force and gap.

    At every level of force the current lies midway between the least and the largest that the
    loops show there: no other curve has a smaller worst error.
    """
    levels = np.linspace(0.0, force_max, LEVELS)
    groups = loops.by_schedule()
    table = []
    for gap, members in groups.items():
        middle = midway(members, levels)
        known = np.isfinite(middle)
        if not known[-1]:
            raise InputError(
                f"loops: at gap {gap} m they do not reach {force_max:g} N; lower force_max_N",
                code="force-not-reached",
                key="loops",
            )
        filled = np.interp(levels, levels[known], middle[known])
        table.append(monotone_fit(filled, np.ones(LEVELS)))
    return SingleValued(np.array(list(groups), dtype=np.float64), levels, np.array(table))


def midway(members: Sequence[Loop], levels: FloatArray) -> FloatArray:
    """Return what lies midway between the least and the largest current at levels of the force.

    As :func:`envelope`.
    """
    low, high = envelope(members, levels)
    return 0.5 * (low + high)


def envelope(members: Sequence[Loop], levels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the least and the largest current at levels of the force."""
    crossings = [_crossings(loop.input, loop.output, levels) for loop in members]
    low = np.min([least for least, _ in crossings], axis=0)
    high = np.max([largest for _, largest in crossings], axis=0)
    known = low <= high
    return np.where(known, low, np.nan), np.where(known, high, np.nan)


def _crossings(
    current: FloatArray, force: FloatArray, levels: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Least and largest current at which a record passes each level; inf and -inf where none."""
    least, largest = np.full(levels.size, np.inf), np.full(levels.size, -np.inf)
    for begin, end in zip(range(force.size - 1), range(1, force.size), strict=True):
        low, high = sorted((force[begin], force[end]))
        met = slice(np.searchsorted(levels, low), np.searchsorted(levels, high, side="right"))
        if met.start == met.stop or low == high:
            continue
        share = (levels[met] - force[begin]) / (force[end] - force[begin])
        at = current[begin] + share * (current[end] - current[begin])
        least[met] = np.minimum(least[met], at)
        largest[met] = np.maximum(largest[met], at)
    return least, largest
