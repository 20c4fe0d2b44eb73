"""Times, amplifiers, bodies, load and stack of a rig file, and what varies between plants."""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal, Self, get_args

from pydantic import Discriminator, Field, Tag, model_validator

from anhyst.support.errors import InputError
from anhyst.support.kinds import NumberFormat
from anhyst.support.toml_file import (
    BRANCH_PREFIX,
    Bits,
    NotNegative,
    Number,
    Positive,
    Table,
    check_order,
    discriminate_by,
)
from anhyst_rigs.rig.magnet_table import ORIGIN, Place

Spread = Annotated[float, Field(ge=0.0, le=30.0)]
Ratio = Annotated[float, Field(gt=0.0, le=1000.0)]


class TimingTable(Table):
    """``[timing]``: when what happens."""

    rate_Hz: Annotated[float, Field(ge=100.0, le=200e3)]
    substeps: Annotated[int, Field(ge=1, le=64)] = 4
    delay_ticks: Annotated[float, Field(ge=0.0, le=8.0)] = 1.0

    @model_validator(mode="after")
    def _check_delay(self) -> Self:
        steps = self.delay_ticks * self.substeps
        if abs(steps - round(steps)) > 1e-9:
            raise InputError(
                f"delay_ticks of {self.delay_ticks} is no whole number of sub-steps of "
                f"1/{self.substeps} tick; correct one of them",
                code="delay-not-whole",
            )
        return self


class AmplifierTable(Table):
    """``[[amplifier]]``: the power stage of a coil, one for each."""

    mode: Literal["current", "voltage"] = "current"
    supply_V: Positive | None = None
    bandwidth_Hz: Positive
    current_low_A: Number = 0.0
    current_high_A: Positive
    slew_A_per_s: Positive | None = None
    dac_bits: Bits
    delay_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        check_order("current_low_A", self.current_low_A, "current_high_A", self.current_high_A)
        return self

    @property
    def supply(self) -> float:
        """Largest voltage, V; a body's rig has one."""
        assert self.supply_V is not None
        return self.supply_V

    @property
    def slew(self) -> float:
        """Fastest change of the current, A/s; a force rig has one."""
        assert self.slew_A_per_s is not None
        return self.slew_A_per_s


class StackAmplifierTable(Table):
    """``[[amplifier]]`` of a stack: a voltage that follows its command."""

    mode: Literal["stack"]
    low_V: Number
    high_V: Positive
    time_constant_s: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        check_order("low_V", self.low_V, "high_V", self.high_V)
        return self


AmplifierEntry = Annotated[
    Annotated[AmplifierTable, Tag(f"{BRANCH_PREFIX}current")]
    | Annotated[StackAmplifierTable, Tag(f"{BRANCH_PREFIX}stack")],
    discriminate_by("mode", "current", "voltage", "stack", default="current", voltage="current"),
]


Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
AXES: tuple[Axis, ...] = get_args(Axis)
"""Ways in which a body is free: along and about x, y, z."""
_ALONG_X: list[Axis] = ["x"]


class BodyTable(Table):
    """``[[body]]``: what moves, its guide and its end stops."""

    mass_kg: Positive
    free: Annotated[list[Axis], Field(min_length=1)] = _ALONG_X
    centre_m: Place = ORIGIN  # centre of mass, on the body
    # about it, of x, y and z
    inertia_kg_m2: Annotated[list[Positive], Field(min_length=3, max_length=3)] | None = None
    tilt_rad: Positive = 1e-3  # where the end stops of the angles are, either way
    stop_low_m: Positive
    stop_high_m: Positive
    damping_N_s_per_m: NotNegative = 0.0
    gravity_m_per_s2: Number = 0.0
    # from a place on the body to the ground: a spring and a damper, without force where it begins
    cable_N_per_m: NotNegative = 0.0
    cable_N_s_per_m: NotNegative = 0.0
    cable_m: Place = ORIGIN

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        check_order("stop_low_m", self.stop_low_m, "stop_high_m", self.stop_high_m)
        if self.free != [axis for axis in AXES if axis in self.free]:
            raise InputError(f"free names some of {list(AXES)}, in this order", code="wrong-order")
        if {*AXES[3:]} & {*self.free} and self.inertia_kg_m2 is None:
            raise InputError("a body that turns needs inertia_kg_m2; add it", code="missing")
        return self

    @property
    def weight_N(self) -> float:  # noqa: N802 - carries its unit
        """Along -z, or opening the gap."""
        return self.mass_kg * self.gravity_m_per_s2


