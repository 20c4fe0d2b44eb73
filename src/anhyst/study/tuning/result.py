"""What a tuning gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anhyst.compensate.interface import MethodName
from anhyst.control.controller_file import ControllerFile
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.distance import PlantCheck
from anhyst.study.tuning.aims import Aims, Figures
from anhyst.study.tuning.limits import Limit
from anhyst.study.tuning.search import FoundGains
from anhyst.study.tuning.trial import Condition
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
    def figures(self) -> Figures:
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
    rig : BearingRig
    controller : ControllerFile
        As it was.
    plant : PlantCheck
        What the loops say about the plant.
    aims : Aims
    conditions : tuple of Condition
    budget, seed : int
    tuned : mapping of str to Tuned
        By variant.
    written : mapping of str to Path
        Controller file of every variant.
    interrupted : bool
        Whether ctrl-C ended it.
    seconds, cpu_seconds : float
        By the clock, and of all processes.
    """

    rig: BearingRig
    controller: ControllerFile
    plant: PlantCheck
    aims: Aims
    conditions: tuple[Condition, ...]
    budget: int
    seed: int
    tuned: Mapping[MethodName, Tuned]
    written: Mapping[MethodName, Path]
    interrupted: bool
    seconds: float
    cpu_seconds: float

    def facts(self) -> dict[str, str]:
        """Return what the gains of every variant reach, and the aims that they miss."""
        told = {"rig": self.rig.settings.name, "found in": f"{self.seconds:.0f} s"}
        for name, one in self.tuned.items():
            told[name] = (
                f"overshoot {one.figures.overshoot_percent:.2f} %, settling "
                f"{1e3 * one.figures.settling_time_s:.2f} ms, "
                + (f"misses {', '.join(one.misses)}" if one.misses else "meets its aims")
            )
        return told

    def to_columns(self) -> dict[str, Any]:
        """Return what the gains of every variant reach, worst of all conditions."""
        return columns_of(
            [
                {"variant": name, **asdict(one.figures), "met": not one.misses}
                for name, one in self.tuned.items()
            ]
        )

    def draw(self, ax: Axes) -> None:
        """Draw overshoot over settling time of every variant."""
        for name, one in self.tuned.items():
            at = 1e3 * one.figures.settling_time_s, one.figures.overshoot_percent
            ax.plot(*at, "o", label=name)
        ax.set_xlabel("settling time [ms]")
        ax.set_ylabel("overshoot [%]")
