"""Fit the eddy currents of solid iron, as a number of layers, to loops of several speeds.

The static model comes from the slow loops and is fixed, because layers do not change static
behaviour. Three parameters are fitted to the fast loops: ``gamma``, the surface layer's fraction of
the cross-section, and the laminated fraction of the path. Withheld speeds (or gaps, with a single
fast speed) decide whether there is a rate dependence. The fit decides on the number of layers: from
two layers on, the number of parameters is the same (docs/rate.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from anhyst._core import AnyIron
from anhyst.data import Loop, Loops
from anhyst.data.speeds import SpeedGroups
from anhyst.data.verdict import largest_output
from anhyst.model.actuator import Model
from anhyst.model.dynamics import GAMMA_NAME, Dynamics, Layers
from anhyst.model.predict import as_history, initial_state
from anhyst.model.schema import Uncertainty
from anhyst.support.numeric import FloatArray

LAYER_COUNTS = (1, 2, 3, 4)  # numbers of layers that are tried; 1 is a lag of the flux

MAX_ERROR_RATIO = 0.9
"""Largest error with layers for which they are accepted, relative to the error of the static model
or of fewer layers."""

MAX_SAMPLES_PER_LOOP = 120  # maximum number of fitted samples per loop

CYCLE_TOLERANCE = 1e-6
MAX_CYCLES = 40
"""Maximum number of cycles until a steady-state loop closes, and the tolerance of the closing,
relative to the field scale of the law."""

GAMMA_START_RATIOS = np.geomspace(0.003, 3.0, 8)
"""Initial values of ``gamma``, relative to the value whose eddy-current field at the fastest rate
equals the drive."""

START_LAMINATED_SHARE = 0.2  # initial laminated fraction of the path

MIN_RATE_EFFECT_RATIO = 0.3
"""Rms rate effect in the slow loops, relative to the static residual, above which the effect is
subtracted and the static model is fitted again."""

_NO_ANSWER_DEVIATION = 1e3  # residual of parameters without a solution


@dataclass(frozen=True, eq=False)
class RateFit:
    """Result of fitting the rate dependence to fast loops."""

    model: Model  # the model with layers or a lag; unchanged if they do not help
    reason: str  # reason why the rate dependence was accepted or rejected, as a sentence
    log_gamma_std: float = 0.0  # standard deviation of ln(gamma)
    error: float = (
        np.inf
    )  # geometric mean over the speeds of the rms residual, relative to the largest output

    def add_to_uncertainty(self, static_uncertainty: Uncertainty) -> Uncertainty:
        """Return the uncertainty of the static model, with ``gamma`` added."""
        gamma, dynamics = self.model.parameters["gamma"], self.model.dynamics
        assert isinstance(gamma, float)
        assert dynamics is not None
        statement = (
            f"gamma has a standard deviation of {100.0 * self.log_gamma_std:.2g} %; it was measured "
            f"up to {dynamics.fastest:.3g} Hz, faster runs were not measured"
        )
        correlation = np.eye(len(static_uncertainty.correlation) + 1)
        correlation[:-1, :-1] = static_uncertainty.correlation or np.empty((0, 0))
        return Uncertainty(
            names=(*static_uncertainty.names, GAMMA_NAME),
            values=(*static_uncertainty.values, gamma),
            std=(*static_uncertainty.std, gamma * self.log_gamma_std),
            correlation=tuple(map(tuple, correlation.tolist())) if static_uncertainty.correlation else (),
            statements=(*static_uncertainty.statements, statement),
        )


@dataclass(frozen=True)
class _RateParameters:
    """The fitted parameters of the rate dependence, and the number of layers."""

    layer_count: int  # number of layers
    theta: tuple[float, ...]  # ``ln(gamma)`` and, with several layers, the logits of both fractions

    @property
    def gamma(self) -> float:
        """Eddy-current coefficient of the model, A s/(m T)."""
        return float(np.exp(self.theta[0]))

    @property
    def shares(self) -> tuple[float, float]:
        """Fraction of the section in the surface layer, and laminated fraction of the path."""
        if self.layer_count == 1:
            return 1.0, 0.0
        surface, laminated = 0.5 + 0.5 * np.tanh(0.5 * np.array(self.theta[1:]))
        return float(surface), float(laminated)


class _LoopPath:
    """One measured loop, prepared for simulation with any rate parameters."""

    def __init__(self, model: Model, loop: Loop, iron: AnyIron, largest_output: float) -> None:
        assert loop.time is not None
        step = 1 + (loop.n - 1) // MAX_SAMPLES_PER_LOOP
        end_rows = [int(np.argmin(loop.input)), int(np.argmax(loop.input)), loop.n - 1]
        samples = np.unique(np.concatenate([np.arange(0, loop.n, step), end_rows]))
        steps = np.diff(loop.time[samples])
        self.is_cycle, self.gap = loop.history.kind == "settled", loop.schedule_value
        first_rate = 1.0 / float(np.median(steps)) if self.is_cycle else 0.0
        self.rate = np.concatenate([[first_rate], 1.0 / steps])
        gap = None if loop.schedule is None else loop.schedule[samples]
        self.circuit = model.circuit(gap, np.zeros(samples.size))
        self.drive = self.circuit.magnetomotive(loop.input[samples])
        self.measured = loop.output[samples]
        self.largest = largest_output
        self.iron = iron
        start = None if loop.schedule is None else float(loop.schedule[0])
        self.state = initial_state(model, iron, as_history(loop.history, model), start)

    def relative_residual(self, rate: _RateParameters) -> FloatArray:
        """Return modelled minus measured output, relative to the largest output of all loops."""
        self.iron.make_solid(rate.layer_count, *rate.shares)
        eddy = rate.gamma * self.rate
        state = np.tile(self.state, rate.layer_count + 1 if rate.layer_count > 1 else 1)
        circuit_inputs = self.drive, self.circuit.rho, eddy
        if self.is_cycle:
            state = self.iron.settle(*circuit_inputs, state, False, MAX_CYCLES, CYCLE_TOLERANCE)[0]
        flux, _, _, status, _ = self.iron.forward(*circuit_inputs, state)
        if status:
            return np.full(self.measured.size, _NO_ANSWER_DEVIATION)
        residual: FloatArray = (self.circuit.output(flux) - self.measured) / self.largest
        return residual


class _RateProblem:
    """Fast loops in groups of equal speed, with a static model."""

    def __init__(self, model: Model, speeds: SpeedGroups, largest_output: float) -> None:
        irons: dict[float | None, AnyIron] = {}  # separate objects, because the fit changes their layers
        law = model.operator_law

        def path(loop: Loop) -> _LoopPath:
            gap = loop.schedule_value if model.needs_fixed_gap else None
            if gap not in irons:
                parameters_at_gap = model.parameters_at(gap if gap is not None else model.first_node)
                iron = law.iron(*(parameters_at_gap[spec.name] for spec in law.parameters))
                assert isinstance(iron, AnyIron)
                irons[gap] = iron
            return _LoopPath(model, loop, irons[gap], largest_output)

        self.groups = [[path(loop) for loop in loops] for loops in speeds.fast]
        self.slow_paths = [path(loop) for loop in speeds.slow.loops]
        fastest_paths = self.groups[-1]
        density = max(float(np.ptp(path.circuit.flux_density(path.measured)[0])) for path in fastest_paths)
        drive = max(float(np.ptp(path.drive)) for path in fastest_paths)
        self.gamma_scale = drive / (2.0 * np.pi * speeds.fastest_rate * density)

    def make_folds(self) -> list[tuple[list[list[_LoopPath]], list[list[_LoopPath]]]]:
        """Return pairs of fitted and withheld groups: each speed is withheld, or each gap."""
        if len(self.groups) > 1:
            all_groups = [[group] for group in self.groups]
        else:
            paths = self.groups[0]
            gaps = sorted({path.gap for path in paths if path.gap is not None})
            all_groups = [[[path for path in paths if path.gap == gap]] for gap in gaps]
        if len(all_groups) < 2:
            return [(self.groups, self.groups)]
        return [
            (
                [group for groups in all_groups if groups is not withheld_groups for group in groups],
                withheld_groups,
            )
            for withheld_groups in all_groups
        ]

    def fit(
        self, groups: Sequence[Sequence[_LoopPath]], layer_count: int, start: _RateParameters | None = None
    ) -> tuple[_RateParameters, float]:
        """Fit the rate parameters to some loops; also return the std of ``ln(gamma)``."""
        from scipy.optimize import least_squares

        if start is None:
            shares = () if layer_count == 1 else (_logit(1.0 / layer_count), _logit(START_LAMINATED_SHARE))
            starts = [
                _RateParameters(layer_count, (float(np.log(gamma_ratio * self.gamma_scale)), *shares))
                for gamma_ratio in GAMMA_START_RATIOS
            ]
            start = min(starts, key=lambda rate: mean_error(groups, rate))

        def residuals(theta: FloatArray) -> FloatArray:
            rate = _RateParameters(layer_count, tuple(theta.tolist()))
            rows = [
                path.relative_residual(rate) / np.sqrt(path.measured.size * len(group))
                for group in groups
                for path in group
            ]
            return np.concatenate(rows)

        theta_limits = np.array([50.0, 6.0, 6.0][: len(start.theta)])
        theta_start = np.array(start.theta)
        theta_start[1:] = np.clip(theta_start[1:], -5.9, 5.9)
        result = least_squares(
            residuals, theta_start, bounds=(-theta_limits, theta_limits), diff_step=1e-3, xtol=1e-4, ftol=1e-5,
            max_nfev=15,
        )  # fmt: skip
        degrees_of_freedom = max(1, result.fun.size - result.x.size)
        covariance = np.linalg.pinv(result.jac.T @ result.jac)
        std = float(np.sqrt(2.0 * result.cost / degrees_of_freedom * covariance[0, 0]))
        return _RateParameters(layer_count, tuple(result.x.tolist())), std


def _logit(share: float) -> float:
    return float(np.log(share / (1.0 - share)))


def mean_error(groups: Iterable[Sequence[_LoopPath]], rate: _RateParameters) -> float:
    """Return the geometric mean over the groups of the rms residual."""
    return _geometric_mean(
        float(np.sqrt(np.mean(np.concatenate([path.relative_residual(rate) ** 2 for path in group]))))
        for group in groups
    )


def fit_rate(model: Model, loops: Loops, speeds: SpeedGroups, min_layers: int = LAYER_COUNTS[0]) -> RateFit:
    """Fit eddy currents to fast loops, with a fixed static model and a minimum number of layers."""
    static_model, model = model, _with_series_reluctance(model)
    problem = _RateProblem(model, speeds, largest_output(loops))
    folds = problem.make_folds()
    static_rate = _RateParameters(1, (-np.inf,))
    static_error = _geometric_mean(mean_error(withheld_paths, static_rate) for _, withheld_paths in folds)
    chosen_fit: tuple[_RateParameters, float] | None = None
    best_error = withheld_error = np.inf
    for layer_count in LAYER_COUNTS[LAYER_COUNTS.index(min_layers) :]:
        rate, std = problem.fit(problem.groups, layer_count)
        error = mean_error(problem.groups, rate)
        if chosen_fit is None:
            withheld_error = _geometric_mean(
                mean_error(
                    withheld_paths,
                    problem.fit(fitted_paths, layer_count, rate)[0]
                    if fitted_paths is not problem.groups
                    else rate,
                )
                for fitted_paths, withheld_paths in folds
            )
            is_better = withheld_error < MAX_ERROR_RATIO * static_error
        else:
            is_better = error < MAX_ERROR_RATIO * best_error
        if is_better:
            best_error, chosen_fit = error, (rate, std)
        elif chosen_fit is not None and layer_count > 2:
            break  # more layers would only be a finer discretisation
    static_text = f"{100.0 * static_error:.2g} % of the largest output"
    if chosen_fit is None:
        return RateFit(
            static_model,
            f"layers do not improve the fit of fast loops: the error of the static model is {static_text}",
        )
    rate, std = chosen_fit
    rate_model = replace(
        model,
        parameters={**model.parameters, "gamma": rate.gamma},
        layers=Layers(rate.layer_count, *rate.shares) if rate.layer_count > 1 else None,
        dynamics=replace(model.dynamics or Dynamics(), fastest=speeds.fastest_rate),
    )
    layers_text = (
        "a lag of the flux has an error of"
        if rate.layer_count == 1
        else f"{rate.layer_count} layers have an error of"
    )
    reason = (
        f"{layers_text} {100.0 * best_error:.2g} % of full scale at the fast loops; its error at withheld loops is "
        f"{100.0 * withheld_error:.2g} %, that of the static model {static_text}"
    )
    return RateFit(rate_model, reason, std, mean_error([*problem.groups, problem.slow_paths], rate))


def _geometric_mean(values: Iterable[float]) -> float:
    return float(np.exp(np.mean(np.log(list(values)))))


def _with_series_reluctance(model: Model) -> Model:
    """Return a play-cell model whose coupling is converted to a series reluctance.

    Static behaviour does not change. With layers, a reluctance acts on the flux of all layers
    together, and a coupling on the flux of each layer. A negative coupling represents a gap, and is
    converted. A positive coupling is a property of the iron and is not converted. If the iron would
    jump without a gap, a positive coupling is converted as far as the reluctance stays positive.
    """
    law, alpha = model.operator_law, model.parameters["alpha"]
    if law.cells is None or isinstance(alpha, tuple) or not alpha or model.needs_fixed_gap:
        return model
    if alpha > 0.0 and not model.jumps_without_gap:
        return model
    total = (1.0 - alpha) * (1.0 + np.array(model.parameters["rho"]))
    new_alpha = max(0.0, 1.0 - float(total.min()))
    factor = (1.0 - alpha) / (1.0 - new_alpha)
    specs = (*law.parameters_with_role("saturation"), *law.parameters_with_role("reversible"))
    scaled_names = (*(spec.name for spec in specs), "c_H")
    parameters = {name: (factor * np.array(model.parameters[name])).tolist() for name in scaled_names}
    circuit = {"alpha": new_alpha, "rho": np.maximum(total / (1.0 - new_alpha) - 1.0, 0.0).tolist()}
    return replace(model, parameters={**model.parameters, **parameters, **circuit})


def remove_rate_effect(model: Model, static_model: Model, slow_loops: Loops) -> Loops | None:
    """Subtract the rate effect from slow loops; return None if it is negligible."""
    static_squares, rate_squares, corrected_loops = [], [], []
    for loop in slow_loops.loops:
        static_output = static_model.predict_loop(loop)
        rate_effect = model.predict_loop(loop) - static_output
        static_squares.append(np.mean((loop.output - static_output) ** 2))
        rate_squares.append(np.mean(rate_effect**2))
        corrected_loops.append(replace(loop, output=loop.output - rate_effect))
    return (
        None
        if np.mean(rate_squares) <= MIN_RATE_EFFECT_RATIO**2 * np.mean(static_squares)
        else slow_loops.with_loops(corrected_loops)
    )
