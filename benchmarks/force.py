"""Measure open-loop force control of the bundled solenoid with the firmware in the loop."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from anhyst_rigs.study.force_control import force_control
from rows import ROOT, Row, Stopwatch

FOLDER = ROOT / "examples" / "solenoid"


def _run_bundled_solenoid(rig: Path) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder_name:
        return force_control(rig, Path(folder_name) / "run").figures


def _format_errors(stage_errors: dict[str, Any]) -> str:
    error_texts = [f"{name} {errors['worst_percent']:.2f} %" for name, errors in stage_errors.items()]
    return ", ".join(error_texts)


def rows() -> list[Row]:
    """Return the worst errors at rest, in motion and with the first solenoid, and the time."""
    watch = Stopwatch()
    run_metrics = _run_bundled_solenoid(FOLDER / "rig.toml")
    wall_seconds, time_text, seconds = watch.wall, str(watch), watch.processor
    error_summary = run_metrics["summary"]
    errors_at_rest = error_summary["positions"]
    full_at_rest, simplified_at_rest, full_in_motion = (
        errors_at_rest["full"],
        errors_at_rest["simplified"],
        error_summary["moving"]["full"],
    )
    first_version = _run_bundled_solenoid(FOLDER / "drawn" / "rig.toml")["summary"]
    differing_count, ticks = run_metrics["ticks_that_differ"], run_metrics["firmware_ticks"]
    return [
        Row(
            "force control, fixed positions: worst error, full",
            "<= 0.6 % of F_max and 1/4 of single-valued",
            f"{full_at_rest['worst_percent']:.2f} %, {full_at_rest['of_single']:.2f} of single-valued",
            full_at_rest["worst_percent"] <= 0.6 and 4.0 * full_at_rest["of_single"] <= 1.0,
        ),
        Row(
            "force control, fixed positions: worst error, simplified",
            "<= 2/3 of single-valued",
            f"{simplified_at_rest['worst_percent']:.2f} %, {simplified_at_rest['of_single']:.2f} of single-valued; "
            f"all: {_format_errors(errors_at_rest)}",
            3.0 * simplified_at_rest["of_single"] <= 2.0,
        ),
        Row(
            "force control, moving armature: worst errors",
            "full: <= 1.5 % and 1/4 of single-valued",
            _format_errors(error_summary["moving"]),
            full_in_motion["worst_percent"] <= 1.5 and 4.0 * full_in_motion["of_single"] <= 1.0,
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
            f"{differing_count} of {ticks} differ",
            differing_count == 0,
        ),
        Row("computing time of force-control", "<= 60 s wall", time_text, wall_seconds <= 60.0, seconds),
    ]
