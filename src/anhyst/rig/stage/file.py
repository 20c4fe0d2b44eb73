"""The rig file of a short-stroke stage: plant, instruments, controller, and its set-points.

Everything is SI and the unit stands in the key. Every key is described in docs/tracking.md.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from anhyst.compensate.interface import NumberFormat
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.tables import (
    MOST_SEED,
    AmplifierTable,
    BearingTable,
    CurrentSensorTable,
    HallTable,
    LoadTable,
    MagnetTable,
    MechanicsTable,
    PositionTable,
    SimulateTable,
    Spread,
    TimingTable,
)
from anhyst.rig.loop_files import FileList, Measured, identify_faults
from anhyst.rig.tables import ForceSensorTable, MeasurementTable, RigTable
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.toml_file import (
    FileFault,
    NotNegative,
    Positive,
    Table,
    faults_error,
    read_toml,
)

Peaks = Annotated[list[Positive], Field(min_length=2)]
NumberSeeds = Annotated[int, Field(ge=2, le=1000)]


class TrackingTable(Table):
    """``[tracking]``: controller, set-points, and what is measured."""

    format: NumberFormat = "fixed"
    crossover_Hz: Positive
    force_max_N: Positive
    position_noise_m: NotNegative
    stray_m: NotNegative = 0.0
    speed_m_per_s: Positive
    cruise_s: Positive
    jerk_phase_s: Positive
    snap_phase_s: Positive
    train_m_per_s2: Peaks
    test_m_per_s2: Peaks
    slit_s: Positive
    noise_seeds: NumberSeeds = 3

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if not 2.0 * self.snap_phase_s <= self.jerk_phase_s:
            raise InputError(
                "snap_phase_s must be at most half of jerk_phase_s; correct them",
                code="phases-too-long",
            )
        for peak in (*self.train_m_per_s2, *self.test_m_per_s2):
            if self.speed_m_per_s / peak < self.jerk_phase_s:
                raise InputError(
                    f"{peak:g} m/s2 are not reached before speed_m_per_s is; lower them or "
                    "shorten jerk_phase_s",
                    code="not-reached",
                )
        if self.slit_s >= self.cruise_s:
            raise InputError("slit_s must be shorter than cruise_s; correct them", code="too-long")
        return self


class CalibrationTable(Table):
    """``[calibration]``: standard deviations of what the controller may be wrong about."""

    gap_zero_m: NotNegative = 1e-6
    current_percent: Spread = 0.5
    pinning_percent: Spread = 10.0
    hall_percent: Spread = 0.5
    eddy_s: NotNegative = 25e-6


class ShortStrokeTable(RigTable):
    """The whole file."""

    format: Literal["anhyst-stage"]
    seed: Annotated[int, Field(ge=0, lt=MOST_SEED)]
    loops: FileList
    timing: TimingTable
    magnet: MagnetTable
    amplifier: AmplifierTable
    mechanics: MechanicsTable
    gap_sensor: PositionTable
    current_sensor: CurrentSensorTable
    force_sensor: ForceSensorTable
    hall_probe: HallTable | None = None
    measurement: MeasurementTable
    tracking: TrackingTable
    calibration: CalibrationTable = Field(default_factory=CalibrationTable)


@dataclass(frozen=True)
class StageRig:
    """A stage as its file describes it."""

    path: Path  # the rig file
    settings: ShortStrokeTable  # what it says

    @property
    def gap(self) -> float:
        """Of either magnet with the mass in the middle, m."""
        total = self.settings.magnet.gap_total_m
        assert total is not None
        return 0.5 * total

    @property
    def idle(self) -> float:
        """What either magnet pulls with where no net force is wanted, N."""
        force = self.settings.magnet.bias_force_N
        assert force is not None
        return force

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.settings.timing.rate_Hz

    @property
    def measured(self) -> Measured:
        """The loops that its file names."""
        settings = self.settings
        return Measured(self.path, ("loops",), tuple(settings.loops), settings.identify)

    @cached_property
    def bearing(self) -> BearingRig:
        """The plant: a pair without load or weight, seen from the long stroke."""
        settings = self.settings
        return BearingRig(
            self.path,
            BearingTable(
                format="anhyst-bearing",
                version=1,
                name=settings.name,
                seed=settings.seed,
                loops=settings.loops,
                identify=settings.identify,
                timing=settings.timing,
                magnet=settings.magnet,
                amplifier=settings.amplifier,
                mechanics=settings.mechanics,
                load=LoadTable(
                    force_N=0.0, bandwidth_Hz=1.0, encoder_step_m=0.0, velocity_bandwidth_Hz=1.0
                ),
                position_sensor=settings.gap_sensor,
                current_sensor=settings.current_sensor,
                force_sensor=settings.force_sensor,
                hall_probe=settings.hall_probe,
                measurement=settings.measurement,
                simulate=SimulateTable(gap_m=self.gap, steps_m=[1e-6], hold_s=1.0),
            ),
        )


def read_stage(path: PathLike) -> StageRig:
    """Read the rig file of a stage."""
    place = Path(path)
    settings = read_toml(place, ShortStrokeTable)
    faults = identify_faults(settings.identify)
    if settings.magnet.arrangement != "pair":
        faults.append(
            FileFault(
                ("magnet", "arrangement"),
                'a stage has two magnets; write "pair"',
                code="not-a-pair",
            )
        )
    if settings.magnet.from_loops:
        faults.append(
            FileFault(
                ("magnet", "iron"),
                "a stage needs its iron; write a table [magnet.iron]",
                code="missing",
            )
        )
    if faults:
        raise faults_error(place, faults)
    return StageRig(place, settings)
