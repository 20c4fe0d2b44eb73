"""Measure the loops of a rig's magnet or piezo stage, and write them with their history.

At each gap, a probe first finds the largest current. Then the designed records are measured. This
module measures virtual rigs. The module `on_board` measures with a running controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from anhyst.data.loops import Loop, Loops
from anhyst.data.sidecar import is_sidecar
from anhyst.support.atomic import PathLike, atomic_writer, check_writable
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.kinds import require_capability
from anhyst.support.numeric import FloatArray
from anhyst.support.toml_file import require_rig
from anhyst.support.toml_text import toml_key, toml_value
from anhyst.support.units import QUANTITIES
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.rig.measuring import HeldMagnet, measure_path, measure_stack_displacement, sweep_path
from anhyst_rigs.rig.piezo import PiezoRig, read_piezo_rig
from anhyst_rigs.rig.sensor_table import Sensors
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.study.excite.design import (
    MIN_PEAK_DIFFERENCE,
    OPERATING_RANGE,
    Bound,
    Record,
    Specimen,
    bearing_specimen,
    can_demagnetise,
    current_step,
    design_records,
    fast_cycle_rates,
    fast_cycles,
    find_thermal_peak,
    force_specimen,
    stack_specimen,
)

MeasureFunction = Callable[[Specimen, Progress | None], "Excitation"]
"""Function that measures the loops of a specimen."""


@dataclass(frozen=True, slots=True)
class ReadSpecimen:
    """A specimen, and the files that describe it."""

    specimen: Specimen
    input_files: tuple[Path, ...]  # files that must not be overwritten
    measure: MeasureFunction  # function that measures the virtual rig


class HasSpecimen(Protocol):
    """A kind of rig whose loops can be measured."""

    def specimen(self, rig: PathLike) -> ReadSpecimen:
        """Return the specimen that a rig file describes."""


def read_specimen(path: PathLike) -> ReadSpecimen:
    """Return the specimen of a rig file of any kind."""
    return require_capability(require_rig(path, "excite"), HasSpecimen).specimen(path)


def read_stack_specimen(path: PathLike) -> ReadSpecimen:
    """Read the rig file of a piezo stage, and return the stage as the specimen."""
    stack = read_piezo_rig(path)
    return ReadSpecimen(stack_specimen(stack), (stack.path,), partial(measure_stack, stack))


def read_force_specimen(path: PathLike) -> ReadSpecimen:
    """Return the actuator of a force-control rig file as specimen."""
    rig = read_rig(path)
    solenoid = rig.settings.solenoid
    files = [rig.path] if solenoid is None else [rig.path, rig.path.parent / solenoid.file]
    if solenoid is None and rig.settings.magnet.has_iron_from_loops:
        files += rig.measured_loops.files
        rig = complete_rig(rig, rig.measured_loops.read())
    return ReadSpecimen(force_specimen(rig), tuple(files), measure_gaps)


def read_bearing_specimen(path: PathLike) -> ReadSpecimen:
    """Read the rig file of a bearing, and return its magnet as the specimen."""
    return _read_body_specimen(read_bearing(path))


def read_stage_specimen(path: PathLike) -> ReadSpecimen:
    """Read the rig file of a stage, and return its magnet as the specimen."""
    return _read_body_specimen(read_stage(path))


def _read_body_specimen(rig: BodyRig) -> ReadSpecimen:
    """Return the magnet of a body as the specimen; it is first fitted to loops if necessary."""
    files = [file for file in (rig.path, rig.model_path, rig.flux_table_path) if file is not None]
    if rig.settings.magnet.has_iron_from_loops:
        files += rig.measured_loops.files
        if rig.fitted is None:
            rig = complete_rig(rig, rig.measured_loops.read())
    return ReadSpecimen(bearing_specimen(rig), tuple(files), measure_gaps)


SLOPE_WINDOW_TO_PEAK = 0.1
"""Half-width of the current window for the slope of the force, as a fraction of the peak."""
FASTEST_TO_REQUIRED_RATE = 1.5
"""Recommended ratio of the fastest measured rate to the rate that the set-point requires."""
PROBE_FORCE_TO_LIMIT = 0.95
"""Fraction of the force limit that stops the probe."""
_PROBE_SEED = 1000
"""Number that stands for the probe in the seed of its noise."""


@dataclass(frozen=True, slots=True)
class ProbedGap:
    """The result of the probe at a gap, before loops are measured."""

    gap: float  # gap, m; nan for a piezo stage
    peak: Bound  # largest current, A, and the limit that sets it
    largest_force: float  # largest force during the probe, N
    operating_current: float  # current at the operating point, A
    is_force_reached: bool  # whether the operating current gives the operating force
    # rate of the current that the set-point requires at this gap, A/s; 0: unknown
    required_current_rate: float = 0.0


@dataclass(frozen=True, eq=False)
class DriveHistory:
    """All samples of the drive, including the rests."""

    time: FloatArray  # time, s
    current: FloatArray  # current, A
    gap: FloatArray  # gap, m
    # warmth of the winding: 1 at the largest continuous current; nan if unknown
    warmth: FloatArray


_OUTPUT_NAMES = {"displacement": "displacement_m", "voltage": "voltage_V"}
"""Keys of the largest output in the JSON output; of all other outputs ``force_N``."""


@dataclass(frozen=True, eq=False)
class Excitation:
    """Measured loops, and how they were measured.

    Parameters
    ----------
    loops : Loops
    specimen : Specimen
    probed_gaps : tuple of ProbedGap
        In the order of the measurement, from the largest gap to the smallest.
    drive_history : DriveHistory
    notes : tuple of str
        Restrictions of the design, and the keys that cause them.
    """

    loops: Loops
    specimen: Specimen
    probed_gaps: tuple[ProbedGap, ...]
    drive_history: DriveHistory
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the JSON output."""
        drive_history, specimen = self.drive_history, self.specimen
        drive, unit = specimen.drive, specimen.units[0]
        output_name = _OUTPUT_NAMES.get(specimen.output, "force_N")
        return {
            "loops": len(self.loops),
            "samples": sum(loop.n for loop in self.loops.loops),
            "duration_s": float(drive_history.time[-1]),
            "begins": "demagnetised" if self.begins_demagnetised else "conditioned",
            f"rate_{unit}_per_s": current_step(specimen) / specimen.sample_s,
            "limits": {
                name: {"value": limit.value, "key": limit.key}
                for name, limit in (
                    (f"{drive}_{unit}", specimen.max_current),
                    (f"rate_{unit}_per_s", specimen.max_rate),
                    (output_name, specimen.max_force),
                )
                if math.isfinite(limit.value)
            },
            "warmth": None if specimen.winding is None else float(drive_history.warmth.max()),
            "gaps": [
                {
                    **({"gap_m": probed_gap.gap} if specimen.gaps else {}),
                    f"{drive}_max_{unit}": probed_gap.peak.value,
                    "limited_by": probed_gap.peak.key,
                    output_name: probed_gap.largest_force,
                    f"operating_{unit}": probed_gap.operating_current,
                    "operating_reached": probed_gap.is_force_reached,
                    **(
                        {"needed_A_per_s": probed_gap.required_current_rate}
                        if probed_gap.required_current_rate
                        else {}
                    ),
                }
                for probed_gap in self.probed_gaps
            ],
            "notes": list(self.notes),
        }

    @property
    def begins_demagnetised(self) -> bool:
        """Whether the iron is demagnetised at the beginning of every record."""
        return all(loop.history.kind == "demagnetised" for loop in self.loops.loops)


