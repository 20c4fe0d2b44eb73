"""A rig for force control as an FMU gives the results of the simulated firmware."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anhyst.cli.app import main
from anhyst_exchange import force_part
from anhyst_exchange.exporter import export_fmu, export_sfunction
from anhyst_exchange.part import FmiVersion
from anhyst_rigs.rig.bench.force import run_firmware
from anhyst_rigs.rig.case_table import ForceCase, MovingCase
from anhyst_rigs.rig.force.bench import BENCH_COLUMNS, ActuatorStand, moving_gap, triangle_demand
from anhyst_rigs.rig.force.file import SENSOR_ORDER, ForceControlRig, read_rig
from anhyst_rigs.rig.force.programs import count_differing_ticks
from anhyst_rigs.study.force_control import build_program
from tests.exchange.slave import HERE, fmpy, needs_binary, slave
from tests.exchange.test_checker import findings
from tests.exchange.test_sfunction import beside, built, simulated
from tests.refusals import says
from tests.rig.forces import EXAMPLE
from tests.rig.test_biased_magnet import BIASED_RIG
from tests.study.test_solid_force import rig_in
from tests.truths import truth

SHAPE = ForceCase(kind="force", name="wide", low=0.05, high=0.95, period_s=0.4, cycles=2)
SEED = [2, 0]


def copied(folder: Path) -> ForceControlRig:
    """Copy the bundled solenoid; return its rig."""
    for name in ("rig.toml", "solenoid.toml", "loops.csv", "loops.toml"):
        (folder / name).write_bytes((EXAMPLE / name).read_bytes())
    return read_rig(folder / "rig.toml")


@needs_binary
@pytest.mark.slow
@pytest.mark.parametrize("moves", [True, False])
def test_it_drives_and_pulls_as_the_firmware_at_the_virtual_bench_bit_for_bit(
    moves: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For a rig with loops at several gaps, and for a compensator of a single gap."""
    rig, model = copied(tmp_path), truth("solenoid-three-gaps" if moves else "solenoid-end")
    monkeypatch.setattr(force_part, "identify_force_model", lambda *_: model)
    rate = rig.settings.timing.rate_Hz
    program = build_program("full", model, rate, "library", tmp_path / "program")
    demand = triangle_demand(SHAPE, rig.settings.force.force_max_N, rate)
    gap = np.full(demand.force.size, rig.settings.force.end_m)
    if moves:
        motion = MovingCase(kind="moving", low_m=1.0e-3, high_m=2.4e-3, period_s=0.3)
        gap = moving_gap(motion, gap.size, rate)
    recording, session = run_firmware(
        rig, program, ActuatorStand(rig, SEED), gap, demand, "library", is_demagnetised=True
    )
    assert count_differing_ticks(program, session) == 0
    sensors, ticks = rig.make_sensors(SEED), session.first_run_tick + gap.size
    noise = np.column_stack([sensors[name].noise(ticks) for name in SENSOR_ORDER])
    columns = (demand.force, gap, *noise[session.first_run_tick :].T)
    names = ("demand_N", "gap_m", "gap_noise_m", "force_noise_N", "current_noise_A")
    export_fmu(tmp_path / "rig.toml", tmp_path / "valve.fmu", platforms=[HERE])
    shown = [name for name in BENCH_COLUMNS if name not in {"t_s", "gap_m"}]
    with slave(tmp_path / "valve.fmu", tmp_path / "unpacked") as made:
        inputs = dict(zip(names, columns, strict=True))
        found = np.array(made.run(inputs, shown, rig.dt)).T
        for name, values in zip(shown, found, strict=True):
            assert np.array_equal(values, recording[name]), name
        made.raw.reset()
        made.begin()
        again = np.array(made.run({key: one[:50] for key, one in inputs.items()}, shown, rig.dt)).T
        assert np.array_equal(again, found[:, :50])
        for beyond in (1e300, 1e-300, 0.0):  # the iron could not recover from these values
            with pytest.raises(fmpy.fmi1.FMICallException):
                made.run({"gap_m": [beyond]}, shown, rig.dt, 50 * rig.dt)
            assert np.array_equal(made.read(*shown), again[:, -1])
    block = simulated(built(export_sfunction(rig.path, tmp_path / "block")), beside(*columns))[1]
    assert np.array_equal(block[1:], found.T[:-1])
    error = recording["force_N"] - demand.force
    assert np.abs(error[demand.lead_in :]).max() < 0.15 * rig.settings.force.force_max_N
    assert np.ptp(recording["force_N"]) > 30.0


