"""Monitor whether a model still fits, from the measured and the predicted force in every cycle.

The residual of a model is not white: it depends on the path, and repeats in every cycle of the
current. Therefore, each cycle is reduced to two values. The level is the mean of the residual over
both branches; it depends on gain, saturation and sensors. The width is half the difference between
the descending and the ascending branch; it depends on pinning.

The first cycles, in which the model is known to fit, give mean, scatter and correlation of these
values. Later cycles are tested by cumulative sums (CUSUM). The same applies to recordings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammaincinv

from anhyst.data.clean import DEFAULT_STEPS
from anhyst.data.output_map import is_actuator
from anhyst.data.path import HistoryLike
from anhyst.data.source import LoopSource, load_loops
from anhyst.model.actuator import Model, resolve_model
from anhyst.model.stepper import Stepper
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.wording import count_text

MIN_ALLOWANCE = 0.5
"""Smallest allowance of a chart, in standard deviations; optimal for shifts of twice this size."""
_RANDOM_WALK_OVERSHOOT = 1.166
"""Mean overshoot of a random walk with normal steps beyond both thresholds (Siegmund 1985)."""
_SCATTER_QUANTILE = 0.05
"""Probability that the true scatter exceeds its estimate from few values."""
_MEAN_ERROR_FACTOR = 2.0
"""Number of standard errors of the mean that are added to the allowance."""
_MAX_CORRELATION = 0.9


def alarm_threshold(run_length: float, allowance: float = MIN_ALLOWANCE) -> float:
    """Return the threshold of a one-sided chart, in standard deviations.

    >>> round(alarm_threshold(465.0), 1)  # tables say 5 for a mean run of 465
    4.8
    """
    scaled_length = 2.0 * allowance * allowance * run_length
    scaled_threshold = brentq(lambda x: math.expm1(x) - x - scaled_length, 1e-9, 700.0)
    return float(max(scaled_threshold / (2.0 * allowance) - _RANDOM_WALK_OVERSHOOT, 0.0))


@dataclass(frozen=True, slots=True)
class Reference:
    """Mean and scatter of a sequence of values while the model fits."""

    mean: float
    # upper bound of the standard deviation of independent values whose sums scatter as much
    scatter: float
    mean_error: float  # standard error of the mean

    @classmethod
    def from_values(cls, values: Sequence[float]) -> Reference:
        """Estimate the reference from at least 4 values.

        Correlation between successive values increases the scatter of a sum. For a correlation r
        that decays geometrically, the factor is the root of ``(1 + r)/(1 - r)``.
        """
        array = np.asarray(values)
        count = array.size
        deviation = array - array.mean()
        square_sum = float(deviation @ deviation)
        if square_sum == 0.0:
            return cls(float(array.mean()), 0.0, 0.0)
        # The term 1/count corrects the bias of short sequences.
        correlation = float(deviation[1:] @ deviation[:-1]) / square_sum + 1.0 / count
        correlation = min(max(correlation, 0.0), _MAX_CORRELATION)
        chi_squared_quantile = 2.0 * float(gammaincinv(0.5 * (count - 1), _SCATTER_QUANTILE))
        single_sigma = math.sqrt(square_sum / chi_squared_quantile)
        scatter = single_sigma * math.sqrt((1.0 + correlation) / (1.0 - correlation))
        return cls(float(array.mean()), scatter, _MEAN_ERROR_FACTOR * scatter / math.sqrt(count))


@dataclass(slots=True)
class CusumChart:
    """A chart of two cumulative sums, one for each sign of the deviation."""

    reference: Reference
    min_shift: float  # smallest shift that causes an alarm; half of this is the allowance
    run_length: float  # mean number of values until a false alarm, for both signs together
    _sums: list[float] = field(default_factory=lambda: [0.0, 0.0])
    _counts: list[int] = field(default_factory=lambda: [0, 0])
    _shifts: list[float] = field(default_factory=lambda: [0.0, 0.0])

    @property
    def allowance(self) -> float:
        """Deviation of a value above which the value increases a sum."""
        noise_allowance = max(MIN_ALLOWANCE * self.reference.scatter, 0.5 * self.min_shift)
        return noise_allowance + self.reference.mean_error

    @property
    def limit(self) -> float:
        """Sum at which an alarm occurs.

        An allowance above the smallest one only makes false alarms rarer.
        """
        return alarm_threshold(2.0 * self.run_length) * self.reference.scatter

    def add_value(self, value: float) -> tuple[float, int] | None:
        """Add a value; return mean shift and number of values if there is an alarm, or None."""
        deviation = value - self.reference.mean
        for side, sign in enumerate((1.0, -1.0)):
            self._sums[side] += sign * deviation - self.allowance
            if self._sums[side] <= 0.0:
                self._sums[side], self._counts[side], self._shifts[side] = 0.0, 0, 0.0
                continue
            self._counts[side] += 1
            self._shifts[side] += deviation
            if self._sums[side] > self.limit:
                return self._shifts[side] / self._counts[side], self._counts[side]
        return None


DriftKind = Literal["level", "width"]

LEARNING_CYCLES = 10
"""Number of cycles from which the reference is estimated."""
DEFAULT_RUN_LENGTH = 1e5
"""Mean number of cycles until a false alarm occurs."""
MIN_DRIFT_TO_MAX_OUTPUT = 0.001
"""Smallest drift that causes an alarm, relative to the largest output of the model."""
REVERSAL_TO_CURRENT_RANGE = 0.1
"""Smallest change of the current that counts as a reversal, relative to the model's range."""