@dataclass(slots=True)
class DriveLog:
    """All samples that have been driven up to now."""

    specimen: Specimen
    time: float = 0.0
    warmth: float = 0.0
    row_blocks: list[tuple[FloatArray, ...]] = field(default_factory=list)

    def append(self, current: FloatArray, gap: float) -> FloatArray:
        """Append a path; return the times of its samples, s."""
        sample, winding = self.specimen.sample_s, self.specimen.winding
        time: FloatArray = self.time + sample * np.arange(1.0, current.size + 1.0)
        if winding is None:
            warmth = np.full(current.size, np.nan)
        else:
            warmth = winding.warmth_along(current, sample, self.warmth)
            self.warmth = float(warmth[-1])
        self.row_blocks.append((time, current, np.full(current.size, gap), warmth))
        self.time = float(time[-1])
        return time

    def rest_at_zero(self, seconds: float, gap: float) -> None:
        """Append a time without current."""
        count = int(np.ceil(seconds / self.specimen.sample_s))
        if count > 0:
            self.append(np.zeros(count), gap)

    def cool_for(self, current: FloatArray, gap: float) -> None:
        """Append a time without current, so that the winding stays cool during a path."""
        winding = self.specimen.winding
        if winding is not None:
            max_warmth = winding.max_start_warmth(current, self.specimen.sample_s)
            self.rest_at_zero(winding.rest_time(self.warmth, max_warmth), gap)

    def history(self) -> DriveHistory:
        """Return all samples."""
        return DriveHistory(*(np.concatenate(column) for column in zip(*self.row_blocks, strict=True)))


