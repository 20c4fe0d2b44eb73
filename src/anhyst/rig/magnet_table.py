"""The electromagnet of a rig file: typed by hand, or fitted to the loops that were measured."""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, Tag, model_validator

from anhyst.rig.iron_table import BY_FAMILY, DuhemTable, MagnetSteelTable, PreisachTable
from anhyst.rig.parts.iron import CellSteel
from anhyst.rig.parts.magnet import Poles
from anhyst.support.errors import InputError
from anhyst.support.toml_file import BRANCH, NotNegative, Positive, Table

FROM_LOOPS = "from loops"


def steel_table(steel: CellSteel) -> MagnetSteelTable:
    """Return what a file says about a steel."""
    return MagnetSteelTable(
        cells=steel.cells,
        reversible_fraction=steel.reversible_fraction,
        pinning_scale_A_per_m=steel.pinning_scale,
        pinning_shape=steel.pinning_shape,
        saturation_sharp_T=steel.saturation_sharp,
        knee_sharp_A_per_m=steel.knee_sharp,
        saturation_slow_T=steel.saturation_slow,
        knee_slow_A_per_m=steel.knee_slow,
    )


HandTyped = MagnetSteelTable | PreisachTable | DuhemTable
"""An iron typed by hand, or found by a fit."""

IronEntry = Annotated[
    Annotated[MagnetSteelTable, Tag(f"{BRANCH}cells")]
    | Annotated[PreisachTable, Tag(f"{BRANCH}preisach")]
    | Annotated[DuhemTable, Tag(f"{BRANCH}duhem")]
    | Annotated[Literal["from loops"], Tag(f"{BRANCH}word")],
    BY_FAMILY,
]
"""A steel typed by hand, or the word that has it fitted."""


class ElectromagnetTable(Table):
    """``[magnet]``: winding, poles and iron. What a fit finds or guesses may be left out."""

    turns: Annotated[int, Field(ge=1)] | None = None
    resistance_ohm: Positive | None = None
    pole_width_m: Positive | None = None
    pole_depth_m: Positive | None = None
    leakage_H: NotNegative | None = None
    iron_length_m: Positive | None = None
    joints_m: NotNegative | None = None
    iron: IronEntry | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.from_loops:
            return self
        for key in ("turns", "resistance_ohm", *_GEOMETRY):
            if getattr(self, key) is None:
                raise InputError(
                    f'needs {key}; add it, or write iron = "{FROM_LOOPS}"', code="missing"
                )
        return self

    @property
    def from_loops(self) -> bool:
        """Whether the loops still have to say what is left out."""
        return self.iron == FROM_LOOPS

    @property
    def steel(self) -> HandTyped:
        """The iron, once it is known."""
        assert isinstance(self.iron, HandTyped)
        return self.iron

    @property
    def poles(self) -> Poles:
        """Winding and poles, once they are known."""
        assert self.turns is not None
        assert self.resistance_ohm is not None
        assert self.pole_width_m is not None
        assert self.pole_depth_m is not None
        assert self.leakage_H is not None
        assert self.iron_length_m is not None
        return Poles(
            turns=self.turns,
            resistance=self.resistance_ohm,
            width=self.pole_width_m,
            depth=self.pole_depth_m,
            leakage=self.leakage_H,
            iron_length=self.iron_length_m,
            joints=self.joints_m or 0.0,
        )


_GEOMETRY = ("pole_width_m", "pole_depth_m", "leakage_H", "iron_length_m")
