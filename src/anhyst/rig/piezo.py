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

STEP = 25e-6
"""Longest step of the integration, s: a fortieth of the period of 1 kHz."""


@dataclass(frozen=True)
class PiezoRig:
    """A piezo stage as its file describes it."""

    path: Path
    settings: RigFile

    def motion(self, dt: float) -> PiezoMotion:
        """Return it at rest for ticks of a length, s, on which a command is held."""
        stack, flexure = self.settings.stack, self.settings.flexure
        steps = max(1, math.ceil(dt / STEP))
        numbers = {
            "stroke_per_volt": stack.stroke_m_per_V,
            "bend": stack.bend_m_per_V2,
            "slope": stack.slope_m_per_V,
            "beta": stack.beta_per_V,
            "gamma": stack.gamma_per_V,
            "omega": 2.0 * math.pi * flexure.resonance_Hz,
            "damping": flexure.damping_ratio,
            "kept": math.exp(-dt / steps / self.settings.stack_amplifier.time_constant_s),
            "step": dt / steps,
            "steps": steps,
        }
        return PiezoMotion(numbers, np.array(stack.creep_times_s), np.array(stack.creep_shares))


def read_piezo_rig(path: PathLike) -> PiezoRig:
    """Read and check the rig file of a piezo stage."""
    return PiezoRig(Path(path), read_rig_file(path, [FileKind.PIEZO]))