def measure_gaps(specimen: Specimen, progress: Progress | None = None) -> Excitation:
    """Measure loops at every gap, within the limits.

    The measurement begins at the largest gap. From gap to gap, the flux increases, so that
    conditioning removes the history of earlier gaps. At each gap, a probe raises the current once
    until current, force or winding reaches its limit. This peak limits all records at the gap.
    """
    assert specimen.held_rig is not None
    thermal_peak = find_thermal_peak(specimen)
    magnet, log = specimen.held_rig.magnet(), DriveLog(specimen)
    gaps = sorted(specimen.gaps, reverse=True)
    loops: list[Loop] = []
    probed_gaps = []
    for number, gap in enumerate(gaps):
        if number:
            log.rest_at_zero(specimen.pause_s, gap)
        probed_gap = _probe_gap(specimen, magnet, log, gap, number, thermal_peak)
        probed_gaps.append(probed_gap)
        records = design_records(specimen, probed_gap.peak.value, probed_gap.operating_current)
        for count, record in enumerate(records):
            sensors = specimen.held_rig.sensors([number, count], record.sample_s)
            loops.append(_record_loop(specimen, magnet, sensors, log, gap, record))
            if progress is not None:
                progress(number * len(records) + count + 1, len(gaps) * len(records))
    check_operating_force(specimen, probed_gaps)
    names = QUANTITIES["current"], QUANTITIES[specimen.output], QUANTITIES["gap"]
    return Excitation(
        Loops(tuple(loops), *names),
        specimen,
        tuple(probed_gaps),
        log.history(),
        tuple(describe_restrictions(specimen, probed_gaps)),
    )


def measure_stack(rig: PiezoRig, specimen: Specimen, progress: Progress | None = None) -> Excitation:
    """Measure the loops of a piezo stage in one continuous drive, including its creep.

    The stage has been at 0 V for a long time before.
    """
    log, thermal_peak, no_gap = DriveLog(specimen), find_thermal_peak(specimen), math.nan
    seed = [rig.settings.seed, _PROBE_SEED]
    rising_path = sweep_path([0.0, thermal_peak.value], current_step(specimen))
    log.append(np.concatenate([rising_path, rising_path[::-1]]), no_gap)
    probe_answer = measure_stack_displacement(rig, log.history().current, specimen.sample_s, seed)
    probe_result = evaluate_probe(
        specimen, no_gap, rising_path, probe_answer[: rising_path.size].tolist(), thermal_peak
    )
    records = design_records(specimen, probe_result.peak.value, probe_result.operating_current)
    output_times = []
    for record in records:
        log.append(record.approach, no_gap)
        log.rest_at_zero(specimen.pause_s, no_gap)
        output_times.append(log.append(record.path, no_gap))
    drive_history = log.history()
    read_displacement = measure_stack_displacement(rig, drive_history.current, specimen.sample_s, seed)
    loops = []
    for count, (record, time) in enumerate(zip(records, output_times, strict=True)):
        begin = round(time[0] / specimen.sample_s) - 1
        displacement = read_displacement[begin : begin + time.size]
        loops.append(Loop(record.name, record.path, displacement, None, time, record.history))
        if progress is not None:
            progress(count + 1, len(records))
    names = QUANTITIES[specimen.drive], QUANTITIES[specimen.output]
    notes = tuple(describe_restrictions(specimen, [probe_result]))
    return Excitation(Loops(tuple(loops), *names), specimen, (probe_result,), drive_history, notes)


def _probe_gap(
    specimen: Specimen, magnet: HeldMagnet, log: DriveLog, gap: float, gap_number: int, thermal_peak: Bound
) -> ProbedGap:
    """Raise the current once until a quantity reaches its limit, then return to zero."""
    assert specimen.held_rig is not None
    path = sweep_path([0.0, thermal_peak.value], current_step(specimen))
    log.cool_for(np.concatenate([path, path[::-1]]), gap)
    sensors = specimen.held_rig.sensors([gap_number, _PROBE_SEED], specimen.sample_s)
    forces: list[float] = []
    for current in path.tolist():
        forces.append(sensors["force"].read(np.array([magnet.hold(current, gap)])).item())
        if forces[-1] >= PROBE_FORCE_TO_LIMIT * specimen.max_force.value:
            break
    magnet.hold(0.0, gap)
    driven_path = path[: len(forces)]
    log.append(np.concatenate([driven_path, driven_path[::-1]]), gap)
    return evaluate_probe(specimen, gap, driven_path, forces, thermal_peak)


