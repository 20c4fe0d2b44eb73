"""Test that faults reduce the current to zero within the stated milliseconds."""

from __future__ import annotations

import math

import pytest

from anhyst.support.states import Command, Fault, State
from anhyst_rigs.link.client import ControllerLink, RequestRefusedError
from anhyst_rigs.link.frames import Setting
from anhyst_rigs.link.virtual_boards import RunningFirmware
from tests.refusals import refused

from .conftest import RATE
from .plant import NoisyPlant

HALF = 1 << 30


def run(board: RunningFirmware, controller: ControllerLink) -> NoisyPlant:
    """Bring a controller to run at half of the full-scale force; return its plant."""
    controller.command(Command.ARM)
    controller.command(Command.RUN)
    controller.demand(HALF)
    board.bus.step(20)
    assert board.bus.state is State.RUN
    assert board.bus.drive > 0.2
    plant = board.bus.plant
    assert isinstance(plant, NoisyPlant)
    return plant


def milliseconds_to_zero(board: RunningFirmware, most: int) -> float:
    """Virtual time until the current driven is zero."""
    for tick in range(most):
        if board.bus.drive == 0.0:
            return 1e3 * tick / RATE
        board.bus.step()
    raise AssertionError(f"the current is {board.bus.drive} after {most} ticks")


def test_a_lost_link_brings_the_current_to_zero_in_time(
    board: RunningFirmware, controller: ControllerLink
) -> None:
    run(board, controller)
    timeout = 1e3 * controller.read_setting(Setting.HEARTBEAT_TICKS) / RATE
    board.bus.step(round(timeout * RATE / 1e3) - 1)
    assert board.bus.state is State.RUN
    assert milliseconds_to_zero(board, 1000) <= controller.info.ramp + 2e3 / RATE
    assert timeout == 100.0
    status = controller.status()
    assert (status.state, status.fault) == (State.FAULT, Fault.LINK_LOST)


def test_a_shorter_timeout_is_respected(board: RunningFirmware, controller: ControllerLink) -> None:
    run(board, controller)
    controller.write_setting(Setting.HEARTBEAT_TICKS, 8)
    board.bus.step(8)
    assert board.bus.state is State.RUN
    board.bus.step()
    assert board.bus.fault is Fault.LINK_LOST
    assert milliseconds_to_zero(board, 1000) <= controller.info.ramp


@pytest.mark.parametrize(
    ("reading", "fault"),
    [
        ({"gap": math.nan}, Fault.GAP_RESERVED),
        ({"gap": 1.2}, Fault.GAP_RANGE),
        ({"gap": 0.9}, Fault.GAP_SLEW),
        ({"force": math.nan}, Fault.FORCE_RESERVED),
        ({"force": -0.5}, Fault.FORCE_RANGE),
        ({"current": math.nan}, Fault.CURRENT_RESERVED),
        ({"current": 1.9}, Fault.CURRENT_RANGE),
    ],
)
def test_a_wrong_sensor_is_detected(
    board: RunningFirmware, controller: ControllerLink, reading: dict[str, float], fault: Fault
) -> None:
    plant = run(board, controller)
    plant.reading = reading
    board.bus.step(8)
    assert board.bus.fault is fault
    assert milliseconds_to_zero(board, 1000) <= controller.info.ramp


def test_a_stuck_sensor_is_detected_while_the_current_changes(
    board: RunningFirmware, controller: ControllerLink
) -> None:
    plant = run(board, controller)
    plant.reading = {"gap": 0.5}
    for n in range(40):
        controller.demand(HALF // 2 if n % 2 else HALF)
        board.bus.step(20)
    assert board.bus.fault is Fault.GAP_STUCK


def test_a_constant_gap_is_not_a_fault(board: RunningFirmware, controller: ControllerLink) -> None:
    run(board, controller)
    for n in range(40):
        controller.demand(HALF // 2 if n % 2 else HALF)
        board.bus.step(20)
    assert board.bus.fault is Fault.NONE


def test_missed_ticks_are_counted_and_too_many_are_a_fault(
    board: RunningFirmware, controller: ControllerLink
) -> None:
    run(board, controller)
    board.bus.skip_ticks(2)
    board.bus.step()
    assert controller.status().codes.missed_ticks == 2
    assert board.bus.state is State.RUN
    board.bus.skip_ticks(3)
    board.bus.step()
    assert board.bus.fault is Fault.MISSED_TICK


def test_the_first_reason_stays_until_it_is_cleared(
    board: RunningFirmware, controller: ControllerLink
) -> None:
    plant = run(board, controller)
    plant.reading = {"force": math.nan}
    board.bus.step(8)
    plant.reading = {"gap": 2.0}
    with refused("refused current", RequestRefusedError):
        controller.command(Command.CLEAR)  # current still flows
    board.bus.step(200)
    assert controller.status().fault is Fault.FORCE_RESERVED
    plant.reading = {}
    assert controller.command(Command.CLEAR) is State.SELFTEST
    board.bus.step(40)
    status = controller.status()
    assert (status.state, status.fault) == (State.IDLE, Fault.NONE)
