"""What the data say about each fitted number, and what they cannot say.

Whether the data demand an offset of a sensor: an information criterion with a prior.

Any law misses a real iron by a little, and an offset is glad to take part of that over: it then
stands for a force where none is. So an offset is fitted only where it pays by more than chance,
with deviations that go together along a record, and from loop to loop, counted once, and by more
than it is unlike a sensor's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from anhyst.data import Loops
from anhyst.identification.default import COMPARED, Evaluation, FoundModel, Linear, follow
from anhyst.identification.fit_records import RestReading
from anhyst.identification.objective import Objective
from anhyst.identification.space import IN_SERIES, CoordinateSpace
from anhyst.laws.law import FitNumber
from anhyst.model.fit_record import Uncertainty
from anhyst.support.errors import NoResponseError
from anhyst.support.numeric import FloatArray

_LOOSE = 0.2
"""Relative standard deviation above which a number is called loose."""

_NAMED = 6
"""Loose numbers that are named one by one, at most: of many only all together mean something."""

_TIED = 0.95
"""Correlation above which two numbers are determined only together."""


def memory(deviations: FloatArray) -> float:
    """Return the number of successive samples that count as one, as their deviations are correlated.

    Twice the integral of the autocorrelation up to its first zero: misfit of the law runs in long
    waves, and counting each sample as independent would promise far too much.
    """
    centred = deviations - deviations.mean()
    power = float(centred @ centred)
    if power == 0.0:
        return 1.0
    spectrum = np.abs(np.fft.rfft(centred, 2 * centred.size)) ** 2
    correlation = np.fft.irfft(spectrum)[: centred.size] / power
    negative = np.flatnonzero(correlation <= 0.0)
    end = int(negative[0]) if negative.size else centred.size
    return max(1.0, 2.0 * float(correlation[:end].sum()) - 1.0)


def mean_memory(space: CoordinateSpace, deviation: FloatArray) -> float:
    """Average the memory of weighted deviations over the drives of a space."""
    ends = np.cumsum([record.input.size for record in space.records.loops])
    return float(np.mean([memory(part) for part in np.split(deviation, ends)[:-1]]))


def _covariance(fit: FoundModel) -> FloatArray:
    evaluation = Evaluation(Objective(fit.space))
    linear = evaluation.at(fit.theta)
    deviation, normal = linear.deviation, linear.normal
    freedom = max(1, deviation.size - fit.theta.size)
    variance = linear.cost / freedom * mean_memory(fit.space, deviation)
    # A coordinate the data do not feel at all gets a huge, finite variance.
    floor = 1e-14 * max(float(np.trace(normal)), 1e-300)
    return np.asarray(variance * np.linalg.inv(normal + floor * np.eye(normal.shape[0])))


def assess(fit: FoundModel, loopset: Loops) -> Uncertainty:
    """Return standard deviations, correlations and plain statements for a finished fit."""
    space = fit.space
    covariance = _covariance(fit)
    deviation = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviation, deviation)
    units = {"input": loopset.input.unit, "output": loopset.output.unit}
    readings = {"in_0": space.records.rest.input, "out_0": space.records.rest.output}
    names, values, stds = [], [], []
    at_gaps = [space.form.values(local) for local in fit.sets]
    for (name, gap), plain, slope, std in zip(
        space.entries,
        *(column.tolist() for column in space.outward(fit.theta)),
        deviation,
        strict=True,
    ):
        value = at_gaps[gap or 0].get(name, plain)
        number = space.numbers[name]
        label = _label(number, units)
        if gap is not None and loopset.schedule is not None:
            label += f" at {loopset.schedule.show(float(space.records.nodes[gap]))}"
        names.append(label)
        stds.append(float(std * (abs(value) if number.coordinate == "log" else slope)))
        values.append(value + (readings[name].offset if name in readings else 0.0))
    sentences = statements(names, values, stds, correlation) + _of_the_gauge(fit)
    for name, reading in readings.items():
        if name in space.held and reading.std is not None and reading.offset != 0.0:
            names.append(_label(space.numbers[name], units))
            values.append(reading.offset)
            stds.append(reading.std)
            sentences.append(f"{names[-1]}: what the sensor reads at rest, not fitted")
    whole = np.eye(len(names))
    whole[: space.size, : space.size] = correlation
    return Uncertainty(
        names=tuple(names),
        values=tuple(values),
        std=tuple(stds),
        correlation=tuple(tuple(row) for row in whole.tolist()),
        statements=tuple(sentences),
    )


def _label(number: FitNumber, units: Mapping[str, str]) -> str:
    return f"{number.meaning} ({units[number.of]})" if number.of else number.meaning


def statements(
    names: Sequence[str], values: Sequence[float], stds: Sequence[float], correlation: FloatArray
) -> list[str]:
    """Say which numbers the data determine badly, and which only together."""
    loose = [
        (name, "more than its size" if std > abs(value) else f"{100 * std / abs(value):.0f} %")
        for name, value, std in zip(names, values, stds, strict=True)
        if "offset" not in name and std > _LOOSE * abs(value)
    ]
    sentences = [
        f"{name} is hardly determined by these loops: uncertain by {share}" for name, share in loose
    ]
    if len(loose) > _NAMED:
        listed = ", ".join(name for name, _ in loose[:_NAMED])
        sentences = [
            f"{len(loose)} of {len(names)} numbers are hardly determined by these loops one by one, "
            f"uncertain by more than {100 * _LOOSE:.0f} %: {listed}, ..."
        ]
    sentences.extend(
        f"{', '.join(names[index] for index in group)}: determined only together (correlations above "
        f"{_TIED:g}); none of them means much by itself"
        for group in _tied(correlation)
    )
    return sentences


def _of_the_gauge(fit: FoundModel) -> list[str]:
    """Say what was chosen, because no output depends on it."""
    sentences = []
    form, gap_map = fit.space.form, fit.space.written_map
    if form.permeability == 0.0:
        sentences.append(
            "M_s is a choice of gauge, on which no output depends; the slope of the air core is "
            f"hardly determined by these loops: a/(M_s*(1-alpha)) is set to {form.h:g}, which matters "
            "beyond the measured range"
        )
    if gap_map in IN_SERIES:
        sentences.append(
            f"alpha and an offset of rho act alike in the {gap_map} map: alpha is chosen so that "
            "rho is nowhere negative down to the closed gap"
        )
    return sentences


def _tied(correlation: FloatArray) -> list[list[int]]:
    """Group coordinates that are tied by strong correlations."""
    groups: list[list[int]] = []
    for index in range(correlation.shape[0]):
        near = [g for g in groups if any(abs(correlation[index, o]) > _TIED for o in g)]
        groups = [g for g in groups if g not in near] + [[*(o for g in near for o in g), index]]
    return [sorted(group) for group in groups if len(group) > 1]


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
    linear = Evaluation(Objective(fit.space, fit.tie)).at(fit.theta)
    drives = len(fit.space.records.loops)
    ends = np.cumsum([record.input.size for record in fit.space.records.loops])
    shares = [_lasting(attempt) for attempt in np.split(linear.deviation, ends)[:-1]]
    alike = 1.0 + (drives - 1) * float(np.mean(shares))
    independent = max(2.0, float(ends[-1]) / mean_memory(fit.space, linear.deviation) / alike)
    ways = [frozenset(names) for n in range(1, len(free) + 1) for names in combinations(free, n)]

    def score(cost: float, space: CoordinateSpace, theta: FloatArray) -> float:
        return independent * math.log(cost + _EXACT) + _price(space, theta, independent)

    tries = {}
    for names in ways:
        space, kept = fit.space.holding(names)
        cost, theta = _without(fit, linear, names)
        tries[names] = score(cost, space, theta[kept]), space, theta[kept]
    _, space, start = min(tries.values(), key=lambda attempt: attempt[0])
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


def _without(fit: FoundModel, linear: Linear, names: frozenset[str]) -> tuple[float, FloatArray]:
    """Foresee the best fit with these offsets held at zero: its cost and its coordinates."""
    out = np.array([name in names for name, _ in fit.space.entries])
    theta = np.where(out, 0.0, fit.theta)
    normal = linear.normal + 1e-12 * np.trace(linear.normal) * np.eye(out.size)
    pull = normal[np.ix_(~out, out)] @ fit.theta[out]
    theta[~out] += np.linalg.solve(normal[np.ix_(~out, ~out)], pull)
    theta = np.clip(theta, *fit.space.bounds)
    step = theta - fit.theta
    return fit.cost + float(step @ linear.normal @ step), theta


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
