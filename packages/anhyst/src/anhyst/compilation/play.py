"""A map with one play as C, for whom the compensator is too dear, and what it leaves of a force."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from anhyst._core import FixedForceController
from anhyst.compensate.block import DemandLimits
from anhyst.compensate.current_map import PlayMap, one_play
from anhyst.compensate.force_controller import Compensator, ForceController
from anhyst.compensate.plan import CompileRequest
from anhyst.compensate.play_block import Words
from anhyst.compensate.sources import Operating, Sources, drive_ramps, model_loops, operating_of
from anhyst.compilation.manifest import (
    MANIFEST,
    VERSION,
    CompiledFolder,
    check_folder,
    signal_entries,
    write_folder,
)
from anhyst.compilation.packages import check_package, package_files
from anhyst.compilation.play_source import play_source
from anhyst.compilation.source import PORT, in_comment, render
from anhyst.compilation.toolchain import SRC, core_files, read_core
from anhyst.compilation.vectors import COLUMNS, SEED, Row, codes_of_inputs, vectors_csv
from anhyst.model.actuator import Model, read_model
from anhyst.model.predict import slow_times
from anhyst.support import running_version
from anhyst.support.atomic import PathLike
from anhyst.support.block_layout import PLACES
from anhyst.support.errors import InputError
from anhyst.support.kept import c_name
from anhyst.support.numeric import FloatArray, q31, rms
from anhyst.support.result import columns_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CYCLE_RAMP = 200
"""Samples of a ramp over the whole range of demands."""

LEVELS = (0.25, 0.5, 0.75)
"""Middles of the small cycles, of the largest force."""

SMALL = 0.1
"""Small cycles from peak to peak, of the largest force."""

ROUNDS = 4
"""Small cycles at a level; the last one counts."""

Answer = Callable[[FloatArray, float], FloatArray]
"""From currents in their order, of an iron without memory at first, and the gap to forces."""


@dataclass(frozen=True)
class CycleErrors:
    """Force less demand, N."""

    major: FloatArray  # from zero to the largest force and back, after two such cycles
    small: FloatArray  # over small cycles about levels that were come to from above and from below

    def joined(self, other: CycleErrors) -> CycleErrors:
        """Return both."""
        return CycleErrors(
            np.concatenate([self.major, other.major]), np.concatenate([self.small, other.small])
        )


def worst(error: FloatArray) -> float:
    """Return the largest magnitude."""
    return float(np.abs(error).max())


def cycle_errors(
    compensator: Compensator, answer: Answer, gap: float, largest: float
) -> CycleErrors:
    """Run a compensator over a path of demands at one gap; the currents are those it solves for."""
    turns, counts = [0.0, 1.0, 0.0, 1.0, 0.0], []
    begin = len(turns) - 1
    turns += [1.0, 0.0]
    counts += [(begin, "major"), (begin + 1, "major")]
    for level in LEVELS:
        for end in (1.0, 0.0):
            turns.append(end)
            for _ in range(ROUNDS):
                ends = (level - 0.5 * SMALL, level + 0.5 * SMALL)
                turns += ends if end > 0.5 else ends[::-1]
            counts += [(len(turns) - 3, "small"), (len(turns) - 2, "small")]
    ramps = drive_ramps(turns, CYCLE_RAMP)
    demand = largest * np.concatenate(ramps)
    error = answer(compensator.run(demand, gap), gap) - demand
    pieces = np.split(error, np.cumsum([ramp.size for ramp in ramps])[:-1])
    errors = {
        kind: np.concatenate([pieces[index] for index, of in counts if of == kind])
        for kind in ("major", "small")
    }
    return CycleErrors(errors["major"], errors["small"])


KIND: Literal["play"] = "play"
SOURCES = ("compensator/play_map.c",)
STATE_BYTES = 20 + 7 * 4 + 5 * 4 + 8
"""Of ``anhyst_play_map_q31`` where a pointer has 32 bits."""


@dataclass(frozen=True, repr=False)
class CompiledPlay(CompiledFolder):
    """What came out.

    Parameters
    ----------
    out : Path
        The folder.
    manifest : dict
        What stands in ``manifest.json``, without the hashes of the files.
    files : tuple of str
        Names of the files.
    play : PlayMap
        What was fitted.
    errors : mapping of str to CycleErrors
        Of the model's force: of this map, and of the best current without memory.
    """

    play: PlayMap
    errors: Mapping[str, CycleErrors]

    def facts(self) -> dict[str, str]:
        """Return where it is, and how far its force is from the model's."""
        accuracy = self.manifest["accuracy"]["play"]
        errors = {name.replace("_", " "): f"{value:.2g} %" for name, value in accuracy.items()}
        return {"folder": str(self.out), "kind": "play", **errors}

    def to_columns(self) -> dict[str, Any]:
        """Return the errors of this map and of the best without memory, per cent."""
        rows = ((name, self.manifest["accuracy"][name]) for name in self.errors)
        return columns_of([{"map": name, **found} for name, found in rows])

    def draw(self, ax: Axes) -> None:
        """Draw the error of the force over the loop, of this map and of that without memory."""
        for name, errors in self.errors.items():
            ax.plot(errors.major, lw=1.0, label=name)
        ax.set_xlabel("sample of the loop")
        ax.set_ylabel("force less demand [N]")


