"""The structure of the simulated loop (the paper's Fig. 10), with its actual numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch
from matplotlib.text import Text

from anhyst.control.controller_file import ControllerTable
from anhyst.reports.bearing.blocks import DiagramBlock, blocks_of, feedback
from anhyst.rig.bearing.file import BearingRig
from anhyst.support.page.style import FALLING, RISING, new_figure, styled

# Everything in inches of the figure, so that text and boxes keep their proportion.
_WIDE, _HIGH, _APART = 2.02, 1.28, 0.46
_LEFT, _TOP, _MIDDLE, _LOW = 0.62, 3.95, 1.95, 0.56
_LOAD_HIGH = 0.96
_FIGURE = (_LEFT + 4 * _WIDE + 3 * _APART + 0.5, 4.8)
_TITLE, _TEXT = 8.5, 7.5  # points
_LINE = 0.155  # inches from line to line
_FILL = 0.86  # of the width of a box that a text may take up

_SOFTWARE, _PLANT, _INK = "#EAF3FA", "#F4F6F8", "#333333"
Place = tuple[float, float]


@styled
def figure_structure(rig: BearingRig, controller: ControllerTable) -> Figure:
    """Draw the loop: controller above, magnet and armature below."""
    figure = new_figure(_FIGURE[1], width=_FIGURE[0])
    figure.set_layout_engine("none")
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set_axis_off()
    ax.grid(visible=False)
    ax.set_xlim(0.0, _FIGURE[0])
    ax.set_ylim(0.0, _FIGURE[1])
    blocks = blocks_of(rig, controller)
    columns = [_LEFT + 0.5 * _WIDE + index * (_WIDE + _APART) for index in range(4)]
    above = ("controller", "compensator", "output", "amplifier")
    below = ("sensors", "mechanics", "hysteresis", "electrical")
    for x, name in zip(columns, above, strict=True):
        _box(ax, (x, _TOP), name, blocks[name], _SOFTWARE if name in above[:2] else _PLANT)
    for x, name in zip(columns, below, strict=True):
        _box(ax, (x, _MIDDLE), name, blocks[name], _PLANT)
    _box(ax, (columns[0], _LOW), "load", blocks["load"], _PLANT, _LOAD_HIGH)
    _signals(ax, columns, feedback(controller))
    return figure


def _signals(ax: Axes, columns: Sequence[float], inputs: str) -> None:
    """Draw what goes from block to block."""
    half, lid = 0.5 * _WIDE, 0.5 * _HIGH
    for index, name in enumerate(("F wanted", "i wanted", "i ref")):
        x = columns[index] + half
        _arrow(ax, [(x, _TOP), (x + _APART, _TOP)])
        _label(ax, (x + 0.5 * _APART, _TOP + 0.08), name.replace(" ", "\n"))
    _arrow(ax, [(columns[3], _TOP - lid), (columns[3], _MIDDLE + lid)])
    _label(ax, (columns[3] + 0.08, 0.5 * (_TOP + _MIDDLE)), "voltage u", "left", "center")
    for index, name in ((3, "i, ψ"), (2, "force"), (1, "gap")):
        x = columns[index] - half
        _arrow(ax, [(x, _MIDDLE), (x - _APART, _MIDDLE)], FALLING if index == 2 else RISING)
        _label(ax, (x - 0.5 * _APART, _MIDDLE + 0.08), name)
    # Reference from the left; the measured gap from below.
    _arrow(ax, [(0.06, _TOP), (_LEFT, _TOP)])
    _label(ax, (0.5 * _LEFT, _TOP + 0.08), "gap\nwanted")
    _arrow(ax, [(columns[0], _MIDDLE + lid), (columns[0], _TOP - lid)])
    _label(ax, (columns[0] - 0.08, 0.5 * (_TOP + _MIDDLE)), "measured gap", "right", "center")
    lane = 0.5 * (_TOP + _MIDDLE)
    _arrow(ax, [(columns[0], lane), (columns[1], lane), (columns[1], _TOP - lid)])
    ax.add_patch(Circle((columns[0], lane), 0.035, fc=RISING, ec=RISING))
    _label(ax, (0.5 * (columns[0] + columns[1]), lane + 0.05), inputs)
    _from_below(ax, columns)


def _from_below(ax: Axes, columns: Sequence[float]) -> None:
    """Draw load and moving gap, on lanes below the plant."""
    half, floor = 0.5 * _WIDE, _MIDDLE - 0.5 * _HIGH
    left = columns[1] - 0.5 * half
    _arrow(ax, [(columns[0] + half, _LOW), (left, _LOW), (left, floor)], FALLING)
    _label(ax, (0.5 * (columns[0] + half + left), _LOW + 0.05), "load")
    start, lane = columns[1] + 0.5 * half, 0.5 * (_LOW + floor)
    ax.plot([start, start], [floor, lane], color=RISING, lw=1.3)
    _arrow(ax, [(start, lane), (columns[3], lane), (columns[3], floor)])
    _arrow(ax, [(columns[2], lane), (columns[2], floor)])
    ax.add_patch(Circle((columns[2], lane), 0.035, fc=RISING, ec=RISING))
    _label(ax, (0.5 * (columns[2] + columns[3]), lane + 0.05), "gap and its velocity")


def _box(
    ax: Axes, centre: Place, name: str, block: DiagramBlock, fill: str, high: float = _HIGH
) -> None:
    x, y = centre
    shape = FancyBboxPatch(
        (x - 0.5 * _WIDE, y - 0.5 * high),
        _WIDE,
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
    room = _FILL * _WIDE * figure.dpi
    if width > room:
        text.set_fontsize(float(text.get_fontsize()) * room / width)


def _arrow(ax: Axes, corners: Sequence[Place], colour: str = RISING) -> None:
    """Go along corners, with a head at the last one."""
    xs, ys = zip(*corners, strict=True)
    if len(corners) > 2:
        ax.plot(xs[:-1], ys[:-1], color=colour, lw=1.3, solid_joinstyle="round")
    style: dict[str, Any] = {"arrowstyle": "-|>", "color": colour, "lw": 1.3}
    ax.annotate("", corners[-1], corners[-2], arrowprops={**style, "shrinkA": 0, "shrinkB": 0})


def _label(ax: Axes, place: Place, text: str, across: str = "center", up: str = "bottom") -> None:
    ax.text(*place, text, ha=across, va=up, fontsize=_TEXT)
