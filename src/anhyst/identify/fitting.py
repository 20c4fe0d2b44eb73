"""Least squares on the analytic derivatives, and what its end says about the parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from anhyst.identify.objective import Objective
from anhyst.identify.response import NoResponse

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fit:
    """End of one descent.

    Parameters
    ----------
    theta
        Coordinates, shape (size,).
    cost
        Weighted sum of squares.
    jacobian
        Derivatives of the weighted deviations there, shape (samples, size).
    """

    theta: Floats
    cost: float
    jacobian: Floats

    @property
    def rms(self) -> float:
        """Weighted root mean square deviation relative to the largest output."""
        return float(np.sqrt(self.cost))


class _Evaluation:
    """Deviations and derivatives come from one run of the law; SciPy asks for them apart."""

    def __init__(self, objective: Objective) -> None:
        self.objective = objective
        self.analytic = objective.space.form.law == "effective-field"
        self.at = np.array([np.nan])
        self.jacobian = np.empty((0, 0))

    def deviations(self, theta: Floats) -> Floats:
        if not self.analytic:
            return self.objective.deviations(theta)
        try:
            found, self.jacobian = self.objective.with_jacobian(theta)
        except NoResponse:
            return self.objective.impossible
        self.at = theta.copy()
        return found

    def derivatives(self, theta: Floats) -> Floats:
        if not self.analytic:
            return self._differences(theta)
        if not np.array_equal(theta, self.at):
            self.deviations(theta)
        return self.jacobian

    def _differences(self, theta: Floats) -> Floats:
        """Central differences, turned inward at the bounds."""
        low, high = self.objective.space.bounds
        columns = []
        for place in range(theta.size):
            ends = []
            for side in (-1e-5, 1e-5):
                moved = theta.copy()
                moved[place] = np.clip(moved[place] + side, low[place], high[place])
                ends.append((moved[place], self.objective.deviations(moved)))
            columns.append((ends[1][1] - ends[0][1]) / (ends[1][0] - ends[0][0]))
        return np.stack(columns, axis=1)


def descend(objective: Objective, theta: Floats, tolerance: float = 1e-9, most: int = 200) -> Fit:
    """Least squares from a start, within the bounds of the space.

    Parameters
    ----------
    objective : Objective
        What is fitted.
    theta : ndarray, shape (size,)
        Start; brought within the bounds.
    tolerance : float
        Relative change of cost and coordinates at which to end.
    most : int
        Evaluations at most.

    Returns
    -------
    Fit
    """
    low, high = objective.space.bounds
    inward = 1e-6 * (high - low)
    evaluation = _Evaluation(objective)
    found = least_squares(
        evaluation.deviations,
        np.clip(theta, low + inward, high - inward),
        evaluation.derivatives,
        bounds=(low, high),
        ftol=tolerance,
        xtol=tolerance,
        gtol=1e-14,
        max_nfev=most,
    )
    return Fit(found.x, float(2.0 * found.cost), np.asarray(found.jac))
