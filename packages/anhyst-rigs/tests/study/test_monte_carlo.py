"""Test drifted plants: each depends on seed and number only, and none is simulated twice."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.compensate.circuit import cell_weights
from anhyst.control.controller_file import ControllerFile, read_controller
from anhyst.support.errors import Interrupted
from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.bearing.loop import make_setup
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.drift import MAX_SAMPLE_SIGMA, Drift, drifted_law, drifted_plant, sample_drift
from anhyst_rigs.rig.loop import SimulatedLoop
from anhyst_rigs.rig.tables import SpreadTable
from anhyst_rigs.study.bearing.inputs import check_inputs
from anhyst_rigs.study.bearing.responses import StepRun, run_steps
from anhyst_rigs.study.engine import monte_carlo as engine
from anhyst_rigs.study.engine.monte_carlo import MonteCarlo, Plants, find_fault, percentile
from anhyst_rigs.study.plants import bearing_plants
from tests.refusals import refused
from tests.repository import ROOT
from tests.study import bearings
from tests.truths import path_of, truth

EXAMPLE = ROOT / "examples" / "bearing"
NONE = dict.fromkeys(SpreadTable.model_fields, 0.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the example with an identified model, so that it is identified once."""
    place = tmp_path_factory.mktemp("bearing")
    for path in EXAMPLE.glob("*.*"):
        shutil.copy(path, place)
    shutil.copy(path_of("bearing"), place / "model.toml")
    text = (place / "controller.toml").read_text()
    text = text.replace('format = "fixed"', 'format = "f64"\nmodel = "model.toml"')
    (place / "controller.toml").write_text(text)
    return place


@pytest.fixture(scope="module")
def rig(folder: Path) -> BodyRig:
    return read_bearing(folder / "rig.toml")


@pytest.fixture(scope="module")
def controller(folder: Path) -> ControllerFile:
    return read_controller(folder / "controller.toml")


@pytest.fixture(scope="module")
def whole(rig: BodyRig, controller: ControllerFile, tmp_path_factory: pytest.TempPathFactory) -> MonteCarlo:
    path = tmp_path_factory.mktemp("whole") / "plants.jsonl"
    return monte_carlo(rig, controller, path, 5, ("linearised", "full"), jobs=1)


def monte_carlo(
    rig: BodyRig,
    controller: ControllerFile,
    path: Path,
    count: int,
    methods: tuple[MethodName, ...],
    seed: int | None = None,
    **options: Any,
) -> MonteCarlo:
    plants = bearing_plants(rig, controller, methods, seed)
    return engine.monte_carlo(plants, path, count, **options)


def with_drift(rig: BodyRig, **spreads: float) -> BodyRig:
    table = SpreadTable(**{**NONE, **spreads})
    return replace(rig, settings=rig.settings.model_copy(update={"spread": table}))


@pytest.mark.slow
def test_a_plant_depends_on_seed_and_number_alone(
    rig: BodyRig, controller: ControllerFile, whole: MonteCarlo, tmp_path: Path
) -> None:
    few = monte_carlo(rig, controller, tmp_path / "a", 3, ("linearised", "full"), jobs=2)
    assert few.drifts == whole.drifts[:3]
    for name, runs in few.runs.items():
        assert runs == whole.runs[name][:3]
    other = monte_carlo(rig, controller, tmp_path / "b", 3, ("linearised",), seed=12, jobs=1)
    assert not set(other.drifts) & set(whole.drifts)
    assert len({drift.mass for drift in whole.drifts}) == 5


