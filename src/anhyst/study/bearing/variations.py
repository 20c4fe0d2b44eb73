"""The same rig with something about it changed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pydantic import BaseModel

from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.iron_table import MagnetSteelTable
from anhyst.support.errors import InputError


def changed(rig: BearingRig, changes: dict[str, Any]) -> BearingRig:
    """Return a rig with other settings.

    Parameters
    ----------
    rig : BearingRig
    changes : dict
        Value by key path, as ``{"magnet.iron.reversible_fraction": 0.3}``.

    Raises
    ------
    KeyError
        There is no such key.
    """
    settings = rig.settings
    for path, value in changes.items():
        settings = _set(settings, path.split("."), value)
    return replace(rig, settings=settings)


def with_iron(rig: BearingRig, reversible_fraction: float, width: float = 1.0) -> BearingRig:
    """Return a rig with another iron of cells.

    Parameters
    ----------
    rig : BearingRig
    reversible_fraction : float
        Weight of the iron that nothing pins.
    width : float, optional
        Factor on the pinning thresholds, and so on the width of the loops.

    Raises
    ------
    InputError
        The force is made by an identified law, or by an iron of another family.
    """
    magnet = rig.settings.magnet
    if magnet.force != "cells":
        raise InputError(
            f'{rig.path}: magnet.force: other irons are tried with force "cells"; set it so'
        )
    if not isinstance(magnet.steel, MagnetSteelTable):
        raise InputError(
            f"{rig.path}: magnet.iron.family: other irons are tried of cells alone; "
            "describe one of cells"
        )
    return changed(
        rig,
        {
            "magnet.iron.reversible_fraction": reversible_fraction,
            "magnet.iron.pinning_scale_A_per_m": width * magnet.steel.pinning_scale_A_per_m,
        },
    )


def _set(table: Any, path: list[str], value: Any) -> Any:
    first, *rest = path
    if not isinstance(table, BaseModel) or first not in type(table).model_fields:
        raise KeyError(first)
    return table.model_copy(
        update={first: _set(getattr(table, first), rest, value) if rest else value}
    )
