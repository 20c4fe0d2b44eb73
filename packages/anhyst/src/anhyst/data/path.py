"""Find reversals, branches and invalid samples, and represent the history before a record.

Input changes below a threshold are ignored. `History` states the reversal points before the first
sample.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

MIN_REVERSAL_SHARE = 0.02
"""Minimum size of a reversal, as a fraction of the input range."""
MAX_MEASURED_VALUE = 1e50
"""Largest magnitude of a measured value in any unit; its squares and sums stay finite."""


def find_runs(mask: NDArray[np.bool_]) -> list[slice]:
    """Return the stretches of rows where a mask is true."""
    bounds = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return [slice(int(a), int(b)) for a, b in zip(bounds[::2], bounds[1::2], strict=True)]


def move_plays(drive: FloatArray, thresholds: FloatArray, start: FloatArray) -> FloatArray:
    """Return the states of play operators for several drives.

    ``drive`` has shape (drives, n), and the result has shape (n, drives, plays).
    """
    columns = drive.T[:, :, None]
    low, high = columns - thresholds, columns + thresholds
    states = np.empty_like(low)
    current = start
    for i, state in enumerate(states):
        current = np.minimum(np.maximum(current, low[i]), high[i], out=state)
    return states


def find_turning_points(values: FloatArray, threshold: float | None = None) -> NDArray[np.intp]:
    """Return the indices of the first sample, the reversals above a threshold and the last sample.

    The default threshold is `MIN_REVERSAL_SHARE` of the range.

    >>> find_turning_points(np.array([0.0, 1.0, 0.99, 2.0, 1.0, 0.0]), 0.1).tolist()
    [0, 3, 5]
    """
    threshold = MIN_REVERSAL_SHARE * float(np.ptp(values)) if threshold is None else threshold
    extreme_rows = _find_local_extremes(values)
    extreme_values = values[extreme_rows].tolist()
    reversals = [0]
    lowest_row = highest_row = direction = 0
    for index, extreme_value in enumerate(extreme_values):
        if direction <= 0 and extreme_value < extreme_values[lowest_row]:
            lowest_row = index
        if direction >= 0 and extreme_value > extreme_values[highest_row]:
            highest_row = index
        if direction <= 0 and extreme_value - extreme_values[lowest_row] > threshold:
            reversals.append(lowest_row)
            direction, highest_row = 1, index
        elif direction >= 0 and extreme_values[highest_row] - extreme_value > threshold:
            reversals.append(highest_row)
            direction, lowest_row = -1, index
    selected_rows = np.unique(np.array([*reversals, len(extreme_values) - 1], dtype=np.intp))
    return extreme_rows[selected_rows]


def reversal_count(values: FloatArray, threshold: float | None = None) -> int:
    """Return the number of reversals above a threshold, as in `find_turning_points`."""
    return max(0, find_turning_points(values, threshold).size - 2)


def find_crossings(
    values: FloatArray, other_values: FloatArray, level: float, *, is_rising: bool
) -> FloatArray:
    """Interpolate ``other_values`` where ``values`` crosses a level in one direction."""
    is_before = values < level if is_rising else values > level
    rows = np.flatnonzero(is_before[:-1] & ~is_before[1:])
    share = (level - values[rows]) / (values[rows + 1] - values[rows])
    return other_values[rows] + share * (other_values[rows + 1] - other_values[rows])


def are_measured(values: FloatArray) -> NDArray[np.bool_]:
    """Return a mask of samples that can be measured values: finite, at most `MAX_MEASURED_VALUE`."""
    return np.asarray(np.abs(values) <= MAX_MEASURED_VALUE)


_MIN_MARK_DISTANCE = 10.0
"""Minimum distance of a repeated overrange mark from the other values, relative to their range."""
_MIN_KNOWN_MARK_DISTANCE = 2.0
"""Minimum distance of a known overrange mark from the other values, relative to their range."""
_MAX_MARK_SHARE = 0.2
_MAX_PLAIN_NUMBER = 1e16
_MIN_OTHER_SAMPLES = 8
_KNOWN_MARK = re.compile(
    r"9{3,}|32767|32768|65535|65536|8388607|8388608|2147483647|2147483648|4294967295|3402823\d*"
    r"|10{6,}"
)
"""Digits of overrange marks: nines, the limits of integers of converters, the largest float."""


def find_overrange_mark(values: FloatArray, *, is_output: bool) -> float | None:
    """Return a value that is far outside all others and looks like an overrange mark.

    In an output, any repeated value of this kind is a mark. An input may consist of pulses, so only
    known marks count.
    """
    measured_values = values[are_measured(values)]
    if measured_values.size < 2 * _MIN_OTHER_SAMPLES:
        return None
    for mark in (float(measured_values.max()), float(measured_values.min())):
        is_mark = measured_values == mark
        count = int(np.count_nonzero(is_mark))
        other_values = measured_values[~is_mark]
        if other_values.size < _MIN_OTHER_SAMPLES or count > _MAX_MARK_SHARE * measured_values.size:
            continue
        value_range = float(np.ptp(other_values))
        distance = float(np.min(np.abs(other_values - mark)))
        is_known = _KNOWN_MARK.fullmatch(_significant_digits(mark)) is not None
        if value_range > 0.0 and (
            (is_output and count > 1 and distance > _MIN_MARK_DISTANCE * value_range)
            or (is_known and distance > _MIN_KNOWN_MARK_DISTANCE * value_range)
        ):
            return mark
    return None


def _significant_digits(value: float) -> str:
    """Return the digits of a number without sign, decimal point and leading zeros."""
    text = f"{abs(value):.7g}"
    if "e" in text:
        text = f"{abs(value):.0f}" if abs(value) < _MAX_PLAIN_NUMBER else text.partition("e")[0]
    return text.replace(".", "").lstrip("0")


def refuse_missing(
    locate_row: Callable[[int], str],
    columns: Sequence[tuple[str, FloatArray]],
    remedy: str = "remove the lines",
) -> None:
    """Raise an error for columns that contain a sample without a measured value.

    Every format returns overrange and invalid samples as NaN. ``columns`` are pairs of header and
    values.
    """
    missing_masks = [~are_measured(values) for _, values in columns]
    for (name, _), is_missing in zip(columns, missing_masks, strict=True):
        if is_missing.any():
            rows = np.logical_or.reduce(missing_masks)
            raise InputError(
                f"{locate_row(int(np.argmax(is_missing)))}, column '{name}': no measured value "
                f"(overrange, invalid or empty), as in {np.count_nonzero(rows)} of {rows.size} "
                f"samples; {remedy}",
                code="not-finite",
                key=name,
            )


def find_time_reversal(time: FloatArray) -> int | None:
    """Return the index of the first sample at which the time decreases, or ``None``."""
    backward_steps = np.flatnonzero(np.diff(time) < 0.0)
    return int(backward_steps[0]) + 1 if backward_steps.size else None


def _find_local_extremes(values: FloatArray) -> NDArray[np.intp]:
    """Return the indices of the ends and of every local extreme (the first of equal samples)."""
    moving_rows = np.flatnonzero(np.diff(values) != 0.0)
    if moving_rows.size == 0:
        return np.array([0] if values.size == 1 else [0, values.size - 1], dtype=np.intp)
    is_rising = values[moving_rows + 1] > values[moving_rows]
    inner_extremes = moving_rows[np.flatnonzero(is_rising[1:] != is_rising[:-1])] + 1
    return np.unique(np.concatenate(([0], inner_extremes, [values.size - 1]))).astype(np.intp)


_MAX_STEP_SHARE = 0.5
"""Maximum step of the output, as a fraction of its range, above which samples are added."""


def thin_rows(drive: FloatArray, max_samples: int, output: FloatArray | None = None) -> NDArray[np.intp]:
    """Return the rows of at most about ``max_samples`` samples, and of every reversal.

    The samples are evenly spaced along the travel of the drive. If the output has a step above
    `_MAX_STEP_SHARE`, samples are added until no step exceeds the mean step, at most twice as many
    in total.
    """
    if drive.size <= max_samples:
        return np.arange(drive.size)
    nearest_rows = _spread_evenly(_cumulative_travel(drive), max_samples)
    rows = np.union1d(nearest_rows, find_turning_points(drive))
    steps = np.zeros(1) if output is None else np.abs(np.diff(output[rows]))
    if output is None or steps.max() <= _MAX_STEP_SHARE * np.ptp(output):
        return rows
    step_parts, output_travel = np.ceil(steps / steps.mean()).astype(np.intp), _cumulative_travel(output)
    extra_rows = [
        rows[index] + _spread_evenly(output_travel[rows[index] : rows[index + 1] + 1], step_parts[index] + 1)
        for index in np.flatnonzero(step_parts > 1)
    ]
    return np.unique(np.concatenate([rows, *extra_rows]))


def _cumulative_travel(values: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values)))])


def _spread_evenly(travel: FloatArray, count: int) -> NDArray[np.intp]:
    """Return the indices of ``count`` samples, evenly spaced along a travel."""
    nearest_rows = np.searchsorted(travel, np.linspace(travel[0], travel[-1], count))
    return np.clip(nearest_rows, 0, travel.size - 1)


_MIN_BRANCH_SHARE = 0.05
"""Minimum size of an input reversal that separates branches, as a fraction of the range."""
_MAX_REPEAT_DISTANCE = 0.03
"""Maximum distance between the ends of repeated branches, as a fraction of the range."""


@dataclass(frozen=True, slots=True)
class Branch:
    """Samples ``start`` to ``stop`` (exclusive) of a loop, in which the input is monotonic."""

    start: int
    stop: int
    is_rising: bool

    @property
    def rows(self) -> slice:
        """The samples of the branch."""
        return slice(self.start, self.stop)

    @property
    def size(self) -> int:
        """Number of samples."""
        return self.stop - self.start


def find_branches(drive: FloatArray) -> list[Branch]:
    """Cut a record into branches at its reversals; two branches share each turning point."""
    min_size = _MIN_BRANCH_SHARE * float(np.ptp(drive))
    turning_points = find_turning_points(drive, min_size).tolist()
    # Wobble before the drive starts or after it has returned is not a branch.
    while len(turning_points) > 2 and abs(drive[turning_points[1]] - drive[0]) <= min_size:
        del turning_points[1]
    while len(turning_points) > 2 and abs(drive[turning_points[-2]] - drive[-1]) <= min_size:
        del turning_points[-2]
    return [Branch(a, b + 1, bool(drive[b] > drive[a])) for a, b in itertools.pairwise(turning_points)]


def find_repeats(drive: FloatArray, branches: list[Branch]) -> list[tuple[Branch, Branch]]:
    """Return pairs of branches, one cycle apart, with equal start inputs and equal end inputs."""
    max_distance = _MAX_REPEAT_DISTANCE * float(np.ptp(drive))
    return [
        (first_branch, second_branch)
        for first_branch, second_branch in zip(branches, branches[2:], strict=False)
        if abs(drive[first_branch.start] - drive[second_branch.start]) <= max_distance
        and abs(drive[first_branch.stop - 1] - drive[second_branch.stop - 1]) <= max_distance
    ]


def average_in_bins(drive: FloatArray, output: FloatArray, bins: int = 100) -> tuple[FloatArray, FloatArray]:
    """Return the means of input and output in equal bins of the input."""
    low, input_range = float(drive.min()), float(np.ptp(drive)) or 1.0
    count = min(bins, drive.size)
    bin_indices = np.minimum(((drive - low) / input_range * count).astype(np.intp), count - 1)
    sample_counts = np.bincount(bin_indices, minlength=count)
    is_filled = sample_counts > 0
    x = np.bincount(bin_indices, weights=drive, minlength=count)[is_filled] / sample_counts[is_filled]
    y = np.bincount(bin_indices, weights=output, minlength=count)[is_filled] / sample_counts[is_filled]
    return x, y


def smooth_curve(drive: FloatArray, output: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a binned curve through samples, extrapolated linearly to both ends."""
    x, y = average_in_bins(drive, output, 60)
    if x.size < 2:
        return x, y
    slopes = np.diff(y)[[0, -1]] / np.diff(x)[[0, -1]]
    end_inputs = np.array([drive.min(), drive.max()])
    end_outputs = y[[0, -1]] + slopes * (end_inputs - x[[0, -1]])
    return np.concatenate([end_inputs[:1], x, end_inputs[1:]]), np.concatenate(
        [end_outputs[:1], y, end_outputs[1:]]
    )


