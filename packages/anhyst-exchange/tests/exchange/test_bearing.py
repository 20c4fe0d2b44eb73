"""A simulated bearing or stage as an FMU gives the bits of `anhyst simulate`."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import anhyst
from anhyst.support.states import Command, Phase, State
from anhyst_exchange import stage_part
from anhyst_exchange.exporter import export_fmu
from anhyst_exchange.part import Part, model_description
from anhyst_rigs.rig.bearing.loop import make_setups
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder
from anhyst_rigs.rig.calibration import CENTRE_PARAMETERS
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.loop import Scenario, SimulatedLoop
from anhyst_rigs.rig.recording import Recording, magnet_columns
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.geometry import axis_unit, error_columns, scan_direction
from anhyst_rigs.rig.stage.loop import Feedforward, feedforward_force, feedforward_wrench, track
from anhyst_rigs.rig.stage.recording import demand_columns, pose_columns
from anhyst_rigs.rig.stage.setpoint import long_stroke_error, motion_ticks, scan_motion, tick_times
from anhyst_rigs.study.bearing.inputs import check_inputs, read_files
from tests.cli.command import quick as run
from tests.exchange.slave import HERE, fmpy, needs_binary, slave
from tests.once import made_once
from tests.refusals import refused, says
from tests.repository import ROOT
from tests.study import bearings, stages
from tests.study.test_axes import three_magnets
from tests.study.test_solid_stage import solid_magnet
from tests.truths import truth

pytestmark = [needs_binary, pytest.mark.slow]

TICK = 1.0 / 20e3
INPUTS = ("target_m", "load_N", "command")
KNOWN = 'applied = "reference"', 'applied = "reference"\nmodel = "model.toml"'
AT_THE_TICK = ("reference_m", "gap_read_m", "demand_N", "command_A", "state", "flags")
AFTER_IT = ("gap_m", "velocity_m_per_s", "force_N", "current_A", "flux_density_T")


@dataclass(frozen=True)
class Flight:
    """A levitation as the simulation computes it, and the FMU of the same files."""

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
    """Copy the bundled bearing with one text replaced; return its rig file."""
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
    """Fill a folder with a bearing whose model is known, and its FMUs of both versions."""
    rig = copied(folder, controller=KNOWN)
    truth("bearing").save(folder / "model.toml")
    for fmi in ("2.0", "3.0"):
        export_fmu(rig, folder / f"{fmi[0]}.fmu", fmi=fmi, platforms=[HERE])


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return flown(made_once(tmp_path_factory, "fmu-bearing", made))


def flown(folder: Path) -> Flight:
    """Lift off, step up and down, and apply the load."""
    rig, controller = read_files(folder / "rig.toml", None)
    ready = check_inputs(rig, controller)
    setup = make_setups(ready.rig, controller, ready.identify_magnet(), ("full",))["full"]
    script = ScenarioBuilder(ready.rig, 0.45e-3).lift_off(controller.settings)
    script.step(0.46e-3, 0.02).step(0.43e-3, 0.02)
    scenario = script.set_load(170.0).hold(0.03).build()
    recording = SimulatedLoop(setup).run(scenario)
    return Flight(folder / "2.fmu", scenario, recording)


def test_it_flies_as_the_simulation_does_bit_for_bit(flight: Flight, tmp_path: Path) -> None:
    flies_alike(flight, tmp_path)


def test_a_bearing_of_solid_iron_agrees_with_its_simulation(tmp_path: Path) -> None:
    copied(tmp_path, controller=KNOWN)
    rig = tmp_path / "rig.toml"
    solid = "turns = 250\nsolid = { depth_m = 4e-3, conductivity_S_per_m = 2e6, path_m = 0.05 }"
    rig.write_text(rig.read_text().replace("turns = 250", solid))
    solid_magnet().model.save(tmp_path / "model.toml")
    export_fmu(rig, tmp_path / "2.fmu", platforms=[HERE])
    flight = flown(tmp_path)
    flies_alike(flight, tmp_path)
    goes_over(flight, tmp_path)


def flies_alike(flight: Flight, tmp_path: Path) -> None:
    ticks = flight.scenario.ticks
    names = (*AT_THE_TICK, *AFTER_IT)
    with slave(flight.path, tmp_path) as made:
        rows = np.array(made.run(flight.inputs(slice(None)), names, TICK))
    found = dict(zip(names, rows.T, strict=True))
    assert flight.recording["state"][-1] == 16 * State.RUN + Phase.HOVER
    for name in AT_THE_TICK:
        assert np.array_equal(found[name], flight.recording[name]), name
    for name in AFTER_IT:
        assert np.array_equal(found[name][: ticks - 1], flight.recording[name][1:]), name
    assert np.ptp(found["gap_m"]) > 1e-4


def test_a_levitating_state_is_transferred_to_another_instance(flight: Flight, tmp_path: Path) -> None:
    goes_over(flight, tmp_path)


def goes_over(flight: Flight, tmp_path: Path) -> None:
    half = flight.scenario.ticks - 600
    rest = flight.inputs(slice(half, half + 400))
    with slave(flight.path, tmp_path) as made, slave(flight.path, tmp_path) as other:
        made.run(flight.inputs(slice(0, half)), ["gap_m"], TICK)
        state = made.save()
        there = made.run(rest, ["gap_m", "current_A"], TICK, half * TICK)
        other.restore(other.from_bytes(made.to_bytes(state)))
        made.raw.reset()  # the other instance is independent
        assert other.run(rest, ["gap_m", "current_A"], TICK, half * TICK) == there
        made.begin()
        assert made.read("gap_m") == pytest.approx([0.55e-3], abs=1e-5)


def test_the_fmu_is_valid_and_gives_its_units(flight: Flight, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(flight.path)) == []
    about = {one.name: one for one in fmpy.read_model_description(flight.path).modelVariables}
    assert [about[name].unit for name in ("target_m", "load_N", "velocity_m_per_s")] == ["m", "N", "m/s"]
    third = flight.path.with_name("3.fmu")
    assert validate_fmu(str(third)) == []
    begin = flight.inputs(slice(0, 300))
    with slave(flight.path, tmp_path / "2") as one, slave(third, tmp_path / "3") as other:
        assert one.run(begin, ["gap_m", "force_N"], TICK) == other.run(begin, ["gap_m", "force_N"], TICK)


def test_rigs_without_an_fmu_form_are_refused(tmp_path: Path) -> None:
    rig = copied(tmp_path, controller=('format = "fixed"', 'format = "f64"'))
    with refused("not-compiled-controller"):
        export_fmu(rig, tmp_path / "b.fmu", platforms=[HERE])
    law = 'kind = "electromagnet"', 'kind = "law"\nmodel = "model.toml"'
    truth("bearing").save(tmp_path / "model.toml")
    with refused("law-not-exported magnet.kind"):
        export_fmu(copied(tmp_path, rig=law, controller=KNOWN), tmp_path / "b.fmu")
    completed = run("export", "rig.toml", "--rate", "1e4", "-o", "b.fmu", cwd=tmp_path)
    assert completed.returncode == 2
    assert says(completed.stderr, "option-not-for-this: --rate")
    assert not (tmp_path / "b.fmu").exists()


@dataclass(frozen=True)
class Scan:
    """A motion of a stage as the simulation computes it, and the FMU of the same file."""

    path: Path
    inputs: dict[str, list[float]]
    recording: Recording

    def part(self, begin: int, end: int) -> dict[str, list[float]]:
        return {name: values[begin:end] for name, values in self.inputs.items()}


def stage_made(folder: Path) -> None:
    """Fill a folder with the FMU of the bundled stage, whose magnets are known."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(stage_part, "identify_stage_magnet", lambda _: bearings.knowledge())
        for fmi in ("2.0", "3.0"):
            export_fmu(stages.EXAMPLE / "rig.toml", folder / f"{fmi[0]}.fmu", fmi=fmi, platforms=[HERE])


