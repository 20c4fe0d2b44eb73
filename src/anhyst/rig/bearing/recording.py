"""What was recorded of a simulated loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from anhyst._core import LOOP_COLUMNS
from anhyst.control.states import Phase, State
from anhyst.support.arrays import FloatArray

COLUMNS: tuple[str, ...] = tuple(LOOP_COLUMNS.split())
"""Of every recording, the unit in the name; described in docs/simulate.md."""


def in_column(state: State, phase: Phase = Phase.REST) -> int:
    """Return what the column ``state`` says of a state and a phase of the controller."""
    return 16 * state + phase


READY, RUN, FAULT = (in_column(state) for state in (State.READY, State.RUN, State.FAULT))
"""The least that the column says in each of these states; the phase comes on top."""

BREAKAWAY, RISE, HOVER, DESCEND, SET_DOWN = (
    in_column(State.RUN, phase)
    for phase in (Phase.BREAKAWAY, Phase.RISE, Phase.HOVER, Phase.DESCEND, Phase.SET_DOWN)
)
"""On its rest while the force rises; under control on its way, there, and down; let go."""


@dataclass(frozen=True)
class Recording:
    """One row a tick."""

    table: FloatArray  # as :data:`COLUMNS` names them; shape (n, len(COLUMNS)

    def __getitem__(self, name: str) -> FloatArray:
        column: FloatArray = self.table[:, COLUMNS.index(name)]
        return column

    def __len__(self) -> int:
        return int(self.table.shape[0])

    def part(self, begin: int, end: int) -> Recording:
        """Return the rows from one tick up to another."""
        return Recording(self.table[begin:end])

    @property
    def columns(self) -> Mapping[str, FloatArray]:
        """All of it by name."""
        return {name: self[name] for name in COLUMNS}
