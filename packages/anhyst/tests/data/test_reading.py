"""Reading of loops from files."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from anhyst.data import History, Loop, Loops
from anhyst.data.reading import read_loops
from anhyst.support.errors import InputError
from anhyst.support.units import QUANTITIES
from tests.refusals import refused

UP_AND_BACK = [0.0, 0.5, 1.0, 1.5, 2.0, 1.5, 1.0, 0.5, 0.0, 0.5, 1.0, 1.5, 2.0]


def rows_of(force: float = 10.0, *tail: object) -> list[str]:
    """Return the rows of one small loop; ``tail`` adds columns."""
    end = "".join(f",{value}" for value in tail)
    return [f"{i},{force * i * i + 0.1 * k}{end}" for k, i in enumerate(UP_AND_BACK)]


def file_of(folder: Path, name: str, header: str, *blocks: list[str]) -> Path:
    path = folder / name
    path.write_text("\n".join([header, *(row for block in blocks for row in block)]) + "\n")
    return path


def test_each_gap_in_a_file_becomes_a_loop(tmp_path: Path) -> None:
    path = file_of(tmp_path, "a.csv", "I_A,F_N,gap_mm", rows_of(10, 0.4), rows_of(20, 0.3), rows_of(5, 0.6))
    loops = read_loops(path)
    assert loops.schedule_values == (0.0003, 0.0004, 0.0006)
    assert [loop.schedule_value for loop in loops.loops] == [0.0004, 0.0003, 0.0006]
    assert {value: len(found) for value, found in loops.by_schedule().items()} == {
        0.0003: 1,
        0.0004: 1,
        0.0006: 1,
    }
    assert loops.at(0.0003).loops[0].output[-1] == 20 * 4.0 + 1.2
    assert loops.without(0.0003).schedule_values == (0.0004, 0.0006)
    assert (loops.input.column, loops.output.column) == ("I_A", "F_N")
    assert loops.schedule == QUANTITIES["gap"]


def test_labels_tell_loops_of_one_gap_apart(tmp_path: Path) -> None:
    path = file_of(tmp_path, "a.csv", "I_A,F_N,gap_mm,loop", rows_of(10, 0.4, "outer"), rows_of(9, 0.4, "in"))
    loops = read_loops(path)
    assert [loop.label for loop in loops.loops] == ["outer", "in"]
    assert loops.schedule_values == (0.0004,)


def test_several_files_join(tmp_path: Path) -> None:
    one = file_of(tmp_path, "a.csv", "I_A,F_N,gap_mm", rows_of(10, 0.4))
    two = file_of(tmp_path, "b.csv", "I_A;F_N;gap_m", [r.replace(",", ";") for r in rows_of(9, 5e-4)])
    loops = read_loops([one, two])
    assert loops.schedule_values == (0.0004, 0.0005)
    assert [Path(source.path).name for source in loops.sources] == ["a.csv", "b.csv"]
    assert all(len(source.sha256) == 64 for source in loops.sources)
    assert read_loops(tmp_path).schedule_values == (0.0004, 0.0005)


def test_without_a_gap_files_are_reported_apart_by_name(tmp_path: Path) -> None:
    one = file_of(tmp_path, "small.csv", "H_A_per_m,B_T", rows_of(1))
    two = file_of(tmp_path, "large.csv", "H_A_per_m,B_T", rows_of(2))
    assert [loop.label for loop in read_loops([one, two]).loops] == ["small", "large"]


def test_files_with_records_of_one_gap_are_loops_named_after_them(tmp_path: Path) -> None:
    header = "I_A,F_N,gap_mm"
    files = [
        file_of(tmp_path, "slow.csv", header, rows_of(10, 0.4)),
        file_of(tmp_path, "fast.csv", header, rows_of(11, 0.4)),
        file_of(tmp_path, "wide.csv", header, rows_of(12, 0.5)),
    ]
    loops = read_loops(files)
    assert [loop.label for loop in loops.loops] == ["slow", "fast", "1"]
    assert loops.schedule_values == (0.0004, 0.0005)


def test_repeated_labels_in_another_file_include_its_name(tmp_path: Path) -> None:
    def labelled(slope: float) -> list[str]:
        return [f"{label},{row}" for label in "ab" for row in rows_of(slope + ord(label), 0.4)]

    files = [
        file_of(tmp_path, name, "loop,I_A,F_N,gap_mm", labelled(slope))
        for name, slope in (("slow.csv", 10.0), ("fast.csv", 20.0))
    ]
    assert [loop.label for loop in read_loops(files).loops] == [
        "slow a", "slow b", "fast a", "fast b"
    ]  # fmt: skip


def test_files_of_the_same_name_are_distinguished_by_their_folders(tmp_path: Path) -> None:
    files = []
    for slope, folder in enumerate(("monday", "tuesday"), 10):
        (tmp_path / folder).mkdir()
        place = tmp_path / folder
        files.append(file_of(place, "loops.csv", "I_A,F_N,gap_mm", rows_of(slope, 0.4)))
    labels = [loop.label for loop in read_loops(files).loops]
    assert [Path(label).parent.name for label in labels] == ["monday", "tuesday"]


def test_one_label_with_other_data_and_no_gap_is_refused(tmp_path: Path) -> None:
    """The temperature can differ without a column for it."""
    for name, slope in (("cold.csv", 10), ("warm.csv", 11)):
        rows = [f"major,{row}" for row in rows_of(slope)]
        file_of(tmp_path, name, "loop,H_A_per_m,B_T", rows)
    with refused("loop-twice major: warm.csv; cold.csv"):
        read_loops(tmp_path)


def test_duplicate_data_is_used_once(tmp_path: Path) -> None:
    one = file_of(tmp_path, "a.csv", "I_A,F_N,gap_mm", rows_of(10, 0.4))
    two = file_of(tmp_path, "b.csv", "I_A,F_N,gap_mm", rows_of(10, 0.4))
    loops = read_loops([one, two])
    assert len(loops) == 1
    assert any("left out" in note for note in loops.notes)


def test_same_data_at_two_gaps_is_refused(tmp_path: Path) -> None:
    one = file_of(tmp_path, "a.csv", "I_A,F_N,gap_mm", rows_of(10, 0.4))
    two = file_of(tmp_path, "b.csv", "I_A,F_N,gap_mm", rows_of(10, 0.5))
    with refused("same-data-twice"):
        read_loops([one, two])


def test_files_of_other_quantities_do_not_join(tmp_path: Path) -> None:
    one = file_of(tmp_path, "a.csv", "I_A,F_N", rows_of())
    two = file_of(tmp_path, "b.csv", "I_A,psi_Wb", rows_of())
    with refused("quantities-differ: psi_Wb; F_N"):
        read_loops([one, two])


def test_a_moving_gap_gives_one_loop(tmp_path: Path) -> None:
    rows = [f"{k * 0.1},{i},{i * i},{0.3 + 0.001 * k}" for k, i in enumerate(UP_AND_BACK * 3)]
    loops = read_loops(file_of(tmp_path, "a.csv", "t_s,I_A,F_N,gap_mm", rows))
    assert len(loops) == 1
    assert loops.loops[0].schedule_value is None
    with refused("schedule-moves gap"):
        loops.by_schedule()


def test_a_repeated_gap_needs_a_label(tmp_path: Path) -> None:
    blocks = [rows_of(10, 0.4), rows_of(9, 0.5), rows_of(8, 0.4)]
    path = file_of(tmp_path, "a.csv", "I_A,F_N,gap_mm", *blocks)
    with refused("value-again loop: line 28; 0.0004"):
        read_loops(path)


def test_only_a_constant_temperature_is_a_schedule(tmp_path: Path) -> None:
    steady = file_of(tmp_path, "a.csv", "H_A_per_m,B_T,T_C", rows_of(1, 20))
    assert read_loops(steady).schedule_values == (20.0,)
    logged = [f"{row},{20 + 0.01 * k}" for k, row in enumerate(rows_of(1))]
    path = file_of(tmp_path, "b.csv", "H_A_per_m,B_T,T_C", logged)
    loops = read_loops(path)
    assert loops.schedule is None
    assert any("temperature varies" in note for note in loops.notes)
    assert read_loops(path, schedule="T").schedule == QUANTITIES["temperature"]


def test_any_named_quantity_can_schedule(tmp_path: Path) -> None:
    path = file_of(tmp_path, "a.csv", "I_A,F_N,load [kPa]", rows_of(1, 2), rows_of(2, 3))
    loops = read_loops(path, schedule="load")
    assert loops.schedule is not None
    assert loops.schedule.column == "load_Pa"
    assert loops.schedule_values == (2000.0, 3000.0)
    with refused("column-missing tilt"):
        read_loops(path, schedule="tilt")


def test_schedule_none_ignores_the_gap(tmp_path: Path) -> None:
    path = file_of(tmp_path, "a.csv", "I_A,F_N,gap_mm", rows_of(1, 2))
    loops = read_loops(path, schedule="none")
    assert loops.schedule is None
    assert loops.by_schedule() == {0.0: list(loops.loops)}


def test_a_history_is_given_or_proposed_with_a_note(tmp_path: Path) -> None:
    path = file_of(tmp_path, "a.csv", "I_A,F_N", rows_of())
    stated = read_loops(path, history="conditioned:0,2,0")
    assert stated.loops[0].history == History("conditioned", (0.0, 2.0, 0.0))
    assert not any("history" in note for note in stated.notes)
    proposed = read_loops(path)
    assert any("history of loop '1' taken as" in note for note in proposed.notes)
    assert proposed.with_history("demagnetised").loops[0].history.kind == "demagnetised"


@pytest.mark.parametrize("text", ["virgin", "demagnetised:1", "conditioned", "conditioned:a,b", ""])
def test_unknown_history_is_refused(text: str) -> None:
    with pytest.raises(InputError) as caught:
        History.parse(text)
    assert caught.value.key == "history"


def test_virgin_rise_is_reported_from_a_settled_cycle(tmp_path: Path) -> None:
    angle = np.linspace(0.0, 4.0 * np.pi, 400)
    drive = np.sin(angle)
    settled = drive - 0.2 * np.cos(angle)
    virgin = np.where(angle < np.pi / 2, drive, settled)
    virgin[0] = 0.0
    for answer, kind in ((settled, "settled"), (virgin, "demagnetised")):
        rows = [f"{h},{b}" for h, b in zip(drive, answer, strict=True)]
        path = file_of(tmp_path, f"{kind}.csv", "H_A_per_m,B_T", rows)
        assert read_loops(path).loops[0].history.kind == kind


def test_a_settings_file_next_to_the_data_is_used(tmp_path: Path) -> None:
    path = file_of(tmp_path, "raw.csv", "drive,U_V,run", rows_of(1, "a"), rows_of(2, "b"))
    (tmp_path / "raw.toml").write_text(
        'loop = "run"\n[columns]\ndrive = "I_mA"\nU_V = "psi_Wb"\n'
        '[history]\na = "demagnetised"\n[constants]\ngap_mm = 0.5\n'
    )
    loops = read_loops(path)
    assert loops.schedule_values == (0.0005,)
    assert [loop.label for loop in loops.loops] == ["a", "b"]
    assert loops.loops[0].history.kind == "demagnetised"
    assert loops.loops[0].input.max() == 2e-3
    assert loops.sources[0].columns == {"drive": "I_mA", "U_V": "psi_Wb"}
    assert read_loops(path, history="settled").loops[0].history.kind == "settled"


def test_rows_are_selected_by_value(tmp_path: Path) -> None:
    blocks = [rows_of(1, 0.4, "y"), rows_of(2, 0.5, "y"), rows_of(3, 0.6, "n")]
    path = file_of(tmp_path, "a.csv", "I_A,F_N,gap_mm,ok", *blocks)
    assert read_loops(path, select={"ok": "y"}).schedule_values == (0.0004, 0.0005)
    assert read_loops(path, select={"gap_mm": [0.5, 0.6]}).schedule_values == (0.0005, 0.0006)
    both = read_loops(path, select={"gap_mm": 0.50, "ok": "y"})
    assert both.schedule_values == (0.0005,)
    assert read_loops(path, select={"gap_mm": "0.50"}).schedule_values == (0.0005,)
    with refused("selection-empty"):
        read_loops(path, select={"ok": "maybe"})


def test_constants_come_from_the_file_name(tmp_path: Path) -> None:
    for value in (-38, 5):
        file_of(tmp_path, f"gd_T{value:+04d}C.csv", "H_A_per_m,B_T", rows_of(abs(value)))
    loops = read_loops(tmp_path, file_name="gd_T{T_C}C")
    assert loops.schedule_values == (-38.0, 5.0)
    with refused("file-name-pattern file_name"):
        read_loops(tmp_path, file_name="x{T_C}")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("columns = 3\n", "wrong-kind columns"),
        ("colums = {}\n", "extra-forbidden colums"),
        ("[columns]\nI = 3\n", "wrong-kind columns.I"),
        ("[columns\n", "damaged-toml"),
        ('history = "old"\n', "unknown-history history: 'old'"),
        ("[constants]\nT_foo = 3\n", "bad-constant T_foo"),
        ("[constants]\ngap = 3\n", "bad-constant gap"),
        ('[columns]\nQ = "I_A"\n', "no-such-column Q"),
    ],
)
def test_bad_sidecar_is_named_with_its_key(tmp_path: Path, content: str, words: str) -> None:
    path = file_of(tmp_path, "a.csv", "I_A,F_N", rows_of())
    sidecar = tmp_path / "other.toml"
    sidecar.write_text(content)
    with refused(words):
        read_loops(path, sidecar=sidecar)


@pytest.mark.parametrize(
    ("header", "rows", "words"),
    [
        ("I_A,gap_mm", ["1,2"] * 4, "column-missing"),
        ("z,F_N", ["1,2"] * 4, "column-missing"),
        ("I,F_N", ["1,2"] * 4, "bad-header I: 'I_A'"),
        ("I_foo,F_N", ["1,2"] * 4, "bad-header I_foo"),
        ("I_A,F_N,gap", ["1,2,3"] * 4, "bad-header gap: 'gap_m'; 'gap_mm'"),
        ("I_A,F_N,gap_mm", ["1,2,3", "2,3,-1", "3,4,3"], "negative-gap gap_m: line 3; -0.001 m"),
        ("I_A,F_N", ["1,2", "2,3"], "too-few-samples 1"),
        ("I_A,F_N", ["1,2"] * 4, "input-constant 1"),
        ("t_s,I_A,F_N", ["0,1,2", "1,2,3", "# x", "0.5,3,4", "2,1,1"], "time-backwards: line 5"),
        ("I_A,F_N,F_kN", ["1,2,3"] * 4, "column-twice force: 'F_N'; 'F_kN'"),
    ],
)
def test_bad_files_are_reported_in_one_line(tmp_path: Path, header: str, rows: list[str], words: str) -> None:
    path = file_of(tmp_path, "bad.csv", header, rows)
    with refused(words) as caught:
        read_loops(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_record_that_never_reverses_is_flagged_and_refused_when_it_matters(tmp_path: Path) -> None:
    path = file_of(tmp_path, "a.csv", "I_A,F_N", [f"{k},{k * k}" for k in range(20)])
    loops = read_loops(path)
    assert not loops.loops[0].reverses
    with refused("no-reversal"):
        loops.require_reversals()
    read_loops(file_of(tmp_path, "b.csv", "I_A,F_N", rows_of())).require_reversals()


def test_frames_follow_the_same_rules() -> None:
    frame = pd.DataFrame({"I [mA]": UP_AND_BACK * 2, "F_N": np.arange(26.0), "loop": ["a"] * 13 + ["b"] * 13})
    loops = read_loops(frame, constants={"gap_mm": 0.3}, history="settled")
    assert [loop.label for loop in loops.loops] == ["a", "b"]
    assert loops.loops[0].input.max() == 2e-3
    assert loops.schedule_values == (0.0003,)
    with refused("text-in-numbers F_N"):
        read_loops(frame.assign(F_N="x"))
    frame.loc[3, "F_N"] = np.nan
    with refused("not-finite: row 3"):
        read_loops(frame)


def test_loops_are_immutable() -> None:
    drive = np.array(UP_AND_BACK)
    loop = Loop("1", drive, drive**2)
    drive[0] = 99.0
    assert loop.input[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        loop.input[0] = 1.0
    with pytest.raises(FrozenInstanceError):
        loop.label = "2"  # type: ignore[misc]


def test_two_loops_of_one_name_are_refused() -> None:
    loop = Loop("1", np.array(UP_AND_BACK), np.array(UP_AND_BACK))
    with refused("loop-twice 1"):
        Loops((loop, loop), QUANTITIES["current"], QUANTITIES["force"])
