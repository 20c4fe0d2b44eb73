"""Provide common parts for the pages of all studies: colours, diagrams, tables, origin of files."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from matplotlib.text import Text

from anhyst.support import running_version
from anhyst.support.atomic import PathLike, atomic_writer
from anhyst.support.figures import FALLING_COLOUR, PALETTE, RISING_COLOUR, new_figure, svg_text
from anhyst.support.kinds import METHOD_TITLES, MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.page import (
    MINUS,
    NBSP,
    UNKNOWN_TEXT,
    Cell,
    Headline,
    Items,
    Note,
    PageTable,
    Picture,
    Section,
    Tile,
    Tone,
    format_number,
    make_table,
    render_page,
)
from anhyst.support.wording import capitalise
from anhyst_rigs.study.engine.table import (
    VERDICT_TITLES,
    CaseFigures,
    Cases,
    Interval,
    Judgement,
    Level,
    Metric,
)

INK_COLOUR = "#000000"
SHADE_COLOUR = "#8C8C8C"
PALE_COLOUR = "#C4C4C4"

# The dashes are for prints without colour.
_LINE_STYLES: Mapping[MethodName, tuple[str, Any]] = {
    "ratio": (FALLING_COLOUR, "-"),
    "secant": (SHADE_COLOUR, (0, (1, 1))),
    "linearised": (PALETTE["orange"], (0, (6, 1.5))),
    "single-valued": (PALETTE["pink"], (0, (3, 1))),
    "play": (PALETTE["rust"], (0, (4, 1, 1, 1, 1, 1))),
    "simplified": (PALETTE["green"], (0, (6, 1.5, 1, 1.5))),
    "at-rest": (PALETTE["slate"], (0, (5, 2))),
    "full": (RISING_COLOUR, "-"),
    "flux": (PALETTE["light blue"], (0, (2, 1, 1, 1))),
    "fused": ("#000060", (0, (8, 1))),
}
COLOURS = {name: colour for name, (colour, _) in _LINE_STYLES.items()}
DASHES = {name: dashes for name, (_, dashes) in _LINE_STYLES.items()}
_INTERVAL_DIGITS = 2
_MEAN_DIGITS = 4
_MAX_DECIMALS = 3
MAX_CURVE_POINTS = 1200
"""Maximum number of points of a curve in a figure."""


def line_style(variant: MethodName) -> dict[str, Any]:
    """Return the line style of a variant."""
    width = 1.6 if variant == "full" else 1.2
    return {"color": COLOURS[variant], "ls": DASHES[variant], "lw": width}


def sort_for_report(variants: Iterable[str]) -> list[MethodName]:
    """Return variants in the order of all figures and tables."""
    present_names = set(variants)
    return [name for name in COLOURS if name in present_names]


def reduce_curve_points(*rows: FloatArray) -> tuple[FloatArray, ...]:
    """Return rows of equal length with no more points than a plot can show.

    In each interval, the lowest and the highest value of the last row are kept, to preserve peaks.
    """
    values = rows[-1]
    interval_rows = math.ceil(2 * values.size / MAX_CURVE_POINTS)
    if interval_rows <= 2:
        return rows
    extreme_indices = {
        start + int(find_extreme(values[start : start + interval_rows]))
        for start in range(0, values.size, interval_rows)
        for find_extreme in (np.argmin, np.argmax)
    }
    index = np.array(sorted({0, *extreme_indices, values.size - 1}))
    return tuple(curve[index] for curve in rows)


def interval_text(interval: Interval | None, unit: str = "", factor: float = 1.0) -> str:
    """Return a mean and the half-width of its confidence interval, rounded up, as text.

    An infinite time becomes "never". If levitation was lost, the text is the number of losses.

    >>> interval_text(Interval(8.1234, 0.213, 20), "%").replace(NBSP, " ")
    '8.12 ± 0.22 %'
    >>> interval_text(Interval(math.nan, math.nan, 20, lost=7))
    '7 of 20 lost'
    >>> interval_text(Interval(3.6157, 0.00098, 20)), interval_text(Interval(2e-4, 0.01, 20))
    ('3.616 ± 0.001', '0.000 ± 0.010')
    """
    if interval is None:
        return UNKNOWN_TEXT
    if interval.lost:
        return f"{interval.lost} of {interval.count} lost"
    mean, width = factor * interval.mean, abs(factor) * interval.half_width
    if not math.isfinite(mean):
        return UNKNOWN_TEXT if math.isnan(mean) else "never"
    if not math.isfinite(width) or width <= 1e-9 * abs(mean):
        text = format_number(mean, 4, is_short=True)
    else:
        digits = _INTERVAL_DIGITS - 1 - math.floor(math.log10(width))
        if mean != 0.0:
            digits = min(digits, _MEAN_DIGITS - 1 - math.floor(math.log10(abs(mean))))
        decimals = min(max(digits, 0), _MAX_DECIMALS)
        half_width = math.ceil(width * 10.0**decimals - 1e-9) / 10.0**decimals
        rounded = round(mean, decimals) + 0.0  # -0.0 becomes 0.0
        text = f"{rounded:.{decimals}f} ± {half_width:.{decimals}f}".replace("-", MINUS)
    return f"{text}{NBSP}{unit}".rstrip()


def legend_below(figure: Figure, *axes: Axes, columns: int = 4) -> None:
    """Add a common legend below several panels; each label occurs once."""
    labels: dict[str, Any] = {}
    for ax in axes:
        for legend_handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            labels.setdefault(str(label), legend_handle)
    figure.legend(list(labels.values()), list(labels), loc="outside lower center", ncols=columns)


_TONE_OF_LEVEL: Mapping[Level, Tone] = {"yes": "good", "mixed": "warn", "no": "warn", "unknown": "info"}


def verdict_note(judgement: Judgement) -> Note:
    """Return a note with a verdict."""
    tone, title = _TONE_OF_LEVEL[judgement.level], VERDICT_TITLES[judgement.level]
    return Note(tone, title, f"{capitalise(judgement.text)}.")


BOX_WIDTH_IN = 2.02
BOX_HEIGHT_IN = 1.28
SOFTWARE_FILL = "#EAF3FA"
PLANT_FILL = "#F4F6F8"
_BOX_EDGE_COLOUR = "#333333"
_TITLE_SIZE_PT = 8.5
_TEXT_SIZE_PT = 7.5
_LINE_SPACING_IN = 0.155  # distance from one line of text to the next
_MAX_TEXT_TO_BOX_WIDTH = 0.86  # largest width of a text, as a fraction of the width of its box
Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class DiagramBlock:
    """A block of a diagram."""

    title: str  # title of the block
    lines: tuple[str, ...]  # further lines with values


def new_diagram(width: float, height: float) -> tuple[Figure, Axes]:
    """Create an empty diagram whose unit of length is one inch."""
    figure = new_figure(height, width=width)
    figure.set_layout_engine("none")
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set_axis_off()
    ax.grid(visible=False)
    ax.set_xlim(0.0, width)
    ax.set_ylim(0.0, height)
    return figure, ax


def draw_box(
    ax: Axes, centre: Point, name: str, block: DiagramBlock, fill: str, height: float = BOX_HEIGHT_IN
) -> None:
    """Draw a box with its title and further lines of text."""
    x, y = centre
    box_patch = FancyBboxPatch(
        (x - 0.5 * BOX_WIDTH_IN, y - 0.5 * height),
        BOX_WIDTH_IN,
        height,
        boxstyle="round,pad=0,rounding_size=0.06",
        fc=fill,
        ec=_BOX_EDGE_COLOUR,
        lw=0.9,
    )
    box_patch.set_gid(f"box-{name}")
    ax.add_patch(box_patch)
    top_line = y + 0.5 * height - 0.14
    text = ax.text(x, top_line, block.title, ha="center", va="center", weight="bold", fontsize=_TITLE_SIZE_PT)
    text.set_gid(f"title-{name}")
    _shrink_to_box(text)
    free_height = height - 0.28 - _LINE_SPACING_IN * len(block.lines)
    first_line_y = top_line - 0.14 - 0.5 * max(free_height, 0.0) - 0.5 * _LINE_SPACING_IN
    for row, line in enumerate(block.lines):
        text = ax.text(
            x, first_line_y - row * _LINE_SPACING_IN, line, ha="center", va="center", fontsize=_TEXT_SIZE_PT
        )
        text.set_gid(f"line{row}-{name}")
        _shrink_to_box(text)


def _shrink_to_box(text: Text) -> None:
    """Reduce the size of a text until it fits into its box, with a margin for wider fonts."""
    figure = text.get_figure(root=True)
    assert figure is not None
    width = text.get_window_extent(FigureCanvasAgg(figure).get_renderer()).width  # type: ignore[no-untyped-call]
    max_width = _MAX_TEXT_TO_BOX_WIDTH * BOX_WIDTH_IN * figure.dpi
    if width > max_width:
        text.set_fontsize(float(text.get_fontsize()) * max_width / width)


def draw_arrow(ax: Axes, points: Sequence[Point], colour: str = RISING_COLOUR, **style: Any) -> None:
    """Draw an arrow through several points, with its head at the last point."""
    xs, ys = zip(*points, strict=True)
    if len(points) > 2:
        ax.plot(xs[:-1], ys[:-1], color=colour, lw=1.3, solid_joinstyle="round")
    arrow_style = {"arrowstyle": "-|>", "color": colour, "lw": 1.3, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", points[-1], points[-2], arrowprops=arrow_style | style)


def draw_label(
    ax: Axes,
    position: Point,
    text: str,
    horizontal_alignment: str = "center",
    vertical_alignment: str = "bottom",
) -> None:
    """Write a label at a given point."""
    ax.text(*position, text, ha=horizontal_alignment, va=vertical_alignment, fontsize=_TEXT_SIZE_PT)


REPORT_NAME = "report.html"
"""File name of the page, in the folder of the recording."""
_METHOD_REMARKS: Mapping[MethodName, str] = {
    "ratio": "the paper's case without compensation; the negative stiffness remains",
    "secant": "the same, as a line through the origin",
    "linearised": "cancels the negative stiffness at the operating point: standard practice",
    "single-valued": "best single-valued curve",
    "play": "simplest hysteresis model: the width of the loops and one state",
    "simplified": "inverse of the simplified law",
    "at-rest": "as full, but without the eddy-current lag",
    "full": "inverse of the identified law, with its state updated by the applied current",
    "flux": "measures the flux density with a Hall probe in the gap instead of a model",
    "fused": "full, corrected by a Hall probe in the gap",
}


class TerminalSummary(NamedTuple):
    """Terminal output of a study, without losses and verdict."""

    tables: Sequence[PageTable]
    lines: Sequence[str]


def page_text(
    kind: str, headline: Headline, sections: Sequence[Section | None], source: str = "a simulation"
) -> str:
    """Return the page of a study."""
    return render_page(headline, sections, running_version(), kind=kind, source=source)


def write_page(path: PathLike, text: str) -> None:
    """Write a page as a self-contained HTML file."""
    with atomic_writer(path) as stream:
        stream.write(text)


def origin_section(files: Mapping[str, str], command: str = "", seed: int | None = None) -> Section:
    """Return the section with the SHA-256 of all input files and the command that repeats a study."""
    rows: list[list[str | Cell]] = [
        [name, Cell(f"{digest[:16]}…", code=True)] for name, digest in files.items()
    ]
    texts = [] if seed is None else [f"Seed {seed}; the same seed gives the same results."]
    texts += [f"Made by: {command}"] if command else []
    blocks = [make_table("Files", ["file", "SHA-256"], rows, texts=2)] if rows else []
    page_items = [Items("How to repeat the study", tuple(texts))] if texts else []
    return Section("origin", "Origin", (*blocks, *page_items))


def file_hashes(files: Sequence[Path]) -> dict[str, str]:
    """Return the SHA-256 of each file, by file name."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def picture(figure: Figure, key: str, alt: str, caption: str) -> Picture:
    """Return a figure with its caption and with a description in words."""
    return Picture(svg_text(figure, key), alt, caption)


