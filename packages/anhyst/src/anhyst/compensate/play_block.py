"""Pack a current map with one play operator into a parameter block, in every number format."""

from __future__ import annotations

import zlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.block import split_single
from anhyst.support.block_layout import (
    KINDS,
    LAYOUT_VERSION,
    MAGIC,
    MIN_BLOCK_WORDS,
    SIGNAL_UNITS,
    WORD_INDEX,
)
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray

Words = NDArray[np.int16] | NDArray[np.float32] | NDArray[np.float64]

_WORD_TYPES: Mapping[NumberFormat, str] = {"fixed": "<u2", "f32": "<f4", "f64": "<f8"}

_UNIT_CODES = SIGNAL_UNITS.index("N") + 16 * SIGNAL_UNITS.index("A") + 256 * SIGNAL_UNITS.index("m")


def pack_play(
    number_format: NumberFormat,
    words: Mapping[str, float],
    tables: Mapping[str, NDArray[np.int16] | FloatArray],
    model_hash: int,
) -> Words:
    """Return a parameter block from words by name and tables, with checksum.

    A word of a floating-point block contains the value that the fixed-point word represents. A word
    whose name begins with ``SCALE`` has single precision: two words in fixed point, one in floating
    point.
    """
    row = np.zeros(MIN_BLOCK_WORDS)
    for word, halves in (("MAGIC", MAGIC), ("MODEL", (model_hash & 0xFFFF, model_hash >> 16))):
        row[WORD_INDEX[word] : WORD_INDEX[word] + 2] = halves
    end = MIN_BLOCK_WORDS
    indices: dict[str, float] = {"LAYOUT": LAYOUT_VERSION, "KIND": KINDS["play"], "SCALE_UNITS": _UNIT_CODES}
    for name, values in tables.items():
        indices[name], end = end, end + values.size
    for name, value in {**words, **indices, "LENGTH": end}.items():
        index, is_single = WORD_INDEX[name], name.startswith("SCALE") and name not in indices
        if is_single and number_format == "fixed":
            row[index : index + 2] = split_single(value)
        else:
            row[index] = value
    row = np.concatenate([row, *(values.ravel() for values in tables.values())])
    if number_format == "fixed":
        row %= 2**16
    packed_row = row.astype(_WORD_TYPES[number_format])
    crc = WORD_INDEX["CRC"]
    checksum = zlib.crc32(np.delete(packed_row, [crc, crc + 1]).tobytes())
    packed_row[crc : crc + 2] = checksum & 0xFFFF, checksum >> 16
    return packed_row.view("<i2").astype(np.int16) if number_format == "fixed" else packed_row
