"""Define the irons of a virtual plant; each family has its table in a rig file.

A table without the key ``family`` is an iron of play cells. Each table computes the parameters of
the plant, the effect of a drift, and the texts of diagrams. The equations are in
``plant/include/anhyst_plant``.
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
from anhyst.support.toml_file import BRANCH_PREFIX, Name, NotNegative, Positive, Share, Table, discriminate_by

CURVE_KEYS = {
    "sharp": "saturation_sharp_T",
    "knee_sharp": "knee_sharp_A_per_m",
    "slow": "saturation_slow_T",
    "knee_slow": "knee_slow_A_per_m",
}
"""Keys of the anhysteretic curve, by the names in ``anhyst_plant/curve.h``."""
MAX_CELLS = 64
"""Largest number of cells of an iron, including the cell without a threshold."""


class AnySteel(Table):
    """A steel of any family, with an anhysteretic curve.

    The polarisation ``mu0*M`` is the sum of a part with a sharp knee and a part that saturates
    slowly. Each part has its own knee field.
    """

    saturation_sharp_T: Positive
    knee_sharp_A_per_m: Positive
    saturation_slow_T: Positive
    knee_slow_A_per_m: Positive
    diagram_lines: ClassVar[tuple[str, ...]]  # format strings for the texts of a diagram
    pinning_key: ClassVar[str]  # key that changes with the pinning
    saturation_keys: ClassVar[tuple[str, ...]] = ("saturation_sharp_T", "saturation_slow_T")

    @model_validator(mode="after")
    def _check_makes_iron(self) -> Self:
        self.make_steel()
        return self

    def plant_parameters(self) -> dict[str, float]:
        """Return the scalar parameters by their names in ``plant/include/anhyst_plant``."""
        return {name: getattr(self, key) for name, key in CURVE_KEYS.items()}

    @abstractmethod
    def make_steel(self) -> Steel:
        """Return the steel for the core's plant."""

    @abstractmethod
    def make_anhysteretic_steel(self) -> Steel:
        """Return the steel without hysteresis for the core's plant."""

    def drifted_keys(self, pinning: float, reversible: float, saturation: float) -> dict[str, float]:
        """Return the keys that a drift changes, for relative changes of each quantity."""
        del reversible  # only play cells have a reversible fraction
        keys = {key: getattr(self, key) * (1.0 + saturation) for key in self.saturation_keys}
        return {self.pinning_key: getattr(self, self.pinning_key) * (1.0 + pinning), **keys}

    def diagram_texts(self) -> list[str]:
        """Return the texts that describe the iron in a diagram."""
        return [line.format(self) for line in self.diagram_lines]


class CellSteel(AnySteel):
    """A steel of parallel play cells, each with a threshold and a weight.

    A cell is a play operator: it follows the field only after the field has moved by more than its
    threshold. The same anhysteretic curve is applied to the field of each cell; the magnetisation
    is the weighted sum of the results. The thresholds are quantiles of a Weibull distribution. The
    cell without a threshold is the reversible part.
    """

    diagram_lines = (
        "iron of {0.cells} pinned cells",
        "reversible fraction {0.reversible_fraction:.3g}",
        "pinning {0.pinning_scale_A_per_m:.3g} A/m",
    )
    pinning_key = "pinning_scale_A_per_m"
    family: Literal["cells"] = "cells"
    cells: Annotated[int, Field(ge=1, le=1000)]  # number of pinned cells, which have equal weights
    reversible_fraction: Share  # weight of the cell without a threshold
    pinning_scale_A_per_m: Positive  # scale of the Weibull distribution of the thresholds
    pinning_shape: Positive

    @field_validator("cells")
    @classmethod
    def _check_cell_count(cls, cells: int) -> int:
        if cells >= MAX_CELLS:
            raise InputError(f"the plant has at most {MAX_CELLS - 1} cells; lower it", code="too-many-cells")
        return cells

    @property
    def thresholds(self) -> FloatArray:
        """Thresholds, A/m, shape (cells + 1,); the first one is zero: the reversible part."""
        pinning_ranks = (self.cells - np.arange(self.cells) - 0.5) / self.cells
        pinned_thresholds = self.pinning_scale_A_per_m * power(-log(pinning_ranks), 1.0 / self.pinning_shape)
        return np.concatenate(([0.0], pinned_thresholds))

    @property
    def weights(self) -> FloatArray:
        """Weight of each cell in the magnetisation, shape (cells + 1,); their sum is 1."""
        pinned_weights = np.full(self.cells, (1.0 - self.reversible_fraction) / self.cells)
        return np.concatenate(([self.reversible_fraction], pinned_weights))

    def make_steel(self) -> Steel:
        """Return the steel for the core's plant."""
        return Steel(self.plant_parameters(), self.thresholds, self.weights)

    def make_anhysteretic_steel(self) -> Steel:
        """Return the steel with the same curve, but without hysteresis, for the core's plant."""
        return self.model_copy(update={"cells": 1, "reversible_fraction": 1.0}).make_steel()

    def drifted_keys(self, pinning: float, reversible: float, saturation: float) -> dict[str, float]:
        """Return the keys that a drift changes, for relative changes of each quantity."""
        fraction = min(self.reversible_fraction * (1.0 + reversible), 1.0)
        common_keys = super().drifted_keys(pinning, reversible, saturation)
        return {"reversible_fraction": fraction, **common_keys}


