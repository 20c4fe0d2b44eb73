"""Run a bench in step with the clock.

Only the thread of the pacer uses the bench. It simulates about 10 ms of ticks when the last of
these ticks is due, and sends their rows as one chunk to all subscribers. Actions on the bench are
executed between two chunks, so that each action takes effect at one tick.
"""

from __future__ import annotations

import math
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TypeVar

from anhyst._core import BusController
from anhyst.support.errors import InputError
from anhyst_rigs.link.client import ControllerLink
from anhyst_rigs.link.virtual_boards import PlantBus
from anhyst_rigs.rig.bench.protocol import Bench, Subscription

MIN_SPEED = 0.01
MAX_SPEED = 1.0
"""Limits of the simulation speed, as a multiple of real time."""
CHUNK_S = 0.01
"""Duration of a chunk in real time, s."""
MAX_LATENESS_S = 0.1
"""Largest lateness in real time, s; a later bench skips the excess instead of catching up."""
_PACER_PRIORITY = 2
"""Real-time priority of the pacer's thread."""
_SLEEP_TO_COMPUTING_TIME = 0.05
"""Sleep after each chunk as a fraction of its computing time, if the thread has real-time priority.
"""
_SPEED_WINDOW_S = 1.0
"""Length of the window in which speed and lateness are measured, s in real time."""

_Result = TypeVar("_Result")


@dataclass(frozen=True, slots=True)
class Pacing:
    """Data on how closely a bench follows the clock."""

    tick: int  # number of the last tick
    is_paused: bool
    speed: float  # requested simulation speed as a multiple of real time
    measured_speed: float  # the same, measured over the last second; 0 while paused
    # mean and largest lateness of the chunks in the last second, s: the time from the due time of a
    # chunk's last tick until its rows were sent
    mean_lateness: float
    max_lateness: float
    # number of times since the start at which lateness above :data:`MAX_LATENESS_S` was skipped
    slip_count: int
    lost_time: float  # sum of the skipped times, s in real time
    # recorder whose full queue blocks the bench; empty if there is none
    awaited_recorder: str


