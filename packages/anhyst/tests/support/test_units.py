"""Units and column headers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from anhyst.support.units import QUANTITIES, UNITS, join_header, parse_header, require_unit, split_header
from tests.refusals import refused


@pytest.mark.parametrize(
    ("text", "quantity", "one_in_si"),
    [
        ("I_A", "current", 1.0),
        ("I_mA", "current", 1e-3),
        ("I [A]", "current", 1.0),
        ("I (kA)", "current", 1e3),
        ("H_A_per_m", "field", 1.0),
        ("H_kA_per_m", "field", 1e3),
        ("H [kA/m]", "field", 1e3),
        ("H (Oe)", "field", 1000.0 / (4.0 * math.pi)),
        ("u_V", "voltage", 1.0),
        ("U_mV", "voltage", 1e-3),
        ("F_N", "force", 1.0),
        ("Force (kN)", "force", 1e3),
        ("B_mT", "flux_density", 1e-3),
        ("B [G]", "flux_density", 1e-4),
        ("psi_mWb", "flux_linkage", 1e-3),
        ("psi [V s]", "flux_linkage", 1.0),
        ("x_um", "displacement", 1e-6),
        ("x [µm]", "displacement", 1e-6),
        ("gap_mm", "gap", 1e-3),
        ("Gap mm", "gap", 1e-3),
        ("air gap (mm)", "gap", 1e-3),
        ("T_C", "temperature", 1.0),
        ("T [°C]", "temperature", 1.0),
        ("t_ms", "time", 1e-3),
        ("gap_inch", "gap", 0.0254),
        ('gap (")', "gap", 0.0254),
        ("gap [thou]", "gap", 2.54e-5),
        ("x [micron]", "displacement", 1e-6),
        ("F_kgf", "force", 9.80665),
        ("F [kg]", "force", 9.80665),
        ("F (kp)", "force", 9.80665),
        ("Force [lbf]", "force", 4.4482216152605),
        ("F (Newtons)", "force", 1.0),
        ("F [MN]", "force", 1e6),
        ("F [mN]", "force", 1e-3),
        ("B (Gauss)", "flux_density", 1e-4),
        ("B_kilogauss", "flux_density", 0.1),
        ("H [A m^-1]", "field", 1.0),
        ("H (kA.m⁻¹)", "field", 1e3),
        ("H_A_per_meter", "field", 1.0),
        ("H (amperes per metre)", "field", 1.0),
        ("psi [volt-seconds]", "flux_linkage", 1.0),
        ("Zeit [ms]", "time", 1e-3),
        ("tout", "time", 1.0),
        ("Spulenstrom [mA]", "current", 1e-3),
        ("Intensité (A)", "current", 1.0),
        ("Corriente (A)", "current", 1.0),
        ("Kracht [kN]", "force", 1e3),
        ("Tension [N]", "force", 1.0),
        ("Tension bobine (V)", "voltage", 1.0),
        ("Luchtspleet [mm]", "gap", 1e-3),
        ("Déplacement (µm)", "displacement", 1e-6),
        ("Flussdichte [mT]", "flux_density", 1e-3),
        ("Température (°C)", "temperature", 1.0),
    ],
)
def test_header_names_quantity_and_unit(text: str, quantity: str, one_in_si: float) -> None:
    header = parse_header(text)
    assert header.problem is None
    assert header.quantity == QUANTITIES[quantity]
    assert header.unit is not None
    assert header.unit.value_to_si(1.0) == pytest.approx(one_in_si, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    ["Hall voltage [V]", "Load cell (V)", "Spannung Kraftaufnehmer [mV]", "gap displacement [mm]",
     "Feld [T]", "Strom", "coil current", "I_in [V]", "CH1 (V)", "Channel A", "speed [A/s]"],
)  # fmt: skip
def test_word_without_its_unit_is_not_read(text: str) -> None:
    assert not (header := parse_header(text)).is_known or header.problem is not None


def test_case_of_symbols_counts() -> None:
    assert parse_header("I [ma]").problem is not None
    assert parse_header("I [MA]").problem is not None
    assert parse_header("I [MILLIAMPS]").unit == UNITS["mA"]


def test_kelvin_becomes_degrees_celsius() -> None:
    header = parse_header("T_K")
    assert header.unit is not None
    assert header.unit.value_to_si(273.15) == 0.0


def test_a_unit_row_completes_a_bare_name() -> None:
    header = parse_header("gap", "mm")
    assert header.problem is None
    assert header.unit == UNITS["mm"]


@pytest.mark.parametrize("text", ["gap", "I", "F", "T", "t", "B"])
def test_known_quantity_without_unit_is_a_problem_with_advice(text: str) -> None:
    problem = parse_header(text).problem
    assert problem is not None
    assert "has no unit; call it" in problem
    assert f"'{text}_" in problem


def test_gap_without_unit_is_reported_metres_or_millimetres() -> None:
    assert parse_header("gap").problem == "has no unit; call it 'gap_m' or 'gap_mm'"


@pytest.mark.parametrize("text", ["I_foo", "I [foo]", "I (foo)", "gap_furlong"])
def test_unknown_unit_is_named(text: str) -> None:
    problem = parse_header(text).problem
    assert problem is not None
    assert problem.startswith("unknown unit")


def test_near_unit_is_suggested() -> None:
    with refused("unknown-unit: 'kA/n'; kA/m"):
        require_unit("kA/n")


def test_unit_of_another_kind_is_a_problem() -> None:
    problem = parse_header("I_V").problem
    assert problem == "'V' is a unit of voltage, not of current; write 'I_A'"


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("U_M_V", "U_M", "V"),
        ("nominal_Hmax_A_per_m", "nominal_Hmax", "A/m"),
        ("bmax_T", "bmax", "T"),
        ("pressure [bar]", "pressure", "Pa"),
        ("V_in", "V_in", "1"),
        ("z_hat", "z_hat", "1"),
    ],
)
def test_unknown_names_become_new_quantities(text: str, name: str, unit: str) -> None:
    header = parse_header(text)
    assert header.quantity is not None
    assert (header.quantity.name, header.quantity.unit) == (name, unit)
    assert not header.is_known


def test_loop_is_the_label() -> None:
    assert parse_header("loop").is_label


def test_millimetres_become_the_nearest_float() -> None:
    values = np.array([0.3, 0.35, 0.7, 1.1, 0.125])
    metres = UNITS["mm"].to_si(values)
    assert metres.tolist() == [0.0003, 0.00035, 0.0007, 0.0011, 0.000125]


@pytest.mark.parametrize(
    ("name", "value", "text"), [("gap", 3e-4, "gap 0.3 mm"), ("temperature", -15.0, "temperature -15 °C")]
)
def test_values_are_shown_with_readable_units(name: str, value: float, text: str) -> None:
    assert QUANTITIES[name].show(value) == text


@pytest.mark.parametrize(
    ("name", "unit", "header"),
    [
        ("I", "A", "I_A"),
        ("H", "kA/m", "H_kA_per_m"),
        ("spindle torque", "Nm", "spindle torque [Nm]"),
        ("load cell", "N", "load cell [N]"),
        ("count", "", "count"),
    ],
)
def test_a_name_and_a_unit_survive_a_header(name: str, unit: str, header: str) -> None:
    assert join_header(name, unit) == header
    found, written = split_header(header)
    assert (found, written.replace("_per_", "/")) == (name, unit)


@pytest.mark.parametrize("unit", ["A", "[A]", "-"])
def test_a_unit_that_repeats_the_one_of_the_name_is_no_other(unit: str) -> None:
    header = parse_header("I_A", unit)
    assert (header.quantity, header.problem) == (QUANTITIES["current"], None)
    assert parse_header("I_A", "mA").problem == "its name says A, its unit mA"
