"""Every fault of ``docs/firmware.md``, while the firmware holds the armature in the air."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from anhyst.support.block_words import regenerate
from anhyst.support.errors import NegativeResult
from anhyst.support.states import Command, Fault, Phase, State
from anhyst_rigs.link.client import Refused
from anhyst_rigs.link.frames import PlantSample
from anhyst_rigs.link.virtual_boards import Q30, Q31
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bearing.scenario import LEAST_LIFT_S
from anhyst_rigs.rig.bench.bearing import BearingBench

Act = Callable[[BearingBench, int], bool]
"""Called before every tick, counted from the beginning of a fault; whether the link stays alive."""
_NO_SAMPLE = 1
_AMPLIFIER, _EMERGENCY_STOP, _OVER_CURRENT, _SUPPLY, _TOO_WARM = 2, 4, 8, 16, 32
"""Bits of ``PORT_...`` in ``firmware/port/port.h``."""
_ERROR_CODE = -(1 << 31)
"""What a sensor says that is broken."""
_SAG = 0.2
"""What a sagging supply is left with."""
_LONGEST_S = 1.0
"""Until an armature lies."""
_ON_S = 0.25
"""After so long it is seen to levitate on."""
_STILL_S = 0.02
"""Without current on its rest, so long, it lies."""
_OVERLOAD_S = 0.1
_STEP_M = 10e-6


@dataclass(frozen=True)
class Injection:
    """What goes wrong."""

    name: str  # in words
    reason: Fault  # that the controller gives; ``NONE`` where it goes on
    act: Act  # what is done


@dataclass(frozen=True)
class Ending:
    """How a fault in the air ended."""

    injection: Injection
    reason: Fault  # that the controller gave
    levitates: bool  # whether it went on hovering
    seconds: float  # from the fault until the armature lay without current, s; NaN where it went on
    # at which it first came to the stop on which it rests, and to that at the magnet, m/s; 0 where
    # it did not
    rest_speed: float
    magnet_speed: float
    # largest distance from where it hovered while it went on, m; NaN where it came down
    away: float

    @property
    def as_expected(self) -> bool:
        """Whether the controller gave the reason that belongs to the fault, or went on."""
        expected = self.injection.reason
        return self.reason is expected and self.levitates == (expected is Fault.NONE)

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "fault": self.injection.name,
            "expected": self.injection.reason.name.lower(),
            "reason": self.reason.name.lower(),
            "levitates": self.levitates,
            "seconds": self.seconds,
            "rest_speed_m_per_s": self.rest_speed,
            "magnet_speed_m_per_s": self.magnet_speed,
            "away_m": self.away,
        }


def _shows(ticks: float = math.inf, /, **shown: int | Callable[[PlantSample], int]) -> Act:
    """Let sensors show something else for some ticks: a number, or what becomes of a sample."""

    def change(sample: PlantSample) -> PlantSample:
        numbers = {name: one(sample) if callable(one) else one for name, one in shown.items()}
        return replace(sample, **numbers)

    def act(running: BearingBench, n: int) -> bool:
        running.tap.shown = change if n < ticks else None
        return True

    return act


def _freezes(running: BearingBench, n: int) -> bool:
    """Freeze the sensor of the position, and step the target."""
    if n == 0:
        running.demand(running.gap + _STEP_M)
        last: list[PlantSample] = []

        def frozen(sample: PlantSample) -> PlantSample:
            last.append(sample)
            return replace(sample, position=last[0].position)

        running.tap.shown = frozen
    return True


def _misses(running: BearingBench, n: int) -> bool:
    """Miss five ticks in a row."""
    if n == 0:
        running.tap.missed = 5
        running.advance(5)
    return True


def _sags(running: BearingBench, n: int) -> bool:
    """Let the supply fall; the board reports it a millisecond later."""
    if n == 0:
        running.bearing.supply *= _SAG
    if n == round(1e-3 * running.rate):
        running.tap.shown = lambda sample: replace(sample, status=_SUPPLY)
    return True


def _stops(running: BearingBench, n: int) -> bool:
    if n == 0:
        running.command(Command.STOP)
    return True


def _bad_block(running: BearingBench, n: int) -> bool:
    """Send a block with a broken checksum, and one whose words are not valid behind a right one."""
    if n == 0:
        words = running.link.read_block()
        words[2] ^= 0x40
        for broken in (words, regenerate(words, 7)):
            try:
                running.link.write_block(broken)
            except Refused:
                continue
            raise NegativeResult(
                "the controller took a parameter block that is not valid", code="bad-block-taken"
            )
    return True


def _swaps(running: BearingBench, n: int) -> bool:
    """Swap in the same parameters as another generation."""
    if n == 0:
        running.link.write_block(regenerate(running.link.read_block(), 9))
    return True


def _overload(running: BearingBench, n: int) -> bool:
    """Load it with more than the largest force can carry, for a while."""
    if n in (0, round(_OVERLOAD_S * running.rate)):
        running.load(1.2 * running.load_most if n == 0 else running.rest_load)
    return True


def injections() -> Iterator[Injection]:
    """Every fault, with the reason that the controller has to give."""
    yield Injection("three samples missing", Fault.NONE, _shows(3, status=_NO_SAMPLE))
    missing = Fault.POSITION_MISSING
    yield Injection("no samples any more", missing, _shows(status=_NO_SAMPLE))
    yield Injection("samples missing for 2 ms", missing, _shows(40, status=_NO_SAMPLE))
    far = round(0.95 * Q31)
    yield Injection("position out of range", Fault.POSITION_RANGE, _shows(position=far))

    def jumped(sample: PlantSample) -> int:
        return max(sample.position - round(0.7 * Q31), 1 + _ERROR_CODE)

    yield Injection("position jumps", Fault.POSITION_STEP, _shows(position=jumped))
    yield Injection("position frozen, target stepped", Fault.POSITION_STUCK, _freezes)
    broken, far = _shows(current=_ERROR_CODE), round(1.9 * Q30)
    yield Injection("current sensor's error code", Fault.CURRENT_RESERVED, broken)
    yield Injection("current out of range", Fault.CURRENT_RANGE, _shows(current=far))
    other, turned = Fault.CURRENT_MISMATCH, _shows(current=lambda sample: -sample.current)
    yield Injection("current sensor disconnected", other, _shows(current=0))
    yield Injection("current read with the wrong sign", other, turned)
    yield Injection("five ticks missed", Fault.MISSED_TICK, _misses)
    yield Injection("link lost", Fault.LINK_LOST, lambda running, n: False)
    yield Injection("command stop", Fault.STOPPED, _stops)
    yield Injection("emergency stop open", Fault.EMERGENCY_STOP, _shows(status=_EMERGENCY_STOP))
    yield Injection("supply sags to a fifth", Fault.SUPPLY, _sags)
    yield Injection("winding too warm", Fault.TOO_WARM, _shows(status=_TOO_WARM))
    yield Injection("amplifier reports a fault", Fault.AMPLIFIER, _shows(status=_AMPLIFIER))
    yield Injection("over-current", Fault.OVER_CURRENT, _shows(status=_OVER_CURRENT))
    yield Injection("bad parameter blocks", Fault.NONE, _bad_block)
    yield Injection("another block swapped in", Fault.NONE, _swaps)
    yield Injection("overload for 100 ms", Fault.NONE, _overload)


class FaultRuns:
    """Lifts, hovers, does something bad and watches, again and again in one session."""

    def __init__(self, setup: BearingSetup, running: BearingBench) -> None:
        self.setup = setup
        self.running = running
        self._gap = setup.rig.settings.gap_m
        self._supply = running.bearing.supply
        self._first = True

    def run(self, injection: Injection) -> Ending:
        """Let one thing go wrong in the air."""
        self._hover()
        ending = self._watch(injection)
        self._recover(ending)
        return ending

    def _ticks(self, seconds: float) -> int:
        return round(seconds * self.running.rate)

    def _hover(self) -> None:
        """Lift off with the iron as it is: its memory has followed every current so far."""
        running = self.running
        running.load(running.rest_load)
        if running.state is not State.READY:
            running.advance(self._ticks(0.005))
            running.command(Command.DEMAGNETISED if self._first else Command.ARM)
        self._first = False
        running.demand(self._gap)
        running.advance(1)
        running.command(Command.LIFT)
        running.advance(self._ticks(LEAST_LIFT_S))
        phase = Phase(running.link.status().codes.phase)
        if running.state is not State.RUN or phase is not Phase.HOVER:
            raise NegativeResult(
                f"the armature does not hover before a fault: state {running.state.name.lower()}, "
                f"phase {phase.name.lower()}, fault {running.fault.name.lower()}",
                code="does-not-hover",
            )

    def _watch(self, injection: Injection) -> Ending:
        running, body = self.running, self.setup.rig.settings.body
        begin, still = running.gap, 0
        rest_speed = magnet_speed = away = 0.0
        inside, speed = True, 0.0
        seconds = math.nan
        for n in range(self._ticks(_ON_S if injection.reason is Fault.NONE else _LONGEST_S)):
            running.beats = injection.act(running, n)
            now = running.step()
            gap = now["gap"]
            rests = gap >= body.stop_high_m
            outside = rests or gap <= body.stop_low_m
            if inside and rests:
                rest_speed = rest_speed or speed
            elif inside and outside:
                magnet_speed = magnet_speed or speed
            inside, speed = not outside, abs(now["velocity"])
            away = max(away, abs(gap - begin))
            still = still + 1 if outside and not _driven(now) else 0
            if still >= _STILL_S * running.rate:
                seconds = n / running.rate - _STILL_S
                break
        running.beats = True
        levitates = running.state is State.RUN
        away = away if levitates else math.nan
        return Ending(injection, running.fault, levitates, seconds, rest_speed, magnet_speed, away)

    def _recover(self, ending: Ending) -> None:
        """Everything works again: clear the fault, or land."""
        running = self.running
        running.tap.shown = None
        running.load(running.rest_load)
        running.bearing.supply = self._supply
        if ending.levitates:
            running.command(Command.LAND)
        for _ in range(self._ticks(_LONGEST_S)):
            now = running.step()
            if running.state is not State.RUN and not _driven(now):
                break
        running.advance(self._ticks(0.05))
        if running.state is State.FAULT:
            running.command(Command.CLEAR)
            running.advance(1)


def _driven(now: Mapping[str, float]) -> bool:
    """Whether a current is asked for."""
    return any(value for name, value in now.items() if name.startswith("command"))
