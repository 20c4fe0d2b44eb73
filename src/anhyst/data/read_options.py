"""How measurements are read, where their headers and sidecars do not say it all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

from anhyst.data.clean import DEFAULT_STEPS, clean
from anhyst.data.loops import Loops
from anhyst.data.reading import read_loops
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress

PREFIX = "read_"
"""Settings of the provenance that say how the measurements were read begin with this."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How measurements are read, where their headers and sidecars do not say it all."""

    columns: Mapping[str, str] = field(default_factory=dict)  # column of the file to our column
    # our column to what it is throughout
    constants: Mapping[str, float | str] = field(default_factory=dict)
    schedule: str | None = None  # the scheduling variable; the column that distinguishes loops
    loop: str | None = None
    history: str | None = None  # what happened before the first sample
    sidecar: str | None = None  # TOML file that describes all the files
    clean: tuple[str, ...] = DEFAULT_STEPS  # cleaning steps, in their order

    @classmethod
    def from_text(cls, **texts: str | None) -> ReadOptions:
        """Read the options from texts, as on the command line and in a model file."""
        options = {name: text for name, text in texts.items() if text is not None}
        columns = _pairs(options.pop("columns", ""), "columns")
        constants = _pairs(options.pop("constants", ""), "constants")
        steps = options.pop("clean", ",".join(DEFAULT_STEPS))
        return cls(
            columns=columns,
            constants={name: _number_or_text(text) for name, text in constants.items()},
            clean=() if steps.strip() == "none" else tuple(_parts(steps)),
            **options,
        )

    def as_settings(self) -> dict[str, str | bool | int | float]:
        """Return what differs from the default as texts, for the provenance of a model."""
        settings: dict[str, str | bool | int | float] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if value == getattr(ReadOptions(), item.name):
                continue
            if isinstance(value, Mapping):
                value = ",".join(f"{name}={text}" for name, text in value.items())
            elif isinstance(value, tuple):
                value = ",".join(value) or "none"
            settings[PREFIX + item.name] = value
        return settings

    def read(self, paths: Sequence[PathLike], progress: Progress | None = None) -> Loops:
        """Read and clean loops."""
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
