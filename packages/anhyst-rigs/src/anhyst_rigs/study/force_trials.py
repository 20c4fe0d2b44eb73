"""Plan and run the trials of force control, and compute their errors.

A trial has one demand, one position of the armature and one initial state of the iron. It runs with
every controller of its group of trials.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from anhyst.compensate.force_controller import Compensator
from anhyst.compensate.methods import MODEL_METHODS
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.bench.force import run_firmware
from anhyst_rigs.rig.force.bench import ActuatorStand, Demand, moving_gap, run_open_loop
from anhyst_rigs.rig.force.file import ForceControlRig
from anhyst_rigs.rig.force.programs import Program, count_differing_ticks
from anhyst_rigs.rig.recording import Recording, SignalBound, find_loss, peak_deviation
from anhyst_rigs.study.engine.beneficial_conditions import BENEFICIAL_CONDITIONS
from anhyst_rigs.study.engine.table import ComparedFigure, Judgement, judge_against_baselines

TrialStage = Literal["end", "positions", "moving"]
InitialState = Literal["unknown", "demagnetised"]


@dataclass(frozen=True)
class ForceTrial:
    """A demand at one position of the armature."""

    # group of trials. ``"end"``: models for the end of the stroke, at this position;
    # ``"positions"``: models for the whole stroke, armature held; ``"moving"``: the same, but it
    # moves
    trial_stage: TrialStage
    demand: Demand  # demanded force
    position: float | None  # gap at which the armature is held, m; None if it moves
    # ``"unknown"``: random history of the iron, and the controller begins with its start-up
    # sequence; ``"demagnetised"``: iron and controller begin demagnetised
    initial_state: InitialState
    number: int  # number of the trial, from which the noise follows

    @property
    def name(self) -> str:
        """Name in files, such as ``positions_1.25mm_wide``."""
        position_text = "" if self.position is None else f"_{1e3 * self.position:.2f}mm"
        history_text = "_demagnetised" if self.initial_state == "demagnetised" else ""
        return f"{self.trial_stage}{position_text}_{self.demand.name}{history_text}"

    def gap(self, rig: ForceControlRig) -> FloatArray:
        """Return the gap at every tick, m."""
        ticks = self.demand.force.size
        if self.position is not None:
            return np.full(ticks, self.position)
        return moving_gap(rig.settings.moving_case, ticks, rig.settings.timing.rate_Hz)


@dataclass(frozen=True)
class Controllers:
    """All controllers of a group of trials."""

    programs: tuple[Program, ...]  # programs of the firmware
    # ``ratio``, the uncompensated case of the paper: one constant ratio, that of the stroke's end;
    # ``ratio_over_gap``: one ratio for each gap; ``single``: the best single-valued curve
    baselines: Mapping[str, Compensator]
    board: str  # board that runs the firmware

    @property
    def conditioning(self) -> list[float]:
        """Reversal points of the start-up sequence, A."""
        return self.programs[0].conditioning_currents


@dataclass(frozen=True)
class ForceOutcome:
    """The result of one trial."""

    trial: ForceTrial  # demand, position and initial state
    # recordings by controller: ``full``, ``at-rest``, ``simplified``, ``ratio``,
    # ``ratio_over_gap``, ``single``
    recordings: Mapping[str, Recording]
    # by program: force that the model predicts for the currents of the firmware, N
    simulated_force: Mapping[str, FloatArray] = field(default_factory=dict)
    # number of ticks, by program, at which the currents of firmware and simulation differ
    differing_ticks: Mapping[str, int] = field(default_factory=dict)


def plan_trials(rig: ForceControlRig, demands: list[Demand]) -> Iterator[ForceTrial]:
    """Yield all trials, in the order of the paper."""
    settings = rig.settings
    trial_number = 0
    for demand in demands:
        initial_states: tuple[InitialState, ...] = ("unknown", "demagnetised")
        for initial_state in initial_states:
            yield ForceTrial("end", demand, settings.force.end_m, initial_state, trial_number)
            trial_number += 1
    for demand in demands:
        for position in settings.held_case.gaps_m:
            yield ForceTrial("positions", demand, position, "unknown", trial_number)
            trial_number += 1
    for demand in demands:
        yield ForceTrial("moving", demand, None, "unknown", trial_number)
        trial_number += 1


def run_trial(rig: ForceControlRig, trial: ForceTrial, controllers: Controllers) -> ForceOutcome:
    """Run a trial with every controller of its group; all have the same noise."""
    gap, seed = trial.gap(rig), [1, trial.number]
    is_demagnetised = trial.initial_state == "demagnetised"
    recordings: dict[str, Recording] = {}
    simulated_force: dict[str, FloatArray] = {}
    differing_ticks: dict[str, int] = {}

    def make_stand() -> ActuatorStand:
        new_stand = ActuatorStand(rig, seed)
        if not is_demagnetised:
            new_stand.apply_random_history(gap[0])
        return new_stand

    for program in controllers.programs:
        recording, session = run_firmware(
            rig, program, make_stand(), gap, trial.demand, controllers.board, is_demagnetised
        )
        recordings[program.name] = recording
        differing_ticks[program.name] = count_differing_ticks(program, session)
        simulated_force[program.name] = _predict_force(program, recording, is_demagnetised)
    gap_reading = rig.make_sensors(seed)["gap"].read(gap)
    for name, baseline in controllers.baselines.items():
        baseline_stand = make_stand()
        if not is_demagnetised:
            baseline_stand.condition_iron(controllers.conditioning, gap[0])
        recordings[name] = run_open_loop(baseline_stand, gap, baseline.run(trial.demand.force, gap_reading))
    return ForceOutcome(trial, recordings, simulated_force, differing_ticks)


def _predict_force(program: Program, recording: Recording, is_demagnetised: bool) -> FloatArray:
    """Return the model's force for the currents of a program, without noise and delay, N."""
    reversals = ",".join(repr(current) for current in [0.0, *program.conditioning_currents])
    history = "demagnetised" if is_demagnetised else f"conditioned:{reversals}"
    model = program.model
    gap = recording["gap_read_m"] if model.needs_schedule else None
    time = recording["t_s"] if model.has_eddy_currents else None
    return model.predict(recording["command_A"], gap, time, history=history).output


