"""Register the hysteresis laws by name; an installed package can add a law as an entry point."""

from __future__ import annotations

import inspect
from contextlib import suppress
from typing import TYPE_CHECKING

from anhyst.laws.jiles_atherton import EFFECTIVE_FIELD, JILES_ATHERTON_1986
from anhyst.laws.law import Law
from anhyst.laws.play_cells import PLAY_CELLS, PLAY_CELLS_LANGEVIN
from anhyst.support.registry import Registry

if TYPE_CHECKING:
    from anhyst.laws.cells import CellWeights

_OWN_LAWS = (EFFECTIVE_FIELD, JILES_ATHERTON_1986, PLAY_CELLS, PLAY_CELLS_LANGEVIN)


def _find_fault(law: object, name: str) -> str:
    """Return the fault that makes a law of another package unusable; empty if there is none."""
    if not isinstance(law, Law):
        return "and it is not a Law"
    names, argument_names = [spec.name for spec in law.parameters], []
    with suppress(TypeError, ValueError):  # some C functions have no signature
        argument_names = list(inspect.signature(law.iron).parameters)
    if argument_names != names and sorted(argument_names) == sorted(names):
        return "and its iron takes the parameters in another order"
    return "" if law.name == name else "and its law has another name"


LAWS: Registry[Law] = Registry("anhyst.laws", {law.name: law for law in _OWN_LAWS}, _find_fault)
"""Laws by name: those of anhyst, and of the entry points ``anhyst.laws`` of installed packages."""


def get_law(name: str, cells: CellWeights | None = None) -> Law:
    """Return a law by name, with its cells if they are given."""
    law = LAWS[name]
    if cells is None:
        return law
    if law.make_with_cells is None:
        raise ValueError(f"law {name!r} has no cells; leave them out or write another law")
    return law.make_with_cells(cells)


DEFAULT_LAW = EFFECTIVE_FIELD.name
