"""The parameter block of a map with one play, in every number format."""

from __future__ import annotations

import zlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.block import single_words
from anhyst.support.block_layout import KINDS, LAYOUT, LEAST_WORDS, MAGIC, PLACES, UNITS
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray

Words = NDArray[np.int16] | NDArray[np.float32] | NDArray[np.float64]

_TYPES: Mapping[NumberFormat, str] = {"fixed": "<u2", "f32": "<f4", "f64": "<f8"}

_UNITS = UNITS.index("N") + 16 * UNITS.index("A") + 256 * UNITS.index("m")


def pack_play(
    number_format: NumberFormat,
    words: Mapping[str, float],
    tables: Mapping[str, NDArray[np.int16] | FloatArray],
    model_hash: int,
) -> Words:
    """Return a block of words by their names in the layout, with checksum.

    A word of a floating-point block is the value that the fixed-point word stands for. A word that
    begins with ``SCALE`` is a single: two words in fixed point, one in floating point.
    """
    row = np.zeros(LEAST_WORDS)
    for word, halves in (("MAGIC", MAGIC), ("MODEL", (model_hash & 0xFFFF, model_hash >> 16))):
        row[PLACES[word] : PLACES[word] + 2] = halves
    end = LEAST_WORDS
    named: dict[str, float] = {"LAYOUT": LAYOUT, "KIND": KINDS["play"], "SCALE_UNITS": _UNITS}
    for name, values in tables.items():
        named[name], end = end, end + values.size
    for name, value in {**words, **named, "LENGTH": end}.items():
        at, is_single = PLACES[name], name.startswith("SCALE") and name not in named
        if is_single and number_format == "fixed":
            row[at : at + 2] = single_words(value)
        else:
            row[at] = value
    row = np.concatenate([row, *(values.ravel() for values in tables.values())])
    if number_format == "fixed":
        row %= 2**16
    packed = row.astype(_TYPES[number_format])
    crc = PLACES["CRC"]
    checksum = zlib.crc32(np.delete(packed, [crc, crc + 1]).tobytes())
    packed[crc : crc + 2] = checksum & 0xFFFF, checksum >> 16
    return packed.view("<i2").astype(np.int16) if number_format == "fixed" else packed
