"""Run open-loop force control, as in section III of the paper, from a rig file to recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from anhyst.compensate.block import Block, Kind
from anhyst.compensate.current_map import fit_ratio, fit_single_valued
from anhyst.compensate.force_controller import Compensator
from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.data.table import check_format, read_columns
from anhyst.model.actuator import Model
from anhyst.model.prediction import describe_fast_drives
from anhyst.model.writer import write_model
from anhyst.support.atomic import PathLike, atomic_folder, write_json
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress, begin_step, map_ordered, split_progress
from anhyst.support.kinds import MethodName
from anhyst.support.result import rows_to_columns
from anhyst.verification.result import Verification
from anhyst_rigs.link.firmware import build, check_compiler
from anhyst_rigs.link.virtual_boards import find_qemu
from anhyst_rigs.rig.distance import PlantCheck
from anhyst_rigs.rig.force.bench import Demand, add_lead_in, triangle_demand
from anhyst_rigs.rig.force.file import ForceControlRig, read_rig
from anhyst_rigs.rig.force.programs import Program, identify_force_model, loops_at_gap, read_rig_loops
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.engine.table import FIGURES_FILE, Judgement, StudyResult
from anhyst_rigs.study.force_trials import (
    Controllers,
    ForceOutcome,
    ForceTrial,
    TrialStage,
    judge_stages,
    make_figures,
    plan_trials,
    run_trial,
    verdict_dict,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MODEL_SCOPES: Mapping[TrialStage, str] = {"end": "end", "positions": "stroke", "moving": "stroke"}
"""Models for each group of trials, by the names of their folders."""
_PREPARATION_WORK = 4.0
"""Work of the models and of the programs, in units of the work of one trial."""
MAX_DEMAND_S = 120.0
"""Longest duration of a demand that is read from a file, s."""


@dataclass(frozen=True, repr=False)
class ForceControl(StudyResult):
    """The result of force control.

    Parameters
    ----------
    rig : Rig
        The completed rig.
    out : Path
        Folder of all results: ``figures.json``, a recording of each trial, and models and controllers
        in ``end/`` and ``stroke/``; :func:`anhyst_rigs.reports.force.draw` adds pictures.
    figures : dict
        Content of ``figures.json``.
    outcomes : tuple of ForceOutcome
        Recordings of all trials.
    plant : PlantCheck
        Comparison of the actuator with the measured loops.
    verified : Verification, optional
        Verification of the compiled C, if the rig was made from loops.
    speed_notes : tuple of str
        A warning if the currents changed faster than the loops of the model allow.
    """

    kind: ClassVar = "force"
    rig: ForceControlRig
    out: Path
    figures: dict[str, Any]
    outcomes: tuple[ForceOutcome, ...]
    plant: PlantCheck
    verified: Verification | None = None
    speed_notes: tuple[str, ...] = ()

    @property
    def compiled(self) -> Path:
        """Folder with the C of the model for the whole stroke."""
        return self.out / "stroke" / "full" / "controller"

    @property
    def lost_in(self) -> list[str]:
        """All trials that lost control of the force."""
        lost_trials: list[str] = self.figures["lost_in"]
        return lost_trials

    def refuse_losses(self) -> None:
        """Raise NegativeResult if control was lost or the firmware differs from its simulation."""
        if self.lost_in:
            raise NegativeResult(
                f"the force was lost: {'; '.join(self.lost_in)}; all files are saved", code="force-lost"
            )
        if differing_ticks := self.figures["ticks_that_differ"]:
            raise NegativeResult(
                f"the current of the firmware differs from the simulated program at {differing_ticks} ticks",
                code="firmware-differs",
            )

    @property
    def verdict(self) -> Judgement:
        """Whether compensation is beneficial, judged by the worst error in each group of trials."""
        if self.lost_in:
            return Judgement("unknown", f"the force was lost: {'; '.join(self.lost_in)}")
        return judge_stages(self.figures["summary"])

    def facts(self) -> dict[str, str]:
        """Return the folder, and the mean force error of each controller over all trials."""
        facts = {"folder": str(self.out), "trials": str(len(self.outcomes))}
        errors = self._errors()
        for name in dict.fromkeys(error_row["controller"] for error_row in errors):
            mean_error_N = np.mean([row["error_rms_N"] for row in errors if row["controller"] == name])
            facts[name] = f"force error {mean_error_N:.3g} N rms"
        return facts | self.losses_fact()

    def _errors(self) -> list[dict[str, Any]]:
        return [
            {
                "trial": trial_number,
                "stage": outcome.trial.trial_stage,
                "controller": name,
                "error_rms_N": figures["true"]["rms_N"],
                "error_worst_N": figures["true"]["worst_N"],
            }
            for trial_number, (outcome, trial) in enumerate(
                zip(self.outcomes, self.figures["trials"], strict=True)
            )
            for name, figures in trial["controllers"].items()
        ]

    def to_columns(self) -> dict[str, Any]:
        """Return the force error of each controller in each trial, N."""
        return rows_to_columns(self._errors())

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``figures.json``, and the verification."""
        verified = {"verified": self.verified.as_dict()} if self.verified else {}
        return self.figures | verified

    def draw(self, ax: Axes) -> None:
        """Draw the demand, and the force of every controller, in the first trial."""
        outcome = self.outcomes[0]
        ax.plot(outcome.trial.demand.force, color="0.15", lw=0.8, ls="--", label="demand")
        for name, run in outcome.recordings.items():
            ax.plot(run["force_N"], lw=0.9, label=name)
        ax.set_xlabel("tick")
        ax.set_ylabel("force [N]")


