"""Test compensators in floating point under sanitizers, with any signals in any order."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from anhyst.compensate.block import Block, Conditioning, DemandLimits, TableSizes
from anhyst.compilation.parameters import define_parameters
from anhyst.compilation.toolchain import KIND_SOURCES_F32
from anhyst.model.dynamics import Layers
from anhyst.support.atomic import core_folder
from anhyst.support.block_words import Scales, SignalUnits
from tests.actuators import RealSignalFormat, closed_form, magnet, ranges, real_block
from tests.compensate import test_solid
from tests.core.test_c_core import can_sanitize

HERE = Path(__file__).resolve().parent
LAWS = ("full", "simplified", "cells", "solid")
SIZES = TableSizes(gap_segments=2, curve_segments=5, inverse_segments=5, iterations=8)
CREEP = {"full": 2e-6, "simplified": 2e-6, "cells": 2e-5, "solid": 2e-2}
"""Largest drift of the current at rest under noise, relative to its range. Play cells in single
precision stay on the loop of the largest noise within 7e-6, even after 2e7 ticks. The fields of a
solid core settle meanwhile."""


def block_of(law: str, io: RealSignalFormat) -> Block:
    match law:
        case "full" | "simplified":
            form = closed_form("reluctance") if law == "simplified" else None
            return real_block(io, magnet(play=40.0), law, *ranges("reluctance"), SIZES, law=form)
        case _:
            late = test_solid.magnet(Layers(2, 0.2))
            model = late if law == "solid" else late.at_rest
            limits = DemandLimits((0.0, test_solid.TOP), (0.0, 6.0))
            scales = Scales(300.0, 8.0, *test_solid.GAPS)
            return real_block(io, model, "cells", scales, limits, SIZES, Conditioning(1, 100, 2e4))


def header(block: Block, law: str, io: RealSignalFormat) -> str:
    """Return block.h: the block, and the names of its format."""
    of, real = f"_{io}", {"f32": "float", "f64": "double"}[io]
    least = {"f32": "FLT_MIN", "f64": "DBL_MIN"}[io]
    calls = ("init", "solve", "commit", "swap", "output", "demagnetise")
    limit = "parameters[ANHYST_WORD_CURRENT_{}] * parameters[ANHYST_WORD_SCALE_CURRENT]"
    lines = [
        f'#include "anhyst/compensator/compensator{of}.h"',
        f"#define REAL {real}",
        f"#define COMPENSATOR anhyst_compensator{of}",
        *(f"#define {name.upper()} anhyst_compensator_{name}{of}" for name in calls),
        f"#define KERNEL anhyst_kernel_{block.kind}{of}",
        f"#define WORDS {block.words.size}",
        f"#define MOST {least.replace('MIN', 'MAX')}",
        f"#define LEAST {least}",
        f"#define LOW ({limit.format('LOW')})",
        f"#define HIGH ({limit.format('HIGH')})",
        f"#define DEMAND ((REAL){block.limits.demand[1]!r})",
        f"#define GAP_LOW ((REAL){block.scales.gap_low!r})",
        f"#define GAP_HIGH ((REAL){block.scales.gap_high!r})",
        f"#define CREEP ((REAL){CREEP[law]!r})",
    ]
    table = define_parameters("the", "WORDS", block, SignalUnits("N", "A"), None)
    return "\n".join([*lines, "static " + table.replace("the_parameters", "parameters"), ""])


@pytest.mark.slow
@pytest.mark.parametrize("io", ["f32", "f64"])
@pytest.mark.parametrize("law", LAWS)
def test_any_sequence_of_signals_gives_currents_within_limits(
    law: str, io: RealSignalFormat, tmp_path: Path
) -> None:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or not can_sanitize(compiler, tmp_path):
        pytest.skip("a C compiler with sanitizers is not installed")
    block, core = block_of(law, io), core_folder()
    (tmp_path / "block.h").write_text(header(block, law, io), encoding="utf-8")
    sources = [str(core / "src" / name.replace("_f32", f"_{io}")) for name in KIND_SOURCES_F32[block.kind]]
    checks = "address,undefined,float-cast-overflow,float-divide-by-zero"
    options = ["-std=c99", "-O1", "-ffp-contract=off", f"-fsanitize={checks}"]
    options += ["-fno-sanitize-recover=all", f"-DANHYST_MEMORIES={block.memory_count}"]
    include = [f"-I{core}/include", f"-I{tmp_path}"]
    program = tmp_path / "extremes"
    files = [str(HERE / "extremes.c"), *sources]
    subprocess.run([compiler, *options, *include, *files, "-lm", "-o", str(program)], check=True)
    completed = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    assert (completed.returncode, completed.stdout, completed.stderr) == (0, "", "")
