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
from anhyst.model.dynamics import GAMMA_NAME, Dynamics, EddyCircuit, Layers
from anhyst.model.predict import as_history, initial_state
from anhyst.model.schema import Uncertainty
from anhyst.support.errors import NegativeResult
from anhyst.support.numeric import FloatArray

MAX_ERROR_RATIO = 0.9
"""Largest error of an accepted form, relative to the error of the static model or of a simpler
form."""

MAX_SAMPLES_PER_LOOP = 120
MAX_FINE_SAMPLES_PER_LOOP = 400
"""Maximum number of fitted samples per loop, for the comparison and for the selected form. A long
time step delays the flux."""

CYCLE_TOLERANCE = 1e-6
MAX_CYCLES = 40
"""Maximum number of cycles until a steady-state loop closes, and the tolerance of the closing,
relative to the field scale of the law."""

GAMMA_RATIO_LIMITS = np.array([1e-6, 30.0])
GAMMA_START_RATIOS = np.geomspace(0.003, 3.0, 8)
"""Range and initial values of ``gamma``, relative to the value whose eddy-current field at the
fastest rate equals the drive. Larger values would freeze the flux at all rates."""

LEAKY_DELAY_START_RATIOS = np.array([0.1, 0.5, 2.0, 10.0])
"""Initial delays of a leakage flux, relative to the reciprocal of the fastest angular frequency."""

EXCESS_START_RATIOS = np.array([0.01, 0.05, 0.2])
"""Initial excess fields at the fastest rate, relative to the drive."""

MIN_GAMMA = 1e-30  # smallest gamma of an eddy circuit, A s/(m T)

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
    rate: _RateParameters | None = None  # the fitted parameters, or None without a rate dependence
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
class _RateForm:
    """A composition of mechanisms that make the iron depend on the rate."""

    layer_count: int = 1  # number of layers; 1: uniform field
    has_leakage: bool = False  # whether a part of the eddy currents has a leakage flux
    has_excess: bool = False  # whether there is an excess loss

    @property
    def theta_limits(self) -> tuple[float, ...]:
        """Largest absolute values of the fitted parameters after ``ln(gamma)``."""
        fractions = (6.0, 6.0) if self.layer_count > 1 else ()
        leakage = (6.0, 20.0) if self.has_leakage else ()
        return (*fractions, *leakage, *((50.0,) if self.has_excess else ()))

    def __str__(self) -> str:
        """Return the form in words."""
        if self.layer_count > 1:
            return f"{self.layer_count} layers"
        additions = ["leakage flux"] * self.has_leakage + ["excess loss"] * self.has_excess
        return f"a lag of the flux{' with ' if additions else ''}{' and '.join(additions)}"


@dataclass(frozen=True)
class _RateParameters:
    """The fitted parameters of a form."""

    form: _RateForm
    # ``ln(gamma)``. Layers add the logits of surface and laminated fraction. A leakage flux adds the
    # logit of its fraction and the logarithm of its delay. An excess loss adds its logarithm.
    theta: tuple[float, ...]

    @property
    def gamma(self) -> float:
        """Eddy-current coefficient of the model, A s/(m T)."""
        return float(np.exp(self.theta[0]))

    @property
    def layers(self) -> Layers | None:
        """The layers, or None for a uniform field."""
        if self.form.layer_count == 1:
            return None
        return Layers(self.form.layer_count, *map(_fraction, self.theta[1:3]))

    @property
    def eddy_circuit(self) -> EddyCircuit | None:
        """Leakage flux and excess loss, or None without both."""
        form = self.form
        if not (form.has_leakage or form.has_excess):
            return None
        leaky = _fraction(self.theta[1]) if form.has_leakage else 0.0
        delay = float(np.exp(self.theta[2])) if form.has_leakage else 0.0
        return EddyCircuit(leaky, delay, float(np.exp(self.theta[-1])) if form.has_excess else 0.0)

    def apply_to(self, iron: AnyIron) -> int:
        """Give an iron this rate dependence; return the number of copies of the law's state."""
        iron.make_solid(1, 1.0, 0.0)
        circuit = self.eddy_circuit or EddyCircuit()
        iron.set_eddy_circuit(*circuit.core_settings(max(self.gamma, MIN_GAMMA)))
        if (layers := self.layers) is None:
            return 1
        iron.make_solid(layers.count, layers.surface, layers.laminated)
        return layers.state_copies


FORMS = (
    _RateForm(),
    _RateForm(has_excess=True),
    _RateForm(has_leakage=True),
    _RateForm(2),
    _RateForm(3),
    _RateForm(4),
)
"""Forms that are compared, simple ones first."""


