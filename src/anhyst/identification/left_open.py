"""What loops leave open, and a fit may fill with anything.

- Along one loop, how pinning, curves and interaction share in it shows only where the drive turns
  within the loop: fits that follow it alike differ on other runs.
- Cells that no loop switches back leave a trace on the first rise alone. A compensator starts there: on
  an iron of narrow loops, cells that held each other in balance along all of them put the first rise
  at eight times their width below.
- Between the gaps that were measured, a map with much freedom may bend although it meets gaps left
  out by luck. What a simpler map misses at these bounds what it misses between them.

What no sample of the loops shows of play cells: thresholds finer than their steps.

A cell of threshold ``r`` moves again after the field has turned back by ``2*r``. Where samples lie
farther apart than that, none shows how stiffly the iron answers a reversal, and of a loop's width there
may be too little to tell a pinned cell from a free one. A compensator believes what the model says: of an
iron that answers every reversal stiffly it asks too much current, and its loop makes noise louder. So
cells count as free as far as the loops do not contradict.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from anhyst.data import Loops
from anhyst.data.history import History
from anhyst.data.output_map import is_actuator
from anhyst.data.verdict import largest_output
from anhyst.laws import law_of
from anhyst.laws.cells import CellWeights
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.units import MU_0

ALIKE = 1.5
"""Deviation from the loop over that of the model that was chosen, up to which a fit follows it as well."""

_TURNS = (0.0, 1.0, 0.3, 0.9, 0.1, 0.6, 0.4, 0.8, 0.2, 0.7, 0.0)
_SAMPLES = 40


def left_open(chosen: Model, others: Sequence[Model], loopset: Loops) -> float:
    """Return how far (rms, of the largest output) others differ from one that is driven within it."""
    loop = loopset.loops[0]
    low, high = float(loop.input.min()), float(loop.input.max())
    ends = low + (high - low) * np.array(_TURNS)
    positions = np.linspace(0.0, ends.size - 1.0, _SAMPLES * (ends.size - 1) + 1)
    drive = np.interp(positions, np.arange(ends.size), ends)
    before = History("conditioned", (low, high, low, high, low))
    runs = []
    for model in (chosen, *others):
        at = loop.schedule_value if model.needs_schedule else None
        try:
            runs.append(model.predict(drive, at, history=before).output)
        except (InputError, NegativeResult):
            continue
    apart = [float(np.sqrt(np.mean((run - runs[0]) ** 2))) for run in runs[1:]]
    return max(apart, default=0.0) / largest_output(loopset)


_EXPLAINED = 2.0
"""Distance of two maps between the gaps, over what both miss at gaps left out, that these explain."""
_COMPARABLE = 3.0
"""Cross-validation error over another's up to which a simpler map says where the other bends."""


def apart_between(model: Model, rival: Model, loopset: Loops) -> float:
    """Return the mean deviation of two models midway between gaps, in parts of the largest output."""
    groups = loopset.by_schedule()
    off = []
    for low, high in pairwise(sorted(groups)):
        loop = max(groups[low], key=lambda loop: float(np.ptp(loop.output)))
        history = replace(loop.history, schedule=())
        gap = math.sqrt(low * high) if low > 0.0 else 0.5 * (low + high)
        try:
            first = model.predict(loop.input, gap, history=history).output
            second = rival.predict(loop.input, gap, history=history).output
        except (InputError, NegativeResult):
            return float("inf")
        off.append(float(np.mean(np.abs(first - second))))
    return max(off, default=0.0) / largest_output(loopset)


def bends(model: Model, error: float, simpler: Sequence[tuple[Model, float]], loops: Loops) -> bool:
    """Whether a model parts from all simpler maps by more than it and they miss at gaps left out.

    One that holds at the measured gaps alone says nothing between them.
    """
    if model.fixed_gap_only:
        return False
    known = [
        (simpler_model, missed)
        for simpler_model, missed in simpler
        if missed <= _COMPARABLE * error
    ]
    return bool(known) and all(
        apart_between(model, simpler_model, loops) > _EXPLAINED * (error + missed)
        for simpler_model, missed in known
    )


FARTHEST = 1.0
"""Of the width of the loop; irons of all families stay below 0.4 where it was measured."""

_STEPS = 100


def is_guessed(loopset: Loops) -> bool:
    """Whether no loop begins demagnetised."""
    return all(loop.history.kind != "demagnetised" for loop in loopset.loops)


def first_rise(model: Model, loopset: Loops) -> float:
    """Return how far a model puts the first rise below the loop that follows."""
    if not is_actuator(loopset):
        return 0.0
    top = max(float(loop.input.max()) for loop in loopset.loops)
    if top <= 0.0:
        return 0.0
    up = np.linspace(0.0, top, _STEPS)
    worst = 0.0
    for value in loopset.schedule_values if model.needs_schedule else (None,):
        try:
            first = model.predict(up, value, history="demagnetised").output
            settled = model.predict(np.concatenate([up[::-1], up]), value, history="settled").output
        except (InputError, NegativeResult):
            return float("inf")
        falling, rising = settled[_STEPS - 1 :: -1], settled[_STEPS:]
        width = float(np.max(np.abs(falling - rising)))
        below = float(np.max(np.abs(rising) - np.abs(first)))
        worst = max(worst, below / width if width > 0.0 else 0.0)
    return worst


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
    """Move the weights of the first cells with a threshold to the cell without one."""
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
