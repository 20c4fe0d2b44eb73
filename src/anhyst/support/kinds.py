"""What kind of file this is, and which verbs take it: asked in one place by all of them."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping
from enum import StrEnum
from pathlib import Path

from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError


class Kind(StrEnum):
    """What a verb can be given; of a TOML file, what its key ``format`` says."""

    BEARING = "anhyst-bearing"
    STAGE = "anhyst-stage"
    PIEZO = "anhyst-piezo-stage"
    FORCE = "anhyst-rig"
    MODEL = "anhyst-model"
    CONTROLLER = "anhyst-controller"
    COMPILED = "compiled folder"
    MEASUREMENT = "measurement"
    PORT = "port"
    UNKNOWN = ""


NAMES: Mapping[Kind, tuple[str, str]] = {
    Kind.BEARING: ("a bearing", "bearings"),
    Kind.STAGE: ("a stage", "stages"),
    Kind.PIEZO: ("a piezo stage", "piezo stages"),
    Kind.FORCE: ("a rig of force control", "rigs of force control"),
    Kind.MODEL: ("a model", "models"),
    Kind.CONTROLLER: ("a controller file", "controller files"),
    Kind.COMPILED: ("a compiled folder", "compiled folders"),
    Kind.MEASUREMENT: ("a measurement", "measurements"),
    Kind.PORT: ("the port of a controller", "ports of controllers"),
}
"""One of a kind, and several, as messages call them."""

_MEASURED, _MODEL = (Kind.MEASUREMENT,), (Kind.MODEL,)
TAKES: Mapping[str, tuple[Kind, ...]] = {
    "inspect": _MEASURED,
    "convert": _MEASURED,
    "identify": _MEASURED,
    "fleet": _MEASURED,
    "init": _MEASURED,
    "predict": _MODEL,
    "invert": _MODEL,
    "report": _MODEL,
    "diff": _MODEL,
    "compile": _MODEL,
    "watch": _MODEL,
    "export": (Kind.MODEL, Kind.BEARING),
    "verify": (Kind.COMPILED,),
    "simulate": (Kind.BEARING, Kind.STAGE, Kind.PIEZO),
    "tune": (Kind.BEARING,),
    "force-control": (Kind.FORCE,),
    "excite": (Kind.BEARING, Kind.FORCE),
    "live": (Kind.BEARING, Kind.FORCE, Kind.COMPILED),
    "xcp": (Kind.PORT,),
}
"""What the first argument of every verb may be."""

MEASUREMENTS = frozenset(
    {".csv", ".tsv", ".mat", ".mf4", ".tdms", ".h5", ".hdf5", ".parquet", ".xlsx", ".xlsm"}
)
"""Endings of files that hold nothing else; ``.txt`` and ``.dat`` may be anything."""


def kind_named(text: object) -> Kind:
    """Return the kind that a key ``format`` names."""
    if isinstance(text, str) and text.startswith("anhyst-") and text in list(Kind):
        return Kind(text)
    return Kind.UNKNOWN


def kind_of(path: PathLike) -> Kind:
    """Return what a file or a folder is; unknown where it says nothing or cannot be read.

    Whoever reads it then says what is wrong with it.
    """
    place = Path(path)
    if place.is_dir():
        return Kind.COMPILED if (place / "manifest.json").is_file() else Kind.UNKNOWN
    if not place.is_file():  # a port must not be read from
        return Kind.UNKNOWN
    if place.suffix.lower() in MEASUREMENTS:
        return Kind.MEASUREMENT
    try:
        return kind_named(tomllib.loads(place.read_text(encoding="utf-8")).get("format"))
    except (OSError, ValueError, RecursionError):
        return Kind.UNKNOWN


def refuse_other(
    path: PathLike, wanted: Collection[Kind], verb: str = "", found: Kind | None = None
) -> Kind:
    """Return what a file is, or refuse one of another kind and name the verbs that take it.

    ``found`` is what it is, where that is known already.
    """
    kind = kind_of(path) if found is None else found
    if kind in wanted or kind is Kind.UNKNOWN:
        return kind
    plural = verb != ""
    names = _listed([NAMES[one][plural] for one in wanted], "and" if plural else "or")
    needed = f"{verb} is for {names}" if plural else f"{names} is needed"
    raise InputError(f"{path}: this is {NAMES[kind][0]}; {needed}; {_taken(kind)}")


def _taken(kind: Kind) -> str:
    """Say which verbs take a kind."""
    if kind is Kind.CONTROLLER:
        return "anhyst simulate, tune, compile and live take it with --controller"
    verbs = [verb for verb, kinds in TAKES.items() if kind in kinds]
    return f"anhyst {_listed(verbs, 'and')} take{'s' if len(verbs) == 1 else ''} it"


def _listed(words: list[str], last: str) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"
