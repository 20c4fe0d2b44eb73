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
from numpy.typing import NDArray

from anhyst.identification.cell_kernel import WeightKernel
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.objective import Linearisation, Objective
from anhyst.identification.response import ParameterSet, ResponseForm
from anhyst.identification.screening import cost_at_gap, scan_gap, screen_starts
from anhyst.identification.space import CoordinateSpace
from anhyst.support.numeric import FloatArray

_MIN_STEPS_TO_EXTRAPOLATE = 5  # steps after which the pace of a descent says how far it comes


def _damped_step(linear: Linearisation, free: NDArray[np.bool_], damping: float) -> FloatArray:
    """Damped Gauss-Newton step in the free coordinates, zero in the others."""
    normal = linear.normal[np.ix_(free, free)]
    diagonal = np.diag(normal)
    normal[np.diag_indices_from(normal)] += damping * np.maximum(diagonal, 1e-9 * diagonal.max())
    step = np.zeros(linear.gradient.size)
    step[free] = -np.linalg.solve(normal, linear.gradient[free])
    return step


def _weight_step(
    linear: Linearisation, theta: FloatArray, low: FloatArray, damping: float
) -> FloatArray:
    """Best damped step above the lower bounds: of many weights most end there, together."""
    from scipy.optimize import nnls

    diagonal = np.diag(linear.normal)
    normal = linear.normal + np.diag(damping * np.maximum(diagonal, 1e-9 * diagonal.max()))
    root = np.linalg.cholesky(normal).T
    distance, _ = nnls(root, root @ (theta - low) - np.linalg.solve(root.T, linear.gradient))
    return np.asarray(distance + low - theta)


def descend(
    objective: Objective, theta: FloatArray, tolerance: float, max_steps: int, goal: float = np.inf
) -> tuple[FloatArray, float]:
    """Least squares from a start, within the bounds of the space: coordinates and cost at the end.

    A descent that at its pace would not come below its goal in the steps left, ends.

    Levenberg-Marquardt with Nielsen's damping; coordinates at a bound that the gradient presses
    outward rest; the weights of cells take the best step within them (SciPy's ``nnls``). The problem
    is tall and narrow (thousands of samples, ten coordinates), where the singular value
    decompositions of a general solver cost several times the law itself.
    """
    low, high = objective.space.bounds
    theta = np.clip(theta, low, high)
    current = objective.linearise(theta)
    damping, growth = 1e-3, 2.0
    by_weights = isinstance(objective.space.form.cells, WeightKernel)
    for steps_left in range(max_steps - 1, 0, -1):
        gradient = current.gradient
        free = ~(((theta <= low) & (gradient > 0.0)) | ((theta >= high) & (gradient < 0.0)))
        if not free.any() or not np.any(np.diag(current.normal)[free]):
            break
        if by_weights:
            step = _weight_step(current, theta, low, damping)
        else:
            step = _damped_step(current, free, damping)
        trial = np.clip(theta + step, low, high)
        step = trial - theta
        predicted_gain = -float(step @ (2.0 * current.gradient + current.normal @ step))
        accepted = objective.linearise_if_better(trial, current.cost)
        if accepted is not None:
            gain = current.cost - accepted.cost
            ratio = gain / max(predicted_gain, 1e-300)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * min(ratio, 1.0) - 1.0) ** 3)
            growth = 2.0
            is_hopeless = (
                steps_left < max_steps - _MIN_STEPS_TO_EXTRAPOLATE
                and accepted.cost - gain * steps_left > goal
            )
            is_finished = is_hopeless or gain <= tolerance * current.cost
            theta, current = trial, accepted
            if is_finished:
                break
        else:
            damping *= growth
            growth *= 2.0
            if abs(predicted_gain) <= tolerance * current.cost or damping > 1e12:
                break
    return theta, current.cost


SCREENED_SETS = 256
MAX_STARTS = 3
SMOOTHED_MAPS = frozenset({"circuit", "free"})
"""Maps with more to each gap than its loops determine, so that neighbouring gaps are tied."""

SMOOTHNESS_WEIGHT = (
    3e-3  # weight of the ties of such a map, relative to the cost of the fit without them
)
COMPARISON_STOP = (
    1e-7,
    200,
)  # tolerance and evaluations, at most, of a fit that is compared with others
CONVERGED_STOP = (1e-8, 50)  # the same of the one that is chosen
_SHORT_DESCENT_STEPS = (
    6  # evaluations of a first descent: enough to distinguish a good valley from a bad one
)


@dataclass(frozen=True, eq=False)
class FoundModel:
    """Outcome of a search under one gap map: coordinates, weighted sum of squares, evaluations."""

    space: CoordinateSpace
    theta: FloatArray
    cost: float
    evaluations: int

    @property
    def parameter_sets(self) -> list[ParameterSet]:
        """Gauge-free parameters at each gap."""
        return [local for local, _ in self.space.unpack(self.theta)]

    def with_records(self, records: FitRecords) -> FoundModel:
        """Take the same parameters to other records of the same gaps."""
        return replace(self, space=replace(self.space, records=records))

    @property
    def smoothness(self) -> float:
        """Weight of the ties of its map, for a descent that goes on from here."""
        return SMOOTHNESS_WEIGHT * self.cost if self.space.gap_map in SMOOTHED_MAPS else 0.0


