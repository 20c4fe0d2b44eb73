"""Test bodies with several coordinates: rig files, tracking, and other kinds of bodies."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst_rigs.reports.tracking import render
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.loop import Scenario, SimulatedLoop
from anhyst_rigs.rig.recording import Recording, column_name
from anhyst_rigs.rig.stage import loop
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.geometry import scan_direction
from anhyst_rigs.rig.stage.loop import (
    Feedforward,
    controller_matrices,
    feedforward_force,
    feedforward_wrench,
    track,
)
from anhyst_rigs.rig.stage.recording import axis_columns, pose_columns, recording_columns
from anhyst_rigs.rig.stage.setpoint import motion_ticks, scan_motion, tick_times
from anhyst_rigs.study.tracking.measures import cross_talk, measure, stationary_axes
from anhyst_rigs.study.tracking.simulate import explore_stage
from tests.repository import ROOT
from tests.study import bearings, stages

EXAMPLES = ROOT / "examples"
PLANAR = (EXAMPLES / "planar" / "rig.toml").read_text()


@cache
def planar() -> BodyRig:
    """Return the example with a known iron, which needs no identification."""
    rig = read_stage(EXAMPLES / "planar" / "rig.toml")
    changes = {"irons": list(stages.stage().settings.irons), "cases": [rig.settings.scan]}
    changed = rig.settings.model_copy(update=changes)
    looked_for = {"control.lost_A": None, "control.head_m_per_s": None}
    return replace(rig, settings=changed.with_changes(looked_for))


@cache
def followed(method: MethodName, substeps: int = 4) -> Recording:
    rig = planar()
    timing = rig.settings.timing.model_copy(update={"substeps": substeps})
    other = replace(rig, settings=rig.settings.model_copy(update={"timing": timing}))
    setup = make_stage(other, bearings.knowledge(), method)
    scan = rig.settings.scan
    return track(setup, scan_motion(scan, scan.test_m_per_s2), Feedforward())


@pytest.mark.slow
def test_compensating_every_magnet_keeps_all_axes_closer() -> None:
    scan = planar().settings.scan
    motion = scan_motion(scan, scan.test_m_per_s2)
    single_valued, full = followed("single-valued"), followed("full")
    assert not single_valued.loss_text
    assert not full.loss_text
    assert (
        measure(full, motion, scan.slit_s).peak_m < 0.4 * measure(single_valued, motion, scan.slit_s).peak_m
    )
    crossed, less = (
        cross_talk(run, motion, stationary_axes(planar().settings)) for run in (single_valued, full)
    )
    assert set(crossed) == {"y_m", "z_m", "rx_rad", "ry_rad", "rz_rad"}
    for axis in ("z_m", "ry_rad"):
        assert less[axis] < 0.7 * crossed[axis]


def test_twice_the_sub_steps_change_little_once_the_body_is_lifted() -> None:
    coarse, fine = followed("full"), followed("full", substeps=8)
    lifted = round(0.05 / coarse.dt)
    for name, limit in (("error_m", 3e-9), ("error_z_m", 1.5e-9), ("error_ry_rad", 50e-9)):
        assert np.abs(coarse[name] - fine[name])[lifted:].max() < limit


def test_single_precision_agrees_with_double_within_a_nanometre() -> None:
    rig, scan = planar(), planar().settings.scan
    motion = scan_motion(scan, scan.test_m_per_s2[:1])
    wide, narrow = (
        track(
            replace(
                make_stage(
                    replace(rig, settings=rig.settings.with_changes({"control.format": law})),
                    bearings.knowledge(),
                    "full",
                ),
                number_format=law,
            ),
            motion,
            Feedforward(),
        )
        for law in ("f64", "f32")
    )
    assert not narrow.loss_text
    for name, largest in (("error_m", 1e-9), ("error_z_m", 1e-9), ("error_rz_rad", 5e-9)):
        assert np.abs(wide[name] - narrow[name]).max() < largest


def on_the_ground(rig: BodyRig, **beam: float) -> BodyRig:
    """Return a stage whose sensor heads are fixed to the ground, without noise."""
    file = rig.settings
    for head in file.position_sensors:
        changes = {"stands": True, "noise_m": 0.0, **beam}
        file = file.with_table_replaced(head, head.model_copy(update=changes))
    return replace(rig, settings=file)


def test_heads_on_the_ground_see_another_place_of_the_body_and_the_controller_knows_which() -> None:
    rig = on_the_ground(planar())
    file, scan = rig.settings, rig.settings.scan
    setup = make_stage(rig, bearings.knowledge(), "single-valued")
    motion = scan_motion(scan, scan.test_m_per_s2[:1])
    n, along = motion_ticks(rig, motion), scan_direction(file)
    reference = np.outer(motion.derivatives_at(tick_times(rig, n + 1))[0], along)
    wrench = feedforward_wrench(rig, feedforward_force(setup, motion, Feedforward()))
    scenario = Scenario(reference[:n], feed=wrench, frame=reference)
    flown = SimulatedLoop(setup).run(scenario)
    pose = np.column_stack([flown[name] for name in axis_columns("pose", file.body.free)])
    pose += reference[:n]
    rotation = Rotation.from_rotvec(pose[:, 3:])
    assert np.ptp(pose[:, 0]) > 0.02
    assert np.abs(pose[:, 4]).max() > 3e-6
    for number, head in enumerate(file.position_sensors, len(file.body_magnets) + 1):
        # a head measures along its beam to a mirror that rotates with the body
        assert head.position_m is not None
        normal = rotation.apply(head.direction)
        way = np.sum((pose[:, :3] + rotation.apply(head.position_m) - head.position_m) * normal, axis=1)
        read = flown[column_name("gap_read", "m", number)]
        assert read == pytest.approx(way / (normal @ head.direction), abs=2e-11)
    columns = recording_columns(rig, flown, scenario)
    read = np.column_stack([columns[name] for name in pose_columns(file.body.free)])
    assert read == pytest.approx(pose, abs=1e-10)
    # With correct settings, z stays as with heads on the body. A controller that does not know
    # where the heads are mistakes a rotation for a height.
    riding, knows = (
        track(each_setup, motion, Feedforward()) for each_setup in (replace(setup, rig=planar()), setup)
    )
    unaware = controller_matrices(setup) | {"ground": np.zeros(0)}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "controller_matrices", lambda _: unaware)
        takes = track(setup, motion, Feedforward())
    unmodelled_change, riding_change = (
        np.abs(run["error_z_m"] - knows["error_z_m"]).max() for run in (takes, riding)
    )
    turn = np.abs(knows["error_ry_rad"] * knows["reference_m"]).max()
    assert unmodelled_change > 0.5 * turn > 10.0 * riding_change


def test_air_that_changed_lengthens_a_beam_with_its_dead_path() -> None:
    rig = on_the_ground(planar(), dead_path_m=0.3, refraction_ppm=0.1)
    motion = scan_motion(rig.settings.scan, rig.settings.scan.test_m_per_s2[:1])
    setup = make_stage(rig, bearings.knowledge(), "full")
    run = track(setup, motion, Feedforward())
    second_half = slice(len(run) // 2, None)
    expected = 1e-7 * (0.3 + run["reference_m"][second_half])
    assert run["pose_read_x_m"][second_half] - run["position_m"][second_half] == pytest.approx(
        expected, abs=1e-12
    )
    assert np.mean(run["error_m"][second_half]) == pytest.approx(np.mean(expected), rel=0.1)


Y1 = 'like = "x1"\nposition_m = [0.0, 0.15, 0.0]\ndirection = '
SCAN = "direction = [1.0, 0.0, 0.0]           # of the"


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("[0.0, 1.0, 0.0]\nnoise", "[0.0, 0.0, 1.0]\nnoise", "axis-not-seen"),
        (SCAN, "direction = [1.0, 1.0, 0.0] # of the", "no-unit-vector"),
        ("gravity_m_per_s2 = 9.81", "gravity_m_per_s2 = -9.81", "axis-not-held"),
        (f"{Y1}[0.0, 1.0, 0.0]", f"{Y1}[1.0, 0.0, 0.0]", "axis-not-held"),
        ("mass_kg = 20.0", "mass_kg = 130.0", "load-too-large"),
        ('free = ["x", "y"', 'free = ["y", "x"', "wrong-order"),
        ("position_m = [0.0, 0.15, 0.02]", "stands = true\nposition_m = [0.0, 0.15, 0.02]", "option-differs"),
        ("position_m = [0.0, 0.15, 0.02]", "dead_path_m = 0.3\nposition_m = [0.0, 0.15, 0.02]", "missing"),
    ],
)
def test_a_layout_that_cannot_fly_is_refused(tmp_path: Path, old: str, new: str, code: str) -> None:
    assert PLANAR.count(old) == 1
    path = tmp_path / "rig.toml"
    path.write_text(PLANAR.replace(old, new))
    with pytest.raises(InputError) as raised:
        read_stage(path)
    assert raised.value.code == code


THREE = """
[[body]]
mass_kg = 6.0
free = ["x", "y"]
stop_low_m = 0.35e-3
stop_high_m = 0.55e-3
"""
SIXTY = np.sqrt(0.75).item()


def three_magnets(folder: Path) -> Path:
    """Write a rig of another body: two coordinates and three magnets at 120 degrees."""
    text = (EXAMPLES / "stage" / "rig.toml").read_text()
    begin, end = text.index('[[magnet]]\nname = "second"'), text.index("[[amplifier]]")
    others = "".join(
        f'[[magnet]]\nname = "{name}"\nlike = "first"\nposition_m = [0.0, 0.0, 0.0]\n'
        f"direction = [-0.5, {side}, 0.0]\ngap_m = 0.45e-3\n\n"
        for name, side in (("second", SIXTY), ("third", -SIXTY))
    )
    text = text[:begin] + others + text[end:]
    begin, end = text.index("[[body]]"), text.index("[[sensor]]")
    text = text[:begin] + THREE + text[end:]
    along = "position_m = [0.0, 0.0, 0.0]\ndirection = [{}]\n"
    text = text.replace('iron = "core"\n', 'iron = "core"\n' + along.format("1.0, 0.0, 0.0"), 1)
    head = 'of = "position"\nnoise_m = 0.5e-9 '
    heads = [head.replace("noise", along.format(way) + "noise") for way in ("1.0, 0.0, 0.0", "0.0, 1.0, 0.0")]
    text = text.replace(head, f"{heads[0]}\n\n[[sensor]]\n{heads[1]}")
    text = text.replace("slit_s", "direction = [0.0, 1.0, 0.0]\nslit_s")
    for key in ("train", "test"):
        begin = text.index(f"{key}_m_per_s2")
        text = text[:begin] + f"{key}_m_per_s2 = [14.0, 9.0]\n" + text[text.index("\n", begin) + 1 :]
    text = text.replace("noise_seeds = 10", "noise_seeds = 2").replace("cruise_s = 0.05", "cruise_s = 0.03")
    text = "".join(line for line in text.splitlines(True) if not line.startswith("eddy_s"))
    text = text.replace('"loops.csv"', f'"{(EXAMPLES / "stage" / "loops.csv").as_posix()}"')
    path = folder / "rig.toml"
    path.write_text(text)
    return path


@pytest.mark.slow
def test_a_new_body_is_a_file(tmp_path: Path) -> None:
    rig = read_stage(three_magnets(tmp_path))
    study = explore_stage(rig, bearings.knowledge(), ("single-valued", "full"))
    assert study.lost_in == []
    plain, own = study.variants["single-valued"], study.variants["full"]
    assert own.interval("peak_m").mean < 0.5 * plain.interval("peak_m").mean
    shown = own.recording
    assert {"error_x_m", "error_y_m", "current_3_A"} <= set(shown.columns)
    assert own.interval("x_m").mean < 1e-6
    variants = study.as_dict()["variants"]
    assert variants["full"]["cross_talk"]["x_m"]["mean"] == own.interval("x_m").mean
    at_rest = variants["full"]["standstill_rms"]
    assert set(at_rest) == {"x_m", "y_m"}
    assert all(0.1e-10 < error < 2e-9 for error in at_rest.values())
    assert variants["full"]["standstill_rms_m"] == at_rest["y_m"]
    text = render(study, "anhyst simulate rig.toml")
    assert 'id="cross-talk"' in text
    assert "Rms of each coordinate at rest" in text
