"""The picture of a tuning."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.figure import Figure

from anhyst.compensate.interface import MethodName
from anhyst.reports.bearing.over_runs import GainsPoint, figure_pareto
from anhyst.reports.bearing.over_runs import TuningPicture as Picture
from anhyst.study.tuning.aims import Aims, Figures
from anhyst.study.tuning.output import RESULTS, keeps_others
from anhyst.study.tuning.result import Tuning
from anhyst.support.page.style import write_png


def write_pareto(tuning: Tuning, folder: Path) -> None:
    """Write ``pareto.png`` into a folder."""
    write_png(pareto(tuning), folder / RESULTS[2])


def pareto(tuning: Tuning) -> Figure:
    """Draw settling against peak sensitivity of everything that was tried."""

    def candidate(variant: MethodName, aims: Aims, figures: Figures) -> GainsPoint:
        return GainsPoint(
            variant=variant,
            settling=figures.settling_time_s,
            peak=figures.peak_sensitivity,
            kept=keeps_others(aims, figures),
        )

    candidates = [
        candidate(name, tuned.aims, one.outcome.worst)
        for name, tuned in tuning.tuned.items()
        for one in tuned.found.candidates
    ]
    chosen = {
        name: candidate(name, tuned.aims, tuned.figures)
        for name, tuned in tuning.tuned.items()
        if math.isfinite(tuned.figures.settling_time_s)
    }
    return figure_pareto(
        Picture(
            tuple(candidates), chosen, tuning.aims.settling_time_s, tuning.aims.peak_sensitivity
        )
    )
