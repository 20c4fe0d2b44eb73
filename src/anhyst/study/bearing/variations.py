"""The same rig with something about it changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.from_loops import AnyRig
from anhyst.rig.iron_table import NamedCells
from anhyst.support.errors import InputError


def changed(rig: AnyRig, changes: Mapping[str, Any]) -> AnyRig:
    """Return a rig with other settings, by the names of :meth:`RigFile.changed`."""
    return replace(rig, settings=rig.settings.changed(changes))


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
