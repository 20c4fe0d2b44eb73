"""Figures over many runs: where compensation gains, what tuning can choose from, drift."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from anhyst.report.style import ALARM, new_figure, panels, styled
from anhyst.simulate.controllerfile import Variant
from anhyst.simulate.metrics import Interval
from anhyst.simulate.montecarlo import PERCENTILES, percentile
from anhyst.simulate.report.look import (
    COLOURS,
    INK,
    Floats,
    legend_below,
    line_of,
    ordered,
)


@dataclass(frozen=True)
class BenefitCell:
    """Overshoot with compensation over that with a baseline, for one iron and one step.

    Parameters
    ----------
    loop_width : float
        Of the iron's force loop, as a share of the largest force.
    reversible : float
        Reversible fraction of the iron.
    height : float
        Of the step, m.
    baseline : str
        Variant that is compared with.
    ratio : Interval
        Below 1 where compensation gains.
    """

    loop_width: float
    reversible: float
    height: float
    baseline: Variant
    ratio: Interval

    @property
    def gains(self) -> bool:
        """Whether a gain is certain: the whole confidence interval lies below 1."""
        return self.ratio.mean + self.ratio.half_width < 1.0


@styled
def figure_benefit(cells: Sequence[BenefitCell], variant: str) -> Figure:
    """Draw the ratio of overshoots over irons: one row a baseline, one column a step height.

    Parameters
    ----------
    cells : sequence of BenefitCell
        At least one; where one is missing the map stays white.
    variant : str
        Whose overshoot is divided by that of the baseline.
    """
    baselines = ordered(cell.baseline for cell in cells)
    heights = sorted({cell.height for cell in cells})
    figure = new_figure(1.1 + 2.3 * len(baselines), width=max(6.4, 1.2 + 2.3 * len(heights)))
    axes = figure.subplots(len(baselines), len(heights), squeeze=False, sharex=True, sharey=True)
    mesh: QuadMesh | None = None
    for row, baseline in zip(axes, baselines, strict=True):
        for ax, height in zip(row, heights, strict=True):
            chosen = [c for c in cells if c.baseline == baseline and c.height == height]
            mesh = _map(ax, cells, chosen)
            ax.set_title(f"{1e6 * height:g} µm, against {baseline}", fontsize=8.5)
        row[0].set_ylabel("loop width (% of largest force)")
    for ax in axes[-1]:
        ax.set_xlabel("reversible fraction")
    assert mesh is not None
    bar = figure.colorbar(mesh, ax=axes, shrink=0.8, extend="max")
    bar.set_label(f"overshoot of {variant} / overshoot of the baseline")
    figure.legend(
        [Rectangle((0, 0), 1, 1, fc="none", ec=ALARM, hatch="////", lw=0.8)],
        ["no certain gain: the confidence interval reaches 1"],
        loc="outside lower center",
    )
    return figure


def _map(ax: Axes, cells: Sequence[BenefitCell], chosen: Sequence[BenefitCell]) -> QuadMesh:
    widths = sorted({cell.loop_width for cell in cells})
    shares = sorted({cell.reversible for cell in cells})
    ratios = np.full((len(widths), len(shares)), np.nan)
    for cell in chosen:
        y, x = widths.index(cell.loop_width), shares.index(cell.reversible)
        ratios[y, x] = cell.ratio.mean
        dark = not 0.35 < cell.ratio.mean < 1.7
        text = f"{cell.ratio.mean:.2f}" if math.isfinite(cell.ratio.mean) else "never"
        ax.text(
            x,
            y,
            text,
            ha="center",
            va="center",
            fontsize=8.0,
            color="#FFFFFF" if dark and cell.gains else INK,
            bbox=None if cell.gains else {"fc": "#FFFFFF", "ec": "none", "pad": 1.2},
        )
        if not cell.gains:
            ax.add_patch(
                Rectangle(
                    (x - 0.48, y - 0.48), 0.96, 0.96, fill=False, ec=ALARM, hatch="////", lw=0.8
                )
            )
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
    ax.set_xticks(range(len(shares)), [f"{share:g}" for share in shares])
    ax.set_yticks(range(len(widths)), [f"{100.0 * width:.2g}" for width in widths])
    return mesh


@dataclass(frozen=True)
class Candidate:
    """A set of gains that tuning looked at.

    Parameters
    ----------
    variant : str
        What it was tried with.
    settling : float
        Longest, s; infinite if it does not.
    peak : float
        Of the sensitivity.
    kept : bool
        Whether it keeps the other aims (overshoot, noise, effort).
    """

    variant: Variant
    settling: float
    peak: float
    kept: bool


@dataclass(frozen=True)
class Tuning:
    """What tuning found.

    Parameters
    ----------
    candidates : tuple of Candidate
        All that were looked at.
    chosen : mapping of str to Candidate
        Of every variant.
    settling_limit, peak_limit : float or None
        Aims, if they were given. s, and a ratio.
    """

    candidates: tuple[Candidate, ...]
    chosen: Mapping[Variant, Candidate]
    settling_limit: float | None
    peak_limit: float | None


@styled
def figure_pareto(tuning: Tuning) -> Figure:
    """Draw settling against peak sensitivity: candidates, fronts, what was chosen.

    Parameters
    ----------
    tuning : Tuning
        With at least one candidate that settles.
    """
    figure = new_figure(4.6)
    ax = figure.add_subplot()
    settled = [one for one in tuning.candidates if math.isfinite(one.settling)]
    for name in ordered(one.variant for one in settled):
        mine = [one for one in settled if one.variant == name]
        for kept, alpha in ((False, 0.25), (True, 0.8)):
            some = [one for one in mine if one.kept is kept]
            ax.scatter(
                [1e3 * one.settling for one in some],
                [one.peak for one in some],
                s=9.0,
                marker="o" if kept else "x",
                color=COLOURS[name],
                alpha=alpha,
                lw=0.8,
            )
        front = pareto_front([one for one in mine if one.kept])
        times, peaks = [1e3 * one.settling for one in front], [one.peak for one in front]
        ax.plot(times, peaks, **line_of(name), drawstyle="steps-post", label=f"front, {name}")
        if (best := tuning.chosen.get(name)) is not None:
            place = ([1e3 * best.settling], [best.peak])
            label = f"chosen, {name}: {1e3 * best.settling:.2f} ms, peak {best.peak:.2f}"
            ax.plot(*place, "*", ms=13.0, mfc=COLOURS[name], mec=INK, mew=0.7, label=label)
    if tuning.settling_limit is not None:
        ax.axvline(1e3 * tuning.settling_limit, color=ALARM, lw=0.9, ls="--", label="aims")
    if tuning.peak_limit is not None:
        ax.axhline(tuning.peak_limit, color=ALARM, lw=0.9, ls="--", label="aims")
    peaks = [one.peak for one in settled]
    ax.set_ylim(min(0.9, *peaks), min(max(peaks), 8.0) + 0.3)
    ax.set_xlabel("settling time (ms)")
    ax.set_ylabel("peak sensitivity")
    legend_below(figure, ax, columns=2)
    return figure


def pareto_front(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return those that no other one beats in both settling and peak, the fastest first."""
    front: list[Candidate] = []
    for one in sorted(candidates, key=lambda each: (each.settling, each.peak)):
        if not front or one.peak < front[-1].peak:
            front.append(one)
    return front


@dataclass(frozen=True)
class Spread:
    """One figure over many plants.

    Parameters
    ----------
    title : str
        What it is, with its unit.
    values : mapping of str to ndarray
        Of every variant, one a plant; infinite where a plant failed.
    """

    title: str
    values: Mapping[Variant, Floats]


@styled
def figure_drift(spreads: Sequence[Spread]) -> Figure:
    """Draw the share of plants that stay below a figure, with percentiles marked.

    Parameters
    ----------
    spreads : sequence of Spread
        At least one.
    """
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
