"""Measurements and how they were read: once for identification, again for the report."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.data.clean import DEFAULT_STEPS, clean
from anhyst.data.loops import Loops
from anhyst.data.reading import read_loops
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.progress import Progress

if TYPE_CHECKING:
    from anhyst.model.actuator import Model
    from anhyst.model.fit_record import Setting


PREFIX = "read_"
"""Settings of the provenance that say how the measurements were read begin with this."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How measurements are read, where their headers and sidecars do not say it all.

    Parameters
    ----------
    columns : mapping of str to str
        Column of the file to our column.
    constants : mapping of str to float or str
        Our column to what it is throughout.
    schedule, loop : str or None
        The scheduling variable; the column that distinguishes loops.
    history : str or None
        What happened before the first sample.
    sidecar : str or None
        TOML file that describes all the files.
    clean : tuple of str
        Cleaning steps, in their order.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, float | str] = field(default_factory=dict)
    schedule: str | None = None
    loop: str | None = None
    history: str | None = None
    sidecar: str | None = None
    clean: tuple[str, ...] = DEFAULT_STEPS

    @classmethod
    def from_text(cls, **texts: str | None) -> ReadOptions:
        """Read the options from texts, as on the command line and in a model file.

        Parameters
        ----------
        **texts : str or None
            One for each field: ``columns="U_M_V=psi_Wb"``, ``constants="gap_mm=0.4"``,
            ``clean="dedupe,drift"`` or ``"none"``. None leaves the default.

        Returns
        -------
        ReadOptions
            The options.

        Raises
        ------
        InputError
            A text that is not of the right form.
        """
        given = {name: text for name, text in texts.items() if text is not None}
        columns = _pairs(given.pop("columns", ""), "columns")
        constants = _pairs(given.pop("constants", ""), "constants")
        steps = given.pop("clean", ",".join(DEFAULT_STEPS))
        return cls(
            columns=columns,
            constants={name: _number_or_text(text) for name, text in constants.items()},
            clean=() if steps.strip() == "none" else tuple(_parts(steps)),
            **given,
        )

    def as_settings(self) -> dict[str, Setting]:
        """Return what differs from the default as texts, for the provenance of a model."""
        settings: dict[str, Setting] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if value == getattr(ReadOptions(), item.name):
                continue
            if isinstance(value, Mapping):
                value = ",".join(f"{name}={one}" for name, one in value.items())
            elif isinstance(value, tuple):
                value = ",".join(value) or "none"
            settings[PREFIX + item.name] = value
        return settings

    def read(self, paths: Sequence[PathLike], progress: Progress | None = None) -> Loops:
        """Read and clean loops.

        Parameters
        ----------
        paths : sequence of path-like
            Files and folders.
        progress : callable, optional
            Called with bytes read and file size.

        Returns
        -------
        Loops
            With notes and repairs.

        Raises
        ------
        InputError
            As :func:`anhyst.data.reading.read_loops`, or an unknown cleaning step.
        """
        clean_steps = tuple(self.clean)
        loops = read_loops(
            paths,
            columns=self.columns,
            history=self.history,
            schedule=self.schedule,
            loop=self.loop,
            constants=self.constants,
            sidecar=self.sidecar,
            progress=progress,
        )
        return clean(loops, clean_steps)


def with_read_options(model: Model, options: ReadOptions) -> Model:
    """Return the model with a note in its provenance of how its measurements were read."""
    origin = model.provenance
    settings = dict(origin.settings) | options.as_settings()
    return replace(model, provenance=replace(origin, settings=settings))


def read_sources(model: Model, folder: PathLike = ".") -> Loops:
    """Read the measurements of a model again, exactly as for its identification.

    Parameters
    ----------
    model : Model
        The model; its provenance names files, hashes and options.
    folder : path-like
        Where else to look for the files, such as the folder of the model file.

    Returns
    -------
    Loops
        The loops.

    Raises
    ------
    InputError
        The model names no files, or one is missing or has changed.
    """
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
        raise InputError(
            f"provenance.settings.{PREFIX}{min(unknown)}: is unknown; remove it",
            code="extra-forbidden",
        )
    options = ReadOptions.from_text(**kept)
    return options.read([_find(source.path, source.sha256, Path(folder)) for source in sources])


def _find(path: str, sha256: str, folder: Path) -> Path:
    places = [Path(path), folder / path, folder / Path(path).name]
    there = [place for place in places if place.is_file()]
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


def _parts(text: str) -> list[str]:
    return [part for part in (piece.strip() for piece in text.split(",")) if part]


def _pairs(text: str, what: str) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for part in _parts(text):
        name, equals, value = (piece.strip() for piece in part.rpartition("="))
        if not equals or not name:
            raise InputError(
                f"{what}: '{part}' is not of the form name=value", code="not-name-value", key=what
            )
        if name in pairs:
            raise InputError(
                f"{what}: '{name}' is given twice; keep one", code="name-twice", key=name
            )
        pairs[name] = value
    return pairs


def _number_or_text(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
