"""A bench by the clock, and all that looks on: pages, a recorder, a log; what is refused now."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst_rigs.dashboard.generator import DrivenBench, Wave
from anhyst_rigs.dashboard.improver import Improver
from anhyst_rigs.dashboard.recording import RecordingFile, Span, TickRecorder
from anhyst_rigs.dashboard.sets import ParameterSets
from anhyst_rigs.rig.bench.force import demand_refusal
from anhyst_rigs.rig.bench.pace import PacedBench, going_first
from anhyst_rigs.rig.bench.protocol import (
    Bench,
    Standing,
    Subscription,
    next_step,
    refusal,
    standing,
)
from anhyst_rigs.study.improve import BenchWatch, DrawnLoop, KnownModel
from anhyst_rigs.study.tracking.beside import BenchLearner

WATCHES = "another browser operates; ask to take over"

_DRIVES = ("target", "generator", "apply")
"""What moves a controller, beside commands."""

_BESIDE = ("load", "pace", "record", "improve", "learn", "sets")


def disturbs(order: str) -> bool:
    """Return whether an order, or a command by its name, disturbs a measurement; a stop ends it."""
    return order != "stop" and (order in _DRIVES or order.upper() in Command.__members__)


def all_refused(bench: Bench, why: str) -> dict[str, str]:
    """Return every order with the same reason."""
    return dict.fromkeys((*_commands(bench), *_DRIVES, *_BESIDE), why)


def refusals(bench: Bench, now: Standing | None, ended: str, measured: str) -> Mapping[str, str]:
    """Return the reason of every order that would be refused."""
    if ended:
        return all_refused(bench, ended)
    if bench.lost or now is None:
        return dict.fromkeys((*_commands(bench), *_DRIVES), bench.lost or "no sample has come yet")
    reasons = {name: refusal(command, now) for name, command in _commands(bench).items()}
    if bench.aim.unit == "N":
        reasons |= dict.fromkeys(("target", "generator"), demand_refusal(now.state))
    if measured:
        reasons |= {name: measured for name in (*reasons, *_DRIVES) if disturbs(name)}
    return {name: why for name, why in reasons.items() if why}


def _commands(bench: Bench) -> dict[str, Command]:
    return {command.name.lower(): command for command in bench.commands}


_LATE = 10_000
"""Chunks that wait for a learner; more than it is ever late by."""

_LOG = 500
"""Entries of the log that are kept."""

Listener = Callable[[FloatArray], None]
_Result = TypeVar("_Result")


class LogEntry(NamedTuple):
    """What was changed."""

    tick: int
    who: str
    text: str


class LiveSession:
    """Runs a bench until it is closed.

    Methods that touch the bench are to be called within :meth:`do`.
    """

    def __init__(
        self,
        bench: Bench,
        recording: RecordingFile | None = None,
        folder: Path | None = None,
        improver: Improver | None = None,
        curves: Sequence[DrawnLoop] = (),
        learner: BenchLearner | None = None,
    ) -> None:
        self.learner = learner
        self.bench = DrivenBench(
            bench, lambda why: self.note("bench", f"generator off: {why}"), self._happened
        )
        self.curves = tuple(curves)
        self.improver = improver
        self.watched: BenchWatch | None = None
        self._unwatch: Callable[[], None] = lambda: None
        self.log: deque[LogEntry] = deque(maxlen=_LOG)
        self.logged = 0
        self.parameters = bench.parameters()
        self.applied = 0
        self._names = [signal.name for signal in bench.signals]
        self._values: dict[str, float] = {}
        self._closed = False
        self._missing, self._newest = 0, 0
        self._listeners: tuple[Listener, ...] = ()
        folder = folder or Path.cwd()
        self.sets = ParameterSets(folder)
        self.recorder = TickRecorder(bench.signals, bench.rate, folder, self._recorded)
        if recording is not None:
            self.recorder.take(recording, Span(), 0)
            self._note_parameters()
        self.paced = PacedBench(self.bench, paused=True)
        complete = self.paced.subscribe("the recording", complete=True)
        self._threads = [
            _begin("pages", self._look_on, self.paced.subscribe("pages")),
            _begin("recorder", self.recorder.run, complete),
        ]
        if learner is not None:
            learn = partial(learner.run, do=self.do)
            self._threads.append(_begin("learner", learn, self.paced.subscribe("learner", _LATE)))

    def start(self) -> None:
        """Let time go on."""
        self.paced.resume()

    def close(self) -> None:
        """End the bench, the recording and work beside it; once is enough."""
        if self._closed:
            return
        self._closed = True
        if self.improver is not None:
            self.improver.close()
        self.paced.close()
        for thread in self._threads:
            thread.join()
        self.bench.close()

    @property
    def measured(self) -> str:
        """Why nothing may be moved: a measurement drives the controller; empty where none does."""
        driven = self.improver is not None and self.improver.drives
        return "a measurement drives the controller; wait, cancel it, or stop" if driven else ""

    @property
    def ended(self) -> str:
        """Why the bench or the recording goes on no more; empty while they do."""
        return str(self.paced.error or self.recorder.trouble)

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Give every row to a listener, which must not wait; returns what ends it."""
        self._listeners = (*self._listeners, listener)

        def leave() -> None:
            self._listeners = tuple(one for one in self._listeners if one is not listener)

        return leave

    def do(self, act: Callable[[], _Result]) -> _Result:
        """Do something between two chunks of ticks, and return what it returned."""
        return self.paced.do(lambda _: act())

    def note(self, who: str, text: str) -> None:
        """Keep what was changed, in the log and in the recording."""
        self.log.append(LogEntry(self.bench.tick, who, text))
        self.logged += 1
        self.recorder.note(self.bench.tick, f"{who}: {text}")

    def record(self, name: str, span: Span) -> None:
        """Begin a recording, with the parameters in force and what was changed of late."""
        tick = self.bench.tick
        self.recorder.start(name, span, tick)
        self._note_parameters()
        for entry in tuple(self.log):
            if entry.tick >= tick - span.before * self.bench.rate:
                self.recorder.note(entry.tick, f"{entry.who}: {entry.text}")

    def stop(self, who: str) -> None:
        """Stop the rig, and time does not stand over it; a refusal is kept too."""
        self.note(who, "emergency stop")
        try:
            self.bench.command(Command.STOP)
        finally:
            self.generate(None)
            self.paced.resume()

    def generate(self, generator: Wave | None) -> None:
        """Start a generator around the target, or stop it and go back to the target."""
        self.bench.generate(generator)

    def watch(self, known: KnownModel | None) -> None:
        """Hold the rows from now on against a model, or no more."""
        watched = None
        if known is not None:
            watched = BenchWatch(known.model, self.bench.signals, self.bench.rate)
        self._unwatch()
        self.watched = watched
        if watched is not None:
            self._unwatch = self.listen(watched.take)

    def apply(self, values: Mapping[str, float]) -> int:
        """Put parameters in force together; returns the first tick that uses them."""
        tick = self.applied = self.bench.apply(values)
        self.parameters = self.bench.parameters()
        return tick

    def status(self) -> Mapping[str, Any]:
        """Return what a page shows beside the signals."""
        pacing, generator = self.paced.pace(), self.bench.generator
        now = standing(self._values) if self._values else None
        refused = refusals(self.bench, now, self.ended, self.measured)
        return {
            "tick": pacing.tick,
            "speed": pacing.speed,
            "paused": pacing.paused,
            "factor": pacing.factor,
            "lateness": pacing.late_most,
            "slips": pacing.slips,
            "missing": self._missing,
            "waits_for": pacing.waits_for,
            "target": self.bench.target,
            "load": self.bench.pulled,
            "state": int(self._values.get("state", 0)),
            "fault": int(self._values.get("fault", 0)),
            "refused": refused,
            "next": self._next_step(now),
            "generator": None if generator is None else generator.as_dict(),
            "recording": self.recorder.status(),
            "sets": self.sets.names,
            "lost": self.bench.lost,
            "ended": self.ended,
            "improve": None if self.improver is None else self.improver.status(),
            "learn": None if self.learner is None else self.learner.status(),
            "watch": None if self.watched is None else self.watched.status(),
        }

    def _next_step(self, now: Standing | None) -> str:
        """Return what to do next so that it runs, in words; empty while it does."""
        if self.ended:
            return "start anhyst live again"
        if now is None or self.bench.lost or self.measured:
            return ""
        return next_step(self.bench.commands, now)

    def _note_parameters(self) -> None:
        in_force = ", ".join(
            f"{one.name} = {one.value!r} {one.unit}".rstrip() for one in self.parameters
        )
        self.recorder.note(self.bench.tick, f"in force: {in_force or 'no parameters'}")

    def _recorded(self, text: str) -> None:
        """Log what the recorder did."""
        self.log.append(LogEntry(self.bench.tick, "recorder", text))
        self.logged += 1

    def _happened(self, text: str) -> None:
        """Log what happened to the controller; what it has in force is as it says."""
        self.note("controller", text)
        self.parameters = self.bench.parameters()
        if self.improver is not None and not self.bench.lost:
            with suppress(InputError):  # it is lost again, and this comes again
                self.improver.look_again()
                self.curves = self.improver.known.curves

    def _look_on(self, subscription: Subscription) -> None:
        while (rows := subscription.get()) is not None:
            for listener in self._listeners:
                listener(rows)
            if self._newest:
                passed = int(rows[-1, 0]) - self._newest
                self._missing += passed // self.bench.every - len(rows)
            self._newest = int(rows[-1, 0])
            self._values = dict(zip(self._names, rows[-1, 1:].tolist(), strict=True))


def _begin(
    name: str, work: Callable[[Subscription], None], subscription: Subscription
) -> threading.Thread:
    def run() -> None:
        with going_first():
            work(subscription)

    thread = threading.Thread(target=run, name=name, daemon=True)
    thread.start()
    return thread


def finite(fields: Mapping[str, Any], key: str) -> float:
    """Return a number of a message."""
    value = fields.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{key}: is no number", code="not-a-number", key=key)
    return float(value)
