"""Read simulated tables of flux linkage and force over current and position.

Programs for field simulation write a value for each pair of current and position, without a time
and without a history. Such a table is recognised from the units of its columns and from currents that recur
exactly at several positions, with one value each. Every position becomes a loop with ascending
current and the history `ANHYSTERETIC`. A position that is not a gap becomes a gap: flux, or else the
attraction, falls as the gap opens.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from anhyst.data.blocks import Breaks
from anhyst.data.formats import OpenTable
from anhyst.data.formats.channels import is_number, parse_number
from anhyst.data.joining import SourceLoops
from anhyst.data.loops import Loop, Source
from anhyst.data.path import ANHYSTERETIC, SETTLED
from anhyst.data.sidecar import FileDescription
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES, Header, parse_header
from anhyst.support.wording import count_text

_OUTPUTS = ("flux_linkage", "force")
"""Outputs of a table, the preferred one first."""
_MIN_POINTS = 3
"""Minimum number of currents at a position, because a loop has three samples or more."""
_MIN_COMMON_SHARE = 0.8
"""Minimum share of points whose current recurs at half of the positions or more. Simulated currents
recur exactly; the measured currents of loops do not."""
_MAX_REPEAT_DIFFERENCE = 1e-6
"""Maximum difference of repeated points, as a fraction of the range; branches of loops differ more."""
_MAX_CONTRADICTION_SHARE = 0.1
"""Maximum share of repeated points that differ, above which the table contains loops."""
_MIN_BRANCH_SHARE = 0.1
_MIN_RUN_POINTS = 3
"""Minimum share of steps in each direction, and minimum mean points of a run, for branches of a loop."""
_MIN_COMPONENT_SHARE = 0.01
"""Minimum size of a component of the force, as a fraction of the largest one."""
_MAX_OPPOSITE_SHARE = 0.05
"""Maximum force of the other sign, as a fraction of the largest force, that is an error of the mesh."""
_MIN_TREND_SHARE = 0.9
"""Minimum share of steps over the position that change the output in the same direction."""
_STATED_POSITION = re.compile(
    r"(?P<name>[^\W\d]\w*)\s*(?:[\[(](?P<inner>\w+)[\])])?\s*[=:]\s*(?P<number>[+-]?\d[\d.,eE+-]*)\s*"
    r"[\[(]?(?P<unit>[^\W\d]*)"
)


@dataclass(frozen=True, slots=True)
class _Points:
    """Points of a table in SI units."""

    current: FloatArray
    position: FloatArray
    outputs: Mapping[str, FloatArray]
    position_header: Header
    output_names: Mapping[str, str]  # names of the columns
    notes: tuple[str, ...]


def read_simulated_table(
    table: OpenTable, headers: Sequence[Header], description: FileDescription, label: str
) -> SourceLoops | None:
    """Return the loops of a simulated table, or None for other tables.

    If the table contains flux linkage and force, the result has the loops of the flux linkage, and
    its alternative has the loops of the force.
    """
    is_described = bool(
        description.histories or description.select or description.schedule not in (None, "gap")
    )
    columns = _find_columns(headers)
    if (
        is_described
        or description.history not in (None, SETTLED, ANHYSTERETIC)
        or any(header.is_clock or header.is_label for header in headers)
        or not columns["current"]
    ):
        return None
    try:
        raw = table.read([index for indices in columns.values() for index in indices])
    except InputError:
        return None  # the ordinary reader reports the fault
    values = {index: headers[index].to_si(column) for index, column in raw.numbers.items()}
    points = _choose_columns(headers, columns, values, raw.breaks)
    if points is None or not (description.history == ANHYSTERETIC or _is_grid(table.source_name, points)):
        return None
    points = _orient_force(table.source_name, points)
    points = _convert_to_gap(table.source_name, points)
    source = Source(table.source_name, raw.sha256, dict(description.columns))
    parts = [_make_loops(points, name, label, source) for name in points.outputs]
    parts = [part for part in parts if part.loops]
    return replace(parts[0], alternatives=tuple(parts[1:])) if parts else None


def _dimension(header: Header) -> str:
    """Return the dimension of a column, empty without a unit."""
    return header.unit.dimension if header.unit is not None and header.problem is None else ""


def _find_columns(headers: Sequence[Header]) -> dict[str, list[int]]:
    """Return the columns of each dimension. Mapped columns exclude other columns of their dimension."""
    columns: dict[str, list[int]] = {}
    for dimension in ("current", "length", *_OUTPUTS):
        found = [n for n, header in enumerate(headers) if _dimension(header) == dimension]
        columns[dimension] = [n for n in found if headers[n].target] or found
    mapped_outputs = [name for name in _OUTPUTS if any(headers[n].target for n in columns[name])]
    if len(mapped_outputs) == 1:
        columns |= {name: [] for name in _OUTPUTS if name not in mapped_outputs}
    return columns


def _choose_columns(
    headers: Sequence[Header],
    columns: Mapping[str, list[int]],
    values: Mapping[int, FloatArray],
    breaks: Breaks,
) -> _Points | None:
    """Return the points from the columns that vary, or None if a column is missing or not clear."""
    counts = {n: np.unique(column[np.isfinite(column)]).size for n, column in values.items()}
    varying = {name: [n for n in found if counts[n] > 1] for name, found in columns.items()}
    sizes = {n: float(np.nanmax(np.abs(values[n]))) for n in varying["force"]}
    varying["force"] = [n for n in sizes if sizes[n] > _MIN_COMPONENT_SHARE * max(sizes.values())]
    lengths = [n for n in varying["length"] if headers[n].quantity == QUANTITIES["gap"]] or varying["length"]
    outputs = {name: varying[name] for name in _OUTPUTS if varying[name]}
    is_clear = len(varying["current"]) == 1 and len(lengths) <= 1 and outputs
    if not is_clear or any(len(found) > 1 for found in outputs.values()):
        return None
    drive = values[varying["current"][0]]
    position = (
        (values[lengths[0]], headers[lengths[0]]) if lengths else _positions_of_blocks(breaks, drive.size)
    )
    if position is None:
        return None
    is_valid = np.isfinite(drive) & np.isfinite(position[0])
    return _Points(
        drive[is_valid],
        position[0][is_valid],
        {name: values[found[0]][is_valid] for name, found in outputs.items()},
        position[1],
        {name: headers[found[0]].text for name, found in outputs.items()},
        (),
    )


def _positions_of_blocks(breaks: Breaks, rows: int) -> tuple[FloatArray, Header] | None:
    """Return the position that a line above each block of rows states, m, or None without such lines."""
    found: list[tuple[Header, float]] = []
    for _, texts in breaks:
        for match in _STATED_POSITION.finditer(" ".join(texts)):
            header = parse_header(match["name"], match["inner"] or match["unit"] or None)
            number = match["number"].rstrip(".,")
            if _dimension(header) == "length" and is_number(number):
                found.append((header, float(header.to_si(np.array([parse_number(number)]))[0])))
                break
    if len(found) < max(2, len(breaks)) or len({header.name for header, _ in found}) > 1:
        return None
    sizes = np.diff([*(row for row, _ in breaks), rows])
    return np.repeat([value for _, value in found], sizes), found[0][0]


def _sorted_rows(points: _Points, name: str) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows of an output by position and current, each once, and repeated rows that differ."""
    output = points.outputs[name]
    order = np.lexsort((points.current, points.position))
    order = order[np.isfinite(output[order])]
    is_repeat = (np.diff(points.current[order]) == 0.0) & (np.diff(points.position[order]) == 0.0)
    limit = _MAX_REPEAT_DIFFERENCE * float(np.ptp(output[order]))
    differs = is_repeat & (np.abs(np.diff(output[order])) > limit)
    return order[np.concatenate(([True], ~is_repeat))], order[1:][differs]


