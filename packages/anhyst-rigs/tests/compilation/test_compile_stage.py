"""Compare the compiled controller of a stage with the simulated flight, without f64."""

from __future__ import annotations

import math
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

import anhyst
from anhyst.cli.app import main
from anhyst.compilation.compiled_stage import CompiledStage
from anhyst.support.kinds import MethodName, NumberFormat
from anhyst_rigs.rig.drift import Drift
from anhyst_rigs.rig.stage.fitted import fit_method_compensator, make_stage
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, make_axes_controller, track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.tracking.compiled import MAX_FLIGHT_ROWS, ROWS_PER_COMMAND, compiled_rig, write_stage
from tests.compilation.packaged import undrawn  # noqa: F401 - a fixture
from tests.compilation.test_controller import WARNINGS, played
from tests.core.test_c_core import tool
from tests.refusals import refused
from tests.repository import ROOT
from tests.study import bearings, stages
from tests.study.test_axes import planar
from tests.study.test_solid_stage import solid, solid_magnet

FLOWN = MAX_FLIGHT_ROWS - 3 * ROWS_PER_COMMAND
"""Ticks before the commands at the end."""
EXAMPLES = ROOT / "examples"


FORMATS: list[tuple[NumberFormat, NumberFormat]] = [("f32", "f32"), ("fixed", "f32"), ("fixed", "fixed")]
"""Number formats of the magnets, and of pose, PIDs and allocation."""


@cache
def single(
    has_six: bool, method: MethodName, number_format: NumberFormat = "f32", law: NumberFormat = "f32"
) -> StageSetup:
    """Return an example in single precision or fixed point with already identified magnets."""
    rig = planar() if has_six else stages.stage()
    rig = replace(rig, settings=rig.settings.with_changes({"control.format": number_format}))
    return replace(make_stage(rig, bearings.knowledge(), method), number_format=law)


def replays(folder: Path, rows: int = MAX_FLIGHT_ROWS) -> None:
    """Check that the example, compiled with the core's strict options, repeats its vectors."""
    sources = sorted(str(file) for file in folder.rglob("*.c"))
    options = [*WARNINGS.split(), "-ffp-contract=off", f"-I{folder / 'include'}"]
    program = folder.parent / "example"
    command = [tool("gcc"), *options, *sources, "-lm", "-o", str(program)]
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr
    vectors = (folder / "vectors.csv").read_text()
    assert played(str(program), vectors) == f"{rows} rows, 0 differ\n"
    command = [tool("nm"), str(program)]
    names = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "_f64" not in names
    assert ("anhyst_axes_tick_q31" in names) != ("_f32" in names)


def flown(setup: StageSetup, number: int) -> np.ndarray:
    """Return the currents of a magnet in the simulated flight, A."""
    scan = setup.rig.settings.scan
    run = track(setup, scan_motion(scan, scan.test_m_per_s2), Feedforward())
    return run["command_A" if number == 1 else f"command_{number}_A"][:FLOWN]


def currents(compiled: CompiledStage, number: int) -> np.ndarray:
    """Return the currents of a magnet from the compiled controller, A."""
    found = compiled.vectors[f"current_{number}"][:FLOWN]
    if compiled.manifest["io"] == "f32":
        return found
    return found / 2.0**31 * float(compiled.manifest["stage"]["full_scale"]["current"])


def folder_of(setup: StageSetup, tmp_path: Path) -> CompiledStage:
    return write_stage(setup, setup.method, tmp_path / "out", "stage")


@pytest.mark.parametrize(("number_format", "law"), FORMATS)
def test_the_compiled_stage_replays_the_simulation_bit_for_bit(
    number_format: NumberFormat, law: NumberFormat, tmp_path: Path
) -> None:
    setup = single(True, "full", number_format, law)
    compiled = folder_of(setup, tmp_path)
    replays(compiled.out)
    assert compiled.vectors["state"][[FLOWN - 1, -60, -40, -20]].tolist() == [0, 2, 3, 1]
    for number in (1, 2, 5, 10):
        assert np.array_equal(currents(compiled, number), flown(setup, number))


