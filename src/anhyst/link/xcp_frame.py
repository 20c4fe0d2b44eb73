"""How packets of XCP stand on a line: behind a length and a counter, 16 bits each.

On TCP that is all. On a serial port packets are filled up to whole words and a checksum follows,
the sum of all words, as ``firmware/xcp/line.h`` says.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

from anhyst.control.xcp_map import PACKET, SECRET

_HEAD = struct.Struct("<HH")
_CHECKSUM_BYTES = 2


class Split(NamedTuple):
    """What has arrived, taken apart."""

    packets: list[bytes]  # whole ones
    rest: bytes  # the beginning of another
    skipped: int  # bytes of a serial port that belonged to no whole packet
    broken: bool  # whether what follows cannot be a packet, on TCP; it is in the rest


def framed(packet: bytes, counter: int = 0, serial: bool = False) -> bytes:
    """Return a packet as it stands on a line."""
    whole = _HEAD.pack(len(packet), counter & 0xFFFF) + packet
    if not serial:
        return whole
    whole += b"\0" * (len(packet) % 2)
    return whole + _checksum(whole)


def split(data: bytes, serial: bool = False) -> Split:
    """Take what has arrived apart; a serial port is searched for the next packet that is whole."""
    at, skipped = 0, 0
    packets: list[bytes] = []
    while at + _HEAD.size <= len(data):
        length, _ = _HEAD.unpack_from(data, at)
        begin = at + _HEAD.size
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
