"""Save the active parameters as a named set in a folder, and read such parameter sets."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from anhyst.support.atomic import atomic_writer, json_text
from anhyst.support.errors import InputError
from anhyst_rigs.rig.bench.protocol import Parameter

FILE_SUFFIX = ".parameters.json"

_FORMAT = "anhyst-parameters"
_NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,59}")
_MAX_SETS = 200
_MAX_FILE_BYTES = 1 << 20


class ParameterSets:
    """The parameter sets in a folder; :attr:`names` lists those whose parameters a bench has."""

    def __init__(self, folder: Path, parameters: Sequence[Parameter]) -> None:
        self._folder = folder
        self.names: tuple[str, ...] = ()
        self.list_names(parameters)

    def save(self, name: str, parameters: Sequence[Parameter]) -> None:
        """Save the active values as a set with a new name."""
        path = self._set_path(name)
        if path.exists():
            raise InputError(f"{path.name}: exists already; choose a new name", code="exists-already")
        if len(self._names_of_files()) >= _MAX_SETS:
            raise InputError(
                f"sets: {_MAX_SETS} are in the folder; remove some of their files",
                code="too-many-sets",
                key="sets",
            )
        values = {entry.name: {"value": entry.value, "unit": entry.unit} for entry in parameters}
        saved = datetime.now(UTC).isoformat(timespec="seconds")
        content = {"format": _FORMAT, "version": 1, "saved": saved, "parameters": values}
        with atomic_writer(path) as file:
            file.write(json_text(content))
        self.list_names(parameters)

    def read(self, name: str) -> dict[str, dict[str, Any]]:
        """Return the value and the unit of each parameter in a set, by parameter name."""
        path = self._set_path(name)
        try:
            with path.open(encoding="utf-8") as file:
                content = json.loads(file.read(_MAX_FILE_BYTES))
        except OSError as error:
            raise InputError(f"{path.name}: {error.strerror}", code="cannot-be-read") from None
        except ValueError:
            content = None
        if not isinstance(content, dict) or content.get("format") != _FORMAT:
            raise InputError(f"{path.name}: is no parameter set", code="not-a-parameter-set")
        values = content.get("parameters")
        if not isinstance(values, dict):
            raise InputError(f"{path.name}: parameters: are missing", code="missing", key="parameters")
        return {str(key): _read_entry(path.name, key, entry) for key, entry in values.items()}

    def _set_path(self, name: str) -> Path:
        if not _NAME_PATTERN.fullmatch(name):
            raise InputError(
                "set: a name may contain letters, digits, blanks, points, _ and -, but no folder",
                code="bad-name",
                key="set",
            )
        return self._folder / f"{name}{FILE_SUFFIX}"

    def list_names(self, parameters: Sequence[Parameter]) -> None:
        """List the sets again that contain only parameters of a bench, with the same units."""
        self.names = tuple(name for name in self._names_of_files() if self._suits(name, parameters))

    def _suits(self, name: str, parameters: Sequence[Parameter]) -> bool:
        try:
            changed_values(parameters, self.read(name))
        except InputError:
            return False
        return True

    def _names_of_files(self) -> list[str]:
        names = (path.name.removesuffix(FILE_SUFFIX) for path in self._folder.glob(f"*{FILE_SUFFIX}"))
        return sorted(name for name in names if _NAME_PATTERN.fullmatch(name))[:_MAX_SETS]


def _read_entry(file: str, key: object, entry: object) -> dict[str, Any]:
    value = entry.get("value") if isinstance(entry, Mapping) else None
    unit = entry.get("unit") if isinstance(entry, Mapping) else None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not math.isfinite(float(str(value))) or not isinstance(unit, str):
        raise InputError(f"{file}: {key}: has no value with a unit", code="no-value-with-unit")
    return {"value": value, "unit": unit}


def changed_values(
    parameters: Sequence[Parameter], saved: Mapping[str, Mapping[str, Any]]
) -> dict[str, float]:
    """Return the values in a set that differ from the active ones."""
    current = {parameter.name: parameter for parameter in parameters}
    for name, saved_value in saved.items():
        if name not in current:
            raise InputError(
                f"set: this rig has no parameter '{name}'; choose a set of this rig",
                code="unknown-parameter",
                key=name,
            )
        if saved_value["unit"] != current[name].unit:
            raise InputError(
                f"set: {name}: is in {saved_value['unit'] or 'no unit'}, here it is in "
                f"{current[name].unit or 'no unit'}",
                code="units-differ",
                key=name,
            )
    return {
        name: saved_value["value"]
        for name, saved_value in saved.items()
        if saved_value["value"] != current[name].value
    }
