"""Estimate the uncertainty of fitted parameters, and decide which sensor offsets the data require.

Every law has a model error, and a fitted offset can hide a part of it. The offset then represents a
force that does not exist. Therefore, an offset is fitted only if it reduces the cost by more than
chance and by more than a usual sensor offset would cost. Residuals that are correlated along a
record or equal in all loops count once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np

from anhyst.data import Loops
from anhyst.data.output_map import is_actuator
from anhyst.data.path import History
from anhyst.data.verdict import largest_output
from anhyst.identification.default_search import COMPARISON_STOP, FoundModel, descend_from
from anhyst.identification.objective import Linearisation, Objective
from anhyst.identification.space import SERIES_MAPS, CoordinateSpace
from anhyst.laws import get_law
from anhyst.laws.cells import CellWeights
from anhyst.laws.law import FitParameter
from anhyst.model.actuator import Model
from anhyst.model.schema import Uncertainty
from anhyst.support.errors import InputError, NegativeResult, NoResponseError
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.units import MU_0

# relative standard deviation above which a parameter is reported as uncertain
_MAX_RELATIVE_STD = 0.2

_MAX_NAMED_PARAMETERS = 6
"""Maximum number of named uncertain parameters. More are meaningful only as a set."""

_MAX_SEPARABLE_CORRELATION = 0.95
"""Correlation above which two parameters are not separable."""


def correlation_length(deviations: FloatArray) -> float:
    """Return the number of successive samples that count as one independent sample.

    The number is twice the integral of the autocorrelation up to its first zero. Model errors vary
    slowly along a record, so that counting each sample would make the uncertainty far too small.
    """
    centred = deviations - deviations.mean()
    sum_of_squares = float(centred @ centred)
    if sum_of_squares == 0.0:
        return 1.0
    spectrum = np.abs(np.fft.rfft(centred, 2 * centred.size)) ** 2
    correlation = np.fft.irfft(spectrum)[: centred.size] / sum_of_squares
    nonpositive_lags = np.flatnonzero(correlation <= 0.0)
    zero_lag = int(nonpositive_lags[0]) if nonpositive_lags.size else centred.size
    return max(1.0, 2.0 * float(correlation[:zero_lag].sum()) - 1.0)


def _split_by_record(space: CoordinateSpace, deviation: FloatArray) -> list[FloatArray]:
    """Split the residuals by record, without the regularisation residuals after them."""
    record_ends = np.cumsum([record.input.size for record in space.records.loops])
    return np.split(deviation, record_ends)[:-1]


def _covariance(fit: FoundModel) -> FloatArray:
    linearisation = Objective(fit.space).linearise(fit.theta)
    normal, residuals = linearisation.normal, _split_by_record(fit.space, linearisation.deviation)
    dof = max(1, linearisation.deviation.size - fit.theta.size)
    variance = (
        linearisation.cost / dof * float(np.mean([correlation_length(residual) for residual in residuals]))
    )
    # A coordinate without sensitivity gets a large, finite variance.
    diagonal_shift = 1e-14 * max(float(np.trace(normal)), 1e-300)
    return np.asarray(variance * np.linalg.inv(normal + diagonal_shift * np.eye(normal.shape[0])))


def assess_uncertainty(fit: FoundModel, loopset: Loops) -> Uncertainty:
    """Return standard deviations, correlations and statements in words for a finished fit."""
    space = fit.space
    covariance = _covariance(fit)
    all_stds = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(all_stds, all_stds)
    units = {"input": loopset.input.unit, "output": loopset.output.unit}
    readings = {"in_0": space.records.rest_readings.input, "out_0": space.records.rest_readings.output}
    names, values, stds = [], [], []
    values_by_gap = [space.form.named_values(parameter_set) for parameter_set in fit.parameter_sets]
    for (name, gap), coordinate_value, slope, std in zip(
        space.entries, *(column.tolist() for column in space.to_parameters(fit.theta)), all_stds, strict=True
    ):
        value = values_by_gap[gap or 0].get(name, coordinate_value)
        number = space.fit_parameters[name]
        label = _full_name(number, units)
        if gap is not None and loopset.schedule is not None:
            label += f" at {loopset.schedule.show(float(space.records.nodes[gap]))}"
        names.append(label)
        stds.append(float(std * (abs(value) if number.coordinate == "log" else slope)))
        values.append(value + (readings[name].offset if name in readings else 0.0))
    sentences = describe_uncertainty(names, values, stds, correlation) + _describe_gauge(fit)
    for name, reading in readings.items():
        if name in space.fixed and reading.std is not None and reading.offset != 0.0:
            names.append(_full_name(space.fit_parameters[name], units))
            values.append(reading.offset)
            stds.append(reading.half_width)
            sentences.append(f"{names[-1]}: sensor reading at rest, not fitted")
    full_correlation = np.eye(len(names))
    full_correlation[: space.size, : space.size] = correlation
    return Uncertainty(
        names=tuple(names),
        values=tuple(values),
        std=tuple(stds),
        correlation=tuple(tuple(row) for row in full_correlation.tolist()),
        statements=tuple(sentences),
    )


def _full_name(parameter: FitParameter, units: Mapping[str, str]) -> str:
    return (
        f"{parameter.meaning} ({units[parameter.unit_signal]})"
        if parameter.unit_signal
        else parameter.meaning
    )


def describe_uncertainty(
    names: Sequence[str], values: Sequence[float], stds: Sequence[float], correlation: FloatArray
) -> list[str]:
    """Describe which parameters are uncertain, and which are not separable."""
    uncertain_items = [
        (name, "more than its value" if std > abs(value) else f"{100 * std / abs(value):.0f} %")
        for name, value, std in zip(names, values, stds, strict=True)
        if "offset" not in name and std > _MAX_RELATIVE_STD * abs(value)
    ]
    sentences = [
        f"{name} is barely determined by these loops: uncertain by {share}" for name, share in uncertain_items
    ]
    if len(uncertain_items) > _MAX_NAMED_PARAMETERS:
        names_text = ", ".join(name for name, _ in uncertain_items[:_MAX_NAMED_PARAMETERS])
        sentences = [
            f"{len(uncertain_items)} of {len(names)} parameters are barely determined individually by these loops, "
            f"uncertain by more than {100 * _MAX_RELATIVE_STD:.0f} %: {names_text}, ..."
        ]
    sentences.extend(
        f"{', '.join(names[index] for index in group)}: not separable (correlations above "
        f"{_MAX_SEPARABLE_CORRELATION:g}); single values are not meaningful"
        for group in _group_correlated_parameters(correlation)
    )
    return sentences


def _describe_gauge(fit: FoundModel) -> list[str]:
    """Describe the values that were chosen because no output depends on them."""
    sentences, form, gap_map = [], fit.space.form, fit.space.file_gap_map
    if form.permeability == 0.0:
        sentences.append(
            "M_s was chosen freely (gauge), because no output depends on it; the slope of the air core is "
            f"barely determined by these loops: a/(M_s*(1-alpha)) is set to {form.h:g}, which matters "
            "only beyond the measured range"
        )
    if gap_map in SERIES_MAPS:
        sentences.append(
            f"alpha and an offset of rho are not separable in the {gap_map} map: alpha is chosen so that "
            "rho is not negative for any gap down to zero"
        )
    return sentences


def _group_correlated_parameters(correlation: FloatArray) -> list[list[int]]:
    """Group parameters that are connected by strong correlations."""
    groups: list[list[int]] = []
    for index in range(correlation.shape[0]):
        correlated_groups = [
            g for g in groups if any(abs(correlation[index, j]) > _MAX_SEPARABLE_CORRELATION for j in g)
        ]
        groups = [g for g in groups if g not in correlated_groups] + [
            [*(o for g in correlated_groups for o in g), index]
        ]
    return [sorted(group) for group in groups if len(group) > 1]


OFFSET_NAMES = frozenset({"in_0", "out_0"})

USUAL_OFFSET_STD = 0.01
"""Standard deviation of usual sensor offsets, as a fraction of the range."""

MIN_REST_READING_STD = 5e-4
"""Minimum standard error of a reading at rest, as a fraction of the range."""

_MAX_OFFSET_PENALTY = 25.0
"""Largest penalty of an unusual offset, and of a contradiction to a reading at rest, as twice the
logarithm of the odds. Clear evidence in the loops can still exceed the penalty."""

_CONTRADICTION_SIGMAS = 4.0
"""Number of standard errors above which a fitted offset contradicts the sensor reading."""

_MAX_REST_READING_COST_RATIO = 2.0
"""A reading at rest replaces a contradicting fitted offset unless it increases the mean square
residual by more than this factor. A model error that an offset can hide increased that residual by
a factor of 1.4 (three gaps, 2 mA of noise)."""

_NEGLIGIBLE_COST = 1e-20
"""Mean square residual, relative to the largest output squared, below which fits are equal."""


def remove_unneeded_offsets(
    fit: FoundModel, tolerance: float = COMPARISON_STOP[0], max_steps: int = COMPARISON_STOP[1]
) -> FoundModel:
    """Fix the offsets at the sensor readings at rest, except offsets that the data require.

    Offsets that differ between gaps are not sensor offsets, so they are not removed.
    """
    free_offsets = sorted(name for name, gap in fit.space.entries if name in OFFSET_NAMES and gap is None)
    if not free_offsets:
        return fit
    linearisation = Objective(fit.space, fit.smoothness).linearise(fit.theta)
    residuals = _split_by_record(fit.space, linearisation.deviation)
    loop_correlation = 1.0 + (len(residuals) - 1) * float(
        np.mean([_neighbour_correlation(residual) for residual in residuals])
    )
    samples_per_value = float(np.mean([correlation_length(residual) for residual in residuals]))
    independent_samples = max(
        2.0, float(sum(residual.size for residual in residuals)) / samples_per_value / loop_correlation
    )
    removable_sets = [
        frozenset(names) for n in range(1, len(free_offsets) + 1) for names in combinations(free_offsets, n)
    ]
    contradicted_names = _find_contradicted_offsets(fit)
    removable_sets = [names for names in removable_sets if contradicted_names <= names]

    def score(cost: float, space: CoordinateSpace, theta: FloatArray) -> float:
        return independent_samples * math.log(cost + _NEGLIGIBLE_COST) + _offset_penalty(
            space, theta, independent_samples
        )

    attempts = {}
    for names in removable_sets:
        space, coordinates = fit.space.with_fixed(names)
        cost, theta = _predict_without_offsets(fit, linearisation, names)
        attempts[names] = score(cost, space, theta[coordinates]), space, theta[coordinates]
    _, space, start = min(attempts.values(), key=lambda attempt: attempt[0])
    full_score = score(fit.cost, fit.space, fit.theta)
    # A reduced fit with a higher cost is rejected for any values of the remaining offsets.
    remaining_offsets = sum(name in OFFSET_NAMES for name, _ in space.entries)
    goal_cost = math.exp(
        full_score / independent_samples
        - remaining_offsets * math.log(independent_samples) / independent_samples
    )
    if contradicted_names:
        goal_cost = _MAX_REST_READING_COST_RATIO * fit.cost
    reduced_fit = descend_from(space, start, tolerance, max_steps, fit.smoothness, goal_cost)
    is_better = score(reduced_fit.cost, reduced_fit.space, reduced_fit.theta) <= full_score
    best_fit = reduced_fit if is_better or (contradicted_names and reduced_fit.cost <= goal_cost) else fit
    try:
        Objective(best_fit.space).outputs(best_fit.parameter_sets)
    except NoResponseError:  # the reduced fit may have no solution
        best_fit = fit
    return replace(best_fit, evaluations=fit.evaluations + reduced_fit.evaluations + 1)


def _find_contradicted_offsets(fit: FoundModel) -> frozenset[str]:
    """Return the free input offsets that contradict an offset read at rest."""
    reading, span = fit.space.records.rest_readings.input, fit.space.records.input_span
    if reading.std is None or reading.offset == 0.0:
        return frozenset()
    max_offset = _CONTRADICTION_SIGMAS * max(reading.std / span, MIN_REST_READING_STD)
    pairs = zip(fit.space.entries, fit.theta, strict=True)
    names = (name for (name, gap), value in pairs if gap is None and abs(float(value)) > max_offset)
    return frozenset(names) & {"in_0"}


def _neighbour_correlation(deviation: FloatArray) -> float:
    """Return the correlation of successive residuals, 0 if it is negative."""
    centred = deviation - deviation.mean()
    sum_of_squares = float(centred @ centred)
    return max(0.0, float(centred[1:] @ centred[:-1]) / sum_of_squares) if sum_of_squares > 0.0 else 0.0


def _predict_without_offsets(
    fit: FoundModel, expansion: Linearisation, names: frozenset[str]
) -> tuple[float, FloatArray]:
    """Predict, to second order, cost and coordinates of the best fit with some offsets zero."""
    is_removed = np.array([name in names for name, _ in fit.space.entries])
    theta = np.where(is_removed, 0.0, fit.theta)
    normal = expansion.normal + 1e-12 * np.trace(expansion.normal) * np.eye(is_removed.size)
    rhs = normal[np.ix_(~is_removed, is_removed)] @ fit.theta[is_removed]
    theta[~is_removed] += np.linalg.solve(normal[np.ix_(~is_removed, ~is_removed)], rhs)
    theta = np.clip(theta, *fit.space.bounds)
    step = theta - fit.theta
    return fit.cost + float(step @ expansion.normal @ step), theta


def _offset_penalty(space: CoordinateSpace, theta: FloatArray, independent_samples: float) -> float:
    """Return the penalty of the free offsets: twice the logarithm of the odds against them."""
    readings_at_rest = space.records.rest_readings
    readings = {
        "in_0": (readings_at_rest.input, space.records.input_span),
        "out_0": (readings_at_rest.output, space.records.output_span),
    }
    penalty = 0.0
    for (name, _), value in zip(space.entries, theta.tolist(), strict=True):
        if name not in OFFSET_NAMES:
            continue
        reading, span = readings[name]
        # A large offset is possible: a load cell without tare, or a displacement sensor with
        # another zero.
        improbability = min((value / USUAL_OFFSET_STD) ** 2, _MAX_OFFSET_PENALTY)
        if reading.std is not None:
            sigmas = value / max(reading.std / span, MIN_REST_READING_STD)
            improbability = min(sigmas**2, _MAX_OFFSET_PENALTY + improbability)
        penalty += math.log(independent_samples) + improbability
    return penalty


EQUAL_FIT_RATIO = 1.5
"""Ratio of rms residuals up to which two fits follow a loop equally well."""

_REVERSAL_POSITIONS = (0.0, 1.0, 0.3, 0.9, 0.1, 0.6, 0.4, 0.8, 0.2, 0.7, 0.0)
_SAMPLES_PER_BRANCH = 40


def ambiguity_within_loop(chosen_model: Model, other_models: Sequence[Model], loopset: Loops) -> float:
    """Return the largest rms difference of models inside a loop, relative to full scale."""
    loop = loopset.loops[0]
    low, high = float(loop.input.min()), float(loop.input.max())
    drive_values = low + (high - low) * np.array(_REVERSAL_POSITIONS)
    positions = np.linspace(0.0, drive_values.size - 1.0, _SAMPLES_PER_BRANCH * (drive_values.size - 1) + 1)
    drive = np.interp(positions, np.arange(drive_values.size), drive_values)
    history = History("conditioned", (low, high, low, high, low))
    outputs = []
    for model in (chosen_model, *other_models):
        schedule = loop.schedule_value if model.needs_schedule else None
        try:
            outputs.append(model.predict(drive, schedule, history=history).output)
        except (InputError, NegativeResult):
            continue
    differences = [rms(run - outputs[0]) for run in outputs[1:]]
    return max(differences, default=0.0) / largest_output(loopset)


_MAX_DEVIATION_RATIO = 2.0
"""Largest allowed deviation between two maps midway between gaps, relative to the sum of their
errors at withheld gaps."""
_MAX_SIMPLER_ERROR_RATIO = 3.0
"""Largest cross-validation error of a simpler map that is evidence against another map, relative to
the error of the other map."""


def deviation_between_gaps(model: Model, rival_model: Model, loopset: Loops) -> float:
    """Return the largest mean deviation midway between gaps, relative to full scale."""
    groups = loopset.by_schedule()
    deviations = []
    for low, high in pairwise(sorted(groups)):
        loop = max(groups[low], key=lambda loop: float(np.ptp(loop.output)))
        history = replace(loop.history, schedule=())
        gap = math.sqrt(low * high) if low > 0.0 else 0.5 * (low + high)
        try:
            output = model.predict(loop.input, gap, history=history).output
            rival_output = rival_model.predict(loop.input, gap, history=history).output
        except (InputError, NegativeResult):
            return float("inf")
        deviations.append(float(np.mean(np.abs(output - rival_output))))
    return max(deviations, default=0.0) / largest_output(loopset)


def is_overfitted_between_gaps(
    model: Model, error: float, simpler_models: Sequence[tuple[Model, float]], loops: Loops
) -> bool:
    """Whether a model deviates between gaps from all simpler maps by more than their errors.

    Models for fixed gaps have no behaviour between gaps and are never overfitted between gaps.
    """
    if model.needs_fixed_gap:
        return False
    comparable_models = [
        (simpler_model, simpler_error)
        for simpler_model, simpler_error in simpler_models
        if simpler_error <= _MAX_SIMPLER_ERROR_RATIO * error
    ]
    return bool(comparable_models) and all(
        deviation_between_gaps(model, other, loops) > _MAX_DEVIATION_RATIO * (error + other_error)
        for other, other_error in comparable_models
    )


MAX_INITIAL_CURVE_DISTANCE = 1.0
"""Largest distance of the initial magnetisation curve below the loop, in loop widths. Measured
irons of all families stay below 0.4."""

_INITIAL_CURVE_SAMPLES = 100


def has_no_initial_curve(loopset: Loops) -> bool:
    """Whether no loop starts demagnetised, so that no initial magnetisation curve is measured."""
    return all(loop.history.kind != "demagnetised" for loop in loopset.loops)


def initial_curve_distance(model: Model, loopset: Loops) -> float:
    """Return the largest distance of a model's initial curve below its loop, in loop widths."""
    if not is_actuator(loopset):
        return 0.0
    largest_input = max(float(loop.input.max()) for loop in loopset.loops)
    if largest_input <= 0.0:
        return 0.0
    ascending_input = np.linspace(0.0, largest_input, _INITIAL_CURVE_SAMPLES)
    largest_distance = 0.0
    for value in loopset.schedule_values if model.needs_schedule else (None,):
        try:
            initial_curve = model.predict(ascending_input, value, history="demagnetised").output
            settled_output = model.predict(
                np.concatenate([ascending_input[::-1], ascending_input]), value, history="settled"
            ).output
        except (InputError, NegativeResult):
            return float("inf")
        descending, ascending = (
            settled_output[_INITIAL_CURVE_SAMPLES - 1 :: -1],
            settled_output[_INITIAL_CURVE_SAMPLES:],
        )
        width = float(np.max(np.abs(descending - ascending)))
        distance = float(np.max(np.abs(ascending) - np.abs(initial_curve)))
        largest_distance = max(largest_distance, distance / width if width > 0.0 else 0.0)
    return largest_distance


