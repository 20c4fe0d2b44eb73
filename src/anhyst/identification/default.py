"""The default search: screen one gap widely, descend from the best, then join the gaps.

1. Thousands of sets over the loops of the gap with the largest output (:mod:`.screening`).
2. Least squares from the few best that differ, at that gap alone.
3. For a gap map, the parameter that the map ties to the gap is scanned at every other gap with the
   rest held, for the optimum of 2 and more sets of 1, and all gaps are fitted together from the
   best. Under the map ``free`` nothing is shared: every gap is fitted like the first, then tied.

Everything random comes from the seed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from anhyst.identification.fit_records import FitRecords
from anhyst.identification.fitting import descend
from anhyst.identification.objective import Objective
from anhyst.identification.response import Local, ResponseForm
from anhyst.identification.screening import cost_at_gap, scan_gap, starts
from anhyst.identification.space import CoordinateSpace
from anhyst.support.arrays import FloatArray

SCREENED = 256
KEPT = 3
TIED = frozenset({"circuit", "free"})
"""Maps with more to each gap than its loops determine, so that neighbouring gaps are tied."""

TIE = 3e-3
"""Weight of the ties of such a map, relative to the cost of the fit without them."""

COMPARED = (1e-7, 200)
"""Tolerance and evaluations, at most, of a fit that is compared with others."""

TO_END = (1e-8, 50)
"""The same of the one that is chosen."""

_SHORT = 6
"""Evaluations of a first descent: enough to distinguish a good valley from a bad one."""


@dataclass(frozen=True, eq=False)
class FoundModel:
    """Outcome of a search under one gap map: coordinates, weighted sum of squares, evaluations."""

    space: CoordinateSpace
    theta: FloatArray
    cost: float
    evaluations: int

    @property
    def sets(self) -> list[Local]:
        """Gauge-free parameters at each gap."""
        return [local for local, _ in self.space.unpack(self.theta)]

    def on(self, records: FitRecords) -> FoundModel:
        """Take the same parameters to other records of the same gaps."""
        return replace(self, space=replace(self.space, records=records))

    @property
    def tie(self) -> float:
        """Weight of the ties of its map, for a descent that goes on from here."""
        return TIE * self.cost if self.space.gap_map in TIED else 0.0


def follow(
    space: CoordinateSpace,
    theta: FloatArray,
    tolerance: float = COMPARED[0],
    most: int = COMPARED[1],
    tie: float = 0.0,
    goal: float = np.inf,
) -> FoundModel:
    """Descend from a start and count; without a goal in reach (:func:`.descend`) it ends."""
    objective = Objective(space, tie)
    fit = descend(objective, theta, tolerance, most, goal)
    return FoundModel(space, fit.theta, fit.cost, objective.evaluations)


def reference_gap(records: FitRecords) -> int:
    """Gap with the largest output: there the iron is driven furthest and shows most."""
    sizes = np.zeros(records.gaps)
    for record in records.loops:
        sizes[record.gap] = max(sizes[record.gap], float(np.max(np.abs(record.output))))
    return int(np.argmax(sizes))


def search_one_gap(
    form: ResponseForm, records: FitRecords, seed: int, held: frozenset[str]
) -> FoundModel:
    """Fit one gap from scratch."""
    space = CoordinateSpace("none", records, form, held)
    return _best_end(space, [space.pack([local]) for local in starts(space, SCREENED, KEPT, seed)])


def _best_end(space: CoordinateSpace, begins: list[FloatArray]) -> FoundModel:
    """Descend a little from each begin, and to the end from the best of them."""
    tried = [follow(space, theta, 1e-4, _SHORT + space.records.gaps) for theta in begins]
    final = follow(space, min(tried, key=lambda end: end.cost).theta)
    return replace(final, evaluations=final.evaluations + sum(end.evaluations for end in tried))


def search_each_gap(
    form: ResponseForm, records: FitRecords, seed: int, held: frozenset[str]
) -> FoundModel:
    """Fit every gap with parameters of its own: the map ``free``.

    Each gap is fitted from scratch, and once more from its neighbour's end, so that all gaps can
    lie in one valley. Then all are tied together so weakly that the fit hardly notices
    (:data:`TIE`): directions that the loops of one gap do not determine would otherwise scatter, and
    nothing could be interpolated.
    """
    space = CoordinateSpace("free", records, form, held)
    alone = [search_one_gap(form, records.at(gap), seed, held) for gap in range(records.gaps)]
    home = reference_gap(records)
    carried = {home: alone[home]}
    for gap in [*range(home + 1, records.gaps), *range(home - 1, -1, -1)]:
        neighbour = carried[gap - 1 if gap > home else gap + 1]
        carried[gap] = follow(alone[gap].space, neighbour.theta, 1e-6, 30)
    tie = TIE * sum(end.cost for end in alone)
    ends = [
        follow(space, space.pack([end.sets[0] for end in ones]), 1e-6, 60, tie)
        for ones in (alone, [carried[gap] for gap in range(records.gaps)])
    ]
    best = min(ends, key=lambda end: end.cost)
    return replace(best, evaluations=sum(end.evaluations for end in (*alone, *ends)))


def join_gaps(
    form: ResponseForm, records: FitRecords, gap_map: str, known: list[Local], held: frozenset[str]
) -> FoundModel:
    """Fit all gaps together under one map, from what is known at the reference gap."""
    space = CoordinateSpace(gap_map, records, form, held)
    home = reference_gap(records)
    at_gaps = [
        (known, cost_at_gap(space, gap, known)) if gap == home else scan_gap(space, gap, known)
        for gap in range(records.gaps)
    ]
    order = np.argsort(np.sum([cost for _, cost in at_gaps], axis=0))
    begins = [[found[index] for found, _ in at_gaps] for index in order[:KEPT]]
    return _best_end(space, [space.pack(sets) for sets in begins])


def join_circuit(
    plain: FoundModel, gap_map: str, common: frozenset[str] = frozenset()
) -> FoundModel:
    """Fit all gaps together with one iron, and a circuit around it that takes more than a gap."""
    old = plain.space
    space = CoordinateSpace(gap_map, old.records, old.form, old.held, common)
    end = follow(space, space.pack(plain.sets), tie=TIE * plain.cost if gap_map in TIED else 0.0)
    return replace(end, evaluations=end.evaluations + plain.evaluations)
