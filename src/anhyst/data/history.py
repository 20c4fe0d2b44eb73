"""What happened before the first sample of a loop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby
from typing import Literal, cast

from anhyst.support.errors import InputError

Kind = Literal["demagnetised", "settled", "conditioned"]

_ADVICE = (
    "use demagnetised, settled or conditioned:0,2,0 (the drive's turning points in SI units; "
    "conditioned:0,2,0@0.0003;0,1 if the first were at 0.0003)"
)


@dataclass(frozen=True, slots=True)
class History:
    """The magnetic past of a loop.

    ``demagnetised``: nothing; ``settled``: the loop is a cycle that has been run often, after
    the drive had gone through ``turning_points``, if there are any; ``conditioned``: the drive went
    through ``turning_points`` (SI units of the input), from the demagnetised state, just before the
    first sample. ``schedule`` holds the scheduling variable at each of these, SI, None where it was
    that of the loop; empty if it was so at all.
    """

    kind: Kind
    turning_points: tuple[float, ...] = ()
    schedule: tuple[float | None, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in {"demagnetised", "settled", "conditioned"}:
            raise InputError(
                f"history '{self.kind}' is not known; {_ADVICE}",
                code="unknown-history",
                key="history",
            )
        wrong = {"conditioned": not self.turning_points, "demagnetised": bool(self.turning_points)}
        if wrong.get(self.kind, False):
            raise InputError(
                f"history '{self.kind}' with the wrong turning points; {_ADVICE}",
                code="history-turning-points",
                key="history",
            )
        if self.schedule and len(self.schedule) != len(self.turning_points):
            raise InputError(
                f"history '{self.kind}': {len(self.turning_points)} turning points and "
                f"{len(self.schedule)} scheduling values; give one for each",
                code="history-schedule",
                key="history",
            )
        values = [*self.turning_points, *(value for value in self.schedule if value is not None)]
        if not all(math.isfinite(value) for value in values):
            raise InputError(
                f"history '{self}': turning points must be finite; {_ADVICE}",
                code="history-turning-points",
                key="history",
            )
        if all(value is None for value in self.schedule):
            object.__setattr__(self, "schedule", ())

    @classmethod
    def parse(cls, text: str) -> History:
        """Read a history from its text form, such as ``settled`` or ``conditioned:0,2,0``.

        >>> str(History.parse("conditioned: 0, 2, 0"))
        'conditioned:0.0,2.0,0.0'
        >>> History.parse("settled:0,3,0@0.0003;0,2,0").schedule
        (0.0003, 0.0003, 0.0003, None, None, None)
        """
        kind, colon, rest = text.strip().partition(":")
        kind = kind.strip().lower().replace("demagnetized", "demagnetised")
        if kind not in {"demagnetised", "settled", "conditioned"}:
            raise InputError(
                f"history '{text}' is not known; {_ADVICE}", code="unknown-history", key="history"
            )
        points: list[float] = []
        schedule: list[float | None] = []
        try:
            for stretch in rest.split(";") if colon else ():
                turns, elsewhere, value = stretch.partition("@")
                points += [float(point) for point in turns.split(",")]
                at = float(value) if elsewhere else None
                schedule += [at] * (len(points) - len(schedule))
        except ValueError:
            raise InputError(
                f"history '{text}': turning points are no numbers; {_ADVICE}",
                code="history-turning-points",
                key="history",
            ) from None
        return cls(cast("Kind", kind), tuple(points), tuple(schedule))

    def places(self, own: float | None) -> tuple[float | None, ...]:
        """Return the scheduling variable at each turning point, for a loop at a value of its own."""
        schedule = self.schedule or (None,) * len(self.turning_points)
        return tuple(own if value is None else value for value in schedule)

    def __str__(self) -> str:
        """Text form, exact to the last digit; `parse` reads it back."""
        if not self.turning_points:
            return self.kind
        pairs = zip(self.turning_points, self.places(None), strict=True)
        stretches = []
        for value, stretch in groupby(pairs, key=lambda pair: pair[1]):
            points = ",".join(repr(float(point)) for point, _ in stretch)
            stretches.append(points if value is None else f"{points}@{float(value)!r}")
        return f"{self.kind}:{';'.join(stretches)}"


SETTLED = History("settled")
DEMAGNETISED = History("demagnetised")
