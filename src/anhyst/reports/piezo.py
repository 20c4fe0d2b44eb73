"""The picture of a piezo stage that followed a triangle."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.study.piezo.track import LEAD, TITLES, PiezoTracking
from anhyst.support.atomic import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOOK = {"none": "#D55E00", "single-valued": "#E69F00", "full": "#0072B2"}


def draw_tracking(found: PiezoTracking, cycle: float) -> Figure:
    """Draw reference, voltage and deviation over the cycles that are judged."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 6.5), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1, 2))
    time = found.runs["full"].time
    judged = time >= LEAD * cycle
    upper.plot(time[judged], 1e6 * found.reference[judged], color="0.3")
    upper.set_ylabel("reference [µm]")
    for name, run in found.runs.items():
        rms = 1e9 * run.errors.rms_m
        label = f"{TITLES[name]}: {rms:.0f} nm rms"
        lower.plot(time[judged], 1e9 * run.error[judged], color=LOOK[name], lw=1.0, label=label)
    lower.set(xlabel="time [s]", ylabel="deviation [nm]")
    lower.legend(loc="upper right", fontsize=9)
    for ax in (upper, lower):
        ax.grid(visible=True, alpha=0.25, lw=0.6)
        ax.spines[["top", "right"]].set_visible(False)
    return figure


def write_picture(found: PiezoTracking, cycle: float, path: Path) -> None:
    """Write the picture as the ending of its name says."""
    picture = BytesIO()
    draw_tracking(found, cycle).savefig(picture, format=path.suffix[1:], dpi=120)
    write_bytes(path, picture.getvalue())
