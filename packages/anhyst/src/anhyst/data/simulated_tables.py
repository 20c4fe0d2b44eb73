"""Read simulated tables of flux linkage and force over current and position.

Programs for field simulation write one value for each pair of current and position: the table has
no time and no history. It is recognised from the units of its columns and from currents that recur
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
from anhyst.data.path import ANHYSTERETIC
from anhyst.data.sidecar import FileDescription
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import GAP_ADVICE, QUANTITIES, Header, parse_header
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
_MIN_COMPONENT_SHARE = 0.01
"""Minimum size of a component of the force, as a fraction of the largest one."""
_MAX_OPPOSITE_SHARE = 0.05
"""Maximum force of the other sign, as a fraction of the largest force, that is an error of the mesh."""
_MIN_TREND_SHARE = 0.9
"""Minimum share of steps over the position in which the output changes in the same direction."""
_PER_LENGTH = re.compile(r"(N|Wb|V ?s)\s*(/|per|·|\*)\s*c?m+(\^?-1)?\b", re.IGNORECASE)
_MODEL_PART = re.compile(r"symmetr|half|quarter|halb|viertel|depth|tiefe|sector|sektor|period", re.IGNORECASE)
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
    """Return the loops of a simulated table; None for other tables.

    If the table contains flux linkage and force, the result has the loops of the flux linkage, and
    those of the force as its alternative.
    """
    is_stated = description.history == ANHYSTERETIC
    has_other_history = bool(description.histories) or (description.history is not None and not is_stated)
    if has_other_history or description.select or description.schedule not in (None, "gap"):
        return None
    if any(header.is_clock or header.is_label for header in headers):
        return None
    columns = _find_columns(headers)
    if columns["current"] and columns["length"]:
        _refuse_per_length(table.source_name, headers)
    if not columns["current"] or not any(columns[name] for name in _OUTPUTS):
        return None
    try:
        raw = table.read([index for indices in columns.values() for index in indices])
    except InputError:
        return None  # the ordinary reader reports the fault
    values = {index: headers[index].to_si(column) for index, column in raw.numbers.items()}
    points = _choose_columns(headers, columns, values, raw.breaks)
    if points is None or not (is_stated or _is_grid(points)):
        return None
    points = _orient_force(table.source_name, points)
    points = _convert_to_gap(table.source_name, points)
    remarks = [text for text in raw.notes if _MODEL_PART.search(text)]
    scale_note = (
        "the values are used as they are: no depth, symmetry factor or number of turns is applied"
        + (f", although the file states '{remarks[0][:60]}'" if remarks else "")
    )
    source = Source(table.source_name, raw.sha256, dict(description.columns)) if raw.sha256 else None
    parts = [
        _make_loops(table.source_name, points, name, label, source, scale_note) for name in points.outputs
    ]
    found_parts = [part for part in parts if part is not None]
    return replace(found_parts[0], alternatives=tuple(found_parts[1:])) if found_parts else None


def _dimension(header: Header) -> str:
    """Return the dimension of a column, empty without a unit."""
    return header.unit.dimension if header.unit is not None and header.problem is None else ""


def _find_columns(headers: Sequence[Header]) -> dict[str, list[int]]:
    """Return the columns of each dimension; mapped columns exclude the others of their dimension."""
    columns: dict[str, list[int]] = {}
    for dimension in ("current", "length", *_OUTPUTS):
        found = [n for n, header in enumerate(headers) if _dimension(header) == dimension]
        columns[dimension] = [n for n in found if headers[n].target] or found
    mapped_outputs = [name for name in _OUTPUTS if any(headers[n].target for n in columns[name])]
    if len(mapped_outputs) == 1:
        columns |= {name: [] for name in _OUTPUTS if name not in mapped_outputs}
    return columns


def _refuse_per_length(source: str, headers: Sequence[Header]) -> None:
    """Raise an error for outputs per length, as plane models give them."""
    for header in headers:
        if header.unit is None and _PER_LENGTH.search(f"{header.text} {header.stated}"):
            raise InputError(
                f"{source}: column '{header.text}' is per length of a plane model; multiply it by the depth of "
                "the model, and write N or Wb",
                code="per-length",
                key=header.text,
            )


def _choose_columns(
    headers: Sequence[Header],
    columns: Mapping[str, list[int]],
    values: Mapping[int, FloatArray],
    breaks: Breaks,
) -> _Points | None:
    """Return the points from the columns that vary; None if a column is missing or not clear."""
    varying = {name: [n for n in found if _varies(values[n])] for name, found in columns.items()}
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
    notes = [
        f"column '{headers[n].text}' is constant at {values[n][0]:g} (SI) and is not used"
        for n in columns["length"]
        if n not in varying["length"] and np.isfinite(values[n][0])
    ]
    is_valid = np.isfinite(drive) & np.isfinite(position[0])
    return _Points(
        drive[is_valid],
        position[0][is_valid],
        {name: values[found[0]][is_valid] for name, found in outputs.items()},
        position[1],
        {name: headers[found[0]].text for name, found in outputs.items()},
        tuple(notes),
    )


def _varies(values: FloatArray) -> bool:
    return np.unique(values[np.isfinite(values)]).size > 1


def _positions_of_blocks(breaks: Breaks, rows: int) -> tuple[FloatArray, Header] | None:
    """Return the position that a line above each block of rows states, m; None without them."""
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


def _sorted_rows(points: _Points, name: str) -> NDArray[np.intp] | None:
    """Return the rows of an output by position and current, each once; None if repeated rows differ."""
    output = points.outputs[name]
    order = np.lexsort((points.current, points.position))
    order = order[np.isfinite(output[order])]
    is_repeat = (np.diff(points.current[order]) == 0.0) & (np.diff(points.position[order]) == 0.0)
    limit = _MAX_REPEAT_DIFFERENCE * float(np.ptp(output[order]))
    if np.any(np.abs(np.diff(output[order]))[is_repeat] > limit):
        return None
    return np.asarray(order[np.concatenate(([True], ~is_repeat))])


def _is_grid(points: _Points) -> bool:
    """Whether each output has one value for each pair, and the same currents recur at several positions."""
    positions = np.unique(points.position).size
    for name in points.outputs:
        rows = _sorted_rows(points, name)
        if rows is None or positions < 2:
            return False
        counts = Counter(points.current[rows].tolist())
        common_count = sum(count for count in counts.values() if 2 * count >= positions)
        if common_count < _MIN_COMMON_SHARE * rows.size:
            return False
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
    """Convert the position to a gap, with a note on its direction; refuse what is not clear."""
    output_name = next(iter(points.outputs))
    name, output_text = points.position_header.text, output_name.replace("_", " ")
    rising_share = _share_of_rising_steps(points, output_name)
    position = points.position
    low, high = float(position.min()), float(position.max())
    if points.position_header.quantity == QUANTITIES["gap"]:
        if rising_share > _MIN_TREND_SHARE:
            raise InputError(
                f"{source}: the {output_text} grows with '{name}', so it is a stroke and not a gap; map it: "
                f'--columns "{name}=x_mm"',
                code="gap-is-stroke",
                key="gap",
            )
        if low < 0.0:
            raise InputError(
                f"{source}: negative gap {low:g} m; {GAP_ADVICE}", code="negative-gap", key="gap_m"
            )
        return points
    if rising_share > _MIN_TREND_SHARE:
        position = high - position
        note = f"'{name}' closes the gap, because the {output_text} grows with it: gap = {1e3 * high:.6g} mm - {name}"
    elif rising_share < 1.0 - _MIN_TREND_SHARE:
        shift = max(-low, 0.0)
        position = position + shift
        note = f"'{name}' opens the gap, because the {output_text} falls as it grows: gap = {name}" + (
            f" + {1e3 * shift:.6g} mm" if shift else ""
        )
    else:
        raise InputError(
            f"{source}: the {output_text} neither grows nor falls with '{name}' everywhere, so it is not clear "
            "whether it opens or closes the gap; write the gap to a column 'gap_mm'",
            code="direction-unclear",
            key=name,
        )
    return replace(points, position=position, notes=(*points.notes, note))


def _share_of_rising_steps(points: _Points, name: str) -> float:
    """Return the share of steps between positions, at equal current, in which the output rises."""
    sign = np.sign(points.current) if name == "flux_linkage" else 1.0
    output = np.asarray(points.outputs[name] * sign)
    order = np.lexsort((points.position, points.current))
    order = order[np.isfinite(output[order])]
    is_step = (np.diff(points.current[order]) == 0.0) & (np.diff(points.position[order]) > 0.0)
    steps = np.diff(output[order])[is_step]
    steps = steps[np.abs(steps) > _MAX_REPEAT_DIFFERENCE * float(np.ptp(output[order]))]
    return float(np.mean(steps > 0.0)) if steps.size else 0.5


def _make_loops(
    source_name: str, points: _Points, name: str, label: str, source: Source | None, scale_note: str
) -> SourceLoops | None:
    """Return one loop for each gap with enough points; None if there is none."""
    rows = _sorted_rows(points, name)
    if rows is None:
        return None
    current, position, output = points.current[rows], points.position[rows], points.outputs[name][rows]
    gaps, counts = np.unique(position, return_counts=True)
    groups = [position == gap for gap in gaps[counts >= _MIN_POINTS]]
    loops = tuple(
        Loop(label, current[group], output[group], position[group], history=ANHYSTERETIC, source=source_name)
        for group in groups
    )
    if not loops:
        return None
    missing_count = int(np.count_nonzero(~np.isfinite(points.outputs[name])))
    missing_text = f"; {count_text(missing_count, 'point')} without a value left out" if missing_count else ""
    short_gaps = ", ".join(f"{1e3 * gap:.4g} mm" for gap in gaps[counts < _MIN_POINTS])
    others = [text for other, text in points.output_names.items() if other != name]
    notes = [
        f"table of one {name.replace('_', ' ')} for each of {np.unique(current).size} currents at "
        f"{count_text(len(loops), 'gap')}, without hysteresis{missing_text}",
        *points.notes,
        scale_note,
        *([f"fewer than {_MIN_POINTS} points, left out: gap {short_gaps}"] if short_gaps else []),
        *(f"'{text}' is used instead with --columns \"{points.output_names[name]}=\"" for text in others),
    ]
    return SourceLoops(
        source_name, loops, QUANTITIES["current"], QUANTITIES[name], QUANTITIES["gap"], source,
        tuple(f"{source_name}: {note}" for note in notes), is_labelled=False,
    )  # fmt: skip
