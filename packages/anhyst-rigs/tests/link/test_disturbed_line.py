"""Test that no request is lost or repeated unnoticed on a disturbed line of pseudo-terminals."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from anhyst.support.block_words import set_generation
from anhyst.support.states import Command, State
from anhyst_rigs.link.client import ControllerLink
from anhyst_rigs.link.frames import Setting
from anhyst_rigs.link.virtual_boards import RunningFirmware, run_host
from tests.refusals import refused

from .plant import NoisyPlant
from .proxy import Disturbance, disturbed_line

DAMAGE = {
    "flip": Disturbance(flip=0.05),
    "drop": Disturbance(drop=0.05),
    "duplicate": Disturbance(duplicate=0.2),
    "reorder": Disturbance(reorder=0.05),
    "insert": Disturbance(insert=0.1),
    "all": Disturbance(flip=0.02, drop=0.02, duplicate=0.05, reorder=0.02, insert=0.02),
}
STEP = 1_000_000


@contextmanager
def session(firmware: Path, line: Disturbance) -> Iterator[tuple[RunningFirmware, ControllerLink]]:
    """A running controller behind a disturbed line; it was also started over this line."""
    with (
        disturbed_line(line) as ends,
        run_host(firmware, NoisyPlant(), ends.controller) as board,
        ControllerLink(ends.pc, timeout=0.02, attempts=200) as controller,
    ):
        board.bus.step(40)
        controller.command(Command.ARM)
        controller.command(Command.RUN)
        yield board, controller


def other(line: Disturbance) -> Disturbance:
    """The same damage, counted again."""
    return Disturbance(line.flip, line.drop, line.duplicate, line.reorder, line.insert)


@pytest.mark.first(1)
@pytest.mark.parametrize("kind", DAMAGE)
def test_every_demand_is_done_once_and_in_its_tick(host_firmware: Path, kind: str) -> None:
    line = other(DAMAGE[kind])
    with session(host_firmware, line) as (board, controller):
        for n in range(1, 151):
            tick = controller.demand(n * STEP).tick
            assert tick == board.bus.tick
            board.bus.step()
            assert controller.status().codes.demand == n * STEP
    assert sum(line.done.values()) > 10
    assert controller.repeated_count > 0 or kind == "duplicate"


@pytest.mark.first(2)
@pytest.mark.parametrize("kind", DAMAGE)
def test_streamed_demands_all_arrive_and_the_last_one_stays(host_firmware: Path, kind: str) -> None:
    line = other(DAMAGE[kind])
    with session(host_firmware, line) as (board, controller):
        answers = list(controller.stream((n * STEP for n in range(1, 501)), window=12))
        board.bus.step()
        last = controller.status().codes.demand
    assert len(answers) == 500
    assert last == 500 * STEP
    assert sum(line.done.values()) > 10


def test_streamed_demands_reach_the_controller_in_order(host_firmware: Path) -> None:
    line = other(DAMAGE["all"])
    with session(host_firmware, line) as (board, controller):
        seen = []
        for answer in controller.stream((n * STEP for n in range(1, 301)), window=12):
            board.bus.step()
            seen.append(answer.codes.demand)
        board.bus.step()
        seen.append(controller.status().codes.demand)
    rises = [b - a for a, b in pairwise(seen)]
    back = [rise for rise in rises if rise < 0]
    assert all(rise > -12 * STEP for rise in back)  # not older than the frames in transit
    assert seen[-1] == 300 * STEP


def test_every_command_is_done_exactly_once(host_firmware: Path) -> None:
    line = other(DAMAGE["all"])
    with session(host_firmware, line) as (_, controller):
        for _ in range(40):  # a repeated request would be refused
            assert controller.command(Command.STOP) is State.READY
            assert controller.command(Command.RUN) is State.RUN
    assert controller.repeated_count > 0


def test_blocks_settings_and_recordings_arrive_whole(host_firmware: Path) -> None:
    line = other(DAMAGE["all"])
    with session(host_firmware, line) as (board, controller):
        words = controller.read_block()
        for generation in (11, 12, 13):
            assert controller.write_block(set_generation(words, generation)) == generation
            assert controller.read_block() == set_generation(words, generation)
        for value in range(100, 120):
            assert controller.write_setting(Setting.HEARTBEAT_TICKS, value) == value
        for _ in range(10):
            board.bus.step(30)
            controller.status()
    assert sum(line.done.values()) > 10


def test_a_cut_line_is_reported_and_the_current_ramps_to_zero(host_firmware: Path) -> None:
    line = Disturbance()
    with session(host_firmware, line) as (board, controller):
        controller.demand(500 * STEP)
        board.bus.step(5)
        assert board.bus.drive > 0.1
        line.cut = True
        controller.attempts = 3
        with refused("no-answer"):
            controller.status()
        board.bus.step(1000)
        assert board.bus.drive == 0.0
        assert board.bus.state is State.FAULT
