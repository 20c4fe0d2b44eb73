"""Relate the flux linkage of a magnet, its gap and its force by the energy balance.

The coil drives the flux of a yoke. Leakage flux passes beside the gap and the armature. With the
flux linkage ``psi`` of the yoke, ``psi_g`` of the gap, and the magnetomotive force ``v`` of gap and
armature in A (per turn)::

    v   = q(psi_g) + r(x)*psi_g             q: saturating armature, odd and convex
    psi = psi_g + p(x)*v                    p: permeance of the leakage path
    1/r = a/(x + d) + b                     a: pole faces, b: fringe field, d: zero of the gap sensor
    p   = p_m + p_x*(x - x_m)

Iron keeps or loses energy that depends only on the history of its own flux. Air is linear.
Therefore, the attraction does not depend on the branch of the hysteresis loop::

    F   = psi_g**2/2 * dr/dx - v**2/2 * dp/dx
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from anhyst.data.loops import Loop, Loops
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.toml_file import FileRecord, FiniteNumber, Numbers, Texts
from anhyst.support.units import QUANTITIES

Positive = Annotated[FiniteNumber, Field(gt=0.0)]
NotNegative = Annotated[FiniteNumber, Field(ge=0.0)]

_MAX_NEWTON_STEPS = 60
_TOLERANCE = 1e-12
_MIN_SLOPE_SHARE = 0.05
"""Smallest slope of force over flux in a Newton step, relative to that without leakage."""


def hinges(flux: FloatArray, knots: FloatArray) -> FloatArray:
    """Return the odd convex functions ``max(|flux| - knot, 0)**2``, shape (n, knots)."""
    excess = np.maximum(np.abs(flux)[:, None] - knots, 0.0)
    return np.asarray(np.sign(flux)[:, None] * excess * excess)


@dataclass(frozen=True, slots=True)
class FluxMap(FileRecord):
    """The static relation of flux linkage, gap and force, table ``[flux]`` of a model file."""

    pole: Positive  # a, permeance of the pole faces times the gap, Wb m/A
    fringe: NotNegative  # b, permeance of the fringe field, Wb/A
    gap_zero: FiniteNumber  # d, added to the measured gap, m
    leakage: NotNegative  # p_m, permeance of the leakage path at the gap `leakage_gap`, Wb/A
    leakage_slope: FiniteNumber  # p_x, Wb/(A m)
    leakage_gap: NotNegative  # x_m, m
    armature_knots: Numbers  # flux linkages from which the armature saturates further, Wb, ascending
    armature_weights: Numbers  # coefficients of `hinges` of these knots, A/Wb^2, not negative
    largest_flux: Positive  # largest measured flux linkage, Wb
    # error of the derived force that about nine of ten magnets do not exceed, mean and worst,
    # relative to the largest force; None for a map that was not identified
    mean_uncertainty: NotNegative | None = None
    worst_uncertainty: NotNegative | None = None
    # flux linkage of each loop of the identification before its first sample, and drift until its
    # last one, Wb; empty for a map that was not identified
    zeros: Numbers = ()
    drifts: Numbers = ()
    assumptions: Texts = ()  # what was assumed and calibrated, one sentence each

    def __post_init__(self) -> None:
        knots, weights = np.array(self.armature_knots), np.array(self.armature_weights)
        if knots.shape != weights.shape or (np.diff(knots) <= 0.0).any() or (knots < 0.0).any():
            text = "model flux: give one armature weight for each knot; knots must ascend from 0"
            raise InputError(text, code="not-ascending", key="armature_knots")
        if len(self.zeros) != len(self.drifts):
            text = (
                f"model flux: {len(self.zeros)} zeros and {len(self.drifts)} drifts; give one for each loop"
            )
            raise InputError(text, code="wrong-size", key="zeros")
        if (weights < 0.0).any():
            text = "model flux: armature weights must not be negative"
            raise InputError(text, code="out-of-range", key="armature_weights")

    def reluctance(self, gap: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the reluctance of the gap, A/Wb, and its slope over the gap, A/(Wb m)."""
        width = gap + self.gap_zero
        denominator = self.pole + self.fringe * width
        return width / denominator, self.pole / (denominator * denominator)

    def leakage_permeance(self, gap: FloatArray) -> FloatArray:
        """Return the permeance of the leakage path, Wb/A, at least zero."""
        permeance = self.leakage + self.leakage_slope * (gap - self.leakage_gap)
        return np.maximum(permeance, 0.0)

    def armature(self, gap_flux: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the magnetomotive force of the armature, A, and its slope over the flux, A/Wb."""
        knots, weights = np.array(self.armature_knots), np.array(self.armature_weights)
        slope = 2.0 * np.maximum(np.abs(gap_flux)[:, None] - knots, 0.0) @ weights
        return hinges(gap_flux, knots) @ weights, slope

    def gap_flux(self, flux_linkage: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the flux linkage of the gap for that of the coil, Wb; shape (n,).

        The equation is convex, so Newton steps from the flux of a linear armature descend to the
        solution.
        """
        (reluctance, _), leakage = self.reluctance(gap), self.leakage_permeance(gap)
        linear_slope = 1.0 + leakage * reluctance
        size = np.abs(flux_linkage)
        flux = size / linear_slope
        for _ in range(_MAX_NEWTON_STEPS):
            saturation, saturation_slope = self.armature(flux)
            error = linear_slope * flux + leakage * saturation - size
            step = error / (linear_slope + leakage * saturation_slope)
            flux = flux - step
            if np.abs(step).max(initial=0.0) <= _TOLERANCE * self.largest_flux:
                break
        return np.asarray(np.copysign(flux, flux_linkage))

    def magnetomotive_force(self, flux_linkage: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the magnetomotive force of gap and armature, A, for a flux linkage of the coil, Wb."""
        flux = self.gap_flux(flux_linkage, gap)
        return np.asarray(self.armature(flux)[0] + self.reluctance(gap)[0] * flux)

    def force(self, flux_linkage: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the attraction, N, for a flux linkage, Wb, and a gap, m; shape (n,)."""
        return self._force_of_gap_flux(self.gap_flux(flux_linkage, gap), gap)[0]

    def _force_of_gap_flux(self, flux: FloatArray, gap: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the force and its slope over the flux linkage of the gap."""
        reluctance, reluctance_slope = self.reluctance(gap)
        saturation, saturation_slope = self.armature(flux)
        drop = saturation + reluctance * flux
        leakage_slope = np.where(self.leakage_permeance(gap) > 0.0, self.leakage_slope, 0.0)
        force = 0.5 * flux * flux * reluctance_slope - 0.5 * drop * drop * leakage_slope
        slope = flux * reluctance_slope - drop * leakage_slope * (saturation_slope + reluctance)
        return force, slope

    def flux_linkage(self, force: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the flux linkage of the coil, Wb and not negative, for a force, N; shape (n,)."""
        target = np.maximum(force, 0.0)
        reluctance, reluctance_slope = self.reluctance(gap)
        flux = np.sqrt(2.0 * target / reluctance_slope)
        for _ in range(_MAX_NEWTON_STEPS):
            reached, slope = self._force_of_gap_flux(flux, gap)
            smallest_slope = _MIN_SLOPE_SHARE * np.maximum(flux, 1e-9 * self.largest_flux) * reluctance_slope
            step = (reached - target) / np.maximum(slope, smallest_slope)
            flux = np.maximum(flux - step, 0.0)
            if np.abs(step).max(initial=0.0) <= _TOLERANCE * self.largest_flux:
                break
        drop = self.armature(flux)[0] + reluctance * flux
        return np.asarray(flux + self.leakage_permeance(gap) * drop)

    def corrected_loops(self, loops: Loops) -> Loops:
        """Return the loops of flux linkage of the identification with their zero and without drift."""
        if len(loops) != len(self.drifts):
            raise InputError(
                f"{len(loops)} loops, but the force was derived from {len(self.drifts)}; identify again",
                code="source-changed",
            )
        return loops.with_loops(
            replace(loop, output=loop.output + zero - drift * elapsed_fraction(loop))
            for loop, zero, drift in zip(loops.loops, self.zeros, self.drifts, strict=True)
        )

    def force_loops(self, loops: Loops) -> Loops:
        """Return loops of flux linkage as loops of force."""
        forces = [self.force(loop.output, as_gaps(loop)) for loop in loops.loops]
        converted = [replace(loop, output=force) for loop, force in zip(loops.loops, forces, strict=True)]
        return replace(loops, loops=tuple(converted), output=QUANTITIES["force"])


def as_gaps(loop: Loop) -> FloatArray:
    """Return the gap of each sample of a loop."""
    assert loop.schedule is not None
    return loop.schedule


def elapsed_fraction(loop: Loop) -> FloatArray:
    """Return the time of each sample as a fraction of the record."""
    if loop.time is None:
        return np.linspace(0.0, 1.0, loop.n)
    return np.asarray((loop.time - loop.time[0]) / (loop.time[-1] - loop.time[0]))
