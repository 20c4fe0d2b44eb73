"""Draw a loop measurement: the drive against time, and the measured loops; or a frequency response."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from anhyst_rigs.study.excite.excite import Excitation
    from anhyst_rigs.study.response.result import FrequencyResponse

_MAX_LINE_POINTS = 20_000
"""Maximum number of points of a line."""


def figure_excitation(excitation: Excitation) -> Figure:
    """Draw the drive and the winding's I^2 t against time, and the measured loops to the right."""
    from matplotlib.figure import Figure

    from anhyst.support.figures import ALARM_COLOUR, PALETTE

    drive = excitation.drive_history
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    drive_ax, loop_ax = figure.subplots(1, 2)
    thinning = slice(None, None, 1 + drive.time.size // _MAX_LINE_POINTS)
    drive_ax.plot(drive.time[thinning], drive.current[thinning], lw=0.6, color="0.3")
    drive_ax.axhline(excitation.specimen.max_current.value, color=ALARM_COLOUR, lw=0.8, ls="--")
    drive_ax.set_xlabel("time [s]")
    drive_ax.set_ylabel(f"{excitation.specimen.drive} [{excitation.specimen.units[0]}]")
    drive_ax.set_title("drive, including rests and conditioning", loc="left", fontsize="medium")
    if np.isfinite(drive.warmth).all():
        warmth_ax = drive_ax.twinx()
        warmth_ax.plot(drive.time[thinning], 100.0 * drive.warmth[thinning], color=PALETTE["orange"], lw=1.0)
        warmth_ax.set_ylabel("I²t [% of the trip level]")
        warmth_ax.set_ylim(0.0, 105.0)
    excitation.loops.plot(loop_ax)
    loop_ax.set_title("measured", loc="left", fontsize="medium")
    return figure


def figure_response(response: FrequencyResponse) -> Figure:
    """Draw magnitude, phase and coherence of closed loop, sensitivity and plant."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 8.0), layout="constrained")
    magnitude_ax, plant_ax, phase_ax, coherence_ax = figure.subplots(4, 1, sharex=True)
    columns = response.to_columns()
    for name, one in response.responses.items():
        line = {
            "color": f"C{list(response.responses).index(name)}",
            "lw": 1.0,
            "label": name.replace("_", " "),
        }
        ax = plant_ax if name == "plant" else magnitude_ax
        ax.semilogx(response.frequency, 20.0 * np.log10(np.abs(one.values)), **line)
        phase_ax.semilogx(response.frequency, columns[f"{name}_deg"], **line)
        coherence_ax.semilogx(response.frequency, one.coherence, **line)
    for ax, text in (
        (magnitude_ax, "magnitude [dB]"),
        (plant_ax, f"plant [dB, {response.plant_unit}]"),
        (phase_ax, "phase [degrees]"),
        (coherence_ax, "coherence"),
    ):
        ax.set_ylabel(text)
        ax.grid(alpha=0.3)
    coherence_ax.set_xlabel("frequency [Hz]")
    phase_ax.legend(frameon=False, fontsize="small")
    magnitude_ax.set_title(
        f"sensitivity peak {response.margins.peak:.2f}: zone {response.zone} of ISO 14839-3",
        loc="left",
        fontsize="medium",
    )
    return figure
