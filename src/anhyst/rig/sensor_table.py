"""``[[sensor]]`` of a rig file: what is read of the plant, by whom and how well.

Every reading passes bandwidth, delay, noise and converter, in this order.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from anhyst.rig.magnet_table import Direction, Place
from anhyst.support.errors import InputError
from anhyst.support.toml_file import (
    BRANCH,
    Bits,
    NotNegative,
    Number,
    Positive,
    Table,
    ordered,
    tag_by,
)

GainError = Annotated[float, Field(gt=-0.5, lt=0.5)]


@dataclass(frozen=True, slots=True)
class PositionSensor:
    """A sensor of the gap with nothing left open."""

    low: float  # range, m
    high: float
    step: float  # resolution, m
    noise: float  # standard deviation before that, m
    bandwidth: float  # of -3 dB, Hz
    delay: float  # s


LVDT_BITS = 16
"""Converter behind an LVDT, which unlike the others has no step of its own."""
POSITION_SENSORS = {
    "encoder": PositionSensor(0.0, 0.0, 50e-9, 5e-9, 20e3, 0.0),
    "capacitive": PositionSensor(0.0, 0.0, 1e-9, 5e-9, 5e3, 0.0),
    "laser": PositionSensor(0.0, 0.0, 1.25e-9, 1e-9, 50e3, 12.5e-6),
    "lvdt": PositionSensor(0.0, 0.0, 0.0, 50e-9, 500.0, 0.0),
}
"""What each kind of sensor has where the file says nothing; the range never comes from here."""


class GapSensorTable(Table):
    """``of = "gap"``: what is left out, the kind of sensor says."""

    of: Literal["gap"]
    kind: Literal["encoder", "capacitive", "laser", "lvdt"]
    low_m: NotNegative
    high_m: Positive
    step_m: Positive | None = None
    adc_bits: Bits | None = None
    noise_m: NotNegative | None = None
    bandwidth_Hz: Positive | None = None
    delay_s: NotNegative | None = None
    gain_error: GainError = 0.0
    offset_m: Number = 0.0

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        ordered("low_m", self.low_m, "high_m", self.high_m)
        if self.step_m is not None and self.adc_bits is not None:
            raise InputError(
                "step_m and adc_bits both say the resolution; keep one", code="both-given"
            )
        return self

    def sensor(self) -> PositionSensor:
        """Return it with the values that its kind has where none are given."""
        usual = POSITION_SENSORS[self.kind]
        step = self.step_m or (0.0 if self.adc_bits else usual.step)
        return PositionSensor(
            low=self.low_m,
            high=self.high_m,
            step=step or (self.high_m - self.low_m) / ((1 << (self.adc_bits or LVDT_BITS)) - 1),
            noise=usual.noise if self.noise_m is None else self.noise_m,
            bandwidth=self.bandwidth_Hz or usual.bandwidth,
            delay=usual.delay if self.delay_s is None else self.delay_s,
        )


class CurrentSensorTable(Table):
    """``of = "current"``: the shunts, one for each coil, as the controller reads them."""

    of: Literal["current"]
    low_A: Number
    high_A: Number
    adc_bits: Bits
    noise_A: NotNegative
    bandwidth_Hz: Positive = math.inf
    gain_error: GainError = 0.0
    offset_A: Number = 0.0  # reads this at no current, and so does the amplifier that follows it

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        ordered("low_A", self.low_A, "high_A", self.high_A)
        return self


class ForceSensorTable(Table):
    """``of = "force"``: measures the loops; a position controller does not see it."""

    of: Literal["force"]
    low_N: Number
    high_N: Number
    adc_bits: Bits
    noise_N: NotNegative
    bandwidth_Hz: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        ordered("low_N", self.low_N, "high_N", self.high_N)
        return self


class FluxSensorTable(Table):
    """``of = "flux"``: Hall probes, which measure the flux density in the gap."""

    of: Literal["flux"]
    range_T: Positive
    adc_bits: Bits
    noise_T: NotNegative
    bandwidth_Hz: Positive
    gain_error: GainError = 0.0


class PositionSensorTable(Table):
    """``of = "position"``: place of the body in space, as an interferometer or a stage's gauge."""

    of: Literal["position"]
    noise_m: NotNegative
    step_m: NotNegative = 0.0
    # where it looks at a body of several coordinates, and the way in which its reading rises
    position_m: Place | None = None
    direction: Direction | None = None
    stands: bool = False  # on the ground: as the body goes on, its beam meets another place of it
    dead_path_m: NotNegative = 0.0  # of that beam, with the body where its motion begins
    refraction_ppm: Number = 0.0  # by which air has changed since the head was zeroed

    @property
    def air(self) -> float:
        """By what part of the length of its beam it reads too much."""
        return 1e-6 * self.refraction_ppm

    @model_validator(mode="after")
    def _of_a_beam(self) -> Self:
        if not self.stands and (self.dead_path_m or self.refraction_ppm):
            raise InputError(
                "dead_path_m and refraction_ppm are of a beam from the ground; add stands = true, "
                "or remove them",
                code="missing",
            )
        return self


SensorEntry = Annotated[
    Annotated[GapSensorTable, Tag(f"{BRANCH}gap")]
    | Annotated[CurrentSensorTable, Tag(f"{BRANCH}current")]
    | Annotated[ForceSensorTable, Tag(f"{BRANCH}force")]
    | Annotated[FluxSensorTable, Tag(f"{BRANCH}flux")]
    | Annotated[PositionSensorTable, Tag(f"{BRANCH}position")],
    Discriminator(
        tag_by("of"),
        custom_error_type="unknown_choice",
        custom_error_message='of must be "gap", "current", "force", "flux" or "position"; '
        "correct it",
    ),
]
