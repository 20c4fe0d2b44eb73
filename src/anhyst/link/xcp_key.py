"""The key that lets a master of XCP write."""

from __future__ import annotations

import zlib

from anhyst.control.xcp_map import SECRET


def key_for(seed: bytes, secret: int = SECRET) -> bytes:
    """Return the key to a seed.

    It keeps a tool that only looks on from writing by mistake; who reads this can write.
    """
    return zlib.crc32(seed, secret).to_bytes(4, "little")
