"""Read a model file, check every key, and report all errors together."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from anhyst.data.path import History
from anhyst.laws import LAWS, get_law
from anhyst.laws.cells import CellWeights
from anhyst.laws.law import Law
from anhyst.model import schema
from anhyst.model.dynamics import Dynamics, EddyCircuit, Layers
from anhyst.model.model_data import ModelData
from anhyst.model.parameters import Parameter, find_problems
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.kinds import MODEL_FILE
from anhyst.support.toml_file import Advice, TomlFile, check_kind, explain_finding
from anhyst.support.toml_text import KeyPath
from anhyst.support.units import QUANTITIES, Quantity, find_unit

Record = TypeVar("Record", bound=ModelData)


def read_as(path: PathLike, kind: type[Record]) -> Record:
    """Read and check a model file; see :func:`anhyst.model.actuator.read_model`."""
    return _Reader(TomlFile(path)).read(kind)


class _Reader:
    """Converts the content of a file to a model, and collects errors."""

    def __init__(self, file: TomlFile) -> None:
        self.file = file
        self.names: dict[tuple[str, ...], schema.Names] = {}

    def read(self, kind: type[Record]) -> Record:
        content = self.file.content
        check_kind(self.file, [MODEL_FILE])
        if (version := content.get("version")) != schema.VERSION:
            text = f"is {version!r}, but this anhyst reads version {schema.VERSION}; update anhyst"
            if version is None:
                text = f"is missing; a file of this anhyst says version = {schema.VERSION}"
            self.file.add_problem(("version",), text, code="wrong-version")
        self._raise_if_problems()
        drive, output_quantity, schedule = (
            self._read_quantity(content, key) for key in ("input", "output", "schedule")
        )
        self._raise_if_problems()
        assert drive is not None
        assert output_quantity is not None
        name = content.get("law")
        law = LAWS.get(name) if isinstance(name, str) else None
        self.names = schema.section_names(None, drive, output_quantity, schedule)
        cells = self._read_cells(content)
        if law is not None and cells is not None:
            with self._collect_table_error("cells"):
                law = get_law(law.name, cells)
            self._raise_if_problems()
        self.names = schema.section_names(law, drive, output_quantity, schedule)
        self._strip_units(content, ())
        try:
            table = schema.model_table(law).model_validate(content)
        except ValidationError as error:
            self._collect_findings(error)
            table = None
        self._check_ranges(content, law)
        self._raise_if_problems()
        assert table is not None
        return self._build_model(kind, table, drive, output_quantity, schedule, cells)

    def _read_cells(self, content: dict[str, Any]) -> CellWeights | None:
        """Read the table of play cells first, because it determines the remaining parameters."""
        table_text = deepcopy(content.get("cells"))
        if table_text is None:
            return None
        self._strip_units(table_text, ("cells",))
        self._raise_if_problems()
        try:
            table = schema.CellsTable.model_validate(table_text)
        except ValidationError as error:
            self._collect_findings(error, ("cells",))
            self._raise_if_problems()
            raise
        rows = {len(row) for row in table.weights}
        if rows != {len(table.widths)} or len(table.weights) != len(table.thresholds):
            text = (
                f"must be {len(table.thresholds)} rows of {len(table.widths)}, one row for each "
                "threshold and one column for each width"
            )
            self.file.add_problem(self._file_path(("cells", "weights")), text, code="wrong-shape")
            self._raise_if_problems()
        thresholds, curve_widths, weights = map(np.array, (table.thresholds, table.widths, table.weights))
        curve_centres, cells = None if table.centres is None else np.array(table.centres), None
        with self._collect_table_error("cells"):
            cells = CellWeights(thresholds, curve_widths, weights, table.shape, curve_centres)
        self._raise_if_problems()
        return cells

    @contextmanager
    def _collect_table_error(self, key: str) -> Iterator[None]:
        """Collect the error of a table, without the location in its text."""
        try:
            yield
        except InputError as error:
            text = str(error).removeprefix(f"model {key}: ")
            self.file.add_problem(
                (key, error.key) if key in {"layers", "eddy_circuit"} else (key,), text, code=error.code
            )
        except ValueError as error:
            self.file.add_problem((key,), str(error), code="cells-out-of-range")

    def _read_quantity(self, content: dict[str, Any], key: str) -> Quantity | None:
        quantity_table = content.get(key)
        if quantity_table is None and key == "schedule":
            return None
        if quantity_table is None:
            self.file.add_problem((key,), "is missing; add this table", code="missing")
            return None
        if isinstance(quantity_table, dict):
            quantity_table = {
                k: v for k, v in quantity_table.items() if k in schema.QuantityTable.model_fields
            }
        try:
            table = schema.QuantityTable.model_validate(quantity_table)
        except ValidationError as error:
            self._collect_findings(error, (key,))
            return None
        quantity = Quantity(table.quantity, table.symbol, table.unit)
        known_quantity = QUANTITIES.get(quantity.name)
        unit = find_unit(quantity.unit)
        symbol = known_quantity.unit if known_quantity else unit.si if unit else None
        if symbol is None:
            text = f"unknown unit {quantity.unit!r}; write an SI unit"
            self.file.add_problem((key, "unit"), text, code="unknown-unit")
        elif quantity.unit != symbol:
            text = f"is {quantity.unit!r}; model files are in SI, write {symbol!r}"
            self.file.add_problem((key, "unit"), text, code="unit-not-si")
        return quantity

    def _strip_units(self, table: Any, path: KeyPath) -> None:
        """Rename keys with units to fields, in place; report keys without their unit."""
        if isinstance(table, list):
            for index, item in enumerate(table):
                self._strip_units(item, (*path, index))
        if not isinstance(table, dict):
            return
        names = self._names_of_table(path)
        field_by_key = {key: field for field, (_, key) in names.items()}
        for key in list(table):
            if key in field_by_key:
                table[field_by_key[key]] = table.pop(key)
            elif field := schema.find_field(key, names):
                text = f"the key must contain its unit; write {names[field][1]}"
                self.file.add_problem((*path, key), text, code="unit-missing")
                table[field] = table.pop(key)
        for key, value in table.items():
            self._strip_units(value, (*path, key))

    def _collect_findings(self, error: ValidationError, path: tuple[str, ...] = ()) -> None:
        self.file.add_findings(error, self._find_advice, lambda location: self._file_path((*path, *location)))

    def _find_advice(self, path: KeyPath, finding: Any) -> Advice:
        advice = explain_finding(finding)
        if advice.code != "extra-forbidden":
            return advice
        known_keys = [key for _, key in self._names_of_table(path[:-1]).values()]
        close_matches = difflib.get_close_matches(str(path[-1]), known_keys, n=1)
        if not close_matches:
            return advice
        return Advice(f"is unknown; did you mean {close_matches[0]}?", code="extra-forbidden")

    def _names_of_table(self, table: KeyPath) -> schema.Names:
        """Return the keys of a table, with units; all elements of an array share its keys."""
        return self.names.get(tuple(key for key in table if isinstance(key, str)), {})

    def _file_path(self, location: KeyPath) -> KeyPath:
        """Return the path in the file of a location in the validated tables."""
        *table, last_key = location
        names = self._names_of_table(tuple(table))
        return (*table, names[last_key][1] if last_key in names else last_key)

    def _check_ranges(self, content: dict[str, Any], law: Law | None) -> None:
        """Check values for conditions that types cannot express, if all types are correct."""
        parameters = content.get("parameters")
        if self.file.problems or law is None or not isinstance(parameters, dict):
            return
        values: dict[str, Parameter] = {
            name: tuple(float(v) for v in value) if isinstance(value, list) else float(value)
            for name, value in parameters.items()
        }
        nodes = content.get("schedule", {}).get("nodes", [])
        key_paths = {"gap_map": ("gap_map",), "nodes": ("schedule", "nodes")}
        for problem in find_problems(law, values, nodes, content["gap_map"]):
            key_path = key_paths.get(problem.key, ("parameters", problem.key))
            self.file.add_problem(self._file_path(key_path), problem.text, code=problem.code)
        for key, limits in content.get("valid", {}).items():
            if isinstance(limits, list) and limits[0] > limits[1]:
                text = "the first must not exceed the second"
                self.file.add_problem(self._file_path(("valid", key)), text, code="range-reversed")
        if "schedule" in content.get("valid", {}) and "schedule" not in content:
            text = "has a range of a scheduling variable, but there is no [schedule]; remove the range"
            self.file.add_problem(("valid",), text, code="no-schedule")
        if (uncertainty := content.get("uncertainty")) is not None:
            self._check_lengths(uncertainty)

    def _check_lengths(self, uncertainty_table: dict[str, Any]) -> None:
        count = len(uncertainty_table["names"])
        matrix = uncertainty_table.get("correlation", [])
        for key, lengths in (
            ("values", [len(uncertainty_table["values"])]),
            ("std", [len(uncertainty_table["std"])]),
            ("correlation", [len(matrix), *map(len, matrix)] if matrix else [count]),
        ):
            if set(lengths) != {count}:
                text = f"must have one entry for each of {count} names"
                self.file.add_problem(("uncertainty", key), text, code="length-differs")

    def _build_model(
        self,
        kind: type[Record],
        table: schema.ModelTable,
        drive: Quantity,
        output_quantity: Quantity,
        schedule: Quantity | None,
        cells: CellWeights | None,
    ) -> Record:
        dynamics, layers, eddy_circuit, dynamics_table = None, None, None, table.dynamics
        with self._collect_table_error("history"):
            history = History.parse(table.history)
        if dynamics_table is not None:
            times, shares = tuple(dynamics_table.creep_times), tuple(dynamics_table.creep_shares)
            with self._collect_table_error("dynamics"):
                dynamics = Dynamics(dynamics_table.lag, times, shares, dynamics_table.fastest)
        if table.layers is not None:
            with self._collect_table_error("layers"):
                layers = Layers(**dict(table.layers))
        if table.eddy_circuit is not None:
            with self._collect_table_error("eddy_circuit"):
                eddy_circuit = EddyCircuit(**dict(table.eddy_circuit))
        self._raise_if_problems()
        model = kind(
            name=table.name,
            input=drive,
            output=output_quantity,
            parameters={
                name: tuple(value) if isinstance(value, list) else value
                for name, value in dict(table.parameters).items()
            },
            law=table.law,
            gap_map=table.gap_map,
            schedule=schedule,
            nodes=tuple(table.schedule.nodes) if table.schedule else (),
            history=history,
            valid=table.valid,
            fit=table.fit,
            uncertainty=table.uncertainty,
            reduction=tuple(table.reduction),
            provenance=table.provenance,
            cells=cells,
            dynamics=dynamics,
            layers=layers,
            eddy_circuit=eddy_circuit,
            flux=table.flux,
        )
        with self._collect_table_error("parameters"):
            for node in model.nodes if model.needs_fixed_gap else (None,):
                model.iron_at(node)
        self._raise_if_problems()
        return model

    def _raise_if_problems(self) -> None:
        if self.file.problems:
            raise self.file.to_error()
