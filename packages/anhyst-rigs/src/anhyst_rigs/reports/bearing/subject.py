"""Collect data, tables and sentences for the report of a bearing; parts of the data may be missing."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from anhyst.control.controller_file import ControllerTable
from anhyst.data.speeds import select_slow_loops
from anhyst.support.kinds import MethodName
from anhyst.support.page import MINUS, NBSP, UNKNOWN_TEXT, Cell, Note, PageTable, format_number, make_table
from anhyst.support.wording import capitalise
from anhyst_rigs.reports.bearing.figures import (
    LoopCurve,
    Response,
    StepPanel,
    identified_loop,
    nearest_loops,
    window_s,
)
from anhyst_rigs.reports.study.page import (
    TerminalSummary,
    case_table,
    file_hashes,
    interval_text,
    sort_for_report,
)
from anhyst_rigs.rig.bearing.held import levitation_loss_time
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.loop import Scenario, SimulatedLoop
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.bearing import experiments
from anhyst_rigs.study.bearing.experiments import ExperimentFigures, Experiments, VariantFigures
from anhyst_rigs.study.bearing.linear import Margins
from anhyst_rigs.study.bearing.operating import has_constant_gains
from anhyst_rigs.study.bearing.responses import (
    NOISE,
    OVERSHOOT,
    SETTLING_BAND,
    StepCell,
    StepComparison,
    compare_overshoots,
    group_by_step,
)
from anhyst_rigs.study.bearing.simulate import Simulation
from anhyst_rigs.study.engine.table import CaseFigures, ComparedFigure, Metric, lost_interval


@dataclass(frozen=True)
class Tracking:
    """An experiment with every variant: a trajectory, a load step, or a recovery."""

    title: str  # name of the experiment
    recordings: Mapping[MethodName, Recording]  # recordings, reduced to the part that is drawn


@dataclass(frozen=True)
class SimulationSubject:
    """All data that the report of a simulation can contain."""

    rig: BodyRig
    # settings of the controller; all other variants are compared with its variant
    controller: ControllerTable
    seeds: int  # number of noise seeds for each interval
    panels: tuple[StepPanel, ...] = ()  # panels of step responses (paper, Fig. 11)
    steps: tuple[StepComparison, ...] = ()  # metrics of all steps
    experiments: Experiments | None = None  # metrics of all other experiments
    # runs for the figure of demanded and true force
    forces: Mapping[MethodName, Recording] = field(default_factory=dict)
    run: Mapping[MethodName, Recording] = field(default_factory=dict)  # runs in the figure of loops
    measured_loops: tuple[LoopCurve, ...] = ()  # measured loops at the nearest gaps
    identified: LoopCurve | None = None  # loop that the model predicts at the gap of the run
    tracked: tuple[Tracking, ...] = ()  # trajectories, load steps and recoveries
    standstill_runs: Mapping[MethodName, Recording] = field(default_factory=dict)  # at standstill
    # measured sensitivity, then sensitivity and loop gain of the linearised loop
    sensitivity: Mapping[MethodName, Response] = field(default_factory=dict)
    linear_sensitivity: Mapping[MethodName, Response] = field(default_factory=dict)
    loop_gain: Mapping[MethodName, Response] = field(default_factory=dict)
    margins: Mapping[MethodName, Margins] = field(default_factory=dict)  # of the linearised loop
    notes: tuple[Note, ...] = ()  # notes for the head of the page
    # SHA-256 of each input file, by file name
    files: Mapping[str, str] = field(default_factory=dict)
    command: str = ""  # command that repeats the study

    @property
    def variant(self) -> MethodName:
        """Variant of the controller, with which all other variants are compared."""
        return self.controller.compensation.variant

    @property
    def baselines(self) -> list[MethodName]:
        """All other variants of the steps, in report order."""
        methods = {name for step in self.steps for name in step.cells}
        return [name for name in sort_for_report(methods) if name != self.variant]

    @property
    def all_variants(self) -> list[MethodName]:
        """All variants that the page shows."""
        variants = (*self.baselines, *self.sensitivity, *self.standstill_runs, *self.forces)
        return sort_for_report({self.variant, *variants})

    def step_text(self, step: StepComparison) -> str:
        """Return a description of a step; it mentions the load only if there are several loads."""
        height_and_gap = f"{1e6 * step.height:g}{NBSP}µm at {1e3 * step.gap:g}{NBSP}mm"
        has_several_loads = len({step.load for step in self.steps}) > 1
        return f"{height_and_gap}, {step.load:g}{NBSP}N" if has_several_loads else height_and_gap


_FORCE_VARIANTS = (
    "ratio",
    "single-valued",
    "full",
)  # variants whose forces are drawn, in addition to that of the controller
_FREQUENCY_COUNT = 400


def gather_subject(simulation: Simulation, command: str) -> SimulationSubject:
    """Return the data of a report; trajectories and load steps are simulated again."""
    rig, settings = simulation.rig, simulation.rig.settings
    steps = group_by_step(simulation.cells)
    upward_steps = [step for step in simulation.scenario.steps if step.gap_after < step.gap_before]
    steps_at_gap = {step.height: step for step in steps if step.gap == settings.gap_m}
    all_ticks = simulation.scenario.ticks
    complete_runs = {name: run for name, run in simulation.step_recordings.items() if len(run) == all_ticks}
    panels = tuple(
        StepPanel(
            step,
            complete_runs,
            compared.figure(OVERSHOOT),
            window_s(_mean_times(compared.cells.values(), SETTLING), (step.end - step.begin) * rig.dt),
        )
        for step in upward_steps
        for height, compared in steps_at_gap.items()
        if np.isclose(height, step.height)
    )
    standstill_plan = experiments.plan_standstill(simulation.setups[simulation.main_variant])
    shown_runs = {
        name: run
        for name, run in complete_runs.items()
        if name in (*_FORCE_VARIANTS, simulation.main_variant)
    }
    last_step = {name: panels[-1].cut(run) for name, run in shown_runs.items()} if panels else {}
    linear_gain, linear_sensitivity = _linear_responses(simulation)
    has_one_magnet = len(rig.settings.body_magnets) == 1
    loops, current = (select_slow_loops(simulation.knowledge.loops), rig.settings.measurement.current_max_A)
    return SimulationSubject(
        rig=rig,
        controller=simulation.controller.settings,
        seeds=settings.noise_seeds,
        panels=panels,
        steps=steps,
        forces=last_step,
        run=last_step if has_one_magnet else {},
        measured_loops=tuple(nearest_loops(loops, settings.gap_m)) if has_one_magnet else (),
        identified=identified_loop(simulation.knowledge.model.at_rest, settings.gap_m, 0.0, current)
        if has_one_magnet
        else None,
        tracked=tuple(runs for runs in _run_tracking(simulation) if runs.recordings),
        standstill_runs=_run_variants(simulation.setups, *standstill_plan),
        sensitivity={
            name: Response(response.frequency, response.ratio)
            for name, response in simulation.sensitivity.items()
        },
        linear_sensitivity=linear_sensitivity,
        loop_gain=linear_gain,
        margins={
            name: simulation.loops[name].margins
            for name, setup in simulation.setups.items()
            if has_constant_gains(setup)
        },
        experiments=simulation.experiments,
        files=file_hashes([rig.path, simulation.controller.path, *rig.measured_loops.files]),
        command=command,
        notes=(
            Note("info", "The plant", f"{capitalise('; '.join(simulation.plant.report_lines))}."),
            *(Note("warn", "The plant", f"{capitalise(text)}.") for text in simulation.plant.warnings),
        ),
    )


def _mean_times(cells: Iterable[CaseFigures], metric: Metric) -> list[float]:
    """Return the mean times of the variants that lost no run, s; infinite if one never settles."""
    intervals = (cell.figures.get(metric.key) for cell in cells)
    return [interval.mean for interval in intervals if interval is not None]


def _linear_responses(
    simulation: Simulation,
) -> tuple[dict[MethodName, Response], dict[MethodName, Response]]:
    """Return loop gain and sensitivity of the linearised loops.

    The loops are those of `ratio` and of the variant in the controller file. Unless this variant
    consists of constants, it is treated as if it knew the static slopes exactly.
    """
    frequency = np.geomspace(5.0, 0.4 * simulation.rig.settings.timing.rate_Hz, _FREQUENCY_COUNT)
    gains: dict[MethodName, Response] = {}
    sensitivities: dict[MethodName, Response] = {}
    for name in ("ratio", simulation.main_variant):
        loop = simulation.loops[name]
        assumption = "" if has_constant_gains(simulation.setups[name]) else "assuming exact static slopes"
        note = assumption if loop.is_stable else f"{assumption}, unstable".removeprefix(", ")
        gains[name] = Response(frequency, loop.loop_gain(frequency), note)
        sensitivities[name] = Response(frequency, loop.sensitivity(frequency), note)
    return gains, sensitivities


def _run_variants(
    setups: Mapping[MethodName, BearingSetup], scenario: Scenario, begin_tick: int
) -> Mapping[MethodName, Recording]:
    """Simulate a scenario with every variant; return the recordings from a tick on.

    Runs that lost levitation are omitted.
    """
    recordings = {}
    for name, setup in setups.items():
        recording = SimulatedLoop(setup).run(scenario)
        loss_time = levitation_loss_time(setup.rig, recording, scenario.lift_end_tick)
        if loss_time is None and len(recording) == scenario.ticks:
            recordings[name] = recording.slice_ticks(begin_tick, len(recording))
    return recordings


def _run_tracking(simulation: Simulation) -> Iterator[Tracking]:
    """Simulate the trajectories and load steps for the figures."""
    setups, settings = simulation.setups, simulation.rig.settings
    setup = next(iter(setups.values()))
    for trajectory in settings.trajectories:
        recordings = _run_variants(setups, *experiments.plan_trajectory(setup, trajectory))
        amplitude = f"{1e6 * trajectory.amplitude_m:g}{NBSP}µm"
        yield Tracking(f"{trajectory.kind} of {amplitude} at {trajectory.frequency_Hz:g}{NBSP}Hz", recordings)
    for force, by_variant in simulation.experiments.load_steps:
        scenario, begin = experiments.plan_load_step(setup, force)
        hold_s = (scenario.ticks - begin) * setup.rig.dt
        ticks = round(window_s(_mean_times(by_variant.values(), RECOVERY), hold_s) / setup.rig.dt)
        recordings = {
            name: run.slice_ticks(0, ticks) for name, run in _run_variants(setups, scenario, begin).items()
        }
        yield Tracking(f"load step of {force:g}{NBSP}N", recordings)


WITHIN_NOISE = "≤ noise"
"""Remark on an overshoot that is not significantly larger than the noise at standstill."""
OVERSHOOT_METRIC = Metric(OVERSHOOT, "Overshoot", "%")
SETTLING = Metric("settling_in_noise_s", "Settling time", "ms", 1e3)
STANDSTILL_OF_STEP = Metric("standstill_rms_m", "Standstill", "nm", 1e9)
STEADY_ERROR = Metric("steady_error_m", "Steady-state error", "nm", 1e9)
FORCE_ERROR = "force_error_rms_N"
_DELAY_NOTE = (
    "True minus demanded force of the same tick. It includes the delay of one tick and the lag of "
    "the amplifier, which no compensation removes."
)
STEP_TABLES: Mapping[Metric, str] = {
    OVERSHOOT_METRIC: "Relative to the height of the step, noise included; the larger "
    f"of a step up and one down. “{WITHIN_NOISE}”: not significantly above the noise in the next table, "
    "so that it may be only noise.",
    Metric(NOISE, "Noise in the overshoot", "%"): "Largest deviation of the gap from its mean in "
    "the last half of the hold, relative to the height of the step; the larger of a step up "
    "and one down.",
    Metric("rise_time_s", "Rise time, 10 to 90 %", "ms", 1e3): "",
    SETTLING: f"Until the gap stays within {100.0 * SETTLING_BAND:g} % of the height, or three times the "
    "resolution of the position sensor (rms of its noise and its steps) if that is more. The "
    "band is the same for all variants.",
    STEADY_ERROR: "Mean of gap minus reference in the last quarter of the hold.",
    Metric("tracking_rms_m", "Deviation from the reference, rms", "µm", 1e6): "During the whole step.",
    Metric(FORCE_ERROR, "Force error, rms", "N"): _DELAY_NOTE,
    Metric("current_rate_rms_A_per_s", "Current effort", "A/s"): "Root mean square of the "
    "current's rate of change.",
}
"""Metrics of steps, with the captions of their tables."""
STANDSTILL_METRICS = (
    Metric("rms_m", "Position at a standstill, rms", "nm", 1e9),
    Metric("mean_error_m", "Mean error at a standstill", "nm", 1e9),
)
TRACKING_METRICS = (
    Metric("tracking_rms_m", "Deviation from the trajectory, rms", "nm", 1e9),
    Metric("tracking_peak_m", "Largest deviation from the trajectory", "nm", 1e9),
    Metric(FORCE_ERROR, "Force error on the trajectory, rms", "N"),
)
LOAD_STEP_PEAK = Metric("peak_m", "Largest deviation after a load step", "µm", 1e6)
RECOVERY = Metric("recovery_s", "Time until the error stays within 1 µm", "ms", 1e3)
EVENT_EXCESS = (
    Metric("excess_peak_m", "Largest deviation after the event", "µm", 1e6),
    Metric("excess_s", "Time until the event has no effect", "ms", 1e3),
)


def difference_text(figure: ComparedFigure) -> str:
    """Return the result of a comparison as text, such as "54 % less"."""
    if figure.is_better:
        return f"{format_number(100.0 * (1.0 - figure.ratio), 2)}{NBSP}% less"
    if figure.is_worse:
        return f"+{format_number(figure.model_value - figure.baseline_value, 2)} points"
    return "equal" if math.isfinite(figure.model_value + figure.baseline_value) else UNKNOWN_TEXT


def _noise_remark(step_cell: CaseFigures) -> str:
    """Return the remark on an overshoot if it does not exceed the noise at standstill."""
    is_noise = isinstance(step_cell, StepCell) and not step_cell.has_overshoot and not step_cell.lost
    return WITHIN_NOISE if is_noise else ""


def metric_text(step: StepComparison, name: MethodName, metric: Metric = OVERSHOOT_METRIC) -> str:
    """Return a metric of a variant as text; an overshoot has a remark if it may be only noise."""
    text = interval_text(step.figure(metric.key)[name], metric.unit, metric.factor)
    return f"{text} {_noise_remark(step.cells[name])}".rstrip() if metric == OVERSHOOT_METRIC else text


def benefit_table(subject: SimulationSubject) -> PageTable | None:
    """Return a table with the reduction of the overshoot for each step and each baseline."""
    steps = [step for step in subject.steps if subject.variant in step.cells]
    baselines = subject.baselines
    if not steps or not baselines:
        return None
    rows: list[list[str | Cell]] = []
    for step in steps:
        table_row: list[str | Cell] = [subject.step_text(step), metric_text(step, subject.variant)]
        for name in baselines:
            has_step = name in step.cells
            difference = compare_overshoots(step, subject.variant, name) if has_step else None
            text = UNKNOWN_TEXT if difference is None else difference_text(difference)
            table_row.append(Cell(text, strong=difference is not None and difference.is_better))
        rows.append(table_row)
    return make_table(
        f"Overshoot of {subject.variant} compared with each baseline",
        ["step", "overshoot", *baselines],
        rows,
        f"Overshoot of {subject.variant} in % of the height, compared with each baseline: "
        f"same gains, same plant, same {subject.seeds} noise seeds. “54 % less”: reduction from the "
        "overshoot of the baseline in the heading of the column. “+0.5 points”: more than the "
        "baseline, in percentage points of the height. “Equal”: the difference is within the 95 % "
        "confidence intervals, or less than the noise of one of the two at standstill. "
        f"“{WITHIN_NOISE}”: not significantly more than this noise. A later table "
        "lists the overshoot of each baseline.",
    )


def terminal_summary(simulation: Simulation) -> TerminalSummary:
    """Return the terminal output of a simulation."""
    file, iron = simulation.rig.settings, simulation.operating_point.slopes
    steps = [step for step in group_by_step(simulation.cells) if step.gap == file.gap_m]
    rows = []
    for name in simulation.setups:
        last_cell = steps[-1].cells[name]
        other_cells = (
            interval_text(last_cell.interval(metric.key), factor=metric.factor)
            for metric in (SETTLING, STANDSTILL_OF_STEP)
        )
        main_mark = " *" if name == simulation.main_variant else ""
        rows.append([f"{name}{main_mark}", *(metric_text(step, name) for step in steps), *other_cells])
    heights = [f"{1e6 * step.height:g} µm" for step in steps]
    overshoots = make_table(
        f"Overshoot of steps at {1e3 * file.gap_m:g} mm",
        ["", *heights, SETTLING.heading, STANDSTILL_OF_STEP.heading],
        rows,
        f"* of the controller file; mean of {file.noise_seeds} noise seeds with its 95 % interval; "
        f"settling and standstill at the highest step; {WITHIN_NOISE}: not significantly more than "
        "the noise at standstill",
    )
    slope = (
        f"{iron.label} iron: slope just after a reversal {100.0 * iron.slope_ratio:.0f} % of the static one; "
        f"unstable pole {simulation.operating_point.bearing.current_drive_pole:.0f} Hz"
    )
    return TerminalSummary([overshoots], [*simulation.plant.report_lines, slope])


def step_tables(subject: SimulationSubject) -> list[PageTable]:
    """Return one table for each metric of the steps."""
    steps = {subject.step_text(step): step.cells for step in subject.steps}
    return [
        case_table(metric, steps, caption, _noise_remark if metric.key == OVERSHOOT else None)
        for metric, caption in STEP_TABLES.items()
        if any(metric.key in cell.figures for row in steps.values() for cell in row.values())
    ]


def standstill_tables(figures: VariantFigures) -> list[PageTable]:
    """Return the metrics at standstill, and the limit cycles of each variant."""
    cycles = make_table(
        "Limit cycles at a standstill",
        ("variant", "runs with one", "amplitude (nm)", "period (ms)"),
        [[name, *_cycle_row(figures[name])] for name in sort_for_report(figures)],
        "Amplitude and period: medians of the runs that have a cycle.",
    )
    return [*(case_table(metric, {"standstill": figures}) for metric in STANDSTILL_METRICS), cycles]


def _cycle_row(figures: ExperimentFigures) -> tuple[str, str, str]:
    if figures.lost:
        return interval_text(lost_interval(figures.lost, figures.runs)), UNKNOWN_TEXT, UNKNOWN_TEXT
    amplitude, period = figures.median("amplitude"), figures.median("period")
    return (
        f"{len(figures.cycles or ())} of {figures.runs}",
        UNKNOWN_TEXT if amplitude is None else format_number(1e9 * amplitude, 3),
        UNKNOWN_TEXT if period is None else format_number(1e3 * period, 3),
    )


def experiment_tables(experiments: Experiments) -> list[PageTable]:
    """Return the metrics of the trajectories, the load steps and the disturbing events."""
    trajectories = {
        f"{shape.kind} of {1e6 * shape.amplitude_m:g}{NBSP}µm at {shape.frequency_Hz:g}{NBSP}Hz": by_variant
        for shape, by_variant in experiments.trajectories
    }
    loads = {f"load step of {force:g}{NBSP}N": step_figures for force, step_figures in experiments.load_steps}
    recovery: dict[str, VariantFigures] = dict(loads)
    events: dict[str, VariantFigures] = {}
    for event, event_figures in experiments.events.items():
        (recovery if event == "overload" else events)[event] = event_figures
    groups = (
        (trajectories, TRACKING_METRICS),
        (loads, (LOAD_STEP_PEAK,)),
        (recovery, (RECOVERY,)),
        (events, EVENT_EXCESS),
    )
    return [
        case_table(metric, cases, _DELAY_NOTE if metric.key == FORCE_ERROR else "")
        for cases, metrics in groups
        if cases
        for metric in metrics
    ]


def margin_table(margins: Mapping[MethodName, Margins]) -> PageTable:
    """Return the stability margins of the linearised loops."""
    rows = [
        [
            name,
            "yes" if margin.stable else "NO",
            f"{format_number(margin.gain_down, 2)} to {format_number(margin.gain_up, 2)}",
            format_number(margin.phase, 2),
            format_number(1e6 * margin.delay, 2),
            format_number(margin.crossover, 3),
            f"{format_number(margin.peak)} at {format_number(margin.peak_frequency, 2)}{NBSP}Hz",
        ]
        for name, margin in ((name, margins[name]) for name in sort_for_report(margins))
    ]
    return make_table(
        "Margins of the linearised loop",
        (
            "variant",
            "stable",
            "gain can change by",
            "phase margin (°)",
            "more delay (µs)",
            "crossover (Hz)",
            "peak sensitivity",
        ),
        rows,
        texts=2,
    )


def settling_sentence(subject: SimulationSubject) -> str:
    """Return a sentence about settling time and steady-state error, which the paper also compares."""
    if "ratio" not in subject.baselines:
        return ""
    counts = []
    for metric in (SETTLING, STEADY_ERROR):
        settling_time_pairs = [
            (abs(row[subject.variant].mean), abs(row["ratio"].mean))
            for row in [step.figure(metric.key) for step in subject.steps]
            if subject.variant in row and "ratio" in row
        ]
        settling_time_pairs = [
            settling_times for settling_times in settling_time_pairs if not math.isnan(sum(settling_times))
        ]  # Levitation was lost.
        if settling_time_pairs:
            settling_range, ratio_range = (
                _range_text([metric.factor * value for value in values], metric.unit)
                for values in zip(*settling_time_pairs, strict=True)
            )
            counts.append(
                f"{metric.title.lower()}: {settling_range} with {subject.variant}, {ratio_range} with ratio"
            )
    if not counts:
        return ""
    return (
        "The paper found settling time and steady-state error almost unchanged by compensation. "
        f"Here, over all steps: {'; '.join(counts)}."
    )


def _range_text(values: Sequence[float], unit: str) -> str:
    low, high = min(values), max(values)
    if not math.isfinite(low):
        return "never"
    end = f"{format_number(high, 2)}{NBSP}{unit}" if math.isfinite(high) else "never"
    return f"{format_number(low, 2)} to {end}".replace("-", MINUS)
