"""The folder that ``anhyst compile`` wrote, read back and checked."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from anhyst.errors import InputError

FORMAT = 1
MANIFEST = "manifest.json"
SOURCES = ("anhyst.h", "anhyst.c", "anhyst_parameters.h", "anhyst_parameters.c")
VECTORS = "vectors.csv"
CONTROLLER_SOURCES = ("anhyst_controller.h", "anhyst_controller.c")
FLIGHT = "controller.csv"
"""What a folder with a position controller holds beside the compensator."""
PORT_HEADER = "anhyst_port_cortex_m4.h"
FORMATS = {"q15": "15", "q31": "31", "f32": "32"}
AGAIN = "run 'anhyst compile' again"


@dataclass(frozen=True, slots=True)
class Bundle:
    """A compensator as C, with what its manifest says.

    Parameters
    ----------
    folder : Path
        Where it stands.
    kind, io : str
        ``full``, ``simplified`` or ``euler``; ``q15`` or ``q31``.
    rate : float or None
        Ticks a second it was made for, Hz.
    manifest : mapping
        All of ``manifest.json``.
    has_control : bool
        Whether the position controller PIDD2 comes with the C.
    """

    folder: Path
    kind: str
    io: str
    rate: float | None
    manifest: Mapping[str, Any]
    has_control: bool

    def copy_sources(self, folder: Path) -> None:
        """Copy the C and the port header to a folder, to be compiled there."""
        for name in (*SOURCES, *CONTROLLER_SOURCES, PORT_HEADER):
            source = self.folder / name
            if source.exists():
                shutil.copyfile(source, folder / name)

    @property
    def has_controller(self) -> bool:
        """Whether a whole position controller comes with it."""
        return self.manifest.get("controller") is not None

    @property
    def has_port(self) -> bool:
        """Whether the instructions of Cortex-M4 and M7 come with it."""
        return (self.folder / PORT_HEADER).exists()


def read_bundle(folder: Path) -> Bundle:
    """Read the manifest and check that every file is as it was written.

    Parameters
    ----------
    folder : Path
        What ``anhyst compile --out`` made.

    Raises
    ------
    InputError
        There is no manifest, it is of another format, or a file is missing or was changed.
    """
    place = folder / MANIFEST
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name the one 'anhyst compile --out' made")
    try:
        manifest = json.loads(place.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"{folder}: has no {MANIFEST}; name the folder 'anhyst compile --out' made"
        ) from None
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{place}: is not JSON: {error}; {AGAIN}") from None
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise InputError(f"{place}: key 'format' is not {FORMAT}; {AGAIN}")
    _check_files(folder, place, manifest)
    io = _text(place, manifest, "io")
    if io not in FORMATS:
        known = " and ".join(FORMATS)
        raise InputError(f"{place}: key 'io': {io} cannot be verified; only {known} can")
    rate = manifest.get("rate_Hz")
    header = (folder / "anhyst.h").read_text(encoding="utf-8", errors="replace")
    return Bundle(
        folder,
        _text(place, manifest, "kind"),
        io,
        float(rate) if isinstance(rate, int | float) else None,
        manifest,
        "anhyst_pidd2_solve_q31" in header,
    )


def _text(place: Path, manifest: Mapping[str, Any], key: str) -> str:
    value = manifest.get(key)
    if not isinstance(value, str):
        raise InputError(f"{place}: key '{key}' is missing or not a text; {AGAIN}")
    return value


def _check_files(folder: Path, place: Path, manifest: Mapping[str, Any]) -> None:
    files = manifest.get("files")
    if not isinstance(files, dict):
        raise InputError(f"{place}: key 'files' is missing; {AGAIN}")
    needed: tuple[str, ...] = (*SOURCES, VECTORS)
    if manifest.get("controller") is not None:
        needed += (*CONTROLLER_SOURCES, FLIGHT)
    for name in needed:
        if name not in files:
            raise InputError(f"{place}: key 'files' does not name {name}; {AGAIN}")
    for name, wanted in files.items():
        path = folder / str(name)
        try:
            found = hashlib.sha256(path.read_bytes()).hexdigest()
        except OSError as error:
            raise InputError(
                f"{path}: {error.strerror}, but {MANIFEST} names it; {AGAIN}"
            ) from None
        if found != wanted:
            raise InputError(f"{path}: was changed since it was written (sha256); {AGAIN}")
