"""What compensators of every kind need to know of the iron of a model, whatever its law."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from anhyst.laws.cells import CellWeights
    from anhyst.model.actuator import Model

FullKind = Literal["full", "cells"]


def iron_of(model: Model) -> Mapping[str, float]:
    """Return the parameters of the iron, the same at every gap of what can be compiled."""
    return model.parameters_at(model.first_node)


def full_kind(model: Model) -> FullKind:
    """Return the kind of the blocks that follow the law itself, of a model that can be compiled."""
    return "full" if model.operator_law.cells is None else "cells"


def saturation(model: Model) -> float:
    """Return the largest magnetisation, A/m."""
    iron, law = iron_of(model), model.operator_law
    if law.cells is not None:
        return law.cells(iron).saturation
    return sum(iron[spec.name] for spec in law.with_role("saturation"))


def cell_weights(model: Model) -> CellWeights:
    """Return the cells of a model whose law has some."""
    cells = model.operator_law.cells
    assert cells is not None
    return cells(iron_of(model))
