"""Noise of which each sample goes with the one before it, in what a fit leaves.

A filtered sensor, the steps of a converter, a slow supply: all look smooth over a few samples. How
smooth is taken from what no shape explains. Shapes explain the slow part of such a noise first, so
what is left goes less together than the noise did: by how much is computed, not guessed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from anhyst.support.arrays import FloatArray

_UNLIKELY = 1e-3
"""Chance of what is taken for more than noise."""
_UNSURE = 2.5
"""Standard errors by which the noise may go together more than it seems to."""
_CHANCE = 0.5
"""Standard errors up to which it is taken to be as it seems."""
_FEWEST = 8.0
"""Degrees of freedom that the variance of the slowest noise is still given."""
_GRID = np.array([0.0, 0.2, 0.4, 0.6, 0.75, 0.85, 0.92, 0.96, 0.98])


@dataclass(frozen=True, eq=False)
class Coloured:
    """Noise in records of some sizes: its variance, how much each sample goes with the last."""

    sizes: tuple[int, ...]
    variance: float
    with_last: float
    free: float

    def chance(self, way: FloatArray) -> float:
        """Sum of squares that orthonormal columns explain of it by chance."""
        smooth = _smoothed(way, self.with_last, self.sizes)
        return self.variance * float(np.einsum("nk,nk->", way, smooth))

    def is_chance(self, squares: float, chance: float, columns: int) -> bool:
        """Whether the noise might have given a sum of squares along some columns."""
        return float(fdtrc(columns, self.free, squares / max(chance, 1e-300))) > _UNLIKELY


def coloured(off: FloatArray, shapes: FloatArray, sizes: Sequence[int]) -> Coloured:
    """Estimate the noise from what orthonormal shapes do not explain."""
    lengths = tuple(sizes)
    left = off - shapes @ (shapes.T @ off)
    power = max(float(left @ left), 1e-300)
    seen = float(left @ _neighbours(left, lengths)) / power
    remainder = _Remainder(shapes, lengths)
    expected = [remainder.at(one) for one in _GRID]
    ratio = np.maximum.accumulate([together / whole for whole, together in expected])
    with_last = float(np.interp(seen, ratio, _GRID))
    free = max(off.size - shapes.shape[1], 2)
    # Unsure by as much as a correlation is, but for what may as well be white.
    error = float(np.sqrt((1.0 - with_last**2) / free))
    unsure = min(max(with_last / error - _CHANCE, 0.0), _UNSURE)
    with_last = min(with_last + unsure * error, float(_GRID[-1]))
    whole = remainder.at(with_last)[0]
    slower = (1.0 - with_last**2) / (1.0 + with_last**2)
    return Coloured(lengths, power / whole, with_last, max(free * slower, _FEWEST))


class _Remainder:
    """Sum of squares, and of products with the sample before, that shapes leave of such noise."""

    def __init__(self, shapes: FloatArray, sizes: tuple[int, ...]) -> None:
        self._shapes, self._sizes = shapes, sizes
        self._shifted = _neighbours(shapes, sizes)
        self._inside = _products(shapes, self._shifted)

    def at(self, with_last: float) -> tuple[float, float]:
        smooth = _smoothed(self._shapes, with_last, self._sizes)
        inside = _products(self._shapes, smooth)
        whole = sum(self._sizes) - float(np.trace(inside))
        together = (
            with_last * (sum(self._sizes) - len(self._sizes))
            - 2.0 * float(np.einsum("nk,nk->", self._shifted, smooth))
            + float(np.einsum("kl,kl->", self._inside, inside))
        )
        return whole, together


def _products(one: FloatArray, other: FloatArray) -> FloatArray:
    """Products of columns with columns, on one thread: a library would wait for its others."""
    found: FloatArray = np.einsum("nk,nl->kl", one, other)
    return found


def _parts(columns: FloatArray, sizes: tuple[int, ...]) -> list[FloatArray]:
    return np.split(columns, np.cumsum(sizes)[:-1])


def _smoothed(columns: FloatArray, with_last: float, sizes: tuple[int, ...]) -> FloatArray:
    """Columns times the correlations of the noise, record by record."""
    if with_last == 0.0:
        return columns
    return np.concatenate(
        [
            _decaying(part, with_last) + _decaying(part[::-1], with_last)[::-1] - part
            for part in _parts(columns, sizes)
        ]
    )


def _decaying(part: FloatArray, share: float) -> FloatArray:
    """Each sample with that share of the sum before it: twice as many of them at every step.

    As SciPy's lfilter, whose import takes longer than most commands.
    """
    found, reach, weight = part.copy(), 1, share
    while reach < len(part) and weight > 1e-18:
        found[reach:] += weight * found[:-reach]
        reach, weight = 2 * reach, weight * weight
    return found


def _neighbours(columns: FloatArray, sizes: tuple[int, ...]) -> FloatArray:
    """Mean of the samples before and after each, nothing beyond the ends of a record."""
    found = []
    for part in _parts(columns, sizes):
        mean = np.zeros_like(part)
        mean[1:] += 0.5 * part[:-1]
        mean[:-1] += 0.5 * part[1:]
        found.append(mean)
    return np.concatenate(found)
