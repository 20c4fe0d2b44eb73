"""Figures over frequency: sensitivity with the zones of ISO 14839-3, Bode and Nyquist plots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from anhyst.reports.bearing.look import COLOURS, INK, SHADE, legend_below, line_of, ordered
from anhyst.study.bearing.linear import BOUNDARIES, zone
from anhyst.support.figures import ALARM, new_figure, styled
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray

_ZONES = ("#E4F2EC", "#FFF7DC", "#FCE6D2", "#F8D7DA")
_FLOOR, _CEILING = -40.0, 20.0  # dB, at least shown


@dataclass(frozen=True)
class Response:
    """A complex number over frequency."""

    frequency: FloatArray  # Hz, rising; shape (n,)
    value: NDArray[np.complex128]  # sensitivity or loop gain; shape (n,)
    note: str = ""  # for the legend, such as that the loop is unstable

    @property
    def decibel(self) -> FloatArray:
        """Magnitude, dB."""
        return np.asarray(20.0 * np.log10(np.maximum(np.abs(self.value), 1e-12)))

    @property
    def peak(self) -> float:
        """Largest magnitude."""
        return float(np.abs(self.value).max())


Responses = Mapping[MethodName, Response]
"""Of every variant."""


@styled
def figure_sensitivity(measured: Responses, linear: Responses) -> Figure:
    """Draw the sensitivity of the running loop, the linearised one, and the zones."""
    figure = new_figure(4.4)
    ax = figure.add_subplot()
    highest = max((curve.decibel.max() for curve in measured.values()), default=0.0)
    top = max(_CEILING, 3.0 + float(highest))
    _zones(ax, top)
    for name in ordered(measured):
        curve = measured[name]
        label = f"{name}: peak {curve.peak:.2f}, zone {zone(curve.peak)}"
        style = line_of(name)
        ax.semilogx(
            curve.frequency, curve.decibel, **style, marker="o", ms=3.0, label=_with(label, curve)
        )
    for name in ordered(linear):
        curve = linear[name]
        ax.semilogx(curve.frequency, curve.decibel, color=COLOURS[name], lw=0.7, ls=":")
    if linear:
        ax.plot([], [], color=INK, lw=0.7, ls=":", label="linearised loop")
    ax.set_ylim(_FLOOR, top)
    ends = [end for curve in measured.values() for end in curve.frequency[[0, -1]]]
    ax.set_xlim(min(ends), max(ends))
    ax.set_xlabel("frequency (Hz)")
    ax.set_ylabel("sensitivity (dB)")
    legend_below(figure, ax, columns=2)
    return figure


def _zones(ax: Axes, top: float) -> None:
    """Shade and name the zones, which a sensitivity is judged by."""
    edges = [_FLOOR, *(boundary.decibel for boundary in BOUNDARIES), top]
    names = [*(boundary.zone for boundary in BOUNDARIES), "D"]
    for name, fill, low, high in zip(names, _ZONES, edges[:-1], edges[1:], strict=True):
        ax.axhspan(low, high, color=fill, lw=0, zorder=0)
        ax.text(
            0.93 if name == "B" else 0.995,
            0.5 * (max(low, 0.0) + high),
            f"zone {name}",
            transform=ax.get_yaxis_transform(),
            ha="right",
            va="center",
            fontsize=7.5,
        )


@styled
def figure_bode(loops: Responses) -> Figure:
    """Draw magnitude and phase of the loop gain of the linearised loop."""
    figure = new_figure(5.0)
    above, below = figure.subplots(2, 1, sharex=True)
    for name in ordered(loops):
        curve = loops[name]
        above.semilogx(curve.frequency, curve.decibel, **line_of(name), label=_with(name, curve))
        phase = np.degrees(np.unwrap(np.angle(curve.value)))
        turns = 360.0 * np.round((phase[0] + 180.0) / 360.0)
        below.semilogx(curve.frequency, phase - turns, **line_of(name))
    above.axhline(0.0, color=INK, lw=0.7)
    below.axhline(-180.0, color=INK, lw=0.7)
    below.yaxis.set_major_locator(MultipleLocator(90.0))
    above.margins(x=0.0)
    above.set_ylabel("loop gain (dB)")
    below.set_ylabel("phase (°)")
    below.set_xlabel("frequency (Hz)")
    legend_below(figure, above, columns=2)
    return figure


@styled
def figure_nyquist(loops: Responses) -> Figure:
    """Draw the loop gain in the complex plane, with the circle that the best zone keeps clear."""
    figure = new_figure(5.2, width=7.2)
    ax = figure.add_subplot()
    turn = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 361))
    limit = BOUNDARIES[0].ratio
    ax.plot(turn.real, turn.imag, color=SHADE, lw=0.7, ls="--", label="gain 1")
    near = turn / limit - 1.0
    ax.fill(near.real, near.imag, fc=_ZONES[-1], ec=ALARM, lw=0.7)
    ax.fill([], [], fc=_ZONES[-1], ec=ALARM, lw=0.7, label=f"sensitivity above {limit:g}")
    ax.plot([-1.0], [0.0], "+", color=ALARM, ms=9.0)
    for name in ordered(loops):
        value = loops[name].value
        ax.plot(value.real, value.imag, **line_of(name), label=name)
    ax.set_aspect("equal")
    ax.set_xlim(-4.0, 2.0)
    ax.set_ylim(-2.5, 2.0)
    ax.set_xlabel("real part of the loop gain")
    ax.set_ylabel("imaginary part")
    legend_below(figure, ax, columns=3)
    return figure


def _with(label: str, curve: Response) -> str:
    return f"{label} ({curve.note})" if curve.note else label
