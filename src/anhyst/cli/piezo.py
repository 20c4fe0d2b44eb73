"""The verb ``simulate`` for a piezo stage."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.cli.console import show, table
from anhyst.study.verdict import Comparison, Judgement, judge
from anhyst.support.pays import PIEZO

if TYPE_CHECKING:
    from anhyst import PiezoTracking

WORTH_IT = 0.5
"""Deviation of a piezo stage, in parts of that without compensation, below which it is worth it."""


def verdict(ratio: float) -> Judgement:
    """Say whether compensation is worth it that leaves this part of the deviation."""
    found = Comparison("rms", "no compensation", ratio, 1.0, 1.0 - WORTH_IT)
    return judge("compensation", [found], "measures", PIEZO)


def show_piezo(found: PiezoTracking, out: Path) -> None:
    """Print how a piezo stage followed its triangle."""
    from anhyst.study.piezo.track import TITLES

    rows = table("deviation from the triangle", ("compensation", "worst nm", "rms nm"))
    for name, run in found.runs.items():
        rows.add_row(
            TITLES[name], f"{1e9 * run.errors.worst_m:.0f}", f"{1e9 * run.errors.rms_m:.0f}"
        )
    lost = [f"lost: {one}" for one in found.lost_in]
    ratio = (
        f"rms with compensation over without: {found.ratio:.2f}; {verdict(found.ratio).sentence}"
    )
    written = f"{out} and {out.with_suffix('.svg')} written"
    show(*lost, rows, *([] if lost else [ratio]), written)
