"""The rig file of a virtual piezo stage."""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

from pydantic import model_validator

from anhyst.rig.piezo.stack import PiezoStage
from anhyst.rig.tables import ordered
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.toml_file import NotNegative, Number, Positive, Table, read_toml


class PiezoStackTable(Table):
    """``[stack]``: what the free stack does."""

    stroke_m_per_V: Positive
    bend_m_per_V2: NotNegative
    slope_m_per_V: Positive
    beta_per_V: Positive
    gamma_per_V: NotNegative
    creep_times_s: list[Positive]
    creep_shares: list[NotNegative]

    @model_validator(mode="after")
    def _alike(self) -> Self:
        if len(self.creep_times_s) != len(self.creep_shares):
            raise InputError(
                "creep_shares must hold one share for each of creep_times_s", code="length-differs"
            )
        return self


class PiezoStageTable(Table):
    """``[stage]``: mass and stiffness, by what they make."""

    resonance_Hz: Positive
    damping_ratio: Positive


class PiezoAmplifierTable(Table):
    """``[amplifier]``: of the voltage."""

    low_V: Number
    high_V: Number
    time_constant_s: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        ordered("low_V", self.low_V, "high_V", self.high_V)
        return self


class PiezoSensorTable(Table):
    """``[sensor]``: of the displacement."""

    noise_m: NotNegative
    step_m: Positive


class PiezoControlTable(Table):
    """``[control]``: an integrator beside the feedforward."""

    rate_Hz: Positive
    bandwidth_Hz: Positive


class PiezoReferenceTable(Table):
    """``[reference]``: a triangle with rounded corners."""

    stroke_m: Positive
    frequency_Hz: Positive
    low_m: NotNegative
    corner_s: Positive
    cycles: Positive


class PiezoRigTable(Table):
    """The whole file."""

    format: Literal["anhyst-piezo-stage"]
    version: Literal[1]
    name: str
    stack: PiezoStackTable
    stage: PiezoStageTable
    amplifier: PiezoAmplifierTable
    sensor: PiezoSensorTable
    control: PiezoControlTable
    reference: PiezoReferenceTable


@dataclass(frozen=True)
class PiezoRig:
    """A file, and the stage it describes."""

    path: Path
    settings: PiezoRigTable
    stage: PiezoStage


def read_piezo_rig(path: PathLike) -> PiezoRig:
    """Read and check the rig file of a piezo stage."""
    found = read_toml(path, PiezoRigTable)
    stack = found.stack
    stage = PiezoStage(
        stroke_per_volt=stack.stroke_m_per_V,
        bend=stack.bend_m_per_V2,
        slope=stack.slope_m_per_V,
        beta=stack.beta_per_V,
        gamma=stack.gamma_per_V,
        creep_times=tuple(stack.creep_times_s),
        creep_shares=tuple(stack.creep_shares),
        resonance=found.stage.resonance_Hz,
        damping=found.stage.damping_ratio,
        amplifier=found.amplifier.time_constant_s,
    )
    return PiezoRig(Path(path), found, stage)
