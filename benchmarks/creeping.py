"""Test the choice of a law for random irons without return-point memory on the single-axis stage.

The parameters of the irons are random values around those of examples/irons. Irons with even
numbers were inspected before the selection rule was fixed, and irons with odd numbers were not.
Irons of play cells and of Preisach, which have return-point memory, serve as a comparison. The
gains of the stage are found on the training set-point; there is one noise seed.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from anhyst.support.errors import ReturnPointMemoryWarning
from anhyst.support.jobs import map_ordered
from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.fitting import IdentifiedMagnet, identify_magnet
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.loop import track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.tracking.gains import find_gains
from anhyst_rigs.study.tracking.measures import measure
from rows import Row
from tracking import RIG, with_iron

SEED = 290
COUNTS = {"duhem": 23, "preisach": 6, "cells": 4}


def sample_iron_table(family: str, number: int) -> dict[str, Any]:
    """Return the table of a random iron, with the keys of a rig file."""
    rng = np.random.default_rng([SEED, number, list(COUNTS).index(family)])

    def log_uniform(low: float, high: float) -> float:
        return float(low * (high / low) ** rng.random())

    def uniform(low: float, high: float) -> float:
        return float(low + (high - low) * rng.random())

    width = log_uniform(20.0, 350.0)
    curve = {"saturation_slow_T": uniform(0.45, 0.6), "knee_slow_A_per_m": log_uniform(2000.0, 6000.0)}
    if family == "preisach":
        return {
            "family": family,
            "saturation_T": uniform(1.1, 1.25),
            "pinning_A_per_m": width,
            "pinning_spread": uniform(0.35, 0.65),
            "bias_A_per_m": width * log_uniform(0.5, 0.9),
            "bias_by_pinning": uniform(0.4, 0.9),
            "feedback_A_per_m_T": 0.1 * width,
            "saturation_sharp_T": uniform(0.1, 0.2),
            "knee_sharp_A_per_m": width * log_uniform(3.0, 6.0),
        } | curve
    family_keys = (
        {
            "family": family,
            "coercivity_A_per_m": width,
            "turning_T": log_uniform(0.08, 0.35),
            "fading": uniform(0.2, 0.75),
        }
        if family == "duhem"
        else {
            "cells": 30,
            "pinning_scale_A_per_m": width,
            "reversible_fraction": uniform(0.05, 0.3),
            "pinning_shape": log_uniform(1.0, 3.0),
        }
    )
    sharp = {"saturation_sharp_T": uniform(1.1, 1.4), "knee_sharp_A_per_m": width * log_uniform(1.0, 3.0)}
    return family_keys | sharp | curve


def measure_moving_average(rig: BodyRig, magnet: IdentifiedMagnet, method: MethodName) -> float:
    """Return the moving average of the error with a method, nm; infinite if control is lost."""
    setup, scan = make_stage(rig, magnet, method), rig.settings.scan
    gains = find_gains(setup, scan_motion(scan, scan.train_m_per_s2))
    motion = scan_motion(scan, scan.test_m_per_s2)
    return 1e9 * measure(track(setup, motion, gains, 1), motion, scan.slit_s).average_m


def evaluate_iron(iron: tuple[str, int]) -> tuple[str, bool, float, float, float]:
    """Return the law, whether a warning was given, and the errors of curve, cells and law, nm."""
    rig = with_iron(read_stage(RIG), sample_iron_table(*iron))
    loops = measure_loops(rig)
    cell_magnet = identify_magnet(loops, rig.settings.loops)
    with warnings.catch_warnings(record=True) as warnings_given:
        warnings.simplefilter("always", ReturnPointMemoryWarning)
        selected_law = identify_stage_magnet(rig, loops)
    curve_error, cells_error = (
        measure_moving_average(rig, cell_magnet, name) for name in ("single-valued", "full")
    )
    chosen_error = (
        cells_error
        if selected_law.model.law == cell_magnet.model.law
        else measure_moving_average(rig, selected_law, "full")
    )
    return selected_law.model.law, bool(warnings_given), curve_error, cells_error, chosen_error


def rows() -> list[Row]:
    """Return a row for each iron."""
    irons = [(family, iron_number) for family, count in COUNTS.items() for iron_number in range(count)]
    result_rows = []
    for (family, number), (law, has_warned, curve, cells_error, selected_error) in zip(
        irons, map_ordered(evaluate_iron, irons), strict=True
    ):
        text = f"{law}{', warned' * has_warned}; curve {curve:.3g}, cells {cells_error:.3g}, "
        text += f"selected law {selected_error:.3g} nm"
        is_better = selected_error <= min(curve, cells_error) if math.isfinite(selected_error) else None
        title = f"{family} {number}{' (unseen)' * (number % 2)}: moving average"
        result_rows.append(
            Row(title, "not worse than curve and cells, or warned", text, is_better or has_warned)
        )
    return result_rows
