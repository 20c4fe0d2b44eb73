"""Loops of the test magnets are read correctly: start, drift, labels and columns."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from tests.cli.command import quick, refused
from tests.cli.records import model
from tests.foreign.magnets import MAGNETS
from tests.refusals import says
from tests.repository import ROOT

Loops = list[tuple[str, float, FloatArray, FloatArray]]
"""Label, gap in m, current in A and force in N of each record."""


@cache
def record(name: str, gap: float, ends: tuple[float, ...], before: tuple[float, ...] = ()) -> Any:
    """Return current and true force of a magnet that is swept between ends, after another sweep."""
    magnet = MAGNETS[name]
    iron = magnet.make_iron()
    if before:
        magnet.force(magnet.sweep_between(*before), gap, iron)
    current = magnet.sweep_between(*ends)
    return current, magnet.force(current, gap, iron)


def records(
    name: str,
    ends: Callable[[float], tuple[float, ...]],
    before: Callable[[float], tuple[float, ...]] = lambda _: (),
    *,
    noise: float = 3e-4,
    drift: float = 0.0,
) -> Loops:
    """Return loops at two gaps and of two sizes; noise and drift are relative to the largest force."""
    magnet, random = MAGNETS[name], np.random.default_rng(7)
    largest = float(np.max(record(name, magnet.gaps[0], ends(magnet.top), before(magnet.top))[1]))
    found = []
    for gap in (magnet.gaps[0], magnet.gaps[-1]):
        for top in (magnet.top, 0.6 * magnet.top):
            current, force = record(name, gap, ends(top), before(top))
            read = force + largest * noise * random.normal(size=force.size)
            read += largest * drift * np.linspace(0.0, 1.0, force.size)
            measured = current + 0.05 * noise * magnet.top * random.normal(size=force.size)
            found.append((f"{top:g} A", gap, measured, read))
    return found


def write(path: Path, loops: Loops) -> Path:
    lines = ["loop,gap_m,I_A,F_N"]
    for label, gap, current, force in loops:
        rows = zip(current.tolist(), force.tolist(), strict=True)
        lines += [f"{label},{gap:.6g},{i:.9g},{f:.9g}" for i, f in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def inspected(path: Path, *options: str) -> dict[str, Any]:
    result = quick("inspect", path, "--json", *options, cwd=path.parent)
    assert result.returncode == 0, result
    found: dict[str, Any] = json.loads(result.stdout)
    return found


def histories(path: Path, *options: str) -> set[str]:
    return {loop["history"] for loop in inspected(path, *options)["loops"]}


def up_and_down_twice(top: float) -> tuple[float, ...]:
    return (0.0, top, 0.0, top, 0.0)


def once(top: float) -> tuple[float, ...]:
    return (0.0, top, 0.0)


def both_signs(top: float) -> tuple[float, ...]:
    return (0.0, top, -top, top, 0.0)


def run_in(top: float) -> tuple[float, ...]:
    return (0.0, top, 0.0)


def run_in_both_ways(top: float) -> tuple[float, ...]:
    return (0.0, top, -top, 0.0)


def test_every_record_of_the_foreign_magnet_starts_demagnetised(tmp_path: Path) -> None:
    path = MAGNETS["u"].write_loops(tmp_path / "u.csv")
    found = inspected(path)
    assert {loop["history"] for loop in found["loops"]} == {"demagnetised"}
    assert not any("the output drifts" in text for text in found["warnings"])


@pytest.mark.first(4)
@pytest.mark.parametrize("noise", [0.0, 3e-4, 1e-3])
@pytest.mark.parametrize("name", ["u", "hard"])
def test_a_virgin_rise_is_recognised(tmp_path: Path, name: str, noise: float) -> None:
    path = write(tmp_path / "virgin.csv", records(name, up_and_down_twice, noise=noise))
    assert histories(path) == {"demagnetised"}


@pytest.mark.parametrize("noise", [3e-3, 1e-2])
def test_a_wide_virgin_rise_is_recognised_in_strong_noise(tmp_path: Path, noise: float) -> None:
    path = write(tmp_path / "virgin.csv", records("hard", up_and_down_twice, noise=noise))
    assert histories(path) == {"demagnetised"}


@pytest.mark.first(3)
@pytest.mark.parametrize("noise", [0.0, 1e-3, 1e-2])
@pytest.mark.parametrize("name", ["u", "hard", "soft"])
@pytest.mark.parametrize("ends", [up_and_down_twice, once, both_signs])
def test_settled_iron_that_starts_at_zero_is_not_read_as_demagnetised(
    tmp_path: Path, name: str, noise: float, ends: Callable[[float], tuple[float, ...]]
) -> None:
    before = run_in_both_ways if ends is both_signs else run_in
    path = write(tmp_path / "settled.csv", records(name, ends, before, noise=noise))
    assert histories(path) == {"settled"}


def test_a_record_that_starts_at_the_other_end_is_settled(tmp_path: Path) -> None:
    path = write(
        tmp_path / "ends.csv",
        records("hard", lambda top: (-top, top, -top), lambda top: (0.0, top, 0.0, -top)),
    )
    assert histories(path) == {"settled"}


def test_a_virgin_rise_is_recognised_inside_a_loop_of_both_signs(tmp_path: Path) -> None:
    path = write(tmp_path / "signs.csv", records("hard", both_signs))
    assert histories(path) == {"demagnetised"}


def test_one_rise_and_one_fall_that_keeps_its_remanence_start_virgin(tmp_path: Path) -> None:
    path = write(tmp_path / "once.csv", records("hard", once))
    assert histories(path) == {"demagnetised"}


def test_soft_iron_with_an_initial_curve_below_noise_is_read_as_settled(tmp_path: Path) -> None:
    path = write(tmp_path / "soft.csv", records("soft", up_and_down_twice, noise=1e-3))
    found = inspected(path)
    assert {loop["history"] for loop in found["loops"]} == {"settled"}
    assert all("noise" in loop["reason"] for loop in found["loops"])


def test_a_file_a_gap_is_judged_like_all_gaps_in_one(tmp_path: Path) -> None:
    loops = records("u", up_and_down_twice)
    folder = tmp_path / "gaps"
    folder.mkdir()
    for gap in {loop[1] for loop in loops}:
        write(folder / f"{gap:g}.csv", [loop for loop in loops if loop[1] == gap])
    assert histories(folder) == {"demagnetised"}


@pytest.mark.parametrize("before", [lambda _: (), run_in])
def test_a_drift_is_seen_and_removed_whatever_the_start(
    tmp_path: Path, before: Callable[[float], tuple[float, ...]]
) -> None:
    drift = 0.02
    clean = records("u", up_and_down_twice, before, noise=3e-4)
    path = write(tmp_path / "drifts.csv", records("u", up_and_down_twice, before, drift=drift))
    found = inspected(path)
    assert {loop["history"] for loop in found["loops"]} == {"settled" if before is run_in else "demagnetised"}
    size = drift * max(float(np.max(force)) for *_, force in clean)
    assert [loop["drift_N"] for loop in found["loops"]] == pytest.approx([size] * 4, rel=0.03)
    assert sum("the output drifts" in text for text in found["warnings"]) == 4
    mended = inspected(path, "--clean", "drift")
    for loop in mended["loops"]:
        assert abs(loop["drift_N"]) < 0.03 * size
        assert abs(loop["closure_N"]) < 6.0 * loop["noise_N"]


@pytest.mark.slow
def test_removing_the_drift_of_a_record_without_any_changes_nothing(tmp_path: Path) -> None:
    path = MAGNETS["u"].write_loops(tmp_path / "u.csv")
    assert inspected(path, "--clean", "drift")["repairs"] == []


def test_a_drift_that_cannot_be_estimated_is_kept_and_reported(tmp_path: Path) -> None:
    path = write(tmp_path / "once.csv", records("hard", once, drift=0.02))
    found = inspected(path, "--clean", "drift", "--history", "demagnetised")
    assert found["repairs"] == []
    assert any("cannot be determined" in text for text in found["notes"])


@pytest.mark.slow
def test_gadolinium_starts_on_its_virgin_curve(measurements: Path) -> None:
    for path in sorted((measurements / "gadolinium_temperature").glob("gd_T*.csv")):
        assert histories(path) == {"demagnetised"}, path


@pytest.mark.first(2)
@pytest.mark.parametrize("example", ["electromagnet", "bearing", "solenoid"])
def test_the_bundled_loops_are_settled_without_their_sidecars(tmp_path: Path, example: str) -> None:
    loops = ROOT / "examples" / example / "loops.csv"
    copy = tmp_path / "loops.csv"
    copy.write_bytes(loops.read_bytes())
    assert {history.partition(":")[0] for history in histories(copy)} == {"settled"}


def test_a_constant_column_reports_loops_apart(tmp_path: Path) -> None:
    lines = ["I_max_A,I_A,F_N,gap_mm"]
    for label, gap, current, force in records("hard", once, run_in):
        rows = zip(current.tolist(), force.tolist(), strict=True)
        lines += [f"{label.split()[0]},{i:.9g},{f:.9g},{1e3 * gap:.6g}" for i, f in rows]
    (tmp_path / "loops.csv").write_text("\n".join(lines) + "\n")
    found = inspected(tmp_path / "loops.csv")
    assert sorted(loop["label"] for loop in found["loops"]) == ["4.8", "4.8", "8", "8"]
    assert found["schedule_values"] == [0.0002, 0.00065]
    assert any("column 'I_max_A' distinguishes the loops" in text for text in found["notes"])


def test_a_column_that_repeats_the_gap_is_not_a_label(tmp_path: Path) -> None:
    path = tmp_path / "loops.csv"
    loops = [loop for loop in records("hard", once, run_in) if loop[0].startswith("8")]
    lines = ["shim,I_A,F_N,gap_m"]
    for _, gap, current, force in loops:
        rows = zip(current.tolist(), force.tolist(), strict=True)
        lines += [f"shim {gap},{i:.9g},{f:.9g},{gap:.6g}" for i, f in rows]
    path.write_text("\n".join(lines) + "\n")
    assert [loop["label"] for loop in inspected(path)["loops"]] == ["1", "1"]


def test_cycles_of_one_record_stay_together(tmp_path: Path) -> None:
    magnet = MAGNETS["hard"]
    current, force = record("hard", magnet.gaps[0], (0.0, 8.0, 0.0, 8.0, 0.0), (0.0, 8.0, 0.0))
    half = current.size // 2
    rows = enumerate(zip(current.tolist(), force.tolist(), strict=True))
    lines = ["cycle,I_A,F_N", *(f"{row // (half + 1)},{i:.9g},{f:.9g}" for row, (i, f) in rows)]
    (tmp_path / "loops.csv").write_text("\n".join(lines) + "\n")
    assert len(inspected(tmp_path / "loops.csv")["loops"]) == 1


def test_a_column_of_lengths_may_be_the_gap_and_is_asked_for(tmp_path: Path) -> None:
    lines = ["shim_mm,I_A,F_N"]
    for label, gap, current, force in records("hard", once, run_in):
        if label.startswith("8"):
            rows = zip(current.tolist(), force.tolist(), strict=True)
            lines += [f"{1e3 * gap:.6g},{i:.9g},{f:.9g}" for i, f in rows]
    (tmp_path / "loops.csv").write_text("\n".join(lines) + "\n")
    complaint = refused("inspect", "loops.csv", cwd=tmp_path)
    assert '--loop "shim_mm"' in complaint
    assert inspected(tmp_path / "loops.csv", *pasted(complaint))["schedule_values"] == [0.0002, 0.00065]


@pytest.mark.parametrize(
    ("name", "labels"),
    [
        ("steel_team32/loops.csv", ["0.5", "1.02", "1.5"]),
        ("steel_core1_dc/loops.csv", ["800", "2000", "8000", "18000"]),
        ("steel_m130_27s/m130_27s_steel_raw_3loops.csv", ["0", "1", "2"]),
        ("ferrite_mnzn/mnzn_ferrite_4loops.csv", ["0", "1", "2", "3"]),
    ],
)
def test_loops_of_real_files_are_reported_apart_by_themselves(
    measurements: Path, name: str, labels: list[str]
) -> None:
    assert [loop["label"] for loop in inspected(measurements / name)["loops"]] == labels


def pasted(complaint: str) -> list[str]:
    """Return the options that a message advises, split as in a shell."""
    advice = complaint[complaint.index("--columns") :]
    return shlex.split(advice)[:2] if '"' in advice or "'" in advice else advice.split()[:2]


@pytest.mark.parametrize(
    ("header", "mapped"),
    [
        ("Strom,F_N,gap_mm", {"I": "Strom"}),
        ("F_N,gap_mm,Strom", {"I": "Strom"}),
        ("I_A,gap_mm,Kraft", {"F": "Kraft"}),
        ("Strom,Kraft,gap_mm", {"I": "Strom", "F": "Kraft"}),
        ("probe,zeit,Strom,Kraft,gap_mm", {"I": "Strom", "F": "Kraft"}),
        ("I_A,F_N,gap", {"gap": "gap"}),
        ('Strom in $ "A";F_N;gap_mm', {"I": 'Strom in $ "A"'}),
    ],
)
def test_the_advised_mapping_works_when_pasted(tmp_path: Path, header: str, mapped: dict[str, str]) -> None:
    sign = ";" if ";" in header else ","
    quoted = header.replace('"', '""')
    columns = quoted.split(sign)
    current, force = record("hard", 2e-4, (0.0, 8.0, 0.0), (0.0, 8.0, 0.0))
    lines = [sign.join(f'"{name}"' for name in columns)]
    for row, (i, f) in enumerate(zip(current.tolist(), force.tolist(), strict=True)):
        values = {"gap_mm": "0.2", "gap": "0.2", "probe": "P7", "zeit": f"{row}"}
        for name in columns:
            drive = name.startswith(("I", "Strom"))
            values.setdefault(name, f"{i if drive else f:.9g}")
        lines.append(sign.join(values[name] for name in columns))
    (tmp_path / "loops.csv").write_text("\n".join(lines) + "\n")
    complaint = refused("inspect", "loops.csv", cwd=tmp_path)
    advice = pasted(complaint)
    pairs = [pair.rpartition("=") for pair in advice[1].split(",")]
    assert {target.partition("_")[0]: name for name, _, target in pairs} == mapped
    found = inspected(tmp_path / "loops.csv", *advice)
    assert found["loops"][0]["input_high_A"] == pytest.approx(8.0, rel=1e-3)
    assert found["loops"][0]["output_high_N"] == pytest.approx(501.0, rel=1e-2)


def test_the_advised_mapping_of_a_drive_works_when_pasted(tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text(model())
    (tmp_path / "drive.csv").write_text("Strom,Spalt\n0,0.4\n1,0.4\n2,0.4\n")
    run = ("predict", "model.toml", "drive.csv", "--out", "force.csv")
    complaint = refused(*run, cwd=tmp_path)
    advice = pasted(complaint)
    assert advice == ["--columns", "Strom=I_A"]
    extra_options = pasted(refused(*run, *advice, cwd=tmp_path))
    assert extra_options == ["--columns", "Strom=I_A,Spalt=gap_mm"]
    assert quick(*run, *extra_options, cwd=tmp_path).returncode == 0


def delayed(values: FloatArray, samples: float) -> FloatArray:
    rows = np.arange(values.size)
    delay: FloatArray = np.interp(rows - samples, rows, values)
    return delay


@pytest.mark.slow
@pytest.mark.parametrize("name", ["u", "hard", "soft"])
def test_no_delay_is_reported_for_undelayed_foreign_magnets(tmp_path: Path, name: str) -> None:
    found = inspected(MAGNETS[name].write_loops(tmp_path / "loops.csv"))
    assert not any(loop["skew_samples"] for loop in found["loops"])
    assert not any("lags" in text for text in found["warnings"])


@pytest.mark.parametrize("delay", [1.0, 2.0, 3.0])
def test_a_delay_is_found_despite_saturation(tmp_path: Path, delay: float) -> None:
    loops = records("u", up_and_down_twice)
    late = [(label, gap, current, delayed(force, delay)) for label, gap, current, force in loops]
    found = inspected(write(tmp_path / "late.csv", late))
    seen = [loop["skew_samples"] for loop in found["loops"] if loop["skew_samples"]]
    assert len(seen) >= 3
    assert seen == pytest.approx([delay] * len(seen), abs=0.35)
    assert sum("lags" in text for text in found["warnings"]) == len(seen)


PREAMBLE = """Device: XY-2000, rev 2
Operator: Max
Sample rate;1000 Hz
Date: 2026-01-01 12:00:00

