"""Options and file names complete a file: scales, signs, invalid samples and gaps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anhyst.data.clean import ReadOptions
from anhyst.data.file_names import find_gaps_in_names
from anhyst.data.reading import read_loops
from anhyst.identification.run import IdentifyTable
from anhyst.support.numeric import FloatArray
from tests.refusals import refused

PHASE = np.linspace(0.0, 6.0 * np.pi, 600)


def cycles(lowest: float = 0.0, high: float = 2.0) -> FloatArray:
    """Return three cycles of a current, A."""
    return 0.5 * (lowest + high) - 0.5 * (high - lowest) * np.cos(PHASE)


def force_of(current: FloatArray, gap: float, play: float = 0.1) -> FloatArray:
    """Return the force of a magnet with a play operator in its iron, N."""
    state, flux = 0.0, np.empty_like(current)
    for index, value in enumerate(current):
        state = min(max(state, value - play), value + play)
        flux[index] = state
    return 10.0 * (1e-3 * flux / (gap + 2e-4)) ** 2


def write(path: Path, header: str, *columns: FloatArray) -> Path:
    """Write columns as CSV."""
    np.savetxt(path, np.column_stack(columns), "%.9g", ",", header=header, comments="")
    return path


def write_magnet(path: Path, gap: float, current: FloatArray, play: float = 0.1) -> None:
    write(path, "I_A,F_N", current, force_of(current, gap, play))


def test_scale_and_flip_are_applied_noted_and_saved(tmp_path: Path) -> None:
    current = cycles()
    force = force_of(current, 5e-4)
    path = write(tmp_path / "a.csv", "CH1 (V),CH2 (mV)", current / 10.0, -force / 50.0)
    options = ReadOptions.from_text(
        columns="CH1 (V)=I_A,CH2 (mV)=F_N", scale="CH1 (V)=10,F=50", flip="F_N", clean="none"
    )
    loops = options.read([path])
    np.testing.assert_allclose(loops.loops[0].input, current, rtol=1e-8)
    np.testing.assert_allclose(loops.loops[0].output, force, rtol=1e-8)
    notes = " ".join(loops.notes)
    assert "'CH1 (V)': multiplied by 10" in notes
    assert "'CH2 (mV)': its sign is reversed" in notes
    texts = {name.removeprefix("read_"): str(v) for name, v in options.as_settings().items()}
    assert ReadOptions.from_text(**texts) == options
    read_again = read_loops(path, columns=options.columns, scale={"CH1 (V)": 10, "force": 50}, flip=["force"])
    assert np.array_equal(read_again.loops[0].output, loops.loops[0].output)
    sidecar = path.with_suffix(".toml")
    sidecar.write_text(
        'flip = "F"\n[columns]\n"CH1 (V)" = "I_A"\n"CH2 (mV)" = "F_N"\n[scale]\nI = 10\nF = 50\n'
    )
    assert np.array_equal(read_loops(path).loops[0].output, loops.loops[0].output)


def test_the_table_of_a_rig_accepts_the_same_options() -> None:
    texts = {"columns": "CH1=I_A", "scale": "CH1=10", "flip": "F_N", "drop": "invalid"}
    assert IdentifyTable.model_validate(texts).read_options() == ReadOptions.from_text(**texts)


def test_volts_need_a_scale_to_be_a_force(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "I_A,load cell [V]", cycles(), force_of(cycles(), 5e-4))
    with refused("scale-needed load cell [V]: N_PER_V"):
        read_loops(path, columns={"load cell [V]": "F_N"})
    with refused("bad-scale F: data sheet"):
        read_loops(path, columns={"load cell [V]": "F_N"}, scale={"F": "N_PER_V"})


@pytest.mark.parametrize("mark", ["NaN", "-inf", "∞", "OL", "Over", "--", "#N/A", "", "9.91e37"])
def test_invalid_samples_are_skipped_and_counted(tmp_path: Path, mark: str) -> None:
    current = cycles()
    fields = [f"{value:.6f}" for value in force_of(current, 5e-4)]
    fields[100:104] = [mark] * 4
    fields[300] = mark
    rows = [f"{i:.6f},{f}" for i, f in zip(current, fields, strict=True)]
    path = tmp_path / "a.csv"
    path.write_text("I_A,F_N\n" + "\n".join(rows) + "\n", encoding="utf-8")
    with refused("not-finite F_N: line 102; 5 of 600; --drop invalid"):
        read_loops(path)
    loops = read_loops(path, drop="invalid")
    assert loops.loops[0].n == 595
    assert "5 of 600 samples left out as invalid in 'F_N', at most 4 in a row" in loops.notes[0]


@pytest.mark.parametrize(
    ("names", "gaps"),
    [
        (["Messung_Spalt_0.5mm", "Messung_Spalt_0.8mm"], [0.5, 0.8]),
        (["gap0p5mm_run1", "gap0p8mm_run2"], [0.5, 0.8]),
        (["gap_500um", "gap_1.2mm"], [0.5, 1.2]),
        (["d=0,8mm", "d=1mm"], [0.8, 1.0]),
        (["0.45 mm", "0.6 mm"], [0.45, 0.6]),
        (["airgap-1.2mm_run3", "airgap-0.4mm_run4"], [1.2, 0.4]),
        (["core_20mm_entrefer_0.3mm", "core_20mm_entrefer_0.4mm"], [0.3, 0.4]),
        (["luchtspleet 10mil", "luchtspleet 20mil"], [0.254, 0.508]),
        (["gap_0.5mm", "gap_0.5mm_b"], [0.5, 0.5]),
        (["Luftspalt 0,8mm"], [0.8]),
        (["run_0.5mm"], []),  # no word for a gap, and no second name
        (["cable_500mm", "cable_1000mm"], []),
        (["EM12mm_20C", "EM15mm_20C"], []),
        (["0.5mm_coil", "0.8mm_magnet"], []),
        (["gap_0.5mm", "other"], []),
        (["run1", "run2"], []),
        (["2024-05-11", "2024-05-12"], []),
        (["2024-05-11_5mm", "2024-05-12_8mm"], []),  # 11.5 mm, or 5 mm?
        (["core_20mm", "core_30mm"], []),
        (["sheet 0.35mm", "sheet 0.5mm"], []),
        (["run_0.5mm_2mm", "run_0.8mm_2mm"], []),
        (["gap_05mm", "gap_08mm"], []),
        (["M400-50A", "M270-50A"], []),
    ],
)
def test_gaps_of_names(names: list[str], gaps: list[float]) -> None:
    found = find_gaps_in_names([Path(f"{name}.csv") for name in names])
    assert [1e3 * gap for gap in found.values()] == pytest.approx(gaps)


def test_a_gap_column_has_priority_over_file_names(tmp_path: Path) -> None:
    for number, gap in enumerate((3.1e-4, 4.2e-4)):
        current = cycles()
        columns = current, force_of(current, gap), np.full_like(current, gap)
        write(tmp_path / f"gap_0.{number + 3}mm.csv", "I_A,F_N,gap_m", *columns)
    assert read_loops(tmp_path).schedule_values == (3.1e-4, 4.2e-4)
    (tmp_path / "gap_0.3mm.csv").rename(tmp_path / "gap_0.6mm.csv")
    with refused("gap-contradiction gap: 0.6 mm; 0.31 mm; --schedule gap"):
        read_loops(tmp_path)
    assert read_loops(tmp_path, schedule="gap").schedule_values == (3.1e-4, 4.2e-4)


@pytest.mark.parametrize(
    ("runs", "is_one_curve"),
    [
        ([(5e-4, (0, 2), 0.1), (8e-4, (0, 2), 0.1), (1.2e-3, (0, 2), 0.1)], False),
        ([(5e-4, (0, 2), 0.1), (5.6e-4, (0, 2), 0.1)], False),
        ([(5e-4, (-2, 2), 0.1), (8e-4, (-1, 1), 0.1)], False),
        ([(5e-4, (0, 2), 0.1), (5e-4, (0, 1), 0.1), (5e-4, (0.5, 1.5), 0.1)], True),
        ([(5e-4, (0, 2), 0.1), (5e-4, (0, 2), 0.25)], True),  # another speed
        ([(5e-4, (-2, 2), 0.1), (5e-4, (-1, 1), 0.1)], True),
    ],
)
def test_different_loops_without_a_gap_are_a_question(
    tmp_path: Path, runs: list[tuple[float, tuple[float, float], float]], is_one_curve: bool
) -> None:
    for number, (gap, ends, play) in enumerate(runs):
        write_magnet(tmp_path / f"run{number}.csv", gap, cycles(*ends), play)
    if is_one_curve:
        assert len(read_loops(tmp_path)) == len(runs)
        return
    with refused("gap-missing gap: --schedule none"):
        read_loops(tmp_path)
    assert len(read_loops(tmp_path, schedule="none")) == len(runs)


def noisy_gap(gap: FloatArray, scatter: float) -> FloatArray:
    return gap + scatter * np.random.default_rng(5).normal(size=gap.size)


@pytest.mark.parametrize("scatter", [1e-6, 3e-6, 6e-6])
@pytest.mark.parametrize("gaps", [[5e-4], [5e-4, 8e-4, 1.2e-3], [9e-4, 7e-4]])
def test_plateaus_of_a_noisy_gap_are_gaps(tmp_path: Path, gaps: list[float], scatter: float) -> None:
    current = np.tile(cycles(), len(gaps))
    gap = np.repeat(gaps, PHASE.size)
    force = np.concatenate([force_of(cycles(), gap) for gap in gaps])
    time = 1e-3 * np.arange(gap.size, dtype=np.float64)
    header = "t_s,I_A,F_N,gap_m"
    loops = read_loops(write(tmp_path / "a.csv", header, time, current, force, noisy_gap(gap, scatter)))
    assert loops.schedule_values == pytest.approx(sorted(gaps), abs=0.2 * scatter)
    assert len(loops) == len(gaps)
    assert sum(loop.n for loop in loops.loops) == gap.size
    assert "scatter" in loops.notes[0]


def test_moving_gap_has_no_plateaus(tmp_path: Path) -> None:
    current = np.tile(cycles(), 3)
    gap = 8e-4 + 3e-4 * np.sin(np.linspace(0.0, 17.0, current.size))
    columns = current, force_of(current, 8e-4), noisy_gap(gap, 2e-6)
    (loop,) = read_loops(write(tmp_path / "a.csv", "I_A,F_N,gap_m", *columns)).loops
    assert loop.schedule_value is None


def test_cases_are_read_right(cases: Path) -> None:
    german = read_loops(cases / "german")
    assert german.schedule_values == pytest.approx((5e-4, 8e-4, 1.2e-3, 1.8e-3))
    assert german.notes[0] == "gap taken from the file names: 0.5 mm, 0.8 mm, 1.2 mm, 1.8 mm"
    stepping = read_loops(cases / "stepping.csv")
    assert stepping.schedule_values == pytest.approx((5e-4, 8e-4, 1.2e-3, 1.8e-3), abs=3e-7)
    kgf, kg = read_loops(cases / "force_kgf.csv"), read_loops(cases / "force_kg.csv")
    assert max(loop.output.max() for loop in kgf.loops) == pytest.approx(391.2, rel=1e-3)
    assert kg.loops[0].output.max() == pytest.approx(18.33 * 9.80665, rel=1e-3)
    assert "9.80665" in kg.notes[0]
    comma = read_loops(cases / "comma_in_header.csv")
    assert comma.loops[0].output.max() == pytest.approx(18.33, rel=1e-3)
    mapped = ReadOptions.from_text(columns='"Current, coil (A)"=I_A,"Force, z component (N)"=F_N').read(
        [cases / "comma_in_header.csv"]
    )
    assert mapped.loops[0].output.max() == comma.loops[0].output.max()


def test_cases_that_are_questions_propose_input_and_output(cases: Path) -> None:
    with refused('column-missing: --columns "CH1=I_A,CH2=F_N"; --scale "CH2=N_PER_V"'):
        read_loops(cases / "scope_time_ch1_ch2.csv")
    with refused('column-missing: --columns "CH1=I_A,CH2=F_N"'):
        read_loops(cases / "scope_metadata_beside_data.csv")
    with refused('column-missing: --columns "yout_1=I_A,yout_2=F_N"'):
        read_loops(cases / "tout_yout.mat")
    (simulink,) = read_loops(cases / "tout_yout.mat", columns={"yout_1": "I_A", "yout_2": "F_N"}).loops
    assert simulink.time is not None
    assert simulink.time[-1] == pytest.approx(1.199)
    channels = {"Channel A": "I_A", "Channel B": "F_N"}
    scale = {"Channel A": 1.0, "Channel B": 0.01}
    path = cases / "scope_overrange.csv"
    with refused("not-finite Channel A: line 194; 21 of 1200; --drop invalid"):
        read_loops(path, columns=channels, scale=scale)
    assert read_loops(path, columns=channels, scale=scale, drop="invalid").loops[0].n == 1179
    with_marks = read_loops(cases / "invalid_samples.mf4", columns={"I": "I_A", "F": "F_N"}, drop="invalid")
    assert with_marks.loops[0].n == 1175
    assert "25 of 1200 samples left out" in with_marks.notes[0]
