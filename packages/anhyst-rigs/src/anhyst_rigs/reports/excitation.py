"""Draw a loop measurement: the drive against time, and the measured loops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from anhyst_rigs.study.excite.excite import Excitation

_MAX_LINE_POINTS = 20_000
"""Maximum number of points of a line."""


def figure_excitation(excitation: Excitation) -> Figure:
    """Draw the drive and the winding's I^2 t against time, and the measured loops to the right."""
    from matplotlib.figure import Figure

    drive = excitation.drive_history
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    drive_ax, loop_ax = figure.subplots(1, 2)
    thinning = slice(None, None, 1 + drive.time.size // _MAX_LINE_POINTS)
    drive_ax.plot(drive.time[thinning], drive.current[thinning], lw=0.6, color="0.3")
    drive_ax.axhline(excitation.specimen.max_current.value, color="tab:red", lw=0.8, ls="--")
    drive_ax.set_xlabel("time [s]")
    drive_ax.set_ylabel(f"{excitation.specimen.drive} [{excitation.specimen.units[0]}]")
    drive_ax.set_title("drive, including rests and conditioning", loc="left", fontsize="medium")
    if np.isfinite(drive.warmth).all():
        warmth_ax = drive_ax.twinx()
        warmth_ax.plot(drive.time[thinning], 100.0 * drive.warmth[thinning], color="tab:orange", lw=1.0)
        warmth_ax.set_ylabel("I²t [% of the trip level]")
        warmth_ax.set_ylim(0.0, 105.0)
    excitation.loops.plot(loop_ax)
    loop_ax.set_title("measured", loc="left", fontsize="medium")
    return figure
