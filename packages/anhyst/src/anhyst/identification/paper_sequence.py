"""Perform the paper's search: free parameter sets at each gap, the reduction, and the model.

The reduction decreases the number of gap-dependent parameters (the paper, II.D and Fig. 3). Each
round tries every parameter that still depends on the gap: the parameter is replaced by its mean
over the gaps, and the others are searched again briefly at each gap. The parameter with the lowest
cost stays fixed, and the others are searched in full. The rounds end when one parameter is left.
Before the first round, all gaps are converted to one gauge, because a mean over different gauges
has no meaning (docs/theory.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from anhyst.data import Loops
from anhyst.identification.candidates import require_gaps
from anhyst.identification.default_search import FoundModel
from anhyst.identification.model_building import is_scheduled_over_gap, make_model
from anhyst.identification.objective import Objective
from anhyst.identification.paper_parameters import (
    OFFSET_NAMES,
    POSITIVE_NAMES,
    Parameters,
    find_gauge_parameters,
    make_parameter_set,
    mean_deviation,
    mean_over_gaps,
    move_to_one_gauge,
)
from anhyst.identification.paper_search import (
    PaperSearch,
    SearchEffort,
    SearchState,
    model_at_nodes,
    search_each_gap,
)
from anhyst.identification.response import ParameterSet
from anhyst.identification.run import Outcome, SearchRun
from anhyst.identification.space import CoordinateSpace
from anhyst.identification.uncertainty import assess_uncertainty
from anhyst.model.actuator import Model
from anhyst.model.schema import ReductionStep
from anhyst.support.errors import InputError

_EQUAL_COST_SHARE = 0.01
"""Relative difference up to which costs are equal, because a simplex search is not more accurate.
"""

_NEGLIGIBLE_COST = 1e-5
"""Difference up to which costs are equal, relative to the largest output; below sensor resolution.
"""


def count_stages(search: PaperSearch, last_name: str | None) -> int:
    """Return the number of stages of :func:`reduce_gap_dependence`."""
    gaps, names = search.gap_count, len(search.searched_names)
    fixed_last = 0 if last_name is None else 1
    return gaps + sum(varying_count - fixed_last + gaps for varying_count in range(2, names + 1))


def move_to_common_gauge(search: PaperSearch, free_state: SearchState) -> SearchState:
    """Convert all gaps to one gauge and, if their loops allow it, to one minimum of the cost.

    Parameters chosen by the gauge are then equal at all gaps, so they are fixed first and at no
    cost. Loops that barely saturate also have long flat valleys, in which a mean over gaps has no
    meaning. Therefore, the other parameters are searched again, outward from the reference gap.
    Each gap starts from the result of its neighbour and from its own set. The neighbour's result is
    preferred unless it costs more.
    """
    moved_sets = move_to_one_gauge(free_state.sets, search.searched_names, search.run.form.power)
    reference = search.run.records.reference_gap
    sets: dict[int, Parameters] = {}
    evaluations = free_state.evaluations
    for gap in [reference, *range(reference + 1, search.gap_count), *range(reference - 1, -1, -1)]:
        neighbour = sets.get(gap - 1 if gap > reference else gap + 1)
        sets[gap], gap_evaluations = search.run.run_stage(
            f"gap {gap} in a common gauge",
            partial(_search_from_neighbour, search, gap, moved_sets[gap], neighbour),
        )
        evaluations += gap_evaluations
    return search.make_state([sets[gap] for gap in range(search.gap_count)], free_state.varying, evaluations)


def _search_from_neighbour(
    search: PaperSearch, gap: int, own_values: Parameters, neighbour_values: Parameters | None
) -> tuple[Parameters, int]:
    """Search one gap from its own set and its neighbour's set; prefer the neighbour's result."""
    names = [
        name for name in search.searched_names if name not in find_gauge_parameters(search.searched_names)
    ]
    starts = [own_values] if neighbour_values is None else [neighbour_values, own_values]
    results = [search.refine_set(gap, start, names, search.effort.final_evaluations) for start in starts]
    costs = [search.cost_at_gap(gap, values) for values, _ in results]
    best = 0 if costs[0] <= _max_equal_cost(min(costs)) else 1
    return results[best][0], sum(evaluations for _, evaluations in results)


def reduce_gap_dependence(
    search: PaperSearch, free_state: SearchState, last_name: str | None = None
) -> Iterator[tuple[SearchState, ReductionStep]]:
    """Make one parameter after another equal at all gaps until one varies; yield each step."""
    state = move_to_common_gauge(search, free_state)
    while len(state.varying) > 1:
        trials = {
            name: _try_fixing_parameter(search, state, name) for name in state.varying if name != last_name
        }
        costs = {name: trial.cost for name, trial in trials.items()}
        fixed_name, previous_state = _select_cheapest(state, costs), state
        evaluations = previous_state.evaluations + sum(trial.evaluations for trial in trials.values())
        stage = _stage_name(trials[fixed_name].varying, "in full at gap {}")
        sets, full_evaluations = search.search_gaps(
            stage, trials[fixed_name].sets, trials[fixed_name].varying
        )
        state = search.make_state(sets, trials[fixed_name].varying, evaluations + full_evaluations)
        yield state, ReductionStep(fixed_name, previous_state.cost, state.cost, costs)


def _try_fixing_parameter(search: PaperSearch, state: SearchState, name: str) -> SearchState:
    """Replace one parameter by its mean, and search the other parameters briefly at every gap."""
    free_names = [free_name for free_name in state.varying if free_name != name]
    mean = mean_over_gaps(name, [values[name] for values in state.sets])

    def work() -> dict[str, object]:
        results = [
            search.refine_set(gap, values | {name: mean}, free_names, search.effort.trial_evaluations)
            for gap, values in enumerate(state.sets)
        ]
        evaluations = sum(result[1] for result in results)
        return asdict(search.make_state([result[0] for result in results], free_names, evaluations))

    return SearchState.from_plain(search.run.run_stage(_stage_name(state.varying, f"without {name}"), work))


def _stage_name(varying: Sequence[str], description: str) -> str:
    return f"{', '.join(varying)} over the gap, {description}"


def _select_cheapest(state: SearchState, costs: dict[str, float]) -> str:
    """Return the parameter to fix: the cheapest or, at equal cost, the most constant one."""
    limit = _max_equal_cost(min(costs.values()))
    return min(
        (name for name, cost in costs.items() if cost <= limit),
        key=lambda name: _relative_spread(name, [values[name] for values in state.sets]),
    )


def _max_equal_cost(cost: float) -> float:
    """Return the highest cost that counts as equal to a cost."""
    return cost * (1.0 + _EQUAL_COST_SHARE) + _NEGLIGIBLE_COST


def _relative_spread(name: str, values: Sequence[float]) -> float:
    """Return the relative spread of a parameter over the gaps."""
    if name in POSITIVE_NAMES:
        return float(np.std(np.log(values)))
    return float(np.std(values) / max(np.max(np.abs(values)), np.finfo(np.float64).tiny))


LAST_VARYING = {"auto": None, "scaling": "c_H", "reluctance": "alpha"}
"""Parameter that remains gap-dependent for a requested gap map. ``free`` makes no reduction."""

_EQUAL_COST_RATIO = 1.01  # ratio of costs up to which a model in another form is equal


def search_paper(run: SearchRun, loopset: Loops, gap_map: str, effort: SearchEffort | None = None) -> Outcome:
    """Perform the paper's search."""
    require_gaps(run.records, gap_map)
    search = PaperSearch(run, loopset, effort or SearchEffort())
    last_name = _find_last_varying_name(search, gap_map)
    is_reducing = search.gap_count > 1 and gap_map != "free"
    has_common_offsets = search.gap_count > 1 and not set(OFFSET_NAMES) <= run.fixed
    run.total_stages = search.gap_count * (2 if has_common_offsets else 1)
    run.total_stages += count_stages(search, last_name) if is_reducing else 0
    free_state: SearchState | None = None
    steps: list[ReductionStep] = []
    interrupted = False
    try:
        free_state = state = search_each_gap(search)
        for next_state, step in reduce_gap_dependence(search, free_state, last_name) if is_reducing else ():
            state = next_state
            steps.append(step)
    except KeyboardInterrupt:
        if free_state is None:
            raise
        interrupted = True
    model, fit = _make_model(search, state, gap_map)
    return Outcome(
        model,
        assess_uncertainty(fit, loopset),
        fit.theta.size,
        fit.evaluations,
        _explain_reduction(state, model, is_reducing, interrupted),
        interrupted,
        steps=tuple(steps),
        per_gap=model_at_nodes(free_state, run, loopset) if search.gap_count > 1 else None,
        resumed_stages=run.resumed_stages,
        fit=fit,
    )