class _LoopPath:
    """One measured loop, prepared for simulation with any rate parameters."""

    def __init__(
        self, model: Model, loop: Loop, iron: AnyIron, largest_output: float, max_samples: int
    ) -> None:
        assert loop.time is not None
        step = 1 + (loop.n - 1) // max_samples
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
        state = np.tile(self.state, rate.apply_to(self.iron))
        if rate.form.has_leakage:
            state = np.append(state, self.iron.flux_of(np.append(state, 0.0)))
        eddy = rate.gamma * self.rate
        circuit_inputs = self.drive, self.circuit.rho, eddy
        if self.is_cycle:
            state = self.iron.settle(*circuit_inputs, state, False, MAX_CYCLES, CYCLE_TOLERANCE)[0]
        flux, _, _, status, _ = self.iron.forward(*circuit_inputs, state)
        if status:
            return np.full(self.measured.size, _NO_ANSWER_DEVIATION)
        residual: FloatArray = (self.circuit.output(flux) - self.measured) / self.largest
        return residual


_Fold = tuple[list[list[_LoopPath]], list[list[_LoopPath]]]
"""Groups of fitted and of withheld loops."""


class _RateProblem:
    """Fast loops in groups of equal speed, with a static model."""

    def __init__(
        self,
        model: Model,
        speeds: SpeedGroups,
        largest_output: float,
        max_samples: int = MAX_SAMPLES_PER_LOOP,
    ) -> None:
        irons: dict[float | None, AnyIron] = {}  # separate objects, because the fit changes their layers
        law = model.operator_law

        def path(loop: Loop) -> _LoopPath:
            gap = loop.schedule_value if model.needs_fixed_gap else None
            if gap not in irons:
                parameters_at_gap = model.parameters_at(gap if gap is not None else model.first_node)
                iron = law.iron(*(parameters_at_gap[spec.name] for spec in law.parameters))
                assert isinstance(iron, AnyIron)
                irons[gap] = iron
            return _LoopPath(model, loop, irons[gap], largest_output, max_samples)

        self.groups = [[path(loop) for loop in loops] for loops in speeds.fast]
        self.slow_paths = [path(loop) for loop in speeds.slow.loops]
        fastest_paths = self.groups[-1]
        density = max(float(np.ptp(path.circuit.flux_density(path.measured)[0])) for path in fastest_paths)
        drive = max(float(np.ptp(path.drive)) for path in fastest_paths)
        self.model, self.fastest_rate = model, speeds.fastest_rate
        self.fastest_angular_rate = 2.0 * np.pi * speeds.fastest_rate
        self.gamma_scale = drive / (self.fastest_angular_rate * density)
        self.excess_scale = drive / np.sqrt(self.fastest_angular_rate * density)

    def make_fit(self, rate: _RateParameters, log_gamma_std: float, reason: str, loops: Loops) -> RateFit:
        """Return the static model with fitted rate parameters.

        The error is infinite if the model cannot predict all loops.
        """
        model = replace(
            self.model,
            parameters={**self.model.parameters, "gamma": rate.gamma},
            layers=rate.layers,
            eddy_circuit=rate.eddy_circuit,
            dynamics=replace(self.model.dynamics or Dynamics(), fastest=self.fastest_rate),
        )
        error = mean_error([*self.groups, self.slow_paths], rate)
        return RateFit(model, reason, rate, log_gamma_std, error if _can_predict(model, loops) else np.inf)

    def make_folds(self) -> list[_Fold]:
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

    def starts(self, form: _RateForm) -> list[_RateParameters]:
        """Return initial parameters of a form on a coarse grid."""
        gammas = np.log(GAMMA_START_RATIOS * self.gamma_scale)
        rows: list[tuple[float, ...]] = [(float(gamma),) for gamma in gammas]
        if form.layer_count > 1:
            fractions = _logit(1.0 / form.layer_count), _logit(START_LAMINATED_SHARE)
            rows = [(*row, *fractions) for row in rows]
        if form.has_leakage:
            delays = np.log(LEAKY_DELAY_START_RATIOS / self.fastest_angular_rate)
            rows = [(*row, 1.0, float(delay)) for row in rows for delay in delays]
        if form.has_excess:
            excesses = np.log(EXCESS_START_RATIOS * self.excess_scale)
            rows = [(*row, float(excess)) for row in rows for excess in excesses]
        return [_RateParameters(form, row) for row in rows]

    def fit(
        self, groups: Sequence[Sequence[_LoopPath]], form: _RateForm, start: _RateParameters | None = None
    ) -> tuple[_RateParameters, float]:
        """Fit the rate parameters to some loops; also return the std of ``ln(gamma)``."""
        from scipy.optimize import least_squares

        if start is None:
            start = min(self.starts(form), key=lambda rate: mean_error(groups, rate))

        def residuals(theta: FloatArray) -> FloatArray:
            rate = _RateParameters(form, tuple(theta.tolist()))
            rows = [
                path.relative_residual(rate) / np.sqrt(path.measured.size * len(group))
                for group in groups
                for path in group
            ]
            return np.concatenate(rows)

        gamma_limits = np.log(GAMMA_RATIO_LIMITS * self.gamma_scale)
        lower = np.array([gamma_limits[0], *(-limit for limit in form.theta_limits)])
        upper = np.array([gamma_limits[1], *form.theta_limits])
        theta_start = np.clip(start.theta, lower + 0.1, upper - 0.1)
        result = least_squares(
            residuals, theta_start, bounds=(lower, upper), diff_step=1e-3, xtol=1e-4, ftol=1e-5,
            max_nfev=15,
        )  # fmt: skip
        degrees_of_freedom = max(1, result.fun.size - result.x.size)
        covariance = np.linalg.pinv(result.jac.T @ result.jac)
        std = float(np.sqrt(2.0 * result.cost / degrees_of_freedom * covariance[0, 0]))
        return _RateParameters(form, tuple(result.x.tolist())), std


