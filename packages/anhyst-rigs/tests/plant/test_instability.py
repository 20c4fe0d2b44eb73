"""Check that an armature at constant current diverges at the rate of the negative stiffness."""

from __future__ import annotations

import math

import numpy as np
import pytest

from anhyst_rigs.rig.parts.iron import CellSteel
from anhyst_rigs.study.bearing.linear import LinearBearing
from tests.plant.oracle import OracleMagnet, Shape
from tests.plant.rigs import GAP, STIFF, bearing, example_steel

MASS = 2.0


def stiffness(steel: CellSteel, current: float, gap: float, way: float) -> tuple[float, float]:
    """Return pull and stiffness, N/m, for a motion of the gap in a direction after a rise of the
    current."""
    magnet = OracleMagnet(Shape(), steel)
    force, _ = magnet.hold(current, gap)
    moved, _ = magnet.hold(current, gap + way)
    return force, (moved - force) / way


@pytest.mark.parametrize("way", [1.0, -1.0], ids=["opens", "closes"])
@pytest.mark.parametrize(("gap", "current"), [(0.45e-3, 2.8), (0.45e-3, 1.5), (0.38e-3, 2.5)])
def test_at_constant_current_the_gap_diverges_at_the_unstable_pole(
    gap: float, current: float, way: float
) -> None:
    force, slope = stiffness(example_steel(), current, gap, 1e-7 * way)
    assert slope < 0.0
    pole = math.sqrt(-slope / MASS)
    linear = LinearBearing(MASS, k_i=1.0, k_s=-slope, inductance=1.0, resistance=1.0)
    assert 2.0 * math.pi * linear.current_drive_pole == pytest.approx(pole)
    plant = bearing(STIFF | {"body.gravity_m_per_s2": force / MASS})
    plant.place([gap], [0.0])
    plant.hold(current, 0)
    start = way * 20e-6 * pole / math.exp(4.0)  # 10 um after four time constants
    plant.place([gap], [start])
    away, speed = [], []
    for _ in range(2000):
        plant.advance([current], 0.0)
        if abs(plant.gap - gap) > 2e-6:
            break
        away.append(abs(plant.gap - gap))
        speed.append(abs(plant.velocity))
    assert len(away) > 20
    # v^2 - v_0^2 = p^2 x^2 where x" = p^2 x.
    measured = np.sqrt((np.array(speed) ** 2 - start**2) / np.array(away) ** 2)
    assert measured[10:] == pytest.approx(pole, rel=0.03)
    late = slice(len(away) // 2, None)
    grows = np.polynomial.Polynomial.fit(np.arange(len(away))[late] * 50e-6, np.log(away)[late], 1).convert()
    assert grows.coef[1] == pytest.approx(pole, rel=0.25)  # e^pt dominates e^-pt


def test_at_constant_voltage_the_gap_diverges_at_a_slower_pole() -> None:
    current, way = 2.8, 1e-7
    force, slope = stiffness(example_steel(), current, GAP, way)
    turned = OracleMagnet(Shape(), example_steel())
    states = np.array([turned.hold(current, GAP), turned.hold(current - 1e-4, GAP)])
    k_i, inductance = (states[0] - states[1]) / 1e-4  # the flux decreases as the gap opens
    linear = LinearBearing(MASS, float(k_i), -slope, float(inductance), 1.2)
    assert linear.voltage_drive_pole < 0.8 * linear.current_drive_pole
    held = {"amplifier.mode": "voltage", "amplifier.supply_V": 150.0, "amplifier.dac_bits": 24}
    plant = bearing(STIFF | held | {"body.gravity_m_per_s2": force / MASS})
    plant.place([GAP], [0.0])
    plant.hold(current, 0)
    plant.place([GAP], [1e-4])
    away = []
    for _ in range(4000):
        plant.advance([1.2 * current], 0.0)
        away.append(plant.gap - GAP)
        if away[-1] > 4e-6:
            break
    late = np.array(away)[np.array(away) > 1e-6]
    grows = np.polynomial.Polynomial.fit(np.arange(late.size) * 50e-6, np.log(late), 1).convert()
    assert grows.coef[1] / (2.0 * math.pi) == pytest.approx(linear.voltage_drive_pole, rel=0.05)


def test_in_balance_it_stays() -> None:
    """Only rounding moves it."""
    plant = bearing(STIFF)
    plant.place([GAP], [0.0])
    plant.hold(2.8, 0)
    lift = plant.force / MASS
    balanced = bearing(STIFF | {"body.gravity_m_per_s2": lift})
    balanced.place([GAP], [0.0])
    balanced.hold(2.8, 0)
    for _ in range(100):
        balanced.advance([2.8], 0.0)
    assert abs(balanced.gap - GAP) < 1e-9
