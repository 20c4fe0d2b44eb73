"""A piezo stage from its rig file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anhyst._core import PiezoMotion
from anhyst.rig.file import RigFile
from anhyst.rig.kind_rules import read_rig_file
from anhyst.support.atomic import PathLike
from anhyst.support.kinds import FileKind
from anhyst.support.numeric import FloatArray

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


@dataclass(frozen=True)
class PiezoRig:
    """A file, and the stage it describes."""

    path: Path
    settings: RigFile
    stage: PiezoStage


def read_piezo_rig(path: PathLike) -> PiezoRig:
    """Read and check the rig file of a piezo stage."""
    file = read_rig_file(path, [FileKind.PIEZO])
    return PiezoRig(Path(path), file, stage_of(file))


def stage_of(file: RigFile) -> PiezoStage:
    """Return the stage that a file describes."""
    stack = file.stack
    return PiezoStage(
        stroke_per_volt=stack.stroke_m_per_V,
        bend=stack.bend_m_per_V2,
        slope=stack.slope_m_per_V,
        beta=stack.beta_per_V,
        gamma=stack.gamma_per_V,
        creep_times=tuple(stack.creep_times_s),
        creep_shares=tuple(stack.creep_shares),
        resonance=file.flexure.resonance_Hz,
        damping=file.flexure.damping_ratio,
        amplifier=file.stack_amplifier.time_constant_s,
    )
