"""Search the seven free parameters of the paper at each gap, by evolution and simplex (II.B, II.C).

1. At each gap, an evolution strategy searches the seven parameters and the offsets of input and output
   with the criterion of eq. 16. The core computes each generation in one batch, on thinned loops.
   A Nelder-Mead simplex search continues with the exact law.
2. Offsets belong to the sensors, not to a gap. They are replaced by their means, and the seven
   parameters are searched again. The result, the paper's free model, fits each gap as well as the law
   can, but its parameters scatter along the redundancies (Fig. 1). An ordinary spline through these
   parameters is wrong between the gaps (Fig. 2, :func:`spline_model_at`).
3. :mod:`.paper_sequence` then makes one parameter after another equal at all gaps (Fig. 3).

Searches use thinned loops, because the exact step does not depend on the sampling. Every reported
cost is computed on all samples. All random numbers come from the seed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from anhyst.data import Loops
from anhyst.identification.paper_parameters import (
    OFFSET_NAMES,
    Criterion,
    Parameters,
    make_variables,
    mean_over_gaps,
    run_simplex,
)
from anhyst.identification.run import SearchRun
from anhyst.model.acceptance import GapCheck, check_over_gap
from anhyst.model.actuator import Model
from anhyst.model.parameters import VARYING_BY_GAP_MAP, Parameter
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

PARENT_COUNT = 15
CHILD_COUNT = 105  # seven children per parent, as Schwefel recommends for self-adaptation
_FIRST_STEP = 0.2  # first step size, relative to the range of a variable
_MIN_STEP = 1e-9  # smallest step size, relative to the range


def reflect_into_bounds(values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Bring values within bounds by reflecting them as often as necessary.

    Unlike clipping, reflection does not collect individuals on the bounds.

    >>> reflect_into_bounds(np.array([1.2, -0.5, 3.4]), np.zeros(3), np.ones(3)).round(12)
    array([0.8, 0.5, 0.6])
    """
    span = high - low
    position = np.mod(values - low, 2.0 * span)
    return np.asarray(low + np.minimum(position, 2.0 * span - position))


class EvolutionStrategy:
    """The (mu, lambda) evolution strategy after Schwefel, with self-adaptive step sizes.

    References: H.-P. Schwefel, *Evolution and Optimum Seeking*, Wiley 1995; operators after T. Baeck,
    *Evolutionary Algorithms in Theory and Practice*, Oxford 1996, section 2.1. Every individual has one
    step size per variable. Step sizes are inherited and mutated before the variables, so that good step
    sizes survive through their children.

    The strategy finds the region of the minimum and then converges slowly: with one step size per
    axis, it cannot follow a valley that is not parallel to an axis. Therefore, a simplex search
    continues from its result (the paper, II.C).
    """

    def __init__(
        self,
        low: FloatArray,
        high: FloatArray,
        seed: int | list[int],
        parents: int = PARENT_COUNT,
        children: int = CHILD_COUNT,
    ) -> None:
        if not np.all(low < high):
            raise InputError(
                "evolution strategy: each lower bound must be below its upper bound", code="range-reversed"
            )
        if not 1 <= parents < children:
            raise InputError(
                f"evolution strategy: {children} children of {parents} parents allow no "
                "selection; use about seven children per parent",
                code="too-few-children",
            )
        self._low, self._high = low.copy(), high.copy()
        self._random = np.random.default_rng(seed)
        self._mu, self._lambda = parents, children
        size = low.size
        self._tau = 1.0 / np.sqrt(2.0 * np.sqrt(size))  # learning rate of each step size
        self._tau_common = 1.0 / np.sqrt(2.0 * size)  # learning rate common to all steps
        self._x = low + (high - low) * self._random.random((children, size))
        self._sigma = np.tile(_FIRST_STEP * (high - low), (children, 1))
        self.best = self._x[0].copy()
        self.best_cost = np.inf

    def ask(self) -> FloatArray:
        """Return the individuals of the present generation, shape (children, n)."""
        return self._x.copy()

    def tell(self, costs: FloatArray) -> None:
        """Select the parents of the next generation by their costs, and create it."""
        ranking = np.argsort(np.where(np.isnan(costs), np.inf, costs), kind="stable")
        if costs[ranking[0]] < self.best_cost:
            self.best_cost = float(costs[ranking[0]])
            self.best = self._x[ranking[0]].copy()
        x, sigma = (values[ranking[: self._mu]] for values in (self._x, self._sigma))
        parent_pairs = self._random.integers(0, self._mu, (2, self._lambda))
        is_from_first = self._random.random((self._lambda, self._low.size)) < 0.5
        self._x = np.where(is_from_first, x[parent_pairs[0]], x[parent_pairs[1]])
        self._sigma = 0.5 * (sigma[parent_pairs[0]] + sigma[parent_pairs[1]])
        self._mutate()

    def _mutate(self) -> None:
        """Mutate the step sizes (log-normal), then the variables with these steps (normal)."""
        common = self._random.standard_normal((self._lambda, 1))
        individual_steps = self._random.standard_normal(self._sigma.shape)
        self._sigma = self._sigma * np.exp(self._tau_common * common + self._tau * individual_steps)
        span = self._high - self._low
        self._sigma = np.clip(self._sigma, _MIN_STEP * span, span)
        steps = self._sigma * self._random.standard_normal(self._x.shape)
        self._x = reflect_into_bounds(self._x + steps, self._low, self._high)


