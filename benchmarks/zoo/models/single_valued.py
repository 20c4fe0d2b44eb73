"""The best single-valued curve: what a calibration table without hysteresis can reach.

The curve is a cubic spline that is fitted by least squares with a light penalty on its curvature
(the P-spline of Eilers and Marx, Statistical Science 11, 1996). The number of its intervals and the
penalty are those with the smallest error on withheld parts of the training records. The knots lie
at equal shares of the travel of input and output. The curve continues linearly outside.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import BSpline

from ..records import FloatArray, Record
from ._over_schedule import OverSchedule
from ._withheld import Scaling, add_mirror_images, grid_lines, withheld

INTERVALS = (1, 2, 4, 8, 16, 32)
PENALTIES = (1e-8, 1e-5, 1e-2)
FOLDS = 4
DEGREE = 3


class SingleValued:
    """A cubic spline of the input."""

    def fit(self, records: Sequence[Record]) -> None:
        """Fit the spline; its flexibility is chosen on withheld parts of the records."""
        self._scaling = Scaling.of(records)
        normalised = [self._scaling.normalise(record) for record in records]
        used = np.concatenate([record.scored for record in normalised])
        u = np.concatenate([record.input for record in normalised])[used]
        y = np.concatenate([record.output for record in normalised])[used]
        folds = [np.concatenate(withheld(normalised, fold, FOLDS))[used] for fold in range(FOLDS)]
        odd_records = add_mirror_images(normalised)
        odd_used = np.concatenate([record.scored for record in odd_records])
        odd_u = np.concatenate([record.input for record in odd_records])[odd_used]
        odd_y = np.concatenate([record.output for record in odd_records])[odd_used]
        smallest_error = np.inf
        for intervals in INTERVALS:
            lines = grid_lines(normalised, intervals)
            basis = _basis(u, lines)
            for penalty in PENALTIES:
                error = sum(
                    float(np.sum((y[out] - basis[out] @ _solve(basis[~out], y[~out], penalty)) ** 2))
                    for out in folds
                )
                if error < smallest_error * (1.0 - 1e-3):
                    smallest_error = error
                    self._lines, self._weights = lines, _solve(_basis(odd_u, lines), odd_y, penalty)

    def predict(self, record: Record) -> FloatArray:
        """Return the value of the curve at each sample."""
        return self._scaling.restore(_basis(record.input / self._scaling.input, self._lines) @ self._weights)

    def n_parameters(self) -> int:
        """Return the number of coefficients of the spline."""
        return int(self._weights.size)


def _basis(u: FloatArray, lines: FloatArray) -> FloatArray:
    """Return the B-splines at each input, continued linearly outside, shape (n, intervals + 3)."""
    knots = np.concatenate([[lines[0]] * DEGREE, lines, [lines[-1]] * DEGREE])
    splines = BSpline(knots, np.eye(lines.size + DEGREE - 1), DEGREE)
    inside = np.clip(u, lines[0], lines[-1])
    values: FloatArray = splines(inside) + (u - inside)[:, None] * splines.derivative()(inside)
    return values


def _solve(basis: FloatArray, y: FloatArray, penalty: float) -> FloatArray:
    """Return the coefficients that minimise the squared residual and the penalty on curvature."""
    bend = np.diff(np.eye(basis.shape[1]), 2, axis=0)
    weight = np.sqrt(penalty * y.size)
    weights: FloatArray = np.linalg.lstsq(
        np.vstack([basis, weight * bend]), np.concatenate([y, np.zeros(len(bend))])
    )[0]
    return weights


MODELS = {"single-valued curve": lambda: OverSchedule(SingleValued)}
