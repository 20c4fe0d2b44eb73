"""One identification under way: its settings, its progress, and what a killed one left behind.

What may be said about an identification: by ``anhyst identify`` and by every rig file alike.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, cast

import numpy as np
from pydantic import AfterValidator, Field

from anhyst.data.clean import STEPS
from anhyst.data.history import History
from anhyst.data.read_options import ReadOptions
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.response import ResponseForm
from anhyst.laws.cells import Shape
from anhyst.model.schema import LawName
from anhyst.support.atomic import atomic_writer
from anhyst.support.errors import InputError
from anhyst.support.progress import Progress
from anhyst.support.toml_file import Table
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


GapMap = Literal["scaling", "reluctance", "circuit", "free", "auto"]
Search = Literal["default", "paper"]
Weights = Literal["loops", "points", "relative"]


def _readable(name: str) -> AfterValidator:
    """Check a text that says how measurements are read, as :class:`ReadOptions` does."""

    def check(text: str) -> str:
        try:
            options = ReadOptions.from_text(**{name: text})
            if options.history is not None:
                History.parse(options.history)
        except InputError as error:
            raise InputError(str(error).removeprefix(f"{name}: "), code=error.code) from error
        for step in options.clean:
            if step not in STEPS:
                raise InputError(
                    f"'{step}' is not known; there are: {', '.join(STEPS)}",
                    code="unknown-cleaning-step",
                )
        return text

    return AfterValidator(check)


class IdentifyTable(Table):
    """``[identify]``: the options of ``anhyst identify``, by the same names and in the same form.

    What is left out is as on the command line, but for the gap map: whoever identifies says which.
    """

    law: LawName | Literal["auto"] = "auto"
    gap_map: GapMap | None = None
    search: Search = "default"
    seed: Annotated[int, Field(ge=0)] = 1
    weights: Weights = "loops"
    offsets: bool = True
    dead_band: bool = True
    rate: bool = True
    columns: Annotated[str, _readable("columns")] | None = None
    sidecar: str | None = None
    schedule: str | None = None
    loop: str | None = None
    constants: Annotated[str, _readable("constants")] | None = None
    history: Annotated[str, _readable("history")] | None = None
    clean: Annotated[str, _readable("clean")] | None = None

    def reading(self, folder: Path | None = None) -> ReadOptions:
        """Return how measurements are read."""
        sidecar = self.sidecar
        if sidecar is not None and folder is not None:
            sidecar = str(folder / sidecar)
        return ReadOptions.from_text(
            columns=self.columns,
            sidecar=sidecar,
            schedule=self.schedule,
            loop=self.loop,
            constants=self.constants,
            history=self.history,
            clean=self.clean,
        )

    def searching(self, gap_map: str = "auto") -> dict[str, Any]:
        """Return what :func:`anhyst.identification.identify` is to be asked for."""
        return {
            "law": self.law,
            "gap_map": self.gap_map or gap_map,
            "search": self.search,
            "seed": self.seed,
            "weights": self.weights,
            "offsets": self.offsets,
            "dead_band": self.dead_band,
            "rate": self.rate,
        }
