"""The page: sections in the order an engineer reads them, rendered to one self-contained file."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

from anhyst.data.loops import Loops
from anhyst.model.acceptance import check_over_drive
from anhyst.model.actuator import Model, read_model
from anhyst.reports.model.figures import (
    figure_between,
    figure_loops,
    figure_parameters,
    figure_reduction,
    figure_residuals,
)
from anhyst.reports.model.headline import headline
from anhyst.reports.model.sections_fit import (
    section_loops,
    section_measurement,
    section_rate,
    section_residuals,
)
from anhyst.reports.model.sections_model import (
    section_between,
    section_gap_map,
    section_laws,
    section_origin,
    section_parameters,
    section_parameters_over,
    section_reduction,
)
from anhyst.reports.model.subject import ModelSubject, gather, own_figures
from anhyst.support.atomic import PathLike, atomic_writer
from anhyst.support.errors import InputError
from anhyst.support.figures import write_png
from anhyst.support.numeric import FloatArray
from anhyst.support.page import Section, render_page


def write_report(model: PathLike, out: PathLike = "report.html") -> tuple[str, ...]:
    """Write the report of a model: one HTML file that needs nothing else.

    The measurements are read again. Where they are missing or have changed, the report is written
    from the model file alone and says so.

    Parameters
    ----------
    model : path-like
        A model file.
    out : path-like
        Where the HTML file is to appear, whole or not at all.

    Returns
    -------
    tuple of str
        What a user should know, one sentence each: measurements that could not be read, figures
        that are stale, an acceptance test that failed.

    Raises
    ------
    InputError
        The model file cannot be used, or the report cannot be written.
    """
    path = Path(model)
    subject = subject_of(read_model(path), path.parent)
    html = render(subject, path.name, hashlib.sha256(path.read_bytes()).hexdigest())
    with atomic_writer(out) as stream:
        stream.write(html)
    warnings = list(subject.warnings)
    if subject.absent:
        warnings.insert(0, f"{subject.absent}; the report is written from the model file alone")
    if subject.acceptance.passed is False:
        warnings.insert(
            0, f"{os.fspath(path)}: {subject.acceptance.text(subject.model.input.unit)}"
        )
    return tuple(warnings)


def subject_of(model: Model, folder: PathLike) -> ModelSubject:
    """Gather all there is to say about a model."""
    check, over_drive = model.check_over_gap(), check_over_drive(model)
    try:
        evidence = gather(model, folder)
    except InputError as error:
        return ModelSubject(model, model.fit, check, None, str(error), (), over_drive)
    fit, stale = own_figures(model, evidence)
    warnings = (*evidence.warnings, *([stale] if stale else []))
    return ModelSubject(model, fit, check, evidence, "", warnings, over_drive)


def render(subject: ModelSubject, file_name: str, file_hash: str) -> str:
    """Return the text of the report."""
    sections: list[Section | None] = [
        section_loops(subject),
        section_rate(subject),
        section_residuals(subject),
        section_parameters_over(subject),
        section_reduction(subject),
        section_between(subject),
        section_laws(subject),
        section_gap_map(subject),
        section_parameters(subject),
        section_measurement(subject),
        section_origin(subject, file_name, file_hash),
    ]
    return render_page(
        headline(subject),
        [section for section in sections if section is not None],
        subject.model.provenance.version,
        kind="Hysteresis model",
        source="the model file",
    )


def write_plots(
    model: Model, loopset: Loops, fitted: Sequence[FloatArray | None], folder: PathLike
) -> tuple[Path, ...]:
    """Write the figures of a model as PNG files."""
    target = Path(folder)
    figures = {
        "loops": figure_loops(loopset, fitted),
        "residuals": figure_residuals(loopset, fitted),
        "parameters": figure_parameters(model),
        "between_gaps": figure_between(model, model.check_over_gap()),
        "reduction": figure_reduction(model.reduction) if model.reduction else None,
    }
    target.mkdir(parents=True, exist_ok=True)
    written = []
    for name, figure in figures.items():
        if figure is not None:
            write_png(figure, target / f"{name}.png")
            written.append(target / f"{name}.png")
    return tuple(written)
