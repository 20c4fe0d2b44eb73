"""Inject every fault of ``docs/firmware.md`` while the firmware levitates the armature."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from anhyst.support.block_words import set_generation
from anhyst.support.errors import NegativeResult
from anhyst.support.states import Command, Fault, Phase, State
from anhyst_rigs.link.client import RequestRefusedError
from anhyst_rigs.link.frames import PlantSample
from anhyst_rigs.link.virtual_boards import Q30, Q31
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bearing.scenario import MIN_LIFT_S
from anhyst_rigs.rig.bench.bearing import BearingBench

FaultAction = Callable[[BearingBench, int], bool]
"""Function that is called before every tick with the bench and the tick since the fault.

It returns whether the link stays alive.
"""
_NO_SAMPLE_BIT = 1
_AMPLIFIER_BIT, _EMERGENCY_STOP_BIT, _OVER_CURRENT_BIT, _SUPPLY_BIT, _TOO_WARM_BIT = 2, 4, 8, 16, 32
"""Bits of ``PORT_...`` in ``firmware/port/port.h``."""
_SENSOR_ERROR_CODE = -(1 << 31)
"""Code of a broken sensor."""
_SAG_RATIO = 0.2
"""Supply voltage after a sag, relative to the nominal one."""
_MAX_FALL_S = 1.0
"""Longest time that is simulated after a fault, until the armature rests."""
_HOVER_CHECK_S = 0.25
"""Simulated time after a fault that the armature must survive levitated."""
_REST_S = 0.02
"""Time on a stop without current after which the armature counts as at rest."""
_OVERLOAD_S = 0.1
_STEP_M = 10e-6


@dataclass(frozen=True)
class FaultInjection:
    """A fault that is injected."""

    name: str  # description
    expected_fault: Fault  # expected reason; ``NONE`` if the armature must stay levitated
    action: FaultAction  # injects the fault


@dataclass(frozen=True)
class FaultOutcome:
    """The result of a fault while levitated."""

    injection: FaultInjection
    fault: Fault  # reported reason
    is_levitating: bool  # whether the armature stayed levitated
    seconds: float  # from the fault to rest without current, s; NaN if levitated
    # speeds at the first contact with the rest and with the stop at the magnet, m/s; 0 without
    # contact
    rest_speed: float
    magnet_speed: float
    # largest deviation of the gap after the fault, m; NaN if the armature came down
    max_deviation: float

    @property
    def is_as_expected(self) -> bool:
        """Whether the controller reported the expected reason, or the armature stayed levitated."""
        expected = self.injection.expected_fault
        return self.fault is expected and self.is_levitating == (expected is Fault.NONE)

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome for JSON."""
        return {
            "fault": self.injection.name,
            "expected": self.injection.expected_fault.name.lower(),
            "reason": self.fault.name.lower(),
            "levitates": self.is_levitating,
            "seconds": self.seconds,
            "rest_speed_m_per_s": self.rest_speed,
            "magnet_speed_m_per_s": self.magnet_speed,
            "away_m": self.max_deviation,
        }


def _replace_readings(
    ticks: float = math.inf, /, **readings: int | Callable[[PlantSample], int]
) -> FaultAction:
    """Replace sensor readings for some ticks by numbers or by functions of the sample."""

    def change(sample: PlantSample) -> PlantSample:
        numbers = {name: one(sample) if callable(one) else one for name, one in readings.items()}
        return replace(sample, **numbers)

    def act(running: BearingBench, n: int) -> bool:
        running.tap.change_sample = change if n < ticks else None
        return True

    return act


def _freeze_position(running: BearingBench, n: int) -> bool:
    """Freeze the position sensor, and step the target."""
    if n == 0:
        running.demand(running.gap + _STEP_M)
        last: list[PlantSample] = []

        def frozen(sample: PlantSample) -> PlantSample:
            last.append(sample)
            return replace(sample, position=last[0].position)

        running.tap.change_sample = frozen
    return True