def has_plausible_initial_curve(model: Model, loopset: Loops) -> bool:
    """Whether the initial magnetisation curve of a model is measured, or close to its loops."""
    return (
        not has_no_initial_curve(loopset)
        or initial_curve_distance(model, loopset) <= MAX_INITIAL_CURVE_DISTANCE
    )


_UNRESOLVED_COST_RATIO = 1.05
"""Ratio of mean square residuals up to which loops cannot distinguish a pinned cell from a free
one."""


def field_step_after_reversal(model: Model, loops: Loops) -> float:
    """Return the median change of the effective field to the first sample after a reversal, A/m.

    The result is 0 if there are no reversals. The iron barely responds directly after a reversal,
    so the field changes more per step of the drive than elsewhere.
    """
    steps = []
    for loop in loops.loops:
        schedule = loop.schedule if model.needs_schedule else None
        prediction = model.predict(loop.input, schedule, loop.time, loop.history)
        alpha = model.parameters_at(loop.schedule_value if model.needs_schedule else None)["alpha"]
        magnetisation = prediction.flux_density / MU_0 - prediction.field
        field_steps = np.diff(prediction.field + alpha * magnetisation)
        steps.append(np.abs(field_steps[1:][field_steps[1:] * field_steps[:-1] < 0.0]))
    reversal_steps = np.concatenate(steps)
    return float(np.median(reversal_steps)) if reversal_steps.size else 0.0


