"""Compare two laws and the strongest baseline on the bearing, with irons of all families.

The irons are those of ``examples/bearing`` and ``examples/irons``. Each controller is fitted only
to loops that the rig's sensors measured. ``python benchmarks/families.py`` prints every step.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from anhyst._core import Coil
from anhyst.compensate import output_drift
from anhyst.compensate.force_controller import make_twin
from anhyst.compensate.plan import CompileRequest, make_plan
from anhyst.control.controller_file import ControllerFile
from anhyst.data import Loops
from anhyst.identification.run import IdentifyTable
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.bearing.loop import BearingSetup, make_setup
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.case_table import TrajectoryCase
from anhyst_rigs.rig.drift import change_iron, change_rig
from anhyst_rigs.rig.fitting import IdentifiedMagnet, identify_magnet
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.study.bearing import experiments
from anhyst_rigs.study.bearing.responses import StepCell, compare_steps, default_seeds
from anhyst_rigs.study.benefit import BASELINES, OVERSHOOT_FLOOR_FACTOR, Benefit, map_bearing_benefit
from bearing import HEIGHTS, read_example, with_quiet_sensor
from rows import Row, Stopwatch
from virtual import irons

BUNDLED = "cells"
CELL_LAW, PAPER_LAW = "play-cells", "effective-field"

MAX_EXTRA_OVERSHOOT = 0.05
"""Target: percentage points by which the overshoot of `full` may exceed that of the best baseline.
"""

MAX_ERROR_RATIO = 0.5
"""Target: ratio of the force error on the slow triangle to that of the best single-valued curve."""

MAX_DRIFT_PERCENT = 0.05
"""Target: drift of a constant force in :data:`SECONDS`, % of the largest force."""

SECONDS = 60
RATE = 20e3
FORCE_LEVELS = (0.2, 0.5, 0.8)
"""Constant force demands, relative to the largest force that can be reached at all gaps."""

LOW_PINNING_FACTOR = 0.02
"""Factor of the pinning that makes the hysteresis negligible."""

SLOW_TRIANGLE = TrajectoryCase(kind="triangle", amplitude_m=20e-6, frequency_Hz=1.0)


@dataclass(frozen=True)
class IronResult:
    """Results of one iron with the gains of the example.

    Parameters
    ----------
    name : str
    steps : mapping of str to sequence of StepCell
        Results of each variant, one for each step height. ``paper`` is `full` with the law of the
        paper; ``without hysteresis`` is the best single-valued curve with a nearly unpinned iron.
    triangle : mapping of str to float
        Rms force error on the slow triangle, N; NaN if the armature was lost.
    initial_curve_errors : mapping of str to float
        The same errors if the initial magnetisation curve was also measured, N.
    drift : tuple of float
        Drift of a constant force in a minute, % of the largest: of the iron, and of the model.
    refusal : str
        Reason why the law of the paper could not be compiled; empty if it was compiled.
    """

    name: str
    steps: Mapping[str, Sequence[StepCell]]
    triangle: Mapping[str, float]
    initial_curve_errors: Mapping[str, float]
    drift: tuple[float, float]
    refusal: str = ""


def make_rigs() -> dict[str, BodyRig]:
    """Return the bearing with every iron; the first has the iron of the example."""
    rig, _ = read_example()
    other_irons = {name: change_rig(rig, {"iron": table}) for name, table in irons().items()}
    return {BUNDLED: rig, **other_irons}


def with_initial_curve(rig: BodyRig, loops: Loops) -> Loops:
    """Return loops with an additional record at every gap, which begins demagnetised."""
    demagnetised_loops = measure_loops(change_rig(rig, {"measurement.conditioning_cycles": 0}))
    record = rig.settings.measurement.records[0].name
    record_settings = [replace(loop, label=f"{loop.label}-first") for loop in demagnetised_loops.loops]
    return loops.with_loops([*loops.loops, *(loop for loop in record_settings if record in loop.label)])


def _setups(
    rig: BodyRig, controller: ControllerFile, loops: Loops
) -> tuple[dict[MethodName, BearingSetup], IdentifiedMagnet]:
    """Fit the baselines, and `full` with play cells."""
    table = controller.settings
    knowledge = identify_magnet(loops, IdentifyTable(law=CELL_LAW))
    setups: dict[MethodName, BearingSetup] = {
        name: make_setup(rig, table, knowledge, name, "fixed") for name in (*BASELINES, "full")
    }
    return setups, knowledge


def _fit_paper_law(rig: BodyRig, controller: ControllerFile, loops: Loops) -> BearingSetup | str:
    """Fit `full` with the law of the paper, or return the reason why this is impossible."""
    knowledge = identify_magnet(loops, IdentifyTable(law=PAPER_LAW))
    try:
        return make_setup(rig, controller.settings, knowledge, "full", "fixed")
    except InputError as error:
        return str(error)


def _fit_unpinned_curve(rig: BodyRig, controller: ControllerFile) -> BearingSetup:
    """Fit the best single-valued curve to an iron with almost no hysteresis, as a reference."""
    soft_rig = change_iron(rig, None, LOW_PINNING_FACTOR)
    knowledge = identify_magnet(measure_loops(soft_rig), IdentifyTable(law=PAPER_LAW))
    return make_setup(soft_rig, controller.settings, knowledge, "single-valued", "fixed")


def _triangle_errors(rig: BodyRig, setups: Mapping[MethodName, BearingSetup]) -> dict[str, float]:
    quiet_rig = with_quiet_sensor(rig)
    quiet_setups = {name: BearingSetup(quiet_rig, s.compensator, s.controller) for name, s in setups.items()}
    metrics_by_name = experiments.run_variants(
        experiments.run_trajectory, quiet_setups, default_seeds(rig), SLOW_TRIANGLE
    )
    return {name: metrics.interval("force_error_rms_N").mean for name, metrics in metrics_by_name.items()}


def _compare_steps(rig: BodyRig, setups: Mapping[MethodName, BearingSetup]) -> dict[str, list[StepCell]]:
    gap, load = rig.settings.gap_m, rig.settings.load.force_N
    return {
        variant: compare_steps([setup], [gap], HEIGHTS, [load], default_seeds(rig))
        for variant, setup in setups.items()
    }


def measure_held_drift(rig: BodyRig, knowledge: IdentifiedMagnet) -> tuple[float, float]:
    """Hold forces with noise of demand and gap; return the drift of iron and model, % of F_max.

    The noise is that of the compiler's drift test. The drift is the difference between the means of
    the first second and the last second with noise.
    """
    plan = make_plan(knowledge.model, CompileRequest("full", "q31", RATE), 0)
    scales = plan.block.scales
    gap_low, gap_span = scales.gap_low, scales.gap_high - scales.gap_low
    output_range = plan.builder.output_range
    largest_demand = float(output_range.demand(np.ones(2), np.array([gap_low, gap_low + gap_span])).min())
    ticks = round(SECONDS * RATE)
    worst_drifts = [0.0, 0.0]
    for force_level in FORCE_LEVELS:
        generator = np.random.default_rng(5)
        demand_rise = np.concatenate([np.linspace(0.05, 0.95, 2000), np.linspace(0.95, force_level, 2000)])
        noisy_demand = force_level + output_drift.DEMAND_NOISE * generator.standard_normal(ticks)
        demand = largest_demand * np.concatenate([demand_rise, noisy_demand])
        gap = np.full(demand.size, gap_low + 0.5 * gap_span)
        gap[demand_rise.size :] += output_drift.GAP_NOISE * gap_span * generator.standard_normal(ticks)
        current = make_twin(plan.block, "q31").run(demand, gap)
        forces = (
            Coil(rig.magnet).run(current, gap)[demand_rise.size :, 0],
            plan.model.predict(current, gap, history="demagnetised").output[demand_rise.size :],
        )
        second_ticks = round(RATE)
        for index, force in enumerate(forces):
            drift = abs(float(np.mean(force[-second_ticks:]) - np.mean(force[:second_ticks])))
            worst_drifts[index] = max(worst_drifts[index], 100.0 * drift / plan.reference_output)
    return worst_drifts[0], worst_drifts[1]


def measure(name: str, rig: BodyRig, controller: ControllerFile) -> IronResult:
    """Measure everything of one iron."""
    loops = measure_loops(rig)
    setups, knowledge = _setups(rig, controller, loops)
    steps = _compare_steps(rig, setups)
    triangle = _triangle_errors(rig, setups)
    paper_setup = _fit_paper_law(rig, controller, loops)
    curve_setup: dict[MethodName, BearingSetup] = {"single-valued": _fit_unpinned_curve(rig, controller)}
    steps["without hysteresis"] = _compare_steps(rig, curve_setup)["single-valued"]
    triangle["without hysteresis"] = _triangle_errors(curve_setup["single-valued"].rig, curve_setup)[
        "single-valued"
    ]
    if isinstance(paper_setup, BearingSetup):
        steps["paper"] = _compare_steps(rig, {"full": paper_setup})["full"]
        triangle["paper"] = _triangle_errors(rig, {"full": paper_setup})["full"]
    initial_curve_magnet = identify_magnet(with_initial_curve(rig, loops), IdentifyTable(law=CELL_LAW))
    names: tuple[MethodName, ...] = ("single-valued", "full")
    initial_curve_setups = {
        method: make_setup(rig, controller.settings, initial_curve_magnet, method, "fixed")
        for method in names
    }
    return IronResult(
        name,
        steps,
        triangle,
        _triangle_errors(rig, initial_curve_setups),
        measure_held_drift(rig, knowledge),
        paper_setup if isinstance(paper_setup, str) else "",
    )


def _overshoot_excess(result: IronResult, variant: str) -> list[float]:
    """Return the significant excess of overshoot over the best baseline for each height, % points.

    Zero if both overshoots are below a multiple of the standstill rms (`OVERSHOOT_FLOOR_FACTOR`).
    """
    excesses = []
    for height_index, height in enumerate(HEIGHTS):
        cells = {name: steps[height_index] for name, steps in result.steps.items()}
        cell_of_variant = cells[variant]
        baseline_cells = [cells[name] for name in BASELINES if not cells[name].lost]
        best_baseline = min(baseline_cells, key=lambda cell: cell.interval("overshoot_percent").mean)
        if cell_of_variant.lost:
            excesses.append(float("inf"))
            continue
        standstill_rms = max(
            cell.interval("standstill_rms_m").mean for cell in (cell_of_variant, best_baseline)
        )
        noise_floor = 100.0 * OVERSHOOT_FLOOR_FACTOR * standstill_rms / height
        variant_interval, baseline_interval = (
            cell.interval("overshoot_percent") for cell in (cell_of_variant, best_baseline)
        )
        significant_excess = (
            variant_interval.mean
            - baseline_interval.mean
            - float(np.hypot(variant_interval.half_width, baseline_interval.half_width))
        )
        is_within_noise = max(variant_interval.mean, baseline_interval.mean) < noise_floor
        excesses.append(0.0 if is_within_noise else max(significant_excess, 0.0))
    return excesses


def _standstill_rms(result: IronResult, variant: str) -> float:
    """Return the standstill rms of the gap, nm, averaged over the heights."""
    cells = [cell for cell in result.steps[variant] if not cell.lost]
    return 1e9 * float(np.mean([cell.interval("standstill_rms_m").mean for cell in cells]))


def _steps_row(result: IronResult) -> Row:
    overshoot_texts = {
        name: "/".join(
            "lost" if cell.lost else f"{cell.interval('overshoot_percent').mean:.2f}" for cell in cells
        )
        for name, cells in result.steps.items()
    }
    excesses = _overshoot_excess(result, "full")
    return Row(
        f"bearing, iron {result.name}: overshoot, steps of 10/20/50/100 um, same gains",
        f"full significantly worse than the strongest baseline by <= {MAX_EXTRA_OVERSHOOT:g} % points",
        f"excess at most {max(excesses):.2f}; "
        + ", ".join(f"{name} {text} %" for name, text in overshoot_texts.items())
        + f"; standstill: full {_standstill_rms(result, 'full'):.0f} nm rms, single-valued "
        f"{_standstill_rms(result, 'single-valued'):.0f} nm"
        + (f"; paper: {result.refusal}" if result.refusal else ""),
        max(excesses) <= MAX_EXTRA_OVERSHOOT,
    )


def _triangle_row(result: IronResult) -> Row:
    full_error, curve_error = result.triangle["full"], result.triangle["single-valued"]
    return Row(
        f"bearing, iron {result.name}: force error on the slow triangle",
        f"<= {MAX_ERROR_RATIO:g} times that of the best single-valued curve",
        f"{full_error / curve_error:.2f} times; "
        + ", ".join(f"{name} {error:.2f} N" for name, error in result.triangle.items())
        + f"; with measured initial curve: full {result.initial_curve_errors['full']:.2f} N, single-valued "
        f"{result.initial_curve_errors['single-valued']:.2f} N",
        full_error <= MAX_ERROR_RATIO * curve_error,
    )


def _drift_row(result: IronResult) -> Row:
    iron, model = result.drift
    return Row(
        f"bearing, iron {result.name}: drift of a force held for {SECONDS} s with noise of demand and gap",
        f"<= {MAX_DRIFT_PERCENT:g} % of F_max without a dead band",
        f"{iron:.3f} %; model instead of the iron {model:.4f} %",
        iron <= MAX_DRIFT_PERCENT,
    )


def map_row(benefit: Benefit) -> Row:
    """Return the row of the benefit map over 12 irons of play cells."""
    excesses = [0.0]
    outcomes = []
    for cell in benefit.cells:
        comparison = cell.strongest["overshoot_percent"]
        outcomes.append(comparison.outcome)
        if comparison.outcome == "loss":
            assert comparison.difference is not None
            excesses.append(-comparison.difference.mean - comparison.difference.half_width)
    counts = ", ".join(f"{outcome} in {outcomes.count(outcome)}" for outcome in dict.fromkeys(outcomes))
    return Row(
        f"bearing, map of {len(benefit.cells)} cells, 12 irons of cells: overshoot of full",
        f"nowhere significantly worse than the strongest baseline by more than {MAX_EXTRA_OVERSHOOT:g} % points",
        f"at most {max(excesses):.2f}; cells that exceed the target: "
        f"{sum(excess > MAX_EXTRA_OVERSHOOT for excess in excesses)}; {counts}",
        max(excesses) <= MAX_EXTRA_OVERSHOOT,
    )


def rows() -> list[Row]:
    """Return all rows: seven irons of three families, and the benefit map."""
    watch = Stopwatch()
    rig, controller = read_example()
    results = [measure(name, rig_of_iron, controller) for name, rig_of_iron in make_rigs().items()]
    result_rows = [
        make_row(result) for make_row in (_steps_row, _triangle_row, _drift_row) for result in results
    ]
    result_rows.append(map_row(map_bearing_benefit(rig, controller)))
    return [
        *result_rows,
        Row("bearing, irons of all families: computing time", "minutes", str(watch), None, watch.processor),
    ]


def main(names: Sequence[str]) -> None:
    """Print the rows of the named irons, or of all irons."""
    _, controller = read_example()
    for name, rig in make_rigs().items():
        if not names or name in names:
            result = measure(name, rig, controller)
            for row in (_steps_row(result), _triangle_row(result), _drift_row(result)):
                print(f"{row.what}: {row.measured} ({row.reach}; met: {row.met})", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
