"""Claims about published measurements; skipped if the files are missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anhyst.data import Loops
from anhyst.data.clean import clean
from anhyst.data.reading import read_loops
from anhyst.identification import IdentifyResult, identify
from anhyst.model.schema import FitFigures
from tests.identification.truths import predicted

pytestmark = pytest.mark.slow  # the measurements are not in the package
AGAIN = pytest.mark.campaign  # repeats another test with the same material

OPTIMUM = 0.021936834
"""Smallest sum of squares of the law without dead band for mnzn_hp_ferrite_4loops, T^2."""


def fit_of(result: IdentifyResult) -> FitFigures:
    assert result.model.fit is not None
    return result.model.fit


def relative_rms(result: IdentifyResult) -> float:
    return fit_of(result).rms / fit_of(result).largest_output


@pytest.fixture(scope="module")
def ferrite(measurements: Path) -> Loops:
    return read_loops(measurements / "ferrite_mnzn/mnzn_hp_ferrite_4loops.csv")


@pytest.fixture(scope="module")
def gapped_core(measurements: Path) -> Loops:
    return read_loops(
        measurements / "ferrite_core_gaps/loops_by_gap.csv", columns={"I_A_scaled": "I_A", "U_M_V": "psi_Wb"}
    )


@pytest.mark.parametrize(
    "seed", [pytest.param(one, marks=[pytest.mark.campaign] * (one > 2)) for one in range(10)]
)
def test_the_ferrite_is_fitted_to_the_optimum_of_the_law(ferrite: Loops, seed: int) -> None:
    result = identify(
        ferrite, law="effective-field", offsets=False, weights="points", seed=seed, dead_band=False
    )
    samples = sum(loop.n for loop in ferrite.loops)
    assert fit_of(result).rms ** 2 * samples == pytest.approx(OPTIMUM, rel=1e-6)
    assert relative_rms(result) < 0.0169
    assert result.evaluations < 100


def test_no_law_fits_the_ferrite_worse_with_offsets(ferrite: Loops) -> None:
    """Only required offsets are fitted, which may cost a little."""
    held, found = (
        {candidate.law: candidate.rms for candidate in fit_of(identify(ferrite, offsets=offsets)).candidates}
        for offsets in (False, True)
    )
    compared = held.keys() & found.keys()
    assert {"effective-field", "play-cells, 1 population"} <= compared
    assert all((found[law] or np.inf) <= 1.02 * (held[law] or 0.0) for law in compared)


def test_the_model_of_the_ferrite_predicts_its_loops(ferrite: Loops) -> None:
    result = identify(ferrite)
    again = predicted(result.model, ferrite)
    for one, other in zip(again, result.fitted, strict=True):
        assert np.abs(one - other).max() < 1e-8 * fit_of(result).largest_output


def test_the_gapped_core_is_fitted_by_reluctance(gapped_core: Loops) -> None:
    result = identify(gapped_core, gap_map="reluctance", output="flux_linkage")
    assert relative_rms(result) < 0.016
    assert fit_of(result).monotone is True
    rho = result.model.parameters["rho"]
    assert isinstance(rho, tuple)
    assert rho[0] < rho[1] < rho[2]


def test_auto_selects_a_series_gap_for_the_gapped_core(gapped_core: Loops) -> None:
    result = identify(gapped_core, output="flux_linkage")
    assert result.model.gap_map in {"reluctance", "circuit"}
    left_out = fit_of(result).left_out
    assert min(left_out, key=lambda name: left_out[name]) != "scaling"
    assert left_out["reluctance"] < 0.035


@pytest.mark.parametrize("place", [pytest.param(0, marks=pytest.mark.campaign), 1, 2])
def test_two_gaps_of_the_core_predict_the_third_in_its_place(gapped_core: Loops, place: int) -> None:
    """The loop at the third gap is between its neighbours, or beyond the outer one."""
    gaps = gapped_core.schedule_values
    model = identify(gapped_core.without(gaps[place]), gap_map="reluctance").model
    third = gapped_core.at(gaps[place]).loops[0]
    heights = [np.ptp(model.predict(third.input, gap, history="settled").output) for gap in gaps]
    assert heights[0] > heights[1] > heights[2]
    assert heights[place] == pytest.approx(np.ptp(third.output), rel=0.16)
    if place == 1:
        assert heights[1] == pytest.approx(np.ptp(third.output), rel=0.05)
        mean = float(np.mean(np.abs(predicted(model, gapped_core.at(gaps[1]))[0] - third.output)))
        assert mean < 0.035 * np.abs(third.output).max()


@pytest.mark.parametrize(
    ("name", "columns", "loop", "most"),
    [
        ("ferrite_mnzn/mnzn_ferrite_3loops.csv", None, None, 0.010),
        pytest.param("ferrite_mnzn/mnzn_ferrite_4loops.csv", None, None, 0.016, marks=AGAIN),
        ("steel_m130_27s/m130_27s_steel_raw_3loops.csv", None, None, 0.025),
        pytest.param("steel_m130_27s/m130_27s_steel_symmetrised_3loops.csv", None, None, 0.024, marks=AGAIN),
        ("steel_core1_dc/loops.csv", None, "nominal_Hmax_A_per_m", 0.016),
        ("steel_team32/loops.csv", {"bmax_T": "loop"}, None, 0.046),
    ],
)
def test_one_parameter_set_fits_all_loops_of_a_material(
    measurements: Path, name: str, columns: dict[str, str] | None, loop: str | None, most: float
) -> None:
    loops = read_loops(measurements / name, columns=columns, loop=loop)
    ends = [identify(loops, law="effective-field", seed=seed) for seed in (1, 2)]
    costs = [fit_of(end).rms for end in ends]
    assert relative_rms(ends[0]) < most
    assert max(costs) < (1.0 + 1e-5) * min(costs)


def test_gadolinium_is_a_schedule_over_temperature(measurements: Path) -> None:
    files = sorted((measurements / "gadolinium_temperature").glob("gd_T*.csv"))
    loops = clean(read_loops(files, file_name="gd_T{T_C}C"), ["dedupe", "spikes", "thin"])
    major = loops.with_loops(loop for loop in loops.loops if loop.label == "major")
    result = identify(major, gap_map="scaling")
    assert result.model.nodes == (-38.0, -25.0, -15.0, -5.0, 5.0, 15.0)
    assert fit_of(result).left_out["scaling"] < 0.05
    assert fit_of(result).monotone is None  # not a gap
    assert relative_rms(result) < 0.05
