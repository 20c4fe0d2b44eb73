"""What an identification gives back."""

from __future__ import annotations

from dataclasses import dataclass

from anhyst.data import LoopSet
from anhyst.model.acceptance import Acceptance, GapCheck
from anhyst.model.actuator import ActuatorModel
from anhyst.support.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class IdentifyResult:
    """A model, and how it was found.

    Parameters
    ----------
    model : ActuatorModel
        Complete, with fit figures, uncertainty, reduction and provenance.
    loops : LoopSet
        What it was fitted to.
    fitted : tuple of ndarray
        Modelled output of each loop of ``loops``, SI, in the same order.
    acceptance : Acceptance
        Outcome of the acceptance test.
    warnings : tuple of str
        What a user should know before trusting the model.
    per_gap : ActuatorModel or None
        Of the paper's search: seven parameters free at each gap, before the reduction.
    splines : GapCheck or None
        The acceptance test over the gap with ordinary splines through the parameters of
        ``per_gap`` (the paper's Fig. 2); its ``failing`` are the gaps where it fails.
    seconds : float
        Wall time.
    evaluations : int
        Runs of all loops through the law.
    interrupted : bool
        The search was stopped before its end; the model is the best so far.
    """

    model: ActuatorModel
    loops: LoopSet
    fitted: tuple[FloatArray, ...]
    acceptance: Acceptance
    warnings: tuple[str, ...] = ()
    per_gap: ActuatorModel | None = None
    splines: GapCheck | None = None
    seconds: float = 0.0
    evaluations: int = 0
    interrupted: bool = False