def _miss_ticks(running: BearingBench, n: int) -> bool:
    """Let the controller miss five ticks in a row."""
    if n == 0:
        running.tap.ticks_to_skip = 5
        running.advance(5)
    return True


def _sag_supply(running: BearingBench, n: int) -> bool:
    """Reduce the supply; the board reports it after 1 ms."""
    if n == 0:
        running.bearing.supply *= _SAG_RATIO
    if n == round(1e-3 * running.rate):
        running.tap.change_sample = lambda sample: replace(sample, status=_SUPPLY_BIT)
    return True


def _command_stop(running: BearingBench, n: int) -> bool:
    if n == 0:
        running.command(Command.STOP)
    return True


def _send_bad_blocks(running: BearingBench, n: int) -> bool:
    """Send a block with a wrong checksum, and one with invalid words and a correct checksum."""
    if n == 0:
        words = running.link.read_block()
        words[2] ^= 0x40
        for broken in (words, set_generation(words, 7)):
            try:
                running.link.write_block(broken)
            except RequestRefusedError:
                continue
            raise NegativeResult(
                "the controller took a parameter block that is not valid", code="bad-block-taken"
            )
    return True


def _swap_block(running: BearingBench, n: int) -> bool:
    """Swap in the same parameters as another generation."""
    if n == 0:
        running.link.write_block(set_generation(running.link.read_block(), 9))
    return True


def _apply_overload(running: BearingBench, n: int) -> bool:
    """Apply a load above the largest force for 100 ms."""
    if n in (0, round(_OVERLOAD_S * running.rate)):
        running.load(1.2 * running.max_load if n == 0 else running.rest_load)
    return True


def fault_injections() -> Iterator[FaultInjection]:
    """Yield every fault with the reason that the controller must report."""
    yield FaultInjection(
        "three samples missing", Fault.NONE, _replace_readings(3, status=_NO_SAMPLE_BIT)
    )
    missing = Fault.POSITION_MISSING
    yield FaultInjection("no samples any more", missing, _replace_readings(status=_NO_SAMPLE_BIT))
    yield FaultInjection(
        "samples missing for 2 ms", missing, _replace_readings(40, status=_NO_SAMPLE_BIT)
    )
    far = round(0.95 * Q31)
    yield FaultInjection(
        "position out of range", Fault.POSITION_RANGE, _replace_readings(position=far)
    )

    def jumped(sample: PlantSample) -> int:
        return max(sample.position - round(0.7 * Q31), 1 + _SENSOR_ERROR_CODE)

    yield FaultInjection("position jumps", Fault.POSITION_STEP, _replace_readings(position=jumped))
    yield FaultInjection("position frozen, target stepped", Fault.POSITION_STUCK, _freeze_position)
    broken, far = _replace_readings(current=_SENSOR_ERROR_CODE), round(1.9 * Q30)
    yield FaultInjection("current sensor's error code", Fault.CURRENT_RESERVED, broken)
    yield FaultInjection(
        "current out of range", Fault.CURRENT_RANGE, _replace_readings(current=far)
    )
    other, turned = (
        Fault.CURRENT_MISMATCH,
        _replace_readings(current=lambda sample: -sample.current),
    )
    yield FaultInjection("current sensor disconnected", other, _replace_readings(current=0))
    yield FaultInjection("current read with the wrong sign", other, turned)
    yield FaultInjection("five ticks missed", Fault.MISSED_TICK, _miss_ticks)
    yield FaultInjection("link lost", Fault.LINK_LOST, lambda running, n: False)
    yield FaultInjection("command stop", Fault.STOPPED, _command_stop)
    yield FaultInjection(
        "emergency stop open", Fault.EMERGENCY_STOP, _replace_readings(status=_EMERGENCY_STOP_BIT)
    )
    yield FaultInjection("supply sags to a fifth", Fault.SUPPLY, _sag_supply)
    yield FaultInjection(
        "winding too warm", Fault.TOO_WARM, _replace_readings(status=_TOO_WARM_BIT)
    )
    yield FaultInjection(
        "amplifier reports a fault", Fault.AMPLIFIER, _replace_readings(status=_AMPLIFIER_BIT)
    )
    yield FaultInjection(
        "over-current", Fault.OVER_CURRENT, _replace_readings(status=_OVER_CURRENT_BIT)
    )
    yield FaultInjection("bad parameter blocks", Fault.NONE, _send_bad_blocks)
    yield FaultInjection("another block swapped in", Fault.NONE, _swap_block)
    yield FaultInjection("overload for 100 ms", Fault.NONE, _apply_overload)


