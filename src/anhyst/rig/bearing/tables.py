"""The tables of a bearing's rig file: what each may hold.

Everything is SI and the unit stands in the key. Every key is described in docs/rig-file.md.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from anhyst.rig.loop_files import FileList
from anhyst.rig.magnet_table import ElectromagnetTable
from anhyst.rig.tables import (
    ForceSensorTable,
    MeasurementTable,
    RigTable,
    ShuntTable,
    ordered,
)
from anhyst.support.errors import InputError
from anhyst.support.toml_file import Bits, NotNegative, Number, Positive, Table

MOST_SEED = 1 << 31
"""Seeds are below it."""
GainError = Annotated[float, Field(gt=-0.5, lt=0.5)]
Spread = Annotated[float, Field(ge=0.0, le=30.0)]


class TimingTable(Table):
    """``[timing]``: when what happens."""

    rate_Hz: Annotated[float, Field(ge=100.0, le=200e3)]
    substeps: Annotated[int, Field(ge=1, le=64)] = 4
    delay_ticks: Annotated[float, Field(ge=0.0, le=8.0)] = 1.0

    @model_validator(mode="after")
    def _whole(self) -> Self:
        steps = self.delay_ticks * self.substeps
        if abs(steps - round(steps)) > 1e-9:
            raise InputError(
                f"delay_ticks of {self.delay_ticks} is no whole number of sub-steps of "
                f"1/{self.substeps} tick; correct one of them",
                code="delay-not-whole",
            )
        return self


class MagnetModelTable(Table):
    """``[magnet.model]``: the identified law that makes the force."""

    file: str
    flux_table: str | None = None


class MagnetTable(ElectromagnetTable):
    """``[magnet]``: winding, poles, and what the iron does."""

    arrangement: Literal["single", "pair"] = "single"
    force: Literal["cells", "model"] = "cells"
    eddy_time_s: NotNegative = 0.0
    gap_total_m: Positive | None = None
    bias_force_N: Positive | None = None
    model: MagnetModelTable | None = None

    @model_validator(mode="after")
    def _complete(self) -> Self:
        for key, value in (("gap_total_m", self.gap_total_m), ("bias_force_N", self.bias_force_N)):
            if self.arrangement == "pair" and value is None:
                raise InputError(f"a pair needs {key}; add it", code="missing")
            if self.arrangement == "single" and value is not None:
                raise InputError(
                    f'{key} belongs to a pair; remove it or write arrangement "pair"',
                    code="pair-only",
                )
        if self.force == "cells" and self.iron is None:
            raise InputError('force "cells" needs the table [magnet.iron]; add it', code="missing")
        if self.force == "model" and self.model is None:
            raise InputError('force "model" needs the table [magnet.model]; add it', code="missing")
        if self.model is not None and self.model.flux_table is None and self.iron is None:
            raise InputError(
                "a model without flux_table needs the table [magnet.iron]; add one", code="missing"
            )
        return self


class AmplifierTable(Table):
    """``[amplifier]``: the power stage, one for each coil."""

    mode: Literal["current", "voltage"] = "current"
    supply_V: Positive
    bandwidth_Hz: Positive
    current_low_A: Number = 0.0
    current_high_A: Positive
    dac_bits: Bits
    delay_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        ordered("current_low_A", self.current_low_A, "current_high_A", self.current_high_A)
        return self


class MechanicsTable(Table):
    """``[mechanics]``: the armature and its guide."""

    mass_kg: Positive
    stop_low_m: Positive
    stop_high_m: Positive
    damping_N_s_per_m: NotNegative = 0.0
    gravity_m_per_s2: Number = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        ordered("stop_low_m", self.stop_low_m, "stop_high_m", self.stop_high_m)
        return self


class DisturbanceTable(Table):
    """``[[load.disturbance]]``: a force beside the commanded one."""

    kind: Literal["step", "sine", "noise"]
    force_N: Number
    frequency_Hz: Positive | None = None
    start_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.kind == "step" and self.frequency_Hz is not None:
            raise InputError("a step has no frequency_Hz; remove it", code="not-for-a-step")
        if self.kind != "step" and self.frequency_Hz is None:
            raise InputError(f"a {self.kind} needs frequency_Hz; add it", code="missing")
        return self


class LoadTable(Table):
    """``[load]``: the load drive, which pulls the gap open."""

    force_N: Number
    bandwidth_Hz: Positive
    damping_N_s_per_m: Number = 0.0
    stiffness_N_per_m: Number = 0.0
    encoder_step_m: NotNegative
    velocity_bandwidth_Hz: Positive
    disturbance: list[DisturbanceTable] = Field(default_factory=list)


@dataclass(frozen=True, slots=True)
class PositionSensor:
    """A sensor of the gap with nothing left open."""

    low: float  # range, m
    high: float
    step: float  # resolution, m
    noise: float  # standard deviation before that, m
    bandwidth: float  # of -3 dB, Hz
    delay: float  # s


class PositionTable(Table):
    """``[position_sensor]``: what is left out, the kind of sensor says."""

    kind: Literal["encoder", "capacitive", "laser", "lvdt"]
    low_m: NotNegative
    high_m: Positive
    step_m: Positive | None = None
    adc_bits: Bits | None = None
    noise_m: NotNegative | None = None
    bandwidth_Hz: Positive | None = None
    delay_s: NotNegative | None = None
    gain_error: GainError = 0.0
    offset_m: Number = 0.0

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        ordered("low_m", self.low_m, "high_m", self.high_m)
        if self.step_m is not None and self.adc_bits is not None:
            raise InputError(
                "step_m and adc_bits both say the resolution; keep one", code="both-given"
            )
        return self

    def sensor(self) -> PositionSensor:
        """Return it with the values that its kind has where none are given."""
        usual = POSITION_SENSORS[self.kind]
        step = self.step_m or (0.0 if self.adc_bits else usual.step)
        bits = self.adc_bits or LVDT_BITS
        return PositionSensor(
            low=self.low_m,
            high=self.high_m,
            step=step or (self.high_m - self.low_m) / ((1 << bits) - 1),
            noise=usual.noise if self.noise_m is None else self.noise_m,
            bandwidth=self.bandwidth_Hz or usual.bandwidth,
            delay=usual.delay if self.delay_s is None else self.delay_s,
        )


LVDT_BITS = 16
"""Converter behind an LVDT, which unlike the others has no step of its own."""
POSITION_SENSORS = {
    "encoder": PositionSensor(0.0, 0.0, 50e-9, 5e-9, 20e3, 0.0),
    "capacitive": PositionSensor(0.0, 0.0, 1e-9, 5e-9, 5e3, 0.0),
    "laser": PositionSensor(0.0, 0.0, 1.25e-9, 1e-9, 50e3, 12.5e-6),
    "lvdt": PositionSensor(0.0, 0.0, 0.0, 50e-9, 500.0, 0.0),
}
"""What each kind of sensor has where the file says nothing; the range never comes from here."""


class CurrentSensorTable(ShuntTable):
    """``[current_sensor]``: the shunts, one for each coil, as the controller reads them."""

    bandwidth_Hz: Positive
    gain_error: GainError = 0.0


class HallTable(Table):
    """``[hall_probe]``: measures the flux density in the gap."""

    range_T: Positive
    adc_bits: Bits
    noise_T: NotNegative
    bandwidth_Hz: Positive
    gain_error: GainError = 0.0


class TrajectoryTable(Table):
    """One of ``simulate.trajectories``: a reference that moves all the time."""

    kind: Literal["triangle", "sine"]
    amplitude_m: Positive
    frequency_Hz: Positive


class SimulateTable(Table):
    """``[simulate]``: the test cases."""

    gap_m: Positive
    also_gaps_m: list[Positive] = Field(default_factory=list)
    steps_m: Annotated[list[Positive], Field(min_length=1)]
    hold_s: Positive
    load_steps_N: list[Number] = Field(default_factory=list)
    trajectories: list[TrajectoryTable] = Field(default_factory=list)
    noise_seeds: Annotated[int, Field(ge=2, le=10_000)] = 20


class DriftTable(Table):
    """``[drift]``: standard deviations of what changes after the controller was made."""

    pinning_percent: Spread = 10.0
    reversible_percent: Spread = 20.0
    saturation_percent: Spread = 2.0
    mass_percent: Spread = 2.0
    resistance_percent: Spread = 10.0
    sensor_gain_percent: Spread = 0.5
    gap_offset_m: NotNegative = 2e-6


class BearingTable(RigTable):
    """The whole file."""

    format: Literal["anhyst-bearing"]
    seed: Annotated[int, Field(ge=0, lt=MOST_SEED)]
    loops: FileList
    timing: TimingTable
    magnet: MagnetTable
    amplifier: AmplifierTable
    mechanics: MechanicsTable
    load: LoadTable
    position_sensor: PositionTable
    current_sensor: CurrentSensorTable
    force_sensor: ForceSensorTable
    hall_probe: HallTable | None = None
    measurement: MeasurementTable
    simulate: SimulateTable
    drift: DriftTable = Field(default_factory=DriftTable)