@dataclass(frozen=True, slots=True)
class DetectedDrift:
    """A drift that was detected."""

    kind: DriftKind  # quantity that has drifted, ``"level"`` or ``"width"``
    shift: float  # shift of the mean from the reference, in the unit of the output (N)
    begin_tick: int  # first tick of the drift, estimated as the end of the last cycle before it
    found_tick: int  # tick at which the drift was detected


@dataclass(frozen=True, slots=True)
class Finding:
    """The present result of the monitoring."""

    cycles: int  # number of completed cycles
    is_learning: bool  # whether there are too few cycles for a result
    drift: DetectedDrift | None  # the first drift; None while the model fits
    # rms residual of the model while it was known to fit, and in the last cycle, in the unit of the
    # output, including noise; 0 before the first cycle is completed
    usual_residual: float = field(default=0.0, compare=False)
    residual: float = field(default=0.0, compare=False)

    @property
    def error_reduction(self) -> float:
        """Estimated reduction of the rms residual if the model were measured again."""
        return max(0.0, self.residual - self.usual_residual)

    def text(self, rate: float) -> str:
        """Return the finding as a sentence. `rate` (Hz) converts ticks to seconds."""
        if self.drift is not None:
            drift = self.drift
            return (
                f"the {drift.kind} has drifted by {drift.shift:+.3g} N since {drift.begin_tick / rate:.1f} s "
                f"(found at {drift.found_tick / rate:.1f} s); the residual is {self.residual:.3g} N rms instead "
                f"of {self.usual_residual:.3g} N; measure again"
            )
        if self.is_learning:
            return f"learning: {self.cycles} of {LEARNING_CYCLES} cycles of the current"
        return f"the model fits, over {count_text(self.cycles, 'cycle')}"


@dataclass(slots=True)
class _BranchSplitter:
    """Splits samples at the reversals of the current, for any division into chunks."""

    reversal_size: float
    _low: float = np.inf
    _high: float = -np.inf
    _is_rising: bool | None = None
    _extreme: float = 0.0
    _extreme_tick: int = 0
    _total: float = 0.0
    _count: int = 0
    _branch_start_sum: tuple[float, int] | None = None
    _extreme_sum: tuple[float, int] = (0.0, 0)

    def add_sample(self, tick: int, current: float, residual: float) -> tuple[bool, float, int] | None:
        """Add a sample; return a completed branch (whether ascending, mean, last tick) or None."""
        self._total += residual
        self._count += 1
        if self._is_rising is None:
            # The first samples can lie anywhere in a swing that is barely larger than a reversal.
            self._low, self._high = min(self._low, current), max(self._high, current)
            if self._high - self._low > self.reversal_size:
                self._is_rising = current == self._high
                self._mark_extreme(tick, current)
            return None
        if (current >= self._extreme) if self._is_rising else (current <= self._extreme):
            self._mark_extreme(tick, current)
            return None
        if abs(current - self._extreme) <= self.reversal_size:
            return None
        residual_sum, count = self._extreme_sum
        branch_start = self._branch_start_sum
        branch = None
        if branch_start is not None and count > branch_start[1]:
            mean = (residual_sum - branch_start[0]) / (count - branch_start[1])
            branch = self._is_rising, mean, self._extreme_tick
        self._branch_start_sum, self._is_rising = self._extreme_sum, not self._is_rising
        self._mark_extreme(tick, current)
        return branch

    def _mark_extreme(self, tick: int, current: float) -> None:
        self._extreme, self._extreme_tick = current, tick
        self._extreme_sum = self._total, self._count


