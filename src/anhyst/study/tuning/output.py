"""What a tuning leaves behind: notes in controller files, a table, JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from anhyst.compensate.methods import BASELINES, MODELS
from anhyst.rig.bearing.file import BearingRig
from anhyst.study.bearing.responses import as_rows
from anhyst.study.engine.verdict import Interval, compare
from anhyst.study.tuning.aims import TITLES, Aims, Figures, text_of
from anhyst.study.tuning.result import Tuned, Tuning
from anhyst.study.tuning.trial import Condition
from anhyst.support.atomic import atomic_writer
from anhyst.support.json_text import json_text
from anhyst.support.pays import FEEDBACK
from anhyst.support.version import running_version

_SETTLING = "settling_time_s"


def worth(tuning: Tuning) -> str:
    """Say in a sentence whether it is, against which baseline, and how measured flux does.

    What counts is the settling time of those whose gains meet the aims.
    """
    models = [one for name, one in tuning.tuned.items() if name in MODELS]
    baselines = [one for name, one in tuning.tuned.items() if name in BASELINES]
    if not models or not baselines:
        names = " and ".join(f"'{name}'" for name in tuning.tuned)
        return (
            f"worth it or not remains open: {names} alone was tuned; --all-variants tunes the "
            "baselines for the same aims, and 'anhyst simulate' compares at the same gains"
        )
    mine, other = _best(models), _best(baselines)
    return f"{_judged(mine, other)}{_flux(tuning)}"


def _best(ones: Sequence[Tuned]) -> Tuned:
    """Return the one that settles first of those that meet the aims."""
    return min(ones, key=lambda one: (bool(one.misses), one.figures.settling_time_s))


def _judged(mine: Tuned, other: Tuned) -> str:
    named = f"the strongest baseline without hysteresis model ('{other.variant}')"
    both = f"'{mine.variant}' settles in {_time(mine)}, {named} in {_time(other)}"
    if mine.misses:
        met = "misses them too" if other.misses else f"meets them, settling in {_time(other)}"
        return f"not worth it here: '{mine.variant}' misses the aims, {named} {met}; {FEEDBACK}"
    if other.misses:
        return f"worth it: '{mine.variant}' meets the aims, {named} misses them"
    mine_s, other_s = _settling(mine), _settling(other)
    found = compare("settling", other.variant, mine_s, other_s)
    if found.less:
        return f"worth it: {both}, {100.0 * (1.0 - found.ratio):.2g} % less"
    rest = "certainly less" if found.more else "the same within the noise"
    return f"not worth it here: {both}, {rest}; {FEEDBACK}"


def _flux(tuning: Tuning) -> str:
    flux = tuning.tuned.get("flux")
    if flux is None:
        return ""
    return f"; measured flux: {'misses the aims' if flux.misses else _time(flux)}"


def _time(one: Tuned) -> str:
    return f"{1e3 * one.figures.settling_time_s:.2f} ms"


def _settling(one: Tuned) -> Interval:
    check, mean = one.found.check, one.figures.settling_time_s
    width = 0.0 if check is None else check.cell(_SETTLING).figures[_SETTLING].half_width
    return Interval(mean, width, 1)


RESULTS = ("tuning.json", "tuning.md", "pareto.png")
"""Files beside the tuned controllers."""

_NOTES = 3
"""Things that limit, of each kind, which a note or a line names; all stand in ``tuning.json``."""

_HEADS = (
    "variant",
    "overshoot, %",
    "settling, ms",
    "peak sensitivity",
    "standstill, nm rms",
    "rate of current, A/s rms",
    "aims",
    "what limits",
)


def verdict(tuned: Tuned) -> str:
    """Say in a line which aims are missed, the best reached, and what limits."""
    limits = tuned.aims.limits
    texts = []
    for name in tuned.misses:
        text = text_of(name, getattr(tuned.figures, name))
        if name in limits:
            _, factor, unit = TITLES[name]
            text += f" (aim {factor * limits[name]:g} {unit}".rstrip() + ")"
        texts.append(text)
    others = [one.text for one in tuned.limits if one.what not in tuned.misses]
    because = "; ".join(others[:_NOTES])
    return f"no gains of '{tuned.variant}' meet the aims, the best reach {', '.join(texts)}" + (
        f"; what limits: {because}" if because else ""
    )


def shortfall(tuning: Tuning) -> str | None:
    """Say why the aims are not met, in a line; None if they are, by the file's own variant."""
    own = tuning.tuned.get(tuning.controller.settings.compensation.variant)
    return verdict(own) if own is not None and own.misses else None


