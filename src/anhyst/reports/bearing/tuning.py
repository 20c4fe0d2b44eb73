"""The picture of a tuning."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.figure import Figure

from anhyst.compensate.interface import MethodName
from anhyst.reports.bearing.over_runs import GainsPoint, TuningPicture, figure_pareto
from anhyst.study.tuning.aims import TITLES, Aims, GainFigures
from anhyst.study.tuning.output import RESULTS, keeps_others
from anhyst.study.tuning.result import Tuning
from anhyst.support.page.style import write_png


def write_pareto(tuning: Tuning, folder: Path) -> None:
    """Write ``pareto.png`` into a folder."""
    write_png(pareto(tuning), folder / RESULTS[2])


def pareto(tuning: Tuning) -> Figure:
    """Draw what was made small against peak sensitivity of everything that was tried."""

    def candidate(variant: MethodName, aims: Aims, figures: GainFigures) -> GainsPoint:
        return GainsPoint(
            variant=variant,
            reached=figures.cost,
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
        if math.isfinite(tuned.figures.cost)
    }
    least = tuning.first.figures.least
    return figure_pareto(
        TuningPicture(
            tuple(candidates),
            chosen,
            getattr(tuning.aims, least),
            tuning.aims.peak_sensitivity,
            TITLES[least].title,
            TITLES[least].unit,
            TITLES[least].factor,
        )
    )
