"""One identification under way: its settings, its progress, and what a killed one left behind."""

from __future__ import annotations

import hashlib
import json
import time
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
    """Settings of a search, and its stages."""

    form: ResponseForm  # equations of the measured quantities
    records: FitRecords  # what is fitted
    seed: int  # of everything random
    held: frozenset[str]  # parameters that are zero and not fitted
    cells: tuple[Shape, ...] = ()  # curves of play cells that are compared with the law of the form
    only_cells: bool = False  # whether only they may be chosen
    dead_band: bool = True  # whether the law is given the widest dead band that the loops allow
    total: int = 1  # number of stages foreseen
    progress: Progress | None = None  # called with the number of stages done and the total
    # file that keeps finished stages until the run ends well; None keeps nothing
    checkpoint: Path | None = None
    resumed: int = 0  # number of stages taken from the checkpoint
    # processor time of each kind of stage, s; runs of one identification share it
    spent: dict[str, float] = field(default_factory=dict)
    best: FoundModel | None = None  # the best complete fit so far, for a run that is interrupted
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
        """Do one stage, or take what an earlier, killed run has left of it."""
        if name in self._kept:
            self.resumed += 1
        else:
            self._kept[name] = work()
            if self.checkpoint is not None:
                with atomic_writer(self.checkpoint) as file:
                    json.dump({"key": self._key, "stages": self._kept}, file)
        return self.step("search", lambda: cast("Stage", self._kept[name]))

    def timed(self, kind: str, work: Callable[[], Stage]) -> Stage:
        """Do a part of a stage of some kind."""
        began = time.process_time()
        made = work()
        self.spent[kind] = self.spent.get(kind, 0.0) + time.process_time() - began
        return made

    def step(self, kind: str, work: Callable[[], Stage]) -> Stage:
        """Do one stage of which nothing is kept, and report the progress."""
        made = self.timed(kind, work)
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
