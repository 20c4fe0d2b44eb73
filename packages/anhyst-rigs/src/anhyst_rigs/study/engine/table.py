"""The table of a study: what methods gave in its cases, and whether a model is worth it.

A figure is a column by its key, a mean over the seeds; how it is called and shown is a
:class:`Metric`. One rule judges every study: a figure of the model is compared with that of the
baseline which is best in it. A difference counts where it is certain: more than the noise of both
leaves open. The model is worth it where some figures are certainly less and none is more.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from anhyst.compensate.methods import METHODS
from anhyst.support.atomic import PathLike, write_json
from anhyst.support.errors import NegativeResult
from anhyst.support.kinds import MethodName
from anhyst.support.result import Result
from anhyst_rigs.rig.recording import Recording

Level = Literal["yes", "mixed", "no", "unknown"]
VERDICT_TITLES: Mapping[Level, str] = {
    "yes": "Worth it",
    "mixed": "Worth it in part",
    "no": "Not worth it here",
    "unknown": "No verdict",
}
MAX_LISTED = 4
"""Comparisons that are named one by one; more are counted."""


@dataclass(frozen=True)
class Interval:
    """A mean and how well it is known."""

    mean: float
    half_width: float  # of the confidence interval
    count: int  # of the runs behind it
    # Of these, the ones in which levitation was lost. If there are any, there is no mean: what the
    # others did would flatter.
    lost: int = 0

    def exceeds(self, floor: Interval) -> bool:
        """Whether it is certainly above another mean, noise of both taken as independent."""
        return self.mean - floor.mean > math.hypot(self.half_width, floor.half_width)

    def as_dict(self) -> dict[str, Any]:
        """Return it as files hold it."""
        return {"mean": self.mean, "half_width": self.half_width, "count": self.count}


def lost_interval(lost: int, count: int) -> Interval:
    """Return what stands in place of a mean of runs of which some lost levitation."""
    return Interval(math.nan, math.nan, count, lost)


def mean_interval(values: ArrayLike, level: float = 0.95) -> Interval:
    """Return the mean of repeated measurements and its confidence interval (Student)."""
    row = np.asarray(values, dtype=float)
    if len(row) < 2:
        raise ValueError("a confidence interval needs two values at least")
    if not np.all(np.isfinite(row)):
        return Interval(mean=float(np.mean(row)), half_width=math.nan, count=len(row))
    factor = float(stdtrit(len(row) - 1, 0.5 + 0.5 * level))
    spread = float(np.std(row, ddof=1)) / math.sqrt(len(row))
    return Interval(mean=float(np.mean(row)), half_width=factor * spread, count=len(row))


@dataclass(frozen=True)
class MeanRatio:
    """A ratio of means with its confidence interval."""

    value: float  # infinite over a mean of zero
    low: float  # ends of the interval; 0 and infinite where the lower mean may be zero
    high: float


def mean_ratio(upper: ArrayLike, lower: ArrayLike, level: float = 0.95) -> MeanRatio:
    """Return the ratio of the means of pairs, with Fieller's interval.

    It holds all ratios R for which the mean of ``upper - R lower`` may be zero. So it holds 1
    exactly where the mean of the difference may be zero.
    """
    rows = np.array([upper, lower], dtype=float)
    count = rows.shape[1]
    factor = float(stdtrit(count - 1, 0.5 + 0.5 * level)) ** 2 / count
    a, b = (float(mean) for mean in rows.mean(axis=1))
    (aa, ab), (_, bb) = (factor * np.cov(rows)).tolist()
    value = a / b if b > 0.0 else math.inf
    # (a - R b)^2 <= aa - 2 R ab + R^2 bb
    square, half, rest = b * b - bb, a * b - ab, a * a - aa
    if square <= 0.0:
        return MeanRatio(value, 0.0, math.inf)
    root = math.sqrt(max(half * half - square * rest, 0.0))
    return MeanRatio(value, max((half - root) / square, 0.0), (half + root) / square)


@dataclass(frozen=True, slots=True)
class ComparedFigure:
    """A figure of a model beside that of a baseline; the smaller one is better."""

    title: str
    baseline: str
    model_value: float
    baseline_value: float
    uncertainty: float  # difference that noise leaves open

    @property
    def is_better(self) -> bool:
        """Whether it is certain that there is a gain."""
        return self.baseline_value - self.model_value > self.uncertainty

    @property
    def is_worse(self) -> bool:
        """Whether it is certain that there is a loss."""
        return self.model_value - self.baseline_value > self.uncertainty

    @property
    def ratio(self) -> float:
        """Figure of the model over that of the baseline; nan where neither leaves anything."""
        if self.baseline_value != 0.0:
            return self.model_value / self.baseline_value
        return math.nan if self.model_value == 0.0 else math.inf


def compare(
    title: str, baseline: str, model_value: Interval, baseline_value: Interval, floor: float = 0.0
) -> ComparedFigure:
    """Compare two means, beyond a floor and what noise of both, taken as independent, leaves open."""
    uncertainty = max(floor, math.hypot(model_value.half_width, baseline_value.half_width))
    return ComparedFigure(title, baseline, model_value.mean, baseline_value.mean, uncertainty)


def strongest_baseline(figures: Mapping[MethodName, Interval]) -> MethodName | None:
    """Return the baseline with the least mean; None where none has one."""
    names = [
        name
        for name, interval in figures.items()
        if METHODS[name].role == "baseline" and math.isfinite(interval.mean)
    ]
    return min(names, key=lambda name: figures[name].mean, default=None)


@dataclass(frozen=True, slots=True)
class Judgement:
    """What came out of all comparisons."""

    level: Level
    text: str

    @property
    def sentence(self) -> str:
        """All of it."""
        return f"{VERDICT_TITLES[self.level]}: {self.text}"


def judge_against_baselines(
    model: str, comparisons: Sequence[ComparedFigure], noun: str, condition: str
) -> Judgement:
    """Judge a model against the strongest baselines; ``instead`` says where it would pay."""
    verdict = judge_comparisons(model, comparisons, noun)
    if verdict.level == "unknown":
        return verdict
    text = f"{model} against the strongest baseline without hysteresis model, {verdict.text}"
    return Judgement(verdict.level, text if verdict.level == "yes" else f"{text}; {condition}")


def judge_comparisons(model: str, comparisons: Sequence[ComparedFigure], noun: str) -> Judgement:
    """Say in which figures a model is certainly less, more or alike, whatever it is compared with."""
    comparable = [
        comparison
        for comparison in comparisons
        if not math.isnan(comparison.ratio) or comparison.baseline_value == comparison.model_value
    ]
    if not comparable:
        return Judgement("unknown", f"{model} was compared with nothing")
    better = [comparison for comparison in comparable if comparison.is_better]
    worse = [comparison for comparison in comparable if comparison.is_worse]
    level: Level = "no" if not better else "mixed" if worse else "yes"
    equal = [
        comparison
        for comparison in comparable
        if not comparison.is_better and not comparison.is_worse
    ]
    parts = [
        f"{word} {_format_comparisons(group, len(comparable), noun)}"
        for word, group in (("less:", better), ("more:", worse), ("alike within the noise:", equal))
        if group
    ]
    return Judgement(level, "; ".join(parts))


def _format_comparisons(comparisons: Sequence[ComparedFigure], count: int, noun: str) -> str:
    """Name figures with their parts of the baseline's, or count them."""
    if count > MAX_LISTED:
        names = " or ".join(dict.fromkeys(f"'{comparison.baseline}'" for comparison in comparisons))
        parts = sorted(
            comparison.ratio for comparison in comparisons if math.isfinite(comparison.ratio)
        )
        span = (
            f", {_format_range(parts[0], parts[-1])} of {names}" if parts else f", against {names}"
        )
        return f"{len(comparisons)} of {count} {noun}{span}"
    by_baseline: dict[str, list[str]] = {}
    for comparison in comparisons:
        by_baseline.setdefault(comparison.baseline, []).append(
            f"{comparison.title} {_format_ratio(comparison.ratio)}"
        )
    return ", ".join(f"{', '.join(parts)} of '{name}'" for name, parts in by_baseline.items())


