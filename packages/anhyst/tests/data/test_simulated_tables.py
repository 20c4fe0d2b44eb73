"""Simulated tables of flux linkage and force over current and position, in the forms of five programs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst import InputError, read_loops
from anhyst.data.loops import Loops
from anhyst.data.path import ANHYSTERETIC, History
from tests.data.simulated_tables import WRITERS, Table, draw_table

QUICK_SEEDS = range(4)
UNSEEN_SEEDS = range(5000, 5030)


def check_against(loops: Loops, table: Table, values: np.ndarray) -> None:
    """Check that loops contain exactly the points of a table, ascending in gap and current."""
    order = np.argsort(table.gaps)
    gaps = table.gaps[order] - (table.gaps.min() if table.is_stroke else 0.0)
    np.testing.assert_allclose(loops.schedule_values, gaps, rtol=1e-6, atol=1e-12)
    for loop, row in zip(loops.loops, order, strict=True):
        columns = [n for n in range(table.currents.size) if (row, n) not in table.missing]
        np.testing.assert_allclose(loop.input, table.currents[columns], rtol=1e-9, atol=0.0)
        np.testing.assert_allclose(loop.output, values[row, columns], rtol=1e-9, atol=0.0)
        assert loop.history == ANHYSTERETIC


@pytest.mark.parametrize("seed", QUICK_SEEDS)
@pytest.mark.parametrize("form", WRITERS)
def test_reading_is_exact(form: str, seed: int, tmp_path: Path) -> None:
    """Every form gives the points of the table in SI units, one loop for each gap."""
    table = draw_table(seed)
    loops = read_loops(WRITERS[form](table, tmp_path))
    assert (loops.input.name, loops.output.name) == ("current", "flux_linkage")
    check_against(loops, table, table.psi)
    assert any("without hysteresis" in note for note in loops.notes)
    assert any("no depth, symmetry factor or number of turns is applied" in note for note in loops.notes)
    assert any("closes the gap" in note for note in loops.notes) == table.is_stroke


@pytest.mark.slow
@pytest.mark.parametrize("form", WRITERS)
def test_reading_of_many_tables_is_exact(form: str, tmp_path: Path) -> None:
    """The same holds for 30 tables that were not used for the design."""
    for seed in UNSEEN_SEEDS:
        folder = tmp_path / str(seed)
        folder.mkdir()
        table = draw_table(seed)
        check_against(read_loops(WRITERS[form](table, folder)), table, table.psi)


@pytest.mark.parametrize("form", ["femm", "elmer", "jmag", "long", "mat"])
def test_force_of_a_table_is_positive(form: str, tmp_path: Path) -> None:
    """Without the column of the flux linkage, the force is read, and an attraction is positive."""
    table = draw_table(11)
    table.missing = set()
    path = WRITERS[form](table, tmp_path)
    flux_name = next(
        note.rsplit('"', 2)[1] for note in read_loops(path).notes if "is used instead with --columns" in note
    ).removesuffix("=")
    loops = read_loops(path, columns={flux_name: ""})
    assert loops.output.name == "force"
    check_against(loops, table, table.force)


def test_table_has_the_output_of_measured_loops(tmp_path: Path) -> None:
    """A table of both outputs that is read with a measured force gives its force."""
    table = draw_table(2)
    table.missing = set()
    gap = 1e3 * float(table.gaps[1])
    current = np.concatenate([table.currents, table.currents[-2::-1]])
    rows = [f"{i!r},{gap!r},{f!r}" for i, f in zip(current.tolist(), (current**2).tolist(), strict=True)]
    measured = tmp_path / "loop.csv"
    measured.write_text("\n".join(["I_A,gap_mm,F_N", *rows]) + "\n")
    loops = read_loops([WRITERS["comsol"](table, tmp_path), measured])
    assert loops.output.name == "force"
    assert sorted(loop.history.kind for loop in loops.loops) == ["anhysteretic"] * table.gaps.size + [
        "settled"
    ]


def test_measured_loops_on_a_grid_are_not_a_table(tmp_path: Path) -> None:
    """Loops with both branches at the same currents keep their hysteresis."""
    current = np.concatenate([np.linspace(0.0, 2.0, 21), np.linspace(2.0, 0.0, 21)[1:]])
    force = current**2 + 0.1 * np.where(np.arange(41) < 21, 0.0, current)
    lines = [f"{i},{gap},{f / gap}" for gap in (0.3, 0.5, 0.7) for i, f in zip(current, force, strict=True)]
    path = tmp_path / "loops.csv"
    path.write_text("\n".join(["I_A,gap_mm,F_N", *lines]) + "\n")
    assert all(loop.n == 41 and loop.history.kind == "settled" for loop in read_loops(path).loops)


@pytest.mark.parametrize("is_wide", [False, True])
def test_loops_with_common_currents_are_not_a_table(is_wide: bool, tmp_path: Path) -> None:
    """Branches sampled at different currents, which all gaps have in common, are not mixed."""
    current = np.concatenate([np.linspace(0.0, 2.0, 40), np.linspace(1.97, 0.01, 37)])
    force = current**2 + 0.05 * np.where(np.arange(77) < 40, 0.0, current)
    gaps = (0.3, 0.5, 0.7)
    path = tmp_path / "loops.csv"
    lines = [f"{i},{gap},{f / gap}" for gap in gaps for i, f in zip(current, force, strict=True)]
    wide = [f"{i},{f / 0.3},{f / 0.5},{f / 0.7}" for i, f in zip(current, force, strict=True)]
    head = "I_A,F_N_0.3mm,F_N_0.5mm,F_N_0.7mm" if is_wide else "I_A,gap_mm,F_N"
    path.write_text("\n".join([head, *(wide if is_wide else lines)]) + "\n")
    if is_wide:
        with pytest.raises(InputError, match="one loop after the other"):
            read_loops(path)
    else:
        assert [loop.history.kind for loop in read_loops(path).loops] == ["settled"] * 3


@pytest.mark.parametrize("seed", range(60))
def test_drawn_loops_are_not_a_table(seed: int) -> None:
    """Loops of any form, also with currents that all gaps have in common, keep their history."""
    rng = np.random.default_rng(seed)
    count, largest, width = int(rng.integers(8, 80)), rng.uniform(1.0, 5.0), rng.uniform(0.002, 0.1)
    phase, rise = np.arange(2 * count) + rng.uniform(), np.linspace(0.0, largest, count)
    current = [
        0.5 * largest * (1.0 - np.cos(np.pi * phase / count)),
        np.concatenate([rise, rise[-2::-1]]),
        np.concatenate([rise, rise[-2::-1], 0.6 * rise, 0.6 * rise[-2::-1]]),
        np.concatenate([rise, np.linspace(0.99 * largest, 0.01, count - 3)]),
        largest * np.sin(np.pi * phase / count),
    ][seed % 5]
    currents = [current + (seed % 2) * 1e-3 * rng.normal(size=current.size) for _ in range(3)]
    flux = np.concatenate(
        [(i - width * np.sign(np.gradient(current))) / (n + 1) for n, i in enumerate(currents)]
    )
    gaps = np.repeat([0.3, 0.5, 0.7], current.size)
    loops = read_loops({"I_A": np.concatenate(currents), "gap_mm": gaps, "psi_Wb": flux})
    assert all(loop.history != ANHYSTERETIC for loop in loops.loops)


HEAD = "I_A,x_mm,psi_Wb\n"
ROWS = "0,0.3,0\n1,0.3,{a}\n2,0.3,3\n0,0.5,0\n1,0.5,{b}\n2,0.5,2\n0,0.7,0\n1,0.7,{c}\n2,0.7,1\n"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (HEAD.replace("x_mm", "gap_mm") + "0,1,0\n1,1,1\n2,1,2\n0,2,0\n1,2,2\n2,2,3\n", "so it is not a gap; map"),
        (HEAD + "0,1,0\n1,1,1\n2,1,2\n0,2,0\n1,2,2\n2,2,1\n", "both grows and falls with 'x_mm'"),
        (HEAD.replace("psi_Wb", "F_N") + "-1,1,-1\n1,1,1\n2,1,2\n-1,2,-1\n1,2,1\n2,2,1.5\n", "has one sign"),
        (HEAD + ROWS.format(a=1.5, b=1, c=0.5) + "3,0.3,4\n3,0.5,3\n3,0.7,2\n3,0.7,2.5\n", "two values in 'psi_Wb'"),
        (HEAD.replace("psi_Wb", "Force (N/m)") + ROWS.format(a=1.5, b=1, c=0.5), "unknown unit 'N/m'"),
        ("psi_Wb\nI_A\\gap_mm,0.3,0.5\n0,0,0\n1,1,x\n2,2,1\n", "line 4: is not a row of 3 numbers"),
        ("psi_Wb\nI_A\\gap_mm,0.3,0.5\n0,0,0\n1,1,1,1\n2,2,1\n", "line 4: is not a row of 3 numbers"),
        ("% Grid\n0 1 2\n0.1 0.2 0.3\n% Data (psi (Wb))\n0 1 2\n0 1 2\n0 1 2\n", "numbers instead of a header"),
    ],
)  # fmt: skip
def test_unclear_tables_are_refused(text: str, fault: str, tmp_path: Path) -> None:
    """A table whose direction, sign, unit or values are not clear is refused with one line."""
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(InputError) as refusal:
        read_loops(path)
    assert fault in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_stroke_named_gap_is_read_after_mapping(tmp_path: Path) -> None:
    """The mapping that the refusal proposes makes a gap of the stroke."""
    path = tmp_path / "table.csv"
    rows = [f"{i},{x},{i * x}\n" for x in (0.3, 0.5, 0.7) for i in range(3)]
    path.write_text(HEAD.replace("x_mm", "gap_mm") + "".join(rows))
    loops = read_loops(path, columns={"gap_mm": "x_mm", "psi_Wb": "psi_Wb"})
    assert loops.schedule_values == pytest.approx((0.0, 2e-4, 4e-4))


def test_motor_map_is_refused(tmp_path: Path) -> None:
    """A map of SyR-e with two axes is named as such."""
    from scipy.io import savemat

    currents = np.meshgrid(np.linspace(0.0, 10.0, 5), np.linspace(0.0, 10.0, 4))
    flux_map = dict(zip(("Id", "Iq", "Fd", "Fq", "T"), (*currents, *currents, currents[0]), strict=True))
    savemat(tmp_path / "motor.mat", {"motorModel": {"FluxMap_dq": flux_map}})
    with pytest.raises(InputError, match="motor with two axes"):
        read_loops(tmp_path / "motor.mat")


def test_history_anhysteretic_needs_no_grid(tmp_path: Path) -> None:
    """A stated history makes a table of points that are not on a grid."""
    path = tmp_path / "table.csv"
    points = [(i + 0.1 * gap, gap, i / gap) for gap in (0.3, 0.5, 0.7) for i in (0.0, 1.0, 2.0, 3.0)]
    path.write_text("I_A,gap_mm,psi_Wb\n" + "".join(f"{i},{gap},{psi}\n" for i, gap, psi in points))
    assert read_loops(path, history="anhysteretic").loops[0].history == ANHYSTERETIC
    assert read_loops(path).loops[0].history == History("demagnetised")
    with pytest.raises(InputError, match="wrong turning points"):
        read_loops(path, history="anhysteretic:0,1")


def damage(content: bytes, data: st.DataObject) -> bytes:
    """Return a file with one to four faults."""
    draw = data.draw
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, max(len(content) - 1, 0)))
        lines = content.split(b"\n")
        line = draw(st.integers(0, len(lines) - 1))
        kind = draw(st.sampled_from(["byte", "cut", "end", "insert", "twice", "drop", "swap"]))
        piece = draw(
            st.sampled_from([b",", b";", b"\t", b"NaN", b"inf", b"%", b"1e400", b"\0", b'"', b"=", b"N/m"])
        )
        content = {
            "byte": content[:place] + bytes([draw(st.integers(0, 255))]) + content[place + 1 :],
            "cut": content[:place] + content[place + draw(st.integers(1, 40)) :],
            "end": content[:place],
            "insert": content[:place] + piece + content[place:],
            "twice": b"\n".join([*lines[:line], lines[line], *lines[line:]]),
            "drop": b"\n".join([*lines[:line], *lines[line + 1 :]]),
            "swap": content.replace(piece, draw(st.sampled_from([b"", b" ", b"-"]))),
        }[kind]
    return content


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_damaged_tables_are_read_or_refused_in_one_line(data: st.DataObject) -> None:
    """A damaged table is read or refused with one line; no other error occurs."""
    import tempfile

    form = data.draw(st.sampled_from([name for name in WRITERS if name != "mat"]))
    table = draw_table(data.draw(st.integers(0, 20)))
    with tempfile.TemporaryDirectory() as folder:
        path = WRITERS[form](table, Path(folder))
        target = path.with_name(f"{path.name}.names")
        target = target if target.exists() and data.draw(st.booleans()) else path
        target.write_bytes(damage(target.read_bytes(), data))
        try:
            outputs, fault = [loop.output for loop in read_loops(path).loops], ""
        except InputError as refusal:
            outputs, fault = [], str(refusal)
        assert "\n" not in fault
        assert all(np.isfinite(output).all() for output in outputs)


def test_return_branches_equal_the_ascending_ones(tmp_path: Path) -> None:
    """For a fit, every loop of a table gets a descending branch; other loops are unchanged."""
    table = draw_table(3)
    loops = read_loops(WRITERS["long"](table, tmp_path))
    for loop, closed in zip(loops.loops, loops.with_return_branches().loops, strict=True):
        np.testing.assert_array_equal(closed.output[loop.n - 1 :], loop.output[::-1])
        np.testing.assert_array_equal(closed.output[: loop.n], loop.output)
        assert closed.reversals == 1
    tables, measured = loops.with_history("settled").split_tables()
    assert tables is None
    assert measured is not None
    assert replace(measured.loops[0]).n == loops.loops[0].n
