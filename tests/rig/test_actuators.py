"""The virtual plants follow physics, whatever a model says of them."""

from __future__ import annotations

import doctest
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from anhyst.rig.parts import sensors
from anhyst.rig.parts.iron import CellSteel
from anhyst.rig.parts.sensors import Amplifier, Converter, Lag, Sensor
from anhyst.rig.parts.solenoid import CircuitTable, FluxPath, Solenoid
from anhyst.support.numeric import passed
from anhyst.support.units import MU_0
from tests.oracles.cell_iron import CellIron

STEEL = CellSteel(
    cells=12,
    reversible_fraction=0.25,
    pinning_scale_A_per_m=300.0,
    pinning_shape=2.5,
    saturation_sharp_T=1.15,
    knee_sharp_A_per_m=330.0,
    saturation_slow_T=0.9,
    knee_slow_A_per_m=5000.0,
)
PATH = FluxPath(length_m=0.13, area_m2=2.3e-4)
CIRCUIT = CircuitTable(
    turns=900,
    slide_reluctance_per_H=2.2e5,
    leakage_H=6e-8,
    face_area_m2=0.6e-4,
    fringe=0.5,
    cone_diameter_m=0.016,
    cone_clearance_m=0.4e-3,
    cone_depth_m=3.2e-3,
    cone_onset_m=1e-3,
    tip_thickness_m=2.2e-3,
    tip_taper=0.45,
    tip_saturation_T=1.7,
)
GAPS = (0.8e-3, 1.5e-3, 2.8e-3)


def walk(iron: CellIron, fields: list[float]) -> list[float]:
    densities = []
    for field in fields:
        densities.append(iron.flux_density(field)[0])
        iron.commit(field)
    return densities


def test_weights_of_the_cells_add_up_to_one() -> None:
    assert STEEL.weights.sum() == pytest.approx(1.0, abs=1e-15)
    assert STEEL.thresholds[0] == 0.0
    assert (np.diff(STEEL.thresholds) > 0.0).all()


def test_iron_saturates_at_what_its_parts_add_up_to() -> None:
    density = CellIron(STEEL).flux_density(1e9)[0]
    assert density == pytest.approx(MU_0 * 1e9 + 1.15 + 0.9, abs=1e-5)


def test_a_minor_loop_of_cells_closes_at_once_and_is_wiped_out_by_a_larger_one() -> None:
    iron = CellIron(STEEL)
    first, _, again = walk(iron, [800.0, 200.0, 800.0])
    assert again == first
    straight, nested = CellIron(STEEL), CellIron(STEEL)
    walk(nested, [800.0, 200.0, 600.0, 300.0])
    assert nested.flux_density(1500.0)[0] == pytest.approx(straight.flux_density(1500.0)[0])


def test_the_way_may_be_cut_anywhere() -> None:
    whole, cut = CellIron(STEEL), CellIron(STEEL)
    walk(whole, [900.0])
    walk(cut, list(np.linspace(0.0, 900.0, 37)[1:]))
    assert cut.flux_density(900.0)[0] == whole.flux_density(900.0)[0]


def test_the_slope_is_that_of_the_way_ahead() -> None:
    iron = CellIron(STEEL)
    walk(iron, [700.0])
    for field in (690.0, 400.0, -300.0, 900.0):
        ahead = 1e-3 * math.copysign(1.0, field - 700.0)
        change = iron.flux_density(field + ahead)[0] - iron.flux_density(field)[0]
        assert iron.flux_density(field)[1] == pytest.approx(change / ahead, rel=1e-4)


def test_a_loop_of_iron_costs_energy() -> None:
    iron = CellIron(STEEL)
    cycle = 1000.0 * np.sin(np.linspace(0.0, 4.0 * np.pi, 2001))
    density = np.array(walk(iron, cycle.tolist()))
    field, loop = cycle[1000:], density[1000:]
    heat = np.sum(0.5 * (field[1:] + field[:-1]) * np.diff(loop))
    assert heat > 100.0  # J/m^3 a cycle
    iron.demagnetise()
    assert iron.flux_density(0.0)[0] == 0.0


@pytest.mark.parametrize("gap", GAPS)
def test_flux_and_ampere_turns_of_the_gap_invert_each_other(gap: float) -> None:
    place = Solenoid(STEEL, PATH, CIRCUIT)._gap(gap)
    for mmf in (-700.0, -1.0, 0.0, 20.0, 900.0, 3000.0):
        flux, slope = place.flux(mmf)
        found, inverse = place.mmf(flux)
        assert found == pytest.approx(mmf, rel=1e-9, abs=1e-9)
        assert inverse == pytest.approx(1.0 / slope, rel=1e-6)


