"""Add the hysteresis of measured loops to the model of a simulated table.

The table determines the anhysteretic curve and everything that depends on the gap. In a law of play
cells, the magnetisation can be moved to cells with other thresholds without a change of the
anhysteretic curve. Therefore, the loops determine only this spread, an error of the
gap's zero and a factor of the output.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from anhyst.data import Loops
from anhyst.data.output_map import full_scale
from anhyst.identification.run import Outcome
from anhyst.laws.cells import CellWeights
from anhyst.model.actuator import Model
from anhyst.model.schema import Uncertainty, ValidRange
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

_THRESHOLD_COUNT = 12
_THRESHOLD_RANGE = 100.0
"""Ratio of the largest to the smallest threshold."""
_MAX_THRESHOLD_SHARE = 0.3
"""Largest threshold, relative to the largest field in the iron on the loops."""
_MAX_THRESHOLD_WIDTHS = 250.0
"""Largest threshold, relative to the narrowest curve; the core allows 300."""
_SPREAD_STEP = 0.3
_SPREAD_SIGMA = 1.0
"""Prior mean and standard deviation of the logarithm of the ratio of neighbouring cells."""
_FACTOR_SIGMA = 0.05
"""Prior standard deviation of the factor of a simulated output."""
_GAP_SIGMA = 0.02
"""Prior standard deviation of the gap's zero, relative to the smallest measured gap."""
_MODEL_SIGMA = 2e-3
"""Assumed deviation of loops from the model, relative to the full scale."""
_INDEPENDENT_SAMPLES = 20.0
"""Assumed number of independent deviations along a loop."""


def add_measured_width(
    outcome: Outcome, measured: Loops, valid: ValidRange
) -> tuple[Outcome, ValidRange, str]:
    """Return the model of a table with the hysteresis of loops, its valid range, and a sentence."""
    low, high = valid.schedule or (0.0, 0.0)
    outside = [gap for gap in measured.schedule_values if not 0.9 * low <= gap <= 1.1 * high]
    if outcome.model.operator_law.cells is None or not measured.schedule_values or outside:
        fault = "play cells (--law play-cells), and loops at constant gaps"
        fault = f"loops within its gaps, not at {1e3 * outside[0]:.4g} mm" if outside else fault
        raise InputError(f"a table and loops together need {fault}", code="table-and-loops", key="loops")
    fit = _WidthFit(outcome.model, measured)
    start = np.concatenate([[2.0], np.zeros(_THRESHOLD_COUNT + 2)])
    result = least_squares(fit.residuals, start, x_scale=fit.scales)
    theta: FloatArray = result.x
    shift, factor = float(theta[-2]) * fit.gap_sigma, float(np.exp(theta[-1]))
    variances = np.diag(np.linalg.pinv(result.jac.T @ result.jac))[-2:]
    std = tuple((np.sqrt(variances) * (fit.gap_sigma, factor)).tolist())
    output_text = measured.output.words
    text = (
        f"from measured loops; the rest from the table, with its gaps moved by {1e6 * shift:.3g} um and its "
        f"{output_text} multiplied by {factor:.4g}"
    )
    outcome = replace(
        outcome,
        model=fit.make_model(theta),
        uncertainty=Uncertainty(("zero of the gap, m", "factor of the table"), (shift, factor), std),
        fit=None,
    )
    return outcome, replace(valid, schedule=(low + shift, high + shift)), text


@dataclass(frozen=True)
class _WidthFit:
    """Least-squares problem for the spread over the cells, the zero of the gap and the factor."""

    model: Model
    loops: Loops
    scales = np.array([1.0] * (_THRESHOLD_COUNT + 2) + [0.1])

    @cached_property
    def largest_field(self) -> float:
        """Largest field in the iron, A/m."""
        predictions = (self.model.predict(loop.input, loop.schedule) for loop in self.loops.loops)
        return max(float(np.abs(prediction.field).max()) for prediction in predictions)

    @property
    def gap_sigma(self) -> float:
        """Prior standard deviation of the gap's zero, m."""
        return _GAP_SIGMA * min(self.loops.schedule_values)

    def make_model(self, theta: FloatArray) -> Model:
        """Return the model for the logarithms of the spread, the shift and the logarithm of the factor."""
        parameters = dict(self.model.parameters)
        iron = self.model.parameters_at(self.model.first_node)
        assert self.model.operator_law.cells is not None
        cells = self.model.operator_law.cells(iron)
        widest = _MAX_THRESHOLD_WIDTHS * float(cells.widths.min())
        largest = min(_MAX_THRESHOLD_SHARE * self.largest_field, widest)
        shares = np.exp(theta[:-2] - theta[:-2].max())
        weights = CellWeights(
            np.concatenate([[0.0], np.geomspace(largest / _THRESHOLD_RANGE, largest, _THRESHOLD_COUNT)]),
            cells.widths,
            shares[:, None] / shares.sum() * cells.weights.sum(axis=0),
            cells.shape,
            cells.centres,
        )
        names = ("alpha", "rho", "c_H", "gamma", "in_0", "out_0")
        c_out = (np.asarray(parameters["c_out"]) * np.exp(theta[-1])).tolist()
        nodes = tuple(np.asarray(self.model.nodes) + theta[-2] * self.gap_sigma)
        circuit = {name: parameters[name] for name in names} | {"c_out": c_out}
        return replace(self.model, cells=weights, parameters=circuit, nodes=nodes)

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Return the weighted deviations from the loops and from the prior."""
        model, loops = self.make_model(theta), self.loops.loops
        size = _MODEL_SIGMA * full_scale(self.loops.output, [loop.output for loop in loops])
        deviations = [
            (model.predict_loop(loop) - loop.output) * (_INDEPENDENT_SAMPLES / loop.n) ** 0.5 / size
            for loop in loops
        ]
        prior = [
            (np.diff(theta[1:-2]) + _SPREAD_STEP) / _SPREAD_SIGMA,
            [theta[0] - 2.0, theta[-2], theta[-1] / _FACTOR_SIGMA],
        ]
        return np.concatenate([*deviations, *prior])
