"""Tune the controller of a magnetic bearing.

A trial consists of steps and a stepped sine at every gap and load. After the search, the limiting
factors are reported: aims, sensor noise, force, voltage, current, delay or pinning of the iron.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from anhyst.support.jobs import map_ordered
from anhyst.support.numeric import FloatArray, geometric_spacing
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bearing.scenario import plan_steps
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import change_rig
from anhyst_rigs.rig.loop import SimulatedLoop
from anhyst_rigs.study.bearing.linear import AnalogueAmplifier
from anhyst_rigs.study.bearing.responses import (
    Sensitivity,
    StepCell,
    StepRun,
    compare_steps,
    default_seeds,
    measure_loop_sensitivity,
    merge_directions,
    run_steps,
)
from anhyst_rigs.study.tuning.aims import GAIN_METRICS, Aims, BearingFigures
from anhyst_rigs.study.tuning.search import SLOPE_FRACTIONS, Screen, make_screen, minimise_cost
from anhyst_rigs.study.tuning.trial import (
    BearingCondition,
    BearingSpace,
    CheckResult,
    Limit,
    find_helpful_changes,
)

MAX_SEARCH_HOLD_S = 0.03
"""Longest hold after a step during the search, s. A check uses the hold of the rig file."""
# factors on the limit of the peak sensitivity for the initial guesses
_PEAK_FACTORS = (0.55, 0.7, 1.0)


def default_conditions(rig: BodyRig) -> tuple[BearingCondition, ...]:
    """Return all gaps of a rig file, each with the load of the file and with two thirds of it."""
    settings, load = rig.settings, rig.settings.load.force_N
    return tuple(
        BearingCondition(gap, force)
        for gap in dict.fromkeys(settings.step_gaps_m)
        for force in dict.fromkeys([load, load * 2.0 / 3.0])
    )


@dataclass(frozen=True)
class BearingLoop:
    """One compensation variant with the controller of a bearing."""

    setup: BearingSetup
    conditions: tuple[BearingCondition, ...]

    @property
    def space(self) -> BearingSpace:
        """Search range of all parameters."""
        settings = self.setup.rig.settings
        return BearingSpace(settings.timing.rate_Hz, settings.body.mass_kg)

    def with_gains_at(self, point: FloatArray) -> BearingLoop:
        """Return this loop with the gains at a point of the search range."""
        controller = self.space.make_controller_table(point, self.setup.controller)
        return replace(self, setup=replace(self.setup, controller=controller))

    def for_search(self) -> BearingLoop:
        """Return this loop with a shorter hold after each step."""
        rig = self.setup.rig
        hold_s = min(rig.settings.step.hold_s, MAX_SEARCH_HOLD_S)
        return replace(self, setup=replace(self.setup, rig=change_rig(rig, {"step.hold_s": hold_s})))

    def make_controller(self) -> None:
        """Make the controller; raise InputError if fixed point cannot represent its gains."""
        self.setup.make_controller()

    def figures(
        self, condition: BearingCondition, aims: Aims, ceiling: float, seed: int
    ) -> BearingFigures | None:
        """Run steps and a stepped sine at one condition; return None if levitation was lost.

        The sine is skipped if the cost of the steps already exceeds the ceiling.
        """
        setup = self.setup
        heights = tuple(setup.rig.settings.step.heights_m)
        steps, lost_at_s = run_steps(StepRun(setup, condition.gap, heights, condition.load, seed))
        if lost_at_s is not None:
            return None
        step_rows = [
            merge_directions(steps, height) for height in dict.fromkeys(step.height for step in steps)
        ]
        figures = _worst_figures([step_figures for step_figures in step_rows if step_figures is not None])
        if aims.cost(figures) > ceiling:
            return figures  # The sine can only increase the cost.
        # The peak sensitivity of a fast loop is in this range.
        rate_Hz = setup.rig.settings.timing.rate_Hz
        frequencies = geometric_spacing(rate_Hz / 160.0, rate_Hz / 10.0, 11)
        response = measure_loop_sensitivity(setup, condition.gap, condition.load, frequencies, seed)
        if response is None:
            return None
        return replace(figures, peak_sensitivity=interpolate_peak(response))

    def initial_guesses(self, aims: Aims, seed: int) -> list[Callable[[], FloatArray]]:
        """Return functions that find the points with the best linear loops.

        There is one function for each pair of a peak sensitivity limit and a softened magnet slope.
        """
        screens = [make_screen(self.setup, self.conditions, factor) for factor in SLOPE_FRACTIONS]
        aims_list = [
            aims.with_scaled_limits({"peak_sensitivity": peak_factor}) for peak_factor in _PEAK_FACTORS
        ]
        return [
            partial(self._find_best_point, seed, (screen, screen_aims))
            for screen in screens
            for screen_aims in aims_list
        ]

    def _find_best_point(self, seed: int, task: tuple[Screen, Aims]) -> FloatArray:
        screen, aims = task
        return minimise_cost(partial(self._linear_costs, screen, aims), len(self.space.axes), seed)

    def _linear_costs(self, screen: Screen, aims: Aims, points: FloatArray) -> FloatArray:
        gains = self.space.gains_per_tick(points, self.setup.controller)
        return screen.evaluate(gains).costs(aims, screen.horizon_s)

    def minimum_settling_time(self, seed: int, changed_problem: tuple[Screen, Aims]) -> float:
        """Return the settling time of the best linear loops, s; inf if they miss the aims."""
        best_point = self._find_best_point(seed, changed_problem)
        cost = float(self._linear_costs(*changed_problem, best_point[None, :])[0])
        return cost if cost <= changed_problem[0].horizon_s else math.inf

    def check(self, jobs: int | None = None) -> CheckResult:
        """Run all steps with every noise seed, and a stepped sine at each condition."""
        setup, conditions = self.setup, self.conditions
        seeds = default_seeds(setup.rig)
        heights = setup.rig.settings.step.heights_m
        gaps = list(dict.fromkeys(condition.gap for condition in conditions))
        loads = list(dict.fromkeys(condition.load for condition in conditions))
        cells = compare_steps([setup], gaps, heights, loads, list(seeds), jobs=jobs)
        responses = map_ordered(partial(_measure_sensitivity, setup), list(conditions), jobs=jobs)
        figures, peak_frequencies = {}, {}
        for condition, response in zip(conditions, responses, strict=True):
            condition_cells = [
                cell for cell in cells if (cell.gap, cell.load) == (condition.gap, condition.load)
            ]
            figures[condition] = _condition_figures(condition_cells, response)
            peak_frequencies[condition] = math.inf if response is None else response.peak_frequency
        worst_cells = {
            name: max(cells_with_figure, key=lambda each: each.figures[name].mean)
            for name in GAIN_METRICS
            if (cells_with_figure := [cell for cell in cells if name in cell.figures])
        }
        return CheckResult(
            figures,
            peak_frequencies,
            len(seeds),
            {name: cell.figures[name].half_width for name, cell in worst_cells.items()},
            {name: f"step of {1e6 * cell.height:g} um" for name, cell in worst_cells.items()},
            {"steps": [cell.as_dict() for cell in cells]},
        )

    def find_limits(
        self, aims: Aims, check_result: CheckResult, seed: int, jobs: int | None = None
    ) -> list[Limit]:
        """Return what limits the checked gains."""
        if not math.isfinite(check_result.worst.cost):
            return [Limit("settling_time_s", "no gains settle within the hold at every condition")]
        return [
            *check_result.find_binding_aims(aims),
            *_noise_limits(self.setup, check_result),
            *_saturation_limits(self.setup, self.conditions, seed, jobs),
            *_find_helpful_changes(self, aims, seed, jobs),
        ]

    def gains(self) -> dict[str, float]:
        """Return the gains, keyed by their names in files."""
        pidd2 = self.setup.controller.pidd2()
        return {
            "K_p_N_per_m": pidd2.K_p,
            "K_i_N_per_m_s": pidd2.K_i,
            "K_d_N_s_per_m": pidd2.K_d,
            "K_dd_N_s2_per_m": pidd2.K_dd,
            "cutoff_Hz": pidd2.cutoff,
            "cutoff_2_Hz": pidd2.cutoff_2,
            "set_point_weight": pidd2.weight,
        }

    @property
    def trial_text(self) -> str:
        """Description of the trial that is run at every condition."""
        heights = self.setup.rig.settings.step.heights_m
        return f"steps of {', '.join(f'{1e6 * height:g}' for height in heights)} um up and down"

    def facts(self) -> dict[str, Any]:
        """Return the data of the rig for tuning.json."""
        controller, rig = self.setup.controller, self.setup.rig.settings
        return {
            "controller": controller.name,
            "number_format": controller.compensation.format,
            "supply_V": rig.amplifier.supply_V,
            "steps_m": list(rig.step.heights_m),
        }

    def explain_parameters(self, parameters: Mapping[str, float]) -> list[str]:
        """Return lines of text that explain the parameters of a point."""
        return [
            f"Poles of the moving mass: pair at {parameters['bandwidth_Hz']:.4g} Hz with damping "
            f"{parameters['damping']:.3g}, real pole at "
            f"{parameters['bandwidth_Hz'] * parameters['real_pole']:.4g} Hz;",
            f"virtual mass {100.0 * parameters['virtual_mass']:.3g} % of the mass.",
        ]


def _worst_figures(rows: Sequence[Mapping[str, float]], peak: float = 0.0) -> BearingFigures:
    """Return the largest value of each metric, with the given peak sensitivity."""
    names = set(rows[0]) & set(BearingFigures().by_name())
    return BearingFigures(peak_sensitivity=peak, **{name: max(row[name] for row in rows) for name in names})


def interpolate_peak(response: Sensitivity) -> float:
    """Return the peak sensitivity from a parabola through the largest value and its two neighbours."""
    log_magnitude = np.log(response.magnitude)
    peak_index = int(np.argmax(log_magnitude))
    if not 0 < peak_index < log_magnitude.size - 1:
        return response.peak
    left_value, centre_value, right_value = log_magnitude[peak_index - 1 : peak_index + 2].tolist()
    curvature = left_value - 2.0 * centre_value + right_value
    return (
        math.exp(centre_value - (right_value - left_value) ** 2 / (8.0 * curvature))
        if curvature < 0.0
        else response.peak
    )


def _measure_sensitivity(setup: BearingSetup, condition: BearingCondition) -> Sensitivity | None:
    rate_Hz = setup.rig.settings.timing.rate_Hz
    frequencies = geometric_spacing(rate_Hz / 500.0, rate_Hz / 8.0, 40)
    return measure_loop_sensitivity(setup, condition.gap, condition.load, frequencies, 0)


def _condition_figures(cells: Sequence[StepCell], measured_sensitivity: Sensitivity | None) -> BearingFigures:
    if measured_sensitivity is None or any(step_cell.lost or not step_cell.figures for step_cell in cells):
        return BearingFigures.for_lost_body()
    mean_figures = [{name: interval.mean for name, interval in cell.figures.items()} for cell in cells]
    return _worst_figures(mean_figures, interpolate_peak(measured_sensitivity))


_LIMIT_FRACTION = 0.995  # fraction of a limit above which a signal counts as saturated
_NOISE_SIGMAS = 3.0  # assumed width of the noise, in standard deviations
_SETTLING_BAND = 0.02  # settling band, relative to the step height


def _noise_limits(setup: BearingSetup, check_result: CheckResult) -> list[Limit]:
    """Report whether sensor noise fills at least half of the smallest step's settling band."""
    height = min(setup.rig.settings.step.heights_m)
    standstill_m = check_result.worst.standstill_rms_m
    noise_to_band = _NOISE_SIGMAS * standstill_m / (_SETTLING_BAND * height)
    if noise_to_band < 0.5:
        return []
    sensor_kind = setup.rig.settings.gap_sensor.kind
    return [
        Limit(
            "noise",
            f"three times the standstill of {1e9 * standstill_m:.0f} nm rms fills {100.0 * noise_to_band:.0f} % of "
            f"the band in which a step of {1e6 * height:g} um must stay (position sensor: {sensor_kind})",
        )
    ]


