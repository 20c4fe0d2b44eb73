"""Is it worth it? What the best curve without memory leaves, and what follows a reversal."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from anhyst.data.estimates import noise
from anhyst.data.lag import lag_line
from anhyst.data.loops import Loop, Loops, folded, is_even
from anhyst.data.output_map import full_scale, name_full_scale
from anhyst.data.path import Branch, branches, separation, smooth, turning_points
from anhyst.data.resonance import resonance_line
from anhyst.data.symmetry import recentre, turning_line
from anhyst.support.numeric import FloatArray
from anhyst.support.units import in_small_unit

Level = Literal["yes", "little", "no", "unknown"]

_MEAN_OF_NORMAL = 0.7979
"""Mean absolute value of a normal variable of unit standard deviation."""
MIN_SAMPLES_PER_BRANCH = 200
"""Samples of a branch that resolve its loop; noise faster than they are is averaged out of the gain."""
_BINS = 4000
_RUN_IN = 6
"""With more branches than this, the first is left out of the loop's width."""


WHERE_IT_PAYS: Mapping[str, str] = MappingProxyType(
    {
        # The loops are narrow, or noise covers them.
        "loops": "it would pay where loops stand well above the noise: iron with wider loops, or "
        "several cycles averaged",
        # A bearing steps behind its position feedback.
        "feedback": "it would pay where feedback does not hide what the force is off: a stage that "
        "follows set-points with feedforward, a force without a sensor, or iron that hardly "
        "answers after a reversal",
        # A force is set without a sensor of it.
        "force": "it would pay where the gap stands still or moves little: there the iron makes the "
        "error, and not the map over the gap",
        # A stage follows set-points with feedforward.
        "stage": "it would pay where set-points change and move the mass, the calibration holds, and "
        "the iron keeps its turning points",
        # A piezo stage follows a reference behind an integrator.
        "piezo": "it would pay with a faster reference or a slower feedback, which then cannot "
        "follow the loop",
    }
)
"""What a verdict adds where compensation does not pay, a physical situation each.

The figures behind them: docs/choosing.md, "Does it pay?".
"""


@dataclass(frozen=True, slots=True)
class Width:
    """How far apart the branches of a loop are at most.

    ``width`` in the input's unit, at equal output; ``height`` in the output's unit, at equal input.
    """

    width: float
    height: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a hysteresis model can gain over the best single-valued curve.

    All figures of the output are in its SI unit; relative ones refer to `largest_output`, those
    of the input to its largest range.
    """

    level: Level  # ``unknown`` if dynamics make the loop
    width: float  # largest loop width (input) and height (output) of all loops
    width_relative: float
    height: float
    height_relative: float
    # mean and worst deviation of the best monotone curve, one a scheduling value
    single_mean: float
    single_mean_relative: float
    single_worst: float
    single_worst_relative: float
    noise_mean: float  # mean deviation that the noise alone causes: no model gets below
    noise_relative: float
    # share of the mean deviation that a perfect hysteresis model takes away at most, in the band of
    # the loops: averages of samples that still resolve a branch
    gain: float
    averaged: int  # largest number of samples in such an average
    band_noise_relative: float  # mean deviation that the noise alone causes in these averages
    dynamics: str  # why the loops are not hysteresis but dynamics; empty if nothing says so
    sentences: tuple[str, ...]  # the same in words

    @property
    def worthwhile(self) -> bool:
        """Whether a hysteresis model is worth having."""
        return self.level == "yes"


def monotone_fit(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Best non-decreasing sequence in the weighted least-squares sense (pool adjacent violators).

    >>> monotone_fit(np.array([1.0, 3.0, 2.0]), np.ones(3)).tolist()
    [1.0, 2.5, 2.5]
    """
    means: list[float] = []
    sums: list[float] = []
    sizes: list[int] = []
    for value, weight in zip(values.tolist(), weights.tolist(), strict=True):
        mean, total, size = value, weight, 1
        while means and means[-1] >= mean:
            before = sums.pop()
            mean = (means.pop() * before + mean * total) / (before + total)
            total += before
            size += sizes.pop()
        means.append(mean)
        sums.append(total)
        sizes.append(size)
    return np.repeat(np.array(means), sizes)


def single_valued(loopset: Loops) -> list[tuple[Loop, FloatArray]]:
    """Return each loop, and the deviation of its output from the best monotone curve of its gap."""
    centred, even = recentre(loopset)
    groups: dict[float | None, list[tuple[Loop, FloatArray, FloatArray]]] = {}
    for loop, moved in zip(loopset.loops, centred.loops, strict=True):
        curve = (loop, *folded(moved, even=even))
        groups.setdefault(loop.schedule_value, []).append(curve)
    return [pair for curves in groups.values() for pair in _residuals(curves)]


