"""Search Jiles-Atherton parameters: screen one gap, optimise the best sets, then join all gaps.

A gap map states how parameters depend on the air gap. The map ``free`` has separate parameters at
each gap. The other maps have one main gap-dependent parameter, such as a reluctance.

1. Simulate many parameter sets for the loops of the gap with the largest output (:mod:`.screening`).
2. Minimise the squared residuals at that gap from a few of the best sets.
3. For a map other than ``free``, find this parameter at each other gap by a scan. The other
   parameters are those of step 2, or further sets of step 1. Then fit all gaps together. For the
   map ``free``, repeat steps 1 and 2 at each gap, then fit all gaps with a smoothness penalty.

All random numbers come from the seed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from anhyst.identification.cell_kernel import WeightKernel
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.objective import Linearisation, Objective
from anhyst.identification.response import ParameterSet, ResponseForm
from anhyst.identification.screening import cost_at_gap, scan_gap, screen_starts
from anhyst.identification.space import CoordinateSpace
from anhyst.support.numeric import FloatArray

_MIN_STEPS_TO_EXTRAPOLATE = 5  # steps after which the progress of a descent predicts its result


def _damped_step(expansion: Linearisation, is_free: NDArray[np.bool_], damping: float) -> FloatArray:
    """Return the damped Gauss-Newton step of the free coordinates; zero for fixed ones."""
    normal = expansion.normal[np.ix_(is_free, is_free)]
    diagonal = np.diag(normal)
    normal[np.diag_indices_from(normal)] += damping * np.maximum(diagonal, 1e-9 * diagonal.max())
    step = np.zeros(expansion.gradient.size)
    step[is_free] = -np.linalg.solve(normal, expansion.gradient[is_free])
    return step


def _weight_step(
    expansion: Linearisation, theta: FloatArray, lower: FloatArray, damping: float
) -> FloatArray:
    """Return the best damped step with all weights above their lower bounds.

    Many weights end at their bound at the same time, so bounds cannot be handled one by one.
    """
    from scipy.optimize import nnls

    diagonal = np.diag(expansion.normal)
    normal = expansion.normal + np.diag(damping * np.maximum(diagonal, 1e-9 * diagonal.max()))
    cholesky = np.linalg.cholesky(normal).T
    distance, _ = nnls(cholesky, cholesky @ (theta - lower) - np.linalg.solve(cholesky.T, expansion.gradient))
    return np.asarray(distance + lower - theta)


def descend(
    objective: Objective, theta: FloatArray, tolerance: float, max_steps: int, goal_cost: float = np.inf
) -> tuple[FloatArray, float]:
    """Minimise the squared residuals within the bounds of the space; return coordinates and cost.

    A descent ends early if, at its present rate, the remaining steps cannot reach `goal_cost`.

    The method is Levenberg-Marquardt with Nielsen's damping. Coordinates at a bound with an outward
    gradient stay fixed. Cell weights use the best step within their bounds (SciPy's ``nnls``). A
    general solver would need singular value decompositions of a tall matrix (thousands of samples,
    ten coordinates), which cost several times as much as the law itself.
    """
    lower, upper = objective.space.bounds
    theta = np.clip(theta, lower, upper)
    expansion = objective.linearise(theta)
    damping, damping_growth = 1e-3, 2.0
    has_cell_weights = isinstance(objective.space.form.cells, WeightKernel)
    for steps_left in range(max_steps - 1, 0, -1):
        gradient = expansion.gradient
        is_free = ~(((theta <= lower) & (gradient > 0.0)) | ((theta >= upper) & (gradient < 0.0)))
        if not is_free.any() or not np.any(np.diag(expansion.normal)[is_free]):
            break
        if has_cell_weights:
            step = _weight_step(expansion, theta, lower, damping)
        else:
            step = _damped_step(expansion, is_free, damping)
        trial_theta = np.clip(theta + step, lower, upper)
        step = trial_theta - theta
        predicted_gain = -float(step @ (2.0 * expansion.gradient + expansion.normal @ step))
        new_expansion = objective.linearise_if_better(trial_theta, expansion.cost)
        if new_expansion is not None:
            gain = expansion.cost - new_expansion.cost
            gain_ratio = gain / max(predicted_gain, 1e-300)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * min(gain_ratio, 1.0) - 1.0) ** 3)
            damping_growth = 2.0
            is_hopeless = (
                steps_left < max_steps - _MIN_STEPS_TO_EXTRAPOLATE
                and new_expansion.cost - gain * steps_left > goal_cost
            )
            is_finished = is_hopeless or gain <= tolerance * expansion.cost
            theta, expansion = trial_theta, new_expansion
            if is_finished:
                break
        else:
            damping *= damping_growth
            damping_growth *= 2.0
            if abs(predicted_gain) <= tolerance * expansion.cost or damping > 1e12:
                break
    return theta, expansion.cost


SCREENED_SETS = 256
MAX_STARTS = 3
SMOOTHED_MAPS = frozenset({"circuit", "free"})
"""Gap maps with more parameters than the loops of a gap determine; they get a smoothness penalty.
"""

SMOOTHNESS_WEIGHT = 3e-3
"""Weight of the smoothness penalty, relative to the cost of the fit without it."""
COMPARISON_STOP = (1e-7, 200)  # tolerance and maximum number of steps of a fit for comparison
CONVERGED_STOP = (1e-8, 50)  # tolerance and maximum number of steps of the selected fit
_SHORT_DESCENT_STEPS = 6  # steps of a first descent, enough to identify the better starts


@dataclass(frozen=True, eq=False)
class FoundModel:
    """Result of a search under one gap map: coordinates, cost and number of evaluations."""

    space: CoordinateSpace
    theta: FloatArray
    cost: float
    evaluations: int

    @property
    def parameter_sets(self) -> list[ParameterSet]:
        """Gauge-free parameters at each gap."""
        return [parameter_set for parameter_set, _ in self.space.unpack(self.theta)]

    def with_records(self, records: FitRecords) -> FoundModel:
        """Return the same parameters with other records of the same gaps."""
        return replace(self, space=replace(self.space, records=records))

    @property
    def smoothness(self) -> float:
        """Weight of the smoothness penalty for a descent that continues from here."""
        return SMOOTHNESS_WEIGHT * self.cost if self.space.gap_map in SMOOTHED_MAPS else 0.0


def descend_from(
    space: CoordinateSpace,
    theta: FloatArray,
    tolerance: float = COMPARISON_STOP[0],
    max_steps: int = COMPARISON_STOP[1],
    smoothness: float = 0.0,
    goal_cost: float = np.inf,
) -> FoundModel:
    """Minimise the cost from a start point; stop early if the goal is out of reach."""
    objective = Objective(space, smoothness)
    theta_end, cost = descend(objective, theta, tolerance, max_steps, goal_cost)
    return FoundModel(space, theta_end, cost, objective.evaluations)


def search_one_gap(form: ResponseForm, records: FitRecords, seed: int, fixed: frozenset[str]) -> FoundModel:
    """Fit one gap without initial values."""
    space = CoordinateSpace("none", records, form, fixed)
    return _descend_from_best(
        space, [[parameter_set] for parameter_set in screen_starts(space, SCREENED_SETS, MAX_STARTS, seed)]
    )


def _descend_from_best(space: CoordinateSpace, starts: list[list[ParameterSet]]) -> FoundModel:
    """Descend for a few steps from each start point, and to convergence from the best result."""
    max_steps = _SHORT_DESCENT_STEPS + space.records.gap_count
    short_fits = [descend_from(space, space.pack(sets), 1e-4, max_steps) for sets in starts]
    final_fit = descend_from(space, min(short_fits, key=lambda fit: fit.cost).theta)
    return replace(final_fit, evaluations=final_fit.evaluations + sum(fit.evaluations for fit in short_fits))


def search_each_gap(form: ResponseForm, records: FitRecords, seed: int, fixed: frozenset[str]) -> FoundModel:
    """Fit every gap with its own parameters: the map ``free``.

    Each gap is fitted without initial values, and again from the result of its neighbour, so that
    all gaps can reach the same minimum. Then all gaps are fitted together with a weak smoothness
    penalty (:data:`SMOOTHNESS_WEIGHT`). Otherwise, parameters that a single gap does not determine
    would scatter and could not be interpolated.
    """
    space = CoordinateSpace("free", records, form, fixed)
    single_fits = [search_one_gap(form, records.at_gap(gap), seed, fixed) for gap in range(records.gap_count)]
    reference = records.reference_gap
    neighbour_fits = {reference: single_fits[reference]}
    for gap in [*range(reference + 1, records.gap_count), *range(reference - 1, -1, -1)]:
        neighbour = neighbour_fits[gap - 1 if gap > reference else gap + 1]
        neighbour_fits[gap] = descend_from(single_fits[gap].space, neighbour.theta, 1e-6, 30)
    smoothness = SMOOTHNESS_WEIGHT * sum(fit.cost for fit in single_fits)
    joint_fits = [
        descend_from(space, space.pack([fit.parameter_sets[0] for fit in gap_fits]), 1e-6, 60, smoothness)
        for gap_fits in (single_fits, [neighbour_fits[gap] for gap in range(records.gap_count)])
    ]
    best_fit = min(joint_fits, key=lambda fit: fit.cost)
    return replace(best_fit, evaluations=sum(fit.evaluations for fit in (*single_fits, *joint_fits)))


def join_gaps(
    form: ResponseForm, records: FitRecords, gap_map: str, starts: list[ParameterSet], fixed: frozenset[str]
) -> FoundModel:
    """Fit all gaps together under one map, starting from sets of the reference gap."""
    space = CoordinateSpace(gap_map, records, form, fixed)
    reference = records.reference_gap
    sets_with_costs = [
        (starts, cost_at_gap(space, gap, starts)) if gap == reference else scan_gap(space, gap, starts)
        for gap in range(records.gap_count)
    ]
    set_order = np.argsort(np.sum([cost for _, cost in sets_with_costs], axis=0))
    return _descend_from_best(
        space, [[gap_sets[index] for gap_sets, _ in sets_with_costs] for index in set_order[:MAX_STARTS]]
    )


def join_circuit(
    reluctance_fit: FoundModel, gap_map: str, common_parameters: frozenset[str] = frozenset()
) -> FoundModel:
    """Fit all gaps together under a map with leakage or with a free gain at each gap."""
    space_before = reluctance_fit.space
    space = CoordinateSpace(
        gap_map, space_before.records, space_before.form, space_before.fixed, common_parameters
    )
    fit = descend_from(
        space,
        space.pack(reluctance_fit.parameter_sets),
        smoothness=SMOOTHNESS_WEIGHT * reluctance_fit.cost if gap_map in SMOOTHED_MAPS else 0.0,
    )
    return replace(fit, evaluations=fit.evaluations + reluctance_fit.evaluations)
