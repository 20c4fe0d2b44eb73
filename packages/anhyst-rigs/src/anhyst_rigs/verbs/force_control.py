"""The command ``force-control``: control the force of a magnet in open loop."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from anhyst.verbs import verify as verifying

if TYPE_CHECKING:
    from anhyst.cli.shared import OutputPart
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress
    from anhyst_rigs.study.force_control import ForceControl

PLACE = 35, "Rigs, simulated and real"
PROGRESS = "force control"

Board = Literal["library", "host", "qemu-mps2"]
"""Boards that need no hardware."""


def force_control(
    rig: PathLike | Sequence[PathLike],
    out: PathLike,
    *,
    board: Board = "library",
    demand: PathLike | None = None,
    recordings: str = "csv",
    progress: Progress | None = None,
) -> ForceControl:
    """Control the force of a magnet in open loop, with and without compensation.

    Models are identified from the loops of the rig, compiled, and built into the firmware. Through
    its serial link, the firmware gets force demands for the simulated magnet: at the end of the
    stroke, at several positions, and with a moving armature. For comparison, the command also runs
    the simulated program, a constant ratio of current to force, and the best single-valued curve.
    It writes recordings, figures.json, figures 6 to 8 of the paper, and report.html.

    If loops are given, the command first creates a rig in the folder, like anhyst init
    --force-control. Finally, it verifies the compiled C of all gaps, like anhyst verify.

    Parameters
    ----------
    rig : path-like or sequence of path-like, ``RIG|LOOPS``
        Rig file for force control, or the loops of a magnet: measurement files, or folders of them.
    out : path-like, ``DIR``
        Output folder.
    board : str, ``BOARD``
        Where the firmware runs: 'library' (in this process), 'host' (in its own process) or
        'qemu-mps2' (an emulated Cortex-M3).
    demand : path-like, ``FILE``, optional
        CSV with a demand (t_s, F_N), in addition to those of the rig file.
    recordings : str, ``FORMAT``
        Format of the recordings: csv, mat, mf4, tdms, h5 or parquet.
    progress : callable, optional
        Called with the work done and the total work.

    Returns
    -------
    ForceControl

    Raises
    ------
    InputError
        The rig, its loops or the demand cannot be used, or a tool is not installed.
    NegativeResult
        A model cannot be compiled, or a controller did not follow its commands.

    Examples
    --------
    anhyst force-control examples/solenoid/rig.toml --out run

    anhyst force-control slow.csv middle.csv fast.csv --out run
    """
    from dataclasses import replace

    from anhyst.support.atomic import check_path
    from anhyst.support.page import make_table
    from anhyst_rigs.reports.force import draw_all
    from anhyst_rigs.study.force_control import force_control as work
    from anhyst_rigs.verbs.init import init

    rig_paths: Sequence[Any] = rig if isinstance(rig, list | tuple) and rig else [rig]
    paths = [Path(check_path(path, "force_control: rig", "the path of a rig file")) for path in rig_paths]
    check_path(out, "force_control: out")
    is_from_loops = len(paths) > 1 or paths[0].suffix != ".toml"
    if is_from_loops:
        init(out, paths, force_control=True)
    file = Path(out) / "rig.toml" if is_from_loops else paths[0]
    result = work(file, out, board=board, demand=demand, recordings=recordings, progress=progress)
    if is_from_loops:
        result = replace(result, verified=verifying.verify(result.compiled))
    rows = result.verified.tables() if result.verified else []
    draw_all(result, [make_table(table.title, table.headings, table.cells) for table in rows])
    return result


def warnings(result: ForceControl) -> Sequence[str]:
    """Return the warnings about the simulated magnet that the loops give rise to."""
    return result.plant.warnings


def show(result: ForceControl, _: Mapping[str, Any]) -> Iterator[OutputPart]:
    """Return the terminal output: the errors of each controller, and the verification of the C."""
    from anhyst_rigs.reports.force import terminal_summary, written_files
    from anhyst_rigs.reports.studies import study_output

    yield from study_output(result, terminal_summary(result), written_files(result))
    if result.verified:
        yield from verifying.show(result.verified, {})


def refuse(result: ForceControl, _: Mapping[str, Any]) -> None:
    """Raise NegativeResult if a force was lost or a bit differs."""
    result.refuse_losses()
    if result.verified:
        verifying.require_equal_bits(result.verified, result.compiled)
