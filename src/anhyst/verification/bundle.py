"""The folder that ``anhyst compile`` wrote, read back and checked."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from anhyst.support.errors import InputError

FORMAT = 2
MANIFEST = "manifest.json"
VECTORS = "vectors.csv"
LEVITATION = "controller.csv"
"""What a folder with a position controller holds beside the compensator's vectors."""
PORT_HEADER = "port/anhyst_port_cortex_m4.h"
EXAMPLE = "main.c"
FORMATS = {"q15": "15", "q31": "31", "f32": "32"}
PLAY = "play"
"""Kind of a map with one play, which is no compensator with a kernel."""

MOST = 64
"""Coordinates, heads or magnets that are believed of a stage."""

AGAIN = "run 'anhyst compile' again"


@dataclass(frozen=True, slots=True)
class Bundle:
    """A compensator as C, with what its manifest says."""

    folder: Path  # where it stands
    name: str  # what the actuator is called in the C
    kind: str  # ``full``, ``simplified``, ``cells``, ``euler`` or ``play``; ``q15`` or ``q31``
    io: str
    rate: float | None  # ticks a second it was made for, Hz
    manifest: Mapping[str, Any]  # all of ``manifest.json``

    @property
    def c_files(self) -> tuple[str, ...]:
        """All that a project compiles or includes, by path below the folder."""
        names = (str(name) for name in self.manifest["files"])
        return tuple(name for name in names if name[-2:] in {".c", ".h"} and name != EXAMPLE)

    def copy_sources(self, folder: Path) -> None:
        """Copy the C and the port header to a folder, to be compiled there."""
        for name in self.c_files:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.folder / name, folder / name)

    @property
    def has_controller(self) -> bool:
        """Whether a whole position controller comes with it."""
        return self.manifest.get("controller") is not None

    @property
    def stage(self) -> Mapping[str, Any] | None:
        """What the manifest says of a stage; None of a compensator."""
        described = self.manifest.get("stage")
        return described if isinstance(described, dict) else None

    @property
    def has_port(self) -> bool:
        """Whether the instructions of Cortex-M4 and M7 come with it."""
        return (self.folder / PORT_HEADER).exists()


def read_bundle(folder: Path) -> Bundle:
    """Read the manifest and check that every file is as it was written."""
    manifest_path = folder / MANIFEST
    if not folder.is_dir():
        raise InputError(
            f"{folder}: no such folder; name the one 'anhyst compile --out' made",
            code="no-such-folder",
        )
    try:
        manifest = json.loads(manifest_path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"{folder}: has no {MANIFEST}; name the folder 'anhyst compile --out' made",
            code="no-manifest",
        ) from None
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(
            f"{manifest_path}: is not JSON: {error}; {AGAIN}", code="damaged-manifest"
        ) from None
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise InputError(
            f"{manifest_path}: key 'format' is not {FORMAT}; {AGAIN}",
            code="damaged-manifest",
            key="format",
        )
    _check_files(folder, manifest_path, manifest)
    _check_stage(manifest_path, manifest.get("stage"))
    io = _text(manifest_path, manifest, "io")
    if io not in FORMATS:
        known = " and ".join(FORMATS)
        raise InputError(
            f"{manifest_path}: key 'io': {io} cannot be verified; only {known} can",
            code="not-verifiable",
            key="io",
        )
    rate = manifest.get("rate_Hz")
    return Bundle(
        folder,
        _text(manifest_path, manifest, "name"),
        _text(manifest_path, manifest, "kind"),
        io,
        float(rate) if isinstance(rate, int | float) else None,
        manifest,
    )


def _text(path: Path, manifest: Mapping[str, Any], key: str) -> str:
    value = manifest.get(key)
    if not isinstance(value, str):
        raise InputError(
            f"{path}: key '{key}' is missing or not a text; {AGAIN}",
            code="damaged-manifest",
            key=key,
        )
    return value


def _check_stage(path: Path, stage: object) -> None:
    """Check the numbers from which the form of a stage's records follows."""
    if stage is None:
        return
    described = stage if isinstance(stage, dict) else {}
    free = described.get("free")
    counts = [
        len(free) if isinstance(free, list) else 0,
        described.get("heads"),
        described.get("magnets"),
    ]
    if not all(isinstance(count, int) and 0 < count <= MOST for count in counts):
        raise InputError(
            f"{path}: key 'stage' does not say what is free, how many heads and magnets there are; {AGAIN}",
            code="damaged-manifest",
            key="stage",
        )


def _check_files(folder: Path, place: Path, manifest: Mapping[str, Any]) -> None:
    files = manifest.get("files")
    if not isinstance(files, dict):
        raise InputError(
            f"{place}: key 'files' is missing; {AGAIN}", code="damaged-manifest", key="files"
        )
    name = _text(place, manifest, "name")
    around = [f"{name}_controller.h", f"{name}_controller.c"]
    needed = around if manifest.get("stage") else [f"{name}_parameters.h"]
    needed = [*needed, f"{name}_parameters.c", VECTORS]
    if manifest.get("controller") is not None:
        needed = [*needed, *around, LEVITATION]
    for file in needed:
        if file not in files:
            raise InputError(
                f"{place}: key 'files' does not name {file}; {AGAIN}",
                code="damaged-manifest",
                key="files",
            )
    for file, wanted in files.items():
        path = folder / str(file)
        try:
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
        except OSError as error:
            raise InputError(
                f"{path}: {error.strerror}, but {MANIFEST} names it; {AGAIN}",
                code="damaged-manifest",
                key="files",
            ) from None
        if digest != wanted:
            raise InputError(
                f"{path}: was changed since it was written (sha256); {AGAIN}", code="changed-since"
            )
