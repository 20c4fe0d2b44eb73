"""The play against creep: what keeps a law's memory from being worn away by noise.

A Jiles-Atherton law forgets by the whole way that the field goes, to and fro, so that noise of the
demand erases what it remembers within milliseconds. A play in front of its irreversible part closes
chatter that stays within it (docs/theory.md). Real iron has something like it, and measured loops
hardly tell how wide it is: the widest one that they allow is taken.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from anhyst.data import LoopSet
from anhyst.data.loopset import Loop
from anhyst.model import ActuatorModel
from anhyst.record import fit_figures
from anhyst.rig.distance import thinned
from anhyst.rig.modelling import SAMPLES

Floats = NDArray[np.float64]

PARTS = (0.35, 0.2, 0.1, 0.05)
"""Half-widths that are tried, in parts of the pinning k, the widest first."""

COST = 1.03
"""Factor by which the error of the fit may grow."""

EVALUATIONS = 40


def with_widest_play(model: ActuatorModel, loops: LoopSet) -> ActuatorModel:
    """Give a model the widest play that its loops allow.

    Pinning and reversible part are fitted anew with every play.

    Parameters
    ----------
    model : ActuatorModel
        Identified from these loops.
    loops : LoopSet
        With their history.

    Returns
    -------
    ActuatorModel
        The given one where even the narrowest play costs more than 3 % of the error.
    """
    records = thinned(loops, SAMPLES)
    most = COST * _error(model, records)
    for part in PARTS:
        found, error = _fit(model, records, part)
        if error <= most:
            return _judged_anew(found, loops)
    return model


def _judged_anew(model: ActuatorModel, loops: LoopSet) -> ActuatorModel:
    """Give a model the figures of its own fit; what was known of its uncertainty is void."""
    fitted = [_predicted(model, loop) for loop in loops.loops]
    before = model.fit
    figures = fit_figures(
        loops,
        fitted,
        {} if before is None else before.left_out,
        None if before is None else before.monotone,
    )
    return replace(model, fit=figures, uncertainty=None)


def _fit(model: ActuatorModel, records: LoopSet, part: float) -> tuple[ActuatorModel, float]:
    k, c = float(model.parameters["k"]), float(model.parameters["c"])  # type: ignore[arg-type]
    c = min(max(c, 0.01), 0.99)
    odds = math.log(c / (1.0 - c))

    def changed(at: Floats) -> ActuatorModel:
        pinning = k * math.exp(float(at[0]))
        share = 1.0 / (1.0 + math.exp(-(odds + float(at[1]))))
        moved = {"k": pinning, "c": share, "r_d": part * pinning}
        return replace(model, parameters=dict(model.parameters) | moved)

    start = np.array([[-0.1, 0.0], [-0.3, 0.0], [-0.1, 0.3]])
    options = {"maxfev": EVALUATIONS, "initial_simplex": start}
    best = minimize(
        lambda at: _error(changed(at), records), start[0], method="Nelder-Mead", options=options
    )
    return changed(best.x), float(best.fun)


def _error(model: ActuatorModel, records: LoopSet) -> float:
    """Root mean square of what a model misses, in units of the output."""
    parts = [_predicted(model, loop) - loop.output for loop in records.loops]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _predicted(model: ActuatorModel, loop: Loop) -> Floats:
    return model.predict(loop.input, loop.schedule, history=loop.history).output
