"""Compile a map with one play operator to C, and measure its force error.

The map is for processors on which a compensator takes too long.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from anhyst._core import FixedForceController
from anhyst.compensate.block import DemandLimits
from anhyst.compensate.current_map import PlayMap, fit_play_map
from anhyst.compensate.force_controller import Compensator, ForceController
from anhyst.compensate.plan import CompileRequest
from anhyst.compensate.play_block import Words
from anhyst.compensate.sources import (
    OperatingRange,
    Sources,
    find_operating_range,
    make_ramps,
    simulate_loops,
)
from anhyst.compilation.manifest import (
    MANIFEST_FILE,
    MANIFEST_VERSION,
    CompiledFolder,
    check_folder,
    signal_entries,
    write_folder,
)
from anhyst.compilation.packages import check_package, make_package_files
from anhyst.compilation.play_source import play_initialiser
from anhyst.compilation.source import PORT_HEADER, escape_comment, render
from anhyst.compilation.toolchain import SOURCE_FOLDER, core_files, read_core
from anhyst.compilation.vectors import COLUMNS, SEED, VectorRow, make_input_codes, write_vectors_csv
from anhyst.model.actuator import Model, read_model
from anhyst.model.predict import slow_times
from anhyst.support import running_version
from anhyst.support.atomic import PathLike
from anhyst.support.block_layout import WORD_INDEX
from anhyst.support.cache import c_name
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray, rms, to_q31
from anhyst.support.result import rows_to_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SAMPLES_PER_RANGE = 200
"""Number of samples of a ramp over the whole range of demands."""

SMALL_CYCLE_LEVELS = (0.25, 0.5, 0.75)
"""Mean values of the small cycles, relative to the largest force."""

SMALL_CYCLE_SIZE = 0.1
"""Peak-to-peak size of the small cycles, relative to the largest force."""

SMALL_CYCLES_PER_LEVEL = 4
"""Number of small cycles at a level. The last cycle is evaluated."""

ForceModel = Callable[[FloatArray, float], FloatArray]
"""Function that returns the forces for currents at a gap, beginning in the demagnetised state."""


@dataclass(frozen=True)
class CycleErrors:
    """Force minus demand, N."""

    major: FloatArray  # major loop from zero to the largest force and back, after two such loops
    small: FloatArray  # small cycles at levels that were approached from above and from below

    def join_errors(self, other: CycleErrors) -> CycleErrors:
        """Return the combined errors of this run and of another run."""
        return CycleErrors(
            np.concatenate([self.major, other.major]), np.concatenate([self.small, other.small])
        )


def max_magnitude(error: FloatArray) -> float:
    """Return the largest magnitude."""
    return float(np.abs(error).max())


def measure_cycle_errors(
    compensator: Compensator, force_model: ForceModel, gap: float, max_force: float
) -> CycleErrors:
    """Run a compensator along test demands at one gap, and return the force errors.

    The solved currents are applied without deviation.
    """
    reversals, evaluated_ramps = [0.0, 1.0, 0.0, 1.0, 0.0], []
    first_ramp = len(reversals) - 1
    reversals += [1.0, 0.0]
    evaluated_ramps += [(first_ramp, "major"), (first_ramp + 1, "major")]
    for level in SMALL_CYCLE_LEVELS:
        for end in (1.0, 0.0):
            reversals.append(end)
            for _ in range(SMALL_CYCLES_PER_LEVEL):
                ends = (level - 0.5 * SMALL_CYCLE_SIZE, level + 0.5 * SMALL_CYCLE_SIZE)
                reversals += ends if end > 0.5 else ends[::-1]
            evaluated_ramps += [(len(reversals) - 3, "small"), (len(reversals) - 2, "small")]
    ramps = make_ramps(reversals, SAMPLES_PER_RANGE)
    demand = max_force * np.concatenate(ramps)
    error = force_model(compensator.run(demand, gap), gap) - demand
    error_by_ramp = np.split(error, np.cumsum([ramp.size for ramp in ramps])[:-1])
    errors = {
        kind: np.concatenate([error_by_ramp[index] for index, label in evaluated_ramps if label == kind])
        for kind in ("major", "small")
    }
    return CycleErrors(errors["major"], errors["small"])


PLAY_KIND: Literal["play"] = "play"
PLAY_SOURCES = ("compensator/play_map.c",)
STATE_BYTES = 20 + 7 * 4 + 5 * 4 + 8
"""Size of ``anhyst_play_map_q31`` with 32-bit pointers."""


@dataclass(frozen=True, repr=False)
class CompiledPlay(CompiledFolder):
    """Result of compiling a map with one play operator.

    Parameters
    ----------
    out : Path
        The folder.
    manifest : dict
        Content of ``manifest.json``, without the hashes of the files.
    files : tuple of str
        Names of the files.
    play : PlayMap
        The fitted map.
    errors : mapping of str to CycleErrors
        Force errors relative to the model: of this map, and of the best single-valued current.
    """

    play: PlayMap
    errors: Mapping[str, CycleErrors]

    def facts(self) -> dict[str, str]:
        """Return folder and force errors."""
        accuracy = self.manifest["accuracy"]["play"]
        errors = {name.replace("_", " "): f"{value:.2g} %" for name, value in accuracy.items()}
        return {"folder": str(self.out), "kind": "play", **errors}

    def to_columns(self) -> dict[str, Any]:
        """Return the errors of the compiled map and of the best single-valued map, per cent."""
        rows = ((name, self.manifest["accuracy"][name]) for name in self.errors)
        return rows_to_columns([{"map": name, **accuracy} for name, accuracy in rows])

    def draw(self, axes: Axes) -> None:
        """Draw the force error along the major loop, of this map and of the single-valued one."""
        for name, errors in self.errors.items():
            axes.plot(errors.major, lw=1.0, label=name)
        axes.set_xlabel("sample of the loop")
        axes.set_ylabel("force less demand [N]")


def compile_play(
    model_path: PathLike, out: PathLike, rate: float, io: str, name: str | None, package: str | None = None
) -> CompiledPlay:
    """Compile a map with one play operator to a folder of C."""
    check_package(package)
    if io != "q31":
        text = f"--io: {io} is not for --kind play, whose signals have 32 bits; give q31"
        raise InputError(text, code="option-not-for-this", key="--io")
    CompileRequest("full", "q31", rate, name=name)  # checks the rate and the name
    check_folder(out)
    model = read_model(model_path).at_rest
    try:
        operating = find_operating_range(model, rate)
        play = fit_play_map(Sources(operating, simulate_loops(model, operating)), "fixed")
        errors = measure_model_errors(model, play, operating)
    except InputError as error:
        raise error.with_location(model_path) from error
    sha256 = hashlib.sha256(Path(model_path).read_bytes()).hexdigest()
    info = _FileInfo(name or c_name(model.name), model, sha256, running_version(), operating)
    manifest_entry = _make_manifest(info, play, errors)
    files = _make_sources(info, play, errors) | {
        "vectors.csv": write_vectors_csv(COLUMNS, _make_golden_vectors(play))
    }
    output_files = make_package_files(package, files, manifest_entry, _example_values(info))
    manifest_entry |= {} if package is None else {"package": package}
    write_folder(out, output_files, manifest_entry)
    return CompiledPlay(Path(out), manifest_entry, (*output_files, MANIFEST_FILE), play, errors)


@dataclass(frozen=True)
class _FileInfo:
    """Values for all templates."""

    name: str
    model: Model
    sha256: str
    version: str
    operating: OperatingRange


def measure_model_errors(model: Model, play: PlayMap, operating: OperatingRange) -> dict[str, CycleErrors]:
    """Return the force errors of the map, and of the same map without play, relative to the model."""

    def predict_force(current: FloatArray, gap: float) -> FloatArray:
        return model.predict(current, gap, slow_times(current.size), "demagnetised").output

    smallest_gap, largest_gap = operating.gap_range
    errors_by_map: dict[str, CycleErrors] = {}
    without_play = PlayMap(play.map, np.zeros_like(play.half_width), play.radius)
    for name, compensator in ((PLAY_KIND, play), ("single-valued", without_play)):
        for gap in np.linspace(smallest_gap, largest_gap, 5).tolist():
            reachable_force = float(predict_force(np.linspace(0.0, operating.current_max, 100), gap)[-1])
            max_force = min(operating.force_max, 0.98 * reachable_force)
            errors = measure_cycle_errors(
                ForceController(PLAY_KIND, "fixed", compensator), predict_force, gap, max_force
            )
            errors_by_map[name] = errors_by_map[name].join_errors(errors) if name in errors_by_map else errors
    return errors_by_map


def _make_golden_vectors(play: PlayMap) -> list[VectorRow]:
    """Run the map over the same kinds of inputs as the compensators."""
    native = play.native("fixed")
    assert isinstance(native, FixedForceController)
    random = np.random.default_rng(SEED + 1)
    table: list[VectorRow] = []
    for index, (demand, gap) in enumerate(make_input_codes((0.0, 1.0), 2**31).tolist()):
        current = native.solve(demand, gap, 0)
        applied_current = int(current * random.random()) if index % 8 == 7 else current
        native.commit(applied_current, gap)
        table.append((demand, gap, applied_current, current))
    return table


def _percent_entries(errors: CycleErrors, max_force: float) -> dict[str, float]:
    return {
        f"{name}_{kind}_percent": 100.0 * measure(error) / max_force
        for name, error in (("major", errors.major), ("small", errors.small))
        for kind, measure in (("rms", rms), ("worst", max_magnitude))
    }


def _make_manifest(info: _FileInfo, play: PlayMap, errors: Mapping[str, CycleErrors]) -> dict[str, Any]:
    scales, operating, model = play.scales, info.operating, info.model
    limits = DemandLimits((0.0, operating.force_max), play.map.limits)
    return {
        "format": MANIFEST_VERSION,
        "anhyst": info.version,
        "name": info.name,
        "model": {"name": model.name, "sha256": info.sha256},
        "kind": PLAY_KIND,
        "io": "q31",
        "rate_Hz": operating.rate,
        "signals": signal_entries("q31", model, scales, limits),
        "limits": {"demand": list(limits.demand), "current": list(limits.current)},
        "memory": {"parameters_bytes": play.block("fixed").nbytes, "state_bytes": STATE_BYTES},
        "play": dict(play.constants),
        "controller": None,
        "accuracy": {
            "unit": model.output.unit,
            "largest_output": operating.force_max,
            **{name: _percent_entries(error, operating.force_max) for name, error in errors.items()},
        },
    }


def _limit_codes(words: Words) -> list[int]:
    """Return the limits of the current as codes."""
    return [int(words[WORD_INDEX[f"PLAY_CURRENT_{end}"]]) * 2**16 for end in ("LOW", "HIGH")]


def _example_values(info: _FileInfo) -> dict[str, object]:
    """Return the values for all templates: names, and the calls of an example."""
    name, macro = info.name, info.name.upper()
    return {
        "name": name,
        "macro": macro,
        "kind": PLAY_KIND,
        "version": info.version,
        "model": escape_comment(info.model.name),
        "sha256": info.sha256,
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
        "input": info.model.input.words,
        "output": info.model.output.words,
    }


def _make_sources(info: _FileInfo, play: PlayMap, errors: Mapping[str, CycleErrors]) -> dict[str, str]:
    """Return the C files and build files."""
    scales, name = play.scales, info.name
    words = play.block("fixed", int(info.sha256[:8], 16))
    values = _example_values(info) | {
        "core": sorted(f"{SOURCE_FOLDER}/{file}" for file in PLAY_SOURCES),
        "own": [f"{name}_parameters.c"],
        "scales": scales,
        "limits": _limit_codes(words),
        "demand_high": to_q31(info.operating.force_max / scales.demand),
        "current_high": play.map.limits[1],
        "force_max": info.operating.force_max,
        "rows": play_initialiser(words),
        "words": words.size,
        "radius_A": play.radius,
        "bytes": words.nbytes,
        "state_bytes": STATE_BYTES,
        "rate": f"{info.operating.rate:.10g}",
        "errors": {key: _percent_entries(error, info.operating.force_max) for key, error in errors.items()},
    }
    return core_files(PLAY_SOURCES) | {
        f"{name}_parameters.h": render("play_parameters.h.j2", values),
        f"{name}_parameters.c": render("play_parameters.c.j2", values),
        "main.c": render("main.c.j2", values),
        "anhyst.mk": render("anhyst.mk.j2", values),
        "anhyst.cmake": render("anhyst.cmake.j2", values),
        "DROP_IN.md": render("play_drop_in.md.j2", values),
        PORT_HEADER: read_core(PORT_HEADER),
    }
