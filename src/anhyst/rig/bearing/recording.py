"""What was recorded of a simulated loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from anhyst._core import PlantLoop
from anhyst.control.states import Phase, State
from anhyst.support.arrays import FloatArray

CURRENTS = (("command", "A"), ("current", "A"))
MAGNETS = 2
"""For which a recording has columns; a single one leaves those of the other at zero."""


def column(signal: str, unit: str, number: int = 1) -> str:
    """Return what a column is called: of the first magnet without a number, further ones with it."""
    return "_".join(part for part in (signal, f"{number}" if number > 1 else "", unit) if part)


def of_magnets(signals: Sequence[tuple[str, str]], first: int, last: int) -> tuple[str, ...]:
    """Return the columns of some signals, magnet by magnet."""
    return tuple(column(*one, number) for number in range(first, last + 1) for one in signals)


COLUMNS: tuple[str, ...] = (
    *("t_s", "reference_m", "gap_m", "gap_read_m", "velocity_m_per_s", "demand_N", "force_N"),
    *("load_N", "command_A", "current_A", "current_read_A", "voltage_V", "flux_Wb"),
    *("flux_density_T", *of_magnets(CURRENTS, 2, MAGNETS), "state", "flags"),
)
"""Of every recording, the unit in the name; described in docs/simulate.md."""


def in_columns(loop: PlantLoop, table: FloatArray) -> FloatArray:
    """Return of a loop's record what is recorded; zero where there is no such signal."""
    names = [column(*signal) for signal in loop.signals]
    taken = [names.index(name) if name in names else -1 for name in COLUMNS]
    return np.take(np.column_stack((table, np.zeros(len(table)))), taken, axis=1)


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
