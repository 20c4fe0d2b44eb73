"""The steps to a better model, each from files to files: long work, done beside what runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.compensate.budget import measure_budget
from anhyst.data import Loops
from anhyst.data.loops import Loop
from anhyst.data.path import thinned
from anhyst.data.reading import read_loops
from anhyst.model.actuator import Model, read_model
from anhyst.model.writer import write_model
from anhyst.rig.recording import peak, rms
from anhyst.study.excite.design import Bound, Specimen
from anhyst.study.excite.excite import Excitation, measure, write_excitation
from anhyst.study.excite.on_board import DrivenBoard, measure_on_board
from anhyst.study.prepared import Improvable, PreparedBoard, block_of
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray

_POINTS = 100
"""Of a loop, where it is drawn; a record may hold several."""


@dataclass(frozen=True, eq=False)
class Compared:
    """An old model and a new one."""

    loops: Loops  # both are held against them
    old: tuple[FloatArray, ...]  # what each predicts, loop by loop
    new: tuple[FloatArray, ...]

    def misfit(
        self, predicted: tuple[FloatArray, ...], gap: float | None = None
    ) -> dict[str, float]:
        """Return what is left over all loops or over those of one gap, noise of sensors included."""
        off = np.concatenate(
            [
                force - loop.output
                for force, loop in zip(predicted, self.loops.loops, strict=True)
                if gap is None or loop.schedule_value == gap
            ]
        )
        return {"rms_N": rms(off), "worst_N": peak(off)}

    def as_dict(self) -> dict[str, Any]:
        """Return figures, and loops to be drawn."""
        rows = [
            {"gap_m": gap, "old": self.misfit(self.old, gap),
             "new": self.misfit(self.new, gap)}
            for gap in self.loops.schedule_values
        ]  # fmt: skip
        return {
            "old": self.misfit(self.old),
            "new": self.misfit(self.new),
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


def _drawn(loop: Loop, old: FloatArray, new: FloatArray) -> dict[str, Any]:
    kept = thinned(loop.input, _POINTS * max(1, loop.reversals // 2))
    columns = {"current": loop.input, "force": loop.output, "old": old, "new": new}
    rounded = {
        name: [float(f"{value:.5g}") for value in values[kept]] for name, values in columns.items()
    }
    return {"label": loop.label, **rounded}


LOOPS, MODEL = "loops.csv", "model.toml"
"""Files that the steps leave in their folder; the sidecar of the loops lies beside them."""
_DRAWN = 1500
"""Points of a drive that is drawn."""


def limits_of(prepared: Improvable) -> dict[str, Any]:
    """Return what a drive will keep to, as the rig file says."""
    specimen = prepared.specimen()
    winding = specimen.winding
    return {
        **{name: asdict(bound) for name, bound in _bounds(specimen).items()},
        "gaps_m": list(specimen.gaps),
        "operating_N": asdict(specimen.operating),
        "winding": None
        if winding is None
        else {"continuous_A": winding.continuous, "thermal_s": winding.time},
    }


def measure_loops(
    progress: Progress, prepared: Improvable, folder: Path, tighter: Mapping[str, float]
) -> dict[str, Any]:
    """Design a drive, run it on the rig with its armature held, and write the loops."""
    excitation = measure(within(prepared.specimen(), tighter), progress)
    return _written(excitation, prepared, folder)


def measure_running(
    progress: Progress,
    bench: DrivenBoard,
    prepared: PreparedBoard,
    folder: Path,
    tighter: Mapping[str, float],
) -> dict[str, Any]:
    """Design a drive, run it through a controller that runs, and write the loops."""
    excitation = measure_on_board(within(prepared.specimen(), tighter), bench, progress)
    return _written(excitation, prepared, folder)


def _written(excitation: Excitation, prepared: Improvable, folder: Path) -> dict[str, Any]:
    write_excitation(excitation, prepared.rig, folder / LOOPS)
    played = excitation.played
    every = max(1, played.time.size // _DRAWN)
    columns = {"time": played.time, "current": played.current, "warmth": played.warmth}
    return {
        **excitation.as_dict(),
        "played": {name: values[::every].tolist() for name, values in columns.items()},
    }


def within(specimen: Specimen, tighter: Mapping[str, float]) -> Specimen:
    """Return a specimen with tighter limits."""
    bounds = _bounds(specimen)
    for name, value in tighter.items():
        if name not in bounds:
            raise InputError(
                f"limits: there is no '{name[:40]}'; choose of {', '.join(bounds)}",
                code="unknown-limit",
                key="limits",
            )
        bound = bounds[name]
        if not 0.0 < value <= bound.value:
            raise InputError(
                f"{name}: is not above 0 and up to {bound.value:.4g}, {bound.key}",
                code="out-of-range",
                key=name,
            )
        if value < bound.value:
            bounds[name] = Bound(value, f"{name} of the operator")
    return replace(
        specimen, current=bounds["current_A"], rate=bounds["rate_A_per_s"], force=bounds["force_N"]
    )


def _bounds(specimen: Specimen) -> dict[str, Bound]:
    """Return the limits that an operator may draw tighter."""
    return {"current_A": specimen.current, "rate_A_per_s": specimen.rate, "force_N": specimen.force}


def identify_model(
    progress: Progress, prepared: Improvable, folder: Path, old: Model
) -> dict[str, Any]:
    """Identify a model of the measured loops, as the rig file wants it; write and compare it."""
    loops = read_loops(folder / LOOPS)
    new = prepared.identify(loops, progress)
    write_model(new, folder / MODEL)
    return {"law": new.law, **compare(old, new, loops).as_dict()}


def compile_block(progress: Progress, prepared: Improvable, folder: Path) -> dict[str, Any]:
    """Compile the model for the running board, and hold the block against it."""
    model = read_model(folder / MODEL)
    plan = prepared.compile(model)
    progress(1.0, 2.0)
    budget = measure_budget(plan)
    progress(2.0, 2.0)
    return {
        "words": block_of(plan).words.tolist(),
        "worst_N": budget.compiled.worst,
        "rms_N": budget.compiled.rms,
        "drift_N": budget.drift.worst,
        "largest_N": plan.largest,
    }
