"""Gains of the position controller from mass, bandwidth and damping.

Behind a compensator that keeps its word the magnet is a force, and what is left of the bearing is
a mass: ``m p'' = u + load``. With the controller's ``u = K_p (r - p) + I - K_d p' - K_dd p''`` and
``I' = K_i (r - p)`` its poles are the roots of::

    (m + K_dd) s^3 + K_d s^2 + K_p s + K_i = (m + K_dd) (s + w) (s^2 + 2 z w s + w^2)

All three lie at the distance w from the origin, so one number sets how fast the loop is, and a
second one, z, how well its pair is damped; with z = 1 all are real and equal. The set point should
be weighted lightly in the proportional part: K_p r puts zeros into the reference's response that
overshoot whatever the poles are.

``K_dd`` is a mass that the controller pretends: loads accelerate ``m + K_dd``, so the same poles
resist loads the better by that ratio, for more noise and less margin against delay. It is zero
unless asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from anhyst.support.errors import InputError


@dataclass(frozen=True)
class Gains:
    """Gains of a PIDD2 in SI units, named as in :class:`anhyst.control.Pidd2`."""

    K_p: float  # n/m
    K_i: float  # n/(m s)
    K_d: float  # N s/m
    K_dd: float  # N s^2/m


def design(mass: float, bandwidth: float, damping: float, virtual_mass: float = 0.0) -> Gains:
    """Place the poles of a mass under PIDD2.

    >>> gains = design(mass=2.0, bandwidth=120.0, damping=1.0)
    >>> f"{gains.K_p:.4g} N/m, {gains.K_i:.4g} N/(m s), {gains.K_d:.4g} N s/m"
    '3.411e+06 N/m, 8.573e+08 N/(m s), 4524 N s/m'
    """
    for name, value, unit in (
        ("mass", mass, " kg"),
        ("bandwidth", bandwidth, " Hz"),
        ("damping", damping, ""),
    ):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(
                f"{name}: {value}{unit} is not above zero", code="not-above-zero", key=name
            )
    if not (math.isfinite(virtual_mass) and mass + virtual_mass > 0.0):
        raise InputError(
            f"virtual_mass: {virtual_mass} kg leaves nothing of a mass of {mass} kg; "
            "give a number above minus the mass",
            code="virtual-mass-too-negative",
            key="virtual_mass",
        )
    w = 2.0 * math.pi * bandwidth
    total = mass + virtual_mass
    return Gains(
        K_p=total * (w * w) * (1.0 + 2.0 * damping),
        K_i=total * (w * w * w),
        K_d=total * w * (1.0 + 2.0 * damping),
        K_dd=virtual_mass,
    )
