"""What the verbs share: options, and what they print; results on standard output, all else on error.

Progress is a bar on a terminal and a line a minute elsewhere.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Event, Thread
from typing import TYPE_CHECKING, Annotated, Any, Union

import typer

from anhyst.cli.printing import WIDTH, TerminalTable, printer, wrapped
from anhyst.support.jobs import Progress

if TYPE_CHECKING:
    from anhyst.support.page import PageTable


def of_its_kind(context: typer.Context, value: Any) -> Any:
    """Refuse a first argument of another kind than the verb takes, and name the verbs that do."""
    from anhyst.support.kinds import kinds_for, refuse_other

    verb = str(context.info_name)
    given = value if isinstance(value, list) else [value] if value else []
    taken = kinds_for(verb)
    for path in given if taken else []:
        refuse_other(path, taken, verb)
    return value


AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


def _print_all(asked_for: bool) -> bool:
    printer.is_verbose = asked_for
    return asked_for


Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose", help="Print all lines and columns, not only the first 25.", callback=_print_all
    ),
]


def say_error(text: str) -> None:
    """Print the one line that bad input gets."""
    print(f"anhyst: error: {one_line(text)}", file=sys.stderr)


def warn(text: str) -> None:
    """Print a warning as one line, which a terminal folds between words."""
    line = f"anhyst: warning: {one_line(text)}"
    lines = wrapped(line, WIDTH) if sys.stderr.isatty() else [line]
    print(*lines, sep="\n", file=sys.stderr)


def one_line(text: str) -> str:
    """Fold a text into one line, with nothing in it that would steer a terminal."""
    folded = " ".join(text.split())
    return "".join(sign if sign.isprintable() else "?" for sign in folded)


Part = Union[str, TerminalTable, "PageTable"]
"""A sentence or a table that a verb shows."""


def show(*parts: Part) -> None:
    """Print tables and lines for a person, the most useful first."""
    for part in parts:
        if isinstance(part, str | TerminalTable):
            printer.print([part])
        else:  # a table of a page, and what is below it
            rows = [
                [cell.text.replace("\N{NO-BREAK SPACE}", " ") for cell in row] for row in part.rows
            ]
            drawn = TerminalTable(part.title, part.head, rows)
            printer.print([drawn, part.caption] if part.caption else [drawn])


def show_with(warnings: Sequence[str], *parts: Part) -> None:
    """Print tables and lines, and then warnings, for which lines are kept free."""
    printer.reserve(warnings)
    show(*parts)
    for text in warnings:
        warn(text)


SILENCE = 60.0
"""Seconds between two lines where there is no terminal."""
_LEAST = 0.01
"""Part of the work from which on it is known how fast it goes."""


class Pace:
    """How far work is, and how long it will still take at the rate seen so far."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._begun = clock()
        self.share = 0.0
        """Part of the work that is done, 0 to 1; it never falls."""

    def update(self, done: float, total: float) -> None:
        """Take what is done and what there is in all."""
        if total > 0.0:
            self.share = max(self.share, min(done / total, 1.0))

    def left(self) -> float | None:
        """Return the seconds that it will still take; None where nothing is known of that."""
        if not _LEAST <= self.share < 1.0:
            return None
        return (self._clock() - self._begun) * (1.0 - self.share) / self.share

    def __str__(self) -> str:
        """Say it in a few words: "34 %, 2 min so far, about 4 min left"."""
        so_far = f"{100.0 * self.share:.0f} %, {_duration(self._clock() - self._begun)} so far"
        left = self.left()
        return so_far if left is None else f"{so_far}, about {_duration(left)} left"


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """Show how far long work is: a bar on a terminal, a line a minute where there is none."""
    with (_bar if sys.stderr.isatty() else _lines)(title) as update:
        yield update


@contextmanager
def _bar(title: str) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    pace = Pace()
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[pace]}"))
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=1.0, pace=pace)

        def update(done: float, total: float) -> None:
            pace.update(done, total)
            bar.update(task, completed=pace.share)

        yield update


@contextmanager
def _lines(title: str) -> Iterator[Progress]:
    pace = Pace()
    over = Event()

    def speak() -> None:
        while not over.wait(SILENCE):
            print(f"anhyst: {title}: {pace}", file=sys.stderr, flush=True)

    # Not from where progress is reported: a step may take longer than a minute.
    speaker = Thread(target=speak, name="anhyst-progress", daemon=True)
    speaker.start()
    try:
        yield pace.update
    finally:
        over.set()
        speaker.join()
