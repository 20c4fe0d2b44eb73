"""Figures and page of the paper's section III, from recordings, and its hardware structure."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from anhyst.support.errors import InputError
from anhyst.support.figures import (
    FALLING,
    MEASURED,
    RISING,
    new_figure,
    styled,
    write_png,
    write_svg,
)
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.page import Headline, Note, PageTable, Section, Text, Tile, number, table
from anhyst_rigs.reports.benefit import map_plants
from anhyst_rigs.reports.study.page import (
    COLOURS,
    HIGH,
    PLANT,
    REPORT,
    SOFTWARE,
    WIDE,
    DiagramBlock,
    Printed,
    draw_arrow,
    draw_box,
    draw_label,
    hashes,
    legend_below,
    new_diagram,
    origin,
    page_text,
    picture,
    verdict_note,
    write_page,
)
from anhyst_rigs.reports.study.task import SimulationTask
from anhyst_rigs.rig.force.file import Rig
from anhyst_rigs.rig.force.programs import loops_of_rig
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.rig.recording import peak
from anhyst_rigs.study.benefit import Benefit
from anhyst_rigs.study.force_control import ForceControl, force_control
from anhyst_rigs.study.force_trials import STAGES, TITLES, ForceOutcome, stage_of, worst_errors


@styled
def figure_hardware(rig: Rig, board: str) -> Figure:
    """Draw what is connected to what."""
    settings = rig.settings
    amplifier, force = settings.amplifier, settings.force_sensor
    gap = settings.gap_sensor
    actuator, turns = rig.actuator_text
    held = settings.held.gaps_m
    left, middle, right, above, below = 1.3, 4.8, 8.3, 3.2, 1.2
    boxes = {
        (left, above): ("PC", "demands, recording"),
        (middle, above): (
            "embedded controller",
            f"board {board}, {settings.timing.rate_Hz:g} ticks/s",
            "fixed point, one tick of delay",
        ),
        (right, above): (
            "current amplifier",
            f"0 to {amplifier.current_high_A:g} A, {amplifier.dac_bits} bits",
            f"{amplifier.bandwidth_Hz:g} Hz, {amplifier.slew_A_per_s:g} A/s",
        ),
        (right, below): (
            actuator,
            f"{turns} turns, {settings.force.force_max_N:g} N",
            f"gap {1e3 * min(held):g} to {1e3 * max(held):g} mm",
        ),
        (middle, below): (
            gap.kind,
            f"{1e6 * gap.step:.3g} um steps over {1e3 * (gap.high_m - gap.low_m):g} mm",
            f"{1e6 * gap.noise_m:g} um rms, {gap.bandwidth_Hz:g} Hz",
        ),
        (left, below): (
            "force sensor",
            f"{force.adc_bits} bits over {force.high_N - force.low_N:g} N",
            f"{force.noise_N:g} N rms, {force.bandwidth_Hz:g} Hz",
        ),
    }
    figure, ax = new_diagram(9.6, 4.1)
    for centre, (title, *lines) in boxes.items():
        fill = SOFTWARE if centre == (middle, above) else PLANT
        draw_box(ax, centre, title.replace(" ", "-"), DiagramBlock(title, tuple(lines)), fill)
    half, lid = 0.5 * WIDE, 0.5 * HIGH
    inner = (left + half, middle - half, middle + half, right - half)
    draw_arrow(ax, [(inner[0], above), (inner[1], above)], arrowstyle="<|-|>")
    draw_arrow(ax, [(inner[2], above), (inner[3], above)])
    draw_arrow(ax, [(right, above - lid), (right, below + lid)])
    draw_arrow(ax, [(inner[3], below), (inner[2], below)], FALLING)
    draw_arrow(ax, [(middle, below + lid), (middle, above - lid)])
    corner = (left + 0.7 * half, below + lid), (middle - 0.7 * half, above - lid)
    draw_arrow(ax, corner, linestyle=(0, (4, 2)))
    floor = below - lid
    draw_arrow(ax, [(right, floor), (right, 0.2), (left, 0.2), (left, floor)], FALLING)
    for x, y, text in (
        (0.5 * (inner[0] + inner[1]), above + 0.08, "serial link\nforce out, status back"),
        (0.5 * (inner[2] + inner[3]), above + 0.08, "current"),
        (0.5 * (inner[2] + inner[3]), below + 0.08, "armature"),
        (0.5 * (left + middle) - 0.3, 0.5 * (above + below) + 0.05, "force"),
        (middle, 0.26, "force"),
    ):
        draw_label(ax, (x, y), text)
    return figure


DEMAND = "#C4C4C4"
SIMULATED = "#F0E442"
_COMPARED: Mapping[str, MethodName] = {
    "full": "full",
    "at-rest": "at-rest",
    "simplified": "simplified",
    "single": "single-valued",
}
"""Whose errors are drawn, where they are: the models, and the strongest curve without memory."""
TITLE_LETTERS = 62
"""Of a line above a panel."""

MOST_POINTS = 1500
"""Points of a curve in a figure at most."""


CAPTIONS: Mapping[str, str] = {
    "fig7": "At the stroke's end: forces above, true force less demand below.",
    "fig8": "At a row of positions, the armature held.",
    "moving": "The armature moving over its stroke.",
    "fig6": "What is connected to what.",
}
"""What the figures of the page show, in its order."""


def simulate(task: SimulationTask) -> ForceControl:
    """Command forces to the firmware, which runs in this process."""
    if not task.written:
        raise InputError("force control: needs a place to write to", code="missing", key="--out")
    return run_firmware(task, "library")


def run_firmware(task: SimulationTask, board: str) -> ForceControl:
    """Command forces to the firmware on a board."""
    controlled = force_control(task.rig, task.out, board=board, progress=task.progress)
    draw(controlled)
    return controlled


def map_benefit(rig: Rig, task: SimulationTask) -> tuple[Benefit, str]:
    """Return what compensation gains on other irons of an actuator, and its page."""
    return map_plants(complete_rig(rig, loops_of_rig(rig)), task)


def written(result: ForceControl, _: Path | None = None) -> str:
    """Say what was written."""
    return (
        f"{result.out}: report.html, figures.json, fig6 to fig8, moving (PNG and SVG), one "
        "recording of each trial"
    )


def printed(result: ForceControl) -> Printed:
    """Return what a terminal shows of force control."""
    figures = result.figures
    same = (
        f"firmware on {figures['board']} against the simulated program: "
        f"{figures['ticks_that_differ']} of {figures['firmware_ticks']} ticks differ"
    )
    return Printed([comparison(result)], [*result.plant.lines, same])


def draw(result: ForceControl, verified: Sequence[PageTable] = ()) -> None:
    """Draw every figure as PNG and SVG into the folder of a run, and the page with all of them."""
    stages: dict[str, list[ForceOutcome]] = {}
    for outcome in result.outcomes:
        stages.setdefault(outcome.trial.stage, []).append(outcome)
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
    pictures = [picture(pages[name], name, text, text) for name, text in CAPTIONS.items()]
    compiled = Text(
        "C of the models, with its manifest: end/full/controller and stroke/full/controller; "
        f"{result.figures['ticks_that_differ']} of {result.figures['firmware_ticks']} ticks of the "
        "firmware differ from the simulated program."
    )
    sections = [
        Section("forces", "Forces", tuple(pictures)),
        Section("controller", "Controller", (compiled, *verified)),
        origin(hashes([rig.path, *rig.measured.files])),
    ]
    text = page_text("Force control", _headline(result, bool(verified)), sections)
    write_page(result.out / REPORT, text)


def _headline(result: ForceControl, verified: bool) -> Headline:
    rig, figures = result.rig, result.figures
    lost = [Note("bad", "Force lost", f"{'; '.join(result.lost_in)}.")]
    notes = lost if result.lost_in else [verdict_note(result.verdict)]
    if verified:
        notes.append(Note("good", "C verified", "The same bits wherever it ran; tables below."))
    return Headline(
        title=rig.settings.name,
        what="The force of a magnet, controlled open loop by firmware that was compiled from "
        "models of its loops; beside it what knows less.",
        basis=f"Simulated, seed {rig.settings.seed}: a virtual magnet, amplifier and sensors; "
        f"firmware on {figures['board']}, {figures['rate_Hz']:g} ticks a second. "
        + "; ".join(result.plant.lines)
        + ".",
        notes=tuple(notes),
        tiles=_tiles(result),
        comparison=comparison(result),
        holds="Errors of the true force after the lead-in, which a simulation alone knows; the tick "
        "of delay and the lag of the amplifier are in them.",
    )


def _tiles(result: ForceControl) -> tuple[Tile, ...]:
    """Return the worst errors of the fastest demand while the armature is held."""
    demands = {outcome.trial.demand.name: outcome.trial.demand for outcome in result.outcomes}
    fastest = max(demands, key=lambda name: np.abs(np.diff(demands[name].force)).max())
    held = (
        trial
        for trial in result.figures["trials"]
        if trial["demand"] == fastest and trial["stage"] != "moving"
    )
    errors = worst_errors(held, lambda _: fastest)[fastest]
    detail = f"worst error, {fastest}, held, % of {result.figures['force_max_N']:g} N"
    return tuple(
        Tile(number(errors[name]["worst_percent"], 2), TITLES[name], detail)
        for name in _COMPARED
        if name in errors
    )


def comparison(result: ForceControl) -> PageTable:
    """Return worst and rms errors of every controller, by group of trials and demand."""
    groups = worst_errors(
        result.figures["trials"], lambda trial: f"{STAGES[stage_of(trial)]}, {trial['demand']}"
    )
    shown = [name for name in TITLES if any(name in errors for errors in groups.values())]

    def cell(errors: Mapping[str, float] | None) -> str:
        return "{worst_percent:.2f} / {rms_percent:.2f}".format(**errors) if errors else ""

    rows = [
        [group, *(cell(errors.get(name)) for name in shown)] for group, errors in groups.items()
    ]
    title = f"Errors of the true force, worst / rms, % of {result.figures['force_max_N']:g} N"
    return table(title, ["", *(TITLES[name] for name in shown)], rows)


@styled
def figure_constant_gap(rig: Rig, outcomes: Sequence[ForceOutcome]) -> Figure:
    """Draw forces and errors at the stroke's end, one column a demand (the paper's Fig. 7)."""
    shown = [outcome for outcome in outcomes if outcome.trial.start == "unknown"]
    return _columns(rig, shown, {"force (N)": 3.0, "true force - demand (N)": 2.0}, 6.0)


@styled
def figure_moving(rig: Rig, outcomes: Sequence[ForceOutcome]) -> Figure:
    """Draw forces, errors and position with the armature moving, one column a demand."""
    rows = {"force (N)": 3.0, "true force - demand (N)": 2.0, "gap (mm)": 1.2}
    return _columns(rig, outcomes, rows, 7.0)


def _columns(
    rig: Rig, outcomes: Sequence[ForceOutcome], rows: Mapping[str, float], height: float
) -> Figure:
    """Draw forces and errors, and the gap where that has a row, one column a demand."""
    figure = new_figure(height, width=4.8 * len(outcomes))
    axes = figure.subplots(
        len(rows), len(outcomes), squeeze=False, sharex="col", height_ratios=[*rows.values()]
    )
    for column, outcome in zip(axes.T, outcomes, strict=True):
        _forces(column[0], rig, outcome)
        _deviations(column[1], rig, outcome)
        if "gap (mm)" in rows:
            time, gap = _curve(rig, outcome, 1e3 * outcome.recordings["full"]["gap_m"])
            column[2].plot(time, gap, color=MEASURED, lw=1.0)
        column[0].set_title(f"{outcome.trial.demand.name}, {_place(outcome)}")
        column[-1].set_xlabel("time (s)")
    for ax, text in zip(axes[:, 0], rows, strict=True):
        ax.set_ylabel(text)
    legend_below(figure, axes[0, 0], axes[1, 0], columns=int(figure.get_figwidth() / 2.4))
    return figure


@styled
def figure_positions(rig: Rig, outcomes: Sequence[ForceOutcome]) -> Figure:
    """Draw the same at a row of positions: for each demand a row of forces and one of errors.

    The paper's Fig. 8 has the forces alone, under which good compensation cannot be seen.
    """
    names = list(dict.fromkeys(outcome.trial.demand.name for outcome in outcomes))
    columns = max(sum(o.trial.demand.name == name for o in outcomes) for name in names)
    figure = new_figure(4.4 * len(names) + 0.8, width=max(9.6, 1.9 * columns))
    axes = figure.subplots(
        2 * len(names), columns, squeeze=False, sharey="row", height_ratios=(3, 2) * len(names)
    )
    for name, row, errors in zip(names, axes[::2], axes[1::2], strict=True):
        members = [outcome for outcome in outcomes if outcome.trial.demand.name == name]
        for ax, below, outcome in zip(row, errors, members, strict=False):
            _forces(ax, rig, outcome)
            ax.set_title(f"{_place(outcome)}\n{name}")
            ax.tick_params(labelbottom=False)
            _deviations(below, rig, outcome, title=False)
            worst = (f"{one} {_worst(rig, outcome, one):.1f}" for one in ("full", "single"))
            below.set_title(f"{'; '.join(worst)} %", fontsize=8.0, weight="normal")
            below.set_xlabel("time (s)")
        for empty in (*row[len(members) :], *errors[len(members) :]):
            empty.remove()
        row[0].set_ylabel("force (N)")
        errors[0].set_ylabel("true force - demand (N)")
    legend_below(figure, axes[0, 0], axes[1, 0], columns=int(figure.get_figwidth() / 2.4))
    return figure


def _forces(ax: Axes, rig: Rig, outcome: ForceOutcome) -> None:
    """Draw the demand (pale, below), what was measured, the simulated program, the constant ratio."""
    curves = (
        ("demand", outcome.trial.demand.force, DEMAND, 4.0, "-"),
        ("constant ratio", outcome.recordings["ratio"]["force_read_N"], FALLING, 0.9, "-"),
        ("measured, full", outcome.recordings["full"]["force_read_N"], RISING, 1.4, "-"),
        ("simulated program, full", outcome.simulated["full"], SIMULATED, 0.8, (0, (4, 3))),
    )
    for label, force, colour, width, dashes in curves:
        ax.plot(*_curve(rig, outcome, force), color=colour, lw=width, ls=dashes, label=label)


def _deviations(ax: Axes, rig: Rig, outcome: ForceOutcome, *, title: bool = True) -> None:
    worst = []
    for name in (one for one in _COMPARED if one in outcome.recordings):
        deviation = outcome.recordings[name]["force_N"] - outcome.trial.demand.force
        deviation[: outcome.trial.demand.lead_in] = np.nan
        label = f"error, {TITLES[name]}"
        ax.plot(
            *_curve(rig, outcome, deviation),
            color=COLOURS[_COMPARED[name]],
            lw=1.0,
            label=label,
        )
        worst.append(f"{TITLES[name]} {_worst(rig, outcome, name):.2f}\N{NO-BREAK SPACE}%")
    if title:
        text = textwrap.fill(f"worst: {'; '.join(worst)}", TITLE_LETTERS)
        ax.set_title(text, fontsize=8.0, weight="normal")


def _worst(rig: Rig, outcome: ForceOutcome, name: str) -> float:
    demand = outcome.trial.demand
    off = (outcome.recordings[name]["force_N"] - demand.force)[demand.lead_in :]
    return 100.0 * peak(off) / rig.settings.force.force_max_N


def _curve(rig: Rig, outcome: ForceOutcome, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Time and values, no more of them than a figure can show."""
    every = max(1, values.size // MOST_POINTS)
    time = np.asarray((np.arange(values.size) - outcome.trial.demand.lead_in) * rig.dt, np.float64)
    return time[::every], values[::every]


def _place(outcome: ForceOutcome) -> str:
    position = outcome.trial.position
    return "armature moving" if position is None else f"gap {1e3 * position:.2f} mm"
