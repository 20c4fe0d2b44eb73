"""Invert any model by iteration over a whole record.

Each sample is corrected by its output error divided by a local slope of the model. The slope is
that of the output over the input along the path, within bounds around the slope of the whole
record. The best of all iterations is returned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .model import InvertibleModel, Model
from .records import FloatArray, Record

MAX_ITERATIONS = 40
CONVERGED_ERROR = 1e-4
"""Rms error, relative to the range of the output, at which the iteration stops."""
SLOPE_BOUNDS = (0.1, 10.0)
"""Smallest and largest local slope, relative to the slope of the whole record."""


def invert(model: Model, record: Record, training: Sequence[Record]) -> FloatArray:
    """Return the input for which a model gives the output of a record.

    The model's own inverse is used if it has one.
    """
    unknown = np.full(record.output.size, np.nan)
    if isinstance(model, InvertibleModel):
        return model.invert(replace(record, input=unknown))
    lowest_input = min(float(np.min(training_record.input)) for training_record in training)
    highest_input = max(float(np.max(training_record.input)) for training_record in training)
    margin = 0.1 * (highest_input - lowest_input)
    drive = np.clip(_start_from_curve(record, training), lowest_input, highest_input)
    output_range = float(np.ptp(record.output))
    best_drive, best_error, gain = drive, np.inf, 1.0
    for _ in range(MAX_ITERATIONS):
        output = model.predict(replace(record, input=drive).without_output())
        residual = record.output - output
        error = float(np.sqrt(np.mean(residual**2))) / output_range
        if error < best_error:
            best_drive, best_error = drive, error
        else:
            gain = max(0.5 * gain, 0.05)
        if best_error < CONVERGED_ERROR:
            break
        drive = np.clip(
            drive + gain * residual / _local_slope(drive, output),
            lowest_input - margin,
            highest_input + margin,
        )
    return best_drive


def _start_from_curve(record: Record, training: Sequence[Record]) -> FloatArray:
    """Return the input that the training samples have on average at each output."""
    drive = np.concatenate([training_record.input for training_record in training])
    output = np.concatenate([training_record.output for training_record in training])
    order = np.argsort(output)
    groups = np.array_split(order, min(50, order.size))
    knots = np.array([np.mean(output[group]) for group in groups])
    values = np.maximum.accumulate([np.mean(drive[group]) for group in groups])
    return np.interp(record.output, knots, values)


def _local_slope(drive: FloatArray, output: FloatArray) -> FloatArray:
    """Return the slope of an output along its path, within bounds."""
    overall = float(np.ptp(output)) / max(float(np.ptp(drive)), 1e-300)
    overall = max(overall, 1e-300)
    input_steps, output_steps = np.gradient(drive), np.gradient(output)
    smallest = 1e-6 * float(np.ptp(drive))
    slope = np.where(
        np.abs(input_steps) > smallest, output_steps / np.where(input_steps == 0.0, 1.0, input_steps), overall
    )
    return np.clip(slope, SLOPE_BOUNDS[0] * overall, SLOPE_BOUNDS[1] * overall)
