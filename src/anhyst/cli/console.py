"""What the verbs say and where: results on standard output, everything else on standard error."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from anhyst.support.json_text import json_text

if TYPE_CHECKING:
    from rich.table import Table

    from anhyst.support.units import Quantity


def say_error(text: str) -> None:
    """Print the one line that bad input gets."""
    print(f"anhyst: error: {one_line(text)}", file=sys.stderr)


def warn(text: str) -> None:
    """Print a warning as one line."""
    print(f"anhyst: warning: {one_line(text)}", file=sys.stderr)


def one_line(text: str) -> str:
    """Fold a text into one line, with nothing in it that would steer a terminal."""
    folded = " ".join(text.split())
    return "".join(sign if sign.isprintable() else "?" for sign in folded)


def print_json(result: Mapping[str, Any]) -> None:
    """Print a result as JSON; numbers that JSON does not have become null."""
    print(json_text(result), end="")


def table(title: str, headers: Sequence[str]) -> Table:
    """Start a table; columns after the first are numbers."""
    from rich.table import Table

    result = Table(title=title, title_justify="left", title_style="bold", header_style="bold")
    for place, header in enumerate(headers):
        result.add_column(header, justify="right" if place else "left")
    return result


def in_small_units(quantity: Quantity | None) -> tuple[str, float]:
    """Return the heading of a scheduling variable and what to multiply it by: gaps in mm."""
    if quantity is None:
        return "", 1.0
    if quantity.unit == "m":
        return f"{quantity.symbol} mm", 1e3
    return f"{quantity.symbol} {quantity.unit}", 1.0


def show(*parts: str | Table) -> None:
    """Print tables and lines for a person."""
    from rich.console import Console

    terminal = sys.stdout.isatty()
    # In a pipe nobody looks at the width: a table is not to be squeezed.
    console = Console(highlight=False, width=None if terminal else 200, soft_wrap=not terminal)
    for part in parts:
        console.print(part, markup=False)
