"""The command ``inspect``: show what was measured, and whether a hysteresis model is worthwhile."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anhyst.cli.printing import TerminalTable
    from anhyst.cli.shared import OutputPart
    from anhyst.data.inspection import Inspection, LoopFigures
    from anhyst.data.source import LoopSource
    from anhyst.data.table import ChannelFigures
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress

PLACE = 11, "From measurements to a model"
PROGRESS = "reading"


def inspect(
    loops: LoopSource, *, plot: PathLike | None = None, progress: Progress | None = None, **reading: Any
) -> Inspection:
    """Show how measured loops were read, and whether a hysteresis model is worth the effort.

    The command reports gaps, loops, ranges, sampling, offsets, drift, closure, noise, delay between
    the channels, saturation and repairs. The verdict states the width of the loops, the error of
    the best single-valued curve, and the largest possible gain of a model.

    Name the columns with their units: t_s, I_A, F_N, gap_m, H_A_per_m, B_T, psi_Wb, u_V, x_m, T_C,
    loop. 'I [mA]', 'gap (mm)' and a row of units are understood, too. For a recording (MAT, MDF 4,
    TDMS, HDF5, Parquet, Excel), the channels are listed first, with their probable meaning.

    Parameters
    ----------
    loops : Loops, path-like, list of path-like, data frame or dict
        CSV files, recordings or folders.
    plot : path-like, ``FILE``, optional
        Draw the loops (png, svg or pdf).
    progress : callable, optional
        Called with the bytes read and the size of the current file.
    **reading
        How files or columns are read: the keywords of `read_loops`, and ``clean``, the cleaning
        steps. The loops are not thinned, because that hides noise and delay.

    Returns
    -------
    Inspection

    Raises
    ------
    InputError
        The record contradicts its headers.

    Examples
    --------
    anhyst inspect loops.csv --plot loops.png
    """
    from anhyst.data.inspection import inspect as work
    from anhyst.data.inspection import plot_inspection
    from anhyst.data.source import load_loops
    from anhyst.support.atomic import check_picture, write_figure

    if plot is not None:
        check_picture(plot)
    loaded_loops, _ = load_loops(loops, "inspect: loops", reading, skipped_steps=("thin",), progress=progress)
    inspection = work(loaded_loops)
    if plot is not None:
        write_figure(plot_inspection(inspection, loaded_loops), plot)
    return inspection


def preview(arguments: Mapping[str, Any]) -> Iterator[TerminalTable]:
    """Return a table of the channels of a recording."""
    from anhyst.support.atomic import check_picture

    if arguments["plot"] is not None:
        check_picture(arguments["plot"])
    if channels := _list_channels(arguments):
        from anhyst.cli.printing import TerminalTable

        rows = TerminalTable("channels", ["name", "unit", "samples", "per s", "range", "is"])
        for channel in channels:
            range_text = "" if channel.low is None else f"{channel.low:.4g} to {channel.high:.4g}"
            rate = "" if channel.rate is None else f"{channel.rate:.6g}"
            rows.add_row(channel.name, channel.unit, str(channel.samples), rate, range_text, channel.role)
        yield rows


def as_json(result: Inspection, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result for ``--json``."""
    channels = _list_channels(arguments)
    content = {"channels": [asdict(channel) for channel in channels]} if channels else {}
    return result.as_dict() | content


def _list_channels(arguments: Mapping[str, Any]) -> list[ChannelFigures]:
    """Return the channels of a recording; empty for a text file, whose header names the columns."""
    from anhyst.data.formats import ChannelTable, open_table
    from anhyst.data.table import list_channels

    loops: Sequence[Path] = arguments["loops"]
    is_alone = len(loops) == 1 and not loops[0].is_dir() and not arguments["columns"]
    if not is_alone or not isinstance(open_table(loops[0]), ChannelTable):
        return []
    return list_channels(loops[0])


def show(inspection: Inspection, arguments: Mapping[str, Any]) -> Iterator[OutputPart]:
    """Return the terminal output: verdict, how the loops were read, and values of each loop."""
    from anhyst.cli.printing import TerminalTable
    from anhyst.support.units import choose_display_unit, schedule_scale
    from anhyst.support.wording import count_text

    drive, output_quantity, schedule = inspection.input, inspection.output, inspection.schedule
    schedule_heading, scale = schedule_scale(schedule)
    headers = ["loop", *([schedule_heading] if schedule else []), "rows"]
    largest_output = max(
        max(abs(loop_figures.output_low), abs(loop_figures.output_high)) for loop_figures in inspection.loops
    )
    unit, output_factor = choose_display_unit(output_quantity, largest_output)
    headers += [f"{drive.symbol} {drive.unit}", f"{output_quantity.symbol} {unit}"]
    headers += [f"width {drive.unit}", f"noise {unit}"]
    headers += ["history", "cycles", f"drift {unit}", f"closure {unit}", "delay", "saturation"]
    loops = count_text(len(inspection.loops), "loop")
    loop_table = TerminalTable(f"{loops}, {drive.name} to {output_quantity.name}", headers)
    for loop in inspection.loops:
        loop_table.add_row(*_loop_row(loop, scale if schedule else None, output_factor))
    # The histories come last, because the table also shows the histories.
    histories = tuple(note for note in inspection.notes if ": history of loop" in note)
    reading_notes = tuple(note for note in inspection.notes if note not in histories)
    yield "is it worth it?"
    yield from _indent(inspection.verdict.sentences)
    yield from _with_title("read", reading_notes)
    yield from _with_title("repaired", inspection.repairs)
    yield from _with_title("speed", (inspection.rate,) if inspection.rate else ())
    yield loop_table
    yield from _with_title("histories", histories)
    if arguments["plot"] is not None:
        yield f"{arguments['plot']} written"


def _loop_row(loop: LoopFigures, scale: float | None, output_factor: float) -> list[str]:
    from anhyst.cli.printing import MAX_CELL_WIDTH, printer

    cells, history = [loop.label], str(loop.history)
    if len(history) > MAX_CELL_WIDTH:
        history = f"{history[: MAX_CELL_WIDTH - 1]}…"
    if scale is not None:
        cells.append("moves" if loop.schedule is None else f"{scale * loop.schedule:.6g}")
    delay = "unknown"  # delay in s, or in samples without a time column
    if loop.skew is not None:
        delay = f"{loop.skew:.3g} samples" if loop.skew_s is None else f"{loop.skew_s:.3g} s"
    return [
        *cells,
        str(loop.samples),
        f"{loop.input_low:.4g} to {loop.input_high:.4g}",
        f"{output_factor * loop.output_low:.4g} to {output_factor * loop.output_high:.4g}",
        _format_value(loop.width),
        _format_value(loop.noise, output_factor),
        history if printer.is_verbose else loop.history.kind,
        f"{loop.cycles:g}",
        _format_value(loop.drift, output_factor),
        _format_value(loop.closure, output_factor),
        delay,
        _format_value(loop.saturation),
    ]


def _format_value(value: float | None, scale: float = 1.0) -> str:
    return "" if value is None else f"{scale * value:.3g}"


def _with_title(title: str, texts: Sequence[str]) -> list[str]:
    return [f"{title}:", *_indent(texts)] if texts else []


def _indent(texts: Sequence[str]) -> list[str]:
    return [f"  {text}" for text in texts]
