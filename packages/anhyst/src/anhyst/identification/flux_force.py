"""Derive the force of a magnet from loops of flux linkage over current at several gaps.

A flux circuit is fitted to the loops. Its energy balance gives the force of every measured sample,
and this force has the hysteresis of the flux linkage. The model of the force is then identified
from these loops of force in the usual way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from anhyst.data.loops import Loops
from anhyst.data.symmetry import describe_flux_bias
from anhyst.data.table import check_source, read_columns
from anhyst.identification.flux_circuit import (
    PRIORS,
    CircuitFit,
    ForceReading,
    Knowledge,
    PoleArea,
    fit_circuit,
)
from anhyst.identification.flux_records import FluxRecords, prepare_records
from anhyst.model.flux_map import FluxMap, elapsed_fraction
from anhyst.model.schema import FitFigures
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0, QUANTITIES
from anhyst.support.wording import count_text

OutputName = Literal["auto", "force", "flux_linkage"]

MIN_GAPS = 3
"""Minimum number of gaps. With two gaps, the law of the reluctance over the gap stays unknown."""

_READING_SIGMA = 0.005, 0.002
"""Standard deviation of a force reading, relative to the reading and to the largest force."""

_LARGEST_CONTRADICTION = 0.15, 0.01
"""Largest deviation of a force reading from the force that the flux gives, relative to it and to the
largest force. The second part is the hysteresis at small currents."""

_LARGEST_READING = 1.1
"""Largest current of a force reading, relative to that of the loops."""

_AREA_SIGMA = 0.05
"""Relative standard deviation of the permeance of a pole from its drawing."""

_AREA_RATIOS = 0.7, 1.75
"""Accepted ratios of the pole area from the flux linkage to the one from a drawing. On 71 virtual
magnets, the ratio was 0.93 to 1.3, except 1.66 and 2.17 on two magnets whose force was wrong by 5 and
10 %. An area that is wrong by a factor of 2 is refused."""

_NEGLIGIBLE_DRIFT = 5e-4

_LARGE_DEVIATION, _LARGEST_DEVIATION = 3e-3, 1e-2
"""Rms deviations of the fit, relative to the largest flux linkage, above which a warning is given and
the force is refused."""

_LARGEST_REMANENCE, _REMANENCE_LEVELS = 1.2, 7
"""Largest current that the unknown remanence of a record corresponds to, relative to half the width of
the widest loop, and number of tried remanences."""

_EQUAL_COST = 1.1
"""Ratio of the costs of two fits below which both fits are plausible."""

_REPEATED_FITS = 12
_LEVELS = 12
_MEAN_FACTOR = 2.5
_WORST_FACTOR = 2.0
_DEVIATION_FACTOR = 1.4
"""Ratios of the stated uncertainty to the scatter of repeated fits and to the deviations of the model.
With these factors, the stated uncertainty covers about nine of ten virtual magnets."""

_CIRCUIT_ERRORS = 0.5, 10.0
"""Error of the force from the form of the circuit, mean and worst, relative to the rms deviation of the
flux linkage. Repeated fits have the same form, so their scatter does not contain this error."""

_MIN_WORST_ERROR = 0.02 / _WORST_FACTOR
"""Error of the force where the smallest gap saturates, relative to the largest force. The loops of some
magnets do not show this error."""


@dataclass(frozen=True)
class ForceCalibration:
    """Force readings and the pole area, which calibrate a derived force. Both are optional."""

    readings: tuple[ForceReading, ...] = ()
    pole: PoleArea | None = None


def read_calibration(
    force_at: PathLike | Any, pole_area: float | None, turns: float | None
) -> ForceCalibration | None:
    """Return the given calibration, or None if nothing is given."""
    if (pole_area is None) is not (turns is None):
        text = "pole_area and turns belong together; give both or neither"
        raise InputError(text, code="options-missing", key="pole_area")
    for name, value in (("pole_area", pole_area), ("turns", turns)):
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{name}: is {value:g}; it must be above 0", code="not-above-zero", key=name)
    pole = None if pole_area is None or turns is None else PoleArea(pole_area, turns)
    readings: tuple[ForceReading, ...] = ()
    if force_at is not None:
        check_source(force_at, "identify: force_at", "a file, a data frame or a dict of arrays")
        table = read_columns(force_at)
        columns = [
            np.abs(table.require(name, QUANTITIES[name].column)) for name in ("current", "gap", "force")
        ]
        readings = tuple(ForceReading(*map(float, row)) for row in zip(*columns, strict=True))
    return None if pole is None and not readings else ForceCalibration(readings, pole)


@dataclass(frozen=True)
class DerivedForce:
    """Loops of force, and the relation of flux linkage and force."""

    loops: Loops  # the measured loops, as loops of force
    # the same, and computed loops between the measured gaps, which are fitted but not reported
    fitted_loops: Loops
    flux: FluxMap
    warnings: tuple[str, ...]


def find_no_force_reason(loops: Loops) -> str:
    """Return why no force can be derived from loops; empty if it can."""
    if (loops.input.name, loops.output.name) != ("current", "flux_linkage"):
        return "the force is derived only from loops of flux linkage over current"
    count = len(loops.schedule_values)
    if loops.schedule is None or loops.schedule.name != "gap" or count < MIN_GAPS:
        gap_text = count_text(count, "gap") if loops.schedule is not None else "no column of the gap"
        return f"{gap_text}: the force needs loops at {MIN_GAPS} gaps or more, best from the smallest to the largest"
    return describe_flux_bias(loops)


def derive_force(loops: Loops, calibration: ForceCalibration, seed: int) -> DerivedForce:
    """Fit the flux circuit, and return the loops of force."""
    loops.by_schedule()  # refuses moving gaps
    first_fit = fit_circuit(prepare_records(loops))
    drifts = first_fit.drifts * first_fit.records.scales[1]
    records = prepare_records(_remove_drift(loops, drifts))
    fits = _fit_zeros(records)
    fit, knowledge = fits[0], Knowledge()
    if fit.flux_rms > _LARGEST_DEVIATION:
        raise InputError(
            f"no circuit of a yoke, one working gap and leakage follows the flux linkage: the best one "
            f"deviates by {100.0 * fit.flux_rms:.2g} % rms; measure the force, or use --output flux_linkage",
            code="circuit-does-not-fit",
            key="output",
        )
    if calibration.readings or calibration.pole is not None:
        readings = _check_readings(calibration.readings, fit)
        knowledge = Knowledge(tuple(readings), _normalise_pole(calibration.pole, fit))
        fit = fit_circuit(fit.records, knowledge, (fit.parameters,))
    drifts = drifts + fit.drifts * records.scales[1]
    first_rows = np.unique(records.record, return_index=True)[1]
    zeros = records.scales[1] * (fit.records.flux - records.flux)[first_rows]
    scatter = estimate_scatter(fit, knowledge, np.random.default_rng(seed))
    mean, worst = np.hypot(scatter, _doubt_of_zero(fits)).tolist()
    flux = replace(
        fit.in_si(),
        mean_uncertainty=mean,
        worst_uncertainty=worst,
        zeros=tuple(zeros.tolist()),
        drifts=tuple(drifts.tolist()),
        assumptions=_assumptions(fit, calibration, float(np.abs(drifts).max()) / records.scales[1]),
    )
    corrected = flux.corrected_loops(loops)
    force_loops = flux.force_loops(corrected)
    has_table = force_loops.split_tables()[0] is not None
    moved_loops = () if has_table else flux.force_loops(_move_between_gaps(corrected, flux)).loops
    fitted_loops = force_loops.with_loops([*force_loops.loops, *moved_loops])
    return DerivedForce(force_loops, fitted_loops, flux, _warnings(fit))


def _fit_zeros(records: FluxRecords) -> list[CircuitFit]:
    """Return the fits for the remanent fluxes that are about equally likely, the best first."""
    fit = fit_circuit(records)
    if not records.zero_slope.any():
        return [fit]
    currents = records.half_width * np.linspace(0.0, _LARGEST_REMANENCE, _REMANENCE_LEVELS)[1:]
    fits = [fit, *(fit_circuit(records.with_zero(current), None, (fit.parameters,)) for current in currents)]
    fits.sort(key=lambda entry: entry.cost)
    return [entry for entry in fits if entry.cost <= _EQUAL_COST * fits[0].cost]


def _doubt_of_zero(fits: Sequence[CircuitFit]) -> tuple[float, float]:
    """Return the mean and the largest difference of the force between fits, relative to the largest force."""
    forces = [entry.circuit.force(entry.records.flux, entry.records.gap) for entry in fits]
    differences = np.abs(np.array(forces) - forces[0]) / forces[0].max()
    return float(differences.mean(axis=1).max()), float(differences.max())


def _move_between_gaps(loops: Loops, flux: FluxMap) -> Loops:
    """Return loops between neighbouring gaps with the flux linkage of the smaller gap.

    At equal flux linkage, only the magnetomotive force of gap and armature depends on the gap, so
    its difference changes the measured current. A law that is fitted to these loops too is not
    interpolated over the wide steps between the measured gaps.
    """
    moved = []
    for gap, next_gap in pairwise(loops.schedule_values):
        middle_gap = math.sqrt(gap * next_gap) if gap > 0.0 else 0.5 * next_gap
        for loop in loops.at(gap).loops:
            order = np.argsort(loop.input)
            points = np.array(loop.history.turning_points)
            current = np.concatenate([points, loop.input])
            psi = np.concatenate([np.interp(points, loop.input[order], loop.output[order]), loop.output])
            gaps = np.full(current.size, middle_gap)
            change = flux.magnetomotive_force(psi, gaps) - flux.magnetomotive_force(
                psi, np.full(current.size, gap)
            )
            moved_current = current + change
            history = replace(loop.history, turning_points=tuple(moved_current[: points.size].tolist()))
            moved.append(
                replace(
                    loop, input=moved_current[points.size :], schedule=gaps[points.size :], history=history
                )
            )
    return loops.with_loops(moved)


def _remove_drift(loops: Loops, drifts: FloatArray) -> Loops:
    """Return loops without the drift of each record, Wb."""
    return loops.with_loops(
        replace(loop, output=loop.output - drift * elapsed_fraction(loop))
        for loop, drift in zip(loops.loops, drifts.tolist(), strict=True)
    )


def _force_scale(fit: CircuitFit) -> float:
    """Return the force of 1 in normalised units, N."""
    current, flux, gap = fit.records.scales
    return current * flux / gap


def _normalise_pole(pole: PoleArea | None, fit: CircuitFit) -> tuple[float, float] | None:
    """Return the normalised pole; a pole that contradicts the flux raises an error."""
    if pole is None:
        return None
    current, flux, gap = fit.records.scales
    permeance = MU_0 * pole.turns**2 * pole.area
    ratio = fit.in_si().pole / permeance
    if not _AREA_RATIOS[0] <= ratio <= _AREA_RATIOS[1]:
        raise InputError(
            f"pole area of {pole.area:g} m^2 and {pole.turns:g} turns: the flux linkage gives "
            f"{ratio * pole.area:.3g} m^2; check the area, the turns, the units and the turns of a sense "
            "coil; for two pole faces in series, give half of the area of one",
            code="area-contradicts",
            key="pole_area",
        )
    return float(np.log(permeance * current / (flux * gap))), _AREA_SIGMA


def _check_readings(
    readings: Sequence[ForceReading], fit: CircuitFit
) -> list[tuple[float, float, float, float]]:
    """Return normalised readings; a reading that contradicts the flux raises an error."""
    current_scale, _, gap_scale = fit.records.scales
    largest = float(_forces(fit.circuit, fit).max())
    rows = []
    for reading in readings:
        if reading.current > _LARGEST_READING * current_scale:
            raise InputError(
                f"force reading at {reading.current:g} A: the loops reach {current_scale:.4g} A; check the unit",
                code="reading-outside",
                key="force_at",
            )
        gap, force = reading.gap / gap_scale, reading.force / _force_scale(fit)
        flux = fit.flux_at(reading.current / current_scale, gap)
        derived = float(fit.circuit.force(np.array([flux]), np.array([gap]))[0])
        share, floor = _LARGEST_CONTRADICTION
        if abs(force - derived) > share * derived + floor * largest:
            raise InputError(
                f"force reading of {reading.force:g} N at {reading.current:g} A and {1e3 * reading.gap:g} mm: "
                f"the flux linkage gives {derived * _force_scale(fit):.4g} N; check the units, the gap and the "
                "turns of the coil",
                code="reading-contradicts",
                key="force_at",
            )
        rows.append((flux, gap, force, _READING_SIGMA[0] * force + _READING_SIGMA[1] * largest))
    return rows


def _forces(circuit: FluxMap, fit: CircuitFit) -> FloatArray:
    """Return normalised forces at levels of the flux linkage and gaps; shape (gaps, levels)."""
    rows = []
    gaps = fit.records.gaps
    for gap in np.geomspace(max(gaps[0], 0.05 * gaps[-1]), gaps[-1], 2 * gaps.size - 1):
        nearest = fit.records.gap == gaps[np.abs(gaps - gap).argmin()]
        flux = np.linspace(0.0, fit.records.flux[nearest].max(), _LEVELS + 1)[1:]
        rows.append(circuit.force(flux, np.full(flux.size, gap)))
    return np.array(rows)


def estimate_scatter(fit: CircuitFit, knowledge: Knowledge, rng: np.random.Generator) -> tuple[float, float]:
    """Return the standard error of the force, mean and worst, relative to the largest force.

    The fit is repeated with deviations whose signs are drawn, in turn for each ramp and for each
    record, and with drawn means of the priors. The scatter of these fits, the effect of each gap, if
    more than three were measured, and the error from the form of the circuit are added.
    """
    records, reference = fit.records, _forces(fit.circuit, fit)
    ramps = np.cumsum(np.diff(np.sign(np.diff(records.current, append=0.0)), prepend=0.0) != 0.0)
    errors = []
    for repeat in range(_REPEATED_FITS):
        block = (ramps, records.record)[repeat % 2]
        signs = rng.choice([-1.0, 1.0], block.max() + 1)[block] - 1.0
        current = records.current + signs * fit.deviations / records.weight
        drawn_knowledge = replace(
            knowledge,
            prior_shifts=rng.standard_normal(PRIORS),
            readings=tuple(
                (flux, gap, force + sigma * rng.standard_normal(), sigma)
                for flux, gap, force, sigma in knowledge.readings
            ),
        )
        repeated = fit_circuit(replace(records, current=current), drawn_knowledge, (fit.parameters,))
        errors.append((_forces(repeated.circuit, fit) - reference) / reference.max())
    scatter = np.sqrt(np.mean(np.square(errors), axis=0))
    mean_parts, worst_parts = [float(scatter.mean())], [float(scatter.max()), _MIN_WORST_ERROR]
    if records.gaps.size > MIN_GAPS:
        fits = [
            fit_circuit(records.without_gap(gap), knowledge, (fit.parameters,))
            for gap in records.gaps.tolist()
        ]
        changes = [(_forces(other.circuit, fit) - reference) / reference.max() for other in fits]
        effect = np.sqrt(np.mean(np.square(changes), axis=0))
        mean_parts.append(float(effect.mean()) / _MEAN_FACTOR)
        worst_parts.append(float(effect.max()) / _WORST_FACTOR)
    form_mean, form_worst = (factor * fit.flux_rms for factor in _CIRCUIT_ERRORS)
    return math.hypot(*mean_parts, form_mean), math.hypot(*worst_parts, form_worst)


def state_uncertainty(flux: FluxMap, fit: FitFigures) -> FluxMap:
    """Return a flux map whose uncertainty includes the deviations of the model from the loops."""
    assert flux.mean_uncertainty is not None
    assert flux.worst_uncertainty is not None
    mean_deviation = _DEVIATION_FACTOR * fit.mean_abs / fit.largest_output
    mean = math.hypot(_MEAN_FACTOR * flux.mean_uncertainty, mean_deviation)
    worst = _WORST_FACTOR * math.hypot(flux.worst_uncertainty, fit.worst / fit.largest_output)
    return replace(flux, mean_uncertainty=mean, worst_uncertainty=worst)


def _assumptions(fit: CircuitFit, calibration: ForceCalibration, drift: float) -> tuple[str, ...]:
    """Return what the force is based on, one sentence each."""
    gap_count = fit.records.gaps.size
    texts = [
        f"The force follows from the energy balance of the flux linkage at {gap_count} gaps.",
        "The current is slow enough that eddy currents do not matter.",
        "The same gap sensor is used for the loops and later.",
        "The armature has little hysteresis, and the flux linkage includes the flux of any permanent magnet.",
    ]
    if drift > _NEGLIGIBLE_DRIFT:
        texts.append(f"A drift of up to {100.0 * drift:.2g} % of the largest flux linkage was removed.")
    if calibration.readings:
        texts.append(f"Calibrated with {count_text(len(calibration.readings), 'force reading')}.")
    if calibration.pole is not None:
        texts.append("The area of the pole is known to 5 %.")
    return tuple(texts)


def _warnings(fit: CircuitFit) -> tuple[str, ...]:
    warnings = []
    if fit.records.zero_slope.any():
        warnings.append(
            "the flux linkage starts at zero, but the iron was not demagnetised: the remanence was "
            "estimated, and small forces are uncertain; demagnetise the iron before the record, or drive "
            "the current in both directions. If a permanent magnet biases it, all forces are wrong"
        )
    if fit.flux_rms > _LARGE_DEVIATION:
        warnings.append(
            f"the magnetic circuit follows the flux linkage only within {100.0 * fit.flux_rms:.2g} % rms of its "
            "largest value, as if several parts of the magnet saturated or a permanent magnet were in the "
            "circuit: the force can be wrong by more than stated; compare it with a measured force (--force-at)"
        )
    return tuple(warnings)
