"""What is tuned, the box of numbers that is searched, and one set of gains in the nonlinear loop.

With the mass m that moves, the poles of the design rule lie at the distance w from the origin; here
the real one may lie elsewhere, at a w, so that every set of gains can be reached::

    (m + K_dd) s^3 + K_d s^2 + K_p s + K_i = (m + K_dd) (s + a w) (s^2 + 2 z w s + w^2)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from anhyst.control.controller_file import ControllerTable, FilterTable, GainsTable
from anhyst.support.errors import InputError
from anhyst.support.jobs import map_ordered
from anhyst.support.numeric import FloatArray
from anhyst_rigs.study.tuning.aims import (
    GAIN_METRICS,
    LOST_BODY_COST,
    Aims,
    GainFigures,
    format_figure,
    merge_worst_figures,
)

_GAIN_DIGITS = 5
"""Of every gain that is kept: what a file says is what was tried."""


class Axis(NamedTuple):
    """One of the numbers: its ends, and whether equal steps are equal ratios."""

    low: float
    high: float
    is_logarithmic: bool


class SearchBox:
    """The box that is searched."""

    @property
    def axes(self) -> dict[str, Axis]:
        """Every number by name."""
        raise NotImplementedError

    def parameters(self, point: FloatArray) -> dict[str, float]:
        """Return the numbers at a point of the unit box."""
        values = {}
        for (name, axis), part in zip(self.axes.items(), point.tolist(), strict=True):
            if axis.is_logarithmic:
                values[name] = axis.low * (axis.high / axis.low) ** part
            else:
                values[name] = axis.low + (axis.high - axis.low) * part
        return values


@dataclass(frozen=True)
class BearingSpace(SearchBox):
    """What is searched of a bearing."""

    rate: float  # of the controller, Hz; frequencies are searched in parts of it
    mass: float  # what moves, kg

    @property
    def axes(self) -> dict[str, Axis]:
        """Every number by name."""
        rate = self.rate
        return {
            "bandwidth_Hz": Axis(rate / 1000.0, rate / 20.0, True),
            "damping": Axis(0.3, 3.0, True),
            "real_pole": Axis(0.03, 3.0, True),  # in parts of the bandwidth
            "virtual_mass": Axis(-0.5, 1.0, False),  # in parts of the mass
            "set_point_weight": Axis(0.0, 1.0, False),
            "cutoff_Hz": Axis(rate / 100.0, 0.45 * rate, True),
            "cutoff_2_Hz": Axis(rate / 100.0, 0.45 * rate, True),
        }

    def make_controller_table(
        self, point: FloatArray, template: ControllerTable
    ) -> ControllerTable:
        """Return the controller at a point of the unit box; what is not searched stays as it is."""
        at = self.parameters(point)
        w, z, a = 2.0 * math.pi * at["bandwidth_Hz"], at["damping"], at["real_pole"]
        total = self.mass * (1.0 + at["virtual_mass"])
        gains = GainsTable(
            K_p_N_per_m=round_gain(total * (1.0 + 2.0 * z * a) * w**2),
            K_i_N_per_m_s=round_gain(total * a * w**3),
            K_d_N_s_per_m=round_gain(total * (2.0 * z + a) * w),
            K_dd_N_s2_per_m=round_gain(self.mass * at["virtual_mass"]),
        )
        filters = FilterTable(
            cutoff_Hz=round_gain(at["cutoff_Hz"]), cutoff_2_Hz=round_gain(at["cutoff_2_Hz"])
        )
        return template.model_copy(
            update={
                "design": None,
                "gains": gains,
                "filter": filters,
                "set_point_weight": round(at["set_point_weight"], _GAIN_DIGITS),
            }
        )

    def gains_per_tick(self, points: FloatArray, template: ControllerTable) -> FloatArray:
        """Return the gains per tick of many points, as :attr:`Pidd2.per_tick`, shape (n, 11)."""
        return np.array(
            [self.make_controller_table(point, template).pidd2().per_tick for point in points]
        )


def round_gain(value: float) -> float:
    """Return a gain as files hold it."""
    return float(f"{value:.{_GAIN_DIGITS}g}")


_BINDING_RATIO = 0.9  # of a limit: from here on it is said to bind
_MIN_COST_REDUCTION = 0.05  # of what is made small: less is not reported


@dataclass(frozen=True)
class BearingCondition:
    """Where a bearing is tried."""

    gap: float  # m
    load: float  # N

    @property
    def text(self) -> str:
        """Both with their units."""
        return f"{1e3 * self.gap:.3g} mm and {self.load:.3g} N"

    def as_dict(self) -> dict[str, Any]:
        """Return both by name."""
        return {"gap_m": self.gap, "load_N": self.load}


@dataclass(frozen=True)
class Limit:
    """One thing that limits."""

    # name of a figure, or ``noise``, ``force``, ``voltage``, ``current``, ``delay``,
    # ``amplifier``, ``pinning``
    what: str
    text: str  # A sentence for a person, with numbers


@dataclass(frozen=True)
class CheckResult:
    """What gains reach over all noise seeds."""

    # means over the seeds, worst of all heights; all infinite where the body was lost
    figures: Mapping[Any, GainFigures]
    peak_frequencies: Mapping[Any, float]  # frequency of the peak of the sensitivity, Hz
    seed_count: int  # noise seeds behind every mean
    half_widths: Mapping[str, float]  # of the 95 % interval of the worst of a figure, half of it
    locations: Mapping[str, str]  # where that is, beside the condition
    rows: Mapping[str, Any]  # what else was found, for tuning.json
    notes: tuple[str, ...] = ()  # the same, for a person

    @property
    def worst(self) -> GainFigures:
        """The worst of each figure."""
        return merge_worst_figures(self.figures.values())

    def find_binding_aims(self, aims: Aims) -> list[Limit]:
        """Return the aims that are missed or nearly so, and where."""
        found = []
        for name, limit in aims.limits.items():
            value = float(getattr(self.worst, name))
            if value < _BINDING_RATIO * limit:
                continue
            at = max(self.figures, key=lambda each: float(getattr(self.figures[each], name)))
            where = f"at {at.text}"
            if name == "peak_sensitivity":
                where += f", around {self.peak_frequencies[at]:.0f} Hz"
            elif name in self.locations:
                where += f", {self.locations[name]}"
            verb = "misses" if value > limit else "nearly takes"
            bound = GAIN_METRICS[name].format_limit(limit)
            found.append(
                Limit(name, f"{format_figure(name, value)} {verb} its limit of {bound} {where}")
            )
        return found


class Tunable(Protocol):
    """One variant in its loop, with gains that can be changed; goes to other processes."""

    @property
    def conditions(self) -> tuple[Any, ...]:
        """All at which gains are to do well; each has ``text`` and ``as_dict()``."""

    @property
    def space(self) -> SearchBox:
        """The box that is searched."""

    def with_gains_at(self, point: FloatArray) -> Tunable:
        """Return the same with the gains at a point of the box."""

    def for_search(self) -> Tunable:
        """Return the same as it is tried in the search; what is checked takes longer."""

    def make_controller(self) -> None:
        """Make the controller; InputError where fixed point cannot hold its gains."""

    def figures(self, condition: Any, aims: Aims, ceiling: float, seed: int) -> GainFigures | None:
        """Try the gains at one condition; None if the body was not held.

        What cannot lower a cost that is above the ceiling need not be tried.
        """

    def initial_guesses(self, aims: Aims, seed: int) -> Sequence[Callable[[], FloatArray]]:
        """Return what finds the points that linear loops like best."""

    def check(self, jobs: int | None) -> CheckResult:
        """Try the gains with all noise seeds."""

    def find_limits(
        self, aims: Aims, check_result: CheckResult, seed: int, jobs: int | None
    ) -> list[Limit]:
        """Return what limits gains that were checked."""

    def gains(self) -> dict[str, float]:
        """Return the gains as files hold them."""

    @property
    def trial_text(self) -> str:
        """What is tried at every condition."""

    def facts(self) -> dict[str, Any]:
        """Return what tuning.json says of the rig."""

    def explain_parameters(self, parameters: Mapping[str, float]) -> list[str]:
        """Return lines that say what the numbers of a point mean."""


Loop = TypeVar("Loop")


def find_helpful_changes(
    minimum_cost: Callable[[tuple[Loop, Aims]], float],
    loop: Loop,
    aims: Aims,
    changes: Mapping[str, tuple[str, Loop, Aims]],
    jobs: int | None,
    format_text: Callable[[str, float, float], str],
) -> list[Limit]:
    """Report what lowers the cost of the best gains when it is eased, the most first.

    One more that is eased is the peak of the sensitivity, by half. A text is made of what is eased,
    and the costs with and without.
    """
    peak, easier = 1.5 * aims.peak_sensitivity, aims.with_scaled_limits({"peak_sensitivity": 1.5})
    changes = {"peak_sensitivity": (f"a peak sensitivity of {peak:g}", loop, easier), **changes}
    tasks = [(loop, aims), *((one, its_aims) for _, one, its_aims in changes.values())]
    base, *costs = map_ordered(minimum_cost, tasks, jobs=jobs)
    if not math.isfinite(base):
        return []
    helps = sorted(
        (cost, what)
        for what, cost in zip(changes, costs, strict=True)
        if cost < (1.0 - _MIN_COST_REDUCTION) * base
    )
    return [Limit(what, format_text(changes[what][0], cost, base)) for cost, what in helps]


@dataclass(frozen=True)
class GainOutcome:
    """What a trial gave."""

    cost: float  # by :meth:`Aims.cost`; a lower bound of it where the trial was given up
    # of what was tried before it was given up, or the body lost
    figures: dict[Any, GainFigures]
    is_complete: bool  # whether everything was tried

    @property
    def worst(self) -> GainFigures:
        """The worst of each figure."""
        return merge_worst_figures(self.figures.values())


def run_trial(
    loop: Tunable, conditions: Sequence[Any], aims: Aims, ceiling: float = math.inf, seed: int = 0
) -> GainOutcome:
    """Try the gains of a loop at one condition after the other, until they cost more than a ceiling.

    An iron that pins, noise and limits are in it; only the noise seed is one.
    """
    figures: dict[Any, GainFigures] = {}
    cost = 0.0
    try:
        loop.make_controller()
    except InputError:  # gains that fixed point cannot hold
        return GainOutcome(LOST_BODY_COST + len(conditions), figures, is_complete=False)
    for index, condition in enumerate(conditions):
        result = loop.figures(condition, aims, ceiling, seed)
        if result is None:
            return GainOutcome(LOST_BODY_COST + len(conditions) - index, figures, is_complete=False)
        figures[condition] = result
        cost = aims.cost(merge_worst_figures(figures.values()))
        if cost > ceiling and index + 1 < len(conditions):
            return GainOutcome(cost, figures, is_complete=False)
    return GainOutcome(cost, figures, is_complete=True)
