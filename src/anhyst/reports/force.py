"""Figures and page of the paper's section III, from recordings, and its hardware structure."""

from __future__ import annotations

import hashlib
import io
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from anhyst.reports.bearing.look import verdict_note
from anhyst.rig.force.file import Rig
from anhyst.study.engine.verdict import Judgement
from anhyst.study.force.force_control import ForceControl
from anhyst.study.force.trials import STAGES, TITLES, ForceOutcome
from anhyst.support.atomic import atomic_writer, write_bytes
from anhyst.support.figures import (
    FALLING,
    MEASURED,
    RISING,
    new_figure,
    styled,
    svg_text,
    write_png,
)
from anhyst.support.numeric import FloatArray
from anhyst.support.page import (
    Headline,
    Note,
    PageTable,
    Picture,
    Section,
    Text,
    Tile,
    number,
    render_page,
    table,
)
from anhyst.support.version import running_version

_WIDE, _HIGH = 2.5, 1.15
_INK = "#333333"
_FILL = "#F4F6F8"

_Place = tuple[float, float]


@styled
def figure_hardware(rig: Rig, board: str) -> Figure:
    """Draw what is connected to what."""
    settings = rig.settings
    amplifier, force = settings.amplifier, settings.force_sensor
    gap = settings.gap_sensor.sensor()
    figure = new_figure(3.9)
    ax = figure.add_subplot()
    ax.set_axis_off()
    ax.grid(visible=False)
    actuator, turns = rig.actuator_text
    boxes: dict[str, tuple[_Place, str, str]] = {
        "pc": ((0.0, 2.0), "PC", "demands, recording"),
        "controller": (
            (4.0, 2.0),
            "embedded controller",
            f"board {board}, {settings.timing.rate_Hz:g} ticks/s\nfixed point, one tick of delay",
        ),
        "amplifier": (
            (8.0, 2.0),
            "current amplifier",
            f"0 to {amplifier.current_high_A:g} A, {amplifier.dac_bits} bits\n"
            f"{amplifier.bandwidth_Hz:g} Hz, {amplifier.slew_A_per_s:g} A/s",
        ),
        "solenoid": (
            (8.0, 0.0),
            actuator,
            f"{turns} turns, {settings.force.force_max_N:g} N\ngap {_stroke(rig)} mm",
        ),
        "lvdt": (
            (4.0, 0.0),
            settings.gap_sensor.kind,
            f"{1e6 * gap.step:.3g} um steps over {1e3 * (gap.high - gap.low):g} mm\n"
            f"{1e6 * gap.noise:g} um rms, {gap.bandwidth:g} Hz",
        ),
        "force": (
            (0.0, 0.0),
            "force sensor",
            f"{force.adc_bits} bits over {force.high_N - force.low_N:g} N\n"
            f"{force.noise_N:g} N rms, {force.bandwidth_Hz:g} Hz",
        ),
    }
    for spot, title, text in boxes.values():
        _box(ax, spot, title, text)
    centre = {name: spot for name, (spot, _, _) in boxes.items()}
    _arrow(ax, centre["pc"], centre["controller"], "serial link\nforce out, status back", both=True)
    _arrow(ax, centre["controller"], centre["amplifier"], "current")
    _arrow(ax, centre["amplifier"], centre["solenoid"], "")
    _arrow(ax, centre["solenoid"], centre["lvdt"], "armature", colour=FALLING)
    _arrow(ax, centre["lvdt"], centre["controller"], "")
    _arrow(ax, centre["force"], centre["controller"], "force", dashed=True)
    _around(ax, centre["solenoid"], centre["force"])
    ax.set_xlim(-1.4, 9.4)
    ax.set_ylim(-1.35, 2.75)
    return figure


def _stroke(rig: Rig) -> str:
    positions = rig.settings.held.gaps_m
    return f"{1e3 * min(positions):g} to {1e3 * max(positions):g}"


def _box(ax: Axes, centre: _Place, title: str, text: str) -> None:
    x, y = centre
    corner = (x - 0.5 * _WIDE, y - 0.5 * _HIGH)
    shape = FancyBboxPatch(
        corner, _WIDE, _HIGH, boxstyle="round,pad=0,rounding_size=0.08", fc=_FILL, ec=_INK, lw=0.9
    )
    ax.add_patch(shape)
    ax.text(x, y + 0.36, title, ha="center", va="center", weight="bold", fontsize=8.5)
    ax.text(x, y - 0.14, text, ha="center", va="center", fontsize=7.5)


