"""What a bearing learns from the recording of a flight in which something goes wrong."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from anhyst.control.states import Command, Fault, State
from anhyst.link.client import ControllerLink
from anhyst.link.plant_bus import Q31, Reading
from anhyst.link.process import run_library
from anhyst.rig.bearing.board import BearingPlant, LevitatingFirmware
from anhyst.rig.bearing.drift import drifted_plant
from anhyst.rig.bearing.loop import position_control
from anhyst.rig.recording import Recording
from anhyst.study.bearing.board_faults import Act, Injection, injections
from anhyst.support.errors import InputError
from tests.study import bearings
from tests.study.test_bearing_calibration import WRONG, setup, taught

HEIGHTS = (-25e-6, 25e-6, -50e-6, 50e-6, 0.0)
COLUMNS = (
    *("t_s", "reference_m", "gap_read_m", "command_A", "load_N", "demand_N"),
    *("state", "phase"),
)
OFTEN = {"three samples missing", "position jumps", "position frozen, target stepped"}
OFTEN |= {"five ticks missed", "overload for 100 ms"}
"""The others are repeated by hand."""


class Shown(BearingPlant):
    """Keeps what its sensors showed."""

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        self.reading = super().step(tick, currents)
        return self.reading


class Recorded(LevitatingFirmware):
    """Keeps a row a tick; where the sensor says nothing, what it said before."""

    plant: Shown

    def __post_init__(self) -> None:
        super().__post_init__()
        self.rows: list[tuple[float, ...]] = []
        self._scales = position_control(setup()).settings("fixed")
        self._gap = math.nan

    def tick(self, beats: bool = True) -> tuple[float, ...]:
        row, scales = super().tick(beats), self._scales
        answer = self.bus.answer
        assert answer is not None
        middle, full = scales["gap_middle"], scales["position_full"]
        gap = middle - full * self.plant.reading.position
        self._gap = gap if math.isfinite(gap) else self._gap
        demand = answer.demand / Q31 * scales["demand_full"]
        place = (middle - full * answer.reference / Q31, self._gap)
        codes = answer.state & 0xFF, answer.mode >> 16
        self.rows.append((row[0], *place, row[3], self.plant.load, demand, *codes))
        return row

    def steps(self) -> None:
        for height in HEIGHTS if self.state is State.RUN else ():
            self.aim(bearings.GAP + height)
            for _ in range(1500):
                self.tick()


def recorded(firmware: Path, act: Act) -> tuple[Recording, int]:
    """Fly steps, then with something that is done, then steps again; until when all was well."""
    plant = Shown(setup(), 1, drifted_plant(setup().rig, WRONG, 1))
    with run_library(firmware, plant) as board, ControllerLink(board.link) as link:
        running = Recorded(plant, board.bus, link)
        for command in (Command.NONE, Command.DEMAGNETISED, Command.LIFT):
            running.aim(bearings.GAP)
            running.command(command)
            for _ in range(9000 if command is Command.LIFT else 120):
                running.tick()
        running.steps()
        good = len(running.rows)
        for n in range(5000):
            running.tick(beats=act(running, n))
        plant.shown, plant.load, plant.bearing.supply = None, plant.rest_load, plant.supply
        running.steps()
    return Recording(dict(zip(COLUMNS, np.array(running.rows).T, strict=True))), good


def learnt(run: Recording) -> dict[str, tuple[float, float]]:
    """Numbers and their standard deviations; none where nothing is taken."""
    (method,) = taught(run).file.method
    return {one.name: (one.value, one.sigma) for one in method.parameter if method.taken}


@cache
def without_a_fault(firmware: Path) -> tuple[dict[str, tuple[float, float]], ...]:
    """What is learnt of the steps before, and of all of a flight in which nothing happens."""
    run, good = recorded(firmware, lambda *_: True)
    return learnt(run.part(0, good)), learnt(run)


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(one, id=one.name, marks=() if one.name in OFTEN else pytest.mark.campaign)
        for one in injections()
    ],
)
def test_a_fault_of_the_flight_list_moves_nothing_that_was_learnt(
    tmp_path_factory: pytest.TempPathFactory, fault: Injection
) -> None:
    firmware = bearings.firmware(tmp_path_factory)
    run, _ = recorded(firmware, fault.act)
    if fault.reason is Fault.MISSED_TICK:
        with pytest.raises(InputError, match="record every tick once"):
            taught(run)
        return
    flies_on = bool(run["state"][-1] == State.RUN)
    assert flies_on == (fault.reason is Fault.NONE)
    wanted = without_a_fault(firmware)[flies_on]
    assert len(wanted) == 4
    for name, (value, sigma) in learnt(run).items():
        assert abs(value - wanted[name][0]) <= sigma, name
