"""Functions that all commands share: options, messages and progress.

Results go to standard output, everything else to standard error. Progress is a bar on a
terminal, and elsewhere one line per minute.
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
from anhyst.support.jobs import Progress, listen_to_steps

if TYPE_CHECKING:
    from anhyst.support.page import PageTable


def check_file_kind(context: typer.Context, given_paths: Any) -> Any:
    """Raise an error if the command does not accept this kind of file; name the commands that do."""
    from anhyst.support.kinds import accepted_kinds, require_kind

    verb = str(context.info_name)
    paths = given_paths if isinstance(given_paths, list) else [given_paths] if given_paths else []
    kinds = accepted_kinds(verb)
    for path in paths if kinds else []:
        require_kind(path, kinds, verb)
    return given_paths


AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


def _set_verbose(is_requested: bool) -> bool:
    printer.is_verbose = is_requested
    return is_requested


Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose", help="Print all lines and columns, not only the first 25.", callback=_set_verbose
    ),
]


def print_error(text: str) -> None:
    """Print an input error as one line."""
    print(f"anhyst: error: {fold_to_line(text)}", file=sys.stderr)


def print_warning(text: str) -> None:
    """Print a warning as one line, which is wrapped between words on a terminal."""
    line = f"anhyst: warning: {fold_to_line(text)}"
    lines = wrap_sentence(line, WIDTH) if sys.stderr.isatty() else [line]
    print(*lines, sep="\n", file=sys.stderr)


def fold_to_line(text: str) -> str:
    """Fold a text into one line, and replace control characters by question marks."""
    folded_text = " ".join(text.split())
    return "".join(character if character.isprintable() else "?" for character in folded_text)


OutputPart = Union[str, TerminalTable, "PageTable"]
"""A sentence or a table of the terminal output."""


def print_parts(*output_parts: OutputPart) -> None:
    """Print tables and sentences. The most useful ones must come first."""
    for output_part in output_parts:
        if isinstance(output_part, str | TerminalTable):
            printer.print([output_part])
        else:  # a table of a page, and its caption
            rows = [
                [cell.text.replace("\N{NO-BREAK SPACE}", " ") for cell in row] for row in output_part.rows
            ]
            drawn_parts = TerminalTable(output_part.title, output_part.head, rows)
            printer.print([drawn_parts, output_part.caption] if output_part.caption else [drawn_parts])


def print_with_warnings(warnings: Sequence[str], *output_parts: OutputPart) -> None:
    """Print tables and sentences, then the warnings, for which lines are reserved."""
    printer.reserve(warnings)
    print_parts(*output_parts)
    for text in warnings:
        print_warning(text)


PROGRESS_INTERVAL_S = 60.0
"""Time between two progress lines without a terminal, s."""
_MIN_SHARE_FOR_ESTIMATE = 0.01
"""Fraction of the work that must be done before the remaining time is estimated."""


class ProgressEstimate:
    """The fraction of the work that is done, and the remaining time at the average speed."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._start_time = clock()
        self.share = 0.0
        """Fraction of the work that is done, 0 to 1; it never decreases."""

    def update(self, done: float, total: float) -> None:
        """Set the work done and the total work, in the same unit."""
        if total > 0.0:
            self.share = max(self.share, min(done / total, 1.0))

    def remaining_s(self) -> float | None:
        """Return the estimated remaining time, s; None before 1 % of the work and after its end."""
        if not _MIN_SHARE_FOR_ESTIMATE <= self.share < 1.0:
            return None
        return (self._clock() - self._start_time) * (1.0 - self.share) / self.share

    def __str__(self) -> str:
        """Return a short text, such as "34 %, 2 min so far, about 4 min left"."""
        elapsed_text = (
            f"{100.0 * self.share:.0f} %, {_duration_text(self._clock() - self._start_time)} so far"
        )
        remaining = self.remaining_s()
        return (
            elapsed_text if remaining is None else f"{elapsed_text}, about {_duration_text(remaining)} left"
        )


def _duration_text(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """Show the progress of long work: a bar on a terminal, otherwise one line per minute."""
    with (_show_bar if sys.stderr.isatty() else _print_lines)(title) as update:
        yield update


@contextmanager
def _show_bar(title: str) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    estimate = ProgressEstimate()
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[pace]}"))
    bar = Bar(*columns, console=Console(stderr=True), transient=True, redirect_stdout=sys.stdout.isatty())
    with bar:
        task = bar.add_task(title, total=1.0, pace=estimate)

        def update(done: float, total: float) -> None:
            estimate.update(done, total)
            bar.update(task, completed=estimate.share)

        yield update


@contextmanager
def _print_lines(title: str) -> Iterator[Progress]:
    estimate = ProgressEstimate()
    has_finished = Event()

    def print_progress() -> None:
        while not has_finished.wait(PROGRESS_INTERVAL_S):
            print(f"anhyst: {title}: {estimate}", file=sys.stderr, flush=True)

    # A separate thread, because a step of the work can take longer than a minute.
    printer_thread = Thread(target=print_progress, name="anhyst-progress", daemon=True)
    printer_thread.start()
    try:
        yield estimate.update
    finally:
        has_finished.set()
        printer_thread.join()


@contextmanager
def print_steps() -> Iterator[None]:
    """Print each step of the work with its time as soon as it has ended."""
    running: list[tuple[str, float]] = []  # the step that runs, and the time at which it began, s

    def end_step(next_work: str = "") -> None:
        now = time.monotonic()
        for work, begin in running:
            print(f"{work}: {now - begin:.1f} s")
        running[:] = [(next_work, now)]

    with listen_to_steps(end_step):
        yield
    end_step()
