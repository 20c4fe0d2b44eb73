"""Unusable measurements are rejected with name, line or column; implausible ones cause warnings."""

from __future__ import annotations

import gzip
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.refusals import says

from .command import Result, quick, refused, said_in_one_line
from .records import GAPS, PLAIN, Row, rows, table


def identify(folder: Path, *arguments: object) -> str:
    """Run identify, which must reject ``loops.csv``."""
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
    """Return the warnings of a run that found a model."""
    assert result.returncode == code, result.stderr
    return result.stderr.splitlines()


def test_the_good_table_is_good(tmp_path: Path) -> None:
    write(tmp_path, table())
    result = quick("identify", "loops.csv", *PLAIN, "--out", "model.toml", cwd=tmp_path)
    assert all("two gaps" in line for line in fitted(result))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["loops.csv", "model.toml"]


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    assert says(identify(tmp_path), "no-such-file: loops.csv")
    for verb in (["inspect", "loops.csv"], ["identify", "loops.csv", "--out", "model.toml"]):
        message = said_in_one_line(quick(*verb, cwd=tmp_path))
        assert says(message, "no-such-file: loops.csv")


def test_a_folder_without_tables_is_named(tmp_path: Path) -> None:
    (tmp_path / "loops.csv").mkdir()
    assert says(identify(tmp_path), "no-files: loops.csv")


@pytest.mark.first(19)
@pytest.mark.parametrize(
    ("content", "message"),
    [
        pytest.param("", "empty-file: loops.csv", id="empty"),
        pytest.param("\n \n\n", "empty-file: loops.csv", id="blank"),
        pytest.param("# rig 3\n", "no-table: loops.csv", id="comments only"),
        pytest.param("t_s,I_A,F_N\n", "no-data: loops.csv", id="header only"),
        pytest.param("1,2,3\n4,5,6\n", "no-header: loops.csv; line 1", id="no header"),
        pytest.param("I_A\n1\n2\n1\n", "single-column: loops.csv; line 1; 'I_A'", id="one column"),
        pytest.param(
            table().replace("F_N", "F_stone"), "bad-header F_stone: loops.csv; 'F_N'", id="unknown unit"
        ),
        pytest.param(
            table().replace("F_N", "F_A"), "bad-header F_A: loops.csv", id="unit of another quantity"
        ),
        pytest.param(table().replace("F_N", "F"), "bad-header F: loops.csv", id="no unit"),
        pytest.param(table().replace("F_N", "thing"), "column-missing: loops.csv", id="unknown quantity"),
        pytest.param(
            changed(18, 2, "oops"), "text-in-numbers F_N: loops.csv; line 18; 'oops'", id="text in a number"
        ),
        pytest.param(changed(18, 1, ""), "not-finite I_A: loops.csv; line 18; --drop invalid", id="empty"),
        pytest.param(changed(18, 2, "NaN"), "not-finite F_N: loops.csv; line 18", id="NaN"),
        pytest.param(changed(18, 1, "-inf"), "not-finite I_A: loops.csv; line 18", id="Inf"),
        pytest.param(changed(18, 1, "1e99"), "not-finite I_A: loops.csv; line 18", id="overflow of a logger"),
        pytest.param(changed(18, 3, "0.3e-3,7"), "fields-missing: loops.csv; line 18", id="ragged"),
        pytest.param(
            changed(18, 0, "0.05"), "time-backwards: loops.csv; line 18; 0.05 s; 0.15 s", id="time backwards"
        ),
        pytest.param(
            changed(18, 3, "-0.3e-3"), "negative-gap: loops.csv; line 18; -0.0003 m", id="negative gap"
        ),
        pytest.param(
            each(lambda row: [row[0], "1.5", *row[2:]]),
            "input-constant 1: loops.csv; 1.5",
            id="constant current",
        ),
        pytest.param(table([[*row[:2], "0", row[3]] for row in rows(GAPS[:1])]), "no-output", id="no force"),
        pytest.param(
            table().replace("I_A,F_N", "F_N,I_A"), "columns-swapped", id="current and force swapped"
        ),
        pytest.param(
            each(lambda row: [*row[:2], f"-{row[2]}", row[3]]),
            "force-negative",
            id="sign of the force flipped",
        ),
        pytest.param(table(rows()[:40]), "no-reversal: loops.csv; '1'; 0.3 mm", id="never reverses"),
        pytest.param(table(rows()[:2]), "too-few-samples 1: loops.csv", id="two samples"),
        pytest.param(each(lambda row: ["1", *row[1:]]), "time-stands-still 1", id="time stands still"),
        pytest.param(
            each(lambda row: [*row[:3], row[3].replace("e-3", "")]).replace("gap_m", "gap"),
            "bad-header gap: loops.csv; 'gap_m'; 'gap_mm'",
            id="gap without a unit",
        ),
    ],
)
def test_a_table_that_cannot_be_used_is_refused(tmp_path: Path, content: str, message: str) -> None:
    assert says(identify(write(tmp_path, content)), message)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        pytest.param(np.random.default_rng(1).bytes(50_000), "not-a-text", id="noise"),
        pytest.param(gzip.compress(table().encode()), "not-a-text", id="gzip"),
        pytest.param(b"PK\x03\x04" + bytes(200), "not-a-text", id="workbook"),
        pytest.param(
            table().encode() + np.random.default_rng(2).bytes(50_000),
            "fields-missing: loops.csv; line 160",
            id="rubbish behind good lines",
        ),
        pytest.param(b"I_A,F_N\n" + b"1" * 5_000_000, "no-table", id="endless line"),
        pytest.param(
            b"I_A,F_N\n0,0\n" + b"1" * 9_000_000, "line-too-long", id="endless line behind good ones"
        ),
    ],
)
def test_a_file_that_is_not_a_text_table_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    assert says(identify(write(tmp_path, content)), message)


