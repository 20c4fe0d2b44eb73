"""Fit curves and play operators of an input to an output, to find the residual of a static law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander

from anhyst.data.loops import Loop
from anhyst.data.path import move_plays, thin_rows
from anhyst.support.numeric import FloatArray

_CURVE_DEGREE = 7
_THRESHOLDS = (0.01, 0.02, 0.04, 0.08, 0.15, 0.25, 0.4)
"""Thresholds of the play operators, relative to half the range of the input."""
_MAX_SAMPLES = 2000
_MAX_RESAMPLING_RATIO = 4.0
"""Maximum number of samples of an evenly sampled record, relative to the loop."""


@dataclass(frozen=True, eq=False)
class EvenRecord:
    """Input and output at a constant sampling rate."""

    drive: FloatArray
    output: FloatArray
    step: float  # time step, s; 1 without a clock

    def average_blocks(self, samples: int) -> EvenRecord:
        """Return the record with averages of blocks of ``samples`` samples."""
        blocks = self.drive.size // samples
        drive, output = (
            signal[: blocks * samples].reshape(blocks, samples).mean(axis=1)
            for signal in (self.drive, self.output)
        )
        return EvenRecord(drive, output, samples * self.step)

    def average_to_sample_limit(self, samples: int) -> EvenRecord:
        """Return the record, averaged in blocks if it has more than ``samples`` samples."""
        count = -(-self.drive.size // samples)
        return self.average_blocks(count) if count > 1 else self

    def largest_window(self, samples: int) -> EvenRecord:
        """Return the window of at most ``samples`` samples with the largest output, without means."""
        starts = range(0, max(self.drive.size - samples, 0) + 1, max(samples // 2, 1))
        start = max(starts, key=lambda start: float(np.std(self.output[start : start + samples])))
        windows = (signal[start : start + samples] for signal in (self.drive, self.output))
        drive, output = (window - window.mean() for window in windows)
        return EvenRecord(drive, output, self.step)


def resample_evenly(loop: Loop) -> EvenRecord | None:
    """Return a loop at its median time step; ``None`` if its clock is too uneven."""
    if loop.time is None:
        return EvenRecord(loop.input, loop.output, 1.0)
    step = float(np.median(np.diff(loop.time)))
    if step <= 0.0 or float(loop.time[-1] - loop.time[0]) > _MAX_RESAMPLING_RATIO * loop.n * step:
        return None
    clock = np.arange(float(loop.time[0]), float(loop.time[-1]) + 0.5 * step, step)
    drive, output = (np.interp(clock, loop.time, signal) for signal in (loop.input, loop.output))
    return EvenRecord(drive, output, step)


def static_fit_rms(drive: FloatArray, output: FloatArray, *, with_plays: bool = True) -> float:
    """Return the rms residual of a fit of curves, and optionally play operators, of the input."""
    # Rows along the travel of the input; held inputs need rows that are evenly spaced in time.
    even_rows = np.linspace(0, drive.size - 1, min(drive.size, _MAX_SAMPLES // 2)).astype(np.intp)
    rows = np.union1d(thin_rows(drive, _MAX_SAMPLES // 2), even_rows)
    middle_input, half_range = 0.5 * float(drive.max() + drive.min()), 0.5 * float(np.ptp(drive))
    scaled_input = (drive[rows] - middle_input) / (half_range or 1.0)
    columns = [legvander(scaled_input, _CURVE_DEGREE)]
    if with_plays:
        thresholds = np.array(_THRESHOLDS)
        initial_states = np.clip(0.0, scaled_input[0] - thresholds, scaled_input[0] + thresholds)
        states = move_plays(scaled_input[None], thresholds, initial_states[None])[:, 0]
        columns += [states, states * scaled_input[:, None]]
    basis = np.hstack(columns)
    coefficients = np.linalg.lstsq(basis, output[rows])[0]
    return float(np.sqrt(np.mean((output[rows] - basis @ coefficients) ** 2)))