def _find_last_varying_name(search: PaperSearch, gap_map: str) -> str | None:
    name = LAST_VARYING.get(gap_map)
    if name is not None and name not in search.searched_names:
        quantity = search.loopset.input.name
        raise InputError(
            f"gap map '{gap_map}' with search 'paper' reduces to {name}, but {name} is known with a "
            f"measured {quantity}; use --gap-map auto or --search default",
            code="choices-together",
            key="gap_map",
        )
    return name


def _make_model(search: PaperSearch, state: SearchState, gap_map: str) -> tuple[Model, FoundModel]:
    model = model_at_nodes(state, search.run, search.loopset)
    sets = [make_parameter_set(values, search.run.form.power) for values in state.sets]
    h = float(np.mean([parameter_set.h for parameter_set in sets]))
    # A gap-dependent alpha can be a reluctance, for a gap and not in the law of 1986.
    is_over_gap = gap_map == "reluctance" or is_scheduled_over_gap(search.loopset)
    can_be_circuit = "c_H" in search.searched_names and not search.run.form.kernel.includes_interaction
    if state.varying == ("alpha",) and is_over_gap and can_be_circuit and search.gap_count > 1:
        fit = _make_fit(search, state, "reluctance", _as_series_reluctance(sets, h), h)
        outputs = Objective(fit.space).outputs(fit.parameter_sets)
        if mean_deviation(search.run.records, outputs) <= _EQUAL_COST_RATIO * state.cost:
            return make_model(fit, search.loopset), fit
    return model, _make_fit(search, state, model.gap_map, sets, h)


