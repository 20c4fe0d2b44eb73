"""Faults in copies of the fixed-point sources: the C tests must detect every one."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

from .test_c_core import HERE, ROOT, tool

pytestmark = pytest.mark.depends("core", "tests/core")


@dataclass(frozen=True)
class Fault:
    """A replacement of a text in one file of core/, and the test that must detect it."""

    name: str
    file: str
    right: str
    wrong: str
    test: str


FIXED = "include/anhyst/numeric/fixed.h"
FAULTS = [
    Fault(
        "truncated towards zero",
        FIXED,
        "return high * b + ((low * b) >> 16);",
        "return high * b + (low * b) / 65536;",
        "test_fixed_q31",
    ),
    Fault(
        "no saturation at the upper end",
        FIXED,
        "return a > ANHYST_Q31_MAX - b ? ANHYST_Q31_MAX : a + b;",
        "return (int32_t)((uint32_t)a + (uint32_t)b);",
        "test_fixed_q31",
    ),
    Fault(
        "undetected overflow of a shift",
        FIXED,
        "if ((shifted >> n) != a) {",
        "if ((shifted >> n) > a) {",
        "test_fixed_q31",
    ),
    Fault(
        "wrong shift",
        FIXED,
        "return anhyst_sat_q15(((a >> 15) + 1) >> 1);",
        "return anhyst_sat_q15(((a >> 14) + 1) >> 2);",
        "test_fixed_q31",
    ),
    Fault(
        "swapped sign",
        FIXED,
        "return a < ANHYST_Q31_MIN + b ? ANHYST_Q31_MIN : a - b;",
        "return a < ANHYST_Q31_MIN + b ? ANHYST_Q31_MIN : b - a;",
        "test_fixed_q31",
    ),
    Fault(
        "halves rounded downwards",
        FIXED,
        "return anhyst_sat_q15(((int32_t)a * b + 0x4000) >> 15);",
        "return anhyst_sat_q15(((int32_t)a * b + 0x3FFF) >> 15);",
        "test_fixed_q15",
    ),
    Fault(
        "wrapped product of -1 by -1",
        FIXED,
        "return anhyst_sat_q15(((int32_t)a * b + 0x4000) >> 15);",
        "return (int16_t)(((int32_t)a * b + 0x4000) >> 15);",
        "test_fixed_q15",
    ),
    Fault(
        "off by one at a power of two",
        FIXED,
        "if (a < 0x20000000) {",
        "if (a <= 0x20000000) {",
        "test_fixed_q31",
    ),
    Fault(
        "one Newton step of the root missing",
        "src/compensator/compensator.c",
        "  r = (r + (normalised >> 1) / r) >> 1;\n  r = (r + (normalised >> 1) / r) >> 1;\n",
        "  r = (r + (normalised >> 1) / r) >> 1;\n",
        "test_fixed_root",
    ),
    Fault(
        "knee of half the height",
        "src/compensator/compensator.c",
        "if ((a >> (31 - 2 * knee)) == 0) {",
        "if ((a >> (30 - 2 * knee)) == 0) {",
        "test_fixed_root",
    ),
    Fault(
        "an octave of decay counted twice",
        "src/compensator/full_fixed.h",
        "(uint16_t)(t >> 26) & 31U;",
        "(uint16_t)(t >> 25) & 31U;",
        "test_fixed_full",
    ),
    Fault(
        "reversible part too small",
        "src/compensator/generic/full_path.h",
        "return y + times_fraction(anhysteretic - y, reversible);",
        "return y + times_fraction(anhysteretic - y, reversible) / 2;",
        "test_fixed_full",
    ),
    Fault(
        "wrong sign of a negative iron weight",
        "src/compensator/generic/full_search.h",
        "residual + scaled(risen, eq->iron)",
        "residual - scaled(risen, eq->iron)",
        "test_fixed_full",
    ),
    Fault(
        "half of the steepest slope",
        "src/compensator/generic/full_block.h",
        "weighted_slope(sum, flux_arm[i], steepest)",
        "weighted_slope(sum, flux_arm[i], steepest / 2)",
        "test_fixed_full",
    ),
    Fault(
        "no check of the current at the last gap",
        "src/compensator/generic/full_block.h",
        "i <= gaps; i++",
        "i < gaps; i++",
        "test_fixed_full",
    ),
    Fault(
        "an octave too low",
        "src/compensator/simplified_fixed.h",
        "index = (int32_t)((uint32_t)(top - bits + 1U) << n);",
        "index = (int32_t)((uint32_t)(top - bits) << n);",
        "test_fixed_closed",
    ),
    Fault(
        "slope limited to 32",
        "src/compensator/simplified_fixed.h",
        "return slope > MAX_STATE_SLOPE ? MAX_STATE_SLOPE : slope;",
        "return slope > ANHYST_MAX_SLOPE ? ANHYST_MAX_SLOPE : slope;",
        "test_fixed_closed",
    ),
    Fault(
        "a path from the start of the dead band",
        "src/compensator/generic/simplified.h",
        "path.peak_flux = sum(from->peak_flux, band);",
        "path.peak_flux = from->peak_flux;",
        "test_simplified_formats",
    ),
    Fault(
        "no dead band",
        "src/compensator/generic/simplified.h",
        "const number band = weight_to_number(words[ANHYST_WORD_SIMPLE_BAND]);",
        "const number band = 0;",
        "test_simplified_formats",
    ),
    Fault(
        "no limits of a damaged flux",
        "src/compensator/generic/simplified.h",
        "clamp(memory->flux, -ONE, ONE),",
        "memory->flux,",
        "test_simplified_formats",
    ),
    Fault(
        "interpolation of a map without the last digits",
        "src/compensator/lookup.h",
        "return 2 * anhyst_scale(a, high) + (anhyst_scale(a, low) >> 14);",
        "return 2 * anhyst_scale(a, high);",
        "test_fixed_map",
    ),
    Fault(
        "search of the inverse map one step too short",
        "src/compensator/generic/map.h",
        "while (above - position.index > 1U) {",
        "while (above - position.index > 2U) {",
        "test_fixed_map",
    ),
    Fault(
        "a digit of a ratio missing",
        "src/compensator/lookup.h",
        "for (uint16_t digit = 0; digit < 31U; digit++) {",
        "for (uint16_t digit = 0; digit < 30U; digit++) {",
        "test_fixed_map",
    ),
    Fault(
        "no check of a falling map",
        "src/compensator/generic/map.h",
        "rise >= 0 &&",
        "rise >= -100 &&",
        "test_fixed_map",
    ),
    Fault(
        "a loop steeper than its map",
        "src/compensator/generic/play_block.h",
        "if (half_rise > rise || -half_rise > rise) {",
        "if (half_rise > rise) {",
        "test_fixed_play_map",
    ),
    Fault(
        "a checksum of half of each word",
        "src/compensator/checksum.h",
        "bit < 16U",
        "bit < 8U",
        "test_fixed_play_map",
    ),
    Fault(
        "a missing corner of the play",
        "src/compensator/generic/play_map.h",
        "if (span.start->side == -ONE || span.end->side == -ONE) {",
        "if (0) {",
        "test_fixed_play_map",
    ),
    Fault(
        "too few Newton steps",
        "src/compensator/play_map.c",
        "#define MAX_NEWTON_STEPS ANHYST_PLAY_STEPS",
        "#define MAX_NEWTON_STEPS 1",
        "test_fixed_play_map",
    ),
    Fault(
        "an applied current of NaN",
        "src/compensator/generic/play_map_real.h",
        "return a >= -MAX_ENTRY && a <= MAX_ENTRY;",
        "return a > -MAX_ENTRY || a <= MAX_ENTRY;",
        "test_play_map_real",
    ),
    Fault(
        "a reversal with the moving cells subtracted",
        "src/compensator/generic/cells.h",
        "path->resting_m = mirrored(saturate(path->resting_m + active_m), -1);",
        "path->resting_m = mirrored(saturate(path->resting_m - active_m), -1);",
        "test_fixed_cells",
    ),
    Fault(
        "reversal point with the wrong sign",
        "src/compensator/generic/cells.h",
        "path->reversal = locate_field(path, path->rows, mirrored(x, -1));",
        "path->reversal = locate_field(path, path->rows, x);",
        "test_fixed_cells",
    ),
    Fault(
        "wrong sign of a joining cell",
        "src/compensator/generic/cells.h",
        "saturate(path->resting_m - resting_magnetisation(path, position, last_cell));",
        "saturate(path->resting_m + resting_magnetisation(path, position, last_cell));",
        "test_fixed_cells",
    ),
    Fault(
        "the last play not stored",
        "src/compensator/generic/cells_block.h",
        "for (int cell = 1; cell < moving; cell++) {",
        "for (int cell = 1; cell + 1 < moving; cell++) {",
        "test_fixed_cells",
    ),
    Fault(
        "resting cells recorded in the wrong direction",
        "src/compensator/generic/cells.h",
        "path->mirror == 0 ? resting_mask | active_mask : resting_mask",
        "path->mirror != 0 ? resting_mask | active_mask : resting_mask",
        "test_fixed_cells",
    ),
    Fault(
        "wrong sign for cells that start to move again",
        "src/compensator/generic/cells.h",
        "saturate(\n        start_m + row_difference(reversal, path->reversal.segment + row_offset(path, cells - 1)));",
        "saturate(start_m - row_difference(reversal, path->reversal.segment + row_offset(path, cells - 1)));",
        "test_fixed_cells",
    ),
    Fault(
        "wrong sign of a cell from the other direction",
        "src/compensator/generic/cells.h",
        "  return -cell_magnetisation(path, rest_position);",
        "  return cell_magnetisation(path, rest_position);",
        "test_fixed_cells",
    ),
    Fault(
        "wrong sign of a step on a segment",
        "src/compensator/generic/cells.h",
        "unsafe_difference(mirrored(target, mirror), left_side(&eq, trial->of.cells.flux, begin));",
        "unsafe_sum(mirrored(target, mirror), left_side(&eq, trial->of.cells.flux, begin));",
        "test_fixed_cells",
    ),
    Fault(
        "wrong index of wide segments",
        "src/compensator/generic/cells_path.h",
        "row += x > 0 ? path->wide_segments : -path->wide_segments;",
        "row -= path->wide_segments;",
        "test_fixed_cells",
    ),
    Fault(
        "difference of rows without interpolation",
        "src/compensator/cells_fixed.h",
        "return low * 32768 + (high - low) * position.fraction;",
        "return low * 32768;",
        "test_fixed_cells",
    ),
    Fault(
        "second digit of a ratio missing",
        "src/control/allocation.c",
        "return anhyst_add_q31(digit * 65536, second_digit * 4);",
        "return digit * 65536;",
        "test_fixed_allocation",
    ),
    Fault(
        "one step of the root instead of two",
        "src/control/allocation.c",
        "  root = (root >> 1) + (ratio(quarter, root) >> 1);\n",
        "",
        "test_fixed_allocation",
    ),
    Fault(
        "unlimited correction by a flux probe",
        "src/compensator/force_controller.c",
        "anhyst_clamp(c->correction, -c->loop->most, c->loop->most)",
        "c->correction",
        "test_fixed_force_controller",
    ),
    Fault(
        "unlimited integral",
        "src/compensator/force_controller.c",
        "anhyst_clamp(c->integral, -(c->loop->most >> 1), c->loop->most >> 1)",
        "c->integral",
        "test_fixed_force_controller",
    ),
]


BLOCK_SOURCES = ("compensator/block",)
"""Additional sources of a test that includes the tested source."""
OTHER_SOURCES = {
    "test_simplified_formats": tuple(
        f"compensator/{name}" for name in ("simplified", "simplified_f32", "simplified_f64")
    ),
    "test_fixed_allocation": ("control/allocation", "control/allocation_f64"),
    "test_fixed_map": ("compensator/map",),
    "test_fixed_play_map": ("compensator/map", "compensator/play_map"),
    "test_play_map_real": (
        *(f"compensator/map{of}" for of in ("", "_f32", "_f64")),
        *(f"compensator/play_map{of}" for of in ("", "_f32", "_f64")),
    ),
    "test_fixed_force_controller": tuple(
        f"compensator/{name}" for name in ("force_controller", "map", "compensator", "block")
    ),
}
"""Additional sources of the other tests."""


def claims_pass(core: Path, test: str, folder: Path) -> bool:
    """Build one C test with a copy of core/, and return whether its claims are true."""
    program = folder / test
    # No warning flags, because a fault may leave a variable unused.
    command = [tool("cc", "gcc"), "-std=c99", "-O1", "-DTEST_SANITIZED", "-DTEST_STOP_AT_FIRST_FAILURE"]
    command += [f"-I{core / 'include'}", f"-I{core / 'src'}"]
    sources = [str(HERE / f"{test}.c"), str(HERE / "truth.c")]
    sources += [str(core / "src" / f"{name}.c") for name in OTHER_SOURCES.get(test, BLOCK_SOURCES)]
    subprocess.run([*command, *sources, "-lm", "-o", str(program)], check=True)
    completed = subprocess.run([program], capture_output=True, check=False, timeout=600)
    assert completed.returncode in {0, 1}, "the test crashed instead of answering"
    return completed.returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name.replace(" ", "-"))
def test_a_seeded_fault_is_found(tmp_path: Path, fault: Fault) -> None:
    core = tmp_path / "core"
    shutil.copytree(ROOT / "core", core)
    broken = core / fault.file
    text = broken.read_text(encoding="utf-8")
    assert text.count(fault.right) == 1, "the source has changed: adapt the fault"
    broken.write_text(text.replace(fault.right, fault.wrong), encoding="utf-8")
    assert not claims_pass(core, fault.test, tmp_path)
