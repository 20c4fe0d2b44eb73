"""Test the equations of the simulated tasks, and that the committed records follow from them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flux_irons import Saturation
from zoo.records import FloatArray
from zoo.task import read_task
from zoo.tasks import _make_simulated
from zoo.tasks._simulate import bouc_wen, magnets, piezo, solid
from zoo.tasks._simulate.drives import Drive, make_ramps, simulate_records, write_records
from zoo.tasks._simulate.preisach import RelayIron

TASKS = sorted(_make_simulated.SYSTEMS)
MAGNETS = {
    "preisach-magnet": magnets.make_preisach_magnet,
    "tellinen-magnet": magnets.make_tellinen_magnet,
    "two-iron-magnet": magnets.make_two_iron_magnet,
}


def compute_loss(effort: FloatArray, flow: FloatArray) -> float:
    """Return the integral of the effort over the flow along a closed cycle."""
    effort, flow = np.append(effort, effort[0]), np.append(flow, flow[0])
    return float(np.sum(0.5 * (effort[1:] + effort[:-1]) * np.diff(flow)))


def test_bouc_wen_agrees_with_scipy() -> None:
    def find_force(time: float) -> float:
        return 60.0 * float(np.sin(2.0 * np.pi * 30.0 * time))

    step, count = 1.0 / 15000.0, 1500
    force = np.array([find_force(0.5 * step * index) for index in range(2 * count + 1)])
    reference = solve_ivp(
        lambda time, state: bouc_wen.find_rates(tuple(state), find_force(time)),
        (0.0, step * count),
        [0.0, 0.0, 0.0],
        t_eval=step * np.arange(count),
        max_step=step,
        rtol=1e-9,
        atol=1e-12,
    )
    displacement = bouc_wen.integrate(force, step)
    assert np.max(np.abs(displacement - reference.y[0])) < 3e-5 * np.max(np.abs(displacement))


def test_slow_bouc_wen_is_the_limit_of_the_dynamic_one() -> None:
    steps = 20000
    force = 100.0 * np.sin(3.0 * np.pi * np.arange(2 * steps + 1) / (2 * steps)) ** 3
    dynamic = bouc_wen.integrate(force, 1.0 / 5000.0)[::50]
    quasi_static = bouc_wen.respond_slowly(Drive(force[: 2 * steps : 100]))
    assert np.max(np.abs(dynamic - quasi_static)) < 1e-3 * np.ptp(quasi_static)


def test_slow_bouc_wen_settles_to_a_loop_that_loses_energy() -> None:
    cycle = Drive(bouc_wen.SLOW_FORCE_N * make_ramps([0.0, 1.0, -1.0, 0.0], 20))
    cycles = bouc_wen.respond_slowly(cycle.repeat(30)).reshape(30, -1)
    change = float(np.max(np.abs(cycles[-1] - cycles[-2])))
    assert change < 1e-6 * np.ptp(cycles[-1])
    assert compute_loss(cycle.input, cycles[-1]) > 0.02 * np.ptp(cycle.input) * np.ptp(cycles[-1])


def test_iron_of_preisach_agrees_with_its_relays() -> None:
    centre, width, count = 260.0, 130.0, 500
    quantiles = (np.arange(count) + 0.5) / count
    thresholds = centre + width * np.tan(np.pi * (quantiles - 0.5))
    upper, lower = np.meshgrid(thresholds, -thresholds, indexing="ij")
    exists = upper > lower
    state = np.where(upper + lower < 0.0, 1.0, -1.0)
    iron = RelayIron(1.4, centre, width, Saturation(1e-12, 1.0, 1.0, 0.5))
    path = 900.0 * make_ramps([0.0, 0.6, -0.3, 0.2, -0.1, 0.4, -0.8, 1.0, -0.2, 0.9, -1.0], 20)
    found, relays = np.empty((2, path.size))
    for index, field in enumerate(path.tolist()):
        iron.commit(field)
        state = np.where(field >= upper, 1.0, np.where(field <= lower, -1.0, state))
        found[index] = iron.find_density(field)[0] - 4e-7 * np.pi * field
        relays[index] = 1.4 * float(np.mean(state[exists]))
    assert np.max(np.abs(found - relays)) < 5e-3 * 1.4


def test_iron_of_preisach_closes_minor_loops_and_knows_its_slope() -> None:
    iron = RelayIron(1.4, 260.0, 130.0, Saturation(0.5, 900.0, 5000.0, 0.5))
    for field in (500.0, -200.0, 300.0):
        iron.commit(field)
    before = iron.find_density(300.0)[0]
    for field in (0.0, 200.0, 100.0, 300.0):
        iron.commit(field)
    assert iron.find_density(300.0)[0] == pytest.approx(before, abs=1e-12)
    for field in (150.0, 400.0, 700.0):
        density_below, density_above = iron.find_density(field - 0.01)[0], iron.find_density(field + 0.01)[0]
        assert iron.find_density(field)[1] == pytest.approx((density_above - density_below) / 0.02, rel=1e-4)


@pytest.mark.parametrize("name", MAGNETS)
def test_magnet_loses_energy_and_pulls_more_at_a_small_gap(name: str) -> None:
    magnet = MAGNETS[name]()
    current = magnet.current_max * make_ramps([0.0, 1.0, 0.0], 40)
    forces = []
    for gap in np.geomspace(*magnet.gap_range, 3):
        linkage, force = (values[-current.size :] for values in magnet.run(np.tile(current, 3), gap))
        assert compute_loss(current, linkage) > 1e-3 * np.ptp(current) * np.ptp(linkage)
        forces.append(float(force[40]))
    assert forces == sorted(forces, reverse=True)


def test_solid_magnet_opens_its_loop_with_speed() -> None:
    widths = []
    for rate in solid.RATES_HZ:
        cycle = solid.make_cycle(rate, solid.GAPS_M[0])
        force = solid.respond(cycle.repeat(2))[-cycle.input.size :]
        half_cycle = cycle.input.size // 2
        widths.append(float(np.max(force[half_cycle + 1 :][::-1] - force[1:half_cycle])))
    assert widths == sorted(widths)
    assert widths[-1] > 2.0 * widths[0]


def test_piezo_loses_energy_and_creeps_with_the_logarithm_of_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(piezo, "NODES", (24, 400))
    cycle = piezo.make_triangles([0.0, 1.0, 0.0], 1.0, 60)
    displacement = piezo.respond(cycle.repeat(2))[-cycle.input.size :]
    assert compute_loss(cycle.input, displacement) > 0.02 * np.ptp(cycle.input) * np.ptp(displacement)
    time = 0.1 * np.arange(1002, dtype=float)
    displacement_held = piezo.respond(Drive(np.where(time > 0.0, 80.0, 0.0), None, time))
    per_decade = np.diff(displacement_held[[2, 11, 101, 1001]])
    assert np.min(per_decade) > 0.5 * np.max(per_decade) > 0.0


@pytest.mark.parametrize("name", TASKS)
def test_task_is_complete(name: str) -> None:
    task = read_task(name)
    records = [*task.training, *task.test]
    assert task.kind == "simulated"
    assert task.training
    assert task.test
    assert 2000 <= sum(record.input.size for record in records) <= 8000
    for record in records:
        assert (record.schedule is not None) == bool(task.schedule)
        assert (record.time is not None) == task.is_rate_dependent
        if record.history == "settled":
            steps = np.abs(np.diff(record.input, append=record.input[:1]))
            assert steps[-1] <= 1.5 * np.max(steps[:-1])
        else:
            assert abs(record.input[0]) <= 0.01 * np.max(np.abs(record.input))


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_records_follow_from_their_equations(name: str, tmp_path: Path) -> None:
    folder = _make_simulated.FOLDER / name
    write_records(tmp_path / "records.csv", simulate_records(folder, _make_simulated.SYSTEMS[name]()))
    tables = []
    for file in (folder / "records.csv", tmp_path / "records.csv"):
        with file.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.reader(stream))
        tables.append(([row[0] for row in rows], np.array([row[1:] for row in rows[1:]], dtype=float)))
    (committed_names, committed), (names, made) = tables
    assert names == committed_names
    assert np.all(np.abs(made - committed) <= 1e-7 * np.ptp(committed, axis=0))
