"""A body between magnets, from its rig file; the rig of a bearing."""

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
from anhyst_rigs.rig.lines import AGAINST_X, ALONG_X, Coordinate, LinesOfAction
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
"""Ticks for which a step is held, to judge it by."""
MAX_PERIOD_S = 60.0
"""Of a trajectory, s."""
MIN_TICKS_PER_PERIOD = 10.0
"""More than so many ticks make a period of a trajectory."""
MAX_DELAY_SUBSTEPS = 128
"""Sub-steps between sample and output, or by which a sensor may be late."""
GAP_MAP_POINTS = 129
"""Places over the gap at which a law's gap map is looked at."""


@dataclass(frozen=True)
class BodyRig:
    """A body between magnets as its file describes it: a bearing; a stage is another layout of it."""

    path: Path  # the rig file
    settings: RigFile  # what it says
    # magnet that was fitted to the loops; `settings` holds its numbers then
    fitted: FittedPlant | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what is made of the files when it is first asked for: no other process takes it."""
        return {name: self.__dict__[name] for name in self.__dataclass_fields__}

    @property
    def gap(self) -> float:
        """Of the first magnet with the body where it works, m."""
        return self.settings.gap_m

    @property
    def idle_force(self) -> float:
        """What either magnet of a pair pulls with where no net force is wanted, N."""
        return self.settings.bias_N or 0.0

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.settings.timing.rate_Hz

    @property
    def loop_delay(self) -> float:
        """Time from a sample to the middle of the tick in which its current flows, s."""
        return (self.settings.timing.delay_ticks + 0.5) * self.dt

    @property
    def substep(self) -> float:
        """Time between sub-steps, s."""
        return self.dt / self.settings.timing.substeps

    @property
    def measured_loops(self) -> MeasuredLoops:
        """The loops that its file names."""
        return MeasuredLoops(self.path, self.settings.loops, self.settings.magnet.output)

    def magnet_gaps(self, gap: FloatArray) -> list[FloatArray]:
        """Return the gaps of one magnet or of both of a pair, m, where the first one has these."""
        total = self.settings.gap_total_m
        return [gap] if total is None else [gap, total - gap]

    @property
    def parameter_names(self) -> tuple[ParameterName, ...]:
        """All that its motion may teach."""
        return BEARING_PARAMETERS[len(self.settings.body_magnets)]

    @cached_property
    def lines_of_action(self) -> LinesOfAction:
        """Where everything acts on the body: the coordinate of a bearing is its first gap."""
        file, body = self.settings, self.settings.body
        pair = [(AGAINST_X, 0.0), (ALONG_X, file.gap_total_m or 0.0)]
        return LinesOfAction(
            coordinates=[Coordinate(0, body.stop_low_m, body.stop_high_m, body.stop_high_m)],
            magnets=pair[: len(file.body_magnets)],
            gap_sensors=[(ALONG_X, 0.0)],
            gravity=[body.gravity_m_per_s2, 0.0, 0.0],
            force_along=AGAINST_X["d"],
            load=ALONG_X,
            load_rest=file.gap_m,
        )

    def method_calibration(self, method: MethodName) -> CalibratedMethod | None:
        """Return what the calibration that it names says of a method; None where it says nothing."""
        return None if self._calibration_file is None else self._calibration_file.for_method(method)

    @cached_property
    def _calibration_file(self) -> CalibrationFile | None:
        """What motion taught; feedforward and force scale must believe in the same mass."""
        if self.calibration_path is None:
            return None
        if getattr(self.settings.control, "calibrate", False):
            raise InputError(
                f"{self.path}: control.calibration: calibrate = true begins without one; leave "
                "one of both out",
                code="not-both",
                key="control.calibration",
            )
        return read_calibration(
            self.calibration_path, self.path, self.settings, self.parameter_names
        )

    def _resolve_path(self, name: str | None) -> Path | None:
        return None if name is None else self.path.parent / name

    @property
    def calibration_path(self) -> Path | None:
        """File of what motion taught of its magnets."""
        return self._resolve_path(self.settings.calibration)

    @property
    def model_path(self) -> Path | None:
        """Model file of a magnet whose force an identified law makes."""
        return self._resolve_path(self.settings.magnet.model)

    @property
    def flux_table_path(self) -> Path | None:
        """Flux table of such a magnet, if it has one."""
        return self._resolve_path(self.settings.magnet.flux_table)

    @cached_property
    def law(self) -> Model | None:
        """The identified law that makes its force; None where an iron does."""
        if self.model_path is None:
            return None
        law = read_model(self.model_path)
        if law.layers is not None:
            text = (
                f"{self.model_path}: a virtual magnet of a law has no layers; take out its [layers]"
            )
            raise InputError(text, code="layers-not-in-plant", key="model")
        if law.needs_fixed_gap or not law.needs_schedule or law.power != 2:
            raise InputError(
                f"{self.model_path}: a bearing needs a model of force over current whose gap may move; "
                "identify one from loops at several gaps",
                code="not-current-to-force",
            )
        return law

    @cached_property
    def flux_linkage(self) -> FluxTable:
        """Flux linkage of the winding of such a magnet, as measured or made from poles and iron."""
        file, body = self.settings, self.settings.body
        high = file.amplifier.current_high_A
        if self.flux_table_path is None:
            ends = (0.8 * body.stop_low_m, 1.2 * body.stop_high_m)
            return make_flux_table(file.magnet.poles, file.steel, 1.5 * high, ends)
        table = read_flux_table(self.flux_table_path)
        check_flux_range(self.flux_table_path, table, body.stop_low_m, body.stop_high_m, high)
        return table

    @cached_property
    def magnet(self) -> Magnet:
        """The magnet that plants step: of an iron in its circuit, or of an identified law."""
        file, table = self.settings, self.settings.magnet
        if table.kind == LAW_KIND:
            return self.make_law_magnet()
        return make_iron_magnet(
            table.poles, file.steel, table.eddy_time_s, file.gap_m, table.solid_iron
        )

    def make_law_magnet(self, law: Model | None = None) -> Magnet:
        """Return its magnet of an identified law: its own, or another one instead."""
        gaps, middle = self.flux_linkage.gap, self.settings.gap_m
        law = law or self.law
        assert law is not None
        at = np.linspace(float(gaps[0]), float(gaps[-1]), GAP_MAP_POINTS)
        names = ("c_H", "rho", "c_out", "out_0", "in_0")
        rows = np.column_stack([law.interpolate_parameter(name, at) for name in names])
        eddy = float(law.interpolate_parameter("gamma", np.array([middle]))[0])
        return make_law_magnet(
            self.settings.magnet.poles, law.iron_at(middle), rows, eddy, self.flux_linkage
        )

    def static_map(
        self, current: FloatArray, gap: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return force, flux linkage and flux density of a path so slow that nothing is induced."""
        path = np.ascontiguousarray(current), np.ascontiguousarray(gap)
        force, linkage, density = Coil(self.magnet).run(*path).T.copy()
        return force, linkage, density

    @property
    def static_load(self) -> float:
        """Force that pulls the gap open all the time, N: load drive and weight."""
        return self.settings.load.force_N + self.settings.body.weight_N


