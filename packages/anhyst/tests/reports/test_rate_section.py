"""The section about rate dependence: each speed, and the speed above which loops change."""

from __future__ import annotations

from dataclasses import replace

import pytest

from anhyst.data import Loops
from anhyst.data.speeds import select_slow_loops
from anhyst.data.verdict import assess_loops
from anhyst.model.acceptance import Acceptance
from anhyst.model.actuator import Model
from anhyst.model.dynamics import GAMMA_NAME, Dynamics, EddyCircuit
from anhyst.model.schema import Uncertainty
from anhyst.reports.sections_fit import rate_corner, section_rate
from anhyst.reports.sections_model import equations_markup
from anhyst.reports.subject import Measurements, ModelSubject
from anhyst.support.page import PageTable, Picture, Text
from tests.identification.test_rate import measured, truth


def known(gamma: float) -> Model:
    """A model with the range of its measurements and the uncertainty of gamma."""
    sure = Uncertainty(names=(GAMMA_NAME,), values=(gamma,), std=(0.05 * gamma,))
    return replace(truth(gamma), dynamics=Dynamics(fastest=50.0), uncertainty=sure)


def about(model: Model, loops: Loops) -> ModelSubject:
    fitted = tuple(
        model.predict(loop.input, loop.schedule, loop.time, loop.history).output for loop in loops.loops
    )
    measurements = Measurements(loops, fitted, None, assess_loops(loops), (), ())
    return ModelSubject(model, None, Acceptance(None, None), measurements)


def test_each_speed_has_a_row_and_the_corner_its_interval() -> None:
    model = known(5.0)
    section = section_rate(about(model, measured()))
    assert section is not None
    corner = rate_corner(model)
    assert corner is not None
    texts = [str(block) for block in section.blocks if isinstance(block, Text)]
    assert any(f"{corner:.3g}" in text and f"{corner * 2.718281828**0.1:.3g}" in text for text in texts)
    assert sum(isinstance(block, Picture) for block in section.blocks) == 1
    assert [len(block.rows) for block in section.blocks if isinstance(block, PageTable)] == [3]


def test_the_corner_is_in_inverse_proportion_to_gamma() -> None:
    once, twice = rate_corner(known(2.0)), rate_corner(known(4.0))
    assert once is not None
    assert twice == pytest.approx(once / 2.0, rel=0.02)


def test_loops_at_one_speed_have_no_section_on_rate() -> None:
    assert section_rate(about(known(5.0), select_slow_loops(measured()))) is None


def test_the_equations_contain_the_terms_of_an_eddy_circuit() -> None:
    model = replace(truth(6.0), layers=None, eddy_circuit=EddyCircuit(0.5, 1e-3, 20.0))
    text = equations_markup(ModelSubject(model, None, Acceptance(None, None), None))
    assert "0.5 d<i>Z</i>/d<i>t</i>" in text
    assert "± 20 √|" in text
