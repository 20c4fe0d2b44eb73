"""How loops are measured, read and identified: ``[loops]``, ``[measurement]`` and ``[excite]``."""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, model_validator

from anhyst.identification.options import IdentifyTable
from anhyst.support.errors import InputError
from anhyst.support.toml_file import Name, NotNegative, Positive, Table

Turn = Annotated[float, Field(ge=-1.0, le=1.0)]
"""Of the largest current; below zero for what goes both ways."""


def _listed(value: Any) -> Any:
    if isinstance(value, str):
        return [value]
    if isinstance(value, list) and value and all(isinstance(one, str) for one in value):
        return value
    raise InputError("must be a file, a folder, or a list of them", code="wrong-kind")


class LoopsTable(IdentifyTable):
    """``[loops]``: files as the command line takes them, and how they are read and identified."""

    files: Annotated[list[str], BeforeValidator(_listed), Field(min_length=1)]


class RecordTable(Table):
    """One of ``measurement.records``: straight from turning point to turning point."""

    name: Name
    turns: Annotated[list[Turn], Field(min_length=2)]


class MeasurementTable(Table):
    """``[measurement]``: how the loops are measured, with armature held."""

    gaps_m: Annotated[list[Positive], Field(min_length=1)]
    current_max_A: Positive
    sweep_A_per_s: Positive
    sample_s: Positive
    conditioning_cycles: Annotated[int, Field(ge=1, le=20)]
    pause_s: NotNegative = 0.0
    records: Annotated[list[RecordTable], Field(min_length=1)]


SHORTEST_S, LONGEST_S = 1e-5, 600.0
"""Of a full cycle at a further speed."""


class CampaignTable(MeasurementTable):
    """``[measurement]`` of a rig file: the same, and at which speeds full cycles run besides."""

    fast_A_per_s: list[Positive] = Field(default_factory=list)

    @model_validator(mode="after")
    def _cycles(self) -> Self:
        for speed in self.fast_A_per_s:
            seconds = 2.0 * self.current_max_A / speed
            if not SHORTEST_S <= seconds <= LONGEST_S:
                raise InputError(
                    f"fast_A_per_s: a full cycle at {speed:g} A/s takes {seconds:.3g} s; "
                    f"{SHORTEST_S:g} to {LONGEST_S:g} s are measured",
                    code="speed-out-of-range",
                )
        if len({f"{speed:.4g}" for speed in self.fast_A_per_s}) < len(self.fast_A_per_s):
            raise InputError(
                "fast_A_per_s: a speed stands there twice; name each once", code="name-twice"
            )
        return self


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