def branch_separation(
    drive: FloatArray, output: FloatArray, first_branch: Branch, second_branch: Branch
) -> tuple[FloatArray, FloatArray] | None:
    """Return an input grid and the output of the falling branch minus that of the rising branch.

    The difference is positive if the loop loses energy. ``None`` if no input occurs in both
    branches.
    """
    rising_output, falling_output = (
        (first_branch, second_branch) if first_branch.is_rising else (second_branch, first_branch)
    )
    x1, y1 = average_in_bins(drive[rising_output.rows], output[rising_output.rows])
    x2, y2 = average_in_bins(drive[falling_output.rows], output[falling_output.rows])
    low, high = max(x1[0], x2[0]), min(x1[-1], x2[-1])
    if high <= low:
        return None
    inputs = np.linspace(low, high, 101)
    return inputs, np.interp(inputs, x2, y2) - np.interp(inputs, x1, y1)


def is_bipolar(drive: FloatArray) -> bool:
    """Whether the input has both signs, each with above a tenth of the larger extreme."""
    low, high = float(drive.min()), float(drive.max())
    return low < 0.0 < high and min(-low, high) > 0.1 * max(-low, high)


def is_negative(drive: FloatArray) -> bool:
    """Whether the input is negative, except for an offset or noise around zero."""
    return not is_bipolar(drive) and float(drive.min()) < -abs(float(drive.max()))


