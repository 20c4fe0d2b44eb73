"""Fit of models that are nonlinear in a few parameters and linear in the others.

The linear parameters are eliminated by least squares at each evaluation (variable projection).
Differential evolution (Storn and Price 1997) searches the other parameters, and a trust-region
least-squares method polishes the best of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import differential_evolution, least_squares

from ..records import BoolArray, FloatArray, Record

SEED = 53
RIDGE = 1e-8
POPULATION_PER_PARAMETER = 10

Residual = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Drive:
    """The complete inputs of some records, one after the other; each begins at rest at zero."""

    input: FloatArray
    is_start: BoolArray  # the sample is a zero before a record
    rows: BoolArray  # the sample belongs to a record, and not to its lead-in
    output: FloatArray  # at the rows

    @classmethod
    def of(cls, records: Sequence[Record]) -> Drive:
        """Return the drive of some records."""
        inputs, starts, rows = [], [], []
        for record in records:
            path = record.path
            count = path.input.size + 1
            inputs.append(np.concatenate([[0.0], path.input]))
            starts.append(np.arange(count) == 0)
            rows.append(np.arange(count) > path.lead_in)
        return cls(
            np.concatenate(inputs),
            np.concatenate(starts),
            np.concatenate(rows),
            np.concatenate([record.output for record in records]),
        )


def evolve(residual: Residual, bounds: FloatArray, evaluations: int) -> FloatArray:
    """Return the parameters within bounds that minimise the sum of squared residuals."""
    population = POPULATION_PER_PARAMETER * len(bounds)
    result = differential_evolution(
        lambda theta: float(np.sum(residual(theta) ** 2)),
        bounds,
        maxiter=max(1, evaluations // population - 1),
        popsize=POPULATION_PER_PARAMETER,
        mutation=(0.4, 0.9),
        recombination=0.8,
        init="sobol",
        tol=1e-6,
        polish=False,
        rng=SEED,
    )
    parameters: FloatArray = result.x
    return parameters


def polish(residual: Residual, theta: FloatArray, bounds: FloatArray, evaluations: int) -> FloatArray:
    """Return the parameters of the nearest minimum of the sum of squared residuals."""
    width = bounds[:, 1] - bounds[:, 0]
    result = least_squares(
        residual,
        np.clip(theta, bounds[:, 0] + 1e-6 * width, bounds[:, 1] - 1e-6 * width),
        bounds=(bounds[:, 0], bounds[:, 1]),
        x_scale=width,
        diff_step=1e-5,
        max_nfev=evaluations,
    )
    parameters: FloatArray = result.x
    return parameters


def solve_linear(features: FloatArray, output: FloatArray) -> FloatArray:
    """Return the coefficients of the features by least squares."""
    size = np.sqrt(np.sum(features**2, axis=0)) + 1e-300
    scaled = features / size
    gram = scaled.T @ scaled
    gram[np.diag_indices(len(gram))] += RIDGE
    solution: FloatArray = np.linalg.solve(gram, scaled.T @ output) / size
    return solution
