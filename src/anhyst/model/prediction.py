"""What a model computed over a record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from anhyst.data.history import History
from anhyst.data.look import few, length_scale
from anhyst.model.valid_range import BoolArray
from anhyst.support.arrays import FloatArray
from anhyst.support.result import Result, range_text
from anhyst.support.units import Quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Result):
    """What a model computed over a record; all arrays of shape (n,).

    Parameters
    ----------
    drive : ndarray
        Input of the actuator, in units of the input.
    output : ndarray
        Output of the actuator, in units of the output. After ``invert``, what the drive really
        gives: the demand, except where the demand has no answer.
    flux_density : ndarray
        T.
    field : ndarray
        Field in the iron, A/m.
    valid : ndarray of bool
        Whether the sample lies inside the valid range of the model.
    state : ndarray, shape (s,)
        State of the iron after the last sample (``x/a``, ``M_irr/M_s``, play ``/a``).
    cycles : int
        Repetitions it took to settle; 0 for another history.
    history : History
        What was assumed to have happened before.
    reachable : ndarray of bool
        Whether the demand has an answer at all; all True after ``predict``.
    flags, notes : tuple of str
        Sentences about samples outside the valid range, and about what was assumed.
    quantities : tuple of Quantity
        What `drive` and `output` are.
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

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader has to know, one sentence each."""
        return self.flags + self.notes

    def facts(self) -> dict[str, str]:
        """Return ranges, what was assumed before, and what is outside the valid range."""
        drive, answer = self.quantities
        return {
            "samples": str(self.drive.size),
            drive.name: range_text(self.drive.min(), self.drive.max(), drive.unit),
            answer.name: range_text(self.output.min(), self.output.max(), answer.unit),
            "history": str(self.history),
            "outside the valid range": f"{int((~self.valid).sum())} samples",
        }

    def to_columns(self) -> dict[str, Any]:
        """Return the samples, SI."""
        drive, answer = self.quantities
        return {
            drive.column: self.drive,
            answer.column: self.output,
            "iron_B_T": self.flux_density,
            "iron_H_A_per_m": self.field,
            "valid": self.valid,
            "reachable": self.reachable,
        }

    def draw(self, ax: Axes) -> None:
        """Draw output over drive."""
        drive, answer = self.quantities
        scale, label = length_scale(answer)
        every = few(self.drive.size)
        ax.plot(self.drive[every], scale * self.output[every], lw=1.1)
        ax.set_xlabel(drive.label)
        ax.set_ylabel(label)