Temperature_C;23,5
Calibration
0;0,1
1;0,2
Remark; a; b; c; d; e
Channel 1: current

"""


def logged(header: str, *, sign: str = ";", factor: float = 1.0, preamble: str = PREAMBLE) -> str:
    """Return the text of a logger; ``factor`` multiplies the force."""
    current, force = record("hard", 2e-4, (0.0, 8.0, 0.0), (0.0, 8.0, 0.0))
    rows = zip(current.tolist(), force.tolist(), strict=True)
    lines = [f"{i:.9g};{factor * f:.9g};0.2" for i, f in rows]
    return (preamble + header + "\n" + "\n".join(lines) + "\n").replace(";", sign)


@pytest.mark.first(4)
@pytest.mark.parametrize("sign", [";", ",", "\t", " "])
@pytest.mark.parametrize("header", ["I_A;F_N;gap_mm", "I;F;gap\nA;N;mm", "I_A;F_N;gap_mm\n\n"])
def test_the_header_is_found_below_the_lines_of_a_logger(tmp_path: Path, sign: str, header: str) -> None:
    preamble = PREAMBLE.replace(",", ".")
    (tmp_path / "log.csv").write_text(logged(header, sign=sign, preamble=preamble))
    found = inspected(tmp_path / "log.csv")
    (tmp_path / "plain.csv").write_text(logged("I_A;F_N;gap_mm", preamble=""))
    assert found["loops"] == inspected(tmp_path / "plain.csv")["loops"]
    kept = [line.replace(";", sign).strip() for line in preamble.splitlines() if line]
    assert [note.partition(": ")[2].strip() for note in found["notes"][: len(kept)]] == kept


def test_a_column_below_the_lines_of_a_logger_is_mapped_as_advised(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(logged("Strom;Kraft;gap_mm"))
    advice = pasted(refused("inspect", "log.csv", cwd=tmp_path))
    assert advice == ["--columns", "Strom=I_A,Kraft=F_N"]
    assert inspected(tmp_path / "log.csv", *advice)["loops"][0]["input_high_A"] == 8.0


def test_a_fault_below_the_lines_of_a_logger_is_named_by_its_line(tmp_path: Path) -> None:
    lines = logged("I_A;F_N;gap_mm").splitlines()
    lines[40] = "1;NaN;0.2"
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    complaint = refused("inspect", "log.csv", cwd=tmp_path)
    assert says(complaint, "not-finite: log.csv; line 41; F_N")


def test_a_header_after_a_long_preamble_is_found(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(logged("I_A;F_N;gap_mm", preamble="Device: XY\n" * 10_000))
    assert inspected(tmp_path / "log.csv")["loops"][0]["input_high_A"] == 8.0


def test_numbers_below_a_logger_s_lines_without_a_header_are_refused(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(logged("Rate;1000 Hz"))
    complaint = refused("inspect", "log.csv", cwd=tmp_path)
    assert says(complaint, "header-not-named: log.csv; line 13")


def test_a_short_drive_below_more_settings_of_a_logger_is_read(tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text(model())
    settings = "Device: XY\nRate;1000\nGain;2\nRange;3\nFilter;4\n"
    (tmp_path / "drive.csv").write_text(settings + "I_A;gap_mm\n0;0.4\n1;0.4\n2;0.4\n")
    result = quick("predict", "model.toml", "drive.csv", "--out", "force.csv", cwd=tmp_path)
    assert result.returncode == 0, result
    assert (tmp_path / "force.csv").read_text().splitlines()[0].startswith("I_A,gap_mm,F")


def test_negative_current_and_force_together_are_both_to_be_flipped(tmp_path: Path) -> None:
    text = logged("I_A;F_N;gap_mm", preamble="", factor=-1.0)
    (tmp_path / "both.csv").write_text(text.replace("\n", "\n-").removesuffix("-"))
    complaint = refused("inspect", "both.csv", cwd=tmp_path)
    assert says(complaint, "force-negative")


def test_a_negative_current_is_judged_as_a_positive_one(tmp_path: Path) -> None:
    (tmp_path / "plus.csv").write_text(logged("I_A;F_N;gap_mm", preamble=""))
    text = logged("I_A;F_N;gap_mm", preamble="").replace("\n", "\n-").removesuffix("-")
    (tmp_path / "minus.csv").write_text(text)
    plus, minus = (inspected(tmp_path / f"{name}.csv") for name in ("plus", "minus"))
    assert minus["warnings"] == plus["warnings"]
    assert minus["verdict"] == plus["verdict"]


def test_samples_with_equal_times_of_a_coarse_clock_are_kept(tmp_path: Path) -> None:
    lines = logged("I_A;F_N;gap_mm", preamble="").splitlines()
    stamped = [f"{0.01 * (row // 5):.2f};{line}" for row, line in enumerate(lines)]
    (tmp_path / "coarse.csv").write_text("\n".join(["t_s;" + lines[0], *stamped[1:]]) + "\n")
    found = inspected(tmp_path / "coarse.csv")
    assert found["loops"][0]["samples"] == len(lines) - 1
    assert found["repairs"] == []


def test_files_of_mixed_units_join(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    folder.mkdir()
    (folder / "a.csv").write_text(logged("I_A;F_N;gap_mm"))
    other_file = logged("I_mA;F_kN;gap_m", factor=0.5).replace(";0.2\n", ";3e-4\n")
    (folder / "b.csv").write_text(other_file)
    high = [loop["output_high_N"] for loop in inspected(folder)["loops"]]
    assert high[1] == pytest.approx(500.0 * high[0], rel=1e-6)
