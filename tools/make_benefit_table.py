"""Make the table that ``anhyst inspect`` looks up: the benefit map of the example bearing.

The tables of ``docs/benefit.md`` are printed. Run it again after a change of plant, controller,
compensation or identification::

    .venv/bin/python tools/make_benefit_table.py
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from anhyst.control.controller_file import read_controller
from anhyst.rig.bearing.file import read_bearing
from anhyst.study.bearing.benefit import MEASURES, Benefit, Cell, benefit
from anhyst.study.bearing.benefit_note import TABLE
from anhyst.support.atomic import atomic_writer

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "examples" / "bearing"
PLACE = ROOT / "src" / "anhyst" / "study" / "bearing" / TABLE


def rows(found: Benefit) -> list[dict[str, Any]]:
    """Return the rows of the table: one a magnet and step height."""
    return [_row(cell) for cell in found.cells]


def _row(cell: Cell) -> dict[str, Any]:
    iron = cell.iron
    overshoot, settling = (cell.strongest[name] for name in MEASURES)
    flux_overshoot, flux_settling = (cell.flux[name] for name in MEASURES)

    def means(measure: Any, digits: int) -> dict[str, float]:
        return {name: round(one[measure].mean, digits) for name, one in cell.figures.items()}

    return {
        "pinning_scale": iron.scale,
        "reversible_fraction": iron.reversible_fraction,
        "loop_width_percent": round(100.0 * iron.loop_width, 2),
        "after_reversal": None if iron.after_reversal is None else round(iron.after_reversal, 3),
        "after_reversal_true": round(iron.after_reversal_true, 3),
        "iron": iron.label,
        "height_m": cell.height,
        "standstill_nm": {name: round(1e9 * rms, 2) for name, rms in cell.standstill.items()},
        "overshoot_percent": means("overshoot_percent", 3),
        "rival": overshoot.rival,
        "outcome": overshoot.outcome,
        "flux_outcome": flux_overshoot.outcome,
        "settling_s": means("settling_in_noise_s", 6),
        "settling_rival": settling.rival,
        "settling_outcome": settling.outcome,
        "settling_flux_outcome": flux_settling.outcome,
    }


MARKS = {"gain": "+", "loss": "-", "no gain": "=", "nothing to gain": "o"}


def markdown(found: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[str]]:
    """Return the rows of the tables of overshoot and of settling, as the documentation has them."""
    overshoot, settling = [], []
    for _, group in groupby(found, lambda row: (row["pinning_scale"], row["reversible_fraction"])):
        rows = list(group)
        first = rows[0]
        told = first["after_reversal"]
        slope = "-" if told is None else f"{told:.2f}"
        mark = " P" if first["iron"] == "pathological" else ""
        share = f"| {first['reversible_fraction']:.2f}"
        width = f"{first['loop_width_percent']:.1f} %"
        true = f"{slope} ({first['after_reversal_true']:.2f}{mark})"
        overshoot.append(" | ".join([share, width, true, *map(_overshoot, rows)]) + " |")
        settling.append(" | ".join([share, width, *map(_settling, rows)]) + " |")
    return overshoot, settling


def _overshoot(row: Mapping[str, Any]) -> str:
    of = row["overshoot_percent"]
    return (
        f"{of['full']:.2f}, {of['ratio']:.1f}, {of[row['rival']]:.2f} {MARKS[row['outcome']]}, "
        f"{of['flux']:.2f} {MARKS[row['flux_outcome']]}"
    )


def _settling(row: Mapping[str, Any]) -> str:
    of = {name: 1e3 * seconds for name, seconds in row["settling_s"].items()}
    return (
        f"{of['full']:.1f}, {of[row['settling_rival']]:.1f} {MARKS[row['settling_outcome']]}, "
        f"{of['flux']:.1f} {MARKS[row['settling_flux_outcome']]}"
    )


def main() -> None:
    """Write the table, and print those of the documentation."""
    rig = read_bearing(EXAMPLE / "rig.toml")
    controller = read_controller(EXAMPLE / "controller.toml")
    found = benefit(rig, controller)
    head = {
        "made": "tools/make_benefit_table.py",
        "from": "examples/bearing/rig.toml, examples/bearing/controller.toml",
        "noise_seeds": found.seeds,
        "gap_m": found.gap,
        "load_N": found.load,
    }
    made = rows(found)
    with atomic_writer(PLACE) as stream:
        for line in (head, *made):
            stream.write(json.dumps(line) + "\n")
    for table in markdown(made):
        print("\n".join(table), end="\n\n")


if __name__ == "__main__":
    main()
