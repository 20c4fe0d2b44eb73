"""What a model file may hold: its tables, their types, and keys that carry units.

Fit figures, uncertainty, reduction and provenance are plain records, and tables of the file at once: a
field that is added here is read, checked and written. Identification fills them, the report shows them.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Annotated, Any, Literal, get_type_hints

import numpy as np
from pydantic import AfterValidator, Field, FiniteFloat, PlainValidator, Strict, create_model
from pydantic_core import PydanticCustomError

from anhyst.data.loops import Loops, Source
from anhyst.data.output_map import full_scale, output_map
from anhyst.data.verdict import largest_output
from anhyst.laws import LAWS
from anhyst.laws.law import Law
from anhyst.model.parameters import parameter_specs
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.toml_file import TUPLE_FROM_LIST, FileRecord, Table
from anhyst.support.units import Quantity

OUTPUT_UNIT_MARK = object()
"""Beside the type of a field that is in units of the output: its key in the file carries them."""

FiniteNumber = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Output = Annotated[FiniteNumber, OUTPUT_UNIT_MARK]
Whole = Annotated[int, Strict()]
Truth = Annotated[bool, Strict()]
Range = Annotated[tuple[FiniteNumber, FiniteNumber], TUPLE_FROM_LIST]
Numbers = Annotated[tuple[FiniteNumber, ...], TUPLE_FROM_LIST]
Texts = Annotated[tuple[str, ...], TUPLE_FROM_LIST]
Unbounded = Annotated[tuple[Annotated[float, Strict()], ...], TUPLE_FROM_LIST]
"""Numbers that may be infinite."""


def output_fields(record: type[FileRecord]) -> list[str]:
    """Return the fields of a record that are in units of the output."""
    hints = get_type_hints(record, include_extras=True)
    return [
        name
        for name, hint in hints.items()
        if OUTPUT_UNIT_MARK in getattr(hint, "__metadata__", ())
    ]


def is_number(value: object) -> bool:
    """Whether a value of a file is a finite number."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    return abs(value) <= sys.float_info.max  # comparing, an integer may be of any size


def _setting(value: Any) -> Any:
    if isinstance(value, str | bool) or is_number(value):
        return value
    raise PydanticCustomError("not_a_setting", "must be a text, a truth value or a finite number")


Setting = Annotated[str | bool | int | float, PlainValidator(_setting)]

CHOSEN = "chosen"
"""Note of the candidate that became the model."""


@dataclass(frozen=True, slots=True)
class ValidRange(FileRecord):
    """Where the model was seen to hold; outside it computes, but every sample is flagged."""

    input: Range  # smallest and largest measured value, SI
    output: Range
    # smallest and largest value of the scheduling variable, SI; None without one
    schedule: Range | None = None


@dataclass(frozen=True, slots=True)
class LoopFit(FileRecord):
    """How far model and measurement are apart on one loop; deviations in units of the output."""

    label: str  # label of the loop in its file
    # scheduling variable of the loop, SI; files of a model without one have none
    schedule: Annotated[FiniteNumber | None, Field(default=None)]
    samples: Whole  # number of samples compared
    largest_output: Output  # full scale of this loop alone, SI
    mean_abs: Output  # mean absolute (eq. 16), root mean square and largest absolute deviation, SI
    rms: Output
    worst: Output


@dataclass(frozen=True, slots=True)
class CrossValidation(FileRecord):
    """What to expect at a scheduling value between those measured, or at other samples of few loops."""

    # mean absolute deviation in parts of the largest output, mean over values that were left out of
    # the fit, of the choice of the map and of the decision about offsets alike
    error: FiniteNumber
    interval: Range  # in it lies the deviation at another such value in about nine of ten cases
    folds: Numbers = ()  # deviation at each value left out, ascending values
    # ``gap``, or ``block``: blocks of samples were left out, which says nothing of other loops
    left_out: Literal["gap", "block"] = "gap"


@dataclass(frozen=True, slots=True)
class CandidateFit(FileRecord):
    """One law that was fitted and compared with others."""

    law: str  # what it is; the law in words
    gap_map: str
    numbers: Whole  # how many were fitted
    # root mean square deviation from all loops, in parts of the largest output: of the one chosen
    # that of the model, of the others that of the fits that were compared; None: there is no fit
    rms: FiniteNumber | None = None
    # mean absolute deviation on what was left out of the fit, gaps or loops, in the same parts;
    # None where nothing was, where the law has no answer there, or where it was passed over
    left_out: FiniteNumber | None = None
    # ``chosen``, ``passed over``, ``dropped`` with the reason, or nothing
    note: str = ""

    def text(self) -> str:
        """Return the candidate in a line."""
        note = f" ({self.note})" if self.note else ""
        error = "" if self.left_out is None else f", left out {100.0 * self.left_out:.3g} %"
        if self.rms is None:
            return f"{self.law}, {self.gap_map}{note}"
        return (
            f"{self.law}, {self.gap_map}: {self.numbers} numbers, rms {100.0 * self.rms:.3g} %"
            f"{error}{note}"
        )


