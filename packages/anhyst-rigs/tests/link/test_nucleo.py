"""Test the firmware of the Nucleo on an emulated processor with the registers that it uses."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import pytest

from anhyst.support.block_layout import MAX_BLOCK_WORDS
from anhyst.support.block_words import set_generation
from anhyst.support.states import Command, Fault, State
from anhyst_rigs.link import frames
from anhyst_rigs.link.firmware import build
from anhyst_rigs.link.frames import (
    ANSWERS,
    AckAnswer,
    BlockBeginRequest,
    BlockDataRequest,
    BlockSwapRequest,
    CommandRequest,
    DemandRequest,
    HeartbeatRequest,
    HelloRequest,
    InfoAnswer,
    KeepRequest,
    Message,
    StatusAnswer,
)
from anhyst_rigs.link.wire import Receiver, encode
from tests.once import made_once
from tests.verification.test_verify_controller import compile_bearing

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
    frames_back = Receiver().feed(chip.send())
    for _ in range(200):  # the main loop needs several runs for a block
        if frames_back:
            break
        chip.main_loop()
        frames_back = Receiver().feed(chip.send())
    (frame,) = frames_back
    assert frame.sequence == sequence
    return ANSWERS[frame.type].unpack(frame.payload)


def test_the_clocks_make_the_rates_that_are_claimed(chip: Chip) -> None:
    pll = chip.written[0x40023804]
    core = 8e6 / (pll & 0x3F) * (pll >> 6 & 0x1FF) / 2
    assert core == 166e6
    for line in (nucleo.LINK, nucleo.XCP):
        divider = chip.written[line.port + nucleo.BRR]
        assert core / 4 / divider == pytest.approx(921600, rel=1e-3)
    assert core / 2 / (chip.written[0x4000002C] + 1) == pytest.approx(RATE, rel=1e-4)
    watchdog = chip.written[0x40003008] * 4 / 32e3
    assert 4 / RATE < watchdog < 0.01


def test_the_firmware_answers_over_its_serial_port(chip: Chip) -> None:
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


def settled(chip: Chip) -> Chip:
    """Pass the self-test and open a session."""
    for n in range(120):
        chip.codes[0] = 2048 + n % 2
        chip.tick()
    ask(chip, HelloRequest(frames.VERSION, 7), 1)
    return chip


def status_of(chip: Chip, sequence: int) -> StatusAnswer:
    status = ask(chip, HeartbeatRequest(), sequence)
    assert isinstance(status, StatusAnswer)
    return status


@pytest.mark.parametrize(
    ("pin", "fault"),
    [
        (nucleo.STOP_CLOSED, Fault.EMERGENCY_STOP),
        (nucleo.AMPLIFIER_READY, Fault.AMPLIFIER),
        (nucleo.CURRENT_FINE, Fault.OVER_CURRENT),
    ],
)
def test_an_input_that_falls_is_a_fault(chip: Chip, pin: int, fault: Fault) -> None:
    settled(chip)
    assert status_of(chip, 2).fault == Fault.NONE
    assert chip.written[nucleo.TIM1_BDTR] & nucleo.OUTPUTS_ON
    chip.inputs &= ~pin
    chip.tick()
    assert status_of(chip, 3).fault == fault


def test_an_over_current_is_cut_by_the_timer_and_works_again_at_zero(chip: Chip) -> None:
    settled(chip)
    ask(chip, CommandRequest(Command.ARM), 2)
    ask(chip, CommandRequest(Command.RUN), 3)
    ask(chip, DemandRequest(1 << 29), 4)
    chip.tick()
    pulses = chip.written[nucleo.TIM1_CCR2]
    assert pulses == chip.written[nucleo.DAC_DHR12R1] > 0
    assert chip.written[nucleo.TIM1_CCMR1] & 0x70 == nucleo.STAGE_ON
    chip.inputs &= ~nucleo.CURRENT_FINE
    chip.tick()
    assert not chip.written[nucleo.TIM1_BDTR] & nucleo.OUTPUTS_ON
    chip.inputs |= nucleo.CURRENT_FINE
    while chip.written[nucleo.TIM1_CCR2]:  # the ramp to zero
        assert not chip.written[nucleo.TIM1_BDTR] & nucleo.OUTPUTS_ON
        chip.tick()
    assert chip.written[nucleo.TIM1_BDTR] & nucleo.OUTPUTS_ON
    assert status_of(chip, 5).fault == Fault.OVER_CURRENT


def test_the_status_reports_the_cycles_of_a_tick(chip: Chip) -> None:
    settled(chip)
    assert status_of(chip, 2).cycles == 1000  # the counter is read twice per tick


def test_a_stored_block_is_used_after_the_next_start(chip: Chip, program: Path, parameters: Path) -> None:
    settled(chip)
    words = block_of(parameters)
    kept = set_generation(words, 7)
    send_block(chip, kept, 2)
    before = chip.flash()
    assert isinstance(ask(chip, KeepRequest(), 40), AckAnswer)
    assert chip.flash() != before
    again = Chip(program, chip.flash())
    again.start()
    info = ask(again, HelloRequest(frames.VERSION, 8), 1)
    assert isinstance(info, InfoAnswer)
    assert info.generation == 7
    chip.tick()
    assert status_of(chip, 41).fault == Fault.NONE
    assert status_of(chip, 42).missed_ticks == 0


WORKS = {n: () if n in {0, 1, 2, 300, 538} else pytest.mark.campaign for n in range(539)}
"""Numbers of flash operations (words and erasures) after which the power fails while a set is
stored."""


@pytest.mark.parametrize("works", [pytest.param(n, marks=mark) for n, mark in WORKS.items()])
def test_a_power_failure_during_storing_keeps_the_previous_block(
    chip: Chip, program: Path, parameters: Path, works: int
) -> None:
    settled(chip)
    words = block_of(parameters)
    send_block(chip, set_generation(words, 7), 2)
    ask(chip, KeepRequest(), 40)
    send_block(chip, set_generation(words, 8), 41)
    chip.power = works
    chip.receive(encode(KeepRequest(), 80))
    while not chip.dead:
        chip.main_loop()
    again = Chip(program, chip.flash())
    again.start()
    info = ask(again, HelloRequest(frames.VERSION, 9), 1)
    assert isinstance(info, InfoAnswer)
    assert info.generation == 7


def block_of(parameters: Path) -> list[int]:
    """Return the words of the built-in block."""
    text = (parameters / "handmade_parameters.c").read_text()
    return [int(word) for word in text[text.index("{") + 1 : text.index("}")].split(",")]


def send_block(chip: Chip, words: list[int], sequence: int) -> None:
    """Send a block and activate it."""
    generation = words[5]
    data = b"".join((word & 0xFFFF).to_bytes(2, "little") for word in words)
    begin = BlockBeginRequest(len(words), generation, zlib.crc32(data))
    ask(chip, begin, sequence)
    for at in range(0, len(words), 100):
        sequence += 1
        ask(chip, BlockDataRequest(at, tuple(words[at : at + 100])), sequence)
    chip.tick()
    answer = ask(chip, BlockSwapRequest(generation), sequence + 1)
    assert isinstance(answer, AckAnswer)


@pytest.fixture(scope="module")
def bearing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the firmware around the bundled bearing's controller."""
    folder = made_once(tmp_path_factory, "compiled-bearing", compile_bearing) / "out"
    return build("nucleo", folder, tmp_path_factory.mktemp("nucleo") / "bearing.elf")


