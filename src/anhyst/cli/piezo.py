"""The verb ``simulate`` for a piezo stage."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.cli.console import show, table

if TYPE_CHECKING:
    from anhyst import PiezoTracking

WORTH_IT = 0.5
"""Deviation of a piezo stage, in parts of that without compensation, below which it is worth it."""


def show_piezo(found: PiezoTracking, out: Path) -> None:
    """Print how a piezo stage followed its triangle."""
    from anhyst.study.piezo.track import TITLES

    rows = table("deviation from the triangle", ("compensation", "worst nm", "rms nm"))
    for name, run in found.runs.items():
        rows.add_row(
            TITLES[name], f"{1e9 * run.errors.worst_m:.0f}", f"{1e9 * run.errors.rms_m:.0f}"
        )
    verdict = (
        f"rms with compensation over without: {found.ratio:.2f}; "
        + ("worth it" if found.ratio < WORTH_IT else "hardly worth it")
        + " behind this feedback"
    )
    lost = [f"lost: {one}" for one in found.lost_in]
    written = f"{out} and {out.with_suffix('.svg')} written"
    show(*lost, rows, *([] if lost else [verdict]), written)
