"""Whether a fit is done: how much of what it leaves is noise, of what shape the rest is, in one line.

A fit is done when what it leaves looks like noise. Signs that keep and samples that go with those
before them say that it does not (:func:`_is_white`). Then every cause has the shapes that it leaves
(:mod:`.residual_shapes`); noise that is filtered or comes in steps goes with the samples before it too,
so a shape counts only where it explains more than such noise would by chance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from anhyst.data import Loops
from anhyst.data.estimates import estimate_noise
from anhyst.data.output_map import name_full_scale
from anhyst.data.verdict import largest_output, single_valued_residuals
from anhyst.model.actuator import Model
from anhyst.model.residual_shapes import (
    ColouredNoise,
    Residual,
    Shape,
    estimate_coloured_noise,
    orthonormal_basis,
    shape_columns,
)
from anhyst.support.numeric import FloatArray

NEGLIGIBLE_DEVIATION = 1e-4
"""Deviation, in parts of the largest output, that no sensor sees."""

MAX_WORST_IN_RMS = 8.0
"""Largest deviation in units of the rms that noise may reach. Normal noise of 1e6 samples reaches 5."""
MIN_OUTLIER = 0.01
"""Smallest deviation that is reported as an outlier, in parts of the full scale."""
_MIN_JUMP_SHARE = 0.1
"""Step of the input between two samples, in parts of its range, that is called a jump."""

MAX_UNEXPLAINED = 0.05
"""Largest rms deviation beyond the noise, in parts of the full scale, with which a model is usable."""
_MAX_CERTAIN_NOISE_RATIO = 2.0
"""Largest rms in units of the noise of the record that is noise, if the model would be unusable."""

_MAX_STEPS_PER_DIFFERENCE = 3
"""Steps of a converter in the smallest difference of two outputs, at most."""
_MAX_LAG_SAMPLES = 4
"""Samples before one, with which it may go."""
_MAX_WHITE_SIGMAS = 3.1
"""Standard deviations by which white noise may go with what was before it, or keep its sign."""
_MAX_RECORD_SAMPLES, _MAX_TOTAL_SAMPLES, _MIN_RECORD_SAMPLES = 300, 1500, 40
"""Samples of a record, and of all, that are looked at for shapes, at most; but so many of each."""
_MAX_NOISE_RATIO = 6.0
"""Smooth deviations this many times the noise of the record are no filtered noise."""
_EQUAL_WORTH_SHARE = 0.97
"""Share of what the best shape explains with which one of fewer numbers is preferred."""


@dataclass(frozen=True, slots=True)
class Outlier:
    """The largest deviation of a fit, which is too large for noise of its rms."""

    size: float  # in parts of the full scale
    record: int  # index of the record
    sample: int  # index of the sample in the record
    is_at_jump: bool  # whether the input jumps there


@dataclass(frozen=True, slots=True)
class ResidualAnalysis:
    """The residual of a fit, and its causes."""

    rms: float  # all of it, in parts of the largest output
    noise: float  # what of it is noise of the sensors, in the same parts
    beyond_noise: float = 0.0  # what of it is none; zero where the fit is done
    # shapes of this and the share of its variance that they explain, the largest first; empty where
    # it has none of those known
    shapes: tuple[tuple[Shape, float], ...] = ()
    start_samples: int = 0  # samples at the beginning of a record in which a wrong start shows
    # largest deviation, if the rms does not explain it; what else is said is without such samples
    outlier: Outlier | None = None

    @property
    def is_noise(self) -> bool:
        """Whether the residual is noise at every sample."""
        return self.beyond_noise == 0.0 and self.outlier is None

    @property
    def unexplained(self) -> float:
        """Return the rms of all samples beyond the noise, in parts of the full scale."""
        return math.sqrt(max(self.rms**2 - self.noise**2, 0.0))


def analyse_residual(records: Sequence[Residual], span: float) -> ResidualAnalysis:
    """Assess the residual of a fit."""
    off = np.concatenate([record.deviation for record in records])
    rms = float(np.sqrt(np.mean(off**2))) / span
    written = np.concatenate([record.measured for record in records])
    if rms < NEGLIGIBLE_DEVIATION or float(np.max(np.abs(off))) <= 0.75 * _quantisation_step(
        written
    ):  # rounded digits
        return ResidualAnalysis(rms, rms)
    outlier = _find_outlier(records, rms, span)
    if outlier is not None:
        limit = MAX_WORST_IN_RMS * rms * span
        calm = [
            replace(each, deviation=np.where(np.abs(each.deviation) < limit, each.deviation, 0.0))
            for each in records
        ]
        return replace(analyse_residual(calm, span), rms=rms, outlier=outlier)
    # White is not enough: a resonance that a random input excites leaves a white residual, too.
    noisy = float(
        np.mean(
            [min(estimate_noise(each.measured), estimate_noise(each.deviation)) for each in records]
        )
    )
    most_noise = noisy * (_MAX_NOISE_RATIO if rms <= MAX_UNEXPLAINED else _MAX_CERTAIN_NOISE_RATIO)
    if rms * span <= most_noise and _is_white([record.deviation for record in records]):
        return ResidualAnalysis(rms, rms)
    most = min(_MAX_RECORD_SAMPLES, max(_MIN_RECORD_SAMPLES, _MAX_TOTAL_SAMPLES // len(records)))
    seen = [record.every_nth(math.ceil(record.deviation.size / most)) for record in records]
    return _attribute_to_shapes(seen, rms, span, (noisy, most_noise))


def _find_outlier(records: Sequence[Residual], rms: float, span: float) -> Outlier | None:
    """Return the largest deviation; None if noise of this rms may reach it."""
    worst = [int(np.argmax(np.abs(record.deviation))) for record in records]
    sizes = [abs(float(each.deviation[at])) for each, at in zip(records, worst, strict=True)]
    index = int(np.argmax(sizes))
    size, drive, sample = sizes[index] / span, records[index].drive, worst[index]
    if size < max(MAX_WORST_IN_RMS * rms, MIN_OUTLIER):
        return None
    steps = np.abs(np.diff(drive[max(sample - _MAX_LAG_SAMPLES, 0) : sample + _MAX_LAG_SAMPLES]))
    is_at_jump = float(steps.max(initial=0.0)) > _MIN_JUMP_SHARE * float(np.ptp(drive))
    return Outlier(size, index, sample, is_at_jump)


def _quantisation_step(values: FloatArray) -> float:
    """Step of a converter or of written digits: what all differences are multiples of; else zero."""
    gaps = np.diff(np.unique(values))
    gaps = gaps[gaps > 1e-9 * float(np.ptp(values))]
    if not gaps.size:
        return 0.0
    for parts in range(1, _MAX_STEPS_PER_DIFFERENCE + 1):
        step = float(gaps.min()) / parts
        if float(np.mean(np.abs(gaps / step - np.rint(gaps / step)) < 0.05)) > 0.95:
            return step
    return 0.0


def _is_white(parts: Sequence[FloatArray]) -> bool:
    """Whether no sample goes with those before it, by signs and by products."""
    signs = [np.sign(part[part != 0.0]) for part in parts]
    pairs = sum(max(sign.size - 1, 0) for sign in signs)
    kept = sum(int(np.sum(sign[1:] == sign[:-1])) for sign in signs)
    if pairs and kept - 0.5 * pairs > _MAX_WHITE_SIGMAS * 0.5 * math.sqrt(pairs):
        return False
    power = sum(float(part @ part) for part in parts)
    samples = sum(part.size for part in parts)
    for lag in range(1, _MAX_LAG_SAMPLES + 1):
        together = sum(float(part[lag:] @ part[:-lag]) for part in parts if part.size > lag)
        if together > _MAX_WHITE_SIGMAS * power / math.sqrt(samples):
            return False
    return True


@dataclass(frozen=True, eq=False)
class _ShapeVariant:
    """One way in which a shape may show: orthonormal columns, and what noise gives by chance."""

    shape: Shape
    columns: FloatArray
    expected_squares: float

    def excess_squares(self, rest: FloatArray) -> float:
        """Sum of squares of that part, less chance."""
        along = self.columns.T @ rest
        return float(along @ along) - self.expected_squares


def _attribute_to_shapes(
    records: Sequence[Residual], rms: float, span: float, noise_limits: tuple[float, float]
) -> ResidualAnalysis:
    """Find the shapes that the residual certainly has, beyond the likely and the largest noise."""
    noisy, most_noise = noise_limits
    off = np.concatenate([record.deviation for record in records])
    bases = [
        (name, orthonormal_basis(way))
        for name, each in shape_columns(records).items()
        for way in each
    ]
    whole = orthonormal_basis(np.hstack([way for _, way in bases]))
    sizes = [record.deviation.size for record in records]
    around = estimate_coloured_noise(off, whole, sizes)
    if rms * span > max(
        most_noise, NEGLIGIBLE_DEVIATION * span
    ):  # no filtered noise: curves, however fine
        white = max(noisy, NEGLIGIBLE_DEVIATION * span) ** 2
        around = ColouredNoise(tuple(sizes), white, 0.0, float(max(off.size - whole.shape[1], 2)))
    ways = [_ShapeVariant(name, way, around.expected_squares(way)) for name, way in bases]
    attributed: list[tuple[Shape, float]] = []
    rest, first = off, 0
    while ways:
        # The shape that explains most, or one with fewer numbers that explains almost as much.
        worths = [each.excess_squares(rest) for each in ways]
        enough = max(worths) - (1.0 - _EQUAL_WORTH_SHARE) * abs(max(worths))
        as_good = [each for each, worth in zip(ways, worths, strict=True) if worth >= enough]
        way = min(as_good, key=lambda each: each.columns.shape[1])
        worth, size = way.excess_squares(rest), way.columns.shape[1]
        if around.can_explain(worth + way.expected_squares, way.expected_squares, size):
            break
        attributed.append((way.shape, worth / off.size))
        part = way.columns @ (way.columns.T @ rest)
        first = (
            _count_start_samples(records, part, around.variance) if way.shape == "start" else first
        )
        rest = rest - part
        ways = [other for other in ways if other.shape != way.shape]
    spread = float(np.sqrt(np.mean(rest**2)))
    if spread <= max(most_noise, NEGLIGIBLE_DEVIATION * span):
        noisy = spread
    noisy = min(noisy / span, rms)
    beyond = math.sqrt(rms**2 - noisy**2)
    if beyond < NEGLIGIBLE_DEVIATION or not (attributed or noisy < spread / span):
        return ResidualAnalysis(rms, rms)
    shares = tuple((name, min(size / (beyond * span) ** 2, 1.0)) for name, size in attributed)
    return ResidualAnalysis(rms, noisy, beyond, shares, first)


def _count_start_samples(records: Sequence[Residual], part: FloatArray, variance: float) -> int:
    """Count samples at the beginning of a record until a wrong start no longer shows."""
    longest, start = 0, 0
    for record in records:
        seen = np.flatnonzero(
            np.abs(part[start : start + record.deviation.size]) > math.sqrt(variance)
        )
        longest = max(longest, int(seen[-1]) + 1 if seen.size else 0)
        start += record.deviation.size
    return longest


_MIN_SECOND_SHARE = 0.2
"""Share of what is no noise from which a second shape is named."""


def analyse_loops(loopset: Loops, fitted: Sequence[FloatArray]) -> ResidualAnalysis:
    """Judge what a model leaves of loops."""
    records = []
    for loop, output in zip(loopset.loops, fitted, strict=True):
        values, at = loopset.schedule_values, loop.schedule_value
        gap = values.index(at) if at in values else 0
        off, is_cycle = output - loop.output, loop.history.kind == "settled"
        records.append(Residual(loop.input, loop.output, off, gap, is_cycle))
    return analyse_residual(records, largest_output(loopset))


def explain_rejection(residual: ResidualAnalysis, loopset: Loops) -> str:
    """Return why a model must not be used; empty if its deviation is small, or is noise."""
    if residual.unexplained <= MAX_UNEXPLAINED:
        return ""
    text = (
        f"the model deviates from the loops by {100.0 * residual.rms:.2g} % of "
        f"{name_full_scale(loopset.output)} rms, of which noise explains "
        f"{100.0 * residual.noise:.2g} %: do not use it"
    )
    residuals = np.concatenate([residual for _, residual in single_valued_residuals(loopset)])
    single = float(np.sqrt(np.mean(residuals**2))) / largest_output(loopset)
    if single < 0.5 * residual.rms:
        return f"{text}; a single-valued curve deviates by {100.0 * single:.2g} % only"
    return (
        f"{text}; no law here follows these loops, or the output depends on more than the "
        f"{loopset.input.name} and its history: plot the record (anhyst inspect --plot), and measure "
        "more slowly or over a smaller range"
    )


def describe_residual(residual: ResidualAnalysis, loopset: Loops, model: Model) -> str:
    """Return one line: how much of the residual is noise, its shape, the remedy, and outliers."""
    text, outlier = _residual_text(residual, loopset, model), residual.outlier
    if outlier is None:
        return text
    loop = loopset.loops[outlier.record]
    time = "" if loop.time is None else f" ({loop.time[outlier.sample]:.4g} s)"
    cause = "a spike or a disturbance; look there"
    if outlier.is_at_jump:
        cause = "the input jumps there and the output follows late"
    return (
        f"{text}; the worst deviation, {100.0 * outlier.size:.3g} %, is at sample "
        f"{outlier.sample + 1}{time} of {loopset.describe(loop)}: {cause}"
    )


def _residual_text(residual: ResidualAnalysis, loopset: Loops, model: Model) -> str:
    full = name_full_scale(loopset.output)
    if residual.beyond_noise == 0.0:
        done = ": the fit is done" if residual.is_noise else ""
        return f"the residual ({100.0 * residual.noise:.2g} % of {full} rms) is noise, or too small to see{done}"
    text = (
        f"a residual of {100.0 * residual.beyond_noise:.2g} % of {full} rms is not noise "
        f"(noise: {100.0 * residual.noise:.2g} %): "
    )
    if not residual.shapes or residual.shapes[0][1] < _MIN_SECOND_SHARE:
        return text + (
            "smooth along the record, but of no shape that repeats: details finer than the law has, "
            "or a sensor that lags; inspect the record"
        )
    at = loopset.schedule.name if loopset.schedule is not None else "gap"
    main, share = residual.shapes[0]
    text += f"{100.0 * share:.0f} % of its square " if share < 1.0 - _MIN_SECOND_SHARE else ""
    text += _SHAPE_TEXTS[main].what.format(
        drive=loopset.input.name, at=at, first=residual.start_samples
    )
    if len(residual.shapes) > 1 and residual.shapes[1][1] >= _MIN_SECOND_SHARE:
        second, share = residual.shapes[1]
        text += f" ({100.0 * share:.0f} %: {_SHAPE_TEXTS[second].short.format(at=at)})"
    if main == "gap":
        remedy = f"measure another {at}"
        remedy += " or try --gap-map circuit" if model.gap_map not in {"circuit", "free"} else ""
        return f"{text}: the gap map '{model.gap_map}' cannot follow; {remedy}"
    is_named = model.provenance.settings.get("law_wanted", "auto") != "auto"
    other = "; try --law auto" if is_named else ", nor can any that was compared"
    return f"{text}: {_SHAPE_TEXTS[main].advice.format(other=other)}"


class _ShapeText(NamedTuple):
    """How a shape of the residual is called, and what helps."""

    what: str  # if it is the largest
    short: str  # after the largest
    advice: str


_SHAPE_TEXTS: dict[Shape, _ShapeText] = {
    "input": _ShapeText(
        "a smooth function of the {drive}, alike on rising and falling branches",
        "a smooth function of the input",
        "the law's curve cannot follow, as in saturation{other}",
    ),
    "direction": _ShapeText(
        "of opposite sign on rising and falling branches",
        "of opposite sign on rising and falling branches",
        "the width of the loops is not that of the law{other}",
    ),
    "gap": _ShapeText("differs from {at} to {at}", "from {at} to {at}", ""),
    "amplitude": _ShapeText(
        "differs between inner and outer loops",
        "inner against outer loops",
        "the law cannot follow all sizes of loops{other}",
    ),
    "start": _ShapeText(
        "in the first {first} samples of a record",
        "at the start of records",
        "they do not begin as their history says; check --history",
    ),
    "drift": _ShapeText(
        "runs steadily with time",
        "with time",
        "a sensor drifts; let it warm up, or remove the drift (--clean)",
    ),
}
