"""Rigs whose plant is fitted to measured loops and states its error."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from anhyst.data import Loops
from anhyst.data.reading import read_loops
from anhyst_rigs.rig.body import read_bearing
from anhyst_rigs.rig.distance import make_path_follower, measure_deviation, simulate_loop
from anhyst_rigs.rig.from_loops import FittedPlant, complete_rig, fit_magnet
from anhyst_rigs.rig.magnet_table import MagnetTable
from tests.cli.command import Result, contents, quick, refused, unwrapped
from tests.foreign.magnets import MAGNETS
from tests.foreign.rigs import OPTIONS_FROM_LOOPS, write_bearing, write_force_control
from tests.refusals import says
from tests.repository import ROOT

RUN = ("simulate", "rig.toml", "--out", "run.csv")
CLOSE = {"u": 0.25, "hard": 1.2, "soft": 0.1}
"""Largest mean distance of a fitted plant from its loops, % of the largest force."""

TYPED = """\
iron = "core"
turns = 150
resistance_ohm = 1.0
pole_width_m = 0.02
pole_depth_m = 0.02
leakage_H = 1e-7
iron_length_m = 0.2
[[iron]]
name = "core"
cells = 10
reversible_fraction = 0.2
pinning_scale_A_per_m = 100.0
pinning_shape = 2.0
saturation_sharp_T = 1.4
knee_sharp_A_per_m = 200.0
saturation_slow_T = 0.6
knee_slow_A_per_m = 4000.0
"""
"""Somebody's guess at the magnet ``u``: its turns are a quarter too few."""


def fit(path: Path, **known: float) -> tuple[FittedPlant, Loops]:
    loops = read_loops(path)
    table = MagnetTable.model_validate({"name": "magnet", "iron": "from loops", **known})
    return fit_magnet(loops, table), loops


def percent(found: FittedPlant, loops: Loops) -> float:
    magnet, zero = found.magnet, found.zero_current
    far = measure_deviation(
        loops, lambda loop: simulate_loop(make_path_follower(magnet), loop, zero) + found.zero_force
    )
    return 100.0 * far.mean_deviation / far.force_max


@pytest.mark.slow
@pytest.mark.parametrize("name", ["u", pytest.param("hard", marks=pytest.mark.slow), "soft"])
def test_a_plant_is_fitted_to_the_loops_of_any_magnet(name: str, tmp_path: Path) -> None:
    found, loops = fit(MAGNETS[name].write_loops(tmp_path / "loops.csv"))
    assert percent(found, loops) < CLOSE[name]


@pytest.mark.slow
@pytest.mark.parametrize("example", ["bearing", "electromagnet"])
def test_a_plant_is_fitted_to_the_bundled_loops_within_their_noise(example: str) -> None:
    found, loops = fit(ROOT / "examples" / example / "loops.csv")
    assert percent(found, loops) < 0.35


@pytest.mark.slow
def test_given_values_of_a_magnet_are_kept_in_the_fit(tmp_path: Path) -> None:
    shape = MAGNETS["soft"].geometry
    path = MAGNETS["soft"].write_loops(tmp_path / "loops.csv")
    found, loops = fit(path, turns=shape.turns, resistance_ohm=7.0, pole_depth_m=shape.depth)
    assert (found.poles.turns, found.poles.resistance) == (shape.turns, 7.0)
    assert found.poles.depth == shape.depth
    assert found.poles.width == pytest.approx(shape.width, rel=0.15)
    assert found.guessed_keys == ("iron_length_m",)
    assert percent(found, loops) < CLOSE["soft"]


@pytest.mark.slow
def test_a_rig_with_iron_from_its_loops_becomes_whole(tmp_path: Path) -> None:
    rig = read_bearing(write_bearing(MAGNETS["soft"], tmp_path))
    assert rig.settings.iron is None
    whole = complete_rig(rig, rig.measured_loops.read())
    assert whole.fitted is not None
    assert whole.settings.steel == whole.fitted.steel
    assert whole.settings.magnet.poles == whole.fitted.poles
    assert complete_rig(whole, rig.measured_loops.read()).settings == whole.settings


def carried(result: Result, folder: Path) -> dict[str, object]:
    assert result.returncode == 0, result.stderr
    figures = json.loads((folder / "figures.json").read_text())
    assert figures["lost_in"] == []
    plant: dict[str, object] = figures["plant"]
    assert "deviation from the loops: plant: mean" in unwrapped(result.stdout)
    return plant


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param("u", marks=pytest.mark.campaign), "soft"])
def test_a_bearing_with_iron_from_its_loops_levitates(name: str, tmp_path: Path) -> None:
    write_bearing(MAGNETS[name], tmp_path)
    (tmp_path / "loops").mkdir()
    (tmp_path / "loops.csv").rename(tmp_path / "loops" / "one.csv")
    rig = (tmp_path / "rig.toml").read_text()
    (tmp_path / "rig.toml").write_text(rig.replace('"loops.csv"', '"loops"'))
    plant = carried(quick(*RUN, cwd=tmp_path), tmp_path)
    assert plant["guessed"] == ["resistance_ohm", "iron_length_m"]
    assert "The plant" in (tmp_path / "report.html").read_text()


