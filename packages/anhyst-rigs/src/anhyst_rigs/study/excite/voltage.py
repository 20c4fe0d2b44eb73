"""Measure the voltage of a coil along its current: records that contain the flux linkage.

The integral of the voltage without the resistive part is the flux linkage, whose dependence on the
gap gives the force. A record makes all unknowns identifiable. Equal reversal points and rests
determine resistance, warming and offset. The smallest gap is driven into saturation. Four gaps in a
geometric sequence determine the reluctance of the gap and the leakage, and test their laws.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from anhyst.data.loops import Loop, Loops
from anhyst.data.path import History
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from anhyst_rigs.rig.measuring import HeldMagnet
from anhyst_rigs.study.excite.design import (
    Bound,
    MeasuredCoil,
    Record,
    Specimen,
    design_approach,
    find_thermal_peak,
)
from anhyst_rigs.study.excite.excite import DriveLog, Excitation, ProbedGap, describe_restrictions

GAP_COUNT, MIN_GAPS = 4, 3
"""Number of gaps, and the smallest number from which the law of the gap can be found."""
GAP_DECIMALS = 5
"""Decimals of a gap, m, that a feeler gauge can set."""
REVERSALS_TO_PEAK = (
    *(0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.6, 0.2, 0.6, 0.2, 1.0, 1.0, 1.0),
    *(0.4, 0.8, 0.4, 0.8, 0.0, 0.0, 0.0, 0.3, 0.0, 0.3, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0),
)
"""Reversal points; a repeated point is held as long as a ramp from zero to the peak."""
RAMP_TIME_CONSTANTS = 4.0
"""Duration of a ramp from zero to the peak, in units of flux linkage over resistive voltage.

