"""Fit the flux circuit of a magnet to loops of flux linkage over current at several gaps.

The hysteresis of the yoke adds to the magnetomotive force of gap, leakage and armature
(:mod:`anhyst.model.flux_map`)::

    i - i_0 = h(psi) + sum_j (c_j + d_j*psi**2)*stop_j[psi] + v(psi, x)

The coefficients of the yoke enter linearly: they are solved by nonnegative least squares within
every step of the search for the circuit. The difference of the currents at equal flux and equal
history of the flux determines how the reluctance changes over the gap, and so the force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from scipy.linalg import orth
from scipy.optimize import OptimizeResult, least_squares, nnls

from anhyst.identification.flux_records import STOP_THRESHOLDS, FluxRecords
from anhyst.model.flux_map import FluxMap, hinges
from anhyst.support.numeric import FloatArray, rms

ARMATURE_KNOTS = np.array([0.45, 0.6, 0.7, 0.8, 0.9])
YOKE_KNOTS = np.array([0.3, 0.45, 0.6, 0.7, 0.8, 0.87, 0.94])
"""Knots of the anhysteretic curves, relative to the largest flux linkage."""

_NOISE = 2e-3
"""Expected deviation of a sample, relative to the largest flux linkage, against the priors."""

_GAP_ZERO_SIGMA_M = 10e-6
"""Standard deviation of the zero of the gap sensor."""

_LARGEST_SHIFT = 0.3
_LOG_FRINGE = np.log(0.4), 1.2
"""Mean and standard deviation of the logarithm of the fringe permeance, relative to that of the
pole at a gap of 1 mm."""
_LEAKAGE_SLOPE = 0.3, 0.5
"""The same of the relative slope of the leakage, per mm."""
_LEAKAGE_SIGMA = 0.3
_SATURATION_SIGMA = 3.0

_STARTS = ((0.03, 0.3), (0.15, 1.0), (0.3, 1.8))
"""First values of the leakage and of the relative fringe permeance per mm. With a single first value,
the search ends in a wrong minimum for some magnets."""

_START_SATURATION = 0.05
_MAX_EVALUATIONS = 60
_MAX_NNLS_STEPS = 2000


@dataclass(frozen=True)
class ForceReading:
    """A static force that was measured at a known current and gap."""

    current: float  # A
    gap: float  # m
    force: float  # N


@dataclass(frozen=True)
class PoleArea:
    """Pole faces and turns, from a drawing."""

    area: float  # cross-section of a single gap with the same permeance, m^2
    turns: float


@dataclass(frozen=True)
class Knowledge:
    """Normalised values of the circuit that do not come from the loops."""

    # flux linkages, gaps, forces and standard deviations of the forces of static readings
    readings: tuple[tuple[float, float, float, float], ...] = ()
    # logarithm of the permeance `pole`, and its standard deviation
    pole: tuple[float, float] | None = None
    # shifts of the means of the priors, in standard deviations; for tests of their influence
    prior_shifts: FloatArray | float = 0.0


@dataclass(frozen=True)
class CircuitFit:
    """A fitted flux circuit in normalised units."""

    records: FluxRecords
    parameters: FloatArray  # parameters of the search
    deviations: FloatArray  # deviations of the samples, as flux linkages
    free: FloatArray  # offset of the current, and drift of each record
    yoke: FloatArray  # other coefficients of the yoke
    cost: float

    @cached_property
    def circuit(self) -> FluxMap:
        """The fitted circuit, normalised."""
        return _make_circuit(self.parameters)

    @property
    def flux_rms(self) -> float:
        """Rms deviation, relative to the largest flux linkage."""
        return rms(self.deviations)

    def in_si(self) -> FluxMap:
        """Return the fitted circuit in SI units."""
        circuit, (current, flux, gap) = self.circuit, self.records.scales
        permeance = flux / current
        return FluxMap(
            pole=circuit.pole * permeance * gap,
            fringe=circuit.fringe * permeance,
            gap_zero=circuit.gap_zero * gap,
            leakage=circuit.leakage * permeance,
            leakage_slope=circuit.leakage_slope * permeance / gap,
            leakage_gap=gap,
            armature_knots=tuple((ARMATURE_KNOTS * flux).tolist()),
            armature_weights=tuple((np.array(circuit.armature_weights) * current / flux**2).tolist()),
            largest_flux=flux,
        )

    @property
    def drifts(self) -> FloatArray:
        """Drift of the flux linkage during each record, relative to the largest; shape (records,)."""
        return -self.free[1:]

    def flux_at(self, current: float, gap: float) -> float:
        """Return the normalised flux linkage at a normalised current, risen from zero, and gap."""
        flux = np.linspace(0.0, 1.5, 3001)
        drop = self.circuit.magnetomotive_force(flux, np.full(flux.size, gap))
        stops = np.minimum(flux[:, None], STOP_THRESHOLDS)
        total = self.free[0] + yoke_functions(flux, stops) @ self.yoke + drop
        return float(np.interp(current, total, flux))


def fit_circuit(
    records: FluxRecords, knowledge: Knowledge | None = None, starts: Sequence[FloatArray] = ()
) -> CircuitFit:
    """Fit a flux circuit from several starts, by default three, and return the best fit."""
    problem = _Problem(records, knowledge or Knowledge())
    low, high = _bounds()
    best: OptimizeResult | None = None
    for start in starts or problem.starts():
        found = least_squares(
            problem, np.clip(start, low + 1e-6, high - 1e-6), bounds=(low, high),
            x_scale="jac", max_nfev=_MAX_EVALUATIONS,
        )  # fmt: skip
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    deviations, free, yoke = problem.deviations(best.x)
    return CircuitFit(records, best.x, deviations, free, yoke, float(best.cost))


@dataclass(frozen=True)
class YokeBasis:
    """Weighted functions whose sum is the current of the yoke, as QR factors.

    The offset of the current and the drift of each record have either sign. The other functions
    have coefficients that are not negative, so that the yoke cannot give energy.
    """

    free: FloatArray  # shape (n, free functions)
    functions: FloatArray  # shape (n, functions)
    free_orthogonal: FloatArray
    orthogonal: FloatArray
    triangular: FloatArray

    @classmethod
    def of(cls, records: FluxRecords) -> Self:
        """Return the basis for the flux linkages of the samples."""
        flux, weight = records.flux, records.weight[:, None]
        drift = (records.record[:, None] == np.unique(records.record)) * records.elapsed[:, None]
        free = np.hstack([weight, drift])
        functions = yoke_functions(flux, records.stops) * weight
        free_orthogonal = orth(free)  # the drift of a simulated table is a column of zeros
        rest = functions - free_orthogonal @ (free_orthogonal.T @ functions)
        return cls(free, functions, free_orthogonal, *np.linalg.qr(rest))

    def fit(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the deviations from values, and the free and the other coefficients."""
        coefficients, _ = nnls(self.triangular, self.orthogonal.T @ values, maxiter=_MAX_NNLS_STEPS)
        remainder = values - self.functions @ coefficients
        free_part = self.free_orthogonal @ (self.free_orthogonal.T @ remainder)
        free_coefficients = np.linalg.lstsq(self.free, free_part, rcond=None)[0]
        return remainder - free_part, free_coefficients, coefficients


