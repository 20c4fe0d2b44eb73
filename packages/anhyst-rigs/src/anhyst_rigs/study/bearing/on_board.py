"""Levitate a bearing with its firmware: the command ``anhyst simulate --board``.

The controller of a rig is compiled and built into the firmware of a board. One run is compared with
the simulation tick by tick. Every fault is injected once.
"""

from __future__ import annotations

import math
import tempfile
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.control.controller_file import ControllerFile
from anhyst.model.writer import write_model
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress, begin_step, split_progress
from anhyst.support.states import State
from anhyst_rigs.link.firmware import build, check_compiler
from anhyst_rigs.link.virtual_boards import find_qemu
from anhyst_rigs.rig.bearing.loop import BearingSetup, make_setups, model_to_compile
from anhyst_rigs.rig.bearing.scenario import plan_recorded_run
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.loop import SimulatedLoop
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.bearing.board_faults import FaultOutcome, FaultRuns, fault_injections
from anhyst_rigs.study.bearing.inputs import check_inputs, read_files

QEMU = "qemu-mps2"
_LIFTED_DISTANCE_M = 5e-6
"""Distance from the rest above which the armature counts as lifted, m."""
_PART_WORK = (2.0, 3.0, 7.0)
"""Relative work of the compilation, the run and the faults, for the progress display."""


@dataclass(frozen=True)
class BoardComparison:
    """A run of a firmware, and its simulation.

    Parameters
    ----------
    rig : BodyRig
    controller : ControllerFile
    board : str
        Board that ran the firmware.
    simulated : Recording
        The run with the simulated controller.
    board_recording : Recording
        The run with the firmware. Gaps, speeds and currents are those of the plant.
    outcomes : tuple of FaultOutcome
        Outcomes of all faults.
    """

    rig: BodyRig
    controller: ControllerFile
    board: str
    simulated: Recording
    board_recording: Recording
    outcomes: tuple[FaultOutcome, ...]

    @property
    def differing_ticks(self) -> int:
        """Number of ticks with a current that differs from the simulation."""
        return count_differences(self.simulated, self.board_recording)

    @property
    def landing_speed(self) -> float:
        """Speed at which the armature reaches the rest at the end, m/s; NaN without a landing."""
        gap, speeds = self.board_recording["gap_m"], np.abs(self.board_recording["velocity_m_per_s"])
        rest_gap = self.rig.settings.body.stop_high_m
        lifted_ticks = np.flatnonzero(gap < rest_gap - _LIFTED_DISTANCE_M)
        if not lifted_ticks.size:
            return math.nan
        rest_ticks = np.flatnonzero(gap[lifted_ticks[-1] :] >= rest_gap)
        return float(speeds[lifted_ticks[-1] + rest_ticks[0] - 1]) if rest_ticks.size else math.nan

    @property
    def has_landed(self) -> bool:
        """Whether the run ends in the state READY without current."""
        has_current = any(self.board_recording[name][-1] for name in _command_columns(self.board_recording))
        return bool(self.board_recording["state"][-1] == State.READY and not has_current)

    def as_dict(self) -> dict[str, Any]:
        """Return all results for JSON; times and speeds that do not apply are null."""
        return {
            "format": "anhyst-firmware-run",
            "rig": self.rig.settings.name,
            "controller": self.controller.settings.name,
            "variant": self.controller.settings.compensation.variant,
            "board": self.board,
            "rate_Hz": self.rig.settings.timing.rate_Hz,
            "ticks": len(self.board_recording),
            "ticks_that_differ": self.differing_ticks,
            "landed": self.has_landed,
            "landing_speed_m_per_s": self.landing_speed,
            "faults": [ending.as_dict() for ending in self.outcomes],
        }

    def raise_if_failed(self) -> None:
        """Raise an error if the firmware differs, did not land, or reported a wrong fault.

        Raises
        ------
        NegativeResult
            The message gives the reason.
        """
        if self.differing_ticks:
            text = "the current of the firmware differs from the simulation at "
            text += f"{self.differing_ticks} of {len(self.board_recording)} ticks"
            raise NegativeResult(text, code="firmware-differs")
        if not self.has_landed:
            text = "the firmware did not land the armature at the end of its run"
            raise NegativeResult(text, code="not-landed")
        unexpected_names = [outcome.injection.name for outcome in self.outcomes if not outcome.is_as_expected]
        if unexpected_names:
            text = f"the firmware reported a wrong reason or none for: {'; '.join(unexpected_names)}"
            raise NegativeResult(text, code="faults-not-noticed")


