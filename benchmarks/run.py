"""The table of figures: ``make bench``.

Each line says what must be reached and what was measured, the rival in the same run where there is
one. A timing never decides a test; this table is where timings are looked at.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from pathlib import Path
from types import ModuleType

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # processor times are for one core

import numpy as np
from rich.console import Console
from rich.table import Table

from anhyst.data import LoopSet
from anhyst.identify import identify
from rows import ROOT, Row, measurements


def _demo() -> ModuleType:
    path = ROOT / "examples" / "electromagnet" / "demo.py"
    spec = importlib.util.spec_from_file_location("anhyst_demo", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["anhyst_demo"] = module
    spec.loader.exec_module(module)
    return module


def bundled_example() -> list[Row]:
    """Unseen gaps of the bundled example against the noise-free truth; wall time of identify."""
    demo = _demo()
    here = Path(demo.HERE)
    loops, truth = (LoopSet.from_csv(here / name) for name in ("loops.csv", "unseen_truth.csv"))
    largest = max(float(np.max(loop.output)) for loop in truth.loops)
    plain = demo.unseen_single_valued(truth)
    rows = []
    for gap_map, reach in (("scaling", 0.5), ("reluctance", 0.35)):
        off = demo.unseen_deviation(identify(loops, gap_map=gap_map).model, truth)
        mean = 100.0 * off.mean / largest
        rows.append(
            Row(
                f"bundled example, unseen gaps, '{gap_map}': mean error",
                f"<= {reach:g} % of F_max",
                f"{mean:.3f} %, worst {100 * off.worst / largest:.2f} %; best single-valued curve "
                f"{100 * plain.mean / largest:.2f} %, worst {100 * plain.worst / largest:.2f} %",
                mean <= reach,
            )
        )
    began = time.perf_counter()
    identify(loops)
    spent = time.perf_counter() - began
    rows.append(
        Row("whole identify, 4 gaps, auto: wall time", "<= 5 s", f"{spent:.2f} s", spent <= 5.0)
    )
    return rows


def main() -> None:
    """Measure everything and print the table."""
    import bearing
    import closed_loop
    import compiled
    import force
    import initial_state
    import serial_link
    import speed
    import tuned

    console = Console()
    rows = [*speed.rows(), *bundled_example(), *compiled.rows(), *serial_link.rows()]
    rows += initial_state.rows()
    rows += force.rows()
    rows += bearing.rows()
    rows += closed_loop.rows()
    rows += tuned.rows()
    folder = measurements()
    if folder is None:
        console.print("real measurements are not here: set ANHYST_DATA to their folder")
    else:
        import measured

        rows += measured.rows(folder)
    table = Table(show_lines=True)
    for name in ("what", "reach", "measured", "met"):
        table.add_column(name, overflow="fold")
    for row in rows:
        met = "-" if row.met is None else "yes" if row.met else "NO"
        table.add_row(row.what, row.reach, row.measured, met)
    console.print(table)


if __name__ == "__main__":
    main()
