"""Make the table that ``anhyst inspect`` looks up: the benefit map of the example bearing.

Run it again after a change of plant, controller, compensation or identification::

    .venv/bin/python tools/make_benefit_table.py
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from anhyst.atomic import atomic_writer
from anhyst.simulate.benefit import Benefit, Cell, benefit
from anhyst.simulate.benefit_note import TABLE
from anhyst.simulate.controllerfile import read_controller
from anhyst.simulate.rigfile import read_bearing

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "examples" / "bearing"
PLACE = ROOT / "src" / "anhyst" / "simulate" / TABLE


def rows(found: Benefit) -> list[dict[str, Any]]:
    """Return the rows of the table: one a magnet and step height."""
    return [_row(cell) for cell in found.cells]


def _row(cell: Cell) -> dict[str, Any]:
    iron = cell.iron
    overshoot, settling = (
        cell.strongest[name] for name in ("overshoot_percent", "settling_in_noise_s")
    )

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
        "overshoot_percent": means("overshoot_percent", 3),
        "rival": overshoot.rival,
        "outcome": overshoot.outcome,
        "settling_s": means("settling_in_noise_s", 6),
        "settling_rival": settling.rival,
        "settling_outcome": settling.outcome,
    }


def main() -> None:
    """Write the table."""
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
    with atomic_writer(PLACE) as stream:
        for line in (head, *rows(found)):
            stream.write(json.dumps(line) + "\n")


if __name__ == "__main__":
    main()
