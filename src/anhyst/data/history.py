"""What happened before the first sample of a loop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from anhyst.data.noise import noise
from anhyst.data.path import crossings, turning_points
from anhyst.errors import InputError

Kind = Literal["demagnetised", "settled", "conditioned"]

_ADVICE = "use demagnetised, settled or conditioned:0,2,0 (the drive's turning points in SI units)"
_NEAR = 0.02
"""A start or an end within this share of the range counts as reached."""


@dataclass(frozen=True, slots=True)
class History:
    """The magnetic past of a loop.

    ``demagnetised``: nothing; ``settled``: the loop is a cycle that has been run often;
    ``conditioned``: the drive went through ``turning_points`` (SI units of the input), from the
    demagnetised state, just before the first sample.
    """

    kind: Kind
    turning_points: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in {"demagnetised", "settled", "conditioned"}:
            raise InputError(f"history '{self.kind}' is not known; {_ADVICE}")
        if (self.kind == "conditioned") != bool(self.turning_points):
            raise InputError(f"history '{self.kind}' with the wrong turning points; {_ADVICE}")
        if not all(math.isfinite(point) for point in self.turning_points):
            raise InputError(f"history '{self}': turning points must be finite; {_ADVICE}")

    @classmethod
    def parse(cls, text: str) -> History:
        """Read a history from its text form, such as ``settled`` or ``conditioned:0,2,0``.

        Raises
        ------
        InputError
            If the text is none of the three.

        Examples
        --------
        >>> str(History.parse("conditioned: 0, 2, 0"))
        'conditioned:0.0,2.0,0.0'
        """
        kind, colon, rest = text.strip().partition(":")
        kind = kind.strip().lower().replace("demagnetized", "demagnetised")
        if kind not in {"demagnetised", "settled", "conditioned"}:
            raise InputError(f"history '{text}' is not known; {_ADVICE}")
        try:
            points = tuple(float(point) for point in rest.split(",")) if colon else ()
        except ValueError:
            raise InputError(
                f"history '{text}': turning points are no numbers; {_ADVICE}"
            ) from None
        return cls(cast("Kind", kind), points)

    def __str__(self) -> str:
        """Text form, exact to the last digit; `parse` reads it back."""
        if self.kind != "conditioned":
            return self.kind
        return "conditioned:" + ",".join(repr(float(point)) for point in self.turning_points)


SETTLED = History("settled")
DEMAGNETISED = History("demagnetised")


def propose_history(drive: NDArray[np.float64], answer: NDArray[np.float64]) -> tuple[History, str]:
    """Judge from a loop what happened before it, and say why.

    A record that comes back to its first point is taken as settled; one that starts at rest and
    does not come back starts demagnetised.

    Parameters
    ----------
    drive, answer
        Input and output of one loop, shape (n,).
    """
    span = float(np.ptp(drive))
    height = float(np.ptp(answer)) or 1.0
    at_rest = (
        abs(drive[0]) <= _NEAR * float(np.max(np.abs(drive)))
        and abs(answer[0]) <= 2 * _NEAR * float(np.max(np.abs(answer)))
    )  # fmt: skip
    back = _return_to_start(drive, answer, span)
    # Two single samples differ by noise alone now and then.
    if back is not None and abs(back - answer[0]) <= max(_NEAR * height, 5.0 * noise(answer)):
        error = abs(back - answer[0]) / height
        return SETTLED, f"it comes back to its start within {error:.2%} of its height"
    if at_rest:
        why = "never comes back there" if back is None else "does not come back there"
        return DEMAGNETISED, f"it starts at rest, at zero, and {why}"
    if back is None:
        return SETTLED, "it starts away from rest and is no complete cycle: a guess"
    error = abs(back - answer[0]) / height
    return (
        SETTLED,
        f"it starts away from rest and misses its start by {error:.2%} of its height: a guess",
    )


def _return_to_start(
    drive: NDArray[np.float64], answer: NDArray[np.float64], span: float
) -> float | None:
    """Output when the input last passes its first value in the direction it started in."""
    turns = turning_points(drive, _NEAR * span)
    if turns.size <= 2:
        return None
    rising = bool(drive[turns[1]] > drive[0])
    later = slice(int(turns[1]), None)
    again = crossings(drive[later], answer[later], float(drive[0]), rising=rising)
    if again.size:
        return float(again[-1])
    if abs(drive[-1] - drive[0]) <= _NEAR * span:
        return float(answer[-1])
    return None
