"""What happened before the first sample of a loop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, cast

from anhyst.support.errors import InputError

Kind = Literal["demagnetised", "settled", "conditioned"]

_ADVICE = "use demagnetised, settled or conditioned:0,2,0 (the drive's turning points in SI units)"


@dataclass(frozen=True, slots=True)
class History:
    """The magnetic past of a loop.

    ``demagnetised``: nothing; ``settled``: the loop is a cycle that has been run often, after
    the drive had gone through ``turning_points``, if there are any; ``conditioned``: the drive went
    through ``turning_points`` (SI units of the input), from the demagnetised state, just before the
    first sample.
    """

    kind: Kind
    turning_points: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in {"demagnetised", "settled", "conditioned"}:
            raise InputError(f"history '{self.kind}' is not known; {_ADVICE}")
        wrong = {"conditioned": not self.turning_points, "demagnetised": bool(self.turning_points)}
        if wrong.get(self.kind, False):
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
        if not self.turning_points:
            return self.kind
        return f"{self.kind}:" + ",".join(repr(float(point)) for point in self.turning_points)


SETTLED = History("settled")
DEMAGNETISED = History("demagnetised")
