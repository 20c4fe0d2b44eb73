"""The verb ``watch``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

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
    from anhyst.data.reading import read_loops
    from anhyst.model.file import read_model
    from anhyst.study.watch.recording import watch_recording

    if least is not None and not least > 0.0:
        raise InputError(
            f"--least: {least:g} N is not above 0; correct it", code="not-above-zero", key="--least"
        )
    found, rate = watch_recording(read_model(model), read_loops(recording), least, run_length)
    drifted = found.drifted
    if as_json:
        since = None if drifted is None else drifted.since / rate
        print_json(
            {
                "cycles": found.cycles,
                "learning": found.learning,
                "fits": drifted is None and not found.learning,
                "drift": None if drifted is None else drifted.name,
                "shift_N": None if drifted is None else drifted.shift,
                "since_s": since,
                "text": found.text(rate),
            }
        )
    if drifted is not None:
        raise NegativeResult(found.text(rate), code="drifted")
    if found.learning:
        raise InputError(
            f"{recording}: too short to say: {found.text(rate)}; record more", code="too-short"
        )
    if not as_json:
        show(found.text(rate))
