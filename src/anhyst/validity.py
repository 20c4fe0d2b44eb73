"""Where a model was seen to hold, and what is said about samples that are not there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from anhyst.model import ActuatorModel

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Given = Literal["drive", "demand"]

GIVEN_MARGIN = 1e-9
COMPUTED_MARGIN = 0.02
"""What a value may exceed the valid range by, in parts of the range, and count as inside. A
computed one gets more: the model of the largest measured loop does not end on its largest sample.
"""


def flag(
    model: ActuatorModel,
    kind: Given,
    drive: FloatArray,
    output: FloatArray,
    schedule: FloatArray | None,
    reachable: BoolArray,
    rows: bool = False,
) -> tuple[BoolArray, tuple[str, ...]]:
    """Flag samples outside the valid range, and say so.

    Parameters
    ----------
    model : ActuatorModel
        The model.
    kind : str
        What was given: ``"drive"`` or ``"demand"``; the other one was computed.
    drive, output : ndarray, shape (n,)
        In units of the input and of the output; the demand as it was given.
    schedule : ndarray, shape (n,), or None
        Scheduling variable, SI.
    reachable : ndarray of bool, shape (n,)
        Whether the demand has an answer.
    rows : bool
        Whether to speak of rows of a file, counted from 1, instead of samples, counted from 0.

    Returns
    -------
    valid : ndarray of bool, shape (n,)
        True inside.
    flags : tuple of str
        One sentence for each quantity that leaves its range.
    """
    valid, flags = reachable.copy(), []
    if not reachable.all():
        flags.append(_sentence(reachable, output, model.output.unit, rows, _UNREACHABLE))
    if model.valid is None:
        flags.append("the model does not say where it holds (no [valid]): nothing could be checked")
        return valid, tuple(flags)
    computed = {"drive": model.output, "demand": model.input}[kind]
    ranges = (
        (model.input, drive, model.valid.input),
        (model.output, output, model.valid.output),
        (model.schedule, schedule, model.valid.schedule),
    )
    for quantity, values, limits in ranges:
        if quantity is None or values is None or limits is None:
            continue
        margin = COMPUTED_MARGIN if quantity is computed else GIVEN_MARGIN
        low, high = limits
        allowance = margin * (high - low) + GIVEN_MARGIN * max(abs(low), abs(high))
        inside = (values >= low - allowance) & (values <= high + allowance)
        valid &= inside
        if not inside.all():
            what = (
                f"lie outside the valid range of {quantity.name.replace('_', ' ')}, {low:g} to "
                f"{high:g} {quantity.unit}"
            )
            flags.append(_sentence(inside, values, quantity.unit, rows, what))
    return valid, tuple(flags)


_UNREACHABLE = "demand less than any drive can give"


def _sentence(good: BoolArray, values: FloatArray, unit: str, rows: bool, what: str) -> str:
    first = int(np.argmin(good))
    place = f"row {first + 1}" if rows else f"sample {first}"
    return (
        f"{int((~good).sum())} of {good.size} {'rows' if rows else 'samples'} {what} "
        f"(first: {place}, {values[first]:g} {unit})"
    )
