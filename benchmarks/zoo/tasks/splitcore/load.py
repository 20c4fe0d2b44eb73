"""Read the flux-current loops of a split ferrite core at three air gaps."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from ...records import Record
from ...task import MissingData

CYCLES = {"0": (19, 94), "0.125": (17, 133), "0.5": (6, 245)}
"""First and last sample of the complete cycles at each gap in mm, from positive peak to positive peak.

The last cycle at 0 mm is not used: its negative peak is 4 % of the range below the others."""


def load(folder: Path) -> list[Record]:
    """Return the complete cycles at each gap.

    Raises
    ------
    MissingData
        The folder does not contain the measurement.
    """
    file = folder / "ferrite_core_gaps" / "loops_by_gap.csv"
    if not file.is_file():
        raise MissingData(f"{file} does not exist; set ANHYST_DATA to the folder of measurements")
    with file.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    records = []
    for gap, (start, end) in CYCLES.items():
        cycles = [row for row in rows if row["gap_mm"] == gap][start:end]
        records.append(
            Record(
                f"gap-{round(1000 * float(gap))}um",
                np.array([float(row["I_A_scaled"]) for row in cycles]),
                np.array([float(row["U_M_V"]) for row in cycles]),
                np.full(len(cycles), 0.001 * float(gap)),
            )
        )
    return records
