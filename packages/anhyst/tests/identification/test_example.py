"""The bundled example, whose iron is not a Jiles-Atherton material, tested at unmeasured gaps."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst.data import Loops
from anhyst.data.reading import read_loops
from anhyst.identification import IdentifyResult, identify
from anhyst.model.actuator import Model
from anhyst.model.schema import FitFigures
from anhyst.support.numeric import FloatArray
from tests.identification.truths import largest, predicted
from tests.repository import ROOT
from tests.truths import truth as kept

FOLDER = ROOT / "examples" / "electromagnet"


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def loops() -> Loops:
    return read_loops(FOLDER / "loops.csv")


@pytest.fixture(scope="module")
def truth() -> Loops:
    return read_loops(FOLDER / "unseen_truth.csv")


@pytest.fixture(scope="module")
def chosen(loops: Loops) -> IdentifyResult:
    return identify(loops)


def fit_of(result: IdentifyResult) -> FitFigures:
    assert result.model.fit is not None
    return result.model.fit


def mean_error(model: Model, truth: Loops) -> float:
    error = [
        np.abs(output - loop.output)
        for output, loop in zip(predicted(model, truth), truth.loops, strict=True)
    ]
    return float(np.mean(np.concatenate(error))) / largest(truth)


def best_single_valued(truth: Loops) -> float:
    """Return the error of a smooth single-valued curve, even if it is fitted to the truth."""
    off: list[FloatArray] = []
    for gap in truth.schedule_values:
        drive = np.concatenate([loop.input for loop in truth.at(gap).loops])
        force = np.concatenate([loop.output for loop in truth.at(gap).loops])
        curve = np.polynomial.Polynomial.fit(drive, force, 12)
        off.append(np.abs(curve(drive) - force))
    return float(np.mean(np.concatenate(off))) / largest(truth)


def test_auto_selects_reluctance_and_gives_the_reason(chosen: IdentifyResult) -> None:
    assert chosen.model.gap_map == "reluctance"
    left_out = fit_of(chosen).left_out
    assert set(left_out) == {"scaling", "reluctance", "circuit"}
    assert min(left_out, key=lambda name: left_out[name]) == "reluctance"
    why = chosen.model.provenance.settings["gap_map_reason"]
    assert "'reluctance' predicts withheld gaps" in str(why)
    assert not chosen.interrupted


def test_unseen_gaps_are_predicted_within_a_third_of_a_percent(chosen: IdentifyResult, truth: Loops) -> None:
    assert mean_error(chosen.model, truth) < 0.0035


def test_scaling_alone_predicts_them_within_half_a_percent(truth: Loops) -> None:
    assert mean_error(kept("electromagnet-play-cells-scaling"), truth) < 0.005


def test_the_model_beats_the_best_single_valued_curve(chosen: IdentifyResult, truth: Loops) -> None:
    assert mean_error(chosen.model, truth) < 0.25 * best_single_valued(truth)


def test_the_force_rises_as_the_gap_closes(chosen: IdentifyResult) -> None:
    assert fit_of(chosen).monotone is True
    check = chosen.model.check_over_gap()
    assert check is not None
    assert check.passed
    assert check.gaps[0] == pytest.approx(0.3e-3)
    assert check.gaps[-1] == pytest.approx(0.6e-3)


def test_the_closed_gap_can_be_computed(chosen: IdentifyResult) -> None:
    force = chosen.model.predict(np.linspace(0.0, 1.0, 50), 0.0).output
    assert np.isfinite(force).all()


def test_the_model_predicts_the_fitted_outputs(chosen: IdentifyResult, loops: Loops) -> None:
    for one, other in zip(predicted(chosen.model, loops), chosen.fitted, strict=True):
        assert np.abs(one - other).max() < 1e-8 * largest(loops)


@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.campaign)])
def test_every_seed_gives_the_same_residual(chosen: IdentifyResult, loops: Loops, seed: int) -> None:
    other = identify(loops, law=chosen.model.law, gap_map="reluctance", seed=seed)
    assert fit_of(other).rms == pytest.approx(fit_of(chosen).rms, rel=0.01)


def test_the_selected_map_needs_few_evaluations(chosen: IdentifyResult) -> None:
    assert chosen.evaluations < 300
