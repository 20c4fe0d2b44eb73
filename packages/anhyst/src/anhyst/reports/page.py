"""The page of a model: what it is and is worth in a few lines, then its sections, in one file."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from anhyst.data.loops import Loops
from anhyst.data.verdict import WHERE_IT_PAYS
from anhyst.model.actuator import MODEL_SOURCES, Model, read_model
from anhyst.reports import sections_model
from anhyst.reports.figures import (
    figure_loops,
    figure_reduction,
    figure_residuals,
)
from anhyst.reports.figures_over_schedule import figure_between, figure_parameters
from anhyst.reports.sections_fit import (
    section_loops,
    section_measurement,
    section_rate,
    section_residuals,
)
from anhyst.reports.subject import ModelSubject, acceptance, gather, own_figures
from anhyst.support.atomic import PathLike, atomic_writer, check_path, check_writable
from anhyst.support.errors import InputError
from anhyst.support.figures import write_png
from anhyst.support.kept import c_name
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.page import (
    Cell,
    Headline,
    Note,
    PageTable,
    Section,
    Tile,
    name_of,
    number,
    percent,
    render_page,
    symbol_of,
    table,
)
from anhyst.support.wording import worded

_RMS_OF_MEAN = float(np.sqrt(0.5 * np.pi))
"""Standard deviation of a normal variable over its mean absolute value."""


def headline(subject: ModelSubject) -> Headline:
    """Say in a few lines what the model is and what it is worth."""
    model = subject.model
    over = f" over the {subject.over}" if model.varying else ""
    what = (
        f"From {subject.drive} {symbol_of(model.input)} to {subject.answer} "
        f"{symbol_of(model.output)}{over}: {model.operator_law.title}"
        + (f", map “{model.gap_map}”." if model.varying else ".")
    )
    notes = [Note("warn", "Note", text[:1].upper() + text[1:]) for text in subject.warnings]
    if subject.absent:
        text = (
            f"The measurements were not read: {subject.absent}. This report is written from the "
            "model file alone, without measured loops and residuals; deviations are those that "
            "the file keeps."
        )
        notes.append(Note("warn", "Without measurements", text))
    judged = (*verdict(subject), acceptance(subject), *notes)
    basis, loops = "", subject.fit.loops if subject.fit else ()
    if loops:
        at = {loop.schedule for loop in loops if loop.schedule is not None}
        plural = {"gap": "gaps"}.get(subject.over, f"values of the {subject.over}")
        where = f" at {len(at)} {plural}" if len(at) > 1 else ""
        count = f"{len(loops)} loops" if len(loops) > 1 else "one loop"
        samples = sum(loop.samples for loop in loops)
        basis = f"Identified from {count}{where}, {samples} samples."
    return Headline(
        title=model.name,
        what=what,
        basis=basis,
        notes=tuple(sorted(judged, key=lambda note: note.tone != "bad")),
        tiles=_tiles(subject),
        comparison=_comparison(subject),
        holds=_holds(subject),
    )


def verdict(subject: ModelSubject) -> tuple[Note, ...]:
    """Say whether the model is worth having, against the best curve without memory."""
    fit, evidence = subject.fit, subject.evidence
    if fit is None or evidence is None:
        return ()
    judged, scale = evidence.verdict, subject.deviation
    mine, baseline = fit.mean_abs, judged.single_mean
    both = (
        f"The model misses the measured {subject.answer} by {scale.show(mine)} on average, the "
        f"best single-valued curve by {scale.show(baseline)}"
    )
    if mine >= baseline:
        text = (
            f"{both}: a curve without any memory does better. Find out why "
            "(another law, another gap map, fewer loops) before using this model."
        )
        return (Note("bad", "Worse than no hysteresis model", text),)
    gain = 1.0 - mine / baseline
    allowed = max(1.0 - judged.noise_mean / baseline, 0.0)
    taken = f"it takes {percent(gain)} of that error away (the noise allows {percent(allowed)})"
    if judged.dynamics:
        return (Note("bad", "Cannot be judged", f"{both}: {taken}; but {judged.dynamics}."),)
    if judged.level == "yes":
        return (Note("good", "Worth it", f"{both}: {taken}."),)
    title = "Gains little" if judged.level == "little" else "Hardly worth it"
    text = (
        f"The loops are so narrow that the best single-valued curve misses by {scale.show(baseline)} "
        f"only ({percent(baseline / fit.largest_output)} of the largest). This model misses by "
        f"{scale.show(mine)}: {taken}; {WHERE_IT_PAYS}."
    )
    return (Note("warn", title, text),)


def _tiles(subject: ModelSubject) -> tuple[Tile, ...]:
    fit, scale = subject.fit, subject.deviation
    if fit is None:
        return ()
    named = {"mean deviation": fit.mean_abs, "rms deviation": fit.rms, "worst point": fit.worst}
    of = f"of {subject.full_scale}"
    tiles = [Tile(scale.show(v), name, f"{subject.percent(v)} {of}") for name, v in named.items()]
    if subject.evidence is not None and subject.evidence.verdict.single_mean > 0.0:
        part = fit.mean_abs / subject.evidence.verdict.single_mean
        baseline = "the best single-valued curve"
        if part < 1.0:
            tiles.append(Tile(percent(1.0 - part), "less error", f"than {baseline}"))
        else:
            tiles.append(Tile(f"{number(part, 2)} times", "the error", f"of {baseline}"))
    return tuple(tiles)


def _comparison(subject: ModelSubject) -> PageTable | None:
    fit, evidence = subject.fit, subject.evidence
    if fit is None or evidence is None:
        return None
    judged, scale = evidence.verdict, subject.deviation

    def both(value: float) -> str:
        return f"{scale.show(value)} ({subject.percent(value)})"

    def row(name: Cell, mean: float, rms: float, worst: float | None) -> list[str | Cell]:
        bar = mean / most if most else None
        last = number(float("nan")) if worst is None else both(worst)
        return [name, Cell(both(mean), bar=bar), both(rms), last]

    single_rms, noise = rms(np.concatenate(evidence.baseline)), judged.noise_mean
    most = max(judged.single_mean, fit.mean_abs)
    cells = [
        row(Cell("Best single-valued curve"), judged.single_mean, single_rms, judged.single_worst),
        row(Cell("This model", strong=True), fit.mean_abs, fit.rms, fit.worst),
        row(Cell("Noise alone (no model gets below)"), noise, _RMS_OF_MEAN * noise, None),
    ]
    largest = subject.output_scale.show(fit.largest_output, 4)
    head = ["", "mean", "rms", "worst"]
    curve = f"one monotone curve for each {subject.over}" if subject.over else "one monotone curve"
    caption = (
        f"Percentages of {subject.full_scale}, {largest}. The best single-valued curve "
        f"({curve}, fitted to the same loops) is what a look-up table without memory can reach."
    )
    return table("Deviation from the measurement", head, cells, caption)


def _holds(subject: ModelSubject) -> str:
    model = subject.model
    if model.valid is None:
        return "The model file does not say where the model was seen to hold."
    parts = [
        f"{subject.drive} {subject.input_scale.span(*model.valid.input)}",
        f"{subject.answer} {subject.output_scale.span(*model.valid.output)}",
    ]
    if model.schedule is not None and model.valid.schedule is not None:
        low, high = model.valid.schedule
        scale = subject.schedule_scale
        text = scale.span(low, high) if low < high else f"{scale.show(low)} only"
        parts.append(f"{name_of(model.schedule)} {text}")
    return f"Seen to hold for {'; '.join(parts)}. Outside, results are computed and flagged."


def write_report(model: Model | PathLike, out: PathLike = "report.html") -> tuple[str, ...]:
    """Write the report of a model: `anhyst.report`."""
    check_path(out, "report: out")
    if isinstance(model, Model):
        with tempfile.TemporaryDirectory(prefix="anhyst-") as scratch:
            file = model.save(Path(scratch) / f"{c_name(model.name)}.toml")
            return _write(model, Path(), file, out)
    path = Path(check_path(model, "report: model", MODEL_SOURCES))
    check_writable(out, reads=[path])
    return _write(read_model(path), path.parent, path, out)


def _write(model: Model, folder: Path, path: Path, out: PathLike) -> tuple[str, ...]:
    """Write the report of a model in a file whose measurements are named from a folder."""
    subject = subject_of(model, folder)
    html = render(subject, path.name, hashlib.sha256(path.read_bytes()).hexdigest())
    with atomic_writer(out) as stream:
        stream.write(html)
    warnings = list(subject.warnings)
    if subject.absent:
        warnings.insert(0, f"{subject.absent}; the report is written from the model file alone")
    if subject.acceptance.passed is False:
        warnings.insert(0, f"{path}: {subject.acceptance.text(subject.model.input.unit)}")
    return tuple(map(worded, warnings))


def subject_of(model: Model, folder: PathLike) -> ModelSubject:
    """Gather all there is to say about a model."""
    outcome = model.acceptance()
    try:
        evidence = gather(model, folder)
    except InputError as error:
        return ModelSubject(model, model.fit, outcome, None, str(error))
    fit, stale = own_figures(model, evidence)
    warnings = (*evidence.warnings, *([stale] if stale else []))
    return ModelSubject(model, fit, outcome, evidence, warnings=warnings)


def render(subject: ModelSubject, file_name: str, file_hash: str) -> str:
    """Return the text of the report."""
    sections: list[Section | None] = [
        section_loops(subject),
        section_rate(subject),
        section_residuals(subject),
        sections_model.section_parameters_over(subject),
        sections_model.section_reduction(subject),
        sections_model.section_between(subject),
        sections_model.section_laws(subject),
        sections_model.section_gap_map(subject),
        sections_model.section_parameters(subject),
        section_measurement(subject),
        sections_model.section_origin(subject, file_name, file_hash),
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
