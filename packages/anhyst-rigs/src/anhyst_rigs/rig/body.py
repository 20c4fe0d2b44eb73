"""Read the rig file of a bearing, and describe a body between magnets.

A stage is also a body between magnets, but with other degrees of freedom. It is a subclass.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from anhyst._core import Coil, Magnet
from anhyst.model.actuator import Model, read_model
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.toml_file import FileFault, Table, faults_error
from anhyst.support.toml_text import KeyPath
from anhyst_rigs.rig.calibration import (
    BEARING_PARAMETERS,
    CalibratedMethod,
    CalibrationFile,
    ParameterName,
    read_calibration,
)
from anhyst_rigs.rig.case_table import DisplacementCase, TrajectoryCase
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.from_loops import FittedPlant
from anhyst_rigs.rig.kind_rules import read_rig_file
from anhyst_rigs.rig.lines import LINE_AGAINST_X, LINE_ALONG_X, Coordinate, LinesOfAction
from anhyst_rigs.rig.magnet_table import LAW_KIND
from anhyst_rigs.rig.measurement_table import MeasuredLoops
from anhyst_rigs.rig.parts.magnet import (
    FluxTable,
    check_flux_range,
    make_flux_table,
    make_iron_magnet,
    make_law_magnet,
    read_flux_table,
)

MIN_HOLD_TICKS = 8
"""Smallest number of ticks between a step and the next one, so that the step can be evaluated."""
MAX_PERIOD_S = 60.0
"""Longest period of a trajectory, s."""
MIN_TICKS_PER_PERIOD = 10.0
"""A period of a trajectory must be longer than this number of ticks."""
MAX_DELAY_SUBSTEPS = 128
"""Longest delay of an output or a sensor, in sub-steps of the simulation."""
GAP_MAP_POINTS = 129
"""Number of gaps in the tabulated gap map of an identified law."""


@dataclass(frozen=True)
class BodyRig:
    """A body between magnets, described by its rig file: a bearing, or in a subclass a stage."""

    path: Path  # path of the rig file
    settings: RigFile  # content of the rig file
    # magnet that was fitted to the loops; `settings` then contains its parameters
    fitted: FittedPlant | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Omit the cached properties when the rig is sent to another process."""
        return {name: self.__dict__[name] for name in self.__dataclass_fields__}

    @property
    def gap(self) -> float:
        """Gap of the first magnet at the operating point, m."""
        return self.settings.gap_m

    @property
    def idle_force(self) -> float:
        """Force of each magnet of a pair if the net force is zero, N."""
        return self.settings.bias_N or 0.0

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.settings.timing.rate_Hz

    @property
    def loop_delay(self) -> float:
        """Time from a sample to the middle of the tick in which the resulting current flows, s."""
        return (self.settings.timing.delay_ticks + 0.5) * self.dt

    @property
    def substep(self) -> float:
        """Duration of a sub-step of the simulation, s."""
        return self.dt / self.settings.timing.substeps

    @property
    def measured_loops(self) -> MeasuredLoops:
        """Measured loops that the rig file names."""
        return MeasuredLoops(self.path, self.settings.loops, self.settings.magnet.output)

    def magnet_gaps(self, gap: FloatArray) -> list[FloatArray]:
        """Return the gaps of all magnets, m, for given gaps of the first magnet."""
        total_gap = self.settings.gap_total_m
        return [gap] if total_gap is None else [gap, total_gap - gap]

    @property
    def parameter_names(self) -> tuple[ParameterName, ...]:
        """Names of all parameters that can be estimated from the motion of the body."""
        return BEARING_PARAMETERS[len(self.settings.body_magnets)]

    @cached_property
    def lines_of_action(self) -> LinesOfAction:
        """Lines of action of all forces and sensors; the coordinate of a bearing is its first gap."""
        file, body = self.settings, self.settings.body
        pair_lines = [(LINE_AGAINST_X, 0.0), (LINE_ALONG_X, file.gap_total_m or 0.0)]
        return LinesOfAction(
            coordinates=[Coordinate(0, body.stop_low_m, body.stop_high_m, body.stop_high_m)],
            magnets=pair_lines[: len(file.body_magnets)],
            gap_sensors=[(LINE_ALONG_X, 0.0)],
            gravity=[body.gravity_m_per_s2, 0.0, 0.0],
            recorded_force_direction=LINE_AGAINST_X["d"],
            load=LINE_ALONG_X,
            load_rest_position=file.gap_m,
        )

    def method_calibration(self, method: MethodName) -> CalibratedMethod | None:
        """Return the calibration of a method from the calibration file of the rig, or None."""
        return None if self._calibration_file is None else self._calibration_file.for_method(method)

    @cached_property
    def _calibration_file(self) -> CalibrationFile | None:
        """Calibration file of the rig; it must have the same mass as the rig file."""
        if self.calibration_path is None:
            return None
        if getattr(self.settings.control, "calibrate", False):
            raise InputError(
                f"{self.path}: control.calibration: not permitted with calibrate = true; omit one of them",
                code="not-both",
                key="control.calibration",
            )
        return read_calibration(self.calibration_path, self.path, self.settings, self.parameter_names)

    def _resolve_path(self, name: str | None) -> Path | None:
        return None if name is None else self.path.parent / name

    @property
    def calibration_path(self) -> Path | None:
        """Path of the file with parameters that were estimated from motions."""
        return self._resolve_path(self.settings.calibration)

    @property
    def model_path(self) -> Path | None:
        """Path of the model file with the identified law that gives the magnet's force."""
        return self._resolve_path(self.settings.magnet.model)

    @property
    def flux_table_path(self) -> Path | None:
        """Path of the flux table of a magnet with an identified law; None if it has no table."""
        return self._resolve_path(self.settings.magnet.flux_table)

    @cached_property
    def law(self) -> Model | None:
        """Identified law that gives the force; None if the force follows from an iron."""
        if self.model_path is None:
            return None
        law = read_model(self.model_path)
        if law.layers is not None or law.eddy_circuit is not None:
            name = "layers" if law.layers is not None else "eddy_circuit"
            text = f"{self.model_path}: a virtual magnet cannot have {name}; remove [{name}]"
            raise InputError(text, code="layers-not-in-plant", key="model")
        if law.needs_fixed_gap or not law.needs_schedule or law.power != 2:
            raise InputError(
                f"{self.model_path}: a bearing needs a model from current to force for a "
                "variable gap; identify one from loops at several gaps",
                code="not-current-to-force",
            )
        return law

    @cached_property
    def flux_linkage(self) -> FluxTable:
        """Flux linkage for an identified law: measured, or computed from poles and iron."""
        file, body = self.settings, self.settings.body
        max_current = file.amplifier.current_high_A
        if self.flux_table_path is None:
            gap_range = (0.8 * body.stop_low_m, 1.2 * body.stop_high_m)
            return make_flux_table(file.magnet.poles, file.steel, 1.5 * max_current, gap_range)
        table = read_flux_table(self.flux_table_path)
        check_flux_range(self.flux_table_path, table, body.stop_low_m, body.stop_high_m, max_current)
        return table

    @cached_property
    def magnet(self) -> Magnet:
        """Magnet of the plant: an iron in its magnetic circuit, or an identified law."""
        file, table = self.settings, self.settings.magnet
        if table.kind == LAW_KIND:
            return self.make_law_magnet()
        return make_iron_magnet(table.poles, file.steel, table.eddy_time_s, file.gap_m, table.solid_iron)

    def make_law_magnet(self, law: Model | None = None) -> Magnet:
        """Return the magnet with the given law; the default is the identified law of the rig."""
        gaps, operating_gap = self.flux_linkage.gap, self.settings.gap_m
        law = law or self.law
        assert law is not None
        gaps_of_map = np.linspace(float(gaps[0]), float(gaps[-1]), GAP_MAP_POINTS)
        names = ("c_H", "rho", "c_out", "out_0", "in_0")
        rows = np.column_stack([law.interpolate_parameter(name, gaps_of_map) for name in names])
        eddy = float(law.interpolate_parameter("gamma", np.array([operating_gap]))[0])
        return make_law_magnet(
            self.settings.magnet.poles, law.iron_at(operating_gap), rows, eddy, self.flux_linkage
        )

    def static_map(self, current: FloatArray, gap: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return force, flux linkage and flux density along a quasi-static path of current and gap."""
        path = np.ascontiguousarray(current), np.ascontiguousarray(gap)
        force, linkage, density = Coil(self.magnet).run(*path).T.copy()
        return force, linkage, density

    @property
    def static_load(self) -> float:
        """Constant force that opens the gap, N: the load drive's force plus the weight."""
        return self.settings.load.force_N + self.settings.body.weight_N


def step_ends(gap: float, height: float) -> tuple[float, float]:
    """Return the upper and the lower gap of a step whose middle is a given gap.

    Thus, large steps keep their distance from both end stops, and steps up and down use the same
    gaps. The plant linearised at the given gap represents the middle of every step.
    """
    return gap + height / 2.0, gap - height / 2.0


def read_bearing(path: PathLike) -> BodyRig:
    """Read the rig file of a bearing."""
    file = Path(path)
    settings = read_rig_file(file, "levitation")
    faults = [*plant_faults(settings), *_pair_faults(settings), *_case_faults(settings)]
    if faults:
        raise faults_error(file, faults)
    return BodyRig(file, settings)


def plant_faults(file: RigFile) -> Iterator[FileFault]:
    """Find inconsistencies of the plant and its instruments."""
    yield from _delay_faults(file)
    body, stop_low, stop_high = file.body, file.body.stop_low_m, file.body.stop_high_m
    sensor = file.gap_sensor
    if not (sensor.low_m <= body.stop_low_m and stop_high <= sensor.high_m):
        text = f"its range must contain the travel, {stop_low:g} to {stop_high:g} m; widen low_m or high_m"
        yield FileFault(file.key_path(sensor), text, code="range-too-narrow")
    amplifier, shunt = file.amplifier, file.current_sensor
    if not (shunt.low_A <= amplifier.current_low_A and amplifier.current_high_A <= shunt.high_A):
        text = "its range must contain that of the amplifier; widen low_A or high_A"
        yield FileFault(file.key_path(shunt), text, code="range-too-narrow")
    lowest_reversal = min(reversal for record in file.measurement.records for reversal in record.turns)
    if min(lowest_reversal, 0.0) * file.measurement.current_max_A < min(amplifier.current_low_A, 0.0):
        text = f"the amplifier begins at {amplifier.current_low_A:g} A; raise the reversal points"
        yield FileFault(("measurement", "records"), text, code="beyond-amplifier")
    if file.measurement.current_max_A > amplifier.current_high_A:
        text = f"the amplifier ends at {amplifier.current_high_A:g} A; lower it"
        yield FileFault(("measurement", "current_max_A"), text, code="beyond-amplifier")
    if not stop_low < file.gap_m < stop_high:
        text = f"the body works at {file.gap_m:g} m, outside the travel of {stop_low:g} to {stop_high:g} m"
        key = file.key_path(file.magnet, "gap_m")
        yield FileFault(key, f"{text}; lower it or move the stops", code="outside-travel")


def _pair_faults(file: RigFile) -> Iterator[FileFault]:
    """Find wrong magnets: a bearing has one magnet that pulls, or two that oppose each other."""
    first_magnet, opposite_magnet, gap_sum = file.magnet, file.opposite, file.gap_total_m
    if first_magnet.is_bidirectional:
        text = "is bidirectional, which only a stage supports; choose another kind"
        yield FileFault(file.key_path(first_magnet, "kind"), text, code="not-for-this-kind")
    if first_magnet.direction != LINE_AGAINST_X["d"]:
        text = f"the first magnet must pull along {LINE_AGAINST_X['d']}, towards smaller gaps; correct it"
        yield FileFault(file.key_path(first_magnet, "direction"), text, code="wrong-direction")
    if opposite_magnet is None or gap_sum is None:
        return
    if opposite_magnet.direction != LINE_ALONG_X["d"]:
        text = f"a second magnet must oppose the first along {LINE_ALONG_X['d']}; correct it"
        yield FileFault(file.key_path(opposite_magnet, "direction"), text, code="wrong-direction")
    if not (stop_high := file.body.stop_high_m) < gap_sum:
        text = f"both gaps sum to {gap_sum:g} m, which must exceed stop_high_m, {stop_high:g} m, or the "
        text += "body touches the second magnet; raise it"
        yield FileFault(file.key_path(opposite_magnet, "gap_m"), text, code="range-too-narrow")


def _delay_faults(file: RigFile) -> Iterator[FileFault]:
    """Find delays that are longer than the plant can store."""
    timing, amplifier, sensor = file.timing, file.amplifier, file.gap_sensor
    per_second = timing.rate_Hz * timing.substeps
    output = timing.delay_ticks * timing.substeps + amplifier.delay_s * per_second
    for table, steps in ((amplifier, output), (sensor, sensor.delay_s * per_second)):
        if steps > MAX_DELAY_SUBSTEPS:
            text = f"is a delay of {steps:.0f} sub-steps, the plant permits {MAX_DELAY_SUBSTEPS}; "
            text += "shorten it or lower substeps"
            yield FileFault(file.key_path(table, "delay_s"), text, code="delay-too-long")


def _case_faults(file: RigFile) -> Iterator[FileFault]:
    """Find references outside the travel, and unsuitable hold times and frequencies."""
    stop_low, stop_high, step = file.body.stop_low_m, file.body.stop_high_m, file.step

    def travel_faults(
        table: Table, key: KeyPath, name: str, lowest_gap: float, highest_gap: float
    ) -> Iterator[FileFault]:
        if not (stop_low < lowest_gap and highest_gap < stop_high):
            range_text = (
                f"{highest_gap:.5g}"
                if lowest_gap == highest_gap
                else f"{lowest_gap:.5g} to {highest_gap:.5g}"
            )
            text = f"{name} is at {range_text} m, outside the travel of {stop_low:g} to {stop_high:g} m"
            text += "; lower it or move the stops"
            yield FileFault(file.key_path(table, *key), text, code="outside-travel")

    for number, gap in enumerate(step.also_gaps_m):
        yield from travel_faults(step, ("also_gaps_m", number), "the reference", gap, gap)
    for number, height in enumerate(step.heights_m):
        for gap in (gap for gap in file.step_gaps_m if stop_low < gap < stop_high):
            upper, lower = step_ends(gap, height)
            name = f"the step around {gap:g} m"
            faults = list(travel_faults(step, ("heights_m", number), name, lower, upper))
            yield from faults
            if faults:
                break
    for trajectory in file.trajectories:
        amplitude = trajectory.amplitude_m
        end_gaps = file.gap_m - amplitude, file.gap_m + amplitude
        yield from travel_faults(trajectory, ("amplitude_m",), "the reference", *end_gaps)
    hold_s, rate = step.hold_s, file.timing.rate_Hz
    if round(hold_s * rate) < MIN_HOLD_TICKS:
        text = f"holds a step for {hold_s * rate:.3g} ticks of 1/{rate:g} s"
        text += f"; hold it for at least {MIN_HOLD_TICKS}, {MIN_HOLD_TICKS / rate:.4g} s"
        yield FileFault(file.key_path(step, "hold_s"), text, code="too-short")
    yield from frequency_faults(file, file.trajectories)


def frequency_faults(
    file: RigFile, cases: Iterable[TrajectoryCase | DisplacementCase]
) -> Iterator[FileFault]:
    """Find references whose frequency is too low, or too high for the sample rate."""
    max_frequency, min_frequency = file.timing.rate_Hz / MIN_TICKS_PER_PERIOD, 1.0 / MAX_PERIOD_S
    for case in cases:
        frequency, text = case.frequency_Hz, ""
        if frequency >= max_frequency:
            text = f"{frequency:g} Hz is not below {max_frequency:g} Hz, a tenth of rate_Hz; lower it"
        elif frequency < min_frequency:
            text = f"a period of {1.0 / frequency:.4g} s is longer than {MAX_PERIOD_S:g} s"
            text += "; raise it"
        if text:
            yield FileFault(file.key_path(case, "frequency_Hz"), text, code="out-of-range")
