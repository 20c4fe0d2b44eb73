"""The verb ``simulate`` for a stage that follows set-points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.cli.console import show, table

if TYPE_CHECKING:
    from anhyst import CalibrationStudy, PiezoTracking, TrackingStudy


REPORT = "report.html"


def show_tracking(found: TrackingStudy, out: Path) -> None:
    """Print how every variant followed the set-points."""
    from anhyst.reports.bearing.look import interval_text
    from anhyst.reports.tracking.verdict import limits, verdict, verdicts

    plant = found.rig.settings
    rows = table(
        f"test set-point, crossover {plant.tracking.crossover_Hz:g} Hz",
        ["", "peak, nm", "average, nm", "deviation, nm", "50 nm, ms", "10 nm, ms", "force rms, N"],
    )
    columns = (
        ("peak_m", 1e9),
        ("average_m", 1e9),
        ("deviation_m", 1e9),
        ("settling_50_s", 1e3),
        ("settling_10_s", 1e3),
        ("force_rms_N", 1.0),
    )
    for name, one in found.tried.items():
        rows.add_row(name, *(interval_text(one.of(key), factor=by) for key, by in columns))
    judged = (
        f"verdict: {verdict(found).sentence}",
        *(f"against '{name}': {one.sentence}" for name, one in verdicts(found).items()),
        *limits(found),
    )
    show(
        *(f"lost: {one}" for one in found.lost_in),
        rows,
        f"mean of {plant.noise_seeds} noise seeds with its 95 % interval; gains found on the "
        f"training set-point; average and deviation over {1e3 * plant.scan.slit_s:g} ms",
        *(() if found.lost_in else judged),
        *(f"left out: {name}: {why}" for name, why in found.left_out.items()),
        f"written: {out}, {out.parent / 'figures.json'}, {out.parent / REPORT}",
    )


def show_calibrations(found: CalibrationStudy, out: Path) -> None:
    """Print how stages that were calibrated wrongly followed them."""
    kinds = list(next(iter(found.runs.values())))
    rows = table("moving average that 50 and 95 % of the plants stay below, nm", ["", *kinds])
    for name, runs in found.runs.items():
        rows.add_row(
            name,
            *(
                ", ".join(
                    f"{1e9 * found.percentile(name, kind, 'average_m', percent):.0f}"
                    for percent in (50.0, 95.0)
                )
                for kind in runs
            ),
        )
    show(rows, f"{found.plants} plants of each kind; gains kept", f"written: {out}")


def show_piezo(found: PiezoTracking, out: Path) -> None:
    """Print how a piezo stage followed its triangle."""
    from anhyst.study.piezo.track import TITLES, verdict

    rows = table("deviation from the triangle", ("compensation", "worst nm", "rms nm"))
    for name, one in found.errors.items():
        rows.add_row(TITLES[name], f"{1e9 * one.worst_m:.0f}", f"{1e9 * one.rms_m:.0f}")
    lost = [f"lost: {one}" for one in found.lost_in]
    ratio = (
        f"rms with compensation over without: {found.ratio:.2f}; {verdict(found.ratio).sentence}"
    )
    written = f"{out} and {out.with_suffix('.svg')} written"
    show(*lost, rows, *([] if lost else [ratio]), written)
