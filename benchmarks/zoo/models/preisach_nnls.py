"""The classical Preisach model, with its density on a triangular grid fitted by nonnegative least squares.

The density is constant in each cell of the grid, and the output is an integral over the relays
that are up. The staircase of past extrema gives this integral in closed form (Mayergoyz,
Mathematical Models of Hysteresis, 1991), so that the output is continuous and no relay is
quantised. The grid is finer where input and output change. A single-valued function adds the
reversible part and the offset. Differences of neighbouring densities are penalised (as Hoffmann
and Sprekels proposed for its identification, 1989). The number of grid lines and the penalty are
those with the smallest error on withheld parts of the training records, and so is whether the
density may be negative: butterfly loops need both signs.

The fit is a strictly convex quadratic programme. Block principal pivoting solves it exactly (Kim
and Park, SIAM J. Sci. Comput. 33, 2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from ..records import BoolArray, FloatArray, Record
from ._compiled import compiled
from ._over_schedule import OverSchedule
from ._training import Scaling, grid_lines, thin, withheld

SIDES = (16, 24, 36, 56)
PENALTIES = (1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
FOLDS = 2
REVERSIBLE_KNOTS = 24
CURVATURE_PENALTY = 1e-5
RIDGE = 1e-9
MAX_SAMPLES_TO_CHOOSE = 1500


@dataclass(frozen=True)
class _Grid:
    """The triangular grid, and the knots of the reversible part."""

    lines: FloatArray
    knots: FloatArray

    @property
    def cells(self) -> int:
        side = self.lines.size - 1
        return side * (side + 1) // 2

    def design(self, record: Record) -> FloatArray:
        """Return the regressors of a record: share of each cell that is up, and the hat functions."""
        path = record.path
        places = np.interp(path.input, self.lines, np.arange(self.lines.size, dtype=float))
        relays = _relay_shares(places, path.lead_in, self._rest(), self.lines.size - 1)
        return np.hstack([relays, _hats(record.input, self.knots)])

    def _rest(self) -> FloatArray:
        """Return the extrema that lead to the demagnetised state: decreasing pairs around zero."""
        largest = max(abs(self.lines[0]), abs(self.lines[-1]))
        sizes = np.unique(np.concatenate([np.abs(self.lines), np.linspace(0.0, largest, 101)]))[::-1]
        pairs = np.column_stack([sizes, -sizes]).ravel()
        places: FloatArray = np.interp(pairs, self.lines, np.arange(self.lines.size, dtype=float))
        return places

    def penalty(self) -> FloatArray:
        """Return the squared differences of neighbouring cells as a matrix over the cells."""
        side = self.lines.size - 1
        index = np.full((side, side), -1)
        index[np.tril_indices(side)] = np.arange(self.cells)
        matrix = np.zeros((self.cells, self.cells))
        for first, second in ((index[1:], index[:-1]), (index[:, 1:], index[:, :-1])):
            inside = (first >= 0) & (second >= 0)
            one, two = first[inside], second[inside]
            np.add.at(matrix, (one, one), 1.0)
            np.add.at(matrix, (two, two), 1.0)
            np.add.at(matrix, (one, two), -1.0)
            np.add.at(matrix, (two, one), -1.0)
        return matrix


class PreisachNNLS:
    """A Preisach density on a triangular grid, with a reversible part."""

    def fit(self, records: Sequence[Record]) -> None:
        """Choose grid, penalty and sign on withheld parts, and fit the density to all records."""
        self._scaling = Scaling.of(records)
        own = [self._scaling.normalise(record) for record in records]
        side, penalty, is_signed = _choose(thin(own, MAX_SAMPLES_TO_CHOOSE))
        self._grid = _make_grid(own, side)
        used = np.concatenate([record.scored for record in own])
        design = np.vstack([self._grid.design(record) for record in own])[used]
        y = np.concatenate([record.output for record in own])[used]
        self._weights = _solve(
            design.T @ design + y.size * _regularisation(self._grid, penalty),
            design.T @ y,
            self._grid.cells,
            is_signed,
        )

    def predict(self, record: Record) -> FloatArray:
        """Return the output of the staircase at each sample."""
        return self._scaling.restore(self._grid.design(self._scaling.normalise(record)) @ self._weights)

    def n_parameters(self) -> int:
        """Return the number of densities that are not zero, plus the knots of the reversible part."""
        return int(np.count_nonzero(self._weights))


def _make_grid(records: Sequence[Record], side: int) -> _Grid:
    return _Grid(grid_lines(records, side), grid_lines(records, REVERSIBLE_KNOTS - 1))


def _choose(records: Sequence[Record]) -> tuple[int, float, bool]:
    """Return the number of grid lines, the penalty and the sign rule with the least withheld error."""
    used = np.concatenate([record.scored for record in records])
    y = np.concatenate([record.output for record in records])[used]
    folds = [np.concatenate(withheld(records, fold, FOLDS))[used] for fold in range(FOLDS)]
    errors: dict[tuple[int, float, bool], float] = {}
    for side in SIDES:
        grid = _make_grid(records, side)
        design = np.vstack([grid.design(record) for record in records])[used]
        for out in folds:
            kept = design[~out]
            gram, target = kept.T @ kept, kept.T @ y[~out]
            for penalty in PENALTIES:
                matrix = gram + len(kept) * _regularisation(grid, penalty)
                for is_signed in (False, True):
                    weights = _solve(matrix, target, grid.cells, is_signed)
                    error = float(np.sum((y[out] - design[out] @ weights) ** 2))
                    key = (side, penalty, is_signed)
                    errors[key] = errors.get(key, 0.0) + error
    return min(errors, key=lambda key: errors[key])


def _regularisation(grid: _Grid, penalty: float) -> FloatArray:
    """Return the matrix of all penalties, over cells and knots, for one sample."""
    cells = grid.cells
    matrix = RIDGE * np.eye(cells + grid.knots.size)
    # A difference between neighbours counts the more the smaller the cells are.
    matrix[:cells, :cells] += penalty * cells * grid.penalty()
    bend = np.diff(np.eye(grid.knots.size), 2, axis=0)
    matrix[cells:, cells:] += CURVATURE_PENALTY * bend.T @ bend
    return matrix


def _solve(matrix: FloatArray, target: FloatArray, cells: int, is_signed: bool) -> FloatArray:
    """Return the minimiser of the quadratic form; the first weights are nonnegative unless signed.

    The pivoting exchanges all infeasible variables as long as their number decreases, and after
    three failures only the last one, which always terminates.
    """
    free = np.ones(target.size, np.bool_)
    if is_signed:
        return _solve_free(matrix, target, free)
    bounded = np.arange(target.size) < cells
    fewest, chances = target.size + 1, 3
    while True:
        weights = _solve_free(matrix, target, free)
        gradient = matrix @ weights - target
        scale = 1e-10 * float(np.max(np.abs(target)))
        infeasible = bounded & ((free & (weights < 0.0)) | (~free & (gradient < -scale)))
        count = int(np.count_nonzero(infeasible))
        if count == 0:
            return weights
        if count < fewest:
            fewest, chances = count, 3
        elif chances > 0:
            chances -= 1
        else:
            last = int(np.flatnonzero(infeasible)[-1])
            infeasible = np.arange(target.size) == last
        free = free ^ infeasible


def _solve_free(matrix: FloatArray, target: FloatArray, free: BoolArray) -> FloatArray:
    """Return the solution over the free variables; the others are zero."""
    weights = np.zeros(target.size)
    part = matrix[np.ix_(free, free)]
    try:
        weights[free] = cho_solve(cho_factor(part, overwrite_a=True, check_finite=False), target[free])
    except LinAlgError:
        weights[free] = np.linalg.lstsq(part, target[free])[0]
    return weights


def _hats(u: FloatArray, knots: FloatArray) -> FloatArray:
    """Return the hat functions of the knots at each input, continued linearly outside."""
    piece = np.clip(np.searchsorted(knots, u, side="right") - 1, 0, knots.size - 2)
    share = (u - knots[piece]) / (knots[piece + 1] - knots[piece])
    hats = np.zeros((u.size, knots.size))
    rows = np.arange(u.size)
    hats[rows, piece] = 1.0 - share
    hats[rows, piece + 1] = share
    return hats


@compiled
def _relay_shares(places: FloatArray, lead_in: int, rest: FloatArray, side: int) -> FloatArray:
    """Return the share of each cell whose relays are up, shape (n - lead_in, cells).

    The stack contains the extrema that still count, maxima at even positions and minima at odd
    ones. Cells are unit squares in the coordinates of the places.
    """
    stack = np.empty(rest.size + places.size + 2)
    depth = rest.size
    stack[:depth] = rest
    base = np.zeros(side * (side + 1) // 2)
    for pair in range(0, depth, 2):
        _add_triangle(base, stack[pair], stack[pair - 1] if pair else 0.0, 1.0, side)
        _add_triangle(base, stack[pair], stack[pair + 1], -1.0, side)
    shares = np.empty((places.size - lead_in, base.size))
    position = stack[depth - 1]
    for sample in range(places.size):
        place = places[sample]
        is_rising = place > position
        if place != position:
            depth = _push(base, stack, depth, place, is_rising, side)
            position = place
        if sample >= lead_in:
            shares[sample - lead_in] = base
    return shares


@compiled
def _push(
    base: FloatArray, stack: FloatArray, depth: int, place: float, is_rising: bool, side: int
) -> int:
    """Move the input to a place, wipe out the extrema that it passes, and return the new depth."""
    parity = 0 if is_rising else 1  # position in the stack of extrema in this direction, modulo 2
    sign = 1.0 if is_rising else -1.0
    last = stack[depth - 1]
    if (depth - 1) % 2 == parity:  # the last extremum is the moving end itself
        opposite = stack[depth - 2] if depth > 1 else 0.0
        _add_triangle_of(base, last, opposite, is_rising, -sign, side)
        depth -= 1
    while depth > 1 and sign * (place - stack[depth - 2]) >= 0.0:
        high = stack[depth - 2]
        _add_triangle_of(base, stack[depth - 1], high, not is_rising, sign, side)
        opposite = stack[depth - 3] if depth > 2 else 0.0
        _add_triangle_of(base, high, opposite, is_rising, -sign, side)
        depth -= 2
    opposite = stack[depth - 1] if depth > 0 else 0.0
    _add_triangle_of(base, place, opposite, is_rising, sign, side)
    stack[depth] = place
    return depth + 1


@compiled
def _add_triangle_of(
    base: FloatArray, end: float, opposite: float, is_rising: bool, sign: float, side: int
) -> None:
    """Add the triangle between an extremum and the opposite extremum before it."""
    if is_rising:
        _add_triangle(base, end, opposite, sign, side)
    else:
        _add_triangle(base, opposite, end, sign, side)


@compiled
def _add_triangle(base: FloatArray, high: float, low: float, sign: float, side: int) -> None:
    """Add the share of each cell with its up threshold below `high` and its down threshold above `low`."""
    for i in range(int(low), min(side, int(np.ceil(high)))):
        up = min(1.0, high - i)
        start = i * (i + 1) // 2
        for j in range(int(low), i):
            base[start + j] += sign * up * min(1.0, j + 1.0 - low)
        part = up - max(0.0, low - i)
        if part > 0.0:
            base[start + i] += sign * part * part


MODELS = {"Preisach, NNLS": lambda: OverSchedule(PreisachNNLS)}
