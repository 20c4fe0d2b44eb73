"""The path of play cells along many drives at once, with tangents: what a fit of them runs on.

From one turning point of a drive to the next every cell is a function of the effective field alone,
``p_i = max(p_i, x - r_i)`` on the way up, so that all samples of such a run, and the same run of
every drive, are solved together: ``x + omega*M(x) = r`` by Newton's method within a bracket.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anhyst._core import langevin
from anhyst.identify.no_response import NoResponseError
from anhyst.laws.cells import CellWeights, Shape
from anhyst.support.arrays import FloatArray

_SOLVED = 1e-10
"""What is left of the equation, in parts of the largest drive."""

_MOST = 100
"""Steps of Newton's method and halvings of its bracket at most."""


class Tangents(NamedTuple):
    """Derivatives of thresholds, widths and weights by some numbers, one row for each number."""

    thresholds: FloatArray
    widths: FloatArray
    weights: FloatArray


class Path(NamedTuple):
    """Effective field and magnetisation along a drive, and their derivatives, (n,) and (n, d)."""

    x: FloatArray
    m: FloatArray
    x_t: FloatArray
    m_t: FloatArray


@dataclass(frozen=True, eq=False)
class DrivenCells:
    """A drive of the cells.

    Parameters
    ----------
    omega
        Weight of the magnetisation.
    r
        Right side, shape (n,).
    kept
        First sample that is asked for; those before it lead up to it.
    guess
        Effective field where it is looked for first, shape (n,).
    omega_t, r_t
        Derivatives by what a caller moves, shapes (d,) and (n, d); the numbers of the law come
        first, and are none of both.
    """

    omega: float
    r: FloatArray
    kept: int
    guess: FloatArray
    omega_t: FloatArray
    r_t: FloatArray


