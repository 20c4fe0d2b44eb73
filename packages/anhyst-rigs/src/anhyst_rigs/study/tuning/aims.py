"""What gains are wanted for, and how far from it they are.

Gains that miss no aim are compared by one figure: of a bearing the settling time, of a stage the
moving average, of a piezo stage the rms error. Those that miss some are compared by how far they
miss them. So the search first finds gains that are allowed, and then the best of them.
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
"""Cost of gains that miss an aim, in SI units; what they miss is added."""
_MAX_RELATIVE_EXCESS = 100.0
"""By which an aim is missed at most: what is infinite must have a cost too."""
LOST_BODY_COST = 1e6
"""Cost of gains that do not hold the body."""


@dataclass(frozen=True)
class GainFigures:
    """What gains reach, as the worst of everything that was tried."""

    cost_name: ClassVar[str]  # figure by which gains that miss no aim are ordered
    settling_time_s: float = 0.0
    peak_sensitivity: float = 0.0
    standstill_rms_m: float = 0.0
    current_rate_rms_A_per_s: float = 0.0  # rate of change of a current, the largest

    def by_name(self) -> dict[str, float]:
        """Return them by name, in the order of every table."""
        return {name: getattr(self, name) for name in GAIN_METRICS if hasattr(self, name)}

    def merge_worst(self, other: Self) -> Self:
        """Return the worse of each."""
        theirs = other.by_name()
        return type(self)(**{name: max(one, theirs[name]) for name, one in self.by_name().items()})

    @property
    def cost(self) -> float:
        """The figure by which gains that miss no aim are ordered."""
        return float(getattr(self, self.cost_name))

    @classmethod
    def for_lost_body(cls) -> Self:
        """Return the figures of gains that do not hold the body."""
        return cls(*[math.inf] * len(fields(cls)))


@dataclass(frozen=True)
class BearingFigures(GainFigures):
    """Of a bearing.

    The settling time is that until the gap stays within 2 % of the height of a step, mean of both
    directions; the sensitivity is measured with a sine that is added to the position sensor.
    """

    cost_name = "settling_time_s"
    overshoot_percent: float = 0.0  # of the height of a step; of both directions, the larger one


@dataclass(frozen=True)
class StageFigures(GainFigures):
    """Of a stage on its set-points.

    The settling time is that from the end of an acceleration until the error stays within 50 nm;
    the sensitivity is that of the linear loop.
    """

    cost_name = "average_m"
    average_m: float = 0.0  # largest moving average over the slit
    error_peak_m: float = 0.0  # largest error


@dataclass(frozen=True)
class PiezoFigures(GainFigures):
    """Of a piezo stage on its triangle; the sensitivity is that of the linear loop."""

    cost_name = "error_rms_m"
    error_rms_m: float = 0.0
    error_peak_m: float = 0.0

    def by_name(self) -> dict[str, float]:
        """Return them by name; a triangle has no settling and no standstill."""
        names = ("error_rms_m", "error_peak_m", "peak_sensitivity")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class GainMetric(Metric):
    """A figure of gains, and how it is written."""

    digits: int = 2  # behind the point, in tables

    def format_limit(self, limit: float) -> str:
        """Write a limit with its unit."""
        return f"{self.factor * limit:g} {self.unit}".rstrip()


GAIN_METRICS: Mapping[str, GainMetric] = {
    one.key: one
    for one in (
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
    """Write a figure with its unit."""
    metric = GAIN_METRICS[name]
    number = f"{metric.factor * value:.3g}" if math.isfinite(value) else "unlimited"
    return f"{metric.title} {number} {metric.unit}".rstrip()


@dataclass(frozen=True)
class Aims:
    """Upper limits of the figures; one of them is made as small as they allow."""

    overshoot_percent: float | None = 2.0  # none: no limit
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
                    f"aim {name}: {limit} is not above zero; give another limit",
                    code="not-above-zero",
                    key=name,
                )
        if self.peak_sensitivity <= 1.0:
            raise InputError(
                f"aim peak_sensitivity: {self.peak_sensitivity:g} is not above 1, and no loop "
                "with delay stays below; give 1.5 to 5",
                code="out-of-range",
                key="peak_sensitivity",
            )

    @property
    def limits(self) -> dict[str, float]:
        """Every limit there is, by the name of its figure."""
        return {
            field.name: float(limit)
            for field in fields(self)
            if (limit := getattr(self, field.name)) is not None
        }

    def missed_by(self, figures: GainFigures) -> dict[str, float]:
        """Return by how much of its limit every missed aim is missed.

        To have no settling time, or no moving average, is a miss even without a limit, by the whole
        of what was allowed.
        """
        found = {
            name: float(getattr(figures, name)) / limit - 1.0 for name, limit in self.limits.items()
        }
        if not math.isfinite(figures.cost):
            found.setdefault(figures.cost_name, 1.0)
        return {name: over for name, over in found.items() if over > 0.0}

    def cost(self, figures: GainFigures) -> float:
        """Return what is to be made small; gains that miss no aim cost the figure that orders them."""
        misses = self.missed_by(figures).values()
        if misses:
            return MISSED_AIM_COST + sum(min(over, _MAX_RELATIVE_EXCESS) for over in misses)
        return figures.cost

    def with_scaled_limits(self, factors: Mapping[str, float]) -> Aims:
        """Return aims whose limits are those of this one times some factors."""
        limits = {name: limit * factors.get(name, 1.0) for name, limit in self.limits.items()}
        limits["peak_sensitivity"] = max(limits["peak_sensitivity"], 1.01)
        return replace(self, **limits)


F = TypeVar("F", bound=GainFigures)


def merge_worst_figures(figures: Iterable[F]) -> F:
    """Return the worst of each figure."""
    return reduce(lambda one, other: one.merge_worst(other), figures)
