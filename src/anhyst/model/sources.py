"""Measurements and how they were read: once for identification, again for the report."""

from __future__ import annotations

import hashlib
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.data.loops import Loops
from anhyst.data.read_options import PREFIX, ReadOptions
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError

if TYPE_CHECKING:
    from anhyst.model.actuator import Model


def read_sources(model: Model, folder: PathLike = ".") -> Loops:
    """Read the measurements of a model again, exactly as for its identification."""
    sources = model.provenance.sources
    if not sources:
        raise InputError(
            "the model does not say which measurements it came from: [provenance]",
            code="no-provenance",
            key="provenance",
        )
    kept = {
        name.removeprefix(PREFIX): str(value)
        for name, value in model.provenance.settings.items()
        if name.startswith(PREFIX)
    }
    unknown = set(kept) - {item.name for item in fields(ReadOptions)}
    if unknown:
        key = f"provenance.settings.{PREFIX}{min(unknown)}"
        raise InputError(f"{key}: is unknown; remove it", code="extra-forbidden", key=key)
    options = ReadOptions.from_text(**kept)
    return options.read([_find(source.path, source.sha256, Path(folder)) for source in sources])


def _find(path: str, sha256: str, folder: Path) -> Path:
    places = [Path(path), folder / path, folder / Path(path).name]
    there = [path for path in places if path.is_file()]
    for place in there:
        with place.open("rb") as stream:
            if hashlib.file_digest(stream, "sha256").hexdigest() == sha256:
                return place
    if there:
        raise InputError(
            f"{there[0]}: has changed since the model was identified; identify again",
            code="source-changed",
        )
    raise InputError(
        f"{path}: no such file; put the measurements back or identify again", code="no-such-file"
    )