def _format_ratio(ratio: float) -> str:
    return f"{ratio:.2g}" if math.isfinite(ratio) else "0" if math.isnan(ratio) else "more than 0"


def _format_range(low: float, high: float) -> str:
    return (
        _format_ratio(low)
        if _format_ratio(low) == _format_ratio(high)
        else f"{_format_ratio(low)} to {_format_ratio(high)}"
    )


FIGURES_FILE = "figures.json"
"""What is written beside a recording."""


@dataclass(frozen=True)
class Metric:
    """A figure that methods are judged by; the smaller, the better."""

    key: str  # in files, with its unit
    title: str  # in words
    unit: str  # as it is shown
    factor: float = 1.0  # from SI to that

    @property
    def heading(self) -> str:
        """Of a table: title and unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


@dataclass(frozen=True)
class CaseFigures:
    """What one method gave in one case."""

    # by key; both directions of a step count as one value. Empty if the loop was lost in any run.
    figures: Mapping[str, Interval]
    lost: int  # runs in which the loop was lost, and all runs
    runs: int

    @classmethod
    def summarise(cls, runs: Sequence[Mapping[str, float] | None], **extra_fields: Any) -> Self:
        """Sum up runs, one a seed; None stands for one in which the loop was lost."""
        completed = [run for run in runs if run is not None]
        names = completed[0] if len(completed) == len(runs) else ()
        figures = {name: mean_interval([run[name] for run in completed]) for name in names}
        return cls(figures=figures, lost=len(runs) - len(completed), runs=len(runs), **extra_fields)

    def interval(self, key: str) -> Interval:
        """Return a figure; one without a mean if the loop was lost in any run."""
        return self.figures.get(key) or lost_interval(self.lost, self.runs)

    def as_dict(self) -> dict[str, Any]:
        """Return it as files hold it."""
        figures = {name: interval.as_dict() for name, interval in self.figures.items()}
        return {"lost": self.lost, "runs": self.runs, **figures}


def save_lost_run(recording: Recording, out: PathLike) -> None:
    """Keep the recording of a loop that was lost, and no figures of another one beside it."""
    recording.save(out)
    (Path(out).parent / FIGURES_FILE).unlink(missing_ok=True)


Cases = Mapping[str, Mapping[MethodName, CaseFigures]]
"""The table: a row a case, by its name, with what each method gave in it."""


class StudyResult(Result):
    """What a study gives: its figures, a verdict, and in what the loop was lost."""

    __slots__ = ()
    kind: ClassVar[str]
    """Of the rig that was simulated: the word of its record."""

    @property
    @abstractmethod
    def lost_in(self) -> list[str]:
        """Everything tried in which the loop was lost."""

    def refuse_losses(self) -> None:
        """Raise NegativeResult where the loop was lost."""
        if self.lost_in:
            raise NegativeResult(
                f"the loop was lost: {'; '.join(self.lost_in)}; figures and recording are kept",
                code="loop-lost",
            )

    @property
    @abstractmethod
    def verdict(self) -> Judgement:
        """Whether compensation is worth it."""

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """Return what ``figures.json`` holds."""

    def losses_fact(self) -> dict[str, str]:
        """Return what is said of losses where facts are."""
        return {"lost in": "; ".join(self.lost_in)} if self.lost_in else {}

    def write_figures(self, path: PathLike) -> None:
        """Write the figures."""
        write_json(path, self.as_dict())
