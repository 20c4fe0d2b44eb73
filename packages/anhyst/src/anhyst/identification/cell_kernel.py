"""What a fit moves of play cells in populations, in units of their own, and their path along drives.

The unit of field is the width ``a_1`` of the first population, that of magnetisation its saturation
``M_1``. How wide the reversible part is hardly any loop shows beside how much of it there is: its
width stays near that of the first population (docs/identification.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anhyst._core import CellOperator, status_text
from anhyst.laws.cells import (
    CellWeights,
    Population,
    Shape,
    Tangents,
    population_tangents,
    populations,
)
from anhyst.laws.law import FitNumber
from anhyst.support.errors import NoResponseError
from anhyst.support.numeric import FloatArray

EXACT = 1e-12  # error of tables that a model is computed with, in parts of the saturation


_STEEPER = 1.03
"""Largest slope over that at the nodes of tables that aim at less: what responds with them must do so
with exact ones."""


_AT_ONCE = np.zeros(1, dtype=np.int64)  # where drives begin, of a single one


class CellPath(NamedTuple):
    """Effective field and magnetisation along a drive, and their derivatives, (n,) and (n, d)."""

    x: FloatArray
    m: FloatArray
    x_t: FloatArray
    m_t: FloatArray


@dataclass(frozen=True, eq=False)
class CellPaths:
    """Demagnetised cells ready to be driven."""

    cells: CellWeights  # thresholds, widths, weights
    tangents: Tangents  # derivatives of weights, widths and thresholds by the numbers of the law
    aim: float = EXACT  # error of the tables, in parts of the saturation

    @cached_property
    def _operator(self) -> CellOperator:
        cells = self.cells
        try:
            return CellOperator(
                cells.thresholds, cells.widths, cells.weights, cells.shape, self.aim, cells.centres
            )
        except ValueError as error:
            raise NoResponseError(str(error)) from error

    def follow(
        self, omega: FloatArray, r: FloatArray, begins: NDArray[np.int64] = _AT_ONCE
    ) -> tuple[FloatArray, FloatArray]:
        """Return effective field and magnetisation where ``x + omega*M(x) = r``, all of shape (n,).

        Drives stand one after the other; at each begin the cells are demagnetised.
        """
        self._refuse_jumps(omega)
        x, m, status = self._operator.run(omega, r, begins)
        require_answer(status)
        return x, m

    def with_tangents(
        self,
        omega: FloatArray,
        r: FloatArray,
        own: FloatArray,
        r_t: FloatArray,
        begins: NDArray[np.int64],
    ) -> CellPath:
        """Return them with derivatives: by the numbers of the law, omega, and what moves r."""
        self._refuse_jumps(omega)
        law = self.tangents.widths.shape[-1]
        directions = law + 1 + r_t.shape[1]
        omega_t, moved = np.zeros((r.size, directions)), np.zeros((r.size, directions))
        omega_t[:, law] = own
        moved[:, law + 1 :] = r_t
        weights_t, widths_t, thresholds_t = (
            np.concatenate([by, np.zeros((*by.shape[:-1], directions - law))], axis=-1)
            for by in self.tangents
        )
        x, m, x_t, m_t, status = self._operator.sensitivity(
            omega, r, omega_t, moved, weights_t, widths_t, thresholds_t, begins
        )
        require_answer(status)
        return CellPath(x, m, x_t, m_t)

    def _refuse_jumps(self, omega: FloatArray) -> None:
        steepest = self._operator.steepest * (1.0 if self.aim == EXACT else _STEEPER)
        if 1.0 + float(omega.min()) * steepest <= 0.0:
            raise NoResponseError("the magnetisation may jump")


def require_answer(status: int) -> None:
    """Raise where the core found no answer."""
    if status != 0:
        raise NoResponseError(status_text(status))


MOST_WIDTHS = 6  # with more, what the weights cost grows faster than what they gain
SCALES = ("M_1", "a_1")  # parameters of the first population, which weights and fields are taken in

LAW_OF: Mapping[Shape, str] = {"tanh": "play-cells", "langevin": "play-cells-langevin"}
"""Law of play cells that follow a curve."""

BESIDE, BEYOND = (0.6, 1.8), 2.0
"""Further widths of cells by their weights: over that of the first population, and of the others."""

_LOOSE = 0.02  # spread of a weight around that of the populations, in parts of all of them

_REVERSIBLE = (
    FitNumber("share_0", "M_0/M_1", 1e-4, 1e2, "log", usual=0.2),
    FitNumber("width_0", "a_0/a_1", 3e-2, 3e1, "log", usual=1.0, spread=0.7),
)


def _population(index: int) -> tuple[FitNumber, ...]:
    """Return the numbers of a population; share and width of the first are the units."""
    every = (
        FitNumber(f"share_{index}", f"M_{index}/M_1", 1e-3, 1e2, "log", usual=1.0),
        FitNumber(f"width_{index}", f"a_{index}/a_1", 3e-2, 3e1, "log", usual=1.0),
        FitNumber(f"pinning_{index}", f"k_{index}/a_1", 1e-3, 1e2, "log", usual=0.3),
        FitNumber(f"spread_{index}", f"s_{index}", 0.3, 12.0, "log", usual=1.5),
    )
    return every[2:] if index == 1 else every


class _AnyCells:
    """What a fit sees of play cells, however it moves them."""

    differentiated = True
    coupled = False

    def dead_band(self, iron: Mapping[str, float], part: float) -> dict[str, float]:
        """Return nothing: cells need none."""
        return {}


@dataclass(frozen=True)
class CellKernel(_AnyCells):
    """Play cells as a fit sees them."""

    shape: Shape  # the curve that cells follow
    populations: int  # how many: 1 to 3
    # error of their tables, in parts of the saturation; tables that aim at less are made faster
    aim: float = EXACT

    @cached_property
    def numbers(self) -> tuple[FitNumber, ...]:
        """Numbers of the law that a fit varies."""
        pinned = map(_population, range(1, self.populations + 1))
        return (*_REVERSIBLE, *chain.from_iterable(pinned))

    def paths(self, law: tuple[float, ...]) -> CellPaths:
        """Return the cells of a set of numbers, ready to be driven."""
        return _paths(self, law)

    def iron(
        self, saturation: float, width: float, law: tuple[float, ...], alpha: float
    ) -> dict[str, float]:
        """Return the parameters of an iron, from its scales and what was fitted."""
        share_0, width_0, *rest = law
        rest = [1.0, 1.0, *rest]
        parameters = {"M_0": share_0 * saturation, "a_0": width_0 * width}
        for index in range(self.populations):
            share, wide, pinning, spread = rest[4 * index : 4 * index + 4]
            parameters |= {
                f"M_{index + 1}": share * saturation,
                f"a_{index + 1}": wide * width,
                f"k_{index + 1}": pinning * width,
                f"s_{index + 1}": spread,
            }
        return parameters | {"alpha": alpha}

    def shrink_field(self, iron: dict[str, float], part: float) -> None:
        """Take the field inside an iron without interaction to a part of itself, by interaction."""
        iron["alpha"] = 1.0 - part
        for name in iron:
            if name[:2] in {"a_", "k_"}:
                iron[name] *= part

    def pinned(self, law: tuple[float, ...]) -> list[Population]:
        """Return the populations of a set of numbers."""
        iron = self.iron(1.0, 1.0, law, 0.0)
        every = range(1, self.populations + 1)
        return [Population(*(iron[f"{name}_{n}"] for name in "Maks")) for n in every]

    def weights(self, law: tuple[float, ...]) -> CellWeights:
        """Return the cells of a set of numbers."""
        return populations((law[0], law[1]), self.pinned(law), self.shape)


@lru_cache(maxsize=8)  # tables of a megabyte or two each
def _paths(kernel: CellKernel, law: tuple[float, ...]) -> CellPaths:
    """Cells with derivatives by the numbers."""
    # By M_0, a_0, then M, a, k, s of each population; those of the first are units.
    moved = [0, 1, *range(4, 2 + 4 * kernel.populations)]
    by_all = population_tangents(kernel.pinned(law))
    tangents = Tangents(*(np.ascontiguousarray(by[..., moved]) for by in by_all))
    return CellPaths(kernel.weights(law), tangents, kernel.aim)


@dataclass(frozen=True)
class WeightKernel(_AnyCells):
    """Play cells by their weights: what populations leave over, near to them."""

    populations: CellWeights  # the cells to begin with

    @property
    def shape(self) -> Shape:
        """The curve that cells follow."""
        return self.populations.shape

    @cached_property
    def numbers(self) -> tuple[FitNumber, ...]:
        """Numbers that a fit varies: the weights."""
        start = self.populations
        spread = _LOOSE * start.saturation
        return tuple(
            FitNumber(f"weight_{i}_{j}", f"W_{i}_{j}/M_1", 0.0, 1e2, usual=value, spread=spread)
            for (i, j), value in np.ndenumerate(start.weights)
        )

    def weights(self, law: tuple[float, ...]) -> CellWeights:
        """Return the cells of a set of weights."""
        start = self.populations
        return replace(start, weights=np.reshape(law, start.weights.shape))

    def paths(self, law: tuple[float, ...]) -> CellPaths:
        """Return the cells of a set of weights, ready to be driven."""
        count, cells = len(law), self.populations
        by_weights = np.eye(count).reshape(*cells.weights.shape, count)
        held = (np.zeros((size, count)) for size in (cells.widths.size, cells.thresholds.size))
        return CellPaths(self.weights(law), Tangents(by_weights, *held))

    def iron(
        self, saturation: float, width: float, law: tuple[float, ...], alpha: float
    ) -> dict[str, float]:
        """Return the interaction, and the scales that the weights are taken in (:meth:`scaled`)."""
        return {**dict(zip(SCALES, (saturation, width), strict=True)), "alpha": alpha}

    def scaled(self, law: tuple[float, ...], saturation: float, width: float) -> CellWeights:
        """Return the cells of a set of weights, A/m."""
        cells = self.weights(law)
        return replace(
            cells,
            thresholds=width * cells.thresholds,
            widths=width * cells.widths,
            weights=saturation * cells.weights,
        )

    def shrink_field(self, iron: dict[str, float], part: float) -> None:
        """Take the field inside an iron without interaction to a part of itself, by interaction."""
        iron["alpha"] = 1.0 - part
        iron[SCALES[1]] *= part


def by_weights(kernel: CellKernel, law: tuple[float, ...]) -> WeightKernel:
    """Return the kernel that moves each weight, beginning with populations."""
    start = kernel.weights(law)
    first, *further = start.widths[1:].tolist()
    more = [part * first for part in BESIDE] + [BEYOND * width for width in further]
    widths = np.concatenate([start.widths, more])[: max(MOST_WIDTHS, start.widths.size)]
    weights = np.zeros((start.thresholds.size, widths.size))
    weights[:, : start.widths.size] = start.weights
    return WeightKernel(replace(start, widths=widths, weights=weights))
