"""One identification under way: its settings, its progress, and what a killed one left behind."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from anhyst.identification.fit_records import FitRecords
from anhyst.identification.response import ResponseForm
from anhyst.laws.cells import Shape
from anhyst.support.atomic import atomic_writer
from anhyst.support.progress import Progress
from anhyst.support.version import running_version

if TYPE_CHECKING:
    from anhyst.identification.default import FoundModel


SEARCHED = 400
"""Samples of a loop that a search looks at, at most."""

Stage = TypeVar("Stage")


@dataclass
class SearchRun:
    """Settings of a search, and its stages.

    Parameters
    ----------
    form
        Equations of the measured quantities.
    records
        What is fitted.
    seed
        Of everything random.
    held
        Parameters that are zero and not fitted.
    cells
        Curves of play cells that are compared with the law of the form.
    only_cells
        Whether only they may be chosen.
    dead_band
        Whether the law is given the widest dead band that the loops allow.
    total
        Number of stages foreseen.
    progress
        Called with the number of stages done and the total.
    checkpoint
        File that keeps finished stages until the run ends well; None keeps nothing.
    resumed
        Number of stages taken from the checkpoint.
    best
        The best complete fit so far, for a run that is interrupted.
    """

    form: ResponseForm
    records: FitRecords
    seed: int
    held: frozenset[str]
    cells: tuple[Shape, ...] = ()
    only_cells: bool = False
    dead_band: bool = True
    total: int = 1
    progress: Progress | None = None
    checkpoint: Path | None = None
    resumed: int = 0
    best: FoundModel | None = None
    _key: str = ""
    _done: int = 0
    _kept: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.checkpoint is None:
            return
        self._key = _key(self)
        try:
            stored = json.loads(self.checkpoint.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return  # none there, or not one of ours: begin from the start
        if isinstance(stored, dict) and stored.get("key") == self._key:
            self._kept = dict(stored.get("stages", {}))

    @cached_property
    def searched(self) -> FitRecords:
        """What the search runs on: long loops thinned, since the exact step does not mind."""
        return self.records.thinned(SEARCHED)

    def stage(self, name: str, work: Callable[[], Stage]) -> Stage:
        """Do one stage, or take what an earlier, killed run has left of it.

        Parameters
        ----------
        name : str
            Distinguishes stages.
        work : callable
            Does the stage; what it returns must be lists, dicts, numbers and texts only, which a
            checkpoint gives back exactly.
        """
        if name in self._kept:
            self.resumed += 1
        else:
            self._kept[name] = work()
            if self.checkpoint is not None:
                with atomic_writer(self.checkpoint) as file:
                    json.dump({"key": self._key, "stages": self._kept}, file)
        return self.step(lambda: cast("Stage", self._kept[name]))

    def step(self, work: Callable[[], Stage]) -> Stage:
        """Do one stage of which nothing is kept, and report the progress."""
        made = work()
        self._done += 1
        if self.progress is not None:
            self.progress(self._done, max(self.total, self._done))
        return made

    def finish(self) -> None:
        """Remove the checkpoint: the run has ended well."""
        if self.checkpoint is not None:
            self.checkpoint.unlink(missing_ok=True)


def _key(run: SearchRun) -> str:
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(source.read_bytes())  # a search that was changed does not go on
    digest.update(f"{running_version()} {run.form} {run.seed} {sorted(run.held)}".encode())
    for record in run.records.loops:
        digest.update(f"{record.label} {record.gap} {record.settled} {record.weight!r}".encode())
        for values in (record.lead.drive, record.lead.place, record.input, record.output):
            digest.update(np.ascontiguousarray(values).tobytes())
    digest.update(run.records.nodes.tobytes())
    return digest.hexdigest()
