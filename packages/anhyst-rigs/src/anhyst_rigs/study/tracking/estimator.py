"""Estimate the calibration errors of magnets from recorded motion.

Mass times acceleration gives the force on the body. A hysteresis model predicts the same force from
the commanded currents and the measured gaps. A few parameters, such as the scale of each magnet's
current, explain the difference. Their prior standard deviations come from the rig file. The same
estimator processes recordings and the motions of a running stage.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.calibration import (
    PARAMETER_LIMITS,
    CalibratedMethod,
    CalibratedParameter,
    ParameterName,
    parameter_kind,
)
from anhyst_rigs.rig.drift import NO_DRIFT, Drift
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from anhyst_rigs.rig.stage.setpoint import SetPoint, scan_motion
from anhyst_rigs.study.tracking.bodies import CALIBRATABLE_METHODS, StageLaw
from anhyst_rigs.study.tracking.motion import COMPARISON_RATE_HZ, Motion, MotionLaw, round_to_grid

MAX_SIGMA = 4.0
"""Largest absolute value of each parameter, in prior standard deviations."""
GAUSS_NEWTON_STEPS = 3
"""Number of Gauss-Newton steps for each motion."""
FORGETTING_TIME_S = 20.0
"""Time constant of forgetting in a running stage, s. It counts only the time in which the demand is
above 6 % of the largest force."""
MAX_UPDATE_RATE_SIGMA_PER_S = 2.0
"""Largest rate of change of the applied corrections, in prior standard deviations per second."""
DERIVATIVE_STEPS = {"scale": 0.005, "gap_zero_m": 2e-6, "width": 0.1, "lag_s": 25e-6}
"""Step of each kind of parameter for finite-difference derivatives of the predicted force."""
MAX_RESIDUAL_TO_INERTIAL_FORCE = 0.01
"""Largest rms residual after the fit for which a motion is accepted, as a fraction of the rms
inertial force (mass times acceleration). The noise is added in quadrature."""
MAX_RESIDUAL_TO_EARLIER_RESIDUAL = 2.5
"""Largest rms residual before the fit, relative to the residual of earlier motions. If a residual
is larger and parameter errors cannot explain it, the plant or a sensor has changed.
"""
MIN_GATE_RESIDUAL_TO_INERTIAL_FORCE = 0.001
"""Smallest residual with which the gate compares, as a fraction of the inertial force. Every
hysteresis model has errors of this size."""
SCALE_SUM_WEIGHT = 20.0
"""Weight of the prior that the scales add up to 0, relative to the prior of one scale. It applies
if the payload is estimated too, because motion cannot separate it from the sum of the scales."""
MAX_COMMON_SCALE_SIGMA = 2.0
"""Largest mean of the scales of all magnets in prior standard deviations, if all have one sign. A
larger mean is that of a payload: independent errors of two magnets reach it in 1 of 200 stages."""
MIN_LAG_TICKS = -0.25
"""Smallest estimated lag in ticks, if it is below 0 by more than two standard deviations. The error
of the estimate is up to a fifth of a tick."""
MASS_PRIOR_SIGMA = 0.3
"""Prior standard deviation of the relative change of mass that may explain a rejected motion."""
MIN_MASS_CHANGE = 0.01
"""Smallest relative change of mass that is reported; errors of the scales can explain less."""
TRAINING_SCANS = 4
"""Number of training scans that calibrate a running stage before its evaluation."""


@dataclass(frozen=True)
class _SquareSums:
    """Sums of squares over all comparisons of predicted and measured force."""

    count: float = 0.0
    force: float = 0.0  # sum of squared inertial force, N^2
    residual: float = 0.0  # sum of squared residual, N^2

    def plus_decayed(self, earlier: _SquareSums, retention: float) -> _SquareSums:
        """Return these sums plus the fraction `retention` of earlier ones."""
        return _SquareSums(
            self.count + retention * earlier.count,
            self.force + retention * earlier.force,
            self.residual + retention * earlier.residual,
        )

    @property
    def force_rms(self) -> float:
        """Root mean square of the force, N; 0 without data."""
        return math.sqrt(self.force / max(self.count, 1.0))

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residual, N; 0 without data."""
        return math.sqrt(self.residual / max(self.count, 1.0))


@dataclass(frozen=True, eq=False)
class _Fit:
    """The estimate including one more motion, before this motion is accepted or rejected."""

    motion_rows: FloatArray  # information rows of this motion alone
    information: FloatArray  # triangular square root of the information of all motions
    identified: list[ParameterName]
    values: dict[ParameterName, float]
    residual_rms: float  # rms residual of this motion, N


