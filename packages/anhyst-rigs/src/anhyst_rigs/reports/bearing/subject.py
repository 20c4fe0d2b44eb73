"""What a report of a simulation is about, plain data parts of which may be absent; its tables and sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from anhyst.control.controller_file import ControllerTable
from anhyst.data.speeds import slow_loops
from anhyst.support.kinds import MethodName
from anhyst.support.page import MINUS, NBSP, NOT_KNOWN, Cell, Note, PageTable, number, table
from anhyst_rigs.reports.bearing.figures import (
    LoopCurve,
    Response,
    StepPanel,
    identified_loop,
    nearest_loops,
)
from anhyst_rigs.reports.study.page import Printed, case_table, hashes, interval_text, ordered
from anhyst_rigs.rig.bearing.held import lost_at
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.loop import ReferenceStep, Scenario, SimulatedLoop
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.bearing import experiments
from anhyst_rigs.study.bearing.experiments import ExperimentFigures, Experiments, Tried
from anhyst_rigs.study.bearing.linear import Margins
from anhyst_rigs.study.bearing.operating import has_constants
from anhyst_rigs.study.bearing.responses import (
    NOISE,
    OVERSHOOT,
    SETTLED,
    StepCell,
    Steps,
    grouped,
    step_difference,
)
from anhyst_rigs.study.bearing.simulate import Simulation
from anhyst_rigs.study.engine.table import CaseFigures, ComparedFigure, Metric, no_mean


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
        notes=(
            Note("info", "The plant", f"{'; '.join(simulation.plant.lines)}."),
            *(Note("warn", "The plant", f"{text}.") for text in simulation.plant.warnings),
        ),
    )


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


WITHIN_NOISE = "≤ noise"
"""Beside an overshoot that is not certainly more than what the standstill adds to it."""
SETTLING = Metric("settling_in_noise_s", "Settling time", "ms", 1e3)
STANDSTILL_OF_STEP = Metric("standstill_rms_m", "Standstill", "nm", 1e9)
STEADY = Metric("steady_error_m", "Steady-state error", "nm", 1e9)
FORCE_ERROR = "force_error_rms_N"
_LATE = (
    "True less wanted force of the same tick: it holds the tick of delay and the lag of the "
    "amplifier, which no compensation takes away."
)
STEP_TABLES: Mapping[Metric, str] = {
    Metric(OVERSHOOT, "Overshoot", "%"): "Of the height of the step, noise included; of a step up "
    f"and one down, the larger. “{WITHIN_NOISE}”: not certainly more than the noise below, so that "
    "it shows nothing of the step.",
    Metric(NOISE, "Noise in the overshoot", "%"): "Largest deviation of the gap from its mean in "
    "the last half of the hold, to both sides, of the height of the step; of a step up and one "
    "down, the larger.",
    Metric("rise_time_s", "Rise time, 10 to 90 %", "ms", 1e3): "",
    SETTLING: f"Until the gap stays within {100.0 * SETTLED:g} % of the height, or three times the "
    "resolution of the position sensor (rms of its noise and its steps) where that is more: one "
    "band for all variants.",
    STEADY: "Of the gap, over the end of the hold.",
    Metric(
        "tracking_rms_m", "Deviation from the reference, rms", "µm", 1e6
    ): "Over the whole step.",
    Metric(FORCE_ERROR, "Force error, rms", "N"): _LATE,
    Metric("current_rate_rms_A_per_s", "Current effort", "A/s"): "Root mean square of the "
    "current's rate of change.",
}
"""Figures of steps, and what their tables say of them."""
STANDSTILL = (
    Metric("rms_m", "Position at a standstill, rms", "nm", 1e9),
    Metric("mean_error_m", "Mean error at a standstill", "nm", 1e9),
)
TRACKING = (
    Metric("tracking_rms_m", "Deviation from the trajectory, rms", "nm", 1e9),
    Metric("tracking_peak_m", "Deviation from the trajectory, largest", "nm", 1e9),
    Metric(FORCE_ERROR, "Force error on the trajectory, rms", "N"),
)
PUSHED = Metric("peak_m", "Deviation after a load step, largest", "µm", 1e6)
RECOVERY = Metric("recovery_s", "Time until the error stays within 1 µm", "ms", 1e3)
EXCESS = (
    Metric("excess_peak_m", "Deviation that the event makes, largest", "µm", 1e6),
    Metric("excess_s", "Time until the event no longer shows", "ms", 1e3),
)


def difference_text(figure: ComparedFigure) -> str:
    """Write such as "54 % less"."""
    if figure.less:
        return f"{number(100.0 * (1.0 - figure.ratio), 2)}{NBSP}% less"
    if figure.more:
        return f"+{number(figure.mine - figure.its, 2)} points"
    return "alike" if math.isfinite(figure.mine + figure.its) else NOT_KNOWN


def _remark(cell: CaseFigures) -> str:
    """Return what is to stand beside an overshoot that is the noise of a standstill."""
    noise = isinstance(cell, StepCell) and not cell.overshoots and not cell.lost
    return WITHIN_NOISE if noise else ""


def overshoot_text(step: Steps, name: MethodName) -> str:
    """Write the overshoot of a variant, and whether it is noise."""
    return f"{interval_text(step.of(OVERSHOOT)[name], '%')} {_remark(step.cells[name])}".rstrip()


def benefit_table(subject: SimulationSubject) -> PageTable | None:
    """Say for every step and baseline how much overshoot is gone."""
    steps = [step for step in subject.steps if subject.variant in step.cells]
    baselines = subject.baselines
    if not steps or not baselines:
        return None
    rows: list[list[str | Cell]] = []
    for step in steps:
        row: list[str | Cell] = [subject.situation(step), overshoot_text(step, subject.variant)]
        for name in baselines:
            known = name in step.cells
            difference = step_difference(step, subject.variant, name) if known else None
            text = NOT_KNOWN if difference is None else difference_text(difference)
            row.append(Cell(text, strong=difference is not None and difference.less))
        rows.append(row)
    return table(
        f"Overshoot of {subject.variant} against that of each baseline",
        ["step", "overshoot", *baselines],
        rows,
        f"Overshoot of {subject.variant} in % of the height, and what it is against each baseline: "
        f"same gains, same plant, same {subject.seeds} noise seeds. “54 % less”: that part of the "
        "overshoot of the baseline in the head of the column is gone. “+0.5 points”: more than the "
        "baseline, by so many percentage points of the height. “Alike”: the 95 % confidence "
        "intervals leave both signs open, or the difference is less than one of the two moves "
        f"about at a standstill. “{WITHIN_NOISE}”: not certainly more than that. The overshoot of "
        "every baseline stands in section 2.",
    )


def printed(simulation: Simulation) -> Printed:
    """Return what a terminal shows of a simulation."""
    file, iron = simulation.rig.settings, simulation.at.slopes
    steps = [step for step in grouped(simulation.cells) if step.gap == file.gap_m]
    rows = []
    for name in simulation.setups:
        last = steps[-1].cells[name]
        rest = (
            interval_text(last.of(metric.key), factor=metric.factor)
            for metric in (SETTLING, STANDSTILL_OF_STEP)
        )
        mark = " *" if name == simulation.own else ""
        rows.append([f"{name}{mark}", *(overshoot_text(step, name) for step in steps), *rest])
    heights = [f"{1e6 * step.height:g} µm" for step in steps]
    overshoots = table(
        f"Overshoot of steps at {1e3 * file.gap_m:g} mm",
        ["", *heights, SETTLING.head, STANDSTILL_OF_STEP.head],
        rows,
        f"* of the controller file; mean of {file.noise_seeds} noise seeds with its 95 % interval; "
        f"settling and standstill at the highest step; {WITHIN_NOISE}: not certainly more than the "
        "armature moves about at a standstill",
    )
    slope = (
        f"{iron.label} iron: just after a reversal {100.0 * iron.share:.0f} % of the static N/A; "
        f"unstable pole {simulation.at.point.pole_at_current:.0f} Hz"
    )
    return Printed([overshoots], [*simulation.plant.lines, slope])


def step_tables(subject: SimulationSubject) -> list[PageTable]:
    """Return one table for each figure of the steps."""
    steps = {subject.situation(step): step.cells for step in subject.steps}
    return [
        case_table(metric, steps, caption, _remark if metric.key == OVERSHOOT else None)
        for metric, caption in STEP_TABLES.items()
        if any(metric.key in one.figures for row in steps.values() for one in row.values())
    ]


def standstill_tables(tried: Tried) -> list[PageTable]:
    """Return the figures of a standstill, and under which variants the armature never came to rest."""
    cycles = table(
        "Limit cycles at a standstill",
        ("variant", "runs with one", "amplitude (nm)", "period (ms)"),
        [[name, *_cycle_row(tried[name])] for name in ordered(tried)],
        "Amplitude and period: medians of the runs that have a cycle.",
    )
    return [*(case_table(metric, {"hanging still": tried}) for metric in STANDSTILL), cycles]


def _cycle_row(one: ExperimentFigures) -> tuple[str, str, str]:
    if one.lost:
        return interval_text(no_mean(one.lost, one.runs)), NOT_KNOWN, NOT_KNOWN
    size, period = one.median("amplitude"), one.median("period")
    return (
        f"{len(one.cycles or ())} of {one.runs}",
        NOT_KNOWN if size is None else number(1e9 * size, 3),
        NOT_KNOWN if period is None else number(1e3 * period, 3),
    )


def experiment_tables(tried: Experiments) -> list[PageTable]:
    """Return the figures of trajectories, load steps, and what goes wrong."""
    follow = {
        f"{shape.kind} of {1e6 * shape.amplitude_m:g}{NBSP}µm at {shape.frequency_Hz:g}{NBSP}Hz": one
        for shape, one in tried.trajectories
    }
    loads = {f"load step of {force:g}{NBSP}N": one for force, one in tried.load_steps}
    recovery: dict[str, Tried] = dict(loads)
    events: dict[str, Tried] = {}
    for event, one in tried.events.items():
        (recovery if event == "overload" else events)[event] = one
    groups = ((follow, TRACKING), (loads, (PUSHED,)), (recovery, (RECOVERY,)), (events, EXCESS))
    return [
        case_table(metric, cases, _LATE if metric.key == FORCE_ERROR else "")
        for cases, metrics in groups
        if cases
        for metric in metrics
    ]


def margin_table(margins: Mapping[MethodName, Margins]) -> PageTable:
    """Return the margins of linearised loops."""
    rows = [
        [
            name,
            "yes" if one.stable else "NO",
            f"{number(one.gain_down, 2)} to {number(one.gain_up, 2)}",
            number(one.phase, 2),
            number(1e6 * one.delay, 2),
            number(one.crossover, 3),
            f"{number(one.peak)} at {number(one.peak_frequency, 2)}{NBSP}Hz",
        ]
        for name, one in ((name, margins[name]) for name in ordered(margins))
    ]
    return table(
        "Margins of the linearised loop",
        (
            "variant",
            "stable",
            "gain may change by",
            "phase margin (°)",
            "more delay (µs)",
            "crossover (Hz)",
            "peak sensitivity",
        ),
        rows,
        texts=2,
    )


def settling_sentence(subject: SimulationSubject) -> str:
    """Say whether settling and steady-state error change, which the paper found not to."""
    if "ratio" not in subject.baselines:
        return ""
    counts = []
    for metric in (SETTLING, STEADY):
        both = [
            (abs(row[subject.variant].mean), abs(row["ratio"].mean))
            for row in [step.of(metric.key) for step in subject.steps]
            if subject.variant in row and "ratio" in row
        ]
        both = [pair for pair in both if not math.isnan(sum(pair))]  # lost
        if both:
            mine, other = (
                _range([metric.factor * one for one in ones], metric.unit)
                for ones in zip(*both, strict=True)
            )
            counts.append(
                f"{metric.title.lower()}: {mine} with {subject.variant}, {other} with ratio"
            )
    if not counts:
        return ""
    return (
        "The paper found settling time and steady-state error almost unchanged by compensation. "
        f"Here, over all steps: {'; '.join(counts)}."
    )


def _range(values: Sequence[float], unit: str) -> str:
    low, high = min(values), max(values)
    if not math.isfinite(low):
        return "never"
    end = f"{number(high, 2)}{NBSP}{unit}" if math.isfinite(high) else "never"
    return f"{number(low, 2)} to {end}".replace("-", MINUS)
