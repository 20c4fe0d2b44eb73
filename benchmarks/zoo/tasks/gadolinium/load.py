"""Read the major and the middle loops of gadolinium at six temperatures."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from ...records import FloatArray, Record
from ...task import MissingData

TEMPERATURES_C = (-38, -25, -15, -5, 5, 15)
LOOPS = {"major": "major", "middle": "mid"}
MAX_BLOCKS_PER_LOOP = 300


def load(folder: Path) -> list[Record]:
    """Return the first sample of each loop, and the medians of equal blocks of the others.

    Raises
    ------
    MissingData
        The folder does not contain the measurement.
    """
    records = []
    for temperature in TEMPERATURES_C:
        file = folder / "gadolinium_temperature" / f"gd_T{temperature:+04d}C.csv"
        if not file.is_file():
            raise MissingData(f"{file} does not exist; set ANHYST_DATA to the folder of measurements")
        with file.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
        for name, key in LOOPS.items():
            samples = np.array(
                [[float(row["H_A_per_m"]), float(row["B_T"])] for row in rows if row["loop"] == key]
            )
            H, B = _take_medians(samples).T
            records.append(
                Record(
                    f"{name}-{temperature + 273}K",
                    H,
                    B,
                    np.full(H.size, temperature + 273.15),
                    history="demagnetised",
                )
            )
    return records


def _take_medians(samples: FloatArray) -> FloatArray:
    """Return the first sample, and the medians of field and flux density in equal blocks."""
    size = math.ceil(len(samples) / MAX_BLOCKS_PER_LOOP)
    blocks = [samples[start : start + size] for start in range(1, len(samples), size)]
    return np.array([samples[0], *(np.median(block, axis=0) for block in blocks)])
