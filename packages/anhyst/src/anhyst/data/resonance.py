"""Find dynamics between input and output, which hysteresis laws cannot represent.

An autoregressive fit proposes a frequency at each of several sampling rates. A second-order
transfer function of the input and its powers, with a free transient, is then fitted to the spectra,
with the iterative weighting of Sanathanan and Koerner (IEEE Trans. Autom. Control 8 (1963) 56). A
dead time is proposed by the correlation of the changes of input and output. The result counts if
its residual is much smaller than that of curves and play operators of the input after any lag.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from anhyst.data.coil_lag import apply_lag
from anhyst.data.loops import Loop, Loops
from anhyst.data.static_fit import EvenRecord, resample_evenly, static_fit_rms
from anhyst.support.numeric import FloatArray

MIN_STATIC_SHARE = 0.1
MIN_RESONANCE_STATIC_SHARE = 0.05
"""Minimum rms residuals of a static law after a lag, relative to the rms variation of the output."""
MAX_RMS_RATIO = 0.6
"""Maximum rms residual of dynamics, relative to that of a static law after a lag."""
MAX_RESONANCE_DAMPING = 0.25
"""Maximum damping ratio of a response that is called a resonance."""
MAX_DAMPING = 0.75
"""Maximum damping ratio of dynamics; a loop without dynamics can look like a larger damping."""
MIN_PERIODS, MIN_PERIODS_PER_DAMPING = 3.0, 40.0
"""Minimum number of periods of an oscillation in a record, and its ratio to the damping ratio."""
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
_LAG_SAMPLES = (0.0, *(0.5 * 2.0**exponent for exponent in range(10)))
"""Lags of a static law that are compared with dynamics, in samples."""
_MAX_SHARE_RATIO = 3.0
"""Maximum residual at a higher sampling rate that is preferred, relative to the smallest residual."""
_MAX_ITERATIONS = 12


@dataclass(frozen=True, slots=True)
class DynamicResponse:
    """A damped oscillation or a dead time between input and output."""

    frequency: float  # undamped frequency, Hz; for a dead time, the inverse of the dead time
    damping: float | None  # damping ratio; None for a dead time

    @property
    def is_resonance(self) -> bool:
        """Whether the damping is so small that hysteresis cannot look like this oscillation."""
        return self.damping is not None and self.damping <= MAX_RESONANCE_DAMPING


def find_dynamics(loopset: Loops) -> DynamicResponse | None:
    """Return the dynamics that dominate the output; ``None`` if a static law after a lag suffices."""
    misfits = [
        (static_fit_rms(loop.input, loop.output, with_plays=False) / _variation(loop.output), loop)
        for loop in loopset.loops
        if loop.time is not None and loop.n >= _MIN_SAMPLES
    ]
    for misfit, loop in sorted(misfits, key=lambda misfit_and_loop: -misfit_and_loop[0])[:_MAX_LOOPS]:
        if misfit < MIN_RESONANCE_STATIC_SHARE:
            break
        # Averages of few samples per branch do not reach the reversals: a law must also fail at the
        # sampling rate of the loop.
        records = list(_resampled_records(loop))
        candidates = [
            (share, record, dynamics)
            for record in records
            for share, dynamics in filter(None, (_fit_oscillation(record), _fit_dead_time(record)))
        ]
        for share, record, dynamics in sorted(candidates, key=lambda candidate: candidate[0]):
            own_limit = MIN_RESONANCE_STATIC_SHARE if dynamics.is_resonance else MIN_STATIC_SHARE
            min_static_share = max(share / MAX_RMS_RATIO, own_limit)
            static_shares = itertools.chain(_static_shares(record), _static_shares(records[0]))
            if all(static_share > min_static_share for static_share in static_shares):
                # A higher sampling rate has less aliasing.
                equals = [d for r, _, d in candidates if r <= _MAX_SHARE_RATIO * share]
                return next(d for d in equals if (d.damping is None) == (dynamics.damping is None))
    return None


def describe_dynamics(loopset: Loops) -> str:
    """Return a sentence about dynamics; empty without any."""
    dynamics = find_dynamics(loopset)
    if dynamics is None:
        return ""
    frequency, damping = dynamics.frequency, dynamics.damping
    drive, slow = (loopset.input.name, f"measure more slowly (below {frequency / 20.0:.2g} Hz)")
    if damping is None:
        return f"the output follows the {drive} after a dead time of about {1e3 / frequency:.3g} ms; {slow}"
    if dynamics.is_resonance:
        return f"the output resonates near {frequency:.3g} Hz; {slow}"
    return (
        f"the output follows the {drive} like a damped oscillator of {frequency:.3g} Hz (damping ratio "
        f"{damping:.2g}), not like hysteresis; {slow}"
    )


def _resampled_records(loop: Loop) -> Iterator[EvenRecord]:
    """Yield a loop at its sampling rate, then repeatedly at half of the previous rate."""
    record = resample_evenly(loop)
    if record is None or _is_sine(record.average_to_sample_limit(_MAX_WINDOW_SAMPLES).drive):
        return
    while record.drive.size >= _MIN_SAMPLES:
        yield record.largest_window(_MAX_WINDOW_SAMPLES)
        record = record.average_blocks(2)


def _static_shares(record: EvenRecord) -> Iterator[float]:
    """Yield the residuals of curves and play operators of the input after several lags."""
    for samples in _LAG_SAMPLES:
        drive = apply_lag(record, record.step * samples) if samples else record.drive
        yield static_fit_rms(drive, record.output) / _variation(record.output)


def _variation(output: FloatArray) -> float:
    """Return the rms variation of an output, to which all residuals are relative; 1 for a constant."""
    return float(np.std(output)) or 1.0


def _fit_dead_time(record: EvenRecord) -> tuple[float, DynamicResponse] | None:
    """Return the relative residual of a static law after a dead time, and the dead time."""
    spectra = [
        np.fft.rfft(np.diff(signal), 2 * record.drive.size) for signal in (record.drive, record.output)
    ]
    correlation = np.abs(np.fft.irfft(spectra[1] * np.conj(spectra[0])))
    delay = int(np.argmax(correlation[: record.drive.size // 4]))
    if delay == 0:
        return None
    delayed_drive = np.concatenate([np.full(delay, record.drive[0]), record.drive[:-delay]])
    share = static_fit_rms(delayed_drive, record.output) / _variation(record.output)
    return share, DynamicResponse(1.0 / (delay * record.step), None)


def _is_sine(drive: FloatArray) -> bool:
    """Whether an input has only one frequency, from which no resonance can be identified."""
    window = np.hanning(drive.size)
    power_spectrum = np.abs(np.fft.rfft(window * (drive - np.average(drive, weights=window)))) ** 2
    peak = int(np.argmax(power_spectrum))
    line_range = slice(
        max(int((1.0 - _LINE_WIDTH_SHARE) * peak) - 2, 0), int((1.0 + _LINE_WIDTH_SHARE) * peak) + 4
    )
    return float(np.sum(power_spectrum[line_range])) > MIN_SINE_POWER_SHARE * float(np.sum(power_spectrum))


def _propose_frequency(record: EvenRecord) -> float:
    """Return the frequency of the poles of an autoregressive fit, Hz, within the analysed range."""
    u, y = record.drive, record.output
    columns = np.column_stack([y[1:-1], y[:-2], u[2:], u[1:-1], u[:-2], np.ones(y.size - 2)])
    poles = np.roots([1.0, *(-np.linalg.lstsq(columns, y[2:])[0][:2])]).astype(np.complex128)
    cycles = float(np.sqrt(np.prod(np.abs(np.log(poles + 1e-12))))) / (2.0 * np.pi)
    return min(max(cycles, 0.005), _MAX_FREQUENCY_SHARE) / record.step


def _fit_oscillation(record: EvenRecord) -> tuple[float, DynamicResponse] | None:
    """Return the relative residual of a second-order response, and the response, if it oscillates."""
    count, start_hz = record.drive.size, _propose_frequency(record)
    frequencies = np.fft.rfftfreq(count, record.step)
    band = slice(1, max(int(_MAX_FREQUENCY_SHARE * count), 8))
    s = 1j * frequencies[band] / start_hz
    drive = record.drive / (np.max(np.abs(record.drive)) or 1.0)
    *inputs, y = (np.fft.rfft(x)[band] / count for x in (drive, drive**2, drive**3, record.output))
    transient = np.ones_like(s)
    numerator = np.column_stack([s**order * u for u in (*inputs, transient) for order in range(3)])
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
    min_frequency_hz = max(MIN_PERIODS, MIN_PERIODS_PER_DAMPING * damping) / (count * record.step)
    if (
        not MIN_DAMPING < damping < MAX_DAMPING
        or not min_frequency_hz < frequency < _MAX_FREQUENCY_SHARE / record.step
    ):
        return None
    weight = 1.0 / (s**2 + denominator[1] * s + denominator[0])
    # A harmonic of a nonlinear output also oscillates, but the input has no component at its
    # frequency.
    is_near_resonance = np.abs(s.imag / relative_frequency - 1.0) < _LINE_WIDTH_SHARE
    forced_response = weight[is_near_resonance] * (numerator[is_near_resonance, :-3] @ coefficients[2:-3])
    if np.linalg.norm(forced_response) < MIN_FORCED_SHARE * np.linalg.norm(y[is_near_resonance]):
        return None
    residual = y - weight * (numerator @ coefficients[2:])
    rms = float(np.sqrt(2.0 * np.sum(np.abs(residual) ** 2)))
    return rms / _variation(record.output), DynamicResponse(frequency, damping)
