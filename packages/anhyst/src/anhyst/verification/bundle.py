"""Read a compiled folder and its golden vectors, and check that no file was changed."""

from __future__ import annotations

import csv
import hashlib
import json
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.compilation.vectors import LEVITATION_COLUMNS, LEVITATION_INPUT_COUNT
from anhyst.support.errors import InputError
from anhyst.support.kinds import COMPILED_FOLDER, require_kind
from anhyst.verification.protocol import AS_GIVEN, COMPENSATOR_RECORD, CONTROLLER_RECORD, RecordLayout, Words

MANIFEST_VERSION = 2
MANIFEST_FILE = "manifest.json"
VECTORS_FILE = "vectors.csv"
LEVITATION_FILE = "controller.csv"
"""Golden vectors of a position controller, in addition to those of the compensator."""
PORT_HEADER = "port/anhyst_port_cortex_m4.h"
EXAMPLE_FILES = ("main.c", "example/interrupt.c")
IO_BITS = {"q15": "15", "q31": "31", "f32": "32"}
PLAY_KIND = "play"
"""Kind of a map with one play operator; it has no kernel."""

MAX_STAGE_COUNT = 64
"""Largest plausible number of coordinates, heads or magnets of a stage."""


@dataclass(frozen=True, slots=True)
class Bundle:
    """Compiled compensator, with the content of its manifest."""

    folder: Path  # the compiled folder
    name: str  # name of the actuator in C
    kind: str  # kind: ``full``, ``simplified``, ``cells``, ``euler`` or ``play``
    io: str
    rate: float | None  # sample rate for which the folder was compiled, Hz
    manifest: Mapping[str, Any]  # content of ``manifest.json``

    @property
    def c_files(self) -> tuple[str, ...]:
        """Paths of all C files and headers of the folder, without the examples."""
        names = (str(name) for name in self.manifest["files"])
        return tuple(name for name in names if name[-2:] in {".c", ".h"} and name not in EXAMPLE_FILES)

    def copy_sources(self, folder: Path) -> None:
        """Copy the C files and the port header to a folder."""
        for name in self.c_files:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.folder / name, folder / name)

    @property
    def stage(self) -> Mapping[str, Any] | None:
        """Entry of the manifest about a stage; None for a compensator."""
        stage_table = self.manifest.get("stage")
        return stage_table if isinstance(stage_table, dict) else None

    @property
    def has_port(self) -> bool:
        """Whether the folder contains the header with the instructions of Cortex-M4 and M7."""
        return (self.folder / PORT_HEADER).exists()


