"""The paper's search: seven free parameters at each gap, and the reduction to one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.data import Loops
from anhyst.identification import IdentifyResult, identify, paper_sequence
from anhyst.identification.fit_records import FitRecords, make_fit_records
from anhyst.identification.model_building import make_response_form
from anhyst.identification.paper_parameters import (
    COMMON_AIR_CORE_SLOPE,
    SEVEN_NAMES,
    UNSOLVED_COST,
    Criterion,
    Parameters,
    make_parameter_set,
    make_variables,
    mean_deviation,
    mean_over_gaps,
    move_to_one_gauge,
    to_gauge_free,
)
from anhyst.identification.paper_search import (
    PaperSearch,
    SearchEffort,
    SearchState,
    search_each_gap,
    spline_model_at,
)
from anhyst.identification.paper_sequence import reduce_gap_dependence, search_paper
from anhyst.identification.run import Outcome, SearchRun
from anhyst.model.actuator import Model
from tests.identification.truths import GAPS, core, loops_of, magnet
from tests.refusals import refused

pytestmark = pytest.mark.slow

SHORT = SearchEffort(generations=30, final_evaluations=40, trial_evaluations=8)
LEAST = SearchEffort(generations=5, final_evaluations=5, trial_evaluations=2)
"""Effort for tests that do not depend on the accuracy of the search."""

NO_OFFSETS = frozenset({"in_0", "out_0"})
THREE = GAPS[:3]

SET: Parameters = {
    "M_s": 5e5,
    "a": 300.0,
    "alpha": -0.03,
    "k": 400.0,
    "c": 0.2,
    "c_H": 5e3,
    "c_out": 900.0,
    "in_0": 0.01,
    "out_0": 0.2,
}


def run_of(loops: Loops, held: frozenset[str] = NO_OFFSETS, **settings: object) -> SearchRun:
    form = make_response_form(loops.input, loops.output, "effective-field")
    return SearchRun(form=form, records=make_fit_records(loops), seed=1, fixed=held, **settings)  # type: ignore[arg-type]


def stopper(after: int) -> Callable[[int, int], None]:
    def progress(done: float, total: float) -> None:
        if done == after:
            raise KeyboardInterrupt

    return progress


@pytest.fixture(scope="module")
def truth() -> Model:
    """Return a magnet in which only c_H depends on the gap, as in the paper, with the air slope of
    iron."""
    c_h = tuple(0.01 / (1.5e-5 + 0.19 * gap) for gap in GAPS)
    iron: dict[str, Any] = {"a": 10.0, "k": 7.0, "alpha": -4e-5, "in_0": 0.0, "out_0": 0.0}
    return magnet("scaling", gaps=THREE, c_H=c_h, **iron)


@pytest.fixture(scope="module")
def loops(truth: Model) -> Loops:
    return loops_of(truth, samples=40)


@pytest.fixture(scope="module")
def free(loops: Loops) -> SearchState:
    return search_each_gap(
        PaperSearch(run_of(loops), loops, SearchEffort(generations=100, final_evaluations=150))
    )


@pytest.fixture(scope="module")
def reduced(loops: Loops, free: SearchState) -> list[SearchState]:
    bench = PaperSearch(
        run_of(loops), loops, SearchEffort(generations=50, final_evaluations=120, trial_evaluations=30)
    )
    return [free, *(stand for stand, _ in reduce_gap_dependence(bench, free))]


@pytest.fixture(scope="module")
def quick(two_gaps: Loops) -> IdentifyResult:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper_sequence, "SearchEffort", lambda: SHORT)
        return identify(two_gaps, search="paper", offsets=False)


@pytest.fixture(scope="module")
def two_gaps() -> Loops:
    return loops_of(magnet("scaling", gaps=GAPS[:2], in_0=0.0, out_0=0.0), samples=25)


@pytest.fixture
def records(loops: Loops) -> FitRecords:
    return make_fit_records(loops)


def test_free_sets_reproduce_the_loops_of_every_gap(free: SearchState) -> None:
    assert free.cost < 1e-3
    assert free.varying == SEVEN_NAMES


def test_free_sets_scatter_along_the_redundancy(free: SearchState) -> None:
    """As in Fig. 1: the iron is the same at every gap, but k scatters."""
    k = [one["k"] for one in free.sets]
    assert max(k) > 1.5 * min(k)


def test_if_only_c_h_varies_freezing_the_others_costs_nothing(reduced: list[SearchState]) -> None:
    assert max(stand.cost for stand in reduced[1:]) < 1e-5


def test_if_only_c_h_varies_it_is_the_last_free_parameter(reduced: list[SearchState]) -> None:
    assert [len(stand.varying) for stand in reduced] == [7, 6, 5, 4, 3, 2, 1]
    assert reduced[-1].varying == ("c_H",)


def test_c_h_is_found_up_to_one_common_factor(truth: Model, reduced: list[SearchState]) -> None:
    found = np.array([one["c_H"] for one in reduced[-1].sets])
    ratio = found / truth.interpolate_parameter("c_H", THREE)
    np.testing.assert_allclose(ratio / ratio[0], 1.0, rtol=1e-4)


def test_frozen_parameters_are_equal_at_every_gap(reduced: list[SearchState]) -> None:
    for stand in reduced[1:]:
        for name in set(SEVEN_NAMES) - set(stand.varying):
            assert len({one[name] for one in stand.sets}) == 1


def test_a_parameter_can_be_excluded_from_freezing(two_gaps: Loops) -> None:
    found = search_paper(run_of(two_gaps), two_gaps, "reluctance", LEAST)
    assert len(found.steps) == 6
    assert all("alpha" not in step.candidates for step in found.steps)
    assert found.model.varying in {("alpha",), ("rho",)}


def test_alpha_is_read_as_a_reluctance_in_the_law_that_allows_it(two_gaps: Loops) -> None:
    form = make_response_form(two_gaps.input, two_gaps.output, "jiles-atherton-1986")
    run = SearchRun(form=form, records=make_fit_records(two_gaps), seed=1, fixed=NO_OFFSETS)
    found = search_paper(run, two_gaps, "reluctance", SearchEffort(20, 20, 5))
    assert found.model.law == "jiles-atherton-1986"
    assert found.model.gap_map == "free"
    assert found.model.varying == ("alpha",)


def test_one_call_gives_model_steps_and_free_sets(quick: IdentifyResult) -> None:
    model = quick.model
    assert len(model.varying) == 1
    assert len(model.reduction) == 6
    for step, left in zip(model.reduction, range(7, 1, -1), strict=True):
        assert len(step.candidates) == left
        assert step.frozen in step.candidates
    assert quick.per_gap is not None
    assert set(quick.per_gap.varying) == set(SEVEN_NAMES)
    assert quick.per_gap.gap_map == "free"
    assert quick.splines is not None
    assert model.fit is not None
    assert model.fit.mean_abs < 0.01 * model.fit.largest_output
    assert quick.evaluations > 1000


def test_cost_of_the_last_step_is_that_of_the_model(quick: IdentifyResult, two_gaps: Loops) -> None:
    outputs = np.concatenate(quick.fitted)
    reported = mean_deviation(make_fit_records(two_gaps), outputs)
    assert reported == pytest.approx(quick.model.reduction[-1].cost_after, rel=0.02)


@pytest.fixture(scope="module")
def whole(two_gaps: Loops) -> Outcome:
    return search_paper(run_of(two_gaps), two_gaps, "auto", LEAST)


@pytest.mark.parametrize("stage", [5, *(pytest.param(one, marks=pytest.mark.slow) for one in (1, 20))])
def test_a_killed_run_resumes_to_the_same_result(
    stage: int, two_gaps: Loops, whole: Outcome, tmp_path: Path
) -> None:
    kept = tmp_path / "checkpoint"

    def killed(done: float, total: float) -> None:
        if done == stage:
            raise RuntimeError("killed")

    with pytest.raises(RuntimeError):
        search_paper(run_of(two_gaps, checkpoint=kept, progress=killed), two_gaps, "auto", LEAST)
    again = run_of(two_gaps, checkpoint=kept)
    found = search_paper(again, two_gaps, "auto", LEAST)
    assert again.resumed_stages == stage
    assert found.model.parameters == whole.model.parameters
    assert found.steps == whole.steps


def test_equal_seeds_give_equal_models_and_other_seeds_others(two_gaps: Loops) -> None:
    def found(seed: int) -> tuple[Parameters, ...]:
        run = run_of(two_gaps)
        run.seed = seed
        return search_each_gap(PaperSearch(run, two_gaps, LEAST)).sets

    assert found(1) == found(1)
    assert found(1) != found(2)


def test_progress_ends_at_the_total_it_promised(two_gaps: Loops) -> None:
    seen: list[tuple[int, int]] = []
    run = run_of(two_gaps, held=frozenset(), progress=lambda *stage: seen.append(stage))
    search_paper(run, two_gaps, "scaling", LEAST)
    assert [done for done, _ in seen] == list(range(1, len(seen) + 1))
    assert {total for _, total in seen} == {len(seen)}


@pytest.mark.parametrize(("stage", "frozen"), [(4, 0), (16, 1)])
def test_ctrl_c_returns_the_best_result_so_far(stage: int, frozen: int, two_gaps: Loops) -> None:
    run = run_of(two_gaps, progress=stopper(stage))
    found = search_paper(run, two_gaps, "auto", LEAST)
    assert found.is_interrupted
    assert len(found.steps) == frozen
    assert found.model.gap_map == "free"
    assert len(found.model.varying) == 7 - frozen


def test_ctrl_c_before_every_gap_is_fitted_gives_no_result(two_gaps: Loops) -> None:
    run = run_of(two_gaps, progress=stopper(1))
    with pytest.raises(KeyboardInterrupt):
        search_paper(run, two_gaps, "auto", LEAST)


def test_offsets_become_common_to_all_gaps(two_gaps: Loops) -> None:
    run = run_of(two_gaps, held=frozenset())
    found = search_each_gap(PaperSearch(run, two_gaps, LEAST))
    for name in ("in_0", "out_0"):
        assert found.sets[0][name] == found.sets[1][name] != 0.0


def test_without_reduction_everything_stays_free(two_gaps: Loops) -> None:
    found = search_paper(run_of(two_gaps), two_gaps, "free", LEAST)
    assert found.steps == ()
    assert found.model.gap_map == "free"
    assert set(found.model.varying) == set(SEVEN_NAMES)


def test_one_gap_gives_a_model_of_that_gap() -> None:
    loops = loops_of(magnet("none", in_0=0.0, out_0=0.0), samples=30)
    found = search_paper(run_of(loops), loops, "auto", LEAST)
    assert found.model.gap_map == "none"
    assert found.per_gap is None
    assert found.steps == ()


def test_a_measured_field_and_flux_density_leave_five() -> None:
    loops = loops_of(core(in_0=0.0, out_0=0.0), samples=40)
    found = search_paper(run_of(loops), loops, "auto", SearchEffort(150, 150, 5))
    assert found.model.parameters["c_H"] == found.model.parameters["c_out"] == 1.0
    modelled = [found.model.predict(loop.input, history=loop.history).output for loop in loops.loops]
    assert mean_deviation(make_fit_records(loops), np.concatenate(modelled)) < 2e-3


def test_a_known_parameter_cannot_be_kept_variable(two_gaps: Loops) -> None:
    by_field = Loops(two_gaps.loops, core().input, two_gaps.output, two_gaps.schedule)
    with refused("choices-together: c_H"):
        search_paper(run_of(by_field), by_field, "scaling")


def test_a_gap_map_needs_two_gaps() -> None:
    loops = loops_of(magnet("none"), samples=30)
    with refused("single-gap"):
        search_paper(run_of(loops), loops, "scaling")


def test_splines_meet_the_nodes_and_overshoot_between() -> None:
    values = (100.0, 5000.0, 100.0, 100.0)
    model = magnet("scaling", c_H=values)
    for gap, value in zip(GAPS, values, strict=True):
        at = spline_model_at(model, gap)
        assert at.parameters["c_H"] == pytest.approx(value)
        assert at.gap_map == "none"
    with refused("out-of-range c_H"):
        spline_model_at(model, 0.55e-3)


def test_splines_need_two_nodes() -> None:
    with refused("single-gap"):
        spline_model_at(magnet("none"), 0.4e-3)


def test_the_acceptance_test_reports_which_gaps_fail_with_splines(quick: IdentifyResult) -> None:
    check = quick.splines
    assert check is not None
    assert set(check.failing) <= set(check.gaps.tolist())
    assert bool(check.failing) == (not check.passed)


def test_a_common_gauge_does_not_change_the_law() -> None:
    other = SET | {"M_s": 9e5, "a": 2e3, "k": 1e3, "c_H": 3e4, "c_out": 90.0}
    moved = move_to_one_gauge([SET, other], SEVEN_NAMES, power=2)
    assert len({one["M_s"] for one in moved}) == 1
    for before, after in zip([SET, other], moved, strict=True):
        assert after["a"] == pytest.approx(COMMON_AIR_CORE_SLOPE * after["M_s"])
        old, new = make_parameter_set(before, 2), make_parameter_set(after, 2)
        for name in ("kappa", "c", "omega", "scale", "gain", "in_0", "out_0"):
            assert getattr(new, name) == pytest.approx(getattr(old, name), rel=1e-12)


def test_a_common_gauge_keeps_parameters_fixed_by_measurements() -> None:
    plain = SET | {"c_H": 1.0, "c_out": 1.0}
    moved = move_to_one_gauge([plain], ("M_s", "a", "alpha", "k", "c"), power=1)[0]
    for name, value in plain.items():
        assert moved[name] == pytest.approx(value, rel=1e-12)


def test_scales_are_averaged_geometrically_and_the_rest_plainly() -> None:
    assert mean_over_gaps("k", [1.0, 100.0]) == pytest.approx(10.0)
    assert mean_over_gaps("alpha", [-0.1, 0.3]) == pytest.approx(0.1)


def test_coordinates_and_parameters_agree(loops: Loops, records: FitRecords) -> None:
    variables, known = make_variables(records, loops.input, loops.output, frozenset())
    assert known == {}
    back = variables.to_parameters(variables.to_coordinates(SET))
    for name, value in SET.items():
        assert float(back[name]) == pytest.approx(value, rel=1e-12)
    assert variables.restrict_to(["c_H", "k"]).names == ("k", "c_H")


def test_batch_and_exact_law_cost_the_same(loops: Loops, records: FitRecords) -> None:
    rng = np.random.default_rng(3)
    count = 20
    many = {name: value * (1.0 + 0.1 * rng.random(count)) for name, value in SET.items()}
    form = make_response_form(loops.input, loops.output, "effective-field")
    criterion = Criterion(form, records.at_gap(0))
    batch = criterion.costs_of_sets(many)
    exact = [
        criterion.cost_of_set({name: float(many[name][place]) for name in many}) for place in range(count)
    ]
    np.testing.assert_allclose(batch, exact, atol=5e-3)
    assert criterion.evaluations == 2 * count


def test_unsolvable_parameters_have_a_very_large_cost(loops: Loops, records: FitRecords) -> None:
    form = make_response_form(loops.input, loops.output, "effective-field")
    criterion = Criterion(form, records.at_gap(0))
    impossible = SET | {"k": 1e-9}
    assert criterion.cost_of_set(impossible) == UNSOLVED_COST
    assert criterion.costs_of_sets({n: np.array([v]) for n, v in impossible.items()})[0] == np.inf


def test_gauge_free_form_has_no_trace_of_the_redundancy() -> None:
    q = 3.0
    same = SET | {name: q * SET[name] for name in ("M_s", "a", "k", "c_H")}
    same["c_out"] = SET["c_out"] / q**2
    one, other = (
        to_gauge_free({name: np.asarray(value) for name, value in values.items()}, 2)
        for values in (SET, same)
    )
    for name, value in one.items():
        np.testing.assert_allclose(other[name], value, rtol=1e-12)
