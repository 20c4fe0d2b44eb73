"""The verb ``simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import anhyst
from anhyst.cli.console import print_json, progress_bar, show, table, warn
from anhyst.cli.options import AsJson, BoardChoice, Scheduler, of_its_kind
from anhyst.cli.rig import show_force

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rich.table import Table

    from anhyst import (
        Benefit,
        BoardComparison,
        MonteCarlo,
        PiezoTracking,
        Simulation,
        TrackingStudy,
    )
    from anhyst.study.bearing.benefit import Comparison, Measure
    from anhyst.study.bearing.board_faults import Ending
    from anhyst.study.bearing.responses import StepCell


REPORT = "report.html"


def simulate(
    rig: Annotated[
        Path,
        typer.Argument(
            metavar="RIG",
            help="Rig file of a bearing, a stage, a piezo stage, or force control.",
            callback=of_its_kind,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="Recording to write: .csv, .mat, .mf4, .tdms, .h5 or .parquet; of force control a "
            "folder.",
        ),
    ],
    controller: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Controller file; 'controller.toml' beside the rig file if left out.",
        ),
    ] = None,
    monte_carlo: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            help="Instead, run N plants that have drifted as [spread] of the rig file says; FILE "
            "then ends in '.jsonl' and holds a line for each of them. The same command goes on "
            "with what is there.",
        ),
    ] = None,
    benefit: Annotated[
        bool,
        typer.Option(
            "--benefit",
            help="Instead, map what compensation gains over loop width, reversible part of the "
            "iron and step height; FILE then ends in '.json'.",
        ),
    ] = False,
    board: Annotated[
        BoardChoice | None,
        typer.Option(
            metavar="BOARD",
            help="Instead, run the firmware itself, built for 'library', within this process, "
            "'host', a process of its own, or 'qemu-mps2', an emulated Cortex-M3, and break "
            "everything while it levitates; FILE then ends in '.json'.",
            show_default=False,
        ),
    ] = None,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Simulate a rig of any kind with and without compensation of its hysteresis.

    The controller's own C runs in the loop, in its number format, against a magnet with hysteresis,
    with delay, converters and noise. Beside the recording, figures.json and report.html are
    written: step responses, standstill, loads, what goes wrong, sensitivity, for every kind of
    compensation behind the same gains.

    A stage follows set-points, a piezo stage a triangle; a rig of force control runs as with
    anhyst force-control.

    Example: anhyst simulate examples/bearing/rig.toml --out run/run.csv

    Example: anhyst simulate examples/piezo/rig.toml --out run/stage.csv

    Example: anhyst simulate examples/bearing/rig.toml --out plants/plants.jsonl --monte-carlo 1000

    Example: anhyst simulate examples/bearing/rig.toml --out map/benefit.json --benefit

    Example: anhyst simulate examples/bearing/rig.toml --out run/firmware.json --board library

    Example: anhyst simulate examples/stage/rig.toml --out run/scan.csv
    """
    with progress_bar("simulate") as progress:
        result = anhyst.simulate(
            rig,
            controller,
            out=out,
            monte_carlo=monte_carlo,
            benefit=benefit,
            board=None if board is None else board.value,
            scheduler=scheduler,
            progress=progress,
        )
    if isinstance(result, anhyst.Simulation | anhyst.ForceControl):
        for text in result.plant.warnings:
            warn(text)
    if as_json:
        print_json(result.figures if hasattr(result, "figures") else result.as_dict())
    else:
        _show_any(result, out)
    _refuse(result)


def _show_any(found: Any, out: Path) -> None:
    """Print a result, whichever was asked for."""
    shown: dict[type, Callable[[Any, Path], None]] = {
        anhyst.Simulation: _show,
        anhyst.MonteCarlo: _show_plants,
        anhyst.Benefit: _show_map,
        anhyst.BoardComparison: _show_firmware,
        anhyst.TrackingStudy: show_tracking,
        anhyst.PiezoTracking: show_piezo,
        anhyst.ForceControl: lambda result, _: show_force(result),
    }
    shown[type(found)](found, out)


def _refuse(result: Any) -> None:
    """End with 1 where what is controlled was lost."""
    if isinstance(result, anhyst.BoardComparison):
        result.refuse()
    elif not isinstance(result, anhyst.Benefit):
        result.refuse_losses()


def _show_firmware(comparison: BoardComparison, out: Path) -> None:
    show(
        _faults(comparison.endings),
        f"firmware on {comparison.board} against the simulation: {comparison.differ} of "
        f"{len(comparison.recorded)} ticks differ, from lift-off to a landing at "
        f"{1e3 * comparison.landing_speed:.1f} mm/s",
        f"written: {out}",
    )


