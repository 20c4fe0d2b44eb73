"""What a tuning gives and leaves behind: notes in controller files, a table, JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anhyst.compensate.methods import BASELINES, MODELS
from anhyst.control.controller_file import ControllerFile
from anhyst.support import running_version
from anhyst.support.atomic import atomic_writer, write_json
from anhyst.support.kinds import PROBED, MethodName
from anhyst.support.result import Result, columns_of
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.distance import PlantCheck
from anhyst_rigs.rig.piezo import PiezoRig
from anhyst_rigs.study.engine.table import Interval, compare
from anhyst_rigs.study.engine.where_it_pays import WHERE_IT_PAYS
from anhyst_rigs.study.tuning.aims import TITLES, Aims, GainFigures, text_of
from anhyst_rigs.study.tuning.search import FoundGains
from anhyst_rigs.study.tuning.trial import Limit

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Tuned:
    """What tuning one variant gave."""

    variant: MethodName
    found: FoundGains  # the search
    limits: tuple[Limit, ...]  # what limits
    aims: Aims

    @property
    def figures(self) -> GainFigures:
        """What the gains reach, worst of all conditions."""
        return self.found.figures

    @property
    def misses(self) -> Mapping[str, float]:
        """Aims that are missed, by how much of their limit."""
        return self.aims.misses(self.figures)


@dataclass(frozen=True, repr=False)
class Tuning(Result):
    """What a tuning gave.

    Parameters
    ----------
    rig : BodyRig or PiezoRig
    controller : ControllerFile or None
        As it was; None of a stage or a piezo stage.
    plant : PlantCheck or None
        What the loops say about the plant of a bearing.
    own : str
        The variant that the files name; of stages ``full``.
    aims : Aims
    budget, seed : int
    tuned : mapping of str to Tuned
        By variant.
    written : mapping of str to Path
        Controller or rig file of every variant.
    interrupted : bool
        Whether ctrl-C ended it.
    seconds, cpu_seconds : float
        By the clock, and of all processes.
    """

    rig: BodyRig | PiezoRig
    controller: ControllerFile | None
    plant: PlantCheck | None
    own: MethodName
    aims: Aims
    budget: int
    seed: int
    tuned: Mapping[MethodName, Tuned]
    written: Mapping[MethodName, Path]
    interrupted: bool
    seconds: float
    cpu_seconds: float

    @property
    def first(self) -> Tuned:
        """What was tuned first; rig, conditions and figures are those of all."""
        return next(iter(self.tuned.values()))

    def facts(self) -> dict[str, str]:
        """Return what the gains of every variant reach, and the aims that they miss."""
        facts = {"rig": self.rig.settings.name, "found in": f"{self.seconds:.0f} s"}
        for name, one in self.tuned.items():
            reached = [text_of(title, value) for title, value in one.figures.named().items()]
            met = f"misses {', '.join(one.misses)}" if one.misses else "meets its aims"
            facts[name] = ", ".join([*reached, met])
        return facts

    def to_columns(self) -> dict[str, Any]:
        """Return what the gains of every variant reach, worst of all conditions."""
        return columns_of(
            [
                {"variant": name, **one.figures.named(), "met": not one.misses}
                for name, one in self.tuned.items()
            ]
        )

    def draw(self, ax: Axes) -> None:
        """Draw the peak of the sensitivity of every variant over what was made small."""
        for name, one in self.tuned.items():
            title = TITLES[one.figures.least]
            at = title.factor * one.figures.cost, one.figures.peak_sensitivity
            ax.plot(*at, "o", label=name)
            ax.set_xlabel(f"{title.title} [{title.unit}]")
        ax.set_ylabel("peak sensitivity")


_WORDS = {
    "settling_time_s": ("settles in", "in", "settling time", WHERE_IT_PAYS["feedback"]),
    "average_m": ("leaves a moving average of", "one of", "moving average", WHERE_IT_PAYS["stage"]),
    "error_rms_m": ("leaves an rms error of", "one of", "rms error", WHERE_IT_PAYS["piezo"]),
}
"""Of what is made small: what a variant does, and another one; its name; where it would pay."""


def worth(tuning: Tuning) -> str:
    """Say in a sentence whether it is, against which baseline, and how measured flux does.

    What counts is the settling time of those whose gains meet the aims, or the moving average.
    """
    models = [one for name, one in tuning.tuned.items() if name in MODELS and name not in PROBED]
    baselines = [one for name, one in tuning.tuned.items() if name in BASELINES]
    if not models or not baselines:
        names = " and ".join(f"'{name}'" for name in tuning.tuned)
        return (
            f"worth it or not remains open: {names} alone was tuned; --all-variants tunes the "
            "baselines for the same aims, and 'anhyst simulate' compares at the same gains"
        )
    text = _judged(_ordered(models)[0], _ordered(baselines)[0])
    if (flux := tuning.tuned.get("flux")) is not None:
        text += f"; measured flux: {'misses the aims' if flux.misses else _value(flux)}"
    return text


def _ordered(ones: Iterable[Tuned]) -> list[Tuned]:
    """Return the best that meets its aims first."""
    return sorted(ones, key=lambda one: (bool(one.misses), one.figures.cost))


def _judged(mine: Tuned, other: Tuned) -> str:
    named = f"the strongest baseline without hysteresis model ('{other.variant}')"
    does, other_does, noun, pays = _WORDS[mine.figures.least]
    both = f"'{mine.variant}' {does} {_value(mine)}, {named} {other_does} {_value(other)}"
    if mine.misses:
        met = "misses them too" if other.misses else f"meets them, with a {noun} of {_value(other)}"
        return f"not worth it here: '{mine.variant}' misses the aims, {named} {met}; {pays}"
    if other.misses:
        return f"worth it: '{mine.variant}' meets the aims, {named} misses them"
    found = compare(noun, other.variant, _interval(mine), _interval(other))
    if found.less:
        return f"worth it: {both}, {100.0 * (1.0 - found.ratio):.2g} % less"
    rest = "certainly less" if found.more else "the same within the noise"
    return f"not worth it here: {both}, {rest}; {pays}"


def _value(one: Tuned) -> str:
    metric = TITLES[one.figures.least]
    return f"{metric.factor * one.figures.cost:.2f} {metric.unit}"


def _interval(one: Tuned) -> Interval:
    check = one.found.check
    width = 0.0 if check is None else check.widths.get(one.figures.least, 0.0)
    return Interval(one.figures.cost, width, 1)


RESULTS = ("tuning.json", "tuning.md", "pareto.png")
"""Files beside the tuned controllers."""
_NOTES = 3
"""Things that limit, of each kind, which a note or a line names; all stand in ``tuning.json``."""


def shortfall(tuning: Tuning) -> str | None:
    """Say which aims the file's own variant misses, the best reached, and what limits; None if none."""
    tuned = tuning.tuned.get(tuning.own)
    if tuned is None or not tuned.misses:
        return None
    limits, texts = tuned.aims.limits, []
    for name in tuned.misses:
        text = text_of(name, getattr(tuned.figures, name))
        if name in limits:
            text += f" (aim {TITLES[name].limit_text(limits[name])})"
        texts.append(text)
    others = [one.text for one in tuned.limits if one.what not in tuned.misses]
    because = "; ".join(others[:_NOTES])
    return f"no gains of '{tuned.variant}' meet the aims, the best reach {', '.join(texts)}" + (
        f"; what limits: {because}" if because else ""
    )


