"""The path of play cells along many drives at once, with tangents: what a fit of them runs on.

The core solves ``x + omega*M(x) = r`` along a drive. From one turning point to the next every cell
is then a function of the effective field alone, ``p_i = max(p_i, x - r_i)`` on the way up, so that
the tangents of all samples of such a run, and of the same run of every drive, are taken together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anhyst._core import CellIron, langevin, status_text
from anhyst.identify.no_response import NoResponseError
from anhyst.laws.cells import CellWeights, Shape
from anhyst.support.arrays import FloatArray
from anhyst.support.units import MU_0

_SMALL = 1e-3
"""Weight of the magnetisation as the core sees it: its unit is free, and makes it that small."""


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
    omega_t, r_t
        Derivatives by what a caller moves, shapes (d,) and (n, d); the numbers of the law come
        first, and are none of both.
    """

    omega: float
    r: FloatArray
    kept: int
    omega_t: FloatArray
    r_t: FloatArray


def curve(shape: Shape, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the curve that cells follow, and its slope."""
    if shape == "tanh":
        value = np.tanh(z)
        return value, 1.0 - value * value
    value, slope = langevin(z.ravel())
    return value.reshape(z.shape), slope.reshape(z.shape)


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

    def follow(self, drives: Sequence[DrivenCells]) -> list[Path]:
        """Drive the demagnetised cells along every drive.

        Raises
        ------
        NoResponseError
            The equation may have several solutions.
        """
        solved = self._solve(drives)
        if self.tangents is None:
            nothing = np.empty((0, 0))
            return [Path(x, m, nothing, nothing) for x, m in solved]
        return _Followed(self, drives, solved).paths()

    def _solve(self, drives: Sequence[DrivenCells]) -> list[tuple[FloatArray, FloatArray]]:
        """Return effective field and magnetisation along every drive."""
        weights = np.array([drive.omega for drive in drives])
        unit = max(1.0, float(np.max(np.abs(weights)))) / _SMALL
        alpha = max(0.0, -float(weights.min()) / unit)
        cells = self.cells
        try:
            iron = CellIron(
                cells.thresholds, cells.widths, unit * cells.weights, cells.shape, alpha
            )
        except ValueError as error:
            raise NoResponseError(str(error)) from error
        if 1.0 + float(weights.min()) / unit * iron.steepest <= 0.0:
            raise NoResponseError("the magnetisation may jump")
        found = []
        for drive, weight in zip(drives, weights.tolist(), strict=True):
            share = weight / unit + alpha
            ratio = np.full(drive.r.size, share / (1.0 - share))
            nothing = np.zeros(drive.r.size)
            flux, field, _, status, _ = iron.forward(
                drive.r * (1.0 + ratio), ratio, nothing, np.zeros(cells.thresholds.size)
            )
            if status != 0:
                raise NoResponseError(status_text(status))
            magnetisation = flux / MU_0 - field
            found.append((field + alpha * magnetisation, magnetisation / unit))
        return found

    def at(self, places: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return, of each pair of cells at places (t, n + 1): curve, weighted slope, place."""
        rows, columns = self._used
        z = places[:, rows] / self.cells.widths[columns]
        value, slope = curve(self.cells.shape, z)
        steep = slope * (self.cells.weights / self.cells.widths)[rows, columns]
        return value, steep, z

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
    """All drives under way: places of the cells, and their tangents."""

    def __init__(
        self,
        paths: CellPaths,
        drives: Sequence[DrivenCells],
        solved: Sequence[tuple[FloatArray, FloatArray]],
    ) -> None:
        self.cells, self.drives, self.solved = paths, drives, solved
        self.thresholds = paths.cells.thresholds
        count, width = len(drives), drives[0].omega_t.size
        self.state = np.zeros((count, self.thresholds.size))
        self.state_t = np.zeros((count, self.thresholds.size, width))
        self.tangents = [
            (np.empty((drive.r.size, width)), np.empty((drive.r.size, width))) for drive in drives
        ]

    def paths(self) -> list[Path]:
        runs = [turns(drive.r) for drive in self.drives]
        for step in range(max(one.size for one in runs) - 1):
            self._run({
                place: slice(int(one[step]), int(one[step + 1]))
                for place, one in enumerate(runs) if step + 1 < one.size
            })  # fmt: skip
        return [
            Path(x, m, x_t, m_t)
            for (x, m), (x_t, m_t) in zip(self.solved, self.tangents, strict=True)
        ]

    def _run(self, spans: dict[int, slice]) -> None:
        """Take one run of each drive that has one left, upward or mirrored."""
        sizes = np.array([span.stop - span.start for span in spans.values()])
        places = np.array(list(spans))
        fields = [self.solved[place][0][span] for place, span in spans.items()]
        last = np.array([field[-1] for field in fields])
        side = np.where(last < self.state[places, 0], -1.0, 1.0)
        x = np.concatenate(fields) * np.repeat(side, sizes)
        state = (self.state[places] * side[:, None]).repeat(sizes, axis=0)
        moved = x[:, None] - self.thresholds
        value, steep, z = self.cells.at(np.maximum(state, moved))
        weights_t, widths_t, thresholds_t = self.cells.by_pair
        each = self.cells.each_cell(steep)
        on = moved >= state
        active = each * on
        direct = value @ weights_t - (steep * z) @ widths_t - active @ thresholds_t
        slope, resting = active.sum(axis=1), each - active
        first = 0
        for place, span, size, way in zip(places, spans.values(), sizes, side, strict=True):
            part = slice(first, first + size)
            first += size
            self._take(place, span, way, direct[part], slope[part, None], resting[part])
            after = np.broadcast_to(
                way * self.tangents[place][0][span][-1], self.state_t[place].shape
            )
            after = after.copy()
            after[:, : thresholds_t.shape[1]] -= thresholds_t
            end = first - 1
            self.state_t[place] = np.where(on[end, :, None], way * after, self.state_t[place])
            self.state[place] = way * np.maximum(state[end], moved[end])

    def _take(
        self,
        place: int,
        span: slice,
        way: float,
        direct: FloatArray,
        slope: FloatArray,
        resting: FloatArray,
    ) -> None:
        """Keep the tangents of a run: those of cells at rest stay what they were."""
        drive = self.drives[place]
        m = way * self.solved[place][1][span]
        m_t = resting @ (way * self.state_t[place])
        m_t[:, : direct.shape[1]] += direct
        x_t = way * drive.r_t[span] - m[:, None] * drive.omega_t - drive.omega * m_t
        x_t /= 1.0 + drive.omega * slope
        self.tangents[place][0][span] = way * x_t
        self.tangents[place][1][span] = way * (m_t + slope * x_t)