def _saturation_limits(
    setup: BearingSetup, conditions: Sequence[BearingCondition], seed: int, jobs: int | None
) -> list[Limit]:
    """Report how long force, voltage or current are at their limits during a step."""
    measure_times = partial(_saturation_times, setup, seed)
    times_by_condition = list(
        zip(conditions, map_ordered(measure_times, list(conditions), jobs=jobs), strict=True)
    )
    limits, amplifier = setup.controller.limits, setup.rig.settings.amplifier
    texts = {
        "force": f"the demand is at its limits of {limits.force_low_N:g} and {limits.force_high_N:g} N",
        "voltage": f"the amplifier is at its supply of {amplifier.supply_V:g} V",
        "current": f"the current is at its limits of {limits.current_low_A:g} and "
        f"{limits.current_high_A:g} A",
    }
    found_limits = []
    for quantity, text in texts.items():
        condition, seconds = max(
            ((condition, time_by_quantity[quantity]) for condition, time_by_quantity in times_by_condition),
            key=lambda entry: entry[1],
        )
        if seconds > 0.0:
            found_limits.append(
                Limit(quantity, f"{text} for up to {1e3 * seconds:.2g} ms of a step, at {condition.text}")
            )
    return found_limits


def _saturation_times(setup: BearingSetup, seed: int, condition: BearingCondition) -> Mapping[str, float]:
    """Return how long force, voltage and current are at their limits in the worst step, s."""
    rig, limits = setup.rig, setup.controller.limits
    heights = rig.settings.step.heights_m
    scenario = plan_steps(rig, setup.controller, condition.gap, heights, condition.load)
    recording = SimulatedLoop(setup, seed).run(scenario)
    longest_s = {"force": 0.0, "voltage": 0.0, "current": 0.0}
    for step in scenario.steps:
        step_recording = recording.slice_ticks(step.begin, step.end)
        force_tolerance_N = (1.0 - _LIMIT_FRACTION) * limits.force_high_N
        demand, current = step_recording["demand_N"], step_recording["command_A"]
        current_high_A, current_low_A = limits.current_high_A, limits.current_low_A
        is_saturated = {
            "force": (demand >= limits.force_high_N - force_tolerance_N)
            | (demand <= limits.force_low_N + force_tolerance_N),
            "voltage": np.abs(step_recording["voltage_V"]) >= _LIMIT_FRACTION * rig.settings.amplifier.supply,
            "current": (current >= _LIMIT_FRACTION * current_high_A)
            | (current <= current_low_A + (1.0 - _LIMIT_FRACTION) * current_high_A),
        }
        for quantity, ticks in is_saturated.items():
            longest_s[quantity] = max(longest_s[quantity], float(np.count_nonzero(ticks)) * rig.dt)
    return longest_s


