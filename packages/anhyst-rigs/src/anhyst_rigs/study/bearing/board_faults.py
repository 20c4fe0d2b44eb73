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
"""Function that is called before every tick with the bench and the number of ticks since the fault.

It returns whether the operator still sends heartbeats.
"""
# The masks correspond to ``PORT_...`` in ``firmware/port/port.h``.
_NO_SAMPLE_BIT = 1
_AMPLIFIER_BIT = 2
_EMERGENCY_STOP_BIT = 4
_OVER_CURRENT_BIT = 8
_SUPPLY_BIT = 16
_TOO_WARM_BIT = 32
_SENSOR_ERROR_CODE = -(1 << 31)
"""Code that a broken sensor delivers."""
_SAG_TO_NOMINAL_VOLTAGE = 0.2
"""Supply voltage after a sag, as a fraction of the nominal voltage."""
_MAX_FALL_S = 1.0
"""Longest time that is simulated after a fault until the armature rests, s."""
_HOVER_CHECK_S = 0.25
"""Time after a fault for which the armature must stay levitated if it is expected to, s."""
_REST_S = 0.02
"""Time on a stop without current after which the armature counts as at rest, s."""
_OVERLOAD_S = 0.1
_GAP_STEP_M = 10e-6


@dataclass(frozen=True)
class FaultInjection:
    """A fault, how it is injected, and what is expected."""

    name: str  # description of the fault
    # fault that must be reported; ``NONE`` if the armature must stay levitated
    expected_fault: Fault
    action: FaultAction  # function that injects the fault


@dataclass(frozen=True)
class FaultOutcome:
    """The result of a fault that is injected while the armature levitates."""

    injection: FaultInjection
    fault: Fault  # fault that was reported
    is_levitating: bool  # whether the armature stayed levitated
    seconds: float  # time from the fault until rest without current, s; NaN if it levitates
    # speed at the first contact with the rest and with the stop at the magnet, m/s; 0 if none
    rest_speed: float
    magnet_speed: float
    # largest deviation of the gap after the fault, m; NaN if the armature did not stay levitated
    max_deviation: float

    @property
    def is_as_expected(self) -> bool:
        """Whether the controller reported the expected fault, or kept the armature levitated."""
        expected_fault = self.injection.expected_fault
        return self.fault is expected_fault and self.is_levitating == (expected_fault is Fault.NONE)

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


def _fake_readings(ticks: float = math.inf, /, **readings: int | Callable[[PlantSample], int]) -> FaultAction:
    """Replace sensor readings by constants or by functions of the sample, for some ticks."""

    def change(sample: PlantSample) -> PlantSample:
        new_readings = {
            name: reading(sample) if callable(reading) else reading for name, reading in readings.items()
        }
        return replace(sample, **new_readings)

    def act(bench: BearingBench, tick: int) -> bool:
        bench.tap.change_sample = change if tick < ticks else None
        return True

    return act


def _repeat_position(bench: BearingBench, tick: int) -> bool:
    """Freeze the position reading, and step the target."""
    if tick == 0:
        bench.demand(bench.gap + _GAP_STEP_M)
        samples: list[PlantSample] = []

        def frozen(sample: PlantSample) -> PlantSample:
            samples.append(sample)
            return replace(sample, position=samples[0].position)

        bench.tap.change_sample = frozen
    return True


def _omit_ticks(bench: BearingBench, tick: int) -> bool:
    """Withhold five ticks in a row from the controller."""
    if tick == 0:
        bench.tap.ticks_to_skip = 5
        bench.advance(5)
    return True


def _lower_supply(bench: BearingBench, tick: int) -> bool:
    """Reduce the supply voltage; the board reports this after 1 ms."""
    if tick == 0:
        bench.bearing.supply *= _SAG_TO_NOMINAL_VOLTAGE
    if tick == round(1e-3 * bench.rate):
        bench.tap.change_sample = lambda sample: replace(sample, status=_SUPPLY_BIT)
    return True