def file_note(
    tuned: Tuned, rig: BearingRig, conditions: Sequence[Condition], budget: int, seed: int
) -> str:
    """Return the comment at the head of a tuned controller file."""
    found = tuned.found
    numbers = found.numbers
    steps = ", ".join(f"{1e6 * height:g}" for height in rig.settings.step.heights_m)
    if found.check is None:
        reached = "Reached with one noise seed (the search was interrupted):"
    else:
        reached = f"Reached, mean of {found.check.seeds} noise seeds, worst of all conditions:"
    missed = ["It MISSES its aims."] if tuned.misses else []
    lines = [
        f"Made by anhyst {running_version()} tune for variant '{tuned.variant}' on the rig "
        f"'{rig.settings.name}'.",
        f"Aims: {aims_text(tuned.aims)}; then the least settling time.",
        f"Tried at {'; '.join(one.text for one in conditions)};",
        f"steps of {steps} um up and down; {budget} sets of gains, seed {seed}.",
        reached,
        f"{', '.join(text_of(name, value) for name, value in asdict(tuned.figures).items())}.",
        *missed,
        f"Poles of the moving mass: pair at {numbers['bandwidth_Hz']:.4g} Hz with damping "
        f"{numbers['damping']:.3g}, real one at "
        f"{numbers['bandwidth_Hz'] * numbers['real_pole']:.4g} Hz;",
        f"virtual mass {100.0 * numbers['virtual_mass']:.3g} % of the mass.",
        *(f"What limits: {one.text}." for one in tuned.limits[:_NOTES]),
    ]
    return "\n".join(lines)


def aims_text(aims: Aims) -> str:
    """Write aims in a line."""
    return ", ".join(
        f"{TITLES[name][0]} <= {TITLES[name][1] * limit:g} {TITLES[name][2]}".rstrip()
        for name, limit in aims.limits.items()
    )


def write_results(tuning: Tuning, folder: Path) -> None:
    """Write the figures as JSON and the table as Markdown."""
    figures, table = (folder / name for name in RESULTS[:2])
    with atomic_writer(figures) as stream:
        stream.write(json_text(figures_of(tuning)))
    with atomic_writer(table) as stream:
        stream.write(markdown(tuning))


def rows(tuning: Tuning) -> list[list[str]]:
    """Return the table of all variants, the fastest that meets its aims first."""
    ordered = sorted(
        tuning.tuned.values(), key=lambda each: (bool(each.misses), each.figures.settling_time_s)
    )
    return [_row(one) for one in ordered]


def _row(tuned: Tuned) -> list[str]:
    check, figures = tuned.found.check, tuned.figures

    def with_interval(name: str, factor: float) -> str:
        value = factor * float(getattr(figures, name))
        if check is None or not math.isfinite(value):
            return f"{value:.2f}"
        width = factor * check.cell(name).figures[name].half_width
        return f"{value:.2f} ± {width:.2f}"

    missed = ", ".join(TITLES[name][0] for name in tuned.misses)
    limiting = list(dict.fromkeys(one.what for one in tuned.limits))
    words = [TITLES[name][0] if name in TITLES else name for name in limiting]
    return [
        tuned.variant,
        with_interval("overshoot_percent", 1.0),
        with_interval("settling_time_s", 1e3),
        f"{figures.peak_sensitivity:.2f}",
        f"{1e9 * figures.standstill_rms_m:.0f}",
        f"{figures.current_rate_rms_A_per_s:.0f}",
        f"misses {missed}" if missed else "met",
        ", ".join(words),
    ]