@pytest.mark.slow
def test_completed_plants_are_not_repeated(
    rig: BodyRig, controller: ControllerFile, whole: MonteCarlo, tmp_path: Path
) -> None:
    path = tmp_path / "plants.jsonl"
    monte_carlo(rig, controller, path, 3, ("linearised", "full"), jobs=1)
    header, *lines = path.read_text().splitlines()
    marked = json.loads(lines[0])
    marked["variants"]["full"]["standstill_rms_m"] = 1.0
    torn = lines[2][: len(lines[2]) // 2]
    path.write_text("\n".join([header, json.dumps(marked), lines[1], torn]))
    found = monte_carlo(rig, controller, path, 5, ("linearised", "full"), jobs=2)
    assert found.values("full", "standstill_rms_m")[0] == 1.0
    assert found.runs["full"][1:] == whole.runs["full"][1:]
    assert found.runs["linearised"] == whole.runs["linearised"]
    plants = [json.loads(line)["plant"] for line in path.read_text().splitlines()[1:]]
    assert sorted(plants) == [0, 1, 2, 3, 4]


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_an_interrupt_loses_nothing(
    rig: BodyRig, controller: ControllerFile, whole: MonteCarlo, tmp_path: Path, jobs: int
) -> None:
    path = tmp_path / "plants.jsonl"

    def stop(done: float, total: float) -> None:
        assert total == 5
        if done == 3:
            raise KeyboardInterrupt

    variants: tuple[MethodName, ...] = ("linearised", "full")
    with pytest.raises(Interrupted, match=r"2 of 5 plants are stored in .*plants\.jsonl; the same"):
        monte_carlo(rig, controller, path, 5, variants, progress=stop, jobs=jobs)
    assert len(path.read_text().splitlines()) == 3
    found = monte_carlo(rig, controller, path, 5, variants, jobs=1)
    assert found.runs == whole.runs


def change_rig(rig: BodyRig, controller: ControllerFile) -> tuple[BodyRig, ControllerFile]:
    return with_drift(rig, mass_percent=1.0), controller


def change_gain(rig: BodyRig, controller: ControllerFile) -> tuple[BodyRig, ControllerFile]:
    return rig, replace(controller, settings=controller.settings.model_copy(update={"set_point_weight": 0.4}))


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("key", "change", "seed", "variant"),
    [
        ("rig", change_rig, None, "linearised"),
        ("controller", change_gain, None, "linearised"),
        ("seed", None, 5, "linearised"),
        ("variants", None, None, "single-valued"),
    ],
)
def test_results_of_something_else_are_refused(
    rig: BodyRig,
    controller: ControllerFile,
    tmp_path: Path,
    key: str,
    change: Callable[..., tuple[BodyRig, ControllerFile]] | None,
    seed: int | None,
    variant: MethodName,
) -> None:
    path = tmp_path / "plants.jsonl"
    monte_carlo(rig, controller, path, 1, ("linearised",), jobs=1)
    before = path.read_bytes()
    if change is not None:
        rig, controller = change(rig, controller)
    with refused(f"other-results {key}: line 1"):
        monte_carlo(rig, controller, path, 2, (variant,), seed=seed, jobs=1)
    assert path.read_bytes() == before


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".csv", ".toml"])
def test_a_changed_file_of_loops_is_reported(
    folder: Path, controller: ControllerFile, tmp_path: Path, suffix: str
) -> None:
    place = tmp_path / "rig"
    shutil.copytree(folder, place)
    rig = read_bearing(place / "rig.toml")
    monte_carlo(rig, controller, place / "p.jsonl", 1, ("linearised",), jobs=1)
    with rig.measured_loops.paths[0].with_suffix(suffix).open("a") as stream:
        stream.write("\n")
    with refused("other-results rig: line 1"):
        monte_carlo(rig, controller, place / "p.jsonl", 1, ("linearised",), jobs=1)


def test_a_damaged_file_is_reported_with_its_line(
    rig: BodyRig, controller: ControllerFile, tmp_path: Path
) -> None:
    path = tmp_path / "plants.jsonl"
    monte_carlo(rig, controller, path, 2, ("linearised",), jobs=1)
    header, first, second = path.read_text().splitlines()
    path.write_text("\n".join([header, first[:20], second, ""]))
    with refused("damaged-results: plants.jsonl"):
        monte_carlo(rig, controller, path, 2, ("linearised",), jobs=1)
    path.write_text("I_A,F_N\n0,0\n")
    with refused("damaged-results: plants.jsonl"):
        monte_carlo(rig, controller, path, 2, ("linearised",), jobs=1)


@pytest.fixture(scope="module")
def linearised(rig: BodyRig, controller: ControllerFile) -> Plants:
    return bearing_plants(rig, controller, ("linearised",))


