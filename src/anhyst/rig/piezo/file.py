"""A piezo stage from its rig file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from anhyst.rig.file import RigFile
from anhyst.rig.kind_rules import read_rig_file
from anhyst.rig.piezo.stack import PiezoStage
from anhyst.support.atomic import PathLike
from anhyst.support.kinds import FileKind


@dataclass(frozen=True)
class PiezoRig:
    """A file, and the stage it describes."""

    path: Path
    settings: RigFile
    stage: PiezoStage


def read_piezo_rig(path: PathLike) -> PiezoRig:
    """Read and check the rig file of a piezo stage."""
    file = read_rig_file(path, [FileKind.PIEZO])
    stack = file.stack
    stage = PiezoStage(
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
    return PiezoRig(Path(path), file, stage)
