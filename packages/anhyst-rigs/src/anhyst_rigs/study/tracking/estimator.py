"""What motion teaches of the magnets of a stage: mass times acceleration is a force sensor.

What a law and the motion differ by is explained by a few numbers, each held by the standard
deviation that the rig file states. One estimator takes in one motion after another: recordings, or
a stage that works.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

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
"""Standard deviations within which a parameter stays."""
GAUSS_NEWTON_STEPS = 3
"""Linear fits, each around the last."""
FORGETTING_TIME_S = 20.0
"""Time of asked force in which a stage that works forgets to a third (1/e) what a motion taught."""
MAX_UPDATE_RATE_SIGMA_PER_S = 2.0
"""Standard deviations a second by which what is applied follows the estimate."""
DERIVATIVE_STEPS: Mapping[str, float] = {
    "scale": 0.005,
    "gap_zero_m": 2e-6,
    "width": 0.1,
    "lag_s": 25e-6,
}
"""By which a parameter of a magnet is moved for its derivative along the path."""
MAX_RESIDUAL_RATIO = 0.01
"""Of the moving force: what any motion leaves that is worth learning from, root mean square."""
GATE_RATIO, MIN_GATE_RATIO = 2.5, 0.001
"""A motion of which the estimate leaves so many times what it left so far teaches nothing: its plant,
or a sensor, is not what it was. Of less than that part of the force any law may be wrong."""
SCALE_SUM_WEIGHT = 20.0
"""Where a payload is learnt, the sum of all scales is held at 0 so many times harder than each: the
scale of force is as good as the currents then, for what a law has slightly wrong would move it."""
MASS_PRIOR_SIGMA, MIN_MASS_CHANGE = 0.3, 0.01
"""Standard deviation of another mass, where a motion is refused; of less than a hundredth nothing is
said, since scales of currents explain as much."""


class ParameterEstimator:
    """What the motions of a stage taught of one method so far: a square-root information filter.

    Rows ``root*numbers = right`` sum up all motions, of the standard deviation of a comparison. The
    prior is added whenever they are solved, so that what fades falls back to it, and no uncertainty
    grows beyond it. They fade with the time in which force was asked for: never at rest.
    """

    def __init__(self, law: MotionLaw, forgetting_time_s: float = math.inf) -> None:
        self.law, self.forgetting_time_s = law, forgetting_time_s
        self.prior_sigma = {name: law.prior_sigma(name) for name in law.names}
        self.estimate = dict.fromkeys(law.names, 0.0)  # the estimate
        self.applied_values = dict(self.estimate)  # follows it at a bounded rate
        self.noise_N = 0.0  # of the force of the motions, from the noise of the position
        self.mass_kg: float | None = None  # explains the last motion that was refused
        self.rejected_count = 0  # motions that the law did not explain: nothing was taken of them
        self._names = [name for name in law.estimable_names if self.prior_sigma[name] > 0.0]
        self.identified: list[ParameterName] = []  # what the motions move
        self._information = np.zeros((0, len(self._names) + 1))
        # comparisons, squares of the force that moved and of what was left of it
        self._sums = np.zeros(3)

    def copy_without_data(self) -> ParameterEstimator:
        """Return one that has learnt nothing and goes on from what is applied."""
        other = ParameterEstimator(self.law, self.forgetting_time_s)
        other.applied_values = dict(self.applied_values)
        return other

    def update(self, motion: Motion) -> bool:
        """Take a motion in; return whether it taught anything: rest does not, nor does a fault."""
        compared = motion.compared_indices
        if not compared.size:
            return False
        force_N, self.noise_N = motion.force_rms, motion.force_noise
        retention = math.exp(
            -compared.size
            / (motion.comparisons_per_tick * COMPARISON_RATE_HZ * self.forgetting_time_s)
        )
        history, values = math.sqrt(retention) * self._information, self.estimate
        limit_N = GATE_RATIO * max(self._force_and_residual_rms[1], MIN_GATE_RATIO * force_N)
        if self.identified and (gate_residual_N := self._residual_rms(motion, values)) > limit_N:
            motion_rows = self._linearise(motion, values, exact=True)
            # along one coordinate, every motion shows the same
            sigma_N = (
                self._prediction_sigma(history, motion_rows)
                if motion.comparisons_per_tick > 1
                else 0.0
            )
            if gate_residual_N > math.hypot(limit_N, GATE_RATIO * sigma_N):
                return self._reject(motion, history, motion_rows)
        for step in range(GAUSS_NEWTON_STEPS):
            motion_rows = self._linearise(motion, values, exact=step == GAUSS_NEWTON_STEPS - 1)
            information = np.asarray(np.linalg.qr(np.vstack([history, motion_rows]), mode="r"))
            excited = self._excited_names(information)
            values = self._solve(information, excited)
        sigma = self._posterior_sigma(information, excited, 0.0)
        identified = [
            name
            for name in excited
            if sigma[name] <= self.law.max_sigma_ratio * self.prior_sigma[name]
        ]
        values = self._solve(information, identified)
        residual_N = self._residual_rms(motion, values)
        sums = compared.size * np.array([1.0, force_N**2, residual_N**2])
        scales = [name for name in self._names if parameter_kind(name) == "scale"]
        has_scale_at_bound = any(
            abs(values[name]) > 0.999 * MAX_SIGMA * self.prior_sigma[name] > 0.0 for name in scales
        )
        if has_scale_at_bound or residual_N > math.hypot(
            MAX_RESIDUAL_RATIO * force_N, self.noise_N
        ):
            self._sums = self._sums if self.identified else sums
            return self._reject(motion, history, motion_rows)
        earlier_sums = retention * self._sums if self.identified else 0.0
        self.estimate, self.identified, self._information, self._sums = (
            values,
            identified,
            information,
            sums + earlier_sums,
        )
        self.mass_kg = None
        return bool(identified)

    def _reject(self, motion: Motion, history: FloatArray, motion_rows: FloatArray) -> bool:
        """Take nothing of a motion, and look whether another mass explains it."""
        self.rejected_count += 1
        force_per_mass = motion.force_per_unit["payload"][motion.compared_indices]
        prior_sigma = np.array(
            [*(self.prior_sigma[name] for name in self._names), MASS_PRIOR_SIGMA]
        )
        old_rows = np.insert(history, -1, 0.0, axis=1)
        new_rows = np.insert(motion_rows, -1, force_per_mass / self._comparison_sigma, axis=1)
        matrix = np.vstack(
            [
                old_rows[:, :-1] * prior_sigma,
                new_rows[:, :-1] * prior_sigma,
                np.eye(prior_sigma.size),
            ]
        )
        rhs = np.concatenate([old_rows[:, -1], new_rows[:, -1], np.zeros(prior_sigma.size)])
        solution = prior_sigma * np.linalg.lstsq(matrix, rhs)[0]
        residual_N = self._comparison_sigma * rms(new_rows[:, -1] - new_rows[:, :-1] @ solution)
        relative_change = float(
            solution[[name == "payload" for name in self._names] + [True]].sum()
        )
        is_explained = self._is_explained(residual_N, motion.force_rms)
        mass_kg = self.law.rig.settings.body.mass_kg * (1.0 + relative_change)
        self.mass_kg = mass_kg if is_explained and abs(relative_change) > MIN_MASS_CHANGE else None
        return False

    def _residual_rms(self, motion: Motion, values: Mapping[ParameterName, float]) -> float:
        """Return the force of a motion that is not explained by some numbers, rms, N."""
        return rms(
            (motion.measured_force - self.law.net_force(motion, values))[motion.compared_indices]
        )

    def _prediction_sigma(self, history: FloatArray, motion_rows: FloatArray) -> float:
        """Return the force of a motion that what is not known yet may explain, rms, N."""
        prior_sigma = np.array([self.prior_sigma[name] for name in self._names])
        matrix = np.vstack([history[:, :-1] * prior_sigma, self._prior_rows(self._names)])
        root = np.asarray(np.linalg.qr(matrix, mode="r"))
        spread = np.linalg.solve(root.T, (motion_rows[:, :-1] * prior_sigma).T)
        return self._comparison_sigma * math.sqrt(float((spread**2).sum(axis=0).mean()))

    def information_rows(self, run: Recording) -> FloatArray:
        """Return what a run shows of the numbers around the estimate, in rows; none of a lost one."""
        motion = self.law.make_motion(run.columns)
        if run.loss is not None or not motion.compared_indices.size:
            return self._information[:0]
        rows = self._linearise(motion, self.estimate, exact=False)
        return np.asarray(np.linalg.qr(rows, mode="r"))

    def relative_sigma(self, *rows: FloatArray) -> dict[ParameterName, float]:
        """Return what is left of each number in parts of its prior, once such rows are taken in."""
        stacked = np.vstack([self._information, *rows])
        sigma = self._posterior_sigma(stacked, self._excited_names(stacked), 0.0)
        return {
            name: sigma.get(name, self.prior_sigma[name]) / self.prior_sigma[name]
            for name in self._names
        }

    def condition_number(self, *rows: FloatArray) -> float:
        """Return the condition number of the information of what they show, scaled by the priors."""
        names = [
            name
            for name, ratio in self.relative_sigma(*rows).items()
            if ratio <= self.law.max_sigma_ratio
        ]
        prior_sigma = np.array([self.prior_sigma[name] for name in names])
        # of the prior the sum of all scales alone, which no motion tells from a payload
        scale_sum_row = self._prior_rows(names)[len(names) :]
        scaled_rows = (
            prior_sigma * np.vstack([self._information, *rows])[:, self._column_indices(names)]
        )
        return (
            float(np.linalg.cond(np.vstack([scaled_rows, scale_sum_row]))) ** 2
            if names
            else math.inf
        )

    def follow_estimate(self, seconds: float) -> None:
        """Let what is applied follow the estimate for some time; it stays where that does not fit."""
        if not self._law_fits:
            return
        for name, target in self.estimate.items():
            max_change = MAX_UPDATE_RATE_SIGMA_PER_S * self.prior_sigma[name] * seconds
            change = min(max(target - self.applied_values[name], -max_change), max_change)
            self.applied_values[name] = round_to_grid(name, self.applied_values[name] + change)

    def corrected_stage(self, drift: Drift = NO_DRIFT) -> StageSetup:
        """Return the stage that is corrected by what is applied; its plant may have drifted."""
        assert isinstance(self.law, StageLaw)
        return self.law.corrected_stage(
            self._calibrated_method(self.applied_values, fits=True), drift
        )

    def run_and_update(
        self, drift: Drift, set_point: SetPoint, gains: Feedforward, seed: int
    ) -> Recording:
        """Follow a set-point with what is applied, and learn from it."""
        run = track(self.corrected_stage(drift), set_point, gains, seed)
        if run.loss is None:
            self.update(self.law.make_motion(run.columns))
            self.follow_estimate(set_point.duration)
        return run

    @property
    def calibration(self) -> CalibratedMethod:
        """What was found."""
        return self._calibrated_method(self.estimate, self._law_fits)

    def _is_explained(self, residual_N: float, force_N: float) -> bool:
        """Whether a law leaves no more than one of the right kind does, N of a moving force."""
        return residual_N <= math.hypot(self.law.max_residual_ratio * force_N, self.noise_N)

    @property
    def _law_fits(self) -> bool:
        force_N, residual_N = self._force_and_residual_rms
        return force_N > 0.0 and self._is_explained(residual_N, force_N)

    def _calibrated_method(
        self, values: Mapping[ParameterName, float], fits: bool
    ) -> CalibratedMethod:
        force_N, residual_N = self._force_and_residual_rms
        sigma = self._posterior_sigma(self._information, self.identified, residual_N)
        if "payload" in sigma:  # the sum of both scales was held, and nothing tells it
            count = sum(parameter_kind(name) == "scale" for name in self._names)
            mean_scale_sigma = self.prior_sigma["scale_1"] / math.sqrt(count)
            added_sigma = {"payload": 2.0 * mean_scale_sigma, "scale": mean_scale_sigma}
            for name, own_sigma in sigma.items():
                sigma[name] = math.hypot(own_sigma, added_sigma.get(parameter_kind(name), 0.0))
        return CalibratedMethod(
            name=self.law.method,
            residual_N=residual_N,
            force_N=force_N,
            fits=fits,
            refused=self.rejected_count,
            mass_kg=self.mass_kg,
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

    @property
    def _force_and_residual_rms(self) -> tuple[float, float]:
        """Force of the motions, and what was left of it when each was taken in, rms, N."""
        count, force_squares, residual_squares = self._sums.tolist()
        return math.sqrt(force_squares / max(count, 1.0)), math.sqrt(
            residual_squares / max(count, 1.0)
        )

    @property
    def _comparison_sigma(self) -> float:
        return self.law.comparison_sigma_ratio * self.law.force_max

    def _prior_rows(self, names: Sequence[ParameterName]) -> FloatArray:
        """Return rows that hold numbers, in standard deviations of them."""
        rows = np.eye(len(names))
        if "payload" in names:
            rows = np.vstack(
                [rows, [SCALE_SUM_WEIGHT * (parameter_kind(name) == "scale") for name in names]]
            )
        return rows

    def _excited_names(self, rows: FloatArray) -> list[ParameterName]:
        """Return what moves anything: of others the sum of all scales would tell something."""
        is_excited = np.any(rows[:, :-1], axis=0).tolist()
        return [name for name, excited in zip(self._names, is_excited, strict=True) if excited]

    def _column_indices(self, names: Sequence[ParameterName]) -> list[int]:
        return [self._names.index(name) for name in names]

    def _solve(
        self, rows: FloatArray, names: Sequence[ParameterName]
    ) -> dict[ParameterName, float]:
        """Solve for some of the numbers, held by the prior and within its bounds; 0 are the others."""
        if not names:
            return dict.fromkeys(self.law.names, 0.0)
        prior_sigma = np.array([self.prior_sigma[name] for name in names])
        bound = np.minimum(
            MAX_SIGMA * prior_sigma, [PARAMETER_LIMITS[parameter_kind(name)] for name in names]
        )
        prior_rows = self._prior_rows(names)
        matrix = np.vstack([prior_sigma * rows[:, self._column_indices(names)], prior_rows])
        rhs = np.concatenate([rows[:, -1], np.zeros(len(prior_rows))])
        solution = np.clip(prior_sigma * np.linalg.lstsq(matrix, rhs)[0], -bound, bound).tolist()
        solved = dict(zip(names, map(round_to_grid, names, solution), strict=True))
        return dict.fromkeys(self.law.names, 0.0) | solved

    def _posterior_sigma(
        self, rows: FloatArray, names: Sequence[ParameterName], residual_N: float
    ) -> dict[ParameterName, float]:
        """Return the standard deviations that are left, where so much is missed, N."""
        prior_sigma = np.array([self.prior_sigma[name] for name in names])
        root = prior_sigma * rows[:, self._column_indices(names)]
        matrix = np.vstack(
            [
                self._comparison_sigma / max(residual_N, self._comparison_sigma) * root,
                self._prior_rows(names),
            ]
        )
        sigma = prior_sigma * np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
        return dict(zip(names, sigma.tolist(), strict=True))

    def _linearise(
        self, motion: Motion, values: Mapping[ParameterName, float], *, exact: bool
    ) -> FloatArray:
        """Return what a motion says of the numbers, around some values of them.

        Paths are those of the law as it was fitted and of one with a wider loop, which are kept;
        exactly, the force is that of a law fitted anew.
        """

        def predict(changed: Mapping[ParameterName, float]) -> FloatArray:
            return self.law.net_force(motion, {**values, **changed})[motion.compared_indices]

        widths = [name for name in self._names if parameter_kind(name) == "width"]
        fitted_width = dict.fromkeys(widths, 0.0)
        base_N = predict(fitted_width)
        jacobian = np.zeros((base_N.size, len(self._names)))
        for column, name in enumerate(self._names):
            if name in motion.force_per_unit:
                jacobian[:, column] = motion.force_per_unit[name][motion.compared_indices]
                continue
            if not self.law.is_excited(motion, name):
                continue
            step = DERIVATIVE_STEPS[parameter_kind(name)]
            changed = fitted_width | {name: step if name in widths else values[name] + step}
            jacobian[:, column] = (predict(changed) - base_N) / step
        width_force_N = jacobian[:, self._column_indices(widths)] @ [
            values[name] for name in widths
        ]
        predicted_N = predict({}) if exact else base_N + width_force_N
        point = np.array([values[name] for name in self._names])
        rhs = motion.measured_force[motion.compared_indices] - predicted_N + jacobian @ point
        return np.column_stack([jacobian, rhs]) / self._comparison_sigma


TRAINING_SCANS = 4
"""Training set-points from which a stage that works learns before it is judged."""


def calibrate_running_stage(
    setup: StageSetup, magnet: IdentifiedMagnet, gains: Feedforward, seed: int
) -> ParameterEstimator | None:
    """Let a stage that calibrates itself follow the training set-point; None where it does not."""
    rig, method = setup.rig, setup.method
    if not rig.settings.tracking.calibrate or method not in CALIBRATABLE_METHODS:
        return None
    estimator = ParameterEstimator(StageLaw(rig, magnet, method), FORGETTING_TIME_S)
    training = scan_motion(rig.settings.scan, rig.settings.scan.train_m_per_s2)
    for scan in range(TRAINING_SCANS):
        estimator.run_and_update(setup.drift, training, gains, seed + scan)
    return estimator


def calibrate_from_motions(law: MotionLaw, motions: Sequence[Motion]) -> CalibratedMethod:
    """Find the numbers with which a law explains motions best; what is not seen stays where it was."""
    estimator = ParameterEstimator(law)
    for motion in motions:
        estimator.update(motion)
    return estimator.calibration