def test_escapes_in_a_file_do_not_reach_the_terminal(tmp_path: Path) -> None:
    message = identify(write(tmp_path, changed(18, 2, "\x1b[31m\u2028x")))
    assert says(message, "text-in-numbers F_N: loops.csv; line 18; '?[31m?x'")


@pytest.mark.parametrize("content", [table().replace("I_A,F_N", "F_N,I_A"), changed(9, 2, "x")])
def test_inspect_refuses_the_same(tmp_path: Path, content: str) -> None:
    message = identify(write(tmp_path, content))
    plotted = ["inspect", "loops.csv", "--plot", "loops.png", "--json"]
    assert refused(*plotted, cwd=tmp_path) == message


def test_a_gap_map_needs_two_gaps(tmp_path: Path) -> None:
    write(tmp_path, table(rows(GAPS[:1])))
    message = identify(tmp_path, "--gap-map", "reluctance")
    assert says(message, "single-gap: 'reluctance'")
    assert says(message, "single-gap")


def test_one_gap_alone_is_warned_of(tmp_path: Path) -> None:
    write(tmp_path, table(rows(GAPS[:1])))
    law = PLAIN[:2]
    reported = fitted(quick("identify", "loops.csv", *law, "-o", "model.toml", cwd=tmp_path))
    assert any("loops at only one gap: the model is valid only there" in t for t in reported)
    assert any("only one loop" in text for text in reported)


def test_millimetres_in_a_column_of_metres_are_warned_of(tmp_path: Path) -> None:
    write(tmp_path, each(lambda row: [*row[:3], row[3].replace("e-3", "")]))
    for verb in (["inspect", "loops.csv"], ["identify", "loops.csv", "-o", "model.toml", *PLAIN]):
        reported = fitted(quick(*verb, cwd=tmp_path))
        advice = "anhyst: warning: gaps up to 500 mm are very wide for an electromagnet; if the"
        assert any(text.startswith(advice) and "name the column 'gap_mm'" in text for text in reported)


def test_gaps_that_are_all_but_the_same_are_warned_of(tmp_path: Path) -> None:
    write(tmp_path, table(rows((0.3, 0.30001, 0.5))))
    reported = fitted(quick("inspect", "loops.csv", cwd=tmp_path))
    assert any("gap 0.0003 and 0.00030001 m are almost equal" in text for text in reported)


