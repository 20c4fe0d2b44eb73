"""The layout of a parameter block: its words, kinds and units.

Made by tools/contract from contract/block.toml: do not edit.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Literal

Format = Literal["q14", "q15", "q8", "weight", "integer", "unsigned", "single"]


@dataclass(frozen=True, slots=True)
class Word:
    """One word of the block."""

    at: int  # its number in the block
    name: str  # as in ``layout.h``, without ``ANHYST_WORD_``
    format: Format  # of the word; of the entries, if it names a table
    doc: str  # what it is
    low: int  # range that the controller accepts; of the entries, if it names a table
    high: int
    size: int = 1  # how many words it takes; a table is named by one
    # for a table: what it runs over, ``"gap"``, ``"field"``, ``"field, both signs"``,
    # ``"magnetisation"`` or ``"distance"``
    axis: str = ""
    # signal whose full scale 1.0 is worth, times `factor` and 2 to the word `shift`: ``"demand"``,
    # ``"current"``; none for a pure number
    of: Literal["", "demand", "current"] = ""
    factor: float = 1.0
    shift: str = ""
    unit: str = ""  # of a single, which is worth what it is: ``"output"``, ``"input"``, or the unit


def _words(rows: str) -> tuple[Word, ...]:
    """Return the words of a table with rows ``at name format low high | key=value | doc``."""
    words = []
    for row in re.split(r"\n(?! )", rows.strip()):
        fixed, *others, doc = " ".join(row.split()).split(" | ")
        at, name, form, low, high = fixed.split()
        given: dict[str, Any] = dict(other.split("=") for other in others)
        kinds = {"size": int, "factor": float}
        given |= {key: kind(given[key]) for key, kind in kinds.items() if key in given}
        known: Any = form  # a Format, because contract/ has no others
        words.append(Word(int(at), name, known, doc, int(low), int(high), **given))
    return tuple(words)


KINDS = {"full": 1, "simplified": 2, "euler": 3, "cells": 4, "play": 5}
MAGIC = (0x6E41, 0x7968)
LAYOUT = 2
LEAST_WORDS = 64
MOST_WORDS = 2048
MOST_REAL_WORDS = 1048576
SCALE_WORDS = 11
UNITS = ("", "1", "A", "A/m", "V", "N", "T", "Wb", "m", "s", "Pa", "Hz", "rad", "degC")
"""Units of the signals, by their numbers in ``SCALE_UNITS``."""

HEAD = _words("""
0 MAGIC unsigned 0 65535 | size=2 | marks the start of a block, two words
2 LAYOUT integer 2 2 | of the words; the code must know it
3 KIND integer 1 5 | 1 full, 2 simplified, 3 Euler, 4 cells, 5 play
4 LENGTH integer 64 2048 | of the whole block, words
5 GENERATION unsigned 0 65535 | chosen by whoever sends the block
6 CRC unsigned 0 65535 | size=2 | CRC-32 of all other words, low half, high half
8 MODEL unsigned 0 65535 | size=2 | first 32 bits of the model's hash, low half, high half
""")

DEMAND = _words("""
10 POWER integer 1 2 | the output goes with this power of the flux
11 DEMAND_LOW q15 -32767 32767 | of=demand | smallest demand
12 DEMAND_HIGH q15 -32767 32767 | of=demand | largest demand
13 CURRENT_LOW q15 -32767 32767 | of=current | smallest current
14 CURRENT_HIGH q15 -32767 32767 | of=current | largest current
15 CURRENT_SHIFT integer 0 8 | 1.0 of the inner current is 2^this of full scale
16 FLUX_LIMIT q14 1 16384 | largest flux solved for, of that of saturated iron
17 FLUX_SHIFT integer 0 6 | flux = root*gain*2^this
18 GAP_SEGMENTS integer 0 6 | tables over the gap have 2^this segments
19 GAP_GAIN weight 1 32767 | axis=gap | shift=FLUX_SHIFT | flux at full-scale demand
20 GAP_OFFSET q15 -32767 32767 | axis=gap | of=demand | output at zero flux
21 GAP_BIAS weight -32767 32767 | axis=gap | of=current | shift=CURRENT_SHIFT
   | current at zero flux and zero field
22 GAP_FLUX_ARM weight -32767 32767 | axis=gap | of=current | shift=CURRENT_SHIFT
   | current for a flux of 1.0
23 GAP_FIELD_ARM weight 1 32767 | axis=gap | of=current | shift=CURRENT_SHIFT
   | current for a field of 1.0
""")

START = _words("""
24 CONDITION_CYCLES integer 0 64 | start-up: triangles of current
25 CONDITION_TICKS integer 2 32767 | start-up: ticks of one ramp
""")

ROOT = _words("""
26 ROOT_KNEE integer 2 8 | below 2^(-2*this) of full scale the root is straight
""")

LAG = _words("""
27 GAP_LAG_ARM weight 0 32767 | axis=gap | of=current | shift=CURRENT_SHIFT
   | current for a flux that rises by 1.0 in a tick
""")

FULL = _words("""
32 FULL_AIR weight 1 32767 | factor=4.0 | flux of a field of 1.0 without iron
33 FULL_REVERSIBLE q15 0 32767 | reversible fraction c
34 FULL_PLAY q15 0 32767 | half-width of the play, in fields of 1.0
35 FULL_RATE weight 1 32767 | factor=16.0 | shift=FULL_RATE_SHIFT
   | octaves forgotten in a field of 1.0
