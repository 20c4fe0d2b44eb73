"""The page of plants that have drifted, whichever rig they are, and its figure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from anhyst.support.figures import new_figure, panels, styled
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.page import (
    MINUS,
    NBSP,
    Headline,
    Items,
    Note,
    PageTable,
    Section,
    number,
    table,
)
from anhyst_rigs.reports.study.page import (
    COLOURS,
    Printed,
    hashes,
    legend_below,
    line_of,
    ordered,
    origin,
    page_text,
    picture,
    verdict_note,
)
from anhyst_rigs.rig.drift import Drift
from anhyst_rigs.rig.tables import SPREADS
from anhyst_rigs.study.engine.monte_carlo import PERCENTILES, MonteCarlo, PlantFigure, percentile


def printed(runs: MonteCarlo) -> Printed:
    """Return what a terminal shows of a Monte Carlo."""
    count = f"{len(runs.drifts)} plants, seed {runs.plants.seed}; judged is '{runs.plants.own}'"
    return Printed([percentile_table(runs)], [count])


def render(runs: MonteCarlo, files: Sequence[Path], command: str) -> str:
    """Return the page of a Monte Carlo."""
    sections = [_drift(runs), origin(hashes(files), command, runs.plants.seed)]
    return page_text("Drifted plants", _headline(runs), sections)


def _headline(runs: MonteCarlo) -> Headline:
    file = runs.plants.file
    counts = [f"{name}: {runs.lost(name)} of {len(runs.drifts)}" for name in ordered(runs.runs)]
    lost = any(runs.lost(name) for name in runs.runs)
    return Headline(
        title=file.name,
        what=f"{len(runs.drifts)} plants of {file.kind.title}, each with a noise of its own, "
        f"whose properties are off by chance: {_deviations(runs)} (standard deviations). What "
        "controls them was made for the nominal one and knows nothing of it.",
        basis=f"Simulated, seed {runs.plants.seed}; all variants meet the same plants.",
        notes=(
            verdict_note(runs.verdict),
            Note("bad" if lost else "good", "Plants lost", f"{'; '.join(counts)}."),
        ),
        tiles=(),
        comparison=None,
        holds="These figures hold for these plants, and for no other spread.",
    )


def _deviations(runs: MonteCarlo) -> str:
    file, shown = runs.plants.file, []
    for key in SPREADS[file.control.kind].keys:
        value, what = getattr(file.spread, key), key.rpartition("_")[0].replace("_", " ")
        if key.endswith("_percent"):
            shown.append(f"{what} {value:g}{NBSP}%")
        else:
            shown.append(f"{what} {1e6 * value:g}{NBSP}µ{key[-1]}")
    return ", ".join(shown)


def _drift(runs: MonteCarlo) -> Section:
    spreads = {
        _title(figure, name): {
            method: figure.factor * np.array(runs.values(method, figure.key, case))
            for method in runs.runs
        }
        for figure in runs.plants.figures
        for case, name in enumerate(figure.names)
    }
    shown = picture(
        figure_drift(spreads),
        "drift",
        "Shares of plants that stay below a figure, with percentiles marked: "
        f"{', '.join(spreads)}.",
        "Share of plants below each figure; dots at "
        f"{', '.join(str(part) for part in PERCENTILES)} %. A plant that is lost counts as "
        "infinitely bad.",
    )
    return Section("drift", "Drifted plants", (shown, percentile_table(runs), _worst(runs)))


def percentile_table(runs: MonteCarlo) -> PageTable:
    """Return what so many per cent of the plants stay below, figure by figure."""
    rows = [
        [_title(spread_of, case), name, *(number(figure, 3) for figure in figures)]
        for spread_of in runs.plants.figures
        for place, case in enumerate(spread_of.names)
        for name in ordered(runs.runs)
        for values in (runs.values(name, spread_of.key, place),)
        for figures in ([spread_of.factor * percentile(values, p) for p in PERCENTILES],)
    ]
    head = ["figure", "variant", *(f"{part:g} %" for part in PERCENTILES)]
    return table("Percentiles", head, rows, texts=2)


def _title(figure: PlantFigure, case: str) -> str:
    return f"{figure.title}{', ' if case else ''}{case.replace(' um', f'{NBSP}µm')} ({figure.unit})"


def _worst(runs: MonteCarlo) -> Items:
    """Say what the worst plants of a variant have in common with nobody else: their drift."""
    figure, own = runs.plants.figures[0], runs.plants.own
    rows = []
    for case, name in enumerate(figure.names):
        values = runs.values(own, figure.key, case)
        worst = int(np.argmax(values))
        much = "lost"
        if math.isfinite(values[worst]):
            much = f"{number(figure.factor * values[worst], 2)}{NBSP}{figure.unit}"
        text = f"{_title(figure, name)}, {much}: plant {worst}, {_drift_text(runs.drifts[worst])}"
        rows.append(text)
    return Items(f"Worst plants of {own}", tuple(rows))


def _drift_text(drift: Drift) -> str:
    changes = []
    for key, value in drift.as_dict().items():
        name, _, unit = key.rpartition("_")
        shown = f"{value:+.1f}{NBSP}%" if unit == "percent" else f"{1e6 * value:+.2f}{NBSP}µ{unit}"
        changes.append(f"{name.replace('_', ' ')} {shown}")
    return ", ".join(changes).replace("-", MINUS)


@styled
def figure_drift(spreads: Mapping[str, Mapping[MethodName, FloatArray]]) -> Figure:
    """Draw the share of plants that stay below a figure, by its title, with percentiles marked.

    Of every variant there is a value a plant, infinite where the plant failed.
    """
    figure = new_figure(3.4 * -(-len(spreads) // 3) + 0.4)
    axes = panels(figure, len(spreads))
    for ax, (title, by_method) in zip(axes, spreads.items(), strict=True):
        for name in ordered(by_method):
            values = np.sort(by_method[name])
            share = 100.0 * np.arange(1, values.size + 1) / values.size
            finite = np.isfinite(values)
            ax.plot(values[finite], share[finite], **line_of(name), label=name)
            marks = [percentile(values.tolist(), part) for part in PERCENTILES]
            ax.plot(marks, PERCENTILES, "o", color=COLOURS[name], ms=3.5)
        ax.set_title(title)
        ax.set_ylim(0.0, 102.0)
    axes[0].set_ylabel("plants below (%)")
    legend_below(figure, *axes)
    return figure
