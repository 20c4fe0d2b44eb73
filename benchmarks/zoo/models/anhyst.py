"""anhyst with default settings, and each of its hysteresis laws alone.

The default compares laws and gap maps with withheld data and selects one. It declines a task if its
command would exit with an error or would state that the model must not be used.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from anhyst.data.loops import Loop, Loops
from anhyst.data.path import History
from anhyst.identification import identify
from anhyst.laws import LAWS
from anhyst.model.actuator import Model as IdentifiedModel
from anhyst.support.errors import InputError
from anhyst.support.units import Quantity, parse_header

from ..model import Factory, Refusal
from ..records import FloatArray, Record

DEFAULT = "anhyst"


class AnhystModel:
    """A model that `anhyst.identify` finds, with one law or with the law that it selects.

    Headers with units are read as in a file, so that values are in SI.
    """

    def __init__(self, law: str) -> None:
        self._law = law
        self._model: IdentifiedModel | None = None
        self._columns: tuple[Column, Column, Column | None]

    def fit(self, records: Sequence[Record]) -> None:
        """Identify the model with default settings."""
        drive, output, schedule = records[0].quantities
        self._columns = Column(drive), Column(output), Column(schedule) if schedule else None
        loops = Loops(
            tuple(map(self._make_loop, records)),
            self._columns[0].quantity,
            self._columns[1].quantity,
            None if self._columns[2] is None else self._columns[2].quantity,
        )
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                result = identify(loops, law=self._law)
        except InputError as error:
            raise Refusal(str(error)) from error
        if result.rejection:
            raise Refusal(result.rejection)
        self._model = result.model

    def predict(self, record: Record) -> FloatArray:
        """Return the output of the identified model."""
        drive, output, _ = self._columns
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            prediction = self._identified.predict(
                drive.to_si(record.input), self._schedule(record), record.time, History.parse(record.history)
            )
        return output.from_si(prediction.output)

    def n_parameters(self) -> int:
        """Return how many numbers the model file contains for the law and its maps."""
        return sum(np.size(value) for value in self._identified.parameters.values())

    @property
    def _identified(self) -> IdentifiedModel:
        assert self._model is not None, "fit first"
        return self._model

    def _schedule(self, record: Record) -> FloatArray | None:
        column = self._columns[2]
        return None if column is None or record.schedule is None else column.to_si(record.schedule)

    def _make_loop(self, record: Record) -> Loop:
        drive, output, _ = self._columns
        return Loop(
            record.name,
            drive.to_si(record.input),
            output.to_si(record.output),
            self._schedule(record),
            record.time,
            History.parse(record.history),
        )


class Column:
    """A quantity of a task, with its conversion to SI."""

    def __init__(self, text: str) -> None:
        header = parse_header(text)
        self.quantity = header.quantity or Quantity(header.name, header.name, header.stated or "1")
        offset, unit_value = header.to_si(np.array([0.0, 1.0])) if header.unit else (0.0, 1.0)
        self._offset, self._factor = float(offset), float(unit_value - offset)

    def to_si(self, values: FloatArray) -> FloatArray:
        """Convert values of the task to SI."""
        return values * self._factor + self._offset

    def from_si(self, values: FloatArray) -> FloatArray:
        """Convert SI values to the units of the task."""
        return (values - self._offset) / self._factor


MODELS: Mapping[str, Factory] = {
    DEFAULT: partial(AnhystModel, "auto"),
    **{f"{DEFAULT} {law}": partial(AnhystModel, law) for law in LAWS},
}
"""The default, and each law under its name."""