PRIORS = 4 + ARMATURE_KNOTS.size
"""Number of priors."""


class _Problem:
    """Residuals of the fit as a function of the parameters of the circuit."""

    def __init__(self, records: FluxRecords, knowledge: Knowledge) -> None:
        self.records, self.knowledge = records, knowledge
        self.basis = YokeBasis.of(records)

    def starts(self) -> list[FloatArray]:
        """Return several first parameters of the search."""
        gap_mm = 1e3 * self.records.scales[2]
        starts = []
        for leakage, fringe_per_mm in _STARTS:
            fringe = fringe_per_mm * gap_mm
            start = np.full(5 + ARMATURE_KNOTS.size, _START_SATURATION)
            start[:5] = (
                -np.log(0.5 * (1.0 + fringe)),
                np.log(fringe),
                0.0,
                leakage,
                _LEAKAGE_SLOPE[0] * gap_mm,
            )
            starts.append(start)
        return starts

    def __call__(self, parameters: FloatArray) -> FloatArray:
        """Return deviations, priors and deviations from the readings, in standard deviations."""
        circuit = _make_circuit(parameters)
        calibration = [
            (float(circuit.force(np.array([flux]), np.array([gap]))[0]) - force) / sigma
            for flux, gap, force, sigma in self.knowledge.readings
        ]
        if self.knowledge.pole is not None:
            log_pole, sigma = self.knowledge.pole
            calibration.append((parameters[0] - log_pole) / sigma)
        priors = self._priors(parameters) - self.knowledge.prior_shifts
        return np.concatenate([self.deviations(parameters)[0] / _NOISE, priors, calibration])

    def deviations(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the deviations as flux linkages, and the free and the other coefficients of the yoke."""
        records, circuit = self.records, _make_circuit(parameters)
        drop = circuit.magnetomotive_force(records.flux, records.gap)
        return self.basis.fit((records.current - drop) * records.weight)

    def _priors(self, parameters: FloatArray) -> FloatArray:
        gap_scale = self.records.scales[2]
        gap_mm = 1e3 * gap_scale
        _, log_fringe, gap_zero, leakage, slope = parameters[:5]
        saturation = parameters[5:]
        fringe_mean, fringe_sigma = _LOG_FRINGE
        slope_mean, slope_sigma = _LEAKAGE_SLOPE
        return np.array(
            [
                gap_zero * gap_scale / _GAP_ZERO_SIGMA_M,
                (log_fringe - np.log(gap_mm) - fringe_mean) / fringe_sigma,
                (slope - slope_mean * gap_mm) / (slope_sigma * max(gap_mm, 0.5)),
                leakage / _LEAKAGE_SIGMA,
                *(saturation / _SATURATION_SIGMA),
            ]
        )


def _bounds() -> tuple[FloatArray, FloatArray]:
    """Return the smallest and the largest parameters."""
    count = ARMATURE_KNOTS.size
    low = [-6.0, -6.0, -_LARGEST_SHIFT, 0.0, -2.0, *[0.0] * count]
    high = [6.0, 3.0, _LARGEST_SHIFT, 1.5, 3.0, *[200.0] * count]
    return np.array(low), np.array(high)


def _make_circuit(parameters: FloatArray) -> FluxMap:
    """Return the normalised circuit of the parameters of the search."""
    log_pole, log_fringe, gap_zero, leakage, slope = map(float, parameters[:5])
    pole = float(np.exp(log_pole))
    return FluxMap(
        pole=pole,
        fringe=pole * float(np.exp(log_fringe)),
        gap_zero=gap_zero,
        leakage=leakage,
        leakage_slope=leakage * slope,
        leakage_gap=1.0,
        armature_knots=tuple(ARMATURE_KNOTS.tolist()),
        armature_weights=tuple(parameters[5:].tolist()),
        largest_flux=1.0,
    )


def yoke_functions(flux: FloatArray, stops: FloatArray) -> FloatArray:
    """Return the functions of the yoke: a line, convex curves and stop operators; shape (n, functions)."""
    squared = flux[:, None] ** 2
    return np.hstack([flux[:, None], hinges(flux, YOKE_KNOTS), stops, stops * squared])
