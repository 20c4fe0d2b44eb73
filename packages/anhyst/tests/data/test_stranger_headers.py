"""Headers of other users are read correctly, or refused with a useful remedy."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from anhyst import read_loops
from anhyst.data.clean import ReadOptions
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import parse_header
from tests.refusals import in_commands, refused

SAMPLES = 90


def loop(gap: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Return input and output of a loop; the output falls with the gap."""
    phase = np.linspace(0.0, 2.0 * np.pi, SAMPLES)
    drive = 1.0 - np.cos(phase)
    return drive, (drive - 0.1 * np.sin(phase)) ** 2 / gap


def write(path: Path, header: str, *columns: FloatArray) -> Path:
    rows = [";".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def table(path: Path, header: str) -> Path:
    """Write a table of any width; each column is a multiple of the loop's input or output."""
    drive, answer = loop()
    width = header.count(";") + 1
    return write(path, header, *[(k + 1) * (drive if k % 2 == 0 else answer) for k in range(width)])


@pytest.mark.parametrize(
    ("header", "factors"),
    [
        ("I/uA;F/cN", (1e-6, 1e-2)),
        ("Spulenstrom/kA;Haltekraft/daN", (1e3, 10.0)),
        ("I <uA>;F {kN}", (1e-6, 1e3)),
        ("I.kA;F.daN", (1e3, 10.0)),
        ("IuA;FcN", (1e-6, 1e-2)),
        ("H/(A/cm);B/kG", (1e2, 0.1)),
        ("u/mV;x/nm", (1e-3, 1e-9)),
        ("i: mA;F, N", (1e-3, 1.0)),
        ("I in kA;F in mN", (1e3, 1e-3)),
        ("I [kA] [kA];F_mN [mN]", (1e3, 1e-3)),
        ("U/kV;eps/%", (1e3, 1e-2)),
        ("I/A;lambda/mWb", (1.0, 1e-3)),
    ],
)
def test_unit_is_read_wherever_the_header_shows_it(
    tmp_path: Path, header: str, factors: tuple[float, float]
) -> None:
    (read,) = read_loops(table(tmp_path / "a.csv", header)).loops
    drive, answer = loop()
    assert read.input == pytest.approx(factors[0] * drive, rel=1e-6)
    assert read.output == pytest.approx(2.0 * factors[1] * answer, rel=1e-6)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("I_kA [A];F [N]", ('"I_kA [A]=I_kA"', '"I_kA [A]=I_A"')),
        ("I [A];Haltekraft (kN) [N]", ('"Haltekraft (kN) [N]=F_kN"', '[N]=F_N"')),
        ("Speisung Netzstrom [A];Haltekraft [N];I_Spule [A]", ('"I_Spule [A]=I_A"',)),
        ("I [A];Kraftgrenze [N];DMS 2 [N]", ('"DMS 2 [N]=F_N"',)),
        ("Vorgabe Strom [mA];F [N]", ("if 'Vorgabe Strom [mA]' can", "=I_mA")),
        ("Strom [A];F [N];Ch 4 [A]", ("which one is the current", '"Strom [A]=I_A"', '"Ch 4 [A]=I_A"')),
        ("I [A];Fa [N];Fb [N];Fc [N]", ("which one", "Fa [N]=F_N", "Fb [N]=F_N", "Fc [N]=F_N")),
        ("5*I [A];F [N]", ("formula", '--scale "5*I [A]=0.2"')),
        ("I [A];F [N] / 4", ("formula", '--scale "F [N] / 4=4"')),
        ("I [A];log10(F) [N]", ("formula", "export the quantity itself")),
        ("B/Bs;H [A/m]", ("formula",)),
        ("U [kV];Hub [um];I [mA]", ('"I [mA]="', '"U [kV]="')),
        ("Verstärker Ausgang [V];Hub [um]", ('Ausgang [V]=u_V"',)),
        ("I [mA] (Bereich 2 A);F [N]", ('(Bereich 2 A)=I_mA"',)),
        ("I [%];F [N]", ("--scale", "A_PER_PERCENT")),
        ("I [A];F [N];gap_adc", ('--scale "gap_adc=m_PER_adc"',)),
        ("I [A];F [N];traferro", ("has no unit", '"traferro=gap_mm"')),
        ("current;force;gap", ("none either", '"current=I_A,force=F_N,gap=gap_mm"')),
    ],
)
def test_doubtful_header_is_a_question(tmp_path: Path, header: str, message: tuple[str, ...]) -> None:
    path = table(tmp_path / "a.csv", header)
    with pytest.raises(InputError) as caught:
        read_loops(path)
    assert [text for text in message if text not in in_commands(caught.value)] == []
    option = re.search(r"--columns (\"[^\"]*\"|'[^']*')", in_commands(caught.value))
    if option is None or "in place of" in in_commands(caught.value):
        return
    scale = re.search(r"--scale (\"[^\"]*\")", in_commands(caught.value))
    options = ReadOptions.from_text(
        columns=shlex.split(option[1])[0], scale=shlex.split(scale[1])[0] if scale else None
    )
    assert len(options.read([path])) == 1