def force_control(
    rig: PathLike,
    out: PathLike,
    *,
    board: str = "library",
    demand: PathLike | None = None,
    recordings: str = "csv",
    progress: Progress | None = None,
) -> ForceControl:
    """Identify, compile and build the controllers, then run every trial: `anhyst.force_control`."""
    rig_from_file = read_rig(rig)
    demands = _collect_demands(rig_from_file, demand)
    check_format(Path(out) / f"recording.{recordings}")
    check_compiler(board)  # Report a missing tool before the computation.
    if board == "qemu-mps2":
        find_qemu()
    trials = list(plan_trials(rig_from_file, demands))
    progress_parts = split_progress(progress, [_PREPARATION_WORK, _PREPARATION_WORK, len(trials)])
    loops = read_rig_loops(rig_from_file)
    end_loops = loops_at_gap(loops, rig_from_file.settings.force.end_m)
    force_max = rig_from_file.settings.force.force_max_N
    current_per_force = fit_ratio(end_loops, force_max)
    baselines: dict[str, dict[str, Compensator]] = {
        "end": {"ratio": current_per_force, "single": fit_single_valued(end_loops, force_max)},
        "stroke": {
            "ratio": current_per_force,
            "ratio_over_gap": fit_ratio(loops, force_max),
            "single": fit_single_valued(loops, force_max),
        },
    }
    with atomic_folder(out) as folder:
        fitted_rig = complete_rig(rig_from_file, loops)
        found_models = map_ordered(
            partial(identify_force_model, fitted_rig), [end_loops, loops], next(progress_parts)
        )
        models = dict(zip(baselines, found_models, strict=True))
        programs = _build_programs(fitted_rig, models, board, folder, next(progress_parts))
        controllers = {
            scope: Controllers(programs[scope], results, board) for scope, results in baselines.items()
        }
        tasks = [(fitted_rig, trial, controllers[MODEL_SCOPES[trial.trial_stage]]) for trial in trials]
        outcomes = map_ordered(_run_trial, tasks, next(progress_parts))
        plant = fitted_rig.check_plant(loops, models["stroke"])
        results = make_figures(fitted_rig, outcomes, board) | {"plant": plant.as_dict()}
        results["verdict"] = None if results["lost_in"] else verdict_dict(results["summary"])
        for outcome in outcomes:
            _write_trial(fitted_rig, folder / f"{outcome.trial.name}.{recordings}", outcome)
        write_json(folder / FIGURES_FILE, results)
    runs = [run for outcome in outcomes for run in outcome.recordings["full"].current_runs]
    notes = describe_fast_drives(models["stroke"], runs)
    return ForceControl(fitted_rig, Path(out), results, tuple(outcomes), plant, speed_notes=notes)


def _compiled_methods(model: Model) -> tuple[MethodName, ...]:
    """Return the methods that are compiled; with eddy currents, this includes a model without them."""
    return ("full", "at-rest", "simplified") if model.has_eddy_currents else ("full", "simplified")