def _find_helpful_changes(loop: BearingLoop, aims: Aims, seed: int, jobs: int | None) -> list[Limit]:
    """Tune linear loops again with one change at a time, and report the changes that help."""
    screen = make_screen(loop.setup, loop.conditions)
    loops = screen.loops
    overshoot = 2.0 * (aims.overshoot_percent or 0.0)
    relaxed_aims = aims.with_scaled_limits({"overshoot_percent": 2.0})
    loops_with_half_delay = [
        replace(loop, timing=replace(loop.timing, delay_ticks=0.5 * loop.timing.delay_ticks))
        for loop in loops
    ]
    changes: dict[str, tuple[str, Screen, Aims]] = {
        "overshoot_percent": (f"an overshoot of {overshoot:g} %", screen, relaxed_aims),
        "force": ("50 % more force for the largest step", screen.with_scaled_force(1.5), aims),
        "delay": ("half the delay from sample to current", screen.with_loops(loops_with_half_delay), aims),
        "pinning": ("an iron without pinning", screen.select_loops(range(0, len(loops), 2)), aims),
    }
    loops_with_fast_amplifier = [
        replace(
            loop, amplifier=AnalogueAmplifier(2.0 * loop.amplifier.gain, 2.0 * loop.amplifier.integral_gain)
        )
        for loop in loops
        if isinstance(loop.amplifier, AnalogueAmplifier)
    ]
    if loops_with_fast_amplifier:
        fast_amplifier_screen = screen.with_loops(loops_with_fast_amplifier)
        changes["amplifier"] = ("an amplifier of twice the bandwidth", fast_amplifier_screen, aims)

    def text(change: str, cost: float, base_cost: float) -> str:
        times_text = f"{1e3 * cost:.2g} instead of {1e3 * base_cost:.2g} ms"
        return f"with {change} linear loops would settle in {times_text}"

    minimum_cost = partial(loop.minimum_settling_time, seed)
    return find_helpful_changes(minimum_cost, screen, aims, changes, jobs, text)