def _make_fit(
    search: PaperSearch, state: SearchState, gap_map: str, sets: list[ParameterSet], h: float
) -> FoundModel:
    form = replace(search.run.form, h=h)
    space = CoordinateSpace(gap_map, search.run.records, form, search.run.fixed)
    return FoundModel(space, space.pack(sets), state.cost, state.evaluations)


def _as_series_reluctance(sets: list[ParameterSet], h: float) -> list[ParameterSet]:
    """Convert a gap-dependent alpha to a gap-dependent series reluctance.

    Both forms are equal except for the slope of the air core, which is small in the common gauge
    (docs/theory.md). With a reluctance, the gap may move during a run; with alpha, the gap must be
    fixed.
    """
    c_h_without_reluctance = float(
        np.mean([parameter_set.scale * (1.0 - h * parameter_set.omega) for parameter_set in sets])
    )
    gain = float(np.mean([parameter_set.gain for parameter_set in sets]))
    return [
        replace(parameter_set, h=h, gain=gain, scale=c_h_without_reluctance / (1.0 - h * parameter_set.omega))
        for parameter_set in sets
    ]


def _explain_reduction(state: SearchState, model: Model, is_reducing: bool, is_interrupted: bool) -> str:
    if is_interrupted:
        return "the search was interrupted: this is the best model so far"
    if not model.nodes or len(model.nodes) < 2:
        return "there is only one gap, so no parameter depends on it"
    if not is_reducing:
        return "gap map 'free' was requested, so there was no reduction"
    last_varying = state.varying[0]
    if model.gap_map == "reluctance":
        return (
            f"after the reduction, only {last_varying} depends on the gap: a series reluctance, stored as rho"
        )
    if model.gap_map == "free":
        return f"after the reduction, only {last_varying} depends on the gap: for runs at a fixed gap"
    return f"after the reduction, only {last_varying} depends on the gap"
