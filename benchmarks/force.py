"""Measure open-loop force control of the bundled solenoid with the firmware in the loop."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from anhyst_rigs.study.force_control import force_control
from rows import ROOT, Row, Stopwatch

FOLDER = ROOT / "examples" / "solenoid"


def _run(rig: Path) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as place:
        return force_control(rig, Path(place) / "run").figures


def _format_errors(stage: dict[str, Any]) -> str:
    parts = [f"{name} {errors['worst_percent']:.2f} %" for name, errors in stage.items()]
    return ", ".join(parts)


def rows() -> list[Row]:
    """Return the worst errors at rest, in motion and with the first solenoid, and the time."""
    watch = Stopwatch()
    figures = _run(FOLDER / "rig.toml")
    wall_seconds, time_text, seconds = watch.wall, str(watch), watch.processor
    summary = figures["summary"]
    errors_at_rest = summary["positions"]
    full, simplified, moving = errors_at_rest["full"], errors_at_rest["simplified"], summary["moving"]["full"]
    first_version = _run(FOLDER / "drawn" / "rig.toml")["summary"]
    differing, ticks = figures["ticks_that_differ"], figures["firmware_ticks"]
    return [
        Row(
            "force control, fixed positions: worst error, full",
            "<= 0.6 % of F_max and 1/4 of single-valued",
            f"{full['worst_percent']:.2f} %, {full['of_single']:.2f} of single-valued",
            full["worst_percent"] <= 0.6 and 4.0 * full["of_single"] <= 1.0,
        ),
        Row(
            "force control, fixed positions: worst error, simplified",
            "<= 2/3 of single-valued",
            f"{simplified['worst_percent']:.2f} %, {simplified['of_single']:.2f} of single-valued; "
            f"all: {_format_errors(errors_at_rest)}",
            3.0 * simplified["of_single"] <= 2.0,
        ),
        Row(
            "force control, moving armature: worst errors",
            "full: <= 1.5 % and 1/4 of single-valued",
            _format_errors(summary["moving"]),
            moving["worst_percent"] <= 1.5 and 4.0 * moving["of_single"] <= 1.0,
        ),
        Row(
            "force control, first version of the solenoid (cold-drawn steel)",
            "",
            _format_errors(first_version["positions"]),
            None,
        ),
        Row(
            "firmware over the link against the simulated program",
            "no tick differs",
            f"{differing} of {ticks} differ",
            differing == 0,
        ),
        Row("computing time of force-control", "<= 60 s wall", time_text, wall_seconds <= 60.0, seconds),
    ]
