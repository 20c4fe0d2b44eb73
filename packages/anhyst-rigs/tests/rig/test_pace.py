"""Test the pacer: no tick is lost with any subscribers, and the speed is as requested."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping

import numpy as np
import pytest

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst_rigs.rig.bench.pace import MAX_LATENESS_S, PacedBench, raised_priority
from anhyst_rigs.rig.bench.protocol import Bench, DemandRange, Parameter, Signal, Subscription
from tests.refusals import refused

RATE = 20000.0


class Counter(Bench):
    """A bench without physics that returns the demand at every tick, with a computing time per
    tick."""

    signals: tuple[Signal, ...] = tuple(Signal(name, "", "as given") for name in ("demand", "a", "b"))
    aim = DemandRange("demand", "demand", "", -1.0, 1.0, 0.0)
    commands = ()
    tick = 0

    def __init__(self, rate: float = RATE, cost: float = 0.0) -> None:
        self.rate = rate
        self.cost = cost
        self.ends = 0
        self._values = {"demand": 0.0, "a": 0.0, "b": 0.0}

    def advance(self, ticks: int) -> FloatArray:
        if self.ends and self.tick + ticks > self.ends:
            raise InputError(f"the controller did not answer tick {self.ends}", code="no-answer")
        time.sleep(self.cost * ticks)
        numbers = np.arange(self.tick + 1, self.tick + ticks + 1, dtype=np.float64)
        self.tick += ticks
        return np.column_stack((numbers, *(np.full(ticks, v) for v in self._values.values())))

    def command(self, command: Command) -> None:
        raise InputError(f"refused {command.name}", code="refused")

    def demand(self, value: float) -> None:
        self._values["demand"] = value

    def load(self, force: float) -> None:
        raise InputError("no load drive", code="no-load-drive")

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def apply(self, values: Mapping[str, float]) -> int:
        self._values |= values
        return self.tick + 1

    def close(self) -> None:
        pass


@pytest.fixture
def paced() -> Iterator[Callable[..., PacedBench]]:
    pacers = []

    def start(bench: Counter, speed: float = 1.0, paused: bool = False) -> PacedBench:
        pacers.append(PacedBench(bench, speed, paused))
        return pacers[-1]

    yield start
    for pacer in pacers:
        pacer.close()


def drain(subscription: Subscription) -> FloatArray:
    """Return all rows until the subscription ends."""
    rows = []
    while (chunk := subscription.get(timeout=10.0)) is not None:
        rows.append(chunk)
    return np.concatenate(rows)


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.002)


def test_a_recorder_gets_every_tick_in_order(paced: Callable[..., PacedBench]) -> None:
    pacer = paced(Counter(), paused=True)
    recorder = pacer.subscribe("recorder", needs_every_tick=True)
    pacer.resume()
    time.sleep(0.3)
    pacer.close()
    rows = drain(recorder)
    assert len(rows) > 0.1 * RATE
    assert (rows[:, 0] == np.arange(1, len(rows) + 1)).all()
    assert recorder.missed_ticks == 0


def test_a_slow_viewer_loses_the_oldest_rows_and_delays_nobody(paced: Callable[..., PacedBench]) -> None:
    pacer = paced(Counter(), paused=True)
    viewer = pacer.subscribe("viewer", max_chunks=3)  # never reads while it runs
    pacer.resume()
    wait_for(lambda: pacer.pacing().tick > 0.2 * RATE)
    pace = pacer.pacing()
    assert pace.awaited_recorder == ""
    pacer.close()
    rows = drain(viewer)
    assert (np.diff(rows[:, 0]) == 1.0).all()
    assert viewer.missed_ticks + len(rows) == rows[-1, 0]  # lost ticks are counted
    assert viewer.missed_ticks > 0


def test_time_waits_for_a_recorder_that_has_no_room(paced: Callable[..., PacedBench]) -> None:
    pacer = paced(Counter(), paused=True)
    recorder = pacer.subscribe("disk", max_chunks=3, needs_every_tick=True)
    pacer.resume()
    wait_for(lambda: pacer.pacing().awaited_recorder == "disk")
    stands = pacer.pacing().tick
    time.sleep(0.1)
    assert pacer.pacing().tick == stands
    pacer.execute(lambda bench: bench.demand(1.0))  # other callers need not wait
    rows = [recorder.get() for _ in range(6)]
    numbers = np.concatenate([row[:, 0] for row in rows if row is not None])
    assert (numbers == np.arange(1, numbers.size + 1)).all()
    recorder.close()
    wait_for(lambda: pacer.pacing().tick > stands + 0.1 * RATE)


@pytest.mark.first(2)
@pytest.mark.parametrize("speed", [1.0, 0.1, 0.01])
def test_time_passes_at_the_set_speed(speed: float, paced: Callable[..., PacedBench]) -> None:
    bench = Counter()
    began = time.monotonic()
    pacer = paced(bench, speed)
    time.sleep(0.5)
    tick, took = pacer.pacing().tick, time.monotonic() - began
    assert 0 < tick <= took * RATE * speed
    wait_for(lambda: pacer.pacing().measured_speed == pytest.approx(speed, rel=0.5))


def test_a_pause_stops_virtual_time_and_a_step_is_one_tick(paced: Callable[..., PacedBench]) -> None:
    pacer = paced(Counter())
    wait_for(lambda: pacer.pacing().tick > 0)
    pacer.pause()
    stands = pacer.execute(lambda bench: bench.tick)
    time.sleep(0.05)
    assert pacer.execute(lambda bench: bench.tick) == stands
    assert pacer.pacing().is_paused
    assert pacer.pacing().measured_speed == 0.0
    pacer.step()
    wait_for(lambda: pacer.pacing().tick == stands + 1)
    pacer.step(500)
    wait_for(lambda: pacer.pacing().tick == stands + 501)
    time.sleep(0.05)
    assert pacer.pacing().tick == stands + 501
    began = time.monotonic()
    pacer.resume()
    wait_for(lambda: pacer.pacing().tick > stands + 600)
    tick, took = pacer.pacing().tick, time.monotonic() - began
    assert tick <= stands + 501 + took * RATE  # the pause is not caught up


def test_all_that_is_done_together_acts_on_one_tick(paced: Callable[..., PacedBench]) -> None:
    bench = Counter()
    pacer = paced(bench, paused=True)
    recorder = pacer.subscribe("recorder", max_chunks=1000, needs_every_tick=True)
    pacer.resume()

    def both(given: float) -> int:
        def act(_: object) -> int:
            bench.demand(given)
            return bench.apply({"a": given, "b": given})

        return pacer.execute(act)

    ticks = []
    for given in range(1, 20):
        ticks.append(both(float(given)))
        wait_for(lambda: pacer.pacing().tick >= ticks[-1])
    pacer.close()
    rows = drain(recorder)
    assert (rows[:, 1] == rows[:, 2]).all()
    assert (rows[:, 2] == rows[:, 3]).all()
    for given, tick in enumerate(ticks, start=1):
        assert rows[tick - 1, 1] == given
        assert tick == 1 or rows[tick - 2, 1] == given - 1


def test_an_overloaded_bench_slows_down_and_reports_it(paced: Callable[..., PacedBench]) -> None:
    bench = Counter(cost=2.0 / RATE)  # twice the available time
    pacer = paced(bench, paused=True)
    recorder = pacer.subscribe("recorder", max_chunks=10_000, needs_every_tick=True)
    pacer.resume()
    wait_for(lambda: pacer.pacing().slip_count >= 2)
    pace = pacer.pacing()
    assert pace.measured_speed < 0.7
    assert pace.max_lateness > MAX_LATENESS_S / 2.0
    assert pace.lost_time >= 2.0 * MAX_LATENESS_S
    bench.cost = 0.0
    began, tick = time.monotonic(), pacer.pacing().tick
    time.sleep(0.3)
    done, took = pacer.pacing().tick - tick, time.monotonic() - began
    assert done <= RATE * (took + MAX_LATENESS_S + 0.03)  # lost time is not caught up
    pacer.close()
    rows = drain(recorder)
    assert (rows[:, 0] == np.arange(1, len(rows) + 1)).all()


def test_a_refusal_is_raised_to_its_caller(paced: Callable[..., PacedBench]) -> None:
    pacer = paced(Counter())
    with refused("refused"):
        pacer.execute(lambda bench: bench.command(Command.LIFT))
    with refused("out-of-range speed: 0.01"):
        pacer.set_speed(2.0)
    tick = pacer.pacing().tick
    wait_for(lambda: pacer.pacing().tick > tick)


def test_the_end_of_a_bench_ends_all_queues_with_its_reason(paced: Callable[..., PacedBench]) -> None:
    bench = Counter()
    bench.ends = 1000
    pacer = paced(bench, paused=True)
    recorder = pacer.subscribe("recorder", needs_every_tick=True)
    pacer.resume()
    rows = drain(recorder)
    assert len(rows) == 1000
    with refused("no-answer: tick 1000"):
        pacer.execute(lambda bench: bench.tick)
    assert str(pacer.error).endswith("tick 1000")


def test_many_threads_may_call_at_once(paced: Callable[..., PacedBench]) -> None:
    pacer = paced(Counter())
    seen: list[int] = []
    lock = threading.Lock()

    def ask() -> None:
        for _ in range(50):
            tick = pacer.execute(lambda bench: bench.tick)
            with lock:
                seen.append(tick)

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(seen) == 200


@pytest.mark.skipif(sys.platform != "linux", reason="the scheduler is asked on Linux alone")
def test_raised_priority_is_temporary() -> None:
    def schedule() -> tuple[int, int]:
        return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority

    before = schedule()
    with raised_priority(3) as allowed:
        within = schedule()
    assert schedule() == before
    assert within == ((os.SCHED_RR | os.SCHED_RESET_ON_FORK, 3) if allowed else before)
