"""What no sample of the loops shows of play cells: thresholds finer than their steps.

A cell of threshold ``r`` moves again after the field has turned back by ``2*r``. Where samples lie
farther apart than that, they are the same whether it is pinned or free, and a fit says either. A
compensator believes what it says: of an iron that answers every reversal with a stiff model it asks
too much current, and its loop makes noise louder. So what no sample shows counts as free.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anhyst.data import Loops
from anhyst.laws.registry import law_of
from anhyst.model.actuator import Model
from anhyst.support.units import MU_0


def field_step(model: Model, loops: Loops) -> float:
    """Return by how much the effective field moves to the first sample after a reversal, A/m.

    The median over all reversals; 0 where there is none. Just there the iron hardly answers, and
    the field moves farther for a step of the drive than anywhere else.

    Parameters
    ----------
    model : Model
        Identified from the loops.
    loops : Loops
    """
    steps = []
    for loop in loops.loops:
        schedule = loop.schedule if model.needs_schedule else None
        found = model.predict(loop.input, schedule, loop.time, loop.history)
        alpha = model.parameters_at(loop.schedule_value if model.needs_schedule else None)["alpha"]
        magnetisation = found.flux_density / MU_0 - found.field
        moved = np.diff(found.field + alpha * magnetisation)
        steps.append(np.abs(moved[1:][moved[1:] * moved[:-1] < 0.0]))
    turned = np.concatenate(steps)
    return float(np.median(turned)) if turned.size else 0.0


def resolved(model: Model, loops: Loops) -> Model:
    """Count cells that no sample shows to be pinned as free.

    Parameters
    ----------
    model : Model
        Identified from the loops.
    loops : Loops

    Returns
    -------
    Model
        The very model where its law has no cells, or all of them are wide enough.
    """
    law = model.operator_law
    if law.cells is None:
        return model
    cells = law.cells(model.parameters_at(model.nodes[0] if model.nodes else None))
    hidden = (cells.thresholds > 0.0) & (2.0 * cells.thresholds < field_step(model, loops))
    if not cells.weights[hidden].any() or not cells.weights[~hidden][1:].any():
        return model
    weights = cells.weights.copy()
    weights[0] += weights[hidden].sum(axis=0)
    other = replace(cells, thresholds=cells.thresholds[~hidden], weights=weights[~hidden])
    gone = {spec.name for spec in law.parameters}
    gone -= {spec.name for spec in law_of(model.law, other).parameters}
    kept = {name: value for name, value in model.parameters.items() if name not in gone}
    return replace(model, cells=other, parameters=kept)
