"""Parameters as C, in fixed and floating point: every number and table with its meaning."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from textwrap import wrap

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.block import Block
from anhyst.compensate.floating import RealBlock
from anhyst.compensate.force_controller import AnyBlock
from anhyst.support.block_layout import BODY, HEAD, LEAST_WORDS, PLACES, SCALE_WORDS, Word
from anhyst.support.block_words import ONES, Names
from anhyst.support.units import Quantity

ENTRIES_A_LINE = 10
VALUES_END = 18
WIDTH = 100


def parameters_source(block: Block, names: Names, schedule: Quantity | None) -> str:
    """Return the rows of the initialiser of ``NAME_parameters[]``, commented."""
    lines = list(_head(block))
    tables: dict[int, list[Word]] = {}
    at = HEAD[-1].at + HEAD[-1].size
    for word in BODY[block.kind]:
        lines += _unused(block, at, word.at)
        at = word.at
        value = block.single(word.name) if word.size == 2 else int(block.words[at])
        if word.axis:
            tables.setdefault(int(value), []).append(word)
            text = f"{word.doc}, table at {value}"
        else:
            text = word.doc + _worth(word, value, block, names)
        entries = block.words[at : at + word.size]
        lines.append(_line(at, entries, f"{word.name}: {text}"))
        at += word.size
    lines += _unused(block, at, LEAST_WORDS)
    for _, named in sorted(tables.items()):
        lines += ["", *_table(named, block, names, schedule)]
    return "\n".join(lines)


def table_source(words: NDArray[np.int16]) -> str:
    """Return the entries of a table over two signals as lines of C, from a new one on for each row."""
    return "\n".join(line for row in words for line in _rows(row))


def scales_source(block: Block) -> str:
    """Return the words that say what the signals are counted in, as an initialiser."""
    words = block.words[PLACES["SCALE_DEMAND"] :][:SCALE_WORDS]
    return f"{{{', '.join(_literal(int(word)) for word in words)}}}"


def _head(block: Block) -> Iterator[str]:
    for word in HEAD:
        entries = block.words[word.at : word.at + word.size]
        yield _line(word.at, entries, f"{word.name}: {word.doc}")


def _unused(block: Block, first: int, end: int) -> list[str]:
    """Return the words before `end` that mean nothing in this kind; they are zero."""
    return [_line(first, block.words[first:end], "not used")] if first < end else []


def _line(at: int, entries: Iterable[int], text: str) -> str:
    """Put one or a few words in front of what they are."""
    row = ", ".join(_literal(int(word)) for word in entries)
    return f"{f'    {row},':<{VALUES_END}} /* {at:2d} {text} */"


def _worth(word: Word, value: float, block: Block, names: Names) -> str:
    """Say what a word is worth, where that is more than its number."""
    unit = block.unit(word, names)
    if word.format == "integer":
        return ""
    if word.format == "single":
        return f"; {value:.7g} {unit.name}".rstrip()
    return f"; {word.format}, {value / ONES[word.format] * unit.scale:.6g} {unit.name}".rstrip()


def _table(
    named: Sequence[Word], block: Block, names: Names, schedule: Quantity | None
) -> Iterator[str]:
    word = named[0]
    first, count = block.tables[word.name]
    entries = block.words[first : first + count]
    unit = block.unit(word, names)
    worth = entries / ONES[word.format] * unit.scale
    called = " and ".join(each.name for each in named)
    text = (
        f"{called}, {word.format}: {word.doc}, {worth.min():.6g} to {worth.max():.6g} {unit.name}"
    ).rstrip()
    yield from _comment(f"{first} {text}; {_axis(word, block, schedule)}")
    yield from _rows(entries)


def _axis(word: Word, block: Block, schedule: Quantity | None) -> str:
    """Say what a table runs over."""
    count = block.tables[word.name][1] - 1
    if word.axis == "gap":
        return _over_gap(count, block, schedule)
    if word.axis == "distance":
        octaves, segments = block.word("SIMPLE_OCTAVES"), 2 ** block.word("SIMPLE_SEGMENTS")
        return (
            f"{segments} steps of distance from 0 to 2^{4 - octaves}, then {segments} in each "
            "octave up to 16"
        )
    if word.axis == "moving plays":
        narrow, zone = 2 ** block.word("CELLS_SEGMENTS"), 2.0 ** -block.word("CELLS_ZONE")
        return (
            f"a row for each number of them: {2 * narrow} steps of field from -{zone:g} to "
            f"{zone:g}, {narrow - round(narrow * zone)} on each side from there to 1"
        )
    return {"play": "one a play", "field, both signs": f"{count} steps of field from -1 to 1"}.get(
        word.axis, f"{count} steps of {word.axis} from 0 to 1"
    )


def _over_gap(count: int, block: Block, schedule: Quantity | None) -> str:
    if schedule is None or block.scales.gap_high <= block.scales.gap_low:
        return "the same everywhere"
    scale, unit = (1e3, "mm") if schedule.unit == "m" else (1.0, schedule.unit)
    low, high = block.scales.gap_low * scale, block.scales.gap_high * scale
    return f"{count} steps of {schedule.name} from {low:.6g} to {high:.6g} {unit}"


def _comment(text: str) -> list[str]:
    """Break a comment into lines."""
    return wrap(f"/* {text} */", WIDTH, initial_indent="    ", subsequent_indent=" " * 7)


def _rows(entries: NDArray[np.int16]) -> Iterator[str]:
    for start in range(0, len(entries), ENTRIES_A_LINE):
        row = entries[start : start + ENTRIES_A_LINE]
        yield f"    {', '.join(_literal(int(word)) for word in row)},"


def _literal(word: int) -> str:
    """Return a word in C; the smallest one has no literal of its own."""
    return "-32767 - 1" if word == -32768 else str(word)


COMMON = {
    "demand_low": "{output}, lowest demand",
    "demand_high": "{output}, highest demand",
    "current_low": "{input}, lowest current",
    "current_high": "{input}, highest current",
    "full_scale": "{output}, counts as 1 under the root",
    "knee": "root below which it is a straight line",
    "flux_limit": "largest flux solved for",
    "gap_low": "{gap}, first row over the gap",
    "gap_rows": "rows for each {gap}",
    "power": "2: output is a force, flux its root; 1: linear",
    "condition_cycles": "triangles of the start-up sequence",
    "condition_ticks": "ticks of one of their ramps",
}
"""What the fields of ``anhyst_parameters_f32`` are, in the order of the structure but for power."""

LAWS = {
    "full": {
        "air": "flux of the air for a unit of field",
        "reversible": "reversible fraction c",
        "play": "half-width of the play, field",
        "octaves": "halvings of the memory in a unit of field",
        "reach": "largest field",
        "iterations": "evaluations of a solve",
        "curve_segments": "",
        "inverse_segments": "",
    },
    "cells": {
        "air": "flux of the air for a unit of field",
        "reach": "A/m, largest field",
        "inner": "A/m, up to which segments are narrow",
        "cells": "plays with a width",
        "narrow": "segments on each side of zero",
        "wide": "and beyond",
    },
    "simplified": {
        "rate": "distance of a unit of flux",
        "hold": "change of u of a unit of flux while held",
        "nu": "",
        "first": "distance at the end of the first octave",
        "iterations": "evaluations of a commit",
        "octaves": "of the table",
        "segments": "up to the first octave and in each",
    },
}
SOLID = {
    "hold": "field that a flux of 1 a tick holds back from layer to layer",
    "own": "field for a unit of flux in a layer",
    "surface": "share of the first layer in the section",
    "laminated": "share of the path that answers at once",
    "layers": "from the surface to the middle",
}
"""What the fields of ``anhyst_solid_f32`` are."""

TABLES = {
    ("full", "curve"): "Anhysteretic curve over fields of 0 to {reach:.6g}",
    ("full", "branch"): "Ascending branch over fields of -{reach:.6g} to {reach:.6g}",
    ("full", "inverse"): "Field over the anhysteretic of 0 to 1",
    ("cells", "thresholds"): "Half-widths of the plays, A/m",
    (
        "cells",
        "rows",
    ): "A row for 1, 2, .. moving plays over fields of -{reach:.6g} to {reach:.6g} A/m",
    ("simplified", "curve"): "State over distances of 0 to 16, finer towards 0",
}


Literal = Callable[[float], str]
"""How a number is written."""


def literal(value: float) -> str:
    """Return the shortest literal that C reads as this number in single precision.

    >>> literal(0.1), literal(2.0), literal(1e-7)
    ('0.1f', '2.0f', '1e-07f')
    """
    return f"{np.float32(value)!s}f"


def double(value: float) -> str:
    """Return the shortest literal that C reads as this number in double precision."""
    return repr(float(value))


def c_parameters(
    name: str, block: RealBlock, names: Names, schedule: Quantity | None, write: Literal = literal
) -> str:
    """Return the definitions of a compensator's parameters, single or double as it is written."""
    parts = [_real_table(block, table, write) for table in block.tables]
    parts += [_gaps(block, names, schedule, write), _law(block, write)]
    if memories(block) > 1:
        parts.append(_solid(block, write))
    parts.append(_parameters(name, block, names, schedule, write))
    text = "\n\n".join("\n".join(part) for part in parts)
    if write is literal:
        return text
    return text.replace("_f32", "_f64").replace("static const float", "static const double")


