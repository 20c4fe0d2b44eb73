"""What the data say about each fitted number, and what they cannot say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from anhyst.data import Loops
from anhyst.identification.default import FoundModel
from anhyst.identification.fitting import Evaluation
from anhyst.identification.objective import Objective
from anhyst.identification.space import IN_SERIES, CoordinateSpace
from anhyst.laws.law import FitNumber
from anhyst.model.fit_record import Uncertainty
from anhyst.support.arrays import FloatArray

_LOOSE = 0.2
"""Relative standard deviation above which a number is called loose."""

_NAMED = 6
"""Loose numbers that are named one by one, at most: of many only all together mean something."""

_TIED = 0.95
"""Correlation above which two numbers are determined only together."""


def memory(deviations: FloatArray) -> float:
    """Count the samples that weigh as one, because their deviations go together.

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
    return float(np.mean([memory(one) for one in np.split(deviation, ends)[:-1]]))


def _covariance(fit: FoundModel) -> FloatArray:
    evaluation = Evaluation(Objective(fit.space))
    here = evaluation.at(fit.theta)
    deviation, normal = here.deviation, here.normal
    freedom = max(1, deviation.size - fit.theta.size)
    variance = here.cost / freedom * mean_memory(fit.space, deviation)
    # A coordinate the data do not feel at all gets a huge, finite variance.
    floor = 1e-14 * max(float(np.trace(normal)), 1e-300)
    return np.asarray(variance * np.linalg.inv(normal + floor * np.eye(normal.shape[0])))


def assess(fit: FoundModel, loopset: Loops) -> Uncertainty:
    """Give standard deviations, correlations and plain statements for a finished fit."""
    space = fit.space
    covariance = _covariance(fit)
    deviation = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviation, deviation)
    units = {"input": loopset.input.unit, "output": loopset.output.unit}
    readings = {"in_0": space.records.rest.input, "out_0": space.records.rest.output}
    names, values, stds = [], [], []
    at_gaps = [space.form.values(local) for local in fit.sets]
    for (name, gap), plain, slope, std in zip(
        space.entries, *(one.tolist() for one in space.outward(fit.theta)), deviation, strict=True
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
