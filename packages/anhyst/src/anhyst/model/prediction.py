"""Hold the output that a model computes for a record, and flag samples outside the valid range."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from anhyst.data.path import History
from anhyst.data.speeds import MAX_RATE_RATIO, fastest_input_rate, find_fast_samples
from anhyst.model.model_data import ModelData
from anhyst.model.schema import ValidRange
from anhyst.support.errors import ImplausibleWarning
from anhyst.support.numeric import FloatArray
from anhyst.support.result import Result, length_scale, range_text, thinning_slice
from anhyst.support.units import QUANTITIES, QUANTITY_DIMENSIONS, UNITS, Quantity
from anhyst.support.wording import count_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BoolArray = NDArray[np.bool_]
InputKind = Literal["drive", "demand"]

GIVEN_MARGIN = 1e-9
COMPUTED_MARGIN = 0.02
"""Margins beyond the valid range within which given and computed values count as inside, relative
to the range. The modelled loop ends near the largest measured sample, but not exactly there."""
UNIT_ERROR_RATIO = 20.0
"""Ratio to the largest value of a model above which a value probably has a wrong unit."""


def flag_samples(
    model: ModelData,
    kind: InputKind,
    drive: FloatArray,
    output: FloatArray,
    schedule: FloatArray | None,
    reachable: BoolArray,
    time: FloatArray | None = None,
    runs: Sequence[NDArray[np.intp]] | None = None,
) -> tuple[BoolArray, tuple[str, ...]]:
    """Flag samples outside the valid range, or too fast; also return warnings in words.

    `runs` are the rows of a file that were run separately; None for one run of samples.
    """
    rows = runs is not None
    is_valid, flags = reachable.copy(), []
    if not reachable.all():
        flags.append(_describe_samples(reachable, output, model.output.unit, rows, _UNREACHABLE))
    if model.valid is None:
        flags.append("the model has no valid range (no [valid]), so samples were not checked")
        return is_valid, tuple(flags)
    computed_quantity = {"drive": model.output, "demand": model.input}[kind]
    ranges = (
        (model.input, drive, model.valid.input),
        (model.output, output, model.valid.output),
        (model.schedule, schedule, model.valid.schedule),
    )
    out_of_range_texts = {
        quantity: describe_far_value(quantity, values, limits)
        for quantity, values, limits in ranges
        if quantity is not computed_quantity
    }
    for quantity, values, limits in ranges:
        if quantity is None or values is None or limits is None:
            continue
        margin = COMPUTED_MARGIN if quantity is computed_quantity else GIVEN_MARGIN
        low, high = limits
        allowance = margin * (high - low) + GIVEN_MARGIN * max(abs(low), abs(high))
        is_inside = (values >= low - allowance) & (values <= high + allowance)
        is_valid &= is_inside
        # If given values are far outside, computed values are outside as a consequence.
        if not is_inside.all() and not (quantity is computed_quantity and any(out_of_range_texts.values())):
            description = (
                f"lie outside the valid range of {quantity.name.replace('_', ' ')}, {low:g} to "
                f"{high:g} {quantity.unit}"
            )
            text = _describe_samples(is_inside, values, quantity.unit, rows, description)
            flags.append(": ".join(filter(None, (text, out_of_range_texts.get(quantity)))))
    if time is not None and model.valid.input_rate is not None:
        is_slow, fastest = _find_slow(model.valid, drive, time, runs or [np.arange(drive.size)])
        is_valid &= is_slow
        if not is_slow.all():
            description = f"change faster than was measured: {_describe_rate(model, fastest)}"
            flags.append(_describe_samples(is_slow, drive, model.input.unit, rows, description))
    return is_valid, tuple(flags)


def describe_fast_drives(
    model: ModelData, runs: Iterable[tuple[FloatArray, FloatArray]], place: str = ""
) -> tuple[str, ...]:
    """Return a warning if a drive changes faster than the loops of a model allow.

    A run is a pair of drives and times.
    """
    limits = model.valid
    if limits is None or limits.input_rate is None:
        return ()
    input_range = limits.input[1] - limits.input[0]
    fastest = max(fastest_input_rate(drive, time, input_range) for drive, time in runs)
    if fastest <= MAX_RATE_RATIO * limits.input_rate:
        return ()
    name = model.input.words
    return (f"{place}the {name} changes faster than was measured: {_describe_rate(model, fastest)}",)


def _describe_rate(model: ModelData, fastest: float) -> str:
    """Return the rate of a run and of the fitted loops, and what to measure."""
    unit, fitted = f"{model.input.unit}/s", model.valid_range.input_rate
    exception = "" if model.input.name == "voltage" else ", unless the iron is laminated"
    return (
        f"up to {fastest:.3g} {unit}, loops up to {fitted:.3g} {unit} were fitted; measure loops at "
        f"{fastest:.3g} {unit} too{exception}"
    )


def _find_slow(
    valid_range: ValidRange, drive: FloatArray, time: FloatArray, runs: Sequence[NDArray[np.intp]]
) -> tuple[BoolArray, float]:
    """Return which samples are slow enough for a model, and the fastest rate of all runs."""
    is_slow, fastest = np.ones(drive.size, dtype=np.bool_), 0.0
    (low, high), max_rate = valid_range.input, MAX_RATE_RATIO * (valid_range.input_rate or math.inf)
    for run in runs:
        rate, is_fast = find_fast_samples(drive[run], time[run], high - low, max_rate)
        is_slow[run], fastest = ~is_fast, max(fastest, rate)
    return is_slow, fastest


def describe_far_value(
    quantity: Quantity | None, values: FloatArray | None, limits: tuple[float, float] | None
) -> str:
    """Describe values so far outside a range that their unit may be wrong; else empty."""
    if quantity is None or values is None or limits is None or quantity.unit == "degC":
        return ""
    name, unit = quantity.words, quantity.unit
    largest_limit = max(map(abs, limits))
    largest_value = float(values[np.argmax(np.abs(values))])
    if abs(largest_value) > UNIT_ERROR_RATIO * largest_limit > 0.0:
        factor = abs(largest_value) / largest_limit
        text = f"{name} {largest_value:g} {unit} is {factor:.3g} times the largest {name} of the model"
        unit_guess = likely_unit(quantity, factor)
        return f"{text}; given in {unit_guess}?" if unit_guess else text
    smallest_value = float(np.abs(values).min())
    # Only a gap is never close to zero on purpose.
    if quantity.name == "gap" and 0.0 < UNIT_ERROR_RATIO * smallest_value < min(limits):
        factor = min(limits) / smallest_value
        return (
            f"{name} {smallest_value:g} {unit} is {factor:.3g} times less than the smallest {name} of the "
            f"model; metres instead of {likely_unit(quantity, factor) or 'another unit'}?"
        )
    return ""


def likely_unit(quantity: Quantity, factor: float) -> str:
    """Return the unit, a thousandth or millionth of SI, that explains a factor; else empty."""
    dimension = QUANTITY_DIMENSIONS.get(quantity.name, quantity.name)
    small_units = (unit for unit in UNITS.values() if unit.dimension == dimension and unit.scale < 0.02)
    nearest_unit = min(
        (unit for unit in small_units if round(math.log10(unit.scale), 9) % 3.0 == 0.0),
        key=lambda unit: abs(math.log(unit.scale * factor)),
        default=None,
    )
    if nearest_unit is None or not 1.0 / 32.0 < nearest_unit.scale * factor < 32.0:
        return ""
    return nearest_unit.symbol


def warn_if_far(model: ModelData, quantity: Quantity, values: FloatArray, schedule: ArrayLike | None) -> None:
    """Warn a Python caller once per call about values whose unit is probably wrong."""
    if model.valid is None:
        return
    limits = model.valid.input if quantity is model.input else model.valid.output
    gaps = None if schedule is None else np.atleast_1d(np.asarray(schedule, dtype=np.float64))
    texts = (
        describe_far_value(model.schedule, gaps, model.valid.schedule),
        describe_far_value(quantity, values, limits),
    )
    text = "; ".join(filter(None, texts))
    if text:
        warnings.warn(text, ImplausibleWarning, stacklevel=4)  # the caller of the model's method


_UNREACHABLE = "demand an output that is too low for every drive"


def _describe_samples(
    has_passed: BoolArray, values: FloatArray, unit: str, rows: bool, description: str
) -> str:
    first_bad = int(np.argmin(has_passed))
    location = f"row {first_bad + 1}" if rows else f"sample {first_bad}"
    return (
        f"{int((~has_passed).sum())} of {has_passed.size} {'rows' if rows else 'samples'} {description} "
        f"(first: {location}, {values[first_bad]:g} {unit})"
    )


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Result):
    """Result of a prediction or inversion over a record; all arrays have the shape (n,).

    Parameters
    ----------
    drive : ndarray
        Input of the actuator, in units of the input.
    output : ndarray
        Output of the actuator, in units of the output. After ``invert``, the output for the computed
        drive: the demand, unless the demand has no solution.
    flux_density : ndarray
        T.
    field : ndarray
        Field in the iron, A/m.
    valid : ndarray of bool
        Whether the sample is inside the valid range of the model.
    state : ndarray, shape (s,)
        State of the iron after the last sample (``x/a``, ``M_irr/M_s``, play ``/a``).
    cycles : int
        Number of repetitions until steady state; 0 for another history.
    history : History
        Assumed history before the first sample.
    reachable : ndarray of bool
        Whether the demand has a solution; all True after ``predict``.
    flags, notes : tuple of str
        Sentences about samples outside the valid range, and about assumptions.
    quantities : tuple of Quantity
        Quantities of `drive` and `output`.
    flux_linkage : ndarray or None
        Flux linkage of the coil, Wb, if the force was derived from it.
    """

    drive: FloatArray
    output: FloatArray
    flux_density: FloatArray
    field: FloatArray
    valid: BoolArray
    state: FloatArray
    cycles: int
    history: History
    reachable: BoolArray
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    quantities: tuple[Quantity, Quantity]
    flux_linkage: FloatArray | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings, one sentence each."""
        return self.flags + self.notes

    def facts(self) -> dict[str, str]:
        """Return ranges, assumed history, and the number of samples outside the valid range."""
        drive, output_quantity = self.quantities
        return {
            "samples": str(self.drive.size),
            drive.name: range_text(self.drive.min(), self.drive.max(), drive.unit),
            output_quantity.name: range_text(self.output.min(), self.output.max(), output_quantity.unit),
            "history": str(self.history),
            "outside the valid range": count_text(int((~self.valid).sum()), "sample"),
        }

    def to_columns(self) -> dict[str, Any]:
        """Return the samples, SI."""
        drive, output_quantity = self.quantities
        has_flux = self.flux_linkage is not None
        return {
            drive.column: self.drive,
            output_quantity.column: self.output,
            **({QUANTITIES["flux_linkage"].column: self.flux_linkage} if has_flux else {}),
            "iron_B_T": self.flux_density,
            "iron_H_A_per_m": self.field,
            "valid": self.valid,
            "reachable": self.reachable,
        }

    def draw(self, ax: Axes) -> None:
        """Draw output over drive."""
        drive, output_quantity = self.quantities
        scale, label = length_scale(output_quantity)
        plotted_samples = thinning_slice(self.drive.size)
        ax.plot(self.drive[plotted_samples], scale * self.output[plotted_samples], lw=1.1)
        ax.set_xlabel(drive.label)
        ax.set_ylabel(label)
