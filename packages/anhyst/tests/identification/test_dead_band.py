"""The dead band that protects a model's memory: used by default, as wide as the loops allow."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from anhyst.data import Loops
from anhyst.data.clean import ReadOptions
from anhyst.identification import IdentifyResult, identify
from anhyst.identification.model_building import DEAD_BAND_RATIOS, MAX_DEVIATION_RATIO
from tests.identification.truths import core, largest, loops_of, magnet, predicted
from tests.repository import ROOT

EXAMPLES = ROOT / "examples"


@cache
def example(name: str) -> Loops:
    return ReadOptions().read([EXAMPLES / name / "loops.csv"])


@cache
def found(name: str, *, dead_band: bool) -> IdentifyResult:
    return identify(example(name), law="effective-field", gap_map="reluctance", dead_band=dead_band)


def rms(result: IdentifyResult) -> float:
    assert result.model.fit is not None
    return result.model.fit.rms


def part_of_pinning(result: IdentifyResult) -> float:
    play, pinning = (np.asarray(result.model.parameters[name]) for name in ("r_d", "k"))
    return float(np.max(play / pinning))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["electromagnet", "bearing"])
def test_a_model_has_a_dead_band_that_costs_no_more_than_it_may(name: str) -> None:
    given, without = (found(name, dead_band=wanted) for wanted in (True, False))
    assert any(part_of_pinning(given) == pytest.approx(part) for part in DEAD_BAND_RATIOS)
    assert without.model.parameters["r_d"] == 0.0
    assert rms(given) < MAX_DEVIATION_RATIO * rms(without)
    again = predicted(given.model, given.loops)
    for one, other in zip(again, given.fitted, strict=True):
        assert np.abs(one - other).max() < 1e-8 * largest(given.loops)


@pytest.mark.slow
def test_the_model_reports_width_and_cost_of_the_dead_band() -> None:
    given, without = (found("electromagnet", dead_band=wanted) for wanted in (True, False))
    reported = str(given.model.provenance.settings["dead_band"])
    assert reported.startswith(f"r_d = {part_of_pinning(given):g}*k")
    change = 100.0 * (rms(given) / rms(without) - 1.0)
    assert float(reported.split()[-2]) == pytest.approx(change, abs=4.0)  # equal weights of the loops
    assert "not requested" in str(without.model.provenance.settings["dead_band"])
    for result in (given, without):
        assert result.model.uncertainty is not None
        assert result.model.uncertainty.names[0] == "k/a"


@pytest.mark.parametrize("law", ["effective-field", "jiles-atherton-1986"])
def test_loops_of_a_law_without_dead_band_allow_none(law: str) -> None:
    result = identify(loops_of(core(law), "demagnetised", samples=48), law=law)
    assert result.model.parameters["r_d"] == 0.0
    assert "by more than 3%" in str(result.model.provenance.settings["dead_band"])


@pytest.mark.parametrize("history", ["settled", "demagnetised"])
def test_a_true_dead_band_is_fitted_exactly(history: str) -> None:
    """Loops of a law with the widest tried dead band give its exact parameters."""
    plain = magnet(in_0=0.0, out_0=0.0)
    pinning = plain.parameters["k"]
    assert isinstance(pinning, float)
    truth = replace(plain, parameters={**plain.parameters, "r_d": DEAD_BAND_RATIOS[0] * pinning})
    loops = loops_of(truth, history)
    result = identify(loops, law="effective-field", gap_map="reluctance", offsets=False)
    assert part_of_pinning(result) == pytest.approx(DEAD_BAND_RATIOS[0])
    assert result.model.parameters["k"] == pytest.approx(pinning, rel=1e-4)
    assert rms(result) < 1e-6 * largest(loops)


@pytest.mark.slow
def test_the_law_of_1986_is_given_one_too() -> None:
    whole = example("bearing").at(example("bearing").schedule_values[0])
    one = whole.with_loops(whole.loops[:1])
    given, without = (identify(one, law="jiles-atherton-1986", dead_band=wanted) for wanted in (True, False))
    assert part_of_pinning(given) > 0.0
    assert rms(given) < MAX_DEVIATION_RATIO * rms(without)