def _runs_up_and_down(current: FloatArray) -> bool:
    """Whether currents in the order of the file form the branches of a loop; shuffled ones do not."""
    steps = np.sign(np.diff(current[np.sort(np.unique(current, return_index=True)[1])]))
    run_count = 1 + np.count_nonzero(np.diff(steps))
    falling_share = float(np.mean(steps < 0.0)) if steps.size else 0.0
    is_two_way = min(falling_share, 1.0 - falling_share) > _MIN_BRANCH_SHARE
    return is_two_way and bool(current.size >= _MIN_RUN_POINTS * run_count)


def _is_grid(source: str, points: _Points) -> bool:
    """Whether each output has one value for each pair, and the same currents recur at several positions."""
    paths = [points.current[points.position == position] for position in np.unique(points.position)]
    positions = len(paths)
    if 2 * sum(map(_runs_up_and_down, paths)) > positions:
        return False
    for name in points.outputs:
        rows, different = _sorted_rows(points, name)
        counts = Counter(points.current[rows].tolist())
        common_count = sum(count for count in counts.values() if 2 * count >= positions)
        is_loop = different.size > _MAX_CONTRADICTION_SHARE * rows.size
        if positions < 2 or is_loop or common_count < _MIN_COMMON_SHARE * rows.size:
            return False
        if different.size:
            current, position = points.current[different[0]], points.position[different[0]]
            raise InputError(
                f"{source}: has two values in '{points.output_names[name]}' for {current:g} A at "
                f"{points.position_header.text} of {1e3 * position:.6g} mm; remove one of them",
                code="two-values",
                key=name,
            )
    return True


