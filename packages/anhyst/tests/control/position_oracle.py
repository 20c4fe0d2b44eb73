"""Fixed-point position controller in exact integers, as an oracle for the C core.

It was written from the headers and shares no code with C. Integers of Python have no limit, so
every saturation is explicit and nothing can wrap. The force controllers are those of the core; they
have their own oracle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from anhyst._core import FixedForceController

LOW, HIGH = -(2**31), 2**31 - 1
MISSING, RANGE, STEP, NO_LIFT, STOPPED = 17, 18, 19, 21, 22
INIT, SELFTEST, IDLE, READY, RUN, FAULT = range(6)
REST, BREAKAWAY, RISE, HOVER, DESCEND, SET_DOWN, FALL, CONDITION = range(8)
LEVITATING = (RISE, HOVER, DESCEND)


def limited(a: int, low: int = LOW, high: int = HIGH) -> int:
    return min(max(a, low), high)


def product(x: int, factor: tuple[int, int]) -> int:
    """Return x*mantissa/65536*2^shift, rounded down."""
    mantissa, shift = factor
    if shift >= 0:
        return limited(x << shift) * mantissa // 65536
    return x * mantissa // 65536 >> -shift


@dataclass
class Pidd2:
    """Oracle of ``anhyst_pidd2_q31``, from its row of words."""

    words: Sequence[int]
    place: int = 0
    speed: int = 0
    integral: int = 0
    wanted: int = 0
    following: tuple[int, int, int] = (0, 0, 0)

    def factor(self, i: int) -> tuple[int, int]:
        return self.words[2 * i], self.words[2 * i + 1]

    def solve(self, reference: int, position: int, load: int) -> int:
        y, r = position // 2, reference // 2
        first = product(self.place - y, self.factor(6))
        second = product(limited(self.speed - first), self.factor(7))
        weighted = r + reference * self.words[16] // 65536
        u = product(weighted - y, self.factor(0))
        u = limited(u + self.integral // 4)
        u = limited(u - product(first, self.factor(2)))
        u = limited(u - product(second, self.factor(3)))
        self.wanted = limited(u + product(load, self.factor(4)))
        learnt = limited(self.integral + product(r - y, self.factor(1)))
        self.following = self.place + first, limited(self.speed + second), learnt
        return limited(limited(8 * self.wanted), self.words[17], self.words[18])

    def commit(self, applied: int) -> None:
        self.place, self.speed, self.integral = self.following
        missing = limited(applied // 8 - self.wanted)
        self.integral = limited(self.integral + product(missing, self.factor(5)))

    def start(self, reference: int, position: int, load: int, output: int) -> None:
        self.place, self.speed, self.integral = position // 2, 0, 0
        self.solve(reference, position, load)
        self.integral = limited(limited(output // 8 - self.wanted) * 4)


@dataclass
class Sample:
    """Codes of one tick; without a position the sample is dropped."""

    position: int | None
    target: int
    load: int = 0
    current: tuple[int, int] = (0, 0)
    flux: tuple[int, int] = (LOW, LOW)
    command: int = 0


@dataclass
class Levitation:
    """Oracle of ``anhyst_levitation``: the sequence of lift-off and landing."""

    given: Mapping[str, float]
    state: int = INIT
    phase: int = REST
    fault: int = 0
    position: int = 0
    rest: int = 0
    reference: int = 0
    demand: int = 0
    count: int = 0
    unseen: int = 0
    passed: int = 0
    seen: bool = False
    begins: bool = False
    fresh: bool = False
    lets_go: bool = False
    lost: bool = False
    events: set[str] = field(default_factory=set)

    def number(self, name: str) -> int:
        return int(self.given[name])

    def tick(self, sample: Sample, demand: int, conditioning: int, at_zero: bool) -> None:
        self.begins, self.lets_go, self.events = False, False, set()
        self.handle_command(sample.command, at_zero)
        if self.phase in LEVITATING:
            self.demand = demand
        self.state = max(self.state, SELFTEST)
        self.watch(sample.position)
        self.move(limited(sample.target, self.number("position_low"), self.number("position_high")))
        if self.phase == CONDITION:
            self.count += 1
            if self.count >= conditioning:
                self.phase, self.state = REST, READY

    def reason(self, position: int | None) -> int:
        if position is None:
            return MISSING
        if not self.number("position_low") <= position <= self.number("position_high"):
            return RANGE
        reach = self.number("position_step") * (self.unseen + 1)
        far = min(abs(limited(position - self.position)), HIGH)
        return STEP if self.seen and reach <= HIGH and far > reach else 0

    def watch(self, position: int | None) -> None:
        if reason := self.reason(position):
            self.events.add("implausible")
            self.passed, self.unseen = 0, min(self.unseen + 1, 65535)
            if self.unseen > self.number("max_missing_samples"):
                self.fail(reason)
                self.lost |= reason == STEP
                instead = {BREAKAWAY: SET_DOWN, CONDITION: REST} | dict.fromkeys(LEVITATING, FALL)
                if self.phase in LEVITATING:
                    self.count = 0
                self.phase = instead.get(self.phase, self.phase)
            return
        assert position is not None
        self.position, self.unseen, self.seen = position, 0, True
        if self.state == SELFTEST:
            self.passed += 1
            if self.passed >= self.number("selftest"):
                self.state = IDLE
        if self.phase == FALL and not self.lost:
            self.begin(DESCEND)

    def fail(self, reason: int) -> None:
        if self.state != FAULT:
            self.state, self.fault = FAULT, reason

    def begin(self, phase: int) -> None:
        self.phase, self.reference, self.begins = phase, self.position, True

    def come_down(self) -> None:
        instead = {BREAKAWAY: SET_DOWN} | dict.fromkeys(LEVITATING, DESCEND)
        self.phase = instead.get(self.phase, self.phase)

    def handle_command(self, command: int, at_zero: bool) -> None:
        resting = self.phase == REST and at_zero
        still = self.phase != CONDITION
        idle = resting and self.state in (IDLE, READY)
        if command == 0:
            return
        if command == 1 and idle:
            self.state, self.phase, self.count = IDLE, CONDITION, -1
        elif command == 2 and idle:
            self.state = READY
            self.events.add("demagnetise")
        elif command == 3 and self.state == READY and self.unseen == 0 and at_zero:
            self.state, self.phase, self.demand, self.fresh = RUN, BREAKAWAY, 0, True
        elif command == 4 and self.state == RUN:
            self.come_down()
        elif command == 5 and self.phase == CONDITION:
            self.phase = REST
        elif command == 5 and self.state == RUN:
            self.fail(STOPPED)
            self.come_down()
        elif command == 6 and resting and self.state == FAULT:
            self.state, self.fault, self.unseen, self.passed = SELFTEST, 0, 0, 0
            self.seen = self.lost = False
        elif command == 7 and self.state in (IDLE, READY):
            self.state = IDLE
            self.phase = self.phase if still else REST
        elif command == 8 and self.state == IDLE and still:
            self.state = READY
        else:
            self.events.add("refused")

    def towards(self, now: int, end: int, rate: str) -> int:
        step = self.number(rate)
        return limited(end, limited(now - step), limited(now + step))

    def move(self, target: int) -> None:
        if self.phase == BREAKAWAY:
            self.break_away()
        elif self.phase == SET_DOWN:
            if self.demand == self.number("press"):
                self.phase = REST
                self.state = READY if self.state == RUN else self.state
            else:
                self.demand = self.towards(self.demand, self.number("press"), "set_down")
        elif self.phase == FALL:
            self.lets_go = self.count == 0
            self.count += 1
            if self.count > self.number("hold"):
                self.phase = REST
        elif self.phase == HOVER and not self.begins:
            self.reference = target
        elif self.phase == RISE and not self.begins:
            self.reference = self.towards(self.reference, target, "rise")
            self.phase = HOVER if self.reference == target else RISE
        elif self.phase == DESCEND and not self.begins:
            if self.reference == self.rest:
                self.phase = SET_DOWN
            else:
                self.reference = self.towards(self.reference, self.rest, "descend")

    def break_away(self) -> None:
        if self.fresh:
            self.rest, self.fresh = self.position, False
        if limited(self.position - self.rest) >= self.number("detect"):
            self.begin(RISE)
        elif self.demand >= self.number("most"):
            self.fail(NO_LIFT)
            self.phase = SET_DOWN
        else:
            self.demand = self.towards(self.demand, self.number("most"), "lift")


class Oracle:
    """Oracle of ``anhyst_position_q31``, with one or two magnets."""

    def __init__(
        self, gains: NDArray[np.int32], drives: list[FixedForceController], settings: Mapping[str, float]
    ) -> None:
        self.given, self.drives = settings, drives
        self.pidd2 = Pidd2([int(word) for word in gains])
        self.levitation = Levitation(settings)
        self.zero = self.on_grid(limited(0, *self.range()))
        self.current = [self.zero] * len(drives)
        self.gap = [0] * len(drives)
        self.demand = self.output = self.flags = 0
        self.pending = self.short = False

    def number(self, name: str) -> int:
        return int(self.given[name])

    def range(self) -> tuple[int, int]:
        return self.number("current_low"), self.number("current_high")

    def on_grid(self, current: int) -> int:
        """Return the nearest current of the converter; of two, the upper one."""
        low, step = self.number("current_low"), self.number("current_step")
        return low + (2 * (current - low) + step) // (2 * step) * step

    def tick(self, sample: Sample) -> tuple[list[int], int, int, int, int]:
        """Return currents, reference, demand, state, flags."""
        levitation = self.levitation
        length = max(drive.conditioning_length() for drive in self.drives)
        levitation.tick(sample, self.demand, length, all(i == self.zero for i in self.current))
        self.flags = 8 * ("implausible" in levitation.events) + 16 * ("refused" in levitation.events)
        for i in range(len(self.drives)):
            factor = self.number(f"gap_mantissa_{i + 1}"), self.number(f"gap_shift_{i + 1}")
            part = limited(2 * product(levitation.position, factor))
            self.gap[i] = limited(self.number(f"gap_offset_{i + 1}") + part)
        if self.given["measured"]:
            self.commit(sample.current)
        expected = self.wanted(sample)
        self.current = [self.on_grid(limited(i, *self.range())) for i in expected]
        if any(limited(i, *self.range()) != i for i in expected):
            self.flags |= 2
        self.short = self.flags & 7 != 0
        if not self.given["measured"]:
            self.commit(self.current)
        reference = levitation.reference if levitation.phase in LEVITATING else levitation.position
        return (self.current, reference, self.demand, 16 * levitation.state + levitation.phase, self.flags)

    def wanted(self, sample: Sample) -> list[int]:
        levitation, release = self.levitation, self.number("release")
        if levitation.phase in (REST, FALL):
            self.demand = self.demand if levitation.phase == FALL else 0
            begin = self.current
            if levitation.lets_go and len(begin) == 1:
                begin = [limited(i - (limited(i - self.zero) >> 3)) for i in begin]
            elif levitation.lets_go:
                begin = [self.zero] * 2
            return [limited(self.zero, limited(i - release), limited(i + release)) for i in begin]
        if levitation.phase == CONDITION:
            self.demand = 0
            return [drive.conditioning(levitation.count) for drive in self.drives]
        self.demand = self.control(sample) if levitation.phase in LEVITATING else levitation.demand
        forces = [self.demand]
        if len(self.drives) == 2:
            first = limited(self.number("bias") + self.demand // 2)
            forces = [first, limited(first - self.demand)]
        found = []
        for drive, force, gap, flux in zip(self.drives, forces, self.gap, sample.flux, strict=False):
            found.append(drive.solve(force, gap, flux))
            self.flags |= drive.flags
        return found

    def control(self, sample: Sample) -> int:
        levitation = self.levitation
        signals = levitation.reference, levitation.position, sample.load
        if levitation.begins:
            self.pidd2.start(*signals, self.demand)
        self.pending = True
        self.output = self.pidd2.solve(*signals)
        return self.output

    def commit(self, applied: Sequence[int]) -> None:
        forces = [
            drive.commit(current, gap)
            for drive, current, gap in zip(self.drives, applied, self.gap, strict=False)
        ]
        force = forces[0] if len(forces) == 1 else limited(forces[0] - forces[1])
        if self.pending:
            self.pidd2.commit(force if self.short else self.output)
            self.pending = False