@pytest.mark.parametrize(("number_format", "law"), FORMATS)
def test_a_lost_magnet_is_compiled_to_the_bit(
    number_format: NumberFormat, law: NumberFormat, tmp_path: Path
) -> None:
    setup = single(True, "full", number_format, law)
    watched = setup.rig.settings.with_changes({"control.lost_A": 0.25})
    compiled = folder_of(replace(setup, rig=replace(setup.rig, settings=watched)), tmp_path)
    replays(compiled.out)
    lost, state = compiled.vectors["lost"], compiled.vectors["state"]
    found = int(np.argmax(lost > 0))
    assert MAX_FLIGHT_ROWS - 200 < found < MAX_FLIGHT_ROWS - 190
    assert not lost[:found].any()
    assert (lost[found:].astype(int) & 1).all()
    assert (state[found:-60] == 1).all()
    assert state[-60:].tolist() == [2] * 60
    assert compiled.vectors["flags"][[-60, -40, -20]].astype(int).tolist() == [0, 16, 16]
    assert not compiled.vectors["current_1"][found:].any()


@pytest.mark.parametrize("law", ["f32", "fixed"])
def test_two_magnets_on_one_coordinate_are_compiled_to_the_bit(law: NumberFormat, tmp_path: Path) -> None:
    setup = single(False, "full", law, law)
    compiled = folder_of(setup, tmp_path)
    replays(compiled.out)
    for number in (1, 2):
        assert np.array_equal(currents(compiled, number), flown(setup, number))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "number_format"),
    [("play", "f32"), ("single-valued", "f32"), ("simplified", "f32"), ("play", "fixed")],
)
def test_every_method_replays_its_golden_vectors(
    method: MethodName, number_format: NumberFormat, tmp_path: Path
) -> None:
    setup = single(True, method, number_format)
    compiled = folder_of(setup, tmp_path)
    replays(compiled.out)
    assert np.array_equal(compiled.vectors["current_1"][:FLOWN], flown(setup, 1))


@pytest.mark.slow
@pytest.mark.parametrize("number_format", ["f32", "fixed"])
def test_calibrated_values_of_each_magnet_are_compiled(number_format: NumberFormat, tmp_path: Path) -> None:
    setup = single(True, "full", number_format)
    other = fit_method_compensator(setup.rig, bearings.knowledge(), "full", 0.05)
    rows = np.tile([1.0, 0.0, 1.0, 0.0], (10, 1))
    rows[1], rows[8] = [1.01, 1e-6, 1.0, 0.0], [0.99, -2e-6, 1.0, 0.0]
    own = tuple(other if number == 3 else setup.compensator for number in range(10))
    drift = Drift(pinning=0.0)
    corrected = replace(
        setup, correction_rows=rows, own_compensators=own, drift=drift, body_corrections={"payload": 0.01}
    )
    compiled = folder_of(corrected, tmp_path)
    replays(compiled.out)
    assert (compiled.out / "stage_2_parameters.c").is_file()
    for number in (2, 4, 9):
        assert np.array_equal(compiled.vectors[f"current_{number}"][:FLOWN], flown(corrected, number))
    assert not np.array_equal(compiled.vectors["current_2"][:FLOWN], flown(setup, 2))


@pytest.mark.slow
def test_layers_of_solid_iron_are_compiled_in_fixed_point_too(tmp_path: Path) -> None:
    made = make_stage(solid(**{"control.format": "fixed"}), solid_magnet(), "full")
    replays(folder_of(replace(made, number_format="f32"), tmp_path).out)


def test_the_rig_file_sets_the_number_format() -> None:
    compiled = {}
    for said in ("f64", "f32", "fixed"):
        rig = planar()
        rig = replace(rig, settings=rig.settings.with_changes({"control.format": said}))
        compiled[said] = compiled_rig(rig).settings.tracking.format
    assert compiled == {"f64": "f32", "f32": "f32", "fixed": "fixed"}


@pytest.mark.slow
def test_fixed_point_is_within_two_nanometres_of_double_precision() -> None:
    scan = planar().settings.scan
    motion = scan_motion(scan, scan.test_m_per_s2)
    wide = replace(single(True, "full", "f64"), number_format="f64")
    expected = track(wide, motion, Feedforward())
    for law in ("f32", "fixed"):
        run = track(single(True, "full", "fixed", law), motion, Feedforward())
        for name, largest in (("error_m", 2e-9), ("error_z_m", 2e-9), ("error_rz_rad", 1e-8)):
            assert 0.0 < np.abs(expected[name] - run[name]).max() < largest


def test_feedforward_carries_the_body_and_accelerates_it(tmp_path: Path) -> None:
    compiled = folder_of(single(True, "single-valued"), tmp_path)
    stage = compiled.manifest["stage"]
    assert np.allclose(compiled.vectors["forward_z"], -stage["weight"][2])
    assert stage["mass"][0][0] == pytest.approx(20.0)
    largest = np.abs(compiled.vectors["forward_x"]).max()
    assert largest == pytest.approx(20.0 * 22.0, rel=0.01)


