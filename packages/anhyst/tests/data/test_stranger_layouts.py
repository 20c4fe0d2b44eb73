"""Layouts of other users are read correctly, or refused with the reason."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.data import read_loops
from anhyst.data.formats.channels import ChannelGroup, Series
from anhyst.data.loops import Loops
from anhyst.data.table import write_channel_groups
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from tests.data.recordings import workbook
from tests.data.test_formats import needs
from tests.refusals import refused

PHASE = np.linspace(0.0, 2.0, 65)
CURRENT = np.round(0.75 * (1.0 - np.abs(PHASE - 1.0)) + 0.01, 4)


def force(gap_mm: float = 0.4) -> FloatArray:
    """Return a loop of force over `CURRENT` that is smaller at larger gaps."""
    lag = 0.05 * np.sin(np.pi * PHASE)
    return np.round(8.0 * (0.4 / gap_mm) ** 2 * (CURRENT - lag) ** 2 + 0.02, 4)


def rows(gap_mm: float = 0.4, sign: str = ";", label: str = "") -> list[str]:
    return [
        sign.join([*([f"{label}{n}"] if label else []), f"{i:.4f}", f"{f:.4f}"])
        for n, (i, f) in enumerate(zip(CURRENT, force(gap_mm), strict=True))
    ]


def text(*lines: str | Sequence[str]) -> str:
    return "".join(f"{row}\n" for line in lines for row in ([line] if isinstance(line, str) else line))


def marked(mark: float | str, column: int, at: Sequence[int] = (20, 21)) -> str:
    table = [row.split(";") for row in rows()]
    for row in at:
        table[row][column] = str(mark)
    return text("I [A];F [N]", [";".join(row) for row in table])


def thousands() -> str:
    lines = [f'{i:.3f},"{f:,.0f}"' for i, f in zip(CURRENT, 400.0 * force(), strict=True)]
    return text("Coil current [A],Pull force [mN]", lines)


def swapped() -> list[str]:
    return [";".join(reversed(row.split(";"))) for row in rows(0.7)]


READ: dict[str, tuple[str, list[float], dict[str, Any], str]] = {
    "statistics below": (
        text("Point;I [A];F [N]", rows(label="S"), "Median;0.3;1.1", "Std.Dev;0.2;0.9"),
        [], {}, "statistics: 'Median",
    ),
    "statistics above": (
        text("Point,I [A],F [N]", "Average,0.3,1.1", rows(sign=",", label="S")),
        [], {}, "statistics: 'Average",
    ),
    "end of record": (text("I [A];F [N]", rows(), "End of record"), [], {}, "End of record"),
    "counter": (text("#;I [A];F [N]", [f"{n};{row}" for n, row in enumerate(rows())]), [], {}, ""),
    "row names": (
        text("I [A],F [N]", [f"{n},{row}" for n, row in enumerate(rows(sign=","), start=1)]),
        [], {}, "",
    ),
    "label, not statistics": (
        text("loop;I [A];F [N]", [f"max;{row}" for row in rows()], [f"min;{row}" for row in rows(0.401)]),
        [], {}, "",
    ),
    "gaps in comments": (
        text("// air gap: 0.4 mm", "I_A F_N", rows(sign=" "), "// air gap: 0.7 mm", rows(0.7, " ")),
        [0.4, 0.7], {}, "2 blocks",
    ),
    "header again": (
        text("I [A];F [N]", "# Spalt = 400 um", rows(), "I [A];F [N]", "# Spalt = 700 um", rows(0.7)),
        [0.4, 0.7], {}, "repeats the header",
    ),
    "stated gap": (text("# Luftspalt: 0,4 mm", "I_A;F_N", rows()), [], {}, "--constants gap_mm=0.4"),
    "stated gap in a row": (
        text("Gap [mm];0.4", "Sample;A7", "I_A;F_N", rows()), [], {}, "--constants gap_mm=0.4",
    ),
    "event": (text("I_A;F_N", rows()[:30], "# trigger", rows()[30:]), [], {}, "trigger"),
    "marks dropped": (marked(65535, 1), [], {"drop": "invalid"}, "65535 is an overrange mark, 2"),
}  # fmt: skip

REFUSED: dict[str, tuple[str, dict[str, Any], str]] = {
    "thousands": (thousands(), {}, "thousands-separator: line"),
    "factors": (text("Ch;I;F", "Unit;A;N", "Gain;0.01;1", rows(label="S")), {}, "factor-row: line 3"),
    "stars": (text("I [A];F [N]", "*0.01;*1", rows()), {}, "factor-row: line 2"),
    "blank line": (text("I_A;F_N", rows(), "", rows(0.7)), {}, "gap-missing: blank lines"),
    "dashes": (text("I_A;F_N", rows(), "-----", rows(0.7)), {}, "gap-missing"),
    "invalid row": (
        text("I_A;F_N", rows(), "NaN;NaN", rows(0.7)), {"drop": "invalid"}, "gap-missing",
    ),
    "gap of the second block only": (
        text("I_A;F_N", rows(), "# gap 0.7 mm", rows(0.7)), {}, "gap-missing",
    ),
    "mean without a name": (text("I_A;F_N", rows(), "", "0.4;1.1"), {}, "rows-below-data"),
    "other order": (text("I [A];F [N]", rows(), "F [N];I [A]", swapped()), {}, "second-header: line 67"),
    "other unit": (text("I [A];F [N]", rows(), "I [mA];F [N]", rows(0.7)), {}, "second-header"),
    "equal names": (text("I [A];I [A];F [N]", [f"{r.split(';')[0]};{r}" for r in rows()]), {},
                    "column-twice: I [A]#2"),
    "side by side": (
        text("I [A];F [N];;I [A];F [N]", [
            f"{a};;{b}" for a, b in zip(rows(), rows(0.7), strict=True)]), {}, "tables-side-by-side",
    ),
    "gap columns": (
        text("I [A];F 0.4mm [N];F 0.7mm [N]", [f"{a};{b.split(';')[1]}" for a, b in zip(
            rows(), rows(0.7), strict=True)]), {}, "loops-side-by-side",
    ),
    "one channel": (text("t [s];Ampl", rows()), {}, "one-channel"),
    "two commas": (text("I [A],F [N]", [row.replace(".", ",").replace(";", ",") for row in rows()]),
                   {}, "fields-missing: semicolons"),
    **{
        f"mark {mark}": (marked(mark, column), {}, "overrange-mark")
        for mark, column in ((-999.9, 0), (32767, 1), ("3.4028235E+38", 1), (1e9, 1), (-9999, 1))
    },
}  # fmt: skip


def check(loops: Loops, gaps_mm: Sequence[float], said: str) -> None:
    assert [round(1e3 * value, 6) for value in loops.schedule_values] == list(gaps_mm)
    for loop in loops.loops:
        gap = 1e3 * loop.schedule_value if loop.schedule_value is not None else 0.4
        kept = np.isin(CURRENT, loop.input)
        assert np.count_nonzero(kept) >= CURRENT.size - 4
        assert loop.n <= CURRENT.size
        if loop.n == CURRENT.size:
            np.testing.assert_allclose(loop.output, force(gap), rtol=0.01)
    assert said in " | ".join(loops.notes)


@pytest.mark.parametrize("name", READ)
def test_a_layout_is_read_correctly_and_notes_skipped_parts(name: str, tmp_path: Path) -> None:
    content, gaps_mm, options, note = READ[name]
    path = tmp_path / "record.csv"
    path.write_text(content)
    check(read_loops(path, **options), gaps_mm, note)


@pytest.mark.parametrize("name", REFUSED)
def test_layout_is_refused_with_its_reason(name: str, tmp_path: Path) -> None:
    content, options, reason = REFUSED[name]
    path = tmp_path / "record.csv"
    path.write_text(content)
    with refused(reason):
        read_loops(path, **options)


def test_a_signal_that_rests_on_few_levels_is_no_overrange_mark(tmp_path: Path) -> None:
    path = tmp_path / "record.csv"
    path.write_text(marked(2.0, 1))
    assert max(loop.output.max() for loop in read_loops(path).loops) >= 2.0


def book(path: Path, sheets: Mapping[str, Sequence[Sequence[Any]]]) -> Path:
    needs(".xlsx")
    return workbook(path, *sheets.values(), names=tuple(sheets))


def cells(gap_mm: float = 0.4, to: Callable[[float], Any] = float) -> list[list[Any]]:
    return [[to(i), to(f)] for i, f in zip(CURRENT, force(gap_mm), strict=True)]


HEAD = ["I [A]", "F [N]"]
BOOKS: dict[str, tuple[dict[str, Any], list[float], str]] = {
    "gap of each sheet": ({"0,4 mm": [HEAD, *cells()], "0,7 mm": [HEAD, *cells(0.7)]}, [0.4, 0.7], ""),
    "numbers as text": (
        {"A": [HEAD, *cells(to=lambda x: f"{x:.4f}".replace(".", ","))]}, [], "",
    ),
    "gap in a cell": ({"A": [["Luftspalt [mm]", 0.4], [], HEAD, *cells()]}, [], "gap_mm=0.4"),
    "mean": ({"A": [HEAD, *cells(), [], ["Mittelwert", 0.7]]}, [], "Mittelwert"),
}  # fmt: skip


@pytest.mark.parametrize("name", BOOKS)
def test_workbook_is_read_right(name: str, tmp_path: Path) -> None:
    sheets, gaps_mm, note = BOOKS[name]
    check(read_loops(book(tmp_path / "a.xlsx", sheets)), gaps_mm, note)


def test_workbook_with_loops_of_unknown_gaps_is_refused(tmp_path: Path) -> None:
    sheets = {"first": [HEAD, *cells()], "second": [HEAD, *cells(0.7)]}
    with refused("gap-missing"):
        read_loops(book(tmp_path / "a.xlsx", sheets))
    pairs = [[*a, *b] for a, b in zip(cells(), cells(0.7), strict=True)]
    with refused("tables-side-by-side"):
        read_loops(book(tmp_path / "b.xlsx", {"A": [HEAD * 2, *pairs]}))


def test_groups_at_several_gaps_are_refused_and_one_may_be_chosen(tmp_path: Path) -> None:
    needs(".h5")
    path = tmp_path / "a.h5"
    write_channel_groups(path, [
        ChannelGroup(f"gap_{gap}mm", None, (Series("I", "A", CURRENT), Series("F", "N", force(gap))))
        for gap in (0.4, 0.7)
    ])  # fmt: skip
    with refused("loops-side-by-side"):
        read_loops(path)
    chosen = {"gap_0.4mm/I": "I_A", "gap_0.4mm/F": "F_N"}
    check(read_loops(path, columns=chosen), [], "gap_0.7mm/F")


def test_gaps_come_from_file_headers_and_a_readme_is_skipped(tmp_path: Path) -> None:
    for name, gap in (("a", 0.4), ("b", 0.7)):
        (tmp_path / f"{name}.csv").write_text(text(f"# gap = {gap} mm", "I_A;F_N", rows(gap)))
    (tmp_path / "readme.txt").write_text("Two loops of the valve.\nSmith\n")
    check(read_loops(tmp_path), [0.4, 0.7], "readme.txt: is left out")


def test_a_clock_set_back_by_an_hour_continues(tmp_path: Path) -> None:
    lines = [
        f"2025-10-26T0{2 if n < 30 else 1}:{59 if n < 30 else 0:02}:{(30 + n) % 60:02}"
        f"+0{2 if n < 30 else 0}:00;{row}"
        for n, row in enumerate(rows()[:60])
    ]
    path = tmp_path / "a.csv"
    path.write_text(text("Time;I_A;F_N", lines))
    time = read_loops(path).loops[0].time
    assert time is not None
    np.testing.assert_allclose(np.diff(time), 1.0)


def test_error_names_no_line_to_remove_below_a_second_header(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(REFUSED["other unit"][0])
    with pytest.raises(InputError) as caught:
        read_loops(path)
    assert "remove" not in str(caught.value)
    assert "split the file" in str(caught.value)