def evaluate_probe(
    specimen: Specimen, gap: float, driven_path: FloatArray, forces: Sequence[float], thermal_peak: Bound
) -> ProbedGap:
    """Evaluate the first increase of the current at a gap."""
    peak = thermal_peak
    if forces[-1] >= PROBE_FORCE_TO_LIMIT * specimen.max_force.value:
        # The sample before it is certainly below the limit.
        peak = Bound(float(driven_path[max(driven_path.size - 2, 0)]), specimen.max_force.key)
    if driven_path.size < 3:
        raise InputError(
            f"{specimen.max_force.key}: at {1e3 * gap:g} mm {specimen.max_force.value:g} N are reached at "
            f"{driven_path[-1]:.3g} A, which is too small for a loop; raise the limit",
            code="force-limit-too-low",
            key=specimen.max_force.key,
        )
    sufficient_samples = np.flatnonzero(np.array(forces) >= specimen.operating_force.value)
    min_operating, max_operating = (operating_fraction * peak.value for operating_fraction in OPERATING_RANGE)
    bias = float(driven_path[sufficient_samples[0]]) if sufficient_samples.size else np.inf
    operating = min(max(bias, min_operating), max_operating)
    required_current_rate = _required_current_rate(specimen, driven_path, np.array(forces), operating)
    return ProbedGap(gap, peak, max(forces), operating, bias == operating, required_current_rate)


def _required_current_rate(
    specimen: Specimen, current: FloatArray, force: FloatArray, operating: float
) -> float:
    """Return the rate of the current that the fastest demanded change of the force requires, A/s."""
    is_near = np.abs(current - operating) <= SLOPE_WINDOW_TO_PEAK * current[-1]
    if specimen.demanded_force_rate == 0.0 or np.count_nonzero(is_near) < 3:
        return 0.0
    slope = float(np.polynomial.polynomial.polyfit(current[is_near], force[is_near], 1)[1])
    return specimen.demanded_force_rate / slope if slope > 0.0 else 0.0


def _record_loop(
    specimen: Specimen, magnet: HeldMagnet, sensors: Sensors, log: DriveLog, gap: float, record: Record
) -> Loop:
    """Bring the iron into the initial state of a record, then measure the record."""
    log.cool_for(record.full_path(specimen.sample_s), gap)
    log.append(record.approach, gap)
    for reversal in record.approach_reversals:
        magnet.hold(reversal, gap)
    time = log.time + record.sample_s * np.arange(1.0, record.path.size + 1.0)
    log.append(record.heating_path(specimen.sample_s), gap)
    seconds = record.sample_s if record.is_fast else math.inf
    current, force = measure_path(magnet, sensors, gap, record.path, seconds)
    label = f"{1e3 * gap:g}mm-{record.name}"
    overload_samples = np.flatnonzero(np.abs(force) > specimen.max_force.value)
    if overload_samples.size:
        raise InputError(
            f"{specimen.max_force.key}: {label} reads {force[overload_samples[0]]:.4g} N at "
            f"{current[overload_samples[0]]:.4g} A, more than {specimen.max_force.value:g} N, although the "
            "probe at this gap stayed below; lower excite.current_max_A",
            code="force-above-limit",
            key=specimen.max_force.key,
        )
    return Loop(label, current, force, np.full(time.size, gap), time, record.history)


def check_operating_force(specimen: Specimen, probed_gaps: Sequence[ProbedGap]) -> None:
    """Raise an InputError if the operating force cannot be reached at any gap."""
    if any(probed_gap.is_force_reached for probed_gap in probed_gaps):
        return
    best_gap = max(probed_gaps, key=lambda probed_gap: probed_gap.largest_force)
    force, peak = specimen.operating_force, best_gap.peak
    low, high = (f"{100 * current_fraction:.0f}" for current_fraction in OPERATING_RANGE)
    raise InputError(
        f"{force.key}: minor loops about {force.value:g} N need a current from {low} to {high} % of "
        f"the largest one, which no gap allows; {peak.key} limits it to {peak.value:.3g} A and "
        f"{best_gap.largest_force:.4g} N at {1e3 * best_gap.gap:g} mm; set excite.operating_N, or "
        "raise that limit",
        code="operating-force-not-reached",
        key=force.key,
    )


