"""Faults in copies of the position controller: the exact-integer reference must detect every one."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from anhyst._core import FixedForceController
from anhyst.control import PositionControl
from tests.control.levitating import CONTROL, PAIR, REST, SCALES, TARGET, make_drive, table
from tests.control.position_oracle import LOW, Oracle, Sample

from .test_c_core import HERE, ROOT, tool

SOURCES = (
    *("control/position", "control/levitation", "control/supervisor", "control/pidd2"),
    *("compensator/force_controller", "compensator/map"),
    *("compensator/compensator", "compensator/block"),
)
LIMITS = (
    *("position_low", "position_high", "position_step", "max_missing_samples", "hold", "selftest"),
    *("current_low", "current_high", "current_step", "release"),
)
SETTINGS = (*("detect", "rise", "descend", "lift", "set_down", "most", "press"), *("bias", "measured"))
GAP = ("gap_offset", "gap_mantissa", "gap_shift")
FASTER = {"lift_rate": 4e5, "set_down_rate": 6e5, "rise_speed": 0.5, "descend_speed": 0.8}
RUNS = [
    replace(
        control,
        limits=replace(control.limits, step=40e-6, max_missing_samples=2, hold=5, selftest=2),
        levitation=replace(control.levitation, **FASTER),
    )
    for control in (CONTROL, replace(CONTROL, uses_measured_currents=True), PAIR)
]
FAULTS = [
    ("control/levitation.c", "if (l->tick > (int32_t)limits->hold) {", "if (l->tick >= limits->hold) {"),
    (
        "control/supervisor.c",
        "if (s->sample_age > max_missing_samples) {",
        "if (s->sample_age >= max_missing_samples) {",
    ),
    ("control/levitation.c", "= (int32_t)l->supervisor.sample_age + 1;", "= 1;"),
    ("control/levitation.c", "if (l->starts_control == 0U) {", "if (l->starts_control < 2U) {"),
    ("control/levitation.c", "  l->reference = l->position;\n", "  l->reference = l->rest_position;\n"),
    ("control/levitation.c", "l->starts_fall = l->tick == 0 ? 1U : 0U;", "l->starts_fall = 0U;"),
    ("control/position.c", "remainder >= step - remainder ?", "remainder >= step ?"),
    ("control/position.c", "anhyst_shl_q31(anhyst_factor_product(", "(2 + anhyst_factor_product("),
    ("control/position.c", "return a >> 1;", "return a >> 2;"),
    ("control/generic/position.h", "c->limited != 0U ? force : c->candidate.output", "force - 64"),
    ("control/generic/position.h", "(force[0], c->demand);", "(c->settings->bias, c->demand);"),
    ("control/pidd2.c", "anhyst_clamp(anhyst_shl_q31(u, 3),", "anhyst_clamp(8 * (u >> 1 << 1),"),
    ("control/pidd2.c", "anhyst_factor_product(not_applied, gains->back)", "not_applied"),
]


def make_samples(seed: int) -> list[Sample]:
    """Return signals that lead through every state; most of them are plausible."""
    rng = np.random.default_rng(seed)
    gap, rows = REST, []
    for tick in range(3000):
        gap = float(np.clip(gap + rng.normal(0.0, 20e-6), 0.32e-3, 0.58e-3))
        position = round((0.45e-3 - gap) / CONTROL.position_full * 2**31)
        target = round(rng.choice([0.45e-3 - TARGET, 30e-6]) / CONTROL.position_full * 2**31)
        current_codes = [int(code) for code in rng.integers(0, 2**31, 2)]
        rows.append(
            Sample(
                position=None if tick % 9 == 0 or tick % 200 > 180 else position,
                target=target,
                load=int(rng.integers(-(2**28), 2**28)),
                current=(current_codes[0], current_codes[1]),
                command=int(rng.choice([1, 2, 3, 3, 4, 5, 6, 9])) if tick % 13 == 0 else 0,
            )
        )
    return rows


@cache
def reference_answers(run: int) -> NDArray[np.int32]:
    """Return the answers of the exact-integer reference."""
    control = RUNS[run]
    drives = [cast(FixedForceController, make_drive("fixed")) for _ in range(magnet_count(control))]
    gains = cast(NDArray[np.int32], control.gains("fixed"))
    oracle = Oracle(gains, drives, control.settings("fixed"))
    rows = []
    for sample in make_samples(run):
        currents, *other_outputs = oracle.tick(sample)
        rows.append([*currents, *[0] * (2 - len(currents)), *other_outputs])
    return np.array(rows, dtype=np.int32)


def magnet_count(control: PositionControl) -> int:
    return 1 if control.gap_total is None else 2


def settings_as_numbers(control: PositionControl) -> NDArray[np.int32]:
    control_settings = control.settings("fixed")
    names = [*LIMITS, *SETTINGS, *(f"{name}_{i}" for i in (1, 2) for name in GAP)]
    gains = control.gains("fixed").tolist()
    return np.array([int(control_settings.get(name, 0)) for name in names] + gains, dtype=np.int32)


def is_exact(library: Path) -> bool:
    """Whether a build of the core gives the answers of the reference in every run."""
    run_plant: Callable[..., int] = ctypes.CDLL(str(library)).position_run
    table_codes = np.round(table() / SCALES.current * 2.0**15).astype(np.int16)
    for i, control in enumerate(RUNS):
        expected = reference_answers(i)
        rows = [
            (
                *(sample.position is None, sample.position or 0, sample.target, sample.load),
                *(*sample.current, LOW, LOW, sample.command),
            )
            for sample in make_samples(i)
        ]
        found = np.zeros_like(expected)
        input_arrays: list[NDArray[Any]] = [
            settings_as_numbers(control),
            table_codes,
            np.array(rows, dtype=np.int32),
            found,
        ]
        row_start = [input_array.ctypes.data_as(ctypes.c_void_p) for input_array in input_arrays]
        assert (
            run_plant(
                row_start[0], row_start[1], magnet_count(control), len(rows), row_start[2], row_start[3]
            )
            == 0
        )
        if not np.array_equal(found, expected):
            return False
    return True


def build_library(core: Path, folder: Path) -> Path:
    library = folder / "run.so"
    command = [tool("cc", "gcc"), "-std=c99", "-O1", "-shared", "-fPIC", "-w"]
    command += [f"-I{core / 'include'}", f"-I{core / 'src'}", str(HERE / "position_run.c")]
    command += [str(core / "src" / f"{name}.c") for name in SOURCES]
    subprocess.run([*command, "-o", str(library)], check=True)
    return library


def test_the_core_is_exact_without_a_fault(tmp_path: Path) -> None:
    assert is_exact(build_library(ROOT / "core", tmp_path))
    phases = {int(row[4]) for run in range(len(RUNS)) for row in reference_answers(run)}
    assert {phase % 16 for phase in phases} == set(range(7))


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault[0]}: {fault[1].strip()}")
def test_a_seeded_fault_is_found(tmp_path: Path, fault: tuple[str, str, str]) -> None:
    name, correct_code, faulty_code = fault
    core = tmp_path / "core"
    shutil.copytree(ROOT / "core", core)
    text = (core / "src" / name).read_text(encoding="utf-8")
    assert text.count(correct_code) == 1, "the source has changed: adapt the fault"
    (core / "src" / name).write_text(text.replace(correct_code, faulty_code), encoding="utf-8")
    assert not is_exact(build_library(core, tmp_path))
