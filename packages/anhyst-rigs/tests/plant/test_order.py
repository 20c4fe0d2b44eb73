"""Check that half the sub-step divides the error by four."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from anhyst._core import Coil, Magnet
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.parts.magnet import make_flux_table, make_iron_magnet, make_law_magnet
from anhyst_rigs.rig.plant import make_plant
from tests.actuators import GAPS
from tests.actuators import magnet as model
from tests.plant.irons import STEELS
from tests.plant.oracle import OracleMagnet, Shape
from tests.plant.rigs import GAP, OPEN_LOOP, example_poles, example_steel, rig

EDDY = 20.0
"""Eddy-current coefficient of a law, A s/(m T)."""
VOLTAGES = ((60.0, 1.5e-3), (-40.0, 1.0e-3), (30.0, 1.0e-3))
"""V and s; the field reverses only at each jump."""


def stepped(magnet: Magnet, steps: int, start: float = 0.0) -> FloatArray:
    """Return flux linkage, current and pull after each voltage, with the given steps per 0.5 ms."""
    coil = Coil(magnet)
    coil.hold(start, GAP)
    rows = []
    for voltage, seconds in VOLTAGES:
        count = round(seconds / 0.5e-3) * steps
        for _ in range(count):
            coil.step(voltage, GAP, seconds / count)
        rows.append((coil.psi, coil.current, coil.force))
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.parametrize("eddy_time", [0.0, 1e-4])
def test_a_winding_agrees_with_independent_equations(eddy_time: float) -> None:
    oracle = OracleMagnet(Shape(eddy_time=eddy_time), example_steel())
    psi, rows = 0.0, []
    for voltage, seconds in VOLTAGES:
        psi, current = oracle.drive(psi, voltage, GAP, seconds)
        rows.append((psi, current, oracle.pull(psi / oracle.shape.turns, GAP)))
    expected = np.array(rows)
    magnet = make_iron_magnet(example_poles(), example_steel(), eddy_time, GAP)
    errors = [np.abs(stepped(magnet, steps) - expected) for steps in (10, 20, 40, 80)]
    for coarse, fine in itertools.pairwise(errors):
        assert np.all(coarse[:, :2] > 3.0 * fine[:, :2])
        assert np.all(coarse[:, :2] < 5.0 * fine[:, :2])
    assert np.all(errors[-1] < 5e-6 * np.max(expected, axis=0))
    if eddy_time:
        plain = stepped(make_iron_magnet(example_poles(), example_steel(), 0.0, GAP), 80)
        assert np.all(np.abs(plain - expected)[:, 1] > 0.05)


def law(eddy: float) -> Magnet:
    gaps = (GAPS[0], GAPS[-1])
    at = np.linspace(*gaps, 129)
    names = ("c_H", "rho", "c_out", "out_0", "in_0")
    rows = np.column_stack([model().interpolate_parameter(name, at) for name in names])
    table = make_flux_table(example_poles(), example_steel(), 6.0, gaps)
    return make_law_magnet(example_poles(), model().iron_at(GAP), rows, eddy, table)


@pytest.mark.parametrize("eddy", [0.0, EDDY])
def test_the_pull_of_a_law_converges_with_the_square_of_the_step(eddy: float) -> None:
    start = float(model().interpolate_parameter("in_0", np.array([GAP]))[0])
    magnet = law(eddy)
    finest = stepped(magnet, 2560, start)
    errors = [np.abs(stepped(magnet, steps, start) - finest)[:, 2] for steps in (10, 40, 160)]
    for coarse, fine in itertools.pairwise(errors):
        assert float(np.sum(coarse)) > 10.0 * float(np.sum(fine))
    assert np.all(errors[-1] < 1e-4 * np.max(finest[:, 2]))
    if eddy:
        assert np.all(np.abs(stepped(law(0.0), 2560, start) - finest)[:, 2] > 0.3)


def test_eddy_currents_of_a_law_agree_with_its_model() -> None:
    """The model uses backward steps of first order for the same currents."""
    with_eddies = replace(model(), parameters={**model().parameters, "gamma": EDDY})
    start = float(model().interpolate_parameter("in_0", np.array([GAP]))[0])
    off = []
    for steps in (200, 400):
        coil, h = Coil(law(EDDY)), 1.5e-3 / (3 * steps)
        coil.hold(start, GAP)
        rows = [(coil.current, coil.force)]
        for _ in range(3 * steps):
            coil.step(60.0, GAP, h)
            rows.append((coil.current, coil.force))
        current, force = np.array(rows).T
        at, gap = h * np.arange(current.size), np.full(current.size, GAP)
        slow = model().predict(current, gap, history="demagnetised").output
        expected = with_eddies.predict(current, gap, at, history="demagnetised").output
        assert np.max(np.abs(slow - expected)) > 20.0
        off.append(float(np.max(np.abs(force - expected))))
    assert off[1] < 0.6 * off[0]
    assert off[1] < 0.5


@dataclass(frozen=True)
class Case:
    changes: dict[str, float]
    current: float = 2.8
    magnets: tuple[Magnet, ...] = ()


CASES = {
    "cells": Case({}),
    "eddy currents": Case({"magnet.eddy_time_s": 5e-5}),
    "damped, with a spring": Case(
        {"body.damping_N_s_per_m": 500.0, "load.damping_N_s_per_m": 100.0, "load.stiffness_N_per_m": 1e4}
    ),
    "law": Case({}, current=1.5, magnets=(law(0.0),)),
    "preisach": Case({}, magnets=(make_iron_magnet(example_poles(), STEELS["preisach-usual"]),)),
    "duhem": Case({}, magnets=(make_iron_magnet(example_poles(), STEELS["duhem-usual"]),)),
}


def run(case: Case, substeps: int, lift: float) -> FloatArray:
    """Return gap, velocity, force and current at each tick of 3 ms of varying commands."""
    changes = OPEN_LOOP | {"timing.delay_ticks": 1.0, "body.gravity_m_per_s2": lift}
    plant = make_plant(rig(changes | case.changes | {"timing.substeps": substeps}), 0, *case.magnets)
    plant.place([GAP], [0.0])
    plant.hold(case.current, 0)
    rows = []
    for tick in range(60):
        command = case.current * (1.0 + 0.14 * math.sin(0.9 * tick))
        plant.advance([command], 20.0 if tick > 30 else 0.0)
        rows.append((plant.gap, plant.velocity, plant.force, plant.current))
    return np.array(rows)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_the_whole_bearing_is_of_second_order(case: Case) -> None:
    plant = make_plant(rig(OPEN_LOOP | case.changes), 0, *case.magnets)
    plant.place([GAP], [0.0])
    plant.hold(case.current, 0)
    lift = plant.force / 2.0
    finest = run(case, 64, lift)
    assert 5e-6 < np.ptp(finest[:, 0]) < 80e-6
    steps = np.array([2, 4, 8, 16])
    errors = np.array([np.sqrt(np.mean((run(case, int(n), lift) - finest) ** 2, axis=0)) for n in steps])
    order = -np.polynomial.polynomial.polyfit(np.log2(steps), np.log2(errors), 1)[1]
    assert np.all(order > 1.6)
    assert np.all(order < 2.5)
    # 12.5 us, as in the example: two parts in a thousand of the motion.
    assert np.all(errors[1] < 2e-3 * np.ptp(finest, axis=0))
