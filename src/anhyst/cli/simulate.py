"""The verb ``simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anhyst.cli.console import print_json, show, table, warn
from anhyst.cli.options import AsJson, BoardChoice, Scheduler
from anhyst.cli.piezo import simulate_piezo
from anhyst.cli.progress import progress_bar
from anhyst.cli.stage import simulate_stage_verb
from anhyst.support.errors import InputError, NegativeResult

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.table import Table

    from anhyst.study.bearing.benefit import Benefit, Comparison, Measure
    from anhyst.study.bearing.board_faults import Ending
    from anhyst.study.bearing.monte_carlo import MonteCarlo
    from anhyst.study.bearing.responses import StepCell
    from anhyst.study.bearing.simulate import Simulation


REPORT = "report.html"


def simulate(
    rig: Annotated[
        Path,
        typer.Argument(metavar="RIG", help="Rig file of a bearing, a stage, or a piezo stage."),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="FILE", help="Recording to write, '.csv' or '.mat'."),
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
            help="Instead, run N plants that have drifted as [drift] of the rig file says; FILE "
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
            help="Instead, run the firmware itself, built for 'host', a process, or 'qemu-mps2', "
            "an emulated Cortex-M3, and break everything while it levitates; FILE then ends in "
            "'.json'.",
            show_default=False,
        ),
    ] = None,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Simulate a magnetic bearing or a stage with and without compensation of its hysteresis.

    The controller's own C runs in the loop, in its number format, against a magnet with hysteresis,
    with delay, converters and noise. Beside the recording, figures.json and report.html are
    written: step responses, standstill, loads, what goes wrong, sensitivity, for every kind of
    compensation behind the same gains.

    A piezo stage follows a triangle instead; a picture of it stands beside the recording.

    Example: anhyst simulate examples/bearing/rig.toml --out run/run.csv

    Example: anhyst simulate examples/piezo/rig.toml --out run/stage.csv

    Example: anhyst simulate examples/bearing/rig.toml --out plants/plants.jsonl --monte-carlo 1000

    Example: anhyst simulate examples/bearing/rig.toml --out map/benefit.json --benefit

    Example: anhyst simulate examples/bearing/rig.toml --out run/firmware.json --board host

    Example: anhyst simulate examples/stage/rig.toml --out run/scan.csv
    """
    from anhyst.rig.piezo.file import FORMAT as PIEZO
    from anhyst.rig.stage.file import FORMAT as STAGE
    from anhyst.support.jobs import workers_of
    from anhyst.support.toml_file import format_of

    chosen = "" if controller is None else f" --controller {controller}"
    command = f"anhyst simulate {rig}{chosen} --out {out}"
    given = {"--benefit": benefit, "--monte-carlo": monte_carlo is not None, "--board": board}
    asked = [name for name, value in given.items() if value]
    if len(asked) > 1:
        raise InputError(
            f"{' and '.join(asked)} do not go together; give one of them",
            code="options-together",
            key=asked[0],
        )
    kind = format_of(rig)
    with workers_of(scheduler):
        if kind == PIEZO:
            if controller is not None or asked:
                more = ["--controller"] if controller is not None else []
                raise InputError(
                    f"a piezo stage has no {' or '.join(more + asked)}; leave it out",
                    code="option-not-for-this",
                    key=(more + asked)[0],
                )
            simulate_piezo(rig, out, as_json)
        elif kind == STAGE:
            if controller is not None or board is not None or benefit:
                raise InputError(
                    "a stage has no --controller, --board or --benefit; leave them out",
                    code="option-not-for-this",
                )
            simulate_stage_verb(rig, out, monte_carlo, command, as_json)
        elif board is not None:
            _firmware(rig, out, controller, board.value, as_json)
        elif benefit:
            _map(rig, out, controller, f"{command} --benefit", as_json)
        elif monte_carlo is not None:
            command = f"{command} --monte-carlo {monte_carlo}"
            _fly(rig, out, controller, monte_carlo, command, as_json)
        else:
            _simulate(rig, out, controller, command, as_json)


def _simulate(rig: Path, out: Path, controller: Path | None, command: str, as_json: bool) -> None:
    from anhyst.reports.bearing import write_simulation_report
    from anhyst.reports.bearing.from_simulation import subject_of
    from anhyst.study.bearing.simulate import explore, refuse_losses, write_simulation
    from anhyst.support.atomic import check_writable

    for path in (out, out.parent / REPORT):
        check_writable(path)
    try:
        with progress_bar("simulate") as progress:
            found = explore(rig, out, controller, progress)
            subject = subject_of(found, command)
    except NegativeResult:
        (out.parent / REPORT).unlink(missing_ok=True)  # of another recording
        raise
    write_simulation(found, out)
    write_simulation_report(out.parent / REPORT, subject)
    for text in found.plant.warnings:
        warn(text)
    if as_json:
        print_json(found.figures)
    else:
        _show(found, out)
    refuse_losses(found)


