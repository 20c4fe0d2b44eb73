"""Bearings for the tests: the example's with some keys changed."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from anhyst._core import Bearing
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.plant import make_bearing
from anhyst.rig.file import RigFile
from anhyst.rig.parts.iron import CellSteel
from anhyst.rig.parts.magnet import Poles

PATH = Path(__file__).resolve().parents[2] / "examples" / "bearing" / "rig.toml"
GAP = 0.45e-3

OPEN_LOOP: dict[str, Any] = {
    "load.force_N": 0.0,
    "load.encoder_step_m": 0.0,
    "timing.delay_ticks": 0.0,
    "amplifier.dac_bits": 24,
}
"""Nothing late, nothing on a grid that would be seen, no load drive."""

STIFF: dict[str, Any] = OPEN_LOOP | {
    "amplifier.supply_V": 1e6,
    "amplifier.bandwidth_Hz": 25e3,
}
"""Holds a current whatever is induced."""


@cache
def _example() -> dict[str, Any]:
    return tomllib.loads(PATH.read_text(encoding="utf-8"))


def rig(changes: dict[str, Any] | None = None) -> BearingRig:
    """Return the example's rig; keys of tables are written with dots."""
    keys = RigFile.model_validate(_example()).model_dump()
    for path, value in (changes or {}).items():
        *tables, key = path.split(".")
        table = keys
        for name in tables:
            table = table[name]
        assert key in table, path
        table[key] = value
    return BearingRig(PATH, RigFile.model_validate(keys))


def bearing(changes: dict[str, Any] | None = None, seed: int = 0) -> Bearing:
    return make_bearing(rig(changes), seed)


def example_steel() -> CellSteel:
    steel = rig().settings.steel.steel()
    assert isinstance(steel, CellSteel)
    return steel


def example_poles() -> Poles:
    return rig().settings.magnet.poles