RUN = {
    "lost_s": None,
    "overshoot_percent": [1.0, 1.0, 1.0, 1.0],
    "settling_s": [0.01, None, 0.01, 0.01],
    "standstill_rms_m": 1e-8,
}
LINE = {"plant": 0, "drift": {"pinning_percent": 1.0}, "variants": {"linearised": RUN}}


@pytest.mark.parametrize(
    ("changes", "reported"),
    [
        ({"drift": None}, "drift: "),
        ({"variants": None}, "variants: "),
        ({"plant": True}, "plant: "),
        ({"plant": -1}, "plant: "),
        ({"variants": {}}, "variants.linearised: is missing"),
        ({"variants": {"linearised": {}}}, "variants.linearised.lost_s: "),
        ({"lost_s": "never"}, "variants.linearised.lost_s: "),
        ({"overshoot_percent": [1.0]}, "overshoot_percent: must have 4 values"),
        ({"settling_s": None}, "variants.linearised.settling_s: must have 4 values"),
        ({"settling_s": [0.1, 0.1, 0.1, math.nan]}, "variants.linearised.settling_s.3: "),
        ({"standstill_rms_m": "low"}, "variants.linearised.standstill_rms_m: "),
        ({"standstill_rms_m": -1.0}, "variants.linearised.standstill_rms_m: "),
    ],
)
def test_a_line_that_is_no_result_is_reported_with_its_key(
    changes: dict[str, Any], reported: str, linearised: Plants
) -> None:
    assert find_fault(LINE, linearised) is None
    whole = {key: changes.get(key, value) for key, value in LINE.items()}
    if not set(changes) & set(LINE):
        whole["variants"] = {"linearised": RUN | changes}
    fault = find_fault(whole, linearised)
    assert fault is not None
    assert reported in fault
    assert "\n" not in fault


def test_a_lost_plant_needs_no_figures(linearised: Plants) -> None:
    lost = LINE | {"variants": {"linearised": {"lost_s": 0.5}}}
    assert find_fault(lost, linearised) is None


def test_a_file_with_such_a_line_is_refused(rig: BodyRig, controller: ControllerFile, tmp_path: Path) -> None:
    path = tmp_path / "plants.jsonl"
    monte_carlo(rig, controller, path, 1, ("linearised",), jobs=1)
    header, _ = path.read_text().splitlines()
    path.write_text(f'{header}\n{{"plant": 0}}\n')
    with refused("damaged-results: plants.jsonl: line 2: drift"):
        monte_carlo(rig, controller, path, 1, ("linearised",), jobs=1)


def test_drawn_plants_have_the_spreads_of_the_file(rig: BodyRig) -> None:
    file = with_drift(rig, pinning_percent=10.0, gap_zero_m=2e-6).settings
    drawn = [sample_drift(file, np.random.default_rng([1, i])) for i in range(4000)]
    pinning = np.array([drift.pinning for drift in drawn])
    offset = np.array([drift.gap_offset for drift in drawn])
    # A normal distribution truncated at 3 sigma has 98.7 % of its standard deviation.
    assert np.std(pinning) == pytest.approx(0.1 * 0.9866, rel=0.03)
    assert np.std(offset) == pytest.approx(2e-6 * 0.9866, rel=0.03)
    assert np.max(np.abs(pinning)) <= 0.1 * MAX_SAMPLE_SIGMA
    assert abs(np.corrcoef(pinning, offset)[0, 1]) < 0.05
    assert {drift.mass for drift in drawn} == {0.0}


@pytest.mark.slow
def test_without_drift_a_plant_is_the_nominal_one(
    rig: BodyRig, controller: ControllerFile, tmp_path: Path
) -> None:
    still = with_drift(rig)
    found = monte_carlo(still, controller, tmp_path / "a", 1, ("full",), jobs=1)
    knowledge = check_inputs(still, controller).identify_magnet()
    setup = make_setup(still, controller.settings, knowledge, "full", "f64")
    tried = still.settings
    _, noise = found.plants.draw_plant(0)
    steps, _ = run_steps(StepRun(setup, tried.gap_m, tuple(tried.step.heights_m), rig.static_load, noise))
    for place, height in enumerate(tried.step.heights_m):
        pair = [step.figures for step in steps if step.height == pytest.approx(height)]
        worst = max(figures["overshoot_percent"] for figures in pair)
        overshoot = found.values("full", "overshoot_percent", place)
        assert overshoot == [pytest.approx(worst, abs=1e-9)]
        slowest = max(figures["settling_in_noise_s"] for figures in pair)
        settling = found.values("full", "settling_s", place)
        assert settling == [pytest.approx(slowest, abs=1e-9)]


