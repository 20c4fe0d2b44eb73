"""Least squares on the analytic derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst.identify.objective import Objective
from anhyst.identify.response import NoResponseError

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
    """

    theta: Floats
    cost: float


class Evaluation:
    """Deviations and derivatives come from one run of the law; SciPy asks for them apart."""

    def __init__(self, objective: Objective) -> None:
        self.objective = objective
        self.analytic = objective.space.form.law == "effective-field"
        self.at = np.array([np.nan])
        self.jacobian = np.empty((0, 0))

    def deviations(self, theta: Floats) -> Floats:
        """Weighted deviations, shape (samples,)."""
        if not self.analytic:
            return self.objective.deviations(theta)
        try:
            found, self.jacobian = self.objective.with_jacobian(theta)
        except NoResponseError:
            found = self.objective.impossible
            self.jacobian = np.zeros((found.size, theta.size))
        self.at = theta.copy()
        return found

    def derivatives(self, theta: Floats) -> Floats:
        """Their derivatives by the coordinates, shape (samples, size)."""
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


def _step(
    fit_jacobian: Floats, gradient: Floats, free: NDArray[np.bool_], damping: float
) -> Floats:
    """Damped Gauss-Newton step in the free coordinates, zero in the others."""
    normal = fit_jacobian[:, free].T @ fit_jacobian[:, free]
    diagonal = np.diag(normal)
    normal[np.diag_indices_from(normal)] += damping * np.maximum(diagonal, 1e-9 * diagonal.max())
    step = np.zeros(gradient.size)
    step[free] = -np.linalg.solve(normal, gradient[free])
    return step


def descend(objective: Objective, theta: Floats, tolerance: float = 1e-10, most: int = 200) -> Fit:
    """Least squares from a start, within the bounds of the space.

    Levenberg-Marquardt with Nielsen's damping; coordinates at a bound that the gradient presses
    outward rest. The problem is tall and narrow (thousands of samples, ten coordinates), where the
    singular value decompositions of a general solver cost several times the law itself.

    Parameters
    ----------
    objective : Objective
        What is fitted.
    theta : ndarray, shape (size,)
        Start; brought within the bounds.
    tolerance : float
        Relative change of the cost at which to end.
    most : int
        Evaluations at most.

    Returns
    -------
    Fit
    """
    low, high = objective.space.bounds
    evaluation = Evaluation(objective)
    theta = np.clip(theta, low, high)
    deviation = evaluation.deviations(theta)
    jacobian = evaluation.derivatives(theta)
    cost = float(deviation @ deviation)
    damping, growth = 1e-3, 2.0
    for _ in range(most - 1):
        gradient = jacobian.T @ deviation
        free = ~(((theta <= low) & (gradient > 0.0)) | ((theta >= high) & (gradient < 0.0)))
        if not free.any() or not np.any(jacobian[:, free]):
            break
        trial = np.clip(theta + _step(jacobian, gradient, free, damping), low, high)
        new = evaluation.deviations(trial)
        new_cost = float(new @ new)
        linear = deviation + jacobian @ (trial - theta)
        foreseen = cost - float(linear @ linear)
        if new_cost < cost:
            jacobian = evaluation.derivatives(trial)
            ratio = (cost - new_cost) / max(foreseen, 1e-300)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * min(ratio, 1.0) - 1.0) ** 3)
            growth = 2.0
            finished = cost - new_cost <= tolerance * cost
            theta, deviation, cost = trial, new, new_cost
            if finished:
                break
        else:
            damping *= growth
            growth *= 2.0
            if abs(foreseen) <= tolerance * cost or damping > 1e12:
                break
    return Fit(theta, cost)
