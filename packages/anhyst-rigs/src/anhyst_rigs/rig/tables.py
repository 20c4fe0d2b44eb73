"""Define the tables of a rig file for timing, amplifiers, bodies, stacks, load, control and spread.

Separate modules define the magnets, the sensors, the measurements and the test cases.
"""

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
from anhyst_rigs.rig.magnet_table import ORIGIN, PositionVector

Spread = Annotated[float, Field(ge=0.0, le=30.0)]
Ratio = Annotated[float, Field(gt=0.0, le=1000.0)]


class TimingTable(Table):
    """``[timing]``: sample rate, number of sub-steps, and delay."""

    rate_Hz: Annotated[float, Field(ge=100.0, le=200e3)]
    substeps: Annotated[int, Field(ge=1, le=64)] = 4
    delay_ticks: Annotated[float, Field(ge=0.0, le=8.0)] = 1.0

    @model_validator(mode="after")
    def _check_delay(self) -> Self:
        steps = self.delay_ticks * self.substeps
        if abs(steps - round(steps)) > 1e-9:
            raise InputError(
                f"delay_ticks of {self.delay_ticks} is not a whole number of sub-steps of "
                f"1/{self.substeps} tick; correct one of them",
                code="delay-not-whole",
            )
        return self


class AmplifierTable(Table):
    """``[[amplifier]]``: power stage that drives each coil."""

    mode: Literal["current", "voltage"] = "current"
    supply_V: Positive | None = None
    bandwidth_Hz: Positive
    current_low_A: Number = 0.0
    current_high_A: Positive
    slew_A_per_s: Positive | None = None
    dac_bits: Bits
    delay_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _check_limit_order(self) -> Self:
        check_order("current_low_A", self.current_low_A, "current_high_A", self.current_high_A)
        return self

    @property
    def supply(self) -> float:
        """Supply voltage, V; bearings and stages require it."""
        assert self.supply_V is not None
        return self.supply_V

    @property
    def slew(self) -> float:
        """Largest slope of the current, A/s; force control requires it."""
        assert self.slew_A_per_s is not None
        return self.slew_A_per_s


class StackAmplifierTable(Table):
    """``[[amplifier]]`` of a stack: a voltage amplifier with a first-order lag."""

    mode: Literal["stack"]
    low_V: Number
    high_V: Positive
    time_constant_s: Positive

    @model_validator(mode="after")
    def _check_limit_order(self) -> Self:
        check_order("low_V", self.low_V, "high_V", self.high_V)
        return self


AmplifierEntry = Annotated[
    Annotated[AmplifierTable, Tag(f"{BRANCH_PREFIX}current")]
    | Annotated[StackAmplifierTable, Tag(f"{BRANCH_PREFIX}stack")],
    discriminate_by("mode", "current", "voltage", "stack", default="current", voltage="current"),
]


Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
AXES: tuple[Axis, ...] = get_args(Axis)
"""Coordinates of a body: displacements along x, y, z, and rotations about these axes."""
_ALONG_X: list[Axis] = ["x"]


class BodyTable(Table):
    """``[[body]]``: moving mass, guide and end stops."""

    mass_kg: Positive
    free: Annotated[list[Axis], Field(min_length=1)] = _ALONG_X
    centre_m: PositionVector = ORIGIN  # position of the centre of mass on the body
    # moments of inertia about the centre of mass, for the axes x, y and z
    inertia_kg_m2: Annotated[list[Positive], Field(min_length=3, max_length=3)] | None = None
    tilt_rad: Positive = 1e-3  # angle of the end stops in both directions
    stop_low_m: Positive
    stop_high_m: Positive
    damping_N_s_per_m: NotNegative = 0.0
    gravity_m_per_s2: Number = 0.0
    # spring and damper from a point of the body to the ground, without force at the pose 0
    cable_N_per_m: NotNegative = 0.0
    cable_N_s_per_m: NotNegative = 0.0
    cable_m: PositionVector = ORIGIN

    @model_validator(mode="after")
    def _check_limit_order(self) -> Self:
        check_order("stop_low_m", self.stop_low_m, "stop_high_m", self.stop_high_m)
        if self.free != [axis for axis in AXES if axis in self.free]:
            raise InputError(f"free must list some of {list(AXES)} in this order", code="wrong-order")
        if {*AXES[3:]} & {*self.free} and self.inertia_kg_m2 is None:
            raise InputError("a body that rotates needs inertia_kg_m2; add it", code="missing")
        return self

    @property
    def weight_N(self) -> float:  # noqa: N802 - carries its unit
        """Weight, which acts along -z or opens the gap, N."""
        return self.mass_kg * self.gravity_m_per_s2


class FlexureTable(Table):
    """``[[body]]``: a body on flexures, described by its resonance."""

    # limited above by the integration steps of the plant
    resonance_Hz: Annotated[float, Field(gt=0.0, le=1e5)]
    damping_ratio: Annotated[float, Field(gt=0.0, le=3.0)]


BodyEntry = Annotated[
    Annotated[BodyTable, Tag(f"{BRANCH_PREFIX}body")]
    | Annotated[FlexureTable, Tag(f"{BRANCH_PREFIX}flexure")],
    Discriminator(
        lambda value: (
            f"{BRANCH_PREFIX}flexure"
            if isinstance(value, FlexureTable) or (isinstance(value, dict) and "resonance_Hz" in value)
            else f"{BRANCH_PREFIX}body"
        )
    ),
]


