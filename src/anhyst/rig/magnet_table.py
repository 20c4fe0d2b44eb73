"""The electromagnet of a rig file: typed by hand, or fitted to the loops that were measured."""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from anhyst.rig.parts.iron import CellSteel
from anhyst.rig.parts.magnet import MOST_CELLS, Poles
from anhyst.support.toml_file import BRANCH, NotNegative, Positive, Share, Table

FROM_LOOPS = "from loops"


class SteelTable(Table):
    """A steel of pinned cells."""

    cells: Annotated[int, Field(ge=1, le=1000)]
    reversible_fraction: Share
    pinning_scale_A_per_m: Positive
    pinning_shape: Positive
    saturation_sharp_T: Positive
    knee_sharp_A_per_m: Positive
    saturation_slow_T: Positive
    knee_slow_A_per_m: Positive

    def steel(self) -> CellSteel:
        """Return what it is made of."""
        return CellSteel(
            cells=self.cells,
            reversible_fraction=self.reversible_fraction,
            pinning_scale=self.pinning_scale_A_per_m,
            pinning_shape=self.pinning_shape,
            saturation_sharp=self.saturation_sharp_T,
            knee_sharp=self.knee_sharp_A_per_m,
            saturation_slow=self.saturation_slow_T,
            knee_slow=self.knee_slow_A_per_m,
        )


class MagnetSteelTable(SteelTable):
    """The same where the core computes it."""

    @field_validator("cells")
    @classmethod
    def _few(cls, cells: int) -> int:
        if cells >= MOST_CELLS:
            raise ValueError(f"the plant has room for {MOST_CELLS - 1}; lower it")
        return cells


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


def _branch(value: Any) -> str:
    return f"{BRANCH}word" if isinstance(value, str) else f"{BRANCH}table"


IronEntry = Annotated[
    Annotated[MagnetSteelTable, Tag(f"{BRANCH}table")]
    | Annotated[Literal["from loops"], Tag(f"{BRANCH}word")],
    Discriminator(_branch),
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
                raise ValueError(f'needs {key}; add it, or write iron = "{FROM_LOOPS}"')
        return self

    @property
    def from_loops(self) -> bool:
        """Whether the loops still have to say what is left out."""
        return self.iron == FROM_LOOPS

    @property
    def steel(self) -> MagnetSteelTable:
        """The iron, once it is known."""
        assert isinstance(self.iron, MagnetSteelTable)
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
