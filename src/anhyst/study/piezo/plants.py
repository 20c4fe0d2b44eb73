"""Piezo stages that have drifted behind the compensation of the nominal one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from anhyst.compensate.interface import MethodName
from anhyst.rig.bearing.drift import Drift, drifted_file
from anhyst.rig.piezo.file import PiezoRig, stage_of
from anhyst.rig.recording import peak, rms
from anhyst.study.engine.monte_carlo import PlantFigure, Plants
from anhyst.study.piezo.track import PiezoInverse, find_inverses, follow, judged_from, reference

METHODS: Mapping[MethodName, str] = {
    "ratio": "none",
    "single-valued": "single-valued",
    "full": "full",
}
"""Of the engine, and what a piezo stage calls them."""


def piezo_plants(rig: PiezoRig) -> Plants:
    """Return what plants of a piezo stage are run with; its loops are those of the nominal one."""
    inverses = find_inverses(rig)
    return Plants(
        file=rig.settings,
        work=PiezoWork(rig, {name: inverses[way] for name, way in METHODS.items()}),
        methods=tuple(METHODS),
        own="full",
        figures=(
            PlantFigure("rms_m", "deviation, rms", "nm", 1e9),
            PlantFigure("worst_m", "deviation, worst", "nm", 1e9),
        ),
        read=(),
        depends={},
        seed=rig.settings.seed,
    )


@dataclass(frozen=True)
class PiezoWork:
    """A nominal stage and what was made for it."""

    rig: PiezoRig
    inverses: Mapping[MethodName, PiezoInverse]

    def run(self, method: MethodName, drift: Drift, noise: int) -> dict[str, Any]:
        """Follow the triangle; the controller knows the nominal stage alone."""
        stage = stage_of(drifted_file(self.rig.settings, drift))
        run = follow(self.rig, reference(self.rig), self.inverses[method], stage, noise)
        if run.loss is not None:
            return {"lost_s": run.dt * run.loss.tick}
        error = run["error_m"][judged_from(self.rig) :]
        return {"rms_m": rms(error), "worst_m": peak(error)}
