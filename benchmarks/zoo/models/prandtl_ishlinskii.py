"""A generalised and modified Prandtl-Ishlinskii model: envelope, play operators, and a memoryless output.

The input passes a tanh envelope (Al Janaideh, Rakheja and Su, IEEE/ASME Trans. Mechatronics 16,
2011), a nonnegative sum of play operators, and a memoryless piecewise linear function, which is the
superposition of one-sided dead-zone operators (Kuhnen, European Journal of Control 9, 2003). The
envelope is linear in the limit, so that the modified model of Kuhnen is included. The output
function is free in its slopes, so that the square of a flux density is included too. A piecewise
linear function of the input adds the reversible part.

The output function and the reversible part are linear in their heights, and are eliminated by
variable projection (Golub and Pereyra 1973). The weights of the plays are then found by
Gauss-Newton steps, each a nonnegative least-squares problem with a line search. Envelope,
smoothness and use of creep have the smallest error on withheld parts of the training records.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from ..records import FloatArray, Record
from ._compiled import compiled
from ._over_schedule import OverSchedule
from ._withheld import Scaling, add_mirror_images, grid_lines, hats, start_at_zero, thin, withheld

THRESHOLDS = 32
OUTPUT_KNOTS = 20
REVERSIBLE_KNOTS = 8
CREEP_OPERATORS = 6
STEEPNESSES = (0.0, 0.7, 1.5, 3.0, 6.0, 12.0, 25.0, 60.0)
PENALTIES = (1e-7, 1e-5, 1e-3, 1e-2, 1e-1, 1.0)
WEIGHT_PENALTY = 1e-8
FOLDS = 2
ROUNDS_TO_CHOOSE = 10
ROUNDS = 60
MAX_SAMPLES_TO_CHOOSE = 1500
MIN_STEP = 1.0 / 64.0
MIN_IMPROVEMENT = 1e-5


@dataclass(frozen=True)
class _Regressors:
    """Plays and hat functions of the input at the samples of some records."""

    plays: FloatArray
    reversible: FloatArray

    @classmethod
    def of(
        cls, records: Sequence[Record], steepness: float, knots: FloatArray, creep_times: FloatArray
    ) -> _Regressors:
        """Return the regressors of all records, one after the other."""
        plays = []
        for record in records:
            path = record.path
            u = _envelope(start_at_zero(path.input), steepness)
            plays.append(_run_plays(u, _thresholds())[1 + path.lead_in :])
        inputs = np.concatenate([record.input for record in records])
        creep = np.vstack([_creep(record, creep_times) for record in records])
        return cls(np.vstack(plays), np.hstack([hats(inputs, knots), creep]))

    def rows(self, mask: FloatArray) -> _Regressors:
        """Return the regressors of some samples."""
        return _Regressors(self.plays[mask], self.reversible[mask])


class _Chain:
    """Weighted plays, an output function of their sum, and a reversible part."""

    def __init__(self, penalty: float) -> None:
        self._penalty = penalty

    def fit(self, regressors: _Regressors, y: FloatArray, rounds: int) -> None:
        """Fit the weights from two starts: a linear output, and plays that decrease exponentially."""
        plays = regressors.plays
        decreasing = np.exp(-6.0 * _thresholds())
        slope = np.sign((plays @ decreasing - np.mean(plays @ decreasing)) @ y)
        base = np.column_stack([slope * plays, np.ones(y.size), -np.ones(y.size)])
        linear = _solve_nonnegative(base.T @ base, base.T @ y)[:THRESHOLDS]
        costs = []
        for start in (linear + 1e-6 * decreasing, decreasing):
            self.weights = start
            costs.append((self._descend(regressors, y, rounds), self.weights))
        self.weights = min(costs, key=lambda pair: pair[0])[1]
        self._project(regressors, y)

    def predict(self, regressors: _Regressors) -> FloatArray:
        """Return the output."""
        output: FloatArray = self._basis(regressors) @ self.heights
        return output

    def _basis(self, regressors: _Regressors) -> FloatArray:
        return np.hstack([hats(regressors.plays @ self.weights, self.knots), regressors.reversible])

    def _project(self, regressors: _Regressors, y: FloatArray) -> float:
        """Fit the output function and the reversible part, and return the cost."""
        total = regressors.plays @ self.weights
        self.knots = np.linspace(np.min(total), np.max(total) + 1e-12, OUTPUT_KNOTS)
        basis = self._basis(regressors)
        basis = np.vstack([basis, _smoothness(basis.shape[1], np.sqrt(self._penalty * y.size))])
        target = np.concatenate([y, np.zeros(len(basis) - y.size)])
        self._orthonormal, triangle = np.linalg.qr(basis)
        self.heights = np.linalg.lstsq(triangle, self._orthonormal.T @ target)[0]
        self._residual = target - basis @ self.heights
        return float(self._residual @ self._residual) / y.size

    def _descend(self, regressors: _Regressors, y: FloatArray, rounds: int) -> float:
        """Improve the weights by Gauss-Newton steps, and return the cost."""
        cost = self._project(regressors, y)
        for _ in range(rounds):
            step = self._propose(regressors, y.size)
            start, before, length = self.weights, cost, 1.0
            while length >= MIN_STEP:
                self.weights = start + length * step
                cost = self._project(regressors, y)
                if cost < before:
                    break
                length /= 2.0
            else:
                self.weights = start
                return self._project(regressors, y)
            if before - cost < MIN_IMPROVEMENT * before:
                break
        return cost

    def _propose(self, regressors: _Regressors, count: int) -> FloatArray:
        """Return the step to the nonnegative weights that minimise the linearised cost."""
        total = regressors.plays @ self.weights
        slopes = np.diff(self.heights[:OUTPUT_KNOTS]) / np.diff(self.knots)
        piece = np.clip(np.searchsorted(self.knots, total, side="right") - 1, 0, OUTPUT_KNOTS - 2)
        jacobian = slopes[piece, None] * regressors.plays
        padded = np.vstack([jacobian, np.zeros((len(self._residual) - count, THRESHOLDS))])
        padded -= self._orthonormal @ (self._orthonormal.T @ padded)
        gram = padded.T @ padded
        gram[np.diag_indices(THRESHOLDS)] += WEIGHT_PENALTY * count + 1e-9 * np.trace(gram)
        step: FloatArray = (
            _solve_nonnegative(gram, padded.T @ self._residual + gram @ self.weights) - self.weights
        )
        return step


class PrandtlIshlinskii:
    """A generalised Prandtl-Ishlinskii model with an output function and a reversible part."""

    def fit(self, records: Sequence[Record]) -> None:
        """Choose envelope and smoothness on withheld parts, and fit the weights to all records."""
        self._scaling = Scaling.of(records)
        normalised = [self._scaling.normalise(record) for record in records]
        self._knots = grid_lines(normalised, REVERSIBLE_KNOTS - 1)
        self._steepness, penalty, self._creep_times = self._choose(thin(normalised, MAX_SAMPLES_TO_CHOOSE))
        self._chain = _Chain(penalty)
        normalised = add_mirror_images(normalised)
        used = np.concatenate([record.scored for record in normalised])
        y = np.concatenate([record.output for record in normalised])[used]
        self._chain.fit(
            _Regressors.of(normalised, self._steepness, self._knots, self._creep_times).rows(used), y, ROUNDS
        )

    def predict(self, record: Record) -> FloatArray:
        """Return the output at each sample."""
        normalised = self._scaling.normalise(record)
        return self._scaling.restore(
            self._chain.predict(_Regressors.of([normalised], self._steepness, self._knots, self._creep_times))
        )

    def n_parameters(self) -> int:
        """Return the nonzero weights, the heights of both functions, and the steepness."""
        return int(np.count_nonzero(self._chain.weights)) + len(self._chain.heights) + 1

    def _choose(self, records: Sequence[Record]) -> tuple[float, float, FloatArray]:
        """Return steepness, penalty and time constants of creep with the smallest withheld error."""
        used = np.concatenate([record.scored for record in records])
        y = np.concatenate([record.output for record in records])[used]
        folds = [np.concatenate(withheld(records, fold, FOLDS))[used] for fold in range(FOLDS)]
        errors = {}
        creep_times = _choose_creep_times(records)
        sizes = (0, creep_times.size) if creep_times.size else (0,)
        for steepness, penalty, size in itertools.product(STEEPNESSES, PENALTIES, sizes):
            regressors = _Regressors.of(records, steepness, self._knots, creep_times[:size]).rows(used)
            errors[steepness, penalty, size] = 0.0
            for out in folds:
                chain = _Chain(penalty)
                chain.fit(regressors.rows(~out), y[~out], ROUNDS_TO_CHOOSE)
                residual = y[out] - chain.predict(regressors.rows(out))
                errors[steepness, penalty, size] += float(residual @ residual)
        steepness, penalty, size = min(errors, key=lambda key: errors[key])
        return steepness, penalty, creep_times[:size]


def _thresholds() -> FloatArray:
    """Return the thresholds of the plays, denser near zero."""
    thresholds: FloatArray = (np.arange(THRESHOLDS) / THRESHOLDS) ** 1.5
    return thresholds


def _envelope(u: FloatArray, steepness: float) -> FloatArray:
    """Return the input after the envelope, which maps -1, 0 and 1 to themselves."""
    if steepness == 0.0:
        return u
    mapped: FloatArray = np.tanh(steepness * u) / np.tanh(steepness)
    return mapped


def _smoothness(columns: int, weight: float) -> FloatArray:
    """Return rows that penalise the curvature of both functions and, slightly, every coefficient."""
    knots = OUTPUT_KNOTS + REVERSIBLE_KNOTS
    bend = np.diff(np.eye(knots, columns), 2, axis=0)
    across = [OUTPUT_KNOTS - 2, OUTPUT_KNOTS - 1]  # rows that would couple both functions
    return np.vstack([weight * np.delete(bend, across, axis=0), 1e-2 * weight * np.eye(columns)])


def _choose_creep_times(records: Sequence[Record]) -> FloatArray:
    """Return time constants from a time step to the longest record, or none without times."""
    times = [record.time for record in records if record.time is not None]
    if len(times) < len(records):
        return np.zeros(0)
    shortest = min(float(np.median(np.diff(time))) for time in times)
    longest = max(float(time[-1] - time[0]) for time in times)
    return np.geomspace(shortest, longest, CREEP_OPERATORS)


def _creep(record: Record, creep_times: FloatArray) -> FloatArray:
    """Return the input after first-order lags at each sample, shape (n, time constants)."""
    path = record.path
    states = np.zeros((path.input.size, creep_times.size))
    if creep_times.size and path.time is not None:
        shares = np.exp(-np.diff(path.time)[:, None] / creep_times)
        states[0] = path.input[0]
        for sample in range(1, path.input.size):
            middle = 0.5 * (path.input[sample] + path.input[sample - 1])
            states[sample] = middle + shares[sample - 1] * (states[sample - 1] - middle)
    return states[path.lead_in :]


def _solve_nonnegative(gram: FloatArray, target: FloatArray) -> FloatArray:
    """Return the nonnegative minimiser of a quadratic form."""
    triangle = np.linalg.cholesky(gram + 1e-12 * np.trace(gram) * np.eye(len(gram))).T
    solution: FloatArray = nnls(triangle, np.linalg.solve(triangle.T, target), maxiter=100 * target.size)[0]
    return solution


@compiled
def _run_plays(u: FloatArray, thresholds: FloatArray) -> FloatArray:
    """Return the plays at each sample; they start at rest at zero, shape (n, thresholds)."""
    plays = np.empty((u.size, thresholds.size))
    state = np.zeros(thresholds.size)
    for sample in range(u.size):
        for index in range(thresholds.size):
            lower, upper = u[sample] - thresholds[index], u[sample] + thresholds[index]
            state[index] = max(lower, min(upper, state[index]))
            plays[sample, index] = state[index]
    return plays


MODELS = {"Prandtl-Ishlinskii": lambda: OverSchedule(PrandtlIshlinskii)}
