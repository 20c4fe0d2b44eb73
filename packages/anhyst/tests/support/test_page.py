"""Numbers in reports have few digits and a unit of suitable size."""

from __future__ import annotations

import doctest
import math

import pytest

from anhyst.support import page
from anhyst.support.page import (
    choose_scale,
    format_deviation,
    format_number,
    format_percent,
    quantity_scale,
    typeset,
)
from anhyst.support.units import QUANTITIES


def test_examples_in_the_docstrings_hold() -> None:
    assert doctest.testmod(page).attempted > 0
    assert doctest.testmod(page).failed == 0


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (9.996, "10.0"),
        (-0.05, "−0.0500"),
        (123456.0, "123456"),
        (1.2e9, "1.2×10⁹"),
        (-3e-7, "−3×10⁻⁷"),
        (math.nan, "–"),
        (math.inf, "∞"),
    ],
)
def test_numbers_keep_their_significant_digits(value: float, text: str) -> None:
    assert format_number(value) == text


@pytest.mark.parametrize(
    ("unit", "value", "text"),
    [
        ("m", 0.3e-3, "0.3\xa0mm"),
        ("m", 12e-6, "12\xa0µm"),
        ("m", 0.0, "0\xa0mm"),
        ("A/m", 1e6, "1\xa0MA/m"),
        ("T", 0.00529, "5.29\xa0mT"),
        ("N", 291.5, "292\xa0N"),
        ("degC", -38.0, "−38\xa0°C"),
        ("1", 0.2, "0.2"),
        ("furlong", 3e7, "3×10⁷\xa0furlong"),
    ],
)
def test_units_fit_the_size_of_the_value(unit: str, value: float, text: str) -> None:
    assert choose_scale(unit, [value]).format_with_unit(value, is_short=True) == text


def test_displacements_are_reported_in_micrometres_and_gaps_in_millimetres() -> None:
    assert quantity_scale(QUANTITIES["displacement"], [123e-6]).unit == "µm"
    assert quantity_scale(QUANTITIES["gap"], [123e-6]).unit == "mm"


def test_a_missing_value_is_a_dash() -> None:
    assert choose_scale("N", [None]).format_with_unit(None) == "–"
    assert format_percent(None) == "–"


def test_an_estimate_has_no_more_digits_than_its_deviation() -> None:
    assert format_deviation(21557.4, 9284.0) == "21557 ± 9284"
    assert format_deviation(-0.00123456, 0.000021) == "−0.001235 ± 0.000021"
    assert format_deviation(-0.0001, 0.011) == "0.000 ± 0.011"
    assert format_deviation(2.0, math.nan) == "2.00 ± –"


def test_texts_of_the_model_file_are_set_for_reading() -> None:
    assert typeset("(w*M_s)/a at temperature -5 °C") == "(w·M_s)/a at temperature −5\xa0°C"
