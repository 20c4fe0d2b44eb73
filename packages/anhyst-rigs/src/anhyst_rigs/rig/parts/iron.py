"""The irons of a virtual plant, one table of a rig file for each family.

A table without ``family`` is one of pinned cells. Each gives the plant its numbers, and knows how it
drifts and how a diagram names it. The equations stand in ``plant/include/anhyst_plant``.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from abc import abstractmethod
from functools import lru_cache
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, Tag, field_validator, model_validator

from anhyst._core import Steel, exp, log
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray, power
from anhyst.support.toml_file import (
    BRANCH_PREFIX,
    Name,
    NotNegative,
    Positive,
    Share,
    Table,
    discriminate_by,
)

CURVE_KEYS = {
    "sharp": "saturation_sharp_T",
    "knee_sharp": "knee_sharp_A_per_m",
    "slow": "saturation_slow_T",
    "knee_slow": "knee_slow_A_per_m",
}
"""Of the numbers of a steel those of the curve that nothing pins, by ``anhyst_plant/curve.h``."""
MAX_CELLS = 64
"""Of an iron, the unpinned one included."""


class AnySteel(Table):
    """A steel of any family, and the curve of it that nothing pins.

    The polarisation, ``mu0*M``, has two parts: one that a sharp knee reaches, one that is approached
    slowly; each with the field of its knee.
    """

    saturation_sharp_T: Positive
    knee_sharp_A_per_m: Positive
    saturation_slow_T: Positive
    knee_slow_A_per_m: Positive
    diagram_lines: ClassVar[tuple[str, ...]]  # what a diagram says of it
    pinning_key: ClassVar[str]  # key of what its pinning goes with
    saturation_keys: ClassVar[tuple[str, ...]] = ("saturation_sharp_T", "saturation_slow_T")

    @model_validator(mode="after")
    def _check_makes_iron(self) -> Self:
        self.make_steel()
        return self

    def plant_parameters(self) -> dict[str, float]:
        """Return its numbers by the names of ``plant/include/anhyst_plant``, without its arrays."""
        return {name: getattr(self, key) for name, key in CURVE_KEYS.items()}

    @abstractmethod
    def make_steel(self) -> Steel:
        """Return it as the plant computes it."""

    @abstractmethod
    def make_anhysteretic_steel(self) -> Steel:
        """Return, as the plant computes it, the same steel without what makes its loops wide."""

    def drifted_keys(
        self, pinning: float, reversible: float, saturation: float
    ) -> dict[str, float]:
        """Return the keys of an iron that has drifted, by parts of each quantity."""
        del reversible  # of cells alone
        keys = {key: getattr(self, key) * (1.0 + saturation) for key in self.saturation_keys}
        return {self.pinning_key: getattr(self, self.pinning_key) * (1.0 + pinning), **keys}

    def diagram_texts(self) -> list[str]:
        """Return what a diagram says of it."""
        return [line.format(self) for line in self.diagram_lines]


class CellSteel(AnySteel):
    """A steel as a stack of cells: what they weigh, what pins them, and the curve they follow.

    A cell follows the field only when that has moved by more than its threshold (a play operator);
    the magnetisation is the weighted sum of one anhysteretic curve at the fields of all cells. The
    thresholds are quantiles of a Weibull distribution; cells without one are the reversible part.
    """

    diagram_lines = (
        "iron of {0.cells} pinned cells",
        "reversible fraction {0.reversible_fraction:.3g}",
        "pinning {0.pinning_scale_A_per_m:.3g} A/m",
    )
    pinning_key = "pinning_scale_A_per_m"
    family: Literal["cells"] = "cells"
    cells: Annotated[int, Field(ge=1, le=1000)]  # pinned ones, of equal weights
    reversible_fraction: Share  # weight of the iron that nothing pins
    pinning_scale_A_per_m: Positive  # Weibull distribution of the thresholds
    pinning_shape: Positive

    @field_validator("cells")
    @classmethod
    def _check_cell_count(cls, cells: int) -> int:
        if cells >= MAX_CELLS:
            raise InputError(
                f"the plant has room for {MAX_CELLS - 1}; lower it", code="too-many-cells"
            )
        return cells

    @property
    def thresholds(self) -> FloatArray:
        """Pinning thresholds, A/m, shape (cells + 1,): zero for the reversible part first."""
        above = (self.cells - np.arange(self.cells) - 0.5) / self.cells
        pinned = self.pinning_scale_A_per_m * power(-log(above), 1.0 / self.pinning_shape)
        return np.concatenate(([0.0], pinned))

    @property
    def weights(self) -> FloatArray:
        """Share of each cell in the magnetisation, shape (cells + 1,); they add up to one."""
        pinned = np.full(self.cells, (1.0 - self.reversible_fraction) / self.cells)
        return np.concatenate(([self.reversible_fraction], pinned))

    def make_steel(self) -> Steel:
        """Return it as the plant computes it."""
        return Steel(self.plant_parameters(), self.thresholds, self.weights)

    def make_anhysteretic_steel(self) -> Steel:
        """Return, as the plant computes it, a steel that follows the same curve without a loop."""
        return self.model_copy(update={"cells": 1, "reversible_fraction": 1.0}).make_steel()

    def drifted_keys(
        self, pinning: float, reversible: float, saturation: float
    ) -> dict[str, float]:
        """Return its keys after a drift."""
        fraction = min(self.reversible_fraction * (1.0 + reversible), 1.0)
        own = super().drifted_keys(pinning, reversible, saturation)
        return {"reversible_fraction": fraction, **own}


_CHECK_FIELD_RATIOS = np.concatenate(([0.0], np.geomspace(1e-3, 1e3, 2000)))
"""Where the slope is looked at, in knees."""


class DuhemSteel(AnySteel):
    """A steel whose field is that of a curve, and a part that goes with the way of the flux.

    It keeps no turning points: small loops about a bias walk towards the curve, and a larger loop
    wipes smaller ones out only as fast as it forgets all else.
    """

    diagram_lines = ("Duhem iron", "coercivity {0.coercivity_A_per_m:.3g} A/m")
    pinning_key = "coercivity_A_per_m"
    family: Literal["duhem"]
    coercivity_A_per_m: Positive  # half the width of a wide loop about zero
    turning_T: Positive  # way on which this part turns round after a reversal, by a factor e
    # share of the coercive field that is gone at saturation
    fading: Annotated[float, Field(ge=0.0, lt=1.0)]

    def make_steel(self) -> Steel:
        """Return it as the plant computes it."""
        self._check_stability()
        return Steel(self.plant_parameters())

    def plant_parameters(self) -> dict[str, float]:
        """Return its numbers by the names of ``anhyst_plant/duhem.h``."""
        return {
            "coercivity": self.coercivity_A_per_m,
            "rate": 1.0 / self.turning_T,
            "fading": self.fading,
            **super().plant_parameters(),
        }

    def make_anhysteretic_steel(self) -> Steel:
        """Return, as the plant computes it, a steel that follows the same curve without a loop."""
        return self.model_copy(update={"coercivity_A_per_m": 0.0}).make_steel()

    def curve(self, field: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return polarisation, T, of the curve at fields, A/m, and its slope."""
        root = np.sqrt(field * field + self.knee_sharp_A_per_m**2)
        slow = self.saturation_slow_T * 2.0 / np.pi
        polarisation = self.saturation_sharp_T * field / root + slow * np.arctan(
            field / self.knee_slow_A_per_m
        )
        slope = self.saturation_sharp_T * self.knee_sharp_A_per_m**2 / root**3
        slope += slow * self.knee_slow_A_per_m / (field * field + self.knee_slow_A_per_m**2)
        return polarisation, slope

    def _check_stability(self) -> None:
        saturation = self.saturation_sharp_T + self.saturation_slow_T
        turn = self.turning_T / saturation
        if self.fading * (1.0 + 2.0 * turn + 2.0 * turn * turn) > 1.0:
            raise InputError(
                f"fading: {self.fading:g} with a turning of {self.turning_T:g} T lets small loops "
                "give energy; lower one of them",
                code="small-loops-give-energy",
                key="fading",
            )
        polarisation, slope = self.curve(_CHECK_FIELD_RATIOS * self.knee_sharp_A_per_m)
        falls = 2.0 * self.coercivity_A_per_m * self.fading / saturation**2
        if np.max(falls * (polarisation - self.turning_T) * slope) > 0.9:
            raise InputError(
                f"coercivity: {self.coercivity_A_per_m:g} A/m fades too fast for a knee of "
                f"{self.knee_sharp_A_per_m:g} A/m; lower it or fading, or raise knee_sharp",
                code="fades-too-fast",
                key="coercivity",
            )


