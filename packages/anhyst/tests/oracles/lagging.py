"""Common part of the two laws on the Langevin curve, without the irreversible step."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

from anhyst.support.errors import InputError
from tests.oracles.langevin import LARGEST_SLOPE, langevin_scalar, langevin_slope_scalar
from tests.oracles.operator import LawState, LawStep

_ROUNDING = 1e-9


class LaggingLaw(ABC):
    """A law whose irreversible part lags the Langevin curve (``M_s = a = 1``).

    Attributes
    ----------
    kappa : float
        Pinning field relative to the shape field, ``k/a > 0``.
    c : float
        Reversible fraction, 0 to 1.
    play : float
        Half-width of the play relative to the shape field, ``r_d/a >= 0``; 0 is none.
    """

    kappa: float
    c: float
    play: float

    def check_parameters(self) -> None:
        """Raise `InputError` if a parameter is out of range."""
        if not (math.isfinite(self.kappa) and self.kappa > 0.0):
            raise InputError("k: must be positive and finite; correct k or a", code="not-above-zero", key="k")
        if not 0.0 <= self.c <= 1.0:
            raise InputError("c: must lie in 0..1; correct c", code="out-of-range", key="c")
        if not (math.isfinite(self.play) and self.play >= 0.0):
            raise InputError(
                "r_d: must be zero or positive and finite; correct r_d", code="out-of-range", key="r_d"
            )

    @abstractmethod
    def irreversible_step(self, x0: float, y0: float, x1: float) -> tuple[float, float]:
        """Return the irreversible part at `x1` and its slope, from `y0` at `x0`."""

    @property
    def largest_reversible_slope(self) -> float:
        """Largest slope of the reversible part alone, ``c*A``."""
        return self.c * LARGEST_SLOPE

    @property
    def length_scale(self) -> float:
        """Distance over which the slope changes considerably, ``min(1, kappa)``."""
        return min(1.0, self.kappa)

    def magnetisation(self, state: LawState) -> float:
        """Return ``M/M_s`` in a state (eq. 8)."""
        return (1.0 - self.c) * state.y + self.c * langevin_scalar(state.x)

    def check_state(self, state: LawState) -> None:
        """Raise `InputError` unless ``|M_an - M_irr| <= k*A`` and the play is within ``r_d``."""
        if not all(math.isfinite(value) for value in state):
            raise InputError(
                "state: not finite; start from the demagnetised state", code="not-finite", key="state"
            )
        if abs(state.p - state.x) > self.play * (1.0 + _ROUNDING) + _ROUNDING * abs(state.x):
            raise InputError(
                "state: the self.play lies farther from the field than r_d; check r_d",
                code="state-not-reachable",
                key="state",
            )
        lag = langevin_scalar(state.p) - state.y
        if abs(lag) > self.kappa * LARGEST_SLOPE * (1.0 + _ROUNDING) + 1e-15:
            raise InputError(
                "state: |M_an - M_irr| exceeds k*A, no path leads there; start elsewhere",
                code="state-not-reachable",
                key="state",
            )

    def step(self, state: LawState, x1: float) -> LawStep:
        """Return the state after a straight change of the effective field to `x1`.

        Parameters
        ----------
        state : LawState
            Initial state.
        x1 : float
            New effective field relative to the shape field.

        Returns
        -------
        LawStep
            New state, magnetisation and the slope of the latter against `x1`.
        """
        p1 = min(max(state.p, x1 - self.play), x1 + self.play)
        y1, slope = self.irreversible_step(state.p, state.y, p1)
        driven = self.play == 0.0 or p1 != state.p
        rest = 1.0 - self.c
        return LawStep(
            LawState(x1, y1, p1),
            rest * y1 + self.c * langevin_scalar(x1),
            (rest * slope if driven else 0.0) + self.c * langevin_slope_scalar(x1),
        )