@pytest.mark.parametrize(
    "header", ["I [A];J [T]", "H [A/m];mu0M [T]", "I [A];Q [nC]", "U [V];M [emu/cm3]", "I [A];Moment/Nm"]
)
def test_nothing_is_proposed_across_dimensions(tmp_path: Path, header: str) -> None:
    with pytest.raises(InputError) as caught:
        read_loops(table(tmp_path / "a.csv", header))
    assert "--columns" not in in_commands(caught.value)


@pytest.mark.parametrize(
    "header", ["Kraft/Force [N]", "Flux density [T]", "Spulenstrom oben [A]", "Time 2 - slow rate [s]"]
)
def test_bilingual_and_longer_names_are_still_read(header: str) -> None:
    assert parse_header(header).is_from_words or parse_header(header).is_known


def test_capital_t_in_ms_is_a_time() -> None:
    assert parse_header("T [us]").is_clock
    assert parse_header("T [MS]").is_clock  # its unit is missing
    assert not parse_header("T [K]").is_clock


def steps(*gaps: float, ramp: int = 0, scatter: float = 0.0) -> list[FloatArray]:
    """Return time, input, output and gap (mm) of loops at successive gaps."""
    parts = []
    for number, gap in enumerate(gaps):
        if number and ramp:
            between = np.linspace(gaps[number - 1], gap, ramp + 2)[1:-1]
            parts.append((np.zeros(ramp), np.zeros(ramp), between))
        parts.append((*loop(gap), np.full(SAMPLES, gap)))
    drive, answer, gap_mm = (np.concatenate(column) for column in zip(*parts, strict=True))
    gap_mm = gap_mm + scatter * np.random.default_rng(3).normal(size=gap_mm.size)
    return [0.01 * np.arange(drive.size), drive, answer, gap_mm]


@pytest.mark.parametrize("scatter", [0.0, 4e-4])
@pytest.mark.parametrize("ramp", [25, 150])
def test_a_ramp_between_gaps_is_skipped(tmp_path: Path, ramp: int, scatter: float) -> None:
    columns = steps(0.4, 0.6, 0.9, ramp=ramp, scatter=scatter)
    loops = read_loops(write(tmp_path / "a.csv", "t_s;I_A;F_N;gap_mm", *columns))
    assert loops.schedule_values == pytest.approx((4e-4, 6e-4, 9e-4), abs=1e-6)
    assert any("samples between them left out" in note for note in loops.notes)


def test_a_wrong_gap_is_not_skipped_as_a_ramp(tmp_path: Path) -> None:
    columns = steps(0.4, 0.6, 0.9)
    columns[3][20] = -0.4
    with refused("negative-gap gap_m: -0.0004 m"):
        read_loops(write(tmp_path / "a.csv", "t_s;I_A;F_N;gap_mm", *columns))


def test_a_gap_that_returns_starts_a_new_loop(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "t_s;I_A;F_N;gap_mm", *steps(0.4, 0.6, 0.4))
    assert [loop.schedule_value for loop in read_loops(path).loops] == [4e-4, 6e-4, 4e-4]


@pytest.mark.parametrize(
    ("name", "scatter"),
    [("Afstand [mm]", 3e-4), ("Hub [mm]", 3e-4), ("Hub [mm]", 0.0), ("d", 0.0), ("Abstand", 3e-4)],
)
def test_hidden_gap_is_a_question(tmp_path: Path, name: str, scatter: float) -> None:
    path = write(tmp_path / "a.csv", f"t_s;I_A;F_N;{name}", *steps(0.4, 0.6, scatter=scatter))
    with refused(f"label-or-schedule {name}: if it is the gap, map it; {name}=gap_mm"):
        read_loops(path)
    assert len(read_loops(path, columns={name: "gap_mm"}).schedule_values) == 2


def test_cycles_of_two_heights_are_a_question(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "t_s;I_A;F_N", *steps(0.4, 0.6)[:3])
    with refused("gap-missing gap: 9.67; 6.45 N; gap_mm"):
        read_loops(path)
    assert len(read_loops(path, schedule="none")) == 1
    one = write(tmp_path / "b.csv", "t_s;I_A;F_N", *steps(0.4, 0.42)[:3])
    assert len(read_loops(one)) == 1
