"""The same rig with something about it changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pydantic import BaseModel

from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.file import RigFile
from anhyst.rig.iron_table import NamedCells
from anhyst.support.errors import InputError


def changed(rig: BearingRig, changes: Mapping[str, Any]) -> BearingRig:
    """Return a rig with other settings, by the names that they have in :class:`RigFile`.

    ``gap_m`` moves the armature between its magnets: those of a pair stay where they are.
    """
    file = rig.settings
    for path, value in changes.items():
        first, *rest = path.split(".")
        if path == "gap_m":
            opposite, moved = file.opposite, value - file.gap_m
            if opposite is not None:
                other = opposite.model_copy(update={"gap_m": opposite.gap_m - moved})
                file = file.replaced(opposite, other)
            first, rest = "magnet", ["gap_m"]
        name = "given_load" if first == "load" else first
        table = getattr(file, first)
        new = _set(table, rest, value) if rest else value
        if name in RigFile.model_fields:
            file = file.model_copy(update={name: new})
        else:
            file = file.replaced(table, new)
    return replace(rig, settings=file)


def with_iron(
    rig: BearingRig, reversible_fraction: float | None = None, width: float = 1.0
) -> BearingRig:
    """Return a rig with another iron of the same family."""
    if rig.settings.magnet.kind == "law":
        raise InputError(
            f"{rig.path}: magnet.kind: other irons are tried with a magnet that has one; write "
            '"electromagnet"',
            code="not-iron-of-cells",
            key="magnet.kind",
        )
    steel = rig.settings.steel
    keys = steel.drifted(width - 1.0, 0.0, 0.0)
    if reversible_fraction is not None:
        if not isinstance(steel, NamedCells):
            raise InputError(
                f"{rig.path}: iron.family: cells alone have a reversible fraction; describe "
                "an iron of cells, or leave the fraction out",
                code="not-iron-of-cells",
                key="iron.family",
            )
        keys["reversible_fraction"] = reversible_fraction
    return changed(rig, {f"iron.{key}": value for key, value in keys.items()})


def _set(table: Any, path: list[str], value: Any) -> Any:
    first, *rest = path
    if not isinstance(table, BaseModel) or first not in type(table).model_fields:
        raise KeyError(first)
    return table.model_copy(
        update={first: _set(getattr(table, first), rest, value) if rest else value}
    )
