"""Measure loops through a controller that runs: its demand drives the current, its sensors measure.

With the constant ratio in place of the compensation a demand is a current. Turning points are
demanded one after the other; the controller goes straight between them, at its own slope.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from anhyst.data.loops import Loop, Loops
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Fault, State
from anhyst.support.units import QUANTITIES
from anhyst_rigs.link.client import Refused
from anhyst_rigs.rig.bench.protocol import Aim, Parameter, Signal
from anhyst_rigs.rig.measuring import straight
from anhyst_rigs.study.excite.design import Bound, Record, Specimen, coolest_peak, records, step_of
from anhyst_rigs.study.excite.excite import (
    HEADROOM,
    Excitation,
    Place,
    Played,
    check_operating,
    notes_of,
    place_of,
)

_DWELL_S = 0.02
"""At each turning point, s: the amplifier follows in the first half, the second is one sample."""
_CHUNK_S = 0.01
"""Between two looks at what is read, s."""
_PATIENCE_S = 30.0
"""Until a controller is in another state, s; a current is taken away along its ramp."""
_BEGIN_S = 2.0
"""Until a run that was begun is seen; somebody may have stopped it already, s."""
_NEAR = 0.01
"""Of the largest gap: so far from a gap of the rig file may the armature be held."""
_SAME = 1e-7
"""Of the full demand: nearer two demands are one."""
_NEEDED = ("force", "current", "demand", "gap", "state", "fault")


class DrivenBoard(Protocol):
    """What is needed of a bench, as :class:`anhyst_rigs.rig.bench.protocol.Bench` has it."""

    @property
    def rate(self) -> float:
        """Ticks a second."""

    @property
    def aim(self) -> Aim:
        """What is demanded."""

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Columns of what is measured, after the number of the tick."""

    @property
    def every(self) -> int:
        """Ticks from one row to the next."""

    @property
    def lost(self) -> str:
        """Why the controller is looked for; empty while it answers."""

    def advance(self, ticks: int) -> FloatArray:
        """Wait until some ticks have passed, and return all rows that came."""

    def command(self, command: Command) -> None:
        """Give a command."""

    def demand(self, value: float) -> None:
        """Demand a force, N."""

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the settings, with the values in force."""

    def apply(self, values: Mapping[str, float]) -> int:
        """Write settings."""


def measure_on_board(
    specimen: Specimen, bench: DrivenBoard, progress: Progress | None = None
) -> Excitation:
    """Measure loops at the gap where the armature is held, within the limits.

    At the end the controller is stopped, its settings as before, and idle if it was.
    """
    drive = BoardDrive(specimen, bench)
    # A board reads too slowly for fast cycles.
    held = replace(specimen, gaps=(drive.gap,), current=drive.most, fast=())
    cool = coolest_peak(held)
    loops: list[Loop] = []
    try:
        drive.begin(step_of(held) / held.sample)
        place = _probe(held, drive, cool)
        check_operating(held, [place])
        paths = records(held, place.peak.value, place.operating)
        for count, record in enumerate(paths):
            loops.append(_take(drive, record))
            if progress is not None:
                progress(count + 1, len(paths))
    finally:
        drive.end()
    names = QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"]
    return Excitation(
        Loops(tuple(loops), *names), held, (place,), drive.played(), tuple(notes_of(held, [place]))
    )


class BoardDrive:
    """A current that a controller of force drives by its constant ratio."""

    def __init__(self, specimen: Specimen, bench: DrivenBoard) -> None:
        self._specimen, self._bench = specimen, bench
        names = [signal.name for signal in bench.signals]
        absent = [name for name in _NEEDED if name not in names]
        if bench.aim.unit != "N" or absent:
            why = f"says no {', '.join(absent)}" if absent else "controls no force"
            raise InputError(
                f"measure: the controller {why}; loops need one that controls a force",
                code="controller-without-force",
                key="measure",
            )
        self._at = {name: 1 + names.index(name) for name in _NEEDED}
        self._chunk = max(1, round(_CHUNK_S * bench.rate))
        self._read = [self._at["current"], self._at["force"]]
        self._block = max(1, round(specimen.sample * bench.rate / bench.every))
        self._warmth, self._idle, self._longest = 0.0, False, 0.0
        self._book: list[tuple[float, float, float]] = []
        self._before = {parameter.name: parameter.value for parameter in bench.parameters()}
        self.gap = self._held()
        (ratio,) = (parameter for parameter in bench.parameters() if parameter.name == "ratio")
        limits = [specimen.current, Bound(ratio.high * bench.aim.high, "the controller's ratio")]
        self.most = min(limits, key=lambda parameter: parameter.value)
        self._ratio = self.most.value / bench.aim.high

    def _held(self) -> float:
        """Return the gap of the rig file at which the armature is held."""
        gap_read = float(np.mean(self._look()[:, self._at["gap"]]))
        near = min(self._specimen.gaps, key=lambda gap: abs(gap - gap_read))
        if abs(near - gap_read) > _NEAR * max(self._specimen.gaps):
            gaps = ", ".join(f"{1e3 * gap:g}" for gap in self._specimen.gaps)
            raise InputError(
                f"measure: the armature stands at {1e3 * gap_read:.4g} mm; hold it at a gap of the rig "
                f"file: {gaps} mm",
                code="gap-not-of-rig",
                key="measure",
            )
        return near

    def begin(self, rate: float) -> None:
        """Be ready to drive a current with this rate, A/s; no current flows yet."""
        if self._state() is State.RUN:
            self._bench.command(Command.STOP)
            self._until(State.READY)
        self._idle = self._state() is State.IDLE
        if self._idle:
            # To condition would drive as far as it was compiled for. What it then takes for its
            # memory does not matter: it is idle again afterwards.
            self._bench.command(Command.DEMAGNETISED)
            self._until(State.READY)
        slew = rate / self._ratio
        self._longest = self.most.value / rate + _PATIENCE_S
        self._bench.apply({"compensation": 0.0, "ratio": self._ratio, "demand_slew": slew})
        self._bench.command(Command.RUN)
        self._until(State.RUN, _BEGIN_S)

    def end(self) -> None:
        """Take the current away, and put the settings back; a controller that is gone stays so."""
        with suppress(InputError):
            if self._state() is State.RUN:
                with suppress(Refused):  # whoever stopped it was quicker than its last sample
                    self._bench.command(Command.STOP)
                self._until(State.READY)
            names = ("compensation", "ratio", "demand_slew")
            self._bench.apply({name: self._before[name] for name in names})
            if self._idle and self._state() is State.READY:
                self._bench.command(Command.IDLE)

    def go(self, current: float) -> tuple[FloatArray, FloatArray]:
        """Go straight to a current, A, and stay a moment."""
        force = min(current / self._ratio, self._bench.aim.high)
        self._bench.demand(force)
        parts = [self._running(self._chunk)]
        end = self._time() + self._longest
        while self._off(parts[-1][-1:], force).any():
            if self._time() > end:
                raise InputError(
                    f"measure: the controller does not go to a demand of {force:g} N",
                    code="demand-not-reached",
                    key="measure",
                )
            parts.append(self._running(self._chunk))
        way = np.concatenate(parts)
        way = way[self._off(way, force)]
        blocks = [way[at : at + self._block] for at in range(0, len(way), self._block)]
        stay = self._running(max(4, round(_DWELL_S * self._bench.rate)))
        parts = [*(block for block in blocks if len(block) == self._block), stay[len(stay) // 2 :]]
        samples = np.array([part[:, self._read].mean(axis=0) for part in parts])
        return samples[:, 0], samples[:, 1]

    def _off(self, rows: FloatArray, force: float) -> NDArray[np.bool_]:
        """Say in which rows the demand is still on its way."""
        differs: NDArray[np.bool_] = (
            np.abs(rows[:, self._at["demand"]] - force) > _SAME * self._bench.aim.high
        )
        return differs

    def rest(self, path: FloatArray) -> None:
        """Wait without current until a path, A, leaves the winding cool enough."""
        winding, sample = self._specimen.winding, self._specimen.sample
        if winding is None:
            return
        end = self._time() + winding.rest(self._warmth, winding.start(path, sample))
        while self._time() < end:
            self._running(self._chunk)

    def played(self) -> Played:
        """Return what was driven, as the sensor of the current read it, a mean each 10 ms."""
        time, current, warmth = np.array(self._book).T
        return Played(time - time[0], current, np.full(time.size, self.gap), warmth)

    def _time(self) -> float:
        return float(self._book[-1][0]) if self._book else 0.0

    def _look(self) -> FloatArray:
        """Return the next rows, of at least a moment."""
        rows = self._bench.advance(self._chunk)
        while not len(rows):
            if self._bench.lost:
                raise InputError(f"measure: {self._bench.lost}", code="port-gone", key="measure")
            rows = self._bench.advance(self._chunk)
        time = float(rows[-1, 0]) / self._bench.rate
        current, winding = float(rows[:, self._at["current"]].mean()), self._specimen.winding
        if winding is None:
            self._warmth = np.nan
        elif self._book:
            passed = time - self._time()
            self._warmth = float(winding.along(np.array([current]), passed, self._warmth)[-1])
        self._book.append((time, current, self._warmth))
        return rows

    def _running(self, ticks: int) -> FloatArray:
        """Return rows of so many ticks of a run; take the current away where it goes too far."""
        parts = [self._look()]
        while parts[-1][-1, 0] - parts[0][0, 0] < ticks - self._bench.every:
            parts.append(self._look())
        rows = np.concatenate(parts)
        last = rows[-1]
        state, fault = State(int(last[self._at["state"]])), Fault(int(last[self._at["fault"]]))
        if state is not State.RUN:
            why = "" if fault is Fault.NONE else f" ({fault.name.lower().replace('_', ' ')})"
            raise InputError(
                f"measure: the controller is in the state {state.name.lower()}{why}",
                code="wrong-state",
                key="measure",
            )
        force, limit = rows[:, self._at["force"]], self._specimen.force
        worst = int(np.argmax(force))
        if not force[worst] <= limit.value:  # no number where the sensor has no value
            self._bench.demand(0.0)
            raise InputError(
                f"{limit.key}: {force[worst]:.4g} N are read at "
                f"{rows[worst, self._at['current']]:.4g} A, more than {limit.value:g} N; lower "
                "excite.current_max_A",
                code="force-above-limit",
                key=limit.key,
            )
        return rows

    def _state(self) -> State:
        return State(int(self._look()[-1, self._at["state"]]))

    def _until(self, goal: State, patience: float = _PATIENCE_S) -> None:
        """Wait until a state is reached."""
        end = time.monotonic() + patience
        while (state := self._state()) is not goal:
            if state is State.FAULT or time.monotonic() > end:
                raise InputError(
                    f"measure: the controller is in the state {state.name.lower()}, not "
                    f"{goal.name.lower()}; see why, and clear its fault",
                    code="wrong-state",
                    key="measure",
                )


def _probe(specimen: Specimen, drive: BoardDrive, cool: Bound) -> Place:
    """Raise the current once until something is at its limit, and take it back."""
    path = straight([0.0, cool.value], step_of(specimen))
    drive.rest(np.concatenate([path, path[::-1]]))
    forces: list[float] = []
    for current in path.tolist():
        forces.append(float(drive.go(current)[1][-1]))
        if forces[-1] >= HEADROOM * specimen.force.value:
            break
    drive.go(0.0)
    return place_of(specimen, drive.gap, path[: len(forces)], forces, cool)


def _take(drive: BoardDrive, record: Record) -> Loop:
    """Bring the iron into the state that a record begins with, and record."""
    drive.rest(record.whole(record.sample))
    for turn in record.before:
        drive.go(turn)
    parts = [drive.go(turn) for turn in _turns(record.path)]
    current, force = (np.concatenate(part) for part in zip(*parts, strict=True))
    label = f"{1e3 * drive.gap:g}mm-{record.name}"
    return Loop(label, current, force, np.full(current.size, drive.gap), history=record.history)


def _turns(path: FloatArray) -> list[float]:
    """Return where a path begins, turns and ends."""
    ways = np.sign(np.diff(path))
    inside = 1 + np.flatnonzero(ways[1:] != ways[:-1])
    return [float(turn) for turn in path[[0, *inside, path.size - 1]]]
