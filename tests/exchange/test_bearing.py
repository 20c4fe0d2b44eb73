"""A whole virtual bearing as an FMU: what `anhyst simulate` runs, bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import anhyst
from anhyst.control.states import Phase, State
from anhyst.exchange.fmu_file import export_fmu
from anhyst.rig.bearing.loop import SimulatedLoop
from anhyst.rig.bearing.make_setup import make_setups
from anhyst.rig.bearing.scenario import Scenario, Script
from anhyst.rig.recording import Recording
from anhyst.study.bearing.ready import make_ready, read_files
from tests.cli.command import quick as run
from tests.exchange.slave import HERE, fmpy, needs_binary, slave
from tests.once import made_once
from tests.refusals import refused, says
from tests.truths import truth

pytestmark = [needs_binary, pytest.mark.slow]

TICK = 1.0 / 20e3
INPUTS = ("target_gap", "load", "command")
AT_THE_TICK = {
    "reference_gap": "reference_m",
    "gap_read": "gap_read_m",
    "demand": "demand_N",
    "command_current_1": "command_A",
    "state": "state",
    "flags": "flags",
}
AFTER_IT = {
    "gap": "gap_m",
    "velocity": "velocity_m_per_s",
    "force": "force_N",
    "current_1": "current_A",
    "flux_density_1": "flux_density_T",
}


@dataclass(frozen=True)
class Flight:
    """A flight as the simulation gives it, and the FMU of the same files."""

    path: Path
    scenario: Scenario
    recording: Recording

    def inputs(self, ticks: slice) -> dict[str, list[float]]:
        events = (self.scenario.target, self.scenario.load, self.scenario.command)
        return {
            name: np.asarray(values)[ticks].astype(float).tolist()
            for name, values in zip(INPUTS, events, strict=True)
        }


def copied(folder: Path, **changes: tuple[str, str]) -> Path:
    """Copy the bundled bearing, with another text in one of its files; return the rig file."""
    files: dict[str, Path] = dict(anhyst.example_files("bearing"))
    for name, path in files.items():
        text = path.read_text()
        if name.partition(".")[0] in changes:
            old, new = changes[name.partition(".")[0]]
            assert text.count(old) == 1
            text = text.replace(old, new)
        (folder / name).write_text(text)
    return folder / "rig.toml"


def made(folder: Path) -> None:
    """Fill a folder with a bearing whose model is known, and its FMU of either version."""
    known = ('applied = "reference"', 'applied = "reference"\nmodel = "model.toml"')
    rig = copied(folder, controller=known)
    truth("bearing").save(folder / "model.toml")
    for fmi in ("2.0", "3.0"):
        export_fmu(rig, folder / f"{fmi[0]}.fmu", fmi=fmi, platforms=[HERE])


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    """Lift off, step up and down, and let the load push."""
    folder = made_once(tmp_path_factory, "fmu-bearing", made)
    rig, controller = read_files(folder / "rig.toml", None)
    ready = make_ready(rig, controller)
    setup = make_setups(ready.rig, controller, ready.knowledge(), ("full",))["full"]
    script = Script(ready.rig, 0.45e-3).lift_off(controller.settings)
    script.step(0.46e-3, 0.02).step(0.43e-3, 0.02)
    scenario = script.set_load(170.0).hold(0.03).build()
    recording = SimulatedLoop(setup).run(scenario)
    return Flight(folder / "2.fmu", scenario, recording)


def test_it_flies_as_the_simulation_does_bit_for_bit(flight: Flight, tmp_path: Path) -> None:
    ticks = flight.scenario.ticks
    names = (*AT_THE_TICK, *AFTER_IT)
    with slave(flight.path, tmp_path) as made:
        rows = np.array(made.run(flight.inputs(slice(None)), names, TICK))
    found = dict(zip(names, rows.T, strict=True))
    assert flight.recording["state"][-1] == 16 * State.RUN + Phase.HOVER
    for name, column in AT_THE_TICK.items():
        assert np.array_equal(found[name], flight.recording[column]), name
    for name, column in AFTER_IT.items():
        assert np.array_equal(found[name][: ticks - 1], flight.recording[column][1:]), name
    assert np.ptp(found["gap"]) > 1e-4


def test_a_state_in_mid_air_goes_over_to_another_instance(flight: Flight, tmp_path: Path) -> None:
    half = flight.scenario.ticks - 600
    rest = flight.inputs(slice(half, half + 400))
    with slave(flight.path, tmp_path) as made, slave(flight.path, tmp_path) as other:
        made.run(flight.inputs(slice(0, half)), ["gap"], TICK)
        state = made.save()
        there = made.run(rest, ["gap", "current_1"], TICK, half * TICK)
        other.restore(other.from_bytes(made.to_bytes(state)))
        made.raw.reset()  # what the other one goes on with is its own
        assert other.run(rest, ["gap", "current_1"], TICK, half * TICK) == there
        made.begin()
        assert made.read("gap") == pytest.approx([0.55e-3], abs=1e-5)


def test_it_is_valid_and_says_its_units(flight: Flight, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(flight.path)) == []
    about = {one.name: one for one in fmpy.read_model_description(flight.path).modelVariables}
    assert [about[name].unit for name in ("target_gap", "load", "velocity")] == ["m", "N", "m/s"]
    third = flight.path.with_name("3.fmu")
    assert validate_fmu(str(third)) == []
    begin = flight.inputs(slice(0, 300))
    with slave(flight.path, tmp_path / "2") as one, slave(third, tmp_path / "3") as other:
        assert one.run(begin, ["gap", "force"], TICK) == other.run(begin, ["gap", "force"], TICK)


def test_what_it_cannot_hold_is_refused(tmp_path: Path) -> None:
    rig = copied(tmp_path, controller=('format = "fixed"', 'format = "f64"'))
    with refused("not-compiled-controller"):
        export_fmu(rig, tmp_path / "b.fmu", platforms=[HERE])
    done = run("export", "rig.toml", "--rate", "1e4", "-o", "b.fmu", cwd=tmp_path)
    assert done.returncode == 2
    assert says(done.stderr, "option-not-for-this: --rate")
    solid = "turns = 250\nsolid = { depth_m = 4e-3, conductivity_S_per_m = 2e6 }"
    with refused("solid-not-exported magnet.solid"):
        export_fmu(copied(tmp_path, rig=("turns = 250", solid)), tmp_path / "b.fmu")
    assert not (tmp_path / "b.fmu").exists()