def memories(block: AnyBlock) -> int:
    """Return of how many memories of its law the iron consists."""
    if isinstance(block, RealBlock):
        layers, laminated = (block.numbers.get(name, 0.0) for name in ("layers", "laminated"))
    elif block.kind == "cells":
        layers, laminated = block.word("SOLID_LAYERS"), block.word("SOLID_LAMINATED")
    else:
        return 1
    return max(int(layers), 1) + (laminated > 0.0)


def _real_table(block: RealBlock, name: str, write: Literal) -> Iterator[str]:
    values = block.tables[name]
    yield f"/* {TABLES[block.kind, name].format(**block.numbers)}. */"
    yield f"static const float {name}[{values.size}] = {{"
    yield from wrap(
        f"{listed(values, write)},", WIDTH, initial_indent="    ", subsequent_indent="    "
    )
    yield "};"


def listed(values: Iterable[float], write: Literal = literal) -> str:
    """Return numbers as C reads them, with commas between them."""
    return ", ".join(map(write, values))


def _gaps(
    block: RealBlock, names: Names, schedule: Quantity | None, write: Literal
) -> Iterator[str]:
    arm = "the bounded state" if block.kind == "simplified" else "field"
    text = (
        f"/* Over the gap: flux for a full-scale output; output at zero flux, {names.output}; "
        f"current at zero flux and field, for a unit of flux, for a unit of {arm}, "
        f"{names.input}. */"
    )
    yield from wrap(text, WIDTH, subsequent_indent="   ")
    yield f"static const anhyst_at_gap_f32 gaps[{len(block.gaps)}] = {{"
    rows = [f"    {{{listed(row, write)}}}," for row in block.gaps.tolist()]
    end = max(len(row) for row in rows)
    at = np.linspace(block.scales.gap_low, block.scales.gap_high, len(rows)).tolist()
    for row, node in zip(rows, at, strict=True):
        yield row if schedule is None else f"{row:<{end}} /* {_schedule_text(node, schedule)} */"
    yield "};"


