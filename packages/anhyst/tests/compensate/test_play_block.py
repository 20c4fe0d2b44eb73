"""Test the parameter block of a map with one play: words in every format, and damage."""

from __future__ import annotations

import zlib

import numpy as np
import pytest

from anhyst._core import FixedForceController, ForceController, ForceControllerF32
from anhyst.compensate.current_map import CurrentMap, PlayMap
from anhyst.compensate.play_block import Words
from anhyst.support.block_layout import KINDS, WORD_INDEX
from anhyst.support.block_words import Scales
from anhyst.support.kinds import NumberFormat


def start(
    number_format: NumberFormat, words: Words
) -> FixedForceController | ForceControllerF32 | ForceController:
    """Start the map with a block."""
    if number_format == "fixed":
        return FixedForceController.play(words.astype(np.int16))
    if number_format == "f32":
        return ForceControllerF32.play(words.astype(np.float32))
    return ForceController.play(words.astype(np.float64))


def a_play() -> PlayMap:
    force, gap = np.linspace(0.0, 256.0, 5), np.array([[1.0], [1.4], [1.9]])
    entries = 0.2 + gap * np.sqrt(force / 256.0)
    table = CurrentMap(entries, Scales(256.0, 4.0, 3e-4, 6e-4), (0.0, 3.0))
    return PlayMap(table, np.full((3, 5), 0.05), 0.16)


@pytest.mark.parametrize("number_format", ["fixed", "f32", "f64"])
def test_block_states_its_kind_and_values_and_is_accepted(number_format: NumberFormat) -> None:
    words = a_play().block(number_format, 0x12345678)
    assert words[WORD_INDEX["KIND"]] == KINDS["play"]
    assert words[WORD_INDEX["LENGTH"]] == words.size
    assert words[WORD_INDEX["MODEL"]] == 0x5678
    current = words[int(words[WORD_INDEX["PLAY_CURRENT"]])]
    assert current == pytest.approx(0.2 * (32768.0 / 4.0 if number_format == "fixed" else 1.0), 1e-2)
    kept = np.delete(words, [WORD_INDEX["CRC"], WORD_INDEX["CRC"] + 1])
    crc = zlib.crc32(kept.astype(kept.dtype.newbyteorder("<")).tobytes())
    low, high = (int(word) & 0xFFFF for word in words[WORD_INDEX["CRC"] :][:2])
    assert low | high << 16 == crc
    start(number_format, words)


@pytest.mark.parametrize("number_format", ["fixed", "f32", "f64"])
def test_block_with_a_damaged_word_is_refused(number_format: NumberFormat) -> None:
    words = a_play().block(number_format)
    for at in range(words.size):
        damaged: Words = words.copy()
        damaged[at] += 1
        with pytest.raises(ValueError, match="not valid"):
            start(number_format, damaged)
    with pytest.raises(ValueError, match="not valid"):
        start(number_format, words[:-1])


def test_formats_give_the_same_currents() -> None:
    play = a_play()
    drives = (
        ForceController.play(play.block("f64").astype(np.float64)),
        ForceControllerF32.play(play.block("f32").astype(np.float32)),
    )
    rng = np.random.default_rng(5)
    for demand, gap in zip(
        rng.uniform(0.0, 250.0, 300).tolist(), rng.uniform(3e-4, 6e-4, 300).tolist(), strict=True
    ):
        currents = [drive.solve(demand, gap, np.nan) for drive in drives]
        assert currents[1] == pytest.approx(currents[0], abs=2e-5)
        forces = [drive.commit(currents[0], gap) for drive in drives]
        assert forces == pytest.approx([demand, demand], abs=2e-3)