def descend_from(
    space: CoordinateSpace,
    theta: FloatArray,
    tolerance: float = COMPARISON_STOP[0],
    max_steps: int = COMPARISON_STOP[1],
    smoothness: float = 0.0,
    goal: float = np.inf,
) -> FoundModel:
    """Descend from a start and count; without a goal in reach (:func:`.descend`) it ends."""
    objective = Objective(space, smoothness)
    theta_end, cost = descend(objective, theta, tolerance, max_steps, goal)
    return FoundModel(space, theta_end, cost, objective.evaluations)


def search_one_gap(
    form: ResponseForm, records: FitRecords, seed: int, fixed: frozenset[str]
) -> FoundModel:
    """Fit one gap from scratch."""
    space = CoordinateSpace("none", records, form, fixed)
    return _descend_from_best(
        space, [[local] for local in screen_starts(space, SCREENED_SETS, MAX_STARTS, seed)]
    )


def _descend_from_best(space: CoordinateSpace, starts: list[list[ParameterSet]]) -> FoundModel:
    """Descend a little from each begin, and to the end from the best of them."""
    max_steps = _SHORT_DESCENT_STEPS + space.records.gap_count
    short_fits = [descend_from(space, space.pack(sets), 1e-4, max_steps) for sets in starts]
    final = descend_from(space, min(short_fits, key=lambda fit: fit.cost).theta)
    return replace(
        final, evaluations=final.evaluations + sum(fit.evaluations for fit in short_fits)
    )


def search_each_gap(
    form: ResponseForm, records: FitRecords, seed: int, fixed: frozenset[str]
) -> FoundModel:
    """Fit every gap with parameters of its own: the map ``free``.

    Each gap is fitted from scratch, and once more from its neighbour's end, so that all gaps can
    lie in one valley. Then all are tied together so weakly that the fit hardly notices
    (:data:`TIE`): directions that the loops of one gap do not determine would otherwise scatter, and
    nothing could be interpolated.
    """
    space = CoordinateSpace("free", records, form, fixed)
    single_fits = [
        search_one_gap(form, records.at_gap(gap), seed, fixed) for gap in range(records.gap_count)
    ]
    reference = records.reference_gap
    neighbour_fits = {reference: single_fits[reference]}
    for gap in [*range(reference + 1, records.gap_count), *range(reference - 1, -1, -1)]:
        neighbour = neighbour_fits[gap - 1 if gap > reference else gap + 1]
        neighbour_fits[gap] = descend_from(single_fits[gap].space, neighbour.theta, 1e-6, 30)
    smoothness = SMOOTHNESS_WEIGHT * sum(fit.cost for fit in single_fits)
    joint_fits = [
        descend_from(
            space, space.pack([fit.parameter_sets[0] for fit in gap_fits]), 1e-6, 60, smoothness
        )
        for gap_fits in (single_fits, [neighbour_fits[gap] for gap in range(records.gap_count)])
    ]
    best = min(joint_fits, key=lambda fit: fit.cost)
    return replace(best, evaluations=sum(fit.evaluations for fit in (*single_fits, *joint_fits)))


def join_gaps(
    form: ResponseForm,
    records: FitRecords,
    gap_map: str,
    starts: list[ParameterSet],
    fixed: frozenset[str],
) -> FoundModel:
    """Fit all gaps together under one map, from what is known at the reference gap."""
    space = CoordinateSpace(gap_map, records, form, fixed)
    reference = records.reference_gap
    at_gaps = [
        (starts, cost_at_gap(space, gap, starts))
        if gap == reference
        else scan_gap(space, gap, starts)
        for gap in range(records.gap_count)
    ]
    order = np.argsort(np.sum([cost for _, cost in at_gaps], axis=0))
    return _descend_from_best(
        space, [[gap_sets[index] for gap_sets, _ in at_gaps] for index in order[:MAX_STARTS]]
    )


def join_circuit(
    reluctance_fit: FoundModel, gap_map: str, common: frozenset[str] = frozenset()
) -> FoundModel:
    """Fit all gaps together with one iron, and a circuit around it that takes more than a gap."""
    space_before = reluctance_fit.space
    space = CoordinateSpace(
        gap_map, space_before.records, space_before.form, space_before.fixed, common
    )
    fit = descend_from(
        space,
        space.pack(reluctance_fit.parameter_sets),
        smoothness=SMOOTHNESS_WEIGHT * reluctance_fit.cost if gap_map in SMOOTHED_MAPS else 0.0,
    )
    return replace(fit, evaluations=fit.evaluations + reluctance_fit.evaluations)
