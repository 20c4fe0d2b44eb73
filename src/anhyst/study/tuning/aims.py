"""What gains are wanted for, and how far from it they are.

Gains that miss no aim are compared by their settling time; those that miss some, by how far they
miss them. So the search first finds gains that are allowed, and then the fastest of them.
"""

# ruff: noqa: N815 - figures carry units

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields

from anhyst.support.errors import InputError

MISSED = 1e3
"""Cost of gains that miss an aim, in seconds; what they miss is added."""

_MOST = 100.0
"""By which an aim is missed at most: what is infinite must have a cost too."""

LOST = 1e6
"""Cost of gains that do not hold the armature in the air."""


@dataclass(frozen=True)
class Figures:
    """What gains reach, as the worst of everything that was tried."""

    overshoot_percent: float  # of the height of a step; of both directions, the larger one
    settling_time_s: float  # until the gap stays within 2 % of the height; mean of both directions
    peak_sensitivity: float  # measured with a sine that is added to the position sensor
    standstill_rms_m: float  # of the gap, after a step has settled
    current_rate_rms_A_per_s: float  # rate of change of the current over a step and its hold

    def worse(self, other: Figures) -> Figures:
        """Return the worse of each."""
        mine, theirs = asdict(self), asdict(other)
        return Figures(**{name: max(mine[name], theirs[name]) for name in mine})


NOTHING = Figures(0.0, 0.0, 0.0, 0.0, 0.0)

TITLES: Mapping[str, tuple[str, float, str]] = {
    "overshoot_percent": ("overshoot", 1.0, "%"),
    "settling_time_s": ("settling time", 1e3, "ms"),
    "peak_sensitivity": ("peak sensitivity", 1.0, ""),
    "standstill_rms_m": ("rms at standstill", 1e9, "nm"),
    "current_rate_rms_A_per_s": ("rms rate of the current", 1.0, "A/s"),
}
"""Of every figure: its name, what an SI value is multiplied by, and the unit then."""


def text_of(name: str, value: float) -> str:
    """Write a figure with its unit."""
    title, factor, unit = TITLES[name]
    number = f"{factor * value:.3g}" if math.isfinite(value) else "unlimited"
    return f"{title} {number} {unit}".rstrip()


@dataclass(frozen=True)
class Aims:
    """Upper limits of the figures; the settling time is made as small as they allow."""

    overshoot_percent: float = 2.0
    peak_sensitivity: float = 3.0
    settling_time_s: float | None = None  # none: no limit
    standstill_rms_m: float | None = None
    current_rate_rms_A_per_s: float | None = None

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
                f"aim peak_sensitivity: {self.peak_sensitivity:g} is not above 1, and no bearing "
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

    def misses(self, figures: Figures) -> dict[str, float]:
        """Return by how much of its limit every missed aim is missed.

        Not to settle is a miss even without a limit, by the whole of what was allowed.
        """
        found = {
            name: float(getattr(figures, name)) / limit - 1.0 for name, limit in self.limits.items()
        }
        if not math.isfinite(figures.settling_time_s):
            found.setdefault("settling_time_s", 1.0)
        return {name: over for name, over in found.items() if over > 0.0}

    def cost(self, figures: Figures) -> float:
        """Return what is to be made small; gains that miss no aim cost their settling time, s."""
        misses = self.misses(figures).values()
        if misses:
            return MISSED + sum(min(over, _MOST) for over in misses)
        return figures.settling_time_s

    def tightened(self, factors: Mapping[str, float]) -> Aims:
        """Return aims whose limits are those of this one times some factors."""
        limits = {name: limit * factors.get(name, 1.0) for name, limit in self.limits.items()}
        limits["peak_sensitivity"] = max(limits["peak_sensitivity"], 1.01)
        return Aims(**limits)


def worst_of(figures: Iterable[Figures]) -> Figures:
    """Return the worst of each figure."""
    found = NOTHING
    for one in figures:
        found = found.worse(one)
    return found
