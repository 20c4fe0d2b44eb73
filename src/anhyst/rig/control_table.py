"""``[control]`` of a rig file: what is controlled. Its kind says what kind of rig this is."""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Tag

from anhyst.compensate.interface import NumberFormat
from anhyst.support.toml_file import BRANCH, Positive, Table, tag_by


class LevitationTable(Table):
    """``kind = "levitation"``: an armature in the air; what controls it, a controller file says."""

    kind: Literal["levitation"]
    bias_N: Positive | None = None  # what each magnet of a pair pulls with without a net force


class TrackingTable(Table):
    """``kind = "tracking"``: a mass between two magnets follows a set-point."""

    kind: Literal["tracking"]
    bias_N: Positive
    format: NumberFormat = "fixed"
    crossover_Hz: Positive
    force_max_N: Positive


class ForceTable(Table):
    """``kind = "force"``: the force of a held armature, open loop."""

    kind: Literal["force"]
    force_max_N: Positive
    end_m: Positive  # gap at the end of the stroke, where loops were measured


class DisplacementTable(Table):
    """``kind = "displacement"``: a stage on a stack, an integrator beside the feedforward."""

    kind: Literal["displacement"]
    bandwidth_Hz: Positive


ControlEntry = Annotated[
    Annotated[LevitationTable, Tag(f"{BRANCH}levitation")]
    | Annotated[TrackingTable, Tag(f"{BRANCH}tracking")]
    | Annotated[ForceTable, Tag(f"{BRANCH}force")]
    | Annotated[DisplacementTable, Tag(f"{BRANCH}displacement")],
    Discriminator(
        tag_by("kind"),
        custom_error_type="unknown_choice",
        custom_error_message='kind must be "levitation", "tracking", "force" or "displacement"; '
        "correct it",
    ),
]
