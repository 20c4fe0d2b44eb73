"""Many demands on their way at a time, none lost and none out of order."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Protocol, Self

from anhyst.link.frames import DemandRequest, Message, NakAnswer, Reason, StatusAnswer
from anhyst.link.wire import Frame, encode
from anhyst.support.errors import InputError
from anhyst.support.states import Fault, Flag, State

_Q30 = 1.0 / (1 << 30)
_Q31 = 1.0 / (1 << 31)


@dataclass(frozen=True, slots=True)
class Status:
    """What a controller did in one tick."""

    tick: int  # which
    codes: StatusAnswer  # the numbers as they came

    @classmethod
    def of(cls, answer: StatusAnswer, tick: int) -> Self:
        """Read an answer."""
        return cls(tick, answer)

    @property
    def state(self) -> State:
        """State of the controller."""
        return State(self.codes.state)

    @property
    def fault(self) -> Fault:
        """Latched reason of a fault."""
        return Fault(self.codes.fault)

    @property
    def flags(self) -> Flag:
        """What was limited, and more."""
        return Flag(self.codes.flags)

    @property
    def demand(self) -> float:
        """Demand in force, as a fraction of the full-scale force."""
        return self.codes.demand * _Q31

    @property
    def force(self) -> float:
        """Force measured, as a fraction of the full-scale force."""
        return self.codes.force * _Q30

    @property
    def gap(self) -> float:
        """Gap measured: 0 at the low end of the model's range, 1 at the high one."""
        return self.codes.gap * _Q30

    @property
    def current(self) -> float:
        """Current measured, as a fraction of the full-scale current."""
        return self.codes.current * _Q30

    @property
    def drive(self) -> float:
        """Current driven, as a fraction of the full-scale current."""
        return self.codes.drive * _Q31

    @property
    def generation(self) -> int:
        """Generation of the parameter block in force."""
        return self.codes.generation


WINDOW_MOST = 32
"""Requests on their way; the controller knows of so many whether it answered them."""


_PAUSE = 0.2e-3
"""Between two looks at the line, s: an emulated board sends byte by byte, and every look costs."""


class Line(Protocol):
    """The end of a line that demands are sent over."""

    url: str
    timeout: float
    attempts: int
    repeated: int

    def next_sequence(self) -> int:
        """Return the number of the next request."""
        ...

    def send(self, wire: bytes) -> None:
        """Put bytes on the line."""
        ...

    def receive(self, timeout: float) -> list[Frame]:
        """Return what arrived, waiting at most so long, s."""
        ...

    def read_answer(self, frame: Frame) -> Message:
        """Return what a frame says."""
        ...

    def silent(self) -> Exception:
        """Return the error of a controller that does not answer."""
        ...


@dataclass(slots=True)
class _Sent:
    """A demand that waits for its answer."""

    force: int
    sequence: int
    wire: bytes
    times: int = 1
    status: Status | None = None


def demand_request(force: int) -> DemandRequest:
    """Return a demand, q31 of the full-scale force."""
    if not -(1 << 31) <= force < 1 << 31:
        raise InputError(
            f"demand {force}: does not fit q31; keep it within -2^31 and 2^31 - 1",
            code="beyond-full-scale",
            key="demand",
        )
    return DemandRequest(int(force))


def stream(controller: Line, forces: Iterable[int], window: int) -> Iterator[Status]:
    """Send demands; see :meth:`anhyst.link.client.ControllerLink.stream`."""
    if not 1 <= window <= WINDOW_MOST:
        raise InputError(
            f"window {window}: choose 1 to {WINDOW_MOST}", code="out-of-range", key="window"
        )
    flow = _Flow(controller)
    source = iter(forces)
    while True:
        flow.send(islice(source, window - len(flow.waiting)))
        if not flow.waiting:
            return
        flow.receive()
        yield from flow.answered()


class _Flow:
    def __init__(self, controller: Line) -> None:
        self.controller = controller
        self.waiting: deque[_Sent] = deque()
        self._end = 0.0

    def send(self, forces: Iterable[int]) -> None:
        """Put demands on the line, in one piece."""
        fresh = [self._number(force) for force in forces]
        if fresh:
            self.waiting.extend(fresh)
            self._write(fresh)

    def _number(self, force: int) -> _Sent:
        sequence = self.controller.next_sequence()
        return _Sent(force, sequence, encode(demand_request(force), sequence))

    def _write(self, demands: Iterable[_Sent]) -> None:
        self.controller.send(b"".join(demand.wire for demand in demands))
        self._end = time.monotonic() + self.controller.timeout

    def receive(self) -> None:
        """Take the answers that arrive; send again what went missing."""
        if len(self.waiting) > 1:
            time.sleep(_PAUSE)
        arrived = self.controller.receive(max(self._end - time.monotonic(), 0.0))
        by_number = {demand.sequence: demand for demand in self.waiting}
        for frame in arrived:
            demand = by_number.get(frame.sequence)
            if demand is not None and demand.status is None and not self._take(demand, frame):
                return
        first = self.waiting[0]
        if first.status is not None:
            return
        if time.monotonic() >= self._end:
            self._repeat([demand for demand in self.waiting if demand.status is None])
        elif first.times == 1 and any(demand.status for demand in self.waiting):
            self._repeat([first])  # newer ones were answered: this one was lost

    def _take(self, demand: _Sent, frame: Frame) -> bool:
        """Keep an answer; False where the demands from this one on were sent again."""
        answer = self.controller.read_answer(frame)
        if isinstance(answer, StatusAnswer):
            demand.status = Status.of(answer, frame.tick)
            return True
        if isinstance(answer, NakAnswer) and answer.reason == Reason.OLD:
            self._begin_again(demand)
            return False
        raise InputError(
            f"{self.controller.url}: {answer} in answer to a demand", code="unexpected-answer"
        )

    def _repeat(self, demands: list[_Sent]) -> None:
        if demands[0].times >= self.controller.attempts:
            raise self.controller.silent()
        for demand in demands:
            demand.times += 1
        self.controller.repeated += len(demands)
        self._write(demands)

    def _begin_again(self, first: _Sent) -> None:
        """Send a demand and all after it under new numbers: newer ones had overtaken it."""
        kept = list(self.waiting)
        at = kept.index(first)
        again = [self._number(demand.force) for demand in kept[at:]]
        self.controller.repeated += len(again)
        self.waiting = deque(kept[:at] + again)
        self._write(again)

    def answered(self) -> Iterator[Status]:
        """Take off the statuses that are there, in order."""
        while self.waiting and self.waiting[0].status is not None:
            status = self.waiting.popleft().status
            if status is not None:
                yield status
