"""The line of a plant in a file of Monte Carlo results: written by one run, trusted by no other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import Field, ValidationError

from anhyst.support.toml_file import NotNegative, Number, Table, explain


class VariantRow(Table):
    """What a plant did behind one controller; nothing but ``lost_s`` where it was lost."""

    lost_s: NotNegative | None
    overshoot_percent: list[NotNegative] | None = None
    settling_s: list[NotNegative | None] | None = None
    standstill_rms_m: NotNegative | None = None


class PlantRow(Table):
    """One plant behind every controller."""

    plant: Annotated[int, Field(ge=0)]
    drift: dict[str, Number]
    variants: dict[str, VariantRow]


def fault_of(row: Mapping[str, Any], variants: Sequence[str], heights: int) -> str | None:
    """Say what keeps a line from being the result of a plant."""
    try:
        found = PlantRow.model_validate(row)
    except ValidationError as error:
        first: dict[str, Any] = {**error.errors(include_url=False)[0]}
        what, _, _ = explain(first).text.partition(";")  # nobody mends such a line by hand
        return f"{'.'.join(str(part) for part in first['loc'])}: {what}"
    for name in variants:
        run = found.variants.get(name)
        if run is None:
            return f"variants.{name}: is missing"
        if run.lost_s is not None:
            continue
        for key in ("overshoot_percent", "settling_s"):
            values = getattr(run, key)
            if values is None or len(values) != heights:
                return f"variants.{name}.{key}: must have {heights} values, one a step height"
        if run.standstill_rms_m is None:
            return f"variants.{name}.standstill_rms_m: is missing"
    return None
