"""Test the virtual bench of a force rig: a demand through its firmware, and manual operation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing

import numpy as np
import pytest

from anhyst.compensate.current_map import fit_ratio
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Fault, State
from anhyst_rigs.link.client import RequestRefusedError
from anhyst_rigs.link.virtual_boards import Reading
from anhyst_rigs.rig.bench.force import Armature, ForceBench, StandPlant, run_firmware
from anhyst_rigs.rig.case_table import ForceCase
from anhyst_rigs.rig.force.bench import ActuatorStand, run_open_loop, triangle_demand
from anhyst_rigs.rig.force.file import ForceControlRig
from anhyst_rigs.rig.force.programs import Program, count_differing_ticks, loops_at_gap, read_rig_loops
from tests.refusals import refused
from tests.rig import forces

UP = 40
"""Ticks until the self-test has passed."""


@pytest.fixture(scope="module")
def rig() -> ForceControlRig:
    return forces.example()


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Program:
    return forces.program(tmp_path_factory)


@pytest.fixture
def bench(rig: ForceControlRig, program: Program) -> Iterator[ForceBench]:
    opened = ForceBench(rig, program)
    opened.advance(UP)
    yield opened
    opened.close()


def run(bench: ForceBench) -> None:
    bench.command(Command.DEMAGNETISED)
    bench.command(Command.RUN)


def column(bench: ForceBench, rows: FloatArray, name: str) -> FloatArray:
    found: FloatArray = rows[:, 1 + [signal.name for signal in bench.signals].index(name)]
    return found


def test_the_firmware_agrees_with_the_simulated_program(rig: ForceControlRig, program: Program) -> None:
    shape = ForceCase(kind="force", name="wide", low=0.05, high=0.95, period_s=0.4, cycles=1)
    demand = triangle_demand(shape, rig.settings.force.force_max_N, 1.0 / rig.dt)
    gap = np.full(demand.force.size, rig.settings.force.end_m)
    stand = ActuatorStand(rig, [2, 0])
    found, session = run_firmware(rig, program, stand, gap, demand, "library", is_demagnetised=True)
    assert count_differing_ticks(program, session) == 0
    # Nothing moved before the run, so its commands alone determine currents and forces.
    alone = run_open_loop(ActuatorStand(rig, [2, 0]), gap, found["command_A"])
    for name in ("t_s", "command_A", "current_A", "force_N", "gap_m"):
        assert (found[name] == alone[name]).all(), name
    gauge = rig.settings.gap_sensor
    assert found["gap_read_m"] == pytest.approx(gap, abs=6.0 * gauge.noise_m + gauge.resolution)


def test_compensation_is_switched_while_it_runs(
    rig: ForceControlRig, program: Program, bench: ForceBench
) -> None:
    settings = rig.settings.force
    loops = loops_at_gap(read_rig_loops(rig), settings.end_m)
    bench.apply({"ratio": 1.0 / float(fit_ratio(loops, settings.force_max_N).ratio[0])})
    run(bench)
    bench.apply({"demand_slew": 200.0})
    worst = {}
    for compensation in (1, 0, 1):
        first = bench.apply({"compensation": compensation})
        assert first == bench.tick + 1
        errors = []
        for force in (30.0, 8.0, 30.0):
            bench.demand(force)
            rows = bench.advance(400)[200:]
            errors.append(abs(column(bench, rows, "force").mean() - force))
        worst[compensation] = max(errors)
    assert worst[1] < 0.3
    assert worst[0] > 5.0 * worst[1]
    assert column(bench, rows, "state")[-1] == State.RUN
    assert column(bench, rows, "expected")[-1] == pytest.approx(30.0, abs=0.1)


def test_the_armature_moves_at_its_speed_and_back_and_forth() -> None:
    armature = Armature(1e-3, 2.8e-3, 1000.0)
    assert armature.move() == pytest.approx(1.9e-3)
    armature.apply({"gap": 1.2e-3, "gap_speed": 0.01})
    way = np.array([armature.move() for _ in range(100)])
    assert np.diff(way[:60]) == pytest.approx(-1e-5)
    assert (way[80:] == 1.2e-3).all()
    armature.apply({"gap_swing": 0.5e-3, "gap_frequency": 4.0})
    swing = np.array([armature.move() for _ in range(500)])
    assert swing.max() == pytest.approx(1.7e-3, rel=1e-3)
    assert swing.min() == 1e-3  # its stop


def test_a_force_is_demanded_in_run_alone(bench: ForceBench) -> None:
    with refused("wrong-state demand"):
        bench.demand(5.0)
    run(bench)
    bench.demand(5.0)
    assert column(bench, bench.advance(2), "demand")[-1] == pytest.approx(5.0)


def test_unsuitable_values_are_refused_and_change_nothing(bench: ForceBench) -> None:
    run(bench)
    before = bench.parameters()
    with refused("wrong-state follow"):
        bench.apply({"demand_slew": 100.0, "follow": 1})
    with refused("out-of-range compensation: 0.5"):
        bench.apply({"demand_slew": 100.0, "compensation": 0.5})
    with refused("out-of-range demand: 1000 N"):
        bench.demand(1000.0)
    with refused("no-load-drive load"):
        bench.load(1.0)
    with refused("refused state", RequestRefusedError):
        bench.command(Command.RUN)
    assert bench.parameters() == before
    assert column(bench, bench.advance(1), "state")[0] == State.RUN


def test_a_force_is_held_for_longer_than_the_heartbeat_of_its_operator(bench: ForceBench) -> None:
    run(bench)
    bench.demand(20.0)
    rows = bench.advance(1000)
    assert (column(bench, rows, "fault") == Fault.NONE).all()
    assert column(bench, rows, "force")[-200:].mean() == pytest.approx(20.0, abs=0.3)


class BrokenSensor(StandPlant):
    """A plant whose current sensor fails during the run."""

    change: Callable[[float], float] = staticmethod(lambda current: current)

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        seen = super().step(tick, currents)
        return seen._replace(current=self.change(seen.current))


BROKEN: dict[str, Callable[[float], float]] = {
    "disconnected": lambda current: 0.0,
    "stuck": lambda current: 0.11,
    "wrong sign": lambda current: -current,
    "gain 20 % too high": lambda current: 1.2 * current,
    "gain 20 % too low": lambda current: 0.8 * current,
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_current_that_does_not_follow_is_a_fault(rig: ForceControlRig, program: Program, name: str) -> None:
    plant = BrokenSensor.with_operator(rig, program, 0)
    with closing(ForceBench(rig, program, plant)) as bench:
        bench.advance(UP)
        run(bench)
        bench.demand(30.0)
        assert (column(bench, bench.advance(300), "fault") == Fault.NONE).all()
        plant.change = BROKEN[name]
        rows = bench.advance(300)
        faults = column(bench, rows, "fault")
        assert faults[-1] == Fault.CURRENT_MISMATCH
        assert (faults[:20] == Fault.NONE).all()
        assert faults[60] == Fault.CURRENT_MISMATCH
        assert column(bench, rows, "command")[-1] == 0.0


@pytest.mark.parametrize(
    "seconds", [30, pytest.param(600, marks=pytest.mark.campaign)], ids=["30 s", "10 min"]
)
def test_normal_operation_of_a_force_raises_no_fault(bench: ForceBench, seconds: int) -> None:
    rng = np.random.default_rng(10)
    bench.command(Command.CONDITION)
    rows = bench.advance(20_000)
    assert (column(bench, rows, "fault") == Fault.NONE).all()
    assert column(bench, rows, "state")[-1] == State.READY
    bench.command(Command.RUN)
    for _ in range(2 * seconds):
        bench.demand(float(rng.uniform(0.0, bench.demand_range.high)))
        rows = bench.advance(500)
        assert (column(bench, rows, "fault") == Fault.NONE).all()
    assert column(bench, rows, "state")[-1] == State.RUN
