"""Data of a report: a model, the scales of its quantities, and its measurements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from matplotlib.figure import Figure

from anhyst.data.clean import DEFAULT_STEPS, SETTING_PREFIX, clean
from anhyst.data.inspection import Inspection, inspect
from anhyst.data.loops import Loops
from anhyst.data.output_map import name_full_scale
from anhyst.data.verdict import Verdict, assess_loops, single_valued_residuals
from anhyst.model.acceptance import Acceptance
from anhyst.model.actuator import Model, read_sources
from anhyst.model.residual_analysis import analyse_loops, describe_residual
from anhyst.model.schema import FitFigures, fit_figures
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.figures import svg_text
from anhyst.support.numeric import FloatArray
from anhyst.support.page import MINUS, Note, Picture, Scale, format_percent, quantity_scale


@dataclass(frozen=True, eq=False)
class ModelSubject:
    """A model and all data about it that its report shows."""

    model: Model
    fit: FitFigures | None  # fit metrics of the present parameters
    acceptance: Acceptance  # outcome of the acceptance test
    measurements: Measurements | None  # measured loops; None if they could not be read
    missing_reason: str = ""  # reason why the measurements could not be read, or empty
    warnings: tuple[str, ...] = ()  # texts for the head of the page
    _pictures: Iterator[int] = field(default_factory=lambda: iter(range(1, 1000)))

    def picture(self, figure: Figure, alt: str, caption: str) -> Picture:
        """Return a figure for the page, with identifiers that are unique on the page."""
        return Picture(svg_text(figure, f"f{next(self._pictures)}"), alt, caption)

    @property
    def schedule_name(self) -> str:
        """Name of the scheduling variable in a sentence."""
        return self.model.schedule.words if self.model.schedule else ""

    @property
    def output_name(self) -> str:
        """Name of the output in a sentence."""
        return self.model.output.words

    @property
    def full_scale_text(self) -> str:
        """Text for the full scale to which deviations of the output refer."""
        return name_full_scale(self.model.output)

    @property
    def input_name(self) -> str:
        """Name of the input in a sentence."""
        return self.model.input.words

    def percent_of_largest(self, deviation: float) -> str:
        """Return a deviation in per cent of the largest output."""
        largest_output = self.fit.largest_output if self.fit else 0.0
        return format_percent(deviation / largest_output if largest_output > 0.0 else None)

    @property
    def deviation_scale(self) -> Scale:
        """Scale for deviations of the output, chosen by their mean."""
        return quantity_scale(self.model.output, [self.fit.mean_abs] if self.fit else [])

    @property
    def input_scale(self) -> Scale:
        """Scale of the input, chosen by its valid range."""
        return quantity_scale(self.model.input, self.model.valid.input if self.model.valid else [])

    @property
    def output_scale(self) -> Scale:
        """Scale of the output, chosen by its valid range."""
        return quantity_scale(self.model.output, self.model.valid.output if self.model.valid else [])

    @property
    def schedule_scale(self) -> Scale:
        """Scale of the scheduling variable, chosen by its nodes."""
        schedule = self.model.schedule
        return quantity_scale(schedule, self.model.nodes) if schedule else Scale(1.0, "")


STALE_RELATIVE_DIFFERENCE = 0.02
"""Relative difference of the mean deviation above which the stored fit metrics are out of date."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """The measurements of a model, and its fit to them."""

    loops: Loops  # loops as they were fitted
    # modelled output of each loop; None if it cannot be computed
    fitted: tuple[FloatArray | None, ...]
    # inspection before thinning; None if the record contradicts its headers
    inspection: Inspection | None
    verdict: Verdict  # comparison with the best single-valued curve on these loops
    # residual of the best single-valued curve for each loop, in the unit of the output
    baseline: tuple[FloatArray, ...]
    warnings: tuple[str, ...]  # texts for the head of the page


def gather_measurements(model: Model, folder: PathLike) -> Measurements:
    """Read the measurements of a model again, and compute the model on them."""
    unthinned_model, loops = _read_loops(model, folder)
    warnings = []
    try:
        inspection = inspect(unthinned_model)
    except InputError as error:
        inspection = None
        warnings.append(f"the measurements are implausible: {error}")
    fitted_outputs: list[FloatArray | None] = []
    for loop in loops.loops:
        try:
            fitted_outputs.append(model.predict_loop(loop))
        except (InputError, NegativeResult) as error:
            fitted_outputs.append(None)
            warnings.append(f"the model cannot be computed on {loops.describe(loop)}: {error}")
    residual_by_loop = {id(loop): residual for loop, residual in single_valued_residuals(loops)}
    return Measurements(
        loops=loops,
        fitted=tuple(fitted_outputs),
        inspection=inspection,
        verdict=assess_loops(loops),
        baseline=tuple(residual_by_loop[id(loop)] for loop in loops.loops),
        warnings=tuple(warnings),
    )


def _read_loops(model: Model, folder: PathLike) -> tuple[Loops, Loops]:
    """Read the loops without thinning, which hides noise and delay, and as they were fitted."""
    provenance = model.provenance
    clean_setting = provenance.settings.get(f"{SETTING_PREFIX}clean", ",".join(DEFAULT_STEPS))
    steps = [step.strip() for step in str(clean_setting).split(",")]
    if steps[-1] != "thin":
        loops = read_sources(model, folder)
        return loops, loops
    settings = dict(provenance.settings) | {f"{SETTING_PREFIX}clean": ",".join(steps[:-1]) or "none"}
    unthinned_model = replace(model, provenance=replace(provenance, settings=settings))
    unthinned_loops = read_sources(unthinned_model, folder)
    return unthinned_loops, clean(unthinned_loops, ("thin",))


def compute_fit_metrics(model: Model, measurements: Measurements) -> tuple[FitFigures | None, str]:
    """Return the fit metrics of the parameters, and a warning if those in the file differ."""
    fitted_outputs = [output for output in measurements.fitted if output is not None]
    if len(fitted_outputs) < len(measurements.fitted):
        return model.fit, ""
    residual = analyse_loops(measurements.loops, fitted_outputs)
    unchanged_figures = replace(
        fit_figures(measurements.loops, fitted_outputs),
        not_noise=residual.unexplained,
        left_over=describe_residual(residual, measurements.loops, model),
    )
    if model.fit is None:
        return unchanged_figures, ""
    figures = replace(
        unchanged_figures,
        left_out=model.fit.left_out,
        monotone=model.fit.monotone,
        cross_validation=model.fit.cross_validation,
    )
    if abs(unchanged_figures.mean_abs - model.fit.mean_abs) <= STALE_RELATIVE_DIFFERENCE * max(
        unchanged_figures.mean_abs, model.fit.mean_abs
    ):
        return figures, ""
    return figures, (
        "the fit figures in the model file do not belong to its parameters, which were changed "
        "after the identification; this report contains newly computed figures"
    )


def acceptance_note(subject: ModelSubject) -> Note:
    """Return the result of the acceptance test over the gap and the drive."""
    check, model = subject.acceptance, subject.model
    if check.passed is not None:
        text = check.text(model.input.unit)
        text = text[:1].upper() + text[1:].replace(" -", f" {MINUS}") + "."
        if check.passed:
            return Note("good", "Acceptance test passed", text)
        return Note("bad", "ACCEPTANCE TEST FAILED", text)
    if model.schedule is None or not model.varying:
        reason = "the model does not depend on a gap"
    elif model.schedule.name != "gap":
        reason = f"it is for gaps, and this model depends on the {subject.schedule_name}"
    else:
        reason = "the model file has no valid range for the drive"
    return Note("info", "Acceptance test", f"Does not apply: {reason}.")
