"""Paces a bench to the clock: speed, pause, single steps; and says how far behind it is."""

from __future__ import annotations

import time

from anhyst.support.errors import InputError

SLOWEST, FASTEST = 0.01, 1.0
"""Speed, times real time."""

_WAIT_S = 0.02
"""Longest wait before orders are looked at, s."""

_FORGIVEN_S = 0.1
"""Further behind, the clock starts anew: a bench that is too slow is slow, it does not run after."""

_AVERAGED_S = 0.5
"""Over which the real-time factor is taken, s."""


class Pacer:
    """Says how many ticks are due, and waits until they are.

    Parameters
    ----------
    rate : float
        Ticks a second.

    Attributes
    ----------
    speed : float
        Wanted, times real time.
    paused : bool
        Whether time stands still.
    factor : float
        Reached of late, times real time.
    lateness : float
        Of the last stretch, s.
    """

    def __init__(self, rate: float) -> None:
        self.speed = 1.0
        self.paused = False
        self.factor = 0.0
        self.lateness = 0.0
        self._rate = rate
        self._steps = 0
        self._due = self._since = time.monotonic()
        self._counted = 0

    def set_speed(self, speed: float) -> None:
        """Set the speed, 0.01 to 1 times real time."""
        if not SLOWEST <= speed <= FASTEST:
            raise InputError(f"speed: is not within {SLOWEST:g} to {FASTEST:g}")
        self.speed = speed

    def pause(self, paused: bool) -> None:
        """Let time stand still, or go on."""
        self.paused = paused
        self._steps = 0
        self._due = time.monotonic()

    def step(self, ticks: int) -> None:
        """Do some ticks of a paused bench, 1 to a second of them."""
        if not 1 <= ticks <= self._rate:
            raise InputError(f"steps: is not within 1 to {self._rate:g}")
        self._steps += ticks

    def wait(self, seconds: float) -> int:
        """Wait for the next stretch of so many seconds of the bench; return its ticks, or 0."""
        now = time.monotonic()
        if self.paused:
            ticks, self._steps = self._steps, 0
            if not ticks:
                time.sleep(_WAIT_S)
            return ticks
        early = self._due - now
        if early > 0.0:
            time.sleep(min(early, _WAIT_S))
            if early > _WAIT_S:
                return 0
        self.lateness = max(0.0, -early)
        if -early > _FORGIVEN_S:
            self._due = now
        ticks = max(1, round(seconds * self._rate * min(1.0, 10.0 * self.speed)))
        self._due += ticks / (self._rate * self.speed)
        self._count(ticks)
        return ticks

    def _count(self, ticks: int) -> None:
        self._counted += ticks
        now = time.monotonic()
        if now - self._since >= _AVERAGED_S:
            self.factor = self._counted / (self._rate * (now - self._since))
            self._since, self._counted = now, 0