def _logit(fraction: float) -> float:
    return float(np.log(fraction / (1.0 - fraction)))


def _fraction(logit: float) -> float:
    return float(0.5 + 0.5 * np.tanh(0.5 * logit))


def mean_error(groups: Iterable[Sequence[_LoopPath]], rate: _RateParameters) -> float:
    """Return the geometric mean over the groups of the rms residual."""
    return _geometric_mean(
        float(np.sqrt(np.mean(np.concatenate([path.relative_residual(rate) ** 2 for path in group]))))
        for group in groups
    )


def fit_rate(model: Model, loops: Loops, speeds: SpeedGroups) -> RateFit:
    """Fit the rate dependence to fast loops, with a fixed static model.

    A form is a candidate if it predicts withheld loops better than the static model, and not clearly
    worse than a single lag. The simplest candidate is selected first. A form with more parameters or
    layers replaces it if the error at all fast loops decreases by a tenth.
    """
    problem = _RateProblem(_with_series_reluctance(model), speeds, largest_output(loops))
    folds = problem.make_folds()
    static_rate = _RateParameters(_RateForm(), (-np.inf,))
    static_error = _geometric_mean(mean_error(withheld_paths, static_rate) for _, withheld_paths in folds)
    largest_withheld_error = MAX_ERROR_RATIO * static_error
    candidates: list[_Candidate] = []
    for form in FORMS:
        candidate = _try_form(problem, folds, form)
        if form == FORMS[0]:
            lag_error = candidate.withheld_error / MAX_ERROR_RATIO
            largest_withheld_error = min(largest_withheld_error, lag_error)
        if candidate.withheld_error <= largest_withheld_error:
            candidates.append(candidate)
    static_text = f"{100.0 * static_error:.2g} % of the largest output"
    if not candidates:
        reason = f"no rate dependence improves the fit of fast loops: the error of the static model is {static_text}"
        return RateFit(model, reason)
    chosen = candidates[0]
    for candidate in candidates[1:]:
        if candidate.error < MAX_ERROR_RATIO * chosen.error:
            chosen = candidate
    test_text = (
        "no loops could be withheld"
        if folds[0][0] is problem.groups
        else f"at withheld loops {100.0 * chosen.withheld_error:.2g} %"
    )
    reason = (
        f"{chosen.rate.form}: the error at the fast loops is {100.0 * chosen.error:.2g} % of full scale, "
        f"{test_text}; the error of the static model there is {static_text}"
    )
    rate_fit = _fit_fine_samples(model, loops, speeds, chosen.rate, reason)
    if np.isinf(rate_fit.error):
        return RateFit(model, f"{chosen.rate.form} fits the fast loops, but its cycles do not close")
    return rate_fit


def continue_rate_fit(rate_fit: RateFit, model: Model, loops: Loops, speeds: SpeedGroups) -> RateFit:
    """Fit the form of an earlier fit again, with another static model."""
    assert rate_fit.rate is not None
    return _fit_fine_samples(model, loops, speeds, rate_fit.rate, rate_fit.reason)


def _fit_fine_samples(
    model: Model, loops: Loops, speeds: SpeedGroups, start: _RateParameters, reason: str
) -> RateFit:
    """Fit a form to more samples, from given parameters."""
    static_model = _with_series_reluctance(model)
    problem = _RateProblem(static_model, speeds, largest_output(loops), MAX_FINE_SAMPLES_PER_LOOP)
    rate, std = problem.fit(problem.groups, start.form, start)
    return problem.make_fit(rate, std, reason, loops)


@dataclass(frozen=True)
class _Candidate:
    """A fitted form, with its errors relative to the largest output."""

    rate: _RateParameters
    error: float  # error at all fast loops
    withheld_error: float  # geometric mean of the errors at withheld loops


def _try_form(problem: _RateProblem, folds: list[_Fold], form: _RateForm) -> _Candidate:
    """Fit a form to all fast loops, then to the loops of each fold."""
    rate, _ = problem.fit(problem.groups, form)
    withheld_error = _geometric_mean(
        mean_error(
            withheld_paths,
            rate if fitted_paths is problem.groups else problem.fit(fitted_paths, form, rate)[0],
        )
        for fitted_paths, withheld_paths in folds
    )
    return _Candidate(rate, mean_error(problem.groups, rate), withheld_error)


def _can_predict(model: Model, loops: Loops) -> bool:
    """Return whether all steady-state cycles of a model close."""
    try:
        for loop in loops.loops:
            model.predict_loop(loop)
    except NegativeResult:
        return False
    return True


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
    if alpha > 0.0 and not model.can_jump_without_gap:
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
