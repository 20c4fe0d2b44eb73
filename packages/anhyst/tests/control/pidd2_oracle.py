"""Textbook version of PIDD2 in double precision, as an oracle for the core.

Differences are divided by the control period and then low-pass filtered. The core instead moves
each filter state by its own derivative. The two implementations share no code.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from anhyst.control.pidd2 import Pidd2
from anhyst.support.numeric import FloatArray


def respond(
    gains: Pidd2,
    reference: FloatArray,
    position: FloatArray,
    load: FloatArray,
    *,
    limit: Callable[[float], float] = lambda output: output,
) -> tuple[FloatArray, FloatArray]:
    """Answer recorded signals, at rest before them.

    Parameters
    ----------
    gains : Pidd2
        In SI units.
    reference, position : ndarray, shape (n,)
        Metres.
    load : ndarray, shape (n,)
        That is fed forward, in the unit that `K_load` is for.
    limit : callable
        What becomes of an output behind the controller, N to N.

    Returns
    -------
    output, integral : ndarray, shape (n,)
        The output within its limits and the integral used for it, N.
    """
    tick = 1.0 / gains.rate
    keep = np.exp(-2.0 * np.pi * gains.cutoff * tick)
    keep_2 = np.exp(-2.0 * np.pi * gains.cutoff_2 * tick)
    outputs, integrals = np.empty(len(position)), np.empty(len(position))
    before, velocity, acceleration, integral = position[0], 0.0, 0.0, 0.0
    for i, (r, y, force) in enumerate(zip(reference, position, load, strict=True)):
        faster = keep * velocity + (1.0 - keep) * (y - before) / tick
        acceleration = keep_2 * acceleration + (1.0 - keep_2) * (faster - velocity) / tick
        before, velocity = y, faster
        expected = gains.K_p * (gains.weight * r - y) + integral + gains.K_load * force
        expected -= gains.K_d * velocity + gains.K_dd * acceleration
        outputs[i], integrals[i] = np.clip(expected, gains.low, gains.high), integral
        integral += gains.K_i * tick * (r - y) + gains.tracking_share * (limit(outputs[i]) - expected)
    return outputs, integrals
