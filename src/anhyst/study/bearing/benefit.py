"""What compensation gains, over the width of the loops, the reversible part and the step height."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np

from anhyst.compensate import methods
from anhyst.control.controller_file import ControllerFile
from anhyst.data.verdict import judge, reversal_share
from anhyst.rig.bearing.loop import check_controller, make_setup
from anhyst.rig.body import BodyRig
from anhyst.rig.drift import with_iron
from anhyst.rig.fitting import identify_magnet
from anhyst.rig.measuring import measure_loops
from anhyst.rig.parts.iron import NamedCells
from anhyst.study.bearing.operating import find_operating_point
from anhyst.study.bearing.responses import StepResult, StepRun, run_steps
from anhyst.study.engine.table import Interval, Quotient, mean_interval, quotient
from anhyst.support.atomic import running_version
from anhyst.support.jobs import Progress, all_of
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray

WIDTHS = (0.5, 1.0, 2.0)
"""Factors on the pinning of the rig's iron."""
FRACTIONS = (0.05, 0.15, 0.3, 0.5)
"""Reversible fractions of irons of cells; another family has none, and keeps its own shape."""
BASELINES = tuple(name for name in methods.BASELINES if name not in ("secant", "play"))
"""Ways from force to current that know no hysteresis and measure nothing; ``linearised`` is the
better one of the two straight lines."""

Measure = Literal["overshoot_percent", "settling_in_noise_s"]
MEASURES: tuple[Measure, ...] = ("overshoot_percent", "settling_in_noise_s")
"""Figures of a step that are compared; the smaller the better."""
STANDSTILLS = 3.0
"""Overshoots of no more than so many times the rms of a standstill are none: nothing to gain."""

Outcome = Literal["gain", "nothing to gain", "no gain", "loss"]
_Runs = Sequence[Sequence[Mapping[str, float]]]


@dataclass(frozen=True)
class IronFigures:
    """One iron of the map, as it shows in measurements."""

    scale: float  # factor on the pinning
    # weight of what nothing pins; None where the family has no such number
    reversible_fraction: float | None
    loop_width: float  # largest of the measured loops, in parts of the largest current
    # slope just after a reversal over the static slope, estimated from the measured loops; None
    # where they leave it open
    after_reversal: float | None
    after_reversal_true: float  # the same of the virtual magnet at its operating point
    label: str  # ``"regular"`` or ``"pathological"``, by that


@dataclass(frozen=True)
class Comparison:
    """The full compensator against a baseline, in one figure."""

    # strongest of those that kept the armature in the air; None if none did
    baseline: MethodName | None
    # figure of ``full`` over that of the baseline; None where one of them has lost the armature
    quotient: Quotient | None
    difference: Interval | None  # figure of the baseline less that of ``full``, seed by seed
    # Overshoot that is none, % of the height: :data:`STANDSTILLS` times the larger standstill rms
    # of the two. None for other figures.
    floor: float | None = None
    small: bool = False  # both means are below the floor

    @property
    def outcome(self) -> Outcome:
        """``gain`` or ``loss`` if it is certain: the interval of the difference leaves out zero.

        It is a loss, too, where the baseline kept the armature in the air and ``full`` did not.
        """
        if self.small:
            return "nothing to gain"
        if self.difference is None:
            return "no gain" if self.baseline is None else "loss"
        if self.difference.mean > self.difference.half_width:
            return "gain"
        return "loss" if self.difference.mean < -self.difference.half_width else "no gain"


@dataclass(frozen=True)
class MapCell:
    """One iron and step height."""

    iron: IronFigures
    height: float  # m
    # by variant, then by :data:`MEASURES`; a variant that lost the armature is missing
    figures: Mapping[MethodName, Mapping[Measure, Interval]]
    # rms of the gap at the end of the holds, mean over seeds and directions, m; by variant
    standstill: Mapping[MethodName, float]
    # by :data:`MEASURES`: against the strongest of :data:`BASELINES` in this very figure, and
    # against ``ratio``
    strongest: Mapping[Measure, Comparison]
    ratio: Mapping[Measure, Comparison]
    # against ``flux``, which measures the flux density instead; empty without a Hall probe
    flux: Mapping[Measure, Comparison]