def loop_width(loop: Loop, *, even: bool) -> Width:
    """Largest distance between neighbouring branches of a loop, noise averaged out."""
    size, answer = folded(loop, even=even)
    span, height = float(np.ptp(size)), float(np.ptp(answer))
    parts = branches(size)
    if len(parts) > _RUN_IN:
        parts = parts[1:]  # how the record got going says nothing about the cycles after it
    widest = highest = 0.0
    for before, after in itertools.pairwise(parts):
        width = separation(size, answer, before, after)
        if width is None or np.ptp(width[0]) < 0.2 * span:
            continue
        highest = max(highest, float(np.max(np.abs(width[1]))))
        widest = max(widest, separation_sideways(size, answer, before.rows, after.rows, height))
    return Width(widest, highest)


def separation_sideways(
    size: FloatArray, answer: FloatArray, first: slice, second: slice, height: float
) -> float:
    """Largest distance in input between two branches at equal output, outer tenths left out."""
    curves = []
    for rows in (first, second):
        x, y = smooth(size[rows], answer[rows], bins=200)
        if y[-1] < y[0]:
            y = -y
        curves.append((x, np.maximum.accumulate(y)))
    (x1, y1), (x2, y2) = curves
    low, high = max(y1[0], y2[0]) + 0.1 * height, min(y1[-1], y2[-1]) - 0.1 * height
    if high <= low:
        return 0.0
    levels = np.linspace(low, high, 101)
    return float(np.max(np.abs(np.interp(levels, y1, x1) - np.interp(levels, y2, x2))))


def largest_output(loopset: Loops) -> float:
    """Return the full scale of the output of all loops, as `full_scale`; 1 if it is zero."""
    return full_scale(loopset.output, (loop.output for loop in loopset.loops)) or 1.0


def judge(loopset: Loops) -> Verdict:
    """Weigh loop width, the best single-valued curve and the noise against each other."""
    centred, even = recentre(loopset)
    widths = [loop_width(loop, even=even) for loop in centred.loops]
    pairs = single_valued(loopset)  # grouped by gap, not in the order of the loops
    pooled = np.abs(np.concatenate([residual for _, residual in pairs]))
    mean, worst = float(pooled.mean()), float(pooled.max())
    band = [_in_band(*pair) for pair in pairs]
    band_mean, band_noise = np.average(
        [each[:2] for each in band], axis=0, weights=[loop.n for loop, _ in pairs]
    ).tolist()
    dynamics = resonance_line(loopset) or lag_line(loopset) or turning_line(loopset)
    counts = np.array([loop.n for loop in loopset.loops], dtype=np.float64)
    sigmas = np.array([noise(loop.output) for loop in loopset.loops])
    floor = _MEAN_OF_NORMAL * float(np.average(sigmas, weights=counts))
    largest = largest_output(loopset)
    span = max(float(np.ptp(loop.input)) for loop in loopset.loops)
    gain = max(0.0, 1.0 - band_noise / band_mean) if band_mean > 0.0 else 0.0
    width = max(measured.width for measured in widths)
    height = max(measured.height for measured in widths)
    level: Level = "yes"
    if dynamics:
        level = "unknown"
    elif band_mean < 5e-4 * largest or gain < 0.3:
        level = "no"
    elif band_mean < 2e-3 * largest or gain < 0.6:
        level = "little"
    figures = Verdict(
        level=level,
        width=width,
        width_relative=width / span,
        height=height,
        height_relative=height / largest,
        single_mean=mean,
        single_mean_relative=mean / largest,
        single_worst=worst,
        single_worst_relative=worst / largest,
        noise_mean=floor,
        noise_relative=floor / largest,
        gain=gain,
        averaged=max(each[2] for each in band),
        band_noise_relative=band_noise / largest,
        dynamics=dynamics,
        sentences=(),
    )
    return _worded(loopset, figures)


def _in_band(loop: Loop, residual: FloatArray) -> tuple[float, float, int]:
    """Return the mean residual and that of noise alone in averages that resolve a branch, their size."""
    size = max(int(loop.n / (MIN_SAMPLES_PER_BRANCH * len(branches(loop.input))) + 0.5), 1)
    starts = np.arange(0, loop.n - size + 1, size)
    over, output = (np.add.reduceat(each, starts) / size for each in (residual, loop.output))
    # The last average may have more samples.
    inside = slice(0, -1) if size > 1 else slice(None)
    return float(np.mean(np.abs(over[inside]))), _MEAN_OF_NORMAL * noise(output[inside]), size