def compile_play(
    model_path: PathLike,
    out: PathLike,
    rate: float,
    io: str,
    name: str | None,
    package: str | None = None,
) -> CompiledPlay:
    """Compile a map with one play into a folder of C."""
    check_package(package)
    if io != "q31":
        text = f"--io: {io} is not for --kind play, whose signals have 32 bits; give q31"
        raise InputError(text, code="option-not-for-this", key="--io")
    CompileRequest("full", "q31", rate, name=name)  # the same rates and names
    check_folder(out)
    model = read_model(model_path).at_rest
    try:
        operating = operating_of(model, rate)
        play = one_play(Sources(operating, model_loops(model, operating)), "fixed")
        errors = model_errors(model, play, operating)
    except InputError as error:
        raise error.at(model_path) from error
    sha256 = hashlib.sha256(Path(model_path).read_bytes()).hexdigest()
    head = _Head(name or c_name(model.name), model, sha256, running_version(), operating)
    described = _manifest(head, play, errors)
    files = _sources(head, play, errors) | {"vectors.csv": vectors_csv(COLUMNS, _vectors(play))}
    packed = package_files(package, files, described, _example_values(head))
    described |= {} if package is None else {"package": package}
    write_folder(out, packed, described)
    return CompiledPlay(Path(out), described, (*packed, MANIFEST), play, errors)


@dataclass(frozen=True)
class _Head:
    """What all files may show."""

    name: str
    model: Model
    sha256: str
    version: str
    operating: Operating


def model_errors(model: Model, play: PlayMap, operating: Operating) -> dict[str, CycleErrors]:
    """Return what the map, and the same without a width, leave of the model's forces."""

    def answer(current: FloatArray, gap: float) -> FloatArray:
        return model.predict(current, gap, slow_times(current.size), "demagnetised").output

    low, high = operating.gap_range
    joined: dict[str, CycleErrors] = {}
    flat = PlayMap(play.map, np.zeros_like(play.half), play.radius)
    for name, compensator in ((KIND, play), ("single-valued", flat)):
        for gap in np.linspace(low, high, 5).tolist():
            reach = float(answer(np.linspace(0.0, operating.current_max, 100), gap)[-1])
            largest = min(operating.force_max, 0.98 * reach)
            errors = cycle_errors(ForceController(KIND, "fixed", compensator), answer, gap, largest)
            joined[name] = joined[name].joined(errors) if name in joined else errors
    return joined


def _vectors(play: PlayMap) -> list[Row]:
    """Run the map over demands of every sort, as for the compensators."""
    native = play.native("fixed")
    assert isinstance(native, FixedForceController)
    lost = np.random.default_rng(SEED + 1)
    table: list[Row] = []
    for index, (demand, gap) in enumerate(codes_of_inputs((0.0, 1.0), 2**31).tolist()):
        current = native.solve(demand, gap, 0)
        applied = int(current * lost.random()) if index % 8 == 7 else current
        native.commit(applied, gap)
        table.append((demand, gap, applied, current))
    return table


