"""Frames on the wire: COBS, a zero at the end, and a checksum; as ``firmware/link/frame.c``."""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

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