def _worded(loopset: Loops, figures: Verdict) -> Verdict:
    drive, answer = loopset.input, loopset.output
    reference = name_full_scale(answer, largest_output(loopset))
    unit, scale = in_small_unit(answer, largest_output(loopset))
    conclusion = {
        "yes": "A hysteresis model is worth it",
        "little": "A hysteresis model gains little",
        "no": "A hysteresis model is not worth it",
        "unknown": "A hysteresis model cannot be judged from these loops",
    }[figures.level]
    noise_alone = f"The noise alone makes {figures.noise_relative:.3%}"
    band = ""
    if figures.averaged > 1:
        band = f" in averages of {figures.averaged} samples"
        noise_alone += f" of a sample and {figures.band_noise_relative:.3%}{band}"
    verdict = (
        f"{conclusion}: {figures.dynamics}."
        if figures.dynamics
        else f"{conclusion}: it can take away at most {figures.gain:.0%} of the mean error of the "
        f"best single-valued curve{band}."
    )
    needs_more = figures.level in {"little", "no"}
    sentences = (
        f"The widest loop is {figures.width:.4g} {drive.unit} wide ({figures.width_relative:.1%} "
        f"of the {drive.name.replace('_', ' ')}'s range) and {scale * figures.height:.4g} {unit} "
        f"high ({figures.height_relative:.1%} of {reference}).",
        f"The best single-valued curve misses by {figures.single_mean_relative:.2%} on average and "
        f"{figures.single_worst_relative:.2%} at worst.",
        f"{noise_alone}, which no model gets below.",
        verdict,
        *(
            (f"{WHERE_IT_PAYS['loops'][0].upper()}{WHERE_IT_PAYS['loops'][1:]}.",)
            if needs_more
            else ()
        ),
    )
    values = {name: getattr(figures, name) for name in Verdict.__slots__}
    return Verdict(**{**values, "sentences": sentences})


def _residuals(
    curves: list[tuple[Loop, FloatArray, FloatArray]],
) -> list[tuple[Loop, FloatArray]]:
    size = np.concatenate([along for _, along, _ in curves])
    answer = np.concatenate([own for _, _, own in curves])
    order = np.argsort(size, kind="stable")
    starts = np.linspace(0, size.size, min(size.size, _BINS) + 1).astype(np.intp)[:-1]
    counts = np.diff(np.concatenate((starts, [size.size]))).astype(np.float64)
    x = np.add.reduceat(size[order], starts) / counts
    y = np.add.reduceat(answer[order], starts) / counts
    x, first = np.unique(x, return_index=True)
    y = np.add.reduceat(y * counts, first)
    counts = np.add.reduceat(counts, first)
    y = y / counts
    rising = float(np.dot(x - x.mean(), y - y.mean())) >= 0.0
    curve = monotone_fit(y, counts) if rising else -monotone_fit(-y, counts)
    return [(loop, own - np.interp(along, x, curve)) for loop, along, own in curves]


_REACH = 0.5
"""Widths of the loop after a reversal that count as just after it."""
_LEVELS = (0.25, 0.9)
"""Outputs, in parts of the largest, between which reversals count: not where hardly anything
answers, nor in saturation."""
_AROUND = 0.1
"""Share of the range, to either side, over which the slope without memory is taken."""
_BEFORE = 4
"""Samples that show where a branch ended."""
_REVERSAL_BINS = 400
_FEWEST = 8
"""Samples from which something is estimated."""
_UNSURE = 0.05
"""Standard error above which nothing is estimated."""


def reversal_share(loopset: Loops) -> float | None:
    """Slope of the output just after a rising input was turned back, in parts of the static slope.

    Without hysteresis it is one; an iron that is all pinned does not answer at all at first. The
    static slope is that of all branches together around the same input. Reversals of all loops are
    taken together, by least squares. A falling input that is turned leaves more of the slope.
    """
    even = is_even(loopset)
    reach = _REACH * max(loop_width(loop, even=even).width for loop in loopset.loops)
    expected: list[FloatArray] = []
    answered: list[FloatArray] = []
    for loops in loopset.by_schedule().values():
        curves = [folded(loop, even=even) for loop in loops]
        every = np.concatenate([size for size, _ in curves])
        answers = np.concatenate([answer for _, answer in curves])
        low, high = (level * float(np.max(np.abs(answers))) for level in _LEVELS)
        middle = smooth(every, answers, _REVERSAL_BINS)
        for size, answer in curves:
            for before, after in itertools.pairwise(branches(size)):
                if not (before.rising and low <= abs(answer[after.start]) <= high):
                    continue
                back, change = _after(size, answer, before, after, reach)
                expected.append(back * _slope(*middle, float(size[after.start])))
                answered.append(change)
    return _share(np.concatenate(expected), np.concatenate(answered)) if expected else None