def _orient_force(source: str, points: _Points) -> _Points:
    """Make an attraction positive, with a note; refuse a force of both signs."""
    force = points.outputs.get("force")
    if force is None:
        return points
    low, high = float(np.nanmin(force)), float(np.nanmax(force))
    if min(-low, high) > _MAX_OPPOSITE_SHARE * max(-low, high):
        name = points.output_names["force"]
        raise InputError(
            f"{source}: '{name}' is {low:.4g} to {high:.4g} N, but an attraction has one sign; choose the "
            f'column of the attraction, or leave this one out: --columns "{name}="',
            code="force-signs",
            key=name,
        )
    if high >= -low:
        return points
    note = "the force is negative: an attraction in the negative direction, whose sign is reversed"
    return replace(points, outputs={**points.outputs, "force": -force}, notes=(*points.notes, note))


def _convert_to_gap(source: str, points: _Points) -> _Points:
    """Convert the position to a gap, with a note on its direction. Refuse unclear directions."""
    output_name = next(iter(points.outputs))
    name, output_text = points.position_header.text, output_name.replace("_", " ")
    low, high = float(points.position.min()), float(points.position.max())
    rising_share = _share_of_rising_steps(points, output_name)
    opens, closes = rising_share < 1.0 - _MIN_TREND_SHARE, rising_share > _MIN_TREND_SHARE
    is_gap = points.position_header.quantity == QUANTITIES["gap"]
    if is_gap and not closes:
        return points
    if is_gap or not (opens or closes):
        fault = "grows" if closes else "both grows and falls"
        remedy = f'map a stroke: --columns "{name}=x_mm"' if is_gap else "write the gap to a column 'gap_mm'"
        raise InputError(
            f"{source}: the {output_text} {fault} with '{name}', so it is not a gap; {remedy}",
            code="direction-unclear",
            key=name,
        )
    if closes:
        position = high - points.position
        note = f"'{name}' closes the gap, because the {output_text} grows with it: gap = {1e3 * high:.6g} mm - {name}"
    else:
        position = points.position + max(-low, 0.0)
        shift_text = f" + {-1e3 * low:.6g} mm" if low < 0.0 else ""
        note = f"'{name}' opens the gap, because the {output_text} falls with it: gap = {name}{shift_text}"
    return replace(points, position=position, notes=(*points.notes, note))


def _share_of_rising_steps(points: _Points, name: str) -> float:
    """Return the share of steps between positions, at equal current, that raise the output."""
    sign = np.sign(points.current) if name == "flux_linkage" else 1.0
    output = np.asarray(points.outputs[name] * sign)
    order = np.lexsort((points.position, points.current))
    order = order[np.isfinite(output[order])]
    is_step = (np.diff(points.current[order]) == 0.0) & (np.diff(points.position[order]) > 0.0)
    steps = np.diff(output[order])[is_step]
    steps = steps[np.abs(steps) > _MAX_REPEAT_DIFFERENCE * float(np.ptp(output[order]))]
    return float(np.mean(steps > 0.0)) if steps.size else 0.5


def _make_loops(points: _Points, name: str, label: str, source: Source) -> SourceLoops:
    """Return one loop for each gap with enough points."""
    rows, _ = _sorted_rows(points, name)
    gaps, counts = np.unique(points.position[rows], return_counts=True)
    groups = [rows[points.position[rows] == gap] for gap in gaps[counts >= _MIN_POINTS]]
    loops = tuple(
        Loop(
            label, points.current[group], points.outputs[name][group], points.position[group],
            history=ANHYSTERETIC, source=source.path,
        )
        for group in groups
    )  # fmt: skip
    left_out_count = points.current.size - sum(group.size for group in groups)
    left_out_text = (
        f"; {count_text(left_out_count, 'point')} repeated or without a value" if left_out_count else ""
    )
    others = [text for other, text in points.output_names.items() if other != name]
    notes = [
        f"table of one {name.replace('_', ' ')} for each of {np.unique(points.current).size} currents at "
        f"{count_text(len(loops), 'gap')}, without hysteresis{left_out_text}",
        *points.notes,
        "values are used as they are; no depth, symmetry factor or number of turns is applied",
        *(f"'{text}' is used instead with --columns \"{points.output_names[name]}=\"" for text in others),
    ]
    return SourceLoops(
        source.path, loops, QUANTITIES["current"], QUANTITIES[name], QUANTITIES["gap"],
        source if source.sha256 else None, tuple(f"{source.path}: {note}" for note in notes), is_labelled=False,
    )  # fmt: skip
