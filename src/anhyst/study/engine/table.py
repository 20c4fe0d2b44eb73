"""The table of a study: what methods gave in its cases, each figure a mean over the seeds.

A figure is a column by its key; how it is called and shown is a :class:`Metric`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from anhyst.rig.recording import Recording
from anhyst.study.engine.verdict import Interval, Judgement, mean_interval, no_mean
from anhyst.support.atomic import PathLike, write_json
from anhyst.support.kinds import MethodName
from anhyst.support.result import Result

FIGURES = "figures.json"
"""What is written beside a recording."""


@dataclass(frozen=True)
class Metric:
    """A figure that methods are judged by; the smaller, the better."""

    key: str  # in files, with its unit
    title: str  # in words
    unit: str  # as it is shown
    factor: float = 1.0  # from SI to that

    @property
    def head(self) -> str:
        """Of a table: title and unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


@dataclass(frozen=True)
class CaseFigures:
    """What one method gave in one case."""

    # by key; both directions of a step count as one value. Empty if the loop was lost in any run.
    figures: Mapping[str, Interval]
    lost: int  # runs in which the loop was lost, and all runs
    runs: int

    @classmethod
    def over(cls, runs: Sequence[Mapping[str, float] | None], **where: Any) -> Self:
        """Sum up runs, one a seed; None stands for one in which the loop was lost."""
        held = [run for run in runs if run is not None]
        names = held[0] if len(held) == len(runs) else ()
        figures = {name: mean_interval([run[name] for run in held]) for name in names}
        return cls(figures=figures, lost=len(runs) - len(held), runs=len(runs), **where)

    def of(self, key: str) -> Interval:
        """Return a figure; one without a mean if the loop was lost in any run."""
        return self.figures.get(key) or no_mean(self.lost, self.runs)

    def as_dict(self) -> dict[str, Any]:
        """Return it as files hold it."""
        figures = {name: interval.as_dict() for name, interval in self.figures.items()}
        return {"lost": self.lost, "runs": self.runs, **figures}


def keep_lost(recording: Recording, out: PathLike) -> None:
    """Keep the recording of a loop that was lost, and no figures of another one beside it."""
    recording.save(out)
    (Path(out).parent / FIGURES).unlink(missing_ok=True)


Cases = Mapping[str, Mapping[MethodName, CaseFigures]]
"""The table: a row a case, by its name, with what each method gave in it."""


class StudyResult(Result):
    """What a study gives: its figures, a verdict, and in what the loop was lost."""

    __slots__ = ()

    @property
    @abstractmethod
    def lost_in(self) -> list[str]:
        """Everything tried in which the loop was lost."""

    @abstractmethod
    def refuse_losses(self) -> None:
        """Raise NegativeResult where the loop was lost."""

    @property
    @abstractmethod
    def verdict(self) -> Judgement:
        """Whether compensation is worth it."""

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """Return what ``figures.json`` holds."""

    def losses_fact(self) -> dict[str, str]:
        """Return what is said of losses where facts are."""
        return {"lost in": "; ".join(self.lost_in)} if self.lost_in else {}

    def write_figures(self, path: PathLike) -> None:
        """Write the figures."""
        write_json(path, self.as_dict())
