"""Least squares on the analytic derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst.identification.cell_kernel import WeightKernel
from anhyst.identification.objective import Objective
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import NoResponseError

_PATIENT = 5
"""Steps after which the pace of a descent says how far it comes."""


@dataclass(frozen=True, eq=False)
class Fit:
    """End of one descent."""

    theta: FloatArray  # coordinates, shape (size,)
    cost: float  # weighted sum of squares


@dataclass(frozen=True, eq=False)
class Linear:
    """Deviations near a point to first order: what a step of least squares needs of them."""

    deviation: FloatArray  # weighted deviations, shape (samples,)
    gradient: FloatArray  # of half their sum of squares, shape (size,)
    normal: FloatArray  # their derivatives times themselves, shape (size, size)

    @property
    def cost(self) -> float:
        """Weighted sum of squares."""
        return float(self.deviation @ self.deviation)


class Evaluation:
    """Deviations of an objective to first order, by analytic derivatives where there are any."""

    def __init__(self, objective: Objective) -> None:
        self.objective = objective
        self.analytic = objective.space.form.kernel.differentiated

    def at(self, theta: FloatArray) -> Linear:
        """Linearise at a point; without any slope where the law has no answer."""
        if not self.analytic:
            deviation = self.objective.deviations(theta)
            jacobian = self.differences(theta)
            return Linear(deviation, deviation @ jacobian, jacobian.T @ jacobian)
        try:
            return Linear(*self.objective.normal(theta))
        except NoResponseError:
            nothing = np.zeros((theta.size, theta.size))
            return Linear(self.objective.impossible, nothing[0], nothing)

    def worth(self, theta: FloatArray, cost: float) -> Linear | None:
        """Linearise where the cost is below another; a numerical derivative is dear."""
        if not self.analytic:
            deviations = self.objective.deviations(theta)
            if float(deviations @ deviations) >= cost:
                return None
        there = self.at(theta)
        return there if there.cost < cost else None

    def differences(self, theta: FloatArray) -> FloatArray:
        """Central differences, turned inward at the bounds."""
        low, high = self.objective.space.bounds
        columns = []
        for index in range(theta.size):
            ends = []
            for side in (-1e-5, 1e-5):
                moved = theta.copy()
                moved[index] = np.clip(moved[index] + side, low[index], high[index])
                ends.append((moved[index], self.objective.deviations(moved)))
            columns.append((ends[1][1] - ends[0][1]) / (ends[1][0] - ends[0][0]))
        return np.stack(columns, axis=1)


def _step(there: Linear, free: NDArray[np.bool_], damping: float) -> FloatArray:
    """Damped Gauss-Newton step in the free coordinates, zero in the others."""
    normal = there.normal[np.ix_(free, free)]
    diagonal = np.diag(normal)
    normal[np.diag_indices_from(normal)] += damping * np.maximum(diagonal, 1e-9 * diagonal.max())
    step = np.zeros(there.gradient.size)
    step[free] = -np.linalg.solve(normal, there.gradient[free])
    return step


def _step_of_weights(
    there: Linear, theta: FloatArray, low: FloatArray, damping: float
) -> FloatArray:
    """Best damped step above the lower bounds: of many weights most end there, together."""
    from scipy.optimize import nnls

    diagonal = np.diag(there.normal)
    normal = there.normal + np.diag(damping * np.maximum(diagonal, 1e-9 * diagonal.max()))
    root = np.linalg.cholesky(normal).T
    above, _ = nnls(root, root @ (theta - low) - np.linalg.solve(root.T, there.gradient))
    return np.asarray(above + low - theta)


def descend(
    objective: Objective, theta: FloatArray, tolerance: float, most: int, goal: float = np.inf
) -> Fit:
    """Least squares from a start, within the bounds of the space.

    A descent that at its pace would not come below its goal in the steps left, ends.

    Levenberg-Marquardt with Nielsen's damping; coordinates at a bound that the gradient presses
    outward rest; the weights of cells take the best step within them (SciPy's ``nnls``). The problem
    is tall and narrow (thousands of samples, ten coordinates), where the singular value
    decompositions of a general solver cost several times the law itself.
    """
    low, high = objective.space.bounds
    evaluation = Evaluation(objective)
    theta = np.clip(theta, low, high)
    here = evaluation.at(theta)
    damping, growth = 1e-3, 2.0
    by_weights = isinstance(objective.space.form.cells, WeightKernel)
    for left in range(most - 1, 0, -1):
        inward = here.gradient
        free = ~(((theta <= low) & (inward > 0.0)) | ((theta >= high) & (inward < 0.0)))
        if not free.any() or not np.any(np.diag(here.normal)[free]):
            break
        if by_weights:
            trial = np.clip(theta + _step_of_weights(here, theta, low, damping), low, high)
        else:
            trial = np.clip(theta + _step(here, free, damping), low, high)
        step = trial - theta
        foreseen = -float(step @ (2.0 * here.gradient + here.normal @ step))
        new = evaluation.worth(trial, here.cost)
        if new is not None:
            gained = here.cost - new.cost
            ratio = gained / max(foreseen, 1e-300)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * min(ratio, 1.0) - 1.0) ** 3)
            growth = 2.0
            hopeless = left < most - _PATIENT and new.cost - gained * left > goal
            finished = hopeless or gained <= tolerance * here.cost
            theta, here = trial, new
            if finished:
                break
        else:
            damping *= growth
            growth *= 2.0
            if abs(foreseen) <= tolerance * here.cost or damping > 1e12:
                break
    return Fit(theta, here.cost)
