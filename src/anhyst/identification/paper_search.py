"""The paper's search (II.B and II.C): seven free parameters at each gap, by evolution and simplex.

1. At each gap by itself the evolution strategy of :mod:`.evolution` narrows seven parameters, and
   the offsets of input and output with them, on the criterion of eq. 16; a generation is computed
   at once by the batch of the core, on thinned loops. Nelder and Mead's simplex finishes on the
   exact law.
2. Offsets belong to the sensors and not to a gap: they are replaced by their means, and the seven
   are searched again. That is the paper's free model. It fits each gap as well as the law can, and
   its parameters scatter along the redundancies (Fig. 1); an ordinary spline through them gives
   nonsense between the gaps (Fig. 2, :func:`spline_model_at`).
3. :mod:`.reduction` then makes one parameter after another the same at all gaps (Fig. 3).

Searches see thinned loops, since the exact step does not depend on how the path is cut; every cost
that is reported is computed on all samples. Everything random comes from the seed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from anhyst.data import Loops
from anhyst.identification.paper_criterion import Criterion, simplex
from anhyst.identification.paper_evolution import EvolutionStrategy
from anhyst.identification.paper_seven import OFFSETS, Values, mean_over_gaps, variables_of
from anhyst.identification.run import SearchRun
from anhyst.model.acceptance import GapCheck, check_over_gap
from anhyst.model.actuator import Model
from anhyst.model.parameters import MAY_VARY
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

_PARENTS, _CHILDREN = 30, 210
_SAMPLES_EVOLUTION = 64
_SAMPLES_SIMPLEX = 128
"""Samples a loop, at most."""


@dataclass(frozen=True)
class SearchEffort:
    """How long to search: generations, and evaluations of the simplex for each variable.

    ``trial`` ranks the candidates of a round; ``final`` is spent on the one that is kept.
    """

    generations: int = 400
    final: int = 250
    trial: int = 40


@dataclass(frozen=True)
class Stand:
    """Where a search stands: parameters at each gap, those that may differ, and the cost."""

    sets: tuple[Values, ...]
    varying: tuple[str, ...]
    cost: float
    evaluations: int = 0

    @property
    def plain(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return {
            "sets": [dict(values) for values in self.sets],
            "varying": list(self.varying),
            "cost": self.cost,
            "evaluations": self.evaluations,
        }

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> Stand:
        """Rebuild from what a checkpoint kept."""
        return cls(
            tuple(plain["sets"]), tuple(plain["varying"]), plain["cost"], plain["evaluations"]
        )


@dataclass
class SearchBench:
    """Loops at every gap, ready for searches with any of the parameters."""

    run: SearchRun  # settings and stages
    loopset: Loops  # for the quantities
    effort: SearchEffort = field(default_factory=SearchEffort)  # how long to search

    def __post_init__(self) -> None:
        self.variables, self.known = variables_of(
            self.run.records, self.loopset.input, self.loopset.output, self.run.held
        )
        self.searched = tuple(name for name in self.variables.names if name not in OFFSETS)
        self._records = [self.run.records.at(gap) for gap in range(self.gaps)]
        counts = [
            sum(record.weight**2 * record.input.size for record in records.loops)
            for records in self._records
        ]
        self._shares = [count / sum(counts) for count in counts]

    @property
    def gaps(self) -> int:
        """Number of gaps."""
        return self.run.records.gaps

    def cost(self, sets: Sequence[Values]) -> float:
        """Criterion of eq. 16 over all samples of all gaps, relative to the largest output."""
        costs = [self.cost_at(gap, values) for gap, values in enumerate(sets)]
        return float(np.dot(self._shares, costs))

    def cost_at(self, gap: int, values: Values) -> float:
        """Compute the same at one gap."""
        return Criterion(self.run.form, self._records[gap]).of_one(values)

    def _criterion(self, gap: int, samples: int) -> Criterion:
        return Criterion(self.run.form, self._records[gap].thinned(samples))

    def stand(self, sets: Sequence[Values], varying: Sequence[str], evaluations: int) -> Stand:
        """Sum up a search that has come to these sets."""
        return Stand(tuple(sets), tuple(varying), self.cost(sets), evaluations)

    def refine(
        self, gap: int, values: Values, names: Sequence[str], each: int
    ) -> tuple[Values, int]:
        """Run the simplex at one gap from given values."""
        variables = self.variables.only(names)
        criterion = self._criterion(gap, _SAMPLES_SIMPLEX)

        def cost(theta: FloatArray) -> float:
            return criterion.of_one(values | _numbers(variables.outward(theta)))

        best, _ = simplex(cost, variables, variables.inward(values), each * variables.size)
        return values | _numbers(variables.outward(best)), criterion.evaluations

    def evolve(self, gap: int, values: Values, names: Sequence[str]) -> tuple[Values, int]:
        """Run the evolution strategy at one gap, over the whole range of the names."""
        variables = self.variables.only(names)
        criterion = self._criterion(gap, _SAMPLES_EVOLUTION)
        seed = [self.run.seed, gap, variables.size]
        strategy = EvolutionStrategy(variables.low, variables.high, seed, _PARENTS, _CHILDREN)
        held = {
            name: np.full(_CHILDREN, value)
            for name, value in values.items()
            if name not in variables.names
        }
        for _ in range(self.effort.generations):
            strategy.tell(criterion.of_many(held | variables.outward(strategy.ask())))
        return values | _numbers(variables.outward(strategy.best)), criterion.evaluations

    def search(
        self, gap: int, values: Values, names: Sequence[str], begin: Values | None = None
    ) -> tuple[Values, int]:
        """Search one gap in full: evolution, then simplex from its end or from a better beginning."""
        evolved, spent = self.evolve(gap, values, names)
        beginnings = [evolved] if begin is None else [begin, evolved]
        criterion = self._criterion(gap, _SAMPLES_SIMPLEX)
        best = min(beginnings, key=criterion.of_one)
        refined, more = self.refine(gap, best, names, self.effort.final)
        return refined, spent + more


def _numbers(arrays: Mapping[str, FloatArray]) -> Values:
    return {name: float(value) for name, value in arrays.items()}


def search_each_gap(bench: SearchBench) -> Stand:
    """Find the paper's free model: an optimal set for every gap, offsets common to all."""
    names = bench.variables.names
    alone = [
        bench.run.stage(
            f"gap {gap} from scratch",
            lambda gap=gap: bench.search(gap, dict(bench.known), names),  # type: ignore[misc]
        )
        for gap in range(bench.gaps)
    ]
    sets, spent = [one[0] for one in alone], sum(one[1] for one in alone)
    offsets = [name for name in names if name in OFFSETS]
    if offsets and bench.gaps > 1:
        means = {name: mean_over_gaps(name, [values[name] for values in sets]) for name in offsets}
        common = [values | means for values in sets]
        again = [
            bench.run.stage(
                f"gap {gap} with common offsets",
                lambda gap=gap: bench.search(gap, common[gap], bench.searched, common[gap]),  # type: ignore[misc]
            )
            for gap in range(bench.gaps)
        ]
        sets, spent = [one[0] for one in again], spent + sum(one[1] for one in again)
    return bench.stand(sets, bench.searched, spent)


