"""S-functions, built with the interface of Simulink and stepped by a fixed-step solver."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import anhyst
from anhyst.support.numeric import FloatArray
from anhyst_exchange import stage_part
from anhyst_exchange.exporter import REPRODUCIBLE_OPTIONS, export_fmu, export_sfunction
from tests.cli.command import quick as run
from tests.core.test_c_core import run_command, tool
from tests.exchange.slave import HERE, RATE, fmpy, needs_binary, slave
from tests.exchange.test_actuator import STEP, drives, gaps, magnet
from tests.exchange.test_bearing import planar_made, stage_made
from tests.exchange.test_fmu import GAP, demands, expected
from tests.once import made_once
from tests.refusals import refused
from tests.study import bearings, stages

INTERFACE = Path(__file__).with_name("simulink")
"""The used part of Simulink's interface, and a fixed-step solver."""


def built(folder: Path) -> Path:
    """Compile the sources as the MATLAB script does."""
    (script,) = folder.glob("build_sfun_*.m")
    text = script.read_text()
    files = re.findall(r"^    '(\S+\.c)'$", text, re.MULTILINE)
    assert sorted(files) == sorted(
        path.relative_to(folder / "src").as_posix() for path in folder.rglob("*.c")
    )
    name: str = re.findall(r"-DS_FUNCTION_NAME=(\w+)", text)[0]
    assert script.stem == f"build_{name}"
    program = folder / name
    warnings = ("-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror")
    stops = ("-fsanitize=float-cast-overflow", "-fsanitize-undefined-trap-on-error")
    run_command(
        *(tool("cc", "gcc", "clang"), "-std=c99", "-O2", *REPRODUCIBLE_OPTIONS, *warnings, *stops),
        *("-DMATLAB_MEX_FILE", f"-DS_FUNCTION_NAME={name}", "-o", str(program)),
        *(f"-I{place}" for place in (INTERFACE, folder / "src", folder / "src" / "include")),
        *(str(folder / "src" / file) for file in files),
        "-lm",
    )
    return program


def simulated(program: Path, rows: FloatArray, *parameters: float) -> tuple[str, FloatArray]:
    """Return the first line and the rows of the outputs."""
    message = subprocess.run(
        [program, *map(repr, parameters)],
        input="\n".join(" ".join(map(repr, row)) for row in rows.tolist()),
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    return message[0], np.array([[float(one) for one in line.split()] for line in message[1:]])


def complaint(program: Path, text: str, *parameters: str) -> str:
    completed = subprocess.run(
        [program, *parameters], input=text, capture_output=True, text=True, check=False
    )
    assert completed.returncode == 2
    return completed.stdout.splitlines()[-1]


def beside(*columns: Sequence[float] | FloatArray) -> FloatArray:
    return np.stack([np.asarray(column, dtype=np.float64) for column in columns], axis=1)


@pytest.fixture(scope="module")
def model() -> anhyst.Model:
    return magnet("effective-field", "reluctance")


@pytest.mark.slow
def test_a_compensator_gives_the_currents_of_the_controller_one_sample_later(
    identified: anhyst.Model, tmp_path: Path
) -> None:
    program = built(export_sfunction(identified, tmp_path / "s", rate=RATE))
    demand = demands(400)
    head, found = simulated(program, beside(demand, np.full(demand.size, GAP)))
    assert head.split()[:2] == ["2", "1"]
    assert float(head.split()[2]) == 1.0 / RATE
    assert found[0, 0] == 0.0
    assert found[1:, 0].tolist() == expected(identified, demand)[:-1]
    assert found.max() > 0.3


@pytest.mark.slow
def test_an_actuator_gives_the_force_of_its_model(model: anhyst.Model, tmp_path: Path) -> None:
    program = built(export_sfunction(model, tmp_path / "s", of="actuator"))
    drive = drives(model)
    gap = gaps(model, drive.size)
    _, found = simulated(program, beside(drive, gap), STEP)
    stepper = model.stepper(0.0, history="demagnetised")
    expected = [stepper.commit(one, at, dt=STEP) for one, at in beside(drive, gap).tolist()]
    assert np.abs(found[1:, 0] - expected[:-1]).max() <= 1e-12 * max(expected)


@pytest.mark.slow
@needs_binary
@pytest.mark.parametrize("kind", ["bearing", "stage", "planar"])
def test_a_rig_agrees_with_its_fmu(
    kind: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    away = np.linspace(0.0, 1e-6, 400)
    inputs = {"load_N": 1e6 * away, "reference_m": away, "frame_m": away - 0.45e-3}
    if kind == "bearing":
        rig = bearings.copy_known(tmp_path)
        inputs = {"target_m": 0.45e-3 + 0.0 * away, "load_N": 120.0 + away, "command": 1.0 + 0.0 * away}
        path = export_fmu(rig, tmp_path / "b.fmu", platforms=[HERE])
    elif kind == "stage":
        rig = stages.EXAMPLE / "rig.toml"
        inputs |= {"feedforward_N": 2e7 * away, "position_noise_m": 1e-3 * away}
        path = made_once(tmp_path_factory, "fmu-stage", stage_made) / "2.fmu"
    else:
        path = made_once(tmp_path_factory, "fmu-planar", planar_made) / "2.fmu"
        rig = path.with_name("rig.toml")
        inputs |= {"feedforward_z_N": 196.0 + 0.0 * away, "reference_ry_rad": away}
    monkeypatch.setattr(stage_part, "identify_stage_magnet", lambda _: bearings.knowledge())
    program = built(export_sfunction(rig, tmp_path / "s"))
    about = fmpy.read_model_description(path).modelVariables
    shown, ports = (
        [one.name for one in about if one.causality == causality] for causality in ("output", "input")
    )
    given = {name: np.asarray(inputs.get(name, 0.0 * away), dtype=float) for name in ports}
    head, found = simulated(program, beside(*given.values()))
    with slave(path, tmp_path / "u") as made:
        rows = np.array(made.run(given, shown, float(head.split()[2])))
    assert head.split()[:2] == [str(len(ports)), str(len(shown))]
    assert np.array_equal(found[1:], rows[:-1])
    if "command" in ports:
        given["command"][-1] = 1e300
        text = "\n".join(" ".join(map(repr, row)) for row in beside(*given.values()).tolist())
        assert "a command is a number from 0 to" in complaint(program, text)


@pytest.mark.slow
def test_wrong_inputs_of_a_block_are_reported(model: anhyst.Model, tmp_path: Path) -> None:
    program = built(export_sfunction(model, tmp_path / "s", of="actuator"))
    assert "not a finite number" in complaint(program, "nan 4e-4\n", "1e-4")
    assert "sample time" in complaint(program, "", "0")
    assert "number of parameters" in complaint(program, "")


@pytest.mark.slow
def test_the_command_writes_a_folder_and_no_folder_of_others_is_lost(
    model: anhyst.Model, tmp_path: Path
) -> None:
    model.save(tmp_path / "model.toml")
    command = ("export", "model.toml", "--as", "simulink", "--rate", "20000", "--out", "s")
    export_sfunction(model, tmp_path / "s", of="actuator")  # an earlier export is overwritten
    assert run(*command, cwd=tmp_path).returncode == 0
    assert (tmp_path / "s" / "build_sfun_magnet.m").is_file()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("x")
    with refused("folder-holds-other-files"):
        export_sfunction(model, tmp_path / "mine", rate=RATE)
    assert (tmp_path / "mine" / "thesis.tex").is_file()
