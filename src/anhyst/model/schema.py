"""What a model file may hold: its tables, their types, and keys that carry units."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, FiniteFloat, PlainValidator, create_model
from pydantic_core import PydanticCustomError

from anhyst.data.output_map import output_map
from anhyst.laws import LAWS
from anhyst.laws.law import Law
from anhyst.model.fit_record import (
    FitFigures,
    Provenance,
    ReductionStep,
    Uncertainty,
    ValidRange,
    is_number,
    of_output,
)
from anhyst.model.parameters import specs_of
from anhyst.support.toml_file import Table
from anhyst.support.units import Quantity

# ruff: noqa: RUF012 - pydantic gives every table its own copy of a default


def _number(value: Any) -> Any:
    """Accept a number or a list of numbers; one finding, whatever is wrong."""
    if is_number(value) or (isinstance(value, list) and value and all(map(is_number, value))):
        return value
    raise PydanticCustomError("not_a_number", "must be a finite number, or one for each node")


def _law(name: str) -> str:
    if name not in LAWS:
        known = [repr(law) for law in LAWS]
        raise PydanticCustomError(
            "unknown_choice", f"Input should be {', '.join(known[:-1])} or {known[-1]}"
        )
    return name


LawName = Annotated[str, AfterValidator(_law)]
Number = Annotated[float | list[float], PlainValidator(_number)]


class QuantityTable(Table):
    """``[input]``, ``[output]``: what is measured, its symbol and its SI unit."""

    quantity: str
    symbol: str
    unit: str


class ScheduleTable(QuantityTable):
    """``[schedule]``: the scheduling variable and its nodes."""

    nodes: list[FiniteFloat] = []


class CellsTable(Table):
    """``[cells]``: the cells of a law that has some, a row of weights for each threshold."""

    shape: Literal["tanh", "langevin"]
    thresholds: list[FiniteFloat]
    widths: list[FiniteFloat]
    weights: list[list[FiniteFloat]]


class DynamicsTable(Table):
    """``[dynamics]``: lag and creep."""

    lag: FiniteFloat = 0.0
    creep_times: list[FiniteFloat] = []
    creep_shares: list[FiniteFloat] = []
    fastest: FiniteFloat = 0.0


class LayersTable(Table):
    """``[layers]``: how solid iron is cut."""

    count: int
    surface: FiniteFloat
    laminated: FiniteFloat = 0.0


class ModelTable(Table):
    """The whole file, its keys without units."""

    format: Literal["anhyst-model"]
    version: Literal[1]
    name: str
    law: LawName
    gap_map: Literal["none", "scaling", "reluctance", "circuit", "free"]
    history: str
    input: QuantityTable
    output: QuantityTable
    schedule: ScheduleTable | None = None
    parameters: dict[str, Any]
    cells: CellsTable | None = None
    dynamics: DynamicsTable | None = None
    layers: LayersTable | None = None
    valid: ValidRange | None = None
    fit: FitFigures | None = None
    uncertainty: Uncertainty | None = None
    reduction: list[ReductionStep] = []
    provenance: Provenance = Provenance()


def model_table(law: Law | None) -> type[ModelTable]:
    """Return the whole file with the parameters of its law: one number, or one for each node."""
    if law is None:
        return ModelTable  # which then refuses the law
    fields: dict[str, Any] = {
        spec.name: (Number, ... if spec.default is None else spec.default)
        for spec in specs_of(law).values()
    }
    parameters = create_model("ParameterTable", __base__=Table, **fields)
    return create_model("ModelTable", __base__=ModelTable, parameters=(parameters, ...))


FORMAT = "anhyst-model"
VERSION = 1

Names = dict[str, tuple[str, str]]
"""For each field of a table whose key carries a unit: the key without and with it."""


def column(name: str, unit: str) -> str:
    """Return a key with its unit, such as ``k_A_per_m``."""
    return Quantity("", name, unit).column


def parameter_names(law: Law | None, drive: Quantity, answer: Quantity) -> Names:
    """Return the keys of ``[parameters]`` for a law, if it is known, an input and an output."""
    power = output_map(answer).power
    turns = {"A": "c_H_per_m", "A/m": "c_H"}.get(drive.unit, f"c_H_A_per_m_{drive.unit}")
    ratio = column(f"c_{answer.symbol}", answer.unit) + f"_per_T{power if power > 1 else ''}"
    return {
        **{
            spec.name: (spec.name, column(spec.name, spec.unit) if spec.unit != "1" else spec.name)
            for spec in (law.parameters if law else ())
        },
        "rho": ("rho", "rho"),
        "c_H": ("c_H", turns),
        "gamma": ("gamma", "gamma_A_s_per_m_T"),
        "c_out": (f"c_{answer.symbol}", "c_B" if answer.unit == "T" else ratio),
        "in_0": (f"{drive.symbol}_0", column(f"{drive.symbol}_0", drive.unit)),
        "out_0": (f"{answer.symbol}_0", column(f"{answer.symbol}_0", answer.unit)),
    }


def section_names(
    law: Law | None, drive: Quantity, answer: Quantity, schedule: Quantity | None
) -> dict[tuple[str, ...], Names]:
    """Return the keys that carry units, table by table (``[[fit.loop]]`` as ``fit, loop``)."""
    deviations = {name: (name, column(name, answer.unit)) for name in of_output(FitFigures)}
    ranges = {"input": (drive.symbol, drive.column), "output": (answer.symbol, answer.column)}
    nodes: Names = {}
    if schedule is not None:
        ranges["schedule"] = (schedule.symbol, schedule.column)
        nodes["nodes"] = ("nodes", column("nodes", schedule.unit))
    at = {"schedule": ranges["schedule"]} if schedule is not None else {}
    return {
        ("schedule",): nodes,
        ("parameters",): parameter_names(law, drive, answer),
        ("cells",): {
            name: (name, column(name, "A/m")) for name in ("thresholds", "widths", "weights")
        },
        ("dynamics",): {
            "lag": ("lag", "lag_s"),
            "creep_times": ("creep_times", "creep_times_s"),
            "fastest": ("fastest", "fastest_Hz"),
        },
        ("valid",): ranges,
        ("fit",): deviations,
        ("fit", "loop"): deviations | at,
    }


def meant(key: str, names: Names) -> str | None:
    """Return the field that a key with a missing or another unit means, if any."""
    for field, (bare, full) in names.items():
        if key == full:
            continue
        if key in {field, bare} or (bare != full and key.startswith(f"{bare}_")):
            return field
    return None
