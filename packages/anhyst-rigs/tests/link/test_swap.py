"""Test parameter swaps while current flows: equal signals, and the limit of the ramp."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from anhyst.compensate.builder import build_block
from anhyst.support.block_words import Scales, set_generation
from anhyst.support.states import Command
from anhyst_rigs.link.client import ControllerLink, RequestRefusedError
from anhyst_rigs.link.frames import Reason
from anhyst_rigs.link.virtual_boards import RunningFirmware
from tests.actuators import SIZES, closed_form, compiled, magnet, ranges

from .conftest import RATE
from .handmade import KIND

FULL = (1 << 31) - 1
STEP = 1.0 / (0.020 * RATE)
"""Largest current change per tick of the ramp, relative to full scale; ``info.ramp`` gives its
ticks."""


def made_for(scales: Scales) -> list[int]:
    """Return a block of the board's actuator compiled for other scales, with its gaps."""
    law = closed_form("reluctance")
    made = build_block(magnet(), "simplified", scales, ranges("reluctance")[1], SIZES, closed_form=law)
    return set_generation(made.words.tolist(), 7)


def weaker(part: float) -> list[int]:
    """Return the board's block with all currents multiplied by a factor."""
    block = compiled(KIND)
    words = block.words.copy()
    for name in ("GAP_BIAS", "GAP_FLUX_ARM", "GAP_FIELD_ARM"):
        first, entries = block.tables[name]
        words[first : first + entries] = np.rint(words[first : first + entries] * part)
    return set_generation(words.tolist(), 8)


def at_full_demand(board: RunningFirmware, controller: ControllerLink) -> None:
    controller.command(Command.ARM)
    controller.command(Command.RUN)
    controller.demand(FULL)
    board.bus.step(4)
    assert board.bus.drive > 0.6


@pytest.mark.parametrize("name", ["demand", "current", "gap_low", "gap_high"])
def test_a_block_made_for_another_board_is_refused_in_one_line(
    board: RunningFirmware, controller: ControllerLink, name: str
) -> None:
    at_full_demand(board, controller)
    own, drive = ranges("reluctance")[0], board.bus.drive
    other = 1.25 * getattr(own, name)
    with pytest.raises(RequestRefusedError) as refused:
        controller.write_block(made_for(replace(own, **{name: other})))
    assert refused.value.reason is Reason.SCALE
    text = str(refused.value)
    unit = {"demand": "N", "current": "A"}.get(name, "m")
    mine, theirs = re.findall(rf"([\d.e-]+) {unit}\b", text)
    assert float(mine) == pytest.approx(other, rel=1e-6)
    assert float(theirs) == pytest.approx(getattr(own, name), rel=1e-6)
    assert "\n" not in text
    board.bus.step(3)
    assert board.bus.drive == pytest.approx(drive, abs=1e-3)
    assert controller.status().codes.generation == 0


def follow(board: RunningFirmware, controller: ControllerLink, words: list[int]) -> list[float]:
    """Activate a block and return the currents from the last one before it."""
    drives = [board.bus.drive]
    controller.write_block(words)
    for _ in range(30):
        board.bus.step()
        drives.append(board.bus.drive)
    return drives


def test_a_swap_at_full_demand_moves_the_current_along_the_ramp(
    board: RunningFirmware, controller: ControllerLink
) -> None:
    at_full_demand(board, controller)
    less = follow(board, controller, weaker(0.8))
    again = follow(board, controller, set_generation(compiled(KIND).words.tolist(), 9))
    for drives, factor in ((less, 0.8), (again, 1.25)):
        assert np.abs(np.diff(drives)).max() <= STEP * (1.0 + 1e-6)
        # The driven current counts: a larger one leaves the iron on its descending branch.
        assert drives[-1] == pytest.approx(factor * drives[0], rel=0.08)
        assert abs(drives[-1] - drives[-2]) < 0.1 * STEP
    controller.demand(0)
    board.bus.step()
    assert board.bus.drive < 0.2  # then with the usual rate
