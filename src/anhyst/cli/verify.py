"""The verb ``verify``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import anhyst
from anhyst.cli.console import print_json, show, table
from anhyst.cli.options import AsJson, of_its_kind
from anhyst.cli.progress import progress_bar
from anhyst.support.errors import InputError, NegativeResult

if TYPE_CHECKING:
    from anhyst import Verification


def verify(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR", help="A folder that 'anhyst compile' wrote.", callback=of_its_kind
        ),
    ],
    on: Annotated[
        str | None,
        typer.Option(
            "--on",
            metavar="TARGETS",
            help="Where to run, separated by commas: host, cortex-m0plus, cortex-m3, cortex-m4, "
            "cortex-m33, cortex-m7, avr, msp430, cortex-m3-qemu (a whole firmware). [default: host,cortex-m4, "
            "as far as there are tools]",
            show_default=False,
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run compiled C on real instruction sets and compare it bit for bit with the host.

    Golden vectors and random steps (a million on the host, ten thousand on each other target);
    instructions or cycles of a step, code size, memory and stack. Results are also written into
    the folder: verify.json and verify.md. A difference anywhere ends with exit code 1. Where tools
    are missing, what can run runs, and a table says what brings the rest; a target that was named
    and did not run ends with exit code 2.

    Example: anhyst verify controller --on host,cortex-m4,avr
    """
    found = run_and_write(folder, on)
    if as_json:
        print_json(found.as_dict())
    else:
        show_tables(found)
    refuse_difference(folder, found)
    if on is not None and found.not_run:
        lacking = [one.text() for one in found.missing if one.target in found.not_run]
        raise InputError(
            f"--on: not run for want of tools: {'; '.join(lacking)}",
            code="tool-missing",
            key="--on",
        )


def run_and_write(folder: Path, on: str | None = None) -> Verification:
    """Verify a folder and write the outcome into it."""
    from anhyst.verification.report import write_report

    with progress_bar("verifying") as progress:
        found = anhyst.verify(folder, on, progress=progress)
    write_report(found, folder)
    return found


def refuse_difference(folder: Path, found: Verification) -> None:
    """Raise NegativeResult where a bit differs."""
    if not found.passed:
        raise NegativeResult(f"{folder}: {found.first_failure()}", code="verification-failed")


def show_tables(found: Verification) -> None:
    """Print where bits are the same, and what a step costs."""
    from anhyst.verification.report import tables

    for rows in tables(found):
        shown = table(rows.title, rows.headings)
        for cells in rows.cells:
            shown.add_row(*cells)
        show(shown)