class PacedBench:
    """A thread that runs a bench in step with the clock, or with the bench's own clock."""

    def __init__(self, bench: Bench, speed: float = 1.0, is_paused: bool = False) -> None:
        self.error: InputError | None = None
        self._bench = bench
        self._speed = _check_speed(speed)
        self._is_paused = is_paused
        self._ticks_to_step = 0
        self._is_closing = False
        self._wake = threading.Condition()
        self._todo: deque[Callable[[], None]] = deque()
        self._subscriptions: list[Subscription] = []
        self._window: deque[tuple[float, int, float]] = deque()
        self._slip_count, self._lost_time, self._awaited_recorder = 0, 0.0, ""
        self._origin = (time.monotonic(), bench.tick)
        self._tick = bench.tick
        self._thread = threading.Thread(target=self._run, name="pacer", daemon=True)
        self._thread.start()

    def subscribe(self, name: str, max_chunks: int = 100, needs_every_tick: bool = False) -> Subscription:
        """Add a subscriber that receives all chunks from the next one on."""
        subscription = Subscription(name, max_chunks, needs_every_tick)
        with self._wake:
            if self._is_closing:
                subscription.close()
            self._subscriptions.append(subscription)
        return subscription

    def execute(self, action: Callable[[Bench], _Result]) -> _Result:
        """Execute an action on the bench between two chunks, and return its result.

        The action takes effect at one tick, also while the bench is paused. An exception of the
        action is raised in the caller.
        """
        future: Future[_Result] = Future()

        def work() -> None:
            try:
                future.set_result(action(self._bench))
            except BaseException as error:
                future.set_exception(error)

        with self._wake:
            if self._is_closing:
                raise self.error or InputError("the bench is closed", code="bench-closed")
            self._todo.append(work)
            self._wake.notify_all()
        return future.result()

    def set_speed(self, speed: float) -> None:
        """Change the simulation speed, as a multiple of real time."""
        with self._wake:
            self._speed = _check_speed(speed)
            self._restart_clock()

    def pause(self) -> None:
        """Pause the bench after the chunk that is being computed."""
        with self._wake:
            self._is_paused = True
            self._window.clear()

    def resume(self) -> None:
        """Continue the bench after a pause."""
        with self._wake:
            self._is_paused, self._ticks_to_step = False, 0
            self._restart_clock()

    def step(self, ticks: int = 1) -> None:
        """Advance a paused bench by some ticks; do nothing if it is not paused."""
        with self._wake:
            if self._is_paused:
                self._ticks_to_step += ticks
                self._wake.notify_all()

    def pacing(self) -> Pacing:
        """Return data on how closely the bench follows the clock."""
        with self._wake:
            lateness, measured_speed = [entry[2] for entry in self._window], 0.0
            if len(lateness) > 1:
                (begin, first_tick, _), (end, last_tick, _) = self._window[0], self._window[-1]
                measured_speed = (last_tick - first_tick) / self._bench.rate / (end - begin)
            return Pacing(
                tick=self._tick,
                is_paused=self._is_paused,
                speed=self._speed,
                measured_speed=measured_speed,
                mean_lateness=sum(lateness) / len(lateness) if lateness else 0.0,
                max_lateness=max(lateness, default=0.0),
                slip_count=self._slip_count,
                lost_time=self._lost_time,
                awaited_recorder=self._awaited_recorder,
            )

    def close(self) -> None:
        """Send the last computed chunk to the subscribers; end all queues. The bench stays open."""
        with self._wake:
            self._is_closing = True
            self._wake.notify_all()
        self._thread.join()

    def _restart_clock(self) -> None:
        """Restart the measurement of time; the caller holds the lock."""
        self._origin = (time.monotonic(), self._tick)
        self._window.clear()
        self._wake.notify_all()

    def _due_time(self, tick: int) -> float:
        """Return the time at which a tick is due, s of the monotonic clock."""
        begin, first_tick = self._origin
        return begin + (tick - first_tick) / (self._bench.rate * self._speed)

    def _run(self) -> None:
        try:
            with raised_priority(_PACER_PRIORITY) as has_priority:
                while (ticks := self._next_ticks()) is not None:
                    start_time = time.monotonic()
                    self._advance(ticks)
                    if has_priority:
                        time.sleep(_SLEEP_TO_COMPUTING_TIME * (time.monotonic() - start_time))
        except InputError as error:
            self.error = error
        finally:
            self._end()

    def _next_ticks(self) -> int | None:
        """Execute actions until ticks are due; return the number of due ticks, or None when closed."""
        while True:
            with self._wake:
                if not self._todo:
                    if self._is_closing:
                        return None
                    ticks, wait_time = self._ticks_due()
                    if ticks:
                        return ticks
                    self._wake.wait(wait_time)
                    continue
                action = self._todo.popleft()
            action()

    def _ticks_due(self) -> tuple[int, float | None]:
        """Return the number of ticks to run now, or 0 and the waiting time, s; requires the lock."""
        full_queues = [subscription.name for subscription in self._subscriptions if subscription.needs_wait()]
        self._awaited_recorder = full_queues[0] if full_queues else ""
        if full_queues:
            return 0, CHUNK_S
        chunk_ticks = max(1, math.floor(CHUNK_S * self._bench.rate * self._speed))
        if self._is_paused:
            ticks = min(self._ticks_to_step, chunk_ticks)
            self._ticks_to_step -= ticks
            return ticks, None
        if self._bench.has_own_clock:
            return chunk_ticks, None  # The bench itself waits until these ticks have passed.
        remaining_time = self._due_time(self._tick + chunk_ticks) - time.monotonic()
        return (0, remaining_time) if remaining_time > 0.0 else (chunk_ticks, None)

    def _advance(self, ticks: int) -> None:
        rows = self._bench.advance(ticks)
        with self._wake:
            self._tick = self._bench.tick
            self._subscriptions = [
                subscription for subscription in self._subscriptions if not subscription.has_ended
            ]
            subscriptions = list(self._subscriptions)
        for subscription in subscriptions if len(rows) else ():
            subscription.put(rows)
        with self._wake:
            if not self._is_paused:
                self._record_lateness()

    def _record_lateness(self) -> None:
        """Record the lateness of a chunk; skip lateness in excess of :data:`MAX_LATENESS_S`."""
        present_time = time.monotonic()
        lateness = 0.0 if self._bench.has_own_clock else present_time - self._due_time(self._tick)
        self._window.append((present_time, self._tick, lateness))
        while self._window[0][0] < present_time - _SPEED_WINDOW_S and len(self._window) > 2:
            self._window.popleft()
        if lateness > MAX_LATENESS_S:
            self._slip_count += 1
            self._lost_time += lateness
            self._origin = (present_time, self._tick)

    def _end(self) -> None:
        with self._wake:
            self._is_closing = True
            actions, self._todo = self._todo, deque()
            subscriptions = list(self._subscriptions)
        for subscription in subscriptions:
            subscription.close()
        for action in actions:
            action()


