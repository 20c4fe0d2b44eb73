"""Settings, progress, checkpoint and result of one identification.

A :class:`SearchRun` performs the stages of a search and stores finished ones in a checkpoint file,
from which an interrupted run continues. :class:`IdentifyResult` is the result for users.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, cast

import numpy as np
from pydantic import AfterValidator, Field

from anhyst.data import Loops
from anhyst.data.clean import STEPS, ReadOptions
from anhyst.data.path import History
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.response import ResponseForm
from anhyst.laws.cells import Shape
from anhyst.model.acceptance import Acceptance, GapCheck
from anhyst.model.actuator import Model
from anhyst.model.schema import CandidateFit, CrossValidation, LawName, ReductionStep, Uncertainty
from anhyst.model.writer import write_model
from anhyst.support import running_version
from anhyst.support.atomic import PathLike, atomic_writer
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.result import Result, length_scale, thinning_slice
from anhyst.support.toml_file import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from anhyst.identification.default_search import FoundModel

MAX_SEARCH_SAMPLES = 400  # maximum number of samples per loop in a search

Stage = TypeVar("Stage")


@dataclass
class SearchRun:
    """Settings of a search, and its stages."""

    form: ResponseForm  # equations of the measured quantities
    records: FitRecords  # the loops, prepared for fitting
    seed: int  # seed of all random numbers
    fixed: frozenset[str]  # parameters fixed at zero
    shapes: tuple[Shape, ...] = ()  # curves of the play cells that are compared with the law
    needs_cells: bool = False  # whether only play cells may be selected
    dead_band: bool = True  # whether a dead band is fitted
    total_stages: int = 1  # expected number of stages
    progress: Progress | None = None  # gets the number of finished stages and the total
    # file that stores finished stages until the run ends without an error; None: no file
    checkpoint: Path | None = None
    resumed_stages: int = 0  # number of stages taken from the checkpoint
    # processor time of each kind of stage, s; shared by the runs of one identification
    cpu_times: dict[str, float] = field(default_factory=dict)
    best_fit: FoundModel | None = None  # best complete fit so far, for interrupted runs
    _key: str = ""
    _done_stages: int = 0
    _stored_stages: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.checkpoint is None:
            return
        self._key = _checkpoint_key(self)
        try:
            stored_content = json.loads(self.checkpoint.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return  # no checkpoint, or not a valid one: start from the beginning
        if isinstance(stored_content, dict) and stored_content.get("key") == self._key:
            self._stored_stages = dict(stored_content.get("stages", {}))

    @cached_property
    def search_records(self) -> FitRecords:
        """The records for the search, with long loops thinned (the exact step allows thinning)."""
        return self.records.thinned(MAX_SEARCH_SAMPLES)

    def run_stage(self, name: str, work: Callable[[], Stage]) -> Stage:
        """Return the result of a stage from the checkpoint, or perform and store the stage."""
        if name in self._stored_stages:
            self.resumed_stages += 1
        else:
            self._stored_stages[name] = work()
            if self.checkpoint is not None:
                with atomic_writer(self.checkpoint) as file:
                    json.dump({"key": self._key, "stages": self._stored_stages}, file)
        return self.run_step("search", lambda: cast("Stage", self._stored_stages[name]))

    def measure_time(self, kind: str, work: Callable[[], Stage]) -> Stage:
        """Perform one part of a stage, and add its processor time to the total of its kind."""
        start = time.process_time()
        result = work()
        self.cpu_times[kind] = self.cpu_times.get(kind, 0.0) + time.process_time() - start
        return result

    def run_step(self, kind: str, work: Callable[[], Stage]) -> Stage:
        """Perform a stage without storing its result, and report the progress."""
        result = self.measure_time(kind, work)
        self._done_stages += 1
        if self.progress is not None:
            self.progress(self._done_stages, max(self.total_stages, self._done_stages))
        return result

    def remove_checkpoint(self) -> None:
        """Remove the checkpoint after a complete run."""
        if self.checkpoint is not None:
            self.checkpoint.unlink(missing_ok=True)


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a search."""

    model: Model  # without records of its identification
    uncertainty: Uncertainty
    parameter_count: int  # number of fitted parameters
    evaluations: int
    map_reason: str  # reason for the gap map, or result of the reduction, as a sentence
    is_interrupted: bool = False  # whether the search was stopped before its end
    dead_band: str = "none"  # width of the dead band of the law, and the reason
    # cross-validation error of each map that has a solution at all withheld gaps, relative to the
    # largest output; empty below three gaps
    withheld_errors: dict[str, float] = field(default_factory=dict)
    # expected error of the selected model at new gaps; None below three gaps
    expected_error: CrossValidation | None = None
    candidates: tuple[CandidateFit, ...] = ()  # all compared candidates, if laws were compared
    law_reason: str = ""  # reason for the law; empty if laws were not compared
    # largest difference of laws that follow the only loop equally well, relative to the largest
    # output
    ambiguity: float = 0.0
    steps: tuple[ReductionStep, ...] = ()  # steps of the reduction in the paper's search
    # model of the paper's search with all parameters free at each gap, without records
    per_gap: Model | None = None
    resumed_stages: int = 0  # number of stages taken from a checkpoint
    rate_reason: str = ""  # reason for the rate dependence of solid iron
    fit: FoundModel | None = None  # the same fit in gauge-free coordinates