def file_note(tuned: Tuned, tuning: Tuning) -> str:
    """Return the comment at the head of a tuned file."""
    found = tuned.found
    if found.check is None:
        reached = "Reached with one noise seed (the search was interrupted):"
    else:
        reached = f"Reached, mean of {found.check.seeds} noise seeds, worst of all conditions:"
    missed = ["It MISSES its aims."] if tuned.misses else []
    lines = [
        f"Made by anhyst {running_version()} tune for variant '{tuned.variant}' on the rig "
        f"'{tuning.rig.settings.name}'.",
        f"Aims: {aims_text(tuning)}.",
        f"Tried at {'; '.join(one.text for one in found.loop.conditions)};",
        f"{found.loop.tried}; {tuning.budget} sets of gains, seed {tuning.seed}.",
        reached,
        f"{', '.join(text_of(name, value) for name, value in tuned.figures.named().items())}.",
        *missed,
        *found.loop.meaning(found.numbers),
        *(f"{one}." for one in (found.check.notes if found.check else ())),
        *(f"What limits: {one.text}." for one in tuned.limits[:_NOTES]),
    ]
    return "\n".join(lines)


def aims_text(tuning: Tuning) -> str:
    """Write aims in a line."""
    limits = ", ".join(
        f"{TITLES[name].title} <= {TITLES[name].limit_text(limit)}"
        for name, limit in tuning.aims.limits.items()
    )
    return f"{limits}; then the least {TITLES[tuning.first.figures.least].title}"


def write_results(tuning: Tuning, folder: Path) -> None:
    """Write the figures as JSON and the table as Markdown."""
    figures, table = (folder / name for name in RESULTS[:2])
    write_json(figures, figures_of(tuning))
    with atomic_writer(table) as stream:
        stream.write(markdown(tuning))