class ParameterEstimator:
    """A square-root information filter for the calibration parameters of one method.

    The rows of ``_information`` are an augmented triangular system ``[R | z]`` with ``R*p = z`` for
    the parameters p, in units of the standard deviation of one comparison. The prior is not part of
    these rows but is added for each solution. Therefore, a parameter that motions no longer excite
    returns to its prior. Information decays only while force is demanded, never at rest.
    """

    def __init__(self, law: MotionLaw, forgetting_time_s: float = math.inf) -> None:
        self.law, self.forgetting_time_s = law, forgetting_time_s
        self.prior_sigma = {name: law.prior_sigma(name) for name in law.names}
        self.estimate = dict.fromkeys(law.names, 0.0)
        # corrections in use, which follow the estimate at a limited rate
        self.applied_values = dict(self.estimate)
        self.noise_N = 0.0  # force noise that the position sensor causes in the last motion, N
        self.mass_kg: float | None = None  # mass that explains the last rejected motion
        self.reason = ""  # why the last rejected motion was rejected; empty: no law explains it
        self.rejected_count = 0
        self.identified: list[ParameterName] = []  # parameters that the motions identify
        self._names = [name for name in law.estimable_names if self.prior_sigma[name] > 0.0]
        self._information = np.zeros((0, len(self._names) + 1))
        self._sums = _SquareSums()

    def copy_without_data(self) -> ParameterEstimator:
        """Return a new estimator without data but with the applied corrections."""
        estimator = ParameterEstimator(self.law, self.forgetting_time_s)
        estimator.applied_values = dict(self.applied_values)
        return estimator

    def update(self, motion: Motion) -> bool:
        """Update the estimate from a motion; return whether the motion identified any parameter.

        A motion whose demand stays below 6 % of the largest force is skipped. A motion that the
        hysteresis model cannot explain is rejected.
        """
        if not motion.compared_indices.size:
            return False
        self.noise_N, self.reason = motion.force_noise, ""
        comparisons_per_s = motion.comparisons_per_tick * COMPARISON_RATE_HZ
        retention = math.exp(-motion.compared_indices.size / (comparisons_per_s * self.forgetting_time_s))
        history = math.sqrt(retention) * self._information
        if self.identified:
            inconsistent_rows = self._contradicting_rows(motion, history)
            if inconsistent_rows is not None:
                return self._reject_motion(motion, history, inconsistent_rows)
        motion_fit = self._fit_motion(motion, history)
        count, force_N = motion.compared_indices.size, motion.force_rms
        square_sums = _SquareSums(count, count * force_N**2, count * motion_fit.residual_rms**2)
        max_residual_N = math.hypot(MAX_RESIDUAL_TO_INERTIAL_FORCE * force_N, self.noise_N)
        is_explained = motion_fit.residual_rms <= max_residual_N
        scale_reason = self._find_common_scale(motion_fit.values) if is_explained else ""
        lag_reason = self._find_acausal_lag(motion_fit) if is_explained and not scale_reason else ""
        self.reason = scale_reason or lag_reason
        if not is_explained or self.reason or self._has_scale_at_bound(motion_fit.values):
            if not self.identified:
                self._sums = square_sums
            return self._reject_motion(motion, history, motion_fit.motion_rows, can_be_mass=not lag_reason)
        if self.identified:
            square_sums = square_sums.plus_decayed(self._sums, retention)
        self.estimate, self.identified = motion_fit.values, motion_fit.identified
        self._information, self._sums = motion_fit.information, square_sums
        self.mass_kg, self.reason = None, ""
        return bool(self.identified)

    def _contradicting_rows(self, motion: Motion, history: FloatArray) -> FloatArray | None:
        """Return the information rows of a motion if it contradicts earlier ones, or None."""
        residual_N = rms(self.law.residual(motion, self.estimate))
        expected_N = max(self._sums.residual_rms, MIN_GATE_RESIDUAL_TO_INERTIAL_FORCE * motion.force_rms)
        limit_N = MAX_RESIDUAL_TO_EARLIER_RESIDUAL * expected_N
        if residual_N <= limit_N:
            return None
        rows = self._info_rows(motion, self.estimate, exact=True)
        # With one coordinate, all motions excite the same combination of parameters. Therefore, the
        # uncertainty of the parameters cannot explain a larger residual.
        sigma_N = self._prediction_sigma(history, rows) if motion.comparisons_per_tick > 1 else 0.0
        return rows if residual_N > math.hypot(limit_N, MAX_RESIDUAL_TO_EARLIER_RESIDUAL * sigma_N) else None

    def _fit_motion(self, motion: Motion, history: FloatArray) -> _Fit:
        """Fit the parameters to a motion and to the information from earlier motions."""
        values = self.estimate
        for step in range(GAUSS_NEWTON_STEPS):
            is_last = step == GAUSS_NEWTON_STEPS - 1
            motion_rows = self._info_rows(motion, values, exact=is_last)
            stacked = np.vstack([history, motion_rows])
            information = np.asarray(np.linalg.qr(stacked, mode="r"))
            excited = self._excited_names(information)
            values = self._solve_values(information, excited)
        sigma = self._posterior_sigma(information, excited, 0.0)
        identified = [
            name for name in excited if sigma[name] <= self.law.max_sigma_ratio * self.prior_sigma[name]
        ]
        values = self._solve_values(information, identified)
        residual_N = rms(self.law.residual(motion, values))
        return _Fit(motion_rows, information, identified, values, residual_N)

    def _has_scale_at_bound(self, values: Mapping[ParameterName, float]) -> bool:
        """Whether the scale of a current is at its bound, as after a plant or sensor fault."""
        scales = [name for name in self._names if parameter_kind(name) == "scale"]
        return any(abs(values[name]) > 0.999 * MAX_SIGMA * self.prior_sigma[name] > 0.0 for name in scales)

    def _find_common_scale(self, values: Mapping[ParameterName, float]) -> str:
        """Return a text if the scales of all magnets deviate as with a payload; empty if not."""
        scales = np.array([values[name] for name in self._names if parameter_kind(name) == "scale"])
        if scales.size < 2 or abs(np.sign(scales).sum()) < scales.size or not self.law.is_right_in_kind:
            return ""
        is_payload = abs(scales.mean()) > MAX_COMMON_SCALE_SIGMA * self.prior_sigma["scale_1"]
        text = f"all scales have one sign and a mean of {100.0 * scales.mean():.2g} %, as with a payload"
        return text if is_payload else ""

    def _find_acausal_lag(self, motion_fit: _Fit) -> str:
        """Return a text if the lag is below 0 by more than its uncertainty; empty if not."""
        if "lag_s" not in motion_fit.identified:
            return ""
        lag, residual_N = motion_fit.values["lag_s"], motion_fit.residual_rms
        sigma = self._posterior_sigma(motion_fit.information, motion_fit.identified, residual_N)["lag_s"]
        is_acausal = lag < min(MIN_LAG_TICKS * self.law.rig.dt, -2.0 * sigma)
        text = f"a lag of {1e6 * lag:.0f} us is not causal: correct timing.delay_ticks"
        return text if is_acausal else ""

    def _reject_motion(
        self, motion: Motion, history: FloatArray, motion_rows: FloatArray, can_be_mass: bool = True
    ) -> bool:
        """Discard a motion, and test whether another mass explains it."""
        self.rejected_count += 1
        force_per_mass = motion.force_per_unit["payload"][motion.compared_indices]
        prior_sigma = np.array([*(self.prior_sigma[n] for n in self._names), MASS_PRIOR_SIGMA])
        # The mass becomes a further parameter, before the right-hand side.
        old_rows = np.insert(history, -1, 0.0, axis=1)
        new_rows = np.insert(motion_rows, -1, force_per_mass / self._comparison_sigma, axis=1)
        matrix = np.vstack([old_rows[:, :-1] * prior_sigma, new_rows[:, :-1] * prior_sigma])
        matrix = np.vstack([matrix, np.eye(prior_sigma.size)])
        rhs = np.concatenate([old_rows[:, -1], new_rows[:, -1], np.zeros(prior_sigma.size)])
        solution = prior_sigma * np.linalg.lstsq(matrix, rhs)[0]
        residual_N = self._comparison_sigma * rms(new_rows[:, -1] - new_rows[:, :-1] @ solution)
        is_mass = [name == "payload" for name in self._names] + [True]
        relative_change = float(solution[is_mass].sum())
        mass_kg = self.law.rig.settings.body.mass_kg * (1.0 + relative_change)
        is_mass_explaining = (
            can_be_mass
            and self.law.is_right_in_kind
            and self.is_explained(residual_N, motion.force_rms)
            and abs(relative_change) > MIN_MASS_CHANGE
            and mass_kg > 0.0
        )
        self.mass_kg = mass_kg if is_mass_explaining else None
        return False

    def _prediction_sigma(self, history: FloatArray, motion_rows: FloatArray) -> float:
        """Return the standard deviation of the force predicted for a motion, rms over time, N."""
        prior_sigma = np.array([self.prior_sigma[name] for name in self._names])
        matrix = np.vstack([history[:, :-1] * prior_sigma, self._prior_rows(self._names)])
        root = np.asarray(np.linalg.qr(matrix, mode="r"))
        spread = np.linalg.solve(root.T, (motion_rows[:, :-1] * prior_sigma).T)
        return self._comparison_sigma * math.sqrt(float((spread**2).sum(axis=0).mean()))

    def information_rows(self, run: Recording) -> FloatArray:
        """Return the information rows of a recording; none if the stage lost control."""
        motion = self.law.make_motion(run.columns)
        if run.loss is not None or not motion.compared_indices.size:
            return self._information[:0]
        rows = self._info_rows(motion, self.estimate, exact=False)
        return np.asarray(np.linalg.qr(rows, mode="r"))

    def relative_sigma(self, *rows: FloatArray) -> dict[ParameterName, float]:
        """Return posterior divided by prior standard deviations, with further information rows."""
        stacked = np.vstack([self._information, *rows])
        sigma = self._posterior_sigma(stacked, self._excited_names(stacked), 0.0)
        prior_sigma = self.prior_sigma
        return {n: sigma.get(n, prior_sigma[n]) / prior_sigma[n] for n in self._names}

    def condition_number(self, *rows: FloatArray) -> float:
        """Return the condition number of the information matrix of the identified parameters.

        Parameters are scaled by their priors, and further information rows are added.
        """
        relative_sigma = self.relative_sigma(*rows)
        names = [name for name, value in relative_sigma.items() if value <= self.law.max_sigma_ratio]
        prior_sigma = np.array([self.prior_sigma[name] for name in names])
        # Only the row of the prior for the sum of all scales is added, because motion cannot
        # separate this sum from a payload.
        scale_sum_row = self._prior_rows(names)[len(names) :]
        root = prior_sigma * np.vstack([self._information, *rows])[:, self._column_indices(names)]
        return float(np.linalg.cond(np.vstack([root, scale_sum_row]))) ** 2 if names else math.inf

    def follow_estimate(self, seconds: float) -> None:
        """Move the applied corrections towards the estimate, unless the law does not fit."""
        if not self._law_fits:
            return
        for name, target in self.estimate.items():
            max_change = MAX_UPDATE_RATE_SIGMA_PER_S * self.prior_sigma[name] * seconds
            change = min(max(target - self.applied_values[name], -max_change), max_change)
            self.applied_values[name] = round_to_grid(name, self.applied_values[name] + change)

    def corrected_stage(self, drift: Drift = NO_DRIFT) -> StageSetup:
        """Return the stage with the applied corrections, and with a drift of its plant."""
        assert isinstance(self.law, StageLaw)
        return self.law.corrected_stage(self._calibrated_method(self.applied_values, fits_well=True), drift)

    def run_and_update(self, drift: Drift, set_point: SetPoint, gains: Feedforward, seed: int) -> Recording:
        """Run a set-point with the applied corrections, then update the estimate from this motion."""
        run = track(self.corrected_stage(drift), set_point, gains, seed)
        if run.loss is None:
            self.update(self.law.make_motion(run.columns))
            self.follow_estimate(set_point.duration)
        return run

    @property
    def calibration(self) -> CalibratedMethod:
        """The estimate, its uncertainty and the residual, in the form of the calibration file."""
        return self._calibrated_method(self.estimate, self._law_fits)

    def is_explained(self, residual_N: float, force_N: float) -> bool:
        """Whether a residual is as small as the residual of a suitable hysteresis model."""
        return residual_N <= math.hypot(self.law.max_residual_ratio * force_N, self.noise_N)

    @property
    def _law_fits(self) -> bool:
        """Whether the hysteresis model explains the accepted motions."""
        force_N, residual_N = self._sums.force_rms, self._sums.residual_rms
        return force_N > 0.0 and self.is_explained(residual_N, force_N)

    def _calibrated_method(self, values: Mapping[ParameterName, float], fits_well: bool) -> CalibratedMethod:
        """Return values, uncertainty and residual in the form of the calibration file."""
        residual_N = self._sums.residual_rms
        sigma = self._posterior_sigma(self._information, self.identified, residual_N)
        if "payload" in sigma:
            self._add_scale_sum_sigma(sigma)
        return CalibratedMethod(
            name=self.law.method,
            residual_N=residual_N,
            force_N=self._sums.force_rms,
            fits=fits_well,
            refused=self.rejected_count,
            mass_kg=self.mass_kg,
            reason=self.reason or None,
            parameter=[
                CalibratedParameter(
                    name=name,
                    value=values[name],
                    sigma=sigma.get(name, self.prior_sigma[name]),
                    prior=self.prior_sigma[name],
                    frozen=name not in self.identified,
                )
                for name in self.law.names
                if self.prior_sigma[name] > 0.0
            ],
        )

    def _add_scale_sum_sigma(self, sigma: dict[ParameterName, float]) -> None:
        """Add the uncertainty of the mean scale, which motion cannot determine."""
        scale_count = sum(parameter_kind(name) == "scale" for name in self._names)
        mean_scale_sigma = self.prior_sigma["scale_1"] / math.sqrt(scale_count)
        # The force is proportional to the square of the current. Therefore, an error of the mean
        # scale counts twice in the payload.
        sensitivity = {"payload": 2.0, "scale": 1.0}
        for name, scale_sigma in sigma.items():
            factor = sensitivity.get(parameter_kind(name), 0.0)
            sigma[name] = math.hypot(scale_sigma, factor * mean_scale_sigma)

    @property
    def _comparison_sigma(self) -> float:
        """Standard deviation of one comparison of predicted and measured force, N."""
        return self.law.comparison_sigma_ratio * self.law.force_max

    def _prior_rows(self, names: Sequence[ParameterName]) -> FloatArray:
        """Return the rows of the prior, for parameters in units of their prior standard deviation."""
        rows = np.eye(len(names))
        if "payload" in names:
            scale_sum_row = [SCALE_SUM_WEIGHT * (parameter_kind(name) == "scale") for name in names]
            rows = np.vstack([rows, scale_sum_row])
        return rows

    def _excited_names(self, rows: FloatArray) -> list[ParameterName]:
        """Return the parameters that affect the force.

        A solution must omit all others, or the prior on the sum of the scales would determine them.
        """
        is_excited = np.any(rows[:, :-1], axis=0).tolist()
        return [name for name, excited in zip(self._names, is_excited, strict=True) if excited]

    def _column_indices(self, names: Sequence[ParameterName]) -> list[int]:
        """Return the columns of given parameters in the information rows."""
        return [self._names.index(name) for name in names]

    def _solve_values(self, rows: FloatArray, names: Sequence[ParameterName]) -> dict[ParameterName, float]:
        """Solve for some parameters with their priors and within their bounds; all others are 0."""
        values = dict.fromkeys(self.law.names, 0.0)
        if not names:
            return values
        prior_sigma = np.array([self.prior_sigma[name] for name in names])
        bound = np.minimum(
            MAX_SIGMA * prior_sigma, [PARAMETER_LIMITS[parameter_kind(name)] for name in names]
        )
        prior_rows = self._prior_rows(names)
        matrix = np.vstack([prior_sigma * rows[:, self._column_indices(names)], prior_rows])
        rhs = np.concatenate([rows[:, -1], np.zeros(len(prior_rows))])
        solution = np.clip(prior_sigma * np.linalg.lstsq(matrix, rhs)[0], -bound, bound).tolist()
        solved = {name: round_to_grid(name, v) for name, v in zip(names, solution, strict=True)}
        return values | solved

    def _posterior_sigma(
        self, rows: FloatArray, names: Sequence[ParameterName], residual_N: float
    ) -> dict[ParameterName, float]:
        """Return posterior standard deviations, increased if the residual is above the assumed one."""
        prior_sigma = np.array([self.prior_sigma[name] for name in names])
        root = prior_sigma * rows[:, self._column_indices(names)]
        weight = self._comparison_sigma / max(residual_N, self._comparison_sigma)
        matrix = np.vstack([weight * root, self._prior_rows(names)])
        sigma = prior_sigma * np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
        return dict(zip(names, sigma.tolist(), strict=True))

    def _info_rows(self, motion: Motion, values: Mapping[ParameterName, float], *, exact: bool) -> FloatArray:
        """Return the information rows ``[J | z]`` of a motion, linearised at given values."""
        jacobian, predicted_N = self._jacobian_and_force(motion, values, exact=exact)
        point = np.array([values[name] for name in self._names])
        rhs = motion.measured_force[motion.compared_indices] - predicted_N + jacobian @ point
        return np.column_stack([jacobian, rhs]) / self._comparison_sigma

    def _jacobian_and_force(
        self, motion: Motion, values: Mapping[ParameterName, float], *, exact: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return the Jacobian of the force along a path, and the predicted force.

        A change of the loop width needs a new fit of the hysteresis model. To save time, the
        derivatives use two cached fits: the identified loop and a wider one. The predicted force is
        extrapolated from them unless ``exact`` is true.
        """

        def predict(changed_values: Mapping[ParameterName, float]) -> FloatArray:
            return self.law.net_force(motion, {**values, **changed_values})[motion.compared_indices]

        width_names = [name for name in self._names if parameter_kind(name) == "width"]
        original_width = dict.fromkeys(width_names, 0.0)
        base_N = predict(original_width)
        jacobian = np.zeros((base_N.size, len(self._names)))
        for column, name in enumerate(self._names):
            if name in motion.force_per_unit:
                jacobian[:, column] = motion.force_per_unit[name][motion.compared_indices]
            elif self.law.is_excited(motion, name):
                step = DERIVATIVE_STEPS[parameter_kind(name)]
                changed = {name: step if name in width_names else values[name] + step}
                jacobian[:, column] = (predict({**original_width, **changed}) - base_N) / step
        if exact:
            return jacobian, predict({})
        width_force_N = jacobian[:, self._column_indices(width_names)] @ [
            values[name] for name in width_names
        ]
        return jacobian, base_N + width_force_N


def calibrate_running_stage(
    setup: StageSetup, magnet: IdentifiedMagnet, gains: Feedforward, seed: int
) -> ParameterEstimator | None:
    """Run the training scans of a stage with online calibration; return None for any other stage."""
    rig, method = setup.rig, setup.method
    if not rig.settings.tracking.calibrate or method not in CALIBRATABLE_METHODS:
        return None
    estimator = ParameterEstimator(StageLaw(rig, magnet, method), FORGETTING_TIME_S)
    training = scan_motion(rig.settings.scan, rig.settings.scan.train_m_per_s2)
    for scan in range(TRAINING_SCANS):
        estimator.run_and_update(setup.drift, training, gains, seed + scan)
    return estimator


def calibrate_from_motions(law: MotionLaw, motions: Sequence[Motion]) -> CalibratedMethod:
    """Estimate the parameters of a method from motions; those without excitation stay 0.

    The estimates of a law that is wrong in kind are rejected if estimates from half of the motions
    do not explain the other half, and explain it less than no estimates do.
    """
    estimator = _estimate(law, motions)
    calibration = estimator.calibration
    if law.is_right_in_kind or not calibration.is_applied:
        return calibration
    residual_N, plain_residual_N = _withheld_residuals(law, motions)
    if residual_N < plain_residual_N or estimator.is_explained(residual_N, calibration.force_N):
        return calibration
    reason = (
        f"in halves of the motion that are withheld, {residual_N:.2g} N remain, "
        f"and {plain_residual_N:.2g} N without estimates"
    )
    return calibration.model_copy(update={"fits": False, "reason": reason})


def _estimate(law: MotionLaw, motions: Sequence[Motion]) -> ParameterEstimator:
    """Return an estimator that has processed motions."""
    estimator = ParameterEstimator(law)
    for motion in motions:
        estimator.update(motion)
    return estimator


def _withheld_residuals(law: MotionLaw, motions: Sequence[Motion]) -> tuple[float, float]:
    """Return the rms residuals in withheld halves of motions, with estimates and without, N.

    The parameters are estimated from the first half of the comparisons of each motion and compared
    with the second half, and vice versa.
    """
    halves: tuple[list[Motion], list[Motion]] = [], []
    for motion in motions:
        if (indices := motion.compared_indices).size:
            middle = int(indices[indices.size // 2]) // motion.comparisons_per_tick
            first_columns = {name: values[:middle] for name, values in motion.columns.items()}
            halves[0].append(law.make_motion(first_columns))
            halves[1].append(law.make_motion(motion.columns, middle))
    no_estimate = dict.fromkeys(law.names, 0.0)
    residuals, plain_residuals = list[FloatArray](), list[FloatArray]()
    for estimated, withheld in (halves, halves[::-1]):
        estimate = _estimate(law, estimated).estimate
        residuals += [law.residual(motion, estimate) for motion in withheld]
        plain_residuals += [law.residual(motion, no_estimate) for motion in withheld]
    return rms(np.concatenate(residuals)), rms(np.concatenate(plain_residuals))
