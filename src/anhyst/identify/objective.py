"""The deviation between measured and modelled loops, over all loops and gaps at once."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from anhyst.identify.cell_response import CellResponder
from anhyst.identify.no_response import NoResponseError
from anhyst.identify.response import Local, Responder
from anhyst.identify.space import CoordinateSpace
from anhyst.support.arrays import FloatArray

_IMPOSSIBLE = 10.0
"""Deviation, in units of the largest output, where the law has no answer."""


@dataclass
class Objective:
    """Weighted deviations as a function of the coordinates of a space.

    The sum of squares is the mean square deviation relative to the largest output, as far as the
    weights make all samples equal. ``evaluations`` counts calls.

    With ``tie`` above zero, differences of coordinates from gap to gap count as deviations too,
    times its square root: what the loops do not determine then runs smoothly over the gap instead of
    anyhow.
    """

    space: CoordinateSpace
    tie: float = 0.0
    evaluations: int = 0
    _responder: Responder | CellResponder = field(init=False)

    def __post_init__(self) -> None:
        self._responder = CellResponder() if self.space.form.populations else Responder()
        loops = self.space.records.loops
        self.measured = np.concatenate([record.output for record in loops])
        self.weights = np.concatenate([np.full(r.output.size, r.weight) for r in loops])
        self._ties = np.sqrt(self.tie) * _differences(self.space)

    @property
    def impossible(self) -> FloatArray:
        """Deviations that stand for parameters without an answer."""
        far = _IMPOSSIBLE * self.space.records.output_span * self.weights
        return np.concatenate([far, np.zeros(self._ties.shape[0])])

    def outputs(self, sets: list[Local]) -> FloatArray:
        """Modelled outputs of all loops, one after the other, SI."""
        self.evaluations += 1
        return np.concatenate(
            self._responder.outputs(self.space.form, sets, self.space.records.loops)
        )

    def deviations(self, theta: FloatArray) -> FloatArray:
        """Weighted deviations, shape (samples,), and ties, if any, after them."""
        try:
            found = self.outputs([local for local, _ in self.space.unpack(theta)])
        except NoResponseError:
            return self.impossible
        return np.concatenate([(found - self.measured) * self.weights, self._ties @ theta])

    def _derivatives(
        self, sets: list[tuple[Local, FloatArray]]
    ) -> list[tuple[FloatArray, FloatArray]]:
        loops = self.space.records.loops
        return self._responder.derivatives(self.space.form, [one for one, _ in sets], loops)

    def with_jacobian(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Deviations as above and their derivatives, one row for each, shape (.., size)."""
        self.evaluations += 1
        sets = self.space.unpack(theta)
        loops = self.space.records.loops
        values, rows = [], []
        for record, (output, by_local) in zip(loops, self._derivatives(sets), strict=True):
            values.append((output - record.output) * record.weight)
            rows.append((by_local * record.weight) @ sets[record.gap][1])
        values.append(self._ties @ theta)
        rows.append(self._ties)
        return np.concatenate(values), np.concatenate(rows)

    def normal(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Deviations as above, gradient of half their sum of squares, and normal matrix.

        Gap by gap from the parameters there: what one gap does not share with the others
        costs nothing at theirs, and no product is large enough for a library to spread it over
        threads that then wait for each other.
        """
        self.evaluations += 1
        sets = self.space.unpack(theta)
        numbers = len(self.space.form.names)
        squares = np.zeros((len(sets), numbers, numbers))
        slopes = np.zeros((len(sets), numbers))
        values = []
        loops = self.space.records.loops
        for record, (output, by_local) in zip(loops, self._derivatives(sets), strict=True):
            value, weighted = (output - record.output) * record.weight, by_local * record.weight
            squares[record.gap] += weighted.T @ weighted
            slopes[record.gap] += value @ weighted
            values.append(value)
        values.append(self._ties @ theta)
        gradient, matrix = self._ties.T @ values[-1], self._ties.T @ self._ties
        for (_, by_theta), square, slope in zip(sets, squares, slopes, strict=True):
            gradient = gradient + slope @ by_theta
            matrix = matrix + by_theta.T @ square @ by_theta
        return np.concatenate(values), gradient, matrix


def _differences(space: CoordinateSpace) -> FloatArray:
    """Rows that take the difference of a coordinate between neighbouring gaps; offsets are free."""
    place = {entry: at for at, entry in enumerate(space.entries)}
    pairs = [
        (place[name, gap], place[name, gap + 1])
        for name, gap in space.entries
        if gap is not None and gap + 1 < space.records.gaps and name not in {"in_0", "out_0"}
    ]
    rows = np.zeros((len(pairs), space.size))
    for row, (first, second) in zip(rows, pairs, strict=True):
        row[first], row[second] = -1.0, 1.0
    return rows
