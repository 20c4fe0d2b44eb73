"""A piece of iron in physical units: the laws and the common equation for whole records.

This is a readable reference that is independent of the C core. A solution and its commit are
separate: :meth:`Iron.solve_forward` and :meth:`Iron.solve_inverse` return a trial step and change
nothing. The caller continues from the state that actually occurred.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.oracles.effective_field import EffectiveField, StepKind
from tests.oracles.equation import NO_EDDY, Eddy, Use, forward_use, inverse_use, solve
from tests.oracles.jiles_atherton_1986 import JilesAtherton1986
from tests.oracles.operator import DEMAGNETISED, LawState

LawName = Literal["effective-field", "jiles-atherton-1986"]


class SolvedSample(NamedTuple):
    """Trial step: a solved sample that is not committed yet.

    Attributes
    ----------
    state : LawState
        The state to go on from if the sample really happens.
    b : float
        Flux density, T.
    h : float
        Field in the iron, A/m.
    drive : float
        Field, or ``c_H*I`` through the gap, A/m.
    """

    state: LawState
    b: float
    h: float
    drive: float


@dataclass(frozen=True)
class Iron:
    """A law with its parameters in physical units.

    Parameters
    ----------
    m_s : float
        Saturation magnetisation ``M_s > 0``, A/m.
    a : float
        Shape field ``a > 0``, A/m.
    k : float
        Pinning field ``k > 0``, A/m.
    c : float
        Reversible fraction, 0 to 1.
    alpha : float
        Coupling of eq. 2, below 1, dimensionless.
    r_d : float, optional
        Half-width of the play, A/m.
    law : {"effective-field", "jiles-atherton-1986"}, optional
        Name of the law.
    step : {"exact", "linear"}, optional
        Step of the law `effective-field`.

    Raises
    ------
    InputError
        If a parameter is out of range.

    Examples
    --------
    >>> iron = Iron(m_s=1.2e6, a=300.0, k=150.0, c=0.2, alpha=1e-4)
    >>> b, h, state = iron.forward([0.0, 200.0, 400.0])
    >>> drive, h, state = iron.inverse(b)
    >>> drive.round(6).tolist()
    [0.0, 200.0, 400.0]
    """

    m_s: float
    a: float
    k: float
    c: float
    alpha: float
    r_d: float = 0.0
    law: LawName = "effective-field"
    step: StepKind = "exact"

    def __post_init__(self) -> None:
        for name, value in (("M_s", self.m_s), ("a", self.a)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(
                    f"{name}: must be positive and finite; correct {name}", code="not-above-zero", key=name
                )
        if not (np.isfinite(self.alpha) and self.alpha < 1.0):
            raise InputError(
                "alpha: must be finite and below 1; correct alpha", code="out-of-range", key="alpha"
            )
        _ = self.operator

    @cached_property
    def operator(self) -> EffectiveField | JilesAtherton1986:
        """The law, normalised to ``M_s = a = 1``."""
        kappa, play = self.k / self.a, self.r_d / self.a
        if self.law == "effective-field":
            return EffectiveField(kappa, self.c, play, self.step)
        if self.law == "jiles-atherton-1986":
            return JilesAtherton1986(kappa, self.c, self.alpha * self.c * self.m_s / self.a, play)
        raise InputError(
            f"law: {self.law!r} is unknown; use effective-field", code="unknown-choice", key="law"
        )

    def magnetisation(self, state: LawState) -> float:
        """Return the magnetisation ``M`` in a state, A/m (eq. 8)."""
        return self.m_s * self.operator.magnetisation(state)

    def field(self, state: LawState) -> float:
        """Return the field ``H = x - alpha*M`` in a state, A/m (eq. 2)."""
        return self.a * state.x - self.alpha * self.magnetisation(state)

    def flux_density(self, state: LawState) -> float:
        """Return ``B = mu0*(H + M)`` in a state, T (eq. 9)."""
        return MU_0 * (self.a * state.x + (1.0 - self.alpha) * self.magnetisation(state))

    def solve_forward(
        self, state: LawState, drive: float, rho: float = 0.0, eddy: Eddy = NO_EDDY
    ) -> SolvedSample:
        """Return the trial step for a drive.

        Parameters
        ----------
        state : LawState
            State of the previous sample.
        drive : float
            Field, or ``c_H*I`` through the gap, A/m.
        rho : float, optional
            Reluctance ratio of the gap, ``>= 0``.
        eddy : Eddy, optional
            Eddy currents.

        Returns
        -------
        SolvedSample
            Solved, not committed.
        """
        after = self._solve(state, forward_use(self.alpha, drive, rho, eddy))
        return SolvedSample(after, self.flux_density(after), self.field(after), drive)

    def solve_inverse(
        self, state: LawState, b: float, rho: float = 0.0, eddy: Eddy = NO_EDDY
    ) -> SolvedSample:
        """Return the trial step for a flux density `b` (T), with its drive.

        Parameters are those of :meth:`solve_forward`.
        """
        after = self._solve(state, inverse_use(self.alpha, b))
        h = self.field(after)
        return SolvedSample(after, b, h, h + (rho + eddy.e) * b / MU_0 - eddy.memory)

    def forward(
        self, drive: ArrayLike, rho: ArrayLike = 0.0, eddy: ArrayLike = 0.0, state: LawState = DEMAGNETISED
    ) -> tuple[FloatArray, FloatArray, LawState]:
        """Return flux density and field for a record of the drive.

        Parameters
        ----------
        drive : array_like, shape (n,)
            Field, or ``c_H*I`` through the gap, A/m.
        rho : array_like, shape (n,) or scalar, optional
            Reluctance ratio of the gap.
        eddy : array_like, shape (n,) or scalar, optional
            ``gamma/dt``, A/(m T); backward Euler.
        state : LawState, optional
            State before the first sample.

        Returns
        -------
        b : ndarray, shape (n,)
            Flux density, T.
        h : ndarray, shape (n,)
            Field in the iron, A/m.
        state : LawState
            State after the last sample.
        """
        return self._run("forward", drive, rho, eddy, state)

    def inverse(
        self, b: ArrayLike, rho: ArrayLike = 0.0, eddy: ArrayLike = 0.0, state: LawState = DEMAGNETISED
    ) -> tuple[FloatArray, FloatArray, LawState]:
        """Return drive and field for a record of the flux density (T).

        Parameters are those of :meth:`forward` with `b` in place of the drive; the drive (A/m) is
        returned in place of the flux density.
        """
        return self._run("inverse", b, rho, eddy, state)

    def _solve(self, state: LawState, use: Use) -> LawState:
        """Return the state that solves the equation of a use given in physical units."""
        return solve(self.operator, state, use.w * self.m_s / self.a, use.r / self.a).state

    def _run(
        self,
        direction: Literal["forward", "inverse"],
        given: ArrayLike,
        rho: ArrayLike,
        eddy: ArrayLike,
        state: LawState,
    ) -> tuple[FloatArray, FloatArray, LawState]:
        """Solve and commit sample by sample."""
        self.operator.check_state(state)
        samples = np.atleast_1d(np.asarray(given, dtype=np.float64))
        ratios = np.broadcast_to(np.asarray(rho, dtype=np.float64), samples.shape).tolist()
        eddies = np.broadcast_to(np.asarray(eddy, dtype=np.float64), samples.shape).tolist()
        found = np.empty_like(samples)
        field = np.empty_like(samples)
        for i, sample in enumerate(samples.tolist()):
            memory = Eddy(eddies[i] * MU_0, eddies[i] * self.flux_density(state))
            if direction == "forward":
                candidate = self.solve_forward(state, sample, ratios[i], memory)
                found[i] = candidate.b
            else:
                candidate = self.solve_inverse(state, sample, ratios[i], memory)
                found[i] = candidate.drive
            field[i] = candidate.h
            state = candidate.state
        return found, field, state
