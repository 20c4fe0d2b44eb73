"""Measurements that cannot be used are refused by name, line or column; odd ones are warned of."""

from __future__ import annotations

import gzip
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from .command import Result, anhyst, as_ordinary_user, quick, refused, said_in_one_line
from .records import GAPS, Row, rows, table


def identify(folder: Path, *arguments: object) -> str:
    """Have ``loops.csv`` refused by identify."""
    return refused("identify", "loops.csv", "--out", "model.toml", *arguments, cwd=folder)


def write(folder: Path, content: str | bytes, name: str = "loops.csv") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return folder


def changed(place: int, column: int, text: str) -> str:
    """Return the good table with one field replaced; line 1 is the header."""
    lines = rows()
    lines[place - 2][column] = text
    return table(lines)


def each(change: Callable[[Row], Row]) -> str:
    return table([change(list(row)) for row in rows()])


def fitted(result: Result, code: int = 0) -> list[str]:
    """Lines of warning of a run that made a model."""
    assert result.returncode == code, result.stderr
    return result.stderr.splitlines()


def test_the_good_table_is_good(tmp_path: Path) -> None:
    write(tmp_path, table())
    result = quick("identify", "loops.csv", "--out", "model.toml", cwd=tmp_path)
    assert all("two gaps" in line for line in fitted(result))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["loops.csv", "model.toml"]


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    assert identify(tmp_path) == "loops.csv: no such file; check the path"
    for verb in (["inspect", "loops.csv"], ["identify", "loops.csv", "--out", "model.toml"]):
        said = said_in_one_line(anhyst(*verb, cwd=tmp_path))
        assert said == "loops.csv: no such file; check the path"


def test_a_folder_without_tables_is_named(tmp_path: Path) -> None:
    (tmp_path / "loops.csv").mkdir()
    assert identify(tmp_path).startswith("loops.csv: this folder holds no .csv")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        pytest.param("", "loops.csv: is empty; name the columns", id="empty"),
        pytest.param("\n \n\n", "loops.csv: is empty; name the columns", id="blank"),
        pytest.param("# rig 3\n", "loops.csv: holds no table", id="comments only"),
        pytest.param("t_s,I_A,F_N\n", "loops.csv: has a header but no data", id="header only"),
        pytest.param("1,2,3\n4,5,6\n", "loops.csv: line 1: numbers where the header should be",
                     id="no header"),
        pytest.param("I_A\n1\n2\n1\n", "loops.csv: line 1: one column only ('I_A')",
                     id="one column"),
        pytest.param(table().replace("F_N", "F_lbf"),
                     "loops.csv: column 'F_lbf': unknown unit 'lbf'; write 'F_N'",
                     id="unknown unit"),
        pytest.param(table().replace("F_N", "F_A"),
                     "loops.csv: column 'F_A': 'A' is a unit of current, not of force",
                     id="unit of another quantity"),
        pytest.param(table().replace("F_N", "F"), "loops.csv: column 'F': has no unit; call it",
                     id="no unit"),
        pytest.param(table().replace("F_N", "pull_N"), "loops.csv: has no column for an output",
                     id="unknown quantity"),
        pytest.param(changed(18, 2, "oops"),
                     "loops.csv: line 18, column 'F_N': 'oops' is not a number; correct or remove",
                     id="text in a number"),
        pytest.param(changed(18, 1, ""), "loops.csv: line 18, column 'I_A': is empty; correct",
                     id="no number"),
        pytest.param(changed(18, 2, "NaN"),
                     "loops.csv: line 18, column 'F_N': NaN is no measured value; remove the line",
                     id="NaN"),
        pytest.param(changed(18, 1, "-inf"),
                     "loops.csv: line 18, column 'I_A': -inf is no measured value; remove the line",
                     id="Inf"),
        pytest.param(changed(18, 1, "1e99"),
                     "loops.csv: line 18: 1e+99 is no measured value; remove the line",
                     id="overflow of a logger"),
        pytest.param(changed(18, 3, "0.3e-3,7"),
                     "loops.csv: line 18: has 5 fields where the header names 4 columns",
                     id="ragged"),
        pytest.param(changed(18, 0, "0.05"),
                     "loops.csv: line 18: time going backwards (0.05 s after 0.15 s); sort",
                     id="time backwards"),
        pytest.param(changed(18, 3, "-0.3e-3"),
                     "loops.csv: line 18: negative gap -0.0003 m; gaps count from contact",
                     id="negative gap"),
        pytest.param(each(lambda row: [row[0], "1.5", *row[2:]]),
                     "loops.csv: loop '1': the input is constant (1.5); a loop needs an input that",
                     id="constant current"),
        pytest.param(table([[*row[:2], "0", row[3]] for row in rows(GAPS[:1])]),
                     "the force is zero throughout",
                     id="no force"),
        pytest.param(table().replace("I_A,F_N", "F_N,I_A"), "are the columns of current and force",
                     id="current and force swapped"),
        pytest.param(each(lambda row: [*row[:2], f"-{row[2]}", row[3]]),
                     "falls as the current grows; flip its sign (attraction counts positive)",
                     id="sign of the force flipped"),
        pytest.param(table(rows()[:40]),
                     "loops.csv: loop '1' at gap 0.3 mm: the current never reverses",
                     id="never reverses"),
        pytest.param(table(rows()[:2]), "loops.csv: loop '1': has 2 samples; a loop needs at least",
                     id="two samples"),
        pytest.param(each(lambda row: ["1", *row[1:]]), "loop '1': time stands still at 1 s;",
                     id="time stands still"),
        pytest.param(each(lambda row: [*row[:3], row[3].replace("e-3", "")])
                     .replace("gap_m", "gap"),
                     "loops.csv: column 'gap': has no unit; call it 'gap_m' or 'gap_mm'",
                     id="gap without a unit"),
    ],
)  # fmt: skip
def test_a_table_that_cannot_be_used_is_refused(tmp_path: Path, content: str, said: str) -> None:
    assert said in identify(write(tmp_path, content))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        pytest.param(table().encode("utf-16"), "is UTF-16 text; save it again as UTF-8", id="bom"),
        pytest.param(table().encode("utf-16-le"), "is UTF-16 text; save it again", id="no bom"),
        pytest.param(table().encode("utf-16-be"), "is UTF-16 text; save it again", id="other end"),
        pytest.param(np.random.default_rng(1).bytes(50_000), "is a binary file, no text table; "
                     "export it as CSV", id="noise"),
        pytest.param(gzip.compress(table().encode()), "is a binary file", id="gzip"),
        pytest.param(b"PK\x03\x04" + bytes(200), "is a zip archive or a workbook, no text; export "
                     "it as CSV", id="workbook"),
        pytest.param(table().encode() + np.random.default_rng(2).bytes(50_000),
                     "loops.csv: line 160", id="rubbish behind good lines"),
        pytest.param(b"I_A,F_N\n" + b"1" * 5_000_000, "the first 4 MiB hold no row of data",
                     id="endless line"),
        pytest.param(b"I_A,F_N\n0,0\n" + b"1" * 9_000_000, "holds a line of more than 4 MiB",
                     id="endless line behind good ones"),
    ],
)  # fmt: skip
def test_what_is_no_text_table_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    assert said in identify(write(tmp_path, content))


