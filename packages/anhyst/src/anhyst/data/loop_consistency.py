"""Check that files without a stated gap contain loops at one gap only.

Minor loops, other speeds and repeated cycles lie within the branches of the largest loop. A loop at
another gap lies outside these branches at almost all inputs. If such a loop is found, an error asks
for the gap.
"""

from __future__ import annotations

from pathlib import PurePath

import numpy as np

from anhyst.data.loops import Loop, Loops
from anhyst.data.path import Branch, find_branches, find_crossings, find_repeats
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES

_LEVEL_SHARES = np.linspace(0.4, 0.95, 12)
"""Inputs at which two loops are compared, as fractions of the largest input of the smaller loop."""
_MIN_BRANCH_DISTANCE = 0.05
"""Minimum median distance between the branches of different loops, as a fraction of the output."""
_MIN_MIDDLE_DISTANCE = 0.08
"""Minimum distance of the centre lines of different loops with the same input range and speed."""
_MAX_END_DIFFERENCE = 0.03
_MAX_SPEED_RATIO = 1.5
_MAX_TIP_DIFFERENCE = 0.25
"""Maximum difference between the tip outputs of two cycles, as a fraction of the larger one."""
_TIP_SHARE = 0.97
_MIN_TIP_SHARE = 0.2
"""Minimum output at the tip of a cycle that is compared, as a fraction of the largest output."""
_CHECKED_OUTPUTS = ("force", "thrust", "flux_density", "flux_linkage")


def refuse_different_loops(loopset: Loops, *, has_blocks: bool = False) -> None:
    """Ask for the gap if loops of files or blocks without a gap differ more than by hysteresis."""
    files = {loop.source for loop in loopset.loops}
    loop_origins = {(loop.source, loop.label if has_blocks else "") for loop in loopset.loops}
    if loopset.schedule == QUANTITIES["gap"] or loopset.input.name == "field":
        return
    if loopset.output.name not in _CHECKED_OUTPUTS:
        return
    if loopset.schedule is None:
        _refuse_different_cycles(loopset)
    if len(loop_origins) < 2:
        return
    largest_loops: dict[float | None, Loop] = {}
    for loop in sorted(loopset.loops, key=lambda loop: -float(np.max(np.abs(loop.input)))):
        larger_loop = largest_loops.setdefault(loop.schedule_value, loop)
        if has_blocks and loop.source == larger_loop.source and _are_apart(loop, larger_loop):
            raise InputError(
                f"{loop.source}: blank lines, remarks or invalid rows separate {len(loop_origins)} "
                f"blocks, which contain different loops of the same quantities without a gap "
                f"('{larger_loop.label}' and '{loop.label}'); state the gaps in a column 'gap_mm', or by "
                "a line such as '# gap = 0.5 mm' above each block; if there is no gap: "
                "--schedule none",
                code="gap-missing",
                key="gap",
            )
        if loop.source != larger_loop.source and _are_apart(loop, larger_loop):
            names = " and ".join(PurePath(named_loop.source).name for named_loop in (larger_loop, loop))
            raise InputError(
                f"{loop.source}: the {len(files)} files contain different loops of the same "
                f"quantities without a gap ({names}); state the gap in the file names, such as "
                "'loop_gap_0.5mm.csv', in a column 'gap_mm', or in a file of the same name, .toml: "
                "constants = {gap_mm = 0.5}; if there is no gap: --schedule none",
                code="gap-missing",
                key="gap",
            )


def _refuse_different_cycles(loopset: Loops) -> None:
    """Ask for the gap if cycles of one record reach different outputs at the same input."""
    for loop in loopset.loops:
        for repeated_cycles in find_repeats(loop.input, find_branches(loop.input)):
            tip_outputs = [_tip_output(loop, branch) for branch in repeated_cycles]
            size = max(map(abs, tip_outputs))
            if size < _MIN_TIP_SHARE * float(np.max(np.abs(loop.output))):
                continue  # noise or ripple moves the tip of a small cycle
            if abs(tip_outputs[1] - tip_outputs[0]) > _MAX_TIP_DIFFERENCE * size:
                raise InputError(
                    f"{loop.source}: loop '{loop.label}' contains cycles that reach {tip_outputs[0]:.3g} and "
                    f"{tip_outputs[1]:.3g} {loopset.output.unit} at the same input, which no hysteresis "
                    "explains; state the gap of each in a column 'gap_mm', or number the loops in a "
                    "column 'loop'; if there is no gap: --schedule none",
                    code="gap-missing",
                    key="gap",
                )


def _tip_output(loop: Loop, branch: Branch) -> float:
    """Return the median output near the largest absolute input of a branch."""
    drive = loop.input[branch.rows]
    tip = drive[-1] if abs(drive[-1]) > 0.5 * abs(drive[0]) else drive[0]
    drive = drive * np.sign(tip)
    return float(np.median(loop.output[branch.rows][drive >= _TIP_SHARE * drive.max()]))


def _are_apart(loop: Loop, larger_loop: Loop) -> bool:
    """Whether two loops are apart at most levels, so that neither history nor speed explains it."""
    sign = 1.0 if float(loop.input.max()) >= -float(loop.input.min()) else -1.0
    distances, middle_distances = [], []
    for input_level in float((sign * loop.input).max()) * _LEVEL_SHARES:
        outputs_by_loop = [
            _outputs_at(compared_loop, sign, input_level) for compared_loop in (loop, larger_loop)
        ]
        if outputs_by_loop[0].size == 0 or outputs_by_loop[1].size == 0:
            continue
        (low, high), (other_low, other_high) = [
            (float(outputs.min()), float(outputs.max())) for outputs in outputs_by_loop
        ]
        size = max(abs(low), abs(high), abs(other_low), abs(other_high)) or 1.0
        distances.append(max(0.0, low - other_high, other_low - high) / size)
        middle_distances.append(abs(low + high - other_low - other_high) / (2.0 * size))
    if not distances:
        return False
    if float(np.median(distances)) > _MIN_BRANCH_DISTANCE:
        return True
    return _are_comparable(loop, larger_loop) and float(np.median(middle_distances)) > _MIN_MIDDLE_DISTANCE


def _are_comparable(loop: Loop, larger_loop: Loop) -> bool:
    """Whether two loops have the same input range and the same speed."""
    both_loops = (loop, larger_loop)
    input_ranges = [(float(record.input.min()), float(record.input.max())) for record in both_loops]
    input_span = input_ranges[1][1] - input_ranges[1][0]
    if (
        max(abs(input_ranges[0][0] - input_ranges[1][0]), abs(input_ranges[0][1] - input_ranges[1][1]))
        > _MAX_END_DIFFERENCE * input_span
    ):
        return False
    speeds = [
        float(np.sum(np.abs(np.diff(record.input)))) / float(record.time[-1] - record.time[0])
        for record in both_loops
        if record.time is not None
    ]
    return len(speeds) < 2 or max(speeds) <= _MAX_SPEED_RATIO * min(speeds)


def _outputs_at(loop: Loop, sign: float, input_level: float) -> FloatArray:
    """Return the outputs where the input crosses a level, in both directions."""
    drive = sign * loop.input
    return np.concatenate(
        [find_crossings(drive, loop.output, input_level, is_rising=is_rising) for is_rising in (True, False)]
    )
