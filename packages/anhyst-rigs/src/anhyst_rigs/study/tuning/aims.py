"""Define the aims of a tuning, and the cost of controller gains.

If gains meet all aims, their cost is a single metric: the settling time of a bearing, the moving
average of a stage, or the rms error of a piezo stage. Otherwise, the cost is larger and increases
with the relative excess over each limit. Thus, a search finds permitted gains, then improves them.
"""

# ruff: noqa: N815 - figures carry units

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import reduce
from typing import ClassVar, Self, TypeVar

from anhyst.support.errors import InputError
from anhyst_rigs.study.engine.table import Metric

MISSED_AIM_COST = 1e3
"""Cost of gains that miss an aim, to which the sum of their relative excesses is added."""
_MAX_RELATIVE_EXCESS = 100.0
"""Largest relative excess that counts for one aim. Thus infinite metrics have a finite cost."""
LOST_BODY_COST = 1e6
"""Cost of gains with which control is lost."""


@dataclass(frozen=True)
class GainFigures:
    """Metrics of a set of gains: the worst values of all trials."""

    cost_name: ClassVar[str]  # name of the metric that is the cost of gains that meet all aims
    settling_time_s: float = 0.0
    peak_sensitivity: float = 0.0
    standstill_rms_m: float = 0.0
    current_rate_rms_A_per_s: float = 0.0  # rms rate, the largest of all currents

    def by_name(self) -> dict[str, float]:
        """Return the metrics by name, in the order of all tables."""
        return {name: getattr(self, name) for name in GAIN_METRICS if hasattr(self, name)}

    def merge_worst(self, other_figures: Self) -> Self:
        """Return the larger value of each metric."""
        other_values = other_figures.by_name()
        return type(self)(**{name: max(value, other_values[name]) for name, value in self.by_name().items()})

    @property
    def cost(self) -> float:
        """Cost of these gains if they meet all aims: one of the metrics."""
        return float(getattr(self, self.cost_name))

    @classmethod
    def for_lost_body(cls) -> Self:
        """Return infinite metrics, which stand for gains with which control is lost."""
        return cls(*[math.inf] * len(fields(cls)))


@dataclass(frozen=True)
class BearingFigures(GainFigures):
    """Metrics of the gains of a bearing.

    The settling time, averaged over both directions, ends when the gap stays within 2 % of the step
    height. The sensitivity is measured with a sine that is added to the position sensor.
    """

    cost_name = "settling_time_s"
    # overshoot, % of the step height, the larger one of both directions
    overshoot_percent: float = 0.0


@dataclass(frozen=True)
class StageFigures(GainFigures):
    """Metrics of the gains of a stage on its set-points.

    The settling time begins at the end of an acceleration and ends when the error stays within 50
    nm. The sensitivity is that of the linear loop.
    """

    cost_name = "average_m"
    average_m: float = 0.0  # largest moving average of the error over the slit
    error_peak_m: float = 0.0  # largest error


@dataclass(frozen=True)
class PiezoFigures(GainFigures):
    """Metrics of a piezo stage on its triangle; the sensitivity is that of the linear loop."""

    cost_name = "error_rms_m"
    error_rms_m: float = 0.0
    error_peak_m: float = 0.0

    def by_name(self) -> dict[str, float]:
        """Return the metrics by name; a triangle has no settling time and no standstill."""
        names = ("error_rms_m", "error_peak_m", "peak_sensitivity")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class GainMetric(Metric):
    """Title, unit and format of a metric of gains."""

    digits: int = 2  # number of decimal places in tables

    def format_limit(self, limit: float) -> str:
        """Return a limit of this metric as text with its unit."""
        return f"{self.factor * limit:g} {self.unit}".rstrip()


GAIN_METRICS: Mapping[str, GainMetric] = {
    metric.key: metric
    for metric in (
        GainMetric("overshoot_percent", "overshoot", "%"),
        GainMetric("average_m", "moving average", "nm", 1e9),
        GainMetric("error_rms_m", "rms error", "nm", 1e9, 1),
        GainMetric("error_peak_m", "peak error", "nm", 1e9, 1),
        GainMetric("settling_time_s", "settling time", "ms", 1e3),
        GainMetric("peak_sensitivity", "peak sensitivity", ""),
        GainMetric("standstill_rms_m", "rms at standstill", "nm", 1e9, 1),
        GainMetric("current_rate_rms_A_per_s", "rms rate of the current", "A/s", 1.0, 0),
    )
}


def format_figure(name: str, value: float) -> str:
    """Return the value of a metric as text with title and unit."""
    metric = GAIN_METRICS[name]
    value_text = f"{metric.factor * value:.3g}" if math.isfinite(value) else "unlimited"
    return f"{metric.title} {value_text} {metric.unit}".rstrip()


@dataclass(frozen=True)
class Aims:
    """Upper limits of the metrics of gains. Within them, a tuning minimises one further metric."""

    overshoot_percent: float | None = 2.0  # None: no limit
    peak_sensitivity: float = 3.0
    settling_time_s: float | None = None
    standstill_rms_m: float | None = None
    current_rate_rms_A_per_s: float | None = None
    error_peak_m: float | None = None
    average_m: float | None = None

    def __post_init__(self) -> None:
        for name, limit in self.limits.items():
            if not (math.isfinite(limit) and limit > 0.0):
                raise InputError(
                    f"aim {name}: {limit} is not above zero; enter a positive limit",
                    code="not-above-zero",
                    key=name,
                )
        if self.peak_sensitivity <= 1.0:
            raise InputError(
                f"aim peak_sensitivity: {self.peak_sensitivity:g} is not above 1, which no loop "
                "with delay reaches; enter 1.5 to 5",
                code="out-of-range",
                key="peak_sensitivity",
            )

    @property
    def limits(self) -> dict[str, float]:
        """All limits that are not None, by the names of their metrics."""
        return {
            field.name: float(limit)
            for field in fields(self)
            if (limit := getattr(self, field.name)) is not None
        }

    def missed_by(self, figures: GainFigures) -> dict[str, float]:
        """Return, for every missed aim, the relative excess above its limit.

        An infinite cost metric (no settling or moving average) has the excess 1, even without
        limit.
        """
        excess = {name: float(getattr(figures, name)) / limit - 1.0 for name, limit in self.limits.items()}
        if not math.isfinite(figures.cost):
            excess.setdefault(figures.cost_name, 1.0)
        return {name: value for name, value in excess.items() if value > 0.0}

    def cost(self, figures: GainFigures) -> float:
        """Return the cost of gains: the cost metric if they meet all aims, otherwise more."""
        excesses = self.missed_by(figures).values()
        if excesses:
            return MISSED_AIM_COST + sum(min(excess, _MAX_RELATIVE_EXCESS) for excess in excesses)
        return figures.cost

    def with_scaled_limits(self, factors: Mapping[str, float]) -> Aims:
        """Return aims with scaled limits; the limit of the peak sensitivity is at least 1.01."""
        limits = {name: limit * factors.get(name, 1.0) for name, limit in self.limits.items()}
        limits["peak_sensitivity"] = max(limits["peak_sensitivity"], 1.01)
        return replace(self, **limits)


F = TypeVar("F", bound=GainFigures)


def merge_worst_figures(figures: Iterable[F]) -> F:
    """Return the largest value of each metric."""
    return reduce(lambda worst_figures, next_figures: worst_figures.merge_worst(next_figures), figures)