def model_at_nodes(stand: Stand, run: SearchRun, loopset: Loops) -> Model:
    """Bare model with a number at each gap for what varies.

    The gap map is ``scaling`` where that allows what varies, else ``free``.
    """
    single = run.records.gaps == 1
    parameters = {
        name: tuple(values[name] for values in stand.sets)
        if name in stand.varying and not single
        else stand.sets[0][name]
        for name in stand.sets[0]
    }
    scaling = set(stand.varying) <= MAY_VARY["scaling"]
    return Model(
        name="model",
        input=loopset.input,
        output=loopset.output,
        parameters=parameters,
        law=run.form.law,
        gap_map="none" if single else "scaling" if scaling else "free",
        schedule=loopset.schedule,
        nodes=tuple(float(node) for node in run.records.nodes),
    )


def spline_model_at(model: Model, gap: float) -> Model:
    """Model of one gap from ordinary cubic splines through all parameters, as in the paper's II.C.

    Kept to show why that fails (Figs. 1 and 2): between nodes a spline overshoots, and parameters
    that scatter along a redundancy do not belong together. The product's own interpolation is that
    of :mod:`anhyst.model.gap_map`.
    """
    if len(model.nodes) < 2:
        raise InputError(
            "a spline over the gap needs a model with two nodes or more", code="single-gap"
        )
    # Only here: importing it takes longer than the default search, which does without.
    from scipy.interpolate import CubicSpline

    parameters = {
        name: float(CubicSpline(model.nodes, value)(gap)) if isinstance(value, tuple) else value
        for name, value in model.parameters.items()
    }
    return replace(
        model, parameters=parameters, gap_map="none", schedule=None, nodes=(), reduction=()
    )


def check_splines(model: Model) -> GapCheck | None:
    """Run the acceptance test (II.C) with ordinary splines through the parameters."""
    return check_over_gap(model, lambda gap: spline_model_at(model, gap))
