"""Flux tables: flux linkage of a coil over current and gap, on a full grid.

The columns are I_A, gap_m and psi_Wb, one row a point, in any order; described in docs/rig-file.md.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from anhyst.data.table import DataTable, read_columns
from anhyst.rig.parts.magnet import FluxTable
from anhyst.support.arrays import FloatArray
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError

Numbers = NDArray[np.int_]


def read_flux_table(path: PathLike) -> FluxTable:
    """Read a flux table."""
    table = read_columns(path)
    current = table.need("current", "I_A")
    gap = table.need("gap", "gap_m")
    psi = table.need("flux_linkage", "psi_Wb")
    currents, column = np.unique(current, return_inverse=True)
    gaps, row = np.unique(gap, return_inverse=True)
    for name, values in (("current", currents), ("gap", gaps)):
        if values.size < 2:
            raise InputError(
                f"{table.path}: has a single {name}; measure at least two",
                code="too-few-values",
                key=name,
            )
    if currents[0] != 0.0:
        text = f"currents begin at {currents[0]:g} A; begin at 0, the flux is taken as odd in it"
        raise InputError(
            f"{table.where(int(np.argmin(current)))}: {text}",
            code="currents-not-from-zero",
            key="I_A",
        )
    numbers = np.full((gaps.size, currents.size), -1)
    for number, place in enumerate(zip(row.tolist(), column.tolist(), strict=True)):
        if numbers[place] >= 0:
            point = _point(gap[number], current[number])
            raise InputError(
                f"{table.where(number)}: {point} comes twice; remove one", code="value-again"
            )
        numbers[place] = number
    _check_full(table.path, gaps, currents, numbers)
    made = FluxTable(currents, gaps, psi[numbers])
    _check_monotone(table, made, numbers)
    return made


def check_flux_range(
    path: PathLike, table: FluxTable, gap_low: float, gap_high: float, current_high: float
) -> None:
    """Refuse a flux table that ends before the plant does."""
    low, high = float(table.gap[0]), float(table.gap[-1])
    if not (low <= gap_low and gap_high <= high):
        raise InputError(
            f"{path}: gap_m runs from {low:g} to {high:g} m and must hold the travel, "
            f"{gap_low:g} to {gap_high:g} m; add gaps",
            code="gaps-not-covered",
            key="gap_m",
        )
    if table.current[-1] < current_high:
        raise InputError(
            f"{path}: I_A ends at {table.current[-1]:g} A and the amplifier at {current_high:g} A; "
            "add currents",
            code="currents-not-covered",
            key="I_A",
        )


def _check_full(path: str, gaps: FloatArray, currents: FloatArray, numbers: Numbers) -> None:
    holes = np.argwhere(numbers < 0)
    if len(holes):
        first = _point(gaps[holes[0, 0]], currents[holes[0, 1]])
        more = f" and at {len(holes) - 1} other points" if len(holes) > 1 else ""
        raise InputError(
            f"{path}: has a hole at {first}{more}; {gaps.size} gaps and {currents.size} currents "
            "must make a full grid, add what is missing",
            code="grid-has-holes",
        )


def _check_monotone(table: DataTable, made: FluxTable, numbers: Numbers) -> None:
    flat = np.add(np.argwhere(np.diff(made.psi, axis=1) <= 0.0), (0, 1))
    widens = np.add(np.argwhere(np.diff(made.psi[:, 1:], axis=0) >= 0.0), (1, 1))
    offset = np.argwhere(made.psi[:, :1] != 0.0)
    for places, text in (
        (offset, "psi is not 0 without current"),
        (flat, "psi does not rise with the current"),
        (widens, "psi does not fall as the gap opens"),
    ):
        if len(places):
            g, i = places[0].tolist()
            point = _point(made.gap[g], made.current[i])
            where = table.where(int(numbers[g, i]))
            raise InputError(f"{where}: {text} at {point}; correct this point", code="not-monotone")


def _point(gap: float, current: float) -> str:
    return f"{gap * 1e3:g} mm, {current:g} A"
