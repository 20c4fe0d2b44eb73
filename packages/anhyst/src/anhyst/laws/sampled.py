"""Simulate whole records for a hysteresis law written in Python that computes single steps.

The circuit around the iron gives ``drive = H + (rho + e)*B/mu0 - e*B_before/mu0`` with ``B = mu0*(H
+ M)`` and ``e = mu0*gamma/dt``. The magnetisation never falls as the field rises. Therefore, the
distance of a field from the solution is at most the error of the equation there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from scipy.optimize import brentq

from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0

_OK = 0
_NOT_SETTLED = -6
_ROUNDING = 1e-12

State = tuple[float, ...]


class SampledIron(ABC):
    """Base class of laws that compute single samples; an `anhyst.laws.law.IronOperator`."""

    @abstractmethod
    def step(self, state: State, field: float) -> tuple[float, State]:
        """Return magnetisation (A/m) and state after a monotonic change to a field (A/m).

        The magnetisation must not fall as the field rises.
        """

    @abstractmethod
    def field_of(self, state: State) -> float:
        """Return the field of a state, A/m."""

    def forward(
        self, drive: FloatArray, rho: FloatArray, eddy: FloatArray, state: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, int, int]:
        """Simulate a drive; see `anhyst.laws.law.IronOperator`."""
        return *self._simulate_record(drive, rho, eddy, state, inverse=False), _OK, drive.size

    def inverse(
        self, flux_density: FloatArray, rho: FloatArray, eddy: FloatArray, state: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, int, int]:
        """Simulate a flux density; see `anhyst.laws.law.IronOperator`."""
        results = self._simulate_record(flux_density, rho, eddy, state, inverse=True)
        return *results, _OK, flux_density.size

    def settle(
        self,
        inputs: FloatArray,
        rho: FloatArray,
        eddy: FloatArray,
        state: FloatArray,
        inverse: bool = False,
        max_cycles: int = 10000,
        tol: float = 1e-12,
    ) -> tuple[FloatArray, int, int]:
        """Repeat a cycle until its state returns within a relative tolerance."""
        for cycle in range(1, max_cycles + 1):
            previous_state = state
            *_, state = self._simulate_record(inputs, rho, eddy, state, inverse=inverse)
            if np.all(np.abs(state - previous_state) <= tol * np.maximum(1.0, np.abs(state))):
                return state, cycle, _OK
        return state, max_cycles, _NOT_SETTLED

    def _simulate_record(
        self, inputs: FloatArray, rho: FloatArray, eddy: FloatArray, state: FloatArray, *, inverse: bool
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        outputs, fields = np.empty(inputs.size), np.empty(inputs.size)
        current_state: State = tuple(state.tolist())
        previous_flux = self._compute_flux(current_state, self.field_of(current_state))
        rows = zip(inputs.tolist(), rho.tolist(), (eddy * MU_0).tolist(), strict=True)
        for index, (value, gap, rate) in enumerate(rows):
            weight, start = gap + rate, current_state
            if inverse:
                field = self._solve_field(start, 0.0, 1.0, value / MU_0)
            else:
                field = self._solve_field(start, 1.0, weight, value + rate * previous_flux)
            _, current_state = self.step(start, field)
            flux = self._compute_flux(start, field)
            outputs[index] = field + weight * flux - rate * previous_flux if inverse else MU_0 * flux
            fields[index], previous_flux = field, flux
        return outputs, fields, np.array(current_state)

    def _compute_flux(self, state: State, field: float) -> float:
        """Return ``B/mu0`` at a field, from a state, A/m."""
        return field + self.step(state, field)[0]

    def _solve_field(self, state: State, field_factor: float, flux_factor: float, total: float) -> float:
        """Solve ``field_factor*H + flux_factor*B/mu0 = total`` for the field H, A/m."""

        def mismatch_at(field: float) -> float:
            return field_factor * field + flux_factor * self._compute_flux(state, field) - total

        start = self.field_of(state)
        mismatch = mismatch_at(start)
        if mismatch == 0.0:
            return start
        opposite_end = start - mismatch - np.copysign(_ROUNDING * (abs(start) + abs(total)), mismatch)
        return float(brentq(mismatch_at, start, opposite_end, xtol=1e-12, rtol=1e-14))