36 FULL_RATE_SHIFT integer 0 12 | exponent of the rate
37 FULL_STEEPNESS q8 1 32767 | field of 1.0 over the pinning
38 FULL_ITERATIONS integer 2 16 | evaluations of a solve
39 FULL_CURVE_SEGMENTS integer 3 9 | the curve has 2^this segments
40 FULL_CURVE q15 0 32767 | axis=field | anhysteretic magnetisation
41 FULL_BRANCH q15 -32767 32767 | axis=field, both signs | ascending branch of the pinned part
42 FULL_INVERSE_SEGMENTS integer 3 9 | the inverse has 2^this segments
43 FULL_INVERSE q15 0 32767 | axis=magnetisation | field of an anhysteretic magnetisation
""")

SIMPLE = _words("""
32 SIMPLE_RATE weight 1 32767 | factor=8.0 | shift=SIMPLE_RATE_SHIFT
   | distance travelled for a flux of 1.0
33 SIMPLE_RATE_SHIFT integer 0 12 | exponent of the rate
34 SIMPLE_HOLD weight 1 32767 | shift=SIMPLE_HOLD_SHIFT
   | change of the bounded state for a flux of 1.0 while held
35 SIMPLE_HOLD_SHIFT integer 0 12 | exponent of the hold
36 SIMPLE_REST q15 1 32767 | 1 - nu of the closed form
37 SIMPLE_ITERATIONS integer 2 16 | evaluations of a commit
""")

CLOSED = _words("""
38 SIMPLE_OCTAVES integer 4 14 | the curve reaches over so many octaves of distance
39 SIMPLE_SEGMENTS integer 2 6 | 2^this segments in each octave
40 SIMPLE_CURVE q15 0 32767 | axis=distance | bounded state 1 - v
""")

EULER = _words("""
41 EULER_SUBSTEPS integer 1 16 | explicit Euler steps a sample
""")

BAND = _words("""
42 SIMPLE_BAND weight 0 32767 | largest reversal of the flux that does not begin a new path
""")

CELLS = _words("""
32 CELLS_AIR weight 1 32767 | factor=4.0 | flux of a field of 1.0 without iron
33 CELLS_COUNT integer 1 12 | plays, beside the one without width
34 CELLS_SEGMENTS integer 2 8 | a row has 2^this segments on each side of zero up to the zone
35 CELLS_ZONE integer 0 5
   | the zone ends at a field of 2^-this; beyond, segments are 2^this times as wide
36 CELLS_THRESHOLDS q15 1 32767 | axis=play | half-widths of the plays, in fields of 1.0, rising
37 CELLS_ROWS q15 -32767 32767 | axis=moving plays | magnetisation of the plays that move
""")

SOLID = _words("""
38 SOLID_LAYERS integer 0 4 | layers, 2 to 4; 0: thin iron, and 0 all that follows
39 SOLID_HOLD weight 0 32767 | shift=SOLID_HOLD_SHIFT
   | field from layer to layer for a flux of 1.0 more than a tick before
40 SOLID_HOLD_SHIFT integer 0 15 | exponent of it
41 SOLID_OWN weight -32767 0 | factor=4.0
   | field of a flux of 1.0 in its layer, beside that of the law
42 SOLID_SURFACE q15 0 32767 | share of the first layer in the section
43 SOLID_LAMINATED q15 0 32767 | share of the path in which the field is the same throughout
""")

PLAY = _words("""
10 PLAY_DEMAND_LOW q15 -32767 0 | of=demand | demand of the first column
11 PLAY_CURRENT_LOW q15 -32767 32767 | of=current | lowest current
12 PLAY_CURRENT_HIGH q15 -32767 32767 | of=current | highest current
13 PLAY_FORCE_SEGMENTS integer 0 8 | tables have 2^this segments along the demand
14 PLAY_GAP_SEGMENTS integer 0 6 | tables have 2^this segments over the gap
15 PLAY_STEEPNESS weight 16384 32767 | shift=PLAY_SHIFT
   | 1/(4*radius of the play), per current of 1.0
16 PLAY_SHIFT integer 0 9 | exponent of the steepness
17 PLAY_CURRENT q15 -32767 32767 | axis=demand and gap | of=current | current without the play
18 PLAY_HALF q15 0 32767 | axis=demand and gap | of=current | half-width of the loop
""")

SCALE = _words("""
48 SCALE_DEMAND single 0 65535 | unit=output | size=2 | demand of 1.0
50 SCALE_CURRENT single 0 65535 | unit=input | size=2 | current of 1.0
52 SCALE_GAP_LOW single 0 65535 | size=2 | gap of 0
54 SCALE_GAP_HIGH single 0 65535 | size=2 | gap of 1.0
56 SCALE_RATE single 0 65535 | unit=Hz | size=2 | ticks a second of the start-up
58 SCALE_UNITS integer 0 32767 | units of demand + 16*current + 256*gap
""")

MEMORY = _words("""
60 UNIT_FIELD single 0 65535 | unit=A/m | size=2 | field of a field of 1.0
""")

BODY: dict[str, tuple[Word, ...]] = {
    "full": DEMAND + START + ROOT + LAG + FULL + SCALE + MEMORY,
    "simplified": DEMAND + START + ROOT + LAG + SIMPLE + CLOSED + BAND + SCALE,
    "euler": DEMAND + START + ROOT + LAG + SIMPLE + EULER + BAND + SCALE,
    "cells": DEMAND + START + ROOT + LAG + CELLS + SOLID + SCALE + MEMORY,
    "play": PLAY + SCALE,
}
"""Every word of a kind behind the head, in the order of the block."""

PLACES = {word.name: word.at for body in (HEAD, *BODY.values()) for word in body}
"""Number of every word in the block, by its name."""

WORDS = {kind: {word.name: word.at for word in body} for kind, body in BODY.items()}
"""Number of a word of a kind, by its name."""
