"""Measure and print the benchmark table: ``make bench``.

Each row states a target and the measured value, with the baseline of the same run if there is one.
Tests do not depend on times; only this table evaluates them. Processor times are also given as
multiples of one step of ``yardstick.c``, so that machines can be compared. The table is written to
``build/`` as ``bench.md`` and ``bench.json``. Arguments select modules of this folder by name.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from types import ModuleType

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # processor times are for one core

import numpy as np
from rich.console import Console
from rich.table import Table

from anhyst.data.reading import read_loops
from anhyst.identification import identify
from machine import Machine, this_machine
from rows import ROOT, Row, Stopwatch, measurements

sys.path.extend(map(str, (ROOT, *(ROOT / "packages").iterdir())))  # for plants in the tests

MODULES = ("speed", "example", "compiled", "serial_link", "initial_state", "force", "bearing",
           "families", "tracking", "calibration", "planar", "balancing", "levitated", "solenoids",
           "levitation", "live", "page", "improve", "closed_loop", "tuned", "measured", "laws",
           "actuators", "fleet")  # fmt: skip
SLOW_MODULES = ("search", "solid", "rate", "meander", "creeping", "sampled_stages", "flux", "flux_control")
"""Modules that take so long that they run only if they are named."""
COLUMNS = ("what", "reach", "measured", "yardsticks", "met")


def _demo() -> ModuleType:
    path = ROOT / "examples" / "demo.py"
    spec = importlib.util.spec_from_file_location("anhyst_demo", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["anhyst_demo"] = module
    spec.loader.exec_module(module)
    return module


def measure_bundled_example() -> list[Row]:
    """Measure errors at withheld gaps of the bundled example against its noise-free truth."""
    demo = _demo()
    example_folder = Path(demo.ELECTROMAGNET)
    loops, truth = (read_loops(example_folder / name) for name in ("loops.csv", "unseen_truth.csv"))
    largest = max(float(np.max(loop.output)) for loop in truth.loops)
    curve_errors = demo.unseen_single_valued(truth)
    rows = []
    for gap_map, target_percent in (("scaling", 0.5), ("reluctance", 0.35)):
        errors = demo.unseen_deviation(identify(loops, gap_map=gap_map).model, truth)
        mean = 100.0 * errors.mean / largest
        rows.append(
            Row(
                f"bundled example, unseen gaps, '{gap_map}': mean error",
                f"<= {target_percent:g} % of F_max",
                f"{mean:.3f} %, worst {100 * errors.worst / largest:.2f} %; best single-valued curve "
                f"{100 * curve_errors.mean / largest:.2f} %, worst {100 * curve_errors.worst / largest:.2f} %",
                mean <= target_percent,
            )
        )
    return [*rows, *measure_identify_time(example_folder / "loops.csv")]


def measure_identify_time(loops: Path) -> list[Row]:
    """Measure the time to identify four gaps, as a call and as the command with all imports."""
    watch = Stopwatch()
    identify(read_loops(loops))
    call = (str(watch), watch.processor)
    with tempfile.TemporaryDirectory(prefix="anhyst-bench-") as folder:
        command = [sys.executable, "-m", "anhyst.cli.app", "identify", str(loops)]
        watch = Stopwatch()
        subprocess.run([*command, "--out", f"{folder}/model.toml"], check=True, capture_output=True)
        command_seconds = (str(watch), watch.processor)
    names = ("identify, 4 gaps, auto", "the same as a command, imports included")
    return [
        Row(name, "<= 3 s of processor time", time_text, seconds <= 3.0, seconds)
        for name, (time_text, seconds) in zip(names, (call, command_seconds), strict=True)
    ]


def rows_of(name: str) -> list[Row]:
    """Measure the rows of one module."""
    if name == "example":
        return measure_bundled_example()
    measure = importlib.import_module(name).rows
    rows: list[Row] = []
    if name != "measured":
        rows = measure()
    elif folder := measurements():
        rows = measure(folder)
    else:
        print("real measurements are not here: set ANHYST_DATA to their folder", file=sys.stderr)
    return rows


def ratio_text(ratio: float) -> str:
    """Format a number that may be large."""
    return f"{ratio:.3g}" if ratio < 1e4 else f"{1e-6 * ratio:.3g} million"


def cells(row: Row, machine: Machine) -> list[str]:
    """Return the cells of a row of the table."""
    ratio = "" if row.seconds is None else ratio_text(row.seconds / machine.yardstick)
    met_text = "-" if row.met is None else "yes" if row.met else "NO"
    return [row.what, row.reach, row.measured, ratio, met_text]


def markdown(rows: Sequence[Row], machine: Machine) -> str:
    """Return the table in Markdown, with the description of the machine above it."""
    lines = [*machine.lines(), ""]
    lines += [f"| {' | '.join(COLUMNS)} |", "| --- " * len(COLUMNS) + "|"]
    lines += [
        f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells(row, machine))} |" for row in rows
    ]
    return "\n".join(lines) + "\n"


def print_table(rows: Sequence[Row], machine: Machine) -> None:
    """Print the table: drawn on a terminal, otherwise as Markdown with unwrapped lines."""
    if not sys.stdout.isatty():
        print(markdown(rows, machine), end="")
        return
    table = Table(show_lines=True)
    for name in COLUMNS:
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*cells(row, machine))
    console = Console()
    for line in machine.lines():
        console.print(line, highlight=False)
    console.print(table)


def main(names: Sequence[str]) -> int:
    """Measure, print and write the table; return the exit code."""
    if unknown := set(names) - {*MODULES, *SLOW_MODULES}:
        print(f"no such lines: {', '.join(sorted(unknown))}; there are {', '.join((*MODULES, *SLOW_MODULES))}",
              file=sys.stderr)  # fmt: skip
        return 2
    machine = this_machine()
    rows: list[Row] = []
    for name in names or MODULES:
        print(f"bench: {name}", file=sys.stderr, flush=True)
        rows += rows_of(name)
    print_table(rows, machine)
    out = ROOT / "build"
    out.mkdir(exist_ok=True)
    (out / "bench.md").write_text(markdown(rows, machine), encoding="utf-8")
    measured_table = {"machine": asdict(machine), "rows": [asdict(row) for row in rows]}
    text = json.dumps(measured_table, indent=2, ensure_ascii=False)
    (out / "bench.json").write_text(text + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
