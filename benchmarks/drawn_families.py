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
    found: dict[str, Any] = {}
    for name, rule in table.items():
        (kind, values), part = next(iter(rule.items())), float(rng.random())
        if kind == "of":
            found[name] = values[int(part * len(values))]
        elif kind == "log":
            found[name] = float(values[0] * (values[1] / values[0]) ** part)
        else:
            found[name] = float(values[0] + (values[1] - values[0]) * part)
    return found


def _curve(rng: np.random.Generator) -> Numbers:
    one = from_ranges(SETTINGS["curve"], rng)
    return {
        "saturation_sharp": one["saturation_sharp"],
        "knee_sharp": one["knee_A_per_m"],
        "saturation_slow": one["saturation_slow"],
        "knee_slow": one["knee_A_per_m"] * one["slow_by_sharp"],
    }


def _keys(curve: Numbers) -> dict[str, Any]:
    """Return the parameters of a curve with the keys of a rig file."""
    return {
        f"{name}_{'T' if name.startswith('saturation') else 'A_per_m'}": value
        for name, value in curve.items()
    }


def _cells(rng: np.random.Generator) -> tuple[Steel, Numbers]:
    curve, one = _curve(rng), from_ranges(SETTINGS["cells"], rng)
    shape = one["shape"]
    pinning = curve["knee_sharp"] * one["pinning_by_knee"]
    free, further = one["reversible"], one["further_share"]
    first = CellSteel(
        cells=_CELLS,
        reversible_fraction=free,
        pinning_scale_A_per_m=pinning,
        pinning_shape=shape,
        **_keys(curve),
    )
    further_pinning = {"pinning_scale_A_per_m": pinning * one["further_by_first"]}
    other = first.model_copy(update=further_pinning)
    both = np.concatenate([first.thresholds, other.thresholds[1:]])
    weights = np.concatenate(
        [first.weights[:1], (1.0 - further) * first.weights[1:], further * other.weights[1:]]
    )
    order = np.argsort(both)
    return Steel(first.plant_parameters(), both[order], weights[order]), curve | one


def _preisach(rng: np.random.Generator) -> tuple[Steel, Numbers]:
    one = from_ranges(SETTINGS["preisach"], rng)
    pinning, relays = one["pinning_A_per_m"], one["saturation"]
    knee = pinning * one["knee_by_pinning"]
    steel = PreisachSteel(
        family="preisach",
        saturation_T=relays,
        pinning_A_per_m=pinning,
        pinning_spread=one["pinning_spread"],
        bias_A_per_m=pinning * one["bias_by_pinning_0"],
        bias_by_pinning=one["bias_by_pinning"],
        feedback_A_per_m_T=0.0,
        saturation_sharp_T=relays * one["sharp_part"],
        knee_sharp_A_per_m=knee,
        saturation_slow_T=relays * one["slow_part"],
        knee_slow_A_per_m=knee * one["slow_by_sharp"],
    )
    # The feedback is a fraction of the largest value that the steel accepts, found by bisection.
    low, high = 0.0, 4.0 * pinning / relays
    for _ in range(6):
        middle = 0.5 * (low + high)
        tried = steel.model_copy(update={"feedback_A_per_m_T": middle})
        low, high = (middle, high) if _bears(tried) else (low, middle)
    steel = steel.model_copy(update={"feedback_A_per_m_T": one["feedback"] * low})
    return steel.make_steel(), one | {"knee_sharp": steel.knee, "saturation_sharp": relays}


def _bears(steel: PreisachSteel | DuhemSteel) -> bool:
    try:
        steel.make_steel()
    except InputError:
        return False
    return True


def _duhem(rng: np.random.Generator) -> tuple[Steel, Numbers]:
    while True:  # some combinations are not a valid iron
        curve, one = _curve(rng), from_ranges(SETTINGS["duhem"], rng)
        coercivity = one["coercivity_by_knee"] * curve["knee_sharp"]
        steel = DuhemSteel.model_construct(
            family="duhem",
            coercivity_A_per_m=coercivity,
            turning_T=one["turning"],
            fading=one["fading"],
            **_keys(curve),
        )
        if _bears(steel):
            return steel.make_steel(), curve | one


_PLANT = {"cells": _cells, "preisach": _preisach, "duhem": _duhem}


def draw_iron(family: str, rng: np.random.Generator) -> tuple[Iron, dict[str, Any]]:
    """Sample an iron; its parameters include saturation and knee, which size the magnet."""
    true: dict[str, Any]
    if family in _PLANT:
        steel, true = _PLANT[family](rng)
        return PlantIron(steel), true
    one = from_ranges(SETTINGS[family], rng)
    if family == "series":
        (first, core), (second, armature) = (_PLANT[one[name]](rng) for name in ("core", "armature"))
        true = {"core_iron": core, "armature_iron": armature, **one}
        true["knee_sharp"] = max(core["knee_sharp"], armature["knee_sharp"])
        true["saturation_sharp"] = min(core["saturation_sharp"], armature["saturation_sharp"])
        return SeriesIron(first, second, one["length_part"], one["area_ratio"]), true
    if family == "tellinen":
        curve = _curve(rng)
        coercivity = one["coercivity_by_knee"] * curve["knee_sharp"]
        return TellinenIron(
            coercivity, curve["saturation_sharp"], curve["knee_sharp"],
            curve["saturation_slow"], curve["knee_slow"],
        ), curve | one  # fmt: skip
    width = one["width_A_per_m"]
    friction = one["friction_by_width"] * width
    langevin = LangevinIron(
        narrow=one["saturation"] * (1.0 - one["wide_part"]),
        width=width,
        wide=one["saturation"] * one["wide_part"],
        width_wide=width * one["wide_by_narrow"],
        friction=friction,
        way=friction * one["way_by_friction"],
    )
    return langevin, one | {"knee_sharp": 2.0 * width, "saturation_sharp": one["saturation"]}
