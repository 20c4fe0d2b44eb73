"""The golden vectors of a bundle: inputs and what the compensator has to answer."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anhyst.errors import InputError
from anhyst.verify.protocol import AS_GIVEN, INPUTS, Words

NEEDED = ("demand", "gap", "current")
OUTPUTS = {
    "current": "current",
    "flags": "flags",
    "flux": "flux",
    "output": "output",
    "flux_applied": "applied flux",
    "memory_a": "memory a",
    "memory_b": "memory b",
    "memory_c": "memory c",
}


@dataclass(frozen=True, slots=True)
class GoldenVectors:
    """Inputs and expected outputs, one row a step, from the start on.

    Parameters
    ----------
    inputs : array of uint32, shape (rows, len(INPUTS))
        In that order: demand, gap, how, applied, gap of applied.
    outputs : mapping of arrays of uint32, shape (rows,)
        By the names of a record.
    """

    inputs: Words
    outputs: Mapping[str, Words]


def read_vectors(path: Path) -> GoldenVectors:
    """Read ``vectors.csv``.

    Columns ``demand``, ``gap`` and ``current`` are needed; ``applied`` and ``applied_gap`` stand
    for the solved current and the same gap where they are missing. All are codes in the format of
    the signals.

    Raises
    ------
    InputError
        A column is missing, or a cell is not an integer of 32 bits.
    """
    with path.open(encoding="utf-8", newline="") as stream:
        lines = csv.reader(row for row in stream if not row.startswith("#"))
        names = [name.strip() for name in next(lines, [])]
        rows = list(lines)
    for name in NEEDED:
        if name not in names:
            raise InputError(f"{path}: column '{name}' is missing; run 'anhyst compile' again")
    try:
        table = np.array(rows, dtype=np.int64).reshape(len(rows), len(names))
    except ValueError:
        raise InputError(f"{path}: a cell is not an integer; run 'anhyst compile' again") from None
    if np.any(np.abs(table) > 1 << 31):
        raise InputError(f"{path}: a number is beyond 32 bits; run 'anhyst compile' again")
    columns = {
        name: (table[:, place] & 0xFFFFFFFF).astype(np.uint32) for place, name in enumerate(names)
    }
    inputs = np.empty((len(rows), len(INPUTS)), dtype=np.uint32)
    inputs[:, 0] = columns["demand"]
    inputs[:, 1] = columns["gap"]
    inputs[:, 2] = AS_GIVEN
    inputs[:, 3] = columns.get("applied", columns["current"])
    inputs[:, 4] = columns.get("applied_gap", columns["gap"])
    outputs = {OUTPUTS[name]: columns[name] for name in names if name in OUTPUTS}
    return GoldenVectors(inputs, outputs)
