"""Write the results of a tuning: comments in controller files, a table and JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anhyst.compensate.methods import BASELINE_METHODS, MODEL_METHODS
from anhyst.control.controller_file import ControllerFile
from anhyst.support import running_version
from anhyst.support.atomic import atomic_writer, write_json
from anhyst.support.kinds import FLUX_PROBE_METHODS, MethodName
from anhyst.support.result import Result, rows_to_columns
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.distance import PlantCheck
from anhyst_rigs.rig.piezo import PiezoRig
from anhyst_rigs.study.engine.beneficial_conditions import BENEFICIAL_CONDITIONS
from anhyst_rigs.study.engine.table import Interval, compare
from anhyst_rigs.study.tuning.aims import GAIN_METRICS, Aims, GainFigures, format_figure
from anhyst_rigs.study.tuning.search import TuningSearchResult
from anhyst_rigs.study.tuning.trial import Limit

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class TunedVariant:
    """The result of tuning one variant."""

    variant: MethodName
    search_result: TuningSearchResult  # result of the search for gains
    limits: tuple[Limit, ...]  # what limits the gains
    aims: Aims

    @property
    def figures(self) -> GainFigures:
        """Metrics of the gains, the worst values of all conditions."""
        return self.search_result.figures

    @property
    def missed_aims(self) -> Mapping[str, float]:
        """Relative excess above the limit, for each missed aim."""
        return self.aims.missed_by(self.figures)


@dataclass(frozen=True, repr=False)
class Tuning(Result):
    """The result of a tuning.

    Parameters
    ----------
    rig : BodyRig or PiezoRig
    controller : ControllerFile or None
        The controller file before tuning; None for a stage or a piezo stage.
    plant : PlantCheck or None
        Comparison of the plant of a bearing with the measured loops.
    main_variant : str
        The variant of the controller file; ``full`` for stages.
    aims : Aims
    budget, seed : int
    tuned : mapping of str to TunedVariant
        By variant.
    written : mapping of str to Path
        The controller or rig file of every variant.
    interrupted : bool
        Whether ctrl-C ended the tuning.
    seconds, cpu_seconds : float
        Elapsed time, and processor time of all processes.
    """

    rig: BodyRig | PiezoRig
    controller: ControllerFile | None
    plant: PlantCheck | None
    main_variant: MethodName
    aims: Aims
    budget: int
    seed: int
    tuned: Mapping[MethodName, TunedVariant]
    written: Mapping[MethodName, Path]
    interrupted: bool
    seconds: float
    cpu_seconds: float

    @property
    def first_tuned(self) -> TunedVariant:
        """The variant that was tuned first. All variants have the same rig, conditions and metrics."""
        return next(iter(self.tuned.values()))

    def facts(self) -> dict[str, str]:
        """Return the metrics of every variant, and the aims that it misses, as text."""
        facts = {"rig": self.rig.settings.name, "found in": f"{self.seconds:.0f} s"}
        for name, tuned in self.tuned.items():
            figure_texts = [format_figure(title, value) for title, value in tuned.figures.by_name().items()]
            aims_text = f"misses {', '.join(tuned.missed_aims)}" if tuned.missed_aims else "meets its aims"
            facts[name] = ", ".join([*figure_texts, aims_text])
        return facts

    def to_columns(self) -> dict[str, Any]:
        """Return the metrics of every variant, the worst values of all conditions."""
        return rows_to_columns(
            [
                {"variant": name, **tuned.figures.by_name(), "met": not tuned.missed_aims}
                for name, tuned in self.tuned.items()
            ]
        )

    def draw(self, ax: Axes) -> None:
        """Draw the peak sensitivity of every variant against the minimised metric."""
        for name, tuned in self.tuned.items():
            metric = GAIN_METRICS[tuned.figures.cost_name]
            position = metric.factor * tuned.figures.cost, tuned.figures.peak_sensitivity
            ax.plot(*position, "o", label=name)
            ax.set_xlabel(f"{metric.title} [{metric.unit}]")
        ax.set_ylabel("peak sensitivity")


_CONDITION_PHRASES = {
    "settling_time_s": ("settles in", "in", "settling time", BENEFICIAL_CONDITIONS["feedback"]),
    "average_m": ("has a moving average of", "one of", "moving average", BENEFICIAL_CONDITIONS["stage"]),
    "error_rms_m": ("has an rms error of", "one of", "rms error", BENEFICIAL_CONDITIONS["piezo"]),
}
"""Words for each minimised metric: verbs for model and baseline, name of the metric, and advice."""


def verdict_text(tuning: Tuning) -> str:
    """Return a sentence on the benefit of hysteresis models and of measured flux.

    The best model is compared with the best baseline by settling time, moving average or rms error.
    Variants that meet their aims come first.
    """
    model_variants = [
        tuned
        for name, tuned in tuning.tuned.items()
        if name in MODEL_METHODS and name not in FLUX_PROBE_METHODS
    ]
    baselines = [tuned for name, tuned in tuning.tuned.items() if name in BASELINE_METHODS]
    if not model_variants or not baselines:
        names = " and ".join(f"'{name}'" for name in tuning.tuned)
        return (
            f"no verdict: only {names} was tuned; --all-variants tunes the baselines for the same "
            "aims, and 'anhyst simulate' compares at the same gains"
        )
    text = _compare_with_baseline(_sort_best_first(model_variants)[0], _sort_best_first(baselines)[0])
    if (flux := tuning.tuned.get("flux")) is not None:
        text += f"; measured flux: {'misses the aims' if flux.missed_aims else _format_cost(flux)}"
    return text


def _sort_best_first(variants: Iterable[TunedVariant]) -> list[TunedVariant]:
    """Sort variants: those that meet their aims come first, then the cost decides."""
    return sorted(variants, key=lambda tuned: (bool(tuned.missed_aims), tuned.figures.cost))


def _compare_with_baseline(model: TunedVariant, baseline: TunedVariant) -> str:
    baseline_name = f"the strongest baseline without hysteresis model ('{baseline.variant}')"
    model_verb, baseline_verb, cost_noun, beneficial_condition = _CONDITION_PHRASES[model.figures.cost_name]
    comparison_text = (
        f"'{model.variant}' {model_verb} {_format_cost(model)}, "
        f"{baseline_name} {baseline_verb} {_format_cost(baseline)}"
    )
    if model.missed_aims:
        aims_text = (
            "misses them too"
            if baseline.missed_aims
            else f"meets them, with a {cost_noun} of {_format_cost(baseline)}"
        )
        negative_result = f"not worth it here: '{model.variant}' misses the aims"
        return f"{negative_result}, {baseline_name} {aims_text}; {beneficial_condition}"
    if baseline.missed_aims:
        return f"worth it: '{model.variant}' meets the aims, {baseline_name} misses them"
    comparison = compare(cost_noun, baseline.variant, _cost_interval(model), _cost_interval(baseline))
    if comparison.is_better:
        return f"worth it: {comparison_text}, {100.0 * (1.0 - comparison.ratio):.2g} % less"
    difference_text = "certainly less" if comparison.is_worse else "the same within the noise"
    return f"not worth it here: {comparison_text}, {difference_text}; {beneficial_condition}"


def _format_cost(tuned: TunedVariant) -> str:
    metric = GAIN_METRICS[tuned.figures.cost_name]
    return f"{metric.factor * tuned.figures.cost:.2f} {metric.unit}"


def _cost_interval(tuned: TunedVariant) -> Interval:
    check = tuned.search_result.check
    half_width = 0.0 if check is None else check.half_widths.get(tuned.figures.cost_name, 0.0)
    return Interval(tuned.figures.cost, half_width, 1)


RESULT_FILES = ("tuning.json", "tuning.md", "pareto.png")
"""Names of the files that are written next to the tuned controllers."""
_MAX_LISTED_LIMITS = 3
"""Largest number of limits in a comment or a message; ``tuning.json`` contains all of them."""


def describe_shortfall(tuning: Tuning) -> str | None:
    """Return a sentence on the missed aims of the main variant; None if it meets all aims."""
    tuned = tuning.tuned.get(tuning.main_variant)
    if tuned is None or not tuned.missed_aims:
        return None
    limits, texts = tuned.aims.limits, []
    for name in tuned.missed_aims:
        text = format_figure(name, getattr(tuned.figures, name))
        if name in limits:
            text += f" (aim {GAIN_METRICS[name].format_limit(limits[name])})"
        texts.append(text)
    other_limits = [limit.text for limit in tuned.limits if limit.what not in tuned.missed_aims]
    reason = "; ".join(other_limits[:_MAX_LISTED_LIMITS])
    return f"no gains of '{tuned.variant}' meet the aims, the best reach {', '.join(texts)}" + (
        f"; what limits: {reason}" if reason else ""
    )


def make_file_note(tuned: TunedVariant, tuning: Tuning) -> str:
    """Return the comment at the head of a tuned file."""
    result = tuned.search_result
    if result.check is None:
        reached_text = "Reached with one noise seed (the search was interrupted):"
    else:
        reached_text = f"Reached, mean of {result.check.seed_count} noise seeds, worst of all conditions:"
    missed_lines = ["It MISSES its aims."] if tuned.missed_aims else []
    lines = [
        f"Made by anhyst {running_version()} tune for variant '{tuned.variant}' on the rig "
        f"'{tuning.rig.settings.name}'.",
        f"Aims: {format_aims(tuning)}.",
        f"Tried at {'; '.join(condition.text for condition in result.loop.conditions)};",
        f"{result.loop.trial_text}; {tuning.budget} sets of gains, seed {tuning.seed}.",
        reached_text,
        f"{', '.join(format_figure(name, value) for name, value in tuned.figures.by_name().items())}.",
        *missed_lines,
        *result.loop.explain_parameters(result.parameters),
        *(f"{note}." for note in (result.check.notes if result.check else ())),
        *(f"What limits: {limit.text}." for limit in tuned.limits[:_MAX_LISTED_LIMITS]),
    ]
    return "\n".join(lines)


def format_aims(tuning: Tuning) -> str:
    """Return all aims as one line of text."""
    limits = ", ".join(
        f"{GAIN_METRICS[name].title} <= {GAIN_METRICS[name].format_limit(limit)}"
        for name, limit in tuning.aims.limits.items()
    )
    return f"{limits}; then the least {GAIN_METRICS[tuning.first_tuned.figures.cost_name].title}"


def write_results(tuning: Tuning, folder: Path) -> None:
    """Write the metrics as JSON and the table as Markdown."""
    figures, table = (folder / name for name in RESULT_FILES[:2])
    write_json(figures, result_dict(tuning))
    with atomic_writer(table) as stream:
        stream.write(make_markdown(tuning))


def table_rows(tuning: Tuning) -> list[list[str]]:
    """Return the table of all variants, the best variant first."""
    return [_table_row(tuned) for tuned in _sort_best_first(tuning.tuned.values())]


def _table_row(tuned: TunedVariant) -> list[str]:
    check = tuned.search_result.check

    def with_interval(name: str, value: float) -> str:
        factor, digits = GAIN_METRICS[name].factor, GAIN_METRICS[name].digits
        text = f"{factor * value:.{digits}f}"
        if check is None or name not in check.half_widths or not math.isfinite(value):
            return text
        return f"{text} ± {factor * check.half_widths[name]:.{digits}f}"

    missed_titles = ", ".join(GAIN_METRICS[name].title for name in tuned.missed_aims)
    limit_names = list(dict.fromkeys(limit.what for limit in tuned.limits))
    limit_titles = [GAIN_METRICS[name].title if name in GAIN_METRICS else name for name in limit_names]
    return [
        tuned.variant,
        *(with_interval(name, value) for name, value in tuned.figures.by_name().items()),
        f"misses {missed_titles}" if missed_titles else "met",
        ", ".join(limit_titles),
    ]


def column_heads(tuning: Tuning) -> list[str]:
    """Return the column headings for :func:`table_rows`."""
    titles = [GAIN_METRICS[name] for name in tuning.first_tuned.figures.by_name()]
    figures = [f"{metric.title}, {metric.unit}" if metric.unit else metric.title for metric in titles]
    return ["variant", *figures, "aims", "what limits"]


def make_markdown(tuning: Tuning) -> str:
    """Return the table and the limits as Markdown."""
    seed_count, loop = tuning.rig.settings.noise_seeds, tuning.first_tuned.search_result.loop
    columns = column_heads(tuning)
    lines = [
        f"Rig: {tuning.rig.settings.name}. Aims: {format_aims(tuning)}.",
        f"Worst of {len(loop.conditions)} conditions "
        f"({'; '.join(item.text for item in loop.conditions)}), {loop.trial_text}; "
        f"means of {seed_count} noise seeds with 95 % intervals. Each variant was tuned separately: "
        f"{tuning.budget} sets of gains, seed {tuning.seed}.",
        "",
        f"| {' | '.join(columns)} |",
        f"| {' | '.join('---' for _ in columns)} |",
        *(f"| {' | '.join(row)} |" for row in table_rows(tuning)),
        "",
        f"Verdict: {verdict_text(tuning)}.",
        "",
        "Limits and further results:",
        "",
    ]
    for name, tuned in tuning.tuned.items():
        notes = tuned.search_result.check.notes if tuned.search_result.check else ()
        lines += [f"- {name}: {text}" for text in (*(item.text for item in tuned.limits), *notes)]
    return "\n".join(lines) + "\n"


def result_dict(tuning: Tuning) -> dict[str, Any]:
    """Return the content of ``tuning.json``; the same inputs and seeds give the same content."""
    rig, loop = tuning.rig.settings, tuning.first_tuned.search_result.loop
    return {
        "format": "anhyst-tuning",
        "rig": rig.name,
        **loop.facts(),
        "rate_Hz": rig.timing.rate_Hz,
        "delay_ticks": rig.timing.delay_ticks,
        **({"plant": tuning.plant.as_dict()} if tuning.plant else {}),
        "aims": tuning.aims.limits,
        "conditions": [entry.as_dict() for entry in loop.conditions],
        "noise_seeds": rig.noise_seeds,
        "budget": tuning.budget,
        "seed": tuning.seed,
        "interrupted": tuning.interrupted,
        "variants": {name: _variant_dict(entry) for name, entry in tuning.tuned.items()},
    }


def _variant_dict(tuned: TunedVariant) -> dict[str, Any]:
    result, check = tuned.search_result, tuned.search_result.check
    cost_name = tuned.figures.cost_name
    condition_figures = [] if check is None else check.figures.items()
    return {
        "met": not tuned.missed_aims,
        "misses": list(tuned.missed_aims),
        "figures": tuned.figures.by_name(),
        "before": result.initial_outcome.worst.by_name() if result.initial_outcome.is_complete else None,
        "gains": result.loop.gains(),
        "searched": dict(result.parameters),
        "limits": [asdict(limit) for limit in tuned.limits],
        "conditions": [
            {**condition.as_dict(), **figures.by_name(), "peak_Hz": check.peak_frequencies[condition]}
            for condition, figures in condition_figures
            if check is not None
        ],
        **({} if check is None else check.rows),
        "tried": result.tried_count,
        "candidates": [
            {
                cost_name: item.outcome.worst.cost,
                "peak_sensitivity": item.outcome.worst.peak_sensitivity,
                "meets_other_aims": meets_other_aims(tuned.aims, item.outcome.worst),
            }
            for item in result.candidates
        ],
    }


def meets_other_aims(aims: Aims, figures: GainFigures) -> bool:
    """Whether gains meet all aims except those for the minimised metric and the peak sensitivity."""
    return not set(aims.missed_by(figures)) - {figures.cost_name, "peak_sensitivity"}
