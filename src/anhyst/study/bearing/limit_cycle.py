"""Limit cycles at a standstill, distinguished from noise.

Sensor noise through a loop swells around the peak of its sensitivity, so a peak in a spectrum
proves nothing. A record is cut into pieces of a few periods of the strongest oscillation, so long
that noise in one says nothing about the next. If it is noise, their complex amplitudes are
independent normal numbers. A cycle shows in one of two ways:

- it keeps its phase: the mean of the amplitudes is larger than noise would let it be;
- or it keeps its size while its phase wanders: the powers are more alike than those of noise, which
  are distributed exponentially (Moran's test).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtr

from anhyst.support.arrays import FloatArray

_PERIODS = 6  # a piece
_PIECES = 5  # at least
_CANDIDATES = 5  # peaks of the spectrum that are looked at
_DOUBT = 1e-3  # that a record of noise is taken for a cycle
_LEAST_SHARE = 0.1  # of the variance
_PADDING = 8


@dataclass(frozen=True)
class LimitCycle:
    """A lasting oscillation."""

    amplitude: float  # of its fundamental, in the unit of the signal
    period: float  # s
    share: float  # of the signal's variance that the fundamental makes up, 0..1


def lowest_frequency(duration: float) -> float:
    """Return below which frequency no cycle can be distinguished from noise."""
    return _PERIODS * _PIECES / duration


def limit_cycle(time: ArrayLike, position: ArrayLike, floor: float = 1e-9) -> LimitCycle | None:
    """Look for a limit cycle in a record of a standstill."""
    t = np.asarray(time, dtype=float)
    y = np.asarray(position, dtype=float)
    y = y - np.polynomial.Polynomial.fit(t, y, 1)(t)
    variance = float(np.mean(y**2))
    if variance <= 0.5 * floor**2:
        return None
    tick = float(t[-1] - t[0]) / (len(t) - 1)
    for frequency in _peaks(y, tick):
        amplitudes = _amplitudes(y, tick, frequency)
        power = float(np.mean(np.abs(amplitudes) ** 2))
        share = 0.5 * power / variance
        if share < _LEAST_SHARE or math.sqrt(power) < floor:
            continue
        if _keeps_phase(amplitudes, len(y)) or _keeps_size(amplitudes):
            return LimitCycle(math.sqrt(power), 1.0 / frequency, min(1.0, share))
    return None


def _peaks(y: FloatArray, tick: float) -> list[float]:
    """Return the frequencies of the strongest oscillations, strongest first, Hz."""
    length = _PADDING * len(y)
    power = np.abs(np.fft.rfft(y * np.hanning(len(y)), length)) ** 2
    first = math.ceil(lowest_frequency(len(y) * tick) * length * tick)
    found = first + _apart(power[first:], 2 * _PADDING)
    below, top, above = (np.log(power[found + i] + np.finfo(float).tiny) for i in (-1, 0, 1))
    bend = below - 2.0 * top + above
    shift = np.divide(0.5 * (below - above), bend, out=np.zeros_like(top), where=bend < 0.0)
    return [float(f) for f in (found + shift) / (length * tick)]


def _apart(power: FloatArray, distance: int) -> NDArray[np.intp]:
    """Return the places of the highest peaks so far apart, highest first."""
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner > power[:-2]) & (inner >= power[2:]))
    chosen: list[int] = []
    for place in peaks[np.argsort(power[peaks])[::-1]].tolist():
        if all(abs(place - other) >= distance for other in chosen):
            chosen.append(place)
        if len(chosen) == _CANDIDATES:
            break
    return np.array(chosen, dtype=np.intp)


def _amplitudes(y: FloatArray, tick: float, frequency: float) -> NDArray[np.complex128]:
    """Return the complex amplitude of an oscillation in every piece."""
    length = round(_PERIODS / (frequency * tick))
    count = len(y) // length
    window = np.hanning(length)
    turn = np.exp(-2j * np.pi * frequency * tick * np.arange(count * length))
    pieces = (y[: count * length] * turn).reshape(count, length)
    return np.asarray(2.0 * (pieces @ window) / np.sum(window))


def _keeps_phase(amplitudes: NDArray[np.complex128], samples: int) -> bool:
    """Whether their mean is too large for noise, at the best of all frequencies."""
    count = len(amplitudes)
    mean = complex(np.mean(amplitudes))
    together = abs(mean) ** 2 / float(np.mean(np.abs(amplitudes) ** 2))
    doubt = max(0.0, 1.0 - together) ** (count - 1)
    return bool(0.5 * samples * doubt < _DOUBT)


def _keeps_size(amplitudes: NDArray[np.complex128]) -> bool:
    """Whether the powers are too much alike for noise."""
    count = len(amplitudes)
    power = np.abs(amplitudes) ** 2
    if np.any(power <= 0.0):
        return False
    unlike = math.log(float(np.mean(power))) - float(np.mean(np.log(power)))
    moran = 2.0 * count * unlike / (1.0 + (count + 1.0) / (6.0 * count))
    return bool(2 * _CANDIDATES * chdtr(count - 1, moran) < _DOUBT)