@dataclass(frozen=True, slots=True)
class FitFigures(FileRecord):
    """How far model and measurement are apart over all loops."""

    # largest absolute output of all loops (of a displacement: largest range), SI; relative figures
    # refer to it
    largest_output: Output
    mean_abs: Output  # deviations over all samples as in :class:`LoopFit`, SI
    rms: Output
    worst: Output
    # the same loop by loop
    loops: Annotated[tuple[LoopFit, ...], TUPLE_FROM_LIST, Field(validation_alias="loop")] = ()
    # For each gap map tried, the mean absolute deviation on schedule values that were left out of
    # the fit, relative to the largest output. It chose the map, so it promises too much.
    left_out: Mapping[str, FiniteNumber] = field(default_factory=dict)
    # outcome of the acceptance test over gap and drive; None where it does not apply
    monotone: Truth | None = None
    # what to expect at values between those measured; None below three of them
    cross_validation: CrossValidation | None = None
    # the laws that were compared, the simplest first; empty where one was asked for
    candidates: Annotated[
        tuple[CandidateFit, ...], TUPLE_FROM_LIST, Field(validation_alias="candidate")
    ] = ()
    # root mean square of what is left that is no noise of the sensors, in parts of the largest
    # output; zero where the fit is done, None where nobody looked
    not_noise: FiniteNumber | None = None
    # what is left, in words, and what to do about it; empty where nobody looked
    left_over: str = ""


def fit_figures(
    loopset: Loops,
    fitted: Sequence[FloatArray],
    left_out: Mapping[str, float] = MappingProxyType({}),
    monotone: bool | None = None,
    cross_validation: CrossValidation | None = None,
    candidates: tuple[CandidateFit, ...] = (),
) -> FitFigures:
    """Compare measured and modelled loops."""
    rows, deviations = [], []
    for loop, output in zip(loopset.loops, fitted, strict=True):
        off = np.abs(output - loop.output)
        deviations.append(off)
        full = full_scale(loopset.output, (loop.output,))
        mean, worst = float(off.mean()), float(off.max())
        rows.append(LoopFit(loop.label, loop.schedule_value, loop.n, full, mean, rms(off), worst))
    pooled = np.concatenate(deviations)
    largest, pooled_rms = largest_output(loopset), rms(pooled)
    return FitFigures(
        largest_output=largest,
        mean_abs=float(pooled.mean()),
        rms=pooled_rms,
        worst=float(pooled.max()),
        loops=tuple(rows),
        left_out=dict(left_out),
        monotone=monotone,
        cross_validation=cross_validation,
        candidates=tuple(
            replace(fit, rms=pooled_rms / largest) if fit.note == CHOSEN else fit
            for fit in candidates
        ),
    )


@dataclass(frozen=True, slots=True)
class Uncertainty(FileRecord):
    """What the data say about each fitted quantity, and what they cannot say."""

    # the fitted quantities, with a node in brackets where there is one for each
    names: Texts
    values: Unbounded  # estimate and standard deviation, in the unit the name states
    std: Unbounded
    # correlation matrix, one row for each name
    correlation: Annotated[tuple[Unbounded, ...], TUPLE_FROM_LIST] = ()
    statements: Texts = ()  # plain sentences about what the data do not determine


@dataclass(frozen=True, slots=True)
class ReductionStep(FileRecord):
    """One round of the reduction: a parameter replaced by its mean over the gaps (II.D)."""

    frozen: str  # the parameter that was frozen
    cost_before: (
        FiniteNumber  # mean absolute deviation relative to the largest output, before and after
    )
    cost_after: FiniteNumber
    # cost of freezing each parameter that was tried in this round
    candidates: Mapping[str, FiniteNumber] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Provenance(FileRecord):
    """Where a model came from."""

    version: str = ""  # version of anhyst that wrote the model
    seed: Whole | None = None  # seed of the search
    # measurement files with their hashes and column mappings
    sources: Annotated[tuple[Source, ...], TUPLE_FROM_LIST, Field(validation_alias="source")] = ()
    settings: Mapping[str, Setting] = field(default_factory=dict)  # settings of the identification


# ruff: noqa: RUF012 - pydantic gives every table its own copy of a default


def _number(value: Any) -> Any:
    """Accept a number or a list of numbers; one finding, whatever is wrong."""
    if is_number(value) or (isinstance(value, list) and value and all(map(is_number, value))):
        return value
    raise PydanticCustomError("not_a_number", "must be a finite number, or one for each node")


def _law(name: str) -> str:
    if why := LAWS.explain_unusable(name):
        raise PydanticCustomError("unknown_choice", why.replace("{", "(").replace("}", ")"))
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
    centres: list[FiniteFloat] | None = None


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
        for spec in parameter_specs(law).values()
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
    deviations = {name: (name, column(name, answer.unit)) for name in output_fields(FitFigures)}
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
            name: (name, column(name, "A/m"))
            for name in ("thresholds", "widths", "weights", "centres")
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


def find_field(key: str, names: Names) -> str | None:
    """Return the field that a key with a missing or another unit means, if any."""
    for name, (bare, full) in names.items():
        if key == full:
            continue
        if key in {name, bare} or (bare != full and key.startswith(f"{bare}_")):
            return name
    return None
