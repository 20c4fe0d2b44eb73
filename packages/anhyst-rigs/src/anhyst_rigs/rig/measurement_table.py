"""Define ``[loops]``, ``[measurement]`` and ``[excite]`` of a rig file, and read its loops.

The module also identifies models from these loops, and measures how well minor loops close.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from anhyst.data import Loops
from anhyst.data.input_files import list_input_files
from anhyst.data.output_map import is_actuator
from anhyst.data.verdict import largest_output
from anhyst.identification import identify
from anhyst.identification.flux_force import ForceCalibration, derive_force, find_no_force_reason
from anhyst.identification.identify import check_options
from anhyst.identification.run import IdentifyTable, require_complete
from anhyst.laws import LAWS
from anhyst.model.actuator import Model
from anhyst.support.cache import cached_result
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.toml_file import FileFault, Name, NotNegative, Positive, Table, faults_error
from anhyst.support.units import QUANTITIES
from anhyst_rigs.rig.minor_loops import find_loop_closings

# ruff: noqa: N815 - keys of the file carry units


RelativeCurrent = Annotated[float, Field(ge=-1.0, le=1.0)]
"""Current relative to the largest current. Only bidirectional magnets can have negative values."""


def _check_file_list(value: Any) -> Any:
    if isinstance(value, str):
        return [value]
    if isinstance(value, list) and value and all(isinstance(entry, str) for entry in value):
        return value
    raise InputError("must be a file, a folder, or a list of them", code="wrong-kind")


class LoopsTable(IdentifyTable):
    """``[loops]``: files with measured loops, and options for reading and identification."""

    files: Annotated[list[str], BeforeValidator(_check_file_list), Field(min_length=1)]


class RecordTable(Table):
    """An entry of ``measurement.records``: linear sweeps from one reversal point to the next."""

    name: Name
    turns: Annotated[list[RelativeCurrent], Field(min_length=2)]


class MeasurementTable(Table):
    """``[measurement]``: how loops are measured while the armature is held."""

    gaps_m: Annotated[list[Positive], Field(min_length=1)]
    current_max_A: Positive
    sweep_A_per_s: Positive
    sample_s: Positive
    conditioning_cycles: Annotated[int, Field(ge=1, le=20)]
    pause_s: NotNegative = 0.0
    records: Annotated[list[RecordTable], Field(min_length=1)]


MIN_CYCLE_S = 1e-5
MAX_CYCLE_S = 600.0
"""Limits of the duration of a full cycle at a fast rate, s."""


class CampaignTable(MeasurementTable):
    """``[measurement]`` of a rig file, with optional full cycles at faster rates."""

    fast_A_per_s: list[Positive] = Field(default_factory=list)

    @model_validator(mode="after")
    def _check_fast_speeds(self) -> Self:
        for speed in self.fast_A_per_s:
            seconds = 2.0 * self.current_max_A / speed
            if not MIN_CYCLE_S <= seconds <= MAX_CYCLE_S:
                raise InputError(
                    f"fast_A_per_s: a full cycle at {speed:g} A/s takes {seconds:.3g} s; "
                    f"{MIN_CYCLE_S:g} to {MAX_CYCLE_S:g} s are possible",
                    code="speed-out-of-range",
                )
        if len({f"{speed:.4g}" for speed in self.fast_A_per_s}) < len(self.fast_A_per_s):
            raise InputError("fast_A_per_s: a speed occurs twice; give each once", code="name-twice")
        return self


class ExciteTable(Table):
    """``[excite]``: gaps, and limits of the drive with which loops are measured."""

    gaps_m: Annotated[list[Positive], Field(min_length=1)] | None = None
    operating_N: Positive | None = None
    current_max_A: Positive | None = None
    rate_max_A_per_s: Positive | None = None
    force_max_N: Positive | None = None
    continuous_A: Positive | None = None
    thermal_s: Positive | None = None
    rise_K: NotNegative = 80.0  # temperature rise at continuous_A
    current_low_A: Annotated[float, Field(le=0.0)] | None = None  # lowest current of the source

    @model_validator(mode="after")
    def _check_thermal_keys(self) -> Self:
        if (self.continuous_A is None) != (self.thermal_s is None):
            text = "continuous_A and thermal_s belong together; give both or none"
            raise InputError(text, code="belong-together")
        return self


_FILES_KEY = ("loops", "files")


@dataclass(frozen=True, slots=True)
class MeasuredLoops:
    """The measured loops that a rig file names."""

    rig: Path  # path of the rig file
    options: LoopsTable  # options from the rig file
    output: str = "force"  # output quantity of the magnets

    @property
    def paths(self) -> tuple[Path, ...]:
        """Files and folders with loops."""
        return tuple(self.rig.parent / name for name in self.options.files)

    @property
    def description(self) -> str:
        """The first path, and the number of further paths, for messages."""
        further_text = f" and {len(self.paths) - 1} more" if len(self.paths) > 1 else ""
        return f"{self.paths[0]}{further_text}"

    @property
    def files(self) -> list[Path]:
        """All files that are read: tables in the folders, and their sidecar files."""
        for number, path in enumerate(self.paths):
            if not path.exists():
                key = (*_FILES_KEY, number) if len(self.paths) > 1 else _FILES_KEY
                text = f"{path}: no such file or folder; check the path"
                raise faults_error(self.rig, [FileFault(key, text, code="no-such-file")])
        try:
            return list_input_files(self.paths, self.options.read_options(self.rig.parent).sidecar)
        except InputError as error:
            raise faults_error(self.rig, [FileFault(_FILES_KEY, str(error), code=error.code)]) from error

    def read(self) -> Loops:
        """Read the loops and clean their data; derive the force from loops of flux linkage."""
        if not self.files:
            raise InputError(f"{self.description}: no loops", code="no-loops")
        loops = self.options.read_options(self.rig.parent).read(self.paths)
        if self.output == "force" and loops.output.name == "flux_linkage":
            loops = self._derive_force(loops)
        if not is_actuator(loops) or loops.schedule is None or loops.output.name != self.output:
            column = f"{QUANTITIES[self.output].symbol}_N"
            text = f"{self.description}: this rig needs columns I_A, {column} and gap_m"
            raise InputError(text, code="columns-missing")
        return loops

    def _derive_force(self, loops: Loops) -> Loops:
        """Return the loops of force that follow from loops of flux linkage."""
        if reason := find_no_force_reason(loops):
            raise InputError(f"{self.description}: {reason}", code="force-not-derived")

        def derive() -> Loops:
            return derive_force(loops, ForceCalibration(), self.options.seed).loops

        return cached_result("forces", derive, loops, self.options.seed)


def identify_faults(options: IdentifyTable) -> list[FileFault]:
    """Find identification options that a rig file must not contain."""
    if options.gap_map == "free":
        text = "'free' is valid only at the measured gaps, but the armature moves; choose another"
        return [FileFault(("loops", "gap_map"), text, code="choice-not-for-this")]
    try:
        check_options(options.law, options.gap_map or "circuit", options.search)
    except InputError as error:
        return [FileFault(("loops",), str(error), code=error.code)]
    return []


def identify_loops(
    loops: Loops, options: IdentifyTable, gap_map: str, progress: Progress | None = None
) -> Model:
    """Identify a model with the options of a rig file; the result is cached."""
    settings = options.search_options(gap_map)

    def search() -> Model:
        return require_complete(identify(loops, **settings, progress=progress)).model

    # The cache key does not cover the source code of plug-in laws.
    return search() if LAWS.plugins else cached_result("models", search, loops, settings)


_MIN_RELATIVE_ERROR = 2e-4
"""Smallest standard error that is assumed for a misclosure, relative to the largest output."""


def squared_misclosures(loops: Loops, models: Sequence[Model]) -> FloatArray:
    """Return the squared misclosure errors, in units of their variance: closings by models.

    A value near 1 can be noise. The first model must follow the loops.
    """
    squared_errors: list[list[float]] = []
    min_error = _MIN_RELATIVE_ERROR * largest_output(loops)
    for loop in loops.loops:
        inputs = loop.input, loop.schedule, loop.time, loop.history
        runs = [model.predict(*inputs).output for model in models]
        for loop_closing in find_loop_closings(loop):
            if (measured_step := loop_closing.measure_output_step(loop, runs[0])) is None:
                continue
            step, sigma = measured_step
            errors = [(step - loop_closing.output_step(loop, run)) / max(sigma, min_error) for run in runs]
            squared_errors.append([error**2 for error in errors])
    return np.array(squared_errors).reshape(-1, len(models))
