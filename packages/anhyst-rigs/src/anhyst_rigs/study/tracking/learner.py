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
    LIMITS,
    CalibratedMethod,
    LearntParameter,
    ParameterName,
    kind_of,
)
from anhyst_rigs.rig.drift import NO_DRIFT, Drift
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from anhyst_rigs.rig.stage.setpoint import SetPoint, motion_of
from anhyst_rigs.study.tracking.bodies import LEARNT, StageLaw
from anhyst_rigs.study.tracking.motion import UPDATES_HZ, Motion, MotionLaw, on_grid

MOST = 4.0
"""Standard deviations within which a parameter stays."""
PASSES = 3
"""Linear fits, each around the last."""
FORGET_S = 20.0
"""Time of asked force in which a stage that works forgets to a third (1/e) what a motion taught."""
RATE = 2.0
"""Standard deviations a second by which what is applied follows the estimate."""
STEPS: Mapping[str, float] = {"scale": 0.005, "gap_zero_m": 2e-6, "width": 0.1, "lag_s": 25e-6}
"""By which a parameter of a magnet is moved for its derivative along the path."""
FAULT = 0.01
"""Of the moving force: what any motion leaves that is worth learning from, root mean square."""
GROWN, LEFT = 2.5, 0.001
"""A motion of which the estimate leaves so many times what it left so far teaches nothing: its plant,
or a sensor, is not what it was. Of less than that part of the force any law may be wrong."""
FIRM = 20.0
"""Where a payload is learnt, the sum of all scales is held at 0 so many times harder than each: the
scale of force is as good as the currents then, for what a law has slightly wrong would move it."""
MASS, LIGHT = 0.3, 0.01
"""Standard deviation of another mass, where a motion is refused; of less than a hundredth nothing is
said, since scales of currents explain as much."""