@dataclass(frozen=True)
class Benefit:
    """The whole map.

    Parameters
    ----------
    rig, controller : str
        Names in the files.
    gap, load : float
        Operating point, m and N.
    seeds : int
        Of noise.
    cells : tuple of MapCell
        In the order scale, reversible fraction, height.
    """

    rig: str
    controller: str
    gap: float
    load: float
    seeds: int
    cells: tuple[MapCell, ...]

    def row_width(self, scale: float) -> float:
        """Return the mean loop width of the irons of a scale, in parts of the largest current."""
        return float(np.mean([c.iron.loop_width for c in self.cells if c.iron.scale == scale]))

    def as_dict(self) -> dict[str, Any]:
        """Return it as ``benefit.json`` holds it."""
        return {
            "format": "anhyst-benefit",
            "version": 1,
            "anhyst": running_version(),
            "rig": self.rig,
            "controller": self.controller,
            "gap_m": self.gap,
            "load_N": self.load,
            "noise_seeds": self.seeds,
            "confidence": 0.95,
            "cells": [_row(cell) for cell in self.cells],
        }


@dataclass(frozen=True)
class _Work:
    rig: BodyRig
    controller: ControllerFile
    scale: float
    fraction: float | None
    heights: tuple[float, ...]
    seeds: tuple[int, ...]


