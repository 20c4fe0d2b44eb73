"""Frames on the wire.

Own frames: COBS, a zero at the end, and a checksum; as ``firmware/link/frame.c``. Packets of XCP stand
behind a length and a counter, 16 bits each. On TCP that is all; on a serial port they are filled up to
whole words and a checksum follows, the sum of all words, as ``firmware/xcp/line.h`` says.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

from anhyst.control.xcp_map import PACKET, SECRET
from anhyst.link.frames import VERSION, Message

_HEAD = struct.Struct("<BBBBI")
_CHECK = struct.Struct("<I")
_MOST = 254
"""Longest run without a zero that COBS joins; every frame is shorter."""


class Frame(NamedTuple):
    """A frame that arrived whole."""

    version: int
    type: int
    sequence: int
    tick: int
    payload: bytes


def encode(message: Message, sequence: int, tick: int = 0, version: int = VERSION) -> bytes:
    """Lay a message out as it goes over the line, the zero at the end included."""
    payload = message.pack()
    body = _HEAD.pack(version, message.TYPE, sequence, len(payload), tick) + payload
    return stuff(body + _CHECK.pack(zlib.crc32(body))) + b"\0"


def stuff(body: bytes) -> bytes:
    """Write bytes without a zero (COBS), for up to 253 of them."""
    return b"".join(bytes((len(run) + 1,)) + run for run in body.split(b"\0"))


def unstuff(stuffed: bytes) -> bytes | None:
    """Undo :func:`stuff`; None where these bytes cannot have come from it."""
    body = bytearray(stuffed)
    at = 0
    while at < len(stuffed):
        run, body[at] = stuffed[at], 0
        if run == 0:
            return None
        at += run
    return bytes(body[1:]) if at == len(stuffed) else None


class Receiver:
    """Finds frames in a stream of bytes; in step again one zero after any garbage."""

    def __init__(self) -> None:
        self.bad = 0
        self._rest = b""

    def feed(self, data: bytes) -> list[Frame]:
        """Take bytes as they arrive; return the frames that they complete."""
        if not data:
            return []
        *pieces, rest = (self._rest + data).split(b"\0")
        frames = []
        for piece in pieces:
            frame = _read(piece)
            if frame is not None:
                frames.append(frame)
            elif piece:
                self.bad += 1
        self._rest = rest[-_MOST:]
        return frames


def _read(stuffed: bytes) -> Frame | None:
    body = unstuff(stuffed)
    if body is None or len(body) < _HEAD.size + _CHECK.size:
        return None
    text = body[: -_CHECK.size]
    version, kind, sequence, length, tick = _HEAD.unpack_from(text)
    payload = text[_HEAD.size :]
    if length != len(payload) or body[-_CHECK.size :] != _CHECK.pack(zlib.crc32(text)):
        return None
    return Frame(version, kind, sequence, tick, payload)


_XCP_HEAD = struct.Struct("<HH")
_CHECKSUM_BYTES = 2


class Split(NamedTuple):
    """What has arrived, taken apart."""

    packets: list[bytes]  # whole ones
    rest: bytes  # the beginning of another
    skipped: int  # bytes of a serial port that belonged to no whole packet
    broken: bool  # whether what follows cannot be a packet, on TCP; it is in the rest


def framed(packet: bytes, counter: int = 0, serial: bool = False) -> bytes:
    """Return a packet as it stands on a line."""
    whole = _XCP_HEAD.pack(len(packet), counter & 0xFFFF) + packet
    if not serial:
        return whole
    whole += b"\0" * (len(packet) % 2)
    return whole + _checksum(whole)


def split(data: bytes, serial: bool = False) -> Split:
    """Take what has arrived apart; a serial port is searched for the next packet that is whole."""
    at, skipped = 0, 0
    packets: list[bytes] = []
    while at + _XCP_HEAD.size <= len(data):
        length, _ = _XCP_HEAD.unpack_from(data, at)
        begin = at + _XCP_HEAD.size
        end = begin + length + (length % 2 if serial else 0)
        behind = end + (_CHECKSUM_BYTES if serial else 0)
        possible = 0 < length <= PACKET
        if possible and behind > len(data):
            break
        if possible and (not serial or _checksum(data[at:end]) == data[end:behind]):
            packets.append(data[begin : begin + length])
            at = behind
        elif serial:
            skipped += 1
            at += 1
        else:
            return Split(packets, data[at:], 0, True)
    return Split(packets, data[at:], skipped, False)


def _checksum(data: bytes) -> bytes:
    """Return the sum of words, low byte first."""
    total: int = sum(struct.unpack(f"<{len(data) // 2}H", data))
    return (total & 0xFFFF).to_bytes(_CHECKSUM_BYTES, "little")


def key_for(seed: bytes, secret: int = SECRET) -> bytes:
    """Return the key to a seed.

    It keeps a tool that only looks on from writing by mistake; who reads this can write.
    """
    return zlib.crc32(seed, secret).to_bytes(4, "little")
