"""The verb ``simulate`` for a stage that follows set-points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.cli.console import print_json, show, table
from anhyst.cli.progress import progress_bar
from anhyst.support.errors import NegativeResult

if TYPE_CHECKING:
    from anhyst.study.tracking.monte_carlo import CalibrationStudy
    from anhyst.study.tracking.simulate import TrackingStudy

REPORT = "report.html"


def simulate_stage_verb(
    rig: Path, out: Path, plants: int | None, command: str, as_json: bool
) -> None:
    """Try every variant on a stage, or on so many that were calibrated wrongly."""
    if plants is not None:
        _wrong(rig, out, plants, as_json)
        return
    from anhyst.reports.tracking import write_tracking_report
    from anhyst.study.tracking.simulate import simulate_stage
    from anhyst.support.atomic import check_writable

    report = out.parent / REPORT
    check_writable(report)
    try:
        with progress_bar("tracking") as progress:
            found = simulate_stage(rig, out, progress)
    except NegativeResult:
        report.unlink(missing_ok=True)  # of another recording
        raise
    write_tracking_report(report, found, command)
    if as_json:
        print_json(found.figures)
    else:
        _show(found, out)
    if found.lost_in:
        raise NegativeResult(
            f"the loop was lost: {'; '.join(found.lost_in)}; figures and recording are kept"
        )


def _show(found: TrackingStudy, out: Path) -> None:
    from anhyst.reports.bearing.look import interval_text
    from anhyst.reports.tracking.verdict import limits, verdict, verdicts

    tracking = found.rig.settings.tracking
    rows = table(
        f"test set-point, crossover {tracking.crossover_Hz:g} Hz",
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
        f"verdict: {verdict(found)[1]}",
        *(one.text for one in verdicts(found)),
        *limits(found),
    )
    show(
        *(f"lost: {one}" for one in found.lost_in),
        rows,
        f"mean of {tracking.noise_seeds} noise seeds with its 95 % interval; gains found on the "
        f"training set-point; average and deviation over {1e3 * tracking.slit_s:g} ms",
        *(() if found.lost_in else judged),
        *(f"left out: {name}: {why}" for name, why in found.left_out.items()),
        f"written: {out}, {out.parent / 'figures.json'}, {out.parent / REPORT}",
    )


def _wrong(rig: Path, out: Path, plants: int, as_json: bool) -> None:
    from anhyst.study.tracking.monte_carlo import calibrate_wrongly

    with progress_bar("wrong calibrations") as progress:
        found = calibrate_wrongly(rig, out, plants, progress)
    if as_json:
        print_json(found.figures)
    else:
        _show_wrong(found, out)


def _show_wrong(found: CalibrationStudy, out: Path) -> None:
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
