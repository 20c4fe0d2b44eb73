"""Errors of force control, in newtons and per cent of the largest force."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from anhyst.compensate.methods import MODELS
from anhyst.rig.force.file import Rig
from anhyst.rig.recording import SignalBound, find_loss, peak, rms
from anhyst.study.engine.verdict import ComparedFigure, judge
from anhyst.study.force.trials import ForceOutcome
from anhyst.support.arrays import FloatArray
from anhyst.support.pays import FORCE

TITLES: Mapping[str, str] = {
    "full": "full",
    "at-rest": "full, iron at rest",
    "simplified": "simplified",
    "single": "best single-valued",
    "ratio": "constant ratio",
    "ratio_over_gap": "ratio for each gap",
}
"""Controllers, the best first, and what tables call them."""
STAGES: Mapping[str, str] = {
    "end": "stroke's end, after the start-up sequence",
    "end_demagnetised": "stroke's end, from demagnetised",
    "positions": "row of positions",
    "moving": "armature moving",
}
"""Groups of trials as tables call them, by their keys in ``figures.json``."""


@dataclass(frozen=True, slots=True)
class Errors:
    """How far a force is from the demand, after the lead-in."""

    # largest and root-mean-square deviation, and mean of its size, N
    worst_N: float  # noqa: N815 - keys of a file carry units
    rms_N: float  # noqa: N815
    mean_N: float  # noqa: N815
    worst_percent: float  # the same over the largest force of the rig
    rms_percent: float
    mean_percent: float

    @classmethod
    def of(cls, deviation: FloatArray, force_max: float) -> Errors:
        """Sum up a deviation, N."""
        found = [peak(deviation), rms(deviation), float(np.abs(deviation).mean())]
        return cls(*found, *(100.0 * value / force_max for value in found))


@dataclass(frozen=True, slots=True)
class Score:
    """One controller in one trial."""

    true: Errors  # of the true force, which only a simulation knows
    read: Errors  # of the force as its sensor reads it: with noise and its delay
    simulated: Errors | None  # of the force that the simulated program expects
    # ticks at which the simulated program gave another current than the firmware
    differing: int | None


def score(outcome: ForceOutcome, force_max: float) -> dict[str, Score]:
    """Score every controller of a trial."""
    demand = outcome.trial.demand
    counts = slice(demand.lead_in, None)

    def errors(force: FloatArray) -> Errors:
        return Errors.of((force - demand.force)[counts], force_max)

    return {
        name: Score(
            true=errors(recording["force_N"]),
            read=errors(recording["force_read_N"]),
            simulated=errors(outcome.simulated[name]) if name in outcome.simulated else None,
            differing=outcome.differing.get(name),
        )
        for name, recording in outcome.recordings.items()
    }


def summary(scores: Sequence[tuple[ForceOutcome, dict[str, Score]]]) -> dict[str, Any]:
    """Worst errors of each stage and start by controller, and against the single-valued curve."""
    groups: dict[str, list[dict[str, Score]]] = {}
    for outcome, found in scores:
        past = "_demagnetised" if outcome.trial.start == "demagnetised" else ""
        groups.setdefault(outcome.trial.stage + past, []).append(found)
    result: dict[str, Any] = {}
    for stage, members in groups.items():
        worst = {name: max(one[name].true.worst_percent for one in members) for name in members[0]}
        result[stage] = {
            name: {
                "worst_percent": worst[name],
                "rms_percent": max(one[name].true.rms_percent for one in members),
                "of_single": worst[name] / worst["single"],
            }
            for name in TITLES
            if name in worst
        }
    return result


def lost_in(outcomes: Sequence[ForceOutcome], force_max: float) -> list[str]:
    """Name every trial in which the force of ``full`` left all proportion, when and how."""
    found = []
    for outcome in outcomes:
        demand, recording = outcome.trial.demand, outcome.recordings["full"]
        off = (recording["force_N"] - demand.force)[demand.lead_in :]
        current = recording["current_A"][demand.lead_in :]
        bounds = (
            SignalBound("the force was off by the largest of the rig", off, -force_max, force_max),
            SignalBound("the current left all bounds", current, -math.inf, math.inf),
        )
        loss = find_loss(bounds, planned=demand.force.size - demand.lead_in)
        if loss is not None:
            found.append(f"{outcome.trial.name} at tick {loss.tick}, {loss.reason}")
    return found


def figures(rig: Rig, outcomes: Sequence[ForceOutcome], board: str) -> dict[str, Any]:
    """Return everything measured, as ``figures.json`` holds it."""
    force_max = rig.settings.force.force_max_N
    scores = [(outcome, score(outcome, force_max)) for outcome in outcomes]
    return {
        "format": "anhyst-force-control",
        "rig": rig.settings.name,
        "board": board,
        "force_max_N": force_max,
        "rate_Hz": rig.settings.timing.rate_Hz,
        "force_noise_N": rig.settings.force_sensor.noise_N,
        "firmware_ticks": sum(o.trial.demand.force.size * len(o.differing) for o in outcomes),
        "ticks_that_differ": sum(sum(o.differing.values()) for o in outcomes),
        "lost_in": lost_in(outcomes, force_max),
        "summary": summary(scores),
        "trials": [
            {
                "stage": outcome.trial.stage,
                "demand": outcome.trial.demand.name,
                "position_m": outcome.trial.position,
                "start": outcome.trial.start,
                "controllers": {
                    name: {k: v for k, v in asdict(one).items() if v is not None}
                    for name, one in found.items()
                },
            }
            for outcome, found in scores
        ],
    }


def judge_stages(summary: Mapping[str, Mapping[str, Mapping[str, float]]]) -> dict[str, Any]:
    """Judge ``full`` by its worst error at every stage, against the strongest baseline there."""
    worst = {
        stage: {name: one["worst_percent"] for name, one in found.items()}
        for stage, found in summary.items()
    }
    against = {
        stage: min((name for name in found if name not in MODELS), key=lambda name: found[name])
        for stage, found in worst.items()
    }
    judged = judge(
        "worst error of full",
        [
            ComparedFigure(stage, TITLES[against[stage]], found["full"], found[against[stage]], 0.0)
            for stage, found in worst.items()
        ],
        "stages",
        FORCE,
    )
    return {"level": judged.level, "text": judged.sentence, "strongest": against}
