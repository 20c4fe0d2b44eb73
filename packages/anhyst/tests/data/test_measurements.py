"""Real measurements of other authors are read without changes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anhyst.data import read_columns
from anhyst.data.clean import clean
from anhyst.data.inspection import inspect
from anhyst.data.reading import read_loops


@pytest.mark.parametrize(
    ("name", "count", "samples"),
    [
        ("ferrite_mnzn/mnzn_hp_ferrite_4loops.csv", 4, 129),
        ("ferrite_mnzn/mnzn_ferrite_4loops.csv", 4, 129),
        ("ferrite_mnzn/mnzn_ferrite_3loops.csv", 3, 129),
        ("steel_m130_27s/m130_27s_steel_raw_3loops.csv", 3, 256),
        ("steel_m130_27s/m130_27s_steel_symmetrised_3loops.csv", 3, 256),
    ],
)
def test_hysteresisgraph_files_need_no_mapping(
    measurements: Path, name: str, count: int, samples: int
) -> None:
    loops = read_loops(measurements / name)
    assert [loop.n for loop in loops.loops] == [samples] * count
    assert {str(loop.history) for loop in loops.loops} == {"settled"}
    found = inspect(loops)
    assert found.verdict.worthwhile


def test_steel_core_loops_start_at_zero_flux_but_are_settled(measurements: Path) -> None:
    loops = read_loops(measurements / "steel_core1_dc/loops.csv", loop="nominal_Hmax_A_per_m")
    assert [loop.label for loop in loops.loops] == ["800", "2000", "8000", "18000"]
    assert {str(loop.history) for loop in loops.loops} == {"settled"}
    assert [loop.output[0] for loop in loops.loops] == [0.0] * 4


def test_team32_loops_are_reported_apart_by_their_peak(measurements: Path) -> None:
    loops = read_loops(measurements / "steel_team32/loops.csv", columns={"bmax_T": "loop"})
    assert [loop.label for loop in loops.loops] == ["0.5", "1.02", "1.5"]
    peaks = [float(np.max(loop.output)) for loop in loops.loops]
    assert peaks == pytest.approx([0.5, 1.02, 1.5], rel=0.02)


def test_core_gaps_are_a_family_over_the_gap(measurements: Path) -> None:
    loops = read_loops(
        measurements / "ferrite_core_gaps/loops_by_gap.csv", columns={"I_A_scaled": "I_A", "U_M_V": "psi_Wb"}
    )
    assert loops.schedule_values == (0.0, 0.000125, 0.0005)
    assert [loop.n for loop in loops.loops] == [158, 157, 261]
    found = inspect(loops)
    shut, narrow, wide = found.loops
    assert shut.saturation is not None
    assert narrow.saturation is not None
    assert wide.saturation is not None
    assert shut.saturation < narrow.saturation < wide.saturation
    assert shut.width > narrow.width > wide.width


def test_the_temperature_of_gadolinium_comes_from_the_file_name(measurements: Path) -> None:
    files = sorted((measurements / "gadolinium_temperature").glob("gd_T*.csv"))
    loops = read_loops(files, file_name="gd_T{T_C}C")
    assert loops.schedule_values == (-38.0, -25.0, -15.0, -5.0, 5.0, 15.0)
    assert len(loops) == 18
    major = [loop for loop in loops.loops if loop.label == "major"]
    assert {str(loop.history) for loop in major} == {"demagnetised"}
    saturation = [float(loop.output.max()) for loop in sorted(major, key=lambda lo: lo.schedule_value or 0)]
    assert saturation == sorted(saturation, reverse=True)
    cleaned = clean(loops, ["dedupe", "spikes", "thin"])
    assert all(loop.n <= 4000 for loop in cleaned.loops)
    assert any(repair.startswith("spikes") for repair in cleaned.repairs)


def test_piezo_stack_is_read_and_its_lag_is_seen(measurements: Path) -> None:
    loops = read_loops(measurements / "piezo_flexure/model_run.csv", columns={"V_in": "u_V", "y_um": "x_um"})
    assert (loops.input.name, loops.output.name) == ("voltage", "displacement")
    assert loops.loops[0].n == 8027
    found = inspect(loops)
    assert found.loops[0].step == pytest.approx(0.005)
    assert found.loops[0].cycles == pytest.approx(40.0, abs=1.0)
    # The lag of the stack and its creep cannot be separated: a lag of zero would be wrong.
    assert found.loops[0].skew is None or found.loops[0].skew > 0.5


def test_sidecar_describes_a_folder_of_files(measurements: Path, tmp_path: Path) -> None:
    sidecar = tmp_path / "gaps.toml"
    sidecar.write_text(
        'history = "settled"\n[columns]\nI_A_scaled = "I_A"\nU_M_V = "psi_Wb"\n'
        "[select]\ngap_mm = [0.125, 0.5]\n"
    )
    loops = read_loops(measurements / "ferrite_core_gaps", sidecar=sidecar)
    assert loops.schedule_values == (0.000125, 0.0005)


def test_closed_loop_log_is_read_whole(measurements: Path) -> None:
    table = read_columns(measurements / "maglev_ball/closedloop_step_PID_anti_windup-KF.csv")
    assert len(table) == 2001
    assert table.require("time", "t_s")[-1] == 10.0
