"""The drift watch of a bench that runs: its rows against what the model in force predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from anhyst.model.actuator import Model
from anhyst.rig.bench.protocol import Signal
from anhyst.study.watch.drift import LEARN, RUN_LENGTH, DriftWatch
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

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
        self._model, self._rate = model, rate
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
        found = self._watch.finding
        drifted = found.drifted is not None
        state = "drifted" if drifted else "learning" if found.learning else "fits"
        return {
            "state": state,
            "text": found.text(self._rate),
            "cycles": found.cycles,
            "learn": LEARN + 1,
            "run_length": RUN_LENGTH,
            "least_N": self._watch.least,
            "usual_N": found.usual,
            "left_N": found.left,
            "gain_N": found.gain if drifted else 0.0,
        }


def _place(names: Sequence[str], choice: Sequence[str]) -> int:
    for name in choice:
        if name in names:
            return 1 + names.index(name)
    raise InputError(
        f"watch: the bench has no signal {' or '.join(choice)}", code="no-such-signal", key="watch"
    )
