"""Trials of force control: which there are, and how one runs under every controller."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from anhyst.compensate.interface import Compensator
from anhyst.rig.force.bench import ActuatorBench, read_gaps, run_open_loop
from anhyst.rig.force.file import Rig
from anhyst.rig.force.programs import Program, ticks_that_differ
from anhyst.rig.force.session import Demand, moving_gap, run_firmware
from anhyst.rig.recording import Recording
from anhyst.support.arrays import FloatArray

Stage = Literal["end", "positions", "moving"]
Start = Literal["unknown", "demagnetised"]


@dataclass(frozen=True)
class ForceTrial:
    """One demand at one place."""

    # ``"end"``: models of the stroke's end, there; ``"positions"``: models of the whole stroke, the
    # armature held; ``"moving"``: the same, the armature moving
    stage: Stage
    demand: Demand  # what is wanted
    position: float | None  # of the armature, m; None where it moves
    # ``"unknown"``: the iron has any past, and the controller begins with its start-up sequence;
    # ``"demagnetised"``: iron and controller begin there
    start: Start
    number: int  # of all trials; decides the noise

    @property
    def name(self) -> str:
        """For files: ``positions_1.25mm_wide``."""
        place = "" if self.position is None else f"_{1e3 * self.position:.2f}mm"
        past = "_demagnetised" if self.start == "demagnetised" else ""
        return f"{self.stage}{place}_{self.demand.name}{past}"

    def gap(self, rig: Rig) -> FloatArray:
        """Return where the armature is at every tick, m."""
        ticks = self.demand.force.size
        if self.position is not None:
            return np.full(ticks, self.position)
        return moving_gap(rig.settings.moving, ticks, rig.settings.timing.rate_Hz)


@dataclass(frozen=True)
class Controllers:
    """All controllers of one stage."""

    programs: tuple[Program, ...]  # firmwares
    # ``ratio``, the paper's uncompensated case: one ratio, of the stroke's end; ``ratio_over_gap``,
    # the same with a ratio for every gap; ``single``, the best curve without memory
    baselines: Mapping[str, Compensator]
    board: str  # where the firmwares run

    @property
    def conditioning(self) -> list[float]:
        """Turning points of the start-up sequence, A."""
        return self.programs[0].conditioning


@dataclass(frozen=True)
class ForceOutcome:
    """What one trial gave."""

    trial: ForceTrial  # which
    # by controller: ``full``, ``at-rest``, ``simplified``, ``ratio``, ``ratio_over_gap``, ``single``
    recordings: Mapping[str, Recording]
    # for each firmware the force, N, that its simulated program expects: the same arithmetic, with
    # the model instead of the solenoid
    simulated: Mapping[str, FloatArray] = field(default_factory=dict)
    # for each firmware the ticks at which the simulated program gave another current
    differing: Mapping[str, int] = field(default_factory=dict)


def plan_trials(rig: Rig, demands: list[Demand]) -> Iterator[ForceTrial]:
    """Name all trials, in the order of the paper."""
    settings = rig.settings
    number = 0
    for demand in demands:
        starts: tuple[Start, ...] = ("unknown", "demagnetised")
        for start in starts:
            yield ForceTrial("end", demand, settings.force.end_m, start, number)
            number += 1
    for demand in demands:
        for position in settings.held.gaps_m:
            yield ForceTrial("positions", demand, position, "unknown", number)
            number += 1
    for demand in demands:
        yield ForceTrial("moving", demand, None, "unknown", number)
        number += 1


def run_trial(rig: Rig, trial: ForceTrial, controllers: Controllers) -> ForceOutcome:
    """Run one trial under every controller of its stage; all see the same noise."""
    gap, seed = trial.gap(rig), [1, trial.number]
    demagnetised = trial.start == "demagnetised"
    recordings: dict[str, Recording] = {}
    simulated: dict[str, FloatArray] = {}
    differing: dict[str, int] = {}

    def bench() -> ActuatorBench:
        return ActuatorBench(rig, gap, seed, unknown_past=not demagnetised)

    for program in controllers.programs:
        recording, session = run_firmware(
            program, bench(), trial.demand, controllers.board, demagnetised
        )
        recordings[program.name] = recording
        differing[program.name] = ticks_that_differ(program, session)
        simulated[program.name] = _expected(program, recording, demagnetised)
    known = read_gaps(rig, gap, seed)
    for name, baseline in controllers.baselines.items():
        stand = bench()
        if not demagnetised:
            stand.condition(controllers.conditioning)
        recordings[name] = run_open_loop(stand, baseline.run(trial.demand.force, known))
    return ForceOutcome(trial, recordings, simulated, differing)


def _expected(program: Program, recording: Recording, demagnetised: bool) -> FloatArray:
    """Force of the model under the currents of the program: it has neither noise nor delay."""
    turns = ",".join(repr(turn) for turn in [0.0, *program.conditioning])
    history = "demagnetised" if demagnetised else f"conditioned:{turns}"
    model = program.model
    gap = recording["gap_read_m"] if model.needs_schedule else None
    time = recording["t_s"] if model.has_eddy_currents else None
    return model.predict(recording["command_A"], gap, time, history=history).output
