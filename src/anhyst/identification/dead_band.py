"""The dead band of the law: what keeps small movements from eroding a model's state.

A Jiles-Atherton law forgets by the whole way that the field goes, to and fro: noise of a demand
erases what it remembers within milliseconds, and a small error that comes again and again, such as
the ripple of a table under a gap that vibrates, makes it wander. A play in front of its
irreversible part closes what stays within it (docs/theory.md). Real iron has something like it, and
measured loops hardly show how wide it is: the widest one that they allow is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from anhyst.identification.default import FoundModel, follow

PARTS = (0.35, 0.2, 0.1, 0.05, 0.02)
"""Half-widths that are tried, in parts of the pinning k, the widest first."""

COST = 1.03
"""Factor by which the deviation from the loops may grow."""

_TOLERANCE, _MOST = 1e-8, 40
"""Of the fit with a dead band: it starts near its end."""


def add_dead_band(fit: FoundModel, accepts: Callable[[FoundModel], bool]) -> FoundModel:
    """Fit again with the widest dead band that the loops allow."""
    form, most = fit.space.form, COST**2 * fit.cost
    for part in PARTS:
        space = replace(fit.space, form=replace(form, dead_band=part))
        tried = follow(space, fit.theta, _TOLERANCE, _MOST, fit.tie, goal=most)
        if tried.cost <= most and accepts(tried):
            return replace(tried, evaluations=fit.evaluations + tried.evaluations)
    return fit


def why_dead_band(before: FoundModel, after: FoundModel) -> str:
    """Report the dead band that was given, and what it costs."""
    part = after.space.form.dead_band
    if part == 0.0:
        return f"none: even one of {PARTS[-1]:g}*k costs more than {COST - 1:.0%} of the deviation"
    change = float(np.sqrt(after.cost / before.cost)) - 1.0
    return (
        f"r_d = {part:g}*k, the widest tried that costs at most {COST - 1:.0%} of the deviation "
        f"from the loops; it changes by {100.0 * change:+.1f} %"
    )
