"""An extended Bouc-Wen model, static or with a second-order oscillator.

The hysteretic state follows the equation of Bouc (1967) and Wen (J. Eng. Mech. 102, 1976),
``dz = du (1 - |z/w|^n (beta sgn(z du) + gamma))``, and its generalisation
for asymmetric loops (Song and Der Kiureghian, J. Eng. Mech. 132, 2006), whose bracket has six terms.
It depends on the input only, and not on its speed. The input passes a scale that may become logarithmic,
as the field of a steel needs it. The output adds a nonlinear elastic part and the
hysteretic part with a gain that depends on the input, so that loops close at saturation. Both are
piecewise linear functions of the input.

If the records have times, the oscillator of Noel and Schoukens (Workshop on Nonlinear System
Identification Benchmarks, 2016) is fitted too: the input is a force, the output is a displacement
``y'' + 2 zeta omega y' + omega^2 (y + c3 y^3) + kappa z = u``, and the displacement drives ``z``. It
is kept if its error on the training records is smaller.

The linear coefficients are eliminated by least squares. Differential evolution finds the other
parameters on thinned records, and least squares polishes them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..records import BoolArray, FloatArray, Record
from ._compiled import compiled
from ._evolution import Drive, evolve, polish, solve_linear
from ._oscillator import Oscillator
from ._over_schedule import OverSchedule
from ._withheld import Scaling, add_mirror_images, grid_lines, hats, thin

BOUNDS = np.array(
    [
        (-6.0, 1.0),  # logarithm of the width w
        (-1.5, 2.5),  # logarithm of the exponent n
        (-1.0, 1.0),  # beta + gamma, which counts while the hysteretic part grows
        (-5.0, 1.0),  # gamma - beta, which counts while it decreases
        (-6.0, 2.0),  # logarithm of the input at which the scale of the input becomes logarithmic
        *[(-1.0, 1.0)] * 4,  # terms of u du, u z, du and u, which make loops asymmetric
    ]
)
"""Bounds of the parameters; the unit of the input is its largest value in the training records."""

SYMMETRIC = 5
"""Number of parameters of the symmetric equation, which the evolution starts from."""

ELASTIC_KNOTS = 24
GAIN_KNOTS = 16
CURVATURE_PENALTY = 1e-5
SAMPLES_TO_EVOLVE = 800
SAMPLES_TO_POLISH = 2000
EVALUATIONS = 5000
EVALUATIONS_TO_POLISH = 40
MAX_STEP = 0.25
"""Largest step of the integration, relative to the width; smaller for a large exponent."""

SETTLED_STEP = 1e-12
"""Change of the hysteretic state in a step below which the state is constant until the input reverses."""

MAX_STATE = 10.0
"""Largest hysteretic state relative to the width; some asymmetric equations have no bound."""


class _StaticBoucWen:
    """The rate-independent model in normalised units."""

    def fit(self, records: Sequence[Record]) -> float:
        """Fit the model and return the mean squared error at the samples that count."""
        complete = add_mirror_images(records)
        self._elastic = grid_lines(complete, ELASTIC_KNOTS - 1)
        self._gain = grid_lines(complete, GAIN_KNOTS - 1)
        thinned = thin(complete, SAMPLES_TO_EVOLVE)
        drive, scored = Drive.of(thinned), np.concatenate([record.scored for record in thinned])

        def coarse(theta: FloatArray) -> FloatArray:
            return self._residual(np.pad(theta, (0, len(BOUNDS) - SYMMETRIC)), drive, scored)

        start = evolve(coarse, BOUNDS[:SYMMETRIC], EVALUATIONS)
        thinned = thin(complete, SAMPLES_TO_POLISH)
        drive, scored = Drive.of(thinned), np.concatenate([record.scored for record in thinned])

        def polish_residual(theta: FloatArray) -> FloatArray:
            return self._residual(theta, drive, scored)

        start = np.pad(start, (0, len(BOUNDS) - SYMMETRIC))
        self._theta = polish(polish_residual, start, BOUNDS, EVALUATIONS_TO_POLISH)
        features = self._features(self._theta, drive)[scored]
        self._coefficients = self._solve(features, drive.output[scored])
        return float(np.mean((drive.output[scored] - features @ self._coefficients) ** 2))

    def predict(self, record: Record) -> FloatArray:
        """Return the output at each sample."""
        output: FloatArray = self._features(self._theta, Drive.of([record])) @ self._coefficients
        return output

    def n_parameters(self) -> int:
        """Return the parameters of the equation and the coefficients of the output."""
        return len(self._theta) + len(self._coefficients)

    def _residual(self, theta: FloatArray, drive: Drive, scored: BoolArray) -> FloatArray:
        """Return the residual at the scored samples with the best coefficients of the output."""
        features, output = self._features(theta, drive)[scored], drive.output[scored]
        residual: FloatArray = output - features @ self._solve(features, output)
        return residual

    def _solve(self, features: FloatArray, output: FloatArray) -> FloatArray:
        """Return the heights of both functions with a light penalty on their curvature."""
        weight = np.sqrt(CURVATURE_PENALTY * output.size)
        bend = weight * np.diff(np.eye(ELASTIC_KNOTS + GAIN_KNOTS), 2, axis=0)
        bend = np.delete(bend, [ELASTIC_KNOTS - 2, ELASTIC_KNOTS - 1], axis=0)
        return solve_linear(np.vstack([features, bend]), np.concatenate([output, np.zeros(len(bend))]))

    def _features(self, theta: FloatArray, drive: Drive) -> FloatArray:
        """Return the regressors of both parts at each sample of the records."""
        width, exponent = np.exp(theta[:2])
        knee = np.exp(theta[SYMMETRIC - 1])
        mapped = np.arcsinh(drive.input / knee) / np.arcsinh(1.0 / knee)
        terms = np.delete(theta[2:], SYMMETRIC - 3)
        z = _run_hysteresis(mapped, drive.is_start, width, exponent, terms)[drive.rows]
        u = drive.input[drive.rows]
        gains = z[:, None] * hats(np.clip(u, self._gain[0], self._gain[-1]), self._gain)
        return np.hstack([hats(u, self._elastic), gains])


class BoucWen:
    """A Bouc-Wen model with a static output or an oscillator."""

    def fit(self, records: Sequence[Record]) -> None:
        """Fit the static model and, if there are times, the oscillator; keep the better of them."""
        self._scaling = Scaling.of(records)
        normalised = [self._scaling.normalise(record) for record in records]
        static = _StaticBoucWen()
        error = static.fit(normalised)
        self._model: _StaticBoucWen | Oscillator = static
        if all(record.time is not None for record in normalised):
            oscillator = Oscillator()
            if oscillator.fit(normalised) < error:
                self._model = oscillator

    def predict(self, record: Record) -> FloatArray:
        """Return the output at each sample."""
        return self._scaling.restore(self._model.predict(self._scaling.normalise(record)))

    def n_parameters(self) -> int:
        """Return the number of parameters of the model that is kept."""
        return self._model.n_parameters()


@compiled
def _run_hysteresis(
    u: FloatArray, is_start: BoolArray, width: float, exponent: float, terms: FloatArray
) -> FloatArray:
    """Return the hysteretic state relative to the width; each start is at rest."""
    states = np.empty(u.size)
    z, position = 0.0, 0.0
    longest = MAX_STEP * width / max(1.0, exponent / 3.0)
    for sample in range(u.size):
        if is_start[sample]:
            z, position = 0.0, 0.0
        change = u[sample] - position
        steps = int(abs(change) / longest) + 1
        du = change / steps
        for _ in range(steps):
            middle = z + 0.5 * du / width * _slope(z, position, du, exponent, terms)
            previous = z
            z += du / width * _slope(middle, position + 0.5 * du, du, exponent, terms)
            z = max(-MAX_STATE, min(MAX_STATE, z))
            position += du
            if abs(z - previous) < SETTLED_STEP and position * u[sample] > 0.0:
                break
        position = u[sample]
        states[sample] = z
    return states


@compiled
def _slope(z: float, u: float, du: float, exponent: float, terms: FloatArray) -> float:
    """Return the derivative of the hysteretic state, relative to the inverse width."""
    su, sd, sz = np.sign(u), np.sign(du), np.sign(z)
    bracket = terms[0] if sz * sd > 0.0 else terms[1]
    bracket += terms[2] * su * sd + terms[3] * su * sz + terms[4] * sd + terms[5] * su
    return float(1.0 - abs(z) ** exponent * bracket)


MODELS = {"Bouc-Wen": lambda: OverSchedule(BoucWen)}
