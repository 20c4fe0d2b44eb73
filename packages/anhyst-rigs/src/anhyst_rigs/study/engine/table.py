"""Compare the metrics of methods in the cases of a study, and decide whether a model is beneficial.

A metric is stored by its key as a mean over noise seeds; a :class:`Metric` contains its title and
unit. Each metric of the model is compared with the best baseline. A difference is significant if it
exceeds the uncertainty of both means. The model is beneficial if some metrics are significantly
smaller and none is significantly larger.
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
MAX_LISTED_COMPARISONS = 4
"""Largest number of comparisons that are listed; if there are more, only their count is given."""


@dataclass(frozen=True)
class Interval:
    """A mean value and its confidence interval."""

    mean: float
    half_width: float  # half-width of the confidence interval
    count: int  # number of runs
    # number of runs that lost levitation; if there are any, there is no mean, because the remaining
    # runs would be too favourable
    lost: int = 0

    def exceeds(self, floor: Interval) -> bool:
        """Whether this mean is significantly above another one, if their noise is independent."""
        return self.mean - floor.mean > math.hypot(self.half_width, floor.half_width)

    def as_dict(self) -> dict[str, Any]:
        """Return the interval in the form for files."""
        return {"mean": self.mean, "half_width": self.half_width, "count": self.count}


def lost_interval(lost: int, count: int) -> Interval:
    """Return an interval without a mean, because some of the runs lost control."""
    return Interval(math.nan, math.nan, count, lost)


def mean_interval(values: ArrayLike, level: float = 0.95) -> Interval:
    """Return the mean of repeated measurements and its confidence interval (Student's t)."""
    samples = np.asarray(values, dtype=float)
    if len(samples) < 2:
        raise ValueError("a confidence interval needs two values at least")
    if not np.all(np.isfinite(samples)):
        return Interval(mean=float(np.mean(samples)), half_width=math.nan, count=len(samples))
    factor = float(stdtrit(len(samples) - 1, 0.5 + 0.5 * level))
    spread = float(np.std(samples, ddof=1)) / math.sqrt(len(samples))
    return Interval(mean=float(np.mean(samples)), half_width=factor * spread, count=len(samples))


@dataclass(frozen=True)
class MeanRatio:
    """A ratio of two means and its confidence interval."""

    value: float  # ratio of the means; infinite if the lower mean is zero
    low: float  # ends of the interval; 0 and infinite if the lower mean may be zero
    high: float


def mean_ratio(upper: ArrayLike, lower: ArrayLike, level: float = 0.95) -> MeanRatio:
    """Return the ratio of the means of paired values, with Fieller's interval.

    The interval contains all ratios R for which the mean of ``upper - R lower`` may be zero.
    Therefore, it contains 1 exactly if the mean difference may be zero.
    """
    rows = np.array([upper, lower], dtype=float)
    count = rows.shape[1]
    factor = float(stdtrit(count - 1, 0.5 + 0.5 * level)) ** 2 / count
    mean_a, mean_b = (float(mean) for mean in rows.mean(axis=1))
    (var_a, cov_ab), (_, var_b) = (factor * np.cov(rows)).tolist()
    value = mean_a / mean_b if mean_b > 0.0 else math.inf
    # (a - R b)^2 <= aa - 2 R ab + R^2 bb
    quadratic, linear, constant = mean_b * mean_b - var_b, mean_a * mean_b - cov_ab, mean_a * mean_a - var_a
    if quadratic <= 0.0:
        return MeanRatio(value, 0.0, math.inf)
    root = math.sqrt(max(linear * linear - quadratic * constant, 0.0))
    return MeanRatio(value, max((linear - root) / quadratic, 0.0), (linear + root) / quadratic)


@dataclass(frozen=True, slots=True)
class ComparedFigure:
    """A metric of a model and of a baseline; the smaller value is better."""

    title: str
    baseline: str
    model_value: float
    baseline_value: float
    uncertainty: float  # largest difference that noise can explain

    @property
    def is_better(self) -> bool:
        """Whether the model is significantly better."""
        return self.baseline_value - self.model_value > self.uncertainty

    @property
    def is_worse(self) -> bool:
        """Whether the model is significantly worse."""
        return self.model_value - self.baseline_value > self.uncertainty

    @property
    def ratio(self) -> float:
        """Value of the model divided by the value of the baseline; nan if both are zero."""
        if self.baseline_value != 0.0:
            return self.model_value / self.baseline_value
        return math.nan if self.model_value == 0.0 else math.inf


def compare(
    title: str, baseline: str, model_value: Interval, baseline_value: Interval, floor: float = 0.0
) -> ComparedFigure:
    """Compare two means. Differences that are below a floor or within the noise do not count."""
    uncertainty = max(floor, math.hypot(model_value.half_width, baseline_value.half_width))
    return ComparedFigure(title, baseline, model_value.mean, baseline_value.mean, uncertainty)


def strongest_baseline(figures: Mapping[MethodName, Interval]) -> MethodName | None:
    """Return the baseline with the smallest mean, or None if no baseline has a mean."""
    names = [
        name
        for name, interval in figures.items()
        if METHODS[name].role == "baseline" and math.isfinite(interval.mean)
    ]
    return min(names, key=lambda name: figures[name].mean, default=None)


@dataclass(frozen=True, slots=True)
class Judgement:
    """The verdict from all comparisons."""

    level: Level
    text: str

    @property
    def sentence(self) -> str:
        """Sentence with the title and the text of the verdict."""
        return f"{VERDICT_TITLES[self.level]}: {self.text}"


def judge_against_baselines(
    model: str, comparisons: Sequence[ComparedFigure], metric_noun: str, beneficial_condition: str
) -> Judgement:
    """Judge a model against the strongest baselines; ``condition`` completes a negative verdict."""
    verdict = judge_comparisons(model, comparisons, metric_noun)
    if verdict.level == "unknown":
        return verdict
    text = f"{model} compared with the strongest baseline without hysteresis model: {verdict.text}"
    return Judgement(verdict.level, text if verdict.level == "yes" else f"{text}; {beneficial_condition}")


def judge_comparisons(model: str, comparisons: Sequence[ComparedFigure], metric_noun: str) -> Judgement:
    """List the metrics in which a model is significantly better, significantly worse, or equal."""
    comparable = [
        comparison
        for comparison in comparisons
        if not math.isnan(comparison.ratio) or comparison.baseline_value == comparison.model_value
    ]
    if not comparable:
        return Judgement("unknown", f"{model} has no baseline to compare with")
    better_comparisons = [comparison for comparison in comparable if comparison.is_better]
    worse_comparisons = [comparison for comparison in comparable if comparison.is_worse]
    level: Level = "no" if not better_comparisons else "mixed" if worse_comparisons else "yes"
    equal_comparisons = [
        comparison for comparison in comparable if not comparison.is_better and not comparison.is_worse
    ]
    group_texts = [
        f"{group_title} {_format_comparisons(group, len(comparable), metric_noun)}"
        for group_title, group in (
            ("smaller in", better_comparisons),
            ("larger in", worse_comparisons),
            ("equal within the noise in", equal_comparisons),
        )
        if group
    ]
    return Judgement(level, "; ".join(group_texts))


def _format_comparisons(comparisons: Sequence[ComparedFigure], count: int, metric_noun: str) -> str:
    """List metrics with their ratios to the baseline, or give their number."""
    if count > MAX_LISTED_COMPARISONS:
        names = " or ".join(dict.fromkeys(f"'{comparison.baseline}'" for comparison in comparisons))
        sorted_ratios = sorted(
            comparison.ratio for comparison in comparisons if math.isfinite(comparison.ratio)
        )
        range_text = (
            f", {_format_range(sorted_ratios[0], sorted_ratios[-1])} times that of {names}"
            if sorted_ratios
            else f", against {names}"
        )
        return f"{len(comparisons)} of {count} {metric_noun}{range_text}"
    by_baseline: dict[str, list[str]] = {}
    for comparison in comparisons:
        by_baseline.setdefault(comparison.baseline, []).append(
            f"{comparison.title} {_format_ratio(comparison.ratio)}"
        )
    return ", ".join(
        f"{', '.join(ratio_texts)} times that of '{name}'" for name, ratio_texts in by_baseline.items()
    )


def _format_ratio(ratio: float) -> str:
    return f"{ratio:.2g}" if math.isfinite(ratio) else "0" if math.isnan(ratio) else "more than 0"


def _format_range(low: float, high: float) -> str:
    return (
        _format_ratio(low)
        if _format_ratio(low) == _format_ratio(high)
        else f"{_format_ratio(low)} to {_format_ratio(high)}"
    )


FIGURES_FILE = "figures.json"
"""Name of the file with metrics next to a recording."""


@dataclass(frozen=True)
class Metric:
    """A metric for the comparison of methods; a smaller value is better."""

    key: str  # name in files, including the unit
    title: str  # name in words
    unit: str  # displayed unit
    factor: float = 1.0  # factor from SI to the displayed unit

    @property
    def heading(self) -> str:
        """Table heading with title and unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


@dataclass(frozen=True)
class CaseFigures:
    """Metrics of a method in one case."""

    # metrics by key; both directions of a step give one value; empty if any run lost control
    figures: Mapping[str, Interval]
    lost: int  # number of runs that lost control, and number of all runs
    runs: int

    @classmethod
    def summarise(cls, runs: Sequence[Mapping[str, float] | None], **extra_fields: Any) -> Self:
        """Summarise runs, one for each seed; a run that lost control is None."""
        completed_runs = [run for run in runs if run is not None]
        names = completed_runs[0] if len(completed_runs) == len(runs) else ()
        figures = {name: mean_interval([run[name] for run in completed_runs]) for name in names}
        return cls(figures=figures, lost=len(runs) - len(completed_runs), runs=len(runs), **extra_fields)

    def interval(self, key: str) -> Interval:
        """Return the interval of a metric, without a mean if any run lost control."""
        return self.figures.get(key) or lost_interval(self.lost, self.runs)

    def as_dict(self) -> dict[str, Any]:
        """Return the metrics in the form for files."""
        figures = {name: interval.as_dict() for name, interval in self.figures.items()}
        return {"lost": self.lost, "runs": self.runs, **figures}


def save_lost_run(recording: Recording, out: PathLike) -> None:
    """Save the recording of a run that lost control; delete an older file of metrics next to it."""
    recording.save(out)
    (Path(out).parent / FIGURES_FILE).unlink(missing_ok=True)


Cases = Mapping[str, Mapping[MethodName, CaseFigures]]
"""Metrics by case and method."""


class StudyResult(Result):
    """The result of a study: metrics, verdict and runs that lost control."""

    __slots__ = ()
    kind: ClassVar[str]
    """Kind of the simulated rig."""

    @property
    @abstractmethod
    def lost_in(self) -> list[str]:
        """Runs that lost control."""

    def refuse_losses(self) -> None:
        """Raise NegativeResult if control was lost."""
        if self.lost_in:
            raise NegativeResult(
                f"control was lost: {'; '.join(self.lost_in)}; metrics and recording are saved",
                code="loop-lost",
            )

    @property
    @abstractmethod
    def verdict(self) -> Judgement:
        """Whether compensation is beneficial."""

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``figures.json``."""

    @property
    def speed_notes(self) -> tuple[str, ...]:
        """A warning if the currents changed faster than the loops of the model allow."""
        return ()

    def losses_fact(self) -> dict[str, str]:
        """Return the runs that lost control as a fact."""
        return {"lost in": "; ".join(self.lost_in)} if self.lost_in else {}

    def write_figures(self, path: PathLike) -> None:
        """Write the metrics to a file."""
        write_json(path, self.as_dict())