def _faults(endings: Sequence[Ending]) -> Table:
    rows = table(
        "what went wrong in the air, and how it ended",
        ["", "reason of the fault", "end", "after, ms", "at the rest, mm/s", "at the magnet, mm/s"],
    )
    for ending in endings:
        end = (
            f"levitates on, {1e6 * ending.away:.2g} um away"
            if ending.levitates
            else "lies without current"
        )
        rows.add_row(
            ending.injection.name,
            ending.reason.name.lower().replace("_", " ")
            + ("" if ending.as_expected else " (wrong)"),
            end,
            "" if ending.levitates else f"{1e3 * ending.seconds:.0f}",
            f"{1e3 * ending.rest_speed:.1f}" if ending.rest_speed else "",
            f"{1e3 * ending.magnet_speed:.1f}" if ending.magnet_speed else "",
        )
    return rows


def _show_map(benefit: Benefit, out: Path) -> None:
    baselines = {
        "its strongest baseline without memory": [cell.strongest for cell in benefit.cells]
    }
    if all(cell.flux for cell in benefit.cells):
        baselines["'flux', which measures"] = [cell.flux for cell in benefit.cells]
    show(
        *(_map_against(benefit, name, comparisons) for name, comparisons in baselines.items()),
        f"'gain' and 'loss' where they are certain over {benefit.seeds} noise seeds, 'nothing to "
        "gain' where both overshoot by less than three times the rms of their standstill",
        f"written: {out}, {out.parent / REPORT}",
    )


def _map_against(
    benefit: Benefit, baseline: str, comparisons: Sequence[Mapping[Measure, Comparison]]
) -> Table:
    heights = list(dict.fromkeys(cell.height for cell in benefit.cells))
    rows = table(
        f"overshoot of 'full' over that of {baseline}",
        ["loop width, reversible part", *(f"{1e6 * height:g} um" for height in heights)],
    )
    for iron in dict.fromkeys(cell.iron for cell in benefit.cells):
        mine = [
            comparison["overshoot_percent"]
            for cell, comparison in zip(benefit.cells, comparisons, strict=True)
            if cell.iron == iron
        ]
        share = "" if iron.reversible_fraction is None else f", {iron.reversible_fraction:g}"
        rows.add_row(
            f"{100.0 * iron.loop_width:.1f} %{share}",
            *(
                "lost"
                if comparison.quotient is None
                else f"{comparison.quotient.value:.2f} {comparison.outcome}"
                for comparison in mine
            ),
        )
    return rows


def _show_plants(plants: MonteCarlo, out: Path) -> None:
    from anhyst.study.engine.monte_carlo import percentile

    rows = []
    titles = [f"{name} *" if name == plants.plants.own else name for name in plants.runs]
    for figure in plants.plants.figures:
        title = f"{figure.title} that 50 and 95 % of the plants stay below, {figure.unit}"
        rows.append(table(title, ["", *titles]))
        for case, name in enumerate(figure.names):
            spreads = [plants.values(method, figure.key, case) for method in plants.runs]
            low, high = (
                [figure.factor * percentile(one, percent) for one in spreads]
                for percent in (50, 95)
            )
            rows[-1].add_row(name, *(f"{a:.4g}, {b:.4g}" for a, b in zip(low, high, strict=True)))
    lost = ", ".join(f"{one} with {name}" for name in plants.runs if (one := plants.lost(name)))
    show(
        f"lost: {lost or 'none'} of {len(plants.drifts)} plants",
        *rows,
        f"* judged; {len(plants.drifts)} plants, seed {plants.plants.seed}",
        f"verdict: {plants.verdict.sentence}",
        f"written: {out}, {out.parent / 'montecarlo.json'}, {out.parent / REPORT}",
    )


def _overshoot(cell: StepCell) -> str:
    if cell.lost:
        return f"{cell.lost} of {cell.runs} lost"
    interval = cell.of("overshoot_percent")
    return f"{interval.mean:.2f} ± {interval.half_width:.2f}{'' if cell.overshoots else ' ≤ noise'}"


