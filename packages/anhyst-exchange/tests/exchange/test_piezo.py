"""A piezo stage as an FMU and as an S-function gives the bits of `anhyst simulate`."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import anhyst_exchange
from anhyst.support.numeric import FloatArray
from anhyst_exchange import piezo_part
from anhyst_exchange.exporter import export_fmu, export_sfunction
from anhyst_rigs.rig.piezo import NOISE_SEED
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.piezo import follow_reference, make_reference
from tests.cli.command import quick as run
from tests.exchange.slave import HERE, fmpy, needs_binary, slave
from tests.exchange.test_sfunction import beside, built, complaint, simulated
from tests.once import made_once
from tests.refusals import refused
from tests.repository import ROOT
from tests.study import piezos

RIG = piezos.EXAMPLE / "rig.toml"
TICK = piezos.rig().dt
OUTPUTS = ("error_m", "voltage_V", "position_m")


def made(folder: Path) -> None:
    """Fill a folder with the FMUs of the bundled piezo stage, in both versions."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(piezo_part, "find_inverses", lambda _: piezos.inverses())
        for fmi in ("2.0", "3.0"):
            export_fmu(RIG, folder / f"{fmi[0]}.fmu", fmi=fmi, platforms=[HERE])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of both FMUs."""
    return made_once(tmp_path_factory, "fmu-piezo", made)


def scan() -> tuple[dict[str, FloatArray], Recording]:
    """Return the inputs of an FMU for a simulated run, and this run."""
    target, sensor = make_reference(piezos.rig()), piezos.rig().settings.position_sensor
    noise = sensor.noise_m * np.random.default_rng(NOISE_SEED).standard_normal(target.size)
    inputs = {"reference_m": target, "position_noise_m": noise}
    return inputs, follow_reference(piezos.rig(), target, piezos.inverses()["full"])


def part(begin: int, end: int) -> dict[str, FloatArray]:
    return {name: values[begin:end] for name, values in scan()[0].items()}


def is_like(rows: FloatArray, recording: Recording) -> bool:
    """Return whether outputs equal those of a simulation, with the position of the next tick."""
    error, voltage, position = rows.T
    return (
        np.array_equal(error, recording["error_m"])
        and np.array_equal(voltage, recording["voltage_V"])
        and np.array_equal(position[:-1], recording["position_m"][1:])
    )


@pytest.mark.slow
@needs_binary
@pytest.mark.parametrize("version", ["2", "3"])
def test_it_scans_as_the_simulation_does_bit_for_bit(version: str, folder: Path, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    path = folder / f"{version}.fmu"
    assert validate_fmu(str(path)) == []
    inputs, recording = scan()
    with slave(path, tmp_path) as one:
        assert is_like(np.array(one.run(inputs, OUTPUTS, TICK)), recording)
    about = {one.name: one for one in fmpy.read_model_description(path).modelVariables}
    assert [about[name].unit for name in ("load_m", "voltage_V", "velocity_m_per_s")] == ["m", "V", "m/s"]


@pytest.mark.slow
@needs_binary
@pytest.mark.parametrize("version", ["2", "3"])
def test_a_state_in_motion_is_transferred_to_another_instance(
    version: str, folder: Path, tmp_path: Path
) -> None:
    path, rest = folder / f"{version}.fmu", part(1234, 2600)
    with slave(path, tmp_path) as one, slave(path, tmp_path) as other:
        one.run(part(0, 1234), OUTPUTS, TICK)
        state = one.save()
        there = one.run(rest, OUTPUTS, TICK, 1234 * TICK)
        other.restore(other.from_bytes(one.to_bytes(state)))
        one.raw.reset()  # the other instance is independent
        assert other.run(rest, OUTPUTS, TICK, 1234 * TICK) == there
        one.restore(state)
        assert one.run(rest, OUTPUTS, TICK, 1234 * TICK) == there


GOES_ON = """
import sys
from pathlib import Path
from tests.exchange.slave import slave
fmu, folder, kept = map(Path, sys.argv[1:])
with slave(fmu, folder) as made:
    made.restore(made.from_bytes(kept.read_bytes()))
    made.raw.doStep(0.04, 0.02)
    print(made.read("position_m", "voltage_V"))