def _command_stop(bench: BearingBench, tick: int) -> bool:
    if tick == 0:
        bench.command(Command.STOP)
    return True


def _send_bad_blocks(bench: BearingBench, tick: int) -> bool:
    """Send a block with a wrong checksum, then one with invalid words and a correct checksum."""
    if tick == 0:
        block_words = bench.link.read_block()
        block_words[2] ^= 0x40
        for bad_block in (block_words, set_generation(block_words, 7)):
            try:
                bench.link.write_block(bad_block)
            except RequestRefusedError:
                continue
            raise NegativeResult("the controller accepted an invalid parameter block", code="bad-block-taken")
    return True


def _swap_block(bench: BearingBench, tick: int) -> bool:
    """Activate a block with the same parameters and another generation number."""
    if tick == 0:
        bench.link.write_block(set_generation(bench.link.read_block(), 9))
    return True


def _apply_overload(bench: BearingBench, tick: int) -> bool:
    """Apply a load above the largest force for 100 ms."""
    if tick in (0, round(_OVERLOAD_S * bench.rate)):
        bench.load(1.2 * bench.max_load if tick == 0 else bench.rest_load)
    return True


def fault_injections() -> Iterator[FaultInjection]:
    """Yield every fault, with the fault that the controller must report."""
    yield FaultInjection("three samples missing", Fault.NONE, _fake_readings(3, status=_NO_SAMPLE_BIT))
    position_missing = Fault.POSITION_MISSING
    yield FaultInjection("no samples", position_missing, _fake_readings(status=_NO_SAMPLE_BIT))
    yield FaultInjection(
        "samples missing for 2 ms", position_missing, _fake_readings(40, status=_NO_SAMPLE_BIT)
    )
    code_out_of_range = round(0.95 * Q31)
    yield FaultInjection(
        "position out of range", Fault.POSITION_RANGE, _fake_readings(position=code_out_of_range)
    )

    def jumped(sample: PlantSample) -> int:
        return max(sample.position - round(0.7 * Q31), 1 + _SENSOR_ERROR_CODE)

    yield FaultInjection("position jumps", Fault.POSITION_STEP, _fake_readings(position=jumped))
    yield FaultInjection("position frozen, target stepped", Fault.POSITION_STUCK, _repeat_position)
    error_code_action = _fake_readings(current=_SENSOR_ERROR_CODE)
    code_out_of_range = round(1.9 * Q30)
    yield FaultInjection("current sensor's error code", Fault.CURRENT_RESERVED, error_code_action)
    yield FaultInjection(
        "current out of range", Fault.CURRENT_RANGE, _fake_readings(current=code_out_of_range)
    )
    current_mismatch, inverted_current = (
        Fault.CURRENT_MISMATCH,
        _fake_readings(current=lambda sample: -sample.current),
    )
    yield FaultInjection("current sensor disconnected", current_mismatch, _fake_readings(current=0))
    yield FaultInjection("current read with the wrong sign", current_mismatch, inverted_current)
    yield FaultInjection("five ticks missed", Fault.MISSED_TICK, _omit_ticks)
    yield FaultInjection("link lost", Fault.LINK_LOST, lambda bench, tick: False)
    yield FaultInjection("command stop", Fault.STOPPED, _command_stop)
    yield FaultInjection(
        "emergency stop open", Fault.EMERGENCY_STOP, _fake_readings(status=_EMERGENCY_STOP_BIT)
    )
    yield FaultInjection("supply sags to a fifth", Fault.SUPPLY, _lower_supply)
    yield FaultInjection("winding too warm", Fault.TOO_WARM, _fake_readings(status=_TOO_WARM_BIT))
    yield FaultInjection("amplifier reports a fault", Fault.AMPLIFIER, _fake_readings(status=_AMPLIFIER_BIT))
    yield FaultInjection("over-current", Fault.OVER_CURRENT, _fake_readings(status=_OVER_CURRENT_BIT))
    yield FaultInjection("bad parameter blocks", Fault.NONE, _send_bad_blocks)
    yield FaultInjection("another block swapped in", Fault.NONE, _swap_block)
    yield FaultInjection("overload for 100 ms", Fault.NONE, _apply_overload)


