"""The model beside a bench that runs: held against its rows, and the steps to a better one.

Each step goes from files to files: long work, done beside what runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from anhyst.compensate.budget import measure_budget
from anhyst.data import Loops
from anhyst.data.loops import Loop
from anhyst.data.path import thinned
from anhyst.data.reading import read_loops
from anhyst.model.actuator import Model, read_model
from anhyst.model.writer import write_model
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.bench.protocol import Signal
from anhyst_rigs.rig.recording import peak
from anhyst_rigs.study.excite.design import Bound, Specimen
from anhyst_rigs.study.excite.excite import measure, write_excitation
from anhyst_rigs.study.excite.on_board import DrivenBoard, measure_on_board
from anhyst_rigs.study.prepared import Improvable, block_of
from anhyst_rigs.study.watch import LEARN, RUN_LENGTH, DriftWatch

SAMPLES_HZ = 250.0
"""Rows a second that are looked at."""

_READ = (("current_read",), ("gap_read",), ("force_read", "force"))
"""What is held against the model; a levitated armature has no force sensor, and the virtual one's
true force is taken."""


class BenchWatch:
    """Watches one model over the rows of a bench, from its first row on."""

    def __init__(self, model: Model, signals: Sequence[Signal], rate: float) -> None:
        names = [signal.name for signal in signals]
        self._columns = [_column_of(names, choice) for choice in _READ]
        self._model, self._rate = model.at_rest, rate  # rows are too few to follow what is late
        self._every = max(1, round(rate / SAMPLES_HZ))
        self._watch: DriftWatch | None = None
        self._trouble = ""

    def take(self, rows: FloatArray) -> None:
        """Go on by rows of the bench; does not depend on how they are cut."""
        seen = rows[rows[:, 0] % self._every == 0]
        if not len(seen) or self._trouble:
            return
        current, gap, force = (seen[:, column] for column in self._columns)
        try:
            if self._watch is None:
                self._watch = DriftWatch(self._model, float(gap[0]))
            self._watch.take(seen[:, 0], current, gap, force)
        except InputError as error:
            self._trouble = str(error)

    def status(self) -> Mapping[str, Any]:
        """Return what a page shows."""
        if self._trouble:
            return {"state": "ended", "text": self._trouble}
        if self._watch is None:
            return {"state": "learning", "text": "no rows yet"}
        finding = self._watch.finding
        drifted = finding.drifted is not None
        state = "drifted" if drifted else "learning" if finding.learning else "fits"
        return {
            "state": state,
            "text": finding.text(self._rate),
            "cycles": finding.cycles,
            "learn": LEARN + 1,
            "run_length": RUN_LENGTH,
            "least_N": self._watch.least,
            "usual_N": finding.usual,
            "left_N": finding.left,
            "gain_N": finding.gain if drifted else 0.0,
        }


def _column_of(names: Sequence[str], choice: Sequence[str]) -> int:
    for name in choice:
        if name in names:
            return 1 + names.index(name)
    raise InputError(
        f"watch: the bench has no signal {' or '.join(choice)}", code="no-such-signal", key="watch"
    )


_POINTS, _COMPARED = 200, 100
"""Of a loop, as it is drawn, alone and with two models; a record may hold several."""
_LOOPS = 60


class DrawnLoop(NamedTuple):
    """A loop as it is drawn."""

    kind: str  # ``measured`` or ``model``
    gap: float | None  # at which it was measured, m
    current: list[float]  # A and N
    force: list[float]


def make_curves(loops: Loops, model: Model | None = None) -> tuple[DrawnLoop, ...]:
    """Return loops of force over current, thinned; and those of a model along the same currents."""
    if (loops.input.name, loops.output.name) != ("current", "force"):
        return ()
    curves = []
    for loop in loops.loops[:_LOOPS]:
        curves.append(_curve("measured", loop, loop.output))
        if model is not None:
            curves.append(_curve("model", loop, model.on(loop)))
    return tuple(curves)


def _curve(kind: str, loop: Loop, force: FloatArray) -> DrawnLoop:
    kept = thinned(loop.input, _POINTS * max(1, loop.reversals // 2))
    return DrawnLoop(kind, loop.schedule_value, loop.input[kept].tolist(), force[kept].tolist())


class KnownModel(NamedTuple):
    """A model beside a bench, and the loops that it stands for."""

    model: Model
    curves: tuple[DrawnLoop, ...]


def known_model(loops: Loops, model: Model) -> KnownModel:
    """Return a model with its loops."""
    return KnownModel(model, make_curves(loops, model))


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
    return Compared(loops, tuple(map(old.on, loops.loops)), tuple(map(new.on, loops.loops)))


def _drawn(loop: Loop, old: FloatArray, new: FloatArray) -> dict[str, Any]:
    kept = thinned(loop.input, _COMPARED * max(1, loop.reversals // 2))
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
    progress: Progress,
    prepared: Improvable,
    folder: Path,
    tighter: Mapping[str, float],
    bench: DrivenBoard | None = None,
) -> dict[str, Any]:
    """Design a drive, run it with the armature held, and write the loops.

    It runs on the virtual rig, or through a controller that runs.
    """
    specimen = within(prepared.specimen(), tighter)
    if bench is None:
        excitation = measure(specimen, progress)
    else:
        excitation = measure_on_board(specimen, bench, progress)
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


def read_known(folder: Path) -> KnownModel:
    """Read what was identified, and the loops it was identified from."""
    return known_model(read_loops(folder / LOOPS), read_model(folder / MODEL))


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
