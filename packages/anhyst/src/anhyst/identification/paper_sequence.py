"""The whole of the paper's search: free sets at each gap, then the reduction, then a model.

The reduction of the number of variable parameters (the paper, II.D and Fig. 3).

Each round tries every parameter that still differs from gap to gap: it is replaced by its mean
over the gaps, and the others are searched again at each gap, briefly. The cheapest is kept so and
the others are searched in full. The rounds end when one parameter is left. So the order is found
and not fixed. Before the first round all gaps are moved to one gauge, since a mean over different
gauges means nothing (docs/theory.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from anhyst.data import Loops
from anhyst.identification.bare import is_over_gap, model_of
from anhyst.identification.candidates import require_gaps
from anhyst.identification.default import FoundModel
from anhyst.identification.objective import Objective
from anhyst.identification.paper_search import (
    SearchBench,
    SearchEffort,
    Stand,
    model_at_nodes,
    search_each_gap,
)
from anhyst.identification.paper_seven import (
    OFFSETS,
    POSITIVE,
    Values,
    chosen_by_gauge,
    in_one_gauge,
    local_of,
    mean_deviation,
    mean_over_gaps,
)
from anhyst.identification.response import Local
from anhyst.identification.run import Outcome, SearchRun
from anhyst.identification.space import CoordinateSpace
from anhyst.identification.uncertainty import assess
from anhyst.model.actuator import Model
from anhyst.model.schema import ReductionStep
from anhyst.support.errors import InputError

_SAME = 0.01
"""Costs that differ by less than this share are taken as equal: a simplex ends no more exactly."""

_NOTHING = 1e-5
"""So are costs that differ by less than this part of the largest output: no sensor distinguishes them."""


def stages_of(bench: SearchBench, last: str | None) -> int:
    """Count the stages that :func:`reductions` will take."""
    gaps, names = bench.gaps, len(bench.searched)
    kept = 0 if last is None else 1
    return gaps + sum(left - kept + gaps for left in range(2, names + 1))


def in_common_gauge(bench: SearchBench, free: Stand) -> Stand:
    """Bring all gaps to one gauge, and to one valley where their loops do not determine which.

    What the gauge chooses is the same at all gaps then, so freezing it comes first and costs
    nothing. Beside the exact redundancies there are long valleys: loops that hardly saturate are
    fitted alike by many sets, and a mean over sets from anywhere in a valley would mean nothing
    either. So the others are searched again outward from the gap that shows most, at each gap from
    where its neighbour ended and from its own set, and the neighbour's valley is taken unless that
    costs more.
    """
    moved = in_one_gauge(free.sets, bench.searched, bench.run.form.power)
    home = bench.run.records.reference_gap
    sets: dict[int, Values] = {}
    spent = free.evaluations
    for gap in [home, *range(home + 1, bench.gaps), *range(home - 1, -1, -1)]:
        near = sets.get(gap - 1 if gap > home else gap + 1)
        sets[gap], more = bench.run.stage(
            f"gap {gap} in one gauge", partial(_beside, bench, gap, moved[gap], near)
        )
        spent += more
    return bench.stand([sets[gap] for gap in range(bench.gaps)], free.varying, spent)


def _beside(bench: SearchBench, gap: int, own: Values, near: Values | None) -> tuple[Values, int]:
    """Search one gap from its own set and from its neighbour's, and prefer the neighbour's end."""
    names = [name for name in bench.searched if name not in chosen_by_gauge(bench.searched)]
    begins = [own] if near is None else [near, own]
    ends = [bench.refine(gap, begin, names, bench.effort.final) for begin in begins]
    costs = [bench.cost_at(gap, values) for values, _ in ends]
    best = 0 if costs[0] <= _alike(min(costs)) else 1
    return ends[best][0], sum(evaluations for _, evaluations in ends)


def reductions(
    bench: SearchBench, free: Stand, last: str | None = None
) -> Iterator[tuple[Stand, ReductionStep]]:
    """Freeze one parameter after another, until one is left."""
    stand = in_common_gauge(bench, free)
    while len(stand.varying) > 1:
        tried = {name: _tried(bench, stand, name) for name in stand.varying if name != last}
        costs = {name: trial.cost for name, trial in tried.items()}
        frozen, before = _cheapest(stand, costs), stand
        spent = before.evaluations + sum(trial.evaluations for trial in tried.values())
        stage = _stage(tried[frozen].varying, "in full at gap {}")
        sets, more = bench.search_all(stage, tried[frozen].sets, tried[frozen].varying)
        stand = bench.stand(sets, tried[frozen].varying, spent + more)
        yield stand, ReductionStep(frozen, before.cost, stand.cost, costs)


def _tried(bench: SearchBench, stand: Stand, name: str) -> Stand:
    """Replace one parameter by its mean and search the others briefly, at every gap."""
    rest = [other for other in stand.varying if other != name]
    mean = mean_over_gaps(name, [values[name] for values in stand.sets])

    def work() -> dict[str, object]:
        results = [
            bench.refine(gap, values | {name: mean}, rest, bench.effort.trial)
            for gap, values in enumerate(stand.sets)
        ]
        spent = sum(result[1] for result in results)
        return asdict(bench.stand([result[0] for result in results], rest, spent))

    return Stand.from_plain(bench.run.stage(_stage(stand.varying, f"without {name}"), work))


def _stage(varying: Sequence[str], what: str) -> str:
    return f"{', '.join(varying)} over the gap, {what}"


def _cheapest(stand: Stand, costs: dict[str, float]) -> str:
    """Choose what to freeze; of those that cost the same, what differs least from gap to gap."""
    limit = _alike(min(costs.values()))
    return min(
        (name for name, cost in costs.items() if cost <= limit),
        key=lambda name: _spread(name, [values[name] for values in stand.sets]),
    )


def _alike(cost: float) -> float:
    """Highest cost that counts as the same as this one."""
    return cost * (1.0 + _SAME) + _NOTHING


def _spread(name: str, values: Sequence[float]) -> float:
    """Relative spread over the gaps."""
    if name in POSITIVE:
        return float(np.std(np.log(values)))
    return float(np.std(values) / max(np.max(np.abs(values)), np.finfo(np.float64).tiny))


LAST = {"auto": None, "scaling": "c_H", "reluctance": "alpha"}
"""Which parameter a wanted gap map keeps to the last; ``free`` makes no reduction."""

_ALIKE = 1.01  # rise of the cost up to which a model in another form counts as the same


def search_paper(
    run: SearchRun, loopset: Loops, gap_map: str, effort: SearchEffort | None = None
) -> Outcome:
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
    return Outcome(
        model,
        assess(fit, loopset),
        fit.theta.size,
        fit.evaluations,
        _why(stand, model, reducing, interrupted),
        interrupted,
        steps=tuple(steps),
        per_gap=model_at_nodes(free, run, loopset) if bench.gaps > 1 else None,
        resumed=run.resumed,
        fit=fit,
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
    sets = [local_of(values, bench.run.form.power) for values in stand.sets]
    h = float(np.mean([local.h for local in sets]))
    # Alpha over the schedule can be a reluctance: of a gap, and in no law of 1986.
    of_a_gap = gap_map == "reluctance" or is_over_gap(bench.loopset)
    circuit = "c_H" in bench.searched and not bench.run.form.kernel.coupled
    if stand.varying == ("alpha",) and of_a_gap and circuit and bench.gaps > 1:
        fit = _found(bench, stand, "reluctance", _in_series(sets, h), h)
        outputs = Objective(fit.space).outputs(fit.sets)
        if mean_deviation(bench.run.records, outputs) <= _ALIKE * stand.cost:
            return model_of(fit, bench.loopset), fit
    return model, _found(bench, stand, model.gap_map, sets, h)


def _found(
    bench: SearchBench, stand: Stand, gap_map: str, sets: list[Local], h: float
) -> FoundModel:
    form = replace(bench.run.form, h=h)
    space = CoordinateSpace(gap_map, bench.run.records, form, bench.run.held)
    return FoundModel(space, space.pack(sets), stand.cost, stand.evaluations)


def _in_series(sets: list[Local], h: float) -> list[Local]:
    """Read alpha over the gap as a series reluctance over the gap.

    They are the same up to the slope of the air core, which the common gauge has made small
    (docs/theory.md). With a reluctance the gap may move during a run, with alpha it may not.
    """
    unscaled = float(np.mean([local.scale * (1.0 - h * local.omega) for local in sets]))
    gain = float(np.mean([local.gain for local in sets]))
    return [replace(own, h=h, gain=gain, scale=unscaled / (1.0 - h * own.omega)) for own in sets]


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
