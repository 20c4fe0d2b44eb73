"""The same rig with something about it changed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pydantic import BaseModel

from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.iron_table import MagnetSteelTable
from anhyst.support.errors import InputError


def changed(rig: BearingRig, changes: dict[str, Any]) -> BearingRig:
    """Return a rig with other settings."""
    settings = rig.settings
    for path, value in changes.items():
        settings = _set(settings, path.split("."), value)
    return replace(rig, settings=settings)


def with_iron(
    rig: BearingRig, reversible_fraction: float | None = None, width: float = 1.0
) -> BearingRig:
    """Return a rig with another iron of the same family."""
    magnet = rig.settings.magnet
    if magnet.force != "cells":
        raise InputError(
            f'{rig.path}: magnet.force: other irons are tried with force "cells"; set it so',
            code="not-iron-of-cells",
            key="magnet.force",
        )
    keys = magnet.steel.drifted(width - 1.0, 0.0, 0.0)
    if reversible_fraction is not None:
        if not isinstance(magnet.steel, MagnetSteelTable):
            raise InputError(
                f"{rig.path}: magnet.iron.family: cells alone have a reversible fraction; describe "
                "an iron of cells, or leave the fraction out",
                code="not-iron-of-cells",
                key="magnet.iron.family",
            )
        keys["reversible_fraction"] = reversible_fraction
    return changed(rig, {f"magnet.iron.{key}": value for key, value in keys.items()})


def _set(table: Any, path: list[str], value: Any) -> Any:
    first, *rest = path
    if not isinstance(table, BaseModel) or first not in type(table).model_fields:
        raise KeyError(first)
    return table.model_copy(
        update={first: _set(getattr(table, first), rest, value) if rest else value}
    )