class FlexureTable(Table):
    """``[[body]]`` on flexures: mass and stiffness, by what they make."""

    # as the steps of the plant's integration follow them
    resonance_Hz: Annotated[float, Field(gt=0.0, le=1e5)]
    damping_ratio: Annotated[float, Field(gt=0.0, le=3.0)]


BodyEntry = Annotated[
    Annotated[BodyTable, Tag(f"{BRANCH_PREFIX}body")]
    | Annotated[FlexureTable, Tag(f"{BRANCH_PREFIX}flexure")],
    Discriminator(
        lambda value: (
            f"{BRANCH_PREFIX}flexure"
            if isinstance(value, FlexureTable)
            or (isinstance(value, dict) and "resonance_Hz" in value)
            else f"{BRANCH_PREFIX}body"
        )
    ),
]


MAX_CREEP_TERMS = 8
"""Most terms of the creep of a stack, as the plant has room for."""


class StackTable(Table):
    """``[[stack]]``: what a free piezo stack does."""

    stroke_m_per_V: Positive
    bend_m_per_V2: Number
    slope_m_per_V: Positive
    beta_per_V: Positive
    gamma_per_V: NotNegative
    creep_times_s: list[Annotated[float, Field(ge=1e-4)]]  # as these steps follow them
    creep_shares: list[NotNegative]

    @model_validator(mode="after")
    def _check_lengths(self) -> Self:
        if len(self.creep_times_s) != len(self.creep_shares):
            raise InputError(
                "creep_shares must hold one share for each of creep_times_s", code="length-differs"
            )
        if len(self.creep_times_s) > MAX_CREEP_TERMS:
            raise InputError(
                f"creep_times_s holds {len(self.creep_times_s)} times; a stack creeps in at most "
                f"{MAX_CREEP_TERMS}, leave the smallest shares out",
                code="too-many-creeps",
            )
        return self


class DisturbanceTable(Table):
    """``[[load.disturbance]]``: a force beside the commanded one."""

    kind: Literal["step", "sine", "noise"]
    force_N: Number
    frequency_Hz: Positive | None = None
    start_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _check_frequency(self) -> Self:
        if self.kind == "step" and self.frequency_Hz is not None:
            raise InputError("a step has no frequency_Hz; remove it", code="not-for-a-step")
        if self.kind != "step" and self.frequency_Hz is None:
            raise InputError(f"a {self.kind} needs frequency_Hz; add it", code="missing")
        return self


class LoadTable(Table):
    """``[load]``: the load drive, which pulls the gap open."""

    force_N: Number
    bandwidth_Hz: Positive
    damping_N_s_per_m: NotNegative = 0.0
    stiffness_N_per_m: Number = 0.0
    encoder_step_m: NotNegative
    velocity_bandwidth_Hz: Positive
    disturbance: list[DisturbanceTable] = Field(default_factory=list)


NO_LOAD = LoadTable(force_N=0.0, bandwidth_Hz=1e5, encoder_step_m=0.0, velocity_bandwidth_Hz=1.0)
"""Of a body that nothing pulls at, or what a benchmark says, at once."""


class FrameTable(Table):
    """``[frame]``: what the magnets ride on, and by how much it misses its path."""

    stray_m: NotNegative = 0.0


class SpreadTable(Table):
    """``[spread]``: standard deviations of what differs from what the controller was made for."""

    pinning_percent: Spread = 10.0
    reversible_percent: Spread = 20.0
    saturation_percent: Spread = 2.0
    mass_percent: Spread = 2.0
    resistance_percent: Spread = 10.0
    sensor_gain_percent: Spread = 0.5
    current_percent: Spread = 0.5
    hall_percent: Spread = 0.5
    gap_zero_m: NotNegative = 1e-6
    eddy_s: NotNegative = 25e-6
    conductivity_percent: Spread = 10.0
    payload_percent: Spread = 0.0
    centre_m: NotNegative = 0.0  # of the centre of mass, each coordinate
    head_m: NotNegative = 0.0  # of the place where a position head looks at the body
    cable_N_per_m: NotNegative = 0.0
    stroke_percent: Spread = 5.0
    creep_percent: Spread = 10.0
    resonance_percent: Spread = 3.0


_IRON_SPREADS = {
    "pinning": "pinning_percent",
    "reversible": "reversible_percent",
    "saturation": "saturation_percent",
}