def build_program(name: MethodName, model: Model, rate: float, board: str, folder: Path) -> Program:
    """Compile a model, and build a firmware with it."""
    begin_step("compile the controller")
    kind: Kind = "simplified" if name == "simplified" else "full"
    model = model if name == "full" else model.at_rest
    folder.mkdir(parents=True, exist_ok=True)
    write_model(model, folder / "model.toml")
    compiled = compile_model(folder / "model.toml", folder / "controller", CompileRequest(kind, "q31", rate))
    block = compiled.plan.block
    assert isinstance(block, Block)
    begin_step("build the firmware")
    return Program(
        kind=kind,
        name=name,
        model=model,
        block=block,
        cycles=compiled.plan.builder.conditioning.cycles,
        firmware=build(board, folder / "controller", folder / "firmware"),
    )


def _build_program(task: tuple[MethodName, Model, float, str, Path]) -> Program:
    return build_program(*task)


def _run_trial(task: tuple[ForceControlRig, ForceTrial, Controllers]) -> ForceOutcome:
    return run_trial(*task)


def _build_programs(
    rig: ForceControlRig, models: Mapping[str, Model], board: str, folder: Path, progress: Progress
) -> dict[str, tuple[Program, ...]]:
    rate = rig.settings.timing.rate_Hz
    tasks = [
        (name, model, rate, board, folder / scope / name)
        for scope, model in models.items()
        for name in _compiled_methods(model)
    ]
    programs = iter(map_ordered(_build_program, tasks, progress))
    return {scope: tuple(next(programs) for _ in _compiled_methods(model)) for scope, model in models.items()}


def _collect_demands(rig: ForceControlRig, path: PathLike | None) -> list[Demand]:
    force_max, rate = rig.settings.force.force_max_N, rig.settings.timing.rate_Hz
    demands = [triangle_demand(shape, force_max, rate) for shape in rig.settings.force_triangles]
    if path is not None:
        demands.append(_read_demand(rig, path))
    names = [demand.name for demand in demands]
    if len(set(names)) < len(names):
        raise InputError(
            f"{rig.path}: case.name: two demands have the same name", code="name-twice", key="case.name"
        )
    return demands


def _read_demand(rig: ForceControlRig, path: PathLike) -> Demand:
    """Read a demand from a file, and sample it at the ticks of the controller."""
    table = read_columns(path)
    time, force = table.require("time", "t_s"), table.require("force", "F_N")
    force_max_N = rig.settings.force.force_max_N
    if force.min() < 0.0 or force.max() > force_max_N:
        row_index = int(np.argmax((force < 0.0) | (force > force_max_N)))
        raise InputError(
            f"{path}: sample {row_index}: {force[row_index]:g} N is outside 0 to {force_max_N:g} N "
            f"(force_max_N of {rig.path}); lower the demand",
            code="out-of-range",
        )
    if not 0.0 < time[-1] - time[0] <= MAX_DEMAND_S:
        raise InputError(
            f"{path}: lasts {time[-1] - time[0]:g} s; enter a demand of at most {MAX_DEMAND_S:g} s",
            code="too-long",
        )
    ticks = np.arange(round((time[-1] - time[0]) * rig.settings.timing.rate_Hz) + 1)
    sampled_force = np.interp(time[0] + ticks * rig.dt, time, force)
    return add_lead_in("file", sampled_force, rig.settings.timing.rate_Hz)


def _write_trial(rig: ForceControlRig, path: Path, outcome: ForceOutcome) -> None:
    demand = outcome.trial.demand
    time = (np.arange(demand.force.size) - demand.lead_in) * rig.dt
    columns = {
        "t_s": np.round(time, 6),
        "F_demand_N": np.round(demand.force, 6),
        "gap_m": np.round(next(iter(outcome.recordings.values()))["gap_m"], 9),
    }
    for name, recording in outcome.recordings.items():
        columns[f"F_{name}_N"] = np.round(recording["force_N"], 5)
        columns[f"F_{name}_read_N"] = np.round(recording["force_read_N"], 5)
        columns[f"I_{name}_A"] = np.round(recording["current_A"], 7)
        if name in outcome.simulated_force:
            columns[f"F_{name}_simulated_N"] = np.round(outcome.simulated_force[name], 5)
    Recording(columns).save(path)
