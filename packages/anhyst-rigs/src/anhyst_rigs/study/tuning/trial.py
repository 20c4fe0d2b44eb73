"""Define the search range of gains, and try one set of gains in the nonlinear loop.

For a bearing, the search varies the poles of the closed loop instead of the gains. The moving mass
is m. The pole pair has the distance w from the origin and the damping ratio z, and the real pole
has the distance a w::

    (m + K_dd) s^3 + K_d s^2 + K_p s + K_i = (m + K_dd) (s + a w) (s^2 + 2 z w s + w^2)

The default design has a = 1. With a as a parameter, every set of gains can be represented.
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
"""Number of significant digits of gains, so that a file contains exactly the gains that were tried.
"""


class Axis(NamedTuple):
    """Range of one parameter, and whether its scale is logarithmic."""

    low: float
    high: float
    is_logarithmic: bool


class SearchBox:
    """Search range of all parameters: a box."""

    @property
    def axes(self) -> dict[str, Axis]:
        """Ranges by parameter name."""
        raise NotImplementedError

    def parameters(self, point: FloatArray) -> dict[str, float]:
        """Return the parameters at a point of the unit box."""
        values = {}
        for (name, axis), position in zip(self.axes.items(), point.tolist(), strict=True):
            if axis.is_logarithmic:
                values[name] = axis.low * (axis.high / axis.low) ** position
            else:
                values[name] = axis.low + (axis.high - axis.low) * position
        return values


@dataclass(frozen=True)
class BearingSpace(SearchBox):
    """Search range of a bearing."""

    rate: float  # sample rate of the controller, Hz, to which all frequencies are related
    mass: float  # moving mass, kg

    @property
    def axes(self) -> dict[str, Axis]:
        """Ranges by parameter name."""
        rate = self.rate
        return {
            "bandwidth_Hz": Axis(rate / 1000.0, rate / 20.0, True),
            "damping": Axis(0.3, 3.0, True),
            "real_pole": Axis(0.03, 3.0, True),  # real pole relative to the bandwidth
            "virtual_mass": Axis(-0.5, 1.0, False),  # virtual mass relative to the mass
            "set_point_weight": Axis(0.0, 1.0, False),
            "cutoff_Hz": Axis(rate / 100.0, 0.45 * rate, True),
            "cutoff_2_Hz": Axis(rate / 100.0, 0.45 * rate, True),
        }

    def make_controller_table(self, point: FloatArray, template: ControllerTable) -> ControllerTable:
        """Return the controller at a point of the unit box; `template` gives all other settings."""
        parameters = self.parameters(point)
        angular_bandwidth = 2.0 * math.pi * parameters["bandwidth_Hz"]
        damping, pole_ratio = parameters["damping"], parameters["real_pole"]
        total_mass = self.mass * (1.0 + parameters["virtual_mass"])
        gains = GainsTable(
            K_p_N_per_m=round_gain(total_mass * (1.0 + 2.0 * damping * pole_ratio) * angular_bandwidth**2),
            K_i_N_per_m_s=round_gain(total_mass * pole_ratio * angular_bandwidth**3),
            K_d_N_s_per_m=round_gain(total_mass * (2.0 * damping + pole_ratio) * angular_bandwidth),
            K_dd_N_s2_per_m=round_gain(self.mass * parameters["virtual_mass"]),
        )
        filters = FilterTable(
            cutoff_Hz=round_gain(parameters["cutoff_Hz"]), cutoff_2_Hz=round_gain(parameters["cutoff_2_Hz"])
        )
        return template.model_copy(
            update={
                "design": None,
                "gains": gains,
                "filter": filters,
                "set_point_weight": round(parameters["set_point_weight"], _GAIN_DIGITS),
            }
        )

    def gains_per_tick(self, points: FloatArray, template: ControllerTable) -> FloatArray:
        """Return the gains of many points as :attr:`Pidd2.per_tick`, shape (n, 11)."""
        return np.array([self.make_controller_table(point, template).pidd2().per_tick for point in points])


def round_gain(value: float) -> float:
    """Return a gain, rounded to the number of digits that files contain."""
    return float(f"{value:.{_GAIN_DIGITS}g}")


_BINDING_FRACTION_OF_LIMIT = 0.9  # fraction of a limit above which the limit is reported
_MIN_COST_REDUCTION = 0.05  # smallest relative reduction of the cost that is reported


@dataclass(frozen=True)
class BearingCondition:
    """Gap and load in a trial of a bearing."""

    gap: float  # gap, m
    load: float  # load, N

    @property
    def text(self) -> str:
        """Gap and load with their units."""
        return f"{1e3 * self.gap:.3g} mm and {self.load:.3g} N"

    def as_dict(self) -> dict[str, Any]:
        """Return gap and load for JSON."""
        return {"gap_m": self.gap, "load_N": self.load}


@dataclass(frozen=True)
class Limit:
    """Something that limits the gains."""

    # name of a metric, or ``noise``, ``force``, ``voltage``, ``current``, ``crossover``, ``delay``,
    # ``damping``, ``amplifier``, ``pinning``
    what: str
    text: str  # explanation as a sentence with values


@dataclass(frozen=True)
class CheckResult:
    """Metrics of gains over all noise seeds."""

    # metrics by condition: means over the seeds, worst of all heights; infinite if control was lost
    figures: Mapping[Any, GainFigures]
    peak_frequencies: Mapping[Any, float]  # frequency of the peak sensitivity, Hz
    seed_count: int  # number of noise seeds
    half_widths: Mapping[str, float]  # half-width of the 95 % interval of each worst metric
    locations: Mapping[str, str]  # step at which each worst metric occurs
    rows: Mapping[str, Any]  # further results for tuning.json
    notes: tuple[str, ...] = ()  # further results as sentences

    @property
    def worst(self) -> GainFigures:
        """Worst value of each metric."""
        return merge_worst_figures(self.figures.values())

    def find_binding_aims(self, aims: Aims) -> list[Limit]:
        """Return the aims that are missed or almost missed, with the condition that is decisive."""
        limits = []
        for name, limit in aims.limits.items():
            value = float(getattr(self.worst, name))
            if value < _BINDING_FRACTION_OF_LIMIT * limit:
                continue
            condition = max(self.figures, key=lambda condition: float(getattr(self.figures[condition], name)))
            location = f"at {condition.text}"
            if name == "peak_sensitivity":
                location += f", around {self.peak_frequencies[condition]:.0f} Hz"
            elif name in self.locations:
                location += f", {self.locations[name]}"
            verb = "exceeds" if value > limit else "almost reaches"
            bound = GAIN_METRICS[name].format_limit(limit)
            limits.append(Limit(name, f"{format_figure(name, value)} {verb} its limit of {bound} {location}"))
        return limits


class Tunable(Protocol):
    """A variant in a loop with adjustable gains. It can be sent to worker processes."""

    @property
    def conditions(self) -> tuple[Any, ...]:
        """All conditions of a trial. Each of them has ``text`` and ``as_dict()``."""

    @property
    def space(self) -> SearchBox:
        """Search range of the parameters."""

    def with_gains_at(self, point: FloatArray) -> Tunable:
        """Return this loop with the gains at a point of the search range."""

    def for_search(self) -> Tunable:
        """Return this loop with shorter motions than those of a check."""

    def make_controller(self) -> None:
        """Make the controller; raise InputError if fixed point cannot represent its gains."""

    def figures(self, condition: Any, aims: Aims, ceiling: float, seed: int) -> GainFigures | None:
        """Try the gains at one condition; return None if control was lost.

        A trial may end early if its cost exceeds the ceiling.
        """

    def initial_guesses(self, aims: Aims, seed: int) -> Sequence[Callable[[], FloatArray]]:
        """Return functions that find the points with the best linear loops."""

    def check(self, jobs: int | None) -> CheckResult:
        """Evaluate the gains with all noise seeds."""

    def find_limits(self, aims: Aims, check_result: CheckResult, seed: int, jobs: int | None) -> list[Limit]:
        """Return what limits the checked gains."""

    def gains(self) -> dict[str, float]:
        """Return the gains, keyed by their names in files."""

    @property
    def trial_text(self) -> str:
        """Description of the trial."""

    def facts(self) -> dict[str, Any]:
        """Return the data of the rig for tuning.json."""

    def explain_parameters(self, parameters: Mapping[str, float]) -> list[str]:
        """Return lines of text that explain the parameters of a point."""


Loop = TypeVar("Loop")


def find_helpful_changes(
    minimum_cost: Callable[[tuple[Loop, Aims]], float],
    loop: Loop,
    aims: Aims,
    changes: Mapping[str, tuple[str, Loop, Aims]],
    jobs: int | None,
    format_text: Callable[[str, float, float], str],
) -> list[Limit]:
    """Return the changes that reduce the cost of the best linear loops, in order of their effect.

    An increase of the peak sensitivity limit by half is always tested too. The text of a change is
    made from its description and from the costs with and without it.
    """
    relaxed_peak = 1.5 * aims.peak_sensitivity
    relaxed_aims = aims.with_scaled_limits({"peak_sensitivity": 1.5})
    changes = {"peak_sensitivity": (f"a peak sensitivity of {relaxed_peak:g}", loop, relaxed_aims), **changes}
    tasks = [
        (loop, aims),
        *((changed_loop, changed_aims) for _, changed_loop, changed_aims in changes.values()),
    ]
    base_cost, *costs = map_ordered(minimum_cost, tasks, jobs=jobs)
    if not math.isfinite(base_cost):
        return []
    helpful_changes = sorted(
        (cost, change)
        for change, cost in zip(changes, costs, strict=True)
        if cost < (1.0 - _MIN_COST_REDUCTION) * base_cost
    )
    return [
        Limit(change, format_text(changes[change][0], cost, base_cost)) for cost, change in helpful_changes
    ]


@dataclass(frozen=True)
class GainOutcome:
    """The result of one trial of gains."""

    cost: float  # cost as in :meth:`Aims.cost`; a lower bound if the trial ended early
    # metrics of each condition that was completed before the trial ended or control was lost
    figures: dict[Any, GainFigures]
    is_complete: bool  # whether all conditions were tried

    @property
    def worst(self) -> GainFigures:
        """Worst value of each metric."""
        return merge_worst_figures(self.figures.values())


def run_trial(
    loop: Tunable, conditions: Sequence[Any], aims: Aims, ceiling: float = math.inf, seed: int = 0
) -> GainOutcome:
    """Try the gains of a loop at one condition after another, until the cost exceeds a ceiling.

    The nonlinear loop includes hysteresis, the noise of one seed, and all limits.
    """
    figures: dict[Any, GainFigures] = {}
    cost = 0.0
    try:
        loop.make_controller()
    except InputError:  # Fixed point cannot represent the gains.
        return GainOutcome(LOST_BODY_COST + len(conditions), figures, is_complete=False)
    for index, condition in enumerate(conditions):
        condition_figures = loop.figures(condition, aims, ceiling, seed)
        if condition_figures is None:
            return GainOutcome(LOST_BODY_COST + len(conditions) - index, figures, is_complete=False)
        figures[condition] = condition_figures
        cost = aims.cost(merge_worst_figures(figures.values()))
        if cost > ceiling and index + 1 < len(conditions):
            return GainOutcome(cost, figures, is_complete=False)
    return GainOutcome(cost, figures, is_complete=True)