@dataclass(frozen=True)
class Spreads:
    """What the plants of a kind of rig differ in: names of a drift, and their keys of ``[spread]``."""

    rig_wide: Mapping[str, str]
    magnet: Mapping[str, str] = field(default_factory=dict)  # of each magnet by itself
    head: Mapping[str, str] = field(default_factory=dict)  # of each position head by itself

    @property
    def keys(self) -> list[str]:
        """The keys of ``[spread]`` that a rig file may give."""
        values = (*self.rig_wide.values(), *self.magnet.values(), *self.head.values())
        return list(dict.fromkeys(values))


SPREADS: Mapping[str, Spreads] = {
    "levitation": Spreads(
        {
            **_IRON_SPREADS,
            "mass": "mass_percent",
            "resistance": "resistance_percent",
            "position_gain": "sensor_gain_percent",
            "current_gain": "sensor_gain_percent",
            "flux_gain": "sensor_gain_percent",
            "gap_offset": "gap_zero_m",
        }
    ),
    "tracking": Spreads(
        {
            "mass": "payload_percent",
            **{f"place_{axis}": "centre_m" for axis in "xyz"},
            "eddy": "eddy_s",
            "conductivity": "conductivity_percent",
            "cable": "cable_N_per_m",
        },
        magnet={
            "gap_offset": "gap_zero_m",
            "first_scale": "current_percent",
            "pinning": "pinning_percent",
            "flux_gain": "hall_percent",
        },
        head={f"place_{axis}": "head_m" for axis in "xyz"},
    ),
    "force": Spreads(
        {**_IRON_SPREADS, "gap_offset": "gap_zero_m", "first_scale": "current_percent"}
    ),
    "displacement": Spreads(
        {"stroke": "stroke_percent", "creep": "creep_percent", "resonance": "resonance_percent"}
    ),
}
"""What differs from plant to plant, by the kind of ``[control]``."""


class LevitationTable(Table):
    """``kind = "levitation"``: an armature in the air; what controls it, a controller file says."""

    kind: Literal["levitation"]
    bias_N: Positive | None = None  # what each magnet of a pair pulls with without a net force
    calibration: str | None = None  # file of anhyst calibrate


class TrackingTable(Table):
    """``kind = "tracking"``: a body between magnets follows a set-point."""

    kind: Literal["tracking"]
    bias_N: Positive | None = None  # what each magnet of a pair pulls with without a net force
    format: NumberFormat = "fixed"
    crossover_Hz: Positive
    # corner frequencies of the PID, in parts of the crossover or the crossover in parts of them
    integral_ratio: Ratio = 5.0  # crossover over the corner of the integral
    lead_ratio: Ratio = 3.0  # crossover over where the lead begins
    rolloff_ratio: Ratio = 6.0  # where the lead ends over the crossover
    force_max_N: Positive
    force_min_N: NotNegative = 0.5  # of a magnet without another against it
    # a magnet is lost whose current is off by so much for so long; none is looked at if left out
    lost_A: Positive | None = None
    lost_s: Positive = 0.25e-3
    # a head is lost whose reading moves so much faster than the target, or does not, for so long
    head_m_per_s: Positive | None = None
    head_s: Positive = 0.25e-3
    land_m_per_s: Positive = 2e-3  # how fast a body is set down
    lift_m_per_s: Positive = 2e-3  # and lifted
    calibration: str | None = None  # file of anhyst calibrate
    calibrate: bool = False  # every motion teaches what the next one is corrected by


class ForceTable(Table):
    """``kind = "force"``: the force of a held armature, open loop."""

    kind: Literal["force"]
    force_max_N: Positive
    end_m: Positive  # gap at the end of the stroke, where loops were measured


class DisplacementTable(Table):
    """``kind = "displacement"``: a stage on a stack, an integrator beside the feedforward."""

    kind: Literal["displacement"]
    bandwidth_Hz: Positive
    # of the notch filter in the feedback: that of the body if left out, and what takes its place
    notch_Hz: Positive | None = None
    notch_damping: Positive | None = None
    notch_width: Positive = 0.7


ControlEntry = Annotated[
    Annotated[LevitationTable, Tag(f"{BRANCH_PREFIX}levitation")]
    | Annotated[TrackingTable, Tag(f"{BRANCH_PREFIX}tracking")]
    | Annotated[ForceTable, Tag(f"{BRANCH_PREFIX}force")]
    | Annotated[DisplacementTable, Tag(f"{BRANCH_PREFIX}displacement")],
    discriminate_by("kind", "levitation", "tracking", "force", "displacement"),
]
