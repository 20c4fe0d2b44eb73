"""Predicted against measured force, cycle by cycle: whether the model still fits.

What a model leaves of a force is not white: it goes with the path, and comes again in every cycle
of the current. So a cycle is reduced to two numbers: the mean of what is left over rise and fall
(the level: gain, saturation, a sensor), and half the difference between fall and rise (the width:
pinning). While the model is known to fit, the first cycles show what these two are and how they
scatter, correlation from cycle to cycle included; after that each runs through a chart of
cumulative sums.

A recording of one run, watched as if it were running.
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
"""Allowance of a chart in standard deviations, at least: it is best for twice that."""
_WALK_OVERSHOOT = 1.166
"""Of a random walk of normal steps over its threshold, to both ends (Siegmund 1985)."""
_SCATTER_QUANTILE = 0.05
"""Chance that the scatter is larger than it is taken to be, from the few values that are known."""
_MEAN_ERROR_FACTOR = 2.0
"""Standard errors by which the mean may be off."""
_MAX_CORRELATION = 0.9


def alarm_threshold(run_length: float, allowance: float = MIN_ALLOWANCE) -> float:
    """Return the threshold of a one-sided chart, in standard deviations.

    >>> round(threshold(465.0), 1)  # tables say 5 for a mean run of 465
    4.8
    """
    wanted = 2.0 * allowance * allowance * run_length
    passed = brentq(lambda x: math.expm1(x) - x - wanted, 1e-9, 700.0)
    return float(max(passed / (2.0 * allowance) - _WALK_OVERSHOOT, 0.0))


@dataclass(frozen=True, slots=True)
class Reference:
    """What a row of numbers is like while nothing is wrong."""

    mean: float
    # standard deviation of one value that would have the same effect on a sum if values were
    # independent, from above
    scatter: float
    mean_error: float  # by which the mean may be off

    @classmethod
    def from_values(cls, values: Sequence[float]) -> Reference:
        """Learn it from values, 4 or more.

        What stays from one value to the next makes a sum scatter more: by the root of
        ``(1 + r)/(1 - r)`` for a correlation r that dies out geometrically.
        """
        rows = np.asarray(values)
        count = rows.size
        away = rows - rows.mean()
        power = float(away @ away)
        if power == 0.0:
            return cls(float(rows.mean()), 0.0, 0.0)
        alike = float(away[1:] @ away[:-1]) / power + 1.0 / count  # a short row looks too little so
        alike = min(max(alike, 0.0), _MAX_CORRELATION)
        least = 2.0 * float(
            gammaincinv(0.5 * (count - 1), _SCATTER_QUANTILE)
        )  # quantile of chi-squared
        single = math.sqrt(power / least)
        scatter = single * math.sqrt((1.0 + alike) / (1.0 - alike))
        return cls(float(rows.mean()), scatter, _MEAN_ERROR_FACTOR * scatter / math.sqrt(count))


@dataclass(slots=True)
class CusumChart:
    """A two-sided cumulative sum."""

    reference: Reference
    min_shift: (
        float  # smallest shift worth an alarm, in the unit of the values; half of it is allowed
    )
    run_length: float  # mean number of values to a false alarm, of both sides together
    _sums: list[float] = field(default_factory=lambda: [0.0, 0.0])
    _counts: list[int] = field(default_factory=lambda: [0, 0])
    _shifts: list[float] = field(default_factory=lambda: [0.0, 0.0])

    @property
    def allowance(self) -> float:
        """By which a value must be off before it adds to a sum."""
        smallest = max(MIN_ALLOWANCE * self.reference.scatter, 0.5 * self.min_shift)
        return smallest + self.reference.mean_error

    @property
    def limit(self) -> float:
        """Sum from which on it is an alarm.

        A wider allowance than the smallest only makes false alarms rarer.
        """
        return alarm_threshold(2.0 * self.run_length) * self.reference.scatter

    def add(self, value: float) -> tuple[float, int] | None:
        """Take the next value."""
        away = value - self.reference.mean
        for side, sign in enumerate((1.0, -1.0)):
            self._sums[side] += sign * away - self.allowance
            if self._sums[side] <= 0.0:
                self._sums[side], self._counts[side], self._shifts[side] = 0.0, 0, 0.0
                continue
            self._counts[side] += 1
            self._shifts[side] += away
            if self._sums[side] > self.limit:
                return self._shifts[side] / self._counts[side], self._counts[side]
        return None


DriftKind = Literal["level", "width"]

LEARNING_CYCLES = 10
"""Cycles from which the reference is taken."""
DEFAULT_RUN_LENGTH = 1e5
"""Mean number of cycles to a false alarm."""
MIN_DRIFT_RATIO = 0.001
"""Smallest drift worth an alarm, in parts of the largest output of the model."""
REVERSAL_RATIO = 0.1
"""A cycle of the current reverses by more than this share of the model's range."""


