"""Provide variants of the example bearing for tests."""

from __future__ import annotations

from functools import cache
from typing import Any

from anhyst._core import Plant
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.magnet_table import OPENS_GAP, LikeTable
from anhyst_rigs.rig.parts.iron import CellSteel
from anhyst_rigs.rig.parts.magnet import Poles
from anhyst_rigs.rig.plant import make_plant
from tests.repository import ROOT

PATH = ROOT / "examples" / "bearing" / "rig.toml"
GAP = 0.45e-3

OPEN_LOOP: dict[str, Any] = {
    "load.force_N": 0.0,
    "load.encoder_step_m": 0.0,
    "timing.delay_ticks": 0.0,
    "amplifier.dac_bits": 24,
}
"""No delays, no visible quantisation, and no load drive."""

STIFF: dict[str, Any] = OPEN_LOOP | {"amplifier.supply_V": 1e6, "amplifier.bandwidth_Hz": 25e3}
"""An amplifier that keeps the current constant against induced voltages."""


@cache
def _example() -> RigFile:
    return read_bearing(PATH).settings


def rig(changes: dict[str, Any] | None = None, pair: bool = False) -> BodyRig:
    """Return the example's rig with other values, by the names of its attributes.

    A pair has a second magnet on the opposite side, at the same distance from the armature at
    `GAP`.
    """
    file = _example()
    if pair:
        second = LikeTable(name="opposite", like="magnet", direction=OPENS_GAP, gap_m=GAP)
        file = file.with_changes({"magnets": [file.magnet, second], "control.bias_N": 100.0})
    file = file.with_changes(changes or {})
    return BodyRig(PATH, RigFile.model_validate(file.model_dump(by_alias=True)))


def bearing(changes: dict[str, Any] | None = None, seed: int = 0, pair: bool = False) -> Plant:
    return make_plant(rig(changes, pair), seed)


def example_steel() -> CellSteel:
    steel = rig().settings.steel
    assert isinstance(steel, CellSteel)
    return steel


def example_poles() -> Poles:
    return rig().settings.magnet.poles