@dataclass(slots=True)
class DriftMonitor:
    """Monitor of one model. Its result does not depend on how the samples are divided into chunks."""

    model: Model  # model of force as a function of current and gap
    gap: float  # gap of the first sample, m
    # history of the iron before the first sample; default: that of the model. The first cycle must
    # remove the effect of any error in it.
    history: HistoryLike | None = None
    run_length: float = DEFAULT_RUN_LENGTH  # mean number of cycles until a false alarm
    # smallest drift that causes an alarm, N; default: a thousandth of the model's largest output
    min_drift: float | None = None
    finding: Finding = field(default=Finding(0, True, None), init=False)
    _stepper: Stepper = field(init=False)
    _splitter: _BranchSplitter = field(init=False)
    _learning_values: dict[DriftKind, list[float]] = field(init=False)
    _charts: dict[DriftKind, CusumChart] = field(default_factory=dict, init=False)
    _ascending_mean: float | None = field(default=None, init=False)
    _cycle_ends: list[int] = field(default_factory=list, init=False)
    _mean_squares: list[float] = field(default_factory=list, init=False)
    _square_sum: tuple[float, int] = field(default=(0.0, 0), init=False)
    _last_tick: int | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        current_low, current_high = self.model.valid_range.input
        self._stepper = Stepper(self.model, self.gap, self.history)
        self._splitter = _BranchSplitter(REVERSAL_TO_CURRENT_RANGE * (current_high - current_low))
        self._learning_values = {"level": [], "width": []}
        if self.min_drift is None:
            self.min_drift = MIN_DRIFT_TO_MAX_OUTPUT * max(abs(end) for end in self.model.valid_range.output)

    def add_samples(
        self, ticks: FloatArray, current: FloatArray, gap: FloatArray, force: FloatArray
    ) -> Finding:
        """Add a chunk of samples."""
        if ticks.size == 0 or self.finding.drift is not None:
            return self.finding
        if np.any(np.diff(ticks) <= 0) or (self._last_tick is not None and ticks[0] <= self._last_tick):
            raise InputError("ticks do not increase; pass the chunks in order", code="time-not-rising")
        self._last_tick = int(ticks[-1])
        residuals = force - self._stepper.follow(current, gap)
        for tick, current_A, residual in zip(
            ticks.tolist(), current.tolist(), residuals.tolist(), strict=True
        ):
            self._square_sum = self._square_sum[0] + residual * residual, self._square_sum[1] + 1
            branch = self._splitter.add_sample(int(tick), current_A, residual)
            if branch is not None:
                self._add_branch(*branch)
            if self.finding.drift is not None:
                break
        return self.finding

    def _add_branch(self, is_rising: bool, mean: float, tick: int) -> None:
        if is_rising:
            self._ascending_mean = mean
        elif self._ascending_mean is not None:
            values: dict[DriftKind, float] = {
                "level": 0.5 * (mean + self._ascending_mean),
                "width": 0.5 * (mean - self._ascending_mean),
            }
            self._ascending_mean = None
            self._add_cycle(values, tick)

    def _add_cycle(self, values: dict[DriftKind, float], tick: int) -> None:
        self._cycle_ends.append(tick)
        self._mean_squares.append(self._square_sum[0] / self._square_sum[1])
        self._square_sum = 0.0, 0
        drift = None
        for name, value in values.items():
            if not self._charts.get(name):
                self._learning_values[name].append(value)
            elif drift is None and (alarm_result := self._charts[name].add_value(value)) is not None:
                mean_shift, count = alarm_result
                drift = DetectedDrift(name, mean_shift, self._cycle_ends[-1 - count], tick)
        if not self._charts and len(self._cycle_ends) == LEARNING_CYCLES + 1:
            # The first cycle removes the effect of the unknown history, so it is not evaluated.
            assert self.min_drift is not None
            self._charts = {
                name: CusumChart(Reference.from_values(rows[1:]), self.min_drift, 2.0 * self.run_length)
                for name, rows in self._learning_values.items()
            }
        usual_residual = float(
            np.sqrt(np.mean(self._mean_squares[1 : LEARNING_CYCLES + 1] or self._mean_squares))
        )
        last_residual = float(np.sqrt(self._mean_squares[-1]))
        self.finding = Finding(len(self._cycle_ends), not self._charts, drift, usual_residual, last_residual)


@dataclass(frozen=True)
class WatchResult:
    """The result of monitoring a recording: shift in N, times in s after its start."""

    finding: Finding
    rate: float  # number of ticks per second in the finding

    def __str__(self) -> str:
        return self.finding.text(self.rate)

    def as_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        detected_drift = self.finding.drift
        return {
            "cycles": self.finding.cycles,
            "learning": self.finding.is_learning,
            "fits": detected_drift is None and not self.finding.is_learning,
            "drift": None if detected_drift is None else detected_drift.kind,
            "shift_N": None if detected_drift is None else detected_drift.shift,
            "since_s": None if detected_drift is None else detected_drift.begin_tick / self.rate,
            "text": str(self),
        }


def watch_recording(
    model: Model | PathLike,
    recording: LoopSource,
    reading: Mapping[str, Any],
    *,
    least: float | None,
    run_length: float,
) -> WatchResult:
    """Monitor a recording of one run: :func:`anhyst.watch`."""
    if least is not None and not least > 0.0:
        raise InputError(
            f"--least: {least:g} N is not above 0; correct it", code="not-above-zero", key="--least"
        )
    model = resolve_model(model, "watch")
    recording, _ = load_loops(recording, "watch: recording", reading, skipped_steps=DEFAULT_STEPS)
    if len(recording) != 1 or not is_actuator(recording):
        raise InputError(
            "a recording is one run with columns t_s, I_A, F_N and gap_m", code="columns-missing"
        )
    (run,) = recording.loops
    if run.time is None or run.schedule is None:
        raise InputError("a recording needs columns t_s and gap_m", code="columns-missing")
    monitor = DriftMonitor(model, float(run.schedule[0]), run.history, run_length=run_length, min_drift=least)
    ticks = np.arange(run.n, dtype=np.float64)
    finding = monitor.add_samples(ticks, run.input, run.schedule, run.output)
    return WatchResult(finding, (run.n - 1) / float(run.time[-1] - run.time[0]))
