"""A piezo stack that pushes a flexure stage: hysteresis, creep and a resonance.

The equations stand in ``plant/include/anhyst_plant/piezo.h``, which runs them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from anhyst._core import PiezoMotion
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

    def motion(self, dt: float) -> PiezoMotion:
        """Return the stage for ticks of a length, s, on which a command is held."""
        steps = max(1, math.ceil(dt / STEP))
        numbers = {
            "stroke_per_volt": self.stroke_per_volt,
            "bend": self.bend,
            "slope": self.slope,
            "beta": self.beta,
            "gamma": self.gamma,
            "omega": 2.0 * math.pi * self.resonance,
            "damping": self.damping,
            "kept": math.exp(-dt / steps / self.amplifier),
            "step": dt / steps,
            "steps": steps,
        }
        return PiezoMotion(numbers, np.array(self.creep_times), np.array(self.creep_shares))

    def run(self, command: FloatArray, dt: float) -> FloatArray:
        """Return the displacement over a command that holds for each sample, from long rest at 0 V."""
        return self.motion(dt).run(np.ascontiguousarray(command))