def _arrow(
    ax: Axes,
    begin: _Place,
    end: _Place,
    text: str,
    *,
    both: bool = False,
    dashed: bool = False,
    colour: str = RISING,
) -> None:
    """From the rim of one box to that of another, straight along a row, a column or a diagonal."""
    (x0, y0), (x1, y1) = begin, end
    across, up = x1 - x0, y1 - y0
    tail = (x0 + 0.5 * _WIDE * _sign(across), y0 + 0.5 * _HIGH * (_sign(up) if not across else 0))
    head = (x1 - 0.5 * _WIDE * _sign(across), y1 - 0.5 * _HIGH * (_sign(up) if not across else 0))
    if across and up:
        tail, head = (x0 + 0.3 * _WIDE, y0 + 0.5 * _HIGH), (x1 - 0.3 * _WIDE, y1 - 0.5 * _HIGH)
    style: dict[str, Any] = {"arrowstyle": "<|-|>" if both else "-|>", "color": colour, "lw": 1.3}
    if dashed:
        style["linestyle"] = (0, (4, 2))
    ax.annotate("", head, tail, arrowprops=style)
    middle = (0.5 * (tail[0] + head[0]), 0.5 * (tail[1] + head[1]))
    ax.text(middle[0], middle[1] + 0.1, text, ha="center", va="bottom", fontsize=7.5)


def _around(ax: Axes, begin: _Place, end: _Place) -> None:
    """Below the boxes, from one to the other: what the armature pulls at."""
    (x0, y0), (x1, y1) = begin, end
    low = y0 - 0.5 * _HIGH - 0.45
    ax.plot([x0, x0, x1], [y0 - 0.5 * _HIGH, low, low], color=FALLING, lw=1.3)
    style = {"arrowstyle": "-|>", "color": FALLING, "lw": 1.3}
    ax.annotate("", (x1, y1 - 0.5 * _HIGH), (x1, low), arrowprops=style)
    ax.text(0.5 * (x0 + x1), low + 0.06, "force", ha="center", va="bottom", fontsize=7.5)


def _sign(value: float) -> float:
    return float((value > 0.0) - (value < 0.0))


DEMAND = "#C4C4C4"
AT_REST = "#8C8C8C"
SIMPLIFIED = "#009E73"
SINGLE = "#CC79A7"
SIMULATED = "#F0E442"
COLOURS: Mapping[str, str] = {
    "full": RISING,
    "at-rest": AT_REST,
    "simplified": SIMPLIFIED,
    "single": SINGLE,
    "ratio": FALLING,
}
_COMPARED = ("full", "at-rest", "simplified", "single")
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
        _write_svg(figure, result.out / f"{name}.svg")
    pictures = [Picture(svg_text(pages[name], name), text, text) for name, text in CAPTIONS.items()]
    compiled = Text(
        "C of the models, with its manifest: end/full/controller and stroke/full/controller; "
        f"{result.figures['ticks_that_differ']} of {result.figures['firmware_ticks']} ticks of the "
        "firmware differ from the simulated program."
    )
    inputs = (rig.path, *rig.measured.files)
    files = [(path.name, hashlib.sha256(path.read_bytes()).hexdigest()) for path in inputs]
    text = render_page(
        _headline(result, bool(verified)),
        [
            Section("forces", "Forces", tuple(pictures)),
            Section("controller", "Controller", (compiled, *verified)),
            Section("origin", "Origin", (table("Files", ["file", "SHA-256"], files, texts=2),)),
        ],
        running_version(),
        kind="Force control",
        source="a simulation",
    )
    with atomic_writer(result.out / "report.html") as stream:
        stream.write(text)


def _headline(result: ForceControl, verified: bool) -> Headline:
    rig, figures = result.rig, result.figures
    verdict = figures["verdict"]
    notes = [
        verdict_note(Judgement(verdict["level"], verdict["text"]))
        if verdict
        else Note("bad", "Force lost", f"{'; '.join(result.lost_in)}.")
    ]
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
        comparison=_comparison(result),
        holds="Errors of the true force after the lead-in, which a simulation alone knows; the tick "
        "of delay and the lag of the amplifier are in them.",
    )


def _tiles(result: ForceControl) -> tuple[Tile, ...]:
    """Return the worst errors of the fastest demand while the armature is held."""
    demands = {outcome.trial.demand.name: outcome.trial.demand for outcome in result.outcomes}
    fastest = max(demands, key=lambda name: np.abs(np.diff(demands[name].force)).max())
    worst: dict[str, float] = {}
    for trial in result.figures["trials"]:
        if trial["demand"] == fastest and trial["stage"] != "moving":
            for name, figures in trial["controllers"].items():
                worst[name] = max(worst.get(name, 0.0), figures["true"]["worst_percent"])
    detail = f"worst error, {fastest}, held, % of {result.figures['force_max_N']:g} N"
    return tuple(
        Tile(number(worst[figures], 2), TITLES[figures], detail)
        for figures in _COMPARED
        if figures in worst
    )


def _comparison(result: ForceControl) -> PageTable:
    """Return worst and rms errors of every controller, by group of trials and demand."""
    groups: dict[tuple[str, str], dict[str, tuple[float, float]]] = {}
    for trial in result.figures["trials"]:
        past = "_demagnetised" if trial["start"] == "demagnetised" else ""
        errors = groups.setdefault((trial["stage"] + past, trial["demand"]), {})
        for name, figures in trial["controllers"].items():
            before = errors.get(name, (0.0, 0.0))
            new = figures["true"]["worst_percent"], figures["true"]["rms_percent"]
            errors[name] = max(before[0], new[0]), max(before[1], new[1])
    shown = [name for name in TITLES if any(name in errors for errors in groups.values())]
    rows = [
        [f"{STAGES[stage]}, {demand}"]
        + [
            "{:.2f} / {:.2f}".format(*errors[figures]) if figures in errors else ""
            for figures in shown
        ]
        for (stage, demand), errors in groups.items()
    ]
    title = f"Errors of the true force, worst / rms, % of {result.figures['force_max_N']:g} N"
    return table(title, ["", *(TITLES[figures] for figures in shown)], rows)


