"""The hardware structure of a rig (the paper's Fig. 6), with its actual numbers."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from anhyst.rig.force.file import Rig
from anhyst.support.page.style import FALLING, RISING, new_figure, styled

_WIDE, _HIGH = 2.5, 1.15
_INK = "#333333"
_FILL = "#F4F6F8"

_Place = tuple[float, float]


@styled
def figure_hardware(rig: Rig, board: str) -> Figure:
    """Draw what is connected to what."""
    settings = rig.settings
    amplifier, force = settings.amplifier, settings.force_sensor
    gap = settings.gap_sensor.sensor()
    figure = new_figure(3.9)
    ax = figure.add_subplot()
    ax.set_axis_off()
    ax.grid(visible=False)
    actuator, turns = rig.actuator_text
    boxes: dict[str, tuple[_Place, str, str]] = {
        "pc": ((0.0, 2.0), "PC", "demands, recording"),
        "controller": (
            (4.0, 2.0),
            "embedded controller",
            f"board {board}, {settings.timing.rate_Hz:g} ticks/s\nfixed point, one tick of delay",
        ),
        "amplifier": (
            (8.0, 2.0),
            "current amplifier",
            f"0 to {amplifier.current_high_A:g} A, {amplifier.dac_bits} bits\n"
            f"{amplifier.bandwidth_Hz:g} Hz, {amplifier.slew_A_per_s:g} A/s",
        ),
        "solenoid": (
            (8.0, 0.0),
            actuator,
            f"{turns} turns, {settings.force.force_max_N:g} N\ngap {_stroke(rig)} mm",
        ),
        "lvdt": (
            (4.0, 0.0),
            settings.gap_sensor.kind,
            f"{1e6 * gap.step:.3g} um steps over {1e3 * (gap.high - gap.low):g} mm\n"
            f"{1e6 * gap.noise:g} um rms, {gap.bandwidth:g} Hz",
        ),
        "force": (
            (0.0, 0.0),
            "force sensor",
            f"{force.adc_bits} bits over {force.high_N - force.low_N:g} N\n"
            f"{force.noise_N:g} N rms, {force.bandwidth_Hz:g} Hz",
        ),
    }
    for spot, title, text in boxes.values():
        _box(ax, spot, title, text)
    centre = {name: spot for name, (spot, _, _) in boxes.items()}
    _arrow(ax, centre["pc"], centre["controller"], "serial link\nforce out, status back", both=True)
    _arrow(ax, centre["controller"], centre["amplifier"], "current")
    _arrow(ax, centre["amplifier"], centre["solenoid"], "")
    _arrow(ax, centre["solenoid"], centre["lvdt"], "armature", colour=FALLING)
    _arrow(ax, centre["lvdt"], centre["controller"], "")
    _arrow(ax, centre["force"], centre["controller"], "force", dashed=True)
    _around(ax, centre["solenoid"], centre["force"])
    ax.set_xlim(-1.4, 9.4)
    ax.set_ylim(-1.35, 2.75)
    return figure


def _stroke(rig: Rig) -> str:
    positions = rig.settings.held.gaps_m
    return f"{1e3 * min(positions):g} to {1e3 * max(positions):g}"


def _box(ax: Axes, centre: _Place, title: str, text: str) -> None:
    x, y = centre
    corner = (x - 0.5 * _WIDE, y - 0.5 * _HIGH)
    shape = FancyBboxPatch(
        corner, _WIDE, _HIGH, boxstyle="round,pad=0,rounding_size=0.08", fc=_FILL, ec=_INK, lw=0.9
    )
    ax.add_patch(shape)
    ax.text(x, y + 0.36, title, ha="center", va="center", weight="bold", fontsize=8.5)
    ax.text(x, y - 0.14, text, ha="center", va="center", fontsize=7.5)


def _arrow(
    ax: Axes,
    begin: _Place,
    end: _Place,
    text: str,
    *,
    both: bool = False,
    dashed: bool = False,
    colour: str = RISING,
) -> None:
    """From the rim of one box to that of another, straight along a row, a column or a diagonal."""
    (x0, y0), (x1, y1) = begin, end
    across, up = x1 - x0, y1 - y0
    tail = (x0 + 0.5 * _WIDE * _sign(across), y0 + 0.5 * _HIGH * (_sign(up) if not across else 0))
    head = (x1 - 0.5 * _WIDE * _sign(across), y1 - 0.5 * _HIGH * (_sign(up) if not across else 0))
    if across and up:
        tail, head = (x0 + 0.3 * _WIDE, y0 + 0.5 * _HIGH), (x1 - 0.3 * _WIDE, y1 - 0.5 * _HIGH)
    style: dict[str, Any] = {"arrowstyle": "<|-|>" if both else "-|>", "color": colour, "lw": 1.3}
    if dashed:
        style["linestyle"] = (0, (4, 2))
    ax.annotate("", head, tail, arrowprops=style)
    middle = (0.5 * (tail[0] + head[0]), 0.5 * (tail[1] + head[1]))
    ax.text(middle[0], middle[1] + 0.1, text, ha="center", va="bottom", fontsize=7.5)


def _around(ax: Axes, begin: _Place, end: _Place) -> None:
    """Below the boxes, from one to the other: what the armature pulls at."""
    (x0, y0), (x1, y1) = begin, end
    low = y0 - 0.5 * _HIGH - 0.45
    ax.plot([x0, x0, x1], [y0 - 0.5 * _HIGH, low, low], color=FALLING, lw=1.3)
    style = {"arrowstyle": "-|>", "color": FALLING, "lw": 1.3}
    ax.annotate("", (x1, y1 - 0.5 * _HIGH), (x1, low), arrowprops=style)
    ax.text(0.5 * (x0 + x1), low + 0.06, "force", ha="center", va="bottom", fontsize=7.5)


def _sign(value: float) -> float:
    return float((value > 0.0) - (value < 0.0))