def read_bundle(folder: Path) -> Bundle:
    """Read the manifest, and check that every file is unchanged."""
    manifest_path = folder / MANIFEST_FILE
    if not folder.is_dir():
        text = f"{folder}: no such folder; name the folder that 'anhyst compile --out' wrote"
        raise InputError(text, code="no-such-folder")
    try:
        manifest = json.loads(manifest_path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        text = f"{folder}: has no {MANIFEST_FILE}; name the folder that 'anhyst compile --out' wrote"
        raise InputError(text, code="no-manifest") from None
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise _damaged_error(f"{manifest_path}: is not JSON: {error}", code="damaged-manifest") from None
    if not isinstance(manifest, dict) or manifest.get("format") != MANIFEST_VERSION:
        text = f"{manifest_path}: key 'format' is not {MANIFEST_VERSION}"
        raise _damaged_error(text, code="damaged-manifest", key="format")
    require_kind(folder, [COMPILED_FOLDER])
    _check_files(folder, manifest_path, manifest)
    _check_stage(manifest_path, manifest.get("stage"))
    io = _read_text(manifest_path, manifest, "io")
    if io not in IO_BITS:
        known_formats = " and ".join(IO_BITS)
        text = f"{manifest_path}: key 'io': {io} cannot be verified; only {known_formats} can"
        raise InputError(text, code="not-verifiable", key="io")
    name, kind = (_read_text(manifest_path, manifest, key) for key in ("name", "kind"))
    rate = manifest.get("rate_Hz")
    rate = float(rate) if isinstance(rate, int | float) else None
    return Bundle(folder, name, kind, io, rate, manifest)


def _damaged_error(text: str, *, code: str, key: str = "") -> InputError:
    return InputError(f"{text}; run 'anhyst compile' again", code=code, key=key)


def _read_text(path: Path, manifest: Mapping[str, Any], key: str) -> str:
    value = manifest.get(key)
    if not isinstance(value, str):
        text = f"{path}: key '{key}' is missing or not a text"
        raise _damaged_error(text, code="damaged-manifest", key=key)
    return value


def _check_stage(path: Path, stage: object) -> None:
    """Check the numbers that determine the record layout of a stage."""
    if stage is None:
        return
    entry = stage if isinstance(stage, dict) else {}
    free = entry.get("free")
    coordinates = len(free) if isinstance(free, list) else 0
    counts = [coordinates, entry.get("heads"), entry.get("magnets")]
    if not all(isinstance(count, int) and 0 < count <= MAX_STAGE_COUNT for count in counts):
        text = f"{path}: key 'stage' does not list the free coordinates, heads and magnets"
        raise _damaged_error(text, code="damaged-manifest", key="stage")


def _check_files(folder: Path, manifest_path: Path, manifest: Mapping[str, Any]) -> None:
    files = manifest.get("files")
    if not isinstance(files, dict):
        text = f"{manifest_path}: key 'files' is missing"
        raise _damaged_error(text, code="damaged-manifest", key="files")
    name = _read_text(manifest_path, manifest, "name")
    controller_files = [f"{name}_controller.h", f"{name}_controller.c"]
    needed_files = controller_files if manifest.get("stage") else [f"{name}_parameters.h"]
    needed_files = [*needed_files, f"{name}_parameters.c", VECTORS_FILE]
    if manifest.get("controller") is not None:
        needed_files = [*needed_files, *controller_files, LEVITATION_FILE]
    for file in needed_files:
        if file not in files:
            text = f"{manifest_path}: key 'files' does not name {file}"
            raise _damaged_error(text, code="damaged-manifest", key="files")
    for file, expected_hash in files.items():
        path = folder / str(file)
        try:
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
        except OSError as error:
            text = f"{path}: {error.strerror}, but {MANIFEST_FILE} names it"
            raise _damaged_error(text, code="damaged-manifest", key="files") from None
        if digest != expected_hash:
            text = f"{path}: was changed since it was written (sha256)"
            raise _damaged_error(text, code="changed-since")


NEEDED_COLUMNS = ("demand", "gap", "current")

INPUT_COLUMNS = LEVITATION_COLUMNS[:LEVITATION_INPUT_COUNT]
OUTPUT_NAMES = {
    name: name.replace("drive_", "current ") for name in LEVITATION_COLUMNS[LEVITATION_INPUT_COUNT:]
}
"""Output columns of a controller's vectors, and their names in a record."""


@dataclass(frozen=True, slots=True)
class GoldenVectors:
    """Inputs and expected outputs for each step after the start."""

    inputs: Words  # inputs in the order of the layout; shape (rows, n)
    outputs: Mapping[str, Words]  # outputs by name in the record; shape (rows,)
    layout: RecordLayout = COMPENSATOR_RECORD  # layout of the records


def read_vectors(path: Path, is_float: bool) -> GoldenVectors:
    """Read ``vectors.csv``; without a column ``applied``, the solved current is applied."""
    columns = _read_columns(path, NEEDED_COLUMNS, is_float)
    demand, gap, current = (columns[name] for name in NEEDED_COLUMNS)
    application_modes, applied_current = np.full_like(demand, AS_GIVEN), columns.get("applied", current)
    inputs = np.stack([demand, gap, application_modes, applied_current, gap], axis=1)
    return GoldenVectors(inputs, {"current": current})


def read_levitation(path: Path) -> GoldenVectors:
    """Read ``controller.csv``: inputs and expected outputs of a position controller."""
    columns = _read_columns(path, (*INPUT_COLUMNS, *OUTPUT_NAMES), is_float=False)
    event = columns["dropped"] << np.uint32(16) | columns["command"]
    inputs = np.stack([*(columns[name] for name in INPUT_COLUMNS[:-2]), event], axis=1)
    outputs = {OUTPUT_NAMES[name]: columns[name] for name in OUTPUT_NAMES}
    return GoldenVectors(inputs, outputs, CONTROLLER_RECORD)


def read_stage_vectors(path: Path, layout: RecordLayout, is_float: bool) -> GoldenVectors:
    """Read the vectors of a stage: inputs of its controller in flight, and expected outputs."""
    outputs = layout.record[len(layout.inputs) :]
    columns = _read_columns(path, [record_column_name(name) for name in layout.record], is_float)
    for name in ("command", "flags", "lost", "state") if is_float else ():
        columns[name] = columns[name].view(np.float32).astype(np.uint32)
    inputs = np.stack([columns[record_column_name(name)] for name in layout.inputs], axis=1)
    return GoldenVectors(inputs, {name: columns[record_column_name(name)] for name in outputs}, layout)


def record_column_name(name: str) -> str:
    """Return the column of a vectors file for a word of a record."""
    return name.replace(" ", "_")


def _read_columns(path: Path, needed_columns: Iterable[str], is_float: bool) -> dict[str, Words]:
    """Read a file of vectors."""
    with path.open(encoding="utf-8", newline="") as stream:
        lines = csv.reader(row for row in stream if not row.startswith("#"))
        names = [name.strip() for name in next(lines, [])]
        rows = list(lines)
    if not rows:
        raise _damaged_error(f"{path}: has no rows", code="damaged-vectors")
    for name in needed_columns:
        if name not in names:
            raise _damaged_error(f"{path}: column '{name}' is missing", code="damaged-vectors", key=name)
    try:
        if is_float:
            words = np.array(rows, dtype=np.float64).astype(np.float32).view(np.uint32)
        else:
            codes = np.array(rows, dtype=np.int64)
            if np.any(np.abs(codes) > 1 << 31):
                raise OverflowError
            words = (codes & 0xFFFFFFFF).astype(np.uint32)
        words = words.reshape(len(rows), len(names))
    except (ValueError, OverflowError) as error:
        value_description = "a number of 32 bits" if is_float else "an integer of 32 bits"
        raise _damaged_error(f"{path}: a cell is not {value_description}", code="damaged-vectors") from error
    return {name: words[:, column] for column, name in enumerate(names)}