def step_ends(gap: float, height: float) -> tuple[float, float]:
    """Return the gaps between which a step goes: half its height to either side.

    High steps have room between the end stops then, up and down steps see the same magnet, and
    the plant linearised at the gap is that of the middle of every step.
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
    """Find what does not fit together in the plant and its instruments."""
    yield from _delay_faults(file)
    body, low, high = file.body, file.body.stop_low_m, file.body.stop_high_m
    sensor = file.gap_sensor
    if not (sensor.low_m <= body.stop_low_m and high <= sensor.high_m):
        text = f"its range must hold the travel, {low:g} to {high:g} m; widen low_m or high_m"
        yield FileFault(file.key_path(sensor), text, code="range-too-narrow")
    amplifier, shunt = file.amplifier, file.current_sensor
    if not (shunt.low_A <= amplifier.current_low_A and amplifier.current_high_A <= shunt.high_A):
        text = "its range must hold that of the amplifier; widen low_A or high_A"
        yield FileFault(file.key_path(shunt), text, code="range-too-narrow")
    lowest = min(turn for record in file.measurement.records for turn in record.turns)
    if min(lowest, 0.0) * file.measurement.current_max_A < min(amplifier.current_low_A, 0.0):
        text = f"the amplifier begins at {amplifier.current_low_A:g} A; raise the turning points"
        yield FileFault(("measurement", "records"), text, code="beyond-amplifier")
    if file.measurement.current_max_A > amplifier.current_high_A:
        text = f"the amplifier ends at {amplifier.current_high_A:g} A; lower it"
        yield FileFault(("measurement", "current_max_A"), text, code="beyond-amplifier")
    if not low < file.gap_m < high:
        text = f"the body works at {file.gap_m:g} m, outside the travel of {low:g} to {high:g} m"
        key = file.key_path(file.magnet, "gap_m")
        yield FileFault(key, f"{text}; lower it or move the stops", code="outside-travel")


def _pair_faults(file: RigFile) -> Iterator[FileFault]:
    """Find what the magnets of a bearing are not: one that pulls, or two against each other."""
    first, opposite, total = file.magnet, file.opposite, file.gap_total_m
    if first.is_bidirectional:
        text = "pushes as well as it pulls; it is for a stage"
        yield FileFault(file.key_path(first, "kind"), text, code="not-for-this-kind")
    if first.direction != AGAINST_X["d"]:
        text = f"the first magnet pulls along {AGAINST_X['d']}, towards smaller gaps; write that"
        yield FileFault(file.key_path(first, "direction"), text, code="wrong-direction")
    if opposite is None or total is None:
        return
    if opposite.direction != ALONG_X["d"]:
        text = f"a second magnet pulls against the first, along {ALONG_X['d']}; write that"
        yield FileFault(file.key_path(opposite, "direction"), text, code="wrong-direction")
    if not (high := file.body.stop_high_m) < total:
        text = f"both gaps make {total:g} m, not above stop_high_m, {high:g} m, where the second "
        text += "magnet is touched; raise it"
        yield FileFault(file.key_path(opposite, "gap_m"), text, code="range-too-narrow")


def _delay_faults(file: RigFile) -> Iterator[FileFault]:
    """Find delays that the plant has no memory for."""
    timing, amplifier, sensor = file.timing, file.amplifier, file.gap_sensor
    per_second = timing.rate_Hz * timing.substeps
    output = timing.delay_ticks * timing.substeps + amplifier.delay_s * per_second
    for table, steps in ((amplifier, output), (sensor, sensor.delay_s * per_second)):
        if steps > MAX_DELAY_SUBSTEPS:
            text = f"makes a delay of {steps:.0f} sub-steps, the plant has {MAX_DELAY_SUBSTEPS}; "
            text += "shorten it or lower substeps"
            yield FileFault(file.key_path(table, "delay_s"), text, code="delay-too-long")


def _case_faults(file: RigFile) -> Iterator[FileFault]:
    """Find references outside the travel, and what is too short or too long for the rate."""
    low, high, step = file.body.stop_low_m, file.body.stop_high_m, file.step

    def travel_faults(
        table: Table, key: KeyPath, what: str, lowest: float, highest: float
    ) -> Iterator[FileFault]:
        if not (low < lowest and highest < high):
            goes = f"{highest:.5g}" if lowest == highest else f"{lowest:.5g} to {highest:.5g}"
            text = f"{what} is at {goes} m, outside the travel of {low:g} to {high:g} m"
            text += "; lower it or move the stops"
            yield FileFault(file.key_path(table, *key), text, code="outside-travel")

    for number, gap in enumerate(step.also_gaps_m):
        yield from travel_faults(step, ("also_gaps_m", number), "the reference", gap, gap)
    for number, height in enumerate(step.heights_m):
        for gap in (gap for gap in file.step_gaps_m if low < gap < high):
            upper, lower = step_ends(gap, height)
            what = f"the step around {gap:g} m"
            faults = list(travel_faults(step, ("heights_m", number), what, lower, upper))
            yield from faults
            if faults:
                break
    for trajectory in file.trajectories:
        away = trajectory.amplitude_m
        ends = file.gap_m - away, file.gap_m + away
        yield from travel_faults(trajectory, ("amplitude_m",), "the reference", *ends)
    hold, rate = step.hold_s, file.timing.rate_Hz
    if round(hold * rate) < MIN_HOLD_TICKS:
        text = f"holds a step for {hold * rate:.3g} ticks of 1/{rate:g} s"
        text += f"; {MIN_HOLD_TICKS} at least, {MIN_HOLD_TICKS / rate:.4g} s"
        yield FileFault(file.key_path(step, "hold_s"), text, code="too-short")
    yield from frequency_faults(file, file.trajectories)


def frequency_faults(
    file: RigFile, cases: Iterable[TrajectoryCase | DisplacementCase]
) -> Iterator[FileFault]:
    """Find references that move too fast for the rate, or too slowly."""
    most, least = file.timing.rate_Hz / MIN_TICKS_PER_PERIOD, 1.0 / MAX_PERIOD_S
    for case in cases:
        frequency, text = case.frequency_Hz, ""
        if frequency >= most:
            text = f"{frequency:g} Hz is not below a tenth of rate_Hz, {most:g} Hz; lower it"
        elif frequency < least:
            text = f"a period of {1.0 / frequency:.4g} s is longer than {MAX_PERIOD_S:g} s"
            text += "; raise it"
        if text:
            yield FileFault(file.key_path(case, "frequency_Hz"), text, code="out-of-range")
