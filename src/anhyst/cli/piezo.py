"""The verb ``simulate`` for a piezo stage."""

from __future__ import annotations

from pathlib import Path

from anhyst.cli.console import print_json, show, table
from anhyst.support.errors import InputError
from anhyst.support.pays import PIEZO

WORTH_IT = 0.5
"""Deviation of a piezo stage, in parts of that without compensation, below which it is worth it."""


def verdict(ratio: float) -> str:
    """Say whether compensation is worth it that leaves this part of the deviation."""
    if ratio < WORTH_IT:
        return "worth it behind this feedback"
    return f"hardly worth it behind this feedback; {PIEZO}"


def simulate_piezo(rig: Path, out: Path, as_json: bool) -> None:
    """Let a piezo stage follow its triangle."""
    from anhyst.reports.piezo import write_picture
    from anhyst.rig.piezo.file import read_piezo_rig
    from anhyst.study.piezo.track import TITLES, track, write_tracking
    from anhyst.support.atomic import check_writable

    picture = out.with_suffix(".svg")
    if out.suffix != ".csv":
        raise InputError(f"{out}: a recording of a piezo stage is written as .csv")
    for path in (out, picture):
        check_writable(path)
    read = read_piezo_rig(rig)
    found = track(read)
    write_tracking(found, out)
    write_picture(found, 1.0 / read.settings.reference.frequency_Hz, picture)
    if as_json:
        print_json(found.as_dict())
        return
    rows = table("deviation from the triangle", ("compensation", "worst nm", "rms nm"))
    for name, run in found.runs.items():
        rows.add_row(
            TITLES[name], f"{1e9 * run.errors.worst_m:.0f}", f"{1e9 * run.errors.rms_m:.0f}"
        )
    show(
        rows,
        f"rms with compensation over without: {found.ratio:.2f}; {verdict(found.ratio)}",
        f"{out} and {picture} written",
    )
