"""Measure force control over the serial link for solenoids with irons of other families.

Winding, poles and instruments are those of ``examples/solenoid``; the irons are those of
``examples/irons``. The loops are measured again for each iron. Only two of the example's test
positions are used, and the loops contain neither of them. ``python benchmarks/solenoids.py NAME``
prints the rows of one iron.
"""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from anhyst.data.reading import read_loops
from anhyst_rigs.study.force_control import force_control
from rows import ROOT, Row, Stopwatch
from virtual import FILE

FOLDER = ROOT / "examples" / "solenoid"
POSITIONS = (1.25e-3, 2.6e-3)

CHOSEN_LAW, PAPER_LAW = "auto", "effective-field"
REST_TARGET, MOVING_TARGET, MAX_ERROR_RATIO = 0.6, 1.5, 0.25
"""Targets: error at rest and in motion, % of F_max, and ratio to the error of the best curve."""

DEMAND_FRACTION = 0.85
"""Largest demand relative to the force that can be reached at every position; at most 40 N."""


def _loops_module() -> ModuleType:
    spec = importlib.util.spec_from_file_location("solenoid_loops", FOLDER / "make_loops.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def write_rig(folder: Path, name: str, law: str) -> Path:
    """Write the example's rig with another iron and its loops; return the path of the rig file."""
    rig_text, solenoid_text = (
        (FOLDER / file).read_text(encoding="utf-8") for file in ("rig.toml", "solenoid.toml")
    )
    iron_table = tomllib.loads(solenoid_text)["iron"]
    iron = tomllib.loads(FILE.read_text(encoding="utf-8"))[name]
    iron |= {key: iron_table[key] for key in ("length_m", "area_m2")}
    lines = "".join(f"{key} = {json.dumps(value)}\n" for key, value in iron.items())
    circuit = solenoid_text[solenoid_text.index("[circuit]") :]
    (folder / "solenoid.toml").write_text(f"[iron]\n{lines}\n{circuit}", encoding="utf-8")
    rig_text = re.sub(r"gaps_m = .*", f"gaps_m = {list(POSITIONS)}", rig_text)
    rig_path = folder / "rig.toml"
    rig_path.write_text(rig_text.replace("[loops]", f'[loops]\nlaw = "{law}"'), encoding="utf-8")
    for file, text in _loops_module().files(rig_path).items():
        (folder / file).write_text(text, encoding="utf-8")
    gaps = read_loops(folder / "loops.csv").by_schedule().values()
    smallest_force = min(max(float(loop.output.max()) for loop in loops) for loops in gaps)
    largest = min(40.0, 5.0 * (DEMAND_FRACTION * smallest_force // 5.0))
    text = rig_path.read_text(encoding="utf-8")
    rig_path.write_text(re.sub(r"force_max_N = [\d.]+", f"force_max_N = {largest}", text), "utf-8")
    return rig_path


def run_test_cases(rig: Path) -> dict[str, Any]:
    """Run all test cases of a rig and return their metrics."""
    with tempfile.TemporaryDirectory() as folder_name:
        return force_control(rig, Path(folder_name) / "run").figures


def errors_by_law_text(summaries: dict[str, dict[str, Any]], stage: str) -> str:
    """Format the errors of each law and of the single-valued curves for a test stage."""
    error_texts = [
        f"{law} {law_summary[stage]['full']['worst_percent']:.2f} %" for law, law_summary in summaries.items()
    ]
    chosen_summary = summaries[CHOSEN_LAW][stage]
    error_texts += [f"{name} {chosen_summary[name]['worst_percent']:.2f} %" for name in ("single", "ratio")]
    return ", ".join(error_texts)


def make_solenoid_rows(solenoid_title: str, summaries: dict[str, dict[str, Any]]) -> list[Row]:
    """Return the rows of one solenoid for each law, at rest and in motion."""
    chosen_summary = summaries[CHOSEN_LAW]
    result_rows = []
    for title, stages, max_error in (
        ("at rest", ("end", "end_demagnetised", "positions"), REST_TARGET),
        ("armature moving", ("moving",), MOVING_TARGET),
    ):
        worst = max(chosen_summary[stage]["full"]["worst_percent"] for stage in stages)
        curve_ratio = max(chosen_summary[stage]["full"]["of_single"] for stage in stages)
        law_text = "; ".join(f"{stage}: {errors_by_law_text(summaries, stage)}" for stage in stages)
        result_rows.append(
            Row(
                f"force control, {solenoid_title}, {title}: worst force error of full",
                f"<= {max_error:g} % of F_max and {MAX_ERROR_RATIO:g} times the best single-valued",
                f"{worst:.2f} %, {curve_ratio:.2f} times; {law_text}",
                worst <= max_error and curve_ratio <= MAX_ERROR_RATIO,
            )
        )
    return result_rows


def measure_iron(name: str) -> list[Row]:
    """Measure one iron with two laws."""
    summaries = {}
    for law in (CHOSEN_LAW, PAPER_LAW):
        with tempfile.TemporaryDirectory() as folder_name:
            summaries[law] = run_test_cases(write_rig(Path(folder_name), name, law))["summary"]
    return make_solenoid_rows(f"iron {name}", summaries)


def measure_bundled() -> list[Row]:
    """Measure the solenoid of the example with two laws, at all its positions."""
    summaries = {}
    for law in (CHOSEN_LAW, PAPER_LAW):
        with tempfile.TemporaryDirectory() as folder_name:
            shutil.copytree(FOLDER, folder_name, dirs_exist_ok=True)
            rig = Path(folder_name) / "rig.toml"
            text = rig.read_text(encoding="utf-8").replace("[loops]", f'[loops]\nlaw = "{law}"')
            rig.write_text(text, encoding="utf-8")
            summaries[law] = run_test_cases(rig)["summary"]
    return make_solenoid_rows("iron of cells", summaries)


def list_iron_names() -> list[str]:
    """Return the names of the irons of other families."""
    return list(tomllib.loads(FILE.read_text(encoding="utf-8")))


def rows() -> list[Row]:
    """Return all rows: the example and six other irons."""
    watch = Stopwatch()
    result_rows = measure_bundled()
    for name in list_iron_names():
        result_rows += measure_iron(name)
    return [
        *result_rows,
        Row("force control, all solenoids: computing time", "minutes", str(watch), None, watch.processor),
    ]


def main(iron_names: Sequence[str]) -> None:
    """Print the rows of the named irons, or of all irons."""
    for name in iron_names or ["cells", *list_iron_names()]:
        for row in measure_bundled() if name == "cells" else measure_iron(name):
            print(f"{row.what}: {row.measured} ({row.reach}; met: {row.met})", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
