"""What no sample of the loops shows of play cells: thresholds finer than their steps.

A cell of threshold ``r`` moves again after the field has turned back by ``2*r``. Where samples lie
farther apart than that, none shows how stiffly the iron answers a reversal, and of a loop's width there
may be too little to tell a pinned cell from a free one. A compensator believes what the model says: of an
iron that answers every reversal stiffly it asks too much current, and its loop makes noise louder. So
cells count as free as far as the loops do not contradict.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anhyst.data import Loops
from anhyst.laws.cells import CellWeights
from anhyst.laws.registry import law_of
from anhyst.model.actuator import Model
from anhyst.support.units import MU_0

_UNSEEN = 1.05
"""Mean square deviation over the least, up to which loops do not tell a pinned cell from a free one."""


def field_step(model: Model, loops: Loops) -> float:
    """Return by how much the effective field moves to the first sample after a reversal, A/m.

    The median over all reversals; 0 where there is none. Just there the iron hardly answers, and
    the field moves farther for a step of the drive than anywhere else.
    """
    steps = []
    for loop in loops.loops:
        schedule = loop.schedule if model.needs_schedule else None
        predicted = model.predict(loop.input, schedule, loop.time, loop.history)
        alpha = model.parameters_at(loop.schedule_value if model.needs_schedule else None)["alpha"]
        magnetisation = predicted.flux_density / MU_0 - predicted.field
        moved = np.diff(predicted.field + alpha * magnetisation)
        steps.append(np.abs(moved[1:][moved[1:] * moved[:-1] < 0.0]))
    turned = np.concatenate(steps)
    return float(np.median(turned)) if turned.size else 0.0


def resolved(model: Model, loops: Loops) -> Model:
    """Count cells as free that no sample shows to be pinned, the finest first."""
    law = model.operator_law
    if law.cells is None:
        return model
    cells = law.cells(model.parameters_at(model.first_node))
    fine = (cells.thresholds > 0.0) & (2.0 * cells.thresholds < field_step(model, loops))
    hidden = int(np.count_nonzero(fine))
    if not cells.weights[fine].any() or not cells.weights[1 + hidden :].any():
        return model
    most = _UNSEEN * _deviation(model, loops)
    refined, known, beyond = model, 0, hidden + 1
    while beyond - known > 1:
        middle = hidden if refined is model and beyond > hidden else (known + beyond) // 2
        other = _freed(model, cells, middle)
        if _deviation(other, loops) <= most:
            refined, known = other, middle
        else:
            beyond = middle
    return refined


def _freed(model: Model, cells: CellWeights, count: int) -> Model:
    """Give the weights of the first cells with a threshold to the one without."""
    weights = np.delete(cells.weights, np.s_[1 : 1 + count], axis=0)
    weights[0] += cells.weights[1 : 1 + count].sum(axis=0)
    other = replace(
        cells, thresholds=np.delete(cells.thresholds, np.s_[1 : 1 + count]), weights=weights
    )
    gone = {spec.name for spec in model.operator_law.parameters}
    gone -= {spec.name for spec in law_of(model.law, other).parameters}
    kept = {name: value for name, value in model.parameters.items() if name not in gone}
    return replace(model, cells=other, parameters=kept)


def _deviation(model: Model, loops: Loops) -> float:
    """Mean square of what a model misses, over all samples."""
    off = [
        model.predict(
            loop.input, loop.schedule if model.needs_schedule else None, loop.time, loop.history
        ).output
        - loop.output
        for loop in loops.loops
    ]
    every = np.concatenate(off)
    return float(every @ every) / every.size
