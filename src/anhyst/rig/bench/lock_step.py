"""What virtual benches have in common: a firmware in lock-step with its plant."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Generic, Protocol, TypeVar

from anhyst.link.client import ControllerLink
from anhyst.rig.bench.pace import Heartbeat


class _Bus(Protocol):
    @property
    def tick(self) -> int: ...


_BusT = TypeVar("_BusT", bound=_Bus)


class LockStepBench(Generic[_BusT]):
    """Virtual time passes while a bench advances, and stands still for the firmware too otherwise.

    Holds a parameter block (:class:`anhyst.dashboard.improver.BlockHolder`); what a bench is made
    of stands in its ``_open``, which ends with it.
    """

    keeps_time = False
    every = 1
    lost = ""

    _open: ExitStack
    _bus: _BusT
    _link: ControllerLink
    _heartbeat: Heartbeat

    @property
    def tick(self) -> int:
        """Number of the last tick."""
        return self._bus.tick

    def news(self) -> Sequence[str]:
        """Return nothing: a firmware of one's own that is lost ends the bench."""
        return ()

    def read_block(self) -> list[int]:
        """Return the parameter block in force."""
        self._heartbeat.restart()
        return self._link.read_block()

    def swap_block(self, words: Sequence[int]) -> int:
        """Put another parameter block in force, from the next tick on."""
        self._link.write_block(words)
        self._heartbeat.restart()
        return self.tick + 1

    def close(self) -> None:
        """End the firmware."""
        self._open.close()
