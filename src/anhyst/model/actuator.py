"""A model in use: whole records, sample by sample, and the acceptance test."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from anhyst.data.history import History
from anhyst.model.acceptance import Acceptance, GapCheck, check_acceptance, check_over_gap
from anhyst.model.predict import Prediction, invert, predict
from anhyst.model.record import ActuatorRecord
from anhyst.model.stepper import Stepper


@dataclass(frozen=True)
class ActuatorModel(ActuatorRecord):
    """A record of an actuator, and what can be done with it.

    Examples
    --------
    >>> from anhyst.support.units import QUANTITIES
    >>> iron = dict(M_s=4e5, a=30.0, k=20.0, c=0.2, c_H=1.0, c_out=1.0)
    >>> model = ActuatorModel("core", QUANTITIES["field"], QUANTITIES["flux_density"], iron)
    >>> model.predict([0.0, 100.0, 0.0]).output.round(3)
    array([0.   , 0.32 , 0.079])
    """

    def predict(
        self,
        drive: ArrayLike,
        schedule: ArrayLike | None = None,
        time: ArrayLike | None = None,
        history: History | str | None = None,
    ) -> Prediction:
        """Compute the output that a drive gives; see :func:`anhyst.model.predict.predict`."""
        return predict(self, drive, schedule, time, history)

    def invert(
        self,
        demand: ArrayLike,
        schedule: ArrayLike | None = None,
        time: ArrayLike | None = None,
        history: History | str | None = None,
    ) -> Prediction:
        """Compute the drive that a demanded output needs; see :func:`anhyst.model.predict.invert`."""
        return invert(self, demand, schedule, time, history)

    def stepper(
        self, schedule: float | None = None, history: History | str | None = None
    ) -> Stepper:
        """Start the model for use sample by sample; see :class:`anhyst.model.stepper.Stepper`."""
        from anhyst.model.stepper import Stepper

        return Stepper(self, schedule, history)

    def check_over_gap(self) -> GapCheck | None:
        """Run the acceptance test over the gap; see :func:`anhyst.model.acceptance.check_over_gap`."""
        return check_over_gap(self)

    def acceptance(self) -> Acceptance:
        """Run the whole acceptance test; see :func:`anhyst.model.acceptance.check_acceptance`."""
        return check_acceptance(self)

    def is_monotone_over_gap(self) -> bool:
        """Whether the output rises at any fixed drive as the gap closes.

        The acceptance test of the paper (II.C) over a dense grid of gaps and both branches. True
        also where it does not apply: no gap, or a single one.
        """
        check = self.check_over_gap()
        return check is None or check.passed
