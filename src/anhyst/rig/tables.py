"""The tables that every rig file holds, of a bearing and of force control alike.

Everything is SI and the unit stands in the key.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from anhyst.identification.options import IdentifyTable
from anhyst.support.errors import InputError
from anhyst.support.toml_file import Bits, NotNegative, Number, Positive, Share, Table

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]


def ordered(low_key: str, low: float, high_key: str, high: float) -> None:
    """Refuse a range that does not rise, with ValueError."""
    if not low < high:
        raise InputError(f"{low_key} must be below {high_key}; correct them", code="range-reversed")


class ExciteTable(Table):
    """``[excite]``: what a drive that measures loops must keep to, and where it measures."""

    gaps_m: Annotated[list[Positive], Field(min_length=1)] | None = None
    operating_N: Positive | None = None
    current_max_A: Positive | None = None
    rate_max_A_per_s: Positive | None = None
    force_max_N: Positive | None = None
    continuous_A: Positive | None = None
    thermal_s: Positive | None = None

    @model_validator(mode="after")
    def _both(self) -> Self:
        if (self.continuous_A is None) != (self.thermal_s is None):
            raise InputError(
                "continuous_A and thermal_s belong together; give both or none",
                code="belong-together",
            )
        return self


class RigTable(Table):
    """The head of a rig file, how its loops are identified, and what measuring them must keep to."""

    version: Literal[1]
    name: str
    identify: IdentifyTable = Field(default_factory=IdentifyTable)
    excite: ExciteTable = Field(default_factory=ExciteTable)


class ShuntTable(Table):
    """``[current_sensor]``: a shunt, as the controller reads it."""

    low_A: Number
    high_A: Number
    adc_bits: Bits
    noise_A: NotNegative

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        ordered("low_A", self.low_A, "high_A", self.high_A)
        return self


class ForceSensorTable(Table):
    """``[force_sensor]``: measures the loops; the position controller does not see it."""

    low_N: Number
    high_N: Number
    adc_bits: Bits
    noise_N: NotNegative
    bandwidth_Hz: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        ordered("low_N", self.low_N, "high_N", self.high_N)
        return self


class RecordTable(Table):
    """One of ``measurement.records``: straight from turning point to turning point."""

    name: Name
    turns: Annotated[list[Share], Field(min_length=2)]


class MeasurementTable(Table):
    """``[measurement]``: how the loops are measured, with armature held."""

    gaps_m: Annotated[list[Positive], Field(min_length=1)]
    current_max_A: Positive
    sweep_A_per_s: Positive
    sample_s: Positive
    conditioning_cycles: Annotated[int, Field(ge=1, le=20)]
    pause_s: NotNegative = 0.0
    records: Annotated[list[RecordTable], Field(min_length=1)]
