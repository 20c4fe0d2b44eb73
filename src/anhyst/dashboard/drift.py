"""The drift watch of a bench that runs: its rows against what the model in force predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from anhyst.data import Loops
from anhyst.data.loops import Loop
from anhyst.data.path import thinned
from anhyst.model.actuator import Model
from anhyst.rig.bench.protocol import Signal
from anhyst.study.watch import LEARN, RUN_LENGTH, DriftWatch
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

SAMPLES_HZ = 250.0
"""Rows a second that are looked at."""

_READ = (("current_read",), ("gap_read",), ("force_read", "force"))
"""What is held against the model; a levitated armature has no force sensor, and the virtual one's
true force is taken."""


class BenchWatch:
    """Watches one model over the rows of a bench, from its first row on."""

    def __init__(self, model: Model, signals: Sequence[Signal], rate: float) -> None:
        names = [signal.name for signal in signals]
        self._columns = [_place(names, choice) for choice in _READ]
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


def _place(names: Sequence[str], choice: Sequence[str]) -> int:
    for name in choice:
        if name in names:
            return 1 + names.index(name)
    raise InputError(
        f"watch: the bench has no signal {' or '.join(choice)}", code="no-such-signal", key="watch"
    )


_POINTS = 200
"""Of a loop, as it is drawn; a record may hold several."""

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
            predicted = model.predict(loop.input, loop.schedule, loop.time, loop.history)
            curves.append(_curve("model", loop, predicted.output))
    return tuple(curves)


def _curve(kind: str, loop: Loop, force: FloatArray) -> DrawnLoop:
    kept = thinned(loop.input, _POINTS * max(1, loop.reversals // 2))
    return DrawnLoop(kind, loop.schedule_value, loop.input[kept].tolist(), force[kept].tolist())