def describe_restrictions(specimen: Specimen, probed_gaps: Sequence[ProbedGap]) -> list[str]:
    """Describe the restrictions of the design, and the keys that cause them."""
    notes = []
    unit, output_name = specimen.units
    if specimen.sweep_rate > specimen.max_rate.value:
        notes.append(
            f"current changes by {specimen.max_rate.value:.4g} A/s instead of {specimen.sweep_rate:.4g} A/s: "
            f"{specimen.max_rate.key}"
        )
    for probed_gap in probed_gaps:
        prefix = f"{1e3 * probed_gap.gap:g} mm: " if specimen.gaps else ""
        if probed_gap.peak.value < specimen.max_current.value:
            notes.append(
                f"{prefix}largest current {probed_gap.peak.value:.4g} A instead of "
                f"{specimen.max_current.value:.4g} A: {probed_gap.peak.key}"
            )
        if not probed_gap.is_force_reached:
            notes.append(
                f"{prefix}minor loops about {probed_gap.operating_current:.4g} {unit}, which does not give the "
                f"{specimen.operating_force.value:.4g} {output_name} of {specimen.operating_force.key}"
            )
    if not all(can_demagnetise(specimen, gap_result.peak.value) for gap_result in probed_gaps):
        reason = "the amplifier does not drive as far below zero as above"
        if specimen.is_biased:
            reason = "a permanent magnet magnetises the iron without current"
        notes.append(
            f"{reason}: records begin after {specimen.conditioning_cycles} cycles from "
            f"{'the lowest' if specimen.is_bipolar else '0'} to the largest {specimen.drive} instead of "
            "demagnetised"
        )
    fast_limit = specimen.max_fast_rate or specimen.max_rate
    notes += [
        f"full cycles at {fast_limit.value:.4g} A/s instead of {speed:.4g} A/s: {fast_limit.key}"
        for speed in specimen.fast_rates
        if speed > fast_limit.value
    ]
    peak = max(place.peak.value for place in probed_gaps)
    largest_peaks = dict(reversed(fast_cycles(specimen, peak)))  # the first peak of a rate is the largest
    notes += [
        f"cycles at {speed:.4g} A/s only up to {cycle_peak:.3g} A: {fast_limit.key}; eddy currents at this rate "
        "and a larger current are not measured"
        for speed, cycle_peak in sorted(largest_peaks.items())
        if cycle_peak < (1.0 - MIN_PEAK_DIFFERENCE) * peak
    ]
    recommended_rate = FASTEST_TO_REQUIRED_RATE * max(place.required_current_rate for place in probed_gaps)
    if specimen.fast_rates and recommended_rate > max(fast_cycle_rates(specimen)):
        notes.append(
            f"the set-point needs {recommended_rate / FASTEST_TO_REQUIRED_RATE:.3g} A/s at the operating point, and "
            f"cycles of {recommended_rate:.3g} A/s would show its eddy currents there "
            "(measurement.fast_A_per_s)"
        )
    if specimen.gaps and specimen.winding is None:
        notes.append(
            "the rig file states no limits of the winding in [excite], so its temperature is not monitored"
        )
    return notes


def excite(
    rig: PathLike, out: PathLike, progress: Progress | None = None, measure: MeasureFunction | None = None
) -> Excitation:
    """Measure the loops of a rig, and write them with a sidecar that states their history.

    Without `measure`, the loops of the virtual rig are measured.
    """
    file = Path(out)
    if file.suffix.lower() != ".csv":
        raise InputError(f"{file}: loops are written as .csv; change the extension", code="wrong-ending")
    source = read_specimen(rig)
    if measure is not None and not source.specimen.gaps:
        raise InputError(
            "--xcp, --port and --voltage need a magnet, and a piezo stage has none; omit them and --folder",
            code="option-not-for-this",
            key="--xcp",
        )
    sidecar = file.with_suffix(".toml")
    for path in (file, sidecar):
        check_writable(path, input_files=source.input_files)
    if sidecar.exists() and not is_sidecar(sidecar):
        raise InputError(f"{sidecar}: is not a sidecar of loops; write to another file", code="not-a-sidecar")
    try:
        excitation = (measure or source.measure)(source.specimen, progress)
    except InputError as error:
        raise error.with_location(rig) from error
    write_excitation(excitation, Path(rig), file)
    return excitation


def write_excitation(excitation: Excitation, rig: Path, out: Path) -> None:
    """Write measured loops, and the sidecar that states their history."""
    lines = [f"# measured by anhyst excite {rig.name}", *(f"# {note}" for note in excitation.notes)]
    histories = {loop.label: str(loop.history) for loop in excitation.loops.loops}
    coil = excitation.specimen.coil
    if excitation.loops.output.name == "sense_voltage" and coil is not None:
        lines += ["", "[constants]", f"turns = {coil.turns:g}", f"sense_turns = {coil.sense_turns:g}"]
    lines += ["", "[history]"]
    lines += [f"{toml_key(label)} = {toml_value(history)}" for label, history in histories.items()]
    with atomic_writer(out.with_suffix(".toml")) as file:
        file.write("\n".join(lines) + "\n")
    excitation.loops.save(out)
