"""Additional information about a file, from arguments or from a TOML file next to it (sidecar)."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from anhyst.data.path import History, HistoryLike
from anhyst.support.atomic import PathLike, read_error
from anhyst.support.errors import InputError

DROP_INVALID = "invalid"
"""Value of ``drop``: omit samples that are not finite or that the recorder marks as invalid."""


@dataclass(frozen=True, slots=True)
class FileDescription:
    """Information from arguments or a sidecar file that completes the headers of files."""

    columns: Mapping[str, str] = field(default_factory=dict)
    loop: str | None = None
    schedule: str | None = None
    history: History | None = None
    histories: Mapping[str, History] = field(default_factory=dict)
    constants: Mapping[str, float | str] = field(default_factory=dict)
    select: Mapping[str, tuple[str | float, ...]] = field(default_factory=dict)
    file_name: str | None = None
    scale: Mapping[str, float | str] = field(default_factory=dict)
    flip: tuple[str, ...] = ()
    drop: str | None = None

    def __post_init__(self) -> None:
        if self.drop not in (None, DROP_INVALID):
            raise InputError(
                f"drop: '{self.drop}' is not known; there is: {DROP_INVALID}", code="unknown-drop", key="drop"
            )

    @classmethod
    def from_arguments(
        cls,
        *,
        history: HistoryLike | None = None,
        select: Mapping[str, object] | None = None,
        flip: Sequence[str] | str | None = None,
        **other_keywords: Any,
    ) -> FileDescription:
        """Return the description from keywords of `read_loops`; ``others`` are named as the fields."""
        for name in ("columns", "constants", "scale"):
            other_keywords[name] = dict(other_keywords.get(name) or {})
        return cls(
            history=None if history is None else History.of(history),
            select={name: _as_choices(name, value) for name, value in (select or {}).items()},
            flip=(flip,) if isinstance(flip, str) else tuple(flip or ()),
            **other_keywords,
        )

    @classmethod
    def from_toml(cls, path: PathLike) -> FileDescription:
        """Read a sidecar file.

        Keys: ``columns`` (table: file column = our column), ``loop`` (name of the label column),
        ``schedule``, ``history`` (text, or a table: label = text), ``constants`` (table: ``T_C =
        -15``), ``select`` (table: column = value or list of values), ``file_name`` (pattern such as
        ``"gd_T{T_C}C"`` for constants in the file name), ``scale`` (table: column = value in our
        unit per unit of the file), ``flip`` (columns whose sign is reversed), ``drop``
        (``"invalid"``).
        """
        path = Path(path)
        keys = _load_toml(path)
        kinds = {
            "columns": dict,
            "loop": str,
            "schedule": str,
            "history": str | dict,
            "constants": dict,
            "select": dict,
            "file_name": str,
            "scale": dict,
            "flip": str | list,
            "drop": str,
        }
        try:
            for key, value in keys.items():
                if key not in kinds:
                    raise InputError(
                        f"key '{key}' is not known; use {', '.join(kinds)}", code="extra-forbidden", key=key
                    )
                _check_kind(key, value, kinds[key])
            _check_members("columns", keys, str)
            _check_members("constants", keys, int | float | str)
            _check_members("scale", keys, int | float)
            for name in keys.get("flip", []):
                _check_kind("flip", name, str)
            arguments = dict(keys)
            history = arguments.pop("history", None)
            description = cls.from_arguments(**arguments)
            if isinstance(history, dict):
                _check_members("history", keys, str)
                history_by_label = {label: History.parse(text) for label, text in history.items()}
                return replace(description, histories=history_by_label)
            return replace(description, history=History.parse(history) if history else None)
        except InputError as error:
            raise error.with_location(path) from None

    def with_defaults(self, defaults: FileDescription) -> FileDescription:
        """Combine with another description; entries of this description take precedence."""
        if self.history is not None:
            defaults = replace(defaults, histories={})
        merged_fields: dict[str, Any] = {}
        for description_field in fields(self):
            own_value, default_value = (
                getattr(self, description_field.name),
                getattr(defaults, description_field.name),
            )
            merged_fields[description_field.name] = (
                {**default_value, **own_value} if isinstance(own_value, dict) else own_value or default_value
            )
        return FileDescription(**merged_fields)


def is_sidecar(path: Path) -> bool:
    """Whether a TOML file exists and describes measurements; a model file has a ``format``."""
    return path.is_file() and "format" not in _load_toml(path)


def _load_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise read_error(path, error) from None
    except (ValueError, RecursionError) as error:  # invalid TOML, invalid UTF-8, very long numbers
        raise InputError(
            f"{path}: is not valid TOML: {error}; correct or remove it", code="damaged-toml"
        ) from None


def _check_kind(key: str, value: object, kind: Any) -> None:
    if not isinstance(value, kind) or isinstance(value, bool):
        raise InputError(
            f"key '{key}' is of the wrong kind: {value!r}; see the reference", code="wrong-kind", key=key
        )


def _check_members(key: str, keys: Mapping[str, Any], kind: Any) -> None:
    for name, value in keys.get(key, {}).items():
        _check_kind(f"{key}.{name}", value, kind)


def _as_choices(name: str, value: object) -> tuple[str | float, ...]:
    values = value if isinstance(value, list | tuple) else (value,)
    for choice in values:
        _check_kind(f"select.{name}", choice, str | int | float)
    return tuple(values)
