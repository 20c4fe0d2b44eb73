"""What a stage learns while it runs on a bench: lap after lap, beside it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from anhyst.compensate.interface import MethodName
from anhyst.rig.bearing.make_setup import IdentifiedMagnet
from anhyst.rig.bench.protocol import Signal, Subscription
from anhyst.rig.bench.stage import LAPS, StageBench, StageLap
from anhyst.rig.calibration import ParameterName
from anhyst.rig.recording import column, peak
from anhyst.rig.stage.file import StageRig
from anhyst.rig.stage.loop import COMMANDS, READ, StageSetup
from anhyst.study.tracking.learner import FORGET_S, Learner
from anhyst.study.tracking.measures import exposures
from anhyst.study.tracking.motion import Motion, MotionLaw, refuse_uncalibratable
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

KEPT = 500
"""Laps that a page can draw."""
ROOM_S = 20.0
"""Rows that are kept for a lap and what its iron remembers, s; after a longer rest a lap is waited for."""
GREW = 1.5
"""Times the least moving average, in two laps in a row, beyond which what was learnt is taken back."""
_NEEDED = ("demand_N", *READ, *COMMANDS)


Numbers = Mapping[ParameterName, float]
"""What a method is corrected by; empty where by nothing."""
Do = Callable[[Callable[[], None]], None]
"""Does something to the bench between two of its ticks, in its thread."""


class LearntLap(NamedTuple):
    """What a lap left, and what was known after it."""

    tick: int  # its last
    lap: int
    method: MethodName
    average_m: float  # largest moving average of the error over the slit, while it cruised
    peak_m: float  # largest error
    learning: bool  # whether it was to teach
    refused: int  # laps of this method so far that taught nothing, since nothing explained them
    # number by name: estimate, standard deviation that is left, what is applied, what is stated
    values: Mapping[str, tuple[float, float, float, float]]


class _Kept:
    """What was in force of a method when its laps left least, and what has been since."""

    def __init__(self) -> None:
        self._in_force: deque[tuple[StageSetup, Numbers]] = deque(maxlen=LAPS)
        self._under: tuple[object, ...] = ()
        self._last = self._least = math.inf  # moving averages, m: a lap's, the larger of two laps'
        self._best: Numbers = {}

    def put(self, setup: StageSetup, numbers: Numbers) -> None:
        """Keep what corrects a setup that is put in force."""
        self._in_force.append((setup, {name: one for name, one in numbers.items() if one}))

    def applied(self, lap: StageLap) -> Numbers | None:
        """Return what a lap was corrected by; None where that is forgotten."""
        return next((numbers for setup, numbers in self._in_force if setup is lap.setup), None)

    def better(
        self, lap: StageLap, applied: Numbers, average: float
    ) -> tuple[Numbers, float] | None:
        """Return what left less than these last two laps do, and how much; None if nothing did."""
        if lap.under != self._under:  # another plant, load or gain: nothing is known of it
            self._under, self._last, self._least = lap.under, math.inf, math.inf
        pair, self._last = (self._last, average), average
        if max(pair) < self._least:
            self._least, self._best = max(pair), applied
        grew = math.isfinite(pair[0]) and min(pair) > GREW * self._least
        return (self._best, self._least) if grew and self._best != applied else None


class BenchLearner:
    """Calibrates the methods of a stage bench from its laps, each from those that it drove itself.

    :meth:`run` is a thread of its own; what it found acts through `do`, which a session gives: in
    the thread of the bench, as the orders do.
    """

    def __init__(self, rig: StageRig, magnet: IdentifiedMagnet, bench: StageBench) -> None:
        self.on = rig.settings.tracking.calibrate
        self.laps: deque[LearntLap] = deque(maxlen=KEPT)
        self._rig, self._magnet, self._bench = rig, magnet, bench
        self._columns = [_place(bench.signals, name) for name in (*_NEEDED, "error_m", "lap")]
        self._learners: dict[MethodName, Learner] = {}
        self._before: dict[MethodName, float] = {}  # moving average while nothing was applied, m
        self._laws: dict[MethodName, MotionLaw] = {}
        self._kept: dict[MethodName, _Kept] = {}
        self._rows: deque[FloatArray] = deque()
        self._trouble = ""
        self._since = 0  # tick before which nothing teaches that waits to be looked at

    def turn(self, on: bool) -> None:
        """Learn from the lap that is under way on, or no more; what is applied stays."""
        if on and (why := self._refusal):
            raise why
        self.on, self._since = on, self._bench.tick

    def revert(self) -> int:
        """Forget all that was learnt, and put in force what the rig file says; in the bench's thread."""
        self._since = self._bench.tick  # first: what waits finds either this or its learner gone
        self._learners, self._kept, self._trouble = {}, {}, ""
        return [self._bench.correct(one.setup) for one in self._bench.variants][-1]

    def status(self) -> Mapping[str, Any]:
        """Return what a page shows beside the laps."""
        learners = dict(self._learners)
        return {
            "on": self.on,
            "refused": str(self._refusal or ""),
            "trouble": self._trouble,
            "said": {method: one.found.judgement for method, one in learners.items()},
            "before_m": dict(self._before),
        }

    def run(self, subscription: Subscription, do: Do) -> None:
        """Take rows until they end."""
        with suppress(InputError):  # the bench is closed
            while (rows := subscription.get()) is not None:
                self.take(rows, do)

    def take(self, rows: FloatArray, do: Do) -> None:
        """Take rows, and learn from each lap that ends with them."""
        if self._rows and rows[0, 0] != self._rows[-1][-1, 0] + 1:
            self._rows.clear()  # some were missed
        self._rows.append(rows)
        while sum(map(len, self._rows)) > ROOM_S * self._bench.rate:
            self._rows.popleft()
        for lap in tuple(self._bench.laps):
            end = lap.begin + lap.ticks - 1
            if rows[0, 0] <= end <= rows[-1, 0]:
                self._end(lap, end, do)

    def _end(self, lap: StageLap, end: int, do: Do) -> None:
        """Learn from a lap, unless it was broken off, and let what was found act."""
        table = np.concatenate(self._rows)
        first = int(table[0, 0])
        *read, error, laps = table[: end + 1 - first, self._columns].T
        begin = lap.begin - first
        if begin < 0 or np.any(laps[begin:] != lap.number):
            return
        slit, dt = self._rig.settings.scan.slit_s, self._rig.dt
        windows = exposures(error[begin:], lap.motion, slit, dt)
        most = peak(error[begin:])
        average = max((peak(mean) for mean, _ in windows if mean.size), default=most)
        learners, on, setup = self._learners, self.on, None
        learner, kept = learners.get(lap.method), self._kept.setdefault(lap.method, _Kept())
        own = any(lap.setup is one.setup for one in self._bench.variants)
        untouched = own and (learner is None or not any(learner.applied.values()))
        applied = {} if own else kept.applied(lap)
        better = None if applied is None else kept.better(lap, applied, average)
        if on and better is not None and learner is not None:
            setup = self._go_back(learner, *better, average)
        elif on and lap.known >= first and end > self._since:
            known = lap.known - first
            columns = dict(zip(_NEEDED, (one[known:] for one in read), strict=True))
            setup = self._learn(learners, lap, Motion(self._rig, columns, begin - known))
        learner = learners.get(lap.method)

        def act() -> None:
            if learners is not self._learners:
                return  # it was reverted meanwhile
            if untouched:
                self._before[lap.method] = average
            if setup is not None and learner is not None:
                self._bench.correct(setup)
                kept.put(setup, learner.applied)
            values = {} if learner is None else _values(learner)
            refused = 0 if learner is None else learner.refused
            self.laps.append(
                LearntLap(end, lap.number, lap.method, average, most, on, refused, values)
            )

        do(act)

    def _go_back(self, learner: Learner, best: Numbers, least: float, average: float) -> StageSetup:
        """End learning, and return what the method was corrected by when its laps left least."""
        learner.applied = dict.fromkeys(learner.applied, 0.0) | dict(best)
        self._trouble, self.on = (
            f"learning ended: the moving average of {learner.law.method} grew from "
            f"{1e9 * least:.3g} to {1e9 * average:.3g} nm; what left least is in force again",
            False,
        )
        return learner.stage()

    def _learn(
        self, learners: dict[MethodName, Learner], lap: StageLap, motion: Motion
    ) -> StageSetup | None:
        """Take a lap in; return what is to be put in force, if anything changes."""
        method = lap.method
        if method not in self._laws:
            self._laws[method] = MotionLaw(self._rig, self._magnet, method)
        learner = learners.setdefault(method, Learner(self._laws[method], FORGET_S))
        before = dict(learner.applied)
        try:
            learner.learn(motion)
            learner.step(lap.motion.duration)
            return None if learner.applied == before else learner.stage()
        except (InputError, np.linalg.LinAlgError) as error:
            self._trouble, self.on = f"learning ended: {error}", False
            return None

    @property
    def _refusal(self) -> InputError | None:
        """Return why nothing can be learnt of this stage, or None."""
        try:
            refuse_uncalibratable(self._rig)
        except InputError as error:
            return error
        if self._rig.calibration is None:
            return None
        return InputError(
            f"{self._rig.path}: control.calibration: learning begins without one; leave it out",
            code="not-both",
            key="control.calibration",
        )


def _values(learner: Learner) -> dict[str, tuple[float, float, float, float]]:
    return {
        one.name: (one.value, one.sigma, learner.applied[one.name], one.prior)
        for one in learner.found.parameter
        if one.name in learner.seen
    }


def _place(signals: Sequence[Signal], header: str) -> int:
    """Return where a column of a recording is in the rows of a bench."""
    return 1 + [column(one.name, one.unit) for one in signals].index(header)