DUHEM = """family = "duhem"
coercivity_A_per_m = 80.0
turning_T = 0.18
fading = 0.6
saturation_sharp_T = 1.35
knee_sharp_A_per_m = 120.0
saturation_slow_T = 0.55
knee_slow_A_per_m = 3200.0

"""


def calibrated(source: Path, folder: Path, values: dict[str, float]) -> str:
    """Copy a stage and add a calibration; return the text of its rig file."""
    for name in ("loops.csv", "loops.toml"):
        (folder / name).write_bytes((source.parent / name).read_bytes())
    rig, most = read_stage(source), "force_max_N = 240.0"
    numbers = "".join(
        f"[[method.parameter]]\nname = {name!r}\nvalue = {value}\nsigma = 0.0\nprior = 1.0\nfrozen = false\n"
        for name, value in values.items()
    )
    (folder / "calibration.toml").write_text(
        f'format = "anhyst-calibration"\nversion = 1\nrig = {rig.settings.name!r}\n'
        f"mass_kg = {rig.settings.body.mass_kg}\n"
        f'[[method]]\nname = "full"\nresidual_N = 0.1\nforce_N = 100.0\nfits = true\n{numbers}'
    )
    text = source.read_text()
    assert text.count(most) == 1
    return text.replace(most, f'{most}\ncalibration = "calibration.toml"')


