"""Map the benefit of compensation as a function of loop width and reversible fraction of the iron.

The loops of every iron are measured, and all methods are fitted to these loops. All methods run
with the same noise. A bearing is assessed by its steps of several heights. Other rigs are assessed
by the metrics of their random plants, but without drift.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Any, Literal, Protocol

import numpy as np

from anhyst.compensate import methods
from anhyst.control.controller_file import ControllerFile, ControllerTable
from anhyst.data import Loops
from anhyst.data.verdict import assess_loops
from anhyst.support import running_version
from anhyst.support.jobs import Progress, map_ordered
from anhyst.support.kinds import MethodName, require_capability
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.bearing.checks import check_controller
from anhyst_rigs.rig.bearing.loop import make_setup
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import NO_DRIFT, Drift, change_iron
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.fitting import identify_magnet
from anhyst_rigs.rig.force.file import ForceControlRig
from anhyst_rigs.rig.kind_rules import allows_key
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.rig.parts.iron import NamedCells
from anhyst_rigs.rig.piezo import PiezoRig
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet
from anhyst_rigs.study.bearing.operating import find_operating_point, label_iron
from anhyst_rigs.study.bearing.responses import StepResult, StepRun, run_steps
from anhyst_rigs.study.engine.monte_carlo import Plants
from anhyst_rigs.study.engine.table import Interval, MeanRatio, Metric, mean_interval, mean_ratio
from anhyst_rigs.study.excite.design import force_specimen
from anhyst_rigs.study.excite.excite import measure_gaps as excite_specimen
from anhyst_rigs.study.piezo import measure_stage_loops as measure_stack
from anhyst_rigs.study.plants import drifted_rig, force_plants, piezo_plants, stage_plants
from anhyst_rigs.study.reversals import reversal_slope_ratio

PINNING_SCALES = (0.5, 1.0, 2.0)
"""Factors that multiply the pinning of the rig's iron."""
REVERSIBLE_FRACTIONS = (0.05, 0.15, 0.3, 0.5)
"""Reversible fractions of play-cell irons. For other families of iron, only the pinning is varied.
"""
BASELINES = tuple(name for name in methods.BASELINE_METHODS if name not in ("secant", "play"))
"""Methods without hysteresis model and measured flux. linearised: the better of two straight lines.
"""

STEP_METRICS = (
    Metric("overshoot_percent", "overshoot", "%"),
    Metric("settling_in_noise_s", "settling time", "ms", 1e3),
)
"""Metrics of a step for the comparison of the methods."""
DEFAULT_SEED_COUNT = 4
"""Number of noise seeds, if the rig file does not give it."""
OVERSHOOT_FLOOR_FACTOR = 3.0
"""Ratio of overshoot to standstill rms, below which an overshoot counts as zero."""

Outcome = Literal["gain", "nothing to gain", "no gain", "loss"]
_StepPairs = Sequence[Sequence[Mapping[str, float]]]
_Values = Mapping[MethodName, Mapping[str, FloatArray]]


@dataclass(frozen=True)
class IronFigures:
    """An iron of the map, with its measured properties."""

    pinning_scale: float  # factor by which the pinning is multiplied
    # weight of the reversible part of the iron; None if the family has no such parameter
    reversible_fraction: float | None
    loop_width: float  # largest width of the measured loops, relative to the largest current
    # ratio of the slope just after a reversal to the static slope, estimated from the measured
    # loops; None if the loops do not determine it
    after_reversal: float | None
    # the same ratio, measured on the virtual magnet at its operating point; only for bearings
    after_reversal_true: float | None
    label: str  # ``"regular"`` or ``"pathological"``; empty if the slopes are unknown


