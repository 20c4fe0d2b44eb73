"""Run the study of a simulated bearing with its page, or test the firmware during levitation."""

from __future__ import annotations

from anhyst.support.atomic import write_json
from anhyst_rigs.reports.bearing import page, subject
from anhyst_rigs.reports.study.task import SimulationTask
from anhyst_rigs.study.bearing.on_board import BoardComparison, run_board
from anhyst_rigs.study.bearing.simulate import Simulation, simulate_bearing


def simulate(task: SimulationTask) -> Simulation:
    """Simulate steps, loads and disturbances of a bearing, with and without compensation."""
    out = task.out if task.writes_files else None
    return task.study(
        lambda: simulate_bearing(task.rig, out, task.controller, task.progress),
        lambda simulation, command: page.render(subject.gather_subject(simulation, command)),
        [task.rig],
    )


def run_firmware(task: SimulationTask, board: str) -> BoardComparison:
    """Run the firmware on a board, and inject faults while the armature levitates."""
    comparison = run_board(task.rig, task.out, board, task.controller, task.progress)
    write_json(task.out, comparison.as_dict())
    return comparison
