"""Check that virtual plants obey physics, independently of models."""

from __future__ import annotations

import math

import numpy as np
import pytest

from anhyst._core import Coil, HeldPlant
from anhyst.support.numeric import FloatArray, first_order_share
from anhyst.support.units import MU_0
from anhyst_rigs.rig.force.file import ForceControlRig, read_rig
from anhyst_rigs.rig.parts.iron import CellSteel
from anhyst_rigs.rig.parts.magnet import CircuitTable, FluxPath, make_solenoid_magnet
from anhyst_rigs.rig.sensor_table import NoisySensor
from tests.oracles.cell_iron import CellIron
from tests.oracles.held import OracleSensor, currents
from tests.oracles.solenoid import OracleGap, OracleSolenoid
from tests.repository import ROOT

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


def test_iron_saturates_at_the_sum_of_its_terms() -> None:
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
    assert heat > 100.0  # J/m^3 per cycle
    iron.demagnetise()
    assert iron.flux_density(0.0)[0] == 0.0


def solenoid() -> Coil:
    return Coil(make_solenoid_magnet(STEEL, PATH, CIRCUIT))


@pytest.mark.parametrize("gap", GAPS)
def test_the_force_of_a_solenoid_is_the_derivative_of_its_coenergy(gap: float) -> None:
    """Its flux also fits the ampere-turns, with and without a saturated cone; computed
    independently."""
    ours, again, rng = solenoid(), OracleSolenoid(STEEL, PATH, CIRCUIT), np.random.default_rng(1)
    for current in (1.2, 0.0, *rng.uniform(-1.2, 1.2, 30).tolist()):
        expected = again.step(current, gap)
        assert ours.hold(current, gap) == pytest.approx(expected, rel=1e-6, abs=1e-6)
        assert ours.psi == pytest.approx(CIRCUIT.turns * again.flux, rel=1e-9, abs=1e-9)
        assert ours.density == pytest.approx(MU_0 * again.mmf / gap, rel=1e-8, abs=1e-9)
    assert expected > 0.0


@pytest.mark.parametrize("gap", GAPS)
def test_jumps_into_and_out_of_a_saturated_cone_are_solved(gap: float) -> None:
    """Newton steps from there may alternate between both ends."""
    other = {"face_area_m2": 6e-6, "leakage_H": 0.0, "cone_clearance_m": 1e-4}
    circuit = CIRCUIT.model_copy(update=other)
    ours, again = (Coil(make_solenoid_magnet(STEEL, PATH, circuit)), OracleSolenoid(STEEL, PATH, circuit))
    for current in (1.2, 0.0, 4.0, -4.0, 0.01, -1.2, 0.3):
        expected = again.step(current, gap)
        assert ours.hold(current, gap) == pytest.approx(expected, rel=1e-5, abs=1e-6)
        assert ours.density == pytest.approx(MU_0 * again.mmf / gap, rel=1e-6, abs=1e-8)


def test_a_plunger_in_front_of_a_sharp_edge_is_pulled_as_by_one_that_is_hardly_blunt() -> None:
    sharp, blunt = (
        Coil(make_solenoid_magnet(STEEL, PATH, CIRCUIT.model_copy(update={"cone_onset_m": onset})))
        for onset in (1e-12, 1e-7)
    )
    for current in (1.2, 0.0, 0.5):
        pull = blunt.hold(current, CIRCUIT.cone_depth_m + 1e-3)
        assert sharp.hold(current, CIRCUIT.cone_depth_m + 1e-3) == pytest.approx(pull, rel=1e-6)
    assert pull > 0.1


def test_a_solenoid_may_be_stepped_coarsely_and_in_both_directions_of_the_gap() -> None:
    coarse, fine = solenoid(), solenoid()
    coarse.hold(1.0, 1e-3)
    for share in np.linspace(0.02, 1.0, 50).tolist():
        fine.hold(share, 1e-3)
    assert coarse.force == pytest.approx(fine.force, rel=1e-9)
    nearer = coarse.hold(1.0, 0.8e-3)
    assert nearer > fine.force
    assert coarse.hold(1.0, 1e-3) > fine.force  # the iron remembers the former flux


