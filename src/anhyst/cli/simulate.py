"""The verbs ``simulate`` and ``force-control``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import anhyst
from anhyst.cli.compile import refuse_difference, run_and_write, show_tables
from anhyst.cli.shared import (
    AsJson,
    BoardChoice,
    ControllerPath,
    Scheduler,
    Verbose,
    of_its_kind,
    print_json,
    progress_bar,
    show,
    show_study,
    table,
    warn,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from anhyst import Benefit, BoardComparison
    from anhyst.cli.printing import TerminalTable
    from anhyst.study.bearing.board_faults import Ending
    from anhyst.study.benefit import Comparison
    from anhyst.study.engine.table import StudyResult


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
            help="Recording to write: .csv, .mat, .mf4, .tdms, .h5 or .parquet; for force "
            "control, a folder.",
        ),
    ],
    controller: ControllerPath = None,
    monte_carlo: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            help="Instead, run N plants with random drift, as defined in [spread] of the rig "
            "file. FILE then ends in '.jsonl' and contains one line per plant. The same "
            "command continues an unfinished run.",
        ),
    ] = None,
    benefit: Annotated[
        bool,
        typer.Option(
            "--benefit",
            help="Instead, map the gain of compensation over the loop width and the reversible "
            "part of the iron, for a bearing also over the step height. FILE then ends in "
            "'.json'.",
        ),
    ] = False,
    board: Annotated[
        BoardChoice | None,
        typer.Option(
            metavar="BOARD",
            help="Instead, run the firmware and inject faults while it levitates. The firmware "
            "is built for 'library' (in this process), 'host' (in its own process) or "
            "'qemu-mps2' (an emulated Cortex-M3). FILE then ends in '.json'.",
            show_default=False,
        ),
    ] = None,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Simulate a rig of any kind, with and without compensation of its hysteresis.

    The C of the controller runs in the loop, in its number format, with a simulated magnet with
    hysteresis, delay, converters and noise. In addition to the recording, the command writes
    figures.json and report.html. They contain step responses, standstill, loads, faults and
    sensitivity, for every kind of compensation with the same gains.

    A stage follows set-points, and a piezo stage follows a triangle. A rig for force control runs
    as with anhyst force-control.

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
            board=board,
            scheduler=scheduler,
            progress=progress,
        )
    if isinstance(result, anhyst.Simulation | anhyst.ForceControl):
        for text in result.plant.warnings:
            warn(text)
    if as_json:
        print_json(result.as_dict())
    elif isinstance(result, anhyst.BoardComparison):
        _show_firmware(result, out)
    elif isinstance(result, anhyst.Benefit):
        _show_map(result, out)
    else:
        show_study(result, _written(result, out))
    if isinstance(result, anhyst.BoardComparison):
        result.refuse()
    elif not isinstance(result, anhyst.Benefit):
        result.refuse_losses()


def _written(result: StudyResult, out: Path) -> str:
    """Say what was written of a study."""
    if isinstance(result, anhyst.ForceControl):
        return (
            f"{result.out}: report.html, figures.json, fig6 to fig8, moving (PNG and SVG), one "
            "recording of each trial"
        )
    figures = "montecarlo.json" if isinstance(result, anhyst.MonteCarlo) else "figures.json"
    picture = [out.with_suffix(".svg")] if isinstance(result, anhyst.PiezoTracking) else []
    return ", ".join(map(str, (out, *picture, out.parent / figures, out.parent / REPORT)))


def _show_firmware(comparison: BoardComparison, out: Path) -> None:
    show(
        _faults(comparison.endings),
        f"firmware on {comparison.board} against the simulation: {comparison.differ} of "
        f"{len(comparison.recorded)} ticks differ, from lift-off to a landing at "
        f"{1e3 * comparison.landing_speed:.1f} mm/s",
        f"written: {out}",
    )


def _faults(endings: Sequence[Ending]) -> TerminalTable:
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
        "gain' where both overshoot a step by less than three times the rms of their standstill",
        f"written: {out}, {out.parent / REPORT}",
    )


def _map_against(
    benefit: Benefit, baseline: str, comparisons: Sequence[Mapping[str, Comparison]]
) -> TerminalTable:
    first = benefit.metrics[0]
    cases = dict.fromkeys(cell.case for cell in benefit.cells)
    rows = table(
        f"{first.title} of 'full' over that of {baseline}",
        ["loop width, reversible part", *map(_case, cases)],
    )
    for iron in dict.fromkeys(cell.iron for cell in benefit.cells):
        mine = [
            comparison[first.key]
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


def _case(case: float | str) -> str:
    return f"{1e6 * case:g} um" if isinstance(case, float) else case


def force_control(
    rig: Annotated[
        list[Path],
        typer.Argument(
            metavar="RIG|LOOPS",
            help="Rig file for force control, or the loops of a magnet: measurement files, or "
            "folders of them.",
            callback=of_its_kind,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Output folder.")],
    board: Annotated[
        BoardChoice,
        typer.Option(
            metavar="BOARD",
            help="Where the firmware runs: 'library' (in this process), 'host' (in its own "
            "process) or 'qemu-mps2' (an emulated Cortex-M3).",
        ),
    ] = "library",
    demand: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="CSV with a demand (t_s, F_N), in addition to those of the rig file.",
        ),
    ] = None,
    recordings: Annotated[
        str,
        typer.Option(
            metavar="FORMAT", help="Format of the recordings: csv, mat, mf4, tdms, h5 or parquet."
        ),
    ] = "csv",
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Control the force of a magnet in open loop, with and without compensation.

    Models are identified from the loops of the rig, compiled, and built into the firmware. The
    firmware controls the simulated magnet over its serial link: at the end of the stroke, at
    several positions, and with a moving armature. For comparison, the command runs the simulated
    program, a constant ratio of force and current, and the best single-valued curve. It writes
    recordings, figures.json, figures 6 to 8 of the paper, and report.html.

    If loops are given, the command first creates a rig in the folder, like anhyst init
    --force-control. Finally, it verifies the compiled C of all gaps, like anhyst verify.

    Example: anhyst force-control examples/solenoid/rig.toml --out run

    Example: anhyst force-control slow.csv middle.csv fast.csv --out run
    """
    from anhyst.reports.force import draw
    from anhyst.support.page import table as page_table

    from_loops = len(rig) > 1 or rig[0].suffix != ".toml"
    if from_loops:
        anhyst.init(out, rig, force_control=True)
    with progress_bar("force control") as progress:
        result = anhyst.force_control(
            out / "rig.toml" if from_loops else rig[0],
            out,
            board=board,
            demand=demand,
            recordings=recordings,
            progress=progress,
        )
    compiled = result.out / "stroke" / "full" / "controller"
    verified = run_and_write(compiled) if from_loops else None
    rows = verified.tables() if verified else []
    draw(result, [page_table(table.title, table.headings, table.cells) for table in rows])
    for text in result.plant.warnings:
        warn(text)
    if as_json:
        print_json(result.figures | ({"verified": verified.as_dict()} if verified else {}))
    else:
        show_study(result, _written(result, out))
        if verified:
            show_tables(verified)
    result.refuse_losses()
    if verified:
        refuse_difference(compiled, verified)
