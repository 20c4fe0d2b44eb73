"""The bundled piezo stage and its inverses for tests."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from anhyst.compensate.force_controller import ForceController
from anhyst_rigs.rig.bench.piezo import PiezoBench
from anhyst_rigs.rig.piezo import PiezoRig, read_piezo_rig
from anhyst_rigs.study.piezo import find_inverses
from anhyst_rigs.study.prepared_benches import PreparedPiezo
from tests.repository import ROOT

EXAMPLE = ROOT / "examples" / "piezo"


@cache
def rig() -> PiezoRig:
    """Return the bundled rig."""
    return read_piezo_rig(EXAMPLE / "rig.toml")


@cache
def inverses() -> Mapping[str, ForceController]:
    """Return all inverses from displacement to voltage, in their initial state."""
    return find_inverses(rig())


def prepared() -> PreparedPiezo:
    """Return the prepared data for opening a bench."""
    return PreparedPiezo(rig(), (inverses()["single-valued"], inverses()["full"]))


def bench() -> PiezoBench:
    """Return the bench of the stage before its first tick."""
    return prepared().open()
