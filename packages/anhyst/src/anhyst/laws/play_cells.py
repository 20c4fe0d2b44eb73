"""Define the laws `play-cells` and `play-cells-langevin`: play operators of the effective field.

The parameters describe a reversible part and up to three populations of pinned cells; a population
without magnetisation is ignored (docs/theory.md). Numerical modules are imported only when needed,
so that the command line can list the laws quickly.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from anhyst.laws.law import Law, ParameterSpec, Role

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from anhyst._core import CellIron
    from anhyst.laws.cells import CellWeights, Shape
    from anhyst.support.numeric import FloatArray

MAX_POPULATIONS = 3

STATE_COUNT = 13
"""Number of states: the effective field and the positions of the pinned cells, A/m."""


_POPULATION_PARAMETERS: tuple[tuple[str, str, str, float, tuple[float, float], Role], ...] = (
    ("M", "share of the saturation", "A/m", 0.0, (10.0, 1e5), "saturation"),
    ("a", "width of its curve", "A/m", 1.0, (0.02, 5.0), ""),
    ("k", "pinning scale", "A/m", 1.0, (5e-3, 1.0), "pinning"),
    ("s", "exponent of the thresholds; a larger one narrows their distribution", "1", 2.0, (0.5, 5.0), ""),
)
"""Symbol, meaning, unit, default, search range and role."""


def _population_specs(population_number: int) -> Iterator[ParameterSpec]:
    """Yield the parameters of a population; only the first population is required."""
    is_first = population_number == 1
    ordinal = ("first", "second", "third")[population_number - 1]
    for symbol, meaning, unit, default, search, role in _POPULATION_PARAMETERS:
        may_vanish = symbol == "M" and not is_first
        yield ParameterSpec(
            f"{symbol}_{population_number}",
            f"{ordinal} population: {meaning}",
            unit,
            low=0.0,
            includes_bounds=may_vanish,
            coordinate="plain" if may_vanish else "log",
            default=None if is_first else default,
            search=search if is_first else None,
            role=role,
        )


ALPHA = ParameterSpec("alpha", "interaction, below 1", high=1.0, default=0.0)

PARAMETERS = (
    ParameterSpec(
        "M_0",
        "saturation of the reversible part",
        "A/m",
        low=0.0,
        includes_bounds=True,
        default=0.0,
        search=(1.0, 1e5),
        role="reversible",
    ),
    ParameterSpec(
        "a_0",
        "width of the reversible curve",
        "A/m",
        low=0.0,
        coordinate="log",
        default=1.0,
        search=(0.02, 5.0),
    ),
    *(spec for number in range(1, MAX_POPULATIONS + 1) for spec in _population_specs(number)),
    ALPHA,
)


def make_cells(shape: Shape, *parameter_values: float) -> CellWeights:
    """Return the cells for all parameters except ``alpha``, in the order of the file."""
    from anhyst.laws.cells import Population, discretise_populations

    pinned = [
        Population(*parameter_values[index : index + 4]) for index in range(2, len(parameter_values), 4)
    ]
    return discretise_populations((parameter_values[0], parameter_values[1]), pinned, shape)


def make_iron(cells: CellWeights, alpha: float) -> CellIron:
    """Return the iron of the core for given cells."""
    from anhyst._core import CellIron

    return CellIron(cells.thresholds, cells.widths, cells.weights, cells.shape, alpha, cells.centres)


def _make_cells_from_parameters(shape: Shape, iron: Mapping[str, float]) -> CellWeights:
    return make_cells(shape, *(iron[spec.name] for spec in PARAMETERS if spec is not ALPHA))


def _least_slope(
    cells: Callable[[Mapping[str, float]], CellWeights], iron: Mapping[str, float], rho: FloatArray
) -> FloatArray:
    """Return ``1 + w*S``; no path is steeper than the one on which all cells move."""
    from anhyst.laws.cells import steepest_slope

    return 1.0 + (rho / (1.0 + rho) - iron["alpha"]) * steepest_slope(cells(iron))


def _make_iron_from_values(shape: Shape, *parameter_values: float) -> CellIron:
    *cell_values, alpha = parameter_values
    return make_iron(make_cells(shape, *cell_values), alpha)


def _make_law_with_cells(name: str, cells: CellWeights) -> Law:
    shape = _SHAPES[name]
    if cells.shape != shape:
        law_of_shape = next(law_name for law_name, curve in _SHAPES.items() if curve == cells.shape)
        raise ValueError(f"shape is {cells.shape!r}, that of law {law_of_shape!r}; {name!r} has {shape!r}")

    def replacement_cells(_: Mapping[str, float]) -> CellWeights:
        return cells

    return replace(
        PLAY_CELLS if shape == "tanh" else PLAY_CELLS_LANGEVIN,
        parameters=(ALPHA,),
        iron=partial(make_iron, cells),
        states=cells.thresholds.size,
        least_slope=partial(_least_slope, replacement_cells),
        cells=replacement_cells,
    )


def _make_law(name: str, title: str) -> Law:
    cells = partial(_make_cells_from_parameters, _SHAPES[name])
    return Law(
        name=name,
        title=title,
        parameters=PARAMETERS,
        iron=partial(_make_iron_from_values, _SHAPES[name]),
        states=STATE_COUNT,
        least_slope=partial(_least_slope, cells),
        make_with_cells=partial(_make_law_with_cells, name),
        cells=cells,
        has_return_point_memory=True,
    )


_SHAPES: dict[str, Shape] = {"play-cells": "tanh", "play-cells-langevin": "langevin"}

PLAY_CELLS = _make_law("play-cells", "play cells in the effective field")
PLAY_CELLS_LANGEVIN = _make_law(
    "play-cells-langevin", "play cells in the effective field, on Langevin curves"
)
