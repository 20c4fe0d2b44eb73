"""Sample random irons from the ranges of ``drawn.toml`` for the models of ``drawn_irons.py``."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from anhyst._core import Steel
from anhyst.support.errors import InputError
from anhyst_rigs.rig.parts.iron import CellSteel, DuhemSteel, PreisachSteel
from drawn_irons import Iron, LangevinIron, PlantIron, SeriesIron, TellinenIron

FILE = Path(__file__).with_name("drawn.toml")
SETTINGS: dict[str, Any] = tomllib.loads(FILE.read_text(encoding="utf-8"))
FAMILIES: list[str] = SETTINGS["families"]

_CELLS = 30

Numbers = dict[str, float]


def from_ranges(table: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Sample all parameters of a table; each uses one value of the random generator."""
    sampled: dict[str, Any] = {}
    for name, rule in table.items():
        (distribution, limits), fraction = next(iter(rule.items())), float(rng.random())
        if distribution == "of":
            sampled[name] = limits[int(fraction * len(limits))]
        elif distribution == "log":
            sampled[name] = float(limits[0] * (limits[1] / limits[0]) ** fraction)
        else:
            sampled[name] = float(limits[0] + (limits[1] - limits[0]) * fraction)
    return sampled


def _curve(rng: np.random.Generator) -> Numbers:
    curve_values = from_ranges(SETTINGS["curve"], rng)
    return {
        "saturation_sharp": curve_values["saturation_sharp"],
        "knee_sharp": curve_values["knee_A_per_m"],
        "saturation_slow": curve_values["saturation_slow"],
        "knee_slow": curve_values["knee_A_per_m"] * curve_values["slow_by_sharp"],
    }


def _rig_file_keys(curve: Numbers) -> dict[str, Any]:
    """Return the parameters of a curve with the keys of a rig file."""
    return {
        f"{name}_{'T' if name.startswith('saturation') else 'A_per_m'}": value
        for name, value in curve.items()
    }


def _cells(rng: np.random.Generator) -> tuple[Steel, Numbers]:
    curve, cell_values = _curve(rng), from_ranges(SETTINGS["cells"], rng)
    pinning_shape = cell_values["shape"]
    pinning = curve["knee_sharp"] * cell_values["pinning_by_knee"]
    free, second_fraction = cell_values["reversible"], cell_values["further_share"]
    one_population = CellSteel(
        cells=_CELLS,
        reversible_fraction=free,
        pinning_scale_A_per_m=pinning,
        pinning_shape=pinning_shape,
        **_rig_file_keys(curve),
    )
    second_pinning = {"pinning_scale_A_per_m": pinning * cell_values["further_by_first"]}
    two_populations = one_population.model_copy(update=second_pinning)
    thresholds = np.concatenate([one_population.thresholds, two_populations.thresholds[1:]])
    weights = np.concatenate(
        [
            one_population.weights[:1],
            (1.0 - second_fraction) * one_population.weights[1:],
            second_fraction * two_populations.weights[1:],
        ]
    )
    threshold_order = np.argsort(thresholds)
    return Steel(
        one_population.plant_parameters(), thresholds[threshold_order], weights[threshold_order]
    ), curve | cell_values


def _preisach(rng: np.random.Generator) -> tuple[Steel, Numbers]:
    preisach_values = from_ranges(SETTINGS["preisach"], rng)
    pinning, relays = preisach_values["pinning_A_per_m"], preisach_values["saturation"]
    knee = pinning * preisach_values["knee_by_pinning"]
    steel = PreisachSteel(
        family="preisach",
        saturation_T=relays,
        pinning_A_per_m=pinning,
        pinning_spread=preisach_values["pinning_spread"],
        bias_A_per_m=pinning * preisach_values["bias_by_pinning_0"],
        bias_by_pinning=preisach_values["bias_by_pinning"],
        feedback_A_per_m_T=0.0,
        saturation_sharp_T=relays * preisach_values["sharp_part"],
        knee_sharp_A_per_m=knee,
        saturation_slow_T=relays * preisach_values["slow_part"],
        knee_slow_A_per_m=knee * preisach_values["slow_by_sharp"],
    )
    # The feedback is a fraction of the largest value that the steel accepts, found by bisection.
    low_feedback, high_feedback = 0.0, 4.0 * pinning / relays
    for _ in range(6):
        trial_feedback = 0.5 * (low_feedback + high_feedback)
        trial_steel = steel.model_copy(update={"feedback_A_per_m_T": trial_feedback})
        low_feedback, high_feedback = (
            (trial_feedback, high_feedback) if _is_valid(trial_steel) else (low_feedback, trial_feedback)
        )
    steel = steel.model_copy(update={"feedback_A_per_m_T": preisach_values["feedback"] * low_feedback})
    return steel.make_steel(), preisach_values | {"knee_sharp": steel.knee, "saturation_sharp": relays}


def _is_valid(steel: PreisachSteel | DuhemSteel) -> bool:
    try:
        steel.make_steel()
    except InputError:
        return False
    return True


def _duhem(rng: np.random.Generator) -> tuple[Steel, Numbers]:
    while True:  # some combinations are not a valid iron
        curve, duhem_values = _curve(rng), from_ranges(SETTINGS["duhem"], rng)
        coercivity = duhem_values["coercivity_by_knee"] * curve["knee_sharp"]
        steel = DuhemSteel.model_construct(
            family="duhem",
            coercivity_A_per_m=coercivity,
            turning_T=duhem_values["turning"],
            fading=duhem_values["fading"],
            **_rig_file_keys(curve),
        )
        if _is_valid(steel):
            return steel.make_steel(), curve | duhem_values


_PLANT = {"cells": _cells, "preisach": _preisach, "duhem": _duhem}


def draw_iron(family: str, rng: np.random.Generator) -> tuple[Iron, dict[str, Any]]:
    """Sample an iron; its parameters include saturation and knee, which size the magnet."""
    true: dict[str, Any]
    if family in _PLANT:
        steel, true = _PLANT[family](rng)
        return PlantIron(steel), true
    iron_values = from_ranges(SETTINGS[family], rng)
    if family == "series":
        (first, core), (second, armature) = (_PLANT[iron_values[name]](rng) for name in ("core", "armature"))
        true = {"core_iron": core, "armature_iron": armature, **iron_values}
        true["knee_sharp"] = max(core["knee_sharp"], armature["knee_sharp"])
        true["saturation_sharp"] = min(core["saturation_sharp"], armature["saturation_sharp"])
        return SeriesIron(first, second, iron_values["length_part"], iron_values["area_ratio"]), true
    if family == "tellinen":
        curve = _curve(rng)
        coercivity = iron_values["coercivity_by_knee"] * curve["knee_sharp"]
        return TellinenIron(
            coercivity, curve["saturation_sharp"], curve["knee_sharp"],
            curve["saturation_slow"], curve["knee_slow"],
        ), curve | iron_values  # fmt: skip
    width = iron_values["width_A_per_m"]
    friction = iron_values["friction_by_width"] * width
    langevin = LangevinIron(
        narrow=iron_values["saturation"] * (1.0 - iron_values["wide_part"]),
        width=width,
        wide=iron_values["saturation"] * iron_values["wide_part"],
        width_wide=width * iron_values["wide_by_narrow"],
        friction=friction,
        way=friction * iron_values["way_by_friction"],
    )
    return langevin, iron_values | {"knee_sharp": 2.0 * width, "saturation_sharp": iron_values["saturation"]}
