"""Test a session with a controller process over a pseudo-terminal."""

from __future__ import annotations

from pathlib import Path

import pytest

from anhyst.support.block_words import set_generation
from anhyst.support.states import Command, Flag, State
from anhyst_rigs.link import frames
from anhyst_rigs.link.client import ControllerLink, RequestRefusedError
from anhyst_rigs.link.frames import (
    AckAnswer,
    BlockBeginRequest,
    BlockDataRequest,
    BlockSwapRequest,
    Reason,
    Setting,
)
from anhyst_rigs.link.virtual_boards import Q30, Q31, RunningFirmware, run_host
from tests.refusals import refused

from .conftest import RATE
from .plant import NOISE, NoisyPlant

TENTH = (1 << 31) // 10


def run(board: RunningFirmware, controller: ControllerLink) -> None:
    """Bring a controller that is idle to run."""
    controller.command(Command.ARM)
    controller.command(Command.RUN)
    board.bus.step()
    assert board.bus.state is State.RUN


def test_a_controller_identifies_itself(controller: ControllerLink) -> None:
    assert controller.info.rate == RATE
    assert controller.info.version == frames.VERSION
    assert controller.status().state is State.IDLE


def test_a_demand_becomes_a_current_two_ticks_later(
    board: RunningFirmware, controller: ControllerLink
) -> None:
    run(board, controller)
    before = controller.demand(3 * TENTH)
    assert before.codes.demand == 0
    board.bus.step()
    after = controller.status()
    assert after.tick == before.tick + 1
    assert after.codes.demand == 3 * TENTH
    assert after.codes.drive / Q31 == board.bus.drive > 0.1
    assert after.codes.current / Q30 == pytest.approx(0.0, abs=6 * NOISE)
    board.bus.step(2)
    flows = controller.status().codes.current / Q30
    assert flows == pytest.approx(after.codes.drive / Q31, abs=0.01)


def test_sensors_come_back_as_they_were_shown(host_firmware: Path) -> None:
    plant = NoisyPlant()
    plant.reading = {"gap": 0.25, "force": 0.5, "current": -0.125}
    with run_host(host_firmware, plant, "tcp:0") as board:
        board.bus.step(3)
        with ControllerLink(board.url, timeout=1.0) as controller:
            status = controller.status()
    codes = status.codes
    assert (codes.gap, codes.force, codes.current) == (0.25 * Q30, 0.5 * Q30, -0.125 * Q30)
    assert status.tick == 3


def test_commands_that_do_not_fit_the_state_are_refused(controller: ControllerLink) -> None:
    with refused("refused state", RequestRefusedError) as answer:
        controller.command(Command.RUN)
    assert answer.value.reason is Reason.STATE
    assert controller.status().state is State.IDLE


def test_settings_are_read_and_written(controller: ControllerLink) -> None:
    assert controller.read_setting(Setting.HEARTBEAT_TICKS) == RATE // 10
    assert controller.write_setting(Setting.DEMAND_SLEW, 12345) == 12345
    assert controller.read_setting(Setting.DEMAND_SLEW) == 12345
    with refused("refused value", RequestRefusedError):
        controller.write_setting(Setting.DEMAND_SLEW, 0)
    assert controller.read_setting(Setting.DEMAND_SLEW) == 12345


def test_demands_beyond_the_model_are_limited_and_reported(
    board: RunningFirmware, controller: ControllerLink
) -> None:
    run(board, controller)
    controller.demand((1 << 31) - 1)
    board.bus.step()
    assert Flag.DEMAND_LIMITED in Flag(controller.status().codes.flags)
    with refused("beyond-full-scale"):
        controller.demand(1 << 31)


def test_a_block_is_swapped_between_two_ticks_while_it_runs(
    board: RunningFirmware, controller: ControllerLink
) -> None:
    run(board, controller)
    controller.demand(2 * TENTH)
    board.bus.step(3)
    drive = controller.status().codes.drive
    words = controller.read_block()
    assert controller.write_block(set_generation(words, 40001)) == 40001
    board.bus.step()
    status = controller.status()
    assert status.codes.generation == 40001
    assert status.state is State.RUN
    assert status.codes.drive == pytest.approx(drive, abs=1e-6 * Q31)
    assert controller.read_block() == set_generation(words, 40001)


@pytest.mark.parametrize("at", [8, 33, -1])
def test_a_corrupted_block_is_rejected_and_the_old_one_stays(controller: ControllerLink, at: int) -> None:
    old = controller.read_block()
    spoilt = set_generation(old, 7)
    spoilt[at] ^= 1
    with refused("refused block", RequestRefusedError) as answer:
        controller.write_block(spoilt)
    assert answer.value.reason is Reason.BLOCK
    assert controller.status().codes.generation == 0
    assert controller.read_block() == old


def test_a_block_that_arrives_incomplete_is_not_put_in_force(controller: ControllerLink) -> None:
    controller.request(BlockBeginRequest(64, 3, 0), AckAnswer)
    with pytest.raises(RequestRefusedError) as answer:
        controller.request(BlockDataRequest(20, (1, 2)), AckAnswer)
    assert (answer.value.reason, answer.value.detail) == (Reason.ORDER, 0)
    with pytest.raises(RequestRefusedError):
        controller.request(BlockSwapRequest(3), AckAnswer)
    assert controller.status().codes.generation == 0


def test_demands_stream_in_order(board: RunningFirmware, controller: ControllerLink) -> None:
    run(board, controller)
    forces = [n * 1000 for n in range(300)]
    answers = list(controller.stream(forces, window=16))
    assert len(answers) == 300
    board.bus.step()
    assert controller.status().codes.demand == forces[-1]
    assert controller.status().codes.lost_frames == 0
    with refused("beyond-full-scale"):
        list(controller.stream([0, 1 << 31]))
    with refused("out-of-range"):
        list(controller.stream(forces, window=33))