_CHECK_FIELDS_TO_KNEE_FIELD = np.concatenate(([0.0], np.geomspace(1e-3, 1e3, 2000)))
"""Fields at which the stability is checked, relative to the field of the sharp knee."""


class DuhemSteel(AnySteel):
    """A Duhem steel: its field is that of the curve plus a part that depends on the flux direction.

    It has no return-point memory. Minor loops about a bias drift towards the curve, and a larger
    loop erases the effect of smaller ones only gradually.
    """

    diagram_lines = ("Duhem iron", "coercivity {0.coercivity_A_per_m:.3g} A/m")
    pinning_key = "coercivity_A_per_m"
    family: Literal["duhem"]
    coercivity_A_per_m: Positive  # half-width of a large loop at zero magnetisation
    # change of polarisation after a reversal in which this part settles by a factor e
    turning_T: Positive
    # fraction of the coercive field that is lost at saturation
    fading: Annotated[float, Field(ge=0.0, lt=1.0)]

    def make_steel(self) -> Steel:
        """Check the parameters and return the steel for the core's plant."""
        self._check_stability()
        return Steel(self.plant_parameters())

    def plant_parameters(self) -> dict[str, float]:
        """Return the parameters by their names in ``anhyst_plant/duhem.h``."""
        return {
            "coercivity": self.coercivity_A_per_m,
            "rate": 1.0 / self.turning_T,
            "fading": self.fading,
            **super().plant_parameters(),
        }

    def make_anhysteretic_steel(self) -> Steel:
        """Return the steel with the same curve, but without hysteresis, for the core's plant."""
        return self.model_copy(update={"coercivity_A_per_m": 0.0}).make_steel()

    def curve(self, field: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the polarisation of the curve, T, at given fields, A/m, and its slope."""
        root = np.sqrt(field * field + self.knee_sharp_A_per_m**2)
        slow_scale = self.saturation_slow_T * 2.0 / np.pi
        polarisation = self.saturation_sharp_T * field / root + slow_scale * np.arctan(
            field / self.knee_slow_A_per_m
        )
        slope = self.saturation_sharp_T * self.knee_sharp_A_per_m**2 / root**3
        slope += slow_scale * self.knee_slow_A_per_m / (field * field + self.knee_slow_A_per_m**2)
        return polarisation, slope

    def _check_stability(self) -> None:
        saturation = self.saturation_sharp_T + self.saturation_slow_T
        turning_ratio = self.turning_T / saturation
        if self.fading * (1.0 + 2.0 * turning_ratio + 2.0 * turning_ratio * turning_ratio) > 1.0:
            raise InputError(
                f"fading: {self.fading:g} with a turning of {self.turning_T:g} T lets minor loops "
                "release energy; lower one of them",
                code="small-loops-give-energy",
                key="fading",
            )
        polarisation, slope = self.curve(_CHECK_FIELDS_TO_KNEE_FIELD * self.knee_sharp_A_per_m)
        coercivity_slope = 2.0 * self.coercivity_A_per_m * self.fading / saturation**2
        if np.max(coercivity_slope * (polarisation - self.turning_T) * slope) > 0.9:
            raise InputError(
                f"coercivity: {self.coercivity_A_per_m:g} A/m fades too fast for a knee of "
                f"{self.knee_sharp_A_per_m:g} A/m; lower it or fading, or raise knee_sharp",
                code="fades-too-fast",
                key="coercivity",
            )


EVERETT_NODES = 257
"""Number of field nodes of an Everett table; odd, so that one node is at zero field."""


class PreisachSteel(AnySteel):
    """A moving Preisach steel of relays, each with a pinning field and a bias field.

    A relay switches up at ``bias + pinning`` and down at ``bias - pinning``. The pinning has a
    lognormal distribution. The bias has a normal distribution whose standard deviation increases
    with the pinning. Therefore, the density is not a product. The relays respond to the applied
    field plus a feedback from the polarisation.
    """

    diagram_lines = ("Preisach iron", "pinning {0.pinning_A_per_m:.3g} A/m")
    pinning_key = "pinning_A_per_m"
    saturation_keys = ("saturation_T", *AnySteel.saturation_keys)
    family: Literal["preisach"]
    saturation_T: Positive  # saturation polarisation of the relays, ``mu0*M``
    pinning_A_per_m: Positive  # median of the pinning
    pinning_spread: Positive  # standard deviation of the logarithm of the pinning
    bias_A_per_m: Positive  # standard deviation of the bias of relays with zero pinning
    bias_by_pinning: NotNegative  # increase of this standard deviation divided by the pinning
    feedback_A_per_m_T: NotNegative  # feedback: additional field divided by the polarisation

    @property
    def knee(self) -> float:
        """Field about which the nodes of the table are densest, A/m."""
        return self.pinning_A_per_m + self.bias_A_per_m

    @property
    def max_switching_field(self) -> float:
        """Field above which no relay switches, A/m: three standard deviations of pinning and bias."""
        max_pinning = self.pinning_A_per_m * float(exp(np.array([3.0 * self.pinning_spread]))[0])
        return max_pinning + 3.0 * (self.bias_A_per_m + self.bias_by_pinning * max_pinning)

    def density(self, pinning: FloatArray, bias: FloatArray) -> FloatArray:
        """Return the density of relays at given pinning and bias fields, up to a constant factor."""
        scatter = self.bias_A_per_m + self.bias_by_pinning * pinning
        log_deviation = log(pinning / self.pinning_A_per_m) / self.pinning_spread
        bias_deviation = bias / scatter
        density: FloatArray = exp(
            -0.5 * (log_deviation * log_deviation + bias_deviation * bias_deviation)
        ) / (pinning * scatter)
        return density

    def make_steel(self) -> Steel:
        """Return the steel for the core's plant."""
        return _make_preisach_steel(self, True)

    def plant_parameters(self) -> dict[str, float]:
        """Return the parameters by their names in ``anhyst_plant/preisach.h``."""
        return {
            "knee": self.knee,
            "reach": self.max_switching_field / (self.max_switching_field + self.knee),
            "feedback": self.feedback_A_per_m_T,
            **super().plant_parameters(),
        }

    def make_anhysteretic_steel(self) -> Steel:
        """Return the steel for the core's plant, with relays of the same bias but without pinning."""
        return _make_preisach_steel(self, False)


def node_fields(steel: PreisachSteel) -> FloatArray:
    """Return the fields of the table's nodes, A/m, in ascending order, shape (EVERETT_NODES,)."""
    end = steel.max_switching_field / (steel.max_switching_field + steel.knee)
    field = end * np.linspace(-1.0, 1.0, EVERETT_NODES)
    return np.asarray(steel.knee * field / (1.0 - np.abs(field)))


def everett_table(steel: PreisachSteel, is_pinned: bool) -> FloatArray:
    """Return the change of polarisation between any two nodes, T, shape (nodes, nodes)."""
    fields = node_fields(steel)
    cell_weights = (
        _relay_weights(steel, fields) if is_pinned else np.diag(_unpinned_relay_weights(steel, fields))
    )
    rising_branches = np.zeros((EVERETT_NODES, EVERETT_NODES))
    from_below = np.cumsum(cell_weights[::-1], axis=0)[::-1]
    rising_branches[:-1, 1:] = np.triu(np.cumsum(from_below, axis=1))
    rising_branches *= 2.0 * steel.saturation_T / rising_branches[0, -1]
    return rising_branches - rising_branches.T


def _relay_weights(steel: PreisachSteel, fields: FloatArray) -> FloatArray:
    """Return the relay weight of each cell of the table: lower field by row, upper field by column.

    The density is evaluated at the centres of a cell's four quarters. A diagonal cell has relays in
    one half only; its density is evaluated at the centroid of this half.
    """
    quarter_widths = 0.25 * np.diff(fields)
    cell_centres = fields[:-1] + 2.0 * quarter_widths
    down_cells, up_cells = np.triu_indices(cell_centres.size, 1)
    cell_weights = np.zeros((cell_centres.size, cell_centres.size))
    for down_side in (-1.0, 1.0):
        for up_side in (-1.0, 1.0):
            lower_field = cell_centres[down_cells] + down_side * quarter_widths[down_cells]
            upper_field = cell_centres[up_cells] + up_side * quarter_widths[up_cells]
            cell_weights[down_cells, up_cells] += steel.density(
                0.5 * (upper_field - lower_field), 0.5 * (upper_field + lower_field)
            )
    cell_weights[down_cells, up_cells] *= 4.0 * quarter_widths[down_cells] * quarter_widths[up_cells]
    diagonal_density = steel.density(quarter_widths * (2.0 / 3.0), cell_centres)
    np.fill_diagonal(cell_weights, 8.0 * quarter_widths * quarter_widths * diagonal_density)
    return cell_weights


def _unpinned_relay_weights(steel: PreisachSteel, fields: FloatArray) -> FloatArray:
    """Return the weight of the relays whose bias is between two nodes, summed over all pinning."""
    bias, slope = 0.5 * (fields[1:] + fields[:-1]), np.zeros(fields.size - 1)
    for spread in np.linspace(-3.0, 3.0, 61).tolist():
        pinning = steel.pinning_A_per_m * exp(np.full(bias.size, spread * steel.pinning_spread))
        slope += pinning * steel.density(pinning, bias)
    return slope * np.diff(fields)


@lru_cache(maxsize=32)
def _make_preisach_steel(steel: PreisachSteel, is_pinned: bool) -> Steel:
    table = everett_table(steel, is_pinned)
    # The steepest branch starts far below zero and passes the middle of the reversible part.
    relays = float(np.max(np.diff(table[0]) / np.diff(node_fields(steel))))
    slope = steel.saturation_sharp_T / steel.knee_sharp_A_per_m + relays
    slope += steel.saturation_slow_T * 2.0 / np.pi / steel.knee_slow_A_per_m
    if steel.feedback_A_per_m_T * slope > 0.9:
        raise InputError(
            f"feedback: {steel.feedback_A_per_m_T:g} A/m per T would make the polarisation jump; "
            f"this steel permits up to {0.9 / slope:.3g}",
            code="reversible-part-jumps",
            key="feedback",
        )
    return Steel(steel.plant_parameters(), np.ascontiguousarray(table))


class NamedCells(CellSteel):
    """``[[iron]]`` of family ``cells``."""

    name: Name


class NamedPreisach(PreisachSteel):
    """``[[iron]]`` of family ``preisach``."""

    name: Name


class NamedDuhem(DuhemSteel):
    """``[[iron]]`` of family ``duhem``."""

    name: Name


NamedIron = NamedCells | NamedPreisach | NamedDuhem
FAMILY_DISCRIMINATOR = discriminate_by("family", "cells", "preisach", "duhem", default="cells")
"""Function that selects the type of an iron table by its family."""
IronEntry = Annotated[
    Annotated[NamedCells, Tag(f"{BRANCH_PREFIX}cells")]
    | Annotated[NamedPreisach, Tag(f"{BRANCH_PREFIX}preisach")]
    | Annotated[NamedDuhem, Tag(f"{BRANCH_PREFIX}duhem")],
    FAMILY_DISCRIMINATOR,
]