def solid_stage_made(folder: Path) -> None:
    """A stage of Duhem iron, partly solid, with known layers and a calibration."""
    found = {"scale_1": 0.01, "scale_2": -0.005, "lag_s": 2e-5}
    found |= {"gap_zero_1_m": 1e-6, "gap_zero_2_m": -1e-6, "width_1": 0.1, "width_2": 0.12}
    text, solid = calibrated(stages.EXAMPLE / "rig.toml", folder, found), "turns = 250\n"
    assert text.count(solid) == 1
    table = "solid = { depth_m = 4e-3, conductivity_S_per_m = 2e6, path_m = 0.05 }\n"
    cells = text[text.index('family = "cells"') : text.index("[[magnet]]")]
    text = text.replace(solid, solid + table).replace(cells, DUHEM)
    (folder / "rig.toml").write_text(text)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(stage_part, "identify_stage_magnet", lambda _: solid_magnet())
        export_fmu(folder / "rig.toml", folder / "2.fmu", platforms=[HERE])


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Scan:
    """Follow two turnarounds with an error of the long stroke and a load."""
    folder = made_once(tmp_path_factory, "fmu-stage", stage_made)
    return scanned(folder, stages.EXAMPLE / "rig.toml", bearings.knowledge())


def scanned(folder: Path, path: Path, magnet: IdentifiedMagnet) -> Scan:
    rig = read_stage(path)
    setup = make_stage(rig, magnet, "full")
    motion = scan_motion(rig.settings.scan, [22.0, 12.0])
    gains, count = Feedforward(0.999, 1e-6, 4e-9), motion_ticks(rig, motion)
    time = tick_times(rig, count + 1)
    load = 0.5 * np.sin(200.0 * time[:count])
    reference = motion.derivatives_at(time)[0]
    inputs = {
        "reference_x_m": reference[:count],
        "feedforward_x_N": feedforward_wrench(setup.assumed_rig, feedforward_force(setup, motion, gains))[
            :, 0
        ],
        "frame_x_m": (reference + long_stroke_error(rig, motion, time))[1:],
        "load_N": load,
    }
    recording = track(setup, motion, gains, load=load)
    listed = {name: values.tolist() for name, values in inputs.items()}
    return Scan(folder / "2.fmu", listed, recording)


def test_a_stage_agrees_with_the_simulation_bit_for_bit(scan: Scan, tmp_path: Path) -> None:
    moves_alike(scan, tmp_path)


def test_a_calibrated_stage_of_solid_iron_agrees_with_the_simulation(tmp_path: Path) -> None:
    solid_stage_made(tmp_path)
    moves_alike(scanned(tmp_path, tmp_path / "rig.toml", solid_magnet()), tmp_path)


def moves_alike(scan: Scan, tmp_path: Path) -> None:
    read = ("pose_read_x_m", "gap_read_m", "gap_read_2_m")
    at_the_tick = (*read, "demand_x_N", "command_A", "command_2_A")
    after_it = ("pose_x_m", "gap_m", "gap_2_m", "force_N", "current_A", "current_2_A")
    names = (*at_the_tick, *after_it)
    with slave(scan.path, tmp_path) as made:
        rows = np.array(made.run(scan.inputs, names, TICK))
    found = dict(zip(names, rows.T, strict=True))
    assert scan.recording.loss is None
    for name in at_the_tick:
        assert np.array_equal(found[name], scan.recording[name]), name
    for name in after_it:
        recorded = scan.recording["position_m" if name == "pose_x_m" else name]
        assert np.array_equal(found[name][:-1], recorded[1:]), name
    assert np.abs(found["demand_x_N"]).max() > 100.0


