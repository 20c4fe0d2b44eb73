"""What motion teaches of the magnets of a stage: mass times acceleration is a force sensor.

The law of a method follows the currents that were commanded, at the gaps that were read, in the
core's own code; what the body did is its acceleration. Both sides pass the same filter. What they
differ by is explained by a few numbers, each held by the standard deviation that the rig file
states. One estimator takes in one motion after another: recordings, or a stage that works.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from anhyst._core import allocate
from anhyst.compensate.flux_feedback import FluxFeedback
from anhyst.compensate.interface import MethodName
from anhyst.rig.bearing.drift import NO_DRIFT, Drift
from anhyst.rig.bearing.make_setup import IdentifiedMagnet
from anhyst.rig.recording import CURRENTS, MAGNETS, Recording, of_magnets, rms
from anhyst.rig.stage.file import (
    LIMITS,
    CalibratedMethod,
    LearntParameter,
    ParameterName,
    StageRig,
    per_root,
)
from anhyst.rig.stage.loop import PROBES, Feedforward, StageSetup, corrected, fit_method, track
from anhyst.rig.stage.setpoint import SetPoint, motion_of
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

FILTER_HZ = 250.0
"""Corner of the three poles that both sides pass; a twentieth of the ticks at most."""
UPDATES_HZ = 1000.0
"""How often the two sides are compared."""
DEAD = 0.06
"""Nothing is learnt below this part of the largest force: at rest any load would be taken for one."""
TRUST = 0.004
"""Standard deviation of a comparison, in parts of the largest force: what a good law leaves."""
MOST = 4.0
"""Standard deviations within which a parameter stays."""
PASSES = 3
"""Linear fits, each around the last."""
FORGET_S = 20.0
"""Time of asked force in which a stage that works forgets to a third (1/e) what a motion taught."""
RATE = 2.0
"""Standard deviations a second by which what is applied follows the estimate."""
SEEN = 0.7
"""Of its prior standard deviation: a parameter with more left is called not seen."""

_OF_BODY: tuple[ParameterName, ...] = ("bias_N", "payload", "cable_N_per_m")
_OF_IRON: tuple[ParameterName, ...] = ("scale_1", "scale_2", "width", "lag_s", *_OF_BODY)
MOVED: Mapping[MethodName, tuple[ParameterName, ...]] = {
    "single-valued": ("scale_1", "scale_2", "lag_s", *_OF_BODY),
    "play": _OF_IRON,
    "at-rest": _OF_IRON,
    "full": _OF_IRON,
    "flux": ("scale_1", "scale_2", *_OF_BODY),
}
"""What can be learnt of each method. The gap zero is frozen: on one axis it is hardly to be told from
the difference of both scales."""
AMPLIFIER = 16.0
"""Bandwidth that an amplifier must have, in corners of the filter: what it lags is not counted."""
STEPS: Mapping[ParameterName, float] = {
    "scale_1": 0.005,
    "scale_2": 0.005,
    "width": 0.1,
    "lag_s": 25e-6,
}
"""By which a parameter of a magnet is moved for its derivative along the path."""
WIDTHS = 0.005
"""A law is fitted anew for widths on this grid."""
COMMANDS = of_magnets(CURRENTS[:1], 1, MAGNETS)
KIND = 0.0037
"""Of the moving force: what a law of the right kind leaves at most, root mean square."""
FAULT = 0.01
"""The same of anything that is worth learning; where more is left, nothing is taken."""
GROWN, LEFT = 2.5, 0.001
"""A motion of which the estimate leaves so many times what it left so far teaches nothing: its plant,
or a sensor, is not what it was. Of less than that part of the force any law may be wrong."""
FIRM = 20.0
"""Where a payload is learnt, the sum of both scales is held at 0 so many times harder than each: the
scale of force is as good as the currents then, for what a law has slightly wrong would move it."""
MASS, LIGHT = 0.3, 0.01
"""Standard deviation of another mass, where a motion is refused; of less than a hundredth nothing is
said, since scales of currents explain as much."""
PARAMETERS: tuple[ParameterName, ...] = get_args(ParameterName)


def refuse_uncalibratable(rig: StageRig) -> None:
    """Refuse a stage whose motion would teach something else than what its magnets are off by."""
    file, least = rig.settings, AMPLIFIER * FILTER_HZ
    if file.several:
        raise InputError(
            f"{rig.path}: body.free: one coordinate alone is calibrated; name a stage of one",
            code="one-coordinate-only",
            key="body.free",
        )
    if file.amplifier.bandwidth_Hz < least:
        raise InputError(
            f"{rig.path}: amplifier.bandwidth_Hz: is below {least:g} Hz, and its lag would be "
            "taken for the iron's; calibrate with a faster amplifier",
            code="amplifier-too-slow",
            key="amplifier.bandwidth_Hz",
        )


def prior(rig: StageRig, method: MethodName, name: ParameterName) -> float:
    """Return the standard deviation that a rig file states for a parameter."""
    spread = rig.settings.spread
    scale = spread.hall_percent if method == "flux" else spread.current_percent
    return {
        "scale_1": 0.01 * scale,
        "scale_2": 0.01 * scale,
        "gap_zero_m": spread.gap_zero_m,
        "width": 0.01 * spread.pinning_percent,
        "lag_s": spread.eddy_s,
        "bias_N": 0.01 * rig.settings.tracking.force_max_N,
        "payload": 0.01 * spread.payload_percent,
        "cable_N_per_m": spread.cable_N_per_m,
    }[name]


@dataclass(frozen=True)
class Motion:
    """What was read while a stage moved, and what its body did."""

    rig: StageRig
    read: Mapping[str, FloatArray]  # by column
    begin: int = 0  # tick from which on it teaches; before, it only tells what the iron remembers

    @property
    def ticks(self) -> FloatArray:
        """Number of each tick."""
        return np.arange(self.read["demand_N"].size, dtype=np.float64)

    def filtered(self, force: FloatArray, late: float = 0.0) -> FloatArray:
        """Return a force that acts so many ticks late, through the filter of both sides."""
        share = -math.expm1(-2.0 * math.pi * min(FILTER_HZ * self.rig.dt, 0.05))
        passed = np.interp(self.ticks - late, self.ticks, force)
        for _ in range(3):
            passed = lfilter([share], [1.0, share - 1.0], passed)
        return np.asarray(passed)

    @cached_property
    def pushed(self) -> FloatArray:
        """Mass times acceleration, filtered, N."""
        place = self.read["position_read_m"]
        acceleration = np.zeros(place.size)
        acceleration[1:-1] = np.diff(place, 2) / self.rig.dt**2
        return self.filtered(self.rig.settings.body.mass_kg * acceleration)

    @cached_property
    def by_body(self) -> Mapping[ParameterName, FloatArray]:
        """What the numbers of the body push with, for each unit of them, filtered, N."""
        place = self.read["position_read_m"]
        moved = self.filtered(place - place[0])
        return dict(zip(_OF_BODY, (np.ones(place.size), -self.pushed, -moved), strict=True))

    @property
    def noise(self) -> float:
        """Standard deviation of that force from the noise of the position, N."""
        tick = np.zeros(self.ticks.size)
        tick[:3] = 1.0, -2.0, 1.0
        passed = float(np.linalg.norm(self.filtered(tick))) / self.rig.dt**2
        file = self.rig.settings
        return file.body.mass_kg * file.position_sensor.noise_m * passed

    @cached_property
    def compared(self) -> NDArray[np.intp]:
        """Ticks at which both sides are compared: where much is demanded."""
        every = max(1, round(1.0 / (UPDATES_HZ * self.rig.dt)))
        least = DEAD * self.rig.settings.tracking.force_max_N
        asked = np.abs(self.filtered(self.read["demand_N"]))[::every]
        ticks = every * np.flatnonzero(asked > least)
        return ticks[ticks >= self.begin]

    @cached_property
    def rises(self) -> FloatArray:
        """By how much the root of the force of each magnet that was asked for rises in a tick."""
        idle = self.rig.idle
        asked = np.array([allocate(one, idle) for one in self.read["demand_N"].tolist()]).T
        return np.diff(np.sqrt(asked), prepend=0.0)

    @property
    def late(self) -> float:
        """Ticks from a command to its force: dead time and half a tick.

        The integral of an amplifier leaves no lag of what is slower than the filter here.
        """
        dead = self.rig.settings.amplifier.delay_s / self.rig.dt
        return self.rig.settings.timing.delay_ticks + 0.5 + dead


class MotionLaw:
    """A method as it is fitted to the loops, and with other numbers."""

    def __init__(self, rig: StageRig, magnet: IdentifiedMagnet, method: MethodName) -> None:
        self.rig, self.magnet, self.method = rig, magnet, method
        self.compensator = cache(lambda width: fit_method(rig, magnet, method, width))

    def stage(self, found: CalibratedMethod, drift: Drift = NO_DRIFT) -> StageSetup:
        """Return the stage whose controller is corrected by what was found; its plant may drift."""
        return corrected(self.rig, self.compensator(found.value("width")), found, drift)

    def net(self, motion: Motion, values: Mapping[ParameterName, float]) -> FloatArray:
        """Return the net force along a path by the law with some numbers, filtered, N."""
        scales = np.array([[1.0 + values["scale_1"]], [1.0 + values["scale_2"]]])
        if self.method == "flux":
            forces, late = self._by_flux(motion, scales), -self._probe_late
        else:
            forces, late = self._by_currents(motion, scales, values), motion.late
        # the first magnet pulls towards smaller positions
        body = (values[name] * force for name, force in motion.by_body.items())
        return sum(body, motion.filtered(forces[1] - forces[0], late))

    def _by_currents(
        self, motion: Motion, scales: FloatArray, values: Mapping[ParameterName, float]
    ) -> list[FloatArray]:
        read, rig = motion.read, self.rig
        compensator = self.compensator(_on_grid("width", values["width"]))
        lead = values["lag_s"] / rig.dt * self._per_root
        flowed = scales * np.array([read[name] for name in COMMANDS]) - lead * motion.rises
        gap = np.interp(motion.ticks + motion.late, motion.ticks, read["gap_read_m"])
        return [
            compensator.fresh().follow(current, at)
            for current, at in zip(flowed, (gap, self._total - gap), strict=True)
        ]

    def _by_flux(self, motion: Motion, scales: FloatArray) -> list[FloatArray]:
        """Go back the way of the method's calibration: the force goes with the flux density squared.

        Its map has straight lines from force to force, which tells small ones too large.
        """
        found = self.compensator(0.0).parameters
        assert isinstance(found, FluxFeedback)
        of_root = found.wanted[:, -1] / math.sqrt(found.scales.demand)
        gaps = np.linspace(found.scales.gap_low, found.scales.gap_high, of_root.size)
        gap = motion.read["gap_read_m"]
        flux = scales * np.array([motion.read[name] for name in PROBES])
        return [
            (density / np.interp(at, gaps, of_root)) ** 2
            for density, at in zip(flux, (gap, self._total - gap), strict=True)
        ]

    @cached_property
    def _per_root(self) -> float:
        return per_root(self.compensator(0.0), self.rig)

    @property
    def _total(self) -> float:
        total = self.rig.settings.gap_total_m
        assert total is not None
        return total

    @property
    def _probe_late(self) -> float:
        probe = self.rig.settings.hall_probe
        assert probe is not None
        return 1.0 / (2.0 * math.pi * probe.bandwidth_Hz * self.rig.dt)


class Learner:
    """What the motions of a stage taught of one method so far: a square-root information filter.

    Rows ``root*numbers = right`` sum up all motions, of the standard deviation of a comparison. The
    prior is added whenever they are solved, so that what fades falls back to it, and no uncertainty
    grows beyond it. They fade with the time in which force was asked for: never at rest.
    """

    def __init__(self, law: MotionLaw, forget_s: float = math.inf) -> None:
        self.law, self.forget_s = law, forget_s
        self.priors = {name: prior(law.rig, law.method, name) for name in PARAMETERS}
        self.values = dict.fromkeys(PARAMETERS, 0.0)  # the estimate
        self.applied = dict(self.values)  # follows it at a bounded rate
        self.noise_N = 0.0  # of the force of the motions, from the noise of the position
        self.mass_kg: float | None = None  # explains the last motion that was refused
        self.refused = 0  # motions that the law did not explain: nothing was taken of them
        self._names = [name for name in MOVED[law.method] if self.priors[name] > 0.0]
        self.seen: list[ParameterName] = []  # what the motions move
        self._rows = np.zeros((0, len(self._names) + 1))
        # comparisons, squares of the force that moved and of what was left of it
        self._sums = np.zeros(3)

    def learn(self, motion: Motion) -> bool:
        """Take a motion in; return whether it taught anything: rest does not, nor does a fault."""
        compared = motion.compared
        if not compared.size:
            return False
        pushed, self.noise_N = motion.pushed[compared], motion.noise
        faded = math.exp(-compared.size / (UPDATES_HZ * self.forget_s))
        before, values = math.sqrt(faded) * self._rows, self.values
        if self.seen and self._missed(motion, values) > GROWN * max(
            self._moved_and_missed[1], LEFT * rms(pushed)
        ):
            return self._refuse(motion, before, self._rows_of(motion, values, exact=True))
        for turn in range(PASSES):
            fresh = self._rows_of(motion, values, exact=turn == PASSES - 1)
            rows = np.asarray(np.linalg.qr(np.vstack([before, fresh]), mode="r"))
            values = self._solved(rows, self._names)
        left = self._left(rows, self._names, 0.0)
        seen = [name for name in self._names if left[name] <= SEEN * self.priors[name]]
        values = self._solved(rows, seen)
        missed = self._missed(motion, values)
        sums = pushed.size * np.array([1.0, rms(pushed) ** 2, missed**2])
        scales: tuple[ParameterName, ...] = ("scale_1", "scale_2")
        far = any(abs(values[name]) > 0.999 * MOST * self.priors[name] > 0.0 for name in scales)
        if far or missed > math.hypot(FAULT * rms(pushed), self.noise_N):
            self._sums = self._sums if self.seen else sums
            return self._refuse(motion, before, fresh)
        explained = faded * self._sums if self.seen else 0.0
        self.values, self.seen, self._rows, self._sums = values, seen, rows, sums + explained
        return bool(seen)

    def _refuse(self, motion: Motion, before: FloatArray, fresh: FloatArray) -> bool:
        """Take nothing of a motion, and look whether another mass explains it."""
        self.refused += 1
        pushed = motion.pushed[motion.compared]
        held = np.array([*(self.priors[name] for name in self._names), MASS])
        known = np.insert(before, -1, 0.0, axis=1)
        new = np.insert(fresh, -1, -pushed / self._trust, axis=1)
        whole = np.vstack([known[:, :-1] * held, new[:, :-1] * held, np.eye(held.size)])
        right = np.concatenate([known[:, -1], new[:, -1], np.zeros(held.size)])
        found = held * np.linalg.lstsq(whole, right)[0]
        missed = self._trust * rms(new[:, -1] - new[:, :-1] @ found)
        heavier = float(found[[name == "payload" for name in self._names] + [True]].sum())
        explained = missed <= math.hypot(KIND * rms(pushed), self.noise_N)
        mass = self.law.rig.settings.body.mass_kg * (1.0 + heavier)
        self.mass_kg = mass if explained and abs(heavier) > LIGHT else None
        return False

    def _missed(self, motion: Motion, values: Mapping[ParameterName, float]) -> float:
        """Return the force of a motion that is not explained by some numbers, rms, N."""
        return rms((motion.pushed - self.law.net(motion, values))[motion.compared])

    def step(self, seconds: float) -> None:
        """Let what is applied follow the estimate for some time."""
        for name, wanted in self.values.items():
            most = RATE * self.priors[name] * seconds
            change = min(max(wanted - self.applied[name], -most), most)
            self.applied[name] = _on_grid(name, self.applied[name] + change)

    def stage(self, drift: Drift = NO_DRIFT) -> StageSetup:
        """Return the stage that is corrected by what is applied; its plant may have drifted."""
        return self.law.stage(self._method(self.applied), drift)

    def work(self, drift: Drift, motion: SetPoint, gains: Feedforward, seed: int) -> Recording:
        """Follow a set-point with what is applied, and learn from it."""
        run = track(self.stage(drift), motion, gains, seed)
        if run.loss is None:
            self.learn(Motion(self.law.rig, run.columns))
            self.step(motion.duration)
        return run

    @property
    def found(self) -> CalibratedMethod:
        """What was found."""
        return self._method(self.values)

    def _method(self, values: Mapping[ParameterName, float]) -> CalibratedMethod:
        moved, missed = self._moved_and_missed
        left = self._left(self._rows, self.seen, missed)
        if "payload" in left:  # the sum of both scales was held, and nothing tells it
            of_sum = math.sqrt(2.0) * self.priors["scale_1"]
            shares = {"payload": 1.0, "scale_1": 0.5, "scale_2": 0.5}
            left = {
                name: math.hypot(one, shares.get(name, 0.0) * of_sum) for name, one in left.items()
            }
        return CalibratedMethod(
            name=self.law.method,
            residual_N=missed,
            force_N=moved,
            fits=moved > 0.0 and missed <= math.hypot(KIND * moved, self.noise_N),
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
                for name in PARAMETERS
                if name in self._names or name == "gap_zero_m"
            ],
        )

    @property
    def _moved_and_missed(self) -> tuple[float, float]:
        """Force of the motions, and what was left of it when each was taken in, rms, N."""
        count, moved, missed = self._sums.tolist()
        return math.sqrt(moved / max(count, 1.0)), math.sqrt(missed / max(count, 1.0))

    @property
    def _trust(self) -> float:
        return TRUST * self.law.rig.settings.tracking.force_max_N

    def _prior(self, names: Sequence[ParameterName]) -> FloatArray:
        """Return rows that hold numbers, in standard deviations of them."""
        rows = np.eye(len(names))
        if "payload" in names:
            scales = [FIRM * (name in ("scale_1", "scale_2")) for name in names]
            rows = np.vstack([rows, scales])
        return rows

    def _columns(self, names: Sequence[ParameterName]) -> list[int]:
        return [self._names.index(name) for name in names]

    def _solved(
        self, rows: FloatArray, names: Sequence[ParameterName]
    ) -> dict[ParameterName, float]:
        """Solve for some of the numbers, held by the prior and within its bounds; 0 are the others."""
        if not names:
            return dict.fromkeys(PARAMETERS, 0.0)
        held = np.array([self.priors[name] for name in names])
        far = np.minimum(MOST * held, [LIMITS[name] for name in names])
        known = self._prior(names)
        whole = np.vstack([held * rows[:, self._columns(names)], known])
        right = np.concatenate([rows[:, -1], np.zeros(len(known))])
        found = np.clip(held * np.linalg.lstsq(whole, right)[0], -far, far).tolist()
        solved = zip(names, found, strict=True)
        return dict.fromkeys(PARAMETERS, 0.0) | {name: _on_grid(name, one) for name, one in solved}

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
        """Return what a motion says of the numbers, around some values of them."""
        slopes, expected = self._look(motion, values, exact=exact)
        now = np.array([values[name] for name in self._names])
        right = motion.pushed[motion.compared] - expected + slopes @ now
        return np.column_stack([slopes, right]) / self._trust

    def _look(
        self, motion: Motion, values: Mapping[ParameterName, float], *, exact: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return what each number does along the path, and the force with all of them.

        Paths are those of the law as it was fitted and of one with a wider loop, which are kept;
        exactly, the force is that of a law fitted anew.
        """

        def force(changed: Mapping[ParameterName, float]) -> FloatArray:
            return self.law.net(motion, {**values, **changed})[motion.compared]

        flat = force({"width": 0.0})
        slopes = np.zeros((flat.size, len(self._names)))
        for place, name in enumerate(self._names):
            if name in _OF_BODY:
                slopes[:, place] = motion.by_body[name][motion.compared]
                continue
            step = STEPS[name]
            moved = {name: step if name == "width" else values[name] + step}
            slopes[:, place] = (force({"width": 0.0, **moved}) - flat) / step
        if "width" not in self._names:
            return slopes, flat
        if exact:
            return slopes, force({})
        return slopes, flat + values["width"] * slopes[:, self._names.index("width")]


def _on_grid(name: ParameterName, value: float) -> float:
    """Return the value of a parameter that a law can be fitted with."""
    return round(value / WIDTHS) * WIDTHS if name == "width" else value


WORK = 4
"""Training set-points from which a stage that works learns before it is judged."""


def at_work(
    setup: StageSetup, magnet: IdentifiedMagnet, gains: Feedforward, seed: int
) -> Learner | None:
    """Let a stage that calibrates itself follow the training set-point; None where it does not."""
    rig, method = setup.rig, setup.compensator.method
    if not rig.settings.tracking.calibrate or method not in MOVED:
        return None
    learner = Learner(MotionLaw(rig, magnet, method), FORGET_S)
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
