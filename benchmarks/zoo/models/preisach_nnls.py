"""The classical Preisach model, with its density on a triangular grid fitted by nonnegative least squares.

The density is constant in each cell of the grid, and the output is an integral over the relays
that are up. The staircase of past extrema gives this integral in closed form (Mayergoyz,
Mathematical Models of Hysteresis, 1991), so that the output is continuous and no relay is
quantised. The grid is finer where input and output change. A single-valued function adds the
reversible part and the offset. The identification by least squares follows Hoffmann and Meyer
(Numerische Mathematik 55, 1989); in addition, differences of neighbouring densities are penalised.
The number of grid lines and the penalty are those with the smallest error on withheld parts of the
training records, and so is whether the density may be negative: butterfly loops need both signs. If
the input has one sign, one more row of cells contains the relays whose other threshold has the
opposite sign.

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
from ._withheld import Scaling, add_mirror_images, grid_lines, hats, thin, withheld

SIDES = (20, 32, 50)
PENALTIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
FOLDS = 2
REVERSIBLE_KNOTS = 24
CURVATURE_PENALTY = 1e-5
RIDGE = 1e-9
MAX_SAMPLES_TO_CHOOSE = 1500

MAX_EXCHANGES = 300
"""Largest number of exchanges; rounding could make the exchanges repeat."""

MARGIN = 0.1
"""Width of the cells beyond the range of the input, which continue the density; relative to the range."""

MIN_SYMMETRY = 0.98
"""Smallest ratio of the extrema of the input for which its range counts as symmetric."""


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
        relays = _relay_shares(places, path.lead_in, self._demagnetising_extrema(), self.lines.size - 1)
        return np.hstack([relays, hats(record.input, self.knots)])

    def _demagnetising_extrema(self) -> FloatArray:
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
        for neighbour, cell in ((index[1:], index[:-1]), (index[:, 1:], index[:, :-1])):
            inside = (neighbour >= 0) & (cell >= 0)
            left, right = neighbour[inside], cell[inside]
            np.add.at(matrix, (left, left), 1.0)
            np.add.at(matrix, (right, right), 1.0)
            np.add.at(matrix, (left, right), -1.0)
            np.add.at(matrix, (right, left), -1.0)
        return matrix


class PreisachNNLS:
    """A Preisach density on a triangular grid, with a reversible part."""

    def fit(self, records: Sequence[Record]) -> None:
        """Choose grid, penalty and sign on withheld parts, and fit the density to all records."""
        self._scaling = Scaling.of(records)
        normalised = [self._scaling.normalise(record) for record in records]
        settings = _choose(thin(normalised, MAX_SAMPLES_TO_CHOOSE))
        normalised = add_mirror_images(normalised)
        self._grid = _make_grid(normalised, settings.side)
        used = np.concatenate([record.scored for record in normalised])
        design = np.vstack([self._grid.design(record) for record in normalised])[used]
        y = np.concatenate([record.output for record in normalised])[used]
        self._weights = _solve(
            design.T @ design + y.size * _regularisation(self._grid, settings.penalty),
            design.T @ y,
            0 if settings.is_signed else self._grid.cells,
        )

    def predict(self, record: Record) -> FloatArray:
        """Return the output of the staircase at each sample."""
        return self._scaling.restore(self._grid.design(self._scaling.normalise(record)) @ self._weights)

    def n_parameters(self) -> int:
        """Return the number of densities that are not zero, plus the knots of the reversible part."""
        return int(np.count_nonzero(self._weights))


def _make_grid(records: Sequence[Record], side: int) -> _Grid:
    """Return a grid somewhat larger than the range of the input, made symmetric by one more line."""
    lines = grid_lines(records, side)
    margin = MARGIN * (lines[-1] - lines[0])
    lower, high = float(lines[0] - margin), float(lines[-1] + margin)
    lines = np.concatenate([[lower], lines, [high]])
    if -lower < MIN_SYMMETRY * high:
        lines = np.concatenate([[-high], lines])
    elif high < MIN_SYMMETRY * -lower:
        lines = np.concatenate([lines, [-lower]])
    return _Grid(lines, grid_lines(records, REVERSIBLE_KNOTS - 1))


@dataclass(frozen=True)
class _Settings:
    """What is chosen on withheld parts of the records."""

    side: int
    penalty: float
    is_signed: bool


def _choose(records: Sequence[Record]) -> _Settings:
    """Return the settings with the least withheld error.

    All penalties and both sign rules are tried on the coarsest grid, and the neighbours of the best
    on finer grids.
    """
    errors: dict[_Settings, float] = {}
    for side in SIDES:
        penalties: Sequence[float] = PENALTIES
        signs: Sequence[bool] = (False, True)
        if errors:
            selected = min(errors, key=lambda settings: errors[settings])
            position = PENALTIES.index(selected.penalty)
            penalties, signs = PENALTIES[max(position - 1, 0) : position + 2], (selected.is_signed,)
        for is_signed in signs:
            for penalty, error in _withheld_errors(records, side, penalties, is_signed).items():
                errors[_Settings(side, penalty, is_signed)] = error
    return min(errors, key=errors.__getitem__)


def _withheld_errors(
    records: Sequence[Record], side: int, penalties: Sequence[float], is_signed: bool
) -> dict[float, float]:
    """Return the sum of squared errors at withheld samples for each penalty."""
    used = np.concatenate([record.scored for record in records])
    y = np.concatenate([record.output for record in records])[used]
    grid = _make_grid(records, side)
    design = np.vstack([grid.design(record) for record in records])[used]
    errors = dict.fromkeys(penalties, 0.0)
    for fold in range(FOLDS):
        out = np.concatenate(withheld(records, fold, FOLDS))[used]
        kept = design[~out]
        gram, target = kept.T @ kept, kept.T @ y[~out]
        weights: FloatArray | None = None
        for penalty in penalties:
            matrix = gram + len(kept) * _regularisation(grid, penalty)
            weights = _solve(matrix, target, 0 if is_signed else grid.cells, weights)
            errors[penalty] += float(np.sum((y[out] - design[out] @ weights) ** 2))
    return errors


def _regularisation(grid: _Grid, penalty: float) -> FloatArray:
    """Return the matrix of all penalties, over cells and knots, for one sample."""
    cells = grid.cells
    matrix = RIDGE * np.eye(cells + grid.knots.size)
    # A difference between neighbours counts the more the smaller the cells are.
    matrix[:cells, :cells] += penalty * cells * grid.penalty()
    bend = np.diff(np.eye(grid.knots.size), 2, axis=0)
    matrix[cells:, cells:] += CURVATURE_PENALTY * bend.T @ bend
    return matrix


def _solve(
    matrix: FloatArray, target: FloatArray, bounded_count: int, start: FloatArray | None = None
) -> FloatArray:
    """Return the minimiser of the quadratic form whose first weights are nonnegative.

    The pivoting exchanges all infeasible variables as long as their number decreases, and after
    three failures only the last one, which terminates in exact arithmetic.
    """
    is_free = np.ones(target.size, np.bool_) if start is None else start != 0.0
    bounded = np.arange(target.size) < bounded_count
    smallest_count, chances = target.size + 1, 3
    for _ in range(MAX_EXCHANGES):
        weights = _solve_free(matrix, target, is_free)
        gradient = matrix @ weights - target
        scale = 1e-10 * float(np.max(np.abs(target)))
        infeasible = bounded & ((is_free & (weights < 0.0)) | (~is_free & (gradient < -scale)))
        count = int(np.count_nonzero(infeasible))
        if count == 0:
            return weights
        if count < smallest_count:
            smallest_count, chances = count, 3
        elif chances > 0:
            chances -= 1
        else:
            last = int(np.flatnonzero(infeasible)[-1])
            infeasible = np.arange(target.size) == last
        is_free = is_free ^ infeasible
    return np.where(bounded, np.maximum(weights, 0.0), weights)


def _solve_free(matrix: FloatArray, target: FloatArray, is_free: BoolArray) -> FloatArray:
    """Return the solution whose free variables are given; the others are zero."""
    weights = np.zeros(target.size)
    part = matrix[np.ix_(is_free, is_free)]
    try:
        weights[is_free] = cho_solve(cho_factor(part, overwrite_a=True, check_finite=False), target[is_free])
    except LinAlgError:
        weights[is_free] = np.linalg.lstsq(part, target[is_free])[0]
    return weights


@compiled
def _relay_shares(places: FloatArray, lead_in: int, demagnetisation: FloatArray, side: int) -> FloatArray:
    """Return the share of each cell whose relays are up, shape (n - lead_in, cells).

    The stack contains the extrema that still count, maxima at even positions and minima at odd
    ones. Cells are unit squares in the coordinates of the places.
    """
    stack = np.empty(demagnetisation.size + places.size + 2)
    depth = demagnetisation.size
    stack[:depth] = demagnetisation
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
def _push(base: FloatArray, stack: FloatArray, depth: int, place: float, is_rising: bool, side: int) -> int:
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
def _add_triangle(base: FloatArray, high: float, lower: float, sign: float, side: int) -> None:
    """Add the share of each cell with its up threshold below `high` and its down threshold above `lower`."""
    for i in range(int(lower), min(side, int(np.ceil(high)))):
        up = min(1.0, high - i)
        start = i * (i + 1) // 2
        for j in range(int(lower), i):
            base[start + j] += sign * up * min(1.0, j + 1.0 - lower)
        part = up - max(0.0, lower - i)
        if part > 0.0:
            base[start + i] += sign * part * part


MODELS = {"Preisach, NNLS": lambda: OverSchedule(PreisachNNLS)}