def test_a_moving_stage_is_transferred_to_another_instance(scan: Scan, tmp_path: Path) -> None:
    rest = scan.part(1500, 1900)
    with slave(scan.path, tmp_path) as made, slave(scan.path, tmp_path) as other:
        made.run(scan.part(0, 1500), ["gap_m"], TICK)
        state = made.save()
        there = made.run(rest, ["gap_m", "current_A"], TICK, 1500 * TICK)
        other.restore(other.from_bytes(made.to_bytes(state)))
        made.raw.reset()  # the other instance is independent
        assert other.run(rest, ["gap_m", "current_A"], TICK, 1500 * TICK) == there
        made.begin()
        assert made.read("gap_m", "pose_x_m") == [0.45e-3, 0.0]


GOES_ON = """
import sys
from pathlib import Path
from tests.exchange.slave import slave
fmu, folder, kept = map(Path, sys.argv[1:])
with slave(fmu, folder) as made:
    made.restore(made.from_bytes(kept.read_bytes()))
    made.raw.doStep(400 * 5e-5, 100 * 5e-5)
    print(made.read("gap_m", "current_A"))
"""


@pytest.mark.parametrize("kind", ["bearing", "stage"])
def test_a_state_continues_in_another_process(kind: str, flight: Flight, scan: Scan, tmp_path: Path) -> None:
    path = flight.path if kind == "bearing" else scan.path
    inputs = flight.inputs(slice(0, 400)) if kind == "bearing" else scan.part(0, 400)
    with slave(path, tmp_path / "one") as made:
        made.run(inputs, ["gap_m"], TICK)
        (tmp_path / "kept").write_bytes(bytes(made.to_bytes(made.save())))
        made.raw.doStep(400 * TICK, 100 * TICK)
        here = made.read("gap_m", "current_A")
    given = [sys.executable, "-c", GOES_ON, path, tmp_path / "two", tmp_path / "kept"]
    completed = subprocess.run(
        list(map(str, given)), cwd=ROOT, capture_output=True, text=True, check=False, timeout=120
    )
    assert completed.returncode == 0, completed.stderr
    assert completed.stdout.strip() == str(here)


def test_a_stage_at_rest_without_inputs_stays_at_rest(scan: Scan, tmp_path: Path) -> None:
    with slave(scan.path, tmp_path) as made:
        rows = made.run({"frame_x_m": [0.0] * 200}, ["pose_x_m"], TICK)
        assert max(abs(place) for (place,) in rows) < 1e-7
        made.raw.reset()
        made.raw.setupExperiment(startTime=0.0)
        made.raw.enterInitializationMode()
        made.write({"frame_x_m": 45e-6})
        assert made.read("gap_m", "pose_x_m") == pytest.approx([0.405e-3, 0.0])
        made.raw.exitInitializationMode()
        rows = made.run({"frame_x_m": [45e-6] * 200}, ["pose_x_m"], TICK)
        assert max(abs(place) for (place,) in rows) < 1e-7
        with pytest.raises(fmpy.fmi1.FMICallException):
            made.run({"reference_x_m": [float("nan")]}, ["pose_x_m"], TICK, 200 * TICK)


def test_a_stage_is_valid_in_both_versions_which_agree(scan: Scan, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    third = scan.path.with_name("3.fmu")
    assert validate_fmu(str(scan.path)) == []
    assert validate_fmu(str(third)) == []
    begin = scan.part(0, 300)
    with slave(scan.path, tmp_path / "2") as one, slave(third, tmp_path / "3") as other:
        assert one.run(begin, ["gap_m", "force_N"], TICK) == other.run(begin, ["gap_m", "force_N"], TICK)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('format = "fixed"', 'format = "f32"', "not-compiled-controller control.format"),
        (
            "force_max_N = 240.0",
            "force_max_N = 240.0\ncalibrate = true",
            "learning-not-exported control.calibrate",
        ),
    ],
)
def test_stages_without_an_fmu_form_are_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = (stages.EXAMPLE / "rig.toml").read_text(encoding="utf-8")
    assert text.count(old) == 1
    (tmp_path / "rig.toml").write_text(text.replace(old, new), encoding="utf-8")
    with refused(said):
        export_fmu(tmp_path / "rig.toml", tmp_path / "s.fmu", platforms=[HERE])
    assert not (tmp_path / "s.fmu").exists()


def test_names_with_characters_invalid_in_xml_are_accepted() -> None:
    part = Part("a\x07<b>", "of a\x00", 1e4, [], {})
    about = ElementTree.fromstring(model_description("3.0", part, "token", []))
    assert (about.get("modelName"), about.get("description")) == ("a?<b>", "of a?")


