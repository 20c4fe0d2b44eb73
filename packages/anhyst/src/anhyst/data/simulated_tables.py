"""Read simulated tables of flux linkage and force over current and position.

Programs for field simulation write one value for each pair of current and position: the table has
no time and no history. It is recognised from the units of its columns and from currents that recur
exactly at all positions, with one value each. Every position becomes a loop with ascending current
and the history `ANHYSTERETIC`. A position that is not a gap becomes a gap: flux, or else the
attraction, falls as the gap opens.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anhyst.data.blocks import Breaks
from anhyst.data.formats import OpenTable
from anhyst.data.formats.channels import parse_number
from anhyst.data.joining import SourceLoops
from anhyst.data.loops import Loop, Source
from anhyst.data.path import ANHYSTERETIC
from anhyst.data.sidecar import FileDescription
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import GAP_ADVICE, QUANTITIES, Header, parse_header
from anhyst.support.wording import count_text

_DIMENSIONS = ("current", "length", "flux_linkage", "force")
_MIN_POINTS = 3
"""Minimum number of currents at a position; a loop has three samples or more."""
_MIN_COMMON_SHARE = 0.8
"""Minimum share of points whose current recurs at half of the positions or more. Commanded currents
recur exactly; the measured currents of loops do not."""
_MAX_REPEAT_DIFFERENCE = 1e-6
"""Maximum difference of repeated points, as a fraction of the range; the branches of a loop differ more."""
_MIN_COMPONENT_SHARE = 0.01
"""Minimum size of a force, as a fraction of the largest one, that is not a component without meaning."""
_MIN_TREND_SHARE = 0.9
"""Minimum share of steps over the position in which the output changes in the same direction."""
_PER_LENGTH = re.compile(r"(N|Wb|V\s?s|Vs)\s*(/|per|·|\*)\s*c?m+(\^?-1)?\b", re.IGNORECASE)
_MODEL_PART = re.compile(r"symmetr|half|quarter|halb|viertel|depth|tiefe|sector|sektor|period", re.IGNORECASE)
_STATED_POSITION = re.compile(
    r"(?P<name>[^\W\d]\w*)\s*(?:[\[(](?P<inner>\w+)[\])])?\s*[=:]\s*(?P<number>[+-]?\d[\d.,eE+-]*)\s*"
    r"[\[(]?(?P<unit>[^\W\d]*)"
)


@dataclass(frozen=True, slots=True)
class _Points:
    """Points of a table in SI units, and the headers of position and output."""

    current: FloatArray
    position: FloatArray
    output: FloatArray
    position_header: Header
    output_header: Header
    notes: tuple[str, ...]

    def select(self, rows: FloatArray) -> _Points:
        """Return some of the points."""
        return _Points(
            self.current[rows], self.position[rows], self.output[rows],
            self.position_header, self.output_header, self.notes,
        )  # fmt: skip


def read_simulated_table(
    table: OpenTable, headers: Sequence[Header], description: FileDescription, label: str
) -> SourceLoops | None:
    """Return the loops of a simulated table; None for other tables."""
    is_stated = description.history == ANHYSTERETIC
    has_other_history = description.histories or (description.history is not None and not is_stated)
    if has_other_history or description.select or description.schedule not in (None, "gap"):
        return None
    if any(header.is_clock or header.is_label for header in headers):
        return None
    by_dimension = _find_columns(headers)
    if not by_dimension["current"] or not (by_dimension["flux_linkage"] or by_dimension["force"]):
        _refuse_per_length(table.source_name, headers, by_dimension)
        return None
    try:
        raw = table.read([index for indices in by_dimension.values() for index in indices])
    except InputError:
        return None  # the ordinary reader names the fault
    values = {index: headers[index].to_si(column) for index, column in raw.numbers.items()}
    points = _choose_points(headers, by_dimension, values, raw.breaks)
    points = None if points is None else _remove_repeats(points)
    if points is None or not (is_stated or _is_grid(points)):
        return None
    points = _orient(table.source_name, points)
    quantity = QUANTITIES["force" if by_dimension_of(points.output_header) == "force" else "flux_linkage"]
    gaps, counts = np.unique(points.position, return_counts=True)
    small_gaps = gaps[counts < _MIN_POINTS]
    loops = [
        Loop(
            label, points.current[rows], points.output[rows], points.position[rows],
            history=ANHYSTERETIC, source=table.source_name,
        )
        for gap in gaps[counts >= _MIN_POINTS]
        for rows in [points.position == gap]
    ]  # fmt: skip
    if not loops:
        return None
    currents = np.unique(points.current).size
    remarks = [text for text in raw.notes if _MODEL_PART.search(text)]
    notes = [
        f"table without hysteresis: {quantity.name.replace('_', ' ')} at {currents} currents and "
        f"{count_text(len(loops), 'gap')}, one value each",
        *points.notes,
        "the values are used as they are: no depth, symmetry factor or number of turns is applied"
        + (f", although the file states '{remarks[0][:60]}'" if remarks else ""),
        *(f"gap {1e3 * gap:.4g} mm is left out, because it has fewer than {_MIN_POINTS} points" for gap in small_gaps),
    ]
    return SourceLoops(
        table.source_name,
        tuple(loops),
        QUANTITIES["current"],
        quantity,
        QUANTITIES["gap"],
        Source(table.source_name, raw.sha256, dict(description.columns)) if raw.sha256 else None,
        tuple(f"{table.source_name}: {note}" for note in notes),
        is_labelled=False,
    )


def by_dimension_of(header: Header) -> str:
    """Return the dimension of a header, empty without a unit."""
    return header.unit.dimension if header.unit is not None and header.problem is None else ""


def _find_columns(headers: Sequence[Header]) -> dict[str, list[int]]:
    """Return the columns of each dimension; mapped columns exclude others of their dimension."""
    found: dict[str, list[int]] = {}
    for dimension in _DIMENSIONS:
        columns = [n for n, header in enumerate(headers) if by_dimension_of(header) == dimension]
        found[dimension] = [n for n in columns if headers[n].target] or columns
    mapped_outputs = [name for name in _DIMENSIONS[2:] if any(headers[n].target for n in found[name])]
    if len(mapped_outputs) == 1:
        return {name: found[name] if name in (*_DIMENSIONS[:2], *mapped_outputs) else [] for name in found}
    return found


def _refuse_per_length(source: str, headers: Sequence[Header], by_dimension: dict[str, list[int]]) -> None:
    """Raise an error for a table over current and position whose outputs are per depth."""
    per_length = [header.text for header in headers if _PER_LENGTH.search(header.text + " " + header.stated)]
    if per_length and by_dimension["current"] and by_dimension["length"]:
        raise InputError(
            f"{source}: column '{per_length[0]}' is per length of a plane model; multiply it by the depth of "
            "the model and write N or Wb",
            code="per-length",
            key=per_length[0],
        )


def _choose_points(
    headers: Sequence[Header], by_dimension: dict[str, list[int]], values: dict[int, FloatArray], breaks: Breaks
) -> _Points | None:
    """Return the points with the column of each role; None if a role is missing or not clear."""
    varying = {
        name: [n for n in columns if np.unique(values[n][np.isfinite(values[n])]).size > 1]
        for name, columns in by_dimension.items()
    }
    sizes = {n: float(np.nanmax(np.abs(values[n]))) for n in varying["force"]}
    varying["force"] = [n for n in sizes if sizes[n] > _MIN_COMPONENT_SHARE * max(sizes.values())]
    gaps = [n for n in varying["length"] if headers[n].quantity == QUANTITIES["gap"]]
    varying["length"] = gaps or varying["length"]
    outputs = varying["flux_linkage"] or varying["force"]
    if len(varying["current"]) != 1 or len(outputs) != 1 or len(varying["length"]) > 1:
        return None
    (drive,), (output,) = varying["current"], outputs
    if varying["length"]:
        position, position_header = values[varying["length"][0]], headers[varying["length"][0]]
    else:
        stated = _positions_of_blocks(breaks, values[drive].size)
        if stated is None:
            return None
        position, position_header = stated
    notes = [
        f"column '{headers[n].text}' is constant at {values[n][0]:g} (SI) and is not used"
        for name in ("length", "current")
        for n in by_dimension[name]
        if n not in varying[name] and n not in gaps and np.isfinite(values[n][0])
    ]
    if varying["flux_linkage"] and varying["force"]:
        force = headers[varying["force"][0]].text
        notes.append(f'the table also contains a force; to use it: --columns "{force}=F_N"')
    is_valid = np.isfinite(values[drive]) & np.isfinite(position) & np.isfinite(values[output])
    if count := int(np.count_nonzero(~is_valid)):
        notes.append(f"{count_text(count, 'point')} without a value left out")
    points = _Points(values[drive], position, values[output], position_header, headers[output], tuple(notes))
    return points.select(is_valid) if is_valid.any() else None


def _positions_of_blocks(breaks: Breaks, rows: int) -> tuple[FloatArray, Header] | None:
    """Return the position that a line above each block of rows states, m; None without them."""
    found = []
    for _, texts in breaks:
        for match in _STATED_POSITION.finditer(" ".join(texts)):
            header = parse_header(match["name"], match["inner"] or match["unit"] or None)
            if by_dimension_of(header) == "length":
                number = parse_number(match["number"].rstrip(".,"))
                found.append((header, float(header.to_si(np.array([number]))[0])))
                break
    if len(found) < max(2, len(breaks)) or len({header.name for header, _ in found}) > 1:
        return None
    sizes = np.diff([*(row for row, _ in breaks), rows])
    return np.repeat([value for _, value in found], sizes), found[0][0]


def _remove_repeats(points: _Points) -> _Points | None:
    """Sort points by position and current, and remove repeated ones; None if their outputs differ."""
    order = np.lexsort((points.current, points.position))
    points = points.select(order)
    is_repeat = (np.diff(points.current) == 0.0) & (np.diff(points.position) == 0.0)
    limit = _MAX_REPEAT_DIFFERENCE * float(np.ptp(points.output))
    if np.any(np.abs(np.diff(points.output))[is_repeat] > limit):
        return None
    return points.select(np.concatenate(([True], ~is_repeat)))


def _is_grid(points: _Points) -> bool:
    """Whether the same currents recur at several positions."""
    positions = np.unique(points.position).size
    counts = Counter(points.current.tolist())
    common = sum(count for count in counts.values() if 2 * count >= positions)
    return positions > 1 and common >= _MIN_COMMON_SHARE * points.current.size


def _orient(source: str, points: _Points) -> _Points:
    """Make the force positive and the position a gap, with notes; refuse what is not clear."""
    notes, output, position = list(points.notes), points.output, points.position
    if by_dimension_of(points.output_header) == "force":
        low, high = float(output.min()), float(output.max())
        if min(-low, high) > 0.05 * max(-low, high):
            raise InputError(
                f"{source}: the force is {low:.4g} to {high:.4g} N, of both signs, and an attraction has one "
                "sign; map the column of the attraction: --columns \"NAME=F_N\"",
                code="force-signs",
            )
        if -low > high:
            output = -output
            notes.append("the force is negative and taken as an attraction: its sign is reversed")
    rising = _share_of_rising(points.current, position, output * np.sign(points.current) if low_is_flux(points) else output)
    name = points.position_header.text
    if points.position_header.quantity == QUANTITIES["gap"]:
        if rising > _MIN_TREND_SHARE:
            raise InputError(
                f"{source}: the {points.output_header.text} grows with '{name}', so it is a stroke and not a gap; "
                f'map it: --columns "{name}=x_mm"',
                code="gap-is-stroke",
                key="gap",
            )
        if float(position.min()) < 0.0:
            raise InputError(
                f"{source}: negative gap {float(position.min()):g} m; {GAP_ADVICE}", code="negative-gap", key="gap_m"
            )
    elif rising > _MIN_TREND_SHARE:
        position, end = float(position.max()) - position, float(position.max())
        notes.append(
            f"'{name}' is a stroke, because the {points.output_header.text} grows with it: "
            f"gap = {1e3 * end:.6g} mm - {name}"
        )
    elif rising < 1.0 - _MIN_TREND_SHARE:
        start = min(float(position.min()), 0.0)
        position = position - start
        shift = f" + {-1e3 * start:.6g} mm" if start else ""
        notes.append(
            f"'{name}' is a gap, because the {points.output_header.text} falls as it grows: gap = {name}{shift}"
        )
    else:
        raise InputError(
            f"{source}: the {points.output_header.text} neither grows nor falls with '{name}' everywhere, so it is "
            f"not clear whether it opens or closes the gap; write the gap in a column 'gap_mm'",
            code="direction-unclear",
            key=name,
        )
    points = _Points(points.current, position, output, points.position_header, points.output_header, tuple(notes))
    return points.select(np.lexsort((points.current, points.position)))


def low_is_flux(points: _Points) -> bool:
    return by_dimension_of(points.output_header) == "flux_linkage"


def _share_of_rising(current: FloatArray, position: FloatArray, output: FloatArray) -> float:
    """Return the share of steps between positions, at equal current, in which the output rises."""
    order = np.lexsort((position, current))
    steps = np.diff(output[order])[np.diff(current[order]) == 0.0]
    steps = steps[np.abs(steps) > _MAX_REPEAT_DIFFERENCE * np.ptp(output)]
    return float(np.mean(steps > 0.0)) if steps.size else 0.5
