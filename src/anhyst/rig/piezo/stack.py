"""A piezo stack that pushes a flexure stage: hysteresis, creep and a resonance.

None of it is a law of the package. The stack wants to be longer by::

    z = d*u + b*u**2 - h,       dh = a*du - beta*|du|*h - gamma*du*|h|        (Bouc and Wen)
    free = z + sum_j w_j s_j,   ds_j/dt = (z - s_j)/T_j

and pushes the stage through its own stiffness::

    m x'' + c x' + k x = k*free,   u' = (command - u)/T_amplifier
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from anhyst.support.arrays import FloatArray

STEP = 25e-6
"""Longest step of the integration, s: a fortieth of the period of 1 kHz."""


@dataclass(frozen=True)
class PiezoStage:
    """Numbers of a stack and its stage, SI."""

    stroke_per_volt: float  # of the free stack without hysteresis, m/V and m/V^2
    bend: float
    slope: float  # bouc and Wen: initial slope of the hysteretic part, m/V, and its two rates, 1/V
    beta: float
    gamma: float
    creep_times: tuple[float, ...]  # s, and parts of what the stack does at once
    creep_shares: tuple[float, ...]
    resonance: float  # of the stage with the stack, Hz, and as a ratio
    damping: float
    amplifier: float  # time constant, s

    def run(self, command: FloatArray, dt: float) -> FloatArray:
        """Return the displacement over a command that holds for each sample, from long rest at 0 V."""
        stage = StageMotion(self, dt)
        found = np.empty(command.size)
        for i, value in enumerate(command.tolist()):
            found[i] = stage.x
            stage.step(value)
        return found


class StageMotion:
    """A stage on its way, from long rest at 0 V."""

    def __init__(self, stage: PiezoStage, dt: float) -> None:
        self._stage = stage
        self._parts = max(1, math.ceil(dt / STEP))
        self._dt = dt / self._parts
        self.voltage = self._h = self.x = self._v = 0.0
        self._slow = [0.0] * len(stage.creep_times)

    def step(self, command: float) -> None:
        """Hold a command, V, for one sample."""
        s, dt = self._stage, self._dt
        w = 2.0 * math.pi * s.resonance
        kept = math.exp(-dt / s.amplifier)
        for _ in range(self._parts):
            before = self.voltage
            self.voltage = command + kept * (before - command)
            du = self.voltage - before
            h = self._h
            self._h += du * s.slope - s.beta * abs(du) * h - s.gamma * du * abs(h)
            free = s.stroke_per_volt * self.voltage + s.bend * self.voltage**2 - self._h
            for j, (time, share) in enumerate(zip(s.creep_times, s.creep_shares, strict=True)):
                self._slow[j] += dt / time * (share * free - self._slow[j])
            wanted = free + sum(self._slow)
            self._v += dt * (w * w * (wanted - self.x) - 2.0 * s.damping * w * self._v)
            self.x += dt * self._v
