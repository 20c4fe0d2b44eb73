"""The tables that every rig file holds, of a bearing and of force control alike.

Everything is SI and the unit stands in the key.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from anhyst.identify.options import IdentifyTable
from anhyst.support.toml_file import Bits, NotNegative, Number, Positive, Table

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]


def ordered(low_key: str, low: float, high_key: str, high: float) -> None:
    """Refuse a range that does not rise, with ValueError."""
    if not low < high:
        raise ValueError(f"{low_key} must be below {high_key}; correct them")


class RigTable(Table):
    """The head of a rig file, and how its loops are identified."""

    version: Literal[1]
    name: str
    identify: IdentifyTable = Field(default_factory=IdentifyTable)


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
