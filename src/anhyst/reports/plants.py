"""The page of plants that have drifted, whichever rig they are."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from anhyst.reports.bearing.look import ordered, verdict_note
from anhyst.reports.bearing.over_runs import Spread, figure_drift
from anhyst.rig.drift import Drift
from anhyst.rig.tables import SPREADS, SPREADS_OF_BODY, SPREADS_OF_HEAD, SPREADS_OF_MAGNET
from anhyst.study.engine.monte_carlo import PERCENTILES, MonteCarlo, PlantFigure, percentile
from anhyst.support.atomic import PathLike, atomic_writer
from anhyst.support.kinds import NAMES
from anhyst.support.page.blocks import (
    Headline,
    Items,
    Note,
    Picture,
    Section,
    Text,
    render_page,
    table,
)
from anhyst.support.page.numbers import MINUS, NBSP, number
from anhyst.support.page.style import svg_text
from anhyst.support.version import running_version


def write_plants_report(
    path: PathLike, runs: MonteCarlo, files: Sequence[Path], command: str
) -> None:
    """Write the report of a Monte Carlo: one HTML file that needs nothing else."""
    rows = [(file.name, hashlib.sha256(file.read_bytes()).hexdigest()) for file in files]
    origin = Section("origin", "Origin", (table("Files", ["file", "SHA-256"], rows, texts=2),
                                          Text(f"Made by: {command}")))  # fmt: skip
    text = render_page(
        _headline(runs),
        [_drift(runs), origin],
        running_version(),
        kind="Drifted plants",
        source="a simulation",
    )
    with atomic_writer(path) as stream:
        stream.write(text)


def _headline(runs: MonteCarlo) -> Headline:
    file = runs.plants.file
    counts = [f"{name}: {runs.lost(name)} of {len(runs.drifts)}" for name in ordered(runs.runs)]
    lost = any(runs.lost(name) for name in runs.runs)
    return Headline(
        title=file.name,
        what=f"{len(runs.drifts)} plants of {NAMES[file.kind][0]}, each with a noise of its own, "
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
    spread, drawn = file.spread, SPREADS[file.kind]
    if file.several:
        of_all = (SPREADS_OF_MAGNET, SPREADS_OF_BODY, SPREADS_OF_HEAD)
        drawn = {key.rpartition("_")[0]: key for drift in of_all for key in drift.values()}
    for name, key in drawn.items():
        value, what = getattr(spread, key), name.replace("_", " ")
        if key.endswith("_percent"):
            shown.append(f"{what} {value:g}{NBSP}%")
        else:
            shown.append(f"{what} {1e6 * value:g}{NBSP}µ{key[-1]}")
    return ", ".join(shown)


def _drift(runs: MonteCarlo) -> Section:
    spreads = [
        Spread(_title(figure, name), {
            method: figure.factor * np.array(runs.values(method, figure.key, case))
            for method in runs.runs
        })
        for figure in runs.plants.figures
        for case, name in enumerate(figure.names)
    ]  # fmt: skip
    rows = [
        [
            spread.title,
            name,
            *(number(percentile(spread.values[name].tolist(), p)) for p in PERCENTILES),
        ]
        for spread in spreads
        for name in ordered(spread.values)
    ]
    picture = Picture(
        svg_text(figure_drift(spreads), "drift"),
        "Shares of plants that stay below a figure, with percentiles marked: "
        f"{', '.join(spread.title for spread in spreads)}.",
        "Share of plants below each figure; dots at "
        f"{', '.join(str(part) for part in PERCENTILES)} %. A plant that is lost counts as "
        "infinitely bad.",
    )
    head = ["figure", "variant", *(f"{part:g} %" for part in PERCENTILES)]
    blocks = (picture, table("Percentiles", head, rows, texts=2), _worst(runs))
    return Section("drift", "Drifted plants", blocks)


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
