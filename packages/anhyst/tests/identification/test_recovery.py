"""Loops of a known model lead back to that model."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst.data import Loops
from anhyst.identification import IdentifyResult, identify
from anhyst.identification.default_search import FoundModel, join_gaps, search_each_gap, search_one_gap
from anhyst.identification.fit_records import make_fit_records
from anhyst.identification.model_building import make_model, make_response_form
from anhyst.identification.objective import Objective
from anhyst.model.actuator import Model
from anhyst.model.parameters import GapMap
from anhyst.model.schema import Uncertainty
from tests.identification.truths import (
    GAPS,
    HISTORIES,
    apart,
    core,
    gauge_free,
    largest,
    loops_of,
    magnet,
    noisy,
    predicted,
    worst,
)
from tests.refusals import refused

TRUTHS: dict[str, Model] = {
    "force at one gap": magnet("none"),
    "flux linkage at one gap": magnet("none", "flux_linkage"),
    "force, scaling": magnet("scaling"),
    "flux density, scaling": magnet("scaling", "flux_density"),
    "force, reluctance": magnet("reluctance"),
    "flux density, reluctance": magnet("reluctance", "flux_density"),
    "force, two gaps": magnet("reluctance", gaps=GAPS[1:3]),
    "closed core": core(),
}
NOISE = 2e-3
NAMES = ("kappa", "c", "omega", "scale", "gain", "in_0", "out_0")
PER_GAP: dict[GapMap, str] = {"none": "", "scaling": "scale", "reluctance": "omega"}


def wanted_map(model: Model) -> str:
    return "auto" if model.gap_map == "none" else model.gap_map


AGAIN = [pytest.mark.slow, pytest.mark.campaign]
SEEDS = [
    ("settled", 1),
    pytest.param("demagnetised", 4, marks=pytest.mark.slow),
    pytest.param("conditioned", 4, marks=pytest.mark.slow),
    pytest.param("settled", 2, marks=AGAIN),
    pytest.param("settled", 3, marks=AGAIN),
]


@pytest.mark.first(2)
@pytest.mark.parametrize(("history", "seed"), SEEDS)
@pytest.mark.parametrize("name", TRUTHS)
def test_the_truth_behind_clean_loops_is_found_from_every_seed(name: str, history: str, seed: int) -> None:
    truth = TRUTHS[name]
    loops = loops_of(truth, history, samples=48)
    result = identify(loops, gap_map=wanted_map(truth), seed=seed)
    assert worst(loops, result.fitted) < 1e-9
    assert apart(result.model, truth, loops) < 1e-9
    assert result.model.gap_map == truth.gap_map


@pytest.mark.slow
@pytest.mark.parametrize("history", ["settled", pytest.param("demagnetised", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "truth",
    [
        core("jiles-atherton-1986"),
        magnet("none", law="jiles-atherton-1986", alpha=-0.004, a=1004.0, k=702.8, rho=0.0),
        pytest.param(magnet("scaling", gaps=GAPS[:2], law="jiles-atherton-1986"), marks=pytest.mark.slow),
    ],
    ids=["closed core", "force at one gap", "scaling"],
)
def test_the_law_of_1986_is_found_too(truth: Model, history: str) -> None:
    loops = loops_of(truth, history, samples=48)
    result = identify(loops, law="jiles-atherton-1986", gap_map=wanted_map(truth))
    assert worst(loops, result.fitted) < 1e-9
    assert apart(result.model, truth, loops) < 1e-9
    assert result.model.law == "jiles-atherton-1986"
    other = identify(loops, law="effective-field", gap_map=wanted_map(truth))
    assert worst(loops, other.fitted) > 1e-4  # the laws differ


@pytest.mark.slow
@pytest.mark.parametrize("gap_map", ["none", "scaling"])
def test_both_laws_are_identified_equally_without_a_reversible_part(gap_map: GapMap) -> None:
    truth = magnet(gap_map, c=0.0, gaps=GAPS[:2])
    loops = loops_of(truth, "demagnetised", samples=48)
    laws: tuple[str, ...] = ("effective-field", "jiles-atherton-1986")
    ends = [identify(loops, law=law, gap_map=wanted_map(truth)) for law in laws]
    for end in ends:
        assert end.model.parameters["c"] == pytest.approx(0.0, abs=1e-9)
        assert worst(loops, end.fitted) < 1e-6
    assert apart(ends[0].model, ends[1].model, loops) < 1e-4


@pytest.mark.slow
@settings(max_examples=15)
@given(
    kappa=st.floats(0.1, 3.0),
    c=st.floats(0.0, 0.9),
    omega=st.floats(-2.0, 100.0),
    reach=st.floats(1.5, 12.0),
    history=st.sampled_from(["settled", "demagnetised"]),
)
def test_cores_of_every_kind_are_found(
    kappa: float, c: float, omega: float, reach: float, history: str
) -> None:
    """Narrow and wide loops, sheared and steep ones, driven to the knee and far beyond."""
    drawn = reach + omega * (1.0 / np.tanh(reach) - 1.0 / reach)
    a = 120.0 / max(drawn, 0.2 * reach)
    truth = core(M_s=1e6, a=a, k=kappa * a, c=c, alpha=-omega * a / 1e6, in_0=0.0, out_0=0.0)
    loops = loops_of(truth, history)
    result = identify(loops)
    assert result.model.fit is not None
    assert result.model.fit.rms < 2e-3 * largest(loops)
    assert worst(loops, predicted(result.model, loops)) < 1e-2


@pytest.mark.first(2)
@pytest.mark.parametrize("name", ["closed core", "force, reluctance", "flux density, scaling"])
def test_the_residual_equals_the_noise(name: str) -> None:
    truth = TRUTHS[name]
    loops = loops_of(truth, noise=NOISE, seed=3)
    result = identify(loops, gap_map=wanted_map(truth), dead_band=False)  # the truth has none either
    assert result.model.fit is not None
    assert result.model.fit.rms == pytest.approx(NOISE * largest(result.loops), rel=0.1)
    clean = loops_of(truth)
    assert worst(clean, predicted(result.model, clean)) < 1.5 * NOISE


def truths_in_order(truth: Model) -> list[float]:
    sets = gauge_free(truth)
    return [
        getattr(local, name)
        for name in NAMES
        for local in (sets if name == PER_GAP[truth.gap_map] else sets[:1])
    ]


@cache
def scores(name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return the errors relative to the stated standard deviations; one row per noise seed."""
    truth = TRUTHS[name]
    clean = loops_of(truth)
    rows = []
    for seed in range(20):
        loops = noisy(clean, NOISE, seed)
        result = identify(
            loops, law="effective-field", gap_map=wanted_map(truth), dead_band=False
        )  # the truth has none
        reported = uncertainty_of(result)
        error = np.array(reported.values) - np.array(truths_in_order(truth))
        rows.append(error / np.array(reported.std))
    return np.array(rows)