@dataclass(frozen=True, slots=True)
class DetectedDrift:
    """A drift that was found."""

    kind: DriftKind  # ``"level"`` or ``"width"``
    shift: float  # of its mean against the first cycles, in units of the output (N)
    begin_tick: (
        int  # tick at which it began, as far as can be said: the end of the last cycle before
    )
    found_tick: int  # tick at which it was found


@dataclass(frozen=True, slots=True)
class Finding:
    """What is known of a model by now."""

    cycles: int  # complete ones
    is_learning: bool  # whether there are too few of them yet to say anything
    drift: DetectedDrift | None  # the first drift; None while the model fits
    # what the model left of the output while it was seen to fit, and leaves in the last cycle: rms,
    # in its unit, noise included. 0 before there is a cycle
    usual_residual: float = field(default=0.0, compare=False)
    residual: float = field(default=0.0, compare=False)

    @property
    def error_reduction(self) -> float:
        """By how much the error falls if the model is measured again, as far as can be said."""
        return max(0.0, self.residual - self.usual_residual)

    def text(self, rate: float) -> str:
        """Say it in a sentence; ticks are turned into seconds by `rate`, Hz."""
        if self.drift is not None:
            one = self.drift
            return (
                f"the {one.kind} has drifted by {one.shift:+.3g} N since {one.begin_tick / rate:.1f} s "
                f"(found at {one.found_tick / rate:.1f} s); the model leaves {self.residual:.3g} N rms instead "
                f"of {self.usual_residual:.3g} N, measure again"
            )
        if self.is_learning:
            return f"learning: {self.cycles} of {LEARNING_CYCLES} cycles of the current seen"
        return f"the model fits, over {count_text(self.cycles, 'cycle')}"


@dataclass(slots=True)
class _BranchSplitter:
    """Cuts a row of samples at the turning points of the current, whatever pieces it comes in."""

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

    def add(self, tick: int, current: float, residual: float) -> tuple[bool, float, int] | None:
        """Take a sample; return a branch that it completes: rising or not, mean, last tick."""
        self._total += residual
        self._count += 1
        if self._is_rising is None:
            # It may begin anywhere between the ends of a swing that is hardly wider than a turn.
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
        total, count = self._extreme_sum
        before = self._branch_start_sum
        done = None
        if before is not None and count > before[1]:
            mean = (total - before[0]) / (count - before[1])
            done = self._is_rising, mean, self._extreme_tick
        self._branch_start_sum, self._is_rising = self._extreme_sum, not self._is_rising
        self._mark_extreme(tick, current)
        return done

    def _mark_extreme(self, tick: int, current: float) -> None:
        self._extreme, self._extreme_tick, self._extreme_sum = (
            current,
            tick,
            (self._total, self._count),
        )


