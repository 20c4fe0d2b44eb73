"""Compute irons of two families independently: individual relays, and an integrated differential
equation.

Only the physics is shared with the plant that these irons test.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.stats import norm

from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from anhyst_rigs.rig.parts.iron import DuhemSteel, PreisachSteel

PINNINGS, BIASES = 1200, 600


def reversible(steel: PreisachSteel | DuhemSteel, field: float) -> float:
    """Return the polarisation of the anhysteretic curve, T."""
    sharp = steel.saturation_sharp_T * field / math.hypot(field, steel.knee_sharp_A_per_m)
    return sharp + steel.saturation_slow_T * math.atan(field / steel.knee_slow_A_per_m) / (0.5 * math.pi)


class Relays:
    """Individual relays of equal weight that are up or down and respond to the same field."""

    def __init__(self, steel: PreisachSteel) -> None:
        self.steel = steel
        rank = norm.ppf((np.arange(PINNINGS) + 0.5) / PINNINGS)
        pinning = (steel.pinning_A_per_m * np.exp(steel.pinning_spread * rank))[:, None]
        # Each row has its own position between two ranks, so that no two relays switch together.
        shift = (0.5 + 0.618034 * np.arange(PINNINGS)[:, None]) % 1.0
        scatter = norm.ppf((np.arange(BIASES) + shift) / BIASES)
        bias = (steel.bias_A_per_m + steel.bias_by_pinning * pinning) * scatter
        self._up, self._down = bias + pinning, bias - pinning
        self._state = np.where(bias < 0.0, 1.0, -1.0)  # demagnetised: the sign of the bias

    def move(self, seen: float) -> tuple[float, float]:
        """Move the field of the relays, A/m; return the field H, A/m, and the flux density, T."""
        self._state[self._up <= seen] = 1.0
        self._state[self._down >= seen] = -1.0
        polarisation = self.steel.saturation_T * float(np.mean(self._state))
        polarisation += reversible(self.steel, seen)
        field = seen - self.steel.feedback_A_per_m_T * polarisation
        return field, MU_0 * field + polarisation


class Duhem:
    """The differential equation of Coleman and Hodgdon, integrated over the field."""

    def __init__(self, steel: DuhemSteel) -> None:
        self.steel = steel
        self.field, self.curve_field = 0.0, 0.0

    def move(self, field: float) -> float:
        """Move linearly to a field, A/m, and return the flux density, T."""
        steel, way = self.steel, math.copysign(1.0, field - self.field)
        saturation = steel.saturation_sharp_T + steel.saturation_slow_T

        def rate(h: float, state: FloatArray) -> list[float]:
            at = float(state[0])
            d = 1e-4 * steel.knee_sharp_A_per_m
            slope = (reversible(steel, at + d) - reversible(steel, at - d)) / (2.0 * d)
            share = reversible(steel, at) / saturation
            pull = steel.coercivity_A_per_m * (1.0 - steel.fading * share * share)
            grows = (pull - way * (h - at)) / steel.turning_T
            return [1.0 / (1.0 + grows * slope)]

        ends = (self.field, field)
        found = solve_ivp(rate, ends, [self.curve_field], method="DOP853", rtol=1e-10, atol=1e-8)
        self.field, self.curve_field = field, float(found.y[0, -1])
        return MU_0 * field + reversible(steel, self.curve_field)
