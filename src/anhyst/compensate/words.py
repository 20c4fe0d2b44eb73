"""The one table of the words of a parameter block: format, meaning, and what a unit is worth.

The comments of the generated parameters, the manifest and ``core/include/anhyst/layout.h`` say
the same thing; a test holds them together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from anhyst.compensate.block import CRC_AT, KINDS, LAYOUT, MAGIC, WORDS, Block, Kind

Format = Literal["q14", "q15", "q8", "weight", "integer", "unsigned", "single"]

ONES: dict[Format, float] = {
    "q14": 16384.0,
    "q15": 32768.0,
    "q8": 256.0,
    "weight": 65536.0,
    "integer": 1.0,
    "unsigned": 1.0,
    "single": 1.0,
}
"""The word that means 1.0 in each format."""


@dataclass(frozen=True, slots=True)
class Unit:
    """What 1.0 of a word is worth, and in what unit; ``low`` is what 0 is worth."""

    scale: float = 1.0
    name: str = ""


@dataclass(frozen=True, slots=True)
class Names:
    """Units of the signals of a model, for the texts."""

    output: str
    input: str


Physical = Callable[[Block, Names], Unit]


@dataclass(frozen=True, slots=True)
class Word:
    """One word of the block.

    Parameters
    ----------
    name : str
        As in ``layout.h``, without ``ANHYST_WORD_``.
    format : str
        Of the word; of the entries, if it names a table.
    doc : str
        What it is.
    low, high : int
        Range that the controller accepts; of the entries, if it names a table.
    physical : callable or None
        What 1.0 is worth; None for a pure number. A single is worth what it is.
    axis : str
        For a table: what it runs over, ``"gap"``, ``"field"``, ``"field, both signs"``,
        ``"magnetisation"`` or ``"distance"``.
    """

    name: str
    format: Format
    doc: str
    low: int
    high: int
    physical: Physical | None = None
    axis: str = ""

    @property
    def size(self) -> int:
        """How many words it takes; a table is told by its first."""
        return 2 if self.format == "single" else 1

    def place(self, kind: Kind) -> int:
        """Position in a block of this kind."""
        return WORDS[kind][self.name]


def _demand(block: Block, names: Names) -> Unit:
    return Unit(block.scales.demand, names.output)


def _current(block: Block, names: Names) -> Unit:
    return Unit(block.scales.current, names.input)


def _inner_current(block: Block, names: Names) -> Unit:
    return Unit(block.scales.current * 2.0 ** block.word("CURRENT_SHIFT"), names.input)


def _flux_gain(block: Block, _: Names) -> Unit:
    return Unit(2.0 ** block.word("FLUX_SHIFT"))


def _shifted(name: str, factor: float) -> Physical:
    return lambda block, _: Unit(factor * 2.0 ** block.word(name))


def _times(factor: float) -> Physical:
    return lambda _block, _: Unit(factor)


def _in(name: str) -> Physical:
    return lambda _block, _: Unit(1.0, name)


_INT16 = 32767
_WHOLE = (0, 65535)

HEAD = (
    Word("MAGIC", "unsigned", "marks the start of a block, two words", *MAGIC),
    Word("LAYOUT", "integer", "of the words; the code must know it", LAYOUT, LAYOUT),
    Word("KIND", "integer", "1 full, 2 simplified, 3 Euler", 1, 3),
    Word("LENGTH", "integer", "of the whole block, words", 48, 1024),
    Word("GENERATION", "unsigned", "chosen by whoever sends the block", 0, 65535),
    Word("CRC", "unsigned", "CRC-32 of all other words, low half, high half", 0, 65535),
    Word("MODEL", "unsigned", "first 32 bits of the model's hash, low half, high half", 0, 65535),
)
"""The head, the same in every kind; positions in :data:`HEAD_PLACES`."""

HEAD_PLACES = {
    "MAGIC": 0,
    "LAYOUT": 2,
    "KIND": 3,
    "LENGTH": 4,
    "GENERATION": 5,
    "CRC": CRC_AT,
    "MODEL": 8,
}

COMMON = (
    Word("POWER", "integer", "the output goes with this power of the flux", 1, 2),
    Word("DEMAND_LOW", "q15", "smallest demand", -_INT16, _INT16, _demand),
    Word("DEMAND_HIGH", "q15", "largest demand", -_INT16, _INT16, _demand),
    Word("CURRENT_LOW", "q15", "smallest current", -_INT16, _INT16, _current),
    Word("CURRENT_HIGH", "q15", "largest current", -_INT16, _INT16, _current),
    Word("CURRENT_SHIFT", "integer", "1.0 of the inner current is 2^this of full scale", 0, 8),
    Word("FLUX_LIMIT", "q14", "largest flux solved for, of that of saturated iron", 1, 16384),
    Word("FLUX_SHIFT", "integer", "flux = root*gain*2^this", 0, 6),
    Word("GAP_SEGMENTS", "integer", "tables over the gap have 2^this segments", 0, 6),
    Word("GAP_GAIN", "weight", "flux at full-scale demand", 1, _INT16, _flux_gain, "gap"),
    Word("GAP_OFFSET", "q15", "output at zero flux", -_INT16, _INT16, _demand, "gap"),
    Word(
        "GAP_BIAS",
        "weight",
        "current at zero flux and zero field",
        -_INT16,
        _INT16,
        _inner_current,
        "gap",
    ),
    Word(
        "GAP_FLUX_ARM",
        "weight",
        "current for a flux of 1.0",
        -_INT16,
        _INT16,
        _inner_current,
        "gap",
    ),
    Word("GAP_FIELD_ARM", "weight", "current for a field of 1.0", 1, _INT16, _inner_current, "gap"),
    Word("CONDITION_CYCLES", "integer", "start-up: triangles of current", 0, 64),
    Word("CONDITION_TICKS", "integer", "start-up: ticks of one ramp", 2, _INT16),
    Word("ROOT_KNEE", "integer", "below 2^(-2*this) of full scale the root is straight", 2, 8),
)

FULL = (
    Word("FULL_AIR", "weight", "flux of a field of 1.0 without iron", 1, _INT16, _times(4.0)),
    Word("FULL_REVERSIBLE", "q15", "reversible fraction c", 0, _INT16),
    Word("FULL_PLAY", "q15", "half-width of the play, in fields of 1.0", 0, _INT16),
    Word(
        "FULL_RATE",
        "weight",
        "octaves forgotten in a field of 1.0",
        1,
        _INT16,
        _shifted("FULL_RATE_SHIFT", 16.0),
    ),
    Word("FULL_RATE_SHIFT", "integer", "exponent of the rate", 0, 12),
    Word("FULL_STEEPNESS", "q8", "field of 1.0 over the pinning", 1, _INT16),
    Word("FULL_ITERATIONS", "integer", "evaluations of a solve", 2, 16),
    Word("FULL_CURVE_SEGMENTS", "integer", "the curve has 2^this segments", 3, 9),
    Word("FULL_CURVE", "q15", "anhysteretic magnetisation", 0, _INT16, axis="field"),
    Word(
        "FULL_BRANCH",
        "q15",
        "ascending branch of the pinned part",
        -_INT16,
        _INT16,
        axis="field, both signs",
    ),
    Word("FULL_INVERSE_SEGMENTS", "integer", "the inverse has 2^this segments", 3, 9),
    Word(
        "FULL_INVERSE",
        "q15",
        "field of an anhysteretic magnetisation",
        0,
        _INT16,
        axis="magnetisation",
    ),
)

SIMPLE = (
    Word(
        "SIMPLE_RATE",
        "weight",
        "distance travelled for a flux of 1.0",
        1,
        _INT16,
        _shifted("SIMPLE_RATE_SHIFT", 8.0),
    ),
    Word("SIMPLE_RATE_SHIFT", "integer", "exponent of the rate", 0, 12),
    Word(
        "SIMPLE_HOLD",
        "weight",
        "change of the bounded state for a flux of 1.0 while held",
        1,
        _INT16,
        _shifted("SIMPLE_HOLD_SHIFT", 1.0),
    ),
    Word("SIMPLE_HOLD_SHIFT", "integer", "exponent of the hold", 0, 12),
    Word("SIMPLE_REST", "q15", "1 - nu of the closed form", 1, _INT16),
    Word("SIMPLE_ITERATIONS", "integer", "evaluations of a commit", 2, 16),
)

CLOSED = (
    Word("SIMPLE_OCTAVES", "integer", "the curve reaches over so many octaves of distance", 4, 14),
    Word("SIMPLE_SEGMENTS", "integer", "2^this segments in each octave", 2, 6),
    Word("SIMPLE_CURVE", "q15", "bounded state 1 - v", 0, _INT16, axis="distance"),
)

EULER = (Word("EULER_SUBSTEPS", "integer", "explicit Euler steps a sample", 1, 16),)

SIGNALS = (
    Word(
        "SCALE_DEMAND", "single", "demand of 1.0", *_WHOLE, lambda _, names: Unit(1, names.output)
    ),
    Word(
        "SCALE_CURRENT", "single", "current of 1.0", *_WHOLE, lambda _, names: Unit(1, names.input)
    ),
    Word("SCALE_GAP_LOW", "single", "gap of 0", *_WHOLE),
    Word("SCALE_GAP_HIGH", "single", "gap of 1.0", *_WHOLE),
    Word("SCALE_RATE", "single", "ticks a second of the start-up", *_WHOLE, _in("Hz")),
    Word("SCALE_UNITS", "integer", "units of demand + 16*current + 256*gap", 0, _INT16),
)
FIELDS = (Word("UNIT_FIELD", "single", "field of a field of 1.0", *_WHOLE, _in("A/m")),)

BODY: dict[Kind, tuple[Word, ...]] = {
    "full": COMMON + FULL + SIGNALS + FIELDS,
    "simplified": COMMON + SIMPLE + CLOSED + SIGNALS,
    "euler": COMMON + SIMPLE + EULER + SIGNALS,
}
"""Every word of a kind behind the head, in the order of the block."""

KIND_NAMES: dict[int, Kind] = {number: kind for kind, number in KINDS.items()}
