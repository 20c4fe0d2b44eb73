"""Test the benefit map: measured magnets, paired noise seeds, and labels of the cells."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from anhyst.control.controller_file import ControllerFile, read_controller
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.drift import change_iron, change_rig
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.rig.piezo import read_piezo_rig
from anhyst_rigs.study.bearing.operating import find_operating_point
from anhyst_rigs.study.benefit import (
    BASELINES,
    Benefit,
    IronFigures,
    MapCell,
    MethodComparison,
    make_map_cell,
    map_bearing_benefit,
    map_plant_benefit,
)
from anhyst_rigs.study.engine.table import Interval, mean_interval, mean_ratio
from anhyst_rigs.study.reversals import reversal_slope_ratio
from anhyst_rigs.verbs.simulate import simulate
from tests.page import Page
from tests.refusals import refused
from tests.repository import ROOT
from tests.study import bearings, stages

EXAMPLE = ROOT / "examples" / "bearing"
HEIGHTS = (10e-6, 100e-6)


@pytest.fixture(scope="module")
def rig() -> BodyRig:
    # The law is given, because four magnets are identified. The choice of law does not matter here.
    rig = read_bearing(EXAMPLE / "rig.toml")
    return change_rig(rig, {"loops.law": "effective-field", "loops.gap_map": "circuit"})


@pytest.fixture(scope="module")
def controller() -> ControllerFile:
    return read_controller(EXAMPLE / "controller.toml")


@pytest.fixture(scope="module")
def found(rig: BodyRig, controller: ControllerFile) -> Benefit:
    return map_bearing_benefit(rig, controller, (1.0, 2.0), (0.05, 0.3), HEIGHTS, seeds=3)


def cell(found: Benefit, scale: float, fraction: float, height: float) -> MapCell:
    (one,) = (
        cell
        for cell in found.cells
        if (cell.iron.pinning_scale, cell.iron.reversible_fraction, cell.case) == (scale, fraction, height)
    )
    return one


@pytest.mark.slow
def test_every_magnet_is_measured_as_it_is(found: Benefit, rig: BodyRig) -> None:
    assert len(found.cells) == 8
    for one in found.cells:
        iron = one.iron
        slopes = find_operating_point(change_iron(rig, iron.reversible_fraction, iron.pinning_scale)).slopes
        assert iron.after_reversal_true == pytest.approx(slopes.slope_ratio)
        assert iron.label == ("pathological" if slopes.slope_ratio < 0.25 else "regular")
    narrow, wide = (cell(found, scale, 0.3, 10e-6).iron for scale in (1.0, 2.0))
    assert wide.loop_width == pytest.approx(2.0 * narrow.loop_width, rel=0.15)
    assert found.mean_loop_width(2.0) > 1.8 * found.mean_loop_width(1.0)
    assert cell(found, 1.0, 0.05, 10e-6).iron.label == "pathological"
    assert cell(found, 1.0, 0.3, 10e-6).iron.label == "regular"


@pytest.mark.slow
def test_against_a_constant_ratio_compensation_gains_everywhere(found: Benefit) -> None:
    for cell in found.cells:
        against = cell.ratio["overshoot_percent"]
        assert against.baseline == "ratio"
        assert against.outcome == "gain"
        assert against.quotient is not None
        assert against.quotient.high < 1.0


@pytest.mark.slow
def test_the_strongest_baseline_has_the_least_value_of_the_metric(found: Benefit) -> None:
    for cell in found.cells:
        for measure, against in cell.strongest.items():
            means = {name: cell.figures[name][measure].mean for name in BASELINES}
            assert against.baseline == min(means, key=lambda name: means[name])
            assert against.quotient is not None
            own = cell.figures["full"][measure].mean
            assert against.quotient.value == pytest.approx(own / min(means.values()))


@pytest.mark.slow
def test_flux_is_compared_with_methods_without_memory(found: Benefit) -> None:
    for cell in found.cells:
        for measure, against in cell.flux.items():
            assert against.baseline == "flux"
            assert against.quotient is not None
            figures = {name: rows[measure].mean for name, rows in cell.figures.items()}
            assert against.quotient.value == pytest.approx(figures["full"] / figures["flux"])
            assert cell.strongest[measure].baseline != "flux"


@pytest.mark.slow
def test_without_a_probe_flux_is_not_compared(rig: BodyRig, controller: ControllerFile) -> None:
    bare = bearings.without_probe(change_rig(rig, {"measurement.sample_s": 0.05}))
    (one,) = map_bearing_benefit(bare, controller, (1.0,), (0.3,), (100e-6,), seeds=2, jobs=1).cells
    assert one.flux == {}
    assert set(one.figures) == set(one.standstill_rms) == {*BASELINES, "full"}


@pytest.mark.slow
def test_the_overshoot_threshold_is_reported_in_metres(found: Benefit) -> None:
    """The limit in metres is equal at all heights: a multiple of the rms motion at standstill."""
    for cell in found.cells:
        for against in (cell.ratio, cell.strongest, cell.flux):
            overshoot = against["overshoot_percent"]
            assert overshoot.baseline is not None
            assert overshoot.floor is not None
            still = max(cell.standstill_rms["full"], cell.standstill_rms[overshoot.baseline])
            assert overshoot.floor == pytest.approx(300.0 * still / float(cell.case))
            assert 5e-9 < still < 100e-9
            means = [cell.figures[name]["overshoot_percent"].mean for name in ("full", overshoot.baseline)]
            assert (overshoot.outcome == "nothing to gain") == (max(means) < overshoot.floor)
            assert against["settling_in_noise_s"].floor is None


@pytest.mark.slow
def test_the_map_marks_cells_without_gain(found: Benefit) -> None:
    """Without overshoot there is no gain; with wide, pathological loops there is a gain."""
    nothing = cell(found, 1.0, 0.3, 10e-6).strongest["overshoot_percent"]
    assert nothing.outcome == "nothing to gain"
    assert nothing.baseline in ("linearised", "single-valued")
    wide = cell(found, 2.0, 0.05, 10e-6)
    assert wide.iron.label == "pathological"
    assert wide.figures["linearised"]["overshoot_percent"].mean > 10.0
    assert wide.strongest["settling_in_noise_s"].outcome == "gain"


@pytest.mark.slow
def test_a_cell_does_not_depend_on_its_neighbours(
    found: Benefit, rig: BodyRig, controller: ControllerFile
) -> None:
    alone = map_bearing_benefit(rig, controller, (2.0,), (0.3,), (100e-6,), seeds=3, jobs=1)
    kept = cell(found, 2.0, 0.3, 100e-6)
    assert alone.cells[0].iron == kept.iron
    # The preceding step has a small effect on the iron.
    for name, rows in alone.cells[0].figures.items():
        for measure, row in rows.items():
            assert row.mean == pytest.approx(kept.figures[name][measure].mean, rel=0.1, abs=0.2)


@pytest.mark.slow
def test_it_is_written_as_json(found: Benefit) -> None:
    kept = found.as_dict()
    assert json.loads(json.dumps(kept, allow_nan=False)) == kept
    assert len(kept["cells"]) == 8
    row = kept["cells"][0]
    against = row["against_strongest"]["overshoot_percent"]
    assert against["ratio_low"] <= against["ratio"] <= against["ratio_high"]
    assert against["outcome"] in ("gain", "nothing to gain", "no gain", "loss")
    assert against["floor_percent"] > 0.0
    assert row["against_flux"]["settling_in_noise_s"]["baseline"] == "flux"


def test_a_law_is_no_iron_to_vary(rig: BodyRig, controller: ControllerFile) -> None:
    law = change_rig(rig, {"magnet.kind": "law"})
    with refused("not-iron-of-cells: rig.toml"):
        map_bearing_benefit(law, controller)


def test_a_lost_method_is_not_a_baseline() -> None:
    lost = MethodComparison(None, None, None)
    assert lost.outcome == "no gain"
    certain = MethodComparison("single-valued", mean_ratio([1.0, 1.1], [2.0, 2.2]), Interval(1.0, 0.9, 2))
    assert certain.outcome == "gain"
    assert MethodComparison("single-valued", None, None).outcome == "loss"


@pytest.mark.parametrize(
    ("mean", "outcome"), [(1.2, "gain"), (1.0, "no gain"), (-1.0, "no gain"), (-1.2, "loss")]
)
def test_gain_and_loss_are_reported_only_if_significant(mean: float, outcome: str) -> None:
    ratio = mean_ratio([1.0, 1.1], [2.0, 2.2])
    assert MethodComparison("single-valued", ratio, Interval(mean, 1.1, 2)).outcome == outcome
    assert MethodComparison("single-valued", ratio, Interval(mean, 1.1, 2), 3.0, True).outcome == (
        "nothing to gain"
    )


def test_the_interval_of_a_ratio_contains_one_if_the_difference_may_be_zero() -> None:
    rng = np.random.default_rng(3)
    apart = 0
    for shift in np.linspace(-0.5, 0.5, 41):
        common = rng.standard_normal(12)
        upper, lower = 3.0 + common + 0.3 * rng.standard_normal(12), 3.0 + shift + common
        ratio, difference = mean_ratio(upper, lower), mean_interval(lower - upper)
        gains = difference.mean - difference.half_width > 0.0
        assert gains == (ratio.high < 1.0)
        assert ratio.low <= ratio.value <= ratio.high
        apart += gains
    assert 5 < apart < 35


def test_the_interval_of_a_ratio_covers_it() -> None:
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(400):
        upper, lower = 2.0 + 0.5 * rng.standard_normal(20), 4.0 + 0.8 * rng.standard_normal(20)
        found = mean_ratio(upper, lower)
        inside += found.low <= 0.5 <= found.high
    assert 0.92 < inside / 400 < 0.98


def test_a_ratio_to_a_possible_zero_is_unbounded() -> None:
    found = mean_ratio([1.0, 1.1, 0.9], [1.0, -1.0, 0.1])
    assert (found.low, found.high) == (0.0, math.inf)
    assert mean_ratio([1.0, 1.0], [0.0, 0.0]).value == math.inf


@pytest.mark.parametrize(("scale", "fraction"), [(0.5, 0.15), (1.0, 0.05), (1.0, 0.3), (1.0, 0.5)])
def test_measured_loops_show_the_slope_after_a_reversal(rig: BodyRig, scale: float, fraction: float) -> None:
    other = change_iron(rig, fraction, scale)
    reported = reversal_slope_ratio(measure_loops(other))
    assert reported == pytest.approx(find_operating_point(other).slopes.slope_ratio, abs=0.08)


def test_wide_loops_show_it_less_well_but_in_order(rig: BodyRig) -> None:
    reported = [
        reversal_slope_ratio(measure_loops(change_iron(rig, fraction, 2.0))) for fraction in (0.05, 0.15)
    ]
    assert reported[0] is not None
    assert reported[1] is not None
    assert 0.08 < reported[0] < 0.3 < reported[1] < 0.5


def test_loops_without_reversals_near_enough_show_nothing(rig: BodyRig) -> None:
    coarse = change_rig(rig, {"measurement.sample_s": 0.05})
    assert reversal_slope_ratio(measure_loops(coarse)) is None
    single = rig.settings.measurement.records[0].model_copy(update={"turns": [0.0, 1.0]})
    assert reversal_slope_ratio(measure_loops(change_rig(rig, {"measurement.records": [single]}))) is None


PIEZO = EXAMPLE.parent / "piezo" / "rig.toml"


@pytest.mark.slow
def test_a_wider_piezo_loop_gives_a_larger_gain() -> None:
    """A curve's error grows with the loop; that of play cells stays below a narrow loop's error."""
    stage = read_piezo_rig(PIEZO)
    narrow, wide = map_plant_benefit(stage, (0.5, 1.0), seeds=2, jobs=1).cells
    assert wide.iron.loop_width == pytest.approx(2.0 * narrow.iron.loop_width, rel=0.15)
    errors = [one.figures["single-valued"]["rms_m"].mean for one in (narrow, wide)]
    assert errors[1] > 1.6 * errors[0]
    for one in (narrow, wide):
        assert one.case == "triangle"
        assert one.strongest["rms_m"].outcome == "gain"
        assert one.figures["full"]["rms_m"].mean < 0.6 * errors[0]


@pytest.mark.slow
def test_iron_of_a_stage_is_varied_and_measured_again() -> None:
    """The iron has a low slope after a reversal; the loop has half of its width, then all of it."""
    rig = stages.stage()
    found = map_plant_benefit(rig, (0.5, 1.0), (0.05,), seeds=2)
    narrow, wide = found.cells
    assert wide.iron.loop_width > 1.7 * narrow.iron.loop_width
    assert wide.iron.label == "pathological"
    for cell in found.cells:
        assert cell.case == "test set-point"
        assert cell.strongest["average_m"].outcome == "gain"
        assert cell.strongest["average_m"].baseline in BASELINES
    assert {metric.key for metric in found.metrics} >= {"average_m", "peak_m"}


@pytest.mark.slow
def test_the_map_of_any_rig_is_written_with_its_page(tmp_path: Path) -> None:
    simulate(PIEZO, out=tmp_path / "map.json", benefit=True)
    kept = json.loads((tmp_path / "map.json").read_text())
    assert {row["case"] for row in kept["cells"]} == {"triangle"}
    page = Page((tmp_path / "report.html").read_text())
    assert page.sections() == ["benefit", "tables", "origin"]
    page.check_answer_first()
    assert "a significant gain in" in page.text


@pytest.mark.slow
def test_a_rig_that_no_method_holds_has_its_map_and_page_too(tmp_path: Path) -> None:
    text = PIEZO.read_text().replace("bandwidth_Hz = 100.0", "bandwidth_Hz = 500.0")
    (tmp_path / "rig.toml").write_text(text)
    simulate(tmp_path / "rig.toml", out=tmp_path / "map.json", benefit=True)
    first, *_ = json.loads((tmp_path / "map.json").read_text())["cells"]
    assert first["figures"] == {}
    assert first["against_strongest"]["rms_m"] == {"baseline": None, "outcome": "no gain"}
    assert "a significant gain in" in Page((tmp_path / "report.html").read_text()).text


def outcome(iron: IronFigures, values: Mapping[MethodName, Mapping[str, FloatArray]]) -> str:
    cell = make_map_cell(iron, "triangle", values, {}, False, ["settling_s"])
    return cell.strongest["settling_s"].outcome


def test_a_cell_that_every_method_lost_has_no_comparison() -> None:
    assert outcome(IronFigures(1.0, None, 0.05, None, None, ""), {}) == "no gain"


def test_a_run_that_never_settled_is_no_gain() -> None:
    iron = IronFigures(1.0, None, 0.05, None, None, "")
    values: dict[MethodName, Mapping[str, FloatArray]] = {
        "single-valued": {"settling_s": np.array([0.01, 0.011])},
        "full": {"settling_s": np.array([0.002, math.inf])},
    }
    assert outcome(iron, values) == "loss"
    values["full"] = {"settling_s": np.array([0.002, 0.003])}
    assert outcome(iron, values) == "gain"
