"""Test the framing in C against independent Python code, and the code made from the frame table."""

from __future__ import annotations

import binascii
import ctypes
import random
import struct
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from anhyst_rigs.link import frames

from .build import ROOT, compile_c, tool


def encode_cobs(payload: bytes) -> bytes:
    """Encode by definition: put the offset of the next zero before each piece between zeros."""
    encoded = bytearray()
    for piece in (payload + b"\0").split(b"\0")[:-1]:
        remaining_bytes = piece
        while len(remaining_bytes) >= 254:
            encoded += b"\xff" + remaining_bytes[:254]
            remaining_bytes = remaining_bytes[254:]
        encoded += bytes([len(remaining_bytes) + 1]) + remaining_bytes
    return bytes(encoded)


def encode_frame(kind: int, sequence: int, tick: int, payload: bytes) -> bytes:
    """Return a frame as it must be sent."""
    plain_bytes = struct.pack("<BBBBI", frames.VERSION, kind, sequence, len(payload), tick) + payload
    return encode_cobs(plain_bytes + struct.pack("<I", binascii.crc32(plain_bytes))) + b"\0"


class CFrame(ctypes.Structure):
    _fields_ = (
        ("version", ctypes.c_uint8),
        ("type", ctypes.c_uint8),
        ("sequence", ctypes.c_uint8),
        ("length", ctypes.c_uint8),
        ("tick", ctypes.c_uint32),
        ("payload", ctypes.POINTER(ctypes.c_uint8)),
        ("check", ctypes.c_uint32),
    )


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The C framing as a loaded library."""
    library_file = tmp_path_factory.mktemp("framing") / "framing.so"
    sources = [ROOT / "firmware" / "link" / name for name in ("frame.c", "crc.c")]
    completed = compile_c(tool("cc", "gcc"), sources, library_file, "-shared", "-fPIC")
    assert completed.returncode == 0, completed.stderr
    loaded_library = ctypes.CDLL(str(library_file))
    loaded_library.link_crc32.restype = ctypes.c_uint32
    loaded_library.link_encode.restype = ctypes.c_uint16
    return loaded_library


def payloads() -> list[bytes]:
    """Payloads of every length, with many zeros and without zeros."""
    draw = random.Random(1)
    lengths = range(frames.MAX_PAYLOAD_BYTES + 1)
    nonzero_payloads = [bytes(draw.choice((0, 0, 1, 255)) for _ in range(n)) for n in lengths]
    return nonzero_payloads + [draw.randbytes(n) for n in lengths] + [b"\x01" * n for n in lengths]


def test_crc_is_that_of_zip(library: ctypes.CDLL) -> None:
    assert library.link_crc32(0, b"123456789", 9) == 0xCBF43926  # check value of the CRC catalogue
    for payload in payloads():
        assert library.link_crc32(0, payload, len(payload)) == binascii.crc32(payload)
    crc_of_halves = library.link_crc32(library.link_crc32(0, b"half ", 5), b"and half", 8)
    assert crc_of_halves == binascii.crc32(b"half and half")


def test_frames_follow_the_definition(library: ctypes.CDLL) -> None:
    out = (ctypes.c_uint8 * 300)()
    for number, payload in enumerate(payloads()):
        row = (ctypes.c_uint8 * max(len(payload), 1)).from_buffer_copy(payload or b"\0")
        tick, sequence = number * 0x01010101 & 0xFFFFFFFF, number & 0xFF
        frame = CFrame(frames.VERSION, 0x82, sequence, len(payload), tick, row, 0)
        count = library.link_encode(out, ctypes.byref(frame))
        assert bytes(out[:count]) == encode_frame(0x82, sequence, tick, payload)


def test_frames_of_the_definition_are_received(library: ctypes.CDLL) -> None:
    receiver = (ctypes.c_uint8 * 512)()
    library.link_receiver_start(receiver)
    frame = CFrame()
    for number, payload in enumerate(payloads()):
        encoded = encode_frame(0x03, number & 0xFF, number, payload)
        complete = [library.link_receive(receiver, byte, ctypes.byref(frame)) for byte in encoded]
        assert complete == [0] * (len(encoded) - 1) + [1]
        assert (frame.type, frame.sequence, frame.tick) == (0x03, number & 0xFF, number)
        assert bytes(frame.payload[: frame.length]) == payload


def test_files_generated_from_the_contract_are_up_to_date() -> None:
    script = ROOT / "tools" / "contract"
    completed = subprocess.run(
        [sys.executable, str(script), "--check"], capture_output=True, text=True, check=False
    )
    assert completed.returncode == 0, completed.stdout + completed.stderr


MESSAGES = [
    kind
    for kind in vars(frames).values()
    if isinstance(kind, type) and issubclass(kind, frames.Message) and kind is not frames.Message
]


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
def test_messages_come_back_as_they_were_packed(kind: type[frames.Message]) -> None:
    numbers: list[int | tuple[int, ...]] = [n + 1 for n in range(len(fields(kind)))]
    if kind.TAIL:
        numbers[-1] = (1, 2, 3) if kind.TAIL.isupper() else (1, -2, 3)
    message = kind(*numbers)
    assert kind.unpack(message.pack()) == message
    if kind.TAIL != "B":  # a byte array has a variable length
        with pytest.raises(ValueError, match=kind.__name__):
            kind.unpack(message.pack() + b"\0")


def test_message_types_are_distinct_and_every_request_has_an_answer() -> None:
    types = [kind.TYPE for kind in MESSAGES]
    assert len(set(types)) == len(types)
    requests = [kind for kind in MESSAGES if kind.TYPE < 0x80]
    assert requests
    assert all(vars(kind)["ANSWER"] in frames.ANSWERS for kind in requests)


def test_values_out_of_range_are_not_packed() -> None:
    with pytest.raises(ValueError, match="DemandRequest"):
        frames.DemandRequest(2**31).pack()


def test_python_and_c_agree_on_sizes(tmp_path: Path) -> None:
    lines = [
        f"typedef char of_{kind.__name__}[LINK_SIZE_{name} == {kind.FIXED.size} ? 1 : -1];"
        for kind in MESSAGES
        for name in [snake_case(kind.__name__)]
    ]
    for record in (frames.PlantSample, frames.PlantDrive):
        size = record.FIXED.size + 4
        lines.append(
            f"typedef char of_{record.__name__}"
            f"[LINK_SIZE_{snake_case(record.__name__ + 'Record')} == {size} ? 1 : -1];"
        )
    source = tmp_path / "sizes.c"
    source.write_text('#include "link/frames.h"\n' + "\n".join(lines) + "\n", encoding="utf-8")
    completed = compile_c(tool("cc", "gcc"), [source], tmp_path, "-c")
    assert completed.returncode == 0, completed.stderr


def snake_case(name: str) -> str:
    """Return the C name of a Python frame class."""
    stem = name.removesuffix("Request").removesuffix("Answer").removesuffix("Record")
    return "".join(f"_{c}" if c.isupper() and i else c for i, c in enumerate(stem)).upper()


def test_a_record_of_the_plant_that_slipped_is_refused() -> None:
    record = frames.PlantSample(7, -1, 2, -3, 4, -5, 0)
    assert frames.PlantSample.unpack(record.pack()) == record
    with pytest.raises(ValueError, match="PlantSample"):
        frames.PlantSample.unpack(record.pack()[1:] + b"\0")
