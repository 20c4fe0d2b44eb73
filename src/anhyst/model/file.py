"""The model file: a versioned TOML that a person reads, edits and compares; and the files it came from.

Everything is SI and the unit stands in the key, so ``k_A_per_m`` is ``k`` in A/m. Numbers are
written so that every bit comes back, and there is no time stamp: the same model gives the same
file. What is wrong with a file is reported with its line and key, all of it at once.
"""

from __future__ import annotations

import hashlib
from dataclasses import fields
from pathlib import Path

from anhyst.data.loops import Loops
from anhyst.data.read_options import PREFIX, ReadOptions
from anhyst.model.actuator import Model
from anhyst.model.reader import read_as
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError


def read_model(path: PathLike) -> Model:
    """Read and check a model file.

    Parameters
    ----------
    path : path-like
        A file that :func:`~anhyst.model.writer.write_model` wrote, perhaps edited since.

    Returns
    -------
    Model
        Ready for use: the core has accepted its parameters.

    Raises
    ------
    InputError
        The file cannot be read or is no TOML.
    TomlFileError
        Another format or version, keys that are unknown, missing, without their unit or out of
        range; with line and key.
    """
    return read_as(path, Model)


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
