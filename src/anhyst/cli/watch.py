"""The verb ``watch``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import anhyst
from anhyst.cli.console import print_json, show
from anhyst.cli.options import AsJson, ModelPath
from anhyst.support.errors import InputError, NegativeResult


def watch(
    model: ModelPath,
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING", help="CSV of one run: t_s, I_A, F_N and gap_m, which may move."
        ),
    ],
    least: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="Smallest drift worth an alarm. [default: a thousandth of the model's largest "
            "force]",
            show_default=False,
        ),
    ] = None,
    run_length: Annotated[
        float, typer.Option(metavar="CYCLES", min=100, help="Mean run to a false alarm.")
    ] = 1e5,
    as_json: AsJson = False,
) -> None:
    """Say whether a model still fits its magnet, or since when it has drifted and by how much.

    The first cycles of the current in the recording show what the model leaves while it fits; every
    later cycle is held against them. Exit code 1 where the model has drifted.

    Example: anhyst watch model.toml monday.csv
    """
    found = anhyst.watch(model, recording, least=least, run_length=run_length)
    if as_json:
        print_json(found.as_dict())
    if found.finding.drifted is not None:
        raise NegativeResult(str(found), code="drifted")
    if found.finding.learning:
        raise InputError(f"{recording}: too short to say: {found}; record more", code="too-short")
    if not as_json:
        show(str(found))
