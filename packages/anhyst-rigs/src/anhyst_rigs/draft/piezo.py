"""Fit a piezo stack with Bouc-Wen hysteresis and creep to loops of displacement against voltage.

The displacement of a free stack is ``d*u + b*u^2 - h`` plus creep, with the voltage u and ``dh =
a*du - beta*|du|*h - gamma*du*|h|``. Because ``h`` is proportional to ``a``, a single least-squares
problem gives d, b and a, with d and a not negative. An outer search varies beta, gamma, the lag of
the measurement and the fractions of the creep.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from anhyst.data import Loop, Loops
from anhyst.data.estimates import estimate_noise
from anhyst.data.path import correlation
from anhyst.data.speeds import cycle_rate
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst_rigs.draft.text import Draft, render_draft

CREEP_TIMES_TO_RECORD = (1 / 100, 1 / 10, 1.0)
"""Time constants of creep, as fractions of the longest record, which shows slower creep
incompletely."""
MIN_CREEP_CYCLES = 2.0
"""Shortest time constant of creep in cycles, if all loops have one rate; shorter creep looks like
width."""
MAX_LAG_SAMPLES = 3.0
"""Longest lag if the loops have several rates, in samples; for a single rate, it is one sample."""
MIN_FASTEST_TO_SLOWEST_RATE = 3.0
"""Smallest ratio of the fastest to the slowest rate that counts as several rates."""
MAX_RESIDUAL_WITH_TO_WITHOUT_CREEP = 0.97
"""Creep is included up to this ratio of the residual with creep to the residual without creep."""
OUTLIER_TO_MEDIAN_RESIDUAL = 10.0
"""Ratio to the median residual, above which a residual counts as an outlier."""
MAX_OUTLIER_FRACTION = 0.02
"""Largest fraction of samples that are excluded as outliers; if there are more, none is excluded.
"""
MAX_RESIDUAL_TO_STROKE = 0.05
"""Largest rms residual of loops that count as loops of a stack, as a fraction of the stroke."""
MAX_FIT_SAMPLES = 6_000
"""Largest number of samples in the fit."""
INITIAL_LOG_BETAS = (0.5, 2.5)
"""Initial guesses of the logarithm of beta times the voltage range."""
_NUMERICAL_MARGIN = 1e-12


@dataclass(frozen=True)
class FittedStack:
    """A stack that was fitted to loops, with the keys of ``[[stack]]``."""

    numbers: dict[str, float]
    creep_times: tuple[float, ...]  # time constants of the creep, s
    creep_shares: tuple[float, ...]
    low: float  # ends of the voltage range, V
    high: float
    stroke: float  # range of the displacement, m
    remains: float  # displacement at the lowest voltage after the highest, the lower limit, m
    rms: float  # rms residual, m
    rms_without_creep: float  # rms residual without creep, m
    has_times: bool  # whether the loops have times, without which creep is unknown

    @property
    def fit_text(self) -> str:
        """Residual of the fit as text."""
        rms_text, stroke = f"{1e6 * self.rms:.3g}", f"{1e6 * self.stroke:.3g}"
        return f"{rms_text} um rms, {100.0 * self.rms / self.stroke:.2g} % of the stroke of {stroke} um"

    @property
    def creep_text(self) -> str:
        """Creep that was fitted, or the reason why there is none, as text."""
        if not self.has_times:
            return "the loops have no times"
        if not self.creep_times:
            return "the loops show none: it barely reduces the residual"
        share_and_time = zip(self.creep_shares, self.creep_times, strict=True)
        texts = ", ".join(
            f"{100 * creep_fraction:.2g} % in {time:.2g} s" for creep_fraction, time in share_and_time
        )
        return f"{texts}; without creep the residual is {1e6 * self.rms_without_creep:.3g} um"


def fit_stack(loopset: Loops) -> FittedStack:
    """Fit a stack to loops; raise an InputError if the loops do not belong to a stack."""
    fit_problem = _FitProblem(loopset)
    fit_problem.exclude_outliers(fit_problem.fit(()))
    fit = fit_without_creep = fit_problem.fit(())
    if (
        fit_problem.creep_times
        and (fit_with_creep := fit_problem.fit(fit_problem.creep_times, fit_without_creep)).rms
        < MAX_RESIDUAL_WITH_TO_WITHOUT_CREEP * fit_without_creep.rms
    ):
        fit = fit_with_creep
    stroke, curvature, slope, _ = fit.weights * fit_problem.stroke
    is_poor = fit.rms > MAX_RESIDUAL_TO_STROKE * fit_problem.stroke or not stroke
    if is_poor or not slope:
        reason = "are not those of a stack" if is_poor else "show no hysteresis"
        raise InputError(
            f"the loops {reason}: the residual of the Bouc-Wen model is "
            f"{100 * fit.rms / fit_problem.stroke:.2g} % of the stroke; check them with anhyst inspect",
            code="no-piezo",
        )
    voltage_range, relative_low = fit_problem.voltage_range, fit_problem.low / fit_problem.voltage_range
    beta, gamma_to_beta = math.exp(fit.shape[0]), float(fit.shape[1])
    remaining_state = bouc_wen_state(
        np.array([0.0, fit_problem.high / voltage_range, relative_low]), beta, gamma_to_beta
    )[-1]
    parameters = {
        "stroke_m_per_V": stroke / voltage_range,
        "bend_m_per_V2": curvature / voltage_range**2,
        "slope_m_per_V": slope / voltage_range,
        "beta_per_V": beta / voltage_range,
        "gamma_per_V": gamma_to_beta * beta / voltage_range,
    }
    return FittedStack(
        numbers={key: float(value) for key, value in parameters.items()},
        creep_times=fit.creep_times,
        creep_shares=tuple(fit.shape[3:].tolist()),
        low=fit_problem.low,
        high=fit_problem.high,
        stroke=max(float(np.ptp(displacement)) for displacement in fit_problem.displacements()),
        remains=float(stroke * relative_low + curvature * relative_low**2 - slope * remaining_state),
        rms=fit.rms,
        rms_without_creep=fit_without_creep.rms,
        has_times=fit_problem.sample_s > 0.0,
    )


@dataclass(frozen=True)
class _Fit:
    """The result of a fit.

    ``shape`` contains the logarithm of beta times the voltage range, the ratio of gamma to beta,
    the lag in samples, and the fractions of the creep.
    """

    shape: FloatArray
    creep_times: tuple[float, ...]
    weights: FloatArray  # stroke, bend, slope and offset, relative to the ranges
    deviation: FloatArray  # residuals, m
    rms: float  # rms residual, m


class _FitProblem:
    """The loops and the least-squares problem; its voltages are fractions of their range."""

    def __init__(self, loopset: Loops) -> None:
        stride = 1 + sum(loop.n for loop in loopset.loops) // MAX_FIT_SAMPLES
        self.loops = loopset.loops
        self.sample_slice = slice(None, None, stride)
        self.low = min(0.0, *(float(loop.input.min()) for loop in self.loops))
        self.high = max(float(loop.input.max()) for loop in self.loops)
        self.stroke = max(float(np.ptp(loop.output)) for loop in self.loops)
        if not (self.high > 0.0 and self.stroke > 0.0):
            text = "no voltage above 0 V moves it; invert the sign of the voltage"
            raise InputError(text, code="voltage-negative")
        if any(correlation(loop.input, loop.output) < 0.0 for loop in self.loops):
            raise InputError(
                "the displacement falls as the voltage rises; invert the sign of one column",
                code="output-falls",
            )
        self.voltage_range = self.high - self.low
        loop_times = [loop.time for loop in self.loops if loop.time is not None]
        has_times = len(loop_times) == len(self.loops)
        self.sample_s = min(float(np.median(np.diff(time))) for time in loop_times) if has_times else 0.0
        rates = [cycle_rate(loop.input, loop.time) for loop in self.loops]
        has_several_rates = max(rates) >= MIN_FASTEST_TO_SLOWEST_RATE * min(rates) > 0.0
        longest_record = max(float(time[-1] - time[0]) for time in loop_times) if has_times else 0.0
        min_creep_time = (
            0.0
            if has_several_rates or not max(rates)
            else MIN_CREEP_CYCLES / min(rate for rate in rates if rate)
        )
        self.max_lag = (MAX_LAG_SAMPLES if has_several_rates else 1.0) if self.sample_s else 0.0
        self.creep_times = tuple(
            creep_time_to_record * longest_record
            for creep_time_to_record in CREEP_TIMES_TO_RECORD
            if creep_time_to_record * longest_record >= max(min_creep_time, 10.0 * self.sample_s, 1e-9)
        )
        self.masks = [np.ones(loop.input[self.sample_slice].size, dtype=np.bool_) for loop in self.loops]

    def displacements(self) -> list[FloatArray]:
        """Return the displacements that the fit uses, m."""
        loops_and_masks = zip(self.loops, self.masks, strict=True)
        return [loop.output[self.sample_slice][mask] for loop, mask in loops_and_masks]

    def fit(self, creep_times: tuple[float, ...], initial: _Fit | None = None) -> _Fit:
        """Return the fit with the smallest residual."""
        from scipy.optimize import least_squares

        min_creep_shares = [0.0] * len(creep_times)
        lower_bounds = [-3.0, 0.0, 0.0, *min_creep_shares]
        upper_bounds = [6.0, 5.0, self.max_lag + 1e-9, *(0.1 for _ in creep_times)]
        shapes = [[guess, 0.3, 0.0] for guess in INITIAL_LOG_BETAS] if initial is None else [initial.shape]
        results = []
        for shape in shapes:
            result = least_squares(
                lambda point: self._solve_weights(point, creep_times)[1],
                np.clip([*shape[:3], *(0.005 for _ in creep_times)], lower_bounds, upper_bounds),
                bounds=(lower_bounds, upper_bounds),
                x_scale=[1.0, 1.0, 0.3, *(0.01 for _ in creep_times)],
                diff_step=1e-4,
                max_nfev=50,
            )
            weights, deviation = self._solve_weights(result.x, creep_times)
            rms = float(np.sqrt(np.mean(deviation**2)))
            results.append(_Fit(result.x, creep_times, weights, deviation * self.stroke, rms * self.stroke))
        return min(results, key=lambda fit: fit.rms)

    def exclude_outliers(self, fit: _Fit) -> None:
        """Exclude samples with a large residual, as from a starting amplifier, if they are few."""
        is_close = np.abs(fit.deviation) <= OUTLIER_TO_MEDIAN_RESIDUAL * np.median(np.abs(fit.deviation))
        if np.count_nonzero(~is_close) <= MAX_OUTLIER_FRACTION * is_close.size:
            loop_ends = np.cumsum([mask.size for mask in self.masks])[:-1]
            self.masks = np.split(is_close, loop_ends)

    def _solve_weights(
        self, shape: FloatArray, creep_times: tuple[float, ...]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the weights of voltage, its square, hysteresis and offset, and the residual."""
        from scipy.optimize import nnls

        rows = [
            self._regressor_matrix(loop, shape, creep_times)[self.sample_slice][mask]
            for loop, mask in zip(self.loops, self.masks, strict=True)
        ]
        matrix, output = np.concatenate(rows), np.concatenate(self.displacements()) / self.stroke
        signed_columns = np.hstack([matrix, -matrix[:, 1::2]])  # two columns may have either sign
        normal_matrix = signed_columns.T @ signed_columns
        cholesky = np.linalg.cholesky(
            normal_matrix + 1e-12 * np.trace(normal_matrix) * np.eye(normal_matrix.shape[0])
        )
        weights, _ = nnls(cholesky.T, np.linalg.solve(cholesky, signed_columns.T @ output), maxiter=1000)
        weights[1:4:2] -= weights[4:]
        weights = weights[:4]
        return weights, matrix @ weights - output

    def _regressor_matrix(self, loop: Loop, shape: FloatArray, creep_times: tuple[float, ...]) -> FloatArray:
        drive = loop.input / self.voltage_range
        if shape[2] and loop.time is not None:
            drive = np.interp(loop.time - shape[2] * self.sample_s, loop.time, drive)
        turning_points = [0.0, *(point / self.voltage_range for point in loop.history.turning_points)]
        earlier_voltages = np.array(turning_points)
        if loop.history.kind == "settled":
            earlier_voltages = np.concatenate([earlier_voltages, drive])
        full_drive = np.concatenate([earlier_voltages, drive])
        hysteresis = bouc_wen_state(full_drive, math.exp(shape[0]), float(shape[1]))[earlier_voltages.size :]
        columns = np.stack([drive, drive**2, -hysteresis, np.ones(drive.size)], axis=1)
        if creep_times and loop.time is not None:
            columns[:, :3] += self._creep_columns(loop, columns[:, :3], shape[3:], creep_times)
        return columns

    def _creep_columns(
        self, loop: Loop, columns: FloatArray, creep_shares: FloatArray, creep_times: Sequence[float]
    ) -> FloatArray:
        """Return the creep of given columns.

        It begins at rest at the first sample; for a steady-state loop, it begins about the mean.
        """
        from scipy.signal import lfilter

        is_settled = loop.history.kind == "settled"
        initial = columns.mean(axis=0) if is_settled else columns[0]
        creep = np.zeros_like(columns)
        for time, creep_share in zip(creep_times, creep_shares, strict=True):
            decay = math.exp(-self.sample_s / time)
            initial_creep = decay * initial[None]
            creep += creep_share * lfilter([1.0 - decay], [1.0, -decay], columns, axis=0, zi=initial_creep)[0]
        return creep