def benefit(
    rig: BodyRig,
    controller: ControllerFile,
    scales: Sequence[float] = WIDTHS,
    fractions: Sequence[float | None] | None = None,
    heights: Sequence[float] | None = None,
    seeds: int | None = None,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> Benefit:
    """Map what compensation gains; every magnet is measured and identified again.

    Loops of each magnet are measured through the sensors of the rig, all variants are fitted to
    these loops, and all run with the gains of the controller file.
    """
    check_controller(controller, rig)
    tried = rig.settings
    steps = tuple(tried.step.heights_m if heights is None else heights)
    count = tried.noise_seeds if seeds is None else seeds
    if fractions is None:
        of_cells = isinstance(rig.settings.iron, NamedCells)
        fractions = FRACTIONS if of_cells else (None,)
    work = [
        _Work(with_iron(rig, fraction, scale), controller, scale, fraction, steps, (*range(count),))
        for scale, fraction in product(scales, fractions)
    ]
    rows = all_of(_map_iron, work, progress, jobs)
    return Benefit(
        rig=rig.settings.name,
        controller=controller.settings.name,
        gap=tried.gap_m,
        load=rig.settings.load.force_N,
        seeds=count,
        cells=tuple(cell for cells in rows for cell in cells),
    )


def _map_iron(work: _Work) -> list[MapCell]:
    """Measure a magnet, fit everything to its loops, and step it."""
    rig, table = work.rig, work.controller.settings
    knowledge = identify_magnet(measure_loops(rig), rig.settings.loops)
    slopes = find_operating_point(rig).slopes
    iron = IronFigures(
        scale=work.scale,
        reversible_fraction=work.fraction,
        loop_width=judge(knowledge.loops).width_relative,
        after_reversal=reversal_share(knowledge.loops),
        after_reversal_true=slopes.share,
        label=slopes.label,
    )
    steps: dict[MethodName, list[list[StepResult]]] = {}
    probe = rig.settings.hall_probe is not None
    baselines: tuple[MethodName, ...] = (*BASELINES, "flux") if probe else BASELINES
    for variant in (*baselines, "full"):
        setup = make_setup(rig, table, knowledge, variant, table.compensation.format)
        gap, load = rig.settings.gap_m, rig.settings.load.force_N
        runs = [run_steps(StepRun(setup, gap, work.heights, load, seed))[0] for seed in work.seeds]
        if all(runs):
            steps[variant] = runs
    hold = rig.settings.step.hold_s
    return [_cell(iron, height, _at(steps, height), hold, probe) for height in work.heights]


def _at(
    steps: Mapping[MethodName, list[list[StepResult]]], height: float
) -> Mapping[MethodName, _Runs]:
    """Return the figures of the steps of a height: up and down, seed by seed."""
    return {
        name: [
            [step.figures for step in run if math.isclose(step.height, height, rel_tol=1e-6)]
            for run in runs
        ]
        for name, runs in steps.items()
    }


def _cell(
    iron: IronFigures, height: float, runs: Mapping[MethodName, _Runs], hold: float, probe: bool
) -> MapCell:
    values = {
        name: {measure: _values(pairs, measure, hold) for measure in MEASURES}
        for name, pairs in runs.items()
    }
    still = {
        name: float(np.mean([figures["standstill_rms_m"] for pair in pairs for figures in pair]))
        for name, pairs in runs.items()
    }

    def against(*baselines: MethodName) -> dict[Measure, Comparison]:
        return {name: _compare(values, still, height, name, baselines) for name in MEASURES}

    return MapCell(
        iron=iron,
        height=height,
        figures={
            name: {measure: mean_interval(row) for measure, row in rows.items()}
            for name, rows in values.items()
        },
        standstill=still,
        strongest=against(*BASELINES),
        ratio=against("ratio"),
        flux=against("flux") if probe else {},
    )


def _values(runs: _Runs, measure: Measure, hold: float) -> FloatArray:
    """Return the larger one of up and down a seed; what did not settle did so when the hold ended."""
    most = hold if measure == "settling_in_noise_s" else math.inf
    return np.array([max(min(figures[measure], most) for figures in pair) for pair in runs])


def _compare(
    values: Mapping[MethodName, Mapping[Measure, FloatArray]],
    still: Mapping[MethodName, float],
    height: float,
    measure: Measure,
    baselines: Sequence[MethodName],
) -> Comparison:
    """Compare with the best baseline of this very cell: chance favours it a little, never ``full``."""
    held = [name for name in baselines if name in values]
    if not held:
        return Comparison(None, None, None)
    baseline = min(held, key=lambda name: float(np.mean(values[name][measure])))
    if "full" not in values:
        return Comparison(baseline, None, None)
    own, other = values["full"][measure], values[baseline][measure]
    ratio, difference = quotient(own, other), mean_interval(other - own)
    if measure != "overshoot_percent":
        return Comparison(baseline, ratio, difference)
    floor = 100.0 * STANDSTILLS * max(still["full"], still[baseline]) / height
    most = max(float(np.mean(own)), float(np.mean(other)))
    return Comparison(baseline, ratio, difference, floor, most < floor)


def _row(cell: MapCell) -> dict[str, Any]:
    iron = cell.iron
    return {
        "pinning_scale": iron.scale,
        "reversible_fraction": iron.reversible_fraction,
        "loop_width_percent": 100.0 * iron.loop_width,
        "after_reversal": iron.after_reversal,
        "after_reversal_true": iron.after_reversal_true,
        "iron": iron.label,
        "height_m": cell.height,
        "figures": {
            name: {measure: _interval(value) for measure, value in rows.items()}
            for name, rows in cell.figures.items()
        },
        "standstill_rms_m": dict(cell.standstill),
        "against_strongest": {name: _comparison(value) for name, value in cell.strongest.items()},
        "against_ratio": {name: _comparison(value) for name, value in cell.ratio.items()},
        "against_flux": {name: _comparison(value) for name, value in cell.flux.items()},
    }


def _interval(interval: Interval) -> dict[str, float]:
    return {"mean": interval.mean, "half_width": interval.half_width}


def _comparison(comparison: Comparison) -> dict[str, Any]:
    row: dict[str, Any] = {"baseline": comparison.baseline, "outcome": comparison.outcome}
    if comparison.floor is not None:
        row["floor_percent"] = comparison.floor
    if comparison.quotient is not None and comparison.difference is not None:
        value, high = comparison.quotient.value, comparison.quotient.high
        row |= {
            "ratio": value if math.isfinite(value) else None,
            "ratio_low": comparison.quotient.low,
            "ratio_high": high if math.isfinite(high) else None,
            "difference": _interval(comparison.difference),
        }
    return row