@contextmanager
def raised_priority(order: int = 1) -> Iterator[bool]:
    """Run a block with real-time priority, and yield whether the system permits this.

    Threads that run continuously in parallel to the pacer need it too. Otherwise, they could be
    suspended while they hold the interpreter's lock, and delay the pacer.
    """
    if sys.platform != "linux":
        yield False
        return
    old_priority = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK  # Child processes do not get this priority.
        os.sched_setscheduler(0, policy, os.sched_param(order))
    except OSError:  # The system usually does not permit it.
        yield False
        return
    try:
        yield True
    finally:
        os.sched_setscheduler(0, *old_priority)


def _check_speed(speed: float) -> float:
    if not MIN_SPEED <= speed <= MAX_SPEED:
        text = f"speed {speed:g}: choose one from {MIN_SPEED:g} to {MAX_SPEED:g}"
        raise InputError(text, code="out-of-range", key="speed")
    return speed


_HEARTBEAT_PERIOD_S = 0.04
"""Time without a request after which a heartbeat is due, s of virtual time; controllers wait 0.1 s.
"""


class Heartbeat:
    """Periodic requests that tell a controller that its operator is present."""

    def __init__(self, link: ControllerLink) -> None:
        self._link = link
        self._period_ticks = max(1, int(_HEARTBEAT_PERIOD_S * link.info.rate))
        self._silent_ticks = 0

    def count_ticks(self, ticks: int) -> int:
        """Send a heartbeat if it is due; return how many ticks may pass until the next one."""
        if self._silent_ticks >= self._period_ticks:
            self._link.status()
            self._silent_ticks = 0
        count = min(ticks, self._period_ticks - self._silent_ticks)
        self._silent_ticks += count
        return count

    def restart(self) -> None:
        """Restart the period after any other request, because it also counts as a heartbeat."""
        self._silent_ticks = 0


class LockStepBench(Bench):
    """A bench whose virtual time passes only while it advances, also for the firmware.

    It implements :class:`anhyst_rigs.dashboard.improver.BlockHolder`. The attribute ``_resources``
    closes its firmware and connections.
    """

    _resources: ExitStack
    _bus: BusController | PlantBus
    link: ControllerLink  # session that carries all commands
    _heartbeat: Heartbeat

    @property
    def tick(self) -> int:
        """Number of the last tick."""
        return self._bus.tick

    def read_block(self) -> list[int]:
        """Return the active parameter block."""
        self._heartbeat.restart()
        return self.link.read_block()

    def swap_block(self, words: Sequence[int]) -> int:
        """Activate another parameter block at the next tick, and return this tick."""
        self.link.write_block(words)
        self._heartbeat.restart()
        return self.tick + 1

    def close(self) -> None:
        """Stop the firmware."""
        self._resources.close()
