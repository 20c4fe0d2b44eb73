"""The whole of the paper's search: free sets at each gap, then the reduction, then a model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from anhyst.data import Loops
from anhyst.identification.bare import model_of
from anhyst.identification.candidates import require_gaps
from anhyst.identification.default import FoundModel
from anhyst.identification.objective import Objective
from anhyst.identification.paper_criterion import mean_deviation
from anhyst.identification.paper_reduction import reductions, stages_of
from anhyst.identification.paper_search import (
    SearchBench,
    SearchEffort,
    Stand,
    model_at_nodes,
    search_each_gap,
)
from anhyst.identification.paper_seven import OFFSETS, local_of
from anhyst.identification.run import SearchRun
from anhyst.identification.space import CoordinateSpace
from anhyst.model.actuator import Model
from anhyst.model.fit_record import ReductionStep
from anhyst.support.errors import InputError

LAST = {"auto": None, "scaling": "c_H", "reluctance": "alpha"}
"""Which parameter a wanted gap map keeps to the last; ``free`` makes no reduction."""

_ALIKE = 1.01
"""Rise of the cost up to which a model in another form counts as the same."""


@dataclass(frozen=True, eq=False)
class Sequence:
    """Outcome of the paper's search."""

    model: Model  # bare model, as far as the reduction has come
    per_gap: Model | None  # bare model with everything free at each gap; None with one gap only
    steps: tuple[ReductionStep, ...]  # what was frozen, in the order it was
    found: FoundModel  # the same fit in gauge-free coordinates
    why: str  # what the reduction came to, as a sentence
    interrupted: bool  # it was stopped before its end


def search_paper(
    run: SearchRun, loopset: Loops, gap_map: str, effort: SearchEffort | None = None
) -> Sequence:
    """Search as the paper does."""
    require_gaps(run.records, gap_map)
    bench = SearchBench(run, loopset, effort or SearchEffort())
    last = _kept_to_the_last(bench, gap_map)
    reducing = bench.gaps > 1 and gap_map != "free"
    shifted = bench.gaps > 1 and not set(OFFSETS) <= run.held
    run.total = bench.gaps * (2 if shifted else 1)
    run.total += stages_of(bench, last) if reducing else 0
    free: Stand | None = None
    steps: list[ReductionStep] = []
    interrupted = False
    try:
        free = stand = search_each_gap(bench)
        for reached, step in reductions(bench, free, last) if reducing else ():
            stand = reached
            steps.append(step)
    except KeyboardInterrupt:
        if free is None:
            raise
        interrupted = True
    model, fit = _model(bench, stand, gap_map)
    return Sequence(
        model=model,
        per_gap=model_at_nodes(free, run, loopset) if bench.gaps > 1 else None,
        steps=tuple(steps),
        found=fit,
        why=_why(stand, model, reducing, interrupted),
        interrupted=interrupted,
    )


def _kept_to_the_last(bench: SearchBench, gap_map: str) -> str | None:
    last = LAST.get(gap_map)
    if last is not None and last not in bench.searched:
        quantity = bench.loopset.input.name
        raise InputError(
            f"gap map '{gap_map}' with search 'paper' keeps {last} to the last, but with a measured "
            f"{quantity} {last} is known; use --gap-map auto or --search default",
            code="choices-together",
            key="gap_map",
        )
    return last


def _model(bench: SearchBench, stand: Stand, gap_map: str) -> tuple[Model, FoundModel]:
    model = model_at_nodes(stand, bench.run, bench.loopset)
    if stand.varying == ("alpha",) and _may_be_reluctance(bench, gap_map):
        fit = _as_reluctance(bench, stand)
        outputs = Objective(fit.space).outputs(fit.sets)
        if mean_deviation(bench.run.records, outputs) <= _ALIKE * stand.cost:
            return model_of(fit, bench.loopset), fit
    sets = [local_of(values, bench.run.form.power) for values in stand.sets]
    form = replace(bench.run.form, h=float(np.mean([local.h for local in sets])))
    space = CoordinateSpace(model.gap_map, bench.run.records, form, bench.run.held)
    return model, FoundModel(space, space.pack(sets), stand.cost, stand.evaluations)


def _may_be_reluctance(bench: SearchBench, gap_map: str) -> bool:
    """Whether alpha over the schedule can be a reluctance: of a gap, and in no law of 1986."""
    schedule = bench.loopset.schedule
    of_a_gap = gap_map == "reluctance" or (schedule is not None and schedule.name == "gap")
    circuit = "c_H" in bench.searched and not bench.run.form.kernel.coupled
    return of_a_gap and circuit and bench.gaps > 1


def _as_reluctance(bench: SearchBench, stand: Stand) -> FoundModel:
    """Read alpha over the gap as a series reluctance over the gap.

    They are the same up to the slope of the air core, which the common gauge has made small
    (docs/theory.md). With a reluctance the gap may move during a run, with alpha it may not.
    """
    sets = [local_of(values, bench.run.form.power) for values in stand.sets]
    h = float(np.mean([local.h for local in sets]))
    unscaled = float(np.mean([local.scale * (1.0 - h * local.omega) for local in sets]))
    gain = float(np.mean([local.gain for local in sets]))
    sets = [replace(own, h=h, gain=gain, scale=unscaled / (1.0 - h * own.omega)) for own in sets]
    space = CoordinateSpace(
        "reluctance", bench.run.records, replace(bench.run.form, h=h), bench.run.held
    )
    return FoundModel(space, space.pack(sets), stand.cost, stand.evaluations)


def _why(stand: Stand, model: Model, reducing: bool, interrupted: bool) -> str:
    if interrupted:
        return "the search was interrupted: this is the best so far"
    if not model.nodes or len(model.nodes) < 2:
        return "there is one gap only, so nothing runs over it"
    if not reducing:
        return "gap map 'free' was asked for, so nothing was made common to all gaps"
    left = stand.varying[0]
    if model.gap_map == "reluctance":
        return (
            f"the reduction left {left} over the gap: a reluctance in series, so it is kept as rho"
        )
    if model.gap_map == "free":
        return f"the reduction left {left} over the gap: for runs at a fixed gap"
    return f"the reduction left {left} over the gap"
