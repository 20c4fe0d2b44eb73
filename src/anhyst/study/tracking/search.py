"""Gains of the feedforward: the same search for every variant, on the training set-point."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from anhyst.rig.stage.loop import Feedforward, StageSetup, track
from anhyst.rig.stage.setpoint import SetPoint
from anhyst.study.tracking.measures import measure
from anhyst.support.arrays import FloatArray

RUNS = 30
"""Of the search."""
_UNITS = np.array([0.01, 50e-6, 5e-9])
"""One of each in the first simplex: weight of the acceleration, jerk (s), snap (s2)."""
_LOST = 1.0
"""Cost of a run in which the loop was lost, m."""


def gains_at(place: FloatArray) -> Feedforward:
    """Return the gains at a place of the search; 0 is the mass of the file alone."""
    acceleration, jerk, snap = (_UNITS * place).tolist()
    return Feedforward(1.0 + acceleration, jerk, snap)


def find_gains(setup: StageSetup, motion: SetPoint) -> Feedforward:
    """Search the three gains that leave the smallest error, rms, on a set-point.

    Nelder and Mead from the mass of the file alone; the noise is the same in every run.
    """
    table = setup.rig.settings.scan

    def cost(place: FloatArray) -> float:
        rms = measure(track(setup, motion, gains_at(place), seed=0), table.slit_s).rms_m
        return min(rms, _LOST)

    simplex = np.vstack([np.zeros(3), np.eye(3)])
    found = minimize(
        cost,
        simplex[0],
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": RUNS, "maxiter": RUNS},
    )
    return gains_at(np.asarray(found.x))
