"""Select among laws that follow few loops about equally well, by their loops that were not measured.

Blocks of samples that were withheld from a loop do not test other loops. Laws with many parameters
then win although they differ widely between the measured amplitudes. Each eligible law predicts
loops of other amplitudes, and the law with the smallest sum of distances to all others is selected
(the medoid).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from anhyst.data import Loops
from anhyst.identification.candidates import CandidateComparison, ModelCandidate
from anhyst.identification.model_building import make_model
from anhyst.model.actuator import Model
from anhyst.support.numeric import FloatArray, rms

MAX_WITHHELD_RATIO = 2.0
"""Largest error at withheld blocks, relative to the smallest of all laws, of an eligible law."""
MAX_RESIDUAL_RATIO = 2.5
"""Largest rms residual of an eligible law, relative to the smallest of all laws."""
SAMPLES_PER_BRANCH = 100
MIN_AMPLITUDE_RATIO = 1.1
"""Ratio of two amplitudes below which they count as equal."""
SINGLE_LOOP_SHARE = 0.5
"""Amplitude of the predicted inner loop if all measured loops are equal, relative to theirs."""
BIPOLAR_SHARE = 0.5
"""Smallest ratio of the negative to the positive end of the input for loops about their centre."""


def select_central_law(
    comparison: CandidateComparison, best: ModelCandidate, loopset: Loops
) -> ModelCandidate:
    """Return the law whose predictions are closest to those of all laws that are about as good."""
    errors = {
        candidate: comparison.withheld_error(candidate) or 0.0
        for candidate in comparison.contenders
        if comparison.has_all_refits(candidate)
    }
    residuals = {candidate: comparison.fits[candidate].reduced_fit.cost ** 0.5 for candidate in errors}
    eligible = [
        candidate
        for candidate in errors
        if candidate == best
        or (
            errors[candidate] <= MAX_WITHHELD_RATIO * min(errors.values())
            and residuals[candidate] <= MAX_RESIDUAL_RATIO * min(residuals.values())
        )
    ]
    if len(eligible) < 3:  # two laws are equally far from each other
        return best
    cycles = _unmeasured_cycles(loopset)
    predictions = [
        _predict_cycles(make_model(comparison.fits[candidate].reduced_fit, loopset), cycles)
        for candidate in eligible
    ]
    distances = [sum(rms(own - other) for other in predictions) for own in predictions]
    return eligible[int(np.argmin(distances))]


def _unmeasured_cycles(loopset: Loops) -> list[tuple[FloatArray, float | None]]:
    """Return cycles between the measured amplitudes, and over the whole range, at each gap."""
    cycles: list[tuple[FloatArray, float | None]] = []
    for value, loops in loopset.by_schedule().items():
        low = min(float(np.min(loop.input)) for loop in loops)
        high = max(float(np.max(loop.input)) for loop in loops)
        sizes = sorted(float(np.ptp(loop.input)) / (high - low) for loop in loops)
        between = [
            (first * second) ** 0.5
            for first, second in pairwise(sizes)
            if second > MIN_AMPLITUDE_RATIO * first
        ]
        for size in (1.0, *(between or [SINGLE_LOOP_SHARE])):
            start = low if low > -BIPOLAR_SHARE * high else 0.5 * (low + high - size * (high - low))
            rising = np.linspace(start, start + size * (high - low), SAMPLES_PER_BRANCH, endpoint=False)
            falling = np.linspace(start + size * (high - low), start, SAMPLES_PER_BRANCH, endpoint=False)
            cycles.append((np.concatenate([rising, falling]), None if loopset.schedule is None else value))
    return cycles


def _predict_cycles(model: Model, cycles: Sequence[tuple[FloatArray, float | None]]) -> FloatArray:
    """Return the settled outputs of a model along all cycles."""
    return np.concatenate([model.predict(drive, value, None, "settled").output for drive, value in cycles])
