"""Filters of second order: coefficients of z, and what fixed point makes of them.

``core/include/anhyst/control/biquad_real.h`` runs them in floating point, ``biquad.h`` in fixed point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst.control.pidd2 import Pidd2
from anhyst.support.numeric import FloatArray, as_factor

_NOTHING = 1e-7


@dataclass(frozen=True)
class Biquad:
    """``(b0 + b1/z + b2/z^2)/(1 + a1/z + a2/z^2)``."""

    forward: tuple[float, float, float]  # b0, b1, b2
    back: tuple[float, float]  # a1, a2

    @property
    def coefficients(self) -> FloatArray:
        """The members of ``anhyst_biquad_f64`` in their order, shape (5,)."""
        return np.array([*self.forward, *self.back])

    @property
    def words(self) -> NDArray[np.int32]:
        """Mantissas and shifts of ``anhyst_biquad_q31`` in their order, shape (12,)."""
        (b0, b1, b2), (a1, a2) = self.forward, self.back
        with_sum, without = 1.0 + a1 + a2, 1.0 - a1 + a2
        if not (with_sum > 0.0 and without > 0.0 and a2 < 1.0):
            raise ValueError("the poles of a filter are not within the unit circle")
        g, d = math.sqrt(with_sum / without), without / 4.0
        # b = through*(1, a1, a2) + of_fast*g*d*(1, 0, -1) + of_slow*g*g*d*(1, 2, 1)
        parts = np.array([[1.0, 1.0, 1.0], [a1, 0.0, 2.0], [a2, -1.0, 1.0]])
        through, fast, slow = np.linalg.solve(parts, [b0, b1, b2]).tolist()
        values = {
            "loss": 1.0 - d,
            "pass": g * d,
            "low": g * g * d,
            "through": through,
            "of_fast": fast / (g * d),
            "of_slow": slow / (g * g * d),
        }
        # What rounding left of a part that is not there is none.
        made = [as_factor(name, v if abs(v) > _NOTHING else 0.0) for name, v in values.items()]
        return np.array([number for pair in made for number in pair], dtype=np.int32)


def as_pidd2(pid: Biquad, rate: float, limit: float) -> Pidd2:
    """Return a filter with an integral and one more real pole as PIDD2 of the error, N over m.

    The same function of z: P + K/(z - 1) + D*(z - 1)/(z - p), p the pole. Its output stays within
    the limit, N; the load is the force that is fed forward.
    """
    (b0, b1, b2), (a1, pole) = pid.forward, pid.back
    if abs(1.0 + a1 + pole) > 1e-9 or not 0.0 < pole < 1.0:
        raise ValueError("a PID has a pole at 1 and one between 0 and 1")
    k = (b0 + b1 + b2) / (1.0 - pole)
    p = (b0 - b2 - k * pole) / (1.0 - pole)
    return Pidd2(
        rate,
        K_p=p,
        K_i=k * rate,
        K_d=(b0 - p) / (1.0 - pole) / rate,
        K_load=1.0,
        cutoff=-math.log(pole) * rate / (2.0 * math.pi),
        low=-limit,
        high=limit,
    )


def notch(frequency: float, damping: float, width: float, dt: float) -> Biquad:
    """Return what takes a resonance (Hz, damping ratio) out and puts one of another damping in."""
    w = math.tan(math.pi * frequency * dt)
    scale = 1.0 + 2.0 * width * w + w * w
    b0, b1, b2 = (
        part / scale
        for part in (
            1.0 + 2.0 * damping * w + w * w,
            2.0 * (w * w - 1.0),
            1.0 - 2.0 * damping * w + w * w,
        )
    )
    return Biquad((b0, b1, b2), (b1, (1.0 - 2.0 * width * w + w * w) / scale))


def integrator(gain: float) -> Biquad:
    """Return the sum of all inputs times a gain; of no fixed point, whose PID has an integral."""
    return Biquad((gain, 0.0, 0.0), (-1.0, 0.0))
