"""Define ``[[magnet]]`` of a rig file: with parameters, fitted to loops, or in a separate file."""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from anhyst.data.output_map import output_map
from anhyst.support.errors import InputError
from anhyst.support.toml_file import BRANCH_PREFIX, Name, NotNegative, Number, Positive, Table
from anhyst.support.units import QUANTITIES
from anhyst_rigs.rig.parts.magnet import ACTUATORS, PERMANENT_MAGNET, Poles, SolidIron

FROM_LOOPS = "from loops"


PositionVector = Annotated[list[Number], Field(min_length=3, max_length=3)]
"""Position on the body in the directions x, y, z, m."""
ORIGIN = [0.0, 0.0, 0.0]


UNIT_LENGTH_TOLERANCE = 1e-6
"""Largest deviation of the length of a unit vector from 1."""


def _check_unit_vector(value: list[float]) -> list[float]:
    if abs(math.hypot(*value) - 1.0) > UNIT_LENGTH_TOLERANCE:
        text = f"has a length of {math.hypot(*value):.6g}; write a unit vector"
        raise InputError(text, code="no-unit-vector")
    return value


DirectionVector = Annotated[PositionVector, AfterValidator(_check_unit_vector)]
"""Unit vector with the components x, y, z."""
CLOSES_GAP = [-1.0, 0.0, 0.0]
OPENS_GAP = [1.0, 0.0, 0.0]
"""Directions along x in which a magnet pulls; the gap of the first magnet increases with x."""


class SolidTable(Table):
    """``magnet.solid``: solid part of the core. Omitted keys are fitted to loops."""

    depth_m: Annotated[float, Field(gt=0.0, le=1.0)]  # depth from the surface to the middle
    conductivity_S_per_m: Annotated[float, Field(gt=0.0, le=1e9)] | None = None
    # length of the flux path in the solid part; None: iron_length_m, or fitted to the loops
    path_m: Annotated[float, Field(ge=1e-6)] | None = None
    volumes: Annotated[int, Field(ge=8, le=16)] = 12  # number of finite volumes across the depth

    def make_solid_iron(self, iron_length: float) -> SolidIron | None:
        """Return the solid part for an iron length, m; None if the conductivity is unknown."""
        if self.conductivity_S_per_m is None:
            return None
        length = iron_length if self.path_m is None else self.path_m
        return SolidIron(length, self.depth_m, self.conductivity_S_per_m, self.volumes)


LAW_KIND = "law"
"""Kind of a magnet whose force is given by an identified law."""


def _check_kind(kind: str) -> str:
    if reason := ACTUATORS.explain_unusable(kind):
        raise InputError(reason, code="not-installed")
    if kind not in (LAW_KIND, *ACTUATORS):
        names = ", ".join(f'"{name}"' for name in (*ACTUATORS, LAW_KIND))
        raise InputError(f"must be one of {names}; correct it", code="unknown-choice")
    return kind


