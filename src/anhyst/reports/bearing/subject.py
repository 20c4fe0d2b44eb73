"""What a report of a simulation is about, plain data parts of which may be absent; gathered from one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from anhyst.control.controller_file import ControllerTable
from anhyst.data.speeds import slow_loops
from anhyst.reports.bearing.figures import (
    LoopCurve,
    Response,
    StepPanel,
    identified_loop,
    nearest_loops,
)
from anhyst.reports.study.page import hashes, ordered
from anhyst.rig.bearing.loop import BearingSetup, lost_at
from anhyst.rig.body import BodyRig
from anhyst.rig.distance import PlantCheck
from anhyst.rig.file import RigFile
from anhyst.rig.loop import ReferenceStep, Scenario, SimulatedLoop
from anhyst.rig.recording import Recording
from anhyst.study.bearing import experiments
from anhyst.study.bearing.experiments import Experiments
from anhyst.study.bearing.linear import Margins
from anhyst.study.bearing.operating import has_constants
from anhyst.study.bearing.simulate import Simulation
from anhyst.study.bearing.verdict import OVERSHOOT, Steps, grouped
from anhyst.support.kinds import MethodName
from anhyst.support.page import NBSP, Note


@dataclass(frozen=True)
class Tracking:
    """One thing that was tried, under every variant: a trajectory, a load step, a recovery."""

    title: str  # what was tried
    recordings: Mapping[MethodName, Recording]  # as long as they are to be shown


@dataclass(frozen=True)
class SimulationSubject:
    """All there is to say about a simulation."""

    rig: BodyRig  # the bearing
    # its controller; the variant it names is the one that others are held against
    controller: ControllerTable
    seeds: int  # noise seeds behind every interval
    panels: tuple[StepPanel, ...] = ()  # fig. 11
    steps: tuple[Steps, ...] = ()  # the figures of all steps
    experiments: Experiments | None = None  # those of all else
    # in which wanted and true force are shown
    forces: Mapping[MethodName, Recording] = field(default_factory=dict)
    run: Mapping[MethodName, Recording] = field(default_factory=dict)  # shown over the loops
    measured: tuple[LoopCurve, ...] = ()  # loops of the nearest gaps
    identified: LoopCurve | None = None  # loop of the model at the gap of the run
    tracked: tuple[Tracking, ...] = ()  # trajectories, load steps, recoveries
    standstill: Mapping[MethodName, Recording] = field(default_factory=dict)  # at rest in the air
    # measured; of the linearised loop; its loop gain
    sensitivity: Mapping[MethodName, Response] = field(default_factory=dict)
    linear_sensitivity: Mapping[MethodName, Response] = field(default_factory=dict)
    loop_gain: Mapping[MethodName, Response] = field(default_factory=dict)
    margins: Mapping[MethodName, Margins] = field(default_factory=dict)  # of the linearised loop
    notes: tuple[Note, ...] = ()  # what a reader must know first, such as a loop that was unstable
    # where it comes from: names of files and their SHA-256
    files: Mapping[str, str] = field(default_factory=dict)
    command: str = ""  # what makes it again

    @property
    def variant(self) -> MethodName:
        """MethodName of the controller, that others are held against."""
        return self.controller.compensation.variant

    @property
    def baselines(self) -> list[MethodName]:
        """The other variants of the steps, in order."""
        methods = {name for step in self.steps for name in step.cells}
        return [name for name in ordered(methods) if name != self.variant]

    @property
    def variants(self) -> list[MethodName]:
        """All that the page speaks of."""
        shown = (*self.baselines, *self.sensitivity, *self.standstill, *self.forces)
        return ordered({self.variant, *shown})

    def situation(self, step: Steps) -> str:
        """Say in words what a step was; the load only if there are several."""
        where = f"{1e6 * step.height:g}{NBSP}µm at {1e3 * step.gap:g}{NBSP}mm"
        several = len({one.load for one in self.steps}) > 1
        return f"{where}, {step.load:g}{NBSP}N" if several else where


_SHOWN = 0.03  # of a step, s
_COLUMNS = ("ratio", "single-valued", "full")  # whose forces are shown, beside the controller's own
_FREQUENCIES = 400


def subject_of(simulation: Simulation, command: str) -> SimulationSubject:
    """Gather what the report of a simulation shows; trajectories and loads are run once more."""
    rig, tried = simulation.rig, simulation.rig.settings
    steps = grouped(simulation.cells)
    up = [step for step in simulation.scenario.steps if step.after < step.before]
    here = {step.height: step for step in steps if step.gap == tried.gap_m}
    whole = simulation.scenario.ticks
    shown = {name: run for name, run in simulation.shown.items() if len(run) == whole}
    panels = tuple(
        StepPanel(
            step,
            shown,
            next(
                found.of(OVERSHOOT)
                for height, found in here.items()
                if np.isclose(height, step.height)
            ),
        )
        for step in up
    )
    still = experiments.standing(simulation.setups[simulation.own])
    chosen = {name: run for name, run in shown.items() if name in (*_COLUMNS, simulation.own)}
    linear_gain, linear_sensitivity = _linear(simulation)
    single = len(rig.settings.placed) == 1
    loops, current = slow_loops(simulation.knowledge.loops), rig.settings.measurement.current_max_A
    return SimulationSubject(
        rig=rig,
        controller=simulation.controller.settings,
        seeds=tried.noise_seeds,
        panels=panels,
        steps=steps,
        forces=_part(chosen, rig.dt, up[-1]),
        run=_part(chosen, rig.dt, up[-1]) if single else {},
        measured=tuple(nearest_loops(loops, tried.gap_m)) if single else (),
        identified=identified_loop(simulation.knowledge.model.at_rest, tried.gap_m, 0.0, current)
        if single
        else None,
        tracked=tuple(one for one in _tracked(simulation.setups, tried) if one.recordings),
        standstill=_seen(simulation.setups, *still),
        sensitivity={
            name: Response(one.frequency, one.ratio) for name, one in simulation.sensitivity.items()
        },
        linear_sensitivity=linear_sensitivity,
        loop_gain=linear_gain,
        margins={
            name: simulation.loops[name].margins
            for name, setup in simulation.setups.items()
            if has_constants(setup)
        },
        experiments=simulation.experiments,
        files=hashes([rig.path, simulation.controller.path, *rig.measured.files]),
        command=command,
        notes=plant_notes(simulation.plant),
    )


def plant_notes(plant: PlantCheck) -> tuple[Note, ...]:
    """Say how far the plant is from its loops, and what that takes from the results."""
    known = Note("info", "The plant", f"{'; '.join(plant.lines)}.")
    return (known, *(Note("warn", "The plant", f"{text}.") for text in plant.warnings))


def _part(
    runs: Mapping[MethodName, Recording], tick: float, step: ReferenceStep
) -> Mapping[MethodName, Recording]:
    """Cut out what happens around a step."""
    first, last = step.begin - round(0.1 * _SHOWN / tick), step.begin + round(_SHOWN / tick)
    return {name: run.part(first, min(last, step.end)) for name, run in runs.items()}


def _linear(
    simulation: Simulation,
) -> tuple[dict[MethodName, Response], dict[MethodName, Response]]:
    """Return linearised loop gain and sensitivity: own variant, as if of static slopes; the paper's."""
    frequency = np.geomspace(5.0, 0.4 * simulation.rig.settings.timing.rate_Hz, _FREQUENCIES)
    gains: dict[MethodName, Response] = {}
    sensitivities: dict[MethodName, Response] = {}
    for name in ("ratio", simulation.own):
        loop = simulation.loops[name]
        known = "" if has_constants(simulation.setups[name]) else "as if it knew the static slopes"
        note = known if loop.stable else f"{known}, unstable".removeprefix(", ")
        gains[name] = Response(frequency, loop.response(frequency), note)
        sensitivities[name] = Response(frequency, loop.sensitivity(frequency), note)
    return gains, sensitivities


