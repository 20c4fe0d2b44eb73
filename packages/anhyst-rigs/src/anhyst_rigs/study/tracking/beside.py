"""What a stage or a bearing learns while it runs on a bench, beside it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from anhyst.model.actuator import Model
from anhyst.support.block_words import GENERATION_AT, regenerate
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.bench.protocol import Bench, Signal, Subscription
from anhyst_rigs.rig.bench.stage import LAPS, StageBench, StageLap
from anhyst_rigs.rig.calibration import ParameterName
from anhyst_rigs.rig.fitting import IdentifiedMagnet, calibrated
from anhyst_rigs.rig.recording import column, peak
from anhyst_rigs.rig.stage.loop import StageSetup
from anhyst_rigs.study.tracking.bodies import BearingLaw, StageLaw
from anhyst_rigs.study.tracking.learner import FORGET_S, Learner
from anhyst_rigs.study.tracking.measures import exposures
from anhyst_rigs.study.tracking.motion import Motion, MotionLaw, refuse_uncalibratable

KEPT = 500
"""Laps that a page can draw."""
LIFTED_S = 0.1
"""In which the weight of a body is taken up: the iron that carries it remembers that ever after."""
ROOM_S = 20.0
"""Rows that are kept for a lap and what its iron remembers, s; after a longer rest a lap is waited for."""
GREW = 1.5
"""Times the least error, in two laps in a row, beyond which what was learnt is taken back."""
_OF_BEARING = ("reference_m", "gap_read_m", "command_A", "load_N", "demand_N", "state", "phase")
LEAST, LITTLE = 50, 0.1
"""Comparisons of a second that teaches; part of a stated deviation below which nothing is swapped."""


Numbers = Mapping[ParameterName, float]
"""What a method is corrected by; empty where by nothing."""
Do = Callable[[Callable[[], None]], None]
"""Does something to the bench between two of its ticks, in its thread."""


class LearntLap(NamedTuple):
    """What a lap left, and what was known after it."""

    tick: int  # its last
    lap: int
    method: MethodName
    # error; of a stage the largest moving average over the slit, while it cruised
    average: float
    peak: float  # largest error
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
        self._in_force.append((setup, {name: value for name, value in numbers.items() if value}))

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
    """Calibrates the methods of a bench from its motions, each from those that it drove itself.

    :meth:`run` is a thread of its own; what it found acts through `do`, which a session gives: in
    the thread of the bench, as the orders do.
    """

    unit = "m"
    """Of the errors of its laps."""

    def __init__(self, bench: Bench, on: bool = False) -> None:
        self.on = on
        self.laps: deque[LearntLap] = deque(maxlen=KEPT)
        self._clock = bench
        self._learners: dict[MethodName, Learner] = {}
        self._before: dict[MethodName, float] = {}  # error where nothing is applied
        self._rows: deque[FloatArray] = deque()
        self._trouble = ""
        self._since = 0  # tick before which nothing teaches that waits to be looked at

    def turn(self, on: bool) -> None:
        """Learn from what is under way on, or no more; what is applied stays."""
        if on and (why := self._refusal):
            raise why
        self.on, self._since = on, self._clock.tick

    def revert(self) -> int:
        """Forget all that was learnt; in the bench's thread."""
        self._since = self._clock.tick  # first: what waits finds either this or its learner gone
        self._learners, self._trouble = {}, ""
        return self._since

    def status(self) -> Mapping[str, Any]:
        """Return what a page shows beside the laps."""
        learners = dict(self._learners)
        return {
            "on": self.on,
            "refused": str(self._refusal or ""),
            "trouble": self._trouble,
            "said": {method: one.found.judgement for method, one in learners.items()},
            "before": dict(self._before),
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
        self._look(rows, do)

    def _look(self, rows: FloatArray, do: Do) -> None:
        """Learn from what ends with rows."""
        raise NotImplementedError  # pragma: no cover

    def _stop(self, why: str) -> None:
        """Learn no more, and show why."""
        self._trouble, self.on = f"learning ended: {why}", False

    def _say(self, lap: LearntLap, learner: Learner | None) -> None:
        """Keep what a page draws of a lap."""
        if learner is not None:
            values = {
                number.name: (
                    number.value,
                    number.sigma,
                    learner.applied[number.name],
                    number.prior,
                )
                for number in learner.found.parameter
                if number.name in learner.seen
            }
            lap = lap._replace(refused=learner.refused, values=values)
        self.laps.append(lap)

    @property
    def _refusal(self) -> InputError | None:
        """Return why nothing can be learnt, or None."""
        raise NotImplementedError  # pragma: no cover


class StageLearner(BenchLearner):
    """Calibrates a stage from its laps; what it found acts when the body next rests."""

    def __init__(self, magnet: IdentifiedMagnet, bench: StageBench) -> None:
        rig = bench.rig
        super().__init__(bench, rig.settings.tracking.calibrate)
        self._rig, self._magnet, self._bench = rig, magnet, bench
        self._needed = StageLaw(rig, magnet, "full").needed[1:]  # the clock is the tick here
        self._columns = [_index_of(bench.signals, one) for one in (*self._needed, "error_m", "lap")]
        # in rows of them
        self._commands = [1 + n for n, one in enumerate(self._needed) if one.startswith("command")]
        self._left_out = 0
        # rows of that, since it was switched on
        self._lifted = np.zeros((0, 1 + len(self._columns)))
        self._laws: dict[MethodName, MotionLaw] = {}
        self._kept: dict[MethodName, _Kept] = {}

    def revert(self) -> int:
        """Forget all that was learnt, and put in force what the rig file says."""
        super().revert()
        self._kept, self._left_out = {}, 0
        return [self._bench.correct(setup) for setup in self._bench.setups][-1]

    def status(self) -> Mapping[str, Any]:
        """Return what a page shows beside the laps."""
        return {**super().status(), "left_out": self._left_out}

    def take(self, rows: FloatArray, do: Do) -> None:
        """Take rows, and learn from each lap that ends with them."""
        super().take(rows[:, [0, *self._columns]], do)

    def _look(self, rows: FloatArray, do: Do) -> None:
        while len(self._rows) > 1 and sum(map(len, self._rows)) > ROOM_S * self._bench.rate:
            self._rows.popleft()
        since, first = max(self._bench.switched, self._bench.lifted), int(rows[0, 0])
        if 0 <= since - first < len(rows):
            again = since != self._bench.switched
            past = self._before_lift(since) if again else self._lifted[:0]
            self._lifted = np.concatenate([past, rows[since - first :]])
            if again:  # its iron carries the weight on another branch now
                self._learners = {name: one.afresh() for name, one in self._learners.items()}
        elif since <= first < since + LIFTED_S * self._bench.rate:
            self._lifted = np.concatenate([self._lifted, rows])
        for lap in tuple(self._bench.laps):
            if rows[0, 0] <= lap.end <= rows[-1, 0]:
                self._end(lap, do)

    def _before_lift(self, tick: int) -> FloatArray:
        """Return what the iron remembers of before a lift: the first one, the last lap, the way down."""
        known = max((one.known for one in tuple(self._bench.laps) if one.begin < tick), default=0)
        rows = np.concatenate(self._rows)
        rows = rows[(rows[:, 0] >= known) & (rows[:, 0] < tick)]
        driven = rows[:, self._commands].any(axis=1)
        before = self._lifted[:, 0] < (rows[0, 0] if len(rows) else tick)
        # of a rest without current its first row says as much
        return np.concatenate([self._lifted[before], rows[driven | np.roll(driven, 1)]])

    def _end(self, lap: StageLap, do: Do) -> None:
        """Learn from a lap, unless it was broken off, and let what was found act."""
        table = np.concatenate([one for one in self._rows if one[-1, 0] >= lap.known])
        first, end = int(table[0, 0]), lap.end
        error, laps = table[: end + 1 - first, -2:].T
        begin = lap.begin - first
        if begin < 0 or np.any(laps[begin:] != lap.number):
            return
        slit, dt = self._rig.settings.scan.slit_s, self._rig.dt
        windows = exposures(error[begin:], lap.motion, slit, dt)
        most = peak(error[begin:])
        average = max((peak(mean) for mean, _ in windows if mean.size), default=most)
        learners, on, setup = self._learners, self.on, None
        learner, kept = learners.get(lap.method), self._kept.setdefault(lap.method, _Kept())
        own = any(lap.setup is setup for setup in self._bench.setups)
        untouched = own and (learner is None or not any(learner.applied.values()))
        applied = {} if own else kept.applied(lap)
        better = None if applied is None else kept.better(lap, applied, average)
        if on and better is not None and learner is not None:
            setup = self._go_back(learner, *better, average)
        elif on and self._is_late(lap):
            on, self._left_out = False, self._left_out + 1
        elif on and lap.known >= first and end > self._since:
            before = self._lifted[:, 0] < lap.known
            rows = table[lap.known - first : end + 1 - first, 1:]
            rows = np.concatenate([self._lifted[before, 1:], rows])
            columns = dict(zip(self._needed, rows.T, strict=False))
            setup = self._learn(learners, lap, columns, len(rows) - lap.ticks)
        learner = learners.get(lap.method)

        def act() -> None:
            if learners is not self._learners:
                return  # it was reverted meanwhile
            if untouched:
                self._before[lap.method] = average
            if setup is not None and learner is not None:
                self._bench.correct(setup)
                kept.put(setup, learner.applied)
            self._say(LearntLap(end, lap.number, lap.method, average, most, on, 0, {}), learner)

        do(act)

    def _is_late(self, lap: StageLap) -> bool:
        """Whether a lap after it has ended meanwhile: looking at one takes longer than a lap."""
        now = self._bench.tick
        return any(one.number > lap.number and one.end <= now for one in tuple(self._bench.laps))

    def _go_back(self, learner: Learner, best: Numbers, least: float, average: float) -> StageSetup:
        """End learning, and return what the method was corrected by when its laps left least."""
        learner.applied = dict.fromkeys(learner.applied, 0.0) | dict(best)
        self._stop(
            f"the moving average of {learner.law.method} grew from {1e9 * least:.3g} to "
            f"{1e9 * average:.3g} nm; what left least is in force again"
        )
        return learner.stage()

    def _learn(
        self,
        learners: dict[MethodName, Learner],
        lap: StageLap,
        read: Mapping[str, FloatArray],
        begin: int,
    ) -> StageSetup | None:
        """Take a lap in that begins with a row; return what is to be put in force, if anything changes."""
        method = lap.method
        if method not in self._laws:
            self._laws[method] = StageLaw(self._rig, self._magnet, method)
        learner = learners.setdefault(method, Learner(self._laws[method], FORGET_S))
        before = dict(learner.applied)
        try:
            learner.learn(self._laws[method].motion(read, begin))
            learner.step(lap.motion.duration)
            return None if learner.applied == before else learner.stage()
        except (InputError, np.linalg.LinAlgError) as error:
            self._stop(str(error))
            return None

    @property
    def _refusal(self) -> InputError | None:
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


WINDOW_S, TAIL_S = 1.0, 0.1
"""Rows of a bearing that are looked at together, and those before of which every one is kept."""
BLOCK, MEMORY = 20, 100_000
"""Of older rows so many become the two that the iron remembers best; beyond so many once more."""


class BearingLearner(BenchLearner):
    """Calibrates a bearing from every second in which its reference moved; a block is swapped then.

    The firmware lets fade what the current would jump by. Errors are what the force is off by; what
    nothing would have been learnt for is what the law as it was fitted leaves of the same second.
    """

    unit = "N"

    def __init__(
        self,
        setup: BearingSetup,
        known: IdentifiedMagnet,
        compiled: Callable[[Model], Sequence[int]],
        bench: BearingBench,
    ) -> None:
        super().__init__(bench)
        self._setup, self._bench, self._method = setup, bench, setup.method
        self._known, self._compiled = known, compiled  # to a block for the running board
        self._columns = {one: _index_of(bench.signals, one) for one in _OF_BEARING}
        self._law: BearingLaw | None = None
        self._memory = np.zeros((0, 1 + len(bench.signals)))
        self._first = self._ours = bench.read_block()
        self._applied: Numbers = {}
        self._waits = False  # for an armature that lies without a current
        self._off = False  # whether the last second was worse than without what is applied

    def revert(self) -> int:
        """Forget all that was learnt, and put in force what the rig file says."""
        super().revert()
        return self._swap(self._first, {})

    def status(self) -> Mapping[str, Any]:
        """Return what a page shows beside the laps."""
        waits = "rows were missed, and what the iron remembers is not known: land, and lift again"
        shown = super().status()
        return {**shown, "trouble": shown["trouble"] or (waits if self._waits else "")}

    def _look(self, rows: FloatArray, do: Do) -> None:
        if len(self._rows) == 1:  # the first, or rows were missed: it begins where no current flows
            self._memory = self._memory[:0]
            self._waits = bool(rows[0, self._columns["command_A"]] > 0.0)
            if self._waits:
                self._rows.clear()
                return
        if sum(map(len, self._rows)) < (WINDOW_S + TAIL_S) * self._bench.rate:
            return
        table = np.concatenate(self._rows)
        self._end(table, do)
        tail = round(TAIL_S * self._bench.rate)
        old = _thinned(table[:-tail], self._columns)
        self._memory = np.concatenate([self._memory, old])
        if len(self._memory) > MEMORY:
            self._memory = _thinned(self._memory, self._columns)
        self._rows = deque([table[-tail:]])

    def _end(self, table: FloatArray, do: Do) -> None:
        """Learn from a second, and let what was found act."""
        if self._refusal is not None:
            return
        setup = self._setup
        law = self._law = self._law or BearingLaw(
            setup.rig, setup.controller, self._known, self._method
        )
        whole = np.concatenate([self._memory, table])
        read = {name: whole[:, place] for name, place in self._columns.items()}
        begin = len(self._memory) + round(TAIL_S * self._bench.rate)
        motion = law.motion(read, begin)
        compared = motion.compared
        if compared.size < LEAST:
            return
        off = (motion.pushed - motion.filtered(read["demand_N"], motion.late))[compared]
        fitted = dict.fromkeys(law.names, 0.0)
        without = rms((motion.pushed - law.net(motion, fitted))[compared])
        end, learners, on = int(table[-1, 0]), self._learners, self.on
        grew = any(self._applied.values())
        grew = grew and rms(off) > GREW * max(without, law.leaves * motion.force)
        back, self._off = grew and self._off, grew
        new = None
        if on and not back and end - len(table) >= self._since:
            new = self._learn(learners, law, motion)

        def act() -> None:
            if learners is not self._learners:
                return  # it was reverted meanwhile
            self._before[self._method] = without
            if back:
                self.revert()
                self._stop(
                    f"the force was off by {rms(off):.3g} N, and by {without:.3g} N without what "
                    "was learnt, which is in force no more"
                )
            elif new is not None:
                self._swap(*new)
            lap = LearntLap(end, 0, self._method, rms(off), peak(off), on, 0, {})
            self._say(lap, self._learners.get(self._method))

        do(act)

    def _learn(
        self, learners: dict[MethodName, Learner], law: BearingLaw, motion: Motion
    ) -> tuple[Sequence[int], Numbers] | None:
        """Take a second in; return the block that is to be put in force, if anything changes."""
        learner = learners.setdefault(self._method, Learner(law, FORGET_S))
        try:
            learner.learn(motion)
            learner.step(WINDOW_S)
            numbers = dict(learner.applied)
            if all(
                abs(one - self._applied.get(name, 0.0)) <= LITTLE * learner.priors[name]
                for name, one in numbers.items()
            ):
                return None
            zero = numbers["gap_zero_m"]
            over = 2.0 * abs(zero)  # the gaps of the board stay those of the build
            magnet = calibrated(self._known, numbers["scale_1"], zero, numbers["width"], over)
            return self._compiled(magnet.model), numbers
        except (InputError, np.linalg.LinAlgError) as error:
            self._stop(str(error))
            return None

    def _swap(self, words: Sequence[int], numbers: Numbers) -> int:
        """Put a block in force, unless somebody swapped another model in; in the bench's thread."""
        now = self._bench.read_block()
        if regenerate(now, 0) != regenerate(self._ours, 0):
            self._stop("another model is in force")
            return self._bench.tick
        self._ours = regenerate(words, (now[GENERATION_AT] + 1) & 0xFFFF)
        self._applied = numbers
        return self._bench.swap_block(self._ours)

    @property
    def _refusal(self) -> InputError | None:
        rig, why = self._setup.rig, ""
        if rig.calibration is not None:
            why = "control.calibration: learning begins without one; leave it out"
        elif len(rig.settings.placed) > 1:
            why = "both magnets of a pair share one block; calibrate from a recording"
        elif self._method != "full":
            why = f"'{self._method}' is not calibrated while it runs; choose 'full'"
        return InputError(f"{rig.path}: {why}", code="not-learnt-here") if why else None


def _thinned(rows: FloatArray, columns: Mapping[str, int]) -> FloatArray:
    """Keep of each block of rows those at which the magnet is driven least and most."""
    blocks = len(rows) // BLOCK
    whole = blocks * BLOCK
    driven = rows[:whole, columns["command_A"]] / rows[:whole, columns["gap_read_m"]]
    driven = driven.reshape(blocks, BLOCK)
    ends = np.column_stack([driven.argmin(axis=1), driven.argmax(axis=1)])
    kept = np.unique(ends + BLOCK * np.arange(blocks)[:, None])
    return np.concatenate([rows[kept], rows[whole:]])


def _index_of(signals: Sequence[Signal], header: str) -> int:
    """Return where a column of a recording is in the rows of a bench."""
    return 1 + [column(signal.name, signal.unit) for signal in signals].index(header)
