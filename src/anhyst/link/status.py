"""What a controller says of itself, as fractions of full scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from anhyst.control.states import Fault, Flag, State
from anhyst.link.frames import StatusAnswer

_Q30 = 1.0 / (1 << 30)
_Q31 = 1.0 / (1 << 31)


@dataclass(frozen=True, slots=True)
class Status:
    """What a controller did in one tick."""

    tick: int  # which
    codes: StatusAnswer  # the numbers as they came

    @classmethod
    def of(cls, answer: StatusAnswer, tick: int) -> Self:
        """Read an answer."""
        return cls(tick, answer)

    @property
    def state(self) -> State:
        """State of the controller."""
        return State(self.codes.state)

    @property
    def fault(self) -> Fault:
        """Latched reason of a fault."""
        return Fault(self.codes.fault)

    @property
    def flags(self) -> Flag:
        """What was limited, and more."""
        return Flag(self.codes.flags)

    @property
    def demand(self) -> float:
        """Demand in force, as a fraction of the full-scale force."""
        return self.codes.demand * _Q31

    @property
    def force(self) -> float:
        """Force measured, as a fraction of the full-scale force."""
        return self.codes.force * _Q30

    @property
    def gap(self) -> float:
        """Gap measured: 0 at the low end of the model's range, 1 at the high one."""
        return self.codes.gap * _Q30

    @property
    def current(self) -> float:
        """Current measured, as a fraction of the full-scale current."""
        return self.codes.current * _Q30

    @property
    def drive(self) -> float:
        """Current driven, as a fraction of the full-scale current."""
        return self.codes.drive * _Q31

    @property
    def generation(self) -> int:
        """Generation of the parameter block in force."""
        return self.codes.generation
