"""Design a multi-sine: a periodic sum of sines that measures a frequency response without leakage.

All frequencies are whole multiples of the inverse period, and their phases are random. They are
spaced as evenly as possible on a logarithmic axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst.support.numeric import FloatArray

ComplexArray = NDArray[np.complex128]
LineArray = NDArray[np.int64]


@dataclass(frozen=True)
class Multisine:
    """A periodic sum of sines."""

    lines: LineArray  # frequencies, as multiples of the inverse period; shape (n,)
    amplitudes: ComplexArray  # complex amplitude of each sine; shape (n,)
    period_ticks: int  # period, ticks

    def respond(self, gains: ComplexArray | float = 1.0) -> FloatArray:
        """Return one period of the response of a system with these gains; 1 for the signal itself."""
        spectrum = np.zeros(self.period_ticks // 2 + 1, dtype=np.complex128)
        spectrum[self.lines] = 0.5 * self.period_ticks * self.amplitudes * gains
        return np.asarray(np.fft.irfft(spectrum, self.period_ticks))

    def amplitudes_of(self, signal: FloatArray) -> ComplexArray:
        """Return the amplitudes in a signal of whole periods."""
        return amplitude_spectrum(signal)[self.lines * (len(signal) // self.period_ticks)]


def amplitude_spectrum(signal: FloatArray) -> ComplexArray:
    """Return the complex amplitude of each harmonic of a signal's duration."""
    return np.asarray(np.fft.rfft(signal) * (2.0 / len(signal)))


def choose_lines(count: int, low: float, high: float) -> LineArray:
    """Return at most `count` lines from `low` to `high` (at least 1) that are almost geometric.

    All lines are odd, because even-order distortion of odd lines is at even lines. Of four odd
    lines, one is never excited and shows the odd-order distortion.
    """
    lines = np.arange(round(low), math.floor(high) + 1)
    allowed = lines[np.isin(lines % 8, (1, 5, 7))]
    chosen, points = allowed, count
    while len(allowed) > count and points < 100 * count:
        borders = 0.5 * (allowed[1:] + allowed[:-1])
        chosen = allowed[np.unique(np.searchsorted(borders, np.geomspace(allowed[0], allowed[-1], points)))]
        if len(chosen) >= count:
            return np.delete(chosen, np.arange(1, 1 + len(chosen) - count))
        points += 1 + (count - len(chosen)) // 2
    return chosen


def with_random_phases(magnitudes: FloatArray) -> ComplexArray:
    """Return complex amplitudes with these magnitudes; the same number of them has the same phases."""
    turns = np.random.default_rng(1).uniform(0.0, 1.0, len(magnitudes))
    return np.asarray(magnitudes * np.exp(2j * np.pi * turns))