def count_differences(simulated: Recording, board_recording: Recording) -> int:
    """Return the number of ticks with a current that differs between a run and its simulation."""
    n = min(len(simulated), len(board_recording))
    is_different = [board_recording[name][:n] != simulated[name][:n] for name in _command_columns(simulated)]
    return int(np.count_nonzero(np.any(is_different, axis=0))) + abs(len(simulated) - len(board_recording))


def _command_columns(run: Recording) -> list[str]:
    return [name for name in run.columns if name.startswith("command")]


def run_board(
    rig_path: PathLike,
    out: PathLike,
    board: str,
    controller_path: PathLike | None = None,
    progress: Progress | None = None,
) -> BoardComparison:
    """Compile the controller of a rig, build it into the firmware of a board, and run the firmware."""
    if Path(out).suffix != ".json":
        text = f"{out}: the run of a firmware is written as .json; use this ending"
        raise InputError(text, code="wrong-ending")
    check_compiler(board)
    if board == QEMU:
        find_qemu()
    rig, controller = read_files(rig_path, controller_path)
    inputs = check_inputs(rig, controller, (out,))
    progress_parts = split_progress(progress, _PART_WORK)
    with tempfile.TemporaryDirectory(prefix="anhyst-") as folder:
        setup, firmware = build_firmware(
            inputs.rig, controller, inputs.identify_magnet(), board, Path(folder)
        )
        next(progress_parts)(1, 1)
        *scenarios, _ = plan_recorded_run(setup.rig, setup.controller)
        loop = SimulatedLoop(setup)
        simulated = Recording.concatenate([loop.run(scenario) for scenario in scenarios])
        part_reports = split_progress(next(progress_parts), [1.0] * len(scenarios))
        with closing(BearingBench(setup, firmware, board=board)) as bench:
            board_recording = Recording.concatenate(list(map(bench.run, scenarios, part_reports)))
        with closing(BearingBench(setup, firmware, board=board)) as bench:
            fault_runs, injections, outcomes = FaultRuns(setup, bench), list(fault_injections()), []
            report_fault = next(progress_parts)
            for injection in injections:
                outcomes.append(fault_runs.run(injection))
                report_fault(len(outcomes), len(injections))
    return BoardComparison(inputs.rig, controller, board, simulated, board_recording, tuple(outcomes))


def build_firmware(
    rig: BodyRig, controller: ControllerFile, knowledge: IdentifiedMagnet, board: str, folder: Path
) -> tuple[BearingSetup, Path]:
    """Compile the controller of a rig, and build it into the firmware of a board."""
    begin_step("compile the controller")
    model = folder / "model.toml"
    controller_table = controller.settings
    variant = controller_table.compensation.variant
    if controller.model is None or rig.method_calibration(variant) is not None:
        write_model(model_to_compile(rig, knowledge, variant), model)
    else:
        model = controller.model
    request = CompileRequest(
        "simplified" if variant == "simplified" else "full", "q31", controller_table.rate_Hz
    )
    compiled = compile_model(model, folder / "c", request, controller.path)
    setup = make_setups(rig, controller, knowledge, (variant,))[variant]
    settings = dict(setup.position_control.settings("fixed"))
    if compiled.manifest["controller"]["settings"] != settings:
        raise InputError(
            f"{controller.path}: differs from {rig.path} in the amplifiers or the second magnet; "
            "enter [converter], and [pair] if there is a second magnet",
            code="controller-and-rig-differ",
        )
    begin_step("build the firmware")
    return setup, build(board, folder / "c", folder / "firmware")
