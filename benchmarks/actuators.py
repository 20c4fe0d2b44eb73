"""Measure the models of actuators that are not magnets: piezo stacks and a magnetostrictive rod.

The systems are a real piezo stack in a flexure, the virtual stage of ``examples/piezo`` and the
virtual rod of ``examples/magnetostrictive``. One half of the real record is fitted, and the other
half is inverted. The error of an inverse is the voltage error at the measured displacement, times
the mean slope of the loop (stroke divided by voltage range). Therefore, this error does not depend
on a model.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import nnls

from anhyst.compensate.block import Block
from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.data import Loop, Loops
from anhyst.data.path import History, move_plays
from anhyst.data.reading import read_loops
from anhyst.identification import identify
from anhyst.model.writer import write_model
from anhyst.support.numeric import FloatArray
from anhyst.verification import verify
from anhyst.verification.protocol import COMPENSATOR_RECORD, ON_GRID
from anhyst_rigs.rig.piezo import read_piezo_rig
from anhyst_rigs.study.piezo import make_reference, measure_stage_loops, simulate_tracking
from compiled import ported_costs
from rows import ROOT, Row, measurements

TARGET_M = 0.3e-6
AUTHORS_TEXT = "authors 0.58"
SWITCH_ON_SAMPLES = 100
"""Number of samples at the beginning of the real record in which the amplifier is switched on."""

LEAD_TICKS = 1000

Inverse = Callable[[Loop], FloatArray]


def real_piezo(folder: Path) -> list[Row]:
    """Fit one half of the record of a real stack and invert the other half."""
    loops = read_loops(
        folder / "piezo_flexure" / "model_run.csv",
        columns={"V_in": "u_V", "y_um": "x_um"},
        history="conditioned:0",
    )
    record = loops.loops[0]
    half_count = record.n // 2
    half_ranges = {"first half fitted": (slice(0, half_count), slice(half_count, None)),
            "second half fitted": (slice(half_count, None), slice(SWITCH_ON_SAMPLES, half_count))}  # fmt: skip
    rows = []
    for name, (fitted_range, other_half) in half_ranges.items():
        fitted_half = _record_part(
            record, fitted_range, "conditioned:0" if fitted_range.start == 0 else "conditioned:0,3.6,0"
        )
        inverses = {
            "play cells": _play_cells(loops, fitted_half),
            "best single-valued curve": _single_valued(fitted_half),
            "classic Prandtl-Ishlinskii": _prandtl_ishlinskii(fitted_half),
        }
        slope = np.ptp(fitted_half.output[SWITCH_ON_SAMPLES:]) / np.ptp(fitted_half.input)
        errors = {
            key: slope * float(np.sqrt(np.mean((inverse(record) - record.input)[other_half] ** 2)))
            for key, inverse in inverses.items()
        }
        other_errors = ", ".join(f"{key} {1e6 * error:.2f}" for key, error in list(errors.items())[1:])
        rows.append(
            Row(
                f"piezo in a flexure, {name}, other half inverted: rms voltage error as displacement",
                "<= 0.3 um of 45",
                f"{1e6 * errors['play cells']:.3f} um; {other_errors}, {AUTHORS_TEXT}",
                bool(errors["play cells"] <= TARGET_M),
            )
        )
    return rows


def _record_part(full_record: Loop, sample_range: slice, history: str) -> Loop:
    assert full_record.time is not None
    return Loop("1", full_record.input[sample_range], full_record.output[sample_range], None,
                full_record.time[sample_range], History.parse(history))  # fmt: skip


def _play_cells(loops: Loops, fitted_half: Loop) -> Inverse:
    model = identify(loops.with_loops([fitted_half])).model

    def inverse(full_record: Loop) -> FloatArray:
        return model.invert(full_record.output, None, full_record.time, "conditioned:0").drive

    return inverse


def _single_valued(fitted_half: Loop) -> Inverse:
    curve = np.polynomial.Polynomial.fit(
        fitted_half.output[SWITCH_ON_SAMPLES:], fitted_half.input[SWITCH_ON_SAMPLES:], 7
    )
    return lambda whole: np.asarray(curve(whole.output))


def _prandtl_ishlinskii(fitted_half: Loop) -> Inverse:
    """Return the inverse of weighted play operators in closed form (Prandtl-Ishlinskii)."""
    thresholds = np.concatenate([[0.0], np.linspace(0.05, 0.5, 12) * np.ptp(fitted_half.input)])
    play_outputs = move_plays(fitted_half.input[None], thresholds, np.zeros((1, thresholds.size)))[
        SWITCH_ON_SAMPLES:, 0
    ]
    offset_column = np.ones((play_outputs.shape[0], 1))
    weights, _ = nnls(
        np.hstack([play_outputs, offset_column, -offset_column]),
        fitted_half.output[SWITCH_ON_SAMPLES:] * 1e6,
        maxiter=10000,
    )
    offset, weights = weights[-2] - weights[-1], weights[:-2]
    weight_sums = np.cumsum(weights)
    reversed_loop = np.array([weights[:i] @ (r - thresholds[:i]) for i, r in enumerate(thresholds)])
    inverse_weights = np.concatenate(
        [[1.0 / weights[0]], -weights[1:] / (weight_sums[1:] * weight_sums[:-1])]
    )

    def inverse(full_record: Loop) -> FloatArray:
        demand = 1e6 * full_record.output[None] - offset
        play_inputs = move_plays(demand, reversed_loop, np.zeros((1, reversed_loop.size)))[:, 0]
        return np.asarray(play_inputs @ inverse_weights)

    return inverse


def stage() -> list[Row]:
    """Simulate the virtual stage while it follows a triangle."""
    rig = read_piezo_rig(ROOT / "examples" / "piezo" / "rig.toml")
    tracking_study = simulate_tracking(rig)
    texts = ", ".join(
        f"{name} {1e9 * error['rms_m']:.0f} nm rms, {1e9 * error['worst_m']:.0f} worst"
        for name, error in tracking_study.errors.items()
    )
    return [
        Row(
            "virtual piezo stage, 100 Hz bandwidth, triangle of 30 um at 10 Hz: "
            "ratio of errors with / without compensation",
            "<= 0.2",
            f"{tracking_study.deviation_ratio():.3f}: {texts}",
            tracking_study.deviation_ratio() <= 0.2,
        ),
        *_measure_compiled_inverse(
            rig.settings.timing.rate_Hz, measure_stage_loops(rig), make_reference(rig)
        ),
    ]


def _measure_compiled_inverse(rate: float, loops: Loops, demand: FloatArray) -> list[Row]:
    with tempfile.TemporaryDirectory(prefix="anhyst-bench-") as folder_name:
        model, folder = Path(folder_name) / "model.toml", Path(folder_name) / "c"
        write_model(identify(loops).model, model)
        compiled = compile_model(model, folder, CompileRequest("full", "q15", rate))
        checked = verify(folder, "host,cortex-m4")
        # A ramp leads from the compensator's initial demand at zero field to the start of the
        # triangle.
        assert isinstance(compiled.plan.block, Block)
        initial_demand = compiled.plan.block.table("GAP_OFFSET")[0] / 2**15
        demand_path = demand / compiled.plan.block.scales.demand
        demand_path = np.concatenate([np.linspace(initial_demand, demand_path[0], LEAD_TICKS), demand_path])
        codes = np.zeros((demand_path.size, len(COMPENSATOR_RECORD.input_positions)), dtype="<u4")
        codes[:, 0] = np.round(2**15 * demand_path)
        codes[:, COMPENSATOR_RECORD.inputs.index("how")] = ON_GRID
        max_cost, mean_costs = ported_costs(folder, codes)
    worst_error = compiled.manifest["accuracy"]["worst_percent"]
    return [
        Row(
            "compiled piezo inverse against double precision, with jumps and lost drives",
            "<= 0.1 % of the stroke",
            f"{worst_error:.3f} %; bit for bit on host and Cortex-M4: {checked.passed}",
            worst_error <= 0.1 and checked.passed,
        ),
        Row(
            "compiled piezo inverse on a Cortex-M4 during the triangle: solve and commit, mean tick",
            "<= 600 instructions",
            f"{mean_costs[0] + mean_costs[1]:.0f}: solve {mean_costs[0]:.0f}, commit {mean_costs[1]:.0f}; "
            f"worst at reversals of the triangle {max_cost[0]:.0f} and {max_cost[1]:.0f}",
            bool(mean_costs[0] + mean_costs[1] <= 600),
        ),
    ]


def rod() -> Row:
    """Predict the strain at a withheld prestress."""
    data_folder = ROOT / "examples" / "magnetostrictive"
    model = identify(read_loops(data_folder / "loops.csv")).model
    withheld_loop = read_loops(data_folder / "unseen.csv")
    residuals = np.concatenate([
        model.predict(loop.input, loop.schedule, None, loop.history).output - loop.output
        for loop in withheld_loop.loops
    ])  # fmt: skip
    largest_strain = max(float(loop.output.max()) for loop in withheld_loop.loops)
    mean_error = 100.0 * float(np.mean(np.abs(residuals))) / largest_strain
    return Row(
        "virtual magnetostrictive rod, withheld prestress: mean error",
        "<= 1 % of the largest strain",
        f"{mean_error:.2f} %, worst {100 * float(np.max(np.abs(residuals))) / largest_strain:.2f} %",
        mean_error <= 1.0,
    )


def rows() -> list[Row]:
    """Return all rows about actuators that are not magnets."""
    folder = measurements()
    return [*(real_piezo(folder) if folder else []), *stage(), rod()]
