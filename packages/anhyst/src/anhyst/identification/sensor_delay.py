"""Estimate a pure delay of the output sensor from the reversals of fast loops.

Eddy currents and a delay of the sensor have the same effect on slow loops. Just after a sharp
reversal of the current, they differ: the flux in iron with eddy currents begins to deviate from its
smooth course at the reversal itself (as a power of the time of 1 without eddy currents, of 3/2 if
the field diffuses into a slab, of 2 behind a shorted turn), and a delay moves this beginning. The
output around each reversal is a polynomial plus these powers with nonnegative factors. The
delay is that of the smallest misfit, in the window with the smallest sum of scatter and bias.
Neither a hysteresis law nor a rate law is needed.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from anhyst.data import Loop, Loops
from anhyst.data.estimates import estimate_noise
from anhyst.data.loops import replace_columns
from anhyst.data.path import find_branches
from anhyst.support.numeric import FloatArray

POWERS = ((1.0, 1.0), (1.0, 1.5), (1.0, 2.0), (1.0, 3.0), (-1.0, 3.0))
"""Signs and powers of the time after a reversal with which the output of any iron begins to deviate;
the cubes are the next order."""
WINDOW_DIVISORS = (3.0, 5.0, 7.0, 9.0, 11.0, 14.0, 18.0)
"""Mean duration of a branch divided by the half-width of the window around a reversal."""
MIN_WINDOW_SAMPLES = 8
"""Smallest number of samples in a window on each side of a reversal."""
BIAS_SHARE = 0.03
"""Bias of the delay by the shape of the loop, as a fraction of the half-width of the window. With it,
no delay is removed on 96 virtual magnets without a delay (docs/rate.md)."""
MIN_SIGMAS = 3.0
MIN_UNCLEAR_SIGMAS = 1.5
"""Number of standard errors above which a delay is removed, and above which it is reported."""
MIN_SHARPNESS = 0.8
"""Smallest change of the slope of the input at a reversal, relative to that of a triangle."""
_CORNER_SHARE = 0.15  # part of the window around a reversal that does not determine its time
_POLYNOMIAL_DEGREE = 3
_MAX_REVERSALS = 24
_SEARCH_SHARES = np.arange(-0.5, 0.501, 0.01)  # candidates, in half-widths of the window
_MAX_EDGE_WEIGHT = 0.01  # largest probability of the first and last candidates of a valid result


@dataclass(frozen=True)
class SensorDelay:
    """A delay of the output after the input that is not the lag of the iron."""

    seconds: float  # s; negative if the input seems late
    error: float  # standard error including the bias, s
    misfit: float = 0.0  # rms misfit of the curves around the reversals, units of the output

    @property
    def is_clear(self) -> bool:
        """Whether the delay is clearly above its error.

        A negative delay is not clear, because a drive that saturates the iron has the same effect.
        """
        return self.seconds > MIN_SIGMAS * self.error

    def __str__(self) -> str:
        """Return a sentence about the removed delay."""
        return (
            f"at sharp reversals the output is later than the input by {1e3 * self.seconds:.2g} ms "
            f"(standard error {1e3 * self.error:.1g} ms), which iron does not do: this delay of a sensor "
            "was removed from all loops, and is not part of the model"
        )


@dataclass(frozen=True)
class _Reversal:
    """A sharp reversal of the input."""

    time: FloatArray  # times of the samples relative to the reversal, s
    output: FloatArray  # sign changed if the output has a minimum
    rounding: float  # square of the time constant that rounds the reversal of the input, s^2


def describe_unclear_delay(delay: SensorDelay | None) -> str:
    """Return a warning about a possible delay that is attributed to the iron; empty without one."""
    if delay is None:
        return (
            "the reversals of the input do not show whether the output is delayed: a delay of the sensor "
            "would be part of the rate dependence; measure triangles, or remove it (--clean skew)"
        )
    if delay.is_clear or delay.seconds < MIN_UNCLEAR_SIGMAS * delay.error:
        return ""
    return (
        f"the output may be later than the input by {1e3 * delay.seconds:.2g} ms (standard error "
        f"{1e3 * delay.error:.1g} ms): this is too uncertain to be removed, and is part of the rate dependence"
    )


def estimate_sensor_delay(loops: Sequence[Loop]) -> SensorDelay | None:
    """Return the delay of the output of loops of one speed; None if their reversals do not show it."""
    records = [record for record in map(_unroll, loops) if record is not None]
    branches = [
        float(time[branch.stop - 1] - time[branch.start])
        for time, drive, _ in records
        for branch in find_branches(drive)[1:-1]
    ]
    if not branches:
        return None
    branch_time = float(np.median(branches))
    step = max(float(np.median(np.diff(time))) for time, _, _ in records)
    reversals = [found for record in records for found in _find_reversals(*record, branch_time)]
    noise = max(estimate_noise(loop.output) for loop in loops)
    fits: list[SensorDelay] = []
    for divisor in WINDOW_DIVISORS:
        window = branch_time / divisor
        if window < MIN_WINDOW_SAMPLES * step:
            break
        centres = {0.0} | {fit.seconds for fit in fits[-1:]}
        near = (_fit_window(reversals[:_MAX_REVERSALS], centre, window, noise) for centre in centres)
        fits += sorted(filter(None, near), key=lambda fit: fit.misfit)[:1]
    best = min(fits, key=lambda fit: fit.error, default=None)
    if best is None:
        return None
    wider = fits[: fits.index(best) + 1]
    contradiction = max(abs(best.seconds - fit.seconds) - fit.error for fit in wider)
    return replace(best, error=float(np.hypot(best.error, max(0.0, contradiction))))


def remove_sensor_delay(loops: Loops, delay: SensorDelay) -> Loops:
    """Shift all outputs by a delay. A steady-state cycle keeps its samples."""
    shifted = []
    for loop in loops.loops:
        record = _unroll(loop)
        assert record is not None
        assert loop.time is not None
        time, _, output = record
        later = loop.time + delay.seconds
        is_inside = later <= time[-1]
        output = np.interp(later, time, output)[is_inside]
        shifted.append(replace_columns(loop, itemgetter(is_inside), output=output))
    return loops.with_loops(shifted)


_Record = tuple[FloatArray, FloatArray, FloatArray]
"""Time, input and output of a record."""


def _unroll(loop: Loop) -> _Record | None:
    """Return a record; a steady-state cycle is repeated, so that all its reversals are inside."""
    if loop.time is None:
        return None
    if loop.history.kind != "settled":
        return loop.time, loop.input, loop.output
    time, step = loop.time, float(np.median(np.diff(loop.time)))
    is_closed = abs(loop.input[-1] - loop.input[0]) < 0.5 * np.median(np.abs(np.diff(loop.input)))
    rows = np.arange(loop.n - is_closed)  # without a last sample that repeats the first
    period = time[rows[-1]] - time[0] + step
    time = np.concatenate([time[rows], time[rows] + period])
    return time, np.tile(loop.input[rows], 2), np.tile(loop.output[rows], 2)


def _find_reversals(
    time: FloatArray, drive: FloatArray, output: FloatArray, branch_time: float
) -> list[_Reversal]:
    """Return the sharp reversals of a record that are far enough from its ends."""
    found, window = [], branch_time / WINDOW_DIVISORS[0]
    for branch, _ in itertools.pairwise(find_branches(drive)):
        tip = float(time[branch.stop - 1])
        rows = np.flatnonzero(np.abs(time - tip) <= 2.0 * window)
        near = rows[np.abs(time[rows] - tip) <= window]
        if min(tip - time[0], time[-1] - tip) < window or near.size < 2 * MIN_WINDOW_SAMPLES:
            continue
        corner = _fit_corner(time[near] - tip, drive[near], _CORNER_SHARE * window)
        depth = float(np.mean(np.abs(drive[near[[0, -1]]] - drive[branch.stop - 1])))
        if corner is None or abs(corner[1]) * window < 2.0 * MIN_SHARPNESS * depth:
            continue
        sign = float(np.sign(2.0 * output[branch.stop - 1] - output[near[[0, -1]]].sum()))
        found.append(_Reversal(time[rows] - tip - corner[0], sign * output[rows], corner[2]))
    return found


def _fit_corner(time: FloatArray, drive: FloatArray, margin: float) -> tuple[float, float, float] | None:
    """Fit parabolas to the input before and after a reversal at time 0, without a margin.

    Return the time at which they intersect, the change of the slope there, and the square of the
    time constant of a first-order lag that rounds the reversal so.
    """
    before, after = time < -margin, time > margin
    if min(np.count_nonzero(before), np.count_nonzero(after)) < 4:
        return None
    coefficients = [np.polyfit(time[part], drive[part], 2) for part in (before, after)]
    _, slope_change, difference = coefficients[1] - coefficients[0]
    if slope_change == 0.0:
        return None
    offset = float(-difference / slope_change)
    rounding = drive - np.where(time < offset, *(np.polyval(side, time) for side in coefficients))
    twice_area = float(np.diff(time) @ (rounding[1:] + rounding[:-1]))
    return offset, float(slope_change), twice_area / float(slope_change)


def _fit_window(
    reversals: Sequence[_Reversal], centre: float, window: float, noise: float
) -> SensorDelay | None:
    """Return the delay near a centre, or None if the reversals do not show it."""
    delays, rows, counts = centre + window * _SEARCH_SHARES, [], []
    for reversal in reversals:
        is_near = np.abs(reversal.time - centre) <= window
        rows.append(_misfit_by_delay((reversal.time[is_near] - centre) / window, reversal.output[is_near]))
        counts.append(np.count_nonzero(is_near))
    misfits, freedom = np.array(rows), sum(counts) - len(counts) * (_POLYNOMIAL_DEGREE + 1 + len(POWERS))
    if freedom <= 0:
        return None
    variance = float(misfits.sum(axis=0).min()) / freedom + 1e-300
    delay, scatter = _weigh(misfits.sum(axis=0), delays, variance)
    if not scatter:
        return None
    each = np.array([_weigh(row, delays, variance, edge=1.0) for row in misfits])
    # Reversals that contradict each other, and a misfit that is not noise, increase the error.
    chi_square = float(np.mean(((each[:, 0] - delay) / each[:, 1]) ** 2)) if len(each) > 1 else 1.0
    systematic = max(0.0, 1.0 - noise**2 / variance) * float(np.mean(counts))
    rounding = max(0.0, float(np.mean([reversal.rounding for reversal in reversals])))
    square = scatter**2 * max(1.0, chi_square) * (1.0 + systematic) + (BIAS_SHARE * window) ** 2 + rounding
    return SensorDelay(delay, float(np.sqrt(square)), float(np.sqrt(variance)))


def _weigh(
    misfits: FloatArray, delays: FloatArray, variance: float, edge: float = _MAX_EDGE_WEIGHT
) -> tuple[float, float]:
    """Return mean and standard deviation of the delay; a deviation of 0 if a bound is likely."""
    weights = np.exp(-0.5 * (misfits - misfits.min()) / variance)
    weights /= weights.sum()
    delay = float(weights @ delays)
    deviation = float(np.sqrt(weights @ (delays - delay) ** 2)) + 1e-3 * float(np.ptp(delays))
    return delay, deviation if weights[[0, -1]].max() <= edge else 0.0


def _misfit_by_delay(time: FloatArray, output: FloatArray) -> FloatArray:
    """Return the sum of squared deviations for each candidate; times are in half-widths."""
    from scipy.optimize import nnls

    polynomial, _ = np.linalg.qr(np.stack([time**power for power in range(_POLYNOMIAL_DEGREE + 1)], axis=1))
    fall = polynomial @ (polynomial.T @ output) - output
    misfits = []
    for delay in _SEARCH_SHARES:
        late = np.clip(time - delay, 0.0, None)
        basis = np.stack([sign * late**power for sign, power in POWERS], axis=1)
        misfits.append(nnls(basis - polynomial @ (polynomial.T @ basis), fall)[1] ** 2)
    return np.array(misfits)
