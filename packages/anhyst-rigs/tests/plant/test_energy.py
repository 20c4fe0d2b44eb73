"""Check that the electrical energy of a magnet equals heat plus mechanical work."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst._core import Coil
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.parts.iron import CellSteel
from anhyst_rigs.rig.parts.magnet import Poles, make_iron_magnet
from anhyst_rigs.rig.stage.file import read_stage
from tests.plant.oracle import Ledger, Shape, middles
from tests.plant.rigs import GAP, OPEN_LOOP, bearing, example_poles, example_steel
from tests.repository import ROOT

SHAPE, STEEL = Shape(), example_steel()
STAGE = ROOT / "examples" / "stage" / "rig.toml"


@pytest.mark.first(5)
@pytest.mark.parametrize(
    ("mean", "swing", "moves", "phase", "gives"),
    [
        pytest.param(2.0, 1.5, 0.0, 0.0, 0, id="current alone"),
        pytest.param(2.8, 0.0, 0.08e-3, 0.0, 0, id="gap alone"),
        pytest.param(2.0, 1.5, 0.08e-3, 0.5 * math.pi, 1, id="a motor"),
        pytest.param(2.0, 1.5, 0.08e-3, -0.5 * math.pi, -1, id="a generator"),
        pytest.param(2.8, 0.1, 0.01e-3, 1.0, 1, id="small"),
        pytest.param(0.0, 3.0, 0.05e-3, 0.4, 0, id="both signs"),
    ],
)
def test_over_a_closed_cycle_energy_is_heat_and_work(
    mean: float, swing: float, moves: float, phase: float, gives: int
) -> None:
    samples = 2000
    turn = 2.0 * math.pi * np.arange(2 * samples + 1) / samples
    current, gap = mean + swing * np.sin(turn), GAP + moves * np.sin(turn + phase)
    force, psi, _ = Coil(make_iron_magnet(example_poles(), STEEL, 0.0, GAP)).run(current, gap).T
    ledger = Ledger(SHAPE, STEEL, current, gap, psi)
    last = slice(samples, None)  # the first cycle starts from the demagnetised state
    electrical = float(middles(current[last]) @ np.diff(psi[last]))
    work = -float(middles(force[last]) @ np.diff(gap[last]))
    heat = ledger.heat[-1] - ledger.heat[samples]
    assert psi[samples] == pytest.approx(psi[-1], abs=1e-6)
    assert heat > 0.0
    assert electrical - work == pytest.approx(heat, rel=1e-3)
    if gives:
        assert gives * work > heat


@pytest.mark.parametrize("eddy_time", [0.0, 5e-5])
def test_stepped_in_time_energy_is_heat_and_work(eddy_time: float) -> None:
    """An alternating voltage is applied while the gap moves."""
    samples, period = 2000, 2e-2
    coil = Coil(make_iron_magnet(example_poles(), STEEL, eddy_time, GAP))
    h = period / samples
    turn = 2.0 * math.pi * np.arange(3 * samples) / samples
    gap = GAP + 0.05e-3 * np.sin(turn)
    rows = []
    for voltage, at in zip((3.0 + 25.0 * np.sin(turn)).tolist(), gap.tolist(), strict=True):
        coil.step(voltage, at, h)
        rows.append((coil.current, coil.psi, coil.force, coil.energy, coil.heat))
    current, psi, force, energy, heat = np.array(rows).T
    # An induced voltage drives eddy currents, as if the winding current were reduced by this share.
    share = Shape(eddy_time=eddy_time).eddy_turns / SHAPE.turns**2
    speed = np.gradient(psi, h)
    ledger = Ledger(SHAPE, STEEL, current - share * speed, gap, psi)
    work = -float(middles(force) @ np.diff(gap))
    parts = {
        "winding": heat[-1] - heat[0],
        "iron": ledger.heat[-1] - ledger.heat[0],
        "eddies": share * float(speed @ speed) * h,
        "stored": ledger.stored[-1] - ledger.stored[0],
        "work": work,
    }
    assert np.all(np.diff(heat) >= 0.0)
    assert parts["iron"] > 0.01 * abs(work)
    assert parts["eddies"] > 0.1 * parts["iron"] or eddy_time == 0.0
    balance = energy[-1] - energy[0] - sum(parts.values())
    assert abs(balance) < 1e-3 * parts["iron"]


def voice_coil() -> Poles:
    """Return an actuator with the core of the example, 20 N/A and 10 mH."""
    outer = example_poles().turns ** 2 / 10e-3
    bias = 20.0 * outer / example_poles().turns
    return replace(example_poles(), outer=outer, bias=bias, spring=bias**2 / outer)


def test_energy_of_a_voice_coil_is_conserved() -> None:
    """A voltage is applied during a motion; the heat is computed from field and flux density."""
    poles, samples, h = voice_coil(), 4000, 5e-6
    coil, at = Coil(make_iron_magnet(poles, STEEL, 0.0, GAP)), GAP + 0.2e-3
    turn = 2.0 * math.pi * np.arange(3 * samples) / samples
    gap = GAP + 0.2e-3 * np.cos(turn)
    coil.hold(0.0, at)
    rows = []
    for voltage, place in zip((25.0 * np.sin(turn)).tolist(), gap.tolist(), strict=True):
        coil.step(voltage, place, h)
        rows.append((coil.current, coil.psi, coil.force, coil.energy, coil.heat))
    current, psi, force, energy, heat = np.array(rows).T[:, samples:]
    gap = gap[samples:]
    density = psi / (poles.turns * poles.area)
    moved = poles.turns * current + poles.bias * (GAP - gap)
    field = (moved - poles.reluctance(GAP) * poles.area * density) / poles.iron_length
    core = poles.iron_length * poles.area * float(middles(field) @ np.diff(density))
    work = -float(middles(force) @ np.diff(gap))
    stored = 0.5 * poles.reluctance(GAP) * (poles.area * density) ** 2 + 0.5 * poles.spring * (
        (GAP - gap) ** 2
    )
    mutual = poles.bias * poles.area * density * (GAP - gap)
    kept = (stored - mutual)[-1] - (stored - mutual)[0]
    left = (energy - heat)[-1] - (energy - heat)[0] - core - work - kept
    assert force.min() < -20.0
    assert force.max() > 20.0
    assert core > 0.0
    assert abs(work) > core
    assert abs(left) < 1e-3 * core


@pytest.mark.parametrize("at", [GAP - 0.3e-3, GAP, GAP + 0.3e-3])
def test_a_voice_coil_of_soft_iron_makes_its_force_constant_wherever_it_is(at: float) -> None:
    soft = CellSteel(
        cells=1,
        reversible_fraction=1.0,
        pinning_scale_A_per_m=1e-3,
        pinning_shape=3.0,
        saturation_sharp_T=1.3,
        knee_sharp_A_per_m=1e-3,
        saturation_slow_T=1e-12,
        knee_slow_A_per_m=1.0,
    )
    current = np.linspace(-2.0, 2.0, 41)
    force, _, _ = Coil(make_iron_magnet(voice_coil(), soft, 0.0, GAP)).run(current, np.full(41, at)).T
    assert force == pytest.approx(20.0 * current, abs=1e-3 * 40.0)


@pytest.mark.slow
def test_over_a_cycle_of_a_stage_no_energy_is_lost_in_its_steps() -> None:
    """Two magnets and what moves between them, stepped as the example is: 5e-6 of the iron's heat,
    a quarter of it with twice as many steps."""
    rig = read_stage(STAGE)
    magnet = rig.settings.magnet
    steel = rig.settings.steel
    assert isinstance(steel, CellSteel)

    def balance(substeps: int) -> tuple[float, float, float]:
        """Return energy residual, heat of the iron and work of the third cycle, J."""
        step, period = rig.dt / substeps, 20e-3
        samples = round(period / step)
        turn = 2.0 * math.pi * np.arange(3 * samples + 1) / samples
        left_over, iron, work = 0.0, 0.0, 0.0
        for side in (1.0, -1.0):
            coil = Coil(make_iron_magnet(magnet.poles, steel, 0.0, rig.gap))
            gap = rig.gap + 20e-6 * side * np.cos(turn)
            coil.hold(2.0, float(gap[0]))
            rows = [(coil.current, coil.psi, coil.force, coil.energy, coil.heat)]
            voltage = 2.0 * SHAPE.resistance + 12.0 * side * np.cos(middles(turn))
            for u, at in zip(voltage.tolist(), gap[1:].tolist(), strict=True):
                coil.step(u, at, step)
                rows.append((coil.current, coil.psi, coil.force, coil.energy, coil.heat))
            current, psi, force, energy, heat = np.array(rows).T
            ledger = Ledger(SHAPE, steel, current, gap, psi)
            begin = 2 * samples
            done = -float(middles(force[begin:]) @ np.diff(gap[begin:]))
            warmed = ledger.heat[-1] - ledger.heat[begin]
            # The stored energy returns, except for the change of the mean current.
            kept = ledger.stored[-1] - ledger.stored[begin]
            left_over += energy[-1] - energy[begin] - (heat[-1] - heat[begin])
            left_over -= warmed + done + kept
            iron, work = iron + warmed, work + done
        return left_over, iron, work

    left_over, iron, work = balance(rig.settings.timing.substeps)
    assert work > 0.3 * iron > 0.0
    assert abs(left_over) < 5e-5 * iron
    assert abs(left_over) < 0.4 * abs(balance(rig.settings.timing.substeps // 2)[0])


def test_a_moving_bearing_keeps_its_energy() -> None:
    """The sub-steps balance winding, gravity and guide; end stops are excluded."""
    mass, damping = 2.0, 20.0
    plant = bearing(
        OPEN_LOOP
        | {
            "timing.rate_Hz": 200e3,
            "timing.substeps": 1,
            "body.gravity_m_per_s2": 71.0,
            "body.damping_N_s_per_m": damping,
        }
    )
    plant.place([GAP], [0.0])
    plant.hold(2.8, 0)
    rows = [(plant.gap, plant.velocity, plant.force, plant.current, plant.psi)]
    for tick in range(600):
        plant.advance([2.8 + 0.6 * math.cos(0.05 * tick)], 0.0)
        rows.append((plant.gap, plant.velocity, plant.force, plant.current, plant.psi))
    gap, velocity, force, current, psi = np.array(rows).T
    assert 0.36e-3 < np.min(gap) < np.max(gap) < 0.54e-3
    assert np.ptp(gap) > 5e-6
    ledger = Ledger(SHAPE, STEEL, current, gap, psi)
    electrical = float(middles(current) @ np.diff(psi))
    kinetic = 0.5 * mass * np.diff(velocity[[0, -1]] ** 2)[0]
    lifted = -mass * 71.0 * (gap[-1] - gap[0])
    guide = damping * float(middles(velocity) @ np.diff(gap))
    iron = ledger.heat[-1] - ledger.heat[0]
    field = ledger.stored[-1] - ledger.stored[0]
    assert iron > 0.0
    assert electrical == pytest.approx(kinetic + lifted + guide + iron + field, abs=1e-3 * iron)
    work = -float(middles(force) @ np.diff(gap))
    assert work == pytest.approx(kinetic + lifted + guide, abs=1e-4 * abs(work))


turning_points = st.lists(
    st.tuples(st.floats(-4.5, 4.5), st.floats(0.35e-3, 0.55e-3)), min_size=1, max_size=5
)
steels = st.builds(
    CellSteel,
    cells=st.integers(1, 40),
    reversible_fraction=st.floats(0.0, 1.0),
    pinning_scale_A_per_m=st.floats(1.0, 500.0),
    pinning_shape=st.floats(0.5, 5.0),
    saturation_sharp_T=st.floats(0.3, 1.5),
    knee_sharp_A_per_m=st.floats(50.0, 500.0),
    saturation_slow_T=st.floats(1e-9, 1.0),
    knee_slow_A_per_m=st.floats(1000.0, 5000.0),
)


def straight(turns: list[tuple[float, float]], samples: int) -> tuple[FloatArray, FloatArray]:
    """Return linear paths of current and gap between reversals and back."""
    ends = np.array([*turns, turns[0]])
    at = np.linspace(0.0, len(turns), samples * len(turns) + 1)
    current, gap = (np.interp(at, np.arange(len(ends)), ends[:, k]) for k in range(2))
    return current, gap


@settings(max_examples=40)
@given(steels, turning_points)
def test_no_path_of_current_and_gap_makes_energy(steel: CellSteel, turns: list[tuple[float, float]]) -> None:
    current, gap = straight(turns, 150)
    current, gap = np.tile(current, 2), np.tile(gap, 2)
    force, psi, _ = Coil(make_iron_magnet(example_poles(), steel, 0.0, GAP)).run(current, gap).T
    ledger = Ledger(SHAPE, steel, current, gap, psi)
    electrical = np.cumsum(middles(current) * np.diff(psi))
    work = -np.cumsum(middles(force) * np.diff(gap))
    spent = electrical - work - (ledger.stored[1:] - ledger.stored[0])
    # The flux linkage of the plant is accurate to 6 nWb.
    scale = 1e-12 + 1e-7 * np.max(np.abs(current))
    scale += 1e-3 * (np.max(ledger.stored) + ledger.heat[-1])
    assert np.all(np.isfinite(force))
    assert spent == pytest.approx(ledger.heat[1:] - ledger.heat[0], abs=scale)
    assert np.min(np.diff(spent)) > -scale
