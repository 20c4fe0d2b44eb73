"""Test the calibration of a bearing from flights with faults."""

from __future__ import annotations

import math
from contextlib import closing
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from anhyst.support.errors import InputError
from anhyst.support.states import Command, Fault, State
from anhyst_rigs.link.frames import PlantDrive, PlantSample
from anhyst_rigs.link.virtual_boards import Q31
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.drift import drifted_plant
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.bearing.board_faults import FaultAction, FaultInjection, fault_injections
from tests.study import bearings
from tests.study.test_bearing_calibration import WRONG_DRIFT, calibrate_run, setup

HEIGHTS = (-25e-6, 25e-6, -50e-6, 50e-6, 0.0)
COLUMNS = {
    **{"t": "t_s", "reference": "reference_m", "gap_read": "gap_read_m", "command": "command_A"},
    **{"load": "load_N", "demand": "demand_N", "state": "state", "phase": "phase"},
}
NO_NUMBER = -(1 << 31)
OFTEN = {"three samples missing", "position jumps", "position frozen, target stepped"}
OFTEN |= {"five ticks missed", "overload for 100 ms"}
"""The others are repeated by hand."""


class Flight:
    """A flight and its rows; a missing position repeats the previous reading."""

    def __init__(self, running: BearingBench) -> None:
        self.running, self.rows = running, list[list[float]]()
        self._exchange, running.tap.exchange = running.tap.exchange, self._look
        self._full = setup().position_control.settings("fixed")
        self._gap = math.nan

    def _look(self, sample: PlantSample) -> PlantDrive:
        if sample.position > NO_NUMBER:
            read = sample.position / Q31 * self._full["position_full"]
            self._gap = self._full["gap_middle"] - read
        return self._exchange(sample)

    def fly(self, ticks: int, act: FaultAction = lambda *_: True) -> None:
        running = self.running
        for n in range(ticks):
            running.sends_heartbeat = act(running, n)
            now = running.step() | {"gap_read": self._gap, "t": running.tick * setup().rig.dt}
            self.rows.append([now[name] for name in COLUMNS])

    def steps(self) -> None:
        for height in HEIGHTS if self.running.state is State.RUN else ():
            self.running.demand(bearings.GAP + height)
            self.fly(1500)

    @property
    def recording(self) -> Recording:
        return Recording.from_table(np.array(self.rows), COLUMNS.values())


def recorded(firmware: Path, act: FaultAction) -> tuple[Recording, int]:
    """Fly steps, then a fault, then steps again; also return the rows before the fault."""
    plant = drifted_plant(setup().rig, WRONG_DRIFT, 1)
    with closing(BearingBench(setup(), firmware, board="library", bearing=plant)) as running:
        flight, supply = Flight(running), plant.supply
        flight.fly(120)
        for command, ticks in ((Command.DEMAGNETISED, 120), (Command.LIFT, 9000)):
            running.command(command)
            flight.fly(ticks)
        flight.steps()
        good = len(flight.rows)
        flight.fly(5000, act)
        running.tap.change_sample, plant.supply = None, supply
        running.load(running.rest_load)
        flight.steps()
    return flight.recording, good


def learnt(run: Recording) -> dict[str, tuple[float, float]]:
    """Parameters and their standard deviations; empty if the method is rejected."""
    (method,) = calibrate_run(run).file.method
    return {
        parameter.name: (parameter.value, parameter.sigma)
        for parameter in method.parameter
        if method.is_applied
    }


@cache
def without_a_fault(firmware: Path) -> tuple[dict[str, tuple[float, float]], ...]:
    """Estimates from the steps before a fault, and from a flight without a fault."""
    run, good = recorded(firmware, lambda *_: True)
    return learnt(run.slice_ticks(0, good)), learnt(run)


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(
            injection, id=injection.name, marks=() if injection.name in OFTEN else pytest.mark.campaign
        )
        for injection in fault_injections()
    ],
)
def test_no_listed_fault_changes_an_estimate(
    tmp_path_factory: pytest.TempPathFactory, fault: FaultInjection
) -> None:
    firmware = bearings.firmware(tmp_path_factory)
    run, _ = recorded(firmware, fault.action)
    if fault.expected_fault is Fault.MISSED_TICK:
        with pytest.raises(InputError, match="record every tick once"):
            calibrate_run(run)
        return
    flies_on = bool(run["state"][-1] == State.RUN)
    assert flies_on == (fault.expected_fault is Fault.NONE)
    expected = without_a_fault(firmware)[flies_on]
    assert len(expected) == 4
    for name, (value, sigma) in learnt(run).items():
        assert abs(value - expected[name][0]) <= sigma, name
