"""A mass on a spring with a Bouc-Wen force, whose displacement is the output.

The input is interpolated by a cubic spline between its samples, and the equations are integrated
with the classical fourth-order Runge-Kutta method. The displacement is computed for a unit gain of
the input; the gain and the offset of the output are linear.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import csd, welch

from ..records import FloatArray, Record
from ._compiled import compiled
from ._evolution import evolve, polish, solve_linear

BOUNDS = np.array(
    [
        (-1.2, 0.5),  # logarithm of the eigenfrequency, relative to that of the linear estimate
        (-7.0, 0.5),  # logarithm of the damping ratio
        (-0.5, 0.5),  # cubic stiffness at the static displacement of the largest input
        (0.0, 3.0),  # stiffness of the hysteretic force, relative to the elastic one
        (-5.0, 2.0),  # logarithm of the width, relative to the same displacement
        (-1.0, 1.5),  # logarithm of the exponent
        (-1.0, 1.0),  # beta + gamma, which counts while the hysteretic force grows
        (-1.5, 1.0),  # gamma - beta, which counts while it decreases
    ]
)
"""Bounds of the parameters in the time unit of the linear estimate."""

SAMPLES_TO_EVOLVE = 1200
SAMPLES_TO_POLISH = 3000
UNSETTLED_SHARE = 0.3
"""Share of an excerpt that does not count, because the excerpt starts at rest."""

EVALUATIONS = 6000
EVALUATIONS_TO_POLISH = 40
EVALUATIONS_TO_FINISH = 5
SUBSTEPS = 3
LIMIT = 1e3
"""Displacement at which a simulation counts as unstable; the static displacement is 1."""


@dataclass(frozen=True)
class _Force:
    """The complete input of a record at all stages of the integration."""

    values: FloatArray  # shape (n - 1, 2 SUBSTEPS + 1)
    steps: FloatArray  # time steps between the samples
    lead_in: int

    @classmethod
    def of(cls, record: Record, frequency: float) -> _Force:
        """Return the force of a record; the unit of time is the inverse of an angular frequency."""
        path = record.path
        assert path.time is not None
        time = (path.time - path.time[0]) * frequency
        shares = np.linspace(0.0, 1.0, 2 * SUBSTEPS + 1)
        grid = time[:-1, None] + np.diff(time)[:, None] * shares
        return cls(CubicSpline(time, path.input)(grid), np.diff(time), path.lead_in)


class Oscillator:
    """A mass on a spring with a Bouc-Wen force, in normalised units of input and output."""

    def fit(self, records: Sequence[Record]) -> float:
        """Fit the model and return the mean squared error at the samples that count."""
        self._frequency = _estimate_frequency(records)
        coarse = self._residual_of(_excerpts(records, SAMPLES_TO_EVOLVE))
        middle = self._residual_of(_excerpts(records, SAMPLES_TO_POLISH))
        all_residual = self._residual_of(records)
        start = evolve(lambda theta: coarse(theta)[0], BOUNDS, EVALUATIONS)
        polished = polish(lambda theta: middle(theta)[0], start, BOUNDS, EVALUATIONS_TO_POLISH)
        self._theta = polish(lambda theta: all_residual(theta)[0], polished, BOUNDS, EVALUATIONS_TO_FINISH)
        residual, self._coefficients = all_residual(self._theta)
        return float(np.mean(residual**2))

    def predict(self, record: Record) -> FloatArray:
        """Return the output at each sample."""
        output: FloatArray = (
            self._features(self._theta, _Force.of(record, self._frequency)) @ self._coefficients
        )
        return output

    def n_parameters(self) -> int:
        """Return the parameters of the equation, and gain and offset of the output."""
        return len(self._theta) + len(self._coefficients)

    def _residual_of(
        self, records: Sequence[Record]
    ) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
        """Return the function from parameters to residual and coefficients for some records."""
        forces = [_Force.of(record, self._frequency) for record in records]
        scored = np.concatenate([record.scored for record in records])
        output = np.concatenate([record.output for record in records])[scored]

        def residual(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
            features = np.vstack([self._features(theta, force) for force in forces])[scored]
            coefficients = solve_linear(features, output)
            return output - features @ coefficients, coefficients

        return residual

    def _features(self, theta: FloatArray, force: _Force) -> FloatArray:
        """Return ones and the displacement at each sample of a record."""
        omega, zeta, width, exponent = np.exp(theta[[0, 1, 4, 5]])
        constants = np.array([omega, zeta, theta[2], theta[3], width, exponent, theta[6], theta[7]])
        y = _integrate(force.values, force.steps, constants)[force.lead_in :]
        return np.column_stack([np.ones(y.size), y])


def _estimate_frequency(records: Sequence[Record]) -> float:
    """Return the angular frequency where the linear frequency response is largest, rad/s."""
    record = max(records, key=lambda candidate: candidate.input.size)
    assert record.time is not None
    rate = 1.0 / float(np.median(np.diff(record.time)))
    length = min(record.input.size, 512)
    frequency, cross = csd(record.input, record.output, rate, nperseg=length)
    power = welch(record.input, rate, nperseg=length)[1]
    is_excited = (power > 1e-3 * np.max(power)) & (frequency > 0.0)
    gain = np.where(is_excited, np.abs(cross) / np.maximum(power, 1e-300), 0.0)
    return 2.0 * np.pi * float(frequency[max(int(np.argmax(gain)), 1)])


def _excerpts(records: Sequence[Record], count: int) -> list[Record]:
    """Return the first part of each record; the unsettled part of it does not count."""
    length = max(count // len(records), 200)
    excerpts = []
    for record in records:
        assert record.time is not None
        part = slice(0, length)
        time = record.time[part]
        scored = record.scored[part] & (np.arange(time.size) >= UNSETTLED_SHARE * time.size)
        cut = replace(record, input=record.input[part], output=record.output[part], time=time)
        excerpts.append(replace(cut, history="demagnetised", is_scored=scored))
    return excerpts


@compiled
def _integrate(values: FloatArray, steps: FloatArray, constants: FloatArray) -> FloatArray:
    """Return the displacement at each sample, from rest, by the Runge-Kutta method."""
    displacement = np.zeros(steps.size + 1)
    y, v, z = 0.0, 0.0, 0.0
    for sample in range(steps.size):
        h = steps[sample] / SUBSTEPS
        for part in range(SUBSTEPS):
            start, middle, end = values[sample, 2 * part : 2 * part + 3]
            y1, v1, z1 = _rates(y, v, z, start, constants)
            y2, v2, z2 = _rates(y + h / 2 * y1, v + h / 2 * v1, z + h / 2 * z1, middle, constants)
            y3, v3, z3 = _rates(y + h / 2 * y2, v + h / 2 * v2, z + h / 2 * z2, middle, constants)
            y4, v4, z4 = _rates(y + h * y3, v + h * v3, z + h * z3, end, constants)
            y += h / 6.0 * (y1 + 2.0 * y2 + 2.0 * y3 + y4)
            v += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4)
            z += h / 6.0 * (z1 + 2.0 * z2 + 2.0 * z3 + z4)
        if not abs(y) < LIMIT:
            displacement[sample + 1 :] = LIMIT
            break
        displacement[sample + 1] = y
    return displacement


@compiled
def _rates(y: float, v: float, z: float, force: float, constants: FloatArray) -> tuple[float, float, float]:
    """Return the derivatives of displacement, velocity and hysteretic state."""
    omega, zeta, cubic, share, width, exponent, loading, unloading = constants
    ratio = min(abs(z) / width, 10.0)
    bracket = loading if z * v > 0.0 else unloading
    spring = y + cubic * y * y * y + share * z
    acceleration = omega * omega * (force - spring) - 2.0 * zeta * omega * v
    return v, acceleration, v * (1.0 - bracket * ratio**exponent)
