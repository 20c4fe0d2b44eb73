"""One scalar equation for every use of a law: ``x + w*M(x) = r``.

The uses differ only in ``w`` and ``r``. With ``R = rho + e`` and the eddy coefficient ``e``:

======================================== ========================= ===============================
use                                      w                         r
======================================== ========================= ===============================
forward, field given                     ``-alpha``                ``H``
inverse, flux density given              ``1 - alpha``             ``B/mu0``
forward through the gap, current given   ``R/(1 + R) - alpha``     ``(c_H*I + memory)/(1 + R)``
inverse through the gap                  ``1 - alpha``             ``B/mu0``
======================================== ========================= ===============================

The field is then ``H = x - alpha*M``, and the drive through the gap is
``c_H*I = H + rho*B/mu0 + e*B/mu0 - memory``. The gap reluctance ratio is ``rho``; the eddy field
``gamma*dB/dt`` is discretised as ``e*B/mu0 - memory``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from scipy.optimize import brentq

from anhyst.support.errors import InputError
from anhyst.support.units import MU_0
from tests.oracles.operator import LawState, LawStep, Operator

_RTOL = 4.0 * 2.220446049250313e-16
_SHORTEST_STRIDE = 1e-3


class Use(NamedTuple):
    """Weight and right side of the equation for one use of a law.

    Attributes
    ----------
    w : float
        Weight of the magnetisation, dimensionless.
    r : float
        Right side, A/m.
    """

    w: float
    r: float


class Eddy(NamedTuple):
    """The eddy field ``gamma*dB/dt`` as ``e*B/mu0 - memory``.

    Attributes
    ----------
    e : float
        Coefficient of ``B/mu0``, dimensionless.
    memory : float
        Known part from the previous sample, A/m.
    """

    e: float
    memory: float


NO_EDDY = Eddy(0.0, 0.0)
"""No eddy currents."""


def backward_euler(gamma: float, dt: float, b0: float) -> Eddy:
    """Return the eddy field with ``dB/dt = (B - B0)/dt``.

    Parameters
    ----------
    gamma : float
        Eddy current constant, A s/(m T).
    dt : float
        Time step, s.
    b0 : float
        Flux density of the previous sample, T.

    Returns
    -------
    Eddy
        Coefficient and memory; first order in `dt`.
    """
    return Eddy(gamma * MU_0 / dt, gamma * b0 / dt)


def trapezoid(gamma: float, dt: float, b0: float, rate0: float) -> Eddy:
    """Return the eddy field with ``dB/dt = 2*(B - B0)/dt - rate0``.

    Parameters
    ----------
    gamma : float
        Eddy current constant, A s/(m T).
    dt : float
        Time step, s.
    b0 : float
        Flux density of the previous sample, T.
    rate0 : float
        ``dB/dt`` of the previous sample, T/s.

    Returns
    -------
    Eddy
        Coefficient and memory; second order in `dt`.
    """
    return Eddy(2.0 * gamma * MU_0 / dt, gamma * (2.0 * b0 / dt + rate0))


def voltage_drive(
    voltage: float, c_h: float, resistance: float, flux_per_tesla: float, eddy: Eddy, rate: Eddy
) -> tuple[float, Eddy]:
    """Return the drive and the eddy term that turn a current drive into a voltage drive.

    From ``u = R_c*I + N*S*dB/dt`` follows ``c_H*I = c_H*u/R_c - (c_H*N*S/R_c)*dB/dt``: the winding
    acts like an additional eddy current.

    Parameters
    ----------
    voltage : float
        Voltage across the winding, V.
    c_h : float
        Field per current, 1/m.
    resistance : float
        Resistance of the winding, ohm.
    flux_per_tesla : float
        Turns times pole area, m^2.
    eddy : Eddy
        The eddy currents of the iron.
    rate : Eddy
        `backward_euler` or `trapezoid` for a `gamma` of 1.

    Returns
    -------
    drive : float
        Equivalent of ``c_H*I``, A/m.
    eddy : Eddy
        Equivalent of the eddy currents.
    """
    factor = c_h * flux_per_tesla / resistance
    total = Eddy(eddy.e + factor * rate.e, eddy.memory + factor * rate.memory)
    return c_h * voltage / resistance, total


def forward_use(alpha: float, drive: float, rho: float = 0.0, eddy: Eddy = NO_EDDY) -> Use:
    """Return the equation of the forward use, from the drive to the flux density.

    Parameters
    ----------
    alpha : float
        Coupling of eq. 2, dimensionless.
    drive : float
        Field, or ``c_H*I`` through a gap, A/m.
    rho : float, optional
        Ratio of the gap reluctance to that of the iron path filled with air, dimensionless.
    eddy : Eddy, optional
        Eddy currents.

    Returns
    -------
    Use
        Weight and right side.
    """
    reluctance = rho + eddy.e
    return Use(reluctance / (1.0 + reluctance) - alpha, (drive + eddy.memory) / (1.0 + reluctance))


def inverse_use(alpha: float, b: float) -> Use:
    """Return the equation of the inverse use, from the flux density to the field.

    Parameters
    ----------
    alpha : float
        Coupling of eq. 2, dimensionless.
    b : float
        Flux density, T.

    Returns
    -------
    Use
        Weight and right side.
    """
    return Use(1.0 - alpha, b / MU_0)


def refuse(law: Operator, omega: float) -> None:
    """Raise `InputError` if even the reversible part would jump, ``-w*c*A > 1``.

    Parameters
    ----------
    law : Operator
        The law, normalised.
    omega : float
        Weight of the magnetisation, ``w*M_s/a``.

    Raises
    ------
    InputError
        If the equation has no stable solution whatever the state.
    """
    if -omega * law.largest_reversible_slope > 1.0:
        raise InputError(
            "alpha: the reversible part jumps (-w*c*M_s/(3*a) > 1); lower alpha or c",
            code="reversible-part-jumps",
            key="alpha",
        )


def may_jump(law: Operator, omega: float) -> bool:
    """Whether the equation may have several solutions, ``1 + w*A <= 0``."""
    return 1.0 + omega * law.largest_slope <= 0.0


def solve(law: Operator, state: LawState, omega: float, r: float) -> LawStep:
    """Return the step that solves ``x + omega*m(x) = r``; the state is not touched.

    Parameters
    ----------
    law : Operator
        The law, normalised.
    state : LawState
        A valid state to start from.
    omega : float
        Weight of the magnetisation, ``w*M_s/a``.
    r : float
        Right side relative to the shape field, ``r/a``.

    Returns
    -------
    LawStep
        The trial step. To commit it, continue from its ``state``.

    Raises
    ------
    InputError
        If the parameters are rejected, see :func:`refuse`, or `r` is not finite.

    Notes
    -----
    With ``0 <= dm/dx <= A`` and ``1 + omega*A > 0`` the root is unique and lies between ``d`` and
    ``d/(1 + omega*A)`` from the start, ``d = r - x0 - omega*m0``. Otherwise there may be jumps and
    the first root in the direction of ``d`` is searched along the path.
    """
    refuse(law, omega)
    if not math.isfinite(r):
        raise InputError("drive: not finite; remove the sample", code="not-finite", key="drive")
    m0 = law.magnetisation(state)
    d = r - state.x - omega * m0
    if d == 0.0:
        return law.step(state, state.x)

    def residual(x: float) -> float:
        return x + omega * law.step(state, x).m - r

    if may_jump(law, omega):
        return law.step(state, _walk(law, state, omega, r))
    near, far = sorted((d, d / (1.0 + omega * law.largest_slope)), key=abs)
    # The residual rises along the path. Doubling from the near end avoids long steps.
    while 2.0 * abs(near) < abs(far) and residual(state.x + 2.0 * near) * d < 0.0:
        near *= 2.0
    far = math.copysign(min(abs(far), 2.0 * abs(near)), d)
    # Rounding may move the root out of the interval by a few ulp; therefore, it is widened.
    slack = 8.0 * _RTOL * (abs(state.x) + abs(r) + abs(omega) * (1.0 + abs(m0)))
    widen = math.copysign(slack, d)
    first = state.x + (near - widen if abs(near) > slack else 0.0)
    return law.step(state, _root(residual, first, state.x + far + widen))


def _root(residual: Callable[[float], float], first: float, last: float) -> float:
    """Return the root between two ends, or the better end if rounding prevents a sign change."""
    at_first, at_last = residual(first), residual(last)
    if at_first * at_last >= 0.0:
        return first if abs(at_first) < abs(at_last) else last
    return float(brentq(residual, first, last, xtol=1e-18, rtol=_RTOL, maxiter=300))


def _walk(law: Operator, state: LawState, omega: float, r: float) -> float:
    """Return the first root in the direction of travel if there may be several.

    The weight is negative, so that the residual rises along the path with a slope of at most 1. A
    stride as long as the magnitude of the residual cannot pass a root. Near zero the strides are
    short. If the slope changes its sign within a stride, the maximum between is tested for a pair
    of roots.
    """
    sg = 1.0 if r - state.x - omega * law.magnetisation(state) > 0.0 else -1.0

    def climb(x: float) -> float:
        return sg * (x + omega * law.step(state, x).m - r)

    def slope(x: float) -> float:
        return 1.0 + omega * law.step(state, x).slope

    shortest = _SHORTEST_STRIDE * law.length_scale
    x = math.nextafter(state.x, sg * math.inf)
    depth, steepness = climb(x), slope(x)
    while depth < 0.0:
        ahead = x + sg * max(-depth, shortest)
        depth_ahead, steepness_ahead = climb(ahead), slope(ahead)
        if depth_ahead >= 0.0:
            return _root(climb, x, ahead)
        if steepness > 0.0 > steepness_ahead:
            summit = _root(slope, x, ahead)
            if climb(summit) >= 0.0:
                return _root(climb, x, summit)
        x, depth, steepness = ahead, depth_ahead, steepness_ahead
    return x
