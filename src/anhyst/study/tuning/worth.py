"""Whether a hysteresis model is worth it where every kind of compensation has gains of its own."""

from __future__ import annotations

from collections.abc import Sequence

from anhyst.compensate.methods import BASELINES, MODELS
from anhyst.study.bearing.metrics import Interval
from anhyst.study.tuning.result import Tuned, Tuning
from anhyst.study.verdict import compare
from anhyst.support.pays import FEEDBACK

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