def test_energy_of_a_solenoid_is_conserved() -> None:
    """In the last of three closed cycles; the heat is computed from field and flux density."""
    samples, h = 2000, 1e-4
    coil, turn = solenoid(), 2.0 * np.pi * np.arange(3 * samples + 1) / samples
    gap = 1.6e-3 + 0.6e-3 * np.sin(turn)
    rows = []
    for voltage, at in zip((5.0 * np.sin(turn)).tolist(), gap.tolist(), strict=True):
        coil.step(voltage, at, h)
        rows.append((coil.current, coil.psi, coil.density * at / MU_0, coil.force, coil.energy))
    current, psi, over, force, energy = np.array(rows)[-samples - 1 :].T
    flux, gap = psi / CIRCUIT.turns, gap[-samples - 1 :]
    in_iron = CIRCUIT.turns * current - CIRCUIT.slide_reluctance_per_H * flux - over
    heat = float(0.5 * (in_iron[1:] + in_iron[:-1]) @ np.diff(flux))
    work = -float(0.5 * (force[1:] + force[:-1]) @ np.diff(gap))
    ends = [
        flux[n] * over[n]
        - OracleGap(CIRCUIT, gap[n]).coenergy(over[n])
        + 0.5 * CIRCUIT.slide_reluctance_per_H * flux[n] ** 2
        for n in (0, -1)
    ]
    assert heat > 1e-3
    assert abs(work) > heat
    assert energy[-1] - energy[0] - heat - work - (ends[1] - ends[0]) == pytest.approx(0.0, abs=2e-3 * heat)


@pytest.fixture(scope="module")
def rig() -> ForceControlRig:
    return read_rig(ROOT / "examples" / "solenoid" / "rig.toml")


def test_amplifier_and_sensors_of_a_held_actuator_agree_with_independent_code_bit_for_bit(
    rig: ForceControlRig,
) -> None:
    rng, ticks = np.random.default_rng(2), 400
    reference = np.repeat(rng.uniform(-0.2, 1.5, ticks // 20), 20)  # also beyond both ends
    gap, noise = rng.uniform(1e-3, 3e-3, ticks), 1e-3 * rng.standard_normal((ticks, 3))
    found = rig.make_plant().run(reference, gap, noise)
    assert found[:, 0].tolist() == currents(rig.amplifier_parameters(), reference)
    magnet = rig.magnet()
    assert found[:, 1].tolist() == [
        magnet.hold(*one) for one in zip(found[:, 0].tolist(), gap.tolist(), strict=True)
    ]
    quantities = {"gap": gap, "force": found[:, 1], "current": found[:, 0]}
    for n, (name, values) in enumerate(quantities.items()):
        sensor = OracleSensor(rig.sensor_parameters(rig.dt)[name])
        pairs = zip(values.tolist(), noise[:, n].tolist(), strict=True)
        assert found[:, 2 + n].tolist() == [sensor.read(*pair) for pair in pairs], name
    assert found[:, 0].max() < 1.2  # the zero of its shunt is an error of the current
    assert (found[:, 0] == 0.0).any()  # the current is never negative


def test_an_amplifier_is_late_by_a_tick_follows_and_keeps_its_limits(rig: ForceControlRig) -> None:
    def step(**changes: float) -> FloatArray:
        plant = HeldPlant(
            rig.amplifier_parameters() | changes,
            [*rig.sensor_parameters(rig.dt).values()],
            make_solenoid_magnet(STEEL, PATH, CIRCUIT),
        )
        return plant.run(np.full(60, 1.0), np.full(60, 1e-3), np.zeros((60, 3)))[:, 0]

    slow = step(share=0.25, most=1e9, zero=0.0)
    assert slow[:2].tolist() == [0.0, 0.0]
    # quantised by the converter
    assert slow[2:5] == pytest.approx([0.25, 0.4375, 0.578125], abs=3e-4)
    limited = step(share=1.0, most=0.02, zero=0.0)
    assert limited[2:] == pytest.approx(np.minimum(0.02 * np.arange(1, 59), 1.0), abs=3e-4)
    assert step(share=1.0, most=1e9, zero=0.004)[-1] == pytest.approx(0.996, abs=3e-4)


def test_a_sensor_has_its_stated_noise_offset_and_lag() -> None:
    numbers = {"low": -10.0, "high": 10.0, "step": 20.0 / (2**24 - 1), "gain": 1.0, "share": 1.0}
    noisy = numbers | {"offset": 0.1, "noise": 0.2, "delay": 0}
    many = NoisySensor(noisy, [5]).read(np.ones(20_000))
    # depends on the seed
    assert many[:1].tolist() == NoisySensor(noisy, [5]).read(np.ones(1)).tolist()
    assert many.mean() == pytest.approx(1.1, abs=0.01)
    assert many.std() == pytest.approx(0.2, rel=0.03)
    assert NoisySensor(noisy, [6]).read(np.ones(1))[0] != many[0]
    lag = noisy | {"noise": 0.0, "offset": 0.0, "share": first_order_share(1e-3 / 0.01), "delay": 2}
    values = np.concatenate([[0.0], np.ones(12)])
    late = NoisySensor(lag, [1]).read(values)
    assert late[:3].tolist() == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert late[-1] == pytest.approx(1.0 - math.exp(-1.0), abs=1e-6)