def comparison_tile(metric: Metric, own_value: float, other_value: float, name: str) -> Tile:
    """Return a tile with a number in large type, and with the value for comparison."""
    texts = [
        f"{format_number(metric.factor * value, 2)}{NBSP}{metric.unit}" for value in (own_value, other_value)
    ]
    return Tile(texts[0], metric.title, f"{name}: {texts[1]}")


def method_table(
    title: str,
    metrics: Sequence[Metric],
    methods: Mapping[str, Callable[[str], Interval | None]],
    caption: str = "",
) -> PageTable:
    """Return a table for one case: one row per method and one column per metric.

    Each method is given as a function that returns its value for the key of a metric.
    """

    def cell(interval_of: Callable[[str], Interval | None], metric: Metric) -> str:
        return interval_text(interval_of(metric.key), factor=metric.factor).replace(" ", NBSP)

    rows = [
        [name, *(cell(value_of_key, metric) for metric in metrics)] for name, value_of_key in methods.items()
    ]
    return make_table(title, ["variant", *(metric.heading for metric in metrics)], rows, caption)


def case_table(
    metric: Metric, cases: Cases, caption: str = "", remark: Callable[[CaseFigures], str] | None = None
) -> PageTable:
    """Return a table for one metric: one row per case and one column per method."""
    methods = sort_for_report(name for method_cells in cases.values() for name in method_cells)

    def cell(case: str, name: MethodName) -> str:
        """Return a value and its remark; a line break is possible only between them."""
        if name not in cases[case]:
            return interval_text(None)
        figures = cases[case][name]
        text = interval_text(figures.interval(metric.key), factor=metric.factor)
        text_parts = (text, "" if remark is None else remark(figures))
        return " ".join(text_part.replace(" ", NBSP) for text_part in text_parts if text_part)

    rows = [[case, *(cell(case, name) for name in methods)] for case in cases]
    counts = [figures.interval(metric.key).count for row in cases.values() for figures in row.values()]
    count_range = " to ".join(str(count) for count in sorted({min(counts), max(counts)}))
    interval = f"Mean and 95 % confidence interval over {count_range} noise seeds."
    return make_table(metric.heading, ["", *methods], rows, f"{caption} {interval}".strip())


def legend_table(methods: Sequence[MethodName]) -> PageTable:
    """Return a table that explains the variants."""
    rows: list[list[str | Cell]] = [
        [Cell(name, code=True), METHOD_TITLES[name], _METHOD_REMARKS[name]] for name in methods
    ]
    return make_table(
        "Variants",
        ["name", "from demanded force to current", "remark"],
        rows,
        "All are fitted to the same measured loops, except flux, which uses static measurements "
        "with its probe.",
        texts=3,
    )