def _show(simulation: Simulation, out: Path) -> None:
    from anhyst.reports.bearing.subject import grouped
    from anhyst.reports.bearing.tables import judge_steps

    heights = list(dict.fromkeys(cell.height for cell in simulation.cells))
    gap = simulation.rig.settings.gap_m
    rows = table(
        f"overshoot of steps at {1e3 * gap:g} mm, %",
        ["", *(f"{1e6 * height:g} um" for height in heights), "settling, ms", "standstill, nm"],
    )
    for name in simulation.setups:
        mine = [cell for cell in simulation.cells if cell.variant == name and cell.gap == gap]
        last = mine[-1]
        rows.add_row(
            f"{name} *" if name == simulation.own else name,
            *(_overshoot(cell) for cell in mine),
            f"{1e3 * last.of('settling_in_noise_s').mean:.2f}" if not last.lost else "",
            f"{1e9 * last.of('standstill_rms_m').mean:.0f}" if not last.lost else "",
        )
    iron = simulation.at.slopes
    label = f"{iron.label} iron: just after a reversal {100.0 * iron.share:.0f} % of the static N/A"
    show(
        *(f"lost levitation: {loss}" for loss in simulation.lost_in),
        rows,
        f"* of the controller file; mean of {simulation.rig.settings.noise_seeds} noise seeds "
        "with its 95 % interval; settling and standstill at the highest step",
        "≤ noise: not certainly more than the armature moves about at a standstill",
        *simulation.plant.lines,
        f"{label}; unstable pole {simulation.at.point.pole_at_current:.0f} Hz",
        *(
            []
            if simulation.lost_in
            else [f"verdict: {judge_steps(grouped(simulation.cells), simulation.own).sentence}"]
        ),
        *(f"left out: {name}: {why}" for name, why in simulation.figures["left_out"].items()),
        f"written: {out}, {out.parent / 'figures.json'}, {out.parent / REPORT}",
    )


def show_tracking(study: TrackingStudy, out: Path) -> None:
    """Print how every variant followed the set-points."""
    from anhyst.reports.bearing.look import interval_text
    from anhyst.reports.tracking.page import limits, verdict, verdicts
    from anhyst.study.tracking.losses import LOSS_NOTES

    plant = study.rig.settings
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
    for name, variant in study.tried.items():
        rows.add_row(name, *(interval_text(variant.of(key), factor=by) for key, by in columns))
    own = next(iter(study.tried.values()))
    crossed = table("largest error of what is held", ["", *own.crossed])
    for name, variant in study.tried.items():
        crossed.add_row(
            name, *(interval_text(variant.cross_talk(axis), factor=1e9) for axis in variant.crossed)
        )
    rests = table("rms at rest, the long stroke moving", ["", *own.at_rest])
    for name, variant in study.tried.items():
        rests.add_row(name, *(f"{1e9 * rest:.3g}" for rest in variant.at_rest.values()))
    judged = (
        f"verdict: {verdict(study).sentence}",
        *(f"against '{name}': {variant.sentence}" for name, variant in verdicts(study).items()),
        *limits(study),
    )
    show(
        *(f"lost: {variant}" for variant in study.lost_in),
        rows,
        *((crossed, rests, "in nm and nrad") if own.crossed else ()),
        *((_losses(study), *LOSS_NOTES) if study.losses else ()),
        f"mean of {plant.noise_seeds} noise seeds with its 95 % interval; gains found on the "
        f"training set-point; average and deviation over {1e3 * plant.scan.slit_s:g} ms",
        *(() if study.lost_in else judged),
        *(
            f"learnt: {name}: {variant.learnt.judgement}"
            for name, variant in study.tried.items()
            if variant.learnt
        ),
        *(f"left out: {name}: {why}" for name, why in study.left_out.items()),
        f"written: {out}, {out.parent / 'figures.json'}, {out.parent / REPORT}",
    )


def _losses(study: TrackingStudy) -> Table:
    """Return what became of a stage without each of its magnets."""
    from anhyst.study.tracking.losses import LOSS_HEAD, LOSS_TITLE

    rows = table(LOSS_TITLE, LOSS_HEAD)
    for loss in study.losses:
        rows.add_row(*loss.cells())
    return rows


def show_piezo(tracking: PiezoTracking, out: Path) -> None:
    """Print how a piezo stage followed its triangle."""
    from anhyst.study.piezo import TITLES, verdict

    rows = table("deviation from the triangle", ("compensation", "worst nm", "rms nm"))
    for name, one in tracking.errors.items():
        rows.add_row(TITLES[name], f"{1e9 * one.worst_m:.0f}", f"{1e9 * one.rms_m:.0f}")
    lost = [f"lost: {one}" for one in tracking.lost_in]
    ratio = f"rms with compensation over without: {tracking.ratio:.2f}; {verdict(tracking.ratio).sentence}"
    written = f"{out} and {out.with_suffix('.svg')} written"
    show(*lost, rows, *([] if lost else [ratio]), written)
