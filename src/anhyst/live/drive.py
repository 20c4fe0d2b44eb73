"""A bench whose target a generator moves while time goes on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from anhyst.control.states import Command
from anhyst.live.generator import Generator
from anhyst.rig.bench.protocol import Bench, Parameter, Signal
from anhyst.support.arrays import FloatArray

_STRETCH_S = 0.001
"""Between two targets of a generator, s of the bench."""


class DrivenBench:
    """A :class:`anhyst.rig.bench.protocol.Bench` around another: generator, target and load kept.

    Parameters
    ----------
    bench : Bench
        What does the work.
    target : float, optional
        With which it was opened.

    Attributes
    ----------
    target : float or None
        Last target, m or N; None before the first.
    pulled : float or None
        Last force commanded to the load drive, N; None before the first.
    """

    def __init__(self, bench: Bench, target: float | None = None) -> None:
        self.rate: float = bench.rate
        self.signals: tuple[Signal, ...] = bench.signals
        self.target = target
        self.pulled: float | None = None
        self._bench = bench
        self._generator: Generator | None = None
        self._stretch = max(1, round(_STRETCH_S * bench.rate))

    @property
    def tick(self) -> int:
        """Number of the last tick."""
        return self._bench.tick

    @property
    def generator(self) -> Generator | None:
        """What is added to the target."""
        return self._generator

    def advance(self, ticks: int) -> FloatArray:
        """Go on; a generator that runs sets the target every millisecond."""
        generator, target = self._generator, self.target
        if generator is None or target is None:
            return self._bench.advance(ticks)
        parts = []
        while ticks > 0:
            self._bench.demand(target + generator.at(self.tick + 1, self.rate))
            parts.append(self._bench.advance(min(ticks, self._stretch)))
            ticks -= self._stretch
        return np.concatenate(parts)

    def generate(self, generator: Generator | None) -> None:
        """Start a generator around the target, or stop it and go back to the target.

        Raises
        ------
        InputError
            The bench refuses the target.
        """
        self._generator = generator
        if generator is None and self.target is not None:
            self._bench.demand(self.target)

    def demand(self, value: float) -> None:
        """Set the target, m or N; a generator goes on around it."""
        self._bench.demand(value)
        self.target = value

    def load(self, force: float) -> None:
        """Command a force to the load drive, N."""
        self._bench.load(force)
        self.pulled = force

    def command(self, command: Command) -> None:
        """Give a command."""
        self._bench.command(command)

    def commands(self) -> tuple[Command, ...]:
        """Return the commands that there are."""
        return self._bench.commands()

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all that may be changed."""
        return self._bench.parameters()

    def apply(self, values: Mapping[str, float]) -> int:
        """Put parameters in force together; returns the first tick that uses them."""
        return self._bench.apply(values)

    def close(self) -> None:
        """Let go of the rig."""
        self._bench.close()
