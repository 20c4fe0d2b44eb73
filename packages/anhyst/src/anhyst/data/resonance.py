"""Find a lightly damped resonance between input and output, which hysteresis laws cannot represent.

An autoregressive fit proposes a frequency at each of several sampling rates. A second-order
transfer function with a free transient is then fitted to the spectra, with the iterative weighting
of Sanathanan and Koerner (IEEE Trans. Autom. Control 8 (1963) 56). The result is a resonance if its
residual is much smaller than that of curves and play operators of the input.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from anhyst.data.loops import Loop, Loops
from anhyst.data.output_map import full_scale
from anhyst.data.static_fit import EvenRecord, resample_evenly, static_fit_rms
from anhyst.support.numeric import FloatArray

MIN_STATIC_RMS_SHARE = 0.02
"""Minimum rms residual of static curves for a search, as a fraction of the full scale."""
MAX_RMS_RATIO = 0.6
"""Maximum rms residual of a resonance, relative to that of static curves with play operators."""
MAX_DAMPING = 0.25
"""Maximum damping ratio of a resonance."""
MIN_DAMPING = 5e-4
"""Minimum damping ratio of a mechanical resonance; mains hum has less."""
MIN_SINE_POWER_SHARE = 0.997
"""Minimum fraction of the power of a sine at one frequency; the fraction of a triangle is 0.986."""
MIN_FORCED_SHARE = 0.3
"""Minimum part of the output near a resonance that the input excites, as an amplitude ratio."""
_LINE_WIDTH_SHARE = 0.2
_MAX_LOOPS = 3
_MAX_WINDOW_SAMPLES = 8192
"""Maximum number of samples that are analysed at one sampling rate."""
_MIN_SAMPLES = 128
_MAX_FREQUENCY_SHARE = 0.4
"""Highest analysed frequency, as a fraction of the sampling rate."""
_MAX_ITERATIONS = 12


def find_resonance(loopset: Loops) -> float | None:
    """Return the frequency of the resonance that dominates the output, Hz; ``None`` without one."""
    scale = full_scale(loopset.output, (loop.output for loop in loopset.loops))
    misfits = [
        (static_fit_rms(loop.input, loop.output, with_plays=False), loop)
        for loop in loopset.loops
        if loop.time is not None and loop.n >= _MIN_SAMPLES
    ]
    for misfit, loop in sorted(misfits, key=lambda misfit_and_loop: -misfit_and_loop[0])[:_MAX_LOOPS]:
        if misfit < MIN_STATIC_RMS_SHARE * scale:
            break
        for record in _resampled_records(loop):
            frequency = _propose_frequency(record)
            resonance_fit = None if frequency is None else _fit_resonance(record, frequency)
            if resonance_fit is None:
                continue
            resonance_hz, resonance_rms = resonance_fit
            static_rms = static_fit_rms(record.drive, record.output)
            if static_rms > MIN_STATIC_RMS_SHARE * scale and resonance_rms < MAX_RMS_RATIO * static_rms:
                return resonance_hz
    return None


def describe_resonance(loopset: Loops) -> str:
    """Return a sentence about a resonance; empty without one."""
    frequency = find_resonance(loopset)
    if frequency is None:
        return ""
    return f"the output resonates near {frequency:.3g} Hz; measure more slowly"


def _resampled_records(loop: Loop) -> Iterator[EvenRecord]:
    """Yield a loop at its sampling rate, then repeatedly at half of the previous rate."""
    record = resample_evenly(loop)
    if record is None or _is_sine(record.average_to_sample_limit(_MAX_WINDOW_SAMPLES).drive):
        return
    while record.drive.size >= _MIN_SAMPLES:
        yield record.first_samples(_MAX_WINDOW_SAMPLES)
        record = record.average_blocks(2)


def _is_sine(drive: FloatArray) -> bool:
    """Whether an input has only one frequency, from which no resonance can be identified."""
    window = np.hanning(drive.size)
    power_spectrum = np.abs(np.fft.rfft(window * (drive - np.average(drive, weights=window)))) ** 2
    peak = int(np.argmax(power_spectrum))
    line_range = slice(
        max(int((1.0 - _LINE_WIDTH_SHARE) * peak) - 2, 0), int((1.0 + _LINE_WIDTH_SHARE) * peak) + 4
    )
    return float(np.sum(power_spectrum[line_range])) > MIN_SINE_POWER_SHARE * float(np.sum(power_spectrum))


def _propose_frequency(record: EvenRecord) -> float | None:
    """Return the frequency of the poles of an autoregressive fit, Hz; ``None`` without oscillation."""
    u, y = record.drive, record.output
    columns = np.column_stack([y[1:-1], y[:-2], u[2:], u[1:-1], u[:-2], np.ones(y.size - 2)])
    poles = np.roots([1.0, *(-np.linalg.lstsq(columns, y[2:])[0][:2])])
    if abs(poles[0].imag) == 0.0:
        return None
    log_pole = np.log(poles[0])
    cycles = abs(log_pole.imag) / (2.0 * np.pi)
    is_oscillating = -log_pole.real < abs(log_pole.imag) and 0.02 < cycles < 0.9 * _MAX_FREQUENCY_SHARE
    return float(cycles / record.step) if is_oscillating else None


def _fit_resonance(record: EvenRecord, start_hz: float) -> tuple[float, float] | None:
    """Return the frequency, Hz, and the rms residual of the output; ``None`` without a resonance."""
    count = record.drive.size
    frequencies = np.fft.rfftfreq(count, record.step)
    band = slice(1, max(int(_MAX_FREQUENCY_SHARE * count), 8))
    s = 1j * frequencies[band] / start_hz
    u, y = (np.fft.rfft(signal)[band] / count for signal in (record.drive, record.output))
    numerator = np.column_stack([u, s * u, s**2 * u, np.ones_like(s), s, s**2])
    columns = np.column_stack([-y, -s * y, numerator])
    denominator: tuple[float, ...] = (1.0, 0.1)
    for _ in range(_MAX_ITERATIONS):
        weight = 1.0 / (s**2 + denominator[1] * s + denominator[0])
        terms, target = columns * weight[:, None], s**2 * y * weight
        rows = np.concatenate([terms.real, terms.imag])
        column_norms = np.sqrt(np.einsum("nk,nk->k", rows, rows)) + 1e-300
        coefficients = (
            np.linalg.lstsq(rows / column_norms, np.concatenate([target.real, target.imag]))[0] / column_norms
        )
        previous_denominator, denominator = denominator, tuple(coefficients[:2].tolist())
        if denominator[0] <= 0.0 or denominator[1] <= 0.0:
            return None
        if (
            abs(denominator[0] / previous_denominator[0] - 1.0)
            + abs(denominator[1] - previous_denominator[1])
            < 1e-6
        ):
            break
    relative_frequency = denominator[0] ** 0.5
    damping, frequency = 0.5 * denominator[1] / relative_frequency, relative_frequency * start_hz
    min_frequency_hz = 3.0 / (count * record.step)
    if (
        not MIN_DAMPING < damping < MAX_DAMPING
        or not min_frequency_hz < frequency < _MAX_FREQUENCY_SHARE / record.step
    ):
        return None
    weight = 1.0 / (s**2 + denominator[1] * s + denominator[0])
    # A harmonic of a nonlinear output also oscillates, but the input has no component at its
    # frequency.
    is_near_resonance = np.abs(s.imag / relative_frequency - 1.0) < _LINE_WIDTH_SHARE
    forced_response = weight[is_near_resonance] * (numerator[is_near_resonance, :3] @ coefficients[2:5])
    if np.linalg.norm(forced_response) < MIN_FORCED_SHARE * np.linalg.norm(y[is_near_resonance]):
        return None
    residual = y - weight * (numerator @ coefficients[2:])
    return frequency, float(np.sqrt(2.0 * np.sum(np.abs(residual) ** 2)))
