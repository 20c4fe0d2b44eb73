"""The Nucleo's firmware, run on an emulated processor with the registers that it touches."""

from __future__ import annotations

from pathlib import Path

import pytest

from anhyst.link import frames
from anhyst.link.firmware import build
from anhyst.link.frames import (
    ANSWERS,
    CommandRequest,
    DemandRequest,
    HelloRequest,
    InfoAnswer,
    Message,
    StatusAnswer,
)
from anhyst.link.wire import Receiver, encode
from anhyst.states import Command, Fault, State

from . import nucleo
from .conftest import RATE
from .nucleo import Chip


@pytest.fixture(scope="module")
def program(parameters: Path) -> Path:
    return build("nucleo", parameters, parameters.parent / "nucleo.elf")


@pytest.fixture
def chip(program: Path) -> Chip:
    chip = Chip(program)
    chip.start()
    return chip


def ask(chip: Chip, request: Message, sequence: int) -> Message:
    """Send a request over the emulated serial port and return its answer."""
    chip.receive(encode(request, sequence))
    (frame,) = Receiver().feed(chip.send())
    assert frame.sequence == sequence
    return ANSWERS[frame.type].unpack(frame.payload)


def test_the_clocks_make_the_rates_that_are_claimed(chip: Chip) -> None:
    pll = chip.written[0x40023804]
    core = 8e6 / (pll & 0x3F) * (pll >> 6 & 0x1FF) / 2
    assert core == 166e6
    assert core / 4 / chip.written[0x40004408] == pytest.approx(921600, rel=1e-3)
    assert core / 2 / (chip.written[0x4000002C] + 1) == pytest.approx(RATE, rel=1e-4)
    watchdog = chip.written[0x40003008] * 4 / 32e3
    assert 4 / RATE < watchdog < 0.01


def test_it_answers_over_its_serial_port(chip: Chip) -> None:
    info = ask(chip, HelloRequest(frames.VERSION, 7), 1)
    assert isinstance(info, InfoAnswer)
    assert info.rate == RATE


def test_a_demand_becomes_a_code_of_the_converter(chip: Chip) -> None:
    for n in range(120):
        chip.codes = [2048 + n % 2, 410, 410]
        chip.tick()
    assert chip.written[nucleo.DAC_DHR12R1] == 0
    ask(chip, HelloRequest(frames.VERSION, 7), 1)
    ask(chip, CommandRequest(Command.ARM), 2)
    ask(chip, CommandRequest(Command.RUN), 3)
    ask(chip, DemandRequest(1 << 29), 4)
    chip.tick()
    status = ask(chip, DemandRequest(1 << 29), 5)
    assert isinstance(status, StatusAnswer)
    assert status.state == State.RUN
    assert status.drive > 0
    assert chip.written[nucleo.DAC_DHR12R1] == status.drive >> 19
    assert status.gap == pytest.approx((2048.5 - 410) / 3276 * 2**30, rel=1e-3)


def test_a_broken_wire_is_a_fault(chip: Chip) -> None:
    for code in (2048, 0):
        chip.codes[0] = code
        for _ in range(120):
            chip.tick()
    ask(chip, HelloRequest(frames.VERSION, 7), 1)
    status = ask(chip, DemandRequest(0), 2)
    assert isinstance(status, StatusAnswer)
    assert status.fault == Fault.GAP_RESERVED