def _checkpoint_key(run: SearchRun) -> str:
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(source.read_bytes())  # a changed search does not continue an old checkpoint
    digest.update(f"{running_version()} {run.form} {run.seed} {sorted(run.fixed)}".encode())
    for record in run.records.loops:
        digest.update(f"{record.label} {record.gap} {record.is_cycle} {record.weight!r}".encode())
        for values in (record.history.inputs, record.history.gap_position, record.input, record.output):
            digest.update(np.ascontiguousarray(values).tobytes())
    digest.update(run.records.nodes.tobytes())
    return digest.hexdigest()


GapMap = Literal["scaling", "reluctance", "circuit", "free", "auto"]
Search = Literal["default", "paper"]
Weights = Literal["loops", "points", "relative"]


def _read_option_validator(name: str) -> AfterValidator:
    """Return a validator for a text option that describes how measurements are read."""

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
                    f"'{step}' is unknown; use one of {', '.join(STEPS)}", code="unknown-cleaning-step"
                )
        return text

    return AfterValidator(check)


SEARCH_OPTIONS = ("law", "gap_map", "search", "seed", "weights", "offsets", "dead_band", "rate")
"""Options of the search; all other options describe how loops are read."""


class IdentifyTable(Table):
    """``[identify]``: the options of ``anhyst identify``, with the same names and values.

    Missing options have the defaults of the command line, except the gap map, which the caller
    provides.
    """

    law: LawName | Literal["auto"] = "auto"
    gap_map: GapMap | None = None
    search: Search = "default"
    seed: Annotated[int, Field(ge=0)] = 1
    weights: Weights = "loops"
    offsets: bool = True
    dead_band: bool = True
    rate: bool = True
    columns: Annotated[str, _read_option_validator("columns")] | None = None
    sidecar: str | None = None
    schedule: str | None = None
    loop: str | None = None
    constants: Annotated[str, _read_option_validator("constants")] | None = None
    history: Annotated[str, _read_option_validator("history")] | None = None
    clean: Annotated[str, _read_option_validator("clean")] | None = None
    scale: Annotated[str, _read_option_validator("scale")] | None = None
    flip: Annotated[str, _read_option_validator("flip")] | None = None
    drop: Literal["invalid"] | None = None

    def read_options(self, folder: Path | None = None) -> ReadOptions:
        """Return the options for reading measurements."""
        texts = {option.name: getattr(self, option.name) for option in fields(ReadOptions)}
        if self.sidecar is not None and folder is not None:
            texts["sidecar"] = str(folder / self.sidecar)
        return ReadOptions.from_text(**texts)

    def search_options(self, gap_map: str = "auto") -> dict[str, Any]:
        """Return the keyword arguments for :func:`anhyst.identification.identify`."""
        options = {name: getattr(self, name) for name in SEARCH_OPTIONS}
        return options | {"gap_map": self.gap_map or gap_map}


@dataclass(frozen=True, eq=False, repr=False)
class IdentifyResult(Result):
    """A model, and the results of its identification.

    Parameters
    ----------
    model : Model
        Complete, with fit figures, uncertainty, reduction and provenance.
    loops : Loops
        The fitted loops.
    fitted : tuple of ndarray
        Modelled output of each loop of ``loops``, SI, in the same order.
    acceptance : Acceptance
        Result of the acceptance test.
    warnings : tuple of str
        Limitations that a user should know before using the model.
    per_gap : Model or None
        Paper's search only: seven parameters free at each gap, before the reduction.
    splines : GapCheck or None
        Acceptance test over the gap with ordinary splines through the parameters of ``per_gap`` (the
        paper's Fig. 2); ``failing`` contains the gaps where it fails.
    seconds : float
        Wall time, s.
    stages : mapping of str to float
        Processor time of each kind of stage, s.
    evaluations : int
        Number of simulations of all loops.
    rejection : str
        Reason why the model must not be used; empty if it is usable.
    interrupted : bool
        Whether the search was stopped before its end; the model is the best so far.
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
    rejection: str = ""

    def facts(self) -> dict[str, str]:
        """Return the model, its accuracy, and the warnings."""
        return {
            **self.model.facts(),
            "found in": f"{self.seconds:.1f} s",
            "processor time": ", ".join(f"{kind} {s:.1f} s" for kind, s in self.stages.items()),
            **({"rejected": self.rejection} if self.rejection else {}),
            **{f"warning {number}": text for number, text in enumerate(self.warnings, 1)},
        }

    def to_columns(self) -> dict[str, Any]:
        """Return all samples of the loops, measured and modelled."""
        output = self.loops.output
        fitted_output = np.concatenate(self.fitted)
        measured_output = np.concatenate([loop.output for loop in self.loops.loops])
        return {
            **self.loops.to_columns(),
            f"{output.column}_fitted": fitted_output,
            f"{output.column}_residual": measured_output - fitted_output,
        }

    def draw(self, ax: Axes) -> None:
        """Draw the measured loops, and the modelled ones dashed."""
        self.loops.draw(ax)
        scale, _ = length_scale(self.loops.output)
        for loop, fitted_output in zip(self.loops.loops, self.fitted, strict=True):
            samples = thinning_slice(loop.n)
            ax.plot(loop.input[samples], scale * fitted_output[samples], color="0.15", lw=0.8, ls="--")
        ax.plot([], [], color="0.15", lw=0.8, ls="--", label="model")

    def save(self, path: PathLike) -> Path:
        """Write the model file.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        write_model(self.model, path)
        return Path(path)


def require_complete(result: IdentifyResult) -> IdentifyResult:
    """Return the result of a complete search; raise KeyboardInterrupt if it was interrupted."""
    if result.interrupted:
        raise KeyboardInterrupt
    return result
