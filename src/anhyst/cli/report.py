"""The verb ``report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import anhyst
from anhyst.cli.console import print_json, show, warn
from anhyst.cli.options import AsJson, ModelPath


def report(
    model: ModelPath,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="HTML file to write.")
    ] = Path("report.html"),
    as_json: AsJson = False,
) -> None:
    """Write the report of a model: one HTML file that needs nothing else.

    Measured against modelled loops at each gap, residuals, parameters over the gap, the cost of
    each reduction, uncertainty, verdict and provenance. The measurements that the model was
    identified from are read again; where they are missing or have changed, the report is written
    from the model alone and says so.

    Example: anhyst report model.toml --out report.html
    """
    from anhyst.support.atomic import check_writable

    check_writable(out, reads=[model])
    warnings = anhyst.report(model, out)
    for text in warnings:
        warn(text)
    if as_json:
        print_json({"out": str(out), "warnings": list(warnings)})
    else:
        show(f"{out} written")
