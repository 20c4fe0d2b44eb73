"""Test the bundled bearing against its README."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.optimize import brentq

from anhyst.data.reading import read_loops
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.drift import change_iron
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.rig.parts.iron import CellSteel

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "bearing"
README = (FOLDER / "README.md").read_text()
HIGH = 4.5
PAST = [0.0, *[HIGH, 0.0] * 3]


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_bearing_loops", FOLDER / "make_loops.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def rig() -> BodyRig:
    return read_bearing(FOLDER / "rig.toml")


def rows(pattern: str) -> list[list[str]]:
    found = re.findall(pattern, README, re.M)
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in found]


def test_the_loops_are_reproduced_by_their_script(example: ModuleType) -> None:
    for name, text in example.files().items():
        assert (FOLDER / name).read_text() == text, f"{name}: run make_loops.py again"


def test_the_loops_read_as_they_were_measured(rig: BodyRig) -> None:
    read_set, measured_set = read_loops(rig.measured_loops.paths[0]), measure_loops(rig)
    assert len(read_set.loops) == len(measured_set.loops) == 12
    for read_loop, measured_loop in zip(read_set.loops, measured_set.loops, strict=True):
        assert str(read_loop.history) == str(measured_loop.history)
        np.testing.assert_allclose(read_loop.input, measured_loop.input, atol=1e-6)
        np.testing.assert_allclose(read_loop.output, measured_loop.output, atol=1e-4)


def both_ways(rig: BodyRig, gap: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return current, rising and falling force, and largest flux density, after conditioning."""
    current = np.linspace(0.0, HIGH, 401)
    path = np.concatenate([PAST, current[1:], current[::-1][1:]])
    force, _, density = rig.static_map(path, np.full(path.size, gap))
    turn = len(PAST) + 399
    return current, force[len(PAST) - 1 : turn + 1], force[turn:][::-1], float(density[turn])


def opening(current: FloatArray, rising: FloatArray, falling: FloatArray) -> FloatArray:
    """Return the width of a loop at all levels, as a percentage of the largest current."""
    level = np.linspace(0.05, 0.95, 181) * rising[-1]
    width: FloatArray = np.interp(level, rising, current) - np.interp(level, falling, current)
    return 100.0 * width / HIGH


def test_the_table_of_gaps(rig: BodyRig) -> None:
    table = rows(r"^\| 0\.\d\d mm.*$")
    mechanics, measured = rig.settings.body, rig.settings.measurement.gaps_m
    expected = sorted({*measured, rig.settings.gap_m})
    assert [float(row[0].split()[0]) for row in table] == [round(1e3 * gap, 2) for gap in expected]
    assert measured[0] == mechanics.stop_low_m
    assert measured[-1] == mechanics.stop_high_m
    for gap, (_, force, density, width, at_load, where) in zip(expected, table, strict=True):
        current, rising, falling, most = both_ways(rig, gap)
        assert f"{rising[-1]:.1f} N" == force
        assert f"{most:.2f} T" == density
        percent = opening(current, rising, falling)
        assert f"{percent.max():.1f} %, {percent.mean():.1f} %" == width
        rising_current, falling_current = (
            float(np.interp(rig.static_load, branch_force, current)) for branch_force in (rising, falling)
        )
        assert f"{rising_current:.3f} A, {falling_current:.3f} A" == at_load
        assert (where == "`loops.csv`") == (gap in measured)


def test_the_table_of_reversible_fractions(rig: BodyRig) -> None:
    table = rows(r"^\| 0\.\d\d \|.*$")
    steel, gap = rig.settings.steel, rig.settings.gap_m
    assert isinstance(steel, CellSteel)
    assert float(table[0][0]) == steel.reversible_fraction
    for fraction, on, back, part, width in table:
        changed_rig = change_iron(rig, float(fraction))

        def force(*currents: float, rig: BodyRig = changed_rig) -> float:
            path = np.array([*PAST, *currents])
            return float(rig.static_map(path, np.full(path.size, gap))[0][-1])

        load = brentq(lambda current: force(current) - rig.static_load, 1.0, HIGH)
        going_on = (force(load + 1e-3) - force(load)) / 1e-3
        turning = (force(load) - force(load, load - 1e-3)) / 1e-3
        assert f"{going_on:.0f} N/A" == on
        assert f"{turning:.0f} N/A" == back
        assert f"{turning / going_on:.2f}" == part
        current, rising, falling, _ = both_ways(changed_rig, gap)
        assert f"{opening(current, rising, falling).max():.1f} %" == width
    assert "pathological here, such as the one with 0.05" in README
    assert [float(row[3]) < 0.25 for row in table] == [False, True, False]


def test_the_numbers_in_the_text(rig: BodyRig) -> None:
    settings = rig.settings
    steel = settings.steel
    assert isinstance(steel, CellSteel)
    thresholds = steel.thresholds
    low, high = map(float, re.findall(r"thresholds between\s+(\d+) and (\d+) A/m", README)[0])
    assert (round(thresholds[1]), round(thresholds[-1])) == (low, high)
    gap = settings.gap_m
    path = np.array([*PAST, 2.85, 2.852])
    linkage = rig.static_map(path, np.full(path.size, gap))[1]
    inductance = (linkage[-1] - linkage[-2]) / 2e-3
    reported = re.search(r"\((\d+) mH\) to (\d+) A/s", README)
    assert reported
    assert inductance == pytest.approx(1e-3 * float(reported[1]), rel=0.05)
    assert settings.amplifier.supply_V / inductance == pytest.approx(float(reported[2]), rel=0.05)