@styled
def _write_svg(figure: Figure, path: Path) -> None:
    stream = io.BytesIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    write_bytes(path, stream.getvalue())


@styled
def figure_constant_gap(rig: Rig, outcomes: Sequence[ForceOutcome]) -> Figure:
    """Draw forces and errors at the stroke's end, one column a demand (the paper's Fig. 7)."""
    shown = [outcome for outcome in outcomes if outcome.trial.start == "unknown"]
    figure = new_figure(6.0, width=4.8 * len(shown))
    axes = figure.subplots(2, len(shown), squeeze=False, sharex="col", height_ratios=(3, 2))
    for (above, below), outcome in zip(axes.T, shown, strict=True):
        _forces(above, rig, outcome)
        _deviations(below, rig, outcome, _COMPARED)
        above.set_title(f"{outcome.trial.demand.name}, {_place(outcome)}")
        below.set_xlabel("time (s)")
    axes[0, 0].set_ylabel("force (N)")
    axes[1, 0].set_ylabel("true force - demand (N)")
    _legend(figure, axes[0, 0], axes[1, 0])
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
            _deviations(below, rig, outcome, _COMPARED, title=False)
            worst = (f"{one} {_worst(rig, outcome, one):.1f}" for one in ("full", "single"))
            below.set_title(f"{'; '.join(worst)} %", fontsize=8.0, weight="normal")
            below.set_xlabel("time (s)")
        for empty in (*row[len(members) :], *errors[len(members) :]):
            empty.remove()
        row[0].set_ylabel("force (N)")
        errors[0].set_ylabel("true force - demand (N)")
    _legend(figure, axes[0, 0], axes[1, 0])
    return figure


@styled
def figure_moving(rig: Rig, outcomes: Sequence[ForceOutcome]) -> Figure:
    """Draw forces, errors and position with the armature moving, one column a demand."""
    figure = new_figure(7.0, width=4.8 * len(outcomes))
    axes = figure.subplots(3, len(outcomes), squeeze=False, sharex="col", height_ratios=(3, 2, 1.2))
    for (above, middle, below), outcome in zip(axes.T, outcomes, strict=True):
        _forces(above, rig, outcome)
        _deviations(middle, rig, outcome, _COMPARED)
        time, gap = _curve(rig, outcome, 1e3 * outcome.recordings["full"]["gap_m"])
        below.plot(time, gap, color=MEASURED, lw=1.0)
        above.set_title(f"{outcome.trial.demand.name}, armature moving")
        below.set_xlabel("time (s)")
    for ax, text in zip(
        axes[:, 0], ("force (N)", "true force - demand (N)", "gap (mm)"), strict=True
    ):
        ax.set_ylabel(text)
    _legend(figure, axes[0, 0], axes[1, 0])
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


def _deviations(
    ax: Axes, rig: Rig, outcome: ForceOutcome, names: Sequence[str], *, title: bool = True
) -> None:
    worst = []
    for name in (one for one in names if one in outcome.recordings):
        deviation = outcome.recordings[name]["force_N"] - outcome.trial.demand.force
        deviation[: outcome.trial.demand.lead_in] = np.nan
        label = f"error, {TITLES[name]}"
        ax.plot(*_curve(rig, outcome, deviation), color=COLOURS[name], lw=1.0, label=label)
        worst.append(f"{TITLES[name]} {_worst(rig, outcome, name):.2f}\N{NO-BREAK SPACE}%")
    if title:
        text = textwrap.fill(f"worst: {'; '.join(worst)}", TITLE_LETTERS)
        ax.set_title(text, fontsize=8.0, weight="normal")


def _worst(rig: Rig, outcome: ForceOutcome, name: str) -> float:
    deviation = outcome.recordings[name]["force_N"] - outcome.trial.demand.force
    largest = np.abs(deviation[outcome.trial.demand.lead_in :]).max()
    return float(100.0 * largest / rig.settings.force.force_max_N)


def _curve(rig: Rig, outcome: ForceOutcome, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Time and values, no more of them than a figure can show."""
    every = max(1, values.size // MOST_POINTS)
    time = np.asarray((np.arange(values.size) - outcome.trial.demand.lead_in) * rig.dt, np.float64)
    return time[::every], values[::every]


def _place(outcome: ForceOutcome) -> str:
    position = outcome.trial.position
    return "" if position is None else f"gap {1e3 * position:.2f} mm"


def _legend(figure: Figure, *axes: Axes) -> None:
    handles, labels = [], []
    for ax in axes:
        more = ax.get_legend_handles_labels()
        handles += more[0]
        labels += more[1]
    figure.legend(
        handles, labels, loc="outside lower center", ncols=int(figure.get_figwidth() / 2.4)
    )