def width_and_top(rig: BodyRig) -> tuple[float, float]:
    """Loop width at half force, and the largest force."""
    current = np.linspace(0.0, 4.5, 500)
    path = np.concatenate([current, current[::-1]])
    force = rig.static_map(path, np.full(path.size, 0.45e-3))[0]
    half_force = 0.5 * force[499]
    up = np.interp(half_force, force[:500], current)
    down = np.interp(half_force, force[500:][::-1], current)
    return float(up - down), float(force[499])


def test_each_iron_change_has_its_documented_effect(rig: BodyRig) -> None:
    width, top = width_and_top(rig)
    wider, same = width_and_top(bearings.drifted(rig, Drift(pinning=0.1)))
    assert wider == pytest.approx(1.1 * width, rel=0.02)
    assert same == pytest.approx(top, rel=0.01)
    narrower, _ = width_and_top(bearings.drifted(rig, Drift(reversible=0.5)))
    assert narrower < 0.97 * width
    _, stronger = width_and_top(bearings.drifted(rig, Drift(saturation=0.05)))
    assert stronger > 1.01 * top
    heavier = bearings.drifted(rig, Drift(mass=0.1, resistance=-0.2)).settings
    assert heavier.body.mass_kg == pytest.approx(2.2)
    assert heavier.magnet.resistance_ohm == pytest.approx(0.96)
    assert bearings.drifted(rig, Drift()).settings == rig.settings


def test_the_sensor_turns_around_the_operating_gap(rig: BodyRig, controller: ControllerFile) -> None:
    setup = make_setup(
        rig, controller.settings, check_inputs(rig, controller).identify_magnet(), "linearised", "f64"
    )
    drift = Drift(position_gain=0.02, gap_offset=3e-6, current_gain=0.01)
    loop = SimulatedLoop(setup, plant=drifted_plant(rig, drift, 1))
    script = ScenarioBuilder(rig, 0.45e-3).lift_off(controller.settings).hold(0.1)
    begin = script.ticks
    script.follow(np.full(2000, 0.40e-3))
    found = loop.run(script.hold(0.2).build())
    # The loop drives the sensor reading to the reference.
    middle = found.slice_ticks(begin - 500, begin)
    assert np.mean(middle["gap_m"]) == pytest.approx(0.45e-3 - 3e-6 / 1.02, abs=30e-9)
    moved = np.mean(middle["gap_m"]) - np.mean(found["gap_m"][-500:])
    assert moved == pytest.approx(50e-6 / 1.02, abs=60e-9)
    share = np.mean(middle["current_read_A"]) / np.mean(middle["current_A"])
    assert share == pytest.approx(1.01, abs=1e-3)


def test_a_drifted_law_keeps_its_bounds(rig: BodyRig) -> None:
    model = truth("bearing-jiles-atherton")
    other = drifted_law(model, Drift(pinning=0.1, reversible=1e6, saturation=-0.02))
    for name, factor in (("k", 1.1), ("M_s", 0.98)):
        ratio = np.asarray(other.parameters[name]) / np.asarray(model.parameters[name])
        np.testing.assert_allclose(ratio, factor)
    assert np.max(np.asarray(other.parameters["c"])) == 1.0
    assert other.parameters["a"] == model.parameters["a"]


