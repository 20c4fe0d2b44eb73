"""Measure the path from loops to verified C, and the cost of the compiled compensators."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.block import DemandLimits, TableSizes
from anhyst.compensate.builder import build_block
from anhyst.compensate.circuit import gap_knots
from anhyst.compensate.force_controller import FixedTwin
from anhyst.compensate.plan import CompileRequest, find_limits, find_scales
from anhyst.compensate.simplified import fit_closed_form
from anhyst.compilation.output import Compiled, compile_model
from anhyst.data.reading import read_loops
from anhyst.identification import identify
from anhyst.model.actuator import Model, read_model
from anhyst.model.writer import write_model
from anhyst.support.block_words import Scales
from anhyst.support.numeric import FloatArray
from anhyst.verification import Verification, verify
from anhyst.verification.bundle import read_bundle
from anhyst.verification.compare import BuildFolder
from anhyst.verification.protocol import COMPENSATOR_RECORD, ON_GRID, START, VECTORS, WINDOW_RECORDS, Request
from anhyst.verification.targets import find_cortex_m_builds
from rows import ROOT, Row, Stopwatch

LOOPS = ROOT / "examples" / "electromagnet" / "loops.csv"
SAMPLE_RATE = 20e3
MAX_ERROR_PERCENT = 0.2
"""Largest error due to formats, tables and iterations of the full law, % of F_max."""

CONTROLLED_TICKS = 4800

RAMP_SAMPLES = 2000
"""Number of samples of the slow ramp to the first demand."""

TARGETS = "cortex-m4,cortex-m0plus,avr,msp430"


def _compile_kind(model: Path, folder: Path, kind: str) -> Compiled:
    request = CompileRequest("euler" if kind == "euler" else "simplified", "q15", SAMPLE_RATE)
    if kind in {"full", "cells"}:
        request = CompileRequest("full", "q15", SAMPLE_RATE, MAX_ERROR_PERCENT)
    return compile_model(model, folder / kind, request)


def measure_loops_to_c(folder: Path) -> tuple[Path, list[Row]]:
    """Measure the whole path for the bundled example: loops to verified C on host and Cortex-M4."""
    watch = Stopwatch()
    model = folder / "model.toml"
    write_model(identify(read_loops(LOOPS)).model, model)
    compiled = _compile_kind(model, folder, "full")
    verification = verify(folder / "full", "host,cortex-m4")
    wall_seconds, time_text, seconds = watch.wall, str(watch), watch.processor
    accuracy = compiled.manifest["accuracy"]
    step_count = sum(result.steps for result in verification.results)
    return model, [
        Row(
            "bundled loops to verified C on host and Cortex-M4",
            "<= 60 s wall",
            f"{time_text}; {step_count} steps compared, all identical: {verification.passed}",
            wall_seconds <= 60.0 and verification.passed,
            seconds,
        ),
        Row(
            "'full' against double precision, force error with jumps and lost currents",
            "<= 0.2 % of F_max",
            f"{accuracy['worst_percent']:.3f} %, rms {accuracy['rms_percent']:.3f} %",
            accuracy["worst_percent"] <= 0.2,
        ),
    ]


def _max_cost_text(verification: Verification, target: str, section_name: str) -> str:
    """Return the largest cost of a part of a step, for each build of a target, as text."""
    texts = []
    for result in verification.results:
        cost = result.cost(section_name)
        if result.target == target and cost is not None:
            texts.append(f"{cost.most} {result.unit} ({result.build})")
    return ", ".join(texts) or "not measured"


TICK_TARGETS = {"full": (1800, 2300), "cells": (1200, 1200), "simplified": (500, 800)}
"""Targets, instructions of the worst tick with PIDD2 on a Cortex-M4 with the port header: with
currents rounded to a converter; with any current, limits and lost currents."""

CONTROLLED_TICK_TARGETS = {"full": None, "cells": (700, 150), "simplified": None}
"""Targets for ticks of a force controller with a moving demand, in instructions: tick, and commit.
"""

MEMORY_TARGETS = {"full": 2048, "cells": 4096, "simplified": 2048}
"""Targets for the parameters, in bytes."""


def _make_tick_rows(verification: Verification, kind: str) -> list[Row]:
    """Return the rows of solve, PIDD2 and commit of one tick together, worst case."""
    costs = {
        (result.build, cost.part): cost
        for result in verification.results
        if result.target == "cortex-m4"
        for cost in result.costs
    }
    rows = []
    for section_name, current_kind, target in (
        ("tick, rounded", "on a converter's grid of 12 bits", TICK_TARGETS[kind][0]),
        ("tick", "with limits and lost currents", TICK_TARGETS[kind][1]),
    ):
        ported, portable = (costs[build, section_name] for build in ("port header", "portable"))
        rows.append(
            Row(
                f"'{kind}' with PIDD2 on Cortex-M4 with the port header, worst tick, {current_kind}",
                f"<= {target} instructions",
                f"{ported.most}, mean {ported.mean:.0f}; portable {portable.most}",
                ported.most <= target,
            )
        )
    return rows


def _measure_controlled_ticks(folder: Path, kind: str) -> Row:
    """Measure ticks of a controlled force: 100 Hz, most of the range, noise, moving gap.

    The demand rises from zero within 480 ticks; every current is rounded to a 12-bit converter.
    """
    ticks = np.arange(CONTROLLED_TICKS)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((2, ticks.size))
    demand = 0.35 + 0.25 * np.sin(2.0 * np.pi * 100.0 * ticks / SAMPLE_RATE) + noise[0]
    demand *= np.minimum(ticks / 480.0, 1.0)
    gap = 0.4 + 0.3 * np.sin(2.0 * np.pi * 37.0 * ticks / SAMPLE_RATE) + noise[1]
    codes = np.zeros((ticks.size, len(COMPENSATOR_RECORD.input_positions)), dtype="<u4")
    codes[:, 0], codes[:, 1] = np.round(2**15 * demand), np.round(2**15 * gap)
    codes[:, COMPENSATOR_RECORD.inputs.index("how")] = ON_GRID
    maxima, means = ported_costs(folder, codes)
    texts = [f"{p} {m:.0f} (mean {t:.0f})" for p, m, t in zip(MEASURED_PARTS, maxima, means, strict=True)]
    targets = CONTROLLED_TICK_TARGETS[kind]
    return Row(
        f"'{kind}' with PIDD2 on Cortex-M4 with the port header, worst tick with a controlled force",
        f"<= {targets[0]} instructions, commit <= {targets[1]}" if targets else "reported",
        ", ".join(texts),
        None if targets is None else bool(maxima[2] <= targets[0] and maxima[1] <= targets[1]),
    )


MEASURED_PARTS = ("solve", "commit, rounded", "tick, rounded")
"""Measured parts of a step whose current is rounded to a converter."""


def ported_costs(folder: Path, codes: NDArray[np.uint32]) -> tuple[FloatArray, FloatArray]:
    """Return maximum and mean of `MEASURED_PARTS` on a Cortex-M4 with the port header, instructions."""
    section_indices = [COMPENSATOR_RECORD.sections.index(section_name) for section_name in MEASURED_PARTS]
    maxima, means = np.zeros(3), np.zeros(3)
    with tempfile.TemporaryDirectory(prefix="anhyst-bench-") as build_folder_name:
        workshop = BuildFolder.create(read_bundle(folder), Path(build_folder_name))
        port_build = next(
            build
            for build in (make_build() for make_build in find_cortex_m_builds("cortex-m4", workshop).builds)
            if build.name == "port header"
        )
        requests = [Request(START, seed=1)]
        for first_row in range(0, len(codes), WINDOW_RECORDS):
            rows = codes[first_row : first_row + WINDOW_RECORDS]
            vectors = Request(
                VECTORS, steps=len(rows), rows=rows, input_positions=COMPENSATOR_RECORD.input_positions
            )
            requests.append(vectors)
        replies = port_build.program.run(requests)
    clock = replies[-1].sections[0].minimum
    sections = replies[-1].sections
    for i, (section_name, section_index) in enumerate(zip(MEASURED_PARTS, section_indices, strict=True)):
        clock_overhead = clock * COMPENSATOR_RECORD.clock_calls.get(section_name, 1)
        maxima[i] = sections[section_index].maximum - clock_overhead
        means[i] = sections[section_index].total / sections[section_index].count - clock_overhead
    return maxima, means


def make_cost_rows(models: Mapping[str, Path], folder: Path) -> list[Row]:
    """Return instructions, cycles and memory of each kind, with its model, on all targets."""
    rows = []
    for kind, model in models.items():
        compiled = _compile_kind(model, folder, kind)
        verification = verify(folder / kind, TARGETS)
        rows += [*_make_tick_rows(verification, kind), _measure_controlled_ticks(folder / kind, kind)]
        for target in ("cortex-m0plus", "avr", "msp430"):
            result_text = ", ".join(
                f"{section_name} {_max_cost_text(verification, target, section_name)}"
                for section_name in ("solve", "commit, rounded", "commit, other")
            )
            rows.append(Row(f"'{kind}' on {target}, worst case", "reported", result_text, None))
        estimates = [estimate for estimate in verification.estimates if estimate.part == "solve"]
        result_text = ", ".join(
            f"{estimate.cycles} cycles, {estimate.rate / 1e3:.1f} kHz ({estimate.prices})"
            for estimate in estimates
        )
        rows.append(
            Row(f"'{kind}' on a 60 MHz DSC, solve, estimated (docs/verify.md)", "reported", result_text, None)
        )
        result = next(
            target_result for target_result in verification.results if target_result.target == "cortex-m4"
        )
        tables = compiled.manifest["memory"]["parameters_bytes"]
        rows.append(
            Row(
                f"'{kind}': mutable state, parameters with tables, stack",
                f"<= 128 bytes, <= {MEMORY_TARGETS[kind]} bytes, reported",
                f"{result.state_bytes + result.control_bytes} bytes with PIDD2, {tables} bytes, "
                f"{result.stack_measured} bytes",
                result.state_bytes + result.control_bytes <= 128 and tables <= MEMORY_TARGETS[kind],
            )
        )
    return rows


def compare_closed_form_with_euler(model: Model, model_file: Path, folder: Path) -> list[Row]:
    """Compare the closed form with the paper's Euler steps at the same rate."""
    limits = find_limits(model)
    scales = find_scales(model, limits)
    table_sizes = TableSizes()
    law = fit_closed_form(model, limits, gap_knots(model, scales, table_sizes), table_sizes)
    fine_sizes = replace(table_sizes, octaves=14, octave_segments=5)
    exact_twin = FixedTwin(build_block(model, "simplified", scales, limits, fine_sizes, closed_form=law))
    error_texts = []
    for name, demand in _test_demands(scales, limits).items():
        exact_current = exact_twin.run(demand, scales.gap_high)
        errors_percent = []
        for kind in ("simplified", "euler"):
            current = FixedTwin(build_block(model, kind, scales, limits, table_sizes, closed_form=law)).run(
                demand, scales.gap_high
            )
            deviation = np.abs(current - exact_current)[RAMP_SAMPLES:]
            errors_percent.append(100.0 * float(deviation.max()) / limits.current[1])
            exact_twin = FixedTwin(
                build_block(model, "simplified", scales, limits, fine_sizes, closed_form=law)
            )
        error_texts.append(f"{name}: {errors_percent[0]:.3f} against {errors_percent[1]:.3f} %")
    count_texts = []
    for kind in ("simplified", "euler"):
        if kind == "euler":
            _compile_kind(model_file, folder, kind)
        verification = verify(folder / kind, "cortex-m4")
        count_texts.append(f"{kind} {_max_cost_text(verification, 'cortex-m4', 'solve')}")
    return [
        Row(
            "closed form against one Euler step per sample: worst current error",
            "reported",
            "; ".join(error_texts) + " of I_max",
            None,
        ),
        Row("closed form against Euler: solve on Cortex-M4", "reported", "; ".join(count_texts), None),
    ]


