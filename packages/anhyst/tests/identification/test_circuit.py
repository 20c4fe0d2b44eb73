"""The gap map ``circuit``: one iron, and a gap that is not a simple reluctance."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from anhyst.data import Loops
from anhyst.identification import IdentifyResult, identify
from anhyst.laws.jiles_atherton import PARAMETERS
from anhyst.model.actuator import Model, read_model
from anhyst.model.writer import write_model
from tests.identification.truths import GAPS, loops_of, magnet, worst
from tests.refusals import refused

GAP = np.array(GAPS)


@cache
def truth() -> Model:
    plain = magnet("reluctance")
    around = {
        "c_out": tuple((60.0 + 4e4 * (GAP - GAP[0])).tolist()),
        "in_0": tuple((0.015 - 40.0 * (GAP - GAP[0])).tolist()),
        "out_0": tuple((-0.4 + 800.0 * (GAP - GAP[0])).tolist()),
    }
    return replace(plain, parameters=dict(plain.parameters) | around, gap_map="circuit")


@cache
def loops() -> Loops:
    return loops_of(truth(), "conditioned", samples=60)


@cache
def found(gap_map: str) -> IdentifyResult:
    law = "effective-field"
    return identify(loops(), law=law, gap_map=gap_map, dead_band=False)  # the truth has none


@pytest.mark.slow
def test_the_circuit_map_fits_loops_that_simpler_maps_cannot() -> None:
    ours = worst(loops(), found("circuit").fitted)
    assert ours < 2e-3
    assert ours < 0.1 * min(worst(loops(), found(name).fitted) for name in ("scaling", "reluctance"))


def test_the_iron_does_not_depend_on_the_gap() -> None:
    model = found("circuit").model
    assert set(model.varying) == {"rho", "c_out", "in_0", "out_0"}
    assert not set(model.varying) & {spec.name for spec in PARAMETERS}
    assert not model.needs_fixed_gap
    assert min(np.atleast_1d(model.parameters["rho"])) >= 0.0
    moving = np.linspace(GAPS[0], GAPS[-1], 50)
    expected = np.linspace(2.0, 40.0, 50)
    answer = model.invert(expected, moving, history="demagnetised")
    back = model.predict(answer.drive, moving, history="demagnetised")
    assert np.allclose(back.output, expected, atol=1e-6)


def test_the_withheld_error_is_reported() -> None:
    fit = found("circuit").model.fit
    assert fit is not None
    assert 0.0 < fit.left_out["circuit"] < 5e-3


def test_offsets_can_be_fixed_at_zero() -> None:
    model = identify(loops(), law="effective-field", gap_map="circuit", offsets=False).model
    assert not np.any(model.parameters["in_0"])
    assert not np.any(model.parameters["out_0"])


def test_the_file_keeps_it(tmp_path: Path) -> None:
    model = found("circuit").model
    write_model(model, tmp_path / "model.toml")
    again = read_model(tmp_path / "model.toml")
    assert again.gap_map == "circuit"
    assert dict(again.parameters) == dict(model.parameters)


def test_the_circuit_map_is_refused_with_incompatible_options() -> None:
    with refused("choices-together"):
        identify(loops(), gap_map="circuit", search="paper")
    with refused("choices-together"):
        identify(loops(), gap_map="circuit", law="jiles-atherton-1986")