def test_options_of_a_model_are_refused_for_a_stage(tmp_path: Path) -> None:
    with refused("option-not-for-this --rate"):
        export_fmu(stages.EXAMPLE / "rig.toml", tmp_path / "s.fmu", rate=1e4)
    assert not list(tmp_path.iterdir())


PLANAR = stages.EXAMPLE.parent / "planar" / "rig.toml"


def planar_made(folder: Path) -> None:
    """Fill a folder with the bundled stage of six axes, its ten calibrated magnets, and its FMU."""
    found = {"payload": 0.01, **dict.fromkeys(CENTRE_PARAMETERS, 1e-4)}
    for number in range(1, 11):
        found |= {f"scale_{number}": 1e-3 * number, f"gap_zero_{number}_m": 1e-7 * number}
        found[f"width_{number}"] = 0.1 if number > 8 else 0.0
    (folder / "rig.toml").write_text(calibrated(PLANAR, folder, found))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(stage_part, "identify_stage_magnet", lambda _: bearings.knowledge())
        for fmi in ("2.0", "3.0"):
            export_fmu(folder / "rig.toml", folder / f"{fmi[0]}.fmu", fmi=fmi, platforms=[HERE])


def scanned_by_axes(fmu: Path, rig_path: Path, peak: float, magnet: IdentifiedMagnet | None = None) -> Scan:
    """Lift the body, and follow a turnaround with an error of the long stroke."""
    rig = read_stage(rig_path)
    setup = make_stage(rig, magnet or bearings.knowledge(), "full")
    motion = scan_motion(rig.settings.scan, [peak])
    gains, count = Feedforward(0.999, 1e-6, 4e-9), motion_ticks(rig, motion)
    time, along = tick_times(rig, count + 1), scan_direction(rig.settings)
    reference = motion.derivatives_at(time)[0]
    each = {
        ("reference", "m", "rad"): np.outer(reference[:count], along),
        ("feedforward", "N", "N_m"): feedforward_wrench(
            setup.assumed_rig, feedforward_force(setup, motion, gains)
        ),
        ("frame", "m", "rad"): np.outer(reference + long_stroke_error(rig, motion, time), along)[1:],
    }
    inputs = {
        f"{name}_{axis}_{units[axis.startswith('r')]}": rows[:, place].tolist()
        for (name, *units), rows in each.items()
        for place, axis in enumerate(rig.settings.body.free)
    }
    return Scan(fmu, inputs, track(setup, motion, gains))


@pytest.fixture(scope="module")
def planar(tmp_path_factory: pytest.TempPathFactory) -> Scan:
    folder = made_once(tmp_path_factory, "fmu-planar", planar_made)
    return scanned_by_axes(folder / "2.fmu", folder / "rig.toml", 22.0)


def test_three_magnets_in_double_precision_on_a_body_of_two_coordinates_are_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stage_part, "identify_stage_magnet", lambda _: bearings.knowledge())
    rig = three_magnets(tmp_path)
    rig.write_text(rig.read_text().replace('format = "fixed"', 'format = "f64"'))
    scan = scanned_by_axes(export_fmu(rig, tmp_path / "t.fmu", platforms=[HERE]), rig, 14.0)
    names = ("demand_y_N", "command_3_A", "current_3_A", "gap_3_m")
    with slave(scan.path, tmp_path / "t") as made:
        rows = np.array(made.run(scan.inputs, names, TICK))
    assert scan.recording.loss is None
    for name, values in zip(names[:2], rows.T, strict=False):
        assert np.array_equal(values, scan.recording[name]), name
    for name, values in zip(names[2:], rows.T[2:], strict=True):
        assert np.array_equal(values[:-1], scan.recording[name][1:]), name