def uncertainty_of(result: IdentifyResult) -> Uncertainty:
    assert result.model.uncertainty is not None
    return result.model.uncertainty


@pytest.mark.slow
@pytest.mark.parametrize("name", ["closed core", "force, two gaps"])
def test_the_truth_lies_within_the_reported_uncertainty(name: str) -> None:
    assert np.mean(np.abs(scores(name)) > 3.0) < 0.03
    assert np.abs(scores(name)).max() < 4.5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["closed core", pytest.param("force, two gaps", marks=pytest.mark.slow)])
def test_the_reported_uncertainty_is_not_too_large(name: str) -> None:
    spread = np.sqrt(np.mean(scores(name) ** 2, axis=0))
    assert spread.min() > 0.5
    assert spread.max() < 1.6


def test_uncertainty_grows_with_the_noise_and_shrinks_with_samples() -> None:
    few = uncertainty_of(identify(loops_of(core(), noise=NOISE, samples=60)))
    noise = uncertainty_of(identify(loops_of(core(), noise=4.0 * NOISE, samples=60)))
    many = uncertainty_of(identify(loops_of(core(), noise=NOISE, samples=960)))
    assert noise.std[0] == pytest.approx(4.0 * few.std[0], rel=0.35)
    assert many.std[0] == pytest.approx(few.std[0] / 4.0, rel=0.35)


def test_parameters_that_loops_do_not_determine_are_reported() -> None:
    reported = uncertainty_of(identify(loops_of(magnet(), noise=NOISE), gap_map="reluctance"))
    assert any("not separable" in text for text in reported.statements)
    assert any("air core" in text for text in reported.statements)
    assert any("alpha and an offset of rho" in text for text in reported.statements)
    size = len(reported.names)
    matrix = np.array(reported.correlation)
    assert matrix.shape == (size, size)
    assert np.allclose(np.diag(matrix), 1.0)
    assert np.allclose(matrix, matrix.T, atol=1e-9)
    assert np.abs(matrix).max() < 1.0 + 1e-9


def test_flux_over_field_determines_the_air_core() -> None:
    reported = uncertainty_of(identify(loops_of(core(), noise=NOISE)))
    assert not any("air core" in text for text in reported.statements)


@pytest.mark.first(4)
@pytest.mark.parametrize("in_0", [-0.1, 0.0, 0.06])
@pytest.mark.parametrize("out_0", [-3.0, 0.0, 8.0])
def test_offsets_are_found(in_0: float, out_0: float) -> None:
    loops = loops_of(magnet("none", in_0=in_0, out_0=out_0))
    found = identify(loops).model.parameters
    assert found["in_0"] == pytest.approx(in_0, abs=1e-9)
    assert found["out_0"] == pytest.approx(out_0, abs=1e-7)


