"""Terminal output: 80 columns, 25 lines, the most useful lines first."""

from __future__ import annotations

import json

import pytest

from anhyst.cli.printing import MAX_LINES, MIN_LINES, WIDTH, Printer, TerminalTable, wrap_sentence
from tests.repository import ROOT

from .command import quick, unwrapped

EXAMPLES = ROOT / "examples"


def printed(capsys: pytest.CaptureFixture[str], printer: Printer, *parts: str | TerminalTable) -> list[str]:
    printer.print(parts)
    printer.finish()
    return capsys.readouterr().out.splitlines()


def wide(columns: int, rows: int = 3) -> TerminalTable:
    table = TerminalTable("wide", ["name", *(f"column {n}" for n in range(columns))])
    for row in range(rows):
        table.add_row(f"row {row}", *(f"{n + 0.125 * row:.4f}" for n in range(columns)))
    return table


def test_table_names_the_columns_that_do_not_fit() -> None:
    lines = wide(12).lines(WIDTH, is_verbose=False)
    assert max(map(len, lines)) <= WIDTH
    assert lines[0] == "wide"
    assert lines[1].split("  ")[0].strip() == "name"
    assert "column 0" in lines[1]
    assert "column 11" not in lines[1]
    assert lines[-1].endswith("column 11")
    assert "more columns with --verbose: " in " ".join(lines)


def test_table_shows_every_cell_below_when_verbose() -> None:
    lines = wide(12).lines(WIDTH, is_verbose=True)
    assert max(map(len, lines)) <= WIDTH
    text = "\n".join(lines)
    assert all(f"column {n}" in text for n in range(12))
    assert all(f"{n + 0.25:.4f}" in text for n in range(12))
    assert "--verbose" not in text


def test_numbers_are_right_aligned_and_words_left_aligned() -> None:
    table = TerminalTable("", ["name", "value", "kind"])
    table.add_row("a", "1.5", "settled")
    table.add_row("long name", "-100", "new")
    assert table.lines(WIDTH, is_verbose=False) == [
        "name       value  kind",
        "a            1.5  settled",
        "long name   -100  new",
    ]


def test_sentences_fold_between_words_and_keep_values_with_their_units() -> None:
    text = "a deviation of " + "0.25 % and 12 mA, " * 9
    lines = wrap_sentence(text, WIDTH)
    assert max(map(len, lines)) <= WIDTH
    assert not any(line.endswith(("0.25", "12")) for line in lines)
    assert unwrapped("\n".join(lines)) == text.strip()


def test_commands_and_paths_stay_in_one_piece() -> None:
    command = "  anhyst identify " + "folder/" * 20 + "loops.csv --out model.toml"
    assert wrap_sentence(command, WIDTH) == [command]
    path = "x" * 120
    assert path in wrap_sentence(f"written: {path} and more", WIDTH)[1]


@pytest.mark.parametrize("count", [1, MAX_LINES - 1, MAX_LINES, MAX_LINES + 1, 60])
def test_printer_keeps_to_its_lines(count: int, capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(capsys, Printer(), *(f"line {n}" for n in range(count)))
    assert len(lines) == min(count, MAX_LINES)
    if count > MAX_LINES:
        hidden = count - MAX_LINES + 1
        assert lines[-1] == f"{hidden} more lines: --verbose"
        lines.pop()
    assert lines == [f"line {n}" for n in range(len(lines))]


def test_printer_prints_a_sentence_as_a_whole_or_not_at_all(capsys: pytest.CaptureFixture[str]) -> None:
    short = [f"line {n}" for n in range(MAX_LINES - 3)]
    lines = printed(capsys, Printer(), *short, "word " * 60, "after")
    assert lines[:-1] == short
    assert lines[-1] == "5 more lines: --verbose"


def test_printer_prints_everything_when_verbose(capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(capsys, Printer(is_verbose=True), wide(12, rows=40), *["line"] * 40)
    assert len(lines) > 100
    assert lines[-1] == "line"


def test_printer_keeps_lines_for_warnings(capsys: pytest.CaptureFixture[str]) -> None:
    few, many = Printer(), Printer()
    few.reserve(["short", "w" * 100])
    many.reserve(["w" * 100] * 40)
    text = ["line"] * 60
    assert len(printed(capsys, few, *text)) == MAX_LINES - 3
    assert len(printed(capsys, many, *text)) == MIN_LINES


@pytest.mark.parametrize("name", ["electromagnet", "piezo", "stage"])
def test_inspect_fits_a_small_terminal(name: str) -> None:
    command, place = ("inspect", "loops.csv"), EXAMPLES / name
    lines = quick(*command, cwd=place).stdout.splitlines()
    assert len(lines) <= MAX_LINES
    assert max(map(len, lines)) <= WIDTH
    assert lines[0] == "is it worth it?"
    full = quick(*command, "--verbose", cwd=place).stdout.splitlines()
    assert max(map(len, full)) <= WIDTH
    assert len(full) >= len(lines)
    assert "saturation" in "\n".join(full)
    found = json.loads(quick(*command, "--json", cwd=place).stdout)
    assert {"saturation", "history"} <= set(found["loops"][0])


def test_one_loop_is_counted_in_the_singular() -> None:
    shown = quick("inspect", "loops.csv", cwd=EXAMPLES / "piezo").stdout
    assert "\n1 loop, " in shown
