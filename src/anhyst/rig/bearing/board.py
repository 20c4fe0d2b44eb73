"""The firmware itself levitates the bearing: built for a board, in lock-step over the plant bus."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anhyst._core import POSITION_MAGNETS, Plant
from anhyst.control.states import Command, Fault, State
from anhyst.link.client import ControllerLink
from anhyst.link.frames import StatusAnswer, TargetRequest
from anhyst.link.plant_bus import Q31, PlantBus, Reading
from anhyst.link.process import VIRTUAL_BOARDS
from anhyst.rig.bearing.loop import Setup, position_control
from anhyst.rig.bearing.plant import current_loop, make_bearing
from anhyst.rig.loop import DROP, Scenario
from anhyst.rig.recording import of_magnets
from anhyst.support.numeric import FloatArray
from anhyst.support.progress import Progress

COLUMNS = (
    "t_s",
    "gap_m",
    "velocity_m_per_s",
    "command_A",
    *of_magnets((("command", "A"),), 2, POSITION_MAGNETS),
    "state",
    "fault",
)
"""Of the record of a run: a row a tick, all at its beginning but for the commands, the state and
the fault, which follow from it."""

_BEAT = 0.04
"""Between two requests while nothing is commanded, s; well below the timeout of the controller."""


class BearingPlant:
    """A bearing as the plant bus knows it: signals as fractions of full scale."""

    def __init__(self, setup: Setup, seed: int = 0, bearing: Plant | None = None) -> None:
        rig = setup.rig
        self.bearing = bearing or make_bearing(rig, seed)
        self.rest_load = rig.settings.load.force_N
        self.force_high = setup.controller.limits.force_high_N
        self.supply = rig.settings.amplifier.supply
        self.load = self.rest_load
        self.inject = 0.0
        self.dropped = False
        self.shown: Callable[[Reading], Reading] | None = None
        self._scales = position_control(setup).settings("fixed")
        self._loop = current_loop(rig)
        self._integral = [0.0 for _ in rig.magnets]
        self._read = self._integral
        self._last: float | None = None

    def amperes(self, drives: tuple[float, ...]) -> tuple[float, ...]:
        """Return what fractions of full scale are, A."""
        full = self._scales["current_full"]
        return tuple(drive * full for drive in drives)

    def position_code(self, gap: float) -> int:
        """Return the code of a gap, as the controller counts positions."""
        return position_code(self._scales, gap)

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        """Go on with the currents of the tick before, and read the sensors."""
        del tick  # the bearing counts for itself
        if self._last is not None:
            self.bearing.advance(self._amplifiers(self.amperes(currents)), self._last)
        self._last = self.load
        (gap,), self._read, *_ = self.bearing.read()
        scales = self._scales
        position = (scales["gap_middle"] - (gap + self.inject)) / scales["position_full"]
        full = scales["current_full"]
        reading = Reading(
            gap=0.0,
            force=0.0,
            current=self._read[0] / full,
            further=tuple(force / full for force in self._read[1:]),
            position=math.nan if self.dropped else position,
        )
        return reading if self.shown is None else self.shown(reading)

    def _amplifiers(self, reference: tuple[float, ...]) -> list[float]:
        """Return the references, or voltages that bring them about, as the amplifiers need."""
        loop = self._loop
        volts = list(reference[: len(self._read)])
        if loop["gain"] == 0.0:
            return volts
        for i in range(len(volts)):
            error = reference[i] - self._read[i]
            voltage = loop["resistance"] * reference[i] + loop["gain"] * error + self._integral[i]
            volts[i] = min(max(voltage, -loop["limit"]), loop["limit"])
            if abs(voltage) < loop["limit"]:
                self._integral[i] += loop["reset"] * error
        return volts


def position_code(scales: Mapping[str, float], gap: float) -> int:
    """Return the code of a gap, as a controller with these scales counts positions."""
    part = (scales["gap_middle"] - gap) / scales["position_full"]
    return max(-(1 << 31), min((1 << 31) - 1, math.floor(part * Q31 + 0.5)))


@dataclass
class LevitatingFirmware:
    """A firmware in the air: what is done to it, tick by tick, and what it did."""

    plant: BearingPlant
    bus: PlantBus
    link: ControllerLink  # its session; all its commands go over it

    def __post_init__(self) -> None:
        self._beat = max(1, int(_BEAT * self.link.info.rate))
        self._since = 0
        self._target: int | None = None
        self._tick = 1.0 / self.link.info.rate

    def run(self, scenario: Scenario, progress: Progress | None = None) -> FloatArray:
        """Go on with a scenario."""
        rows = np.empty((scenario.ticks, len(COLUMNS)))
        for n in range(scenario.ticks):
            self.command(Command(int(scenario.command[n]) & 0xFF))
            self.aim(float(scenario.target[n]))
            self.plant.load = float(scenario.load[n])
            self.plant.inject = float(scenario.inject[n])
            self.plant.dropped = bool(int(scenario.command[n]) & DROP)
            rows[n] = self.tick()
            if not math.isfinite(rows[n, 1]):
                return rows[: n + 1]
            if progress is not None and n % 1000 == 0:
                progress(n, scenario.ticks)
        return rows

    def command(self, command: Command) -> None:
        """Give a command over the link; ``NONE`` is nothing."""
        if command is not Command.NONE:
            self.link.command(command)
            self._since = 0

    def aim(self, gap: float) -> None:
        """Give the controller its target, if it is another place than before."""
        code = self.plant.position_code(gap)
        if code != self._target:
            self.link.request(TargetRequest(code), StatusAnswer)
            self._target, self._since = code, 0

    def tick(self, beats: bool = True) -> tuple[float, ...]:
        """Go on by one tick; without beats the link stays silent."""
        self._since += 1
        if beats and self._since >= self._beat:
            self.link.status()
            self._since = 0
        time = self.bus.tick * self._tick
        self.bus.step()
        bearing, bus = self.plant.bearing, self.bus
        commands = self.plant.amperes(bus.drives)
        return time, bearing.gap, bearing.velocity, *commands, bus.state, bus.fault

    @property
    def state(self) -> State:
        """Of the controller after the last tick."""
        return self.bus.state

    @property
    def fault(self) -> Fault:
        """Its reason."""
        return self.bus.fault


@contextmanager
def firmware_run(firmware: Path, plant: BearingPlant, board: str) -> Iterator[LevitatingFirmware]:
    """Start the firmware of a bearing and open its link."""
    with VIRTUAL_BOARDS[board](firmware, plant) as running, ControllerLink(running.link) as link:
        yield LevitatingFirmware(plant, running.bus, link)
