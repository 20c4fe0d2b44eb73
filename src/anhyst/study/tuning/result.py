"""What a tuning gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anhyst.compensate.interface import MethodName
from anhyst.control.controller_file import ControllerFile
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.distance import PlantCheck
from anhyst.rig.stage.file import StageRig
from anhyst.study.tuning.aims import TITLES, Aims, GainFigures, text_of
from anhyst.study.tuning.search import FoundGains
from anhyst.study.tuning.trial import Limit
from anhyst.support.result import Result, columns_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Tuned:
    """What tuning one variant gave."""

    variant: MethodName
    found: FoundGains  # the search
    limits: tuple[Limit, ...]  # what limits
    aims: Aims

    @property
    def figures(self) -> GainFigures:
        """What the gains reach, worst of all conditions."""
        return self.found.figures

    @property
    def misses(self) -> Mapping[str, float]:
        """Aims that are missed, by how much of their limit."""
        return self.aims.misses(self.figures)


@dataclass(frozen=True, repr=False)
class Tuning(Result):
    """What a tuning gave.

    Parameters
    ----------
    rig : BearingRig or StageRig
    controller : ControllerFile or None
        As it was; None of a stage.
    plant : PlantCheck or None
        What the loops say about the plant of a bearing.
    own : str
        The variant that the files name; of a stage ``full``.
    aims : Aims
    budget, seed : int
    tuned : mapping of str to Tuned
        By variant.
    written : mapping of str to Path
        Controller or rig file of every variant.
    interrupted : bool
        Whether ctrl-C ended it.
    seconds, cpu_seconds : float
        By the clock, and of all processes.
    """

    rig: BearingRig | StageRig
    controller: ControllerFile | None
    plant: PlantCheck | None
    own: MethodName
    aims: Aims
    budget: int
    seed: int
    tuned: Mapping[MethodName, Tuned]
    written: Mapping[MethodName, Path]
    interrupted: bool
    seconds: float
    cpu_seconds: float

    @property
    def first(self) -> Tuned:
        """What was tuned first; rig, conditions and figures are those of all."""
        return next(iter(self.tuned.values()))

    def facts(self) -> dict[str, str]:
        """Return what the gains of every variant reach, and the aims that they miss."""
        facts = {"rig": self.rig.settings.name, "found in": f"{self.seconds:.0f} s"}
        for name, one in self.tuned.items():
            reached = [text_of(title, value) for title, value in one.figures.named().items()]
            met = f"misses {', '.join(one.misses)}" if one.misses else "meets its aims"
            facts[name] = ", ".join([*reached, met])
        return facts

    def to_columns(self) -> dict[str, Any]:
        """Return what the gains of every variant reach, worst of all conditions."""
        return columns_of(
            [
                {"variant": name, **one.figures.named(), "met": not one.misses}
                for name, one in self.tuned.items()
            ]
        )

    def draw(self, ax: Axes) -> None:
        """Draw the peak of the sensitivity of every variant over what was made small."""
        for name, one in self.tuned.items():
            title = TITLES[one.figures.least]
            at = title.factor * one.figures.cost, one.figures.peak_sensitivity
            ax.plot(*at, "o", label=name)
            ax.set_xlabel(f"{title.title} [{title.unit}]")
        ax.set_ylabel("peak sensitivity")
