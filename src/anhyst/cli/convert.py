"""The verb ``convert``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

import anhyst
from anhyst.cli.console import print_json, show, warn
from anhyst.cli.options import AsJson, of_its_kind
from anhyst.cli.progress import progress_bar


def convert(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="A measurement in any format that is read, or a rig file.",
            callback=of_its_kind,
        ),
    ],
    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="To write: .csv, .mat, .mf4, .tdms, .h5 or .parquet; .toml for a rig.",
        ),
    ],
    as_json: AsJson = False,
) -> None:
    """Write a measurement in another file format, or a rig file in the format of today.

    Values stay bit for bit. Where a format cannot hold something, such as groups in a CSV, it is
    said; channels on several clocks are interpolated onto the finest for a CSV or Parquet file.

    Example: anhyst convert recording.mf4 recording.csv
    """
    with progress_bar(f"reading {source.name}") as progress:
        done = anhyst.convert(source, out, progress=progress)
    for text in done.notes:
        warn(text)
    if as_json:
        print_json(asdict(done))
    elif not done.channels:
        show(f"written: {done.out}")
    else:
        channels = "one channel" if done.channels == 1 else f"{done.channels} channels"
        show(f"{done.out}: {channels}, {done.samples} samples")
