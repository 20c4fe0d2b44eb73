"""The irons of a rig file, one table for each family.

A table without ``family`` is one of cells. Each knows how it drifts and how a diagram names it.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from anhyst.rig.parts.iron import MOST_CELLS, CellSteel, DuhemSteel, PreisachSteel
from anhyst.support.errors import InputError
from anhyst.support.toml_file import BRANCH, Name, NotNegative, Positive, Share, Table, tag_by


class CurveTable(Table):
    """The curve of a steel that nothing pins."""

    saturation_sharp_T: Positive
    knee_sharp_A_per_m: Positive
    saturation_slow_T: Positive
    knee_slow_A_per_m: Positive

    def _curve(self) -> dict[str, float]:
        return {
            "saturation_sharp": self.saturation_sharp_T,
            "knee_sharp": self.knee_sharp_A_per_m,
            "saturation_slow": self.saturation_slow_T,
            "knee_slow": self.knee_slow_A_per_m,
        }

    def _saturated(self, factor: float) -> dict[str, float]:
        keys = ("saturation_sharp_T", "saturation_slow_T")
        return {key: getattr(self, key) * factor for key in keys}


class SteelTable(CurveTable):
    """A steel of pinned cells."""

    family: Literal["cells"] = "cells"
    cells: Annotated[int, Field(ge=1, le=1000)]
    reversible_fraction: Share
    pinning_scale_A_per_m: Positive
    pinning_shape: Positive

    def steel(self) -> CellSteel:
        """Return what it is made of."""
        return CellSteel(
            cells=self.cells,
            reversible_fraction=self.reversible_fraction,
            pinning_scale=self.pinning_scale_A_per_m,
            pinning_shape=self.pinning_shape,
            **self._curve(),
        )

    def drifted(self, pinning: float, reversible: float, saturation: float) -> dict[str, float]:
        """Return the keys of an iron that has drifted, by parts of each quantity."""
        return {
            "pinning_scale_A_per_m": self.pinning_scale_A_per_m * (1.0 + pinning),
            "reversible_fraction": min(self.reversible_fraction * (1.0 + reversible), 1.0),
            **self._saturated(1.0 + saturation),
        }

    def lines(self) -> list[str]:
        """Return what a diagram says of it."""
        return [
            f"iron of {self.cells} pinned cells",
            f"reversible fraction {self.reversible_fraction:.3g}",
            f"pinning {self.pinning_scale_A_per_m:.3g} A/m",
        ]


class MagnetSteelTable(SteelTable):
    """The same where the core computes it."""

    @field_validator("cells")
    @classmethod
    def _few(cls, cells: int) -> int:
        if cells >= MOST_CELLS:
            raise InputError(
                f"the plant has room for {MOST_CELLS - 1}; lower it", code="too-many-cells"
            )
        return cells


class PreisachTable(CurveTable):
    """A moving Preisach iron."""

    family: Literal["preisach"]
    saturation_T: Positive
    pinning_A_per_m: Positive
    pinning_spread: Positive
    bias_A_per_m: Positive
    bias_by_pinning: NotNegative
    feedback_A_per_m_T: NotNegative

    @model_validator(mode="after")
    def _makes_an_iron(self) -> Self:
        self.steel().plant()
        return self

    def steel(self) -> PreisachSteel:
        """Return what it is made of."""
        return PreisachSteel(
            saturation=self.saturation_T,
            pinning=self.pinning_A_per_m,
            pinning_spread=self.pinning_spread,
            bias=self.bias_A_per_m,
            bias_by_pinning=self.bias_by_pinning,
            feedback=self.feedback_A_per_m_T,
            **self._curve(),
        )

    def drifted(self, pinning: float, reversible: float, saturation: float) -> dict[str, float]:
        """Return the keys of an iron that has drifted, by parts of each quantity."""
        del reversible
        return {
            "pinning_A_per_m": self.pinning_A_per_m * (1.0 + pinning),
            "saturation_T": self.saturation_T * (1.0 + saturation),
            **self._saturated(1.0 + saturation),
        }

    def lines(self) -> list[str]:
        """Return what a diagram says of it."""
        return ["Preisach iron", f"pinning {self.pinning_A_per_m:.3g} A/m"]


class DuhemTable(CurveTable):
    """A Duhem iron."""

    family: Literal["duhem"]
    coercivity_A_per_m: Positive
    turning_T: Positive
    fading: Annotated[float, Field(ge=0.0, lt=1.0)]

    @model_validator(mode="after")
    def _makes_an_iron(self) -> Self:
        self.steel().plant()
        return self

    def steel(self) -> DuhemSteel:
        """Return what it is made of."""
        return DuhemSteel(
            coercivity=self.coercivity_A_per_m,
            turning=self.turning_T,
            fading=self.fading,
            **self._curve(),
        )

    def drifted(self, pinning: float, reversible: float, saturation: float) -> dict[str, float]:
        """Return the keys of an iron that has drifted, by parts of each quantity."""
        del reversible
        return {
            "coercivity_A_per_m": self.coercivity_A_per_m * (1.0 + pinning),
            **self._saturated(1.0 + saturation),
        }

    def lines(self) -> list[str]:
        """Return what a diagram says of it."""
        return ["Duhem iron", f"coercivity {self.coercivity_A_per_m:.3g} A/m"]


class NamedCells(MagnetSteelTable):
    """``[[iron]]`` of cells."""

    name: Name


class NamedPreisach(PreisachTable):
    """``[[iron]]`` after Preisach."""

    name: Name


class NamedDuhem(DuhemTable):
    """``[[iron]]`` after Duhem."""

    name: Name


NamedIron = NamedCells | NamedPreisach | NamedDuhem
BY_FAMILY = Discriminator(
    tag_by("family", default="cells"),
    custom_error_type="unknown_choice",
    custom_error_message='family must be "cells", "preisach" or "duhem"; correct it',
)
"""By it an iron of a file is read as the table of its family."""
IronEntry = Annotated[
    Annotated[NamedCells, Tag(f"{BRANCH}cells")]
    | Annotated[NamedPreisach, Tag(f"{BRANCH}preisach")]
    | Annotated[NamedDuhem, Tag(f"{BRANCH}duhem")],
    BY_FAMILY,
]


def steel_table(name: str, steel: CellSteel) -> NamedCells:
    """Return what a file says about a steel."""
    return NamedCells(
        name=name,
        cells=steel.cells,
        reversible_fraction=steel.reversible_fraction,
        pinning_scale_A_per_m=steel.pinning_scale,
        pinning_shape=steel.pinning_shape,
        saturation_sharp_T=steel.saturation_sharp,
        knee_sharp_A_per_m=steel.knee_sharp,
        saturation_slow_T=steel.saturation_slow,
        knee_slow_A_per_m=steel.knee_slow,
    )