class FaultRuns:
    """Run one fault after another in one session: lift, hover, inject, monitor, recover."""

    def __init__(self, setup: BearingSetup, bench: BearingBench) -> None:
        self.setup = setup
        self.running = bench
        self._gap = setup.rig.settings.gap_m
        self._supply = bench.bearing.supply
        self._is_first = True

    def run(self, injection: FaultInjection) -> FaultOutcome:
        """Run one fault while the armature is levitated."""
        self._lift_to_hover()
        ending = self._monitor(injection)
        self._recover(ending)
        return ending

    def _ticks(self, seconds: float) -> int:
        return round(seconds * self.running.rate)

    def _lift_to_hover(self) -> None:
        """Lift off; after the first fault the controller continues with its hysteresis state."""
        running = self.running
        running.load(running.rest_load)
        if running.state is not State.READY:
            running.advance(self._ticks(0.005))
            running.command(Command.DEMAGNETISED if self._is_first else Command.ARM)
        self._is_first = False
        running.demand(self._gap)
        running.advance(1)
        running.command(Command.LIFT)
        running.advance(self._ticks(MIN_LIFT_S))
        phase = Phase(running.link.status().codes.phase)
        if running.state is not State.RUN or phase is not Phase.HOVER:
            raise NegativeResult(
                f"the armature does not hover before a fault: state {running.state.name.lower()}, "
                f"phase {phase.name.lower()}, fault {running.fault.name.lower()}",
                code="does-not-hover",
            )

    def _monitor(self, injection: FaultInjection) -> FaultOutcome:
        running, body = self.running, self.setup.rig.settings.body
        begin, still = running.gap, 0
        rest_speed = magnet_speed = away = 0.0
        inside, speed = True, 0.0
        seconds = math.nan
        for n in range(
            self._ticks(_HOVER_CHECK_S if injection.expected_fault is Fault.NONE else _MAX_FALL_S)
        ):
            running.sends_heartbeat = injection.action(running, n)
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
            still = still + 1 if outside and not _has_current(now) else 0
            if still >= _REST_S * running.rate:
                seconds = n / running.rate - _REST_S
                break
        running.sends_heartbeat = True
        levitates = running.state is State.RUN
        away = away if levitates else math.nan
        return FaultOutcome(
            injection, running.fault, levitates, seconds, rest_speed, magnet_speed, away
        )

    def _recover(self, ending: FaultOutcome) -> None:
        """Remove the fault, and clear it in the controller or land."""
        running = self.running
        running.tap.change_sample = None
        running.load(running.rest_load)
        running.bearing.supply = self._supply
        if ending.is_levitating:
            running.command(Command.LAND)
        for _ in range(self._ticks(_MAX_FALL_S)):
            now = running.step()
            if running.state is not State.RUN and not _has_current(now):
                break
        running.advance(self._ticks(0.05))
        if running.state is State.FAULT:
            running.command(Command.CLEAR)
            running.advance(1)


def _has_current(now: Mapping[str, float]) -> bool:
    """Whether any current is commanded."""
    return any(value for name, value in now.items() if name.startswith("command"))