def _firmware(rig: Path, out: Path, controller: Path | None, board: str, as_json: bool) -> None:
    from anhyst.study.bearing.on_board import run_board, write_comparison

    with progress_bar(f"firmware on {board}") as progress:
        found = run_board(rig, out, board, controller, progress)
    write_comparison(found, out)
    if as_json:
        print_json(found.as_dict())
    else:
        show(
            _faults(found.endings),
            f"firmware on {board} against the simulation: {found.differ} of {len(found.recorded)} "
            f"ticks differ, from lift-off to a landing at {1e3 * found.landing_speed:.1f} mm/s",
            f"written: {out}",
        )
    found.refuse()


def _faults(endings: Sequence[Ending]) -> Table:
    rows = table(
        "what went wrong in the air, and how it ended",
        ["", "reason of the fault", "end", "after, ms", "at the rest, mm/s", "at the magnet, mm/s"],
    )
    for one in endings:
        end = (
            f"levitates on, {1e6 * one.away:.2g} um away"
            if one.levitates
            else "lies without current"
        )
        rows.add_row(
            one.injection.name,
            one.reason.name.lower().replace("_", " ") + ("" if one.as_expected else " (wrong)"),
            end,
            "" if one.levitates else f"{1e3 * one.seconds:.0f}",
            f"{1e3 * one.rest_speed:.1f}" if one.rest_speed else "",
            f"{1e3 * one.magnet_speed:.1f}" if one.magnet_speed else "",
        )
    return rows


def _fly(
    rig_path: Path, out: Path, controller_path: Path | None, count: int, command: str, as_json: bool
) -> None:
    from anhyst.reports.bearing import write_simulation_report
    from anhyst.reports.bearing.from_plants import subject_of_plants
    from anhyst.study.bearing.monte_carlo import COMPARED, monte_carlo
    from anhyst.study.bearing.ready import make_ready, read_files
    from anhyst.support.atomic import atomic_writer
    from anhyst.support.json_text import json_text

    files = read_files(rig_path, controller_path)
    if out.suffix != ".jsonl":
        raise InputError(
            f"{out}: results of a Monte Carlo are written as .jsonl; name it so",
            code="wrong-ending",
        )
    figures_path, report_path = out.parent / "montecarlo.json", out.parent / REPORT
    ready = make_ready(*files, (figures_path, report_path))
    rig, controller = ready.rig, ready.controller
    own = controller.settings.compensation.variant
    compared = tuple(dict.fromkeys((*COMPARED, own)))
    with progress_bar("monte carlo") as progress:
        found = monte_carlo(rig, controller, out, count, compared, progress=progress)
    figures = found.as_dict()
    with atomic_writer(figures_path) as stream:
        stream.write(json_text(figures))
    write_simulation_report(report_path, subject_of_plants(rig, controller, found, command))
    if as_json:
        print_json(figures)
    else:
        _show_plants(found, own, out)
    lost = figures["variants"][own]["lost"]
    if lost:
        raise NegativeResult(
            f"{lost} of {count} plants lost levitation with '{own}'", code="levitation-lost"
        )


def _map(
    rig_path: Path, out: Path, controller_path: Path | None, command: str, as_json: bool
) -> None:
    from anhyst.reports.bearing import write_simulation_report
    from anhyst.reports.bearing.from_benefit import subject_of_benefit
    from anhyst.study.bearing.benefit import benefit
    from anhyst.study.bearing.ready import make_ready, read_files
    from anhyst.support.atomic import atomic_writer
    from anhyst.support.json_text import json_text

    files = read_files(rig_path, controller_path)
    if out.suffix != ".json":
        raise InputError(f"{out}: the map is written as .json; name it so", code="wrong-ending")
    report_path = out.parent / REPORT
    ready = make_ready(*files, (out, report_path))
    rig, controller = ready.rig, ready.controller
    with progress_bar("benefit") as progress:
        found = benefit(rig, controller, progress=progress)
    figures = found.as_dict()
    with atomic_writer(out) as stream:
        stream.write(json_text(figures))
    write_simulation_report(report_path, subject_of_benefit(rig, controller, found, command))
    if as_json:
        print_json(figures)
    else:
        _show_map(found, out)