MAX_CREEP_TERMS = 8
"""Largest number of creep terms that the plant of a stack can have."""


class StackTable(Table):
    """``[[stack]]``: a free piezo stack."""

    stroke_m_per_V: Positive
    bend_m_per_V2: Number
    slope_m_per_V: Positive
    beta_per_V: Positive
    gamma_per_V: NotNegative
    creep_times_s: list[Annotated[float, Field(ge=1e-4)]]  # limited by the integration steps
    creep_shares: list[NotNegative]

    @model_validator(mode="after")
    def _check_lengths(self) -> Self:
        if len(self.creep_times_s) != len(self.creep_shares):
            raise InputError(
                "creep_shares must contain one share for each of creep_times_s", code="length-differs"
            )
        if len(self.creep_times_s) > MAX_CREEP_TERMS:
            raise InputError(
                f"creep_times_s has {len(self.creep_times_s)} times, but a stack has at most "
                f"{MAX_CREEP_TERMS}; omit the smallest shares",
                code="too-many-creeps",
            )
        return self


class DisturbanceTable(Table):
    """``[[load.disturbance]]``: a force that is added to the commanded force of the load drive."""

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
    """``[load]``: a load drive whose force opens the gap."""

    force_N: Number
    bandwidth_Hz: Positive
    damping_N_s_per_m: NotNegative = 0.0
    stiffness_N_per_m: Number = 0.0
    encoder_step_m: NotNegative
    velocity_bandwidth_Hz: Positive
    disturbance: list[DisturbanceTable] = Field(default_factory=list)


NO_LOAD = LoadTable(force_N=0.0, bandwidth_Hz=1e5, encoder_step_m=0.0, velocity_bandwidth_Hz=1.0)
"""Load drive without force. Its high bandwidth lets a benchmark apply forces immediately."""


class FrameTable(Table):
    """``[frame]``: path error of the long stroke, on which the magnets ride."""

    stray_m: NotNegative = 0.0


class SpreadTable(Table):
    """``[spread]``: standard deviations of the differences between plants and the rig file."""

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
    centre_m: NotNegative = 0.0  # spread of each coordinate of the centre of mass
    head_m: NotNegative = 0.0  # spread of each coordinate of a head's measured point
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
    """Quantities that differ between plants: names in a drift, and keys in ``[spread]``."""

    rig_wide: Mapping[str, str]
    magnet: Mapping[str, str] = field(default_factory=dict)  # different for each magnet
    head: Mapping[str, str] = field(default_factory=dict)  # different for each position head

    @property
    def keys(self) -> list[str]:
        """Keys of ``[spread]`` that a rig file of this kind may give."""
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
    "force": Spreads({**_IRON_SPREADS, "gap_offset": "gap_zero_m", "first_scale": "current_percent"}),
    "displacement": Spreads(
        {"stroke": "stroke_percent", "creep": "creep_percent", "resonance": "resonance_percent"}
    ),
}
"""Quantities that differ between plants, by ``control.kind``."""


class LevitationTable(Table):
    """``kind = "levitation"``: a levitated armature, whose controller has its own file."""

    kind: Literal["levitation"]
    bias_N: Positive | None = None  # force of each magnet of a pair if the net force is zero
    calibration: str | None = None  # file that anhyst calibrate has written


class TrackingTable(Table):
    """``kind = "tracking"``: a body between magnets that follows a set-point."""

    kind: Literal["tracking"]
    bias_N: Positive | None = None  # force of each magnet of a pair if the net force is zero
    format: NumberFormat = "fixed"
    crossover_Hz: Positive
    # ratios between the crossover and the corner frequencies of the PID
    integral_ratio: Ratio = 5.0  # crossover divided by the corner of the integral
    lead_ratio: Ratio = 3.0  # crossover divided by the start of the lead
    rolloff_ratio: Ratio = 6.0  # end of the lead divided by the crossover
    force_max_N: Positive
    force_min_N: NotNegative = 0.5  # smallest pull of a magnet that has no opposing magnet
    # A magnet counts as lost if its current deviates by lost_A for lost_s; None: not monitored.
    lost_A: Positive | None = None
    lost_s: Positive = 0.25e-3
    # A head counts as lost if its speed deviates from the target's by head_m_per_s for head_s;
    # None: not monitored.
    head_m_per_s: Positive | None = None
    head_s: Positive = 0.25e-3
    land_m_per_s: Positive = 2e-3  # speed of landing
    lift_m_per_s: Positive = 2e-3  # speed of lifting
    calibration: str | None = None  # file that anhyst calibrate has written
    calibrate: bool = False  # whether corrections are estimated from every motion


class ForceTable(Table):
    """``kind = "force"``: open-loop control of the force on a held armature."""

    kind: Literal["force"]
    force_max_N: Positive
    end_m: Positive  # gap at the end of the stroke, at which loops must have been measured


class DisplacementTable(Table):
    """``kind = "displacement"``: a piezo stage with feedforward and an integrator."""

    kind: Literal["displacement"]
    bandwidth_Hz: Positive
    # frequency of the cancelled resonance, by default that of the body, and the damping ratio that
    # replaces the original one
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