def free_unresolved_cells(model: Model, loops: Loops) -> Model:
    """Treat pinned cells as free if no sample resolves them, smallest threshold first."""
    law = model.operator_law
    if law.cells is None:
        return model
    cells = law.cells(model.parameters_at(model.first_node))
    is_unresolved = (cells.thresholds > 0.0) & (
        2.0 * cells.thresholds < field_step_after_reversal(model, loops)
    )
    unresolved_count = int(np.count_nonzero(is_unresolved))
    if not cells.weights[is_unresolved].any() or not cells.weights[1 + unresolved_count :].any():
        return model
    max_cost = _UNRESOLVED_COST_RATIO * _mean_square_error(model, loops)
    best_model, accepted_count, rejected_count = model, 0, unresolved_count + 1
    while rejected_count - accepted_count > 1:
        middle = (
            unresolved_count
            if best_model is model and rejected_count > unresolved_count
            else (accepted_count + rejected_count) // 2
        )
        freed_model = _free_first_cells(model, cells, middle)
        if _mean_square_error(freed_model, loops) <= max_cost:
            best_model, accepted_count = freed_model, middle
        else:
            rejected_count = middle
    return best_model


def _free_first_cells(model: Model, cells: CellWeights, count: int) -> Model:
    """Move the weights of the first pinned cells to the free cell."""
    weights = np.delete(cells.weights, np.s_[1 : 1 + count], axis=0)
    weights[0] += cells.weights[1 : 1 + count].sum(axis=0)
    remaining_cells = replace(
        cells, thresholds=np.delete(cells.thresholds, np.s_[1 : 1 + count]), weights=weights
    )
    removed_names = {spec.name for spec in model.operator_law.parameters}
    removed_names -= {spec.name for spec in get_law(model.law, remaining_cells).parameters}
    remaining_parameters = {
        name: value for name, value in model.parameters.items() if name not in removed_names
    }
    return replace(model, cells=remaining_cells, parameters=remaining_parameters)


def _mean_square_error(model: Model, loops: Loops) -> float:
    """Return the mean square residual over all samples; infinite if the model has no solution."""
    try:
        residual = np.concatenate([model.predict_loop(loop) - loop.output for loop in loops.loops])
    except (InputError, NegativeResult):
        return float("inf")
    return float(residual @ residual) / residual.size
