"""The command ``simulate``: simulate a rig of any kind, with and without compensation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

if TYPE_CHECKING:
    from anhyst.cli.printing import TerminalTable
    from anhyst.cli.shared import OutputPart
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress
    from anhyst_rigs.reports.studies import Simulated, Studied
    from anhyst_rigs.study.bearing.board_faults import FaultOutcome
    from anhyst_rigs.study.bearing.on_board import BoardComparison
    from anhyst_rigs.study.benefit import Benefit, MethodComparison

PLACE = 32, "Rigs, simulated and real"

Board = Literal["library", "host", "qemu-mps2"]
"""Boards that need no hardware."""


@overload
def simulate(
    rig: PathLike,
    controller: PathLike | None = None,
    *,
    out: PathLike | None = None,
    monte_carlo: None = None,
    benefit: Literal[False] = False,
    board: None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Simulated: ...


@overload
def simulate(
    rig: PathLike,
    controller: PathLike | None = None,
    *,
    out: PathLike | None = None,
    monte_carlo: int | None = None,
    shard: str | None = None,
    merge: bool = False,
    benefit: bool = False,
    board: Board | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Studied: ...


def simulate(
    rig: PathLike,
    controller: PathLike | None = None,
    *,
    out: PathLike | None = None,
    monte_carlo: int | None = None,
    shard: str | None = None,
    merge: bool = False,
    benefit: bool = False,
    board: Board | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Studied:
    """Simulate a rig of any kind, with and without compensation of its hysteresis.

    The C code of the controller, in its number format, runs in a loop with a simulated magnet that
    has hysteresis, delay, converters and noise. In addition to the recording, the command writes
    figures.json and report.html. These files contain step responses, standstill, loads, faults and
    sensitivity for every kind of compensation, all with the same gains.

    A stage follows set-points, and a piezo stage follows a triangle. A rig for force control is
    simulated as by anhyst force-control.

    Parameters
    ----------
    rig : path-like
        Rig file of a bearing, a stage, a piezo stage, or a rig for force control.
    controller : path-like, ``FILE``, optional
        Controller file. [default: 'controller.toml' next to the rig file]
    out : path-like, ``FILE``, required on the command line
        Recording to write: .csv, .mat, .mf4, .tdms, .h5 or .parquet; for force control, a folder.
    monte_carlo : int, at least 1, ``N``, optional
        Instead, run N plants with random drift, as defined in [spread] of the rig file. FILE must
        then end in '.jsonl', and will contain one line per plant. The same command continues an
        unfinished run.
    shard : str, ``I/N``, optional
        With --monte-carlo, run only part I of N, for job arrays. 'plants.jsonl' becomes
        'plants.2-of-8.jsonl' for 2/8; no other file is written.
    merge : bool
        With --monte-carlo, read the files of all shards instead of running plants. All files equal
        those of one run.
    benefit : bool
        Instead, map the benefit of compensation as a function of loop width and reversible fraction
        of the iron, and for a bearing also of step height. FILE must then end in '.json'.
    board : str, ``BOARD``, optional
        Instead, run the firmware of a bearing, and inject faults while the armature levitates. The
        firmware is built for 'library' (in this process), 'host' (in its own process) or
        'qemu-mps2' (an emulated Cortex-M3). FILE must then end in '.json'.
    scheduler : str, ``ADDRESS``, optional
        Use the workers of a dask scheduler, such as tcp://host:8786 (extra 'cluster'). They must
        have access to the same files. [default: processes of this machine]
    progress : callable, optional
        Called with the work done and the total work.

    Returns
    -------
    Simulation, TrackingStudy, PiezoTracking or ForceControl
        With `monte_carlo`, `benefit` or `board`: MonteCarlo, Benefit or BoardComparison. Without
        `out`, nothing is written until ``save`` is called.

    Raises
    ------
    InputError
        A file cannot be read or contradicts another file, or options exclude each other.
    NegativeResult
        Levitation was lost before anything could be compared.

    Examples
    --------
    anhyst simulate examples/bearing/rig.toml --out run/run.csv

    anhyst simulate examples/piezo/rig.toml --out run/stage.csv

    anhyst simulate examples/bearing/rig.toml --out plants/plants.jsonl --monte-carlo 1000

    anhyst simulate examples/bearing/rig.toml --out map/benefit.json --benefit

    anhyst simulate examples/bearing/rig.toml --out run/firmware.json --board library

    anhyst simulate examples/stage/rig.toml --out run/scan.csv
    """
    from anhyst.support.atomic import check_path
    from anhyst.support.errors import InputError, wrong_key
    from anhyst.support.jobs import use_scheduler
    from anhyst.support.kinds import require_capability
    from anhyst.support.toml_file import require_rig
    from anhyst_rigs.reports.studies import HasBenefit, HasBoard, HasPlants, HasSimulation, map_benefit
    from anhyst_rigs.reports.studies import monte_carlo as run_plants
    from anhyst_rigs.reports.study.task import SimulationTask

    check_path(rig, "simulate: rig", "the path of a rig file")
    switches = {"--benefit": benefit, "--monte-carlo": monte_carlo is not None, "--board": board}
    chosen = [name for name, value in switches.items() if value]
    if len(chosen) > 1:
        text = f"{' and '.join(chosen)} exclude each other; give one of them"
        raise InputError(text, code="options-together", key=chosen[0])
    kind = require_rig(rig, "simulate")
    kind.refuse_options("simulate", {"--controller": controller, "--board": board})
    if out is None and chosen:
        raise InputError(f"{chosen[0]}: needs an output file", code="missing", key="--out")
    if (shard is not None or merge) and (monte_carlo is None or (shard is not None and merge)):
        option = "--merge" if merge else "--shard"
        text = "needs --monte-carlo" if monte_carlo is None else "is not for one shard; leave out --shard"
        raise wrong_key(option, text, code="options-together")
    task = SimulationTask(rig, controller, Path(out or "-"), out is not None, progress)
    with use_scheduler(scheduler):
        if monte_carlo is not None:
            return run_plants(require_capability(kind, HasPlants), task, monte_carlo, shard, merge)
        if benefit:
            return map_benefit(require_capability(kind, HasBenefit), task)
        if board is not None:
            return require_capability(kind, HasBoard).run_board(task, board)
        return require_capability(kind, HasSimulation).simulate(task)


def warnings(result: Studied) -> Sequence[str]:
    """Return the warnings about the simulated plant, which follow from the loops."""
    plant = getattr(result, "plant", None)
    return getattr(plant, "warnings", ())


def show(result: Studied, arguments: Mapping[str, Any]) -> Iterator[OutputPart]:
    """Return the terminal output of the study."""
    from anhyst.support.kinds import require_capability, rig_kinds
    from anhyst_rigs.reports import plants
    from anhyst_rigs.reports.studies import HasSimulation, study_output
    from anhyst_rigs.reports.study.task import files_written
    from anhyst_rigs.study.bearing.on_board import BoardComparison
    from anhyst_rigs.study.benefit import Benefit
    from anhyst_rigs.study.engine.monte_carlo import MonteCarlo, Shard

    out = arguments["out"]
    if isinstance(result, Shard):
        yield from (f"{name}: {text}" for name, text in result.facts().items())
        yield f"written: {result.path}"
    elif isinstance(result, BoardComparison):
        yield from _show_firmware(result, out)
    elif isinstance(result, Benefit):
        yield from _show_map(result, out)
    elif isinstance(result, MonteCarlo):
        yield from study_output(result, plants.terminal_summary(result), files_written(result, out))
    else:
        kind = require_capability(rig_kinds()[result.kind], HasSimulation)
        yield from study_output(result, kind.printed(result), kind.written(result, out))


def refuse(result: Studied, _: Mapping[str, Any]) -> None:
    """Raise NegativeResult if levitation, a force or a position was lost."""
    from anhyst_rigs.study.bearing.on_board import BoardComparison
    from anhyst_rigs.study.benefit import Benefit
    from anhyst_rigs.study.engine.monte_carlo import Shard

    if isinstance(result, BoardComparison):
        result.raise_if_failed()
    elif not isinstance(result, Benefit | Shard):
        result.refuse_losses()


def _show_firmware(comparison: BoardComparison, out: Path) -> Iterator[OutputPart]:
    yield _fault_table(comparison.outcomes)
    yield (
        f"firmware on {comparison.board} against the simulation: {comparison.differing_ticks} of "
        f"{len(comparison.board_recording)} ticks differ, from lift-off to a landing at "
        f"{1e3 * comparison.landing_speed:.1f} mm/s"
    )
    yield f"written: {out}"


def _fault_table(endings: Sequence[FaultOutcome]) -> TerminalTable:
    from anhyst.cli.printing import TerminalTable

    rows = TerminalTable(
        "faults injected during levitation, and their outcome",
        ["", "reported fault", "outcome", "after, ms", "at the stop, mm/s", "at the magnet, mm/s"],
    )
    for ending in endings:
        end = (
            f"keeps levitating, {1e6 * ending.max_deviation:.2g} um away"
            if ending.is_levitating
            else "landed without current"
        )
        rows.add_row(
            ending.injection.name,
            ending.fault.name.lower().replace("_", " ") + ("" if ending.is_as_expected else " (wrong)"),
            end,
            "" if ending.is_levitating else f"{1e3 * ending.seconds:.0f}",
            f"{1e3 * ending.rest_speed:.1f}" if ending.rest_speed else "",
            f"{1e3 * ending.magnet_speed:.1f}" if ending.magnet_speed else "",
        )
    return rows


def _show_map(benefit: Benefit, out: Path) -> Iterator[OutputPart]:
    from anhyst_rigs.reports.study.page import REPORT_NAME

    baselines = {"the strongest single-valued baseline": [cell.strongest for cell in benefit.cells]}
    if all(cell.flux for cell in benefit.cells):
        baselines["'flux' (measured flux density)"] = [cell.flux for cell in benefit.cells]
    yield from (_map_table(benefit, name, comparisons) for name, comparisons in baselines.items())
    yield (
        f"'gain' and 'loss' are significant over {benefit.seeds} noise seeds, 'nothing to "
        "gain': both overshoot a step by less than three times the rms of their standstill"
    )
    yield f"written: {out}, {out.parent / REPORT_NAME}"


def _map_table(
    benefit: Benefit, baseline: str, comparisons: Sequence[Mapping[str, MethodComparison]]
) -> TerminalTable:
    from anhyst.cli.printing import TerminalTable

    first_metric = benefit.metrics[0]
    cases = dict.fromkeys(cell.case for cell in benefit.cells)
    rows = TerminalTable(
        f"{first_metric.title} of 'full' relative to that of {baseline}",
        ["loop width, reversible part", *map(_case_text, cases)],
    )
    for iron in dict.fromkeys(cell.iron for cell in benefit.cells):
        row_comparisons = [
            comparison[first_metric.key]
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
                for comparison in row_comparisons
            ),
        )
    return rows


def _case_text(case: float | str) -> str:
    return f"{1e6 * case:g} um" if isinstance(case, float) else case
