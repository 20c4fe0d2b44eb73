"""Add the hysteresis of measured loops to the model of a simulated table.

The table determines the anhysteretic curve and everything that depends on the gap. In a law of play
cells, the magnetisation of the same curves can be spread over cells of any thresholds without a
change of the anhysteretic curve. Therefore, the loops determine only this spread, an error of the
gap's zero and a factor of the output.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from anhyst.data import Loops
from anhyst.data.output_map import full_scale
from anhyst.data.path import thin_rows
from anhyst.identification.run import Outcome
from anhyst.laws.cells import CellWeights
from anhyst.model.actuator import Model
from anhyst.model.schema import Uncertainty, ValidRange
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

_THRESHOLDS = 12
_THRESHOLD_RANGE = (2e-3, 0.7)
"""Thresholds of the cells, relative to the drive of the largest measured current."""
_START_SCALES = (0.01, 0.03, 0.1)
_SCALE_SIGMA = 0.05
"""Prior standard deviation of the factor of a simulated output."""
_GAP_SIGMA = 0.02
"""Prior standard deviation of the gap's zero, relative to the smallest measured gap."""
_MODEL_SIGMA = 2e-3
"""Assumed deviation of loops from the model, relative to the full scale."""
_INDEPENDENT_SAMPLES = 20.0
_MAX_SAMPLES = 300


def add_measured_width(
    outcome: Outcome, measured: Loops, valid: ValidRange
) -> tuple[Outcome, ValidRange, str]:
    """Return the model of a table with the hysteresis of loops, its valid range, and a sentence."""
    model = outcome.model
    if model.operator_law.cells is None:
        raise InputError(
            f"law {model.law}: a table and loops together need play cells; identify with --law play-cells",
            code="choices-together",
            key="law",
        )
    low, high = valid.schedule or (0.0, 0.0)
    for gap in measured.schedule_values:
        if not 0.9 * low <= gap <= 1.1 * high:
            raise InputError(
                f"a loop at gap {1e3 * gap:.4g} mm is outside of the table, {1e3 * low:.4g} to {1e3 * high:.4g} mm; "
                "simulate this gap too",
                code="gap-outside-table",
                key="gap",
            )
    fit = _WidthFit(model, _thinned(measured))
    starts = (np.array([np.log(scale), np.log(1.5), 0.0, 0.0, 0.0]) for scale in _START_SCALES)
    results = [least_squares(fit.residuals, start, bounds=fit.bounds, x_scale=fit.scales) for start in starts]
    best = min(results, key=lambda result: float(result.cost))
    theta: FloatArray = best.x
    covariance = np.linalg.pinv(best.jac.T @ best.jac)
    shift, scale = float(theta[3]) * fit.gap_unit, float(np.exp(theta[4]))
    std = np.sqrt(np.diag(covariance))[3:] * (fit.gap_unit, scale)
    text = (
        f"from {len(measured)} measured loops; the table gives the curve and the dependence on the gap, with its gap "
        f"zero moved by {1e6 * shift:.3g} um and its {measured.output.name.replace('_', ' ')} multiplied by {scale:.4g}"
    )
    uncertainty = Uncertainty(("gap zero, m", "factor of the table"), (shift, scale), tuple(std.tolist()))
    new_valid = replace(valid, schedule=(low + shift, high + shift))
    return replace(outcome, model=fit.make_model(theta), uncertainty=uncertainty, fit=None), new_valid, text


def _thinned(loops: Loops) -> Loops:
    """Return the loops with fewer samples; reversals are kept."""
    return loops.with_loops(
        replace(loop, time=None, **{
            name: values[thin_rows(loop.input, _MAX_SAMPLES)]
            for name in ("input", "output", "schedule")
            if (values := getattr(loop, name)) is not None
        })
        for loop in loops.loops
    )  # fmt: skip


@dataclass(frozen=True)
class _WidthFit:
    """The least-squares problem of width, gap zero and factor."""

    model: Model
    loops: Loops
    bounds = ([np.log(1e-3), np.log(0.5), -6.0, -6.0, -0.7], [np.log(1.0), np.log(6.0), 6.0, 6.0, 0.7])
    scales = np.array([1.0, 0.5, 2.0, 1.0, 0.1])

    @property
    def gap_unit(self) -> float:
        """Prior standard deviation of the gap's zero, m."""
        return _GAP_SIGMA * min(self.loops.schedule_values)

    def make_model(self, theta: FloatArray) -> Model:
        """Return the model for the logarithms of pinning scale, exponent and factor, pinned share and shift."""
        log_scale, log_exponent, share, shift, log_factor = theta
        parameters = dict(self.model.parameters_at(self.model.first_node))
        assert self.model.operator_law.cells is not None
        cells = self.model.operator_law.cells(parameters)
        largest_drive = parameters["c_H"] * max(float(np.abs(loop.input).max()) for loop in self.loops.loops)
        thresholds = np.geomspace(*_THRESHOLD_RANGE, _THRESHOLDS)
        limits = np.sqrt(thresholds[1:] * thresholds[:-1])
        tails = np.concatenate(
            [[1.0], np.exp(-((limits / np.exp(log_scale)) ** np.exp(log_exponent))), [0.0]]
        )
        pinned_share = 1.0 / (1.0 + np.exp(-share))
        shares = np.concatenate([[1.0 - pinned_share], -np.diff(tails) * pinned_share])
        weights = CellWeights(
            np.concatenate([[0.0], thresholds * largest_drive]),
            cells.widths,
            shares[:, None] * cells.weights.sum(axis=0),
            cells.shape,
            cells.centres,
        )
        circuit = {
            name: self.model.parameters[name] for name in ("alpha", "rho", "c_H", "gamma", "in_0", "out_0")
        }
        c_out = np.asarray(self.model.parameters["c_out"]) * np.exp(log_factor)
        nodes = tuple(np.asarray(self.model.nodes) + shift * self.gap_unit)
        return replace(
            self.model, cells=weights, parameters={**circuit, "c_out": c_out.tolist()}, nodes=nodes
        )

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Return the weighted deviations from the loops, and the priors of gap zero and factor."""
        model, loops = self.make_model(theta), self.loops.loops
        size = _MODEL_SIGMA * full_scale(self.loops.output, [loop.output for loop in loops])
        deviations = [
            (model.predict_loop(loop) - loop.output) * np.sqrt(_INDEPENDENT_SAMPLES / loop.n)
            for loop in loops
        ]
        return np.concatenate([np.concatenate(deviations) / size, [theta[3], theta[4] / _SCALE_SIGMA]])