def kept_set(position: tuple[int, ...], source: int) -> bytes:
    """Return a flash with a stored set: calibrations and source of the position, without a block."""
    live_zero = (410, 327760, 0, 80, 4015)
    numbers = [1, *live_zero * 3, *position, source, 0]
    payload = struct.pack(f"<{len(numbers)}i", *numbers) + bytes(2 * MAX_BLOCK_WORDS)
    copy = struct.pack("<III", 0x53594E41, 5, len(payload) // 4) + payload
    copy += struct.pack("<I", zlib.crc32(copy))
    return copy.ljust(2 * nucleo.SECTOR_BYTES, b"\xff")


@pytest.mark.slow
def test_the_encoder_counts_both_ways_round(bearing: Path) -> None:
    chip = Chip(bearing, kept_set((0, 100, 0, -(2**31), 2**31 - 1), 0))
    chip.start()
    ask(chip, HelloRequest(frames.VERSION, 7), 1)
    for sequence, edges in enumerate((100, -100, -20_000, -40_000, -30_000), start=2):
        chip.edges = edges
        chip.tick()
        assert status_of(chip, sequence).position == edges * 100


@pytest.mark.slow
def test_the_position_uses_the_calibration_in_flash(bearing: Path) -> None:
    chip = Chip(bearing, kept_set((32768, -200, 1, 100, 65000), 1))
    chip.start()
    ask(chip, HelloRequest(frames.VERSION, 7), 1)
    for sequence, code in enumerate((32768, 40000, 20001), start=2):
        chip.place = code
        chip.tick()
        assert status_of(chip, sequence).position == (code - 32768) * -100


@pytest.mark.slow
def test_a_converter_that_does_not_answer_is_a_fault(bearing: Path) -> None:
    chip = Chip(bearing, kept_set((32768, 65536, 0, 100, 65000), 1))
    chip.start()
    for n in range(200):
        chip.place = 32768 + n % 3
        chip.tick()
    ask(chip, HelloRequest(frames.VERSION, 7), 1)
    assert status_of(chip, 2).fault == Fault.NONE
    chip.place = None
    for _ in range(20):
        chip.tick()
    assert status_of(chip, 3).fault in {Fault.POSITION_MISSING, Fault.SENSOR_FAILED}
