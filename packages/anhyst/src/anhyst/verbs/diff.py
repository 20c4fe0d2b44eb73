"""The command ``diff``: compare two models."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anhyst.cli.shared import OutputPart
    from anhyst.model.actuator import Model
    from anhyst.model.diff import ModelDiff
    from anhyst.support.atomic import PathLike

PLACE = 16, "From measurements to a model"


def diff(first: Model | PathLike, second: Model | PathLike) -> ModelDiff:
    """Show the differences between two models, in their parameters and in their output.

    The command compares steady-state loops over the range of the drive in which both models are
    valid, at the gaps of both models and midway between them. Differences are in the unit of the
    output, N for a force.

    Parameters
    ----------
    first : Model or path-like, ``A``
        A model.toml.
    second : Model or path-like, ``B``
        Another model.toml.

    Returns
    -------
    ModelDiff

    Raises
    ------
    InputError
        The models have different quantities.

    Examples
    --------
    anhyst diff old.toml new.toml
    """
    from anhyst.model.diff import diff as work

    return work(first, second)


def as_json(result: ModelDiff, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result for ``--json``."""
    from dataclasses import asdict

    from anhyst.model.actuator import read_model

    unit = read_model(arguments["first"]).output.unit
    return asdict(result) | {"same": result.same, "unit": unit}


def show(result: ModelDiff, arguments: Mapping[str, Any]) -> Iterator[OutputPart]:
    """Return the terminal output: changed parameters and the differences of the predicted loops."""
    from anhyst.cli.printing import TerminalTable
    from anhyst.model.actuator import read_model
    from anhyst.support.units import schedule_scale

    if result.same:
        yield "the two models give the same results"
        return
    model, other_model = read_model(arguments["first"]), read_model(arguments["second"])
    names = {name: key for name, (_, key) in {**model.file_keys, **other_model.file_keys}.items()}
    changes_table = TerminalTable("different", ["", "A", "B", "change"])
    for change in (*result.settings, *result.parameters):
        changes_table.add_row(
            names.get(change.name, change.name),
            _format_value(change.first),
            _format_value(change.second),
            _format_change(change.first, change.second) if change.name in names else "",
        )
    yield changes_table
    if result.drive is None:
        yield result.note
        return
    unit, drive = model.output.unit, model.input
    low, high = result.drive
    title = f"steady-state loops, {drive.symbol} from {low:g} to {high:g} {drive.unit}"
    schedule_heading, scale = schedule_scale(model.schedule)
    headings = [
        schedule_heading,
        f"largest [{unit}]",
        f"mean difference [{unit}]",
        f"worst [{unit}]",
        "worst at",
    ]
    loops = TerminalTable(title, headings)
    for loop in result.loops:
        loops.add_row(
            "" if loop.schedule is None else f"{scale * loop.schedule:.6g}",
            f"{loop.largest_output:.5g}",
            f"{loop.mean:.4g}",
            f"{loop.worst:.4g}",
            f"{loop.at_drive:.4g} {drive.unit}",
        )
    yield loops
    yield f"all together: mean {result.mean:.4g} {unit}, worst {result.worst:.4g} {unit}"


def _format_value(value: float | tuple[float, ...] | str | None) -> str:
    if isinstance(value, tuple):
        return ", ".join(f"{number:.6g}" for number in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return value or "none"


def _format_change(first_value: object, second_value: object) -> str:
    if isinstance(first_value, float) and isinstance(second_value, float) and first_value:
        return f"{100.0 * (second_value / first_value - 1.0):+.3g} %"
    return ""