def test_drifted_cells_are_pinned_otherwise_and_saturate_otherwise(
    rig: BodyRig, controller: ControllerFile
) -> None:
    model = check_inputs(rig, controller).identify_magnet().model
    drift = Drift(pinning=0.1, reversible=0.5, saturation=-0.02)
    own, other = cell_weights(model), cell_weights(drifted_law(model, drift))
    np.testing.assert_allclose(other.thresholds, 1.1 * own.thresholds)
    np.testing.assert_allclose(other.saturation, 0.98 * own.saturation)
    free, freer = (each.weights[0].sum() / each.saturation for each in (own, other))
    assert freer == pytest.approx(min(1.5 * free, 1.0))
    assert not cell_weights(drifted_law(model, Drift(reversible=1e6))).weights[1:].any()
    same = drifted_law(model, Drift())
    there, back = (each.predict([0.0, 3.0, 1.0], 0.45e-3).output for each in (same, model))
    np.testing.assert_allclose(there, back)


def test_a_magnet_of_a_law_drifts_in_its_law(
    folder: Path, rig: BodyRig, controller: ControllerFile, tmp_path: Path
) -> None:
    place = tmp_path / "law"
    shutil.copytree(folder, place)
    text = (place / "rig.toml").read_text().replace('"electromagnet"', '"law"\nmodel = "model.toml"')
    (place / "rig.toml").write_text(text)
    law = read_bearing(place / "rig.toml")
    setup = make_setup(
        law, controller.settings, check_inputs(law, controller).identify_magnet(), "linearised", "f64"
    )
    gaps = []
    for drift in (Drift(), Drift(saturation=-0.03)):
        loop = SimulatedLoop(setup, plant=drifted_plant(law, drift, 1))
        recording = loop.run(ScenarioBuilder(law, 0.45e-3).lift_off(controller.settings).build())
        gaps.append(float(np.mean(recording["current_A"][-1000:])))
    assert gaps[1] > gaps[0] + 1e-3  # a weaker magnet needs more current for the same load


def test_plants_that_are_lost_count_as_the_worst(
    rig: BodyRig, controller: ControllerFile, tmp_path: Path
) -> None:
    # The armature is not lifted if it rests beyond the position limits of the controller.
    far = with_drift(rig, gap_zero_m=30e-6)
    found = monte_carlo(far, controller, tmp_path / "a", 8, ("linearised",), jobs=1)
    lost = [run.lost_s is not None for run in found.runs["linearised"]]
    for is_lost, drift in zip(lost, found.drifts, strict=True):
        assert is_lost or drift.gap_offset < 20e-6
        assert not is_lost or abs(drift.gap_offset) > 10e-6
    assert 0 < sum(lost) < 8
    figures = found.as_dict()["variants"]["linearised"]
    assert figures["lost"] == sum(lost)
    worst = figures["overshoot_percent"][0]
    assert (worst["p99"], worst["worst"]) == (None, None)
    assert lost[worst["worst_plant"]]
    assert math.isfinite(worst["p5"])


def test_percentiles_are_values_that_occurred(whole: MonteCarlo) -> None:
    assert percentile([5.0, 1.0, 3.0, 2.0, 4.0], 50) == 3.0
    assert percentile(list(range(1, 101)), 95) == 95
    assert percentile(list(range(1, 1001)), 99) == 990
    figures = whole.as_dict()
    assert json.loads(json.dumps(figures, allow_nan=False)) == figures
    for name in ("overshoot_percent", "settling_s"):
        for place in range(4):
            row = figures["variants"]["full"][name][place]
            values = whole.values("full", name, place)
            assert row["worst"] == max(values) == values[row["worst_plant"]]
            assert row["p5"] <= row["p50"] <= row["p95"] <= row["p99"] <= row["worst"]
            assert str(row["worst_plant"]) in figures["worst_plants"]


def test_the_verdict_compares_plant_by_plant(whole: MonteCarlo) -> None:
    """Plants differ by more than the methods, but paired differences are significant."""
    assert whole.verdict.level in {"yes", "mixed"}
    first = MonteCarlo(whole.plants, whole.drifts[:1], {name: runs[:1] for name, runs in whole.runs.items()})
    assert first.verdict.level == "unknown"


def test_a_table_of_plants_has_a_row_a_plant_variant_and_case(whole: MonteCarlo) -> None:
    table = whole.to_dataframe()
    assert len(table) == 5 * 2 * (4 + 4 + 1)
    assert set(table["variant"]) == {"linearised", "full"}
