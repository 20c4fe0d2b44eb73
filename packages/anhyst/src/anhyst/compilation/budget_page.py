"""Write the accuracy budget of a compensator, and the choices of its plan, as an HTML page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from anhyst.compensate.budget import Budget, percent
from anhyst.compensate.measure import BudgetPart, PathRun
from anhyst.compensate.output_drift import HOLD_TIME_S
from anhyst.compensate.plan import Decision, Plan
from anhyst.support.figures import ALARM_COLOUR, FIGURE_WIDTH_IN, MODEL_COLOUR, svg_text, use_report_style
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.page import (
    NBSP,
    UNKNOWN_TEXT,
    Cell,
    Headline,
    Note,
    PageTable,
    Picture,
    Section,
    Text,
    Tile,
    Tone,
    make_table,
    render_page,
)

LSB = {"q15": 2.0**-15, "q31": 2.0**-31}


def explain_choices(plan: Plan) -> list[Decision]:
    """Return the choices of a plan with their reasons."""
    choices = [
        *_signal_choices(plan),
        _axis_choice(plan, "gap_segments", "tables over the gap", "linear interpolation between the gaps"),
    ]
    if plan.block.kind == "cells":
        return [*choices, *_cell_choices(plan), _root_choice(plan), _start_up_choice(plan)]
    if plan.block.kind == "full":
        choices += [
            _axis_choice(plan, "curve_segments", "anhysteretic curve and branch", "these tables"),
            _axis_choice(plan, "inverse_segments", "inverse of the anhysteretic curve", "this table"),
        ]
    else:
        choices += _closed_form_table_choices(plan)
    return [*choices, _iteration_choice(plan), _root_choice(plan), _start_up_choice(plan)]


def _cell_choices(plan: Plan) -> list[Decision]:
    errors, cells = dict(plan.search_result.axis_errors["cells"]), plan.sizes.cells
    reason = f"this number of thresholds causes an error of {_percent_text(plan, errors[cells])}"
    if cells - 1 in errors:
        reason += f"; {cells - 1} would cause {_percent_text(plan, errors[cells - 1])}"
    return [
        Decision("play cells with a threshold", f"{cells}", reason),
        _axis_choice(plan, "curve_segments", "row for each number of moving cells", "these tables"),
    ]


def _signal_choices(plan: Plan) -> list[Decision]:
    model, scales, io = plan.model, plan.block.scales, plan.request.io
    if io == "f32":
        reason = "24 bits of mantissa: no scaling is needed"
        return [Decision("signals", "single precision, SI units", reason)]
    step = LSB[io]
    rows = [
        ("demand", scales.demand, plan.reference_output, model.output.unit),
        ("current", scales.current, max(abs(limit) for limit in plan.block.limits.current), model.input.unit),
    ]
    choices = [
        Decision(
            f"full scale of the {name}",
            f"{scale:g} {unit}",
            f"the next round value above {largest_value:.4g} {unit}; a step of {io} is "
            f"{scale * step:.3g} {unit}, and the arithmetic uses 32 bits",
        )
        for name, scale, largest_value, unit in rows
    ]
    if model.needs_schedule and model.schedule is not None:
        low, high = 1e3 * scales.gap_low, 1e3 * scales.gap_high
        text = f"{low:g} to {high:g} mm" if model.schedule.unit == "m" else (
            f"{scales.gap_low:g} to {scales.gap_high:g} {model.schedule.unit}"
        )  # fmt: skip
        choices.append(
            Decision(
                f"range of the {model.schedule.name}",
                text,
                "the measured range, so that all codes are within the range of the model",
            )
        )
    return choices


def _axis_choice(plan: Plan, axis: str, name: str, subject: str) -> Decision:
    chosen_exponent = getattr(plan.sizes, axis)
    errors = dict(plan.search_result.axis_errors[axis])
    if axis == "gap_segments" and not plan.model.needs_schedule:
        return Decision(name, "constant", "nothing depends on the gap")
    reason = f"{subject} cause an error of {_percent_text(plan, errors[chosen_exponent])}"
    if chosen_exponent - 1 in errors:
        reason += f"; with {2 ** (chosen_exponent - 1)} it would be {_percent_text(plan, errors[chosen_exponent - 1])}"
    return Decision(name, f"{2**chosen_exponent} segment{'s' if chosen_exponent else ''}", reason)


def _closed_form_table_choices(plan: Plan) -> list[Decision]:
    law, axis_errors = plan.builder.closed_form, plan.search_result.axis_errors
    sizes = plan.sizes
    choices = [
        Decision(
            "simplified law",
            f"rate {law.rate:.4g}, nu {law.nu:.4g}",
            f"fitted in {plan.model.output.name.replace('_', ' ')} to the response of the model "
            f"over its range; largest error {_percent_text(plan, law.max_error)} over steady-state triangles",
        )
    ]
    if plan.block.kind == "simplified":
        octave_error = max(dict(axis_errors["octaves"])[sizes.octaves], 0.0)
        segment_error = max(dict(axis_errors["octave_segments"])[sizes.octave_segments], 0.0)
        choices.append(
            Decision(
                "closed form",
                f"{sizes.octaves} octaves of {2**sizes.octave_segments} segments",
                f"error due to the octaves {_percent_text(plan, octave_error)}, due to the segments "
                f"{_percent_text(plan, segment_error)}: the curve is steep at its start and flat at its end",
            )
        )
    return choices


def _iteration_choice(plan: Plan) -> Decision:
    subject = "a solve" if plan.block.kind == "full" else "a commit of another current than the solved one"
    return Decision(
        "iterations",
        f"{plan.sizes.iterations} in {subject}",
        "one more than the smallest number that is as accurate as many, for full-range jumps and lost "
        "currents too; this is the maximum, because a search ends when it reaches the target",
    )


def _root_choice(plan: Plan) -> Decision:
    k = plan.sizes.root_knee
    if plan.model.power != 2:
        return Decision("root", "none", "the output is proportional to the flux")
    knee = plan.block.scales.demand * 4.0**-k
    unit = plan.model.output.unit
    return Decision(
        "root near zero",
        f"straight below {knee:.3g} {unit}",
        f"the infinite slope of the root would turn the last bit of a demand into a jump of current; "
        f"the error is at most {_percent_text(plan, knee / 4.0)} there",
    )


def _start_up_choice(plan: Plan) -> Decision:
    start_up = plan.start_up
    cycles = start_up.conditioning.cycles
    return Decision(
        "start-up",
        f"{cycles} triangle{'s' * (cycles > 1)} of current in {start_up.seconds:g} s",
        "the output afterwards depends on the earlier history by at most "
        f"{_percent_text(plan, start_up.remaining_difference)}",
    )


def _percent_text(plan: Plan, value: float) -> str:
    return f"{100.0 * value / plan.reference_output:.2g} %"


PANEL_HEIGHT_IN = 2.1  # inches
"""Height of a panel, inches."""
MAX_PLOT_POINTS = 1200
"""Maximum number of points of a plotted path. Each plotted point shows the extremes of an interval,
so that no peak is lost."""


def make_budget_page(
    plan: Plan, budget: Budget, choices: Sequence[Decision], signals: Sequence[str], version: str
) -> str:
    """Return the page of a budget; each line of `signals` describes the codes of a signal."""
    worst_percent, drift = (percent(budget, part.worst or 0.0) for part in (budget.compiled, budget.drift))
    text = f"Compiled, the output is within {worst_percent:.2g} % of the output of the model"
    tone: Tone = "info"
    title, limit = "Accuracy measured", "no accuracy was requested"
    if budget.required is not None:
        limit = f"{percent(budget, budget.required):.3g} % was requested"
        tone = "good" if (budget.compiled.worst or 0.0) <= budget.required else "bad"
        title = "As accurate as requested" if tone == "good" else "Less accurate than requested"
    worst_run = max(budget.runs, key=lambda run_and_error: float(np.abs(run_and_error[1]).max()))
    headline = Headline(
        title=f"{plan.model.name}: {plan.block.kind}, {plan.request.io}",
        description="Accuracy of a compiled compensator, measured on the paths of its demands.",
        basis="",
        verdict=Note(tone, title, f"{text}; {limit}."),
        tiles=(
            Tile(f"{worst_percent:.2g}{NBSP}%", "worst error, compiled", limit),
            Tile(
                f"{percent(budget, budget.compiled.rms or 0.0):.2g}{NBSP}%",
                "rms error, compiled",
                "of all paths",
            ),
            Tile(f"{drift:.2g}{NBSP}%", "drift of a held output", f"in {HOLD_TIME_S:g} s"),
        ),
        picture=Picture(
            svg_text(_draw_deviations(budget, [worst_run]), "worst"),
            "Deviation of the output from the demand along the path with the largest deviation",
            "The path with the largest deviation; dashed: the requested accuracy, if there is one.",
        ),
        comparison=None,
        validity=f"Values in % are relative to the largest demand, {budget.reference_output:.4g} {budget.unit}. All "
        "values are measured: the currents of the compensator are applied to the model in double "
        "precision, and the output of the model is compared with the demand.",
    )
    sections = (
        Section("parts", "Error of each step", (_parts_table(budget),)),
        Section("paths", "Deviation along the paths", _path_section(budget)),
        Section("held", "Held demands", (_held_demand_table(budget),)),
        Section("choices", "Choices and reasons", _choice_section(plan, choices)),
        Section("signals", "Signals", (_signal_table(signals),)),
    )
    return render_page(headline, sections, version, kind="Accuracy budget", source="the model file")


def _parts_table(budget: Budget) -> PageTable:
    """Return the table of all error contributions, each measured alone, and of their sums."""
    sums = budget.compiled, budget.total, budget.drift
    largest_error = max(part.worst or 0.0 for part in (*budget.parts, *sums))

    def row(part: BudgetPart) -> list[Cell]:
        def share(value: float | None) -> str:
            return UNKNOWN_TEXT if value is None else f"{percent(budget, value):#.2g}"

        worst_text = UNKNOWN_TEXT if part.worst is None else f"{part.worst:.3g}"
        return [
            Cell(part.title, strong=part in sums),
            Cell(part.note),
            Cell(worst_text),
            Cell(share(part.worst), bar=(part.worst or 0.0) / largest_error if largest_error else 0.0),
            Cell(share(part.rms)),
        ]

    return make_table(
        "Parts and sums",
        ["part", "what was switched on", f"worst [{budget.unit}]", "worst [%]", "rms [%]"],
        [row(part) for part in (*budget.parts, *sums)],
        "Each contribution is measured alone, while everything else is exact.",
        texts=2,
    )


def _path_section(budget: Budget) -> tuple[Picture, PageTable]:
    rows = [
        [
            run.path.title,
            f"{error.size}",
            f"{percent(budget, float(np.abs(error).max())):.3g}",
            f"{percent(budget, rms(error)):.2g}",
        ]
        for run, error in budget.runs
    ]
    figure_markup = Picture(
        svg_text(_draw_deviations(budget, budget.runs), "paths"),
        "Deviation of the output from the demand along each path",
        "All compilation steps are active. If the current is at a limit, only deviations that "
        "a current within the limits could reduce count.",
    )
    return figure_markup, make_table("Every path", ["path", "samples", "worst [%]", "rms [%]"], rows)


def _held_demand_table(budget: Budget) -> PageTable:
    rows = [
        [path.title, f"{path.demand:.3g}", f"{path.seconds:g}", f"{percent(budget, path.drift):.2g}"]
        for path in budget.held_demands
    ]
    return make_table(
        "Every movement",
        ["while", f"demand [{budget.unit}]", "time [s]", "drift [%]"],
        rows,
        "Largest change of the output at the same demand and gap, since the first return. A periodic "
        "movement is simulated until the states of compensator and model repeat too.",
    )


def _choice_section(plan: Plan, choices: Sequence[Decision]) -> tuple[PageTable, Text]:
    rows = [[choice.name, choice.value, choice.reason] for choice in choices]
    size = f"The parameters take {plan.block.size} bytes."
    return make_table("Every choice", ["what", "chosen", "because"], rows, texts=3), Text(size)


def _signal_table(signals: Sequence[str]) -> PageTable:
    lines = [line.partition(" ") for line in signals]
    return make_table("", ["signal", "meaning"], [[name, text.strip()] for name, _, text in lines], "", 2)


@use_report_style
def _draw_deviations(budget: Budget, runs: Sequence[tuple[PathRun, FloatArray]]) -> Figure:
    """Draw the deviation along each of some paths."""
    columns = min(len(runs), 2)
    rows = -(-len(runs) // columns)
    # Fixed margins, because an automatic layout took a fifth of the compile time.
    figure = Figure((FIGURE_WIDTH_IN, PANEL_HEIGHT_IN * rows))
    figure.subplots_adjust(
        0.1, 0.5 / (PANEL_HEIGHT_IN * rows), 0.99, 1.0 - 0.3 / (PANEL_HEIGHT_IN * rows), 0.08, 0.65
    )
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel().tolist()
    for ax in axes[len(runs) :]:
        ax.remove()
    for ax, (run, error) in zip(axes, runs, strict=False):
        at, low, high = _envelope(percent(budget, 1.0) * error)
        ax.fill_between(at, low, high, color=MODEL_COLOUR, linewidth=0.6, edgecolor=MODEL_COLOUR)
        ax.set_title(run.path.title)
        ax.set_xlabel("sample")
        if budget.required is not None:
            for accuracy_limit in (-percent(budget, budget.required), percent(budget, budget.required)):
                ax.axhline(accuracy_limit, color=ALARM_COLOUR, linewidth=0.8, dashes=(4, 3))
    for ax in axes[0 : len(runs) : columns]:
        ax.set_ylabel("deviation, %")
    return figure


def _envelope(error: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position, lowest and highest value of intervals of equal length."""
    edges = np.unique(np.linspace(0, error.size, min(MAX_PLOT_POINTS, error.size) + 1).astype(int))
    low, high = (np.asarray(f.reduceat(error, edges[:-1])) for f in (np.minimum, np.maximum))
    return edges[:-1].astype(np.float64), low, high