In longer ramps, an error of the resistance has a larger effect; shorter ones cause eddy currents."""
SAMPLES_PER_RAMP = 250
MIN_SAMPLE_S = 1e-4
"""Shortest time from one sample to the next, s."""
COPPER_PER_KELVIN = 3.93e-3
"""Relative increase of the resistance of copper per kelvin at 20 degrees Celsius."""


def select_gaps(specimen: Specimen) -> tuple[float, ...]:
    """Return the gaps of the measurement, m: those of [excite], or a geometric sequence."""
    low, high = min(specimen.gaps), max(specimen.gaps)
    if specimen.has_own_gaps:
        gaps = specimen.gaps
    else:
        inner_gaps = np.round(np.geomspace(low, high, GAP_COUNT)[1:-1], GAP_DECIMALS)
        gaps = (low, *inner_gaps.tolist(), high)
    if len(set(gaps)) < MIN_GAPS:
        raise InputError(
            f"excite.gaps_m: the flux linkage gives the force only with {MIN_GAPS} gaps or more, best with "
            f"{GAP_COUNT} in a geometric sequence over the range of use, such as from {1e3 * low:g} mm to "
            f"{1e3 * max(high, 3.0 * low):g} mm; add gaps",
            code="too-few-gaps",
            key="excite.gaps_m",
        )
    return gaps


def design_voltage_record(specimen: Specimen, peak: float, operating: float = 0.0) -> list[Record]:
    """Return the record of a gap. Small cycles need no operating point, so its current has no effect."""
    del operating
    ramp = peak / (specimen.sweep_rate * specimen.sample_s)  # samples
    pieces = [np.zeros(1)]
    for begin, end in pairwise(REVERSALS_TO_PEAK):
        count = math.ceil(ramp * (abs(end - begin) or 1.0) - 1e-6)
        pieces.append(peak * np.linspace(begin, end, count + 1)[1:])
    reversals, approach, history = design_approach(specimen, peak)
    return [Record("voltage", reversals, approach, np.concatenate(pieces), history, specimen.sample_s)]


def plan_voltage(specimen: Specimen) -> Specimen:
    """Return a specimen with the gaps, the rate and the sampling of a measurement of voltage."""
    coil = specimen.coil
    if coil is None:
        raise InputError(
            'sensor: --voltage needs a [[sensor]] of = "voltage"; add one with range_V, adc_bits and noise_V',
            code="missing",
            key="sensor",
        )
    if coil.resistance is None:
        raise InputError(
            "circuit.resistance_ohm: --voltage needs the resistance of the winding; add it to the file of "
            "the solenoid",
            code="missing",
            key="circuit.resistance_ohm",
        )
    if specimen.max_force.key == "excite.force_max_N":
        raise InputError(
            "excite.force_max_N: the force is not measured with --voltage; limit excite.current_max_A instead",
            code="option-not-for-this",
            key="excite.force_max_N",
        )
    specimen = replace(specimen, gaps=select_gaps(specimen), max_force=Bound(math.inf, "sensor"))
    peak = specimen.max_current.value
    assert specimen.held_rig is not None
    path = np.linspace(0.0, peak, SAMPLES_PER_RAMP)
    largest_psi = specimen.held_rig.magnet().run(path, np.full(path.size, min(specimen.gaps)))[-1, 1]
    ramp_s = max(
        RAMP_TIME_CONSTANTS * float(largest_psi) / (coil.resistance * peak),
        peak / specimen.max_rate.value,
        SAMPLES_PER_RAMP * MIN_SAMPLE_S,
    )
    digits = 1 - math.floor(math.log10(ramp_s / SAMPLES_PER_RAMP))
    sample_s = round(ramp_s / SAMPLES_PER_RAMP + 0.5 * 10.0**-digits, digits)  # two digits, rounded up
    return replace(specimen, sweep_rate=peak / (SAMPLES_PER_RAMP * sample_s), sample_s=sample_s)


def measure_voltage(specimen: Specimen, progress: Progress | None = None) -> Excitation:
    """Measure current and voltage at each gap, from the largest to the smallest."""
    specimen = plan_voltage(specimen)
    peak = find_thermal_peak(specimen, design_voltage_record)
    assert specimen.held_rig is not None
    assert specimen.coil is not None
    magnet, log = specimen.held_rig.magnet(), DriveLog(specimen)
    loops, probed_gaps = [], []
    gaps = sorted(specimen.gaps, reverse=True)
    (record,) = design_voltage_record(specimen, peak.value)
    for number, gap in enumerate(gaps):
        log.rest_at_zero(specimen.pause_s if number else 0.0, gap)
        log.cool_for(record.full_path(specimen.sample_s), gap)
        log.append(record.approach, gap)
        for reversal in record.approach_reversals:
            magnet.hold(reversal, gap)
        time = log.append(record.path, gap)
        voltage = _voltage(specimen.coil, magnet, log, gap, record.path)
        sensors = specimen.held_rig.sensors([number, 0], specimen.sample_s)
        current, reading = sensors["current"].read(record.path), sensors["voltage"].read(voltage)
        schedule = np.full(time.size, gap)
        loops.append(Loop(f"{1e3 * gap:g}mm", current, reading, schedule, time, record.history))
        probed_gaps.append(ProbedGap(gap, peak, float(np.abs(voltage).max()), 0.0, is_force_reached=True))
        if progress is not None:
            progress(number + 1, len(gaps))
    output = "voltage" if specimen.coil.sense_turns is None else "sense_voltage"
    names = QUANTITIES["current"], QUANTITIES[output], QUANTITIES["gap"]
    notes = (*_describe_plan(specimen, record.history), *describe_restrictions(specimen, probed_gaps))
    specimen = replace(specimen, output="voltage")
    return Excitation(Loops(tuple(loops), *names), specimen, tuple(probed_gaps), log.history(), notes)


def _voltage(
    coil: MeasuredCoil, magnet: HeldMagnet, log: DriveLog, gap: float, path: FloatArray
) -> FloatArray:
    """Return the mean voltage of each sample, V, along the currents that were appended last."""
    sample, winding = log.specimen.sample_s, log.specimen.winding
    between = np.repeat(path, 2)[1:]
    between[1::2] = 0.5 * (path[1:] + path[:-1])
    between = np.append(between, path[-1])
    psi = magnet.run(between, np.full(between.size, gap), 0.5 * sample)[:, 1]
    half_steps = psi[1::2]
    slope = np.diff(half_steps, prepend=psi[0]) / sample
    if coil.sense_turns is not None:
        return np.asarray(coil.sense_turns / coil.turns * slope)
    assert coil.resistance is not None
    warmth = log.row_blocks[-1][3]
    rise = 0.0 if winding is None else COPPER_PER_KELVIN * winding.rise * warmth
    return np.asarray(coil.resistance * (1.0 + rise) * path + slope)


def _describe_plan(specimen: Specimen, history: History) -> list[str]:
    gaps = ", ".join(f"{1e3 * gap:g}" for gap in sorted(specimen.gaps))
    ramp_s = SAMPLES_PER_RAMP * specimen.sample_s
    notes = [
        f"{len(specimen.gaps)} gaps, {gaps} mm: {MIN_GAPS} determine the reluctance of the gap and the leakage, "
        f"a fourth tests them; best is a geometric sequence over the range of use",
        f"ramps of {ramp_s:.3g} s from zero to the largest current, sampled every {specimen.sample_s:.3g} s",
    ]
    if history.kind != "demagnetised":
        notes.append(
            "the remanent flux linkage at the beginning of the records is unknown, because the source does not "
            "drive as far below zero as above; demagnetise with another one (excite.current_low_A)"
        )
    return notes