@pytest.mark.slow
def test_a_plant_that_does_not_fit_its_loops_is_flagged(tmp_path: Path) -> None:
    write_bearing(MAGNETS["u"], tmp_path, TYPED)
    result = quick(*RUN, cwd=tmp_path)
    assert "anhyst: warning: the mean deviation from the loops is " in result.stderr
    assert 'set iron = "from loops"' in result.stderr
    assert "errors of this size come from the plant" in (tmp_path / "report.html").read_text()


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        pytest.param(
            "noise_seeds = 2",
            "noise_seeds = 1",
            "greater-than-equal: rig.toml:4: noise_seeds",
            id="first key of the rig",
        ),
        pytest.param(
            'files = "loops.csv"',
            'files = ["loops.csv", "gone"]',
            "no-such-file: rig.toml:8: loops.files[2]: gone",
            id="one of several files",
        ),
        pytest.param(
            'files = "loops.csv"',
            'files = "empty"',
            "no-files: rig.toml:8: loops.files: empty",
            id="empty folder",
        ),
        pytest.param('files = "loops.csv"', "files = 3", "wrong-kind: rig.toml:8: loops.files", id="number"),
        pytest.param(
            OPTIONS_FROM_LOOPS,
            'iron = "from loop"',
            "missing: rig.toml:9: magnet[1]; from loops",
            id="another word",
        ),
        pytest.param(
            "[[magnet]]",
            'clean = "dedupe,dirt"\n[[magnet]]',
            "unknown-cleaning-step: rig.toml:9: loops.clean",
            id="unknown cleaning",
        ),
        pytest.param(
            "[[magnet]]",
            'gap_map = "free"\n[[magnet]]',
            "choice-not-for-this: rig.toml:9: loops.gap_map",
            id="map of fixed gaps",
        ),
        pytest.param(
            "[[magnet]]",
            'law = "jiles-atherton-1986"\n[[magnet]]',
            "choices-together: rig.toml:7: loops",
            id="law without that map",
        ),
    ],
)
def test_errors_of_a_rig_file_are_reported_before_any_work(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    rig = write_bearing(MAGNETS["soft"], tmp_path)
    (tmp_path / "empty").mkdir()
    text = rig.read_text()
    assert text.count(old) == 1
    rig.write_text(text.replace(old, new))
    assert says(refused(*RUN, cwd=tmp_path), message)


@pytest.mark.slow
def test_a_wrong_last_key_costs_no_work(tmp_path: Path) -> None:
    rig = write_bearing(MAGNETS["u"], tmp_path)
    rig.write_text(rig.read_text().replace("hold_s = 0.03", "hold_s = -0.03"))
    (tmp_path / "loops.csv").write_text("nothing that a fit could begin with\n")
    assert "case[1].hold_s: " in refused(*RUN, cwd=tmp_path, preexec_fn=None)


def test_a_wrong_controller_key_is_reported_before_the_fit(tmp_path: Path) -> None:
    write_bearing(MAGNETS["soft"], tmp_path)
    place = tmp_path / "controller.toml"
    place.write_text(place.read_text().replace("hold_ticks = 2000", "hold_ticks = -1"))
    assert refused(*RUN, cwd=tmp_path).startswith("controller.toml:33: safety.hold_ticks: ")


def test_several_files_of_loops_are_one_set(tmp_path: Path) -> None:
    rig = write_bearing(MAGNETS["soft"], tmp_path)
    head, *rows = (tmp_path / "loops.csv").read_text().splitlines()
    whole = read_bearing(rig).measured_loops.read()
    for number, gap in enumerate(("0.15", "0.25", "0.4")):
        part = [row for row in rows if row.split(",")[3] == gap]
        (tmp_path / f"{number}.csv").write_text("\n".join([head, *part]) + "\n")
    text = rig.read_text().replace('"loops.csv"', '["0.csv", "1.csv", "2.csv"]')
    rig.write_text(text)
    parts = read_bearing(rig).measured_loops.read()
    assert len(parts) == len(whole)
    assert sorted(loop.n for loop in parts.loops) == sorted(loop.n for loop in whole.loops)


def test_a_failed_force_control_leaves_no_file(tmp_path: Path) -> None:
    rig = write_force_control(MAGNETS["soft"], tmp_path)
    (tmp_path / "out").mkdir()
    before = contents(tmp_path)
    rig.write_text(rig.read_text().replace("force_max_N = ", "force_max_N = 1000"))
    message = refused("force-control", "rig.toml", "--out", "out", cwd=tmp_path)
    assert says(message, "force-not-reached")
    assert set(contents(tmp_path)) == set(before)


@pytest.mark.slow
def test_a_plant_made_of_the_model_itself_is_reported_as_no_evidence(tmp_path: Path) -> None:
    from anhyst.model.writer import write_model
    from anhyst_rigs.rig.fitting import check_plant
    from anhyst_rigs.study.bearing.inputs import check_inputs, read_files

    example = ROOT / "examples" / "bearing"
    for name in ("rig.toml", "controller.toml", "loops.csv", "loops.toml"):
        shutil.copy(example / name, tmp_path)
    ready = check_inputs(*read_files(tmp_path / "rig.toml", None))
    knowledge = ready.identify_magnet()
    assert check_plant(ready.rig, knowledge).warnings == []
    write_model(knowledge.model, tmp_path / "model.toml")
    rig = (tmp_path / "rig.toml").read_text().replace('"electromagnet"', '"law"\nmodel = "model.toml"')
    (tmp_path / "rig.toml").write_text(rig)
    own = check_inputs(*read_files(tmp_path / "rig.toml", None))
    (message,) = check_plant(own.rig, knowledge).warnings
    assert "is not evidence" in message
