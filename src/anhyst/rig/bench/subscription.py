"""What a bench measures, on its way to whoever looks on."""

from __future__ import annotations

import threading
from collections import deque

from anhyst.support.arrays import FloatArray


class Subscription:
    """A bounded queue of chunks, in order, to one that looks on."""

    def __init__(self, name: str, most: int, complete: bool) -> None:
        self.name = name
        self.complete = complete
        self.missed = 0
        self._most = most
        self._chunks: deque[FloatArray] = deque()
        self._changed = threading.Condition()
        self._ended = False

    def get(self, timeout: float | None = None) -> FloatArray | None:
        """Take the next chunk: a row a tick, as :meth:`Bench.advance` gives them."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._chunks or self._ended, timeout):
                raise TimeoutError(f"{self.name}: no chunk in {timeout:g} s")
            return self._chunks.popleft() if self._chunks else None

    def close(self) -> None:
        """Take no more; what has come can still be taken."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    @property
    def ended(self) -> bool:
        """Whether nothing comes any more."""
        return self._ended

    def is_waited_for(self) -> bool:
        """Whether the bench has to wait, because every tick is wanted and there is no room."""
        with self._changed:
            return self.complete and not self._ended and len(self._chunks) >= self._most

    def give(self, chunk: FloatArray) -> None:
        """Hand on a chunk; where there is no room, the oldest ones are lost if not all are wanted."""
        with self._changed:
            if self._ended:
                return
            while not self.complete and len(self._chunks) >= self._most:
                self.missed += len(self._chunks.popleft())
            self._chunks.append(chunk)
            self._changed.notify_all()
