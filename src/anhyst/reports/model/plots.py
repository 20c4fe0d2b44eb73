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
    """Write the figures of a model as PNG files.

    Parameters
    ----------
    model : Model
        The model.
    loopset : Loops
        The measured loops.
    fitted : sequence of ndarray or None
        Modelled output of each loop, SI, in the order of the set.
    folder : path-like
        Where to; created if it is not there.

    Returns
    -------
    tuple of Path
        What was written: ``loops.png`` and ``residuals.png``; ``parameters.png`` and
        ``between_gaps.png`` where parameters vary; ``reduction.png`` after a reduction.

    Raises
    ------
    InputError
        A file cannot be written.
    """
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
