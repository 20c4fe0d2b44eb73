"""Define the test cases of a rig file: ``[[case]]``."""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, Tag, model_validator

from anhyst.support.errors import InputError
from anhyst.support.toml_file import (
    BRANCH_PREFIX,
    Name,
    NotNegative,
    Number,
    Positive,
    Share,
    Table,
    check_order,
    discriminate_by,
)
from anhyst_rigs.rig.magnet_table import OPENS_GAP, DirectionVector

Peaks = Annotated[list[Positive], Field(min_length=2)]


class StepCase(Table):
    """``kind = "step"``: steps of the reference, centred on given gaps."""

    kind: Literal["step"]
    heights_m: Annotated[list[Positive], Field(min_length=1)]
    hold_s: Positive
    also_gaps_m: list[Positive] = Field(default_factory=list)


class LoadCase(Table):
    """``kind = "load"``: steps of the load force."""

    kind: Literal["load"]
    forces_N: Annotated[list[Number], Field(min_length=1)]


class TrajectoryCase(Table):
    """``kind = "triangle"`` or ``"sine"``: a periodic reference."""

    kind: Literal["triangle", "sine"]
    amplitude_m: Positive
    frequency_Hz: Positive


class ScanCase(Table):
    """``kind = "scan"``: motions at constant speed between turnarounds with limited snap."""

    kind: Literal["scan"]
    speed_m_per_s: Positive
    cruise_s: Positive
    jerk_phase_s: Positive
    snap_phase_s: Positive
    train_m_per_s2: Peaks
    test_m_per_s2: Peaks
    slit_s: Positive
    # weight of the moving average relative to the rms error when feedforward gains are searched
    average_weight: NotNegative = 0.0
    direction: DirectionVector = OPENS_GAP  # direction of the set-point

    @model_validator(mode="after")
    def _check_phases(self) -> Self:
        if not 2.0 * self.snap_phase_s <= self.jerk_phase_s:
            text = "snap_phase_s must be at most half of jerk_phase_s; correct them"
            raise InputError(text, code="phases-too-long")
        for peak in (*self.train_m_per_s2, *self.test_m_per_s2):
            if self.speed_m_per_s / peak < self.jerk_phase_s:
                raise InputError(
                    f"{peak:g} m/s2 is not reached before speed_m_per_s is; lower it or shorten jerk_phase_s",
                    code="not-reached",
                )
        if self.slit_s >= self.cruise_s:
            raise InputError("slit_s must be shorter than cruise_s; correct them", code="too-long")
        return self


HeadFault = Literal["missing", "frozen", "jumps"]
"""Failure of a position head: no reading, a constant reading, or a jump of the reading."""


class LossCase(Table):
    """``kind = "loss"``: runs of the test set-point, each with one failure of an amplifier or head."""

    kind: Literal["loss"]
    circuit: Literal["open", "short"]  # whether the winding is opened or shorted by the failure
    # magnets that fail; default: all
    magnets: Annotated[list[Name], Field(min_length=1)] | None = None
    heads: Annotated[list[HeadFault], Field(min_length=1)] | None = None  # failures of each head
    lift: bool = False  # whether a lift-off and landing without a failure is added
    # time of the failure; default: at the largest pull of the magnet, or at the largest
    # acceleration if a head fails
    at_s: NotNegative | None = None


class ForceCase(Table):
    """``kind = "force"``: a triangular force between two fractions of the largest force."""

    kind: Literal["force"]
    name: Name
    low: Share
    high: Share
    period_s: Positive
    cycles: Annotated[int, Field(ge=1, le=100)]

    @model_validator(mode="after")
    def _check_limit_order(self) -> Self:
        check_order("low", self.low, "high", self.high)
        return self


class HeldCase(Table):
    """``kind = "held"``: gaps at which the armature is held while the force is controlled."""

    kind: Literal["held"]
    gaps_m: Annotated[list[Positive], Field(min_length=1)]


class MovingCase(Table):
    """``kind = "moving"``: a periodic motion of the armature while the force is controlled."""

    kind: Literal["moving"]
    low_m: Positive
    high_m: Positive
    period_s: Positive


class DisplacementCase(Table):
    """``kind = "displacement"``: a triangular displacement with rounded corners."""

    kind: Literal["displacement"]
    stroke_m: Positive
    frequency_Hz: Positive
    low_m: NotNegative
    corner_s: Positive
    cycles: Annotated[float, Field(ge=3.0)]  # number of cycles; the first two are not evaluated

    @model_validator(mode="after")
    def _check_corner(self) -> Self:
        if self.corner_s * self.frequency_Hz > 0.5:
            text = "corner_s must be at most half a period of the triangle; shorten it"
            raise InputError(text, code="too-long")
        return self


_CASE_KINDS = ("step", "load", "triangle", "sine", "scan", "loss", "force", "held", "moving")
CaseEntry = Annotated[
    Annotated[StepCase, Tag(f"{BRANCH_PREFIX}step")]
    | Annotated[LoadCase, Tag(f"{BRANCH_PREFIX}load")]
    | Annotated[TrajectoryCase, Tag(f"{BRANCH_PREFIX}triangle")]
    | Annotated[ScanCase, Tag(f"{BRANCH_PREFIX}scan")]
    | Annotated[LossCase, Tag(f"{BRANCH_PREFIX}loss")]
    | Annotated[ForceCase, Tag(f"{BRANCH_PREFIX}force")]
    | Annotated[HeldCase, Tag(f"{BRANCH_PREFIX}held")]
    | Annotated[MovingCase, Tag(f"{BRANCH_PREFIX}moving")]
    | Annotated[DisplacementCase, Tag(f"{BRANCH_PREFIX}displacement")],
    discriminate_by("kind", *_CASE_KINDS, "displacement", sine="triangle"),
]
