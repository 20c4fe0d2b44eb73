"""A model over the schedule (gap or temperature), made from a model of one scheduling value.

The training records are grouped by their scheduling value, and each group gets a separate model. A
prediction runs every model over the complete input, and interpolates their outputs over the
schedule at each sample. Therefore, the schedule may move within a predicted record. With three or
more values, the interpolation is a shape-preserving cubic (Fritsch and Butland 1984, SciPy's
PCHIP); it is linear between two values. It is continued linearly outside.

The outputs or their signed square roots are interpolated, or the reciprocals of these values, over
the schedule or over the reciprocal of the schedule plus an offset. The reasons are that the
reciprocal of a flux density is about linear in the gap, and that a force is proportional to the
square of a flux density. The scales are chosen by the error of the
interpolation at inner training values that are left out. Two gaps have no inner value; then the
offset is the one for which the two models agree best.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from ..model import Model, Refusal
from ..records import FloatArray, Record

MAX_SPREAD = 0.01
"""Largest spread of the schedule in one group, relative to its span over all training records."""

OFFSETS = (None, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 3.0)
"""Offsets of the reciprocal, relative to the span of the schedule; ``None`` is the schedule itself."""

POWERS = (1.0, 0.5)
FLOOR = 0.01
"""Added before the reciprocal of an output, relative to the largest output."""


@dataclass(frozen=True)
class _Scales:
    """Scales of schedule and output for the interpolation."""

    lowest: float  # smallest scheduling value
    offset: float | None  # added to the distance from the smallest value before its reciprocal
    power: float  # exponent of the absolute output
    floor: float | None  # added before the reciprocal of the powers is interpolated

    def interpolate(self, values: FloatArray, outputs: FloatArray, schedule: FloatArray) -> FloatArray:
        """Return the output at each sample, interpolated at the scheduling value of the sample."""
        powers = np.abs(outputs) ** self.power
        mapped, mapped_schedule = self._map(values), self._map(schedule)
        signed = _interpolate(mapped, np.sign(outputs) * powers, mapped_schedule)
        size = np.abs(signed)
        if self.floor is not None:
            reciprocal = _interpolate(mapped, 1.0 / (powers + self.floor), mapped_schedule)
            reciprocal = np.maximum(reciprocal, 0.1 / float(np.max(powers + self.floor)))
            size = np.maximum(1.0 / reciprocal - self.floor, 0.0)
        result: FloatArray = np.sign(signed) * size ** (1.0 / self.power)
        return result

    def _map(self, schedule: FloatArray) -> FloatArray:
        """Return the increasing scale of the schedule; below the range, it stops before the pole."""
        if self.offset is None:
            return schedule
        return -1.0 / (np.maximum(schedule - self.lowest, -0.5 * self.offset) + self.offset)


class OverSchedule:
    """A separate model for each scheduling value, interpolated over the schedule.

    Parameters
    ----------
    factory
        Makes an unfitted model that ignores the schedule.
    """

    def __init__(self, factory: Callable[[], Model]) -> None:
        self._factory = factory
        self._values: FloatArray = np.zeros(0)
        self._models: list[Model] = []

    def fit(self, records: Sequence[Record]) -> None:
        """Fit one model for every scheduling value, and choose the scales."""
        groups = _group_by_schedule(records)
        self._values = np.array([value for value, _ in groups])
        self._models = [self._factory() for _ in groups]
        for model, (_, group) in zip(self._models, groups, strict=True):
            model.fit([replace(record, schedule=None) for record in group])
        if len(groups) > 1:
            self._scales = self._choose_scales([group for _, group in groups])

    def predict(self, record: Record) -> FloatArray:
        """Return the output, interpolated over the schedule at each sample."""
        outputs = self._predict_all(record)
        if len(outputs) == 1 or record.schedule is None:
            only_output: FloatArray = outputs[0]
            return only_output
        return self._scales.interpolate(self._values, outputs, record.schedule)

    def _predict_all(self, record: Record) -> FloatArray:
        """Return the outputs of all models, shape (models, n)."""
        unscheduled = replace(record, schedule=None).without_output()
        return np.array([model.predict(unscheduled) for model in self._models])

    def _choose_scales(self, groups: Sequence[Sequence[Record]]) -> _Scales:
        """Return the scales with the smallest error at inner training values that are left out."""
        lowest, span = self._values[0], float(np.ptp(self._values))
        if len(groups) == 2:
            is_gap = groups[0][0].quantities[2].startswith("gap")
            return _Scales(lowest, self._agree_on_offset(groups) if is_gap else None, 1.0, None)
        errors = {}
        predicted = [[(record, self._predict_all(record)) for record in group] for group in groups[1:-1]]
        largest = max(float(np.max(np.abs(record.output))) for group in groups for record in group)
        for offset, power, is_reciprocal in itertools.product(OFFSETS, POWERS, (False, True)):
            floor = FLOOR * largest**power if is_reciprocal else None
            scales = _Scales(lowest, None if offset is None else offset * span, power, floor)
            errors[scales] = 0.0
            for index, pairs in enumerate(predicted, 1):
                values = np.delete(self._values, index)
                for record, outputs in pairs:
                    schedule = np.full(record.input.size, self._values[index])
                    output = scales.interpolate(values, np.delete(outputs, index, axis=0), schedule)
                    errors[scales] += float(np.sum((output - record.output)[record.scored] ** 2))
        return min(errors, key=errors.__getitem__)

    def _agree_on_offset(self, groups: Sequence[Sequence[Record]]) -> float | None:
        """Return the offset with which two outputs times gap plus offset agree best, or ``None``."""
        outputs = np.hstack([self._predict_all(record) for group in groups for record in group])
        difference = outputs[0] - outputs[1]
        product = outputs[1] * (self._values[1] - self._values[0])
        offset = float(difference @ product / max(float(difference @ difference), 1e-300))
        return offset if offset > 0.0 else None

    def n_parameters(self) -> int:
        """Return the sum over the models."""
        return sum(model.n_parameters() for model in self._models)


def _group_by_schedule(records: Sequence[Record]) -> list[tuple[float, list[Record]]]:
    """Return the scheduling values in increasing order, each with its records."""
    schedules = [record.schedule for record in records if record.schedule is not None]
    if not schedules:
        return [(0.0, list(records))]
    limit = MAX_SPREAD * float(np.ptp(np.concatenate(schedules)))
    constant_records = [
        (float(np.mean(record.schedule)), record)
        for record in records
        if record.schedule is not None and np.ptp(record.schedule) <= limit
    ]
    if not constant_records:
        raise Refusal("the schedule moves in every training record, and each fit needs a constant one")
    constant_records.sort(key=lambda pair: pair[0])
    groups: list[list[tuple[float, Record]]] = []
    for value, record in constant_records:
        if groups and value - groups[-1][0][0] <= limit:
            groups[-1].append((value, record))
        else:
            groups.append([(value, record)])
    return [(float(np.mean([v for v, _ in group])), [r for _, r in group]) for group in groups]


def _interpolate(values: FloatArray, outputs: FloatArray, schedule: FloatArray) -> FloatArray:
    """Return the column of each sample, interpolated at the scheduling value of the sample."""
    columns = np.arange(schedule.size)
    inside = np.clip(schedule, values[0], values[-1])
    piece = np.clip(np.searchsorted(values, inside, side="right") - 1, 0, values.size - 2)
    if values.size == 2:
        slope = (outputs[1] - outputs[0]) / (values[1] - values[0])
        linear: FloatArray = outputs[0] + slope * (schedule - values[0])
        return linear
    c3, c2, c1, c0 = PchipInterpolator(values, outputs, axis=0).c[:, piece, columns]
    x = inside - values[piece]
    result: FloatArray = c0 + x * (c1 + x * (c2 + x * c3))
    result += (schedule - inside) * (c1 + x * (2.0 * c2 + x * 3.0 * c3))
    return result