def _seen(
    setups: Mapping[MethodName, BearingSetup], scenario: Scenario, begin: int
) -> Mapping[MethodName, Recording]:
    """Run a scenario under every variant, and keep what follows a tick; lost runs are left out."""
    shown = {}
    for name, setup in setups.items():
        recording = SimulatedLoop(setup).run(scenario)
        lost = lost_at(setup.rig, recording, scenario.lifted)
        if lost is None and len(recording) == scenario.ticks:
            shown[name] = recording.part(begin, len(recording))
    return shown


def _tracked(setups: Mapping[MethodName, BearingSetup], tried: RigFile) -> Iterator[Tracking]:
    """Run trajectories and load steps for the eye."""
    setup = next(iter(setups.values()))
    for shape in tried.trajectories:
        seen = _seen(setups, *experiments.following(setup, shape))
        size = f"{1e6 * shape.amplitude_m:g}{NBSP}µm"
        yield Tracking(f"{shape.kind} of {size} at {shape.frequency_Hz:g}{NBSP}Hz", seen)
    for force in tried.load_steps_N:
        scenario, begin = experiments.loaded(setup, force)
        ticks = round(0.1 / setup.rig.dt)
        seen = {name: run.part(0, ticks) for name, run in _seen(setups, scenario, begin).items()}
        yield Tracking(f"load step of {force:g}{NBSP}N", seen)
