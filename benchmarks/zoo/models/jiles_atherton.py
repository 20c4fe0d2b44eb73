"""The Jiles-Atherton model, for an induction or for the force of a magnet with an air gap.

The equations are those of Jiles and Atherton (J. Magn. Magn. Mater. 61, 1986) with the derivative
of Jiles, Thoelke and Devine (IEEE Trans. Magn. 28, 1992) and a Langevin anhysteretic. The
irreversible part does not move away from the anhysteretic, which keeps the susceptibility
positive. A negative coupling is the demagnetising field of an air gap.

Two output maps are fitted, and the one with the smaller error on the training records is kept:
``c0 + c1 m + c2 h`` is an induction, and ``c0 + c1 b + c2 b^2`` with ``b = m + g h`` is the force of
a magnet, which is proportional to the square of the flux density with an offset. The coefficients
of the output are eliminated by least squares. Differential evolution finds the other parameters on
thinned records, and least squares polishes them on more samples.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..records import BoolArray, FloatArray, Record
from ._compiled import compiled
from ._evolution import Drive, evolve, polish, solve_linear
from ._over_schedule import OverSchedule
from ._withheld import Scaling, add_mirror_images, thin

BOUNDS = np.array(
    [
        (-7.0, 1.5),  # logarithm of the anhysteretic width
        (-1.0, 0.97),  # coupling: -1 is the strongest air gap, 0 none, and 1 would be a jump
        (-7.0, 1.0),  # logarithm of the pinning
        (0.0, 0.98),  # reversible share
        (-0.1, 0.1),  # offset of the field
        (-6.0, 1.0),  # logarithm of the share of the field in the flux density of a force
    ]
)
"""Bounds of the parameters; the unit of the field is the largest input of the training records."""

MAX_GAP = 60.0
"""Strongest demagnetising field at saturation, in units of the largest input."""

SAMPLES_TO_EVOLVE = 500
SAMPLES_TO_POLISH = 1500
EVALUATIONS = 2600
EVALUATIONS_TO_POLISH = 25

MAX_STEP = 0.3
"""First step of the integration, relative to the smaller one of pinning and anhysteretic width."""

MAX_STEPS_PER_SAMPLE = 8
"""Largest number of first steps in a sample."""

MAX_CHANGE = 0.1
"""Largest change of the magnetisation in a step; a longer step is halved."""

SMALLEST_STEP = 1e-3
"""Smallest step, relative to the change of the field from a sample to the next one."""


class JilesAtherton:
    """A Jiles-Atherton model with an output map for induction or force."""

    def fit(self, records: Sequence[Record]) -> None:
        """Find the parameters by differential evolution, polish them and choose the output map."""
        self._scaling = Scaling.of(records)
        normalised = add_mirror_images([self._scaling.normalise(record) for record in records])
        thinned = thin(normalised, SAMPLES_TO_EVOLVE)
        drive, scored = Drive.of(thinned), np.concatenate([record.scored for record in thinned])

        def coarse(theta: FloatArray) -> FloatArray:
            candidates = [_residual(theta, drive, scored, is_force) for is_force in (False, True)]
            return min(candidates, key=lambda residual: float(residual @ residual))

        start = evolve(coarse, BOUNDS, EVALUATIONS)
        thinned = thin(normalised, SAMPLES_TO_POLISH)
        drive, scored = Drive.of(thinned), np.concatenate([record.scored for record in thinned])
        fits = []
        for is_force in (False, True):

            def polish_residual(theta: FloatArray, is_force: bool = is_force) -> FloatArray:
                return _residual(theta, drive, scored, is_force)

            theta = polish(polish_residual, start, BOUNDS, EVALUATIONS_TO_POLISH)
            fits.append((float(np.sum(polish_residual(theta) ** 2)), theta, is_force))
        _, self._theta, self._is_force = min(fits, key=lambda fit: fit[0])
        features = _features(self._theta, drive, self._is_force)
        self._coefficients = solve_linear(features[scored], drive.output[scored])

    def predict(self, record: Record) -> FloatArray:
        """Return the output of the integrated model at each sample."""
        drive = Drive.of([self._scaling.normalise(record)])
        return self._scaling.restore(_features(self._theta, drive, self._is_force) @ self._coefficients)

    def n_parameters(self) -> int:
        """Return the parameters of the equations and of the output map."""
        return len(BOUNDS) - (not self._is_force) + len(self._coefficients)


def _residual(theta: FloatArray, drive: Drive, scored: BoolArray, is_force: bool) -> FloatArray:
    """Return the residual at the scored samples with the best coefficients of the output map."""
    features, output = _features(theta, drive, is_force)[scored], drive.output[scored]
    residual: FloatArray = output - features @ solve_linear(features, output)
    return residual


def _features(theta: FloatArray, drive: Drive, is_force: bool) -> FloatArray:
    """Return what the output map weights, at each sample of the records, shape (n, 3)."""
    width, pinning = np.exp(theta[0]), np.exp(theta[2])
    coupling = 3.0 * width * theta[1] if theta[1] > 0.0 else MAX_GAP * theta[1] ** 3
    field = drive.input + theta[4]
    m = _magnetise(field, drive.is_start, width, coupling, pinning, theta[3])[drive.rows]
    h = field[drive.rows]
    if not is_force:
        return np.column_stack([np.ones(m.size), m, h])
    b = m + np.exp(theta[5]) * h
    return np.column_stack([np.ones(m.size), b, b * b])


@compiled
def _magnetise(
    field: FloatArray, is_start: BoolArray, width: float, coupling: float, pinning: float, reversible: float
) -> FloatArray:
    """Return the magnetisation relative to saturation; each start is demagnetised at its field."""
    m = np.empty(field.size)
    state, h = 0.0, 0.0
    longest = MAX_STEP * min(width, pinning)
    for sample in range(field.size):
        if is_start[sample]:
            state, h = 0.0, 0.0
        change = field[sample] - h
        if change == 0.0:
            m[sample] = state
            continue
        steps = min(MAX_STEPS_PER_SAMPLE, int(abs(change) / longest) + 1)
        dh, travelled = change / steps, 0.0
        while travelled < 1.0 - 1e-9:
            dh = np.sign(change) * min(abs(dh), (1.0 - travelled) * abs(change))
            slope = _susceptibility(h, state, dh, width, coupling, pinning, reversible)
            middle = state + 0.5 * dh * slope
            dm = dh * _susceptibility(h + 0.5 * dh, middle, dh, width, coupling, pinning, reversible)
            is_too_long = max(abs(dm), abs(dh * slope)) > MAX_CHANGE
            if is_too_long and abs(dh) > SMALLEST_STEP * abs(change):
                dh /= 2.0
                continue
            state += dm
            h += dh
            travelled += dh / change
            dh *= 1.5
        h = field[sample]
        state = max(-1.0, min(1.0, state))
        m[sample] = state
    return m


@compiled
def _susceptibility(
    h: float, m: float, dh: float, width: float, coupling: float, pinning: float, reversible: float
) -> float:
    """Return the derivative of the magnetisation with respect to the field."""
    q = (h + coupling * m) / width
    if abs(q) < 0.05:
        anhysteretic, slope = q / 3.0 - q**3 / 45.0, 1.0 / 3.0 - q * q / 15.0
    else:
        coth = 1.0 / np.tanh(q)
        anhysteretic, slope = coth - 1.0 / q, 1.0 - coth * coth + 1.0 / (q * q)
    distance = anhysteretic - m if dh > 0.0 else m - anhysteretic
    effective = max(distance, 0.0) / pinning + reversible * slope / width
    return float(effective / max(1.0 - coupling * effective, 0.02))


MODELS = {"Jiles-Atherton": lambda: OverSchedule(JilesAtherton)}