class MagnetTable(Table):
    """Winding, poles and iron of a magnet. Keys that are fitted to loops may be omitted."""

    name: Name
    kind: Annotated[str, AfterValidator(_check_kind)] = "electromagnet"
    iron: str | None = None  # name of an iron table, or "from loops"
    direction: DirectionVector = CLOSES_GAP
    position_m: PositionVector = ORIGIN  # position of the centre of the poles on the body
    gap_m: Positive | None = None  # gap at the operating point
    turns: Annotated[int, Field(ge=1)] | None = None
    resistance_ohm: Positive | None = None
    pole_width_m: Positive | None = None
    pole_depth_m: Positive | None = None
    leakage_H: NotNegative | None = None
    iron_length_m: Positive | None = None
    joints_m: NotNegative | None = None
    eddy_time_s: NotNegative = 0.0
    solid: SolidTable | None = None
    numbers: dict[str, Positive] = Field(default_factory=dict)  # parameters of a plug-in kind
    model: str | None = None
    flux_table: str | None = None

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        if self.kind == LAW_KIND and self.model is None:
            raise InputError('a magnet of kind "law" needs model; add it', code="missing")
        if self.kind != LAW_KIND and (self.model or self.flux_table):
            text = 'model and flux_table belong to kind "law"; write that, or remove them'
            raise InputError(text, code="not-for-this-kind")
        if self.iron is None and (self.kind != LAW_KIND or self.flux_table is None):
            raise InputError(f'needs iron; name one of [[iron]], or write "{FROM_LOOPS}"', code="missing")
        if self.solid is not None and self.kind in (LAW_KIND, PERMANENT_MAGNET):
            raise InputError('solid belongs to kind "electromagnet"; remove it', code="not-for-this-kind")
        parameters = {} if self.kind == LAW_KIND else ACTUATORS[self.kind].numbers
        for key in sorted(parameters.keys() - self.numbers):
            text = f"needs numbers.{key}, {parameters[key]}; add it"
            raise InputError(text, code="missing")
        for key in sorted(self.numbers.keys() - parameters):
            text = f'numbers.{key} is unknown for kind "{self.kind}"; remove it'
            raise InputError(text, code="not-for-this-kind")
        if self.has_iron_from_loops:
            return self
        if self.solid is not None and self.solid.conductivity_S_per_m is None:
            text = f'needs solid.conductivity_S_per_m; add it, or write iron = "{FROM_LOOPS}"'
            raise InputError(text, code="missing")
        for name, key in POLE_KEYS.items():
            if name != "joints" and getattr(self, key) is None:
                raise InputError(f'needs {key}; add it, or write iron = "{FROM_LOOPS}"', code="missing")
        if self.solid_iron is not None and self.solid_iron.length > (self.iron_length_m or 0.0):
            raise InputError("solid.path_m is longer than iron_length_m; lower it", code="too-long")
        if not self._has_circuit():
            text = f'numbers give no valid circuit for kind "{self.kind}"; correct them'
            raise InputError(text, code="no-circuit")
        return self

    def _has_circuit(self) -> bool:
        """Whether the parameters make a valid circuit, which needs a bias if it is bidirectional."""
        try:
            poles = self.poles
        except ArithmeticError:
            return False
        if poles.outer is None:
            return not self.is_bidirectional
        time_constant = poles.turns**2 / poles.outer / poles.resistance if poles.outer > 0.0 else math.inf
        is_finite = math.isfinite(poles.bias) and math.isfinite(poles.spring)
        return (
            is_finite
            and 0.0 < time_constant <= MAX_TIME_CONSTANT_S
            and self.is_bidirectional == (poles.bias != 0.0)
        )

    @property
    def output(self) -> str:
        """Output quantity of the magnet's loops."""
        return "force" if self.kind == LAW_KIND else ACTUATORS[self.kind].output

    @property
    def is_bidirectional(self) -> bool:
        """Whether the magnet can push as well as pull."""
        return not output_map(QUANTITIES[self.output]).is_even

    @property
    def has_iron_from_loops(self) -> bool:
        """Whether omitted keys are fitted to the loops."""
        return self.iron == FROM_LOOPS

    @property
    def solid_iron(self) -> SolidIron | None:
        """Solid part of the core; None if there is none or it is not yet fitted."""
        if self.solid is None or self.iron_length_m is None:
            return None
        return self.solid.make_solid_iron(self.iron_length_m)

    @property
    def poles(self) -> Poles:
        """Winding and poles; requires that all their parameters are given or fitted."""
        pole_values = {name: getattr(self, key) for name, key in POLE_KEYS.items()}
        poles = Poles(**{**pole_values, "joints": self.joints_m or 0.0})
        return poles if self.kind == LAW_KIND else ACTUATORS[self.kind].circuit(poles, self.numbers)


MAX_TIME_CONSTANT_S = 1e3
"""Largest ratio of inductance to resistance of a winding, s; larger ones cannot be simulated."""
POLE_KEYS = {
    "turns": "turns",
    "resistance": "resistance_ohm",
    "width": "pole_width_m",
    "depth": "pole_depth_m",
    "leakage": "leakage_H",
    "iron_length": "iron_length_m",
    "joints": "joints_m",
}
"""Keys of the rig file by the fields of :class:`Poles`."""


class LikeTable(Table):
    """A magnet with the parameters of another one, at another position."""

    name: Name
    like: Name
    direction: DirectionVector
    position_m: PositionVector = ORIGIN
    gap_m: Positive


class SolenoidTable(Table):
    """A solenoid that is described in its own file."""

    name: Name
    kind: Literal["solenoid"]
    file: str


def _table_tag(value: Any) -> str:
    """Return the tag that selects the type of a magnet's table."""
    if isinstance(value, Table):
        return f"{BRANCH_PREFIX}{_TAGS[type(value)]}"
    if not isinstance(value, dict) or value.get("kind") != "solenoid":
        return f"{BRANCH_PREFIX}{'like' if isinstance(value, dict) and 'like' in value else 'magnet'}"
    return f"{BRANCH_PREFIX}solenoid"


_TAGS: dict[type[Table], str] = {MagnetTable: "magnet", LikeTable: "like", SolenoidTable: "solenoid"}
MagnetEntry = Annotated[
    Annotated[MagnetTable, Tag(f"{BRANCH_PREFIX}magnet")]
    | Annotated[LikeTable, Tag(f"{BRANCH_PREFIX}like")]
    | Annotated[SolenoidTable, Tag(f"{BRANCH_PREFIX}solenoid")],
    Discriminator(_table_tag),
]
