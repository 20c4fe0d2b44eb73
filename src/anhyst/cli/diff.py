"""The verb ``diff``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import anhyst
from anhyst.cli.console import in_small_units, print_json, show, table
from anhyst.cli.options import AsJson, of_its_kind

if TYPE_CHECKING:
    from anhyst import Model, ModelDiff
    from anhyst.model.parameters import Parameter


def diff(
    first: Annotated[Path, typer.Argument(metavar="A", help="A model.toml.", callback=of_its_kind)],
    second: Annotated[
        Path, typer.Argument(metavar="B", help="Another model.toml.", callback=of_its_kind)
    ],
    as_json: AsJson = False,
) -> None:
    """Show what two models have different, and by how much in newtons.

    Compared are settled loops over the range of drive in which both models are valid, at the gaps
    of both and half-way between. The difference is in units of the output (N for a force).

    Example: anhyst diff old.toml new.toml
    """
    one, other = anhyst.read_model(first), anhyst.read_model(second)
    result = anhyst.diff(one, other)
    if as_json:
        print_json(asdict(result) | {"same": result.same, "unit": one.output.unit})
    else:
        _show(result, one, other)


def _show(result: ModelDiff, model: Model, other: Model) -> None:
    if result.same:
        show("the two models compute the same")
        return
    names = {name: key for name, (_, key) in {**model.keys, **other.keys}.items()}
    changes = table("different", ["", "A", "B", "change"])
    for change in (*result.settings, *result.parameters):
        changes.add_row(
            names.get(change.name, change.name),
            _text(change.first),
            _text(change.second),
            _relative(change.first, change.second) if change.name in names else "",
        )
    show(changes)
    if result.drive is None:
        show(result.note)
        return
    unit, drive = model.output.unit, model.input
    low, high = result.drive
    title = f"settled loops, {drive.symbol} from {low:g} to {high:g} {drive.unit}"
    at, scale = in_small_units(model.schedule)
    loops = table(title, [at, f"largest [{unit}]", f"mean apart [{unit}]", f"worst [{unit}]", "at"])
    for loop in result.loops:
        loops.add_row(
            "" if loop.schedule is None else f"{scale * loop.schedule:.6g}",
            f"{loop.largest_output:.5g}",
            f"{loop.mean:.4g}",
            f"{loop.worst:.4g}",
            f"{loop.at_drive:.4g} {drive.unit}",
        )
    show(loops, f"all together: mean {result.mean:.4g} {unit}, worst {result.worst:.4g} {unit}")


def _text(value: Parameter | str | None) -> str:
    if isinstance(value, tuple):
        return ", ".join(f"{number:.6g}" for number in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return value or "none"


def _relative(first: Parameter | str | None, second: Parameter | str | None) -> str:
    if isinstance(first, float) and isinstance(second, float) and first:
        return f"{100.0 * (second / first - 1.0):+.3g} %"
    return ""
