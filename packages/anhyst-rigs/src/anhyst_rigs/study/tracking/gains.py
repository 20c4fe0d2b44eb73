"""Find the feedforward gains of a stage, and check them on turnarounds that the search does not use.

The physical gains are the mass alone, with the estimated payload and cable. A search absorbs errors
of the force into the gains. On a stage whose force is correct, it fits only the searched turnarounds.
Therefore, the searched gains are used only if they are better on withheld turnarounds.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from anhyst_rigs.rig.stage.setpoint import SetPoint
from anhyst_rigs.study.tracking.measures import measure

GAIN_SEARCH_RUNS = 30
"""Largest number of runs in the search for gains."""
_GAIN_STEPS = np.array([0.01, 50e-6, 5e-9])
"""Steps of the first simplex: acceleration gain, jerk gain (s), and snap gain (s^2)."""
_LOST_COST_M = 1.0
"""Cost of a run that lost control, m."""
WITHHELD_FRACTION = 0.5
"""Accelerations of the second half of the withheld turnarounds, as a fraction of the searched ones."""
WITHHELD_SEEDS = (2000, 2001, 2002)
"""Noise seeds of the runs with withheld turnarounds."""


def gains_at(point: FloatArray) -> Feedforward:
    """Return the gains at a point of the search; at 0, only the mass of the file is fed forward."""
    acceleration, jerk, snap = (_GAIN_STEPS * point).tolist()
    return Feedforward(1.0 + acceleration, jerk, snap)


def search_gains(setup: StageSetup, motion: SetPoint) -> Feedforward:
    """Return the three feedforward gains with the smallest error on a set-point.

    The cost is the rms error plus the moving average with its weight from the rig file. The
    Nelder-Mead search starts with the mass of the file; all runs have the same noise.
    """
    table = setup.rig.settings.scan

    def cost(point: FloatArray) -> float:
        run = track(setup, motion, gains_at(point), seed=0)
        measures = measure(run, motion, table.slit_s)
        return min(measures.rms_m + table.average_weight * measures.average_m, _LOST_COST_M)

    simplex = np.vstack([np.zeros(3), np.eye(3)])
    options = {"initial_simplex": simplex, "maxfev": GAIN_SEARCH_RUNS, "maxiter": GAIN_SEARCH_RUNS}
    search_result = minimize(cost, simplex[0], method="Nelder-Mead", options=options)
    return gains_at(np.asarray(search_result.x))


def withheld_turnarounds(motion: SetPoint) -> SetPoint:
    """Return a set-point with accelerations between those of a motion, then with half of them.

    The first turnaround is the largest of the motion; it is not evaluated.
    """
    between = [0.5 * (first + second) for first, second in pairwise(motion.peaks)]
    lower = [WITHHELD_FRACTION * peak for peak in motion.peaks[1:]]
    return replace(motion, peaks=(max(motion.peaks), *between, *lower))


def find_gains(setup: StageSetup, motion: SetPoint) -> Feedforward:
    """Search the gains on a set-point; return them only if they are better on withheld turnarounds.

    The compared error is the geometric mean of the rms error and of the moving average. If the
    mean of the logarithmic ratio over the noise seeds is not below 0 by more than its scatter, the
    mass alone is fed forward. The result contains the ratio of both errors.
    """
    physical, searched = Feedforward(), search_gains(setup, motion)
    withheld = withheld_turnarounds(motion)

    def log_errors(gains: Feedforward) -> FloatArray:
        runs = [track(setup, withheld, gains, seed) for seed in WITHHELD_SEEDS]
        all_measures = [measure(run, withheld, setup.rig.settings.scan.slit_s) for run in runs]
        errors = [(min(m.rms_m, _LOST_COST_M), min(m.average_m, _LOST_COST_M)) for m in all_measures]
        return np.asarray(np.log(errors).mean(axis=1))

    log_ratios = log_errors(searched) - log_errors(physical)
    is_better = log_ratios.mean() < -log_ratios.std(ddof=1)
    return replace(
        searched if is_better else physical, searched_error_ratio=math.exp(float(log_ratios.mean()))
    )


def gains_text(gains: Feedforward) -> str:
    """Return which gains are used, and the errors that decide this."""
    name = "the mass alone" if gains == Feedforward() else "searched gains"
    if gains.searched_error_ratio is None:
        return name
    return f"{name} (searched gains / mass alone: {gains.searched_error_ratio:.2f})"