def heads() -> tuple[str, ...]:
    """Return the heads of the columns of :func:`rows`."""
    return _HEADS


def markdown(tuning: Tuning) -> str:
    """Return the table and what limits as Markdown."""
    seeds = tuning.rig.settings.noise_seeds
    steps = ", ".join(f"{1e6 * one:g}" for one in tuning.rig.settings.step.heights_m)
    lines = [
        f"Rig: {tuning.rig.settings.name}. Aims: {aims_text(tuning.aims)}; then the least "
        "settling time.",
        f"Worst of {len(tuning.conditions)} conditions "
        f"({'; '.join(one.text for one in tuning.conditions)}), steps of {steps} um up and down; "
        f"means of {seeds} noise seeds with 95 % intervals. Each variant was tuned for itself: "
        f"{tuning.budget} sets of gains, seed {tuning.seed}.",
        "",
        f"| {' | '.join(_HEADS)} |",
        f"| {' | '.join('---' for _ in _HEADS)} |",
        *(f"| {' | '.join(row)} |" for row in rows(tuning)),
        "",
        f"Verdict: {worth(tuning)}.",
        "",
        "What limits:",
        "",
    ]
    for name, tuned in tuning.tuned.items():
        lines += [f"- {name}: {one.text}" for one in tuned.limits]
    return "\n".join(lines) + "\n"


def figures_of(tuning: Tuning) -> dict[str, Any]:
    """Return what ``tuning.json`` holds; the same for the same input and seed."""
    rig = tuning.rig.settings
    return {
        "format": "anhyst-tuning",
        "rig": rig.name,
        "controller": tuning.controller.settings.name,
        "number_format": tuning.controller.settings.compensation.format,
        "rate_Hz": rig.timing.rate_Hz,
        "delay_ticks": rig.timing.delay_ticks,
        "plant": tuning.plant.as_dict(),
        "supply_V": rig.amplifier.supply_V,
        "aims": tuning.aims.limits,
        "conditions": [{"gap_m": one.gap, "load_N": one.load} for one in tuning.conditions],
        "steps_m": list(rig.step.heights_m),
        "noise_seeds": rig.noise_seeds,
        "budget": tuning.budget,
        "seed": tuning.seed,
        "interrupted": tuning.interrupted,
        "variants": {name: _of_variant(one) for name, one in tuning.tuned.items()},
    }


def _of_variant(tuned: Tuned) -> dict[str, Any]:
    found, check = tuned.found, tuned.found.check
    pidd2 = found.setup.controller.pidd2()
    return {
        "met": not tuned.misses,
        "misses": list(tuned.misses),
        "figures": asdict(tuned.figures),
        "before": asdict(found.before.worst) if found.before.complete else None,
        "gains": {
            "K_p_N_per_m": pidd2.K_p,
            "K_i_N_per_m_s": pidd2.K_i,
            "K_d_N_s_per_m": pidd2.K_d,
            "K_dd_N_s2_per_m": pidd2.K_dd,
            "cutoff_Hz": pidd2.cutoff,
            "cutoff_2_Hz": pidd2.cutoff_2,
            "set_point_weight": pidd2.weight,
        },
        "searched": dict(found.numbers),
        "limits": [asdict(one) for one in tuned.limits],
        "conditions": [
            {
                "gap_m": condition.gap,
                "load_N": condition.load,
                **asdict(figures),
                "peak_Hz": check.peaks[condition],
            }
            for condition, figures in check.figures.items()
        ]
        if check is not None
        else [],
        "steps": [] if check is None else as_rows(check.cells),
        "tried": found.tried,
        "candidates": [
            {
                "settling_time_s": one.outcome.worst.settling_time_s,
                "peak_sensitivity": one.outcome.worst.peak_sensitivity,
                "meets_other_aims": keeps_others(tuned.aims, one.outcome.worst),
            }
            for one in found.candidates
        ],
    }


def keeps_others(aims: Aims, figures: Figures) -> bool:
    """Return whether the aims other than settling time and peak sensitivity are met."""
    return not set(aims.misses(figures)) - {"settling_time_s", "peak_sensitivity"}