def _test_demands(scales: Scales, limits: DemandLimits) -> dict[str, FloatArray]:
    """Return force demands that can be reached at every gap, N: triangles and full-range jumps.

    They begin with a slow ramp that is not evaluated, because a single Euler step from zero to the
    first demand would cause a permanent error.
    """
    largest_demand = 0.25 * min(scales.demand, limits.demand[1])
    ramp = np.linspace(0.0, 0.05 * largest_demand, RAMP_SAMPLES)
    demands = {}
    for samples in (20, 50, 200):
        wave = 1.0 - np.abs(np.arange(samples) / (samples / 2) - 1.0)
        demands[f"{samples} samples a cycle"] = np.append(
            ramp, largest_demand * np.tile(0.05 + 0.9 * wave, 4)
        )
    demands["full-range jumps"] = np.append(ramp, largest_demand * np.tile([0.05, 0.05, 0.95, 0.95], 20))
    return demands


def rows() -> list[Row]:
    """Return all rows of this module."""
    with tempfile.TemporaryDirectory(prefix="anhyst-bench-") as name:
        folder = Path(name)
        model_file, path_rows = measure_loops_to_c(folder)
        iron_model, cell_model = folder / "iron.toml", folder / "cells.toml"
        loops = read_loops(LOOPS)
        write_model(identify(loops, law="effective-field").model, iron_model)
        write_model(identify(loops, law="play-cells").model, cell_model)
        return [
            *path_rows,
            *make_cost_rows({"full": iron_model, "cells": cell_model, "simplified": iron_model}, folder),
            *compare_closed_form_with_euler(read_model(model_file), model_file, folder),
        ]