def _percent(errors: CycleErrors, largest: float) -> dict[str, float]:
    return {
        f"{name}_{kind}_percent": 100.0 * of(error) / largest
        for name, error in (("major", errors.major), ("small", errors.small))
        for kind, of in (("rms", rms), ("worst", worst))
    }


def _manifest(head: _Head, play: PlayMap, errors: Mapping[str, CycleErrors]) -> dict[str, Any]:
    scales, where, model = play.scales, head.operating, head.model
    limits = DemandLimits((0.0, where.force_max), play.map.limits)
    return {
        "format": VERSION,
        "anhyst": head.version,
        "name": head.name,
        "model": {"name": model.name, "sha256": head.sha256},
        "kind": KIND,
        "io": "q31",
        "rate_Hz": where.rate,
        "signals": signal_entries("q31", model, scales, limits),
        "limits": {"demand": list(limits.demand), "current": list(limits.current)},
        "memory": {"parameters_bytes": play.block("fixed").nbytes, "state_bytes": STATE_BYTES},
        "play": dict(play.numbers),
        "controller": None,
        "accuracy": {
            "unit": model.output.unit,
            "largest_output": where.force_max,
            **{name: _percent(error, where.force_max) for name, error in errors.items()},
        },
    }


def _limits(words: Words) -> list[int]:
    """Return the limits of the current as codes."""
    return [int(words[PLACES[f"PLAY_CURRENT_{end}"]]) * 2**16 for end in ("LOW", "HIGH")]


def _example_values(head: _Head) -> dict[str, object]:
    """Return what all files may show: names, and the calls of an example."""
    name, macro = head.name, head.name.upper()
    return {
        "name": name,
        "macro": macro,
        "kind": KIND,
        "version": head.version,
        "model": in_comment(head.model.name),
        "sha256": head.sha256,
        "io": "q31",
        "real": False,
        "memories": 1,
        "port": True,
        "control": False,
        "play": True,
        "type": "int32_t",
        "one": 2**31,
        "state": "anhyst_play_map_q31",
        "calls": "anhyst_play_map",
        "init": f"anhyst_play_map_init_q31(&compensator, {name}_parameters,\n"
        f"                                  {macro}_PARAMETERS_WORDS)",
        "input": head.model.input.name.replace("_", " "),
        "output": head.model.output.name.replace("_", " "),
    }


def _sources(head: _Head, play: PlayMap, errors: Mapping[str, CycleErrors]) -> dict[str, str]:
    """Return the C files and what helps to build them."""
    scales, name = play.scales, head.name
    words = play.block("fixed", int(head.sha256[:8], 16))
    values = _example_values(head) | {
        "core": sorted(f"{SRC}/{file}" for file in SOURCES),
        "own": [f"{name}_parameters.c"],
        "scales": scales,
        "limits": _limits(words),
        "demand_high": q31(head.operating.force_max / scales.demand),
        "current_high": play.map.limits[1],
        "force_max": head.operating.force_max,
        "rows": play_source(words),
        "words": words.size,
        "radius_A": play.radius,
        "bytes": words.nbytes,
        "state_bytes": STATE_BYTES,
        "rate": f"{head.operating.rate:.10g}",
        "errors": {key: _percent(error, head.operating.force_max) for key, error in errors.items()},
    }
    return core_files(SOURCES) | {
        f"{name}_parameters.h": render("play_parameters.h.j2", values),
        f"{name}_parameters.c": render("play_parameters.c.j2", values),
        "main.c": render("main.c.j2", values),
        "anhyst.mk": render("anhyst.mk.j2", values),
        "anhyst.cmake": render("anhyst.cmake.j2", values),
        "DROP_IN.md": render("play_drop_in.md.j2", values),
        PORT: read_core(PORT),
    }
