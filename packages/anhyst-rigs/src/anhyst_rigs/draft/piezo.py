"""A piezo stack fitted to loops of displacement over voltage: the law of Bouc and Wen, and creep.

A free stack wants to be ``d*u + b*u^2 - h`` long, with ``dh = a*du - beta*|du|*h - gamma*du*|h|``,
and creeps after it. ``h`` is in proportion to ``a``: d, b and a come from one least-squares problem
with d and a not below zero. Around it beta, gamma, the lag of the measurement and the shares of the
creep are varied.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from anhyst.data import Loop, Loops
from anhyst.data.estimates import noise
from anhyst.data.path import correlation
from anhyst.data.speeds import rate_of
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst_rigs.draft.text import Draft, draft

CREEP = (1 / 100, 1 / 10, 1.0)
"""Time constants that are tried, in parts of the longest record: of slower ones it shows the begin."""
SLOWER = 2.0
"""Least time constant, in cycles, where all loops run at one rate: a shorter one looks like width."""
LAGS = 3.0
"""Longest lag, in samples; there a single one, for the same reason."""
RATES_APART = 3.0
WORTH = 0.97
"""Deviation, in parts of that without creep, from which on loops show none."""
STRAY, FEW = 10.0, 0.02
"""A sample that deviates so many times as much as usual shows no loop; of so few it is left out."""
MISSED = 0.05
"""Of the stroke, rms: loops that are followed no better are none of a stack."""
SAMPLES = 6_000
"""That are fitted."""
STARTS = (0.5, 2.5)
"""Of the logarithm of beta, over the range of the voltage."""
_TINY = 1e-12


@dataclass(frozen=True)
class FittedStack:
    """A stack as loops show it, in the keys of ``[[stack]]``."""

    numbers: dict[str, float]
    creep_times: tuple[float, ...]  # s
    creep_shares: tuple[float, ...]
    low: float  # range of the voltage, V
    high: float
    stroke: float  # range of the displacement, m
    remains: float  # at the lowest voltage after the highest: what a stage cannot go below, m
    rms: float  # deviation, m
    still_rms: float  # the same without creep, m
    timed: bool  # without times nothing is known of creep

    @property
    def fit_text(self) -> str:
        """How well loops are followed."""
        size, stroke = f"{1e6 * self.rms:.3g}", f"{1e6 * self.stroke:.3g}"
        return f"{size} um rms, {100.0 * self.rms / self.stroke:.2g} % of the stroke of {stroke} um"

    @property
    def creep_text(self) -> str:
        """What creeps, or why nothing does."""
        if not self.timed:
            return "the loops have no times"
        if not self.creep_times:
            return "the loops show none: with it they are missed by hardly less"
        shares = zip(self.creep_shares, self.creep_times, strict=True)
        listed = ", ".join(f"{100 * share:.2g} % in {time:.2g} s" for share, time in shares)
        return f"{listed}; without that they would be missed by {1e6 * self.still_rms:.3g} um"


def fit_stack(loopset: Loops) -> FittedStack:
    """Fit a stack to loops; refuse what is none."""
    problem = _Problem(loopset)
    problem.leave_out_strays(problem.fit(()))
    best = still = problem.fit(())
    if problem.times and (crept := problem.fit(problem.times, still)).rms < WORTH * still.rms:
        best = crept
    stroke, bend, slope, _ = best.weights * problem.height
    missed = best.rms > MISSED * problem.height or not stroke
    if missed or not slope:
        why = "are followed by no stack" if missed else "show no hysteresis"
        raise InputError(
            f"the loops {why}: the law of Bouc and Wen misses {100 * best.rms / problem.height:.2g} "
            "% of the stroke; look at them with anhyst inspect",
            code="no-piezo",
        )
    span, low = problem.span, problem.low / problem.span
    beta, ratio = math.exp(best.shape[0]), float(best.shape[1])
    back = hysteresis(np.array([0.0, problem.high / span, low]), beta, ratio)[-1]
    numbers = {
        "stroke_m_per_V": stroke / span,
        "bend_m_per_V2": bend / span**2,
        "slope_m_per_V": slope / span,
        "beta_per_V": beta / span,
        "gamma_per_V": ratio * beta / span,
    }
    return FittedStack(
        numbers={key: float(value) for key, value in numbers.items()},
        creep_times=best.times,
        creep_shares=tuple(best.shape[3:].tolist()),
        low=problem.low,
        high=problem.high,
        stroke=max(float(np.ptp(answer)) for answer in problem.answers()),
        remains=float(stroke * low + bend * low**2 - slope * back),
        rms=best.rms,
        still_rms=still.rms,
        timed=problem.step > 0.0,
    )


@dataclass(frozen=True)
class _Fit:
    """Logarithm of beta over the range, gamma over beta, lag in samples, shares of the creep."""

    shape: FloatArray
    times: tuple[float, ...]
    weights: FloatArray  # stroke, bend and slope in parts of the range
    off: FloatArray  # m
    rms: float  # m


class _Problem:
    """Loops, and what is fitted to them; voltages in parts of their range."""

    def __init__(self, loopset: Loops) -> None:
        every = 1 + sum(loop.n for loop in loopset.loops) // SAMPLES
        self.loops = loopset.loops
        self.thin = slice(None, None, every)
        self.low = min(0.0, *(float(loop.input.min()) for loop in self.loops))
        self.high = max(float(loop.input.max()) for loop in self.loops)
        self.height = max(float(np.ptp(loop.output)) for loop in self.loops)
        if not (self.high > 0.0 and self.height > 0.0):
            text = "no voltage above 0 V moves it; turn the sign of the voltage"
            raise InputError(text, code="voltage-negative")
        if any(correlation(loop.input, loop.output) < 0.0 for loop in self.loops):
            raise InputError(
                "the displacement falls as the voltage rises; flip the sign of one of the columns",
                code="output-falls",
            )
        self.span = self.high - self.low
        times = [loop.time for loop in self.loops if loop.time is not None]
        timed = len(times) == len(self.loops)
        self.step = min(float(np.median(np.diff(time))) for time in times) if timed else 0.0
        rates = [rate_of(loop.input, loop.time) for loop in self.loops]
        apart = max(rates) >= RATES_APART * min(rates) > 0.0
        longest = max(float(time[-1] - time[0]) for time in times) if timed else 0.0
        least = 0.0 if apart or not max(rates) else SLOWER / min(rate for rate in rates if rate)
        self.most_lag = (LAGS if apart else 1.0) if self.step else 0.0
        self.times = tuple(
            part * longest for part in CREEP if part * longest >= max(least, 10.0 * self.step, 1e-9)
        )
        self.counted = [np.ones(loop.input[self.thin].size, dtype=np.bool_) for loop in self.loops]

    def answers(self) -> list[FloatArray]:
        """Return the displacements that count, m."""
        pairs = zip(self.loops, self.counted, strict=True)
        return [loop.output[self.thin][mask] for loop, mask in pairs]

    def fit(self, times: tuple[float, ...], begin: _Fit | None = None) -> _Fit:
        """Vary the shape until the deviation is least."""
        from scipy.optimize import least_squares

        extra = [0.0] * len(times)
        low, high = (
            [-3.0, 0.0, 0.0, *extra],
            [6.0, 5.0, self.most_lag + 1e-9, *(0.1 for _ in times)],
        )
        shapes = [[start, 0.3, 0.0] for start in STARTS] if begin is None else [begin.shape]
        fits = []
        for shape in shapes:
            done = least_squares(
                lambda point: self._solve(point, times)[1],
                np.clip([*shape[:3], *(0.005 for _ in times)], low, high),
                bounds=(low, high),
                x_scale=[1.0, 1.0, 0.3, *(0.01 for _ in times)],
                diff_step=1e-4,
                max_nfev=50,
            )
            weights, off = self._solve(done.x, times)
            rms = float(np.sqrt(np.mean(off**2)))
            fits.append(_Fit(done.x, times, weights, off * self.height, rms * self.height))
        return min(fits, key=lambda fit: fit.rms)

    def leave_out_strays(self, fit: _Fit) -> None:
        """Leave out few samples that deviate as no loop does: an amplifier that came up."""
        near = np.abs(fit.off) <= STRAY * np.median(np.abs(fit.off))
        if np.count_nonzero(~near) <= FEW * near.size:
            ends = np.cumsum([mask.size for mask in self.counted])[:-1]
            self.counted = np.split(near, ends)

    def _solve(self, shape: FloatArray, times: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
        """Return weights of voltage, its square, hysteresis and offset, and the deviation."""
        from scipy.optimize import nnls

        rows = [
            self._columns(loop, shape, times)[self.thin][mask]
            for loop, mask in zip(self.loops, self.counted, strict=True)
        ]
        matrix, target = np.concatenate(rows), np.concatenate(self.answers()) / self.height
        signed = np.hstack([matrix, -matrix[:, 1::2]])  # two columns may have either sign
        normal = signed.T @ signed
        factor = np.linalg.cholesky(normal + 1e-12 * np.trace(normal) * np.eye(normal.shape[0]))
        weights, _ = nnls(factor.T, np.linalg.solve(factor, signed.T @ target), maxiter=1000)
        weights[1:4:2] -= weights[4:]
        weights = weights[:4]
        return weights, matrix @ weights - target

    def _columns(self, loop: Loop, shape: FloatArray, times: tuple[float, ...]) -> FloatArray:
        drive = loop.input / self.span
        if shape[2] and loop.time is not None:
            drive = np.interp(loop.time - shape[2] * self.step, loop.time, drive)
        before = [0.0, *(point / self.span for point in loop.history.turning_points)]
        lead = np.array(before)
        if loop.history.kind == "settled":
            lead = np.concatenate([lead, drive])
        whole = np.concatenate([lead, drive])
        held = hysteresis(whole, math.exp(shape[0]), float(shape[1]))[lead.size :]
        columns = np.stack([drive, drive**2, -held, np.ones(drive.size)], axis=1)
        if times and loop.time is not None:
            columns[:, :3] += self._creep(loop, columns[:, :3], shape[3:], times)
        return columns

    def _creep(
        self, loop: Loop, columns: FloatArray, shares: FloatArray, times: Sequence[float]
    ) -> FloatArray:
        """Return what creeps after some columns, from rest where the loop begins or about its mean."""
        from scipy.signal import lfilter

        settled = loop.history.kind == "settled"
        begin = columns.mean(axis=0) if settled else columns[0]
        added = np.zeros_like(columns)
        for time, share in zip(times, shares, strict=True):
            kept = math.exp(-self.step / time)
            start = kept * begin[None]
            added += share * lfilter([1.0 - kept], [1.0, -kept], columns, axis=0, zi=start)[0]
        return added


def hysteresis(drive: FloatArray, beta: float, ratio: float) -> FloatArray:
    """Return h of Bouc and Wen for a = 1 along a drive that begins at its first value without any.

    Exact between turning points: with v the way and g = h in its direction, dg/dv = 1 - beta*g -
    gamma*|g|; gamma is a ratio times beta.
    """
    step = np.diff(drive)
    moving = np.flatnonzero(step)
    held = np.zeros(drive.size)
    if not moving.size:
        return held
    signs = np.sign(step[moving])
    turns = moving[1:][signs[1:] != signs[:-1]]
    now = 0.0
    for begin, end in pairwise([0, *turns.tolist(), drive.size - 1]):
        way = np.abs(drive[begin : end + 1] - drive[begin])
        sign = 1.0 if drive[end] > drive[begin] else -1.0
        along = _along(way, sign * now, beta, ratio)
        held[begin : end + 1] = sign * along
        now = float(held[end])
    return held


def _along(way: FloatArray, start: float, beta: float, ratio: float) -> FloatArray:
    """Solve dg/dv = 1 - beta*g - gamma*|g| from a start: below zero first, above it then."""
    above, below = beta * (1.0 + ratio), beta * (1.0 - ratio) or _TINY
    start = min(start, (1.0 - _TINY) / above)  # g nears 1/above and never reaches it
    before = above if start >= 0.0 else below
    past = way - math.log1p(-start * before) / before  # zero
    rate = np.where(past < 0.0, below, above)
    return np.asarray(-np.expm1(-rate * past) / rate)


RESONANCE = 480.0
"""Of the example, Hz: loops say nothing of it."""

USUAL_NOISE = 1e-4
"""Of the stroke, where the loops show none."""


def draft_piezo(name: str, loops: Loops, stack: FittedStack) -> Draft:
    """Write the rig file of a piezo stage."""
    read = float(np.median([noise(loop.output) for loop in loops.loops]))
    usual = read or USUAL_NOISE * stack.stroke
    return draft("piezo", name=name, stack=stack, read=read, usual=usual, resonance=RESONANCE)
