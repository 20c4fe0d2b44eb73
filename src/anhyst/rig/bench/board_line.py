"""What a controller on a board is reached by."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from anhyst.control.states import Command, State
from anhyst.link.frames import Body, Setting


class BoardLine(Protocol):
    """An open line to a controller."""

    url: str  # for messages
    name: str  # what the controller is called
    body: Body  # what the controller controls
    signals: tuple[str, ...]  # signals of ``contract/signals.toml`` that :meth:`take` returns
    every: int  # ticks from one sample to the next

    def take(self, tick: int) -> NDArray[np.int64]:
        """Wait for the last sample up to a tick, and return all that came: tick, codes."""
        ...  # pragma: no cover

    def beat(self) -> None:
        """Say that the operator is there."""
        ...  # pragma: no cover

    def clock(self) -> int:
        """Return the number of the last tick, modulo 2^32."""
        ...  # pragma: no cover

    def goal(self) -> int:
        """Return what is demanded, q31 of full scale."""
        ...  # pragma: no cover

    def aim(self, code: int) -> None:
        """Demand a force or a position, q31 of full scale."""
        ...  # pragma: no cover

    def command(self, command: Command) -> State:
        """Change the state, and return the one it is in then."""
        ...  # pragma: no cover

    def read_words(self, first: int, count: int) -> list[int]:
        """Return words of the parameter block in force."""
        ...  # pragma: no cover

    def read_block(self) -> list[int]:
        """Return the parameter block in force."""
        ...  # pragma: no cover

    def swap_block(self, words: Sequence[int]) -> None:
        """Download another parameter block and put it in force between two ticks."""
        ...  # pragma: no cover

    def read_setting(self, setting: Setting) -> int:
        """Ask for a setting."""
        ...  # pragma: no cover

    def write_setting(self, setting: Setting, value: int) -> int:
        """Set a setting from the next tick on."""
        ...  # pragma: no cover

    def close(self) -> None:
        """Hang up."""
        ...  # pragma: no cover