@pytest.mark.parametrize("gap", GAPS)
def test_the_force_is_the_coenergy_that_the_gap_gives_up(gap: float) -> None:
    solenoid = Solenoid(STEEL, PATH, CIRCUIT)

    def coenergy(at: float, mmf: float) -> float:
        place = solenoid._gap(at)
        return float(quad(lambda u: place.flux(u)[0], 0.0, mmf, epsabs=1e-14)[0])

    step = 1e-7
    for mmf in (100.0, 500.0, 900.0):
        slope = (coenergy(gap + step, mmf) - coenergy(gap - step, mmf)) / (2.0 * step)
        assert solenoid._gap(gap).force(mmf) == pytest.approx(-slope, rel=1e-5)


@pytest.mark.parametrize("gap", GAPS)
def test_the_ampere_turns_of_a_step_are_used_up(gap: float) -> None:
    ours, rng = Solenoid(STEEL, PATH, CIRCUIT), np.random.default_rng(1)
    before = CellIron(STEEL)
    for current in rng.uniform(0.0, 1.2, 30).tolist():

        def excess(field: float, iron: CellIron = before, drive: float = current) -> float:
            flux = PATH.area_m2 * iron.flux_density(field)[0]
            outside = ours._gap(gap).mmf(flux)[0]
            used = PATH.length_m * field + CIRCUIT.slide_reluctance_per_H * flux + outside
            return CIRCUIT.turns * drive - used

        ours.step(current, gap)
        wanted = brentq(excess, -1e5, 1e5, xtol=1e-10)
        assert ours.iron.field == pytest.approx(wanted, abs=1e-5)
        before.commit(wanted)


def test_a_solenoid_may_be_stepped_coarsely_and_in_both_directions_of_the_gap() -> None:
    coarse, fine = Solenoid(STEEL, PATH, CIRCUIT), Solenoid(STEEL, PATH, CIRCUIT)
    coarse.step(1.0, 1e-3)
    for share in np.linspace(0.02, 1.0, 50):
        fine.step(share, 1e-3)
    assert coarse.force == pytest.approx(fine.force, rel=1e-9)
    nearer = coarse.step(1.0, 0.8e-3)
    assert nearer > fine.force
    assert coarse.step(1.0, 1e-3) > fine.force  # what the flux was, the iron remembers


def test_a_converter_gives_the_nearest_of_its_values() -> None:
    converter = Converter.of_bits(-1.0, 2.0, 4)
    values = -1.0 + converter.step * np.arange(16)
    for value in np.linspace(-1.5, 2.5, 401).tolist():
        held = min(max(value, -1.0), 2.0)
        assert abs(converter(value) - held) <= 0.5 * converter.step + 1e-12
        assert np.abs(values - converter(value)).min() < 1e-12


def test_a_sensor_has_the_noise_offset_and_lag_that_it_says() -> None:
    fine = Converter.of_bits(-10.0, 10.0, 24)
    numbers = {"low": -10.0, "high": 10.0, "step": fine.step, "gain": 1.0, "share": 1.0}
    noisy = numbers | {"offset": 0.1, "noise": 0.2}
    readings = np.array([Sensor(noisy, 5).read(1.0)] * 1)
    sensor = Sensor(noisy, 5)
    many = np.array([sensor.read(1.0) for _ in range(20_000)])
    assert many[0] == readings[0]  # the seed decides
    assert many.mean() == pytest.approx(1.1, abs=0.01)
    assert many.std() == pytest.approx(0.2, rel=0.03)
    assert Sensor(noisy | {"offset": 0.0}, 6).read(1.0) != many[0]
    lag = Lag(passed(1e-3 / 0.01))
    assert lag(0.0) == 0.0
    assert [lag(1.0) for _ in range(10)][-1] == pytest.approx(1.0 - math.exp(-1.0))


def test_an_amplifier_is_late_by_a_tick_follows_and_keeps_its_limits() -> None:
    tau, dt = 2e-3, 1e-3
    slow = Amplifier(Converter.of_bits(0.0, 2.0, 20), 1.0 / (2.0 * math.pi * tau), 1e9, 0.0, dt)
    assert slow.tick(1.0) == 0.0
    assert slow.tick(1.0) == pytest.approx(1.0 - math.exp(-dt / tau), abs=1e-5)
    limited = Amplifier(Converter.of_bits(0.0, 2.0, 20), 1e6, 100.0, 0.0, dt)
    limited.tick(5.0)
    steps = [limited.tick(5.0) for _ in range(40)]
    assert steps[0] == pytest.approx(0.1)
    assert steps[-1] == pytest.approx(2.0)


def test_the_zero_of_the_shunt_is_an_error_of_the_current_but_none_below_zero() -> None:
    wrong = Amplifier(Converter.of_bits(0.0, 2.0, 20), 1e6, 1e9, 0.004, 1e-3)
    for _ in range(3):
        wrong.tick(1.0)
    assert wrong.current == pytest.approx(0.996, abs=1e-5)
    for _ in range(3):
        wrong.tick(0.0)
    assert wrong.current == 0.0


def test_examples_in_the_docstrings() -> None:
    assert doctest.testmod(sensors).failed == 0
