"""The common style of all Matplotlib figures, and their export as SVG and PNG."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping
from functools import wraps
from types import MappingProxyType
from typing import Any, ParamSpec, TypeVar, cast

import matplotlib as mpl
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from anhyst.support.atomic import PathLike, write_bytes

P = ParamSpec("P")
T = TypeVar("T")

PALETTE: Mapping[str, str] = MappingProxyType(
    {
        "blue": "#0072B2",
        "vermilion": "#D55E00",
        "green": "#009E73",
        "pink": "#CC79A7",
        "orange": "#E69F00",
        "light blue": "#56B4E9",
        "slate": "#486060",
        "rust": "#903018",
    }
)
"""Colours of lines: six of Okabe and Ito, and two that remain distinct from them in all kinds of
colour vision. The live page has the same colours in `colours.js`.
"""
RISING_COLOUR = PALETTE["blue"]
FALLING_COLOUR = PALETTE["vermilion"]
MODEL_COLOUR = PALETTE["blue"]
MEASURED_COLOUR = "#8C8C8C"
ALARM_COLOUR = "#B00020"
FAINT_COLOUR = "#D9D9D9"

FIGURE_WIDTH_IN = 9.6
PIXELS_PER_INCH = 100  # pixels on a page per inch of a figure
RASTER_DPI = 200  # dots per inch of rasterised points

STYLE: Mapping[str, Any] = MappingProxyType(
    {
        "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans"],
        "font.size": 9.0,
        "axes.titlesize": 9.5,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.edgecolor": "#555555",
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.prop_cycle": cycler(color=list(PALETTE.values())),
        "grid.color": "#E3E3E3",
        "grid.linewidth": 0.6,
        "lines.solid_capstyle": "round",
        "legend.frameon": False,
        "legend.fontsize": 9.0,
        "mathtext.default": "it",
        "mathtext.fontset": "dejavusans",
        "svg.fonttype": "none",
        "svg.hashsalt": "anhyst",
        "path.simplify": True,
    }
)

_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}


def use_report_style(draw: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function so that it draws in the report style, not with settings of the user."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> T:
        with mpl.rc_context(cast("Any", dict(STYLE))):
            return draw(*args, **kwargs)

    return drawn


def new_figure(height: float, width: float = FIGURE_WIDTH_IN) -> Figure:
    """Create a figure; sizes in inches."""
    return Figure(figsize=(width, height), layout="constrained")


def create_panels(figure: Figure, count: int, *, share_y: bool = False) -> list[Axes]:
    """Divide a figure into panels, row by row, in as many columns as are readable."""
    columns = column_count(count)
    rows = -(-count // columns)
    axes = figure.subplots(rows, columns, squeeze=False, sharey=share_y).ravel().tolist()
    for ax in axes[count:]:
        ax.remove()
    return list(axes[:count])


def column_count(count: int) -> int:
    """Return the number of columns in which a number of panels is readable."""
    return 2 if count in {2, 4} else min(count, 3)


@use_report_style
def svg_text(figure: Figure, prefix: str) -> str:
    """Render a figure as an SVG element; ``prefix`` makes its identifiers unique on a page."""
    stream = io.StringIO()
    figure.savefig(stream, format="svg", dpi=RASTER_DPI, metadata=_NO_METADATA)
    text = stream.getvalue()
    text = text[text.index("<svg") :].strip()
    text = re.sub(r"\bid=\"", f'id="{prefix}-', text)
    text = text.replace("url(#", f"url(#{prefix}-").replace('href="#', f'href="#{prefix}-')
    # The page contains the alternative text. A screen reader must not read the tick labels.
    width = round(PIXELS_PER_INCH * figure.get_figwidth())
    start_tag = f'<svg aria-hidden="true" focusable="false" style="--width: {width}px"'
    return re.sub(r"^<svg\b", start_tag, text)


@use_report_style
def write_png(figure: Figure, path: PathLike) -> None:
    """Write a figure as a PNG file without a time stamp."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=150, metadata={"Software": None})
    write_bytes(path, stream.getvalue())


@use_report_style
def write_svg(figure: Figure, path: PathLike) -> None:
    """Write a figure as an SVG file without a time stamp."""
    stream = io.BytesIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    write_bytes(path, stream.getvalue())