EVERETT_NODES = 257
"""Of an Everett table, odd: one of them is zero."""


class PreisachSteel(AnySteel):
    """A steel of relays whose bias scatters the more, the harder they are to turn.

    A relay turns up at ``bias + pinning`` and down at ``bias - pinning``. The pinnings have a
    lognormal distribution; the biases of the relays of one pinning a normal one, whose width grows
    with the pinning, so that the density is no product. What the relays see is the field and a
    share of the polarisation.
    """

    diagram_lines = ("Preisach iron", "pinning {0.pinning_A_per_m:.3g} A/m")
    pinning_key = "pinning_A_per_m"
    saturation_keys = ("saturation_T", *AnySteel.saturation_keys)
    family: Literal["preisach"]
    saturation_T: Positive  # of the relays, ``mu0*M``
    pinning_A_per_m: Positive  # median
    pinning_spread: Positive  # standard deviation of its logarithm
    bias_A_per_m: Positive  # standard deviation of the biases of relays without pinning
    bias_by_pinning: NotNegative  # what it grows by for each A/m of pinning
    feedback_A_per_m_T: NotNegative  # what the polarisation adds to the field

    @property
    def knee(self) -> float:
        """Field around which the nodes of the table are dense, A/m."""
        return self.pinning_A_per_m + self.bias_A_per_m

    @property
    def max_switching_field(self) -> float:
        """Field beyond which no relay turns, A/m: three standard deviations of all that scatters."""
        hardest = self.pinning_A_per_m * float(exp(np.array([3.0 * self.pinning_spread]))[0])
        return hardest + 3.0 * (self.bias_A_per_m + self.bias_by_pinning * hardest)

    def density(self, pinning: FloatArray, bias: FloatArray) -> FloatArray:
        """Return relays for each A/m of pinning and of bias, up to a constant factor."""
        scatter = self.bias_A_per_m + self.bias_by_pinning * pinning
        ways = log(pinning / self.pinning_A_per_m) / self.pinning_spread
        across = bias / scatter
        density: FloatArray = exp(-0.5 * (ways * ways + across * across)) / (pinning * scatter)
        return density

    def make_steel(self) -> Steel:
        """Return it as the plant computes it."""
        return _make_preisach_steel(self, True)

    def plant_parameters(self) -> dict[str, float]:
        """Return its numbers by the names of ``anhyst_plant/preisach.h``."""
        return {
            "knee": self.knee,
            "reach": self.max_switching_field / (self.max_switching_field + self.knee),
            "feedback": self.feedback_A_per_m_T,
            **super().plant_parameters(),
        }

    def make_anhysteretic_steel(self) -> Steel:
        """Return, as the plant computes it, a steel of relays with the same biases, unpinned."""
        return _make_preisach_steel(self, False)


