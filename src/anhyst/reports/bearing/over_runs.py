"""Figures over many runs: where compensation gains, what tuning can choose from and chose, drift."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from anhyst.reports.bearing.look import COLOURS, INK, SHADE, legend_below, line_of, ordered
from anhyst.study.engine.monte_carlo import PERCENTILES, percentile
from anhyst.study.tuning.aims import TITLES, Aims, GainFigures
from anhyst.study.tuning.result import RESULTS, Tuning, keeps_others
from anhyst.support.figures import ALARM, new_figure, panels, styled, write_png
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray

_DARK = 0.45  # ratio below which its colour asks for white letters

_SHORT = {"linearised": "lin.", "single-valued": "single"}  # where squares are narrow

Outcome = Literal["gain", "nothing to gain", "no gain", "loss"]


@dataclass(frozen=True)
class BenefitCell:
    """A figure with compensation over that of a baseline, for one iron and one step."""

    measure: str  # the figure, such as "overshoot"
    against: str  # which baseline, such as "ratio" or "the strongest baseline"
    baseline: str  # MethodName that this is here; empty if none kept the armature in the air
    # of the iron, as a share of the largest current; one number for a row of the map
    loop_width: float
    # reversible fraction of the iron; None where its family has no such number, for all cells
    reversible: float | None
    pathological: bool  # whether the iron hardly answers just after a reversal
    height: float  # of the step, m
    ratio: float  # below 1 where compensation gains; not a number where one of them was lost
    outcome: Outcome  # ``"gain"`` and ``"loss"`` only if it is certain


@styled
def figure_benefit(cells: Sequence[BenefitCell], variant: str) -> Figure:
    """Draw ratios over irons: one row of maps a baseline, one column a step height."""
    baselines = list(dict.fromkeys(cell.against for cell in cells))
    heights = sorted({cell.height for cell in cells})
    figure = new_figure(1.2 + 2.4 * len(baselines), width=max(6.4, 1.2 + 2.4 * len(heights)))
    axes = figure.subplots(len(baselines), len(heights), squeeze=False, sharex=True, sharey=True)
    mesh: QuadMesh | None = None
    for row, against in zip(axes, baselines, strict=True):
        for ax, height in zip(row, heights, strict=True):
            chosen = [c for c in cells if c.against == against and c.height == height]
            mesh = _map(ax, cells, chosen)
            ax.set_title(f"{1e6 * height:g} µm, against {against}", fontsize=8.0)
        row[0].set_ylabel("loop width (% of largest current)")
    for ax in axes[-1]:
        ax.set_xlabel("reversible fraction")
    assert mesh is not None
    bar = figure.colorbar(mesh, ax=axes, shrink=0.8, extend="max")
    bar.set_label(f"{cells[0].measure} of {variant} / that of the baseline")
    figure.legend(
        [Rectangle((0, 0), 1, 1, fc="none", lw=0.8, **style) for style in _HATCHES.values()],
        ["certain loss", "neither is certain", "nothing to gain: both are small"],
        loc="outside lower center",
        ncols=3,
    )
    return figure


_HATCHES: Mapping[str, dict[str, Any]] = {
    "loss": {"ec": ALARM, "hatch": "xxxx"},
    "no gain": {"ec": SHADE, "hatch": "////"},
    "nothing to gain": {"ec": SHADE, "hatch": "...."},
}


def _map(ax: Axes, cells: Sequence[BenefitCell], chosen: Sequence[BenefitCell]) -> QuadMesh:
    widths = sorted({cell.loop_width for cell in cells})
    shares = list(dict.fromkeys(cell.reversible for cell in cells))
    ratios = np.full((len(widths), len(shares)), np.nan)
    for cell in chosen:
        y, x = widths.index(cell.loop_width), shares.index(cell.reversible)
        ratios[y, x] = cell.ratio
        _write(ax, (x, y), cell)
    # Squares and not an image: a page has each of its identifiers once.
    mesh = ax.pcolormesh(
        np.arange(len(shares) + 1) - 0.5,
        np.arange(len(widths) + 1) - 0.5,
        np.ma.masked_invalid(np.minimum(ratios, 2.0)),
        cmap="PuOr_r",
        norm=TwoSlopeNorm(1.0, 0.0, 2.0),
        zorder=0.5,  # below the hatching
    )
    ax.grid(visible=False)
    ax.set_xticks(
        range(len(shares)), ["as it is" if share is None else f"{share:g}" for share in shares]
    )
    ax.set_yticks(range(len(widths)), [f"{100.0 * width:.2g}" for width in widths])
    return mesh


def _write(ax: Axes, at: tuple[int, int], cell: BenefitCell) -> None:
    """Write the ratio into its square; hatch the square where no gain is certain."""
    x, y = at
    text = "lost" if math.isnan(cell.ratio) else f"{cell.ratio:.2f}"
    if cell.pathological:
        text += "†"
    if cell.baseline and cell.baseline != cell.against:
        text += f"\n{_SHORT.get(cell.baseline, cell.baseline)}"
    plain = cell.outcome == "gain"
    ax.text(
        x,
        y,
        text,
        ha="center",
        va="center",
        fontsize=7.0,
        color="#FFFFFF" if plain and cell.ratio < _DARK else INK,
        bbox=None if plain else {"fc": "#FFFFFF", "ec": "none", "pad": 1.2},
    )
    if not plain:
        corner = (x - 0.48, y - 0.48)
        ax.add_patch(Rectangle(corner, 0.96, 0.96, fill=False, lw=0.8, **_HATCHES[cell.outcome]))


@dataclass(frozen=True)
class GainsPoint:
    """A set of gains that tuning looked at."""

    variant: MethodName  # what it was tried with
    reached: float  # longest settling, s, or what else was made small; infinite if it has none
    peak: float  # of the sensitivity
    kept: bool  # whether it keeps the other aims (overshoot, noise, effort)


@dataclass(frozen=True)
class TuningPicture:
    """What tuning found."""

    candidates: tuple[GainsPoint, ...]  # all that were looked at
    chosen: Mapping[MethodName, GainsPoint]  # of every variant
    limit: float | None  # aims, if they were given: of what was made small, and of the peak
    peak_limit: float | None
    title: str = "settling time"  # of what was made small
    unit: str = "ms"
    factor: float = 1e3  # from SI


@styled
def figure_pareto(tuning: TuningPicture) -> Figure:
    """Draw what was made small against peak sensitivity: candidates, fronts, what was chosen."""
    figure = new_figure(4.6)
    ax = figure.add_subplot()
    settled = [candidate for candidate in tuning.candidates if math.isfinite(candidate.reached)]
    for name in ordered(trial.variant for trial in settled):
        mine = [trial for trial in settled if trial.variant == name]
        for kept, alpha in ((False, 0.25), (True, 0.8)):
            some = [trial for trial in mine if trial.kept is kept]
            ax.scatter(
                [tuning.factor * one.reached for one in some],
                [one.peak for one in some],
                s=9.0,
                marker="o" if kept else "x",
                color=COLOURS[name],
                alpha=alpha,
                lw=0.8,
            )
        front = pareto_front([trial for trial in mine if trial.kept])
        values, peaks = [tuning.factor * one.reached for one in front], [one.peak for one in front]
        ax.plot(values, peaks, **line_of(name), drawstyle="steps-post", label=f"front, {name}")
        if (best := tuning.chosen.get(name)) is not None:
            point = ([tuning.factor * best.reached], [best.peak])
            label = f"chosen, {name}: {tuning.factor * best.reached:.2f} {tuning.unit}, peak {best.peak:.2f}"
            ax.plot(*point, "*", ms=13.0, mfc=COLOURS[name], mec=INK, mew=0.7, label=label)
    if tuning.limit is not None:
        ax.axvline(tuning.factor * tuning.limit, color=ALARM, lw=0.9, ls="--", label="aims")
    if tuning.peak_limit is not None:
        ax.axhline(tuning.peak_limit, color=ALARM, lw=0.9, ls="--", label="aims")
    peaks = [trial.peak for trial in settled]
    ax.set_ylim(min(0.9, *peaks), min(max(peaks), 8.0) + 0.3)
    ax.set_xlabel(f"{tuning.title} ({tuning.unit})")
    ax.set_ylabel("peak sensitivity")
    legend_below(figure, ax, columns=2)
    return figure


def pareto_front(candidates: Sequence[GainsPoint]) -> list[GainsPoint]:
    """Return those that no other one beats in both settling and peak, the fastest first."""
    front: list[GainsPoint] = []
    for candidate in sorted(candidates, key=lambda each: (each.reached, each.peak)):
        if not front or candidate.peak < front[-1].peak:
            front.append(candidate)
    return front


@dataclass(frozen=True)
class Spread:
    """One figure over many plants."""

    title: str  # what it is, with its unit
    # of every variant, one a plant; infinite where a plant failed
    values: Mapping[MethodName, FloatArray]


@styled
def figure_drift(spreads: Sequence[Spread]) -> Figure:
    """Draw the share of plants that stay below a figure, with percentiles marked."""
    figure = new_figure(3.4 * -(-len(spreads) // 3) + 0.4)
    axes = panels(figure, len(spreads))
    for ax, spread in zip(axes, spreads, strict=True):
        for name in ordered(spread.values):
            values = np.sort(spread.values[name])
            share = 100.0 * np.arange(1, values.size + 1) / values.size
            finite = np.isfinite(values)
            ax.plot(values[finite], share[finite], **line_of(name), label=name)
            marks = [percentile(values.tolist(), part) for part in PERCENTILES]
            ax.plot(marks, PERCENTILES, "o", color=COLOURS[name], ms=3.5)
        ax.set_title(spread.title)
        ax.set_ylim(0.0, 102.0)
    axes[0].set_ylabel("plants below (%)")
    legend_below(figure, *axes)
    return figure


def write_pareto(tuning: Tuning, folder: Path) -> None:
    """Write ``pareto.png`` into a folder."""
    write_png(pareto(tuning), folder / RESULTS[2])


def pareto(tuning: Tuning) -> Figure:
    """Draw what was made small against peak sensitivity of everything that was tried."""

    def candidate(variant: MethodName, aims: Aims, figures: GainFigures) -> GainsPoint:
        return GainsPoint(
            variant=variant,
            reached=figures.cost,
            peak=figures.peak_sensitivity,
            kept=keeps_others(aims, figures),
        )

    candidates = [
        candidate(name, tuned.aims, trial.outcome.worst)
        for name, tuned in tuning.tuned.items()
        for trial in tuned.found.candidates
    ]
    chosen = {
        name: candidate(name, tuned.aims, tuned.figures)
        for name, tuned in tuning.tuned.items()
        if math.isfinite(tuned.figures.cost)
    }
    least = tuning.first.figures.least
    return figure_pareto(
        TuningPicture(
            tuple(candidates),
            chosen,
            getattr(tuning.aims, least),
            tuning.aims.peak_sensitivity,
            TITLES[least].title,
            TITLES[least].unit,
            TITLES[least].factor,
        )
    )
