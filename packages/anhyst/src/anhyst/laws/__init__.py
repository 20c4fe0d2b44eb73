"""The hysteresis laws by name. A further one is one more entry, whoever makes it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from anhyst.laws.jiles_atherton import EFFECTIVE_FIELD, JILES_ATHERTON_1986
from anhyst.laws.law import Law
from anhyst.laws.play_cells import PLAY_CELLS, PLAY_CELLS_LANGEVIN

if TYPE_CHECKING:
    from anhyst.laws.cells import CellWeights

LAWS: dict[str, Law] = {
    law.name: law for law in (EFFECTIVE_FIELD, JILES_ATHERTON_1986, PLAY_CELLS, PLAY_CELLS_LANGEVIN)
}
OWN = frozenset(LAWS)
"""Laws of this package."""


def law_of(name: str, cells: CellWeights | None = None) -> Law:
    """Return a law, with its cells if they are given."""
    law = LAWS[name]
    if cells is None:
        return law
    if law.of_cells is None:
        raise ValueError(f"law {name!r} has no cells; leave them out or write another law")
    return law.of_cells(cells)


DEFAULT_LAW = EFFECTIVE_FIELD.name
