"""A demand, and a controller at work on it: its firmware over the serial link, in lock-step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anhyst.control.states import Command, Fault, State
from anhyst.link.client import ControllerLink
from anhyst.link.plant_bus import PlantBus, Reading
from anhyst.link.process import VIRTUAL_BOARDS
from anhyst.rig.case_table import ForceCase, MovingCase
from anhyst.rig.force.bench import ActuatorBench
from anhyst.rig.force.programs import ONE, Program, Session
from anhyst.rig.recording import Recording
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import NegativeResult

LEAD_IN = 0.2
"""Time in which a demand rises from zero to its first value, s; errors there do not count."""
_UP = 40
"""Ticks after power on until the self-test must have passed."""

_BETWEEN = 40
"""Ticks between two heartbeats while nothing is demanded; well below the timeout of the controller."""

_LONGEST = 200_000
"""Ticks of a start-up sequence after which something is wrong."""

_Q30 = 1 << 30


@dataclass(frozen=True)
class Demand:
    """Force wanted at every tick."""

    name: str  # for files and figures
    force: FloatArray  # N; shape (n,)
    lead_in: int  # ticks before the demand proper


def with_lead_in(name: str, force: FloatArray, rate: float) -> Demand:
    """Put a straight rise from zero before a demand."""
    ticks = round(LEAD_IN * rate)
    rise = force[0] * np.arange(ticks) / ticks
    return Demand(name, np.concatenate([rise, force]), ticks)


def triangle(shape: ForceCase, force_max: float, rate: float) -> Demand:
    """Return a triangle, beginning and ending at its low turning point."""
    half = max(1, round(0.5 * shape.period_s * rate))
    phase = np.arange(2 * half * shape.cycles + 1) / half
    height = 1.0 - np.abs(phase % 2.0 - 1.0)
    force = force_max * (shape.low + (shape.high - shape.low) * height)
    return with_lead_in(shape.name, force, rate)


def moving_gap(shape: MovingCase, ticks: int, rate: float) -> FloatArray:
    """Return a sinusoidal motion that begins at rest at its low end, m, shape (ticks,)."""
    phase = 2.0 * np.pi * np.arange(ticks) / (rate * shape.period_s)
    share: FloatArray = 0.5 - 0.5 * np.cos(phase)
    return shape.low_m + (shape.high_m - shape.low_m) * share


class _Plant:
    """The bench as the plant bus knows it: signals as fractions of full scale."""

    def __init__(self, bench: ActuatorBench, program: Program) -> None:
        self.bench = bench
        self.gaps: list[int] = []
        self.drives: list[int] = []
        self._scales = program.scales
        self._span = program.scales.gap_high - program.scales.gap_low or 1.0

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        del tick  # the bench counts for itself
        current = currents[0]
        if self.gaps:
            self.drives.append(round(current * ONE))
        reading = self.bench.step(current * self._scales.current)
        gap = (reading.gap - self._scales.gap_low) / self._span
        code = min(max(round(gap * _Q30), 0), _Q30)
        self.gaps.append(min(2 * code, ONE - 1))  # as the firmware takes it
        return Reading(
            gap, reading.force / self._scales.demand, reading.current / self._scales.current
        )


def run_firmware(
    program: Program, bench: ActuatorBench, demand: Demand, board: str, demagnetised: bool
) -> tuple[Recording, Session]:
    """Run a demand through a firmware: one command over the link at every tick."""
    plant = _Plant(bench, program)
    codes = program.demand_codes(demand.force)
    with (
        VIRTUAL_BOARDS[board](program.firmware, plant) as running,
        ControllerLink(running.link) as controller,
    ):
        bus = running.bus
        _get_ready(controller, bus, demagnetised)
        controller.command(Command.RUN)
        first = len(plant.gaps)
        bench.begin()
        for code in codes.tolist():
            controller.demand(code)
            bus.step()
        if controller.status().state is not State.RUN:
            raise NegativeResult(
                f"the controller left its run for {_state(bus)}", code="wrong-state"
            )
        last = bus.drive
    plant.drives.append(round(last * ONE))
    session = Session(
        np.array(plant.gaps, dtype=np.int64),
        np.array(plant.drives, dtype=np.int64),
        codes,
        first,
        demagnetised,
    )
    return bench.recording(last * program.scales.current), session


def _get_ready(controller: ControllerLink, bus: PlantBus, demagnetised: bool) -> None:
    """Take a controller from power on to ready."""
    bus.step(_UP)
    if demagnetised:
        controller.command(Command.DEMAGNETISED)
        return
    controller.command(Command.CONDITION)
    end = bus.tick + _LONGEST
    while bus.state is not State.READY:
        if bus.state is State.FAULT or bus.tick > end:
            raise NegativeResult(
                f"the controller did not get ready: it is in {_state(bus)}", code="wrong-state"
            )
        bus.step(_BETWEEN)
        controller.status()


def _state(bus: PlantBus) -> str:
    reason = "" if bus.fault is Fault.NONE else f", reason {bus.fault.name.lower()}"
    return f"state {bus.state.name.lower()}{reason}"
