"""Test that a parameter block is accepted only if every word of it is valid."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from anhyst._core import FixedCompensator
from anhyst.compensate.block import Block, Kind
from anhyst.support import block_layout as layout
from anhyst.support.block_layout import WORD_INDEX_OF_KIND
from tests.actuators import compiled

KINDS: tuple[Kind, ...] = ("full", "simplified", "euler")
Words = NDArray[Any]

GAP_TABLES = {"GAP_GAIN": 1, "GAP_OFFSET": -32767, "GAP_BIAS": -32767, "GAP_FLUX_ARM": 0, "GAP_FIELD_ARM": 1}
"""Smallest entry of each gap table; flux coefficients of the full law may be negative."""

RISING: dict[Kind, dict[str, int]] = {
    "full": {"FULL_CURVE": 0, "FULL_BRANCH": -32767, "FULL_INVERSE": 0},
    "simplified": {"SIMPLE_CURVE": 0},
    "euler": {},
}
"""Smallest first entry of each table that must not decrease."""

COMMON = {
    "POWER": (1, 2),
    "CURRENT_SHIFT": (0, 8),
    "FLUX_LIMIT": (1, 16384),
    "FLUX_SHIFT": (0, 6),
    "GAP_SEGMENTS": (0, 6),
    "CONDITION_CYCLES": (0, 64),
    "CONDITION_TICKS": (2, 32767),
    "ROOT_KNEE": (2, 8),
}
SIMPLE = {
    "SIMPLE_RATE": (1, 32767),
    "SIMPLE_RATE_SHIFT": (0, 12),
    "SIMPLE_HOLD": (1, 32767),
    "SIMPLE_HOLD_SHIFT": (0, 12),
    "SIMPLE_REST": (1, 32767),
    "SIMPLE_ITERATIONS": (2, 16),
}
RANGES: dict[Kind, dict[str, tuple[int, int]]] = {
    "full": {
        "FULL_AIR": (1, 32767),
        "FULL_REVERSIBLE": (0, 32767),
        "FULL_PLAY": (0, 32767),
        "FULL_RATE": (1, 32767),
        "FULL_RATE_SHIFT": (0, 12),
        "FULL_STEEPNESS": (1, 32767),
        "FULL_ITERATIONS": (2, 16),
        "FULL_CURVE_SEGMENTS": (3, 9),
        "FULL_INVERSE_SEGMENTS": (3, 9),
    },
    "simplified": {**SIMPLE, "SIMPLE_OCTAVES": (4, 14), "SIMPLE_SEGMENTS": (2, 6)},
    "euler": {**SIMPLE, "EULER_SUBSTEPS": (1, 16)},
}


def sealed(words: Words) -> Words:
    """Return a copy with a valid checksum, in any format."""
    sound = words.copy()
    length = int(words[4]) if 8 <= words[4] <= words.size else words.size
    crc = zlib.crc32(np.concatenate([sound[:6], sound[8:length]]).tobytes())
    halves = np.array([crc & 0xFFFF, crc >> 16])
    sound[6:8] = halves.astype(np.uint16).view(np.int16) if words.dtype == np.int16 else halves
    return sound


def changed(block: Block, at: int, value: int) -> Words:
    """Return a block with one replaced word and a valid checksum."""
    words = block.words.copy()
    words[at] = value
    return sealed(words)


def taken(kind: Kind, words: Words) -> bool:
    try:
        FixedCompensator(kind, words)
    except ValueError:
        return False
    return True


@pytest.mark.parametrize("kind", KINDS)
def test_parameter_words_do_not_overlap_and_precede_the_tables(kind: Kind) -> None:
    end = 0
    for word in (*layout.HEAD_WORDS, *layout.BODY_WORDS[kind]):
        assert word.index >= end, word.name
        end = word.index + word.size
        assert -32768 <= word.low <= word.high <= 65535
        assert word.doc
    assert end <= layout.MIN_BLOCK_WORDS < layout.MAX_BLOCK_WORDS


@pytest.mark.parametrize("kind", KINDS)
def test_a_valid_block_is_accepted_and_its_checksum_agrees_with_zlib(kind: Kind) -> None:
    block = compiled(kind)
    assert taken(kind, block.words)
    assert np.array_equal(sealed(block.words), block.words)


@pytest.mark.parametrize("kind", KINDS)
def test_a_block_of_another_make_is_refused(kind: Kind) -> None:
    block = compiled(kind)
    for at, value in ((0, 0x6E42), (1, 0x7969), (2, 1), (3, 4), (3, block.words[3] % 3 + 1)):
        assert not taken(kind, changed(block, at, value))
    assert not any(taken(other, block.words) for other in KINDS if other != kind)


@pytest.mark.parametrize("kind", KINDS)
def test_a_length_that_does_not_fit_is_refused(kind: Kind) -> None:
    block = compiled(kind)
    size = block.words.size
    for length in (-1, 0, 7, 63, size - 1, size + 1, 1025, 32767):
        assert not taken(kind, changed(block, 4, length))
    for capacity in (0, 1, 63, size - 1):
        assert not taken(kind, block.words[:capacity].copy())
    room = np.concatenate([block.words, np.full(9, 77, dtype=np.int16)])
    assert taken(kind, room)  # the words after the block are not part of it


@pytest.mark.parametrize("kind", KINDS)
def test_words_outside_their_range_are_refused_and_the_limits_accepted(kind: Kind) -> None:
    block = compiled(kind)
    for name, (low, high) in (COMMON | RANGES[kind]).items():
        at = WORD_INDEX_OF_KIND[kind][name]
        for value in (low - 1, high + 1, -32768):
            if value <= 32767 and not low <= value <= high:
                assert not taken(kind, changed(block, at, value)), (name, value)
        if not name.endswith(("SEGMENTS", "OCTAVES")):  # these words set the lengths of tables
            assert taken(kind, changed(block, at, low)), (name, low)
            assert taken(kind, changed(block, at, high)), (name, high)


@pytest.mark.parametrize("kind", KINDS)
def test_limits_the_wrong_way_round_are_refused(kind: Kind) -> None:
    block = compiled(kind)
    for name in ("DEMAND", "CURRENT"):
        low, high = (WORD_INDEX_OF_KIND[kind][f"{name}_LOW"], WORD_INDEX_OF_KIND[kind][f"{name}_HIGH"])
        assert not taken(kind, changed(block, low, int(block.words[high]) + 1))
        assert taken(kind, changed(block, low, int(block.words[high])))


def all_tables(kind: Kind) -> Iterator[tuple[str, int]]:
    yield from GAP_TABLES.items()
    yield from RISING[kind].items()


@pytest.mark.parametrize("kind", KINDS)
def test_a_table_outside_the_block_is_refused(kind: Kind) -> None:
    block = compiled(kind)
    size = block.words.size
    for name, _ in all_tables(kind):
        entries = block.tables[name][1]
        at = WORD_INDEX_OF_KIND[kind][name]
        for first in (-32768, -1, 0, 47, size - entries + 1, size, 32767):
            assert not taken(kind, changed(block, at, first)), (name, first)


ENDS = [
    ("full", "GAP_SEGMENTS", "GAP_GAIN"),
    ("simplified", "GAP_SEGMENTS", "GAP_GAIN"),
    ("euler", "GAP_SEGMENTS", "GAP_GAIN"),
    ("full", "FULL_INVERSE_SEGMENTS", "FULL_INVERSE"),
    ("simplified", "SIMPLE_OCTAVES", "SIMPLE_CURVE"),
    ("simplified", "SIMPLE_SEGMENTS", "SIMPLE_CURVE"),
]


@pytest.mark.parametrize(("kind", "segments", "table"), ENDS)
def test_more_segments_than_the_block_has_room_for_are_refused(kind: Kind, segments: str, table: str) -> None:
    block = compiled(kind)
    first = block.words.size - block.tables[table][1]
    words = changed(block, WORD_INDEX_OF_KIND[kind][table], first)
    assert taken(kind, words)  # the table ends with the block
    words[WORD_INDEX_OF_KIND[kind][segments]] += 1
    assert not taken(kind, sealed(words))


@pytest.mark.parametrize("kind", KINDS)
def test_a_table_with_an_entry_too_low_or_too_steep_is_refused(kind: Kind) -> None:
    block = compiled(kind, "scaling")
    full = {"GAP_FLUX_ARM": -32767} if kind == "full" else {}
    for name, smallest in (GAP_TABLES | full).items():
        first, entries = block.tables[name]
        for place in (0, entries // 2, entries - 1):
            assert not taken(kind, changed(block, first + place, smallest - 1)), (name, place)
        if smallest < 0:
            words = block.words.copy()
            words[first : first + 2] = -20000, 20000
            assert not taken(kind, sealed(words)), name
            words[first : first + 2] = 20000, -20000
            assert not taken(kind, sealed(words)), name


def test_the_full_law_accepts_a_negative_flux_coefficient_if_the_current_rises() -> None:
    block = compiled("full", "circuit")
    flux_arm, field_arm = (block.table(f"GAP_{arm}_ARM").astype(float) for arm in ("FLUX", "FIELD"))
    assert flux_arm.min() < 0.0 < flux_arm.max()
    segments = 2.0 ** block.integer("FULL_CURVE_SEGMENTS")
    share = block.integer("FULL_REVERSIBLE") / 2**15
    reversible = np.diff(block.table("FULL_CURVE").astype(float))
    pinned = np.diff(block.table("FULL_BRANCH").astype(float))[int(segments) :]
    steepest = (share * reversible + (1.0 - share) * pinned).max() * segments / 2**15
    largest = field_arm / (4.0 * block.integer("FULL_AIR") / 2**16 + steepest)
    first, entries = block.tables["GAP_FLUX_ARM"]
    for place in (0, entries // 2, entries - 1):
        for part, valid in ((0.97, True), (1.03, False)):
            words = changed(block, first + place, -round(part * largest[place]))
            assert taken("full", words) == valid, (place, part)


@pytest.mark.parametrize("kind", ["full", "simplified"])
def test_a_falling_table_is_refused(kind: Kind) -> None:
    block = compiled(kind)
    for name, smallest in RISING[kind].items():
        first, entries = block.tables[name]
        steepest = first + int(np.argmax(np.diff(block.table(name))))
        for place in (steepest, first + entries - 1):
            low = int(block.words[place - 1]) - 1
            assert not taken(kind, changed(block, place, low)), (name, place)
        if smallest - 1 >= -32768:
            assert not taken(kind, changed(block, first, smallest - 1)), name


@pytest.mark.parametrize("kind", KINDS)
def test_every_single_flipped_bit_is_refused(kind: Kind) -> None:
    block = compiled(kind)
    for at in range(block.words.size):
        for bit in range(16):
            words = block.words.copy()
            words.view(np.uint16)[at] ^= 1 << bit
            assert not taken(kind, words), (at, bit)


@pytest.mark.parametrize("kind", KINDS)
def test_a_refused_block_leaves_the_old_one_in_use(kind: Kind) -> None:
    block = compiled(kind)
    twin = FixedCompensator(kind, block.words)
    before = twin.solve_q31(700_000_000, 0)
    broken = block.words.copy()
    broken[block.words.size - 1] ^= 1
    with pytest.raises(ValueError, match="not valid"):
        twin.swap(broken)
    assert twin.solve_q31(700_000_000, 0) == before
