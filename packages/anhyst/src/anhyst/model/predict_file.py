"""Predict or invert a whole file: read a drive or a demand, compute, and write the result."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from anhyst.data.formats.channels import Texts
from anhyst.data.formats.text import write_csv
from anhyst.data.joining import NESTED_LOOPS_NOTE, add_earlier_loops
from anhyst.data.loops import Loop, Loops
from anhyst.data.output_map import OUTPUT_MAPS, full_scale, name_full_scale
from anhyst.data.path import SETTLED, History, HistoryLike, history_text
from anhyst.data.table import DataTable, check_source, read_columns
from anhyst.model.actuator import Model, resolve_model
from anhyst.model.predict import MIN_RUN_SAMPLES, SampleError, run_record
from anhyst.model.prediction import InputKind, flag_samples
from anhyst.support.atomic import PathLike, check_path, check_writable
from anhyst.support.errors import InputError, NegativeResult, wrong_type
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.result import Result, range_text
from anhyst.support.units import QUANTITIES
from anhyst.support.wording import word_for_reader

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from anhyst.support.units import Quantity

Rows = NDArray[np.intp]
Direction = Literal["predict", "invert"]
INPUT_KINDS: Mapping[Direction, InputKind] = {"predict": "drive", "invert": "demand"}
"""Input of the commands predict and invert, as their argument is named."""
_SOURCE_KINDS = "a file, Loops, a data frame or a dict of arrays"


@dataclass(frozen=True, slots=True)
class Deviation:
    """Deviation of the computed quantity from the measured quantity in the file, SI."""

    mean_abs: float
    rms: float
    worst: float
    largest: float  # full scale of relative deviations, as in the fit of a model
    of: str  # full scale in words: ``the largest force (24 N)``


@dataclass(frozen=True, slots=True, repr=False)
class RunSummary(Result):
    """Result of a prediction or inversion of a file or a data frame.

    Parameters
    ----------
    out : str or None
        The written file, if any.
    column, unit : str
        Header of the computed column and its unit.
    rows, runs : int
        Number of samples, and of runs that each start from the history.
    history : str
        Assumed history before each run.
    low, high : float
        Range of the computed quantity.
    outside : int
        Number of samples outside the valid range of the model (``valid`` is 0).
    deviation : Deviation or None
        From a column of the same quantity in the file, if there is one.
    warnings : tuple of str
        One sentence each.
    columns : mapping
        The columns that were read, the computed one and ``valid``.
    """

    out: str | None
    column: str
    unit: str
    rows: int
    runs: int
    history: str
    low: float
    high: float
    outside: int
    deviation: Deviation | None
    warnings: tuple[str, ...]
    columns: Mapping[str, Any] = field(default_factory=dict, compare=False)

    def facts(self) -> dict[str, str]:
        """Return the number of rows, the computed range, and samples outside the valid range."""
        return {
            "rows": str(self.rows),
            "history": self.history,
            self.column: range_text(self.low, self.high, self.unit),
            "outside the valid range": str(self.outside),
        }

    def to_columns(self) -> dict[str, Any]:
        """Return the columns that were read, the computed column and ``valid``."""
        return {
            name: column.as_list() if isinstance(column, Texts) else column
            for name, column in self.columns.items()
        }

    def draw(self, ax: Axes) -> None:
        """Draw the computed quantity over the rows."""
        ax.plot(self.columns[self.column], lw=1.1)
        ax.set_xlabel("row")
        ax.set_ylabel(self.column)

    def as_dict(self) -> dict[str, Any]:
        """Return the summary values, without the columns."""
        summary_values = asdict(replace(self, columns={}))
        del summary_values["columns"]
        return summary_values

    def save(self, path: PathLike) -> Path:
        """Write the columns to a CSV file, completely or not at all."""
        write_csv(path, self.columns)
        return Path(path)


def run_file(
    model: Model | PathLike,
    direction: Direction,
    source: PathLike | Any,
    out: PathLike | None,
    columns: Mapping[str, str] | None = None,
    scale: Mapping[str, float | str] | None = None,
    flip: Collection[str] | None = None,
    history: HistoryLike | None = None,
    progress: Progress | None = None,
) -> RunSummary:
    """Predict or invert a whole file or data frame: `anhyst.predict` and `anhyst.invert`.

    The columns of the file are copied; the computed quantity and ``valid`` (1 inside the valid
    range of the model, 0 outside) are added. Each loop of the column ``loop`` is a separate run, at
    each value of the scheduling variable. A file without ``loop`` is one run, except with the
    history ``settled``: then each part at one scheduling value is a cycle. If times and measured
    output show that cycles were run one after the other, each cycle keeps the history of the earlier ones.
    """
    if isinstance(source, Loops):
        source = source.to_columns()
    if isinstance(source, Model | list | tuple):
        raise wrong_type(f"{direction}: {INPUT_KINDS[direction]}", _SOURCE_KINDS, source)
    check_source(source, f"{direction}: {INPUT_KINDS[direction]}", _SOURCE_KINDS)
    if out is not None:
        check_path(out, f"{direction}: out")
        paths = [path for path in (model, source) if isinstance(path, str | os.PathLike)]
        check_writable(out, input_files=paths)
    model = resolve_model(model, direction)
    table = read_columns(source, columns, progress, scale, flip)
    history_option = history_text(model.history if history is None else history)
    computed_values, flux_linkage, is_valid, runs, warnings = _compute_runs(
        model, direction, table, history_option
    )
    computed_quantity = model.output if direction == "predict" else model.input
    name, computed_columns = _add_computed_columns(
        table, computed_quantity, computed_values, flux_linkage, is_valid
    )
    if out is not None:
        write_csv(out, computed_columns)
    return RunSummary(
        out=None if out is None else str(out),
        column=name,
        unit=computed_quantity.unit,
        rows=len(table),
        runs=len(runs),
        history=history_option,
        low=float(computed_values.min()),
        high=float(computed_values.max()),
        outside=int((~is_valid).sum()),
        deviation=_compute_deviation(table, computed_quantity, computed_values, runs),
        warnings=tuple(map(word_for_reader, warnings)),
        columns=computed_columns,
    )


def _compute_runs(
    model: Model, direction: Direction, table: DataTable, history: str
) -> tuple[FloatArray, FloatArray | None, NDArray[np.bool_], list[Rows], tuple[str, ...]]:
    """Compute all runs of a table: results, flux linkages, validity, the runs, and the warnings.

    There are flux linkages after a prediction with a model whose force was derived from them.
    """
    is_prediction, kind = direction == "predict", INPUT_KINDS[direction]
    quantity = model.input if is_prediction else model.output
    values = _read_inputs(model, direction, table, quantity)
    schedule = None if model.schedule is None else table.get(model.schedule.name)
    if schedule is None and model.schedule is not None:
        try:
            model.schedule_or_default(None)
        except InputError as error:
            raise InputError(
                f"{table.path}: {error}{table.advise_mapping(model.schedule.name)}",
                code=error.code,
                key=error.key,
            ) from None
    time = table.get("time") if model.needs_time else _read_measured(table, "time")
    runs = _find_runs(table, schedule, are_settled=history.startswith("settled"))
    histories = _find_histories(model, direction, table, runs, values, schedule, history)
    computed_values, reachable = np.empty(values.size), np.ones(values.size, dtype=np.bool_)
    flux_linkage = np.empty(values.size) if is_prediction and model.flux is not None else None
    notes: Counter[str] = Counter()
    for rows, history_before in zip(runs, histories, strict=True):
        run_schedule, clock = (None if column is None else column[rows] for column in (schedule, time))
        try:
            result = run_record(model, kind, values[rows], run_schedule, clock, history_before)
        except SampleError as error:
            raise InputError(
                f"{table.locate_row(int(rows[error.sample]))}: {quantity.name.replace('_', ' ')} "
                f"{error.fault}; stay closer to the valid range of the model",
                code="sample-refused",
            ) from error
        except (InputError, NegativeResult) as error:
            location = "" if rows.size == values.size else f": rows from {rows[0] + 1}"
            raise error.with_location(f"{table.path}{location}") from error
        computed_values[rows] = result.output if is_prediction else result.drive
        reachable[rows] = result.reachable
        if flux_linkage is not None and result.flux_linkage is not None:
            flux_linkage[rows] = result.flux_linkage
        notes.update(result.notes)
    drive, output = (values, computed_values) if is_prediction else (computed_values, values)
    is_valid, flags = flag_samples(model, kind, drive, output, schedule, reachable, time, runs)
    count = len(runs)
    lines = [text if count == 1 else f"{text} ({n} of {count} runs)" for text, n in notes.items()]
    lines += (
        [NESTED_LOOPS_NOTE] if any(history_before != histories[0] for history_before in histories) else []
    )
    return computed_values, flux_linkage, is_valid, runs, (*flags, *lines)


def _read_inputs(model: Model, direction: Direction, table: DataTable, quantity: Quantity) -> FloatArray:
    """Return the drive or the demand; a demanded flux linkage is converted to its force.

    The current of an even force is that of a positive flux linkage, so a negative flux linkage
    becomes a negative force, which is flagged.
    """
    name = _column_name(table, quantity)
    flux_name = QUANTITIES["flux_linkage"].name
    if direction == "predict" or model.flux is None or table.get(name) is not None:
        return table.require(name, quantity.column)
    psi = table.get(flux_name)
    if psi is None:
        return table.require(name, f"{quantity.column} or {QUANTITIES['flux_linkage'].column}")
    schedule = None if model.schedule is None else table.get(model.schedule.name)
    gaps = np.full(psi.size, model.schedule_or_default(None)) if schedule is None else schedule
    return np.asarray(np.copysign(model.flux.force(psi, gaps), psi))


def _find_histories(
    model: Model,
    direction: Direction,
    table: DataTable,
    runs: list[Rows],
    values: FloatArray,
    schedule: FloatArray | None,
    history: str,
) -> list[History]:
    """Return the history of each run.

    If times and measured output show that steady-state runs followed one another, each includes the
    earlier runs.
    """
    history_before = History.parse(history)
    measured_output, time = (
        _read_measured(table, _column_name(table, model.output)),
        _read_measured(table, "time"),
    )
    if history_before != SETTLED or direction == "invert" or measured_output is None or time is None:
        return [history_before] * len(runs)
    loops = []
    try:
        for index, rows in enumerate(runs):
            run_schedule = None if schedule is None else schedule[rows]
            loops.append(Loop(str(index), values[rows], measured_output[rows], run_schedule, time[rows]))
    except InputError:  # some run is not a loop
        return [history_before] * len(runs)
    is_gap = model.schedule is not None and model.schedule.name == "gap"
    return [loop.history for loop in add_earlier_loops(loops, across_gaps=is_gap)]


def _column_name(table: DataTable, quantity: Quantity) -> str:
    """Return the name of a quantity in a table; magnetised materials may use another name."""
    names = {quantity.name} | {
        name for name, kind in OUTPUT_MAPS.items() if kind.magnetised_name == quantity.name
    }
    table_quantities = {header.quantity.name for header in table.headers if header.quantity is not None}
    return next((name for name in sorted(names) if name in table_quantities), quantity.name)


def _read_measured(table: DataTable, name: str) -> FloatArray | None:
    try:
        return table.get(name)
    except InputError:  # an unused column may be invalid
        return None


def _find_runs(table: DataTable, schedule: FloatArray | None, *, are_settled: bool) -> list[Rows]:
    """Return the rows of each run, in the order of the file."""
    for header, column in zip(table.headers, table.columns, strict=True):
        if header.is_label and isinstance(column, Texts):
            return [run for rows in column.rows_by_text() for run in _split_by_schedule(schedule, rows)]
    all_rows = np.arange(len(table))
    return _split_by_schedule(schedule, all_rows) if are_settled else [all_rows]


def _split_by_schedule(schedule: FloatArray | None, rows: Rows) -> list[Rows]:
    """Split rows at steps of the scheduling variable; if it moves, the rows stay together."""
    if schedule is None:
        return [rows]
    steps = np.flatnonzero(np.diff(schedule[rows])) + 1
    if not steps.size or rows.size < MIN_RUN_SAMPLES * (steps.size + 1):
        return [rows]
    return np.split(rows, steps)


def _add_computed_columns(
    table: DataTable,
    quantity: Quantity,
    computed_quantity: FloatArray,
    flux_linkage: FloatArray | None,
    is_valid: NDArray[np.bool_],
) -> tuple[str, dict[str, Any]]:
    """Return the header of the computed column, and all columns including computed ones."""
    columns: dict[str, FloatArray | NDArray[np.bool_] | Texts] = dict(table.as_columns())
    name = _free_header(columns, quantity)
    added: dict[str, Any] = {name: computed_quantity}
    if flux_linkage is not None:
        added[_free_header(columns, QUANTITIES["flux_linkage"])] = flux_linkage
    added["valid_model" if "valid" in columns else "valid"] = is_valid
    for header in added:
        if header in columns:
            text = f"{table.path}: already has a column '{header}'; rename it in the file"
            raise InputError(text, code="exists-already", key=header)
    return name, columns | added


def _free_header(columns: Mapping[str, Any], quantity: Quantity) -> str:
    """Return the header of a computed quantity, next to a measured one if there is one."""
    if quantity.column not in columns:
        return quantity.column
    return f"{quantity.symbol}_model{quantity.column.removeprefix(quantity.symbol)}"


def _compute_deviation(
    table: DataTable, quantity: Quantity, predicted_values: FloatArray, runs: list[Rows]
) -> Deviation | None:
    measured_values = _read_measured(table, _column_name(table, quantity))
    if measured_values is None:
        return None
    differences = np.abs(predicted_values - measured_values)
    largest_value = full_scale(quantity, (measured_values[rows] for rows in runs))
    mean, rms = float(differences.mean()), float(np.sqrt(np.square(differences).mean()))
    scale_name = name_full_scale(quantity, largest_value)
    return Deviation(mean, rms, float(differences.max()), largest_value, scale_name)
