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

from anhyst.cli.printing import WIDTH, TerminalTable, printer, wrap_sentence
from anhyst.support.jobs import Progress

if TYPE_CHECKING:
    from anhyst.support.page import PageTable


def check_file_kind(context: typer.Context, value: Any) -> Any:
    """Refuse a first argument of another kind than the verb takes, and name the verbs that do."""
    from anhyst.support.kinds import accepted_kinds, require_kind

    verb = str(context.info_name)
    paths = value if isinstance(value, list) else [value] if value else []
    accepted = accepted_kinds(verb)
    for path in paths if accepted else []:
        require_kind(path, accepted, verb)
    return value


AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


def _set_verbose(is_requested: bool) -> bool:
    printer.is_verbose = is_requested
    return is_requested


Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose",
        help="Print all lines and columns, not only the first 25.",
        callback=_set_verbose,
    ),
]


def print_error(text: str) -> None:
    """Print the one line that bad input gets."""
    print(f"anhyst: error: {fold_to_line(text)}", file=sys.stderr)


def print_warning(text: str) -> None:
    """Print a warning as one line, which a terminal folds between words."""
    line = f"anhyst: warning: {fold_to_line(text)}"
    lines = wrap_sentence(line, WIDTH) if sys.stderr.isatty() else [line]
    print(*lines, sep="\n", file=sys.stderr)


def fold_to_line(text: str) -> str:
    """Fold a text into one line, with nothing in it that would steer a terminal."""
    folded = " ".join(text.split())
    return "".join(sign if sign.isprintable() else "?" for sign in folded)


OutputPart = Union[str, TerminalTable, "PageTable"]
"""A sentence or a table that a verb shows."""


def print_parts(*parts: OutputPart) -> None:
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


def print_with_warnings(warnings: Sequence[str], *parts: OutputPart) -> None:
    """Print tables and lines, and then warnings, for which lines are kept free."""
    printer.reserve(warnings)
    print_parts(*parts)
    for text in warnings:
        print_warning(text)


PROGRESS_INTERVAL_S = 60.0
"""Seconds between two lines where there is no terminal."""
_MIN_SHARE_FOR_ESTIMATE = 0.01
"""Part of the work from which on it is known how fast it goes."""


class ProgressEstimate:
    """How far work is, and how long it will still take at the rate seen so far."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._start_time = clock()
        self.share = 0.0
        """Part of the work that is done, 0 to 1; it never falls."""

    def update(self, done: float, total: float) -> None:
        """Take what is done and what there is in all."""
        if total > 0.0:
            self.share = max(self.share, min(done / total, 1.0))

    def remaining_s(self) -> float | None:
        """Return the seconds that it will still take; None where nothing is known of that."""
        if not _MIN_SHARE_FOR_ESTIMATE <= self.share < 1.0:
            return None
        return (self._clock() - self._start_time) * (1.0 - self.share) / self.share

    def __str__(self) -> str:
        """Say it in a few words: "34 %, 2 min so far, about 4 min left"."""
        elapsed_text = (
            f"{100.0 * self.share:.0f} %, {_duration_text(self._clock() - self._start_time)} so far"
        )
        remaining = self.remaining_s()
        return (
            elapsed_text
            if remaining is None
            else f"{elapsed_text}, about {_duration_text(remaining)} left"
        )


def _duration_text(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """Show how far long work is: a bar on a terminal, a line a minute where there is none."""
    with (_show_bar if sys.stderr.isatty() else _print_lines)(title) as update:
        yield update


@contextmanager
def _show_bar(title: str) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    estimate = ProgressEstimate()
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[pace]}"))
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=1.0, pace=estimate)

        def update(done: float, total: float) -> None:
            estimate.update(done, total)
            bar.update(task, completed=estimate.share)

        yield update


@contextmanager
def _print_lines(title: str) -> Iterator[Progress]:
    estimate = ProgressEstimate()
    finished = Event()

    def print_progress() -> None:
        while not finished.wait(PROGRESS_INTERVAL_S):
            print(f"anhyst: {title}: {estimate}", file=sys.stderr, flush=True)

    # Not from where progress is reported: a step may take longer than a minute.
    printer_thread = Thread(target=print_progress, name="anhyst-progress", daemon=True)
    printer_thread.start()
    try:
        yield estimate.update
    finally:
        finished.set()
        printer_thread.join()