def curve(shape: Shape, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the curve that cells follow, and its slope."""
    if shape == "tanh":
        value = np.tanh(z)
        return value, 1.0 - value * value
    value, slope = langevin(z.ravel())
    return value.reshape(z.shape), slope.reshape(z.shape)


SLOPES = {"tanh": 1.0, "langevin": 1.0 / 3.0}
"""Largest slope of each curve, at its middle."""


@dataclass(frozen=True, eq=False)
class CellPaths:
    """Cells ready to be driven.

    Parameters
    ----------
    cells
        Thresholds, widths, weights.
    tangents
        Their derivatives by the numbers of the law; None where none are wanted.
    """

    cells: CellWeights
    tangents: Tangents | None = None

    @cached_property
    def _used(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Cell and width of every pair that carries something, or may."""
        some = self.cells.weights > 0.0
        if self.tangents is not None:
            some = some | (self.tangents.weights != 0.0).any(axis=0)
        rows, columns = np.nonzero(some)
        return rows, columns

    @cached_property
    def steepest(self) -> float:
        """Bound of the slope of the magnetisation, whatever the state."""
        sums = self.cells.weights @ (1.0 / self.cells.widths)
        return SLOPES[self.cells.shape] * float(sums.sum())

    def follow(self, drives: Sequence[DrivenCells]) -> list[Path]:
        """Drive the demagnetised cells along every drive.

        Raises
        ------
        NoResponseError
            The equation may have several solutions, or none was found.
        """
        if min(1.0 + drive.omega * self.steepest for drive in drives) <= 0.0:
            raise NoResponseError("the magnetisation may jump")
        return _Followed(self, drives).paths()

    def magnetisation(
        self, places: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return M of cells at places (t, n + 1), and of each pair: curve, slope over width, place."""
        rows, columns = self._used
        z = places[:, rows] / self.cells.widths[columns]
        value, slope = curve(self.cells.shape, z)
        steep = slope * (self.cells.weights / self.cells.widths)[rows, columns]
        return value @ self.cells.weights[rows, columns], value, steep, z

    def each_cell(self, of_pairs: FloatArray) -> FloatArray:
        """Sum over the widths of each cell."""
        return of_pairs @ self._cell_of_pair

    @cached_property
    def _cell_of_pair(self) -> FloatArray:
        rows, _ = self._used
        return np.eye(self.cells.thresholds.size)[rows]

    @cached_property
    def by_pair(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Derivatives of weights and widths of each pair (pairs, d), and of thresholds (cells, d)."""
        assert self.tangents is not None
        rows, columns = self._used
        ratio = self.tangents.widths[:, columns] / self.cells.widths[columns]
        return (
            np.ascontiguousarray(self.tangents.weights[:, rows, columns].T),
            np.ascontiguousarray((ratio * self.cells.widths[columns]).T),
            np.ascontiguousarray(self.tangents.thresholds.T),
        )


def turns(r: FloatArray) -> NDArray[np.intp]:
    """Return where runs begin, from a demagnetised start, and the end: places in r."""
    way = np.sign(np.diff(np.concatenate([[0.0], r])))
    moving = np.flatnonzero(way)
    if not moving.size:
        return np.array([0, r.size])
    reversals = moving[1:][way[moving[1:]] != way[moving[:-1]]]
    return np.concatenate([[0], reversals, [r.size]])


class _Followed:
    """All drives under way: states, and what was found so far."""

    def __init__(self, paths: CellPaths, drives: Sequence[DrivenCells]) -> None:
        self.cells, self.drives = paths, drives
        self.thresholds = paths.cells.thresholds
        count, width = len(drives), drives[0].omega_t.size
        self.state = np.zeros((count, self.thresholds.size))
        self.found = [Path(np.empty(d.r.size), np.empty(d.r.size), *(
            np.empty((d.r.size, width if paths.tangents else 0)) for _ in range(2)
        )) for d in drives]  # fmt: skip
        self.state_t = np.zeros((count, self.thresholds.size, width))
        self.reach = max(float(np.max(np.abs(d.r))) for d in drives)

    def paths(self) -> list[Path]:
        runs = [turns(drive.r) for drive in self.drives]
        for step in range(max(one.size for one in runs) - 1):
            self._run({
                place: slice(int(one[step]), int(one[step + 1]))
                for place, one in enumerate(runs) if step + 1 < one.size
            })  # fmt: skip
        return self.found

    def _run(self, spans: dict[int, slice]) -> None:
        """Take one run of each drive that has one left."""
        places = np.array(list(spans))
        sizes = np.array([span.stop - span.start for span in spans.values()])
        of = np.repeat(places, sizes)
        r = np.concatenate([self.drives[place].r[span] for place, span in spans.items()])
        omega = np.array([drive.omega for drive in self.drives])[of]
        ends = np.cumsum(sizes) - 1
        before = self.state[places, 0]
        m0 = self.cells.magnetisation(self.state[places])[0]
        start = before + np.array([self.drives[place].omega for place in places]) * m0
        side = np.where(r[ends] < start, -1.0, 1.0)
        each = np.repeat(side, sizes)
        state = self.state[of] * each[:, None]
        wanted = each * r
        way = np.maximum(wanted - np.repeat(start * side, sizes), 0.0)
        low = np.repeat(before * side, sizes)
        guess = np.concatenate([self.drives[place].guess[span] for place, span in spans.items()])
        x = self._solve(state, omega, wanted, low, way, each * guess)
        self._take(spans, ends, each, state, omega, x)

    def _solve(
        self,
        state: FloatArray,
        omega: FloatArray,
        wanted: FloatArray,
        low: FloatArray,
        way: FloatArray,
        guess: FloatArray,
    ) -> FloatArray:
        """Solve a run upward; the field lies between where it was and a bound of the slope."""
        steepest = self.cells.steepest
        high = low + way / np.minimum(1.0, 1.0 + omega * steepest)
        x = np.clip(guess, low, high)
        before = np.full(x.size, np.inf)
        for _ in range(_MOST):
            places = np.maximum(state, x[:, None] - self.thresholds)
            m, _, steep, _ = self.cells.magnetisation(places)
            off = x + omega * m - wanted
            if float(np.max(np.abs(off))) <= _SOLVED * self.reach:
                return x
            active = x[:, None] - self.thresholds >= state
            slope = np.sum(self.cells.each_cell(steep) * active, axis=1)
            low, high = np.where(off < 0.0, x, low), np.where(off > 0.0, x, high)
            trial = x - off / (1.0 + omega * slope)
            # From one flat end to the other and back Newton's method can go for ever.
            nearer = (trial >= low) & (trial <= high) & (np.abs(off) <= 0.5 * before)
            x, before = np.where(nearer, trial, 0.5 * (low + high)), np.abs(off)
        raise NoResponseError("the equation of the cells has no solution that was found")

    def _take(
        self,
        spans: dict[int, slice],
        ends: NDArray[np.intp],
        side: FloatArray,
        state: FloatArray,
        omega: FloatArray,
        x: FloatArray,
    ) -> None:
        """Keep what a run gave, its tangents, and the states at its end."""
        cells = self.cells
        moved = x[:, None] - self.thresholds
        places = np.maximum(state, moved)
        m, value, steep, z = cells.magnetisation(places)
        first = ends + 1 - np.diff(np.concatenate([[-1], ends]))
        if cells.tangents is not None:
            weights_t, widths_t, thresholds_t = cells.by_pair
            numbers = weights_t.shape[1]
            each = cells.each_cell(steep)
            active = each * (moved >= state)
            slope = active.sum(axis=1)
            direct = value @ weights_t - (steep * z) @ widths_t - active @ thresholds_t
            resting = each - active
        for place, (one, span) in enumerate(spans.items()):
            part, found = slice(first[place], ends[place] + 1), self.found[one]
            way = side[ends[place]]
            found.x[span], found.m[span] = way * x[part], way * m[part]
            if cells.tangents is not None:
                drive, before = self.drives[one], self.state_t[one]
                m_t = resting[part] @ (way * before)
                m_t[:, :numbers] += direct[part]
                x_t = way * drive.r_t[span] - m[part, None] * drive.omega_t - drive.omega * m_t
                x_t /= (1.0 + drive.omega * slope[part])[:, None]
                m_t += slope[part, None] * x_t
                found.x_t[span], found.m_t[span] = way * x_t, way * m_t
                on = moved[ends[place]] >= state[ends[place]]
                after = np.broadcast_to(x_t[-1], before.shape).copy()
                after[:, :numbers] -= thresholds_t
                self.state_t[one] = np.where(on[:, None], way * after, before)
            self.state[one] = way * places[ends[place]]
