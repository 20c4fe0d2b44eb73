"""The verb ``init``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import anhyst
from anhyst.cli.console import print_json, progress_bar, show
from anhyst.cli.options import (
    AsJson,
    Clean,
    Columns,
    Constants,
    LoopColumn,
    LoopHistory,
    Schedule,
    Sidecar,
    of_its_kind,
    read_options,
)

if TYPE_CHECKING:
    from anhyst import Drafted

_NAMED = 6
"""Files that are named one by one."""


def init(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder to write to.")],
    loops: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[LOOPS]", help="CSV files, or folders of them.", callback=of_its_kind
        ),
    ] = None,
    mass: Annotated[
        float | None,
        typer.Option(metavar="KG", help="What moves. [default: the load is its weight]"),
    ] = None,
    load: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="Force that pulls the gap open. [default: the weight of the mass, or half the "
            "force at the largest gap]",
        ),
    ] = None,
    gap: Annotated[
        float | None,
        typer.Option(metavar="M", help="Where it works. [default: the middle of the loops' gaps]"),
    ] = None,
    force_control: Annotated[
        bool, typer.Option("--force-control", help="Instead, a rig whose force is controlled.")
    ] = False,
    example: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Instead, copy an example that comes with anhyst: 'bearing', 'electromagnet', "
            "'magnetostrictive', 'piezo', 'solenoid' or 'stage'.",
        ),
    ] = None,
    columns: Columns = None,
    sidecar: Sidecar = None,
    schedule: Schedule = None,
    loop: LoopColumn = None,
    constants: Constants = None,
    history: LoopHistory = None,
    clean: Clean = None,
    as_json: AsJson = False,
) -> None:
    """Begin: write a rig of your own from measured loops, ready to run.

    A folder with rig.toml, controller.toml and a copy of the loops comes out; it can be moved.
    What the loops say is taken from them, the rest is guessed by rules, and every guess is marked
    as one in the files. What is there already is not written over.

    Example: anhyst init loops.csv --mass 0.8 --load 60 --gap 0.45e-3 --out my

    Example: anhyst init loops.csv --force-control --out my

    Example: anhyst init --example bearing --out my
    """
    options = read_options(columns, sidecar, schedule, loop, constants, history, clean)
    with progress_bar("reading") as progress:
        drafted = anhyst.init(
            out,
            loops,
            mass=mass,
            load=load,
            gap=gap,
            force_control=force_control,
            example=example,
            progress=progress,
            **asdict(options),
        )
    if as_json:
        print_json(drafted.as_dict())
    else:
        _show(drafted)


def _show(drafted: Drafted) -> None:
    show(*drafted.found)
    if drafted.guessed:
        show("guessed:", *(f"  {key}: {why}" for key, why in drafted.guessed.items()))
    count = sum(map(len, drafted.guesses.values()))
    if count:
        show(f"{count} keys are guesses, each marked 'guess' in its line; write your numbers there")
    named, others = drafted.files[:_NAMED], len(drafted.files[_NAMED:])
    more = f" and {others} more" if others else ""
    show(f"written to {drafted.out}: {', '.join(named)}{more}")
    show("next:", *(f"  {command}" for command in drafted.run))