def node_fields(steel: PreisachSteel) -> FloatArray:
    """Return the fields of the nodes, A/m, rising, shape (NODES,)."""
    end = steel.max_switching_field / (steel.max_switching_field + steel.knee)
    field = end * np.linspace(-1.0, 1.0, EVERETT_NODES)
    return np.asarray(steel.knee * field / (1.0 - np.abs(field)))


def everett_table(steel: PreisachSteel, is_pinned: bool) -> FloatArray:
    """Return by how much the relays change from node to node, T, shape (NODES, NODES)."""
    at = node_fields(steel)
    inside = _relay_weights(steel, at) if is_pinned else np.diag(_unpinned_relay_weights(steel, at))
    rising = np.zeros((EVERETT_NODES, EVERETT_NODES))
    from_below = np.cumsum(inside[::-1], axis=0)[::-1]
    rising[:-1, 1:] = np.triu(np.cumsum(from_below, axis=1))
    rising *= 2.0 * steel.saturation_T / rising[0, -1]
    return rising - rising.T


def _relay_weights(steel: PreisachSteel, at: FloatArray) -> FloatArray:
    """Return the relays in each cell between nodes, from the lower to the higher field.

    The density is looked at in the middles of the four quarters of a cell; on the diagonal, where
    only half a cell is above it, at its centroid.
    """
    quarter = 0.25 * np.diff(at)
    middle = at[:-1] + 2.0 * quarter
    down, up = np.triu_indices(middle.size, 1)
    inside = np.zeros((middle.size, middle.size))
    for below in (-1.0, 1.0):
        for above in (-1.0, 1.0):
            low = middle[down] + below * quarter[down]
            high = middle[up] + above * quarter[up]
            inside[down, up] += steel.density(0.5 * (high - low), 0.5 * (high + low))
    inside[down, up] *= 4.0 * quarter[down] * quarter[up]
    alone = steel.density(quarter * (2.0 / 3.0), middle)
    np.fill_diagonal(inside, 8.0 * quarter * quarter * alone)
    return inside