_PARENTS = 30
_CHILDREN = 210
_EVOLUTION_SAMPLES = 64
_SIMPLEX_SAMPLES = 128
"""Maximum number of samples per loop, for the evolution strategy and for the simplex search."""


@dataclass(frozen=True)
class SearchEffort:
    """Effort of a search: generations, and evaluations of the simplex per variable.

    ``trial_evaluations`` rank the candidates of a round, ``final_evaluations`` refine the selected one.
    """

    generations: int = 400
    final_evaluations: int = 250
    trial_evaluations: int = 40


@dataclass(frozen=True)
class SearchState:
    """State of a search: parameters at each gap, gap-dependent parameters, and the cost."""

    sets: tuple[Parameters, ...]
    varying: tuple[str, ...]
    cost: float
    evaluations: int = 0

    @classmethod
    def from_plain(cls, stored_state: dict[str, Any]) -> SearchState:
        """Restore a state from a checkpoint, which stores tuples as lists."""
        return cls(**stored_state | {key: tuple(stored_state[key]) for key in ("sets", "varying")})


@dataclass
class PaperSearch:
    """Loops of every gap, prepared for searches over any of the parameters."""

    run: SearchRun  # settings and stages of the identification
    loopset: Loops  # measured loops, for their quantities
    effort: SearchEffort = field(default_factory=SearchEffort)  # effort of the search

    def __post_init__(self) -> None:
        self.variables, self.fixed_values = make_variables(
            self.run.records, self.loopset.input, self.loopset.output, self.run.fixed
        )
        self.searched_names = tuple(name for name in self.variables.names if name not in OFFSET_NAMES)
        self._records = [self.run.records.at_gap(gap) for gap in range(self.gap_count)]
        weight_sums = [
            sum(record.weight**2 * record.input.size for record in records.loops) for records in self._records
        ]
        self._shares = [count / sum(weight_sums) for count in weight_sums]

    @property
    def gap_count(self) -> int:
        """Number of gaps."""
        return self.run.records.gap_count

    def cost(self, sets: Sequence[Parameters]) -> float:
        """Return the criterion of eq. 16 over all samples of all gaps."""
        costs = [self.cost_at_gap(gap, values) for gap, values in enumerate(sets)]
        return float(np.dot(self._shares, costs))

    def cost_at_gap(self, gap: int, values: Parameters) -> float:
        """Return the criterion of eq. 16 at one gap."""
        return Criterion(self.run.form, self._records[gap]).cost_of_set(values)

    def _criterion(self, gap: int, samples: int) -> Criterion:
        return Criterion(self.run.form, self._records[gap].thinned(samples))

    def make_state(self, sets: Sequence[Parameters], varying: Sequence[str], evaluations: int) -> SearchState:
        """Return the state of a search with given parameter sets."""
        return SearchState(tuple(sets), tuple(varying), self.cost(sets), evaluations)

    def refine_set(
        self, gap: int, values: Parameters, names: Sequence[str], evaluations_per_variable: int
    ) -> tuple[Parameters, int]:
        """Run the simplex search at one gap from given values; also return its evaluations."""
        variables = self.variables.restrict_to(names)
        criterion = self._criterion(gap, _SIMPLEX_SAMPLES)

        def cost(theta: FloatArray) -> float:
            return criterion.cost_of_set(values | _to_floats(variables.to_parameters(theta)))

        best_values, _ = run_simplex(
            cost, variables, variables.to_coordinates(values), evaluations_per_variable * variables.size
        )
        return values | _to_floats(variables.to_parameters(best_values)), criterion.evaluations

    def evolve_set(self, gap: int, values: Parameters, names: Sequence[str]) -> tuple[Parameters, int]:
        """Run the evolution strategy at one gap over the whole range of the named parameters."""
        variables = self.variables.restrict_to(names)
        criterion = self._criterion(gap, _EVOLUTION_SAMPLES)
        seed = [self.run.seed, gap, variables.size]
        strategy = EvolutionStrategy(variables.low, variables.high, seed, _PARENTS, _CHILDREN)
        fixed = {
            name: np.full(_CHILDREN, value) for name, value in values.items() if name not in variables.names
        }
        for _ in range(self.effort.generations):
            strategy.tell(criterion.costs_of_sets(fixed | variables.to_parameters(strategy.ask())))
        return values | _to_floats(variables.to_parameters(strategy.best)), criterion.evaluations

    def search_gap(self, gap: int, values: Parameters, names: Sequence[str]) -> tuple[Parameters, int]:
        """Search one gap in full: evolution, then simplex from its result or from the given values.

        The given values are a start only if they contain every named parameter.
        """
        evolved_values, evaluations = self.evolve_set(gap, values, names)
        starts = [values, evolved_values] if set(names) <= values.keys() else [evolved_values]
        criterion = self._criterion(gap, _SIMPLEX_SAMPLES)
        best = min(starts, key=criterion.cost_of_set)
        refined_set, simplex_evaluations = self.refine_set(gap, best, names, self.effort.final_evaluations)
        return refined_set, evaluations + simplex_evaluations

    def search_gaps(
        self, stage: str, sets: Sequence[Parameters], names: Sequence[str]
    ) -> tuple[list[Parameters], int]:
        """Search every gap in full, each as one stage; return the sets and the evaluations."""
        results = [
            self.run.run_stage(stage.format(gap), partial(self.search_gap, gap, values, names))
            for gap, values in enumerate(sets)
        ]
        return [values for values, _ in results], sum(evaluations for _, evaluations in results)


