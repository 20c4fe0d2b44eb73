"""Write the page of a Monte Carlo study, and draw its figure: plants of any kind with random drift."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from anhyst.support.figures import create_panels, new_figure, use_report_style
from anhyst.support.kinds import METHOD_TITLES, MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.page import (
    MAX_TILES,
    MINUS,
    NBSP,
    Headline,
    Items,
    Note,
    PageTable,
    Picture,
    Section,
    Tile,
    format_number,
    make_table,
)
from anhyst.support.units import key_in_words
from anhyst_rigs.reports.study.page import (
    COLOURS,
    TerminalSummary,
    file_hashes,
    legend_below,
    line_style,
    origin_section,
    page_text,
    picture,
    sort_for_report,
    verdict_note,
)
from anhyst_rigs.rig.drift import Drift
from anhyst_rigs.rig.tables import SPREADS
from anhyst_rigs.study.engine.monte_carlo import PERCENTILES, MonteCarlo, PlantMetric, percentile


def terminal_summary(runs: MonteCarlo) -> TerminalSummary:
    """Return the terminal output of a Monte Carlo study."""
    count = f"{len(runs.drifts)} plants, seed {runs.plants.seed}; evaluated is '{runs.plants.main_method}'"
    return TerminalSummary([percentile_table(runs)], [count])


def render(runs: MonteCarlo, files: Sequence[Path], command: str) -> str:
    """Return the page of a Monte Carlo study."""
    sections = [
        Section("drift", "Drifted plants", (percentile_table(runs), _worst_plants(runs))),
        origin_section(file_hashes(files), command, runs.plants.seed),
    ]
    return page_text("Drifted plants", _headline(runs), sections)


def _headline(runs: MonteCarlo) -> Headline:
    file = runs.plants.file
    counts = [f"{name}: {runs.lost_count(name)} of {len(runs.drifts)}" for name in sort_for_report(runs.runs)]
    has_losses = any(runs.lost_count(name) for name in runs.runs)
    return Headline(
        title=file.name,
        description=f"{len(runs.drifts)} plants of {file.kind.title}, each with its own noise, "
        f"whose properties have random deviations: {_spread_text(runs)} (standard deviations). Their "
        "controllers were designed for the nominal plant.",
        basis=f"Simulated, seed {runs.plants.seed}; all variants control the same plants.",
        verdict=verdict_note(runs.verdict),
        notes=(Note("bad" if has_losses else "good", "Plants lost", f"{'; '.join(counts)}."),),
        tiles=tuple(_tiles(runs)),
        picture=_drift_picture(runs),
        comparison=None,
        validity="These results apply only to this spread.",
    )


def _spread_text(runs: MonteCarlo) -> str:
    file, texts = runs.plants.file, []
    for key in SPREADS[file.control.kind].keys:
        value, property_name = getattr(file.spread, key), key_in_words(key).partition(" [")[0]
        if key.endswith("_percent"):
            texts.append(f"{property_name} {value:g}{NBSP}%")
        else:
            texts.append(f"{property_name} {1e6 * value:g}{NBSP}µ{key[-1]}")
    return ", ".join(texts)


def _tiles(runs: MonteCarlo) -> Iterator[Tile]:
    """Yield the number of lost plants, and the medians of the first metrics and cases."""
    method = runs.plants.main_method
    lost_count = f"{runs.lost_count(method)} of {len(runs.drifts)}"
    yield Tile(lost_count, "plants lost", f"with {METHOD_TITLES[method]}")
    cases = [(metric, *case) for metric in runs.plants.figures for case in enumerate(metric.case_names)]
    for metric, index, case in cases[: MAX_TILES - 1]:
        values = runs.values(method, metric.key, index)
        median, high = (
            f"{format_number(metric.factor * percentile(values, percent), 2)}{NBSP}{metric.unit}"
            for percent in (50, 95)
        )
        title = _figure_title(metric, case).rpartition(" (")[0]
        yield Tile(median, title, f"median of the plants; 95 % of them are below {high}")


def _drift_picture(runs: MonteCarlo) -> Picture:
    spreads = {
        _figure_title(figure, name): {
            method: figure.factor * np.array(runs.values(method, figure.key, case)) for method in runs.runs
        }
        for figure in runs.plants.figures
        for case, name in enumerate(figure.case_names)
    }
    return picture(
        figure_drift(spreads),
        "drift",
        f"Distribution of metrics of the plants, with percentiles marked: {', '.join(spreads)}.",
        "Fraction of plants below each value; dots at "
        f"{', '.join(str(percent) for percent in PERCENTILES)} %. A plant that lost control counts as "
        "infinite.",
    )


def percentile_table(runs: MonteCarlo) -> PageTable:
    """Return a table with percentiles over all plants, for each metric and variant."""
    rows = [
        [_figure_title(figure, case), name, *(format_number(value, 3) for value in percentiles)]
        for figure in runs.plants.figures
        for case_index, case in enumerate(figure.case_names)
        for name in sort_for_report(runs.runs)
        for values in (runs.values(name, figure.key, case_index),)
        for percentiles in ([figure.factor * percentile(values, percentage) for percentage in PERCENTILES],)
    ]
    table_header = ["figure", "variant", *(f"{percent:g} %" for percent in PERCENTILES)]
    return make_table("Percentiles", table_header, rows, texts=2)


def _figure_title(figure: PlantMetric, case: str) -> str:
    return f"{figure.title}{', ' if case else ''}{case.replace(' um', f'{NBSP}µm')} ({figure.unit})"


def _worst_plants(runs: MonteCarlo) -> Items:
    """Return the worst plant for each case of the first metric, with the drift of this plant."""
    figure, main_method = runs.plants.figures[0], runs.plants.main_method
    rows = []
    for case, name in enumerate(figure.case_names):
        values = runs.values(main_method, figure.key, case)
        plant = int(np.argmax(values))
        value_text = "lost"
        if math.isfinite(values[plant]):
            value_text = f"{format_number(figure.factor * values[plant], 2)}{NBSP}{figure.unit}"
        text = (
            f"{_figure_title(figure, name)}, {value_text}: plant {plant}, {_drift_text(runs.drifts[plant])}"
        )
        rows.append(text)
    return Items(f"Worst plants of {main_method}", tuple(rows))


def _drift_text(drift: Drift) -> str:
    changes = []
    for key, value in drift.as_dict().items():
        name, _, unit = key.rpartition("_")
        value_text = f"{value:+.1f}{NBSP}%" if unit == "percent" else f"{1e6 * value:+.2f}{NBSP}µ{unit}"
        changes.append(f"{key_in_words(name)} {value_text}")
    return ", ".join(changes).replace("-", MINUS)


@use_report_style
def figure_drift(spreads: Mapping[str, Mapping[MethodName, FloatArray]]) -> Figure:
    """Draw the distribution of metrics over the plants, and mark the percentiles.

    Each variant has one value per plant, which is infinite if control was lost.
    """
    figure = new_figure(3.4 * -(-len(spreads) // 3) + 0.4)
    axes = create_panels(figure, len(spreads))
    for ax, (title, by_method) in zip(axes, spreads.items(), strict=True):
        for name in sort_for_report(by_method):
            values = np.sort(by_method[name])
            plant_percent = 100.0 * np.arange(1, values.size + 1) / values.size
            finite = np.isfinite(values)
            ax.plot(values[finite], plant_percent[finite], **line_style(name), label=name)
            percentile_values = [percentile(values.tolist(), percent) for percent in PERCENTILES]
            ax.plot(percentile_values, PERCENTILES, "o", color=COLOURS[name], ms=3.5)
        ax.set_title(title)
        ax.set_ylim(0.0, 102.0)
    axes[0].set_ylabel("plants below (%)")
    legend_below(figure, *axes)
    return figure
