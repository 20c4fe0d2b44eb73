"""Records that show how a fitted model behaves: at rest, in repeated minor loops, and its losses.

The probes stay inside the range of the training data, with steps and time steps like those of the
training records.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .model import Model
from .records import FloatArray, Record

REST_SAMPLES = 2000
"""Number of samples at a constant input."""
CYCLES = 4
BIASES = (0.25, 0.5, 0.75)
AMPLITUDES = (0.05, 0.15)
"""Bias and amplitude of the minor loops, as fractions of the input range."""
MIN_ODD_CORRELATION = 0.5
"""Smallest correlation of input and output for which the output is not an even function."""
PASSIVE_LOSS = -1e-4
"""Smallest loss of a cycle, relative to the product of the ranges, that counts as passive."""


@dataclass(frozen=True)
class Behaviour:
    """What the probes show; outputs are in % of the largest output of the training records."""

    rest_drift: float  # change of the output while the input rests
    minor_loop_gap: float  # change of a minor loop from its third to its fourth cycle
    smallest_loss: float  # energy lost in a cycle, relative to the product of the ranges

    @property
    def is_passive(self) -> bool:
        """Whether no probed cycle delivers energy."""
        return self.smallest_loss >= PASSIVE_LOSS


def has_even_output(training: Sequence[Record]) -> bool:
    """Whether the output is the same for both signs of the input, as a force of a bipolar current.

    Its inverse has two solutions, and its loops run in both directions.
    """
    drive = np.concatenate([record.input for record in training])
    output = np.concatenate([record.output for record in training])
    return bool(abs(np.corrcoef(drive, output)[0, 1]) < MIN_ODD_CORRELATION)


def probe_behaviour(model: Model, training: Sequence[Record]) -> Behaviour:
    """Run the probes with a fitted model."""
    widest = max(training, key=lambda record: float(np.ptp(record.input)))
    lowest_input, highest_input = float(np.min(widest.input)), float(np.max(widest.input))
    steps = np.abs(np.diff(widest.input))
    stride = max(float(np.median(steps[steps > 0.0])), (highest_input - lowest_input) / 400.0)
    full_scale = max(float(np.max(np.abs(record.output))) for record in training)
    output_range = max(float(np.ptp(record.output)) for record in training)
    start = min(max(0.0, lowest_input), highest_input)
    gaps, losses, drifts = [], [], []
    for bias in BIASES:
        center = lowest_input + bias * (highest_input - lowest_input)
        for amplitude in AMPLITUDES:
            swing = amplitude * (highest_input - lowest_input)
            lead = _ramp([start, highest_input, center - swing], stride)
            cycle = _ramp([center - swing, center + swing, center - swing], stride)[1:]
            drive = np.concatenate([lead, *[cycle] * CYCLES])
            output = model.predict(_like(widest, drive))
            third, fourth = output[-2 * cycle.size : -cycle.size], output[-cycle.size :]
            gaps.append(float(np.max(np.abs(fourth - third))))
            losses.append(
                _lost_energy(drive[-cycle.size :], fourth) / ((highest_input - lowest_input) * output_range)
            )
        rest_drive = np.concatenate(
            [_ramp([start, highest_input, center], stride), np.full(REST_SAMPLES, center)]
        )
        drifts.append(float(np.ptp(model.predict(_like(widest, rest_drive))[-REST_SAMPLES:])))
    return Behaviour(100.0 * max(drifts) / full_scale, 100.0 * max(gaps) / full_scale, min(losses))


def _ramp(corners: Sequence[float], stride: float) -> FloatArray:
    """Return a path of straight lines with steps of about a given size."""
    pieces = [np.array(corners[:1])]
    for begin, end in pairwise(corners):
        count = max(1, round(abs(end - begin) / stride))
        pieces.append(np.linspace(begin, end, count + 1)[1:])
    return np.concatenate(pieces)


def _like(pattern: Record, drive: FloatArray) -> Record:
    """Return a record with another input, with the time step and schedule of a pattern."""
    time: FloatArray | None = None
    schedule: FloatArray | None = None
    if pattern.time is not None:
        time = np.arange(drive.size, dtype=np.float64) * float(np.median(np.diff(pattern.time)))
    if pattern.schedule is not None:
        schedule = np.full(drive.size, float(np.median(pattern.schedule)))
    unknown = np.full(drive.size, np.nan)
    return Record("probe", drive, unknown, schedule, time, "demagnetised", None, pattern.quantities)


def _lost_energy(drive: FloatArray, output: FloatArray) -> float:
    """Return the area of a closed loop, positive if the output lags behind the input."""
    closed_drive, closed_output = np.append(drive, drive[0]), np.append(output, output[0])
    return float(np.sum(0.5 * (closed_drive[1:] + closed_drive[:-1]) * np.diff(closed_output)))