@dataclass(frozen=True)
class MethodComparison:
    """A comparison of the method ``full`` with a baseline by one metric."""

    # strongest baseline that kept the armature levitated, or None
    baseline: MethodName | None
    # ratio of the metric of ``full`` to that of the baseline; None if one of them lost levitation
    quotient: MeanRatio | None
    difference: Interval | None  # metric of the baseline minus that of ``full``, seed by seed
    # overshoot below which it is treated as zero, % of the height: :data:`OVERSHOOT_FLOOR_FACTOR`
    # times the larger standstill rms of the two methods; None for other metrics
    floor: float | None = None
    is_below_floor: bool = False  # whether both mean overshoots are below the floor

    @property
    def outcome(self) -> Outcome:
        """The outcome; ``gain`` and ``loss`` require that the interval excludes zero.

        It is also ``loss`` if the baseline kept the armature levitated and ``full`` did not.
        """
        if self.is_below_floor:
            return "nothing to gain"
        if self.difference is None:
            return "no gain" if self.baseline is None else "loss"
        if self.difference.mean > self.difference.half_width:
            return "gain"
        return "loss" if self.difference.mean < -self.difference.half_width else "no gain"


@dataclass(frozen=True)
class MapCell:
    """The results for one iron in one case."""

    iron: IronFigures
    case: float | str  # height of a step, m, or name of a trial of the plants
    # metrics by variant and key, without the variants that lost control
    figures: Mapping[MethodName, Mapping[str, Interval]]
    # rms of the gap at the end of the holds by variant, mean over seeds and directions, m
    standstill_rms: Mapping[MethodName, float]
    # by metric: comparison with the strongest of :data:`BASELINES` in it, and with ``ratio``
    strongest: Mapping[str, MethodComparison]
    ratio: Mapping[str, MethodComparison]
    # by metric: comparison with ``flux``, which uses measured flux; empty without a Hall probe
    flux: Mapping[str, MethodComparison]