def test_offsets_are_zero_if_they_are_disabled() -> None:
    loops = loops_of(core(in_0=2.0, out_0=0.02))
    held = identify(loops, law="effective-field", offsets=False)
    assert held.model.parameters["in_0"] == held.model.parameters["out_0"] == 0.0
    assert len(uncertainty_of(held).names) == 5
    assert worst(loops, held.fitted) > 10 * worst(loops, identify(loops).fitted)
    centred = loops_of(core(in_0=0.0, out_0=0.0))
    assert worst(centred, identify(centred, offsets=False).fitted) < 1e-9


def test_the_slope_of_the_air_core_hardly_matters_for_a_force() -> None:
    """Identification chooses it; a truth with another slope is still fitted far below any noise."""
    truth = magnet("none", a=500.0, k=350.0, c_H=2e3, rho=0.003)
    loops = loops_of(truth)
    assert worst(loops, identify(loops).fitted) < 2e-4


def test_fit_metrics_agree_with_the_fitted_loops() -> None:
    result = identify(loops_of(magnet(), noise=NOISE), gap_map="reluctance")
    fit = result.model.fit
    assert fit is not None
    error = [out - loop.output for out, loop in zip(result.fitted, result.loops.loops, strict=True)]
    whole = np.concatenate(error)
    assert fit.rms == pytest.approx(float(np.sqrt(np.mean(whole**2))))
    assert fit.mean_abs == pytest.approx(float(np.mean(np.abs(whole))))
    assert fit.worst == float(np.abs(whole).max())
    assert fit.largest_output == largest(result.loops)
    for row, one, loop in zip(fit.loops, error, result.loops.loops, strict=True):
        assert (row.label, row.schedule, row.samples) == (loop.label, loop.schedule_value, loop.n)
        assert row.rms == pytest.approx(float(np.sqrt(np.mean(one**2))))


def fit_alone(loops: Loops, gap_map: GapMap) -> FoundModel:
    """Search under one map, without selection and withheld data."""
    form, records = (
        make_response_form(loops.input, loops.output, "effective-field"),
        make_fit_records(loops),
    )
    none: frozenset[str] = frozenset()
    if gap_map == "free":
        return search_each_gap(form, records, 1, none)
    home = search_one_gap(form, records.at_gap(records.reference_gap), 1, none)
    return home if gap_map == "none" else join_gaps(form, records, gap_map, home.parameter_sets, none)


@pytest.mark.parametrize("history", HISTORIES)
@pytest.mark.parametrize("gap_map", ["none", "scaling", "reluctance", "free"])
def test_the_model_predicts_the_fitted_outputs(gap_map: GapMap, history: str) -> None:
    """The fit uses gauge-free equations of its own."""
    source: GapMap = "reluctance" if gap_map == "free" else gap_map
    loops = loops_of(magnet(source, gaps=GAPS[:2]), history, noise=NOISE, samples=48)
    found = fit_alone(loops, gap_map)
    fitted = Objective(found.space).outputs(found.parameter_sets)
    again = np.concatenate(predicted(make_model(found, loops), loops))
    assert np.abs(again - fitted).max() < 1e-8 * largest(loops)


def test_the_law_of_1986_is_refused_under_reluctance() -> None:
    law: str = "jiles-atherton-1986"
    loops = loops_of(magnet("scaling", gaps=GAPS[:2], law=law), "demagnetised")
    with refused("choices-together"):
        identify(loops, law=law, gap_map="reluctance")


@pytest.mark.slow
def test_the_law_of_1986_chooses_scaling_over_reluctance() -> None:
    law: str = "jiles-atherton-1986"
    loops = loops_of(magnet("scaling", gaps=GAPS[:2], law=law), "demagnetised")
    assert identify(loops, law=law).model.gap_map == "scaling"


@pytest.mark.parametrize("history", HISTORIES)
def test_fitted_loops_keep_the_order_of_the_set(history: str) -> None:
    loops = loops_of(magnet(gaps=GAPS[:2]), history, samples=48)
    shuffled = replace(loops, loops=loops.loops[::-1])
    result = identify(shuffled, gap_map="reluctance")
    assert worst(shuffled, result.fitted) < 1e-8


def test_fit_metrics_use_settled_inner_loops() -> None:
    """Steep, wide loops need hundreds of simple repetitions to close."""
    truth = core(M_s=1e6, a=157.0, k=509.0, c=0.15, alpha=3.3e-4, in_0=0.0, out_0=0.0)
    loops = loops_of(truth)
    again = loops_of(truth, "settled", samples=160)
    result = identify(loops)
    assert worst(loops, result.fitted) < 1e-8
    assert worst(again, predicted(result.model, again)) < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, 1e-3])
def test_a_coordinate_at_its_bound_does_not_end_the_search(offset: float) -> None:
    """Without a reversible part, most of the search is at c = 0."""
    truth = core(M_s=1e6, a=4.1, k=1.29, c=offset, alpha=-3.78e-4, in_0=0.0, out_0=0.0)
    loops = loops_of(truth)
    for seed in range(2):
        assert worst(loops, identify(loops, seed=seed).fitted) < 1e-6