def _slope(size: FloatArray, answer: FloatArray, at: float) -> float:
    near = np.abs(size - at) <= _AROUND * float(np.ptp(size))
    if np.count_nonzero(near) < _FEWEST:
        return 0.0
    # A parabola, so that the bend of the curve does not tilt its slope.
    return float(np.polynomial.Polynomial.fit(size[near] - at, answer[near], 2).deriv()(0.0))


def _after(
    size: FloatArray, answer: FloatArray, before: Branch, after: Branch, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Return how far input and output went back just after a reversal, sample by sample."""
    tip = after.start
    rows = slice(max(before.start, tip + 1 - _BEFORE), tip + 1)
    line = np.polynomial.Polynomial.fit(np.arange(rows.stop - rows.start), answer[rows], 1)
    end = float(line(rows.stop - rows.start - 1))
    back = size[tip + 1 : after.stop] - size[tip]
    beyond = np.flatnonzero(np.abs(back) > reach)
    count = int(beyond[0]) if beyond.size else back.size
    return back[:count], answer[tip + 1 : tip + 1 + count] - end


def _share(expected: FloatArray, answered: FloatArray) -> float | None:
    weight = float(expected @ expected)
    if expected.size < _FEWEST or weight == 0.0:
        return None
    share = float(expected @ answered) / weight
    error = float(np.std(answered - share * expected)) / math.sqrt(weight)
    return min(max(share, 0.0), 1.0) if error < _UNSURE else None


_WINDOW = 0.08
"""Share of the range, to either side of where a small loop closes, that is looked at."""
_SAME = 0.02
"""Share of the range within which an input comes back to where it was turned."""


@dataclass(frozen=True, slots=True)
class Closing:
    """Where the input comes back to a turning point, a small loop behind it, and goes on.

    An iron that keeps its turning points then goes on as if the small loop had not been.
    """

    at: float  # input there
    before: slice  # samples of the branch that was turned there, or of that which leaves from there
    after: slice  # of the one that passes there again, or leaves from there again
    beyond: float  # 1 or -1: to which side of it `after` counts; 0 for both

    def step(self, loop: Loop, output: FloatArray) -> float:
        """Return how far an output without noise is off after the small loop."""
        ends = []
        for rows in (self.before, self.after):
            order = np.argsort(loop.input[rows])
            ends.append(float(np.interp(self.at, loop.input[rows][order], output[rows][order])))
        return ends[1] - ends[0]

    def measured(self, loop: Loop, followed: FloatArray) -> tuple[float, float] | None:
        """Return that of the measured output and its standard error; None of too few samples.

        Seen in what a model that follows the loop leaves of it, which is straight nearby.
        """
        window, distances, left = _WINDOW * float(np.ptp(loop.input)), [], []
        for rows, side in ((self.before, 0.0), (self.after, self.beyond)):
            distance = (loop.input[rows] - self.at) / window
            near = (np.abs(distance) <= 1.0) & (side * distance >= 0.0)
            if np.count_nonzero(near) < _FEWEST // 2:
                return None
            distances.append(distance[near])
            left.append((loop.output - followed)[rows][near])
        stepped = np.repeat([0.0, 1.0], [on_side.size for on_side in distances])
        along = np.concatenate(distances)
        terms = np.column_stack([np.ones_like(along), along, stepped])
        coefficients, squares, _, _ = np.linalg.lstsq(terms, np.concatenate(left))
        if squares.size == 0:
            return None
        spread = float(squares[0]) / (along.size - 3) * float(np.linalg.inv(terms.T @ terms)[2, 2])
        return float(coefficients[2]) + self.step(loop, followed), math.sqrt(spread)


def closings(loop: Loop) -> Iterator[Closing]:
    """Yield where the small loops of a record close."""
    drive, span = loop.input, float(np.ptp(loop.input))
    turns = turning_points(drive, _SAME / 2.0 * span)
    ways = [slice(begin, end + 1) for begin, end in itertools.pairwise(turns.tolist())]
    open_: list[int] = []
    for number, end in enumerate(drive[turns[1:]].tolist(), start=1):
        up = math.copysign(1.0, end - drive[turns[number - 1]])
        while len(open_) > 1:
            first = open_[-2]
            at = float(drive[turns[first]])
            ahead = up * (end - at) / span
            if ahead < -_SAME:
                break
            passed = int(ahead > _SAME)  # else it turns where it was turned before
            if number - passed < len(ways):
                yield Closing(at, ways[first - passed], ways[number - passed], passed * up)
            del open_[-2:]
            if not passed:
                break
        open_.append(number)
