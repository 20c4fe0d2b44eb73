"""Two models against the same measured loops, in newtons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from anhyst.data import Loops
from anhyst.data.loops import Loop
from anhyst.data.path import thinned
from anhyst.model.actuator import Model
from anhyst.support.arrays import FloatArray

_POINTS = 100
"""Of a loop, where it is drawn; a record may hold several."""


@dataclass(frozen=True, slots=True)
class Misfit:
    """What a model leaves of measured loops, noise of the sensors included."""

    rms: float  # in units of the output
    worst: float


@dataclass(frozen=True, eq=False)
class Compared:
    """An old model and a new one."""

    loops: Loops  # both are held against them
    old: tuple[FloatArray, ...]  # what each predicts, loop by loop
    new: tuple[FloatArray, ...]

    def misfit(self, predicted: tuple[FloatArray, ...], gap: float | None = None) -> Misfit:
        """Return what is left over all loops, or over those of one gap."""
        off = np.concatenate(
            [
                found - loop.output
                for found, loop in zip(predicted, self.loops.loops, strict=True)
                if gap is None or loop.schedule_value == gap
            ]
        )
        return Misfit(float(np.sqrt(np.mean(np.square(off)))), float(np.abs(off).max()))

    def as_dict(self) -> dict[str, Any]:
        """Return figures, and loops to be drawn."""
        rows = [
            {"gap_m": gap, "old": _plain(self.misfit(self.old, gap)),
             "new": _plain(self.misfit(self.new, gap))}
            for gap in self.loops.schedule_values
        ]  # fmt: skip
        return {
            "old": _plain(self.misfit(self.old)),
            "new": _plain(self.misfit(self.new)),
            "gaps": rows,
            "loops": [
                _drawn(loop, old, new)
                for loop, old, new in zip(self.loops.loops, self.old, self.new, strict=True)
            ],
        }


def compare(old: Model, new: Model, loops: Loops) -> Compared:
    """Hold two models against the same loops."""
    return Compared(loops, _predicted(old, loops), _predicted(new, loops))


def _predicted(model: Model, loops: Loops) -> tuple[FloatArray, ...]:
    return tuple(
        model.predict(loop.input, loop.schedule, loop.time, loop.history).output
        for loop in loops.loops
    )


def _plain(misfit: Misfit) -> dict[str, float]:
    return {"rms_N": misfit.rms, "worst_N": misfit.worst}


def _drawn(loop: Loop, old: FloatArray, new: FloatArray) -> dict[str, Any]:
    kept = thinned(loop.input, _POINTS * max(1, loop.reversals // 2))
    columns = {"current": loop.input, "force": loop.output, "old": old, "new": new}
    rounded = {
        name: [float(f"{value:.5g}") for value in values[kept]] for name, values in columns.items()
    }
    return {"label": loop.label, **rounded}