def _schedule_text(value: float, schedule: Quantity) -> str:
    scale, unit = (1e3, "mm") if schedule.unit == "m" else (1.0, schedule.unit)
    return f"{value * scale:.6g} {unit}"


def _law(block: RealBlock, write: Literal) -> Iterator[str]:
    unit = "A/m" if block.kind == "cells" else "units of the law's own scale"
    yield f"/* Fields in {unit}, flux in units of that of saturated iron. */"
    yield f"static const anhyst_{block.kind}_law_f32 law = {{"
    fields = [(name, _number(block, name, write), doc) for name, doc in LAWS[block.kind].items()]
    yield from _fields(fields + [(name, name, "") for name in block.tables])
    yield "};"


def _solid(block: RealBlock, write: Literal) -> Iterator[str]:
    yield f"#if ANHYST_MEMORIES < {memories(block)}"
    yield '#error "ANHYST_MEMORIES: too few for the layers of this iron; see plays.h"'
    yield "#endif"
    yield "/* Layers of solid iron. */"
    yield "static const anhyst_solid_f32 solid = {"
    fields = [("stand", f"anhyst_{block.kind}_stand_f32", "")]
    yield from _fields(
        fields + [(key, _number(block, key, write), doc) for key, doc in SOLID.items()]
    )
    yield "};"


def _parameters(
    actuator: str, block: RealBlock, names: Names, schedule: Quantity | None, write: Literal
) -> Iterator[str]:
    units = {
        "output": names.output,
        "input": names.input,
        "gap": "" if schedule is None else schedule.unit,
    }
    fields = [
        ("kernel", f"&anhyst_kernel_{block.kind}_f32", ""),
        (block.kind, "&law", ""),
        ("gaps", "gaps", ""),
        ("gap_segments", str(len(block.gaps) - 1), ""),
    ]
    fields += [
        (name, _number(block, name, write), doc.format(**units)) for name, doc in COMMON.items()
    ]
    if memories(block) > 1:
        fields.append(("solid", "&solid", ""))
    yield f"const anhyst_parameters_f32 {actuator}_parameters = {{"
    yield from _fields(fields)
    yield "};"


def _number(block: RealBlock, name: str, write: Literal) -> str:
    value = block.numbers[name]
    return str(value) if isinstance(value, int) else write(value)


def _fields(fields: list[tuple[str, str, str]]) -> Iterator[str]:
    rows = [(f"    .{name} = {value},", doc) for name, value, doc in fields]
    end = max(len(row) for row, doc in rows if doc) if any(doc for _, doc in rows) else 0
    for row, doc in rows:
        yield f"{row:<{end}} /* {doc} */" if doc else row
