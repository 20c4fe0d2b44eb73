"""What a bench can do whose compensator's parameters may be exchanged while it runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class BlockHolder(Protocol):
    """A bench beyond :class:`anhyst.rig.bench.protocol.Bench`: it holds a parameter block."""

    def read_block(self) -> list[int]:
        """Return the parameter block in force.

        Raises
        ------
        InputError
            There is none, or it cannot be read.
        """
        ...  # pragma: no cover

    def swap_block(self, words: Sequence[int]) -> int:
        """Download another parameter block and put it in force between two ticks.

        Parameters
        ----------
        words : sequence of int
            The whole block, its generation and checksum included.

        Returns
        -------
        int
            Number of the first tick that uses it.

        Raises
        ------
        Refused
            It is not valid or not for this controller; the old one stays in force.
        """
        ...  # pragma: no cover
