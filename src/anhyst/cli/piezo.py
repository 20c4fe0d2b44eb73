"""The verb ``simulate`` for a piezo stage."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.cli.console import print_json, show, table
from anhyst.support.errors import NegativeResult

if TYPE_CHECKING:
    from anhyst.study.piezo.track import PiezoTracking

WORTH_IT = 0.5
"""Deviation of a piezo stage, in parts of that without compensation, below which it is worth it."""


def simulate_piezo(rig: Path, out: Path, as_json: bool) -> None:
    """Let a piezo stage follow its triangle."""
    from anhyst.data.writing import check_recording
    from anhyst.reports.piezo import write_picture
    from anhyst.rig.piezo.file import read_piezo_rig
    from anhyst.study.piezo.track import track, write_tracking
    from anhyst.support.atomic import check_writable

    picture = out.with_suffix(".svg")
    check_recording(out, [rig])
    check_writable(picture)
    read = read_piezo_rig(rig)
    found = track(read)
    write_tracking(found, out)
    write_picture(found, 1.0 / read.settings.reference.frequency_Hz, picture)
    if as_json:
        print_json(found.as_dict())
    else:
        _show(found, f"{out} and {picture} written")
    if lost := found.runs["full"].lost:
        raise NegativeResult(
            f"the loop was lost {lost}: a bandwidth of {read.settings.control.bandwidth_Hz:g} Hz "
            f"does not hold this stage; the recording is kept in {out}"
        )


def _show(found: PiezoTracking, written: str) -> None:
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
    show(*lost, rows, *([] if lost else [verdict]), written)
