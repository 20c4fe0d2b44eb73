"""Test the simulated electromagnet against the claims of its README."""

from __future__ import annotations

import importlib.util
import itertools
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.oracles.cell_iron import CellIron

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "electromagnet"
GAPS = (0.30e-3, 0.35e-3, 0.40e-3, 0.50e-3, 0.55e-3, 0.60e-3)


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_loops", FOLDER / "make_loops.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look up this module by name
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def settings() -> dict[str, Any]:
    return tomllib.loads((FOLDER / "magnet.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def records(example: ModuleType) -> list[Any]:
    return [*example.measure("identification"), *example.measure("unseen")]


def full_loops(records: list[Any]) -> list[Any]:
    return [record for record in records if record.label.endswith("-full")]


def branches(record: Any) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return current and force of the ascending and descending branches, sorted by current."""
    current = np.append(record.current, record.current[0])
    force = np.append(record.force, record.force[0])
    tip_index = int(np.argmax(current))
    return current[: tip_index + 1], force[: tip_index + 1], current[:tip_index:-1], force[:tip_index:-1]


def width(record: Any) -> FloatArray:
    """Return the width of the loop at constant force, A, at evenly spaced forces."""
    current_up, force_up, current_down, force_down = branches(record)
    level = np.linspace(force_up[0], force_up[-1], 500)
    opening = np.interp(level, force_up, current_up) - np.interp(level, force_down, current_down)
    return np.asarray(opening)


def slope_after_turning(magnet: Any, current: float, gap: float) -> float:
    """Return ``dF/dI`` (N/A) of the first downward step from a current reached from below."""
    for turning_point in (0.0, 3.0, 0.0, 3.0, 0.0, current):
        force = magnet.step(turning_point, gap)
    step = 1e-5
    return float((force - magnet.step(current - step, gap)) / step)


@pytest.mark.slow
def test_committed_files_are_reproduced_by_their_script(example: ModuleType) -> None:
    for name, text in example.files().items():
        assert (FOLDER / name).read_bytes() == text.encode(), name


@pytest.mark.slow
def test_script_writes_into_the_folder_it_is_reported(
    example: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["make_loops.py", "--out", str(tmp_path / "new")])
    example.main()
    written_names = {path.name for path in (tmp_path / "new").iterdir()}
    assert written_names == set(example.files())


def test_files_are_small_and_labelled_as_simulated(example: ModuleType) -> None:
    tables = sorted(FOLDER.glob("*.csv"))
    assert sum(path.stat().st_size for path in tables) < 1_500_000
    assert all(path.read_text(encoding="utf-8").startswith("# simulated") for path in tables)


def test_no_loop_is_longer_than_400_samples(records: list[Any]) -> None:
    assert max(record.current.size for record in records) <= 400


def test_unseen_gaps_lie_between_the_identified_ones(settings: dict[str, Any]) -> None:
    identified_gaps, unseen_gaps = (set(settings[part]["gaps_m"]) for part in ("identification", "unseen"))
    assert not identified_gaps & unseen_gaps
    assert min(identified_gaps) < min(unseen_gaps) < max(unseen_gaps) < max(identified_gaps)


@pytest.mark.parametrize("gap", GAPS)
@pytest.mark.parametrize("current", [0.8, 1.5, 2.4, 3.0])
def test_the_slope_after_a_reversal_agrees_with_the_reversible_fraction(
    example: ModuleType, settings: dict[str, Any], current: float, gap: float
) -> None:
    magnet, _ = example.load()
    slope = slope_after_turning(magnet, current, gap)
    # Invert force = const*B**2 and N*I = H*l + B*A*R to get the slope of the iron from dF/dI.
    area = magnet.circuit.iron_area
    force = magnet.circuit.force(magnet.flux_density * area, gap)
    db_di = slope * magnet.flux_density / (2 * force)
    outer_ratio = area * magnet.circuit.outer_reluctance(gap)
    dh_db = (magnet.circuit.turns / db_di - outer_ratio) / magnet.length
    susceptibility = 1 / (MU_0 * dh_db) - 1
    near = magnet.field + np.array([-0.01, 0.01])
    curve = CellIron(magnet.steel.model_copy(update={"reversible_fraction": 1.0}))
    anhysteretic = float(np.diff([curve.flux_density(h)[0] for h in near])[0]) / 0.02 / MU_0 - 1
    fraction = settings["iron"]["reversible_fraction"]
    assert susceptibility / anhysteretic == pytest.approx(fraction, rel=1e-3)
    assert 0.05 <= fraction <= 0.3


def test_loops_are_at_least_4_percent_of_the_current_wide(
    records: list[Any], settings: dict[str, Any]
) -> None:
    loops = full_loops(records)
    assert len(loops) == len(GAPS)
    for record in loops:
        assert width(record).max() >= 0.04 * settings["drive"]["current_max_A"], record.label


def test_every_loop_encloses_a_positive_area(records: list[Any]) -> None:
    for record in records:
        assert width(record).min() > -1e-12, record.label
        assert width(record).mean() > 0, record.label


def test_every_kind_of_loop_is_settled(records: list[Any], example: ModuleType) -> None:
    magnet, settings = example.load()
    for record in records[:4]:
        low, high = record.current.min(), record.current.max()
        settled_loop = example.settled_loop(magnet, record.gap, low, high, settings)
        again = example.settled_loop(magnet, record.gap, low, high, settings)
        np.testing.assert_allclose(again[1], settled_loop[1], rtol=0, atol=1e-7)
        np.testing.assert_allclose(record.force, settled_loop[1], rtol=0, atol=1e-7)


def test_force_rises_as_the_gap_closes_on_both_branches(records: list[Any]) -> None:
    loops = sorted(full_loops(records), key=lambda record: float(record.gap))
    for nearer, farther in itertools.pairwise(loops):
        assert np.all(nearer.force > farther.force)


def test_iron_saturates_to_the_knee_and_not_beyond(example: ModuleType) -> None:
    share = {}
    for gap in (GAPS[0], GAPS[-1]):
        magnet, settings = example.load()
        full = settings["drive"]["current_max_A"]
        magnet.step(full, gap)
        share[gap] = magnet.length * magnet.field / (magnet.circuit.turns * full)
    assert 0.15 <= share[GAPS[0]] <= 0.25  # knee: the iron needs a fifth of the ampere-turns
    assert share[GAPS[-1]] < 0.08


def test_electric_work_of_a_cycle_is_the_heat_of_the_iron(example: ModuleType) -> None:
    magnet, _ = example.load()
    for turning_point in (0.0, 3.0, 0.0, 3.0, 0.0):
        magnet.step(turning_point, GAPS[0])
    current = 3.0 - np.abs(np.linspace(-3.0, 3.0, 2001))
    field, flux_density = np.empty((2, current.size))
    for i, amperes in enumerate(current):
        magnet.step(amperes, GAPS[0])
        field[i], flux_density[i] = magnet.field, magnet.flux_density
    linkage = magnet.circuit.turns * magnet.circuit.iron_area * flux_density
    electric = float(np.trapezoid(current, linkage))
    volume = magnet.circuit.iron_area * magnet.length
    heat = volume * float(np.trapezoid(field, flux_density))
    assert electric > 0
    assert electric == pytest.approx(heat, rel=1e-3)


def test_the_energy_of_a_moving_armature_equals_the_iron_loss(example: ModuleType) -> None:
    magnet, _ = example.load()
    smallest_gap, largest_gap, low, high, n = GAPS[0], GAPS[-1], 1.0, 2.5, 400
    corners = (
        (low, largest_gap),
        (low, smallest_gap),
        (high, smallest_gap),
        (high, largest_gap),
        (low, largest_gap),
    )
    legs = [np.linspace(start, end, n) for start, end in itertools.pairwise(corners)]
    path = np.concatenate([*legs, *legs])
    state = np.empty((path.shape[0], 3))
    for i, (current, gap) in enumerate(path):
        force = magnet.step(current, gap)
        state[i] = force, magnet.flux_density, magnet.field
    second = slice(len(path) // 2 - 1, None)
    current, gap = path[second].T
    force, flux_density, field = state[second].T
    area = magnet.circuit.iron_area
    electric = float(np.trapezoid(current, magnet.circuit.turns * area * flux_density))
    mechanical = -float(np.trapezoid(force, gap))
    heat = area * magnet.length * float(np.trapezoid(field, flux_density))
    assert abs(mechanical) > 5 * heat > 0  # the balance is a difference of large terms
    assert electric - mechanical == pytest.approx(heat, rel=1e-3)


def test_sensors_have_their_stated_errors(records: list[Any], settings: dict[str, Any]) -> None:
    sensors, drive = settings["sensors"], settings["drive"]
    largest = max(record.force.max() for record in records)
    assert sensors["force_noise_N"] >= 0.002 * largest
    offset = np.concatenate([record.read_current - record.current for record in records])
    assert offset.mean() == pytest.approx(sensors["current_offset_A"], rel=0.02)
    assert offset.std() == pytest.approx(sensors["current_noise_A"], rel=0.05)
    assert sensors["current_offset_A"] >= 0.002 * drive["current_max_A"]

    force_error, late, age = [], [], []
    tared = dict.fromkeys(GAPS, np.inf)
    for record in records:
        started = record.time[0] - drive["conditioning_cycles"] * record.current.size * drive["sample_s"]
        tared[record.gap] = min(tared[record.gap], started)
        force_error.append(record.read_force - record.force)
        late.append((np.roll(record.force, 1) - record.force) / drive["sample_s"])
        age.append(record.time - tared[record.gap])
    error = np.concatenate(force_error)
    design = np.column_stack([np.concatenate(late), np.concatenate(age)])
    found, *_ = np.linalg.lstsq(design, error, rcond=None)
    assert found == pytest.approx([sensors["force_delay_s"], sensors["force_drift_N_per_s"]], rel=0.15)
    assert (error - design @ found).std() == pytest.approx(sensors["force_noise_N"], rel=0.05)


def test_truth_holds_the_true_force_and_the_current_with_the_sensor_offset(
    example: ModuleType, settings: dict[str, Any]
) -> None:
    unseen = example.measure("unseen")
    table = np.loadtxt(FOLDER / "unseen_truth.csv", delimiter=",", skiprows=4, usecols=(0, 1, 2, 3))
    current = np.concatenate([record.current for record in unseen])
    force = np.concatenate([record.force for record in unseen])
    offset = settings["sensors"]["current_offset_A"]
    np.testing.assert_allclose(table[:, 1], current + offset, rtol=0, atol=1e-6)
    np.testing.assert_allclose(table[:, 2], force, rtol=0, atol=1e-6)
    measured = np.loadtxt(FOLDER / "unseen.csv", delimiter=",", skiprows=4, usecols=(0, 3))
    np.testing.assert_array_equal(measured, table[:, [0, 3]])


def test_the_readme_table_agrees_with_the_loops(records: list[Any], settings: dict[str, Any]) -> None:
    readme = (FOLDER / "README.md").read_text(encoding="utf-8")
    full = settings["drive"]["current_max_A"]
    for record in full_loops(records):
        opening = 100 * width(record) / full
        row = (
            f"| {record.gap * 1e3:.2f} mm | {record.force.max():.1f} N "
            f"| {opening.max():.1f} %, {opening.mean():.1f} % |"
        )
        assert row in readme