@dataclass(slots=True)
class DriftMonitor:
    """Watches one model, chunk by chunk; what comes out does not depend on how it is cut."""

    model: Model  # of force over current, and gap
    gap: float  # where the armature is at the beginning, m
    # Of the iron before the first sample; as the model says, if left out. What it gets wrong must
    # be wiped out by the first cycle.
    history: HistoryLike | None = None
    run_length: float = DEFAULT_RUN_LENGTH  # mean number of cycles of the current to a false alarm
    # smallest drift worth an alarm, N; a thousandth of the model's largest output if left out
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
        low, high = self.model.valid_range.input
        self._stepper = Stepper(self.model, self.gap, self.history)
        self._splitter = _BranchSplitter(REVERSAL_RATIO * (high - low))
        self._learning_values = {"level": [], "width": []}
        if self.min_drift is None:
            self.min_drift = MIN_DRIFT_RATIO * max(
                abs(end) for end in self.model.valid_range.output
            )

    def add_samples(
        self, ticks: FloatArray, current: FloatArray, gap: FloatArray, force: FloatArray
    ) -> Finding:
        """Go on by a chunk."""
        if ticks.size == 0 or self.finding.drift is not None:
            return self.finding
        if np.any(np.diff(ticks) <= 0) or (
            self._last_tick is not None and ticks[0] <= self._last_tick
        ):
            raise InputError(
                "ticks do not rise; give the chunks in their order", code="time-not-rising"
            )
        self._last_tick = int(ticks[-1])
        left = force - self._stepper.follow(current, gap)
        for tick, drive, rest in zip(ticks.tolist(), current.tolist(), left.tolist(), strict=True):
            self._square_sum = self._square_sum[0] + rest * rest, self._square_sum[1] + 1
            branch = self._splitter.add(int(tick), drive, rest)
            if branch is not None:
                self._add_branch(*branch)
            if self.finding.drift is not None:
                break
        return self.finding

    def _add_branch(self, rising: bool, mean: float, tick: int) -> None:
        if rising:
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
        drifted = None
        for name, value in values.items():
            if not self._charts.get(name):
                self._learning_values[name].append(value)
            elif drifted is None and (alarm := self._charts[name].add(value)) is not None:
                shift, count = alarm
                drifted = DetectedDrift(name, shift, self._cycle_ends[-1 - count], tick)
        if not self._charts and len(self._cycle_ends) == LEARNING_CYCLES + 1:
            # The first cycle wipes out what the model does not know of the past.
            assert self.min_drift is not None
            self._charts = {
                name: CusumChart(
                    Reference.from_values(rows[1:]), self.min_drift, 2.0 * self.run_length
                )
                for name, rows in self._learning_values.items()
            }
        usual = float(
            np.sqrt(np.mean(self._mean_squares[1 : LEARNING_CYCLES + 1] or self._mean_squares))
        )
        left = float(np.sqrt(self._mean_squares[-1]))
        self.finding = Finding(len(self._cycle_ends), not self._charts, drifted, usual, left)


@dataclass(frozen=True)
class WatchResult:
    """What a recording says about a model; the shift in N, times in s from its begin."""

    finding: Finding
    rate: float  # ticks a second, in which the finding counts

    def __str__(self) -> str:
        return self.finding.text(self.rate)

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        drifted = self.finding.drift
        return {
            "cycles": self.finding.cycles,
            "learning": self.finding.is_learning,
            "fits": drifted is None and not self.finding.is_learning,
            "drift": None if drifted is None else drifted.kind,
            "shift_N": None if drifted is None else drifted.shift,
            "since_s": None if drifted is None else drifted.begin_tick / self.rate,
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
    """Watch a recording of one run as if it were running: :func:`anhyst.watch`."""
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
    watched = DriftMonitor(
        model, float(run.schedule[0]), run.history, run_length=run_length, min_drift=least
    )
    ticks = np.arange(run.n, dtype=np.float64)
    found = watched.add_samples(ticks, run.input, run.schedule, run.output)
    return WatchResult(found, (run.n - 1) / float(run.time[-1] - run.time[0]))