def rows(tuning: Tuning) -> list[list[str]]:
    """Return the table of all variants, the best that meets its aims first."""
    return [_row(one) for one in _ordered(tuning.tuned.values())]


def _row(tuned: Tuned) -> list[str]:
    check = tuned.found.check

    def with_interval(name: str, value: float) -> str:
        factor, digits = TITLES[name].factor, TITLES[name].digits
        text = f"{factor * value:.{digits}f}"
        if check is None or name not in check.widths or not math.isfinite(value):
            return text
        return f"{text} ± {factor * check.widths[name]:.{digits}f}"

    missed = ", ".join(TITLES[name].title for name in tuned.misses)
    limiting = list(dict.fromkeys(one.what for one in tuned.limits))
    words = [TITLES[name].title if name in TITLES else name for name in limiting]
    return [
        tuned.variant,
        *(with_interval(name, value) for name, value in tuned.figures.named().items()),
        f"misses {missed}" if missed else "met",
        ", ".join(words),
    ]


def heads(tuning: Tuning) -> list[str]:
    """Return the heads of the columns of :func:`rows`."""
    titles = [TITLES[name] for name in tuning.first.figures.named()]
    figures = [f"{one.title}, {one.unit}" if one.unit else one.title for one in titles]
    return ["variant", *figures, "aims", "what limits"]


def markdown(tuning: Tuning) -> str:
    """Return the table and what limits as Markdown."""
    seeds, loop = tuning.rig.settings.noise_seeds, tuning.first.found.loop
    head = heads(tuning)
    lines = [
        f"Rig: {tuning.rig.settings.name}. Aims: {aims_text(tuning)}.",
        f"Worst of {len(loop.conditions)} conditions "
        f"({'; '.join(one.text for one in loop.conditions)}), {loop.tried}; "
        f"means of {seeds} noise seeds with 95 % intervals. Each variant was tuned for itself: "
        f"{tuning.budget} sets of gains, seed {tuning.seed}.",
        "",
        f"| {' | '.join(head)} |",
        f"| {' | '.join('---' for _ in head)} |",
        *(f"| {' | '.join(row)} |" for row in rows(tuning)),
        "",
        f"Verdict: {worth(tuning)}.",
        "",
        "What limits, and what was found besides:",
        "",
    ]
    for name, tuned in tuning.tuned.items():
        notes = tuned.found.check.notes if tuned.found.check else ()
        lines += [f"- {name}: {text}" for text in (*(one.text for one in tuned.limits), *notes)]
    return "\n".join(lines) + "\n"


def figures_of(tuning: Tuning) -> dict[str, Any]:
    """Return what ``tuning.json`` holds; the same for the same input and seed."""
    rig, loop = tuning.rig.settings, tuning.first.found.loop
    return {
        "format": "anhyst-tuning",
        "rig": rig.name,
        **loop.facts(),
        "rate_Hz": rig.timing.rate_Hz,
        "delay_ticks": rig.timing.delay_ticks,
        **({"plant": tuning.plant.as_dict()} if tuning.plant else {}),
        "aims": tuning.aims.limits,
        "conditions": [one.as_dict() for one in loop.conditions],
        "noise_seeds": rig.noise_seeds,
        "budget": tuning.budget,
        "seed": tuning.seed,
        "interrupted": tuning.interrupted,
        "variants": {name: _of_variant(one) for name, one in tuning.tuned.items()},
    }


def _of_variant(tuned: Tuned) -> dict[str, Any]:
    found, check = tuned.found, tuned.found.check
    least = tuned.figures.least
    checked = [] if check is None else check.figures.items()
    return {
        "met": not tuned.misses,
        "misses": list(tuned.misses),
        "figures": tuned.figures.named(),
        "before": found.before.worst.named() if found.before.complete else None,
        "gains": found.loop.gains(),
        "searched": dict(found.numbers),
        "limits": [asdict(one) for one in tuned.limits],
        "conditions": [
            {**condition.as_dict(), **figures.named(), "peak_Hz": check.peaks[condition]}
            for condition, figures in checked
            if check is not None
        ],
        **({} if check is None else check.rows),
        "tried": found.tried,
        "candidates": [
            {
                least: one.outcome.worst.cost,
                "peak_sensitivity": one.outcome.worst.peak_sensitivity,
                "meets_other_aims": keeps_others(tuned.aims, one.outcome.worst),
            }
            for one in found.candidates
        ],
    }


def keeps_others(aims: Aims, figures: GainFigures) -> bool:
    """Return whether the aims other than what is made small and peak sensitivity are met."""
    return not set(aims.misses(figures)) - {figures.least, "peak_sensitivity"}
