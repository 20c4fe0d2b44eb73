"""Simulate a levitated mass below a single-valued magnet, with its controllers, for tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from anhyst._core import (
    FixedForceController,
    FixedPosition,
    ForceController,
    ForceControllerF32,
    Position,
    PositionF32,
)
from anhyst.control import Levitation, Pidd2, PositionControl, PositionLimits, ReferenceConverter, design
from anhyst.support.block_words import Scales
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Phase, State

RATE = 20e3
MASS, LOAD = 2.0, 150.0
REST, TARGET, CEILING = 0.55e-3, 0.45e-3, 0.35e-3
CONSTANT = 150.0 * (0.45e-3 / 2.25) ** 2  # N m^2/A^2
FORMATS: tuple[NumberFormat, ...] = ("f64", "f32", "fixed")
SCALES = Scales(demand=300.0, current=5.0, gap_low=0.3e-3, gap_high=0.6e-3)
Q31 = 2.0**31
Tick = tuple[float, float, float, float, int, int]
AnyPosition = Position | PositionF32 | FixedPosition

GAINS = design(MASS, 120.0, 1.0, 0.0)
CONTROL = PositionControl(
    pidd2=Pidd2(
        rate=RATE,
        K_p=GAINS.K_p,
        K_i=GAINS.K_i,
        K_d=GAINS.K_d,
        K_load=1.0,
        cutoff=2000.0,
        cutoff_2=2000.0,
        weight=0.3,
        low=0.0,
        high=300.0,
    ),
    levitation=Levitation(
        detect=2e-6, rise_speed=2e-3, descend_speed=2e-3, lift_rate=1000.0, set_down_rate=1000.0
    ),
    limits=PositionLimits(
        gap_low=0.33e-3,
        gap_high=0.57e-3,
        step=20e-6,
        current_low=0.0,
        current_high=4.5,
        release=45.0,
        max_missing_samples=3,
        hold=200,
    ),
    converter=ReferenceConverter(0.0, 4.5, 16),
    scales=SCALES,
    load_full_scale=200.0,
)
PAIR = replace(
    CONTROL,
    pidd2=replace(CONTROL.pidd2, low=-150.0, high=150.0),
    bias=75.0,
    gap_total=0.9e-3,
    scales=SCALES,
    load_full_scale=200.0,
)


def force(current: float, gap: float) -> float:
    """Force of the magnet, N."""
    return CONSTANT * (current / gap) ** 2


def table() -> FloatArray:
    """Exact inverse of the force at every entry: current over gap and force."""
    forces = np.linspace(0.0, SCALES.demand, 257)
    gaps = np.linspace(SCALES.gap_low, SCALES.gap_high, 33)
    return np.asarray(np.sqrt(forces / CONSTANT) * gaps[:, None])


def make_drive(number_format: NumberFormat) -> ForceController | ForceControllerF32 | FixedForceController:
    if number_format == "fixed":
        words = np.round(table() / SCALES.current * 2.0**15).clip(max=2**15 - 1)
        return FixedForceController.map(words.astype(np.int16), 0, 2**31 - 1)
    kind = ForceController if number_format == "f64" else ForceControllerF32
    return kind.map(table(), 0.0, SCALES.demand, SCALES.gap_low, SCALES.gap_high, 0.0, 5.0)


def make(number_format: NumberFormat, control: PositionControl = CONTROL) -> AnyPosition:
    """Return a controller in its initial state."""
    kinds = {"f64": Position, "f32": PositionF32, "fixed": FixedPosition}
    magnets = 1 if control.gap_total is None else 2
    drives = [make_drive(number_format) for _ in range(magnets)]
    settings = dict(control.settings(number_format))
    made = kinds[number_format](control.gains(number_format), drives, settings)
    assert isinstance(made, (Position, PositionF32, FixedPosition))
    return made


@dataclass
class Rig:
    """Mass between two stops; the currents follow their references after one tick."""

    controller: AnyPosition
    load: float = LOAD
    gap_total: float | None = None
    gap: float = REST
    speed: float = 0.0
    current: tuple[float, float] = (0.0, 0.0)
    hidden: Callable[[float], float] = lambda gap: gap  # measured gap

    def tick(self, target: float = TARGET, command: int = 0, feed: float = 0.0) -> Tick:
        """Run the controller for a tick, and then the mass."""
        answer = self.controller.tick(self.hidden(self.gap), target, feed, self.current, command=command)
        pull = force(self.current[0], self.gap)
        if self.gap_total is not None:
            pull -= force(self.current[1], self.gap_total - self.gap)
        self.speed += (self.load - pull) / MASS / RATE
        self.gap += self.speed / RATE
        if not CEILING < self.gap < REST:
            self.gap, self.speed = min(max(self.gap, CEILING), REST), 0.0
        self.current = (answer[0], answer[1])
        return answer

    def run(self, ticks: int, target: float = TARGET, command: int = 0) -> list[Tick]:
        """Run several ticks; the command is given in the first one."""
        return [self.tick(target, command if i == 0 else 0) for i in range(ticks)]

    def hover(self, ticks: int = 9000) -> list[Tick]:
        """Run from power-on to levitation."""
        rows = self.run(30)
        rows += self.run(10, command=Command.DEMAGNETISED)
        rows += self.run(ticks, command=Command.LIFT)
        assert place(rows[-1]) == (State.RUN, Phase.HOVER)
        return rows


def place(answer: Tick) -> tuple[State, Phase]:
    return State(answer[4] // 16), Phase(answer[4] % 16)


def path(rows: list[Tick]) -> list[tuple[State, Phase]]:
    """Return states and phases in the order in which they occurred."""
    places = [place(row) for row in rows]
    return [now for i, now in enumerate(places) if i == 0 or now != places[i - 1]]


def words(control: PositionControl = CONTROL) -> Mapping[str, float]:
    return control.settings("fixed")


def codes(value: float, one: float) -> int:
    """Return the nearest q31 of a number, as the adapter of a loop does; 0 for NaN."""
    if math.isnan(value):
        return 0
    scaled = value / one * Q31 + 0.5
    if math.isinf(scaled):
        return -(2**31) if scaled < 0 else 2**31 - 1
    return max(-(2**31), min(2**31 - 1, math.floor(scaled)))