def test_six_axes_and_ten_calibrated_magnets_move_as_the_simulation_does_bit_for_bit(
    planar: Scan, tmp_path: Path
) -> None:
    """All except the read pose, because the recording adds its heads in another order."""
    run, free = planar.recording, read_stage(PLANAR).settings.body.free
    at_the_tick = [*demand_columns(free), *magnet_columns([("gap_read", "m"), ("command", "A")], 1, 10)]
    after_it = ["force_N", *magnet_columns([("gap", "m"), ("current", "A")], 1, 10)]
    poses = [f"pose_{axis}_{axis_unit(axis)}" for axis in free]
    names = (*at_the_tick, *after_it, *poses, *pose_columns(free))
    with slave(planar.path, tmp_path) as made:
        rows = np.array(made.run(planar.inputs, names, TICK))
        other = {"load_N": 300 * [5.0]} | planar.part(0, 300)
        made.raw.reset()
        made.begin()
        pushed = np.array(made.run(other, names, TICK))
    found = dict(zip(names, rows.T, strict=True))
    assert run.loss is None
    for name in at_the_tick:
        assert np.array_equal(found[name], run[name]), name
    for name in after_it:
        assert np.array_equal(found[name][:-1], run[name][1:]), name
    for name, error, axis in zip(poses, error_columns(free), free, strict=True):
        expected = planar.inputs[f"reference_{axis}_{axis_unit(axis)}"]
        assert np.array_equal((expected[1:] - found[name][:-1]), run[error][1:]), name
    for name in pose_columns(free):
        assert found[name] == pytest.approx(run[name], rel=0.0, abs=1e-15)
    assert np.abs(found["demand_x_N"]).max() > 100.0
    deviation = pushed[:, names.index("pose_x_m")] - rows[:300, names.index("pose_x_m")]
    assert deviation.max() > 1e-7  # effect of the load, which the simulation does not have


def test_six_axes_lift_off_and_land_at_a_command_as_the_simulation_does_bit_for_bit(
    planar: Scan, tmp_path: Path
) -> None:
    rig, up, down, count = read_stage(planar.path.with_name("rig.toml")), 200, 4000, 8000
    setup = make_stage(rig, bearings.knowledge(), "full")
    free, still = rig.settings.body.free, np.zeros(count)
    frame, forward = np.zeros((count + 1, len(free))), feedforward_wrench(setup.assumed_rig, still)
    scenario = Scenario(frame[:count], feed=forward, frame=frame)
    scenario.command[[0, up, down]] = Command.IDLE, Command.LIFT, Command.LAND
    run = SimulatedLoop(setup).run(scenario)
    held = np.repeat([Command.IDLE, Command.LIFT, Command.LAND], [up, down - up, count - down])
    inputs = {"command": held.astype(np.float64).tolist()} | {
        f"feedforward_{axis}_N{'_m' * axis.startswith('r')}": forward[:, place].tolist()
        for place, axis in enumerate(free)
    }
    with slave(planar.path, tmp_path) as made:
        rows = np.array(made.run(inputs, ["state", "command_3_A", "pose_z_m"], TICK))
    assert np.array_equal(rows[:, 0], run["state"])
    assert np.array_equal(rows[:, 1], run["command_3_A"])
    phases = rows[:, 0] % 16
    assert phases[up - 1] == Phase.REST
    assert rows[up - 1, 2] < -5e-5  # it has fallen onto its stops
    assert phases[down - 1] == Phase.HOVER
    assert abs(rows[down - 1, 2]) < 1e-8
    assert rows[-1, 0] // 16 == State.READY
    assert rows[-1, 1] == 0.0


def test_six_axes_are_transferred_to_another_instance_and_agree_in_both_versions(
    planar: Scan, tmp_path: Path
) -> None:
    from fmpy.validation import validate_fmu

    third, shown = planar.path.with_name("3.fmu"), ["pose_z_m", "wrench_ry_N_m", "current_10_A"]
    assert validate_fmu(str(planar.path)) == []
    assert validate_fmu(str(third)) == []
    rest = planar.part(1000, 1200)
    with (
        slave(planar.path, tmp_path / "2") as made,
        slave(planar.path, tmp_path / "2") as other,
        slave(third, tmp_path / "3") as newer,
    ):
        before = made.run(planar.part(0, 1000), shown, TICK)
        assert newer.run(planar.part(0, 1000), shown, TICK) == before
        state = made.save()
        there = made.run(rest, shown, TICK, 1000 * TICK)
        other.restore(other.from_bytes(made.to_bytes(state)))
        made.raw.reset()  # the other instance is independent
        assert other.run(rest, shown, TICK, 1000 * TICK) == there
        made.begin()
        assert made.read("pose_x_m", "gap_2_m") == [0.0, 0.45e-3]
    units = {one.name: one.unit for one in fmpy.read_model_description(third).modelVariables}
    assert [units[name] for name in ("pose_rx_rad", *shown)] == ["rad", "m", "N.m", "A"]
