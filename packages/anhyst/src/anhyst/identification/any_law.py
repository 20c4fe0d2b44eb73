"""Fit any hysteresis law through its iron model, for laws without a fast kernel in the core.

Each parameter of the model file is varied within its search range, which is mapped to 0..1. Many
sets are simulated, and least squares with numerical derivatives starts from the best. Redundancies
of parameters (docs/theory.md) are removed: ``c_H`` is 1 at the first gap unless the data give it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from anhyst.data import Loops
from anhyst.data.output_map import output_map
from anhyst.identification.default_search import MAX_STARTS, SCREENED_SETS
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.model_building import is_scheduled_over_gap
from anhyst.identification.objective import UNSOLVED_DEVIATION
from anhyst.identification.run import Outcome
from anhyst.identification.screening import sample_unit_cube
from anhyst.identification.uncertainty import correlation_length, describe_uncertainty
from anhyst.laws import LAWS
from anhyst.laws.law import Law
from anhyst.model.actuator import Model
from anhyst.model.parameters import VARYING_BY_GAP_MAP, GapMap, Parameter
from anhyst.model.schema import Uncertainty
from anhyst.support.errors import InputError, NegativeResult, NoUsableStartError
from anhyst.support.numeric import FloatArray

_MAX_OFFSET_SHARE = 0.1  # largest input offset, relative to the largest input
_MAX_GAIN_RATIO = 1e3  # largest ratio of the fitted gain to the gain of the linear regression


@dataclass(frozen=True, slots=True)
class _Coordinate:
    """A varied parameter: its name, its node (None: common to all nodes), and its range."""

    name: str
    node: int | None
    low: float
    high: float

    def value(self, position: float) -> float:
        """Return the parameter value at a position 0..1, on a log scale in a positive range."""
        if self.low > 0.0:
            return float(self.low * (self.high / self.low) ** position)
        return self.low + (self.high - self.low) * position

    def derivative(self, position: float) -> float:
        """Return the derivative of the parameter value with respect to the position."""
        if self.low > 0.0:
            return float(self.value(position) * np.log(self.high / self.low))
        return self.high - self.low


@dataclass(eq=False)
class _AnyLawProblem:
    """Fit of one law under one gap map to the loops."""

    law: Law
    gap_map: GapMap
    loopset: Loops
    records: FitRecords
    fits_offsets: bool
    evaluations: int = 0

    @cached_property
    def entries(self) -> tuple[_Coordinate, ...]:
        """Coordinates of the screening; the final fit also varies gain and offsets."""
        input_span = self.records.input_span
        ranges = {
            spec.name: tuple(input_span * end if spec.unit == "A/m" else end for end in spec.search)
            for spec in self.law.parameters
            if spec.search is not None
        }
        if self.gap_map in {"reluctance", "circuit"}:
            ranges["rho"] = (1e-3, 1e3)
        if output_map(self.loopset.output).is_flux_density and self.loopset.input.name != "field":
            ranges["c_H"] = (10.0 / input_span, 1e5 / input_span)
        elif self.gap_map == "scaling":
            ranges["c_H"] = (0.1, 10.0)
        varying_names: Collection[str] = VARYING_BY_GAP_MAP[self.gap_map] & {"rho", "c_H"}
        if self.gap_map == "free":
            varying_names = ranges
        coordinates = []
        for name, (low, high) in ranges.items():
            is_varying = self.records.gap_count > 1 and name in varying_names
            nodes = range(self.records.gap_count) if is_varying else (None,)
            coordinates += [_Coordinate(name, node, low, high) for node in nodes]
        fixed_by_gauge = _Coordinate("c_H", 0, 0.1, 10.0)
        return tuple(entry for entry in coordinates if entry != fixed_by_gauge)

    def model(self, entries: tuple[_Coordinate, ...], theta: FloatArray) -> Model:
        """Return the model for a point in the unit cube of the given coordinates."""
        nodes = self.loopset.schedule_values
        values: dict[str, Parameter] = {"c_H": 1.0, "c_out": 1.0}
        rows = {entry.name: [1.0] * len(nodes) for entry in entries if entry.node is not None}
        for entry, position in zip(entries, theta.tolist(), strict=True):
            if entry.node is None:
                values[entry.name] = entry.value(position)
            else:
                rows[entry.name][entry.node] = entry.value(position)
        values |= {name: tuple(row) for name, row in rows.items()}
        return Model(
            name="model",
            input=self.loopset.input,
            output=self.loopset.output,
            parameters=values,
            law=self.law.name,
            gap_map=self.gap_map,
            schedule=self.loopset.schedule,
            nodes=nodes,
        )

    def outputs(self, model: Model) -> FloatArray | None:
        """Return the modelled outputs of all loops; None if the law has no solution."""
        self.evaluations += 1
        groups = self.loopset.by_schedule()
        loops = [(node, loop) for node, group in groups.items() for loop in group]
        try:
            outputs_by_loop = [
                model.predict(record.input, node, history=loop.history).output
                for (node, loop), record in zip(loops, self.records.loops, strict=True)
            ]
        except (InputError, NegativeResult):
            return None
        return np.concatenate(outputs_by_loop)

    def __post_init__(self) -> None:
        loops = self.records.loops
        self.measured = np.concatenate([loop.output for loop in loops])
        self.weights = np.concatenate([np.full(loop.output.size, loop.weight) for loop in loops])

    def residuals(self, entries: tuple[_Coordinate, ...], theta: FloatArray) -> FloatArray:
        """Return the weighted residuals."""
        outputs = self.outputs(self.model(entries, theta))
        if outputs is None:
            return UNSOLVED_DEVIATION * self.records.output_span * self.weights
        return np.asarray((outputs - self.measured) * self.weights)

    def fit_gain(self, modelled_output: FloatArray) -> tuple[float, float, float]:
        """Return gain, offset and cost of the linear regression on a modelled output."""
        columns = np.stack([modelled_output, np.ones(modelled_output.size) * self.fits_offsets], axis=1)
        weighted_columns = columns * self.weights[:, None]
        weighted_output = self.measured * self.weights
        (gain, offset), *_ = np.linalg.lstsq(weighted_columns, weighted_output, rcond=None)
        residual = weighted_columns @ np.array([gain, offset]) - weighted_output
        return float(gain), float(offset), float(residual @ residual) if gain > 0.0 else np.inf

    def find_starts(self, seed: int) -> list[tuple[float, tuple[_Coordinate, ...], FloatArray]]:
        """Return the best parameter sets of a screening: cost, coordinates and start point."""
        names = [entry.name for entry in self.entries if not entry.node]  # all nodes start with equal values
        starts = []
        for point in sample_unit_cube(len(names), SCREENED_SETS, seed).T:
            values = dict(zip(names, point, strict=True))
            theta = np.array([values.get(entry.name, 0.5) for entry in self.entries])
            modelled_output = self.outputs(self.model(self.entries, theta))
            if modelled_output is None or not np.ptp(modelled_output):
                continue
            gain, offset, cost = self.fit_gain(modelled_output)
            if np.isfinite(cost):
                starts.append((cost, *self._add_gain_and_offsets(theta, gain, offset)))
        return sorted(starts, key=lambda start: start[0])[:MAX_STARTS]

    def _add_gain_and_offsets(
        self, theta: FloatArray, gain: float, offset: float
    ) -> tuple[tuple[_Coordinate, ...], FloatArray]:
        """Add gain and offsets to the coordinates, starting from the linear regression."""
        entries, positions = list(self.entries), theta.tolist()
        if not output_map(self.loopset.output).is_flux_density:
            entries.append(_Coordinate("c_out", None, gain / _MAX_GAIN_RATIO, gain * _MAX_GAIN_RATIO))
            positions.append(0.5)
        if self.fits_offsets:
            for name, span in (
                ("in_0", _MAX_OFFSET_SHARE * self.records.input_span),
                ("out_0", max(self.records.output_span, 2.0 * abs(offset))),
            ):
                entries.append(_Coordinate(name, None, -span, span))
                positions.append(0.5 if name == "in_0" else 0.5 + 0.5 * offset / span)
        return tuple(entries), np.array(positions)


def fit_any_law(
    loopset: Loops, records: FitRecords, law: str, gap_map: str, seed: int, offsets: bool
) -> Outcome:
    """Fit a law by simulating its iron model under each possible gap map; return the best fit."""
    gap_maps: tuple[GapMap, ...] = ("scaling",)
    if records.gap_count < 2:
        gap_maps = ("none",)
    elif gap_map != "auto":
        gap_maps = (gap_map,)  # type: ignore[assignment]  # the caller has checked it
    elif is_scheduled_over_gap(loopset):
        gap_maps = ("scaling", "reluctance")
    fits = [_descend(_AnyLawProblem(LAWS[law], name, loopset, records, offsets), seed) for name in gap_maps]
    _, best_fit = min(fits, key=lambda fit: fit[0])
    return replace(best_fit, evaluations=sum(outcome.evaluations for _, outcome in fits))


def _descend(problem: _AnyLawProblem, seed: int) -> tuple[float, Outcome]:
    """Return the cost and the result of a least-squares fit under one gap map."""
    from scipy.optimize import OptimizeResult, least_squares

    starts = problem.find_starts(seed)
    if not starts:
        raise NoUsableStartError

    def descend(
        entries: tuple[_Coordinate, ...], theta: FloatArray, tolerance: float, max_evaluations: int
    ) -> OptimizeResult:
        return least_squares(
            lambda point: problem.residuals(entries, point),
            np.clip(theta, 1e-6, 1.0 - 1e-6),
            bounds=(0.0, 1.0),
            ftol=tolerance,
            xtol=tolerance,
            diff_step=1e-6,
            max_nfev=max_evaluations,
        )

    short_fits = [(descend(entries, theta, 1e-3, 6), entries) for _, entries, theta in starts]
    best_trial, entries = min(short_fits, key=lambda attempt: float(attempt[0].cost))
    best = descend(entries, best_trial.x, 1e-8, 60)
    reason = f"of all tried gap maps, '{problem.gap_map}' fits the loops best"
    model = problem.model(entries, best.x)
    uncertainty = _assess_uncertainty(problem, entries, best.x, best.fun, best.jac)
    outcome = Outcome(model, uncertainty, len(entries), problem.evaluations, reason)
    return 2.0 * float(best.cost), outcome


def _assess_uncertainty(
    problem: _AnyLawProblem,
    entries: tuple[_Coordinate, ...],
    theta: FloatArray,
    deviation: FloatArray,
    jacobian: FloatArray,
) -> Uncertainty:
    """Estimate the uncertainty in the same way as :func:`.uncertainty.assess_uncertainty`."""
    normal = jacobian.T @ jacobian
    variance = float(deviation @ deviation) / max(1, deviation.size - theta.size)
    ridge = 1e-14 * max(float(np.trace(normal)), 1e-300)
    covariance = variance * correlation_length(deviation) * np.linalg.inv(normal + ridge * np.eye(theta.size))
    unit_stds = np.sqrt(np.diag(covariance))
    keys = problem.model(entries, theta).file_keys
    names = [keys[e.name][1] + ("" if e.node is None else f"[{e.node}]") for e in entries]
    values = [entry.value(position) for entry, position in zip(entries, theta.tolist(), strict=True)]
    stds = [
        float(std * entry.derivative(position))
        for entry, position, std in zip(entries, theta.tolist(), unit_stds.tolist(), strict=True)
    ]
    correlation = covariance / np.outer(unit_stds, unit_stds)
    return Uncertainty(
        names=tuple(names),
        values=tuple(values),
        std=tuple(stds),
        correlation=tuple(tuple(row) for row in correlation.tolist()),
        statements=tuple(describe_uncertainty(names, values, stds, correlation)),
    )
