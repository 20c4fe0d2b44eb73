"""How the figures of a study look: a colour and a dash for every variant; boxes of block diagrams."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from matplotlib.text import Text

from anhyst.study.engine.verdict import TITLES, Interval, Judgement, Level
from anhyst.support.figures import FALLING, RISING, new_figure
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.page import MINUS, NBSP, NOT_KNOWN, Note, Tone, number

INK = "#000000"
SHADE = "#8C8C8C"
PALE = "#C4C4C4"

# Okabe and Ito, and dashes beside them, for print without colour.
COLOURS: Mapping[MethodName, str] = {
    "ratio": FALLING,
    "secant": "#7A4B21",
    "linearised": "#E69F00",
    "single-valued": "#CC79A7",
    "play": "#882255",
    "simplified": "#009E73",
    "at-rest": "#8C8C8C",
    "full": RISING,
    "flux": "#56B4E9",
    "fused": "#6A3D9A",
}
DASHES: Mapping[MethodName, Any] = {
    "ratio": "-",
    "secant": (0, (1, 1)),
    "linearised": (0, (6, 1.5)),
    "single-valued": (0, (3, 1)),
    "play": (0, (4, 1, 1, 1, 1, 1)),
    "simplified": (0, (6, 1.5, 1, 1.5)),
    "at-rest": (0, (5, 2)),
    "full": "-",
    "flux": (0, (2, 1, 1, 1)),
    "fused": (0, (8, 1)),
}
_WIDTH_DIGITS, _MEAN_DIGITS, _PLACES = 2, 4, 3
MOST_POINTS = 1200
"""Points of a curve in a figure at most."""


def line_of(variant: MethodName) -> dict[str, Any]:
    """Return how the line of a variant is drawn."""
    width = 1.6 if variant == "full" else 1.2
    return {"color": COLOURS[variant], "ls": DASHES[variant], "lw": width}


def ordered(variants: Iterable[str]) -> list[MethodName]:
    """Return variants in the order in which every figure and table has them."""
    present = set(variants)
    return [name for name in COLOURS if name in present]


def thinned(*rows: FloatArray) -> tuple[FloatArray, ...]:
    """Return rows of equal length with no more points than a figure can show.

    From every stretch the lowest and the highest value of the last row are kept: peaks stay.
    """
    shape = rows[-1]
    every = math.ceil(2 * shape.size / MOST_POINTS)
    if every <= 2:
        return rows
    kept = {
        start + int(extreme(shape[start : start + every]))
        for start in range(0, shape.size, every)
        for extreme in (np.argmin, np.argmax)
    }
    index = np.array(sorted({0, *kept, shape.size - 1}))
    return tuple(row[index] for row in rows)


def interval_text(interval: Interval | None, unit: str = "", factor: float = 1.0) -> str:
    """Write a mean with the half width of its confidence interval, rounded up.

    An infinite time is "never"; where levitation was lost, how often.

    >>> interval_text(Interval(8.1234, 0.213, 20), "%").replace(NBSP, " ")
    '8.12 ± 0.22 %'
    >>> interval_text(Interval(math.nan, math.nan, 20, lost=7))
    '7 of 20 lost'
    >>> interval_text(Interval(3.6157, 0.00098, 20)), interval_text(Interval(2e-4, 0.01, 20))
    ('3.616 ± 0.001', '0.000 ± 0.010')
    """
    if interval is None:
        return NOT_KNOWN
    if interval.lost:
        return f"{interval.lost} of {interval.count} lost"
    mean, width = factor * interval.mean, abs(factor) * interval.half_width
    if not math.isfinite(mean):
        return NOT_KNOWN if math.isnan(mean) else "never"
    if not math.isfinite(width) or width <= 1e-9 * abs(mean):
        text = number(mean, 4, short=True)
    else:
        digits = _WIDTH_DIGITS - 1 - math.floor(math.log10(width))
        if mean != 0.0:
            digits = min(digits, _MEAN_DIGITS - 1 - math.floor(math.log10(abs(mean))))
        places = min(max(digits, 0), _PLACES)
        unsure = math.ceil(width * 10.0**places - 1e-9) / 10.0**places
        rounded = round(mean, places) + 0.0  # a negative zero becomes a plain one
        text = f"{rounded:.{places}f} ± {unsure:.{places}f}".replace("-", MINUS)
    return f"{text}{NBSP}{unit}".rstrip()


def legend_below(figure: Figure, *axes: Axes, columns: int = 4) -> None:
    """Put one legend for several panels below them, each label once."""
    labels: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            labels.setdefault(str(label), handle)
    figure.legend(list(labels.values()), list(labels), loc="outside lower center", ncols=columns)


_TONES: Mapping[Level, Tone] = {"yes": "good", "mixed": "warn", "no": "warn", "unknown": "info"}


def verdict_note(judgement: Judgement) -> Note:
    """Return it as a box."""
    text = f"{judgement.text[:1].upper()}{judgement.text[1:]}."
    return Note(_TONES[judgement.level], TITLES[judgement.level], text)


WIDE, HIGH = 2.02, 1.28
SOFTWARE, PLANT = "#EAF3FA", "#F4F6F8"
_INK = "#333333"
_TITLE, _TEXT = 8.5, 7.5  # points
_LINE = 0.155  # inches from line to line
_FILL = 0.86  # of the width of a box that a text may take up
Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class DiagramBlock:
    """A block of the diagram."""

    title: str  # what it is
    lines: tuple[str, ...]  # its numbers


def new_diagram(width: float, height: float) -> tuple[Figure, Axes]:
    """Start a diagram: text and boxes keep their proportion."""
    figure = new_figure(height, width=width)
    figure.set_layout_engine("none")
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set_axis_off()
    ax.grid(visible=False)
    ax.set_xlim(0.0, width)
    ax.set_ylim(0.0, height)
    return figure, ax


def draw_box(
    ax: Axes, centre: Place, name: str, block: DiagramBlock, fill: str, high: float = HIGH
) -> None:
    """Draw a box with its title and the lines below it."""
    x, y = centre
    shape = FancyBboxPatch(
        (x - 0.5 * WIDE, y - 0.5 * high),
        WIDE,
        high,
        boxstyle="round,pad=0,rounding_size=0.06",
        fc=fill,
        ec=_INK,
        lw=0.9,
    )
    shape.set_gid(f"box-{name}")
    ax.add_patch(shape)
    top = y + 0.5 * high - 0.14
    text = ax.text(x, top, block.title, ha="center", va="center", weight="bold", fontsize=_TITLE)
    text.set_gid(f"title-{name}")
    _fit(text)
    spare = high - 0.28 - _LINE * len(block.lines)
    first = top - 0.14 - 0.5 * max(spare, 0.0) - 0.5 * _LINE
    for row, line in enumerate(block.lines):
        text = ax.text(x, first - row * _LINE, line, ha="center", va="center", fontsize=_TEXT)
        text.set_gid(f"line{row}-{name}")
        _fit(text)


def _fit(text: Text) -> None:
    """Make a text smaller until it keeps within its box, with room for a wider typeface."""
    figure = text.get_figure(root=True)
    assert figure is not None
    width = text.get_window_extent(FigureCanvasAgg(figure).get_renderer()).width  # type: ignore[no-untyped-call]
    room = _FILL * WIDE * figure.dpi
    if width > room:
        text.set_fontsize(float(text.get_fontsize()) * room / width)


def draw_arrow(ax: Axes, corners: Sequence[Place], colour: str = RISING, **style: Any) -> None:
    """Go along corners, with a head at the last one."""
    xs, ys = zip(*corners, strict=True)
    if len(corners) > 2:
        ax.plot(xs[:-1], ys[:-1], color=colour, lw=1.3, solid_joinstyle="round")
    head = {"arrowstyle": "-|>", "color": colour, "lw": 1.3, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", corners[-1], corners[-2], arrowprops=head | style)


def draw_label(ax: Axes, at: Place, text: str, across: str = "center", up: str = "bottom") -> None:
    """Write a label at a place."""
    ax.text(*at, text, ha=across, va=up, fontsize=_TEXT)
