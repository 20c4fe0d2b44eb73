"""The verb ``verify``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anhyst.cli.console import print_json, progress_bar, show, table
from anhyst.cli.options import AsJson
from anhyst.errors import NegativeResult

if TYPE_CHECKING:
    from anhyst.verify import Verification


def verify(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A folder that 'anhyst compile' wrote.")
    ],
    on: Annotated[
        str,
        typer.Option(
            "--on",
            metavar="TARGETS",
            help="Where to run, separated by commas: host, cortex-m0plus, cortex-m3, cortex-m4, "
            "cortex-m7, avr, msp430, cortex-m3-qemu (a whole firmware).",
        ),
    ] = "host,cortex-m4",
    as_json: AsJson = False,
) -> None:
    """Run compiled C on real instruction sets and compare it bit for bit with the host.

    Golden vectors and random steps (a million on the host, ten thousand on each other target);
    instructions or cycles of a step, code size, memory and stack. Results are also written into
    the folder: verify.json and verify.md. A difference anywhere ends with exit code 1.

    Example: anhyst verify controller --on host,cortex-m4,avr
    """
    from anhyst.verify import verify as run
    from anhyst.verify.report import write_report

    with progress_bar("verifying") as progress:
        found = run(folder, on, progress=progress)
    write_report(found, folder)
    if as_json:
        print_json(found.as_dict())
    else:
        _show(found)
    if not found.passed:
        raise NegativeResult(f"{folder}: {found.first_failure()}")


def _show(found: Verification) -> None:
    from anhyst.verify.report import tables

    for rows in tables(found):
        shown = table(rows.title, rows.headings)
        for cells in rows.cells:
            shown.add_row(*cells)
        show(shown)
