"""Whether the data demand an offset of a sensor: an information criterion with a prior.

Any law misses a real iron by a little, and an offset is glad to take part of that over: it then
stands for a force where none is. So an offset is fitted only where it pays by more than chance,
with deviations that go together along a record, and from loop to loop, counted once, and by more
than it is unlike a sensor's.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations

import numpy as np

from anhyst.identification.default import COMPARED, FoundModel, follow
from anhyst.identification.fitting import Evaluation, Linear
from anhyst.identification.objective import Objective
from anhyst.identification.rest import RestReading
from anhyst.identification.space import CoordinateSpace
from anhyst.identification.uncertainty import mean_memory
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import NoResponseError

OFFSETS = frozenset({"in_0", "out_0"})

USUAL = 0.01
"""Standard deviation of the offsets that sensors have, in parts of the range: seldom more."""

AT_REST = 5e-4
"""Least uncertainty of a reading at rest, in parts of the range."""

_UNBELIEVED = 25.0
"""What an unusual offset costs at most, and what contradicting a reading at rest costs, in twice
the logarithm of the odds: the highest price that still lets plain evidence overrule either."""

_EXACT = 1e-20
"""Mean square deviation, in parts of the largest output, below which nothing is distinguished."""


def only_demanded(
    fit: FoundModel, tolerance: float = COMPARED[0], most: int = COMPARED[1]
) -> FoundModel:
    """Hold the offsets at what the sensors read at rest, but for those that the data demand.

    Those that differ from gap to gap are none of a sensor's, and not judged as such.
    """
    free = sorted(name for name, gap in fit.space.entries if name in OFFSETS and gap is None)
    if not free:
        return fit
    here = Evaluation(Objective(fit.space, fit.tie)).at(fit.theta)
    drives = len(fit.space.records.loops)
    ends = np.cumsum([record.input.size for record in fit.space.records.loops])
    shares = [_lasting(one) for one in np.split(here.deviation, ends)[:-1]]
    alike = 1.0 + (drives - 1) * float(np.mean(shares))
    independent = max(2.0, float(ends[-1]) / mean_memory(fit.space, here.deviation) / alike)
    ways = [frozenset(names) for n in range(1, len(free) + 1) for names in combinations(free, n)]

    def score(cost: float, space: CoordinateSpace, theta: FloatArray) -> float:
        return independent * math.log(cost + _EXACT) + _price(space, theta, independent)

    tries = {}
    for names in ways:
        space, kept = fit.space.holding(names)
        cost, theta = _without(fit, here, names)
        tries[names] = score(cost, space, theta[kept]), space, theta[kept]
    _, space, start = min(tries.values(), key=lambda one: one[0])
    whole = score(fit.cost, fit.space, fit.theta)
    # Whatever the offsets that stay free come out at, above this cost they are not taken.
    stay = sum(name in OFFSETS for name, _ in space.entries)
    goal = math.exp(whole / independent - stay * math.log(independent) / independent)
    held = follow(space, start, tolerance, most, fit.tie, goal)
    enough = _responds(held) and score(held.cost, held.space, held.theta) <= whole
    best = held if enough else fit
    return replace(best, evaluations=fit.evaluations + held.evaluations + 1)


def _responds(fit: FoundModel) -> bool:
    """Whether the law has an answer there at all: a fit that finds none ends at any cost."""
    try:
        Objective(fit.space).outputs(fit.sets)
    except NoResponseError:
        return False
    return True


def _lasting(deviation: FloatArray) -> float:
    """Part of the mean square that is still there a sample later."""
    centred = deviation - deviation.mean()
    power = float(centred @ centred)
    return max(0.0, float(centred[1:] @ centred[:-1]) / power) if power > 0.0 else 0.0


def _without(fit: FoundModel, here: Linear, names: frozenset[str]) -> tuple[float, FloatArray]:
    """Foresee the best fit with these offsets held at zero: its cost and its coordinates."""
    out = np.array([name in names for name, _ in fit.space.entries])
    theta = np.where(out, 0.0, fit.theta)
    normal = here.normal + 1e-12 * np.trace(here.normal) * np.eye(out.size)
    pull = normal[np.ix_(~out, out)] @ fit.theta[out]
    theta[~out] += np.linalg.solve(normal[np.ix_(~out, ~out)], pull)
    theta = np.clip(theta, *fit.space.bounds)
    step = theta - fit.theta
    return fit.cost + float(step @ here.normal @ step), theta


def _price(space: CoordinateSpace, theta: FloatArray, independent: float) -> float:
    """Price the free offsets of a space, in twice the logarithm of the odds."""
    rest = space.records.rest
    readings = {
        "in_0": (rest.input, space.records.input_span),
        "out_0": (rest.output, space.records.output_span),
    }
    return sum(
        math.log(independent) + _unlikely(float(value), *readings[name])
        for (name, _), value in zip(space.entries, theta, strict=True)
        if name in OFFSETS
    )


def _unlikely(value: float, reading: RestReading, span: float) -> float:
    """How unlikely an offset is, beyond the reading at rest, in parts of the range."""
    # Seldom is not never: a load cell that nobody tared, a gauge with a zero of its own.
    usual = min((value / USUAL) ** 2, _UNBELIEVED)
    if reading.std is None:
        return usual
    return min((value / max(reading.std / span, AT_REST)) ** 2, _UNBELIEVED + usual)
