"""The report of a model: one HTML page with a summary, followed by its sections."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from anhyst.data.loops import Loops
from anhyst.data.verdict import GAIN_ADVICE
from anhyst.model.actuator import MODEL_SOURCES, Model, read_model
from anhyst.reports import sections_model
from anhyst.reports.figures import figure_loops, figure_reduction, figure_residuals
from anhyst.reports.figures_over_schedule import figure_between_gaps, figure_parameters
from anhyst.reports.section_flux import section_flux
from anhyst.reports.sections_fit import (
    picture_of_loops,
    section_loops,
    section_measurement,
    section_rate,
    section_residuals,
)
from anhyst.reports.subject import ModelSubject, acceptance_note, compute_fit_metrics, gather_measurements
from anhyst.support.atomic import PathLike, atomic_writer, check_path, check_writable
from anhyst.support.cache import c_name
from anhyst.support.errors import InputError
from anhyst.support.figures import write_png
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.page import (
    Cell,
    Headline,
    Note,
    PageTable,
    Tile,
    display_symbol,
    format_number,
    format_percent,
    make_table,
    render_page,
)
from anhyst.support.wording import capitalise, word_for_reader

_RMS_PER_MEAN_ABS = float(np.sqrt(0.5 * np.pi))
"""Ratio of the standard deviation of a normal variable to its mean absolute value."""


def make_headline(subject: ModelSubject) -> Headline:
    """Return the head of the page: what the model is, its verdict and its main values."""
    model = subject.model
    schedule_part = f" over the {subject.schedule_name}" if model.varying else ""
    description = (
        f"From {subject.input_name} {display_symbol(model.input)} to {subject.output_name} "
        f"{display_symbol(model.output)}{schedule_part}: {model.operator_law.title}"
        + (f", map “{model.gap_map}”." if model.varying else ".")
    )
    notes = [Note("warn", "Note", capitalise(text)) for text in subject.warnings]
    if subject.missing_reason:
        text = (
            f"The measurements were not read: {subject.missing_reason}. This report is written from the "
            "model file only. It has no measured loops and residuals, and its deviations are those "
            "in the file."
        )
        notes.insert(0, Note("warn", "Without measurements", text))
    all_notes = (*verdict_notes(subject), *notes, acceptance_note(subject))
    verdict, *other_notes = sorted(all_notes, key=lambda note: note.tone != "bad")
    basis_text, loops = "", subject.fit.loops if subject.fit else ()
    if loops:
        schedule_values = {loop.schedule for loop in loops if loop.schedule is not None}
        schedule_plural = {"gap": "gaps"}.get(subject.schedule_name, f"values of the {subject.schedule_name}")
        schedule_text = f" at {len(schedule_values)} {schedule_plural}" if len(schedule_values) > 1 else ""
        count = f"{len(loops)} loops" if len(loops) > 1 else "one loop"
        sample_count = sum(loop.samples for loop in loops)
        basis_text = f"Identified from {count}{schedule_text}, {sample_count} samples."
    return Headline(
        title=model.name,
        description=description,
        basis=basis_text,
        verdict=verdict,
        notes=tuple(other_notes),
        tiles=_make_tiles(subject),
        picture=picture_of_loops(subject),
        comparison=_comparison_table(subject),
        validity=_validity_text(subject),
    )


def verdict_notes(subject: ModelSubject) -> tuple[Note, ...]:
    """Compare the model with the best single-valued curve, and state whether it is worth using."""
    fit, measurements = subject.fit, subject.measurements
    if fit is None or measurements is None:
        return ()
    assessment, scale = measurements.verdict, subject.deviation_scale
    model_error, baseline_error = fit.mean_abs, assessment.single_mean
    comparison = (
        f"The mean error of the modelled {subject.output_name} is {scale.format_with_unit(model_error)}, "
        f"that of the best single-valued curve is {scale.format_with_unit(baseline_error)}"
    )
    if model_error >= baseline_error:
        text = (
            f"{comparison}. A curve without hysteresis is better. Find out why "
            "(another law, another gap map, fewer loops) before you use this model."
        )
        return (Note("bad", "Worse than no hysteresis model", text),)
    gain = 1.0 - model_error / baseline_error
    possible_gain = max(1.0 - assessment.noise_mean / baseline_error, 0.0)
    gain_text = (
        f"the model removes {format_percent(gain)} of the error of the curve (the noise limits this "
        f"to {format_percent(possible_gain)})"
    )
    if assessment.dynamics:
        return (Note("bad", "Cannot be assessed", f"{comparison}: {gain_text}; but {assessment.dynamics}."),)
    if assessment.level == "yes":
        return (Note("good", "Worth it", f"{comparison}: {gain_text}."),)
    title = "Small gain" if assessment.level == "little" else "Barely worth it"
    text = (
        "The loops are so narrow that the mean error of the best single-valued curve is only "
        f"{scale.format_with_unit(baseline_error)} ({format_percent(baseline_error / fit.largest_output)} "
        f"of the largest). The error of this model is {scale.format_with_unit(model_error)}: {gain_text}; "
        f"{GAIN_ADVICE}."
    )
    return (Note("warn", title, text),)


def _make_tiles(subject: ModelSubject) -> tuple[Tile, ...]:
    fit, scale = subject.fit, subject.deviation_scale
    if fit is None:
        return ()
    basis = f"of {subject.full_scale_text}"
    tiles = [
        Tile(scale.format_with_unit(error), name, f"{subject.percent_of_largest(error)} {basis}")
        for name, error in (("mean deviation", fit.mean_abs), ("worst point", fit.worst))
    ]
    if subject.measurements is None or not subject.measurements.verdict.single_mean > 0.0:
        rms_text = f"{subject.percent_of_largest(fit.rms)} {basis}"
        return (*tiles, Tile(scale.format_with_unit(fit.rms), "rms deviation", rms_text))
    ratio = fit.mean_abs / subject.measurements.verdict.single_mean
    baseline = "the best single-valued curve"
    if ratio < 1.0:
        return (*tiles, Tile(format_percent(1.0 - ratio), "less error", f"than {baseline}"))
    return (*tiles, Tile(f"{format_number(ratio, 2)} times", "the error", f"of {baseline}"))


def _comparison_table(subject: ModelSubject) -> PageTable | None:
    fit, measurements = subject.fit, subject.measurements
    if fit is None or measurements is None:
        return None
    assessment, scale = measurements.verdict, subject.deviation_scale

    def format_with_percent(value: float) -> str:
        return f"{scale.format_with_unit(value)} ({subject.percent_of_largest(value)})"

    def row(name: Cell, mean: float, rms: float, worst: float | None) -> list[str | Cell]:
        bar = mean / largest_mean if largest_mean else None
        worst_text = format_number(float("nan")) if worst is None else format_with_percent(worst)
        return [name, Cell(format_with_percent(mean), bar=bar), format_with_percent(rms), worst_text]

    single_rms, noise_mean = rms(np.concatenate(measurements.baseline)), assessment.noise_mean
    largest_mean = max(assessment.single_mean, fit.mean_abs)
    cells = [
        row(Cell("Best single-valued curve"), assessment.single_mean, single_rms, assessment.single_worst),
        row(Cell("This model", strong=True), fit.mean_abs, fit.rms, fit.worst),
        row(Cell("Noise alone (no model can be better)"), noise_mean, _RMS_PER_MEAN_ABS * noise_mean, None),
    ]
    largest_output_text = subject.output_scale.format_with_unit(fit.largest_output, 4)
    head = ["", "mean", "rms", "worst"]
    curve = (
        f"one monotone curve for each {subject.schedule_name}"
        if subject.schedule_name
        else "one monotone curve"
    )
    caption = (
        f"Percentages of {subject.full_scale_text}, {largest_output_text}. The best single-valued curve "
        f"({curve}, fitted to the same loops) is the best that a look-up table without memory can reach."
    )
    return make_table("Deviation from the measurement", head, cells, caption)


def _validity_text(subject: ModelSubject) -> str:
    model = subject.model
    if model.valid is None:
        return "The model file does not state a valid range."
    range_texts = [
        f"{subject.input_name} {subject.input_scale.format_range(*model.valid.input)}",
        f"{subject.output_name} {subject.output_scale.format_range(*model.valid.output)}",
    ]
    if model.schedule is not None and model.valid.schedule is not None:
        low, high = model.valid.schedule
        scale = subject.schedule_scale
        text = scale.format_range(low, high) if low < high else f"{scale.format_with_unit(low)} only"
        range_texts.append(f"{model.schedule.words} {text}")
    return f"Valid range: {'; '.join(range_texts)}. Results outside this range are computed and flagged."


def write_report(model: Model | PathLike, out: PathLike = "report.html") -> tuple[str, ...]:
    """Write the report of a model: `anhyst.report`."""
    check_path(out, "report: out")
    if isinstance(model, Model):
        with tempfile.TemporaryDirectory(prefix="anhyst-") as scratch:
            file = model.save(Path(scratch) / f"{c_name(model.name)}.toml")
            return _write_report(model, Path(), file, out)
    path = Path(check_path(model, "report: model", MODEL_SOURCES))
    check_writable(out, input_files=[path])
    return _write_report(read_model(path), path.parent, path, out)


def _write_report(model: Model, folder: Path, path: Path, out: PathLike) -> tuple[str, ...]:
    """Write the report of a model in a file. Paths of its measurements are relative to a folder."""
    subject = gather_subject(model, folder)
    html = render_report(subject, path.name, hashlib.sha256(path.read_bytes()).hexdigest())
    with atomic_writer(out) as stream:
        stream.write(html)
    warnings = list(subject.warnings)
    if subject.missing_reason:
        warnings.insert(0, f"{subject.missing_reason}; the report is written from the model file only")
    if subject.acceptance.passed is False:
        warnings.insert(0, f"{path}: {subject.acceptance.text(subject.model.input.unit)}")
    return tuple(map(word_for_reader, warnings))


def gather_subject(model: Model, folder: PathLike) -> ModelSubject:
    """Gather all data for the report of a model."""
    acceptance = model.acceptance()
    try:
        measurements = gather_measurements(model, folder)
    except InputError as error:
        return ModelSubject(model, model.fit, acceptance, None, str(error))
    fit, stale_warning = compute_fit_metrics(model, measurements)
    warnings = (*measurements.warnings, *([stale_warning] if stale_warning else []))
    return ModelSubject(model, fit, acceptance, measurements, warnings=warnings)


def render_report(subject: ModelSubject, file_name: str, file_hash: str) -> str:
    """Return the HTML text of the report."""
    sections = [
        section_loops(subject),
        section_flux(subject),
        section_rate(subject),
        section_residuals(subject),
        sections_model.section_parameters_over(subject),
        sections_model.section_reduction(subject),
        sections_model.section_between_nodes(subject),
        sections_model.section_laws(subject),
        sections_model.section_gap_map(subject),
        sections_model.section_parameters(subject),
        section_measurement(subject),
        sections_model.section_origin(subject, file_name, file_hash),
    ]
    return render_page(
        make_headline(subject),
        sections,
        subject.model.provenance.version,
        kind="Hysteresis model",
        source="the model file",
    )


def write_plots(
    model: Model, loopset: Loops, fitted_outputs: Sequence[FloatArray | None], folder: PathLike
) -> tuple[Path, ...]:
    """Write the figures of a model as PNG files."""
    plot_folder = Path(folder)
    figures = {
        "loops": figure_loops(loopset, fitted_outputs),
        "residuals": figure_residuals(loopset, fitted_outputs),
        "parameters": figure_parameters(model),
        "between_gaps": figure_between_gaps(model, model.check_over_gap()),
        "reduction": figure_reduction(model.reduction) if model.reduction else None,
    }
    plot_folder.mkdir(parents=True, exist_ok=True)
    written_paths = []
    for name, figure in figures.items():
        if figure is not None:
            write_png(figure, plot_folder / f"{name}.png")
            written_paths.append(plot_folder / f"{name}.png")
    return tuple(written_paths)
