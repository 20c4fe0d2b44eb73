"""The fit of play cells with lag and creep: what deforms under a voltage, not what is magnetised.

Where cells stand depends on the drive and their thresholds alone, so that all weights, the creep
and the offset come from one least-squares problem with weights not below zero. Around it few
numbers are tried: the lag, where the curves of the cells have their middle (``in_0``), and their
widths. A loop that bends to one side has its middle beyond that side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from anhyst.data import Loop, Loops
from anhyst.data.path import History, correlation
from anhyst.data.speeds import rate_of
from anhyst.identification.run import Outcome
from anhyst.laws.cells import CellWeights
from anhyst.model.actuator import Model
from anhyst.model.dynamics import Dynamics
from anhyst.model.schema import CandidateFit, Uncertainty
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0

LAW = "play-cells"

PLAYS = 12
"""Cells with a threshold: as many as a compiled compensator takes."""

FINEST = 0.04
"""First threshold, in parts of the range of the input; the last is half of it. A finer one does what
a lag does, and lets the inverse jump where the drive turns."""

MIDDLES = (-2.0, -1.0, -0.5, 0.0, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
"""Of the curves, in ranges of the input above its lowest value."""

WIDTHS = (0.5, 1.0, 2.0, 8.0)
"""Of the curves, in ranges of the input; the last is all but straight."""

LAGS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
"""In samples."""

LONGEST_AT_ONE_RATE = 1.0
"""Of these, where all loops run at about one rate: there a lag and a wider loop are all but the same."""

RATES_APART = 3.0
"""Fastest loop over slowest one from which on a lag is told from a wider loop."""

HOLDS = 1.5
"""Deviation, in parts of that of the slowest loops, up to which a model holds at a rate."""

CREEP = (1 / 200, 1 / 10, 2.0)
"""Time constants, in parts of the longest record."""

SLOWEST_SAMPLE = 3.0
"""A time constant is this many samples at least."""

STRAIGHT = 0.02
"""Share of the straight part in the mean slope. The model must have one; what is straight beyond is a
cell on the widest curve, so that the saturation of all cells is more than the output ever is."""

SMOOTH = 1e-3
"""Weight of the second differences over the thresholds; neighbours that no sample distinguishes
share what they have."""

WORTH = 0.98
"""Deviation, in parts of that without, from which on lag or creep say nothing."""

STRAY = 10.0
"""Deviation, in parts of the usual one, from which on a sample shows no loop but a spike, or that the
amplifier was switched on."""

REACHED = 0.98
"""Of the way to the far end."""

MOST_UNKNOWN = 0.3
"""Of a record, that may be left out as its first rise."""

FEW = 0.02
"""Most samples that may be left out as such."""

MOST_SAMPLES = 20_000
"""That are fitted."""

ALIKE = 0.995
"""The same of a shorter lag: of lags that do as well, the shortest."""

ROUNDS = 3
"""Creep follows what the last round found."""


@dataclass(frozen=True)
class _Try:
    """One trial: lag in s, middle of the curves, creep times; and its result."""

    lag: float
    middle: float
    times: tuple[float, ...] = ()
    weights: FloatArray | None = None
    rms: float = np.inf


def fit_creeping(loopset: Loops) -> Outcome:
    """Fit play cells, lag and creep to loops without a scheduling variable."""
    problem = _Problem(_fewer(loopset))
    problem.leave_out_strays()
    lags = problem.lags
    plain = [problem.solve(_Try(lag, middle)) for lag, middle in product(lags, problem.middles)]
    best = min(plain, key=lambda attempt: attempt.rms)
    still = min(
        (attempt for attempt in plain if attempt.lag == 0.0), key=lambda attempt_at: attempt_at.rms
    )
    # Several lags do about as well where all cycles are alike: the shortest that does.
    kept = [attempt for attempt in plain if attempt.rms <= best.rms / ALIKE]
    chosen = min(kept, key=lambda attempt: (attempt.lag, attempt.rms))
    if problem.times:
        chosen = _with_creep(problem, plain, chosen)
    tries = [_listed(problem, "play cells", still)]
    if chosen is not still:
        parts = [f"a lag of {chosen.lag:.3g} s"] * (chosen.lag > 0.0) + ["creep"] * bool(
            chosen.times
        )
        tries.append(_listed(problem, f"play cells, {' and '.join(parts)}", chosen))
    last = replace(tries[-1], note="chosen")
    model, statement = held(problem.model(chosen), loopset)
    assert chosen.weights is not None
    return Outcome(
        model,
        Uncertainty((), (), (), statements=(statement,) if statement else ()),
        int(np.count_nonzero(chosen.weights)),
        problem.solved,
        "nothing is scheduled",
        dead_band="none: play cells need none",
        candidates=(*tries[:-1], last),
        why_law=_why(chosen, still),
    )


def _with_creep(problem: _Problem, plain: Sequence[_Try], chosen: _Try) -> _Try:
    """Add creep to the best fits without it, and keep it where it pays."""
    near = sorted(plain, key=lambda attempt: attempt.rms)[:4]
    tried = []
    for start in {id(each): each for each in (*near, chosen)}.values():
        now = start
        for _ in range(ROUNDS):
            now = problem.solve(replace(now, times=problem.times))
        tried.append(now)
    best = min(tried, key=lambda attempt: attempt.rms)
    alike = min(
        (attempt for attempt in tried if attempt.rms <= best.rms / ALIKE),
        key=lambda start: start.lag,
    )
    return alike if alike.rms < WORTH * chosen.rms else chosen


def held(model: Model, loopset: Loops) -> tuple[Model, str]:
    """Find the highest cycle rate at which a model holds, and its error above that."""
    missed: dict[float, list[float]] = {}
    for loop in loopset.loops:
        made = model.predict(loop.input, None, loop.time, loop.history).output
        off = float(np.sqrt(np.mean((made - loop.output) ** 2)) / np.ptp(loop.output))
        missed.setdefault(float(f"{rate_of(loop.input, loop.time):.2g}"), []).append(off)
    if set(missed) == {0.0}:
        return model, ""
    rates = sorted(missed)
    mean = [float(np.mean(missed[rate])) for rate in rates]
    good = [rate for rate, off in zip(rates, mean, strict=True) if off <= HOLDS * mean[0]]
    beyond = [index for index, rate in enumerate(rates) if rate not in good]
    first = beyond[0] if beyond else len(rates)
    fastest = rates[max(0, first - 1)]
    assert model.dynamics is not None
    model = replace(model, dynamics=replace(model.dynamics, fastest=fastest))
    if not beyond:
        return model, f"the loops run at up to {fastest:.2g} Hz; beyond nothing is known"
    return model, (
        f"the model holds up to {fastest:.2g} Hz: there it misses {100 * mean[first - 1]:.2g} % of "
        f"the range, at {rates[first]:.2g} Hz {100 * mean[first]:.2g} %"
    )


def _listed(problem: _Problem, name: str, attempt: _Try) -> CandidateFit:
    assert attempt.weights is not None
    count = int(np.count_nonzero(attempt.weights))
    return CandidateFit(law=name, gap_map="none", numbers=count, rms=attempt.rms / problem.height)


def _why(chosen: _Try, still: _Try) -> str:
    if chosen is still:
        return "neither lag nor creep takes away 2 % of the deviation"
    return (
        f"lag and creep take the deviation to {chosen.rms / still.rms:.2f} of that of play cells "
        "that answer at once"
    )


class _Problem:
    """Loops, and the columns of their least-squares problem."""

    def __init__(self, loopset: Loops) -> None:
        self.loopset = loopset
        self.solved = 0
        self.low = min(float(loop.input.min()) for loop in loopset.loops)
        self.span = max(float(loop.input.max()) for loop in loopset.loops) - self.low
        self.height = max(float(np.ptp(loop.output)) for loop in loopset.loops)
        if any(correlation(loop.input, loop.output) < -0.5 for loop in loopset.loops):
            name, drive = loopset.output.name.replace("_", " "), loopset.input.name
            raise InputError(
                f"the {name} falls as the {drive} rises; flip the sign of one of the columns",
                code="output-falls",
            )
        self.slope = STRAIGHT * self.height / self.span
        self.thresholds = np.concatenate([[0.0], self.span * np.geomspace(FINEST, 0.5, PLAYS)])
        self.widths = self.span * np.array(WIDTHS)
        self._plays: dict[tuple[float, float], list[tuple[FloatArray, FloatArray]]] = {}
        self.counted = [_known(loop) for loop in loopset.loops]

    def leave_out_strays(self) -> None:
        """Leave out few samples that deviate from the best fit without a lag as no loop does."""
        best = min(
            (self.solve(_Try(0.0, middle)) for middle in self.middles),
            key=lambda attempt: attempt.rms,
        )
        assert best.weights is not None
        off = []
        for loop, (fields, _) in zip(
            self.loopset.loops, self.plays(best.lag, best.middle), strict=True
        ):
            made = self.at_once(fields, best.weights) + best.weights[-2] - best.weights[-1]
            off.append(np.abs(loop.output - made))
        usual = float(np.median(np.concatenate(off)))
        counted = [
            known & (deviation <= STRAY * usual)
            for known, deviation in zip(self.counted, off, strict=True)
        ]
        before, after = (
            sum(int(deviation.sum()) for deviation in some) for some in (self.counted, counted)
        )
        if before - after <= FEW * before:
            self.counted = counted

    @property
    def middles(self) -> list[float]:
        """Where the curves may have their middle, in units of the input."""
        return [self.low + part * self.span for part in MIDDLES]

    @cached_property
    def step(self) -> float:
        """Time from sample to sample, s; 0 where a loop has none."""
        if any(loop.time is None for loop in self.loopset.loops):
            return 0.0
        steps = [
            np.median(np.diff(loop.time)) for loop in self.loopset.loops if loop.time is not None
        ]
        return float(min(steps))

    @property
    def rates(self) -> list[float]:
        """Cycle rate of each loop, Hz."""
        return [rate_of(loop.input, loop.time) for loop in self.loopset.loops]

    @property
    def lags(self) -> list[float]:
        """That are tried, s."""
        if not self.step:
            return [0.0]
        one_rate = max(self.rates) < RATES_APART * min(self.rates)
        return [part * self.step for part in LAGS if not one_rate or part <= LONGEST_AT_ONE_RATE]

    @cached_property
    def times(self) -> tuple[float, ...]:
        """Time constants of the creep, s."""
        if not self.step:
            return ()
        longest = max(
            float(loop.time[-1] - loop.time[0])
            for loop in self.loopset.loops
            if loop.time is not None
        )
        spread = (part * longest for part in CREEP)
        return tuple(time for time in spread if time >= SLOWEST_SAMPLE * self.step)

    def plays(self, lag: float, middle: float) -> list[tuple[FloatArray, FloatArray]]:
        """Places of the cells over each loop, and at rest before it, from the middle."""
        if (lag, middle) not in self._plays:
            cells = []
            for loop in self.loopset.loops:
                drive = loop.input
                if lag and loop.time is not None:
                    drive = Dynamics(lag).delayed(drive, loop.time)
                before = _before(loop.history, drive)
                lead = np.concatenate([[middle], before]) - middle
                at_rest = moved(lead, self.thresholds, np.zeros(PLAYS + 1))[-1]
                cells.append((moved(drive - middle, self.thresholds, at_rest), at_rest))
            self._plays[lag, middle] = cells
        return self._plays[lag, middle]

    def columns(self, fields: FloatArray) -> FloatArray:
        """Return what each weight gives: each cell on each curve."""
        return np.tanh(fields[:, :, None] / self.widths).reshape(fields.shape[0], -1)

    def at_once(self, fields: FloatArray, weights: FloatArray) -> FloatArray:
        """Return what weights make of cells, without creep and offset."""
        columns = self.columns(fields)
        return np.asarray(columns @ weights[: columns.shape[1]] + self.slope * fields[:, 0])

    def solve(self, attempt: _Try) -> _Try:
        """Solve for weights; with creep, that of what the weights given so far make."""
        from scipy.optimize import nnls

        self.solved += 1
        rows, targets = [], []
        for loop, counted, (fields, at_rest) in zip(
            self.loopset.loops, self.counted, self.plays(attempt.lag, attempt.middle), strict=True
        ):
            own = self.columns(fields)
            if attempt.times:
                own = np.hstack([own, self._creep(attempt, fields, at_rest, loop)])
            weight = 1.0 / (self.height * np.sqrt(loop.n * len(self.loopset)))
            ends = np.ones((loop.n, 1))
            rows.append(weight * np.hstack([own, ends, -ends])[counted])
            targets.append(weight * (loop.output - self.slope * fields[:, 0])[counted])
        matrix, target = np.concatenate(rows), np.concatenate(targets)
        smooth = SMOOTH * self._differences(matrix.shape[1], np.linalg.norm(matrix, axis=0))
        normal = matrix.T @ matrix + smooth.T @ smooth
        normal += 1e-12 * np.trace(normal) * np.eye(normal.shape[0])
        factor = np.linalg.cholesky(normal)
        weights, _ = nnls(factor.T, np.linalg.solve(factor, matrix.T @ target), maxiter=10000)
        off = matrix @ weights - target
        return replace(attempt, weights=weights, rms=float(np.linalg.norm(off)) * self.height)

    def _differences(self, columns: int, size: FloatArray) -> FloatArray:
        """Second differences over the thresholds, one block a width."""
        curves = len(WIDTHS)
        rows = []
        for width, cell in product(range(curves), range(2, PLAYS)):
            row = np.zeros(columns)
            for at, part in ((cell - 1, 1.0), (cell, -2.0), (cell + 1, 1.0)):
                column = at * curves + width
                row[column] = part * size[column]
            rows.append(row)
        return np.array(rows)

    def _creep(
        self, attempt: _Try, fields: FloatArray, at_rest: FloatArray, loop: Loop
    ) -> FloatArray:
        """Return the slow response to the instantaneous output, a column for each time constant."""
        assert attempt.weights is not None
        assert loop.time is not None
        at_once = self.at_once(fields, attempt.weights)
        rest = float(self.at_once(at_rest[None], attempt.weights)[0])
        columns = []
        for time in attempt.times:
            single = Dynamics(0.0, (time,), (1.0,))
            settled = loop.history.kind == "settled"
            start = single.settled(at_once, loop.time, known=True) if settled else np.array([rest])
            columns.append(single.added(at_once, loop.time, start).values - at_once)
        return np.stack(columns, axis=1)

    def model(self, attempt: _Try) -> Model:
        """Return the model of a solution."""
        assert attempt.weights is not None
        cells = (PLAYS + 1) * len(WIDTHS)
        slope, weights = self.slope, attempt.weights[:cells] / self.slope
        slow = attempt.weights[cells:-2]
        kept = [(t, float(w)) for t, w in zip(attempt.times, slow, strict=True) if w > 1e-4]
        return Model(
            name="model",
            input=self.loopset.input,
            output=self.loopset.output,
            parameters={
                "alpha": 0.0,
                "c_H": 1.0,
                "c_out": slope / MU_0,
                "in_0": attempt.middle,
                "out_0": float(attempt.weights[-2] - attempt.weights[-1]),
            },
            law=LAW,
            cells=CellWeights(
                self.thresholds, self.widths, weights.reshape(PLAYS + 1, len(WIDTHS))
            ),
            dynamics=Dynamics(
                attempt.lag, tuple(t for t, _ in kept), tuple(w for _, w in kept), max(self.rates)
            ),
        )


def _fewer(loopset: Loops) -> Loops:
    """Thin long records to every n-th sample."""
    every = 1 + sum(loop.n for loop in loopset.loops) // MOST_SAMPLES
    if every == 1:
        return loopset
    loops = [
        replace(
            loop,
            input=loop.input[::every],
            output=loop.output[::every],
            time=None if loop.time is None else loop.time[::every],
        )
        for loop in loopset.loops
    ]
    return loopset.with_loops(loops)


def _known(loop: Loop) -> NDArray[np.bool_]:
    """Return from where on it does not matter how a body came to rest: after the first far end."""
    counted = np.ones(loop.n, dtype=np.bool_)
    if loop.history.kind == "settled":
        return counted
    far = np.abs(loop.input - loop.input[0])
    first = int(np.argmax(far >= REACHED * far.max()))
    if first <= MOST_UNKNOWN * loop.n:
        counted[:first] = False
    return counted


def _before(history: History, drive: FloatArray) -> FloatArray:
    """Return what moved the cells before a loop."""
    points = np.array(history.turning_points)
    return np.concatenate([points, drive]) if history.kind == "settled" else points


def moved(drive: FloatArray, thresholds: FloatArray, start: FloatArray) -> FloatArray:
    """Return the play of each cell over a drive, shape (n, cells)."""
    low, high = drive[:, None] - thresholds, drive[:, None] + thresholds
    moved_to = np.empty_like(low)
    now = start
    for i in range(drive.size):
        now = np.minimum(np.maximum(now, low[i]), high[i])
        moved_to[i] = now
    return moved_to
