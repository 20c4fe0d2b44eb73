"""A bench that runs in a thread of its own: orders between two stretches, rows to who listens."""

from __future__ import annotations

import math
import queue
import threading
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any, NamedTuple

from anhyst.control.states import Command
from anhyst.live.generator import Generator
from anhyst.live.pacing import Pacer
from anhyst.live.recorder import StreamRecorder
from anhyst.rig.bench.protocol import Bench
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

STRETCH_S = 0.002
"""Between two looks at orders and generator, s of the bench."""

_ORDERS = 256
"""That wait; more are refused."""

_LOG = 500
"""Entries of the log that are kept."""

Listener = Callable[[FloatArray], None]


class Entry(NamedTuple):
    """What was changed."""

    tick: int
    who: str
    text: str


class Session:
    """Runs a bench; everything that touches it happens in one thread.

    Parameters
    ----------
    bench : Bench
        Closed with the session.
    recorder : StreamRecorder, optional
        Gets every row from the first tick on; closed with the session.

    Attributes
    ----------
    bench : Bench
        The bench.
    target : float or None
        Last target, m or N; None before the first.
    load : float or None
        Last load, N; None before the first.
    generator : Generator or None
        What is added to the target.
    parameters : tuple of Parameter
        With the values in force; another tuple after each change.
    ended : str
        Why the bench runs no more; empty while it does.
    """

    def __init__(self, bench: Bench, recorder: StreamRecorder | None = None) -> None:
        self.bench = bench
        self.recorder = recorder
        self.target: float | None = None
        self.load: float | None = None
        self.generator: Generator | None = None
        self.log: deque[Entry] = deque(maxlen=_LOG)
        self.logged = 0
        self.ended = ""
        self.pacer = Pacer(bench.rate)
        self.values: dict[str, float] = {}
        self.parameters = bench.parameters()
        self._names = [signal.name for signal in bench.signals]
        self._orders: queue.Queue[tuple[Callable[[], Any], Future[Any]]] = queue.Queue(_ORDERS)
        self._emergency = ""
        self._closing = False
        self._listeners: tuple[Listener, ...] = ()
        self._thread = threading.Thread(target=self._run, name="bench", daemon=True)

    def start(self) -> None:
        """Let the bench run."""
        self._thread.start()

    def close(self) -> None:
        """End the bench and the recording."""
        self._closing = True
        self._thread.join()

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Give every row to a listener, which must not wait; returns what ends it."""
        self._listeners = (*self._listeners, listener)

        def leave() -> None:
            self._listeners = tuple(one for one in self._listeners if one is not listener)

        return leave

    def call(self, act: Callable[[], Any]) -> Future[Any]:
        """Do something between two stretches; raises where too much waits already."""
        future: Future[Any] = Future()
        if self.ended:
            raise InputError(self.ended)
        try:
            self._orders.put_nowait((act, future))
        except queue.Full:
            raise InputError("too many orders wait; try again") from None
        return future

    def stop_now(self, who: str) -> None:
        """Stop at the next stretch, before anything else that waits."""
        self._emergency = who

    def note(self, who: str, text: str) -> None:
        """Keep what was changed, in the log and in the recording."""
        self.log.append(Entry(self.bench.tick, who, text))
        self.logged += 1
        if self.recorder is not None:
            self.recorder.note(f"tick {self.bench.tick}, {who}: {text}")

    def aim(self, target: float) -> None:
        """Set the target, m or N; the generator goes on around it."""
        if self.generator is None:
            self.bench.demand(target)
        self.target = target

    def generate(self, generator: Generator | None) -> None:
        """Start a generator around the target, or stop it and go back to the target."""
        if self.target is None:
            self.target = self.values.get("reference", 0.0)
        self.generator = generator
        if generator is None:
            self.bench.demand(self.target)

    def push(self, force: float) -> None:
        """Set the load drive, N."""
        self.bench.load(force)
        self.load = force

    def apply(self, values: Mapping[str, float]) -> int:
        """Put parameters in force together; returns the first tick that used them."""
        tick = self.bench.apply(values)
        self.parameters = self.bench.parameters()
        return tick

    def status(self) -> Mapping[str, Any]:
        """Return what a page shows beside the signals."""
        generator, recorder = self.generator, self.recorder
        return {
            "tick": self.bench.tick,
            "target": self.target,
            "load": self.load,
            "speed": self.pacer.speed,
            "paused": self.pacer.paused,
            "factor": self.pacer.factor,
            "lateness": self.pacer.lateness,
            "state": int(self.values.get("state", 0)),
            "fault": int(self.values.get("fault", 0)),
            "generator": None
            if generator is None
            else {
                "shape": generator.shape,
                "amplitude": generator.amplitude,
                "frequency": generator.frequency,
            },
            "recording": None
            if recorder is None
            else {"file": recorder.path.name, "rows": recorder.rows},
            "ended": self.ended,
        }

    def _run(self) -> None:
        try:
            while not self._closing:
                self._between()
                self._stretch()
        except Exception as error:
            self.ended = f"the bench ended: {error}"
            self._refuse_orders()
        finally:
            self.bench.close()
            if self.recorder is not None:
                self.recorder.close()

    def _stretch(self) -> None:
        ticks = self.pacer.wait(STRETCH_S)
        if not ticks:
            return
        generator = self.generator
        if generator is not None and self.target is not None:
            offset = generator.at(self.bench.tick + 1, self.bench.rate)
            self.bench.demand(self.target + offset)
        rows = self.bench.advance(ticks)
        if self.recorder is not None:
            self.recorder.put(rows)
        for listener in self._listeners:
            listener(rows)
        self.values = dict(zip(self._names, rows[-1, 1:].tolist(), strict=True))

    def _between(self) -> None:
        """Do what waits; the emergency stop first."""
        if self._emergency:
            who, self._emergency = self._emergency, ""
            self.generator = None
            try:
                self.bench.command(Command.STOP)
                self.note(who, "emergency stop")
            except InputError as refused:
                self.note(who, f"emergency stop: {refused}")
        for _ in range(self._orders.qsize()):
            act, future = self._orders.get_nowait()
            try:
                future.set_result(act())
            except InputError as error:
                future.set_exception(error)

    def _refuse_orders(self) -> None:
        while not self._orders.empty():
            self._orders.get_nowait()[1].set_exception(InputError(self.ended))


def finite(fields: Mapping[str, Any], key: str) -> float:
    """Return a number of a message.

    Raises
    ------
    InputError
        It is missing, or no finite number.
    """
    value = fields.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{key}: is no number")
    return float(value)
