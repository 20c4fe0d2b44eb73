"""The deviation between measured and modelled loops, over all loops and gaps at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anhyst.identification.cell_response import CellResponder
from anhyst.identification.response import Local, Responder
from anhyst.identification.space import CoordinateSpace
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import NoResponseError

EXPECTED = 1e-8
"""Cost of a number one spread away from what is expected of it, in parts of the largest output
squared: as much as a deviation of a ten-thousandth."""

DRIFT = 0.003
"""Spread of what a sensor of the output drifts by in a record, in parts of the largest output."""

_PIECE = 20_000
"""Samples of which derivatives are held at once: a long record must not cost memory by its length
times its numbers. A law of Jiles and Atherton, with few numbers, needs its cycle whole to close it."""

_IMPOSSIBLE = 10.0
"""Deviation, in units of the largest output, where the law has no answer."""


@dataclass
class Objective:
    """Weighted deviations as a function of the coordinates of a space.

    The sum of squares is the mean square deviation relative to the largest output, as far as the
    weights make all samples equal. ``evaluations`` counts calls.

    With ``tie`` above zero, differences of coordinates from gap to gap count as deviations too,
    times its square root: what the loops do not determine then runs smoothly over the gap instead of
    anyhow. Numbers of which something is expected count as :data:`EXPECTED` says.

    Of play cells, what a steady drift of the output since the first sample at a gap can explain is no
    deviation, where a clock says which loop was run when: its slope is the one with the least cost.
    A law of Jiles and Atherton misses loops by more than sensors drift, and would take that for one.
    """

    space: CoordinateSpace
    tie: float = 0.0
    evaluations: int = 0

    def __post_init__(self) -> None:
        loops = self.space.records.loops
        self._responder: Responder | CellResponder = Responder()
        if self.space.form.cells:
            self._responder = CellResponder()
            loops = tuple(piece for record in loops for piece in record.pieces(_PIECE))
        self._loops = loops
        self.measured = np.concatenate([record.output for record in loops])
        self.weights = np.concatenate([record.weights for record in loops])
        self._ties = np.sqrt(self.tie) * _differences(self.space)
        self._pull, self._usual = _expectations(self.space)
        self._held = self._ties.T @ self._ties + self._pull.T @ self._pull
        clocks = np.concatenate([record.clock for record in loops]) * bool(self.space.form.cells)
        self._drift = _Drift(self.space.records.output_span * clocks * self.weights)

    @property
    def impossible(self) -> FloatArray:
        """Deviations that stand for parameters without an answer."""
        far = _IMPOSSIBLE * self.space.records.output_span * self.weights
        return np.concatenate([far, np.zeros(1 + self._ties.shape[0] + self._usual.size)])

    def outputs(self, sets: list[Local]) -> FloatArray:
        """Modelled outputs of all loops, one after the other, SI."""
        self.evaluations += 1
        return np.concatenate(self._responder.outputs(self.space.form, sets, self._loops))

    def deviations(self, theta: FloatArray) -> FloatArray:
        """Weighted deviations, shape (samples,), and ties, if any, after them."""
        try:
            outputs = self.outputs([local for local, _ in self.space.unpack(theta)])
        except NoResponseError:
            return self.impossible
        off = (outputs - self.measured) * self.weights
        off, cost = self._drift.without(off)
        return np.concatenate([off, cost, self._ties @ theta, self._pull @ theta - self._usual])

    def normal(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Deviations as above, gradient of half their sum of squares, and normal matrix.

        Gap by gap from the parameters there: what one gap does not share with the others
        costs nothing at theirs, and no product is large enough for a library to spread it over
        threads that then wait for each other.
        """
        self.evaluations += 1
        sets = self.space.unpack(theta)
        numbers = len(self.space.at_gap)
        squares = np.zeros((len(sets), numbers, numbers))
        slopes = np.zeros((len(sets), numbers))
        values, along = [], np.zeros((len(sets), numbers))
        first = 0
        responses = self._responder.derivatives(
            self.space.form, [one for one, _ in sets], self._loops
        )
        for gap, output, by_local in responses:
            part = slice(first, first + output.size)
            weights = self.weights[part]
            value, weighted = (output - self.measured[part]) * weights, by_local * weights[:, None]
            squares[gap] += weighted.T @ weighted
            slopes[gap] += value @ weighted
            if self._drift.known:
                along[gap] += self._drift.way[part] @ weighted
            first = part.stop
            values.append(value)
        whole = np.concatenate(values)
        off, cost = self._drift.without(whole)
        values = [off, cost, self._ties @ theta, self._pull @ theta - self._usual]
        gradient = self._ties.T @ values[-2] + self._pull.T @ values[-1]
        matrix = self._held
        for (_, by_theta), square, slope in zip(sets, squares, slopes, strict=True):
            gradient = gradient + slope @ by_theta
            matrix = matrix + by_theta.T @ square @ by_theta
        if self._drift.known:
            by_drift = np.einsum("gn,gnk->k", along, np.stack([one for _, one in sets]))
            gradient = gradient - self._drift.slope(whole) * by_drift
            matrix = matrix - np.outer(by_drift, by_drift) / self._drift.size
        return np.concatenate(values), gradient, matrix


class _Drift:
    """A steady drift along the deviations, and what it leaves of them."""

    def __init__(self, way: FloatArray) -> None:
        self.way = way
        self._loose = np.sqrt(EXPECTED) / DRIFT
        self.size = float(way @ way) + self._loose**2
        self.known = bool(np.any(way))

    def slope(self, deviation: FloatArray) -> FloatArray:
        """Slope with the least cost, of each column."""
        return np.asarray(self.way @ deviation / self.size)

    def without(self, deviation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Take it off the columns; and what it costs, one row."""
        slope = self.slope(deviation)
        return deviation - np.multiply.outer(self.way, slope), self._loose * slope[None]


def _differences(space: CoordinateSpace) -> FloatArray:
    """Rows that take the difference of a coordinate between neighbouring gaps; offsets are free."""
    column = {entry: at for at, entry in enumerate(space.entries)}
    pairs = [
        (column[name, gap], column[name, gap + 1])
        for name, gap in space.entries
        if gap is not None and gap + 1 < space.records.gaps and name not in {"in_0", "out_0"}
    ]
    rows = np.zeros((len(pairs), space.size))
    for row, (first, second) in zip(rows, pairs, strict=True):
        row[first], row[second] = -1.0, 1.0
    return rows


def _expectations(space: CoordinateSpace) -> tuple[FloatArray, FloatArray]:
    """Rows that take a coordinate in parts of its spread, and what is expected of them."""
    numbers = [space.numbers[name] for name, _ in space.entries]
    places = [column for column, number in enumerate(numbers) if number.usual is not None]
    rows, usual = np.zeros((len(places), space.size)), np.zeros(len(places))
    for row, column in enumerate(places):
        number = numbers[column]
        assert number.usual is not None
        rows[row, column] = np.sqrt(EXPECTED) / number.spread
        usual[row] = rows[row, column] * space.inward(number.name, number.usual)
    return rows, usual
