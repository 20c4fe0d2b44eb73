"""Irons of two families that no law of the package describes: Preisach, and friction in the flux.

Both relate field and flux density exactly along monotonic paths of any length, in either direction.
They share no code with the package.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import brentq

from anhyst.support.numeric import FloatArray

MU_0 = 4e-7 * np.pi
Floats = FloatArray


class Iron(Protocol):
    """Iron with hysteresis, in series with a part that needs ampere-turns of its own."""

    def move(self, excitation: float, length: float, outside: float) -> float:
        """Solve ``length*H + outside*B = excitation``, change the state and return B, T."""


@dataclass(frozen=True)
class PreisachSteel:
    """Density of switching fields: pinning ``c`` and bias ``u`` of a relay, and not separable.

    A relay switches up at ``u + c`` and down at ``u - c``. Relays with equal pinning share a play
    operator ``p <- clip(p, H - c, H + c)``; relays with ``u < p`` are up. The biases for a pinning
    have a logistic distribution that is wider for stronger pinning, so that ``M = sum_c w_c *
    tanh(p_c/s_c)``.
    """

    saturation: float  # T
    pinning: float  # A/m, median pinning of the relays
    pinning_spread: float  # standard deviation of its logarithm
    bias: float  # A/m, width of the biases without pinning
    bias_by_pinning: float  # A/m of bias for each A/m of pinning
    reversible_fraction: float
    relays: int = 60


class PreisachIron:
    """A sample of such steel; starts demagnetised."""

    def __init__(self, steel: PreisachSteel) -> None:
        rank = (np.arange(steel.relays) + 0.5) / steel.relays
        logistic = np.log(rank / (1.0 - rank)) * np.sqrt(3.0) / np.pi
        pinned = steel.pinning * np.exp(steel.pinning_spread * logistic)
        share = (1.0 - steel.reversible_fraction) / steel.relays
        self._pinning = np.concatenate(([0.0], pinned))
        self._bias = steel.bias + steel.bias_by_pinning * self._pinning
        self._weights = steel.saturation * np.r_[steel.reversible_fraction, np.full(pinned.size, share)]
        self._plays = np.zeros(pinned.size + 1)
        self._field = 0.0

    def _moved(self, field: float) -> Floats:
        moved: Floats = np.clip(self._plays, field - self._pinning, field + self._pinning)
        return moved

    def _flux_density(self, field: float) -> float:
        return MU_0 * field + float(self._weights @ np.tanh(self._moved(field) / self._bias))

    def move(self, excitation: float, length: float, outside: float) -> float:
        def excess(field: float) -> float:
            return excitation - length * field - outside * self._flux_density(field)

        # B never falls as H rises, so the field cannot change by more than this.
        end = self._field + excess(self._field) / length
        if abs(end - self._field) > 1e-9:  # smaller values are rounding errors of either sign
            self._field = float(brentq(excess, self._field, end, xtol=1e-10))
        flux_density = self._flux_density(self._field)
        self._plays = self._moved(self._field)
        return flux_density


@dataclass(frozen=True)
class FrictionSteel:
    """Magnetisation curve ``H = H_0*(b + b**9)``, ``b = B/B_0``, plus dry friction.

    The friction is Dahl's model ``dz/dB = (sign(dB) - z)/B_f``, and needs a field ``H_c*z``.
    """

    knee_field: float  # H_0, A/m
    knee_flux: float  # B_0, T
    coercivity: float  # H_c, A/m
    friction_flux: float  # B_f, T: travel in which the friction reverses


class FrictionIron:
    """A sample of such steel; starts demagnetised."""

    def __init__(self, steel: FrictionSteel) -> None:
        self._steel = steel
        self._flux_density = 0.0
        self._friction = 0.0

    def _moved(self, flux_density: float) -> float:
        way = flux_density - self._flux_density
        end = float(np.sign(way))
        return end + (self._friction - end) * float(np.exp(-abs(way) / self._steel.friction_flux))

    def _field(self, flux_density: float) -> float:
        steel = self._steel
        share = flux_density / steel.knee_flux
        return steel.knee_field * (share + share**9) + steel.coercivity * self._moved(flux_density)

    def move(self, excitation: float, length: float, outside: float) -> float:
        def excess(flux_density: float) -> float:
            return excitation - length * self._field(flux_density) - outside * flux_density

        # The curve alone needs at least outside*B, and friction adds at most H_c.
        slack = length * self._steel.coercivity * 2.0 + 1e-12
        here = self._flux_density
        reach = (abs(excitation) + slack) / outside + abs(here)
        start = excess(here)
        if start != 0.0:
            end = reach if start > 0.0 else -reach
            there = float(brentq(excess, here, end, xtol=1e-14))
            self._friction = self._moved(there)
            self._flux_density = there
        return self._flux_density