class Learner:
    """What the motions of a stage taught of one method so far: a square-root information filter.

    Rows ``root*numbers = right`` sum up all motions, of the standard deviation of a comparison. The
    prior is added whenever they are solved, so that what fades falls back to it, and no uncertainty
    grows beyond it. They fade with the time in which force was asked for: never at rest.
    """

    def __init__(self, law: MotionLaw, forget_s: float = math.inf) -> None:
        self.law, self.forget_s = law, forget_s
        self.priors = {name: law.prior(name) for name in law.names}
        self.values = dict.fromkeys(law.names, 0.0)  # the estimate
        self.applied = dict(self.values)  # follows it at a bounded rate
        self.noise_N = 0.0  # of the force of the motions, from the noise of the position
        self.mass_kg: float | None = None  # explains the last motion that was refused
        self.refused = 0  # motions that the law did not explain: nothing was taken of them
        self._names = [name for name in law.moved if self.priors[name] > 0.0]
        self.seen: list[ParameterName] = []  # what the motions move
        self._rows = np.zeros((0, len(self._names) + 1))
        # comparisons, squares of the force that moved and of what was left of it
        self._sums = np.zeros(3)

    def afresh(self) -> Learner:
        """Return one that has learnt nothing and goes on from what is applied."""
        other = Learner(self.law, self.forget_s)
        other.applied = dict(self.applied)
        return other

    def learn(self, motion: Motion) -> bool:
        """Take a motion in; return whether it taught anything: rest does not, nor does a fault."""
        compared = motion.compared
        if not compared.size:
            return False
        force, self.noise_N = motion.force, motion.noise
        faded = math.exp(-compared.size / (motion.rows * UPDATES_HZ * self.forget_s))
        before, values = math.sqrt(faded) * self._rows, self.values
        known = GROWN * max(self._moved_and_missed[1], LEFT * force)
        if self.seen and (off := self._missed(motion, values)) > known:
            fresh = self._rows_of(motion, values, exact=True)
            # along one coordinate, every motion shows the same
            unsure = self._unsure(before, fresh) if motion.rows > 1 else 0.0
            if off > math.hypot(known, GROWN * unsure):
                return self._refuse(motion, before, fresh)
        for turn in range(PASSES):
            fresh = self._rows_of(motion, values, exact=turn == PASSES - 1)
            rows = np.asarray(np.linalg.qr(np.vstack([before, fresh]), mode="r"))
            shown = self._shown(rows)
            values = self._solved(rows, shown)
        left = self._left(rows, shown, 0.0)
        seen = [name for name in shown if left[name] <= self.law.seen * self.priors[name]]
        values = self._solved(rows, seen)
        missed = self._missed(motion, values)
        sums = compared.size * np.array([1.0, force**2, missed**2])
        scales = [name for name in self._names if kind_of(name) == "scale"]
        far = any(abs(values[name]) > 0.999 * MOST * self.priors[name] > 0.0 for name in scales)
        if far or missed > math.hypot(FAULT * force, self.noise_N):
            self._sums = self._sums if self.seen else sums
            return self._refuse(motion, before, fresh)
        explained = faded * self._sums if self.seen else 0.0
        self.values, self.seen, self._rows, self._sums = values, seen, rows, sums + explained
        self.mass_kg = None
        return bool(seen)

    def _refuse(self, motion: Motion, before: FloatArray, fresh: FloatArray) -> bool:
        """Take nothing of a motion, and look whether another mass explains it."""
        self.refused += 1
        heavy = motion.by_body["payload"][motion.compared]
        held = np.array([*(self.priors[name] for name in self._names), MASS])
        known = np.insert(before, -1, 0.0, axis=1)
        new = np.insert(fresh, -1, heavy / self._trust, axis=1)
        whole = np.vstack([known[:, :-1] * held, new[:, :-1] * held, np.eye(held.size)])
        right = np.concatenate([known[:, -1], new[:, -1], np.zeros(held.size)])
        solution = held * np.linalg.lstsq(whole, right)[0]
        missed = self._trust * rms(new[:, -1] - new[:, :-1] @ solution)
        heavier = float(solution[[name == "payload" for name in self._names] + [True]].sum())
        explained = self._explains(missed, motion.force)
        mass = self.law.rig.settings.body.mass_kg * (1.0 + heavier)
        self.mass_kg = mass if explained and abs(heavier) > LIGHT else None
        return False

    def _missed(self, motion: Motion, values: Mapping[ParameterName, float]) -> float:
        """Return the force of a motion that is not explained by some numbers, rms, N."""
        return rms((motion.pushed - self.law.net(motion, values))[motion.compared])

    def _unsure(self, before: FloatArray, fresh: FloatArray) -> float:
        """Return the force of a motion that what is not known yet may explain, rms, N."""
        held = np.array([self.priors[name] for name in self._names])
        whole = np.vstack([before[:, :-1] * held, self._prior(self._names)])
        root = np.asarray(np.linalg.qr(whole, mode="r"))
        spread = np.linalg.solve(root.T, (fresh[:, :-1] * held).T)
        return self._trust * math.sqrt(float((spread**2).sum(axis=0).mean()))

    def information(self, run: Recording) -> FloatArray:
        """Return what a run shows of the numbers around the estimate, in rows; none of a lost one."""
        motion = self.law.motion(run.columns)
        if run.loss is not None or not motion.compared.size:
            return self._rows[:0]
        rows = self._rows_of(motion, self.values, exact=False)
        return np.asarray(np.linalg.qr(rows, mode="r"))

    def left(self, *rows: FloatArray) -> dict[ParameterName, float]:
        """Return what is left of each number in parts of its prior, once such rows are taken in."""
        whole = np.vstack([self._rows, *rows])
        left = self._left(whole, self._shown(whole), 0.0)
        return {name: left.get(name, self.priors[name]) / self.priors[name] for name in self._names}

    def condition(self, *rows: FloatArray) -> float:
        """Return the condition number of the information of what they show, scaled by the priors."""
        names = [name for name, one in self.left(*rows).items() if one <= self.law.seen]
        held = np.array([self.priors[name] for name in names])
        # of the prior the sum of all scales alone, which no motion tells from a payload
        sums = self._prior(names)[len(names) :]
        seen = held * np.vstack([self._rows, *rows])[:, self._columns(names)]
        return float(np.linalg.cond(np.vstack([seen, sums]))) ** 2 if names else math.inf

    def step(self, seconds: float) -> None:
        """Let what is applied follow the estimate for some time; it stays where that does not fit."""
        if not self._fits:
            return
        for name, wanted in self.values.items():
            most = RATE * self.priors[name] * seconds
            change = min(max(wanted - self.applied[name], -most), most)
            self.applied[name] = on_grid(name, self.applied[name] + change)

    def stage(self, drift: Drift = NO_DRIFT) -> StageSetup:
        """Return the stage that is corrected by what is applied; its plant may have drifted."""
        assert isinstance(self.law, StageLaw)
        return self.law.stage(self._method(self.applied, fits=True), drift)

    def work(self, drift: Drift, motion: SetPoint, gains: Feedforward, seed: int) -> Recording:
        """Follow a set-point with what is applied, and learn from it."""
        run = track(self.stage(drift), motion, gains, seed)
        if run.loss is None:
            self.learn(self.law.motion(run.columns))
            self.step(motion.duration)
        return run

    @property
    def found(self) -> CalibratedMethod:
        """What was found."""
        return self._method(self.values, self._fits)

    def _explains(self, missed: float, force: float) -> bool:
        """Whether a law leaves no more than one of the right kind does, N of a moving force."""
        return missed <= math.hypot(self.law.leaves * force, self.noise_N)

    @property
    def _fits(self) -> bool:
        moved, missed = self._moved_and_missed
        return moved > 0.0 and self._explains(missed, moved)

    def _method(self, values: Mapping[ParameterName, float], fits: bool) -> CalibratedMethod:
        moved, missed = self._moved_and_missed
        left = self._left(self._rows, self.seen, missed)
        if "payload" in left:  # the sum of both scales was held, and nothing tells it
            count = sum(kind_of(name) == "scale" for name in self._names)
            of_mean = self.priors["scale_1"] / math.sqrt(count)
            shares = {"payload": 2.0 * of_mean, "scale": of_mean}
            for name, one in left.items():
                left[name] = math.hypot(one, shares.get(kind_of(name), 0.0))
        return CalibratedMethod(
            name=self.law.method,
            residual_N=missed,
            force_N=moved,
            fits=fits,
            refused=self.refused,
            mass_kg=self.mass_kg,
            parameter=[
                LearntParameter(
                    name=name,
                    value=values[name],
                    sigma=left.get(name, self.priors[name]),
                    prior=self.priors[name],
                    frozen=name not in self.seen,
                )
                for name in self.law.names
                if self.priors[name] > 0.0
            ],
        )

    @property
    def _moved_and_missed(self) -> tuple[float, float]:
        """Force of the motions, and what was left of it when each was taken in, rms, N."""
        count, moved, missed = self._sums.tolist()
        return math.sqrt(moved / max(count, 1.0)), math.sqrt(missed / max(count, 1.0))

    @property
    def _trust(self) -> float:
        return self.law.trust * self.law.force_max

    def _prior(self, names: Sequence[ParameterName]) -> FloatArray:
        """Return rows that hold numbers, in standard deviations of them."""
        rows = np.eye(len(names))
        if "payload" in names:
            rows = np.vstack([rows, [FIRM * (kind_of(name) == "scale") for name in names]])
        return rows

    def _shown(self, rows: FloatArray) -> list[ParameterName]:
        """Return what moves anything: of others the sum of all scales would tell something."""
        moves = np.any(rows[:, :-1], axis=0).tolist()
        return [name for name, moved in zip(self._names, moves, strict=True) if moved]

    def _columns(self, names: Sequence[ParameterName]) -> list[int]:
        return [self._names.index(name) for name in names]

    def _solved(
        self, rows: FloatArray, names: Sequence[ParameterName]
    ) -> dict[ParameterName, float]:
        """Solve for some of the numbers, held by the prior and within its bounds; 0 are the others."""
        if not names:
            return dict.fromkeys(self.law.names, 0.0)
        held = np.array([self.priors[name] for name in names])
        far = np.minimum(MOST * held, [LIMITS[kind_of(name)] for name in names])
        known = self._prior(names)
        whole = np.vstack([held * rows[:, self._columns(names)], known])
        right = np.concatenate([rows[:, -1], np.zeros(len(known))])
        solution = np.clip(held * np.linalg.lstsq(whole, right)[0], -far, far).tolist()
        solved = dict(zip(names, map(on_grid, names, solution), strict=True))
        return dict.fromkeys(self.law.names, 0.0) | solved

    def _left(
        self, rows: FloatArray, names: Sequence[ParameterName], missed: float
    ) -> dict[ParameterName, float]:
        """Return the standard deviations that are left, where so much is missed, N."""
        held = np.array([self.priors[name] for name in names])
        root = held * rows[:, self._columns(names)]
        whole = np.vstack([self._trust / max(missed, self._trust) * root, self._prior(names)])
        left = held * np.sqrt(np.diag(np.linalg.inv(whole.T @ whole)))
        return dict(zip(names, left.tolist(), strict=True))

    def _rows_of(
        self, motion: Motion, values: Mapping[ParameterName, float], *, exact: bool
    ) -> FloatArray:
        """Return what a motion says of the numbers, around some values of them.

        Paths are those of the law as it was fitted and of one with a wider loop, which are kept;
        exactly, the force is that of a law fitted anew.
        """

        def force(changed: Mapping[ParameterName, float]) -> FloatArray:
            return self.law.net(motion, {**values, **changed})[motion.compared]

        widths = [name for name in self._names if kind_of(name) == "width"]
        narrow = dict.fromkeys(widths, 0.0)
        flat = force(narrow)
        slopes = np.zeros((flat.size, len(self._names)))
        for index, name in enumerate(self._names):
            if name in motion.by_body:
                slopes[:, index] = motion.by_body[name][motion.compared]
                continue
            if not self.law.shows(motion, name):
                continue
            step = STEPS[kind_of(name)]
            moved = narrow | {name: step if name in widths else values[name] + step}
            slopes[:, index] = (force(moved) - flat) / step
        wider = slopes[:, self._columns(widths)] @ [values[name] for name in widths]
        expected = force({}) if exact else flat + wider
        now = np.array([values[name] for name in self._names])
        right = motion.pushed[motion.compared] - expected + slopes @ now
        return np.column_stack([slopes, right]) / self._trust


WORK = 4
"""Training set-points from which a stage that works learns before it is judged."""


def at_work(
    setup: StageSetup, magnet: IdentifiedMagnet, gains: Feedforward, seed: int
) -> Learner | None:
    """Let a stage that calibrates itself follow the training set-point; None where it does not."""
    rig, method = setup.rig, setup.method
    if not rig.settings.tracking.calibrate or method not in LEARNT:
        return None
    learner = Learner(StageLaw(rig, magnet, method), FORGET_S)
    training = motion_of(rig.settings.scan, rig.settings.scan.train_m_per_s2)
    for scan in range(WORK):
        learner.work(setup.drift, training, gains, seed + scan)
    return learner


def fit(law: MotionLaw, motions: Sequence[Motion]) -> CalibratedMethod:
    """Find the numbers with which a law explains motions best; what is not seen stays where it was."""
    learner = Learner(law)
    for motion in motions:
        learner.learn(motion)
    return learner.found