@dataclass(frozen=True)
class Benefit:
    """The complete map.

    Parameters
    ----------
    rig : str
        Name in the rig file.
    seeds : int
        Number of noise seeds.
    cells : tuple of MapCell
        In the order scale, reversible fraction, case.
    metrics : tuple of Metric
        The compared metrics.
    bearing : mapping of str to object
        For a bearing: the name of its controller and its operating point, m and N.
    """

    rig: str
    seeds: int
    cells: tuple[MapCell, ...]
    metrics: tuple[Metric, ...] = STEP_METRICS
    bearing: Mapping[str, Any] = field(default_factory=dict)

    def mean_loop_width(self, scale: float) -> float:
        """Return the mean loop width of the irons of a scale, relative to the largest current."""
        return float(np.mean([c.iron.loop_width for c in self.cells if c.iron.pinning_scale == scale]))

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``benefit.json``."""
        return {
            "format": "anhyst-benefit",
            "version": 1,
            "anhyst": running_version(),
            "rig": self.rig,
            **self.bearing,
            "noise_seeds": self.seeds,
            "confidence": 0.95,
            "cells": [_cell_dict(map_cell) for map_cell in self.cells],
        }


_IronCase = tuple[float, float | None]
"""An iron: factor on the pinning, and reversible fraction (None: unchanged)."""


def map_bearing_benefit(
    rig: BodyRig,
    controller: ControllerFile,
    scales: Sequence[float] = PINNING_SCALES,
    fractions: Sequence[float | None] | None = None,
    heights: Sequence[float] | None = None,
    seeds: int | None = None,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> Benefit:
    """Map the benefit of compensation for a bearing.

    The loops of each iron are measured with the sensors of the rig, and all variants are fitted to
    them. All variants run with the gains of the controller file.
    """
    check_controller(controller, rig)
    settings = rig.settings
    steps = tuple(settings.step.heights_m if heights is None else heights)
    seed_count = settings.noise_seeds if seeds is None else seeds
    irons = list(product(scales, fractions or reversible_fractions(rig.settings)))
    map_iron = partial(_map_iron, rig, controller.settings, steps, range(seed_count))
    cells_by_iron = map_ordered(map_iron, irons, progress, jobs)
    return Benefit(
        rig=rig.settings.name,
        seeds=seed_count,
        cells=tuple(map_cell for cells in cells_by_iron for map_cell in cells),
        bearing={
            "controller": controller.settings.name,
            "gap_m": settings.gap_m,
            "load_N": rig.settings.load.force_N,
        },
    )


def reversible_fractions(file: RigFile) -> Sequence[float | None]:
    """Return the reversible fractions that are mapped for a rig."""
    is_of_cells = file.bodies and file.magnets and isinstance(file.iron, NamedCells)
    return REVERSIBLE_FRACTIONS if is_of_cells else (None,)


def _map_iron(
    nominal: BodyRig,
    table: ControllerTable,
    heights: tuple[float, ...],
    seeds: Sequence[int],
    iron_case: _IronCase,
) -> list[MapCell]:
    """Measure a magnet, fit all variants to its loops, and simulate its steps."""
    scale, fraction = iron_case
    rig = change_iron(nominal, fraction, scale)
    knowledge = identify_magnet(measure_loops(rig), rig.settings.loops)
    slopes = find_operating_point(rig).slopes
    iron = IronFigures(
        pinning_scale=scale,
        reversible_fraction=fraction,
        loop_width=assess_loops(knowledge.loops).width_relative,
        after_reversal=reversal_slope_ratio(knowledge.loops),
        after_reversal_true=slopes.slope_ratio,
        label=slopes.label,
    )
    steps: dict[MethodName, list[list[StepResult]]] = {}
    has_probe = rig.settings.flux_sensor is not None
    baselines: tuple[MethodName, ...] = (*BASELINES, "flux") if has_probe else BASELINES
    for variant in (*baselines, "full"):
        setup = make_setup(rig, table, knowledge, variant, table.compensation.format)
        gap, load = rig.settings.gap_m, rig.settings.load.force_N
        runs = [run_steps(StepRun(setup, gap, heights, load, seed))[0] for seed in seeds]
        if all(runs):
            steps[variant] = runs
    return [_make_step_cell(iron, height, steps, rig) for height in heights]


def _make_step_cell(
    iron: IronFigures, height: float, steps: Mapping[MethodName, list[list[StepResult]]], rig: BodyRig
) -> MapCell:
    """Return the map cell for one step height."""
    runs: dict[MethodName, _StepPairs] = {  # steps up and down, seed by seed
        name: [
            [step.figures for step in run if math.isclose(step.height, height, rel_tol=1e-6)]
            for run in variant_runs
        ]
        for name, variant_runs in steps.items()
    }
    hold_time = rig.settings.step.hold_s
    values = {
        name: {metric.key: _step_values(step_pairs, metric.key, hold_time) for metric in STEP_METRICS}
        for name, step_pairs in runs.items()
    }
    standstill = {
        name: float(
            np.mean(
                [figures["standstill_rms_m"] for steps_up_and_down in pairs for figures in steps_up_and_down]
            )
        )
        for name, pairs in runs.items()
    }
    has_probe = rig.settings.flux_sensor is not None
    return make_map_cell(iron, height, values, standstill, has_probe, [metric.key for metric in STEP_METRICS])


def make_map_cell(
    iron: IronFigures,
    case: float | str,
    values: _Values,
    standstill_rms: Mapping[MethodName, float],
    has_probe: bool,
    keys: Sequence[str],
) -> MapCell:
    """Return the map cell of an iron from its metrics by method and key, one value for each seed.

    The metrics omit methods that lost control.
    """

    def against(*baselines: MethodName) -> dict[str, MethodComparison]:
        comparisons = {key: _compare_methods(values, key, baselines) for key in keys}
        if isinstance(case, float):
            comparisons["overshoot_percent"] = _with_overshoot_floor(
                comparisons["overshoot_percent"], values, standstill_rms, case
            )
        return comparisons

    return MapCell(
        iron=iron,
        case=case,
        figures={
            name: {key: mean_interval(values_by_seed) for key, values_by_seed in rows.items()}
            for name, rows in values.items()
        },
        standstill_rms=standstill_rms,
        strongest=against(*BASELINES),
        ratio=against("ratio"),
        flux=against("flux") if has_probe else {},
    )


def _step_values(runs: _StepPairs, key: str, hold_time: float) -> FloatArray:
    """Return, for each seed, the larger value of a step up and a step down.

    A settling time is limited to the hold time.
    """
    max_value = hold_time if key == "settling_in_noise_s" else math.inf
    return np.array(
        [max(min(figures[key], max_value) for figures in steps_up_and_down) for steps_up_and_down in runs]
    )


def _compare_methods(values: _Values, key: str, baselines: Sequence[MethodName]) -> MethodComparison:
    """Compare ``full`` with the best baseline of this case; this choice favours it slightly."""
    usable_names = [name for name in baselines if name in values and np.isfinite(values[name][key]).all()]
    if not usable_names:
        return MethodComparison(None, None, None)
    baseline = min(usable_names, key=lambda name: float(np.mean(values[name][key])))
    if "full" not in values or not np.isfinite(values["full"][key]).all():
        return MethodComparison(baseline, None, None)
    full_values, baseline_values = values["full"][key], values[baseline][key]
    return MethodComparison(
        baseline, mean_ratio(full_values, baseline_values), mean_interval(baseline_values - full_values)
    )


def _with_overshoot_floor(
    comparison: MethodComparison, values: _Values, standstill_rms: Mapping[MethodName, float], height: float
) -> MethodComparison:
    """Return a comparison of overshoots with the floor below which they count as zero."""
    if comparison.baseline is None or comparison.quotient is None:
        return comparison
    compared_methods: tuple[MethodName, ...] = ("full", comparison.baseline)
    floor = 100.0 * OVERSHOOT_FLOOR_FACTOR * max(standstill_rms[name] for name in compared_methods) / height
    largest_overshoot = max(float(np.mean(values[name]["overshoot_percent"])) for name in compared_methods)
    return replace(comparison, floor=floor, is_below_floor=largest_overshoot < floor)


AnyRig = BodyRig | ForceControlRig | PiezoRig


class HasIrons(Protocol):
    """A kind of rig whose plants can be simulated with other irons."""

    def with_iron(self, rig: AnyRig, fraction: float | None, scale: float) -> tuple[Loops, Plants]:
        """Measure the loops of a rig with another iron; return the loops and the plants."""


def map_plant_benefit(
    rig: AnyRig,
    scales: Sequence[float] = PINNING_SCALES,
    fractions: Sequence[float | None] | None = None,
    seeds: int | None = None,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> Benefit:
    """Map the benefit of compensation for a stage, a piezo stage or a force rig.

    The loops of every iron are measured, and the models are identified from them. The metrics are
    those of the random plants for this kind of rig, but without drift and over several noise seeds.
    """
    default_count = (
        rig.settings.noise_seeds if allows_key(rig.settings, "noise_seeds") else DEFAULT_SEED_COUNT
    )
    count = seeds or default_count
    irons = list(product(scales, fractions or reversible_fractions(rig.settings)))
    results = map_ordered(partial(_map_plants, rig, range(1, count + 1)), irons, progress, jobs)
    return Benefit(
        rig=rig.settings.name,
        seeds=count,
        cells=tuple(map_cell for cells, _ in results for map_cell in cells),
        metrics=results[0][1],
    )


def _map_plants(
    rig: AnyRig, seeds: Sequence[int], iron_case: _IronCase
) -> tuple[list[MapCell], tuple[Metric, ...]]:
    """Simulate the plants of one iron with every method."""
    scale, fraction = iron_case
    loops, plants = require_capability(rig.settings.kind, HasIrons).with_iron(rig, fraction, scale)
    slope_ratio = reversal_slope_ratio(loops)
    label = "" if slope_ratio is None else label_iron(slope_ratio)
    width = assess_loops(loops).width_relative
    iron = IronFigures(scale, fraction, width, slope_ratio, None, label)
    runs = {method: [plants.run(method, NO_DRIFT, seed) for seed in seeds] for method in plants.methods}
    complete_runs = {
        method: method_runs
        for method, method_runs in runs.items()
        if not any("lost_s" in run for run in method_runs)
    }
    cells, keys = [], [figure.key for figure in plants.figures]
    for case, positions in _cases_by_name(plants).items():
        values = {
            method: {
                figure.key: np.array([_largest_value(run[figure.key], positions) for run in method_runs])
                for figure in plants.figures
            }
            for method, method_runs in complete_runs.items()
        }
        cells.append(make_map_cell(iron, case, values, {}, "flux" in plants.methods, keys))
    return cells, plants.figures


def _cases_by_name(plants: Plants) -> Mapping[str, Sequence[int]]:
    """Return the cases of a map, each with the indices of its values in the metrics of a plant."""
    if plants.single_case:
        return {plants.single_case: [0]}
    stages = [name.partition("_")[0] for name in plants.figures[0].case_names]
    return {
        f"worst of {key}": [position for position, stage_name in enumerate(stages) if stage_name == key]
        for key in dict.fromkeys(stages)
    }


def _largest_value(figure: float | Sequence[float | None] | None, positions: Sequence[int]) -> float:
    """Return the largest of some values of a metric; infinite if a level was not reached."""
    values = [figure[position] for position in positions] if isinstance(figure, Sequence) else [figure]
    return max(math.inf if value is None else value for value in values)


def stage_with_iron(rig: BodyRig, fraction: float | None, scale: float) -> tuple[Loops, Plants]:
    """Measure the loops of a stage with another iron; return the loops and the plants."""
    changed_stage = change_iron(rig, fraction, scale)
    knowledge = identify_stage_magnet(changed_stage, measure_loops(changed_stage))
    probe_methods: tuple[MethodName, ...] = ("flux",) if rig.settings.flux_sensor is not None else ()
    names: tuple[MethodName, ...] = (*BASELINES, "full", *probe_methods)
    return knowledge.loops, stage_plants(changed_stage, knowledge, names, errors={"none": ()}, jobs=1)


def force_with_iron(rig: ForceControlRig, _: float | None, scale: float) -> tuple[Loops, Plants]:
    """Measure the loops of an actuator with another iron; return the loops and the plants."""
    drifted_force_rig = drifted_rig(rig, Drift(pinning=scale - 1.0))
    loops = excite_specimen(force_specimen(drifted_force_rig)).loops
    return loops, force_plants(drifted_force_rig, loops=loops)


def piezo_with_iron(rig: PiezoRig, _: float | None, scale: float) -> tuple[Loops, Plants]:
    """Measure the loops of a stack with scaled width; return the loops and the plants of the stage."""
    slope = scale * rig.settings.stack.slope_m_per_V
    changed_rig = replace(rig, settings=rig.settings.with_changes({"stack.slope_m_per_V": slope}))
    loops = measure_stack(changed_rig)
    return loops, piezo_plants(changed_rig, loops)


def _cell_dict(map_cell: MapCell) -> dict[str, Any]:
    iron = map_cell.iron
    return {
        "pinning_scale": iron.pinning_scale,
        "reversible_fraction": iron.reversible_fraction,
        "loop_width_percent": 100.0 * iron.loop_width,
        "after_reversal": iron.after_reversal,
        "after_reversal_true": iron.after_reversal_true,
        "iron": iron.label,
        "height_m" if isinstance(map_cell.case, float) else "case": map_cell.case,
        "figures": {
            name: {key: _interval_dict(value) for key, value in intervals.items()}
            for name, intervals in map_cell.figures.items()
        },
        "standstill_rms_m": dict(map_cell.standstill_rms),
        **{
            f"against_{baseline}": {
                name: _comparison_dict(comparison) for name, comparison in getattr(map_cell, baseline).items()
            }
            for baseline in ("strongest", "ratio", "flux")
        },
    }


def _interval_dict(interval: Interval) -> dict[str, float]:
    return {"mean": interval.mean, "half_width": interval.half_width}


def _comparison_dict(comparison: MethodComparison) -> dict[str, Any]:
    comparison_values: dict[str, Any] = {"baseline": comparison.baseline, "outcome": comparison.outcome}
    if comparison.floor is not None:
        comparison_values["floor_percent"] = comparison.floor
    if comparison.quotient is not None and comparison.difference is not None:
        value, high = comparison.quotient.value, comparison.quotient.high
        comparison_values |= {
            "ratio": value if math.isfinite(value) else None,
            "ratio_low": comparison.quotient.low,
            "ratio_high": high if math.isfinite(high) else None,
            "difference": _interval_dict(comparison.difference),
        }
    return comparison_values
