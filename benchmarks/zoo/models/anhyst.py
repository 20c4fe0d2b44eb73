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
from anhyst.support.units import QUANTITIES, Quantity

from ..model import Factory, Refusal
from ..records import FloatArray, Record

DEFAULT = "anhyst"


class AnhystModel:
    """A model that `anhyst.identify` finds, with one law or with the law that it selects."""

    def __init__(self, law: str) -> None:
        self._law = law
        self._model: IdentifiedModel | None = None

    def fit(self, records: Sequence[Record]) -> None:
        """Identify the model with default settings."""
        quantities = [_read_quantity(header) if header else None for header in records[0].quantities]
        drive, output, schedule = quantities
        assert drive is not None
        assert output is not None
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                result = identify(
                    Loops(tuple(map(_make_loop, records)), drive, output, schedule), law=self._law
                )
        except InputError as error:
            raise Refusal(str(error)) from error
        if result.rejection:
            raise Refusal(result.rejection)
        self._model = result.model

    def predict(self, record: Record) -> FloatArray:
        """Return the output of the identified model."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            prediction = self._identified.predict(
                record.input, record.schedule, record.time, History.parse(record.history)
            )
        return prediction.output

    def invert(self, record: Record) -> FloatArray:
        """Return the input from the exact inverse of the model."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            prediction = self._identified.invert(
                record.output, record.schedule, record.time, History.parse(record.history)
            )
        return prediction.drive

    def n_parameters(self) -> int:
        """Return how many numbers the model file contains for the law and its maps."""
        return sum(np.size(value) for value in self._identified.parameters.values())

    @property
    def _identified(self) -> IdentifiedModel:
        assert self._model is not None, "fit first"
        return self._model


def _read_quantity(header: str) -> Quantity:
    """Return the quantity of a header such as ``I (A)``."""
    symbol, _, unit = header.rstrip(")").partition(" (")
    known = {quantity.symbol: quantity for quantity in QUANTITIES.values()}
    return known.get(symbol, Quantity(symbol, symbol, unit))


def _make_loop(record: Record) -> Loop:
    return Loop(
        record.name, record.input, record.output, record.schedule, record.time, History.parse(record.history)
    )


MODELS: Mapping[str, Factory] = {
    DEFAULT: partial(AnhystModel, "auto"),
    **{f"{DEFAULT} {law}": partial(AnhystModel, law) for law in LAWS},
}
"""The default, and each law under its name."""