CONTROLLER_TITLES: Mapping[str, str] = {
    "full": "full",
    "at-rest": "full, iron at rest",
    "simplified": "simplified",
    "single": "best single-valued",
    "ratio": "constant ratio",
    "ratio_over_gap": "ratio for each gap",
}
"""Titles of the controllers in tables; the best controller is first."""
STAGE_TITLES: Mapping[str, str] = {
    "end": "stroke's end (after the start-up sequence)",
    "end_demagnetised": "stroke's end (from demagnetised)",
    "positions": "row of positions",
    "moving": "armature moving",
}
"""Titles of the groups of trials in tables, by their keys in ``figures.json``."""


def error_figures(deviation: FloatArray, force_max: float) -> dict[str, float]:
    """Return metrics of a force error, in N and in per cent of the rig's largest force."""
    errors = {
        "worst": peak_deviation(deviation),
        "rms": rms(deviation),
        "mean": float(np.abs(deviation).mean()),
    }
    newtons = {f"{name}_N": error for name, error in errors.items()}
    return newtons | {f"{name}_percent": 100.0 * error / force_max for name, error in errors.items()}


def evaluate_outcome(outcome: ForceOutcome, force_max: float) -> dict[str, dict[str, Any]]:
    """Return the error metrics of every controller of a trial, after the lead-in of the demand.

    ``true`` uses the exact force of the simulation, and ``read`` the sensor reading with noise and
    delay. ``simulated`` uses the prediction of the model. ``differing`` is the number of ticks at
    which the firmware had another current than the simulated program.
    """
    demand, scores = outcome.trial.demand, {}
    for name, recording in outcome.recordings.items():
        forces = {"true": recording["force_N"], "read": recording["force_read_N"]}
        if name in outcome.simulated_force:
            forces["simulated"] = outcome.simulated_force[name]
        scores[name] = {
            kind: error_figures((force - demand.force)[demand.lead_in :], force_max)
            for kind, force in forces.items()
        } | ({"differing": outcome.differing_ticks[name]} if name in outcome.differing_ticks else {})
    return scores


def stage_key(trial: Mapping[str, Any]) -> str:
    """Return the group of a trial as a key of :data:`STAGE_TITLES`."""
    return str(trial["stage"]) + ("_demagnetised" if trial["start"] == "demagnetised" else "")


