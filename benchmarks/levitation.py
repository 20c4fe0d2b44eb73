"""Run the bearing's firmware in an emulated Cortex-M3, compare with simulation, inject faults."""

from __future__ import annotations

import tempfile
from pathlib import Path

from anhyst.support.errors import InputError
from anhyst_rigs.study.bearing.on_board import QEMU, run_board
from rows import ROOT, Row, Stopwatch

RIG = ROOT / "examples" / "bearing" / "rig.toml"
MAX_LANDING_SPEED = 5e-3
"""Largest touch-down speed that counts as a landing, m/s."""


def rows() -> list[Row]:
    """Run from lift-off to landing, then inject each fault while the armature is levitated."""
    watch = Stopwatch()
    with tempfile.TemporaryDirectory() as folder_name:
        try:
            board_run = run_board(RIG, Path(folder_name) / "run.json", QEMU)
        except InputError as error:
            return [Row("firmware of the bearing in QEMU", "", str(error), None)]
    released = [
        outcome
        for outcome in board_run.outcomes
        if not outcome.is_levitating and outcome.rest_speed > MAX_LANDING_SPEED
    ]
    fastest_released = 1e3 * max(outcome.rest_speed for outcome in released)
    landed = [
        outcome
        for outcome in board_run.outcomes
        if not outcome.is_levitating and outcome.rest_speed <= MAX_LANDING_SPEED
    ]
    return [
        Row(
            "firmware of the bearing in QEMU against the simulation, lift-off to landing",
            "no tick differs",
            f"{board_run.differing_ticks} of {len(board_run.board_recording)} differ, landing at "
            f"{1e3 * board_run.landing_speed:.1f} mm/s",
            board_run.differing_ticks == 0 and board_run.has_landed,
            watch.processor,
        ),
        Row(
            "faults during levitation",
            "detected, no contact with the magnet",
            f"{len(landed)} of {len(board_run.outcomes)} landed with at most "
            f"{1e3 * max(outcome.rest_speed for outcome in landed):.1f} mm/s, {len(released)} released, with "
            f"at most {fastest_released:.0f} mm/s",
            all(outcome.is_as_expected and outcome.magnet_speed == 0.0 for outcome in board_run.outcomes),
        ),
    ]
