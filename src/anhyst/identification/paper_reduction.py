"""The reduction of the number of variable parameters (the paper, II.D and Fig. 3).

Each round tries every parameter that still differs from gap to gap: it is replaced by its mean
over the gaps, and the others are searched again at each gap, briefly. The cheapest is kept so and
the others are searched in full. The rounds end when one parameter is left. So the order is found
and not fixed. Before the first round all gaps are moved to one gauge, since a mean over different
gauges means nothing (docs/theory.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from anhyst.identification.default import reference_gap
from anhyst.identification.paper_search import SearchBench, Stand
from anhyst.identification.paper_seven import (
    POSITIVE,
    Values,
    chosen_by_gauge,
    in_one_gauge,
    mean_over_gaps,
)
from anhyst.model.fit_record import ReductionStep

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
    home = reference_gap(bench.run.records)
    sets: dict[int, Values] = {}
    spent = free.evaluations
    for gap in [home, *range(home + 1, bench.gaps), *range(home - 1, -1, -1)]:
        near = sets.get(gap - 1 if gap > home else gap + 1)
        sets[gap], more = bench.run.stage(
            f"gap {gap} in one gauge",
            lambda gap=gap, near=near: _beside(bench, gap, moved[gap], near),  # type: ignore[misc]
        )
        spent += more
    return bench.stand([sets[gap] for gap in range(bench.gaps)], free.varying, spent)


def _beside(bench: SearchBench, gap: int, own: Values, near: Values | None) -> tuple[Values, int]:
    """Search one gap from its own set and from its neighbour's, and prefer the neighbour's end."""
    names = [name for name in bench.searched if name not in chosen_by_gauge(bench.searched)]
    ends = [
        bench.refine(gap, begin, names, bench.effort.final)
        for begin in (near, own)
        if begin is not None
    ]
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
        costs = {name: one.cost for name, one in tried.items()}
        frozen, before = _cheapest(stand, costs), stand
        stand = _kept(bench, tried[frozen])
        spent = before.evaluations + sum(one.evaluations for one in tried.values())
        stand = replace(stand, evaluations=spent + stand.evaluations)
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
        return bench.stand([one[0] for one in results], rest, sum(one[1] for one in results)).plain

    return Stand.from_plain(bench.run.stage(_stage(stand.varying, f"without {name}"), work))


def _kept(bench: SearchBench, tried: Stand) -> Stand:
    """Search what is left in full, at every gap, from where the trial has come to."""
    candidates = [
        bench.run.stage(
            _stage(tried.varying, f"in full at gap {gap}"),
            lambda gap=gap, values=values: bench.search(gap, values, tried.varying, values),  # type: ignore[misc]
        )
        for gap, values in enumerate(tried.sets)
    ]
    spent = sum(candidate[1] for candidate in candidates)
    return bench.stand([candidate[0] for candidate in candidates], tried.varying, spent)


def _stage(varying: Sequence[str], what: str) -> str:
    return f"{', '.join(varying)} over the gap, {what}"


def _cheapest(stand: Stand, costs: dict[str, float]) -> str:
    """Choose what to freeze; of those that cost the same, what differs least from gap to gap."""
    limit = _alike(min(costs.values()))
    return min(
        (name for name, cost in costs.items() if cost <= limit),
        key=lambda name: _spread(name, [one[name] for one in stand.sets]),
    )


def _alike(cost: float) -> float:
    """Highest cost that counts as the same as this one."""
    return cost * (1.0 + _SAME) + _NOTHING


def _spread(name: str, values: Sequence[float]) -> float:
    """Relative spread over the gaps."""
    if name in POSITIVE:
        return float(np.std(np.log(values)))
    return float(np.std(values) / max(np.max(np.abs(values)), np.finfo(np.float64).tiny))
