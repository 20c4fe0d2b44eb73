"""Group loops by speed, and find out whether fast loops differ from slow loops."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from anhyst.data.estimates import estimate_noise
from anhyst.data.loops import Loop, Loops, is_even
from anhyst.data.path import reversal_count
from anhyst.data.verdict import largest_output, loop_width_and_height
from anhyst.support.numeric import FloatArray

MIN_SPEED_RATIO = 3.0
"""Minimum speed ratio of fast and slow loops of a gap.

Both the cycles per second and the input change per second must have this ratio. A loop of smaller
amplitude can differ in one of these values, but not in both.
"""
GAP_TOLERANCE = 5e-3
"""Largest relative difference of scheduling values that count as equal."""
MIN_HEIGHT_INCREASE = 0.01
"""Minimum increase of the loop height that is a rate effect, relative to the largest output."""

_MIN_HEIGHT_SIGMAS = 4.0
"""Number of standard deviations of the noise that a height difference must exceed."""

MAX_RATE_RATIO = 1.5
"""Ratio of the input rate of a run to the fastest fitted input rate above which a run is flagged."""
MIN_TRAVEL_SHARE = 0.1
"""Smallest change of the input that has a rate, as a fraction of the input range of the model."""
_HELD_SHARE = 0.01
"""Largest distance from its first value of an input that is held, as a fraction of the input range."""
_MIN_TRAVEL_SIGMAS = 6.0
_MAX_NOISE_TRAVEL_SHARE = 0.3
"""The smallest change is increased by this number of standard deviations of the noise of a
difference, at most by this fraction of the input range."""


def cycle_rate(drive: FloatArray, time: FloatArray | None) -> float:
    """Return the rate of the cycles in a record, Hz; 0 without time or reversals."""
    if time is None or time[-1] <= time[0]:
        return 0.0
    reversals = reversal_count(drive)
    return (reversals + 1) / (2.0 * float(time[-1] - time[0])) if reversals else 0.0


def fastest_input_rate(drive: FloatArray, time: FloatArray | None, input_range: float) -> float:
    """Return the fastest rate of an input, units of the input per s; 0 if it is unknown."""
    return find_fast_samples(drive, time, input_range, math.inf)[0]


def find_fast_samples(
    drive: FloatArray, time: FloatArray | None, input_range: float, max_rate: float
) -> tuple[float, NDArray[np.bool_]]:
    """Return the fastest rate of an input, and which samples are faster than a rate.

    The rate is the slope between the means of two adjacent blocks of 1, 2, 4, ... samples. It counts
    if the means differ by `MIN_TRAVEL_SHARE` of the input range of the model. A held input counts
    as one sample in the middle of its time, so a step between held values is as slow as the
    sequence of values.
    """
    is_fast, fastest = np.zeros(drive.size + 1, dtype=np.intp), 0.0
    if time is None or not _is_clock(time) or input_range <= 0.0:
        return 0.0, is_fast[:-1] > 0
    time = _spread_times(time - time[0])
    starts = _find_held_starts(drive, _HELD_SHARE * input_range)
    counts = np.diff(starts, append=drive.size)
    sums = [np.cumsum(np.append(0.0, np.add.reduceat(row, starts) / counts)) for row in (drive, time)]
    noise_travel = _MIN_TRAVEL_SIGMAS * math.sqrt(2.0) * estimate_noise(drive) / input_range
    block = 1
    while 2 * block <= starts.size:
        drive_means, time_means = ((row[block:] - row[:-block]) / block for row in sums)
        travel = np.abs(drive_means[block:] - drive_means[:-block])
        seconds = time_means[block:] - time_means[:-block]
        share = MIN_TRAVEL_SHARE + min(noise_travel / math.sqrt(block), _MAX_NOISE_TRAVEL_SHARE)
        rates = np.where(travel >= share * input_range, travel, 0.0) / np.maximum(seconds, 1e-300)
        fastest = max(fastest, float(rates.max()))
        # A block of equal steps begins half the distance of the means before its mean.
        is_over = rates > max_rate
        begin = (time_means[:-block] - 0.5 * seconds)[is_over]
        np.add.at(is_fast, np.searchsorted(time, begin), 1)
        np.add.at(is_fast, np.searchsorted(time, begin + 2.0 * seconds[is_over], "right"), -1)
        block *= 2
    return fastest, np.cumsum(is_fast)[:-1] > 0


def _is_clock(time: FloatArray) -> bool:
    """Whether times are finite, never decrease, and increase at least once."""
    return bool(np.all(np.diff(time) >= 0.0) and time[0] < time[-1] < math.inf)


def _find_held_starts(drive: FloatArray, band: float) -> NDArray[np.intp]:
    """Return the first sample of each stretch in which the input stays within a band."""

    def follow(state: float, value: float) -> float:
        return min(max(state, value - band), value + band)

    followed = np.fromiter(accumulate(drive.tolist(), follow), np.float64, drive.size)
    return np.flatnonzero(np.diff(followed, prepend=np.nan) != 0.0)


@dataclass(frozen=True, eq=False)
class SpeedGroups:
    """Loops grouped by their rate."""

    slow: Loops  # slowest loops of each gap, and all loops that are not clearly faster
    fast: tuple[tuple[Loop, ...], ...]  # other loops in groups of similar rate, slowest first

    @property
    def fastest_rate(self) -> float:
        """Rate of the fastest loops, Hz."""
        return max(cycle_rate(loop.input, loop.time) for loop in self.fast[-1])


def group_by_speed(loops: Loops) -> SpeedGroups | None:
    """Separate slow loops from fast ones; ``None`` if their speeds are similar or unknown."""
    fast_flags = list(map(bool, find_slower_loops(loops.loops)))
    if not any(fast_flags):
        return None
    groups: list[list[Loop]] = []
    fast_loops = (loop for loop, is_fast in zip(loops.loops, fast_flags, strict=True) if is_fast)
    for loop in sorted(fast_loops, key=lambda member: _loop_speed(member)[0]):
        if groups and _loop_speed(loop)[0] < MIN_SPEED_RATIO * _loop_speed(groups[-1][0])[0]:
            groups[-1].append(loop)
        else:
            groups.append([loop])
    slow_loops = (loop for loop, is_fast in zip(loops.loops, fast_flags, strict=True) if not is_fast)
    return SpeedGroups(loops.with_loops(slow_loops), tuple(map(tuple, groups)))


def find_slower_loops(loops: Sequence[Loop]) -> list[list[int]]:
    """Return, for each loop, the indices of the loops at its gap that are clearly slower."""
    if any(loop.time is None for loop in loops):
        return [[] for _ in loops]
    loop_speeds = list(map(_loop_speed, loops))
    return [
        [
            loop_index
            for loop_index, (other_loop, other_speed) in enumerate(zip(loops, loop_speeds, strict=True))
            if _is_same_gap(other_loop, loop)
            and min(loop_speed[0] / other_speed[0], loop_speed[1] / other_speed[1]) >= MIN_SPEED_RATIO
        ]
        for loop, loop_speed in zip(loops, loop_speeds, strict=True)
    ]


def _is_same_gap(loop: Loop, other_loop: Loop) -> bool:
    """Return whether two loops have the same scheduling value, apart from the error of its sensor."""
    values = loop.schedule_value, other_loop.schedule_value
    if values[0] is None or values[1] is None:
        return values[0] is values[1]
    return abs(values[0] - values[1]) <= GAP_TOLERANCE * abs(values[0])


def explain_no_rate(loops: Loops) -> str:
    """Return why loops of several speeds have no fast and slow loop to compare; empty otherwise."""
    with_times = [loop for loop in loops.loops if loop.time is not None]
    if with_times and len(with_times) < len(loops):
        return (
            f"{len(loops) - len(with_times)} of {len(loops)} loops have no times: the rate dependence was "
            "not fitted; add a column t_s to all of them"
        )
    speeds = np.array([_loop_speed(loop) for loop in with_times])
    if not with_times or np.min(speeds.max(axis=0) / speeds.min(axis=0)) < MIN_SPEED_RATIO:
        return ""
    name = "gap" if loops.schedule is None else loops.schedule.name
    return (
        f"the loops have several speeds, but no {name} has a slow and a fast loop of a similar size: the "
        f"rate dependence was not fitted; measure both at one {name}"
    )


def select_slow_loops(loops: Loops) -> Loops:
    """Return the slow loops, with negligible eddy currents; all loops if speeds are similar."""
    speeds = group_by_speed(loops)
    return loops if speeds is None else speeds.slow


def _loop_speed(loop: Loop) -> tuple[float, float]:
    """Return the rate of a loop, Hz, and the change of its input per second."""
    assert loop.time is not None
    seconds = float(loop.time[-1] - loop.time[0])
    return cycle_rate(loop.input, loop.time) or 0.5 / seconds, float(
        np.sum(np.abs(np.diff(loop.input))) / seconds
    )


def spread_equal_times(loops: Loops) -> Loops:
    """Distribute samples with equal times evenly up to the next time, for coarse clocks."""
    if not any(loop.time is not None and np.any(np.diff(loop.time) == 0.0) for loop in loops.loops):
        return loops
    changed_loops = [
        loop if loop.time is None else replace(loop, time=_spread_times(loop.time)) for loop in loops.loops
    ]
    return loops.with_loops(changed_loops, "samples with equal times are distributed up to the next time")


def _spread_times(time: FloatArray) -> FloatArray:
    """Return times that increase evenly from the first sample of each stamp to the next stamp."""
    stamp_rows = np.flatnonzero(np.diff(time, prepend=-np.inf))
    step = (time[stamp_rows[-1]] - time[stamp_rows[-2]]) / (stamp_rows[-1] - stamp_rows[-2])
    end_time = time[-1] + step * (time.size - stamp_rows[-1])
    bounds = np.append(stamp_rows, time.size)
    new_times: FloatArray = np.interp(np.arange(time.size), bounds, np.append(time[stamp_rows], end_time))
    return new_times


def describe_rate(loops: Loops) -> str:
    """Return a sentence on the rate above which loops change; empty if speeds are similar."""
    speeds = group_by_speed(loops)
    if speeds is None:
        return ""
    rate_effect = find_rate_effect(loops, speeds)
    if rate_effect is None:
        return (
            f"rate does not matter up to {speeds.fastest_rate:.3g} Hz: fast loops are as high as slow "
            "ones, to 1 % of the largest output"
        )
    rate, share = rate_effect
    return (
        f"rate matters: at {rate:.3g} Hz loops are higher than slow ones by {100.0 * share:.2g} % of "
        f"the largest output; extrapolated linearly, by 1 % from {rate * MIN_HEIGHT_INCREASE / share:.2g} Hz on"
    )


def find_rate_effect(loops: Loops, speeds: SpeedGroups) -> tuple[float, float] | None:
    """Return the lowest rate with an effect, Hz, and the effect relative to the largest output."""
    is_even_output, largest_magnitude = is_even(loops), largest_output(loops)
    slow_height: dict[float | None, float] = {}
    for loop in speeds.slow.loops:
        _, height = loop_width_and_height(loop, is_even=is_even_output)
        slow_height[loop.schedule_value] = max(height, slow_height.get(loop.schedule_value, 0.0))
    for group in speeds.fast:
        rate = max(cycle_rate(loop.input, loop.time) for loop in group)
        height_increases = [
            (
                loop_width_and_height(loop, is_even=is_even_output)[1] - slow_height[loop.schedule_value],
                estimate_noise(loop.output),
            )
            for loop in group
        ]
        largest_increase, noise_sigma = max(height_increases)
        share = largest_increase / largest_magnitude
        if share >= MIN_HEIGHT_INCREASE and largest_increase > _MIN_HEIGHT_SIGMAS * noise_sigma:
            return rate, share
    return None
