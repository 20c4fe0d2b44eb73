"""Print tables and sentences in 80 columns, with at most 25 lines unless ``--verbose`` is given.

A table that is too wide loses its last columns, and a text that is too long loses its last lines. A
last line says what was left out. Therefore, verbs print the most useful lines first.
"""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from anhyst.support.wording import count_text

WIDTH = 80
"""Width of the output if it is not a terminal, in columns."""
MAX_LINES = 25
"""Maximum number of lines that a command prints without ``--verbose``."""
MIN_LINES = 12
"""Minimum number of lines for results, even if there are many warnings."""
MAX_CELL_WIDTH = 34
"""Width beyond which the text of a cell is wrapped, in columns."""
_COLUMN_GAP = "  "
_INDENT = "    "
_VALUE_WITH_UNIT_PATTERN = re.compile(r"(\d) (%|[A-Za-zµ]{1,2}\b)")
_NUMBER_PATTERN = re.compile(r"[-+<>~]?\d")


@dataclass
class TerminalTable:
    """A table with a title. The first column and columns of words are aligned to the left."""

    title: str
    head: Sequence[str]
    rows: list[list[str]] = field(default_factory=list)

    def add_row(self, *cells: str) -> None:
        """Add a row."""
        self.rows.append(list(cells))

    def lines(self, width: int, *, is_verbose: bool) -> list[str]:
        """Return the table as text.

        Columns that do not fit are named, or with `is_verbose` follow in further tables.
        """
        columns = [
            _Column(name, [row[index] for row in self.rows], is_first=index == 0)
            for index, name in enumerate(self.head)
        ]
        label_column, remaining_columns = columns[0], columns[1:]
        blocks: list[list[_Column]] = []
        while remaining_columns or not blocks:
            fitting_columns = [label_column]
            while (
                remaining_columns
                and sum(
                    column.width + len(_COLUMN_GAP) for column in (*fitting_columns, remaining_columns[0])
                )
                <= width + 2
            ):
                fitting_columns.append(remaining_columns.pop(0))
            if len(fitting_columns) == 1 and remaining_columns:
                fitting_columns.append(remaining_columns.pop(0))
            blocks.append(fitting_columns)
        text = wrap_sentence(self.title, width) if self.title else []
        for block in blocks if is_verbose else blocks[:1]:
            text += _table_lines(block)
        hidden_columns = [column.name for block in blocks[1:] for column in block[1:] if column.name]
        if hidden_columns and not is_verbose:
            text += wrap_sentence(f"more columns with --verbose: {', '.join(hidden_columns)}", width)
        return text


class _Column:
    """A column of a table with wrapped cells."""

    def __init__(self, name: str, cells: Sequence[str], *, is_first: bool) -> None:
        self.name = name
        self.head = textwrap.wrap(name, MAX_CELL_WIDTH) or [""]
        self.cells = [textwrap.wrap(cell, MAX_CELL_WIDTH) or [""] for cell in cells]
        lines = [line for cell in (self.head, *self.cells) for line in cell]
        self.width = max(map(len, lines))
        first_lines = [cell[0] for cell in self.cells if cell[0]]
        has_numbers = sum(map(bool, map(_NUMBER_PATTERN.match, first_lines))) > len(first_lines) // 2
        self.is_right = has_numbers and not is_first

    def pad_text(self, text: str) -> str:
        return text.rjust(self.width) if self.is_right else text.ljust(self.width)


def _table_lines(columns: Sequence[_Column]) -> list[str]:
    """Return the lines of a table: the heading, then the rows."""
    lines = []
    for cells in zip(*([table_column.head, *table_column.cells] for table_column in columns), strict=True):
        for index in range(max(map(len, cells))):
            padded_cells = (
                column.pad_text(cell[index] if index < len(cell) else "")
                for column, cell in zip(columns, cells, strict=True)
            )
            lines.append(_COLUMN_GAP.join(padded_cells).rstrip())
    return lines


def wrap_sentence(text: str, width: int) -> list[str]:
    """Wrap a sentence between words; a path and a command to paste stay in one piece."""
    if text.lstrip().startswith("anhyst "):
        return [text]
    indent = text[: len(text) - len(text.lstrip())]
    lines = textwrap.wrap(
        _VALUE_WITH_UNIT_PATTERN.sub("\\1\N{NO-BREAK SPACE}\\2", text),
        width,
        subsequent_indent=indent + _INDENT,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines] or [""]


@dataclass
class Printer:
    """Prints the output of a command, and counts its lines."""

    is_verbose: bool = False
    used_lines: int = 0
    max_lines: int = MAX_LINES
    pending: list[str] = field(default_factory=list)

    def reserve(self, texts: Iterable[str]) -> None:
        """Reserve lines for warnings."""
        needed_lines = sum(-(-len(text) // WIDTH) for text in texts)
        self.max_lines = max(MIN_LINES, MAX_LINES - needed_lines)

    def print(self, output_parts: Iterable[str | TerminalTable]) -> None:
        """Print tables and sentences while there are lines left, and keep the rest for `finish`.

        A sentence is printed completely or not at all. After a part that did not fit, nothing more
        is printed.
        """
        width = _output_width()
        for output_part in output_parts:
            if isinstance(output_part, TerminalTable):
                lines = output_part.lines(width, is_verbose=self.is_verbose)
                lines_that_fit = len(lines) if self.is_verbose else self.max_lines - 1 - self.used_lines
            else:
                lines = [line for text in output_part.split("\n") for line in wrap_sentence(text, width)]
                has_room = self.is_verbose or self.used_lines + len(lines) < self.max_lines
                lines_that_fit = len(lines) if has_room else 0
            lines_that_fit = 0 if self.pending else max(lines_that_fit, 0)
            for index, line in enumerate(lines[:lines_that_fit]):
                _print_line(line, is_bold=isinstance(output_part, TerminalTable) and index == 0)
            self.used_lines += len(lines[:lines_that_fit])
            self.pending += lines[lines_that_fit:]

    def finish(self) -> None:
        """Print the pending lines if they fit, or else the number of pending lines."""
        if self.used_lines + len(self.pending) <= self.max_lines:
            for line in self.pending:
                _print_line(line)
        elif self.pending:
            _print_line(f"{count_text(len(self.pending), 'more line')}: --verbose")
        self.pending = []


def _output_width() -> int:
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else WIDTH


def _print_line(line: str, *, is_bold: bool = False) -> None:
    if is_bold and sys.stdout.isatty():
        from rich.console import Console

        Console(highlight=False).print(line, style="bold", markup=False, soft_wrap=True)
    else:
        print(line)


printer = Printer()
"""The printer of the current command."""


def start_printing() -> None:
    """Reset the line count for another command."""
    printer.is_verbose, printer.used_lines, printer.max_lines = False, 0, MAX_LINES
    printer.pending = []