def test_a_repeated_gap_needs_a_label(tmp_path: Path) -> None:
    again = [[row[0], row[1], f"{1.1 * float(row[2])}", row[3]] for row in rows()]
    untimed = [row[1:] for row in rows() + again]
    message = identify(write(tmp_path, table(untimed, "I_A,F_N,gap_m")))
    assert says(message, "value-again loop: line 160; 0.0003")
    assert says(message, "value-again loop")
    once = [row for row in rows() + again if row[3] == "0.3e-3"]
    message = identify(write(tmp_path, table(once)))
    assert says(message, "time-backwards: loops.csv; line 81")
    assert says(message, "time-backwards")


def test_a_counter_of_rows_is_no_label_of_loops(tmp_path: Path) -> None:
    lines = [[str(place), *row[1:3]] for place, row in enumerate(rows(GAPS[:1]) * 240)]
    message = identify(write(tmp_path, table(lines, "loop,I_A,F_N")))
    assert says(message, "too-many-loops loop: loops.csv; 2000")
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
    message = identify(write(tmp_path, table(twice)))
    assert says(message, "same-data-twice: 0.0005; loops.csv; 0.0003")


def test_the_same_file_twice_counts_once(tmp_path: Path) -> None:
    write(tmp_path, table(), "one.csv")
    write(tmp_path, table(), "two.csv")
    result = quick("inspect", "one.csv", "two.csv", "--json", cwd=tmp_path)
    assert fitted(result) == []
    found = json.loads(result.stdout)
    assert len(found["loops"]) == 2
    assert any("is the same as in one.csv: left out" in note for note in found["notes"])


def test_files_of_different_quantities_do_not_mix(tmp_path: Path) -> None:
    write(tmp_path, table(), "one.csv")
    write(tmp_path, table().replace("F_N", "psi_Wb"), "two.csv")
    message = refused("identify", "one.csv", "two.csv", "-o", "model.toml", cwd=tmp_path)
    assert says(message, "quantities-differ: two.csv; psi_Wb; one.csv; F_N")


def test_a_moving_gap_is_not_fitted(tmp_path: Path) -> None:
    lines = rows(GAPS[:1])
    for place, row in enumerate(lines):
        row[3] = f"{3e-4 + 1e-6 * place}"
    assert says(identify(write(tmp_path, table(lines))), "schedule-moves gap")


def test_few_samples_are_warned_of(tmp_path: Path) -> None:
    lines = rows(GAPS[:1])
    write(tmp_path, table([*lines[:40:10], lines[39], *lines[40::10]]))
    law = PLAIN[:2]
    reported = fitted(quick("identify", "loops.csv", *law, "-o", "model.toml", cwd=tmp_path))
    assert any("samples for" in text and "record more samples" in text for text in reported)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("columns = 3", "wrong-kind columns: loops.toml"),
        ("colums = {}", "extra-forbidden colums: loops.toml"),
        ("history = 'virgin'", "unknown-history history: loops.toml; 'virgin'"),
        ("[columns", "damaged-toml: loops.toml"),
        ("x = " + "[" * 5000, "damaged-toml: loops.toml"),
        ("columns = { I = 'I_A' }", "no-such-column I: loops.csv"),
    ],
)
def test_a_sidecar_that_makes_no_sense_is_refused(tmp_path: Path, content: str, message: str) -> None:
    write(tmp_path, content, "loops.toml")
    assert says(identify(write(tmp_path, table())), message)


def test_a_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "loops.csv")
    message = identify(tmp_path)
    assert says(message, "not-a-file: loops.csv")
    assert says(message, "not-a-file")


def test_a_file_that_may_not_be_read_is_refused(tmp_path: Path) -> None:
    write(tmp_path, table())
    (tmp_path / "loops.csv").chmod(0)
    result = quick("inspect", "loops.csv", cwd=tmp_path, ordinary=True)
    assert "'loops.csv' is not readable" in said_in_one_line(result)
