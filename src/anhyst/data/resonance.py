"""Find a lightly damped resonance between input and output, which no hysteresis law can follow.

An autoregressive fit proposes a frequency at each of several sampling rates. A rational transfer
function of second order with a free transient is then fitted to the spectra, iteratively weighted
as by Sanathanan and Koerner (IEEE Trans. Autom. Control 8 (1963) 56). It counts as a resonance if
it leaves much less of the output than curves and play operators of the input do.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from anhyst.data.loops import Loop, Loops
from anhyst.data.static_fit import static_rms
from anhyst.data.verdict import largest_output, single_valued
from anhyst.support.numeric import FloatArray

MIN_MISFIT = 0.02
"""Smallest rms that static curves leave, in parts of the full scale, with which a search is made."""
MAX_RATIO = 0.6
"""Largest rms of a resonance in parts of what static curves leave."""
MAX_DAMPING = 0.25
"""Largest damping ratio that is called a resonance."""
MIN_DAMPING = 5e-4
"""Smallest damping ratio of a body; mains hum has less."""
_MAX_LOOPS = 3
_WINDOW = 8192
"""Largest number of samples that are analysed at one sampling rate."""
_MIN_SAMPLES = 128
_BAND = 0.4
"""Upper limit of the analysed frequencies, in parts of the sampling rate."""
_ITERATIONS = 12


@dataclass(frozen=True, eq=False)
class _Record:
    """Input and output without their means at a constant sampling rate."""

    drive: FloatArray
    output: FloatArray
    step_s: float

    def slower(self) -> _Record:
        """Average pairs of samples."""
        half = self.drive.size // 2
        pairs = (each[: 2 * half].reshape(half, 2).mean(axis=1) for each in self._both())
        return _Record(*pairs, 2.0 * self.step_s)

    def first(self, samples: int) -> _Record:
        """Return the first samples."""
        drive, output = (each[:samples] - each[:samples].mean() for each in self._both())
        return _Record(drive, output, self.step_s)

    def _both(self) -> tuple[FloatArray, FloatArray]:
        return self.drive, self.output


def find_resonance(loopset: Loops) -> float | None:
    """Return the frequency of the resonance that dominates the output, Hz; None without one."""
    scale = largest_output(loopset)
    misfits = [
        (float(np.sqrt(np.mean(residual**2))) / scale, loop)
        for loop, residual in single_valued(loopset)
        if loop.time is not None and loop.n >= _MIN_SAMPLES
    ]
    for misfit, loop in sorted(misfits, key=lambda each: -each[0])[:_MAX_LOOPS]:
        if misfit < MIN_MISFIT:
            break
        if (frequency := _resonance_of(loop, MIN_MISFIT * scale)) is not None:
            return frequency
    return None


def resonance_line(loopset: Loops) -> str:
    """Return the sentence about a resonance; empty without one."""
    frequency = find_resonance(loopset)
    if frequency is None:
        return ""
    return f"the output resonates near {frequency:.3g} Hz; measure more slowly"


def _resonance_of(loop: Loop, least: float) -> float | None:
    for record in _records(loop):
        frequency = _propose_frequency(record)
        found = None if frequency is None else _fit_resonance(record, frequency)
        if found is None:
            continue
        resonance_hz, rms = found
        static = static_rms(record.drive, record.output)
        if static > least and rms < MAX_RATIO * static:
            return resonance_hz
    return None


def _records(loop: Loop) -> Iterator[_Record]:
    """Yield a loop at its own sampling rate, and at halves of it."""
    assert loop.time is not None
    step = float(np.median(np.diff(loop.time)))
    if step <= 0.0:
        return
    clock = np.arange(float(loop.time[0]), float(loop.time[-1]), step)
    if not _MIN_SAMPLES <= clock.size <= 4 * loop.n:
        return
    record = _Record(
        np.interp(clock, loop.time, loop.input), np.interp(clock, loop.time, loop.output), step
    )
    while record.drive.size >= _MIN_SAMPLES:
        yield record.first(_WINDOW)
        record = record.slower()


def _propose_frequency(record: _Record) -> float | None:
    """Return the frequency of the poles of an autoregressive fit, Hz; None if they do not swing."""
    u, y = record.drive, record.output
    columns = np.column_stack([y[1:-1], y[:-2], u[2:], u[1:-1], u[:-2], np.ones(y.size - 2)])
    poles = np.roots([1.0, *(-np.linalg.lstsq(columns, y[2:])[0][:2])])
    if abs(poles[0].imag) == 0.0:
        return None
    log = np.log(poles[0])
    cycles = abs(log.imag) / (2.0 * np.pi)
    is_swinging = -log.real < abs(log.imag) and 0.02 < cycles < 0.9 * _BAND
    return float(cycles / record.step_s) if is_swinging else None


def _fit_resonance(record: _Record, start_hz: float) -> tuple[float, float] | None:
    """Return frequency, Hz, and rms of the remaining output; None if there is no resonance."""
    count = record.drive.size
    used = np.fft.rfftfreq(count, record.step_s)
    inside = slice(1, max(int(_BAND * count), 8))
    s = 1j * used[inside] / start_hz
    u, y = (np.fft.rfft(each)[inside] / count for each in (record.drive, record.output))
    numerator = np.column_stack([u, s * u, s**2 * u, np.ones_like(s), s, s**2])
    columns = np.column_stack([-y, -s * y, numerator])
    found: tuple[float, ...] = (1.0, 0.1)
    for _ in range(_ITERATIONS):
        weight = 1.0 / (s**2 + found[1] * s + found[0])
        terms, target = columns * weight[:, None], s**2 * y * weight
        rows = np.concatenate([terms.real, terms.imag])
        sizes = np.sqrt(np.einsum("nk,nk->k", rows, rows)) + 1e-300
        shares = np.linalg.lstsq(rows / sizes, np.concatenate([target.real, target.imag]))[0] / sizes
        previous, found = found, tuple(shares[:2].tolist())
        if found[0] <= 0.0 or found[1] <= 0.0:
            return None
        if abs(found[0] / previous[0] - 1.0) + abs(found[1] - previous[1]) < 1e-6:
            break
    own = found[0] ** 0.5
    damping, frequency = 0.5 * found[1] / own, own * start_hz
    slowest = 3.0 / (count * record.step_s)
    if not MIN_DAMPING < damping < MAX_DAMPING or not slowest < frequency < _BAND / record.step_s:
        return None
    weight = 1.0 / (s**2 + found[1] * s + found[0])
    left = y - weight * (numerator @ shares[2:])
    return frequency, float(np.sqrt(2.0 * np.sum(np.abs(left) ** 2)))
