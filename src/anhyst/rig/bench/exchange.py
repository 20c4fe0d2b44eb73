"""What a bench can do whose compensator's parameters may be exchanged while it runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class BlockHolder(Protocol):
    """A bench beyond :class:`anhyst.rig.bench.protocol.Bench`: it holds a parameter block."""

    def read_block(self) -> list[int]:
        """Return the parameter block in force."""
        ...  # pragma: no cover

    def swap_block(self, words: Sequence[int]) -> int:
        """Download another parameter block and put it in force between two ticks."""
        ...  # pragma: no cover
