"""What a fit moves of play cells in populations, in units of their own.

The unit of field is the width ``a_1`` of the first population, that of magnetisation its saturation
``M_1``. How wide the reversible part is no loop shows beside how much of it there is: its width is
set (docs/identification.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from anhyst.identify.cell_path import CellPaths, Tangents
from anhyst.laws.cells import CellWeights, Population, Shape, populations
from anhyst.laws.law import FitNumber

REVERSIBLE_WIDTH = 1.0
"""``a_0`` over ``a_1``."""

LAW_OF: Mapping[Shape, str] = {"tanh": "play-cells", "langevin": "play-cells-langevin"}
"""Law of play cells that follow a curve."""

_DIFFERENCE = 1e-6

POLISHED = (0.6, 1.0, 1.8)
"""Widths of cells by their weights, over that of the first population; further ones have theirs,
and twice it."""

_LOOSE = 0.1
"""Spread of a weight around that of the populations, in parts of all of them."""

_FIRST = (
    FitNumber("share_0", "M_0/M_1", 1e-4, 1e2, "log", usual=0.2),
    FitNumber("pinning_1", "k_1/a_1", 1e-3, 1e2, "log", usual=0.3),
    FitNumber("spread_1", "s_1", 0.3, 12.0, "log", usual=1.5),
)


def _further(place: int) -> tuple[FitNumber, ...]:
    return (
        FitNumber(f"share_{place}", f"M_{place}/M_1", 1e-3, 1e2, "log", usual=1.0),
        FitNumber(f"width_{place}", f"a_{place}/a_1", 3e-2, 3e1, "log", usual=1.0),
        FitNumber(f"pinning_{place}", f"k_{place}/a_1", 1e-3, 1e2, "log", usual=0.3),
        FitNumber(f"spread_{place}", f"s_{place}", 0.3, 12.0, "log", usual=1.5),
    )


@dataclass(frozen=True)
class CellKernel:
    """Play cells as a fit sees them.

    Parameters
    ----------
    shape
        The curve that cells follow.
    populations
        How many: 1 to 3.
    """

    shape: Shape
    populations: int

    differentiated = True
    coupled = False

    @cached_property
    def numbers(self) -> tuple[FitNumber, ...]:
        """What a fit moves of the law itself."""
        more = (number for place in range(2, self.populations + 1) for number in _further(place))
        return (*_FIRST, *more)

    def paths(self, law: tuple[float, ...]) -> CellPaths:
        """Return the cells of a set of numbers, ready to be driven."""
        return _paths(self, law, tangents=False)

    def paths_with_tangents(self, law: tuple[float, ...]) -> CellPaths:
        """Return them with derivatives by the numbers."""
        return _paths(self, law, tangents=True)

    def iron(
        self, saturation: float, width: float, law: tuple[float, ...], alpha: float
    ) -> dict[str, float]:
        """Return the parameters of an iron, from its scales and what was fitted."""
        share_0, *rest = law
        rest = [1.0, 1.0, *rest]
        found = {"M_0": share_0 * saturation, "a_0": REVERSIBLE_WIDTH * width}
        for place in range(self.populations):
            share, wide, pinning, spread = rest[4 * place : 4 * place + 4]
            found |= {
                f"M_{place + 1}": share * saturation,
                f"a_{place + 1}": wide * width,
                f"k_{place + 1}": pinning * width,
                f"s_{place + 1}": spread,
            }
        return found | {"alpha": alpha}

    def shrink_field(self, iron: dict[str, float], part: float) -> None:
        """Take the field inside an iron without interaction to a part of itself, by interaction."""
        iron["alpha"] = 1.0 - part
        for name in iron:
            if name[:2] in {"a_", "k_"}:
                iron[name] *= part

    def dead_band(self, iron: Mapping[str, float], part: float) -> dict[str, float]:
        """Return nothing: cells need none."""
        return {}

    def weights(self, law: tuple[float, ...]) -> CellWeights:
        """Return the cells of a set of numbers."""
        iron = self.iron(1.0, 1.0, law, 0.0)
        pinned = [
            Population(*(iron[f"{name}_{place}"] for name in "Maks"))
            for place in range(1, self.populations + 1)
        ]
        return populations((iron["M_0"], iron["a_0"]), pinned, self.shape)


@lru_cache(maxsize=64)
def _paths(kernel: CellKernel, law: tuple[float, ...], *, tangents: bool) -> CellPaths:
    cells = kernel.weights(law)
    if not tangents:
        return CellPaths(cells)
    ends = []
    for place, value in enumerate(law):
        step = _DIFFERENCE * value
        ends.append((kernel.weights((*law[:place], value + step, *law[place + 1 :])), step))
    thresholds, widths, weights = (
        np.array([(getattr(end, name) - getattr(cells, name)) / step for end, step in ends])
        for name in ("thresholds", "widths", "weights")
    )
    return CellPaths(cells, Tangents(thresholds, widths, weights))


@dataclass(frozen=True)
class WeightKernel:
    """Play cells by their weights: what populations leave over, near to them.

    Parameters
    ----------
    populations
        The cells to begin with.
    """

    populations: CellWeights

    differentiated = True
    coupled = False

    @property
    def shape(self) -> Shape:
        """The curve that cells follow."""
        return self.populations.shape

    @cached_property
    def numbers(self) -> tuple[FitNumber, ...]:
        """What a fit moves: the weights."""
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
        return CellPaths(self.weights(law))

    def paths_with_tangents(self, law: tuple[float, ...]) -> CellPaths:
        """Return them with derivatives by the weights."""
        count, cells = len(law), self.populations
        tangents = Tangents(
            np.zeros((count, cells.thresholds.size)),
            np.zeros((count, cells.widths.size)),
            np.eye(count).reshape(count, *cells.weights.shape),
        )
        return CellPaths(self.weights(law), tangents)

    def iron(
        self, saturation: float, width: float, law: tuple[float, ...], alpha: float
    ) -> dict[str, float]:
        """Return the parameters of an iron: of the law only the interaction is left."""
        return {"alpha": alpha}

    def shrink_field(self, iron: dict[str, float], part: float) -> None:
        """Take the field inside an iron without interaction to a part of itself, by interaction."""
        iron["alpha"] = 1.0 - part

    def dead_band(self, iron: Mapping[str, float], part: float) -> dict[str, float]:
        """Return nothing: cells need none."""
        return {}


def by_weights(kernel: CellKernel, law: tuple[float, ...]) -> WeightKernel:
    """Return the kernel that moves each weight, beginning with populations."""
    start = kernel.weights(law)
    first, *further = start.widths[1:]
    widths = np.unique([*(part * first for part in POLISHED),
                        *(part * one for one in further for part in (1.0, 2.0))])  # fmt: skip
    weights = np.zeros((start.thresholds.size, widths.size))
    for column, width in enumerate(start.widths):
        weights[:, int(np.argmin(np.abs(widths - width)))] += start.weights[:, column]
    return WeightKernel(replace(start, widths=widths, weights=weights))
