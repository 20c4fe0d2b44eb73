"""A model over the schedule (gap or temperature), made from a model of one scheduling value.

The training records are grouped by their scheduling value, and each group gets a model of its own.
A prediction runs every model over the complete input, and interpolates their outputs over the
schedule at each sample. Therefore, the schedule may move within a predicted record. The
interpolation is a shape-preserving cubic (Fritsch and Butland 1984, SciPy's PCHIP) from three
values on, and linear between two values. It is continued linearly outside.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from ..model import Model, Refusal
from ..records import FloatArray, Record

MAX_SPREAD = 0.01
"""Largest spread of the schedule in one group, relative to its span over all training records."""


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
        """Fit one model to the records of each scheduling value."""
        groups = _group_by_schedule(records)
        self._values = np.array([value for value, _ in groups])
        self._models = [self._factory() for _ in groups]
        for model, (_, group) in zip(self._models, groups, strict=True):
            model.fit([replace(record, schedule=None) for record in group])

    def predict(self, record: Record) -> FloatArray:
        """Return the output, interpolated over the schedule at each sample."""
        alone = replace(record, schedule=None)
        outputs = np.array([model.predict(alone) for model in self._models])
        if len(outputs) == 1 or record.schedule is None:
            first: FloatArray = outputs[0]
            return first
        return _interpolate(self._values, outputs, record.schedule)

    def n_parameters(self) -> int:
        """Return the numbers of all models together."""
        return sum(model.n_parameters() for model in self._models)


def _group_by_schedule(records: Sequence[Record]) -> list[tuple[float, list[Record]]]:
    """Return the scheduling values in increasing order, each with its records."""
    schedules = [record.schedule for record in records if record.schedule is not None]
    if not schedules:
        return [(0.0, list(records))]
    limit = MAX_SPREAD * float(np.ptp(np.concatenate(schedules)))
    still = [
        (float(np.mean(record.schedule)), record)
        for record in records
        if record.schedule is not None and np.ptp(record.schedule) <= limit
    ]
    if not still:
        raise Refusal("the schedule moves in every training record, and each fit needs a constant one")
    still.sort(key=lambda pair: pair[0])
    groups: list[list[tuple[float, Record]]] = []
    for value, record in still:
        if groups and value - groups[-1][0][0] <= limit:
            groups[-1].append((value, record))
        else:
            groups.append([(value, record)])
    return [(float(np.mean([v for v, _ in group])), [r for _, r in group]) for group in groups]


def _interpolate(values: FloatArray, outputs: FloatArray, schedule: FloatArray) -> FloatArray:
    """Return the column of each sample, interpolated at its own scheduling value."""
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