def correlation(x: FloatArray, y: FloatArray) -> float:
    """Return the correlation coefficient of two signals; 0 if a signal is constant."""
    x_deviation, y_deviation = x - x.mean(), y - y.mean()
    scale = float(np.sqrt(np.sum(x_deviation * x_deviation) * np.sum(y_deviation * y_deviation)))
    return float(np.sum(x_deviation * y_deviation)) / scale if scale > 0.0 else 0.0


HistoryKind = Literal["demagnetised", "settled", "conditioned", "anhysteretic"]

_HISTORY_ADVICE = (
    "use demagnetised, settled or conditioned:0,2,0 (the drive's turning points in SI units; "
    "conditioned:0,2,0@0.0003;0,1 if the first were at 0.0003)"
)


@dataclass(frozen=True, slots=True)
class History:
    """The magnetic history before a loop.

    ``demagnetised``: no history. ``settled``: the loop is a cycle that was repeated many times, after the
    drive had gone through ``turning_points``, if any. ``conditioned``: the drive went from the
    demagnetised state through ``turning_points`` (SI units of the input), just before the first
    sample. ``anhysteretic``: the values are single-valued and belong to no history, as in a simulated
    table. ``schedule`` holds the scheduling variable at each turning point (SI units), or ``None``
    for the value of the loop. It is empty if all turning points were at that value.
    """

    kind: HistoryKind
    turning_points: tuple[float, ...] = ()
    schedule: tuple[float | None, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in get_args(HistoryKind):
            raise InputError(
                f"history '{self.kind}' is not known; {_HISTORY_ADVICE}",
                code="unknown-history",
                key="history",
            )
        has_points = bool(self.turning_points)
        wrong_by_kind = {
            "conditioned": not has_points,
            "demagnetised": has_points,
            "anhysteretic": has_points,
        }
        if wrong_by_kind.get(self.kind, False):
            raise InputError(
                f"history '{self.kind}' with the wrong turning points; {_HISTORY_ADVICE}",
                code="history-turning-points",
                key="history",
            )
        if self.schedule and len(self.schedule) != len(self.turning_points):
            raise InputError(
                f"history '{self.kind}': {len(self.turning_points)} turning points and "
                f"{len(self.schedule)} scheduling values; give one for each",
                code="history-schedule",
                key="history",
            )
        values = [*self.turning_points, *(value for value in self.schedule if value is not None)]
        if not all(math.isfinite(value) for value in values):
            raise InputError(
                f"history '{self}': turning points must be finite; {_HISTORY_ADVICE}",
                code="history-turning-points",
                key="history",
            )
        if all(value is None for value in self.schedule):
            object.__setattr__(self, "schedule", ())

    @classmethod
    def of(cls, value: HistoryLike) -> History:
        """Return a history from any form that the functions of the package accept.

        A sequence of numbers lists the turning points before the first sample.

        >>> str(History.of([0, 2, 0]))
        'conditioned:0.0,2.0,0.0'
        """
        if isinstance(value, History):
            return value
        if isinstance(value, str):
            return cls.parse(value)
        try:
            points = tuple(float(point) for point in value)
        except (TypeError, ValueError):
            raise InputError(
                f"history: must be a text or a list of turning points, such as [0, 2, 0], not {value!r:.60}",
                code="wrong-type",
                key="history",
            ) from None
        return cls("conditioned", points)

    @classmethod
    def parse(cls, text: str) -> History:
        """Return a history from its text form, such as ``settled`` or ``conditioned:0,2,0``.

        >>> str(History.parse("conditioned: 0, 2, 0"))
        'conditioned:0.0,2.0,0.0'
        >>> History.parse("settled:0,3,0@0.0003;0,2,0").schedule
        (0.0003, 0.0003, 0.0003, None, None, None)
        """
        kind, colon, points_text = text.strip().partition(":")
        kind = kind.strip().lower().replace("demagnetized", "demagnetised")
        if kind not in get_args(HistoryKind):
            raise InputError(
                f"history '{text}' is not known; {_HISTORY_ADVICE}", code="unknown-history", key="history"
            )
        points: list[float] = []
        schedule: list[float | None] = []
        try:
            for points_part in points_text.split(";") if colon else ():
                reversals_text, at_sign, value = points_part.partition("@")
                points += [float(point) for point in reversals_text.split(",")]
                schedule_value = float(value) if at_sign else None
                schedule += [schedule_value] * (len(points) - len(schedule))
        except ValueError:
            raise InputError(
                f"history '{text}': turning points are not numbers; {_HISTORY_ADVICE}",
                code="history-turning-points",
                key="history",
            ) from None
        return cls(cast("HistoryKind", kind), tuple(points), tuple(schedule))

    def schedule_at_points(self, loop_value: float | None) -> tuple[float | None, ...]:
        """Return the scheduling variable at each turning point, given the value of the loop."""
        schedule = self.schedule or (None,) * len(self.turning_points)
        return tuple(loop_value if value is None else value for value in schedule)

    def __str__(self) -> str:
        """Return the text form with full precision, which `parse` accepts."""
        if not self.turning_points:
            return self.kind
        points_and_schedule = zip(self.turning_points, self.schedule_at_points(None), strict=True)
        texts = []
        for value, points_part in groupby(points_and_schedule, key=lambda pair: pair[1]):
            points = ",".join(repr(float(point)) for point, _ in points_part)
            texts.append(points if value is None else f"{points}@{float(value)!r}")
        return f"{self.kind}:{';'.join(texts)}"


HistoryLike = History | str | Sequence[float] | FloatArray
"""A history, its text form, or its turning points."""


def history_text(history: HistoryLike) -> str:
    """Return the text form of a history; a text is returned unchanged."""
    return history if isinstance(history, str) else str(History.of(history))


SETTLED = History("settled")
DEMAGNETISED = History("demagnetised")
ANHYSTERETIC = History("anhysteretic")
