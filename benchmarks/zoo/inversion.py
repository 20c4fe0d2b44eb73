"""Invert any model sample by sample, and compare the output with the demand.

A root search finds the input of each sample, between the limits of the training records. The model
then gives the demanded output, and all earlier inputs are kept. All models are inverted in this
way. A demand that the model cannot reach gives the nearer limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from .model import Model
from .records import FloatArray, Record

MAX_SAMPLES = 60
"""Number of evenly spaced samples of a record that are inverted."""
INPUT_TOLERANCE = 1e-5
"""Tolerance of an input, relative to the range of the training records."""
MARGIN = 0.1
"""Distance of the limits from the training records, relative to their range."""


def round_trip_error(model: Model, record: Record, training: Sequence[Record]) -> float:
    """Return the rms error of output -> input -> output, relative to the standard deviation.

    A settled cycle is demanded three times, starting demagnetised; the last cycle counts.
    """
    rows = np.unique(np.linspace(0, record.input.size - 1, MAX_SAMPLES).astype(int))
    path = replace(
        record,
        input=record.input[rows],
        schedule=None if record.schedule is None else record.schedule[rows],
        time=None if record.time is None else record.time[rows],
    ).path
    demand = np.resize(record.output[rows], path.input.size)
    lowest_input = min(float(np.min(known.input)) for known in training)
    highest_input = max(float(np.max(known.input)) for known in training)
    input_range = highest_input - lowest_input
    limits = lowest_input - MARGIN * input_range, highest_input + MARGIN * input_range
    drive = np.empty(path.input.size)
    probe = Record(
        "inverse", drive, demand, path.schedule, path.time, "demagnetised", None, record.quantities
    )
    for index in range(drive.size):

        def residual(value: float, index: int = index) -> float:
            drive[index] = value
            return float(model.predict(_first_samples(probe, index + 1))[-1] - demand[index])

        ends = [residual(limit) for limit in limits]
        if ends[0] * ends[1] >= 0.0:
            drive[index] = limits[int(np.argmin(np.abs(ends)))]
        else:
            drive[index] = brentq(
                residual, *limits, xtol=INPUT_TOLERANCE * input_range, maxiter=40, disp=False
            )
    output = path.cut(model.predict(_first_samples(probe, drive.size)))
    counted_demand: FloatArray = path.cut(demand)
    return float(np.sqrt(np.mean((output - counted_demand) ** 2)) / np.std(counted_demand))


def _first_samples(record: Record, count: int) -> Record:
    """Return the first samples of a record without their output."""
    return replace(
        record,
        input=record.input[:count].copy(),
        output=np.full(count, np.nan),
        schedule=None if record.schedule is None else record.schedule[:count],
        time=None if record.time is None else record.time[:count],
    )