def test_escapes_in_a_file_do_not_reach_the_terminal(tmp_path: Path) -> None:
    said = identify(write(tmp_path, changed(18, 2, "\x1b[31m\u2028x")))
    assert said.startswith("loops.csv: line 18, column 'F_N': '?[31m?x' is not a number")


@pytest.mark.parametrize("content", [table().replace("I_A,F_N", "F_N,I_A"), changed(9, 2, "x")])
def test_inspect_refuses_the_same(tmp_path: Path, content: str) -> None:
    said = identify(write(tmp_path, content))
    plotted = ["inspect", "loops.csv", "--plot", "loops.png", "--json"]
    assert refused(*plotted, cwd=tmp_path) == said


def test_a_gap_map_needs_two_gaps(tmp_path: Path) -> None:
    write(tmp_path, table(rows(GAPS[:1])))
    said = identify(tmp_path, "--gap-map", "reluctance")
    assert "gap map 'reluctance' needs loops at two gaps or more, there are loops at one" in said
    assert "measure another gap, or use --gap-map auto" in said


def test_one_gap_alone_is_warned_of(tmp_path: Path) -> None:
    write(tmp_path, table(rows(GAPS[:1])))
    reported = fitted(quick("identify", "loops.csv", "-o", "model.toml", cwd=tmp_path))
    assert any(
        "loops at one gap only: the model holds there and nowhere else" in t for t in reported
    )
    assert any("one loop only" in text for text in reported)


def test_millimetres_in_a_column_of_metres_are_warned_of(tmp_path: Path) -> None:
    write(tmp_path, each(lambda row: [*row[:3], row[3].replace("e-3", "")]))
    for verb in (["inspect", "loops.csv"], ["identify", "loops.csv", "-o", "model.toml"]):
        reported = fitted(quick(*verb, cwd=tmp_path))
        advice = "anhyst: warning: gaps up to 500 mm are very wide for an electromagnet; if the"
        assert any(
            text.startswith(advice) and "name the column 'gap_mm'" in text for text in reported
        )


def test_gaps_that_are_all_but_the_same_are_warned_of(tmp_path: Path) -> None:
    write(tmp_path, table(rows((0.3, 0.30001, 0.5))))
    reported = fitted(quick("inspect", "loops.csv", cwd=tmp_path))
    assert any("gap 0.0003 and 0.00030001 m are all but the same" in text for text in reported)


