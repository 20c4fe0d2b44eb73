"""Draw the map of the benefit of compensation for different irons, and write its page.

Each cell of the map is an iron with a certain loop width and a certain reversible fraction. Its
value is the ratio of a metric with compensation to the same metric without compensation.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from anhyst.control.controller_file import ControllerFile
from anhyst.support.figures import ALARM_COLOUR, new_figure, use_report_style
from anhyst.support.page import (
    NBSP,
    UNKNOWN_TEXT,
    Block,
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
from anhyst_rigs.reports.bearing.page import plant_text, structure_section
from anhyst_rigs.reports.study.page import (
    INK_COLOUR,
    SHADE_COLOUR,
    file_hashes,
    origin_section,
    page_text,
    picture,
    verdict_note,
)
from anhyst_rigs.reports.study.task import SimulationTask
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.study.bearing.inputs import check_inputs, read_bearing_controller
from anhyst_rigs.study.benefit import (
    AnyRig,
    Benefit,
    MapCell,
    MethodComparison,
    Outcome,
    map_bearing_benefit,
    map_plant_benefit,
)
from anhyst_rigs.study.engine.table import Judgement, Level, Metric

_OUTCOME_TITLES: Mapping[Outcome, str] = {
    "gain": "significant gains",
    "loss": "significant losses",
    "nothing to gain": "with nothing to gain",
}
"""Outcomes at the head of the page."""
STRONGEST_BASELINE = "the strongest baseline"
_MAX_RATIO_WITH_WHITE_TEXT = 0.45  # ratio below which the colour is so dark that the text is white
_SHORT_NAMES = {"linearised": "lin.", "single-valued": "single"}  # names for narrow squares
_OUTCOME_HATCHES: Mapping[str, dict[str, Any]] = {
    "loss": {"ec": ALARM_COLOUR, "hatch": "xxxx"},
    "no gain": {"ec": SHADE_COLOUR, "hatch": "////"},
    "nothing to gain": {"ec": SHADE_COLOUR, "hatch": "...."},
}
ComparedCells = Sequence[tuple[MapCell, MethodComparison]]


def _case_text(case: float | str) -> str:
    """Return a case as text: the height of its step, or its name."""
    return f"{1e6 * case:g} µm" if isinstance(case, float) else case


def compare_with_baselines(gains: Benefit, key: str) -> dict[str, ComparedCells]:
    """Return, for each baseline, the comparison of every map cell with this baseline."""
    by_baseline = {
        "ratio": [map_cell.ratio for map_cell in gains.cells],
        STRONGEST_BASELINE: [cell.strongest for cell in gains.cells],
        "flux": [cell.flux for cell in gains.cells],
    }
    return {
        baseline: [(cell, metrics[key]) for cell, metrics in zip(gains.cells, comparisons, strict=True)]
        for baseline, comparisons in by_baseline.items()
        if all(comparisons)
    }


@use_report_style
def figure_benefit(gains: Benefit, metric: Metric) -> Figure:
    """Draw the ratios for all irons: one row of maps per baseline, and one column per case."""
    baselines = compare_with_baselines(gains, metric.key)
    cases = list(dict.fromkeys(map_cell.case for map_cell in gains.cells))
    figure = new_figure(1.2 + 2.4 * len(baselines), width=max(6.4, 1.2 + 2.4 * len(cases)))
    axes = figure.subplots(len(baselines), len(cases), squeeze=False, sharex=True, sharey=True)
    mesh: QuadMesh | None = None
    for axes_row, (baseline_name, cells) in zip(axes, baselines.items(), strict=True):
        for ax, case in zip(axes_row, cases, strict=True):
            mesh = _draw_map(
                ax,
                gains,
                baseline_name,
                [cell_and_comparison for cell_and_comparison in cells if cell_and_comparison[0].case == case],
            )
            ax.set_title(f"{_case_text(case)}, against {baseline_name}", fontsize=8.0)
        axes_row[0].set_ylabel("loop width (% of largest drive)")
    for ax in axes[-1]:
        ax.set_xlabel("reversible fraction")
    assert mesh is not None
    colour_bar = figure.colorbar(mesh, ax=axes, shrink=0.8, extend="max")
    colour_bar.set_label(f"{metric.title} of full / that of the baseline")
    figure.legend(
        [Rectangle((0, 0), 1, 1, fc="none", lw=0.8, **style) for style in _OUTCOME_HATCHES.values()],
        ["significant loss", "not significant", "nothing to gain: both are small"],
        loc="outside lower center",
        ncols=3,
    )
    return figure


def _draw_map(ax: Axes, gains: Benefit, baseline: str, cells: ComparedCells) -> QuadMesh:
    loop_widths = sorted({gains.mean_loop_width(map_cell.iron.pinning_scale) for map_cell in gains.cells})
    levels = list(dict.fromkeys(cell.iron.reversible_fraction for cell in gains.cells))
    metric_ratios = np.full((len(loop_widths), len(levels)), np.nan)
    for cell, comparison in cells:
        y = loop_widths.index(gains.mean_loop_width(cell.iron.pinning_scale))
        x = levels.index(cell.iron.reversible_fraction)
        metric_ratios[y, x] = _ratio_or_nan(comparison)
        _label_cell(ax, (x, y), baseline, cell, comparison)
    # A mesh of squares replaces an image, because identifiers must be unique on a page.
    mesh = ax.pcolormesh(
        np.arange(len(levels) + 1) - 0.5,
        np.arange(len(loop_widths) + 1) - 0.5,
        np.ma.masked_invalid(np.minimum(metric_ratios, 2.0)),
        cmap="PuOr_r",
        norm=TwoSlopeNorm(1.0, 0.0, 2.0),
        zorder=0.5,  # The mesh is drawn below the hatching.
    )
    ax.grid(visible=False)
    ax.set_xticks(range(len(levels)), ["unchanged" if level is None else f"{level:g}" for level in levels])
    ax.set_yticks(range(len(loop_widths)), [f"{100.0 * width:.2g}" for width in loop_widths])
    return mesh


def _ratio_or_nan(comparison: MethodComparison) -> float:
    """Return the ratio of a metric with and without compensation; NaN if a run lost control."""
    return math.nan if comparison.quotient is None else comparison.quotient.value


def _label_cell(
    ax: Axes, position: tuple[int, int], map_baseline: str, map_cell: MapCell, comparison: MethodComparison
) -> None:
    """Write the ratio into its square, and hatch the square if there is no significant gain."""
    x, y = position
    metric_ratio, baseline = _ratio_or_nan(comparison), comparison.baseline
    text = "lost" if math.isnan(metric_ratio) else f"{metric_ratio:.2f}"
    if map_cell.iron.label == "pathological":
        text += "†"
    if baseline and baseline != map_baseline:
        text += f"\n{_SHORT_NAMES.get(baseline, baseline)}"
    is_gain = comparison.outcome == "gain"
    ax.text(
        x,
        y,
        text,
        ha="center",
        va="center",
        fontsize=7.0,
        color="#FFFFFF" if is_gain and metric_ratio < _MAX_RATIO_WITH_WHITE_TEXT else INK_COLOUR,
        bbox=None if is_gain else {"fc": "#FFFFFF", "ec": "none", "pad": 1.2},
    )
    if not is_gain:
        lower_left, style = (x - 0.48, y - 0.48), _OUTCOME_HATCHES[comparison.outcome]
        ax.add_patch(Rectangle(lower_left, 0.96, 0.96, fill=False, lw=0.8, **style))


_COMPARISON_TEXT = (
    "Every iron is measured and identified again, and all variants are fitted to the same loops, {} "
    f"“{STRONGEST_BASELINE}” is the best of ratio, linearised and single-valued in each cell. These "
    "variants ignore hysteresis. The selection favours this baseline a little. If there is a Hall "
    "probe, flux is compared, too. It measures the flux density and needs no model."
)


def _headline(gains: Benefit, title: str, description: str, run_text: str) -> Headline:
    metric = gains.metrics[0]
    by_baseline = compare_with_baselines(gains, metric.key)
    baseline = STRONGEST_BASELINE if STRONGEST_BASELINE in by_baseline else next(iter(by_baseline))
    cells = by_baseline[baseline]
    counts = Counter(comparison.outcome for _, comparison in cells)
    level: Level = "no" if not counts["gain"] else "mixed" if counts["gain"] < len(cells) else "yes"
    text = _gain_text(gains, metric.title.capitalize(), baseline, cells)
    tiles = (
        Tile(f"{counts[outcome]} of {len(cells)}", title, f"{metric.title}, against {baseline}")
        for outcome, title in _OUTCOME_TITLES.items()
    )
    return Headline(
        title=title,
        description=description,
        basis=f"Simulated; intervals are those of 95 % confidence over {gains.seeds} noise seeds.",
        verdict=verdict_note(Judgement(level, text.removesuffix("."))),
        notes=(Note("info", "What is compared", _COMPARISON_TEXT.format(run_text)),),
        tiles=tuple(tiles),
        picture=_picture_of_map(gains, metric),
        comparison=None,
        validity="These results apply only to this plant, its iron and these settings.",
    )


def render_bearing(rig: BodyRig, controller: ControllerFile, gains: Benefit, command: str) -> str:
    """Return the page of the benefit map of a bearing."""
    compensation = controller.settings.compensation.model_copy(update={"variant": "full"})
    table_of_full = controller.settings.model_copy(update={"compensation": compensation})
    description = f"{plant_text(rig)}; controller “{controller.settings.name}”, variant full."
    runs = f"run with the same gains, {gains.seeds} noise seeds each."
    variants = [
        "full",
        *(comparison.baseline for cell in gains.cells for comparison in cell.strongest.values()),
    ]
    sections = (
        _benefit_section(gains),
        structure_section(rig, table_of_full, [*variants, "ratio"]),
        origin_section(file_hashes([rig.path, controller.path]), command, rig.settings.seed),
    )
    headline = _headline(gains, rig.settings.name, description, runs)
    return page_text("Magnetic bearing", headline, sections)


def map_bearing(rig: BodyRig, task: SimulationTask) -> tuple[Benefit, str]:
    """Return the benefit map of a bearing for loop widths and reversible fractions, and its page."""
    inputs = check_inputs(rig, read_bearing_controller(rig, task.controller))
    gains = map_bearing_benefit(inputs.rig, inputs.controller, progress=task.progress)
    command = task.command(" --benefit")
    return gains, render_bearing(inputs.rig, inputs.controller, gains, command)


def map_plants(rig: AnyRig, task: SimulationTask) -> tuple[Benefit, str]:
    """Return the benefit map of a rig with other irons, and its page."""
    gains, command = map_plant_benefit(rig, progress=task.progress), task.command(" --benefit")
    kind = rig.settings.kind.title
    cases = ", ".join(dict.fromkeys(_case_text(map_cell.case) for map_cell in gains.cells))
    description = f"{kind.capitalize()}, judged in: {cases}."
    runs = f"each with its own gains, if it has any, {gains.seeds} noise seeds each."
    headline = _headline(gains, rig.settings.name, description, runs)
    sections = (_benefit_section(gains), origin_section(file_hashes([rig.path]), command, rig.settings.seed))
    return gains, page_text(kind.capitalize(), headline, sections)


def _picture_of_map(gains: Benefit, metric: Metric) -> Picture:
    title = metric.title
    return picture(
        figure_benefit(gains, metric),
        f"benefit-{metric.key}",
        f"Maps of the ratio of {title} over loop width and reversible fraction, one "
        "column a case, one row a baseline; hatched if no gain is significant.",
        f"{title.capitalize()} of full divided by that of the baseline, same gains.  "
        "Below 1 (violet), compensation is better. Crossed red: a significant loss, or the run "
        "was lost. Hatched grey: not significant, because the 95 % confidence interval of the "
        "difference contains zero. Dotted: nothing to gain, because both overshoots of a step "
        "are less than three times the rms at standstill. †: pathological iron, whose slope is "
        "small just after a reversal. The name in a square is its baseline; lin. is linearised.",
    )


def _benefit_section(gains: Benefit) -> Section:
    blocks: list[Block] = []
    for metric in gains.metrics:
        for baseline_name, cells in compare_with_baselines(gains, metric.key).items():
            blocks.append(Text(_gain_text(gains, metric.title.capitalize(), baseline_name, cells)))
        if metric != gains.metrics[0]:
            blocks.append(_picture_of_map(gains, metric))
    return Section("benefit", "Gain of compensation", (*blocks, _iron_table(gains)))


def _gain_text(gains: Benefit, title: str, baseline: str, cells: ComparedCells) -> str:
    """Return a sentence with the numbers of gains and losses, and with the largest gain."""
    gain_cells = [
        cell_and_comparison for cell_and_comparison in cells if cell_and_comparison[1].outcome == "gain"
    ]
    loss_count, no_potential_count = (
        sum(comparison.outcome == outcome for _, comparison in cells)
        for outcome in ("loss", "nothing to gain")
    )
    text = (
        f"{title} against {baseline}: a significant gain in {len(gain_cells)} of {len(cells)} cells, a "
        f"significant loss in {loss_count}, nothing to gain in {no_potential_count}"
    )
    if gain_cells:
        cell, largest_gain = min(gain_cells, key=lambda pair: _ratio_or_nan(pair[1]))
        width, fraction = (gains.mean_loop_width(cell.iron.pinning_scale), cell.iron.reversible_fraction)
        fraction_text = "" if fraction is None else f"reversible fraction {fraction:g}, "
        text += (
            f"; at best {100.0 * (1.0 - _ratio_or_nan(largest_gain)):.0f}{NBSP}% less than {largest_gain.baseline} ("
            f"{'step of ' * isinstance(cell.case, float)}{_case_text(cell.case)}, {fraction_text}loop width "
            f"{100.0 * width:.2g}{NBSP}%)"
        )
    return f"{text}."


def _iron_table(gains: Benefit) -> PageTable:
    """Return a table that describes each iron by its loops."""
    rows = [
        [
            format_number(iron.pinning_scale, is_short=True),
            UNKNOWN_TEXT
            if iron.reversible_fraction is None
            else format_number(iron.reversible_fraction, is_short=True),
            f"{format_number(100.0 * iron.loop_width)}{NBSP}%",
            UNKNOWN_TEXT if iron.after_reversal is None else format_number(iron.after_reversal, 2),
            UNKNOWN_TEXT if iron.after_reversal_true is None else format_number(iron.after_reversal_true, 2),
            iron.label or UNKNOWN_TEXT,
        ]
        for iron in dict.fromkeys(map_cell.iron for map_cell in gains.cells)
    ]
    return make_table(
        "Irons",
        (
            "pinning, times",
            "reversible fraction",
            "loop width",
            "slope after reversal, from loops",
            "true",
            "label",
        ),
        rows,
        "Loop width: at the largest drive. Ratio of the slope just after a reversal to the static slope: "
        "below a quarter an iron is pathological.",
        texts=0,
    )
