"""Open-loop force control of the bundled solenoid, firmware in the loop: errors and wall time."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

from anhyst.rig.force_control import force_control
from rows import ROOT, Row

FOLDER = ROOT / "examples" / "solenoid"


def _run(rig: Path) -> tuple[dict[str, Any], float]:
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as place:
        figures = force_control(rig, Path(place) / "run").figures
    return figures, time.perf_counter() - began


def _told(stage: dict[str, Any]) -> str:
    parts = [f"{name} {one['worst_percent']:.2f} %" for name, one in stage.items()]
    return ", ".join(parts)


def rows() -> list[Row]:
    """Worst errors over the positions, with the armature moving, and of the first version."""
    figures, spent = _run(FOLDER / "rig.toml")
    summary = figures["summary"]
    held = summary["positions"]
    full, simplified = held["full"], held["simplified"]
    drawn = _run(FOLDER / "drawn" / "rig.toml")[0]["summary"]
    differing, ticks = figures["ticks_that_differ"], figures["firmware_ticks"]
    return [
        Row(
            "force control, row of positions: worst error, full",
            "<= 1.5 % of F_max and a third of the single-valued",
            f"{full['worst_percent']:.2f} %, {full['of_single']:.2f} of it",
            full["worst_percent"] <= 1.5 and 3.0 * full["of_single"] <= 1.0,
        ),
        Row(
            "the same, simplified",
            "two thirds of the single-valued",
            f"{simplified['worst_percent']:.2f} %, {simplified['of_single']:.2f} of it; all: "
            f"{_told(held)}",
            3.0 * simplified["of_single"] <= 2.0,
        ),
        Row("the same, armature moving", "", _told(summary["moving"]), None),
        Row(
            "the same, first version of the solenoid (steel as drawn)",
            "",
            _told(drawn["positions"]),
            None,
        ),
        Row(
            "firmware over the link against the simulated program",
            "no tick differs",
            f"{differing} of {ticks} differ",
            differing == 0,
        ),
        Row("whole force-control: wall time", "<= 60 s", f"{spent:.0f} s", spent <= 60.0),
    ]