def _to_floats(arrays: Mapping[str, FloatArray]) -> Parameters:
    return {name: float(value) for name, value in arrays.items()}


def search_each_gap(search: PaperSearch) -> SearchState:
    """Find the paper's free model: a separate set for every gap, with common offsets."""
    names = search.variables.names
    sets, evaluations = search.search_gaps(
        "gap {} from scratch", [search.fixed_values] * search.gap_count, names
    )
    offsets = [name for name in names if name in OFFSET_NAMES]
    if offsets and search.gap_count > 1:
        means = {name: mean_over_gaps(name, [values[name] for values in sets]) for name in offsets}
        common = [values | means for values in sets]
        sets, second_evaluations = search.search_gaps(
            "gap {} with common offsets", common, search.searched_names
        )
        evaluations += second_evaluations
    return search.make_state(sets, search.searched_names, evaluations)


def model_at_nodes(state: SearchState, run: SearchRun, loopset: Loops) -> Model:
    """Return the model with one value per gap for gap-dependent parameters, without records.

    The gap map is ``scaling`` if it allows the varying parameters, else ``free``.
    """
    is_single_gap = run.records.gap_count == 1
    parameters: dict[str, Parameter] = dict(state.sets[0])
    for name in () if is_single_gap else state.varying:
        parameters[name] = tuple(values[name] for values in state.sets)
    is_scaling = set(state.varying) <= VARYING_BY_GAP_MAP["scaling"]
    return Model(
        name="model",
        input=loopset.input,
        output=loopset.output,
        parameters=parameters,
        law=run.form.law,
        gap_map="none" if is_single_gap else "scaling" if is_scaling else "free",
        schedule=loopset.schedule,
        nodes=tuple(float(node) for node in run.records.nodes),
    )


def spline_model_at(model: Model, gap: float) -> Model:
    """Return the model of one gap from cubic splines through all parameters (the paper's II.C).

    The result shows why ordinary splines fail (Figs. 1 and 2): a spline overshoots between nodes,
    and parameters that scatter along a redundancy are not consistent. Models use the interpolation
    of :mod:`anhyst.model.parameters`.
    """
    if len(model.nodes) < 2:
        raise InputError("a spline over the gap needs a model with at least two nodes", code="single-gap")
    # Imported here, because importing SciPy takes longer than the default search, which does not
    # need it.
    from scipy.interpolate import CubicSpline

    parameters = {
        name: float(CubicSpline(model.nodes, value)(gap)) if isinstance(value, tuple) else value
        for name, value in model.parameters.items()
    }
    return replace(model, parameters=parameters, gap_map="none", schedule=None, nodes=(), reduction=())


def check_splines(model: Model) -> GapCheck | None:
    """Run the acceptance test (II.C) with ordinary splines through the parameters."""
    return check_over_gap(model, lambda gap: spline_model_at(model, gap))