def _unpinned_relay_weights(steel: PreisachSteel, at: FloatArray) -> FloatArray:
    """Return the relays whose bias lies between two nodes, whatever their pinning."""
    middle, slope = 0.5 * (at[1:] + at[:-1]), np.zeros(at.size - 1)
    for spread in np.linspace(-3.0, 3.0, 61).tolist():
        pinning = steel.pinning_A_per_m * exp(np.full(middle.size, spread * steel.pinning_spread))
        slope += pinning * steel.density(pinning, middle)
    return slope * np.diff(at)


@lru_cache(maxsize=32)
def _make_preisach_steel(steel: PreisachSteel, is_pinned: bool) -> Steel:
    table = everett_table(steel, is_pinned)
    # The steepest way comes from far below, past the middle of the reversible part.
    relays = float(np.max(np.diff(table[0]) / np.diff(node_fields(steel))))
    slope = steel.saturation_sharp_T / steel.knee_sharp_A_per_m + relays
    slope += steel.saturation_slow_T * 2.0 / np.pi / steel.knee_slow_A_per_m
    if steel.feedback_A_per_m_T * slope > 0.9:
        raise InputError(
            f"feedback: {steel.feedback_A_per_m_T:g} A/m for each T would make the polarisation jump; this "
            f"steel bears up to {0.9 / slope:.3g}",
            code="reversible-part-jumps",
            key="feedback",
        )
    return Steel(steel.plant_parameters(), np.ascontiguousarray(table))


class NamedCells(CellSteel):
    """``[[iron]]`` of cells."""

    name: Name


class NamedPreisach(PreisachSteel):
    """``[[iron]]`` after Preisach."""

    name: Name


class NamedDuhem(DuhemSteel):
    """``[[iron]]`` after Duhem."""

    name: Name


NamedIron = NamedCells | NamedPreisach | NamedDuhem
FAMILY_DISCRIMINATOR = discriminate_by("family", "cells", "preisach", "duhem", default="cells")
"""By it an iron of a file is read as the table of its family."""
IronEntry = Annotated[
    Annotated[NamedCells, Tag(f"{BRANCH_PREFIX}cells")]
    | Annotated[NamedPreisach, Tag(f"{BRANCH_PREFIX}preisach")]
    | Annotated[NamedDuhem, Tag(f"{BRANCH_PREFIX}duhem")],
    FAMILY_DISCRIMINATOR,
]
