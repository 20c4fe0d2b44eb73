"""The heartbeat of a virtual bench, which counts ticks as the controller does."""

from __future__ import annotations

from anhyst.link.client import ControllerLink

_BEAT_S = 0.04
"""Between two heartbeats while nothing else is said, s of virtual time; a controller waits 0.1 s."""


class Heartbeat:
    """Says to a controller that its operator is there, as often as it must."""

    def __init__(self, link: ControllerLink) -> None:
        self._link = link
        self._beat = max(1, int(_BEAT_S * link.info.rate))
        self._silent = 0

    def let_pass(self, ticks: int) -> int:
        """Return how many of so many ticks may pass before the next beat; beats where it is due."""
        if self._silent >= self._beat:
            self._link.status()
            self._silent = 0
        count = min(ticks, self._beat - self._silent)
        self._silent += count
        return count

    def restart(self) -> None:
        """Begin to count again: something else was said."""
        self._silent = 0