def _show_map(found: Benefit, out: Path) -> None:
    baselines = {"its strongest baseline without memory": [cell.strongest for cell in found.cells]}
    if all(cell.flux for cell in found.cells):
        baselines["'flux', which measures"] = [cell.flux for cell in found.cells]
    show(
        *(_map_against(found, name, comparisons) for name, comparisons in baselines.items()),
        f"'gain' and 'loss' where they are certain over {found.seeds} noise seeds, 'nothing to "
        "gain' where both overshoot by less than three times the rms of their standstill",
        f"written: {out}, {out.parent / REPORT}",
    )


def _map_against(
    found: Benefit, baseline: str, comparisons: Sequence[Mapping[Measure, Comparison]]
) -> Table:
    heights = list(dict.fromkeys(cell.height for cell in found.cells))
    rows = table(
        f"overshoot of 'full' over that of {baseline}",
        ["loop width, reversible part", *(f"{1e6 * height:g} um" for height in heights)],
    )
    for iron in dict.fromkeys(cell.iron for cell in found.cells):
        mine = [
            one["overshoot_percent"]
            for cell, one in zip(found.cells, comparisons, strict=True)
            if cell.iron == iron
        ]
        share = "" if iron.reversible_fraction is None else f", {iron.reversible_fraction:g}"
        rows.add_row(
            f"{100.0 * iron.loop_width:.1f} %{share}",
            *(
                "lost" if one.quotient is None else f"{one.quotient.value:.2f} {one.outcome}"
                for one in mine
            ),
        )
    return rows


def _show_plants(found: MonteCarlo, own: str, out: Path) -> None:
    from anhyst.study.bearing.monte_carlo import percentile

    rows = table(
        "overshoot that 50 and 95 % of the plants stay below, %",
        ["", *(f"{1e6 * height:g} um" for height in found.heights), "standstill, 95 %, nm", "lost"],
    )
    for name, runs in found.runs.items():
        spreads = [
            found.values(name, "overshoot_percent", place) for place in range(len(found.heights))
        ]
        standstill = percentile(found.values(name, "standstill_rms_m"), 95)
        rows.add_row(
            f"{name} *" if name == own else name,
            *(f"{percentile(one, 50):.2f}, {percentile(one, 95):.2f}" for one in spreads),
            f"{1e9 * standstill:.1f}",
            str(sum(run.lost is not None for run in runs)),
        )
    show(
        rows,
        f"* of the controller file; {len(found.drifts)} plants, seed {found.seed}",
        f"written: {out}, {out.parent / 'montecarlo.json'}, {out.parent / REPORT}",
    )


def _overshoot(cell: StepCell) -> str:
    if cell.lost:
        return f"{cell.lost} of {cell.runs} lost"
    one = cell.of("overshoot_percent")
    return f"{one.mean:.2f} ± {one.half_width:.2f}{'' if cell.overshoots else ' ≤ noise'}"


def _show(found: Simulation, out: Path) -> None:
    from anhyst.reports.bearing.subject import grouped
    from anhyst.reports.bearing.verdict import judge

    heights = list(dict.fromkeys(cell.height for cell in found.cells))
    gap = found.rig.settings.simulate.gap_m
    rows = table(
        f"overshoot of steps at {1e3 * gap:g} mm, %",
        ["", *(f"{1e6 * height:g} um" for height in heights), "settling, ms", "standstill, nm"],
    )
    for name in found.setups:
        mine = [cell for cell in found.cells if cell.variant == name and cell.gap == gap]
        last = mine[-1]
        rows.add_row(
            f"{name} *" if name == found.own else name,
            *(_overshoot(cell) for cell in mine),
            f"{1e3 * last.of('settling_in_noise_s').mean:.2f}" if not last.lost else "",
            f"{1e9 * last.of('standstill_rms_m').mean:.0f}" if not last.lost else "",
        )
    iron = found.at.slopes
    label = f"{iron.label} iron: just after a reversal {100.0 * iron.share:.0f} % of the static N/A"
    show(
        rows,
        f"* of the controller file; mean of {found.rig.settings.simulate.noise_seeds} noise seeds "
        "with its 95 % interval; settling and standstill at the highest step",
        "≤ noise: not certainly more than the armature moves about at a standstill",
        *found.plant.lines,
        f"{label}; unstable pole {found.at.point.pole_at_current:.0f} Hz",
        f"verdict: {judge(grouped(found.cells), found.own).sentence()}",
        *(f"left out: {name}: {why}" for name, why in found.figures["left_out"].items()),
        f"written: {out}, {out.parent / 'figures.json'}, {out.parent / REPORT}",
    )
