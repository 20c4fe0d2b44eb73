"""The virtual bench of a bearing: its plant, and the firmware that levitates it as a process."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from anhyst.control.states import Command
from anhyst.rig.bearing.board import BearingPlant, firmware_run
from anhyst.rig.bearing.setup import Setup
from anhyst.rig.bench.protocol import Parameter, Signal
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

_SIGNALS = (
    Signal("gap", "m", "true gap"),
    Signal("reference", "m", "gap that is demanded"),
    Signal("velocity", "m/s", "of the gap"),
    Signal("force", "N", "of the magnets, net"),
    Signal("load", "N", "commanded to the load drive"),
    Signal("current", "A", "that flows in the first magnet"),
    Signal("command", "A", "that the controller asks for, of the first magnet"),
    Signal("command_2", "A", "likewise, of the second"),
    Signal("state", "", "of the controller: anhyst.control.states.State"),
    Signal("fault", "", "its latched reason: anhyst.control.states.Fault"),
)

_COMMANDS = (
    Command.CONDITION,
    Command.DEMAGNETISED,
    Command.LIFT,
    Command.LAND,
    Command.STOP,
    Command.CLEAR,
    Command.IDLE,
    Command.ARM,
)


class BearingBench:
    """A bearing and the firmware that levitates it, in lock-step; a :class:`Bench`.

    Virtual time passes in :meth:`advance` alone: between two calls it stands still, for the
    firmware too, whose heartbeat counts ticks.

    Parameters
    ----------
    setup : Setup
        What runs, in fixed point.
    firmware : Path
        From :func:`anhyst.link.firmware.build`, for the board ``host``.
    seed : int, optional
        Of the sensors' noise; the seed of the rig file is added.
    """

    signals = _SIGNALS

    def __init__(self, setup: Setup, firmware: Path, seed: int = 0) -> None:
        self.rate = float(setup.rig.settings.timing.rate_Hz)
        self._plant = BearingPlant(setup, seed)
        self._open = ExitStack()
        self._running = self._open.enter_context(firmware_run(firmware, self._plant, "host"))
        self._target = setup.rig.settings.simulate.gap_m
        self.demand(self._target)

    @property
    def tick(self) -> int:
        """Number of the last tick."""
        return self._running.bus.tick

    def advance(self, ticks: int) -> FloatArray:
        """Compute some ticks, one after the other."""
        rows = np.empty((ticks, 1 + len(self.signals)))
        bearing = self._plant.bearing
        for row in rows:
            _, gap, velocity, first, second, state, fault = self._running.tick()
            row[:] = (
                self.tick,
                gap,
                self._target,
                velocity,
                bearing.force,
                self._plant.load,
                bearing.current,
                first,
                second,
                state,
                fault,
            )
        return rows

    def command(self, command: Command) -> None:
        """Give a command over the link."""
        self._running.command(command)

    def commands(self) -> tuple[Command, ...]:
        """Return the commands of a controller of position."""
        return _COMMANDS

    def demand(self, value: float) -> None:
        """Demand a gap, m."""
        self._running.aim(value)
        self._target = value

    def load(self, force: float) -> None:
        """Command a force to the load drive, N; positive pulls the gap open."""
        self._plant.load = force

    def parameters(self) -> tuple[Parameter, ...]:
        """Return what may be changed."""
        return ()

    def apply(self, values: Mapping[str, float]) -> int:
        """Put parameters in force."""
        for name in values:
            raise InputError(f"{name}: is no parameter of this bench")
        return self.tick + 1

    def close(self) -> None:
        """End the firmware."""
        self._open.close()
