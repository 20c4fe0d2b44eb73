"""The golden vectors of a bundle: inputs and what has to be answered."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anhyst.compilation.lifting import COLUMNS, INPUTS
from anhyst.support.errors import InputError
from anhyst.verification.protocol import AS_GIVEN, COMPENSATOR, CONTROLLER, RecordForm, Words

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

GIVEN = COLUMNS[:INPUTS]
ANSWERED = {name: name.replace("drive_", "current ") for name in COLUMNS[INPUTS:]}
"""Columns of a controller's vectors, and what they are called in a record."""


@dataclass(frozen=True, slots=True)
class GoldenVectors:
    """Inputs and expected outputs, one row a step, from the start on."""

    inputs: Words  # in the order of the form; shape (rows, n)
    outputs: Mapping[str, Words]  # by the names of a record; shape (rows,)
    form: RecordForm = COMPENSATOR  # of the records


def read_vectors(path: Path, floating: bool) -> GoldenVectors:
    """Read ``vectors.csv``.

    Columns ``demand``, ``gap`` and ``current`` are needed; ``applied`` and ``applied_gap`` stand
    for the solved current and the same gap where they are missing.
    """
    columns = _columns(path, NEEDED, floating)
    inputs = np.empty((len(columns["demand"]), len(COMPENSATOR.inputs)), dtype=np.uint32)
    inputs[:, 0] = columns["demand"]
    inputs[:, 1] = columns["gap"]
    inputs[:, 2] = AS_GIVEN
    inputs[:, 3] = columns.get("applied", columns["current"])
    inputs[:, 4] = columns.get("applied_gap", columns["gap"])
    outputs = {OUTPUTS[name]: columns[name] for name in columns if name in OUTPUTS}
    return GoldenVectors(inputs, outputs)


def read_levitation(path: Path) -> GoldenVectors:
    """Read ``controller.csv``: what a position controller is given and has to answer."""
    columns = _columns(path, (*GIVEN, *ANSWERED), floating=False)
    event = columns["dropped"] << np.uint32(16) | columns["command"]
    inputs = np.stack([*(columns[name] for name in GIVEN[:-2]), event], axis=1)
    outputs = {ANSWERED[name]: columns[name] for name in ANSWERED}
    return GoldenVectors(inputs, outputs, CONTROLLER)


def read_flight(path: Path, form: RecordForm, floating: bool) -> GoldenVectors:
    """Read the vectors of a stage: what its controller was given in flight and has to answer."""
    outputs = form.record[len(form.inputs) :]
    columns = _columns(path, [_header(name) for name in form.record], floating)
    for name in ("command", "flags", "lost", "state") if floating else ():
        columns[name] = columns[name].view(np.float32).astype(np.uint32)
    inputs = np.stack([columns[_header(name)] for name in form.inputs], axis=1)
    return GoldenVectors(inputs, {name: columns[_header(name)] for name in outputs}, form)


def _header(name: str) -> str:
    return name.replace(" ", "_")


def _columns(path: Path, needed: Iterable[str], floating: bool) -> dict[str, Words]:
    """Read a file of vectors."""
    with path.open(encoding="utf-8", newline="") as stream:
        lines = csv.reader(row for row in stream if not row.startswith("#"))
        names = [name.strip() for name in next(lines, [])]
        rows = list(lines)
    if not rows:
        raise InputError(f"{path}: has no rows; run 'anhyst compile' again", code="damaged-vectors")
    for name in needed:
        if name not in names:
            raise InputError(
                f"{path}: column '{name}' is missing; run 'anhyst compile' again",
                code="damaged-vectors",
                key=name,
            )
    try:
        words = _words_of_numbers(rows) if floating else _words_of_codes(rows)
        words = words.reshape(len(rows), len(names))
    except (ValueError, OverflowError) as error:
        what = "a number of 32 bits" if floating else "an integer of 32 bits"
        raise InputError(
            f"{path}: a cell is not {what}; run 'anhyst compile' again", code="damaged-vectors"
        ) from error
    return {name: words[:, column] for column, name in enumerate(names)}


def _words_of_codes(rows: list[list[str]]) -> Words:
    codes = np.array(rows, dtype=np.int64)
    if np.any(np.abs(codes) > 1 << 31):
        raise OverflowError
    return (codes & 0xFFFFFFFF).astype(np.uint32)


def _words_of_numbers(rows: list[list[str]]) -> Words:
    return np.array(rows, dtype=np.float64).astype(np.float32).view(np.uint32)
