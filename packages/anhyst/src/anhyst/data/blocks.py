"""Split a table at blank lines, comments or invalid rows into loops, and read gaps from comments.

Blocks of rows are separate loops if the input reverses in each, and either all blocks close or each
begins with a jump. Otherwise, all rows are one record. A comment above a block may state its gap,
such as `# gap = 0.5 mm`.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from anhyst.data.formats.channels import Texts, parse_number
from anhyst.data.joining import SourceLoops
from anhyst.data.path import reversal_count
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES, find_unit, parse_header

Breaks = Sequence[tuple[int, tuple[str, ...]]]
"""First row of each block, and the comments above it."""

_MIN_BLOCK_ROWS = 6
_MAX_CLOSURE_SHARE = 0.05
"""Maximum distance between start and end of a closed loop, as a fraction of its input range."""
_MIN_JUMP_STEPS = 5.0
"""Minimum jump of the input between two blocks, relative to the largest step before it."""
_STATED_VALUE = re.compile(
    r"(?P<name>[^\W\d_][\w -]*?)\s*(?:[\[(](?P<inner>[^\])]{1,10})[\])])?\s*(?:[=:;,]|\s|\bis\b)+"
    r"(?P<number>\d+(?:[.,]\d+)?)[\s;,]*[\[(]?(?P<unit>[^\W\d]+)?"
)


@dataclass(frozen=True, slots=True)
class Blocks:
    """The label of each row, and the gap of each row in m if comments state it (otherwise None)."""

    labels: Texts
    gaps: FloatArray | None
    note: str


def find_stated_gap(texts: Sequence[str]) -> tuple[float | None, str] | None:
    """Return the gap that the last of several comments states, m, and this comment.

    The gap is None if the comment does not state a unit of length.
    """
    last_gap = None
    for text in texts:
        for match in _STATED_VALUE.finditer(text):
            if parse_header(match["name"], "mm").quantity != QUANTITIES["gap"]:
                continue
            unit_text = match["inner"] or match["unit"] or ""
            name_unit = parse_header(match["name"]).unit
            unit = find_unit(unit_text) or name_unit
            if unit is not None and unit.dimension != "length":
                continue
            number = parse_number(match["number"])
            last_gap = (unit.value_to_si(number) if unit else None), text.strip()
    return last_gap


def find_blocks(
    source: str, breaks: Breaks, drive: FloatArray, *, has_gaps: bool, name: str
) -> Blocks | None:
    """Find blocks that are separate loops; return None if all rows are one record.

    ``has_gaps`` states whether gaps in comments are used. ``name`` is the beginning of each label.
    """
    starts = [row for row, _ in breaks]
    stated_gaps = [find_stated_gap(texts) if has_gaps else None for _, texts in breaks]
    later_gaps = [stated_gap for stated_gap in stated_gaps[1:] if stated_gap is not None]
    if len(starts) < 2:
        return None
    block_inputs = np.split(drive, starts[1:])
    _refuse_rows_below_data(source, block_inputs)
    are_loops = _are_loops(block_inputs)
    if not later_gaps:
        return _label_blocks(starts, drive.size, name, None) if are_loops else None
    gaps, current_gap = [], None
    for stated_gap in stated_gaps:
        current_gap = stated_gap if stated_gap is not None else current_gap
        if current_gap is None or current_gap[0] is None:
            advice_place = (
                "above the first rows" if current_gap is None else f"with its unit ('{current_gap[1]}')"
            )
            raise InputError(
                f"{source}: comments between the rows state gaps; state the gap {advice_place} too, such "
                "as '# gap = 0.5 mm', or add a column 'gap_mm'",
                code="gap-missing",
                key="gap",
            )
        gaps.append(current_gap[0])
    if not are_loops:
        gap_changes = [n for n in range(len(starts)) if n == 0 or gaps[n] != gaps[n - 1]]
        starts, gaps = [starts[n] for n in gap_changes], [gaps[n] for n in gap_changes]
    return _label_blocks(starts, drive.size, name, gaps)


def _label_blocks(starts: Sequence[int], rows: int, name: str, gaps: Sequence[float] | None) -> Blocks:
    """Label each row with the name and the number of its block, counted separately for each gap."""
    block_sizes = np.diff([*starts, rows])
    count_by_gap = Counter[float | None]()
    block_names = []
    block_gaps: Sequence[float | None] = gaps or [None] * len(starts)
    for gap in block_gaps:
        count_by_gap[gap] += 1
        block_names.append(f"{name} {count_by_gap[gap]}".strip())
    block_labels = Texts.from_rows(block_names)
    labels = Texts(block_labels.values, np.repeat(block_labels.codes, block_sizes))
    note = f"{len(starts)} blocks of rows are separate loops"
    if gaps is None:
        return Blocks(labels, None, note)
    texts = ", ".join(dict.fromkeys(f"{1e3 * gap:.4g} mm" for gap in gaps))
    note += f", with the gaps in the comments above them: {texts}"
    return Blocks(labels, np.repeat(np.array(gaps), block_sizes), note)


def _are_loops(blocks: Sequence[FloatArray]) -> bool:
    """Whether the input reverses in each block, and all blocks close or all begin with a jump."""
    if any(block.size < _MIN_BLOCK_ROWS or np.ptp(block) == 0.0 for block in blocks):
        return False
    if not all(map(reversal_count, blocks)):
        return False
    are_closed = all(abs(block[-1] - block[0]) <= _MAX_CLOSURE_SHARE * np.ptp(block) for block in blocks)
    neighbouring_blocks = pairwise(blocks)
    return are_closed or all(_has_jump_between(first, second) for first, second in neighbouring_blocks)


def _has_jump_between(block: FloatArray, next_block: FloatArray) -> bool:
    """Whether the input jumps from the end of a block to the start of the next block."""
    largest_step = float(np.max(np.abs(np.diff(block)))) if block.size > 1 else 0.0
    return bool(abs(next_block[0] - block[-1]) > _MIN_JUMP_STEPS * largest_step)


def _refuse_rows_below_data(source: str, block_inputs: Sequence[FloatArray]) -> None:
    """Raise an error if the last rows do not continue the samples, such as a row of means."""
    last_block, rows_above = block_inputs[-1], np.concatenate(block_inputs[:-1])
    if (
        last_block.size < _MIN_BLOCK_ROWS
        and rows_above.size >= 2 * _MIN_BLOCK_ROWS
        and _has_jump_between(rows_above, last_block)
    ):
        raise InputError(
            f"{source}: the last {last_block.size} row{'s' if last_block.size > 1 else ''} below a blank line "
            "or a comment do not continue the samples above; if they are statistics, remove them, "
            "otherwise remove the blank line",
            code="rows-below-data",
        )


def apply_stated_gaps(sources: list[SourceLoops]) -> list[SourceLoops]:
    """Use the gaps in the headers of several files if each states a gap and the gaps differ."""
    gaps = {source.source_name: source.stated_gap[0] for source in sources if source.stated_gap is not None}
    known_gaps = {name: gap for name, gap in gaps.items() if gap is not None}
    if len(known_gaps) == len(sources) and len(set(known_gaps.values())) > 1:
        return [_set_gap(source, known_gaps[source.source_name]) for source in sources]
    return [_add_gap_advice(source) for source in sources]


def _set_gap(source: SourceLoops, gap: float) -> SourceLoops:
    """Set the gap of all loops of a file to the gap in its header."""
    is_alone = len(source.loops) == 1
    loops = tuple(
        replace(loop, label="1" if is_alone else loop.label, schedule=np.full(loop.n, gap))
        for loop in source.loops
    )
    note = f"{source.source_name}: gap taken from the header of the file: {1e3 * gap:.4g} mm"
    return replace(source, loops=loops, schedule=QUANTITIES["gap"], notes=(note, *source.notes))


def _add_gap_advice(source: SourceLoops) -> SourceLoops:
    """Add a note about a gap that is stated above the data but not used."""
    if source.stated_gap is None:
        return source
    gap, text = source.stated_gap
    value = "NUMBER" if gap is None else f"{1e3 * gap:.4g}"
    note = (
        f"{source.source_name}: the gap above the data ('{text[:60]}') is not used; to use it: "
        f"--constants gap_mm={value}"
    )
    return replace(source, notes=(note, *source.notes))