def worst_errors(
    trials: Iterable[Mapping[str, Any]], group: Callable[[Mapping[str, Any]], str]
) -> dict[str, dict[str, dict[str, float]]]:
    """Return the largest error of the true force by group of trials and controller, %."""
    groups: dict[str, dict[str, dict[str, float]]] = {}
    for trial in trials:
        errors = groups.setdefault(group(trial), {})
        for name, forces in trial["controllers"].items():
            trial_errors = {key: forces["true"][key] for key in ("worst_percent", "rms_percent")}
            worst_by_name = errors.get(name, trial_errors)
            errors[name] = {key: max(worst_by_name[key], value) for key, value in trial_errors.items()}
    return groups


def summarise_errors(trials: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the worst errors by group of trials and controller, also relative to ``single``."""
    return {
        stage_name: {
            name: {
                **errors[name],
                "of_single": errors[name]["worst_percent"] / errors["single"]["worst_percent"],
            }
            for name in CONTROLLER_TITLES
            if name in errors
        }
        for stage_name, errors in worst_errors(trials, stage_key).items()
    }


def find_losses(outcomes: Sequence[ForceOutcome], force_max: float) -> list[str]:
    """Return a text with time and reason for every trial in which ``full`` lost control."""
    losses = []
    for outcome in outcomes:
        demand, recording = outcome.trial.demand, outcome.recordings["full"]
        error = (recording["force_N"] - demand.force)[demand.lead_in :]
        current = recording["current_A"][demand.lead_in :]
        bounds = (
            SignalBound("the force error reached the largest force of the rig", error, -force_max, force_max),
            SignalBound("the current became infinite", current, -math.inf, math.inf),
        )
        loss = find_loss(bounds, planned_ticks=demand.force.size - demand.lead_in)
        if loss is not None:
            losses.append(f"{outcome.trial.name} at tick {loss.tick}, {loss.reason}")
    return losses


def make_figures(rig: ForceControlRig, outcomes: Sequence[ForceOutcome], board: str) -> dict[str, Any]:
    """Return the content of ``figures.json``."""
    force_max = rig.settings.force.force_max_N
    trials = [
        {
            "stage": outcome.trial.trial_stage,
            "demand": outcome.trial.demand.name,
            "position_m": outcome.trial.position,
            "start": outcome.trial.initial_state,
            "controllers": evaluate_outcome(outcome, force_max),
        }
        for outcome in outcomes
    ]
    return {
        "format": "anhyst-force-control",
        "rig": rig.settings.name,
        "board": board,
        "force_max_N": force_max,
        "rate_Hz": rig.settings.timing.rate_Hz,
        "force_noise_N": rig.settings.force_sensor.noise_N,
        "firmware_ticks": sum(o.trial.demand.force.size * len(o.differing_ticks) for o in outcomes),
        "ticks_that_differ": sum(sum(o.differing_ticks.values()) for o in outcomes),
        "lost_in": find_losses(outcomes, force_max),
        "summary": summarise_errors(trials),
        "trials": trials,
    }


Summary = Mapping[str, Mapping[str, Mapping[str, float]]]
"""Worst errors by group of trials, controller and metric."""


def strongest_baselines(summary: Summary) -> dict[str, str]:
    """Return, for each group of trials, the controller without model with the smallest worst error."""
    return {
        stage_name: min(
            (name for name in errors if name not in MODEL_METHODS),
            key=lambda name: errors[name]["worst_percent"],
        )
        for stage_name, errors in summary.items()
    }


def judge_stages(summary: Summary) -> Judgement:
    """Compare the worst error of ``full`` in every group of trials with the strongest baseline."""
    compared = [
        ComparedFigure(
            STAGE_TITLES[stage_name],
            CONTROLLER_TITLES[name],
            summary[stage_name]["full"]["worst_percent"],
            summary[stage_name][name]["worst_percent"],
            0.0,
        )
        for stage_name, name in strongest_baselines(summary).items()
    ]
    return judge_against_baselines("worst error of full", compared, "stages", BENEFICIAL_CONDITIONS["force"])


def verdict_dict(summary: Summary) -> dict[str, Any]:
    """Return the verdict as ``figures.json`` contains it."""
    judgements = judge_stages(summary)
    baselines_by_stage = strongest_baselines(summary)
    return {"level": judgements.level, "text": judgements.sentence, "strongest": baselines_by_stage}
