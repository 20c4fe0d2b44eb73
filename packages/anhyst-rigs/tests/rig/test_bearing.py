"""Run every kind of plant, amplifier, load and sensor in the loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.data.formats.text import write_csv
from anhyst.model.writer import write_model
from anhyst.support.kinds import NumberFormat
from anhyst.support.states import Command
from anhyst_rigs.rig.bearing.held import levitation_loss_time
from anhyst_rigs.rig.bearing.loop import BearingSetup, make_setup
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import change_rig
from anhyst_rigs.rig.loop import Scenario, SimulatedLoop
from anhyst_rigs.rig.recording import HOVER_CODE, READY_CODE, Recording
from anhyst_rigs.rig.tables import DisturbanceTable
from anhyst_rigs.study.bearing.operating import find_operating_point
from tests.study import bearings
from tests.study.bearings import GAP

Changes = dict[str, Any]
FULL = bearings.single


def levitate(
    rig: BodyRig, seconds: float = 0.3, setup: BearingSetup | None = None
) -> tuple[Recording, Recording]:
    """Lift, hold, step up and land; return the levitated plant and the recording."""
    setup = setup or BearingSetup(rig, FULL().compensator, FULL().controller)
    script = bearings.lifted(setup)
    begin = script.ticks
    script.hold(seconds)
    stepped = script.ticks
    script.step(GAP - 10e-6, 0.2)
    down = script.ticks
    script.command(Command.LAND).hold(0.5)
    recording = bearings.run_plant(setup, script)
    assert len(recording) == script.ticks
    assert levitation_loss_time(rig, recording.slice_ticks(0, down), script.build().lift_end_tick) is None
    assert recording["state"][-1] == READY_CODE
    last = recording.slice_ticks(down - 2000, down)
    assert last["gap_m"].mean() == pytest.approx(GAP - 10e-6, abs=0.2e-6)
    return recording, recording.slice_ticks(begin, stepped)


def holds(still: Recording, load: float, most: float) -> None:
    """Check that the gap stays within `most` and that the load is carried."""
    assert set(still["state"]) == {HOVER_CODE}
    assert np.abs(still["gap_m"] - GAP).max() < most
    assert still["force_N"].mean() == pytest.approx(load, abs=0.2)


@pytest.mark.first(8)
@pytest.mark.parametrize("number_format", bearings.FORMATS)
@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({}, id="example"),
        pytest.param({"magnet.eddy_time_s": 1e-4}, id="eddy currents"),
        pytest.param({"amplifier.mode": "voltage"}, id="voltage"),
        pytest.param({"amplifier.mode": "voltage", "magnet.eddy_time_s": 1e-4}, id="both"),
    ],
)
def test_the_measured_flux_hangs_still(changes: Changes, number_format: NumberFormat) -> None:
    rig = change_rig(bearings.example(), changes)
    table = bearings.controller().settings
    setup = make_setup(rig, table, bearings.knowledge(), "flux", number_format)
    _, still = levitate(rig, setup=setup)
    holds(still, 150.0, 0.1e-6)
    assert still["flux_density_T"].std() < 2e-3


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"amplifier.mode": "voltage"}, id="voltage"),
        pytest.param({"magnet.eddy_time_s": 2e-4}, id="eddy currents"),
        pytest.param({"body.damping_N_s_per_m": 50.0}, id="damped guide"),
        pytest.param({"load.damping_N_s_per_m": 100.0}, id="damping load"),
        pytest.param({"load.stiffness_N_per_m": 5e4}, id="stiff load"),
        pytest.param({"timing.substeps": 8}, id="finer sub-steps"),
        pytest.param({"amplifier.supply_V": 40.0}, id="low supply"),
        pytest.param({"gap_sensor": bearings.sensor("lvdt")}, id="lvdt"),
        pytest.param({"gap_sensor": bearings.sensor("laser")}, id="laser"),
        pytest.param({"gap_sensor": bearings.sensor("capacitive")}, id="capacitive"),
        pytest.param({"gap_sensor": bearings.sensor("encoder")}, id="encoder"),
    ],
)
def test_it_hangs_still(changes: Changes) -> None:
    rig = change_rig(bearings.example(), changes)
    find_operating_point(rig)
    _, still = levitate(rig)
    holds(still, 150.0, 0.3e-6)
    assert np.abs(still["voltage_V"]).max() <= rig.settings.amplifier.supply


def test_weight_counts_as_load() -> None:
    weight = 2.0 * 9.81
    changes = {"body.gravity_m_per_s2": 9.81, "load.force_N": 150.0 - weight}
    _, still = levitate(change_rig(bearings.example(), changes))
    holds(still, 150.0, 0.3e-6)
    assert still["load_N"].mean() == pytest.approx(150.0 - weight, abs=0.1)


def test_a_sharper_sensor_makes_a_quieter_hover() -> None:
    """LVDT, encoder, capacitive, laser: in the order of their noise."""
    spread = []
    for kind in ("lvdt", "encoder", "capacitive", "laser"):
        rig = change_rig(bearings.example(), {"gap_sensor": bearings.sensor(kind)})
        spread.append(float(levitate(rig)[1]["gap_m"].std()))
    assert spread == sorted(spread, reverse=True)
    assert spread[0] > 20.0 * spread[-1]


def test_a_late_amplifier_is_a_late_output() -> None:
    """Half a tick of computing and half a tick of the amplifier equal one tick, bit for bit."""
    late = {"timing.delay_ticks": 0.5, "amplifier.delay_s": 25e-6}
    records = [levitate(rig)[0] for rig in (bearings.example(), change_rig(bearings.example(), late))]
    assert np.array_equal(records[0].table, records[1].table, equal_nan=True)


def test_disturbances_have_their_stated_force() -> None:
    begin = 0.5

    def pushed(kind: str, force: float, frequency: float | None = None) -> Recording:
        given = {"kind": kind, "force_N": force, "start_s": begin, "frequency_Hz": frequency}
        one = DisturbanceTable.model_validate(given)
        recording, _ = levitate(change_rig(bearings.example(), {"load.disturbance": [one]}), 1.0)
        before = recording.slice_ticks(9200, 9990)
        assert np.ptp(before["load_N"]) < 1e-9
        return recording.slice_ticks(10400, 28000)

    step = pushed("step", 10.0)
    assert step["load_N"].mean() == pytest.approx(160.0, abs=0.01)
    assert step["force_N"][-4000:].mean() == pytest.approx(160.0, abs=0.2)
    sine = pushed("sine", 10.0, 30.0)
    angle = 2.0 * np.pi * 30.0 * (sine["t_s"] - begin)
    wave = np.column_stack([np.ones(angle.size), np.sin(angle), np.cos(angle)])
    mean, first, second = np.linalg.lstsq(wave, sine["load_N"], rcond=None)[0]
    assert mean == pytest.approx(150.0, abs=0.05)
    assert np.hypot(first, second) == pytest.approx(10.0, rel=0.01)
    assert np.hypot(first, second) > 9.9
    noise = pushed("noise", 2.0, 50.0)
    assert np.std(noise["load_N"]) == pytest.approx(2.0, rel=0.3)
    assert np.std(noise["gap_m"]) > 5.0 * np.std(step["gap_m"][-4000:])


def test_a_rendered_load_pushes_back() -> None:
    """Its stiffness pulls the armature to its rest position, and its damping opposes motion."""
    changes = {"load.stiffness_N_per_m": 5e4}
    recording, _ = levitate(change_rig(bearings.example(), changes))
    up = recording.slice_ticks(len(recording) - 10000 - 2000, len(recording) - 10000)
    deviation = up["gap_m"].mean() - bearings.example().settings.gap_m
    assert up["load_N"].mean() == pytest.approx(150.0 - 5e4 * deviation, abs=0.05)
    assert up["force_N"].mean() == pytest.approx(150.5, abs=0.1)


@pytest.fixture
def law(tmp_path: Path) -> BodyRig:
    """Return a rig whose magnet has the force of the model identified from the example."""
    write_model(bearings.knowledge().model, tmp_path / "model.toml")
    table = bearings.example().flux_linkage
    current, gap = np.meshgrid(table.current, table.gap)
    columns = {"I_A": current.ravel(), "gap_m": gap.ravel(), "psi_Wb": table.psi.ravel()}
    write_csv(tmp_path / "flux.csv", columns)
    rig = change_rig(bearings.example(), {"magnet.kind": "law", "magnet.model": "model.toml"})
    return replace(rig, path=tmp_path / "rig.toml")


def with_table(rig: BodyRig) -> BodyRig:
    return change_rig(rig, {"magnet.flux_table": "flux.csv", "magnet.iron": None, "irons": []})


@pytest.mark.slow
@pytest.mark.parametrize(
    "change", [pytest.param(lambda rig: rig, id="made"), pytest.param(with_table, id="measured")]
)
def test_an_identified_law_makes_the_force(law: BodyRig, change: Callable[[BodyRig], BodyRig]) -> None:
    """The controller's model is the plant, so that demand and force are equal.

    There is no noise. Its peaks would move the play of the compensator, which uses the reference,
    by more than the play of the magnet, which uses the amplifier's current.
    """
    silent = {
        "gap_sensor": bearings.sensor("capacitive", noise_m=0.0, step_m=1e-13),
        "current_sensor.noise_A": 0.0,
    }
    rig = change_rig(change(law), silent)
    at, own = find_operating_point(rig), find_operating_point(bearings.example())
    assert at.bearing.k_i == pytest.approx(own.bearing.k_i, rel=0.05)
    assert at.bearing.inductance == pytest.approx(own.bearing.inductance, rel=0.05)
    recording, still = levitate(rig)
    holds(still, 150.0, 0.3e-6)
    mine = still["demand_N"].mean() - still["force_N"].mean()
    _, other = levitate(bearings.example())
    assert abs(mine) < 0.2 * abs(other["demand_N"].mean() - other["force_N"].mean())
    assert recording["flux_Wb"].max() > 0.01


def test_a_measured_flux_table_gives_the_plant_it_was_made_from(law: BodyRig) -> None:
    made, measured = levitate(law)[0], levitate(with_table(law))[0]
    assert np.abs(made["gap_m"] - measured["gap_m"]).max() < 1e-6
    assert np.abs(made["flux_Wb"] - measured["flux_Wb"]).max() < 1e-4


def test_a_scenario_in_parts_agrees_with_the_whole() -> None:
    """What it leaves out is nothing at every tick; a frame has a row more than each part has ticks."""
    setup, rng = bearings.single(), np.random.default_rng(1)
    target = np.full(400, GAP)
    load, frame = rng.normal(size=400), 1e-6 * np.cumsum(rng.normal(size=401))
    whole = Scenario(target, load, frame=frame)
    expected = SimulatedLoop(setup).run(whole)
    silent = replace(whole, feed=np.zeros(400), command=np.zeros(400, dtype=np.uint32))
    assert np.array_equal(SimulatedLoop(setup).run(silent).table, expected.table)
    loop = SimulatedLoop(setup)
    parts = [loop.run(whole.slice_ticks(begin, begin + 100)) for begin in range(0, 400, 100)]
    assert np.array_equal(Recording.concatenate(parts).table, expected.table)
    assert np.ptp(expected["gap_m"]) > 0.0
