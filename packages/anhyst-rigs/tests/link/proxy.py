"""A line between two real pseudo-terminals that disturbs the frames it carries."""

from __future__ import annotations

import os
import select
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from random import Random


@dataclass
class Disturbance:
    """Disturbances of frames in both directions, each with a probability.

    Attributes
    ----------
    done : dict
        Number of disturbances of each kind.
    """

    flip: float = 0.0
    drop: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    insert: float = 0.0
    cut: bool = False
    random: Random = field(default_factory=lambda: Random(5))
    done: dict[str, int] = field(default_factory=dict)
    late: dict[int, list[bytes]] = field(default_factory=dict)

    def apply(self, frame: bytes, way: int) -> list[bytes]:
        """Return the frames that result from one frame; `way` is its direction."""
        late = self.late.pop(way, [])
        if not late and self._happens("reorder"):
            self.late[way] = [frame]  # delivered after the next frame
            return []
        return [] if self.cut else self._one(frame) + late

    def _one(self, frame: bytes) -> list[bytes]:
        if self._happens("drop"):
            return []
        if self._happens("duplicate"):
            return [frame, frame]
        if self._happens("flip"):
            bit = self.random.randrange(8 * len(frame))
            spoilt = bytearray(frame)
            spoilt[bit // 8] ^= 1 << bit % 8
            return [bytes(spoilt)]
        if self._happens("insert"):
            return [self.random.randbytes(self.random.randrange(1, 300)), frame]
        return [frame]

    def _happens(self, kind: str) -> bool:
        happens = self.random.random() < float(getattr(self, kind))
        self.done[kind] = self.done.get(kind, 0) + happens
        return happens


@dataclass(frozen=True)
class Line:
    """The names of the two ends."""

    controller: str
    pc: str
    disturbance: Disturbance


@contextmanager
def disturbed_line(disturbance: Disturbance) -> Iterator[Line]:
    """Carry frames between two pseudo-terminals and disturb some frames."""
    pairs = [os.openpty(), os.openpty()]
    for pair in pairs:
        tty.setraw(pair[1])
    stop, stopped = os.pipe()
    masters = [pair[0] for pair in pairs]

    def carry() -> None:
        held = dict.fromkeys(masters, b"")
        while True:
            ready, _, _ = select.select([*masters, stop], [], [])
            if stop in ready:
                return
            for source in ready:
                *frames, held[source] = (held[source] + os.read(source, 4096)).split(b"\0")
                way = masters.index(source)
                for frame in frames:
                    for piece in disturbance.apply(frame + b"\0", way):
                        os.write(masters[1 - way], piece)

    thread = threading.Thread(target=carry, daemon=True)
    thread.start()
    try:
        yield Line(os.ttyname(pairs[0][1]), os.ttyname(pairs[1][1]), disturbance)
    finally:
        os.write(stopped, b"x")
        thread.join()
        for descriptor in (*pairs[0], *pairs[1], stop, stopped):
            os.close(descriptor)
