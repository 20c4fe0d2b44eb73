"""Compare models of magnets whose lag has other causes than layers of one law.

Each magnet of ``rate_magnets.py`` is identified with default settings from loops at 0.5, 5 and 50 Hz
at three gaps. The compared gap and rates were not fitted. The baselines are the static model of the
slow loops, and this model with one first-order lag that is fitted to the fast loops.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from anhyst.data.speeds import SpeedGroups, group_by_speed
from anhyst.identification import identify
from anhyst.model.actuator import Model
from rate_magnets import MAGNET_COUNT, RateMagnet, rate_magnet
from rows import Row
from speed_magnets import Deviations, find_deviations

TARGETS = {"1 Hz": 0.06, "20 Hz": 0.35, "100 Hz": 0.9, "random": 0.2}
"""Targets of the median magnet: mean deviation, % of the largest force."""
WORST_TARGETS = {"20 Hz": 2.5, "100 Hz": 6.0}
"""Targets of the worst deviation of any magnet with a solid part, % of the largest force."""
METHODS = ("default", "static and lag", "static")


@dataclass(frozen=True)
class RateResult:
    """Deviations of all methods on one magnet."""

    magnet: RateMagnet
    deviations: dict[str, Deviations]
    chosen: str  # selected model, in words
    seconds: float  # processor time of the identification


def evaluate_magnet(number: int) -> RateResult:
    """Identify a magnet with all methods, and compare records that were not fitted."""
    magnet = rate_magnet(number)
    loops = magnet.measure_loops()
    speeds = group_by_speed(loops)
    assert speeds is not None
    start_time = time.process_time()
    model = identify(loops).model
    seconds = time.process_time() - start_time
    static_model = identify(speeds.slow).model
    models = dict(zip(METHODS, (model, _with_lag(static_model, speeds), static_model), strict=True))
    records = magnet.comparison_records()
    largest = max(float(np.max(loop.output)) for loop in loops.loops)
    deviations = {
        method: find_deviations(candidate, records, largest) for method, candidate in models.items()
    }
    chosen = f"{model.law}, {model.gap_map}, {model.layers or model.eddy_circuit or 'one lag'}"
    return RateResult(magnet, deviations, chosen, seconds)


def _with_lag(static_model: Model, speeds: SpeedGroups) -> Model:
    """Return the static model with the lag that fits the fast loops best."""
    fast_loops = [loop for group in speeds.fast for loop in group]

    def lagging(log_gamma: float) -> Model:
        parameters = {**static_model.parameters, "gamma": float(np.exp(log_gamma))}
        return replace(static_model, parameters=parameters)

    def error(log_gamma: float) -> float:
        model = lagging(log_gamma)
        return sum(float(np.mean((model.predict_loop(loop) - loop.output) ** 2)) for loop in fast_loops)

    starts = np.log(np.geomspace(1e-3, 1e3, 25))
    start = min(starts.tolist(), key=error)
    return lagging(float(minimize_scalar(error, bounds=(start - 0.6, start + 0.6), method="bounded").x))


def rows() -> list[Row]:
    """Evaluate all magnets; inspected and uninspected magnets have separate rows."""
    results = [evaluate_magnet(number) for number in range(MAGNET_COUNT)]
    lines = []
    for title, is_odd in (("looked at", 0), ("not looked at", 1)):
        group = [result for result in results if result.magnet.number % 2 == is_odd]
        for name, target in TARGETS.items():
            medians = {
                method: float(np.median([result.deviations[method][name][0] for result in group]))
                for method in METHODS
            }
            text = "; ".join(f"{method} {median:.3f}" for method, median in medians.items())
            lines.append(
                Row(
                    f"rate, {name}, median of {len(group)} magnets {title}: mean deviation, % of F_max",
                    f"<= {target:g}",
                    text,
                    medians["default"] <= target,
                    medians["default"],
                )
            )
        for name, target in WORST_TARGETS.items():
            worst = {
                result.magnet.number: result.deviations["default"][name][1]
                for result in group
                if result.magnet.kind.startswith("rod")
            }
            lines.append(
                Row(
                    f"rate, {name}, solid parts, magnets {title}: worst deviation, % of F_max",
                    f"<= {target:g}",
                    "; ".join(f"magnet {number}: {value:.2g}" for number, value in worst.items()),
                    max(worst.values()) <= target,
                    max(worst.values()),
                )
            )
        lines += [_magnet_row(result, title) for result in group]
    return lines


def _magnet_row(result: RateResult, title: str) -> Row:
    text = "; ".join(
        f"{name} {mean:.2f} / {worst:.2f} (static {result.deviations['static'][name][0]:.2f})"
        for name, (mean, worst) in result.deviations["default"].items()
    )
    return Row(
        f"rate, magnet {result.magnet.number} ({result.magnet.kind}), {title}: mean / worst, % of F_max",
        "identified in 10 s",
        f"{text}; {result.chosen}; {result.seconds:.1f} s",
        result.seconds <= 10.0,
        result.seconds,
    )
