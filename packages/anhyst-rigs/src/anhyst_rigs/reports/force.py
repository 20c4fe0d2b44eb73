"""Draw the figures of open-loop force control (section III of the paper), and write the page."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from anhyst.support.errors import InputError
from anhyst.support.figures import (
    FALLING_COLOUR,
    MEASURED_COLOUR,
    PALETTE,
    RISING_COLOUR,
    new_figure,
    use_report_style,
    write_png,
    write_svg,
)
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.page import (
    NBSP,
    Headline,
    Note,
    PageTable,
    Picture,
    Section,
    Text,
    Tile,
    format_number,
    make_table,
)
from anhyst_rigs.reports.benefit import map_plants
from anhyst_rigs.reports.study.page import (
    BOX_HEIGHT_IN,
    BOX_WIDTH_IN,
    COLOURS,
    PLANT_FILL,
    REPORT_NAME,
    SOFTWARE_FILL,
    DiagramBlock,
    TerminalSummary,
    draw_arrow,
    draw_box,
    draw_label,
    file_hashes,
    legend_below,
    new_diagram,
    origin_section,
    page_text,
    picture,
    verdict_note,
    write_page,
)
from anhyst_rigs.reports.study.task import SimulationTask
from anhyst_rigs.rig.force.file import ForceControlRig
from anhyst_rigs.rig.force.programs import read_rig_loops
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.rig.recording import peak_deviation
from anhyst_rigs.study.benefit import Benefit
from anhyst_rigs.study.force_control import ForceControl, force_control
from anhyst_rigs.study.force_trials import (
    CONTROLLER_TITLES,
    STAGE_TITLES,
    ForceOutcome,
    stage_key,
    worst_errors,
)


@use_report_style
def figure_hardware(rig: ForceControlRig, board: str) -> Figure:
    """Draw a block diagram of the hardware: PC, controller, amplifier, actuator and sensors."""
    settings = rig.settings
    amplifier, force_sensor = settings.amplifier, settings.force_sensor
    gap = settings.gap_sensor
    actuator, turn_count = rig.actuator_name_and_turns
    held_gaps = settings.held_case.gaps_m
    left_x, middle_x, right_x, upper_y, lower_y = 1.3, 4.8, 8.3, 3.2, 1.2
    boxes = {
        (left_x, upper_y): ("PC", "demands, recording"),
        (middle_x, upper_y): (
            "embedded controller",
            f"board {board}, {settings.timing.rate_Hz:g} ticks/s",
            "fixed point, one tick of delay",
        ),
        (right_x, upper_y): (
            "current amplifier",
            f"0 to {amplifier.current_high_A:g} A, {amplifier.dac_bits} bits",
            f"{amplifier.bandwidth_Hz:g} Hz, {amplifier.slew_A_per_s:g} A/s",
        ),
        (right_x, lower_y): (
            actuator,
            f"{turn_count} turns, {settings.force.force_max_N:g} N",
            f"gap {1e3 * min(held_gaps):g} to {1e3 * max(held_gaps):g} mm",
        ),
        (middle_x, lower_y): (
            gap.kind,
            f"{1e6 * gap.resolution:.3g} um steps over {1e3 * (gap.high_m - gap.low_m):g} mm",
            f"{1e6 * gap.noise_m:g} um rms, {gap.bandwidth_Hz:g} Hz",
        ),
        (left_x, lower_y): (
            "force sensor",
            f"{force_sensor.adc_bits} bits over {force_sensor.high_N - force_sensor.low_N:g} N",
            f"{force_sensor.noise_N:g} N rms, {force_sensor.bandwidth_Hz:g} Hz",
        ),
    }
    figure, ax = new_diagram(9.6, 4.1)
    for centre, (title, *lines) in boxes.items():
        fill = SOFTWARE_FILL if centre == (middle_x, upper_y) else PLANT_FILL
        draw_box(ax, centre, title.replace(" ", "-"), DiagramBlock(title, tuple(lines)), fill)
    half_width, half_height = 0.5 * BOX_WIDTH_IN, 0.5 * BOX_HEIGHT_IN
    box_edges = (left_x + half_width, middle_x - half_width, middle_x + half_width, right_x - half_width)
    draw_arrow(ax, [(box_edges[0], upper_y), (box_edges[1], upper_y)], arrowstyle="<|-|>")
    draw_arrow(ax, [(box_edges[2], upper_y), (box_edges[3], upper_y)])
    draw_arrow(ax, [(right_x, upper_y - half_height), (right_x, lower_y + half_height)])
    draw_arrow(ax, [(box_edges[3], lower_y), (box_edges[2], lower_y)], FALLING_COLOUR)
    draw_arrow(ax, [(middle_x, lower_y + half_height), (middle_x, upper_y - half_height)])
    box_corner = (
        (left_x + 0.7 * half_width, lower_y + half_height),
        (middle_x - 0.7 * half_width, upper_y - half_height),
    )
    draw_arrow(ax, box_corner, linestyle=(0, (4, 2)))
    box_bottom = lower_y - half_height
    draw_arrow(
        ax, [(right_x, box_bottom), (right_x, 0.2), (left_x, 0.2), (left_x, box_bottom)], FALLING_COLOUR
    )
    for x, y, text in (
        (0.5 * (box_edges[0] + box_edges[1]), upper_y + 0.08, "serial link\nforce out, status back"),
        (0.5 * (box_edges[2] + box_edges[3]), upper_y + 0.08, "current"),
        (0.5 * (box_edges[2] + box_edges[3]), lower_y + 0.08, "armature"),
        (0.5 * (left_x + middle_x) - 0.3, 0.5 * (upper_y + lower_y) + 0.05, "force"),
        (middle_x, 0.26, "force"),
    ):
        draw_label(ax, (x, y), text)
    return figure


DEMAND_COLOUR = "#C4C4C4"
SIMULATED_COLOUR = PALETTE["light blue"]
_DRAWN_ERRORS: Mapping[str, MethodName] = {
    "full": "full",
    "at-rest": "at-rest",
    "simplified": "simplified",
    "single": "single-valued",
}
"""Controllers whose errors are drawn if they ran: those with a model, and the single-valued curve.
"""
MAX_TITLE_LETTERS = 62
"""Largest number of letters of a line above a panel."""

MIN_THINNED_POINTS = 1500
"""Smallest number of points of a thinned curve, which has less than twice this number."""


CAPTIONS: Mapping[str, str] = {
    "fig7": "At the stroke's end: forces above, true force minus demand below.",
    "fig8": "At several positions of a fixed armature.",
    "moving": "With the armature moving over its stroke.",
    "fig6": "Hardware.",
}
"""Captions of the figures, in the order of the page."""


def simulate(task: SimulationTask) -> ForceControl:
    """Run the firmware in this process with the demands of a rig."""
    if not task.writes_files:
        raise InputError("force control: needs an output folder", code="missing", key="--out")
    return run_firmware(task, "library")


def run_firmware(task: SimulationTask, board: str) -> ForceControl:
    """Run the firmware on a board with the demands of a rig."""
    controlled = force_control(task.rig, task.out, board=board, progress=task.progress)
    draw_all(controlled)
    return controlled


def map_benefit(rig: ForceControlRig, task: SimulationTask) -> tuple[Benefit, str]:
    """Return the benefit map of an actuator with other irons, and the page with this map."""
    return map_plants(complete_rig(rig, read_rig_loops(rig)), task)


def written_files(result: ForceControl, _: Path | None = None) -> str:
    """Return a text that names the files that were written."""
    return (
        f"{result.out}: report.html, figures.json, fig6 to fig8, moving (PNG and SVG), one "
        "recording of each trial"
    )


def terminal_summary(result: ForceControl) -> TerminalSummary:
    """Return the terminal output of force control."""
    figures = result.figures
    agreement = (
        f"firmware on {figures['board']} against the simulated program: "
        f"{figures['ticks_that_differ']} of {figures['firmware_ticks']} ticks differ"
    )
    return TerminalSummary([comparison_table(result)], [*result.plant.report_lines, agreement])


def draw_all(result: ForceControl, verification_tables: Sequence[PageTable] = ()) -> None:
    """Write all figures as PNG and SVG into the folder of a run, and a page that contains them."""
    stages: dict[str, list[ForceOutcome]] = {}
    for outcome in result.outcomes:
        stages.setdefault(outcome.trial.trial_stage, []).append(outcome)
    rig = result.rig
    pages = {
        "fig6": figure_hardware(rig, str(result.figures["board"])),
        "fig7": figure_constant_gap(rig, stages["end"]),
        "fig8": figure_positions(rig, stages["positions"]),
        "moving": figure_moving(rig, stages["moving"]),
    }
    for name, figure in pages.items():
        write_png(figure, result.out / f"{name}.png")
        write_svg(figure, result.out / f"{name}.svg")
    answer, *pictures = (picture(pages[name], name, text, text) for name, text in CAPTIONS.items())
    compiled = Text(
        "C of the models, with its manifest: end/full/controller and stroke/full/controller; "
        f"{result.figures['ticks_that_differ']} of {result.figures['firmware_ticks']} ticks of the "
        "firmware differ from the simulated program."
    )
    sections = [
        Section("forces", "Forces", tuple(pictures)),
        Section("controller", "Controller", (compiled, *verification_tables)),
        origin_section(file_hashes([rig.path, *rig.measured_loops.files])),
    ]
    text = page_text("Force control", _headline(result, answer, bool(verification_tables)), sections)
    write_page(result.out / REPORT_NAME, text)


def _headline(result: ForceControl, answer: Picture, has_verification: bool) -> Headline:
    rig, figures = result.rig, result.figures
    verdict, notes = verdict_note(result.verdict), []
    if result.lost_in:
        verdict = Note("bad", "Force lost", f"{'; '.join(result.lost_in)}.")
    if has_verification:
        notes.append(
            Note("good", "C verified", "The same bits on all targets that ran; see the tables below.")
        )
    return Headline(
        title=rig.settings.name,
        description="The force of a magnet, controlled open loop by firmware that was compiled from "
        "models of its loops, compared with simpler controllers.",
        basis=f"Simulated, seed {rig.settings.seed}: a virtual magnet, amplifier and sensors; "
        f"firmware on {figures['board']}, {figures['rate_Hz']:g} ticks a second. "
        + "; ".join(result.plant.report_lines)
        + ".",
        verdict=verdict,
        notes=tuple(notes),
        tiles=_error_tiles(result),
        picture=answer,
        comparison=comparison_table(result),
        validity="Errors of the true force after the lead-in, which only a simulation knows. They "
        "include the delay of one tick and the lag of the amplifier.",
    )


def _error_tiles(result: ForceControl) -> tuple[Tile, ...]:
    """Return the largest errors for the fastest demand with a fixed armature."""
    demands = {outcome.trial.demand.name: outcome.trial.demand for outcome in result.outcomes}
    fastest_demand = max(demands, key=lambda name: np.abs(np.diff(demands[name].force)).max())
    fixed_trials = (
        trial
        for trial in result.figures["trials"]
        if trial["demand"] == fastest_demand and trial["stage"] != "moving"
    )
    errors = worst_errors(fixed_trials, lambda _: fastest_demand)[fastest_demand]
    detail = f"worst error for the demand “{fastest_demand}”, % of {result.figures['force_max_N']:g} N"
    return tuple(
        Tile(f"{format_number(errors[name]['worst_percent'], 2)}{NBSP}%", CONTROLLER_TITLES[name], detail)
        for name in ("full", "single", "ratio")
        if name in errors
    )


def comparison_table(result: ForceControl) -> PageTable:
    """Return the largest and the rms error of each controller, by group of trials and demand."""
    groups = worst_errors(
        result.figures["trials"], lambda trial: f"{STAGE_TITLES[stage_key(trial)]}, {trial['demand']}"
    )
    controllers = [name for name in CONTROLLER_TITLES if any(name in errors for errors in groups.values())]

    def cell(errors: Mapping[str, float] | None) -> str:
        return "{worst_percent:.2f} / {rms_percent:.2f}".format(**errors) if errors else ""

    rows = [[group, *(cell(errors.get(name)) for name in controllers)] for group, errors in groups.items()]
    title = f"Errors of the true force, worst / rms, % of {result.figures['force_max_N']:g} N"
    return make_table(title, ["", *(CONTROLLER_TITLES[name] for name in controllers)], rows)


@use_report_style
def figure_constant_gap(rig: ForceControlRig, outcomes: Sequence[ForceOutcome]) -> Figure:
    """Draw forces and errors at the end of the stroke: one column per demand (paper, Fig. 7)."""
    outcomes_with_unknown_history = [
        outcome for outcome in outcomes if outcome.trial.initial_state == "unknown"
    ]
    return _draw_columns(
        rig, outcomes_with_unknown_history, {"force (N)": 3.0, "true force - demand (N)": 2.0}, 6.0
    )


@use_report_style
def figure_moving(rig: ForceControlRig, outcomes: Sequence[ForceOutcome]) -> Figure:
    """Draw forces, errors and position with a moving armature: one column per demand."""
    rows = {"force (N)": 3.0, "true force - demand (N)": 2.0, "gap (mm)": 1.2}
    return _draw_columns(rig, outcomes, rows, 7.0)


def _draw_columns(
    rig: ForceControlRig, outcomes: Sequence[ForceOutcome], rows: Mapping[str, float], height: float
) -> Figure:
    """Draw forces and errors, and the gap if it has a row: one column per demand."""
    figure = new_figure(height, width=4.8 * len(outcomes))
    axes = figure.subplots(
        len(rows), len(outcomes), squeeze=False, sharex="col", height_ratios=[*rows.values()]
    )
    for column, outcome in zip(axes.T, outcomes, strict=True):
        _draw_forces(column[0], rig, outcome)
        _draw_deviations(column[1], rig, outcome)
        if "gap (mm)" in rows:
            time, gap = _thin_curve(rig, outcome, 1e3 * outcome.recordings["full"]["gap_m"])
            column[2].plot(time, gap, color=MEASURED_COLOUR, lw=1.0)
        column[0].set_title(f"{outcome.trial.demand.name}, {_position_text(outcome)}")
        column[-1].set_xlabel("time (s)")
    for ax, text in zip(axes[:, 0], rows, strict=True):
        ax.set_ylabel(text)
    legend_below(figure, axes[0, 0], axes[1, 0], columns=int(figure.get_figwidth() / 2.4))
    return figure


@use_report_style
def figure_positions(rig: ForceControlRig, outcomes: Sequence[ForceOutcome]) -> Figure:
    """Draw forces and errors at several positions: one row of each per demand.

    Fig. 8 of the paper shows only the forces, in which good compensation is not visible.
    """
    names = list(dict.fromkeys(outcome.trial.demand.name for outcome in outcomes))
    columns = max(sum(o.trial.demand.name == name for o in outcomes) for name in names)
    figure = new_figure(4.4 * len(names) + 0.8, width=max(9.6, 1.9 * columns))
    axes = figure.subplots(
        2 * len(names), columns, squeeze=False, sharey="row", height_ratios=(3, 2) * len(names)
    )
    for name, error_axes, errors in zip(names, axes[::2], axes[1::2], strict=True):
        group_outcomes = [outcome for outcome in outcomes if outcome.trial.demand.name == name]
        for ax, error_ax, outcome in zip(error_axes, errors, group_outcomes, strict=False):
            _draw_forces(ax, rig, outcome)
            ax.set_title(f"{_position_text(outcome)}\n{name}")
            ax.tick_params(labelbottom=False)
            _draw_deviations(error_ax, rig, outcome, title=False)
            worst_error = (
                f"{controller} {_worst_error_percent(rig, outcome, controller):.1f}"
                for controller in ("full", "single")
            )
            error_ax.set_title(f"{'; '.join(worst_error)} %", fontsize=8.0, weight="normal")
            error_ax.set_xlabel("time (s)")
        for empty_axes in (*error_axes[len(group_outcomes) :], *errors[len(group_outcomes) :]):
            empty_axes.remove()
        error_axes[0].set_ylabel("force (N)")
        errors[0].set_ylabel("true force - demand (N)")
    legend_below(figure, axes[0, 0], axes[1, 0], columns=int(figure.get_figwidth() / 2.4))
    return figure


def _draw_forces(ax: Axes, rig: ForceControlRig, outcome: ForceOutcome) -> None:
    """Draw demanded, measured and simulated force, and the force with the constant ratio."""
    curves = (
        ("demand", outcome.trial.demand.force, DEMAND_COLOUR, 4.0, "-"),
        ("constant ratio", outcome.recordings["ratio"]["force_read_N"], FALLING_COLOUR, 0.9, "-"),
        ("measured, full", outcome.recordings["full"]["force_read_N"], RISING_COLOUR, 1.4, "-"),
        ("simulated program, full", outcome.simulated_force["full"], SIMULATED_COLOUR, 0.8, (0, (4, 3))),
    )
    for label, force, colour, width, dashes in curves:
        ax.plot(*_thin_curve(rig, outcome, force), color=colour, lw=width, ls=dashes, label=label)


def _draw_deviations(ax: Axes, rig: ForceControlRig, outcome: ForceOutcome, *, title: bool = True) -> None:
    worst_errors = []
    for name in (controller for controller in _DRAWN_ERRORS if controller in outcome.recordings):
        deviation = outcome.recordings[name]["force_N"] - outcome.trial.demand.force
        deviation[: outcome.trial.demand.lead_in] = np.nan
        label = f"error, {CONTROLLER_TITLES[name]}"
        ax.plot(
            *_thin_curve(rig, outcome, deviation), color=COLOURS[_DRAWN_ERRORS[name]], lw=1.0, label=label
        )
        worst_errors.append(
            f"{CONTROLLER_TITLES[name]} {_worst_error_percent(rig, outcome, name):.2f}\N{NO-BREAK SPACE}%"
        )
    if title:
        text = textwrap.fill(f"worst: {'; '.join(worst_errors)}", MAX_TITLE_LETTERS)
        ax.set_title(text, fontsize=8.0, weight="normal")


def _worst_error_percent(rig: ForceControlRig, outcome: ForceOutcome, name: str) -> float:
    demand = outcome.trial.demand
    error = (outcome.recordings[name]["force_N"] - demand.force)[demand.lead_in :]
    return 100.0 * peak_deviation(error) / rig.settings.force.force_max_N


def _thin_curve(
    rig: ForceControlRig, outcome: ForceOutcome, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return time and values with no more points than a plot can show."""
    step = max(1, values.size // MIN_THINNED_POINTS)
    time = np.asarray((np.arange(values.size) - outcome.trial.demand.lead_in) * rig.dt, np.float64)
    return time[::step], values[::step]


def _position_text(outcome: ForceOutcome) -> str:
    position = outcome.trial.position
    return "armature moving" if position is None else f"gap {1e3 * position:.2f} mm"
