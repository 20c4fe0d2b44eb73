"""Cut records where samples are missing, because the history after the hole is unknown.

Extreme inputs of a record wipe out the history before them. Samples between a hole and the next
extreme input are left out. The next loop begins at that input with a known history.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from anhyst.data.loops import Loop, Loops, replace_columns
from anhyst.data.output_map import output_map
from anhyst.data.path import History, is_bipolar
from anhyst.support.numeric import FloatArray

_MIN_CLOCK_SAMPLES = 20
_SHORT_STEPS_SHARE = 0.98
"""Minimum fraction of short time steps in a record with holes; an irregular logger has fewer."""
_MAX_SHORT_STEP_RATIO = 2.5
_MIN_HOLE_STEPS = 8.0
"""Minimum length of a hole, in median time steps."""
_MAX_TIP_DISTANCE = 0.01
"""Maximum distance from an extreme input at which history is wiped out, as a fraction of the range.
"""
_MIN_LOOP_SAMPLES = 20


@dataclass(frozen=True, slots=True)
class Hole:
    """A time interval of a record without samples."""

    row: int  # last sample before the hole
    time_s: float  # time of the last sample before the hole, s
    duration_s: float  # duration of the hole, s

    def __str__(self) -> str:
        """Return the duration and the position as text."""
        return f"{self.duration_s:.3g} s are missing after sample {self.row + 1} (at {self.time_s:.6g} s)"


def find_holes(time: FloatArray | None) -> list[Hole]:
    """Find missing stretches of a clock whose other steps are almost even."""
    if time is None or time.size < _MIN_CLOCK_SAMPLES:
        return []
    steps = np.diff(time)
    step = float(np.median(steps))
    if step <= 0.0 or float(np.quantile(steps, _SHORT_STEPS_SHARE)) > _MAX_SHORT_STEP_RATIO * step:
        return []
    rows = np.flatnonzero(steps > _MIN_HOLE_STEPS * step).tolist()
    return [Hole(row, float(time[row]), float(steps[row]) - step) for row in rows]


def cut_holes(loopset: Loops) -> Loops:
    """Cut records at missing stretches; each later loop begins at an extreme input.

    Outputs with creep are not cut, because extreme inputs do not wipe out the creep.
    """
    if output_map(loopset.output).has_creep:
        return loopset
    for loop in loopset.loops:
        holes = find_holes(loop.time)
        # Input and output are unchanged after a pause of the drive.
        holes = [hole for hole in holes if not _is_pause(loop, hole.row)]
        cut_loops = _cut_loop(loop, holes) if holes else []
        if not cut_loops:
            continue
        kept_samples = sum(cut_loop.n for cut_loop in cut_loops)
        loops = [
            cut_loop
            for original_loop in loopset.loops
            for cut_loop in (cut_loops if original_loop is loop else [original_loop])
        ]
        more_text = f" and {len(holes) - 1} more" if len(holes) > 1 else ""
        loopset = loopset.with_loops(
            loops,
            f"holes: in loop '{loop.label}' {holes[0]}{more_text}; the history after it is unknown up to "
            f"the next extreme {loopset.input.name}: {loop.n - kept_samples} samples left out, "
            f"{len(cut_loops)} loops remain",
        )
    return loopset


def _is_pause(loop: Loop, row: int) -> bool:
    """Whether input and output after a hole continue from their values before it."""
    rows_around = slice(max(0, row - 3), row + 1), slice(row + 1, row + 5)
    for values in (loop.input, loop.output):
        values_before, values_after = values[rows_around[0]], values[rows_around[1]]
        step = float(np.quantile(np.abs(np.diff(values)), 0.9))
        if abs(float(values_after[0]) - float(values_before[-1])) > 2.0 * step:
            return False
    input_changes = [float(loop.input[rows][-1] - loop.input[rows][0]) for rows in rows_around]
    return input_changes[0] * input_changes[1] >= 0.0


def _cut_loop(loop: Loop, holes: list[Hole]) -> list[Loop]:
    """Return the parts of a record whose history is known."""
    stretch_bounds = [0, *(hole.row + 1 for hole in holes), loop.n]
    names = [loop.label, *(f"{loop.label} after {hole.time_s:.4g} s" for hole in holes)]
    cut_loops = []
    for label, (start, stop) in zip(names, itertools.pairwise(stretch_bounds), strict=True):
        known_row, history = start, loop.history
        if start > 0 or history.kind == "settled":
            known_start = _find_known_history(loop, start, stop)
            if known_start is None:
                continue
            known_row, history = known_start
        rows = slice(known_row, stop)
        if stop - known_row < _MIN_LOOP_SAMPLES or np.ptp(loop.input[rows]) == 0.0:
            continue
        new_loop = replace_columns(loop, itemgetter(rows), label=label, history=history)
        if new_loop.reverses:
            cut_loops.append(new_loop)
    return cut_loops


def _find_known_history(loop: Loop, start: int, stop: int) -> tuple[int, History] | None:
    """Return the first sample of a part whose history is known, and that history.

    The input of largest magnitude wipes out the entire history. The opposite extreme wipes out
    everything except the first extreme.
    """
    lowest_input, highest_input = float(loop.input.min()), float(loop.input.max())
    tips = (
        (lowest_input, highest_input)
        if abs(highest_input) >= abs(lowest_input)
        else (highest_input, lowest_input)
    )
    max_distance = _MAX_TIP_DISTANCE * (highest_input - lowest_input)
    was_largest = loop.history.kind == "settled" or bool(
        np.any(np.abs(loop.input[:start] - tips[1]) <= max_distance)
    )
    distance = np.abs(loop.input[start:stop] - tips[1])
    is_near, turning_points = distance <= max_distance, (0.0, *tips)
    if was_largest:
        other_distance = np.abs(loop.input[start:stop] - tips[0])
        if np.any(other_distance <= max_distance) and (
            not is_near.any() or np.argmax(other_distance <= max_distance) < np.argmax(is_near)
        ):
            distance, is_near, turning_points = (
                other_distance,
                other_distance <= max_distance,
                (0.0, *tips[::-1]),
            )
    if not is_near.any():
        return None
    first_near = int(np.argmax(is_near))
    rows_away = np.flatnonzero(~is_near[first_near:])
    last_near = first_near + int(rows_away[0]) if rows_away.size else is_near.size
    begin = start + first_near + int(np.argmin(distance[first_near:last_near]))
    extremes = turning_points if is_bipolar(loop.input) or turning_points[-1] == tips[0] else (0.0, tips[1])
    return begin, History("conditioned", (*extremes[:-1], float(loop.input[begin])))
