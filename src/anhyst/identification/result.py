"""What an identification gives back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from anhyst.data import Loops
from anhyst.data.look import few, length_scale
from anhyst.model.acceptance import Acceptance, GapCheck
from anhyst.model.actuator import Model
from anhyst.model.writer import write_model
from anhyst.support.atomic import PathLike
from anhyst.support.numeric import FloatArray
from anhyst.support.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class IdentifyResult(Result):
    """A model, and how it was found.

    Parameters
    ----------
    model : Model
        Complete, with fit figures, uncertainty, reduction and provenance.
    loops : Loops
        What it was fitted to.
    fitted : tuple of ndarray
        Modelled output of each loop of ``loops``, SI, in the same order.
    acceptance : Acceptance
        Outcome of the acceptance test.
    warnings : tuple of str
        What a user should know before trusting the model.
    per_gap : Model or None
        Of the paper's search: seven parameters free at each gap, before the reduction.
    splines : GapCheck or None
        The acceptance test over the gap with ordinary splines through the parameters of
        ``per_gap`` (the paper's Fig. 2); its ``failing`` are the gaps where it fails.
    seconds : float
        Wall time.
    stages : mapping of str to float
        Processor time of each kind of stage, s.
    evaluations : int
        Runs of all loops through the law.
    interrupted : bool
        The search was stopped before its end; the model is the best so far.
    """

    model: Model
    loops: Loops
    fitted: tuple[FloatArray, ...]
    acceptance: Acceptance
    warnings: tuple[str, ...] = ()
    per_gap: Model | None = None
    splines: GapCheck | None = None
    seconds: float = 0.0
    stages: Mapping[str, float] = field(default_factory=dict)
    evaluations: int = 0
    interrupted: bool = False

    def facts(self) -> dict[str, str]:
        """Return what was found, how well it fits, and what to know before trusting it."""
        return {
            **self.model.facts(),
            "found in": f"{self.seconds:.1f} s",
            "processor time": ", ".join(f"{kind} {s:.1f} s" for kind, s in self.stages.items()),
            **{f"warning {number}": text for number, text in enumerate(self.warnings, 1)},
        }

    def to_columns(self) -> dict[str, Any]:
        """Return all samples of the loops, with what the model gives beside what was measured."""
        output = self.loops.output
        fitted = np.concatenate(self.fitted)
        measured = np.concatenate([loop.output for loop in self.loops.loops])
        return {
            **self.loops.to_columns(),
            f"{output.column}_fitted": fitted,
            f"{output.column}_residual": measured - fitted,
        }

    def draw(self, ax: Axes) -> None:
        """Draw the measured loops, and what the model gives for them dashed."""
        self.loops.draw(ax)
        scale, _ = length_scale(self.loops.output)
        for loop, fitted in zip(self.loops.loops, self.fitted, strict=True):
            every = few(loop.n)
            ax.plot(loop.input[every], scale * fitted[every], color="0.15", lw=0.8, ls="--")
        ax.plot([], [], color="0.15", lw=0.8, ls="--", label="model")

    def save(self, path: PathLike) -> Path:
        """Write the model file.

        Raises
        ------
        InputError
            The place cannot be written.
        """
        write_model(self.model, path)
        return Path(path)


def whole_search(result: IdentifyResult) -> IdentifyResult:
    """Return what a search found if it came to its end; after ctrl-C, whoever goes on ends too."""
    if result.interrupted:
        raise KeyboardInterrupt
    return result