"""


@pytest.mark.slow
@needs_binary
def test_a_state_continues_in_another_process(folder: Path, tmp_path: Path) -> None:
    path = folder / "2.fmu"
    with slave(path, tmp_path / "one") as one:
        one.run(part(0, 400), OUTPUTS, TICK)
        (tmp_path / "kept").write_bytes(bytes(one.to_bytes(one.save())))
        one.raw.doStep(0.04, 0.02)
        here = one.read("position_m", "voltage_V")
    given = [sys.executable, "-c", GOES_ON, path, tmp_path / "two", tmp_path / "kept"]
    completed = subprocess.run(
        list(map(str, given)), cwd=ROOT, capture_output=True, text=True, check=False, timeout=120
    )
    assert completed.returncode == 0, completed.stderr
    assert completed.stdout.strip() == str(here)


@pytest.mark.slow
@needs_binary
def test_the_stage_rests_yields_to_a_load_and_refuses_impossible_inputs(folder: Path, tmp_path: Path) -> None:
    with slave(folder / "2.fmu", tmp_path) as one:
        one.raw.doStep(0.0, 2.0)  # without inputs, it moves to the low end
        assert one.read("position_m") == pytest.approx([4e-6], abs=2e-9)
        one.run({"load_m": 10 * [1e-6]}, OUTPUTS, TICK, 2.0)
        assert one.read("position_m")[0] > 4.3e-6
        one.raw.doStep(2.0 + 10 * TICK, 1.0)
        assert one.read("position_m") == pytest.approx([4e-6], abs=5e-9)
        before = one.read(*OUTPUTS, "creep_m", "hysteresis_m")
        beyond: Mapping[str, float]
        for beyond in ({"reference_m": 1e300}, {"load_m": -2.0}, {"position_noise_m": 1e300}):
            usual = one.read(*beyond)
            with pytest.raises(fmpy.fmi1.FMICallException):
                one.run({name: [value] for name, value in beyond.items()}, OUTPUTS, TICK, 4.0)
            assert one.read(*OUTPUTS, "creep_m", "hysteresis_m") == before
            one.write(dict(zip(beyond, usual, strict=True)))
        with pytest.raises(fmpy.fmi1.FMICallException):
            one.write({"load_m": float("nan")})
        one.run({"load_m": [0.0]}, OUTPUTS, TICK, 3.5)


@pytest.mark.slow
@needs_binary
def test_the_s_function_agrees_one_sample_later(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(piezo_part, "find_inverses", lambda _: piezos.inverses())
    program = built(export_sfunction(RIG, tmp_path / "s"))
    inputs = part(0, 500)
    given = beside(inputs["reference_m"], 1e-7 + 0.0 * inputs["reference_m"], inputs["position_noise_m"])
    head, rows = simulated(program, given)
    assert float(head.split()[2]) == TICK
    names = [one.name for one in fmpy.read_model_description(folder / "2.fmu").modelVariables]
    with slave(folder / "2.fmu", tmp_path / "u") as one:
        there = one.run(dict(zip(names[:3], given.T, strict=True)), names[3:], TICK)
    assert np.array_equal(rows[1:], np.array(there)[:-1])
    assert "at most 1 m" in complaint(program, "2.0 0.0 0.0\n0.0 0.0 0.0\n")


def test_its_sources_are_written_and_options_of_a_model_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(piezo_part, "find_inverses", lambda _: piezos.inverses())
    with refused("option-not-for-this --rate"):
        export_fmu(RIG, tmp_path / "p.fmu", rate=1e4)
    assert not list(tmp_path.iterdir())
    anhyst_exchange.export(RIG, tmp_path / "p", as_="simulink")
    script = (tmp_path / "p" / "build_sfun_piezo.m").read_text()
    assert "input 1: reference_m (m)" in script
    assert "output 7: stack_voltage_V (V)" in script
    assert (tmp_path / "p" / "src" / "plant" / "piezo.c").is_file()


@pytest.mark.slow
def test_the_command_writes_them_too_the_same_each_time(tmp_path: Path) -> None:
    for name in ("one", "two"):
        given = ("export", RIG, "--as", "simulink", "--out", tmp_path / name)
        result = run(*given, cwd=tmp_path)
        assert (result.returncode, result.stderr) == (0, "")
    texts = [(tmp_path / name / "src" / "piezo_numbers.h").read_text() for name in ("one", "two")]
    assert texts[0] == texts[1]
    assert "PIEZO_WORDS" in texts[0]
