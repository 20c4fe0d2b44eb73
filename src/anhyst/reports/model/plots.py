"""The figures of the report as picture files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from anhyst.data.loops import Loops
from anhyst.model.actuator import Model
from anhyst.reports.model.figures import (
    figure_between,
    figure_loops,
    figure_parameters,
    figure_reduction,
    figure_residuals,
)
from anhyst.support.arrays import FloatArray
from anhyst.support.atomic import PathLike
from anhyst.support.page.style import write_png


def write_plots(
    model: Model,
    loopset: Loops,
    fitted: Sequence[FloatArray | None],
    folder: PathLike,
) -> tuple[Path, ...]:
    """Write the figures of a model as PNG files."""
    place = Path(folder)
    figures = {
        "loops": figure_loops(loopset, fitted),
        "residuals": figure_residuals(loopset, fitted),
        "parameters": figure_parameters(model),
        "between_gaps": figure_between(model, model.check_over_gap()),
        "reduction": figure_reduction(model.reduction) if model.reduction else None,
    }
    place.mkdir(parents=True, exist_ok=True)
    written = []
    for name, figure in figures.items():
        if figure is not None:
            write_png(figure, place / f"{name}.png")
            written.append(place / f"{name}.png")
    return tuple(written)