def bouc_wen_state(drive: FloatArray, beta: float, gamma_to_beta: float) -> FloatArray:
    """Return h of the Bouc-Wen model for a = 1 along a drive that begins without hysteresis.

    The solution is exact between reversal points. With the travel v and with g = h in its
    direction, dg/dv = 1 - beta*g - gamma*|g|, where gamma is ``ratio`` times beta.
    """
    step = np.diff(drive)
    moving_samples = np.flatnonzero(step)
    state = np.zeros(drive.size)
    if not moving_samples.size:
        return state
    step_signs = np.sign(step[moving_samples])
    reversals = moving_samples[1:][step_signs[1:] != step_signs[:-1]]
    last_state = 0.0
    for begin, end in pairwise([0, *reversals.tolist(), drive.size - 1]):
        travel = np.abs(drive[begin : end + 1] - drive[begin])
        direction = 1.0 if drive[end] > drive[begin] else -1.0
        branch = _branch_state(travel, direction * last_state, beta, gamma_to_beta)
        state[begin : end + 1] = direction * branch
        last_state = float(state[end])
    return state


def _branch_state(travel: FloatArray, start_state: float, beta: float, gamma_to_beta: float) -> FloatArray:
    """Solve dg/dv = 1 - beta*g - gamma*|g| from an initial value; the sign of g sets the rate."""
    rate_at_positive_state, rate_at_negative_state = (
        beta * (1.0 + gamma_to_beta),
        beta * (1.0 - gamma_to_beta) or _NUMERICAL_MARGIN,
    )
    # g approaches 1/rate_at_positive_state from below
    start_state = min(start_state, (1.0 - _NUMERICAL_MARGIN) / rate_at_positive_state)
    initial_rate = rate_at_positive_state if start_state >= 0.0 else rate_at_negative_state
    # travel, counted from the point at which g is zero
    travel_from_zero = travel - math.log1p(-start_state * initial_rate) / initial_rate
    decay_rate = np.where(travel_from_zero < 0.0, rate_at_negative_state, rate_at_positive_state)
    return np.asarray(-np.expm1(-decay_rate * travel_from_zero) / decay_rate)


EXAMPLE_RESONANCE_HZ = 480.0
"""Resonance of the example, Hz, because loops do not show a resonance."""

DEFAULT_NOISE_TO_STROKE = 1e-4
"""Noise as a fraction of the stroke, if the loops contain no noise."""


def draft_piezo(name: str, loops: Loops, stack: FittedStack) -> Draft:
    """Draft the rig file of a piezo stage."""
    measured_noise = float(np.median([estimate_noise(loop.output) for loop in loops.loops]))
    noise_m = measured_noise or DEFAULT_NOISE_TO_STROKE * stack.stroke
    return render_draft(
        "piezo", name=name, stack=stack, read=measured_noise, usual=noise_m, resonance=EXAMPLE_RESONANCE_HZ
    )