def test_a_short_simulation_is_compiled_completely(tmp_path: Path) -> None:
    setup = single(True, "single-valued")
    slow = setup.rig.settings.with_changes({"timing.rate_Hz": 2e3, "control.crossover_Hz": 60.0})
    known = bearings.knowledge()
    made = make_stage(replace(setup.rig, settings=slow), known, "single-valued")
    compiled = folder_of(replace(made, number_format="f32"), tmp_path)
    rows = len(compiled.vectors["flags"])
    assert 500 < rows < 1000
    replays(compiled.out, rows)
    assert f"`vectors.csv`, {rows} ticks" in (compiled.out / "DROP_IN.md").read_text()


@pytest.mark.parametrize("number_format", ["f32", "fixed"])
@pytest.mark.parametrize("law", ["f32", "f64"])
def test_readings_that_cannot_be_are_flagged_and_move_no_integral(
    law: Literal["f32", "f64"], number_format: NumberFormat
) -> None:
    setup = replace(single(True, "single-valued", number_format), number_format=law)
    controller, gaps = make_axes_controller(setup), [0.45e-3] * 10
    forward, true = [0.0, 0.0, 20.0 * 9.81, 0.0, 0.0, 0.0], [2e-7] * 6
    other = make_axes_controller(setup)
    none = [math.nan] * 10
    *held, _, _, _ = controller.tick(true, forward, gaps, none)
    other.tick(true, forward, gaps, none)
    for reading in (math.nan, math.inf, -math.inf, 0.5e-3, -0.3e-3, 1e30):
        for _ in range(3):
            *wrong, flags, _, _ = controller.tick([reading] + [1e-7] * 5, forward, gaps, none)
            assert flags == 8
            assert wrong == held
    assert controller.tick(true, forward, gaps, none) == other.tick(true, forward, gaps, none)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"io": "q15"}, "option-not-for-this --io"),
        ({"rate": 10e3}, "option-differs timing.rate_Hz"),
        ({"accuracy": 0.1}, "option-not-for-this --accuracy"),
        ({"controller": "controller.toml"}, "option-not-for-this --controller"),
        ({"name": "Upper"}, "bad-name --name"),
    ],
)
def test_options_that_do_not_fit_a_stage_are_refused(
    options: dict[str, object], code: str, tmp_path: Path
) -> None:
    with refused(code):
        anhyst.compile(EXAMPLES / "planar" / "rig.toml", tmp_path / "out", **options)  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()


def changed_planar(old: str, new: str, folder: Path) -> Path:
    text = (EXAMPLES / "planar" / "rig.toml").read_text()
    assert old in text
    (folder / "rig.toml").write_text(text.replace(old, new))
    for name in ("loops.csv", "loops.toml"):
        (folder / name).write_bytes((EXAMPLES / "planar" / name).read_bytes())
    return folder / "rig.toml"


def test_a_stage_that_learns_as_it_runs_is_refused(tmp_path: Path) -> None:
    path = changed_planar("bias_N = 5.0  ", "calibrate = true\nbias_N = 5.0  ", tmp_path)
    with refused("not-compilable control.calibrate"):
        anhyst.compile(path, tmp_path / "out")


def test_heads_on_the_ground_are_not_compiled(tmp_path: Path) -> None:
    path = changed_planar('of = "position"', 'of = "position"\nstands = true', tmp_path)
    with refused("not-compilable sensor.stands"):
        anhyst.compile(path, tmp_path / "out")


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ('format = "f32"  ', "option-not-for-this --io"),
        ('format = "fixed"\ncalibration = "found.toml"  ', "not-compilable control.calibration"),
    ],
)
def test_features_missing_in_fixed_point_are_refused(wrong: str, code: str, tmp_path: Path) -> None:
    path = changed_planar('format = "fixed"  ', wrong, tmp_path)
    with refused(code):
        anhyst.compile(path, tmp_path / "out", io="q31")


def test_a_missing_file_is_reported_before_a_missing_rate(tmp_path: Path) -> None:
    with refused("no-such-file: absent.toml"):
        anhyst.compile("absent.toml", tmp_path / "out")


def test_a_model_has_no_curve_without_memory(tmp_path: Path) -> None:
    assert main(["compile", "model.toml", "--kind", "single-valued", "--out", str(tmp_path)]) == 2
    with refused("option-not-for-this --kind"):
        anhyst.compile("model.toml", tmp_path / "out", rate=1e4, kind="single-valued")
