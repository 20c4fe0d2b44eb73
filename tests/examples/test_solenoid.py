"""Test the bundled solenoid against its README."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from anhyst.support.units import MU_0
from anhyst_rigs.rig.force.file import ForceControlRig, read_rig
from anhyst_rigs.rig.parts.iron import CellSteel

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "solenoid"
CURRENT_MAX = 1.2
LEVELS = np.linspace(0.05, 0.95, 181)


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_solenoid_loops", FOLDER / "make_loops.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def rig() -> ForceControlRig:
    return read_rig(FOLDER / "rig.toml")


def table() -> list[list[str]]:
    text = (FOLDER / "README.md").read_text()
    rows = re.findall(r"^\| \d\.\d\d mm.*$", text, re.M)
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def test_the_data_are_reproduced_by_their_script(example: ModuleType) -> None:
    for name, text in example.files().items():
        assert (FOLDER / name).read_text() == text, f"{name}: run make_loops.py again"


def test_the_first_version_has_its_data_too(example: ModuleType) -> None:
    rig = read_rig(FOLDER / "drawn" / "rig.toml")
    made = example.rows(rig)
    stored_rows = (FOLDER / "drawn" / "loops.csv").read_text().splitlines()[4:]
    for row, line in zip(range(300), stored_rows, strict=False):
        assert next(made) == line, f"row {row}"


def test_the_table_of_positions(rig: ForceControlRig) -> None:
    rows = table()
    assert [float(row[0].split()[0]) for row in rows] == [
        round(1e3 * gap, 2) for gap in rig.settings.held_case.gaps_m
    ]
    file = rig.solenoid_file
    assert file is not None
    assert file.measurement is not None
    measured_gaps = {round(1e3 * gap, 2) for gap in file.measurement.gaps_m}
    turns = file.circuit.turns
    for place, force, left, width, density, share, where in rows:
        gap = float(place.split()[0])
        solenoid, at = rig.magnet(), np.full(201, 1e-3 * gap)
        current = np.linspace(0.0, CURRENT_MAX, 201)
        for turn in (CURRENT_MAX, 0.0) * 3:
            rest = solenoid.hold(turn, 1e-3 * gap)
        rising_force = solenoid.run(current, at)[:, 0]
        assert f"{rising_force[-1]:.1f} N" == force
        assert f"{rest:.2f} N" == left
        flux = solenoid.psi / turns
        assert f"{flux / file.iron.area_m2:.2f} T" == density
        over = solenoid.density * 1e-3 * gap / MU_0 + file.circuit.slide_reluctance_per_H * flux
        usable_fraction = 1.0 - over / (turns * CURRENT_MAX)
        assert f"{100.0 * usable_fraction:.0f} %" == share
        falling_force = solenoid.run(current[::-1].copy(), at)[::-1, 0]
        force_levels = LEVELS * rising_force[-1]
        loop_width = np.interp(force_levels, rising_force, current) - np.interp(
            force_levels, falling_force, current
        )
        percent = 100.0 * loop_width / CURRENT_MAX
        reported = [float(number) for number in re.findall(r"[\d.]+(?= %)", width)]
        assert percent.max() == pytest.approx(reported[0], abs=0.06)
        assert percent.mean() == pytest.approx(reported[1], abs=0.06)
        assert percent.max() >= 4.0
        assert rising_force[-1] >= rig.settings.force.force_max_N
        assert (where == "`loops.csv`") == (gap in measured_gaps)


def test_the_thresholds_of_the_cells(rig: ForceControlRig) -> None:
    assert rig.solenoid_file is not None
    steel = rig.solenoid_file.iron
    assert isinstance(steel, CellSteel)
    thresholds = steel.thresholds
    text = (FOLDER / "README.md").read_text()
    low, high = map(float, re.findall(r"thresholds between (\d+) and (\d+) A/m", text)[0])
    assert thresholds[1] == pytest.approx(low, rel=0.05)
    assert thresholds[-1] == pytest.approx(high, rel=0.05)