class FaultRuns:
    """Runs of all faults in one session, one after another: lift, hover, inject, monitor, recover."""

    def __init__(self, setup: BearingSetup, bench: BearingBench) -> None:
        self.setup = setup
        self.running = bench
        self._gap = setup.rig.settings.gap_m
        self._supply = bench.bearing.supply
        self._is_first = True

    def run(self, injection: FaultInjection) -> FaultOutcome:
        """Inject a fault while the armature levitates, and return the outcome."""
        self._lift_to_hover()
        outcome = self._monitor(injection)
        self._recover(outcome)
        return outcome

    def _ticks(self, seconds: float) -> int:
        return round(seconds * self.running.rate)

    def _lift_to_hover(self) -> None:
        """Lift off. After the first fault, the controller continues with its hysteresis state."""
        bench = self.running
        bench.load(bench.rest_load)
        if bench.state is not State.READY:
            bench.advance(self._ticks(0.005))
            bench.command(Command.DEMAGNETISED if self._is_first else Command.ARM)
        self._is_first = False
        bench.demand(self._gap)
        bench.advance(1)
        bench.command(Command.LIFT)
        bench.advance(self._ticks(MIN_LIFT_S))
        phase = Phase(bench.link.status().codes.phase)
        if bench.state is not State.RUN or phase is not Phase.HOVER:
            raise NegativeResult(
                f"the armature does not hover before a fault: state {bench.state.name.lower()}, "
                f"phase {phase.name.lower()}, fault {bench.fault.name.lower()}",
                code="does-not-hover",
            )

    def _monitor(self, injection: FaultInjection) -> FaultOutcome:
        bench, body = self.running, self.setup.rig.settings.body
        begin_gap, rest_ticks = bench.gap, 0
        rest_speed = magnet_speed = max_deviation = 0.0
        is_free, speed = True, 0.0
        seconds = math.nan
        for tick in range(
            self._ticks(_HOVER_CHECK_S if injection.expected_fault is Fault.NONE else _MAX_FALL_S)
        ):
            bench.sends_heartbeat = injection.action(bench, tick)
            signals = bench.step()
            gap = signals["gap"]
            is_on_rest = gap >= body.stop_high_m
            is_on_stop = is_on_rest or gap <= body.stop_low_m
            if is_free and is_on_rest:
                rest_speed = rest_speed or speed
            elif is_free and is_on_stop:
                magnet_speed = magnet_speed or speed
            is_free, speed = not is_on_stop, abs(signals["velocity"])
            max_deviation = max(max_deviation, abs(gap - begin_gap))
            rest_ticks = rest_ticks + 1 if is_on_stop and not _has_current(signals) else 0
            if rest_ticks >= _REST_S * bench.rate:
                seconds = tick / bench.rate - _REST_S
                break
        bench.sends_heartbeat = True
        levitates = bench.state is State.RUN
        max_deviation = max_deviation if levitates else math.nan
        return FaultOutcome(
            injection, bench.fault, levitates, seconds, rest_speed, magnet_speed, max_deviation
        )

    def _recover(self, outcome: FaultOutcome) -> None:
        """Remove the fault, then clear it in the controller or land the armature."""
        bench = self.running
        bench.tap.change_sample = None
        bench.load(bench.rest_load)
        bench.bearing.supply = self._supply
        if outcome.is_levitating:
            bench.command(Command.LAND)
        for _ in range(self._ticks(_MAX_FALL_S)):
            signals = bench.step()
            if bench.state is not State.RUN and not _has_current(signals):
                break
        bench.advance(self._ticks(0.05))
        if bench.state is State.FAULT:
            bench.command(Command.CLEAR)
            bench.advance(1)


def _has_current(signals: Mapping[str, float]) -> bool:
    """Whether any current command is nonzero."""
    return any(value for name, value in signals.items() if name.startswith("command"))
