"""A bench whose target a generator moves while time goes on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from anhyst.control.states import Command
from anhyst.dashboard.generator import Wave
from anhyst.rig.bench.protocol import Aim, Bench, Parameter, Signal
from anhyst.rig.bench.stage import AxesBench
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

_STRETCH_S = 0.001
"""Between two targets of a generator, s of the bench."""


class DrivenBench:
    """A :class:`anhyst.rig.bench.protocol.Bench` around another: generator, target and load kept."""

    def __init__(
        self, bench: Bench, refused: Callable[[str], None], happened: Callable[[str], None]
    ) -> None:
        self.rate: float = bench.rate
        self.signals: tuple[Signal, ...] = bench.signals
        self.aim: Aim = bench.aim
        self.load_most: float = bench.load_most
        self.keeps_time: bool = bench.keeps_time
        self.every: int = bench.every
        self.body = bench.body if isinstance(bench, AxesBench) else None
        self.target = bench.aim.value
        self._refused = refused
        self._happened = happened
        self.pulled: float | None = None
        self._bench = bench
        self._generator: Wave | None = None
        self._stretch = max(1, round(_STRETCH_S * bench.rate))

    @property
    def tick(self) -> int:
        """Number of the last tick."""
        return self._bench.tick

    @property
    def generator(self) -> Wave | None:
        """What is added to the target."""
        return self._generator

    def advance(self, ticks: int) -> FloatArray:
        """Go on; a generator that runs sets the target every millisecond."""
        parts, end = [], self.tick + ticks
        while self.tick < end:
            left = end - self.tick
            if self._generator is not None:
                self._follow(self._generator)
                left = min(left, self._stretch)
            parts.append(self._bench.advance(left))
            self._heed(self._bench.news())
            if self.lost:
                break
        return np.concatenate(parts)

    def _heed(self, news: Sequence[str]) -> None:
        for text in news:
            self._generator = None
            self.target = self._bench.aim.value
            self._happened(text)

    @property
    def lost(self) -> str:
        """Why the controller is looked for; empty while it answers."""
        return self._bench.lost

    def news(self) -> Sequence[str]:
        """Return nothing: it was said already."""
        return ()

    def _follow(self, generator: Wave) -> None:
        try:
            if self.tick + 1 - generator.begin > generator.lasts * self.rate:
                self.generate(None)
                self._refused("it is over")
            else:
                self._bench.demand(self.target + generator.at(self.tick + 1, self.rate))
        except InputError as refused:
            self._generator = None
            self._refused(str(refused))

    def generate(self, generator: Wave | None) -> None:
        """Start a generator around the target, or stop it and go back to the target."""
        if generator is not None:
            self._check(self.target, generator)
        elif self._generator is None:
            return
        self._bench.demand(self.target)
        self._generator = generator

    def _check(self, target: float, generator: Wave) -> None:
        aim, (least, most) = self.aim, generator.swing
        if not aim.low <= target + least <= target + most <= aim.high:
            raise InputError(
                f"generator: {target + least:g} to {target + most:g} {aim.unit} is not within "
                f"{aim.low:g} to {aim.high:g} {aim.unit}; set a target in between, or take less",
                code="out-of-range",
                key="generator",
            )

    def demand(self, value: float) -> None:
        """Set the target, m or N; a generator goes on around it."""
        if self._generator is not None:
            self._check(value, self._generator)
        self._bench.demand(value)
        self.target = value

    def load(self, force: float) -> None:
        """Command a force to the load drive, N."""
        self._bench.load(force)
        self.pulled = force

    def command(self, command: Command) -> None:
        """Give a command. A stop ends the generator too, and a run of force begins at zero."""
        if command is Command.STOP:
            self._generator = None
        self._bench.command(command)
        if command is Command.RUN:
            self.target = 0.0

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
