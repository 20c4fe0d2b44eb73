"""Interface of every hysteresis law: a state, a step, a slope."""

from __future__ import annotations

from typing import NamedTuple, Protocol


class LawState(NamedTuple):
    """State of a law in units that do not depend on the parameter set.

    Attributes
    ----------
    x : float
        Effective field relative to the shape field, ``H_e/a``.
    y : float
        Irreversible magnetisation relative to saturation, ``M_irr/M_s``.
    p : float
        Position of the play relative to the shape field, ``x_p/a``; equal to `x` without play.
    """

    x: float
    y: float
    p: float


DEMAGNETISED = LawState(0.0, 0.0, 0.0)
"""The demagnetised state."""


class LawStep(NamedTuple):
    """Result of a straight change of the effective field to a new value.

    Attributes
    ----------
    state : LawState
        The new state.
    m : float
        Magnetisation relative to saturation in this state, ``M/M_s``.
    slope : float
        Slope of `m` against the new effective field, ``(a/M_s)*dM/dx``.
    """

    state: LawState
    m: float
    slope: float


class Operator(Protocol):
    """A hysteresis law in normalised form (``M_s = a = 1``)."""

    @property
    def largest_slope(self) -> float:
        """Upper bound of the slope of every step from a valid state."""

    @property
    def largest_reversible_slope(self) -> float:
        """Largest slope of the reversible part alone, ``c*A``."""

    @property
    def length_scale(self) -> float:
        """Distance over which the slope changes considerably, relative to the shape field."""

    def magnetisation(self, state: LawState) -> float:
        """Return ``M/M_s`` in a state (eq. 8)."""

    def check_state(self, state: LawState) -> None:
        """Raise `InputError` for a state that the law cannot have reached."""

    def step(self, state: LawState, x1: float) -> LawStep:
        """Return the state after a straight change of the effective field to `x1`."""
