"""Make the records of the simulated tasks.

The command ``python -m zoo.tasks._make_simulated`` runs in the folder ``benchmarks``. It makes the
tasks that are named after it, or all simulated tasks.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from ._simulate import bouc_wen, magnets, piezo, solid
from ._simulate.drives import System, simulate_records, write_records

FOLDER = Path(__file__).parent
SYSTEMS: dict[str, Callable[[], System]] = {
    "bouc-wen-dynamic": bouc_wen.make_dynamic_system,
    "bouc-wen-slow": bouc_wen.make_slow_system,
    "piezo-creep": piezo.make_system,
    "preisach-magnet": magnets.make_preisach_system,
    "solid-magnet": solid.make_system,
    "tellinen-magnet": magnets.make_tellinen_system,
    "two-iron-magnet": magnets.make_two_iron_system,
}


def main(names: list[str]) -> None:
    """Write ``records.csv`` of the named tasks."""
    for name in names or list(SYSTEMS):
        write_records(FOLDER / name / "records.csv", simulate_records(FOLDER / name, SYSTEMS[name]()))


if __name__ == "__main__":
    main(sys.argv[1:])