@needs_binary
@pytest.mark.slow
def test_a_permanent_magnet_pulls_as_in_the_plant_bit_for_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The compensator is that of another magnet; its currents are converted by the biased one."""
    (tmp_path / "rig.toml").write_bytes(BIASED_RIG.read_bytes())
    rig = read_rig(tmp_path / "rig.toml")
    monkeypatch.setattr(force_part, "identify_force_model", lambda *_: truth("electromagnet"))
    monkeypatch.setattr(force_part, "read_rig_loops", lambda _: None)
    export_fmu(tmp_path / "rig.toml", tmp_path / "magnet.fmu", platforms=[HERE])
    ticks = 300
    inputs = {"demand_N": 40.0 + 30.0 * np.sin(np.arange(ticks) / 30.0), "gap_m": np.full(ticks, 0.4e-3)}
    with slave(tmp_path / "magnet.fmu", tmp_path) as made:
        shown = ["command_A", "current_A", "force_N"]
        command, current, force = np.array(made.run(inputs, shown, rig.dt)).T
    alone = rig.make_plant().run(np.concatenate([[0.0], command[:-1]]), inputs["gap_m"], np.zeros((ticks, 3)))
    assert np.array_equal(alone[:, 0], current)
    assert np.array_equal(alone[:, 1], force)
    assert force[0] > 100.0


@needs_binary
@pytest.mark.slow
def test_solid_iron_keeps_its_time_and_its_state_is_transferred(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = read_rig(rig_in(tmp_path))
    monkeypatch.setattr(force_part, "identify_force_model", lambda *_: truth("electromagnet"))
    monkeypatch.setattr(force_part, "read_rig_loops", lambda _: None)
    monkeypatch.setattr(force_part, "complete_rig", lambda rig, _: rig)
    export_fmu(tmp_path / "rig.toml", tmp_path / "magnet.fmu", fmi="3.0", platforms=[HERE])
    ticks, shown = 400, ["command_A", "current_A", "force_N"]
    inputs = {"demand_N": 40.0 + 30.0 * np.sin(np.arange(ticks) / 30.0), "gap_m": np.full(ticks, 0.4e-3)}
    with slave(tmp_path / "magnet.fmu", tmp_path) as made, slave(tmp_path / "magnet.fmu", tmp_path) as other:
        command, current, force = np.array(made.run(inputs, shown, rig.dt)).T
        state = made.to_bytes(made.save())
        rest = {name: values[:20] for name, values in inputs.items()}
        there = made.run(rest, shown, rig.dt, ticks * rig.dt)
        other.restore(other.from_bytes(state))
        assert other.run(rest, shown, rig.dt, ticks * rig.dt) == there
    alone = rig.make_plant().run(np.concatenate([[0.0], command[:-1]]), inputs["gap_m"], np.zeros((ticks, 3)))
    assert np.array_equal(alone[:, 0], current)
    assert np.array_equal(alone[:, 1], force)
    assert force.max() > 30.0


def test_the_command_writes_a_block_and_refuses_options_of_a_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    copied(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(force_part, "identify_force_model", lambda *_: truth("solenoid-end"))
    assert main(["export", "rig.toml", "--as", "simulink", "--rate", "1e3", "-o", "block"]) == 2
    assert says(capsys.readouterr().err, "option-not-for-this: --rate")
    assert main(["export", "rig.toml", "--as", "simulink", "--out", "block"]) == 0
    (script,) = (tmp_path / "block").glob("build_sfun_*.m")
    assert "input 2: gap_m (m)" in script.read_text()
    numbers = (tmp_path / "block" / "src" / "force_numbers.h").read_text()
    assert "magnet_cone" in numbers
    assert "bearing" not in " ".join(path.name for path in (tmp_path / "block" / "src").iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_it_breaks_no_rule_of_the_standard(
    fmi: FmiVersion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copied(tmp_path)
    monkeypatch.setattr(force_part, "identify_force_model", lambda *_: truth("solenoid-three-gaps"))
    made = export_fmu(tmp_path / "rig.toml", tmp_path / "valve.fmu", fmi=fmi, platforms=[])
    assert findings(made) == (fmi, [])