def test_a_gap_that_comes_again_must_be_reported_apart(tmp_path: Path) -> None:
    again = [[row[0], row[1], f"{1.1 * float(row[2])}", row[3]] for row in rows()]
    untimed = [row[1:] for row in rows() + again]
    said = identify(write(tmp_path, table(untimed, "I_A,F_N,gap_m")))
    assert "line 160: the value 0.0003 comes again after others" in said
    assert said.endswith("tell the loops apart by a column 'loop'")
    once = [row for row in rows() + again if row[3] == "0.3e-3"]
    said = identify(write(tmp_path, table(once)))
    assert said.startswith("loops.csv: line 81: time going backwards")
    assert said.endswith("tell loops apart by a column 'loop'")


def test_a_counter_of_rows_is_no_label_of_loops(tmp_path: Path) -> None:
    lines = [[str(place), *row[1:3]] for place, row in enumerate(rows() * 60)]
    said = identify(write(tmp_path, table(lines, "loop,I_A,F_N")))
    assert said.startswith("loops.csv: holds more than 2000 loops; is the column 'loop' a counter")
    reported = ["--columns", "loop=", "--clean", "none", "--history", "settled"]
    assert fitted(quick("inspect", "loops.csv", *reported, cwd=tmp_path)) == []


def test_two_files_at_one_gap_are_two_loops(tmp_path: Path) -> None:
    write(tmp_path, table(), "one.csv")
    write(tmp_path, changed(9, 2, "0.5"), "two.csv")
    found = json.loads(quick("inspect", "one.csv", "two.csv", "--json", cwd=tmp_path).stdout)
    assert {"one", "two"} <= {loop["label"] for loop in found["loops"]}


def test_the_same_record_at_two_gaps_is_refused(tmp_path: Path) -> None:
    lines = rows(GAPS[:1])
    twice = lines + [[*row[:3], "0.5e-3"] for row in lines]
    said = identify(write(tmp_path, table(twice)))
    assert "holds the same data at 0.0005 as loops.csv at 0.0003" in said
    assert "mislabelled" in said


def test_the_same_file_twice_counts_once(tmp_path: Path) -> None:
    write(tmp_path, table(), "one.csv")
    write(tmp_path, table(), "two.csv")
    result = quick("inspect", "one.csv", "two.csv", "--json", cwd=tmp_path)
    assert fitted(result) == []
    found = json.loads(result.stdout)
    assert len(found["loops"]) == 2
    assert any("is the one in one.csv: left out" in note for note in found["notes"])


def test_files_of_different_quantities_do_not_mix(tmp_path: Path) -> None:
    write(tmp_path, table(), "one.csv")
    write(tmp_path, table().replace("F_N", "psi_Wb"), "two.csv")
    said = refused("identify", "one.csv", "two.csv", "-o", "model.toml", cwd=tmp_path)
    assert said.startswith("two.csv: its output is psi_Wb but that of one.csv is F_N")


def test_a_gap_that_moves_is_not_fitted(tmp_path: Path) -> None:
    lines = rows(GAPS[:1])
    for place, row in enumerate(lines):
        row[3] = f"{3e-4 + 1e-6 * place}"
    assert "the gap moves during the loop; loops at constant" in identify(
        write(tmp_path, table(lines))
    )


def test_few_samples_are_warned_of(tmp_path: Path) -> None:
    lines = rows(GAPS[:1])
    write(tmp_path, table([*lines[:40:10], lines[39], *lines[40::10]]))
    reported = fitted(quick("identify", "loops.csv", "-o", "model.toml", cwd=tmp_path))
    assert any("samples for" in text and "record more samples" in text for text in reported)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("columns = 3", "loops.toml: key 'columns' is of the wrong kind"),
        ("colums = {}", "loops.toml: key 'colums' is not known; use columns"),
        ("history = 'virgin'", "loops.toml: history 'virgin' is not known; use demagnetised"),
        ("[columns", "loops.toml: is no valid TOML"),
        ("x = " + "[" * 5000, "loops.toml: is no valid TOML"),
        ("columns = { I = 'I_A' }", "loops.csv: has no column 'I' to map"),
    ],
)
def test_a_sidecar_that_makes_no_sense_is_refused(tmp_path: Path, content: str, said: str) -> None:
    write(tmp_path, content, "loops.toml")
    assert identify(write(tmp_path, table())).startswith(said)


def test_a_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "loops.csv")
    said = identify(tmp_path)
    assert said.startswith("loops.csv: is a pipe or a device")
    assert "save it as a file first" in said


def test_a_file_that_may_not_be_read_is_refused(tmp_path: Path) -> None:
    write(tmp_path, table())
    (tmp_path / "loops.csv").chmod(0)
    result = anhyst("inspect", "loops.csv", cwd=tmp_path, preexec_fn=as_ordinary_user())
    assert "'loops.csv' is not readable" in said_in_one_line(result)
