"""What kind of file this is, and which verbs take it: asked in one place by all of them."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Collection, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Literal

from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError


class FileKind(StrEnum):
    """What a verb can be given; of a rig, its ``control.kind``, of another file its ``format``."""

    BEARING = "levitation"
    STAGE = "tracking"
    PIEZO = "displacement"
    FORCE = "force"
    MODEL = "anhyst-model"
    CONTROLLER = "anhyst-controller"
    CALIBRATION = "anhyst-calibration"
    COMPILED = "compiled folder"
    PACKAGE = "package"
    MEASUREMENT = "measurement"
    PORT = "port"
    UNKNOWN = ""


NAMES: Mapping[FileKind, tuple[str, str]] = {
    FileKind.BEARING: ("a bearing", "bearings"),
    FileKind.STAGE: ("a stage", "stages"),
    FileKind.PIEZO: ("a piezo stage", "piezo stages"),
    FileKind.FORCE: ("a rig of force control", "rigs of force control"),
    FileKind.MODEL: ("a model", "models"),
    FileKind.CONTROLLER: ("a controller file", "controller files"),
    FileKind.CALIBRATION: ("a calibration", "calibrations"),
    FileKind.COMPILED: ("a compiled folder", "compiled folders"),
    FileKind.PACKAGE: ("a package of an ecosystem", "packages of ecosystems"),
    FileKind.MEASUREMENT: ("a measurement", "measurements"),
    FileKind.PORT: ("the port of a controller", "ports of controllers"),
}
"""One of a kind, and several, as messages call them."""

RIGS = (FileKind.BEARING, FileKind.STAGE, FileKind.PIEZO, FileKind.FORCE)
"""All that a rig file can be."""
_MEASURED, _MODEL = (FileKind.MEASUREMENT,), (FileKind.MODEL,)
TAKES: Mapping[str, tuple[FileKind, ...]] = {
    "inspect": _MEASURED,
    "convert": _MEASURED,
    "identify": _MEASURED,
    "fleet": _MEASURED,
    "init": _MEASURED,
    "predict": _MODEL,
    "invert": _MODEL,
    "report": _MODEL,
    "diff": _MODEL,
    "compile": (FileKind.MODEL, FileKind.STAGE),
    "watch": _MODEL,
    "export": (FileKind.MODEL, *RIGS),
    "verify": (FileKind.COMPILED,),
    "simulate": RIGS,
    "calibrate": (FileKind.BEARING, FileKind.STAGE),
    "tune": (FileKind.BEARING, FileKind.STAGE, FileKind.PIEZO),
    "force-control": (FileKind.FORCE, *_MEASURED),
    "excite": RIGS,
    "live": (*RIGS, FileKind.COMPILED),
    "xcp": (FileKind.PORT,),
}
"""What the first argument of every verb may be."""
REASONS: Mapping[tuple[str, FileKind], str] = {
    ("tune", FileKind.FORCE): "its force is controlled open loop, so there are no gains to find",
    ("calibrate", FileKind.FORCE): "its armature is held, so there is no motion to learn from",
    ("calibrate", FileKind.PIEZO): "it has no magnets, whose errors are what motion teaches",
    ("force-control", FileKind.BEARING): "its armature flies, and here one is held",
    ("force-control", FileKind.STAGE): "its body moves, and here an armature is held",
    ("force-control", FileKind.PIEZO): "a stack is driven to a displacement, not to a force",
    ("compile", FileKind.BEARING): "compile its model, with --controller for the whole controller",
}
"""Why a verb has no use for a kind, where there is more to say than that."""

MEASUREMENTS = frozenset(
    {".csv", ".tsv", ".asc", ".lvm", ".mat", ".mf4", ".mdf", ".tdms", ".h5", ".hdf5", ".parquet"}
    | {".xlsx", ".xlsm"}
)
"""Endings of files that hold nothing else; ``.txt`` and ``.dat`` may be anything."""


RIG_FORMAT = "anhyst-rig"


def format_of(kind: FileKind) -> str:
    """Return what the key ``format`` of a kind of file says."""
    return RIG_FORMAT if kind in RIGS else kind


def kind_in(content: Mapping[str, object]) -> FileKind:
    """Return the kind of a TOML file from its contents."""
    text, control = content.get("format"), content.get("control")
    if text == RIG_FORMAT:
        word = control.get("kind") if isinstance(control, dict) else None
        return FileKind(word) if word in RIGS else FileKind.UNKNOWN
    known = (FileKind.MODEL, FileKind.CONTROLLER, FileKind.CALIBRATION)
    return FileKind(text) if isinstance(text, str) and text in known else FileKind.UNKNOWN


def kind_of(path: PathLike) -> FileKind:
    """Return what a file or a folder is; unknown where it says nothing or cannot be read.

    Whoever reads it then says what is wrong with it.
    """
    file = Path(path)
    if file.is_dir():
        return _kind_of_folder(file / "manifest.json")
    if not file.is_file():  # a port must not be read from
        return FileKind.UNKNOWN
    if file.suffix.lower() in MEASUREMENTS:
        return FileKind.MEASUREMENT
    try:
        return kind_in(tomllib.loads(file.read_text(encoding="utf-8")))
    except (OSError, ValueError, RecursionError):
        return FileKind.UNKNOWN


def _kind_of_folder(manifest: Path) -> FileKind:
    """Return what a folder is by its manifest; a package has its files in other places."""
    if not manifest.is_file():
        return FileKind.UNKNOWN
    try:
        content = json.loads(manifest.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return FileKind.COMPILED
    is_package = isinstance(content, dict) and "package" in content
    return FileKind.PACKAGE if is_package else FileKind.COMPILED


def refuse_other(
    path: PathLike,
    taken: Collection[FileKind],
    verb: str = "",
    kind_in_file: FileKind | None = None,
) -> FileKind:
    """Return what a file is, or refuse one of another kind and name the verbs that take it.

    ``found`` is what it is, where that is known already.
    """
    kind = kind_of(path) if kind_in_file is None else kind_in_file
    if kind in taken or kind is FileKind.UNKNOWN:
        return kind
    plural = verb != ""
    names = _listed([NAMES[kind][plural] for kind in taken], "and" if plural else "or")
    reason = f": {REASONS[verb, kind]}" if (verb, kind) in REASONS else ""
    needed = f"{verb} is for {names}{reason}" if plural else f"{names} is needed"
    raise InputError(
        f"{path}: this is {NAMES[kind][0]}; {needed}; {_taken(kind)}", code="wrong-kind"
    )


def _taken(kind: FileKind) -> str:
    """Say which verbs take a kind."""
    if kind is FileKind.CONTROLLER:
        return "anhyst simulate, tune, compile and live take it with --controller"
    if kind is FileKind.CALIBRATION:
        return "a rig file names it as control.calibration"
    if kind is FileKind.PACKAGE:
        return "compile again without --package for it"
    verbs = [verb for verb, kinds in TAKES.items() if kind in kinds]
    return f"anhyst {_listed(verbs, 'and')} take{'s' if len(verbs) == 1 else ''} it"


def _listed(words: list[str], last: str) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"


MethodName = Literal[
    "ratio",
    "secant",
    "linearised",
    "single-valued",
    "play",
    "simplified",
    "at-rest",
    "full",
    "flux",
    "fused",
]
"""How a force controller finds its current; a row of :data:`anhyst.compensate.methods.METHODS`."""
METHOD_TITLES: Mapping[MethodName, str] = {
    "ratio": "constant force-current ratio",
    "secant": "force in proportion to current",
    "linearised": "two constants, k_i and k_s",
    "single-valued": "best current without memory",
    "play": "map with one play",
    "simplified": "simplified hysteresis compensator",
    "at-rest": "full hysteresis compensator, at rest",
    "full": "full hysteresis compensator",
    "flux": "measured flux density",
    "fused": "full, and measured flux density",
}
"""Every method in words."""
PROBED: tuple[MethodName, ...] = ("flux", "fused")
"""Those that need a flux probe."""


NumberFormat = Literal["f64", "f32", "fixed"]
"""In which a force controller counts: double, single, or 32-bit fixed point."""
