"""The layout of a parameter block: its words, kinds and units.

Made by tools/contract from contract/block.toml: do not edit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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


KINDS = {"full": 1, "simplified": 2, "euler": 3, "cells": 4, "play": 5}
MAGIC = (0x6E41, 0x7968)
LAYOUT = 2
LEAST_WORDS = 64
MOST_WORDS = 2048
MOST_REAL_WORDS = 1048576
SCALE_WORDS = 11
UNITS = ("", "1", "A", "A/m", "V", "N", "T", "Wb", "m", "s", "Pa", "Hz", "rad", "degC")
"""Units of the signals, by their numbers in ``SCALE_UNITS``."""

HEAD = (
    Word(0, "MAGIC", "unsigned", "marks the start of a block, two words", 0, 65535, size=2),
    Word(2, "LAYOUT", "integer", "of the words; the code must know it", 2, 2),
    Word(3, "KIND", "integer", "1 full, 2 simplified, 3 Euler, 4 cells, 5 play", 1, 5),
    Word(4, "LENGTH", "integer", "of the whole block, words", 64, 2048),
    Word(5, "GENERATION", "unsigned", "chosen by whoever sends the block", 0, 65535),
    Word(6, "CRC", "unsigned", "CRC-32 of all other words, low half, high half", 0, 65535, size=2),
    Word(
        8,
        "MODEL",
        "unsigned",
        "first 32 bits of the model's hash, low half, high half",
        0,
        65535,
        size=2,
    ),
)

DEMAND = (
    Word(10, "POWER", "integer", "the output goes with this power of the flux", 1, 2),
    Word(11, "DEMAND_LOW", "q15", "smallest demand", -32767, 32767, of="demand"),
    Word(12, "DEMAND_HIGH", "q15", "largest demand", -32767, 32767, of="demand"),
    Word(13, "CURRENT_LOW", "q15", "smallest current", -32767, 32767, of="current"),
    Word(14, "CURRENT_HIGH", "q15", "largest current", -32767, 32767, of="current"),
    Word(15, "CURRENT_SHIFT", "integer", "1.0 of the inner current is 2^this of full scale", 0, 8),
    Word(16, "FLUX_LIMIT", "q14", "largest flux solved for, of that of saturated iron", 1, 16384),
    Word(17, "FLUX_SHIFT", "integer", "flux = root*gain*2^this", 0, 6),
    Word(18, "GAP_SEGMENTS", "integer", "tables over the gap have 2^this segments", 0, 6),
    Word(
        19,
        "GAP_GAIN",
        "weight",
        "flux at full-scale demand",
        1,
        32767,
        axis="gap",
        shift="FLUX_SHIFT",
    ),
    Word(20, "GAP_OFFSET", "q15", "output at zero flux", -32767, 32767, axis="gap", of="demand"),
    Word(
        21,
        "GAP_BIAS",
        "weight",
        "current at zero flux and zero field",
        -32767,
        32767,
        axis="gap",
        of="current",
        shift="CURRENT_SHIFT",
    ),
    Word(
        22,
        "GAP_FLUX_ARM",
        "weight",
        "current for a flux of 1.0",
        -32767,
        32767,
        axis="gap",
        of="current",
        shift="CURRENT_SHIFT",
    ),
    Word(
        23,
        "GAP_FIELD_ARM",
        "weight",
        "current for a field of 1.0",
        1,
        32767,
        axis="gap",
        of="current",
        shift="CURRENT_SHIFT",
    ),
)

START = (
    Word(24, "CONDITION_CYCLES", "integer", "start-up: triangles of current", 0, 64),
    Word(25, "CONDITION_TICKS", "integer", "start-up: ticks of one ramp", 2, 32767),
)

ROOT = (
    Word(26, "ROOT_KNEE", "integer", "below 2^(-2*this) of full scale the root is straight", 2, 8),
)

LAG = (
    Word(
        27,
        "GAP_LAG_ARM",
        "weight",
        "current for a flux that rises by 1.0 in a tick",
        0,
        32767,
        axis="gap",
        of="current",
        shift="CURRENT_SHIFT",
    ),
)

FULL = (
    Word(32, "FULL_AIR", "weight", "flux of a field of 1.0 without iron", 1, 32767, factor=4.0),
    Word(33, "FULL_REVERSIBLE", "q15", "reversible fraction c", 0, 32767),
    Word(34, "FULL_PLAY", "q15", "half-width of the play, in fields of 1.0", 0, 32767),
    Word(
        35,
        "FULL_RATE",
        "weight",
        "octaves forgotten in a field of 1.0",
        1,
        32767,
        factor=16.0,
        shift="FULL_RATE_SHIFT",
    ),
    Word(36, "FULL_RATE_SHIFT", "integer", "exponent of the rate", 0, 12),
    Word(37, "FULL_STEEPNESS", "q8", "field of 1.0 over the pinning", 1, 32767),
    Word(38, "FULL_ITERATIONS", "integer", "evaluations of a solve", 2, 16),
    Word(39, "FULL_CURVE_SEGMENTS", "integer", "the curve has 2^this segments", 3, 9),
    Word(40, "FULL_CURVE", "q15", "anhysteretic magnetisation", 0, 32767, axis="field"),
    Word(
        41,
        "FULL_BRANCH",
        "q15",
        "ascending branch of the pinned part",
        -32767,
        32767,
        axis="field, both signs",
    ),
    Word(42, "FULL_INVERSE_SEGMENTS", "integer", "the inverse has 2^this segments", 3, 9),
    Word(
        43,
        "FULL_INVERSE",
        "q15",
        "field of an anhysteretic magnetisation",
        0,
        32767,
        axis="magnetisation",
    ),
)

SIMPLE = (
    Word(
        32,
        "SIMPLE_RATE",
        "weight",
        "distance travelled for a flux of 1.0",
        1,
        32767,
        factor=8.0,
        shift="SIMPLE_RATE_SHIFT",
    ),
    Word(33, "SIMPLE_RATE_SHIFT", "integer", "exponent of the rate", 0, 12),
    Word(
        34,
        "SIMPLE_HOLD",
        "weight",
        "change of the bounded state for a flux of 1.0 while held",
        1,
        32767,
        shift="SIMPLE_HOLD_SHIFT",
    ),
    Word(35, "SIMPLE_HOLD_SHIFT", "integer", "exponent of the hold", 0, 12),
    Word(36, "SIMPLE_REST", "q15", "1 - nu of the closed form", 1, 32767),
    Word(37, "SIMPLE_ITERATIONS", "integer", "evaluations of a commit", 2, 16),
)

CLOSED = (
    Word(
        38, "SIMPLE_OCTAVES", "integer", "the curve reaches over so many octaves of distance", 4, 14
    ),
    Word(39, "SIMPLE_SEGMENTS", "integer", "2^this segments in each octave", 2, 6),
    Word(40, "SIMPLE_CURVE", "q15", "bounded state 1 - v", 0, 32767, axis="distance"),
)

EULER = (Word(41, "EULER_SUBSTEPS", "integer", "explicit Euler steps a sample", 1, 16),)

BAND = (
    Word(
        42,
        "SIMPLE_BAND",
        "weight",
        "largest reversal of the flux that does not begin a new path",
        0,
        32767,
    ),
)

CELLS = (
    Word(32, "CELLS_AIR", "weight", "flux of a field of 1.0 without iron", 1, 32767, factor=4.0),
    Word(33, "CELLS_COUNT", "integer", "plays, beside the one without width", 1, 12),
    Word(
        34,
        "CELLS_SEGMENTS",
        "integer",
        "a row has 2^this segments on each side of zero up to the zone",
        2,
        8,
    ),
    Word(
        35,
        "CELLS_ZONE",
        "integer",
        "the zone ends at a field of 2^-this; beyond, segments are 2^this times as wide",
        0,
        5,
    ),
    Word(
        36,
        "CELLS_THRESHOLDS",
        "q15",
        "half-widths of the plays, in fields of 1.0, rising",
        1,
        32767,
        axis="play",
    ),
    Word(
        37,
        "CELLS_ROWS",
        "q15",
        "magnetisation of the plays that move",
        -32767,
        32767,
        axis="moving plays",
    ),
)

SOLID = (
    Word(
        38, "SOLID_LAYERS", "integer", "layers, 2 to 4; 0: thin iron, and 0 all that follows", 0, 4
    ),
    Word(
        39,
        "SOLID_HOLD",
        "weight",
        "field from layer to layer for a flux of 1.0 more than a tick before",
        0,
        32767,
        shift="SOLID_HOLD_SHIFT",
    ),
    Word(40, "SOLID_HOLD_SHIFT", "integer", "exponent of it", 0, 15),
    Word(
        41,
        "SOLID_OWN",
        "weight",
        "field of a flux of 1.0 in its layer, beside that of the law",
        -32767,
        0,
        factor=4.0,
    ),
    Word(42, "SOLID_SURFACE", "q15", "share of the first layer in the section", 0, 32767),
    Word(
        43,
        "SOLID_LAMINATED",
        "q15",
        "share of the path in which the field is the same throughout",
        0,
        32767,
    ),
)

PLAY = (
    Word(10, "PLAY_DEMAND_LOW", "q15", "demand of the first column", -32767, 0, of="demand"),
    Word(11, "PLAY_CURRENT_LOW", "q15", "lowest current", -32767, 32767, of="current"),
    Word(12, "PLAY_CURRENT_HIGH", "q15", "highest current", -32767, 32767, of="current"),
    Word(
        13, "PLAY_FORCE_SEGMENTS", "integer", "tables have 2^this segments along the demand", 0, 8
    ),
    Word(14, "PLAY_GAP_SEGMENTS", "integer", "tables have 2^this segments over the gap", 0, 6),
    Word(
        15,
        "PLAY_STEEPNESS",
        "weight",
        "1/(4*radius of the play), per current of 1.0",
        16384,
        32767,
        shift="PLAY_SHIFT",
    ),
    Word(16, "PLAY_SHIFT", "integer", "exponent of the steepness", 0, 9),
    Word(
        17,
        "PLAY_CURRENT",
        "q15",
        "current without the play",
        -32767,
        32767,
        axis="demand and gap",
        of="current",
    ),
    Word(
        18,
        "PLAY_HALF",
        "q15",
        "half-width of the loop",
        0,
        32767,
        axis="demand and gap",
        of="current",
    ),
)

SCALE = (
    Word(48, "SCALE_DEMAND", "single", "demand of 1.0", 0, 65535, unit="output", size=2),
    Word(50, "SCALE_CURRENT", "single", "current of 1.0", 0, 65535, unit="input", size=2),
    Word(52, "SCALE_GAP_LOW", "single", "gap of 0", 0, 65535, size=2),
    Word(54, "SCALE_GAP_HIGH", "single", "gap of 1.0", 0, 65535, size=2),
    Word(56, "SCALE_RATE", "single", "ticks a second of the start-up", 0, 65535, unit="Hz", size=2),
    Word(58, "SCALE_UNITS", "integer", "units of demand + 16*current + 256*gap", 0, 32767),
)

MEMORY = (
    Word(60, "UNIT_FIELD", "single", "field of a field of 1.0", 0, 65535, unit="A/m", size=2),
)

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
