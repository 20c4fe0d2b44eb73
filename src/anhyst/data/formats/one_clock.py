"""Channels that ran on clocks of their own, brought onto one; refused where that cannot be right."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from anhyst.data.formats.channels import Channel, Values
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

_LONGEST_GAP = 10.0
"""Usual steps of a clock; across a longer pause nothing is known of the channel."""


@dataclass(frozen=True, eq=False)
class Clock:
    """A clock and its times."""

    channel: Channel | None
    length: int
    times: FloatArray | None  # s, shape (length,); None where a file does not say them
    start: int = 0  # first of the channel's samples that ``times`` holds
    whole: bool = True  # whether it holds all of them


def shared_clock(
    place: str, channels: Sequence[Channel], seconds: Callable[[Channel], FloatArray]
) -> tuple[Clock, tuple[str, ...]]:
    """Find the clock that channels are read on: the finest, as far as all of them reach."""
    clocks = list(dict.fromkeys(channel.clock for channel in channels if channel.clock is not None))
    free = [channel for channel in channels if channel.clock is None and channel.length != 1]
    by_length = {channel.length: channel for channel in (*free, *clocks[:1])}
    if len(by_length) > 1 or (free and len(clocks) > 1):
        one, other = list(by_length.values())[:2] if len(by_length) > 1 else (free[0], clocks[1])
        raise InputError(
            f"{place}: channels '{one.full_name}' ({one.length} samples) and '{other.full_name}' "
            f"({other.length}) have no common clock; leave one out, or export them with their times",
            code="no-common-clock",
            key=one.full_name,
        )
    if not clocks:
        return Clock(None, max(by_length, default=1), None), ()
    times = [seconds(clock) for clock in clocks]
    if all(np.array_equal(times[0], other) for other in times[1:]):
        return Clock(clocks[0], clocks[0].length, times[0]), ()
    steps = [_step(place, clock, ticks) for clock, ticks in zip(clocks, times, strict=True)]
    finest = int(np.argmin(steps))
    begin, end = max(ticks[0] for ticks in times), min(ticks[-1] for ticks in times)
    start, stop = np.searchsorted(times[finest], [begin, np.nextafter(end, np.inf)])
    first = [next(c.full_name for c in channels if c.clock is clock) for clock in clocks]
    if stop - start < 2:
        late = first[[ticks[0] for ticks in times].index(begin)]
        early = first[[ticks[-1] for ticks in times].index(end)]
        raise InputError(
            f"{place}: channel '{early}' ends at {end:g} s and '{late}' begins at {begin:g} s: "
            "nothing was recorded together; leave one out",
            code="no-common-time",
            key=late,
        )
    clock = Clock(clocks[finest], int(stop - start), times[finest][start:stop], int(start), False)
    names = ", ".join(c.full_name for c in channels if c.clock not in {None, clock.channel})
    note = f"{names}: interpolated linearly onto the times of {first[finest]}"
    dropped = times[finest].size - clock.length
    outside = f", {dropped} of whose samples lie outside {begin:g} to {end:g} s and are left out"
    return clock, (note + (outside if dropped else ""),)


def _step(place: str, clock: Channel, times: FloatArray) -> float:
    """Usual step of a clock that others are compared with."""
    if times.size < 2:
        raise InputError(
            f"{place}: '{clock.full_name}' holds one time only, too few to bring others onto it; "
            "leave its channels out",
            code="clock-too-short",
            key=clock.full_name,
        )
    odd = ~np.isfinite(times)
    odd[1:] |= ~(np.diff(times) >= 0.0)
    if odd.any():
        row = int(np.argmax(odd))
        raise InputError(
            f"{place}: time '{clock.full_name}' is {times[row]:g} s in sample {row + 1}, not later "
            "than before; channels on several clocks need rising times",
            code="time-not-rising",
            key=clock.full_name,
        )
    return float(np.median(np.diff(times))) or float(np.mean(np.diff(times)))


def onto(place: str, channel: Channel, own: Clock, values: FloatArray, clock: Clock) -> FloatArray:
    """Bring a channel onto a clock."""
    stop = clock.start + clock.length
    if own.times is None or clock.times is None or own.channel is clock.channel:
        return values[clock.start : stop]
    if clock.whole:  # clocks of the same times
        return values
    steps = np.diff(own.times)
    inside = (own.times[1:] > clock.times[0]) & (own.times[:-1] < clock.times[-1])
    usual = float(np.median(steps))
    long = inside & (steps > _LONGEST_GAP * usual)
    if long.any():
        row = int(np.argmax(long))
        raise InputError(
            f"{place}: channel '{channel.full_name}' has no sample from {own.times[row]:g} to "
            f"{own.times[row + 1]:g} s, {steps[row] / usual:.0f} of its usual steps: it cannot be "
            "interpolated; leave it out, or give it as a constant",
            code="gap-in-channel",
            key=channel.full_name,
        )
    used = np.concatenate(([False], inside)) | np.concatenate((inside, [False]))
    odd = used & ~np.isfinite(values)
    if odd.any():
        row = int(np.argmax(odd))
        raise InputError(
            f"{place}: channel '{channel.full_name}', sample {row + 1}: {values[row]:g} is no "
            "measured value; remove it",
            code="not-finite",
            key=channel.full_name,
        )
    return np.interp(clock.times, own.times, values)


def held(own: Clock, values: Values, clock: Clock) -> Values:
    """Hold the last value of a channel at each time; what fits no clock is blank."""
    if own.channel is clock.channel or (own.length == clock.length and clock.whole):
        return values[clock.start : clock.start + clock.length]
    if own.length == 1:
        return np.repeat(values, clock.length)
    if own.times is None or clock.times is None or not np.all(np.diff(own.times) >= 0.0):
        return np.full(clock.length, "")
    last = np.searchsorted(own.times, clock.times, side="right") - 1
    return np.asarray(values[np.maximum(last, 0)])
