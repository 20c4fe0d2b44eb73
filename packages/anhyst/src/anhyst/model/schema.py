"""Define the tables of a model file, their types, and keys with units.

Fit figures, uncertainty, reduction and provenance are dataclasses and tables of the file at the
same time: an added field is read, checked and written. Identification fills these tables, and the
report shows them.
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
from anhyst.model.flux_map import FluxMap
from anhyst.model.parameters import parameter_specs
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.toml_file import TUPLE_FROM_LIST, FileRecord, FiniteNumber, Numbers, Table, Texts
from anhyst.support.units import Quantity

OUTPUT_UNIT_MARK = object()
"""Annotation of fields in units of the output, whose key in the file contains that unit."""

Output = Annotated[FiniteNumber, OUTPUT_UNIT_MARK]
Whole = Annotated[int, Strict()]
Truth = Annotated[bool, Strict()]
Range = Annotated[tuple[FiniteNumber, FiniteNumber], TUPLE_FROM_LIST]
Unbounded = Annotated[tuple[Annotated[float, Strict()], ...], TUPLE_FROM_LIST]
"""Numbers that may be infinite."""


def output_fields(record: type[FileRecord]) -> list[str]:
    """Return the fields of a record that are in units of the output."""
    types = get_type_hints(record, include_extras=True)
    return [name for name, hint in types.items() if OUTPUT_UNIT_MARK in getattr(hint, "__metadata__", ())]


def is_number(value: object) -> bool:
    """Whether a value of a file is a finite number."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    return abs(value) <= sys.float_info.max  # in comparisons, integers may have any size


def _accept_setting(value: Any) -> Any:
    if isinstance(value, str | bool) or is_number(value):
        return value
    raise PydanticCustomError("not_a_setting", "must be a text, true or false, or a finite number")


Setting = Annotated[str | bool | int | float, PlainValidator(_accept_setting)]

CHOSEN = "chosen"
"""Text of the note at the selected candidate."""


@dataclass(frozen=True, slots=True)
class ValidRange(FileRecord):
    """Measured ranges of the model. Outside, every sample is computed but flagged."""

    input: Range  # smallest and largest measured value, SI
    output: Range
    # smallest and largest scheduling value, SI; None without a scheduling variable
    schedule: Range | None = None
    # fastest fitted change of the input, units of the input per s; None if the loops have no times
    input_rate: Annotated[FiniteNumber, Field(gt=0.0)] | None = None


@dataclass(frozen=True, slots=True)
class LoopFit(FileRecord):
    """Deviation of the model from one measured loop, in units of the output."""

    label: str  # label of the loop in its file
    # scheduling value of the loop, SI; missing in files of models without a scheduling variable
    schedule: Annotated[FiniteNumber | None, Field(default=None)]
    samples: Whole  # number of compared samples
    largest_output: Output  # full scale of this loop alone, SI
    mean_abs: Output  # mean absolute (eq. 16), root mean square and largest absolute deviation, SI
    rms: Output
    worst: Output


@dataclass(frozen=True, slots=True)
class CrossValidation(FileRecord):
    """Expected error between the measured scheduling values, or of few loops at other samples."""

    # mean absolute error relative to the largest output, mean over values withheld from the fit,
    # from the selection of the map and from the decision about offsets
    error: FiniteNumber
    interval: Range  # contains the error at an unmeasured value in about nine of ten cases
    folds: Numbers = ()  # error at each withheld value, in ascending order of the values
    # ``gap``, or ``block`` for withheld blocks of samples, which is not evidence about other loops
    left_out: Literal["gap", "block"] = "gap"


@dataclass(frozen=True, slots=True)
class CandidateFit(FileRecord):
    """One law that was fitted and compared with others."""

    law: str  # name of the law in words
    gap_map: str
    numbers: Whole  # number of fitted parameters
    # rms deviation from all loops, relative to the largest output; for the selected candidate, of
    # the final model; for others, of the fits that were compared; None: no fit
    rms: FiniteNumber | None = None
    # mean absolute error at withheld gaps, loops or blocks, relative to the largest output; None if
    # nothing was withheld, the law has no solution there, or the candidate was passed over
    left_out: FiniteNumber | None = None
    # ``chosen``, ``passed over``, ``dropped`` with the reason, or empty
    note: str = ""

    def text(self) -> str:
        """Return the candidate as one line."""
        note_text = f" ({self.note})" if self.note else ""
        error_text = "" if self.left_out is None else f", withheld {100.0 * self.left_out:.3g} %"
        if self.rms is None:
            return f"{self.law}, {self.gap_map}{note_text}"
        return (
            f"{self.law}, {self.gap_map}: {self.numbers} parameters, rms {100.0 * self.rms:.3g} %"
            f"{error_text}{note_text}"
        )


@dataclass(frozen=True, slots=True)
class FitFigures(FileRecord):
    """Deviation of the model from all measured loops."""

    # largest absolute output of all loops (of a displacement: largest range), SI; full scale of
    # relative values
    largest_output: Output
    mean_abs: Output  # deviations over all samples as in :class:`LoopFit`, SI
    rms: Output
    worst: Output
    # deviations of each loop
    loops: Annotated[tuple[LoopFit, ...], TUPLE_FROM_LIST, Field(validation_alias="loop")] = ()
    # mean absolute error at withheld scheduling values for each tried gap map, relative to the
    # largest output; optimistic, because it was used to select the map
    left_out: Mapping[str, FiniteNumber] = field(default_factory=dict)
    # whether the acceptance tests over gap and drive passed; None if none applies
    monotone: Truth | None = None
    # expected error between the measured scheduling values; None for fewer than three
    cross_validation: CrossValidation | None = None
    # compared laws, the simplest first; empty if a law was requested
    candidates: Annotated[tuple[CandidateFit, ...], TUPLE_FROM_LIST, Field(validation_alias="candidate")] = ()
    # rms residual beyond the sensor noise, relative to the largest output; zero if the residual is
    # noise, None if it was not analysed
    not_noise: FiniteNumber | None = None
    # description of the residual and its remedy; empty if it was not analysed
    left_over: str = ""


def fit_figures(
    loopset: Loops,
    fitted_outputs: Sequence[FloatArray],
    left_out: Mapping[str, float] = MappingProxyType({}),
    monotone: bool | None = None,
    cross_validation: CrossValidation | None = None,
    candidates: tuple[CandidateFit, ...] = (),
) -> FitFigures:
    """Compute the deviations between measured and modelled loops."""
    rows, deviations = [], []
    for loop, output in zip(loopset.loops, fitted_outputs, strict=True):
        deviation = np.abs(output - loop.output)
        deviations.append(deviation)
        full_scale_output = full_scale(loopset.output, (loop.output,))
        mean, worst = float(deviation.mean()), float(deviation.max())
        rows.append(
            LoopFit(loop.label, loop.schedule_value, loop.n, full_scale_output, mean, rms(deviation), worst)
        )
    pooled_deviations = np.concatenate(deviations)
    largest_output_value, pooled_rms = largest_output(loopset), rms(pooled_deviations)
    return FitFigures(
        largest_output=largest_output_value,
        mean_abs=float(pooled_deviations.mean()),
        rms=pooled_rms,
        worst=float(pooled_deviations.max()),
        loops=tuple(rows),
        left_out=dict(left_out),
        monotone=monotone,
        cross_validation=cross_validation,
        candidates=tuple(
            replace(fit, rms=pooled_rms / largest_output_value) if fit.note == CHOSEN else fit
            for fit in candidates
        ),
    )


@dataclass(frozen=True, slots=True)
class Uncertainty(FileRecord):
    """Uncertainty of each fitted quantity, and statements about what the data do not determine."""

    # fitted quantities, with the node in brackets if each node has its own value
    names: Texts
    values: Unbounded  # estimate and standard deviation, in the unit the name states
    std: Unbounded
    # correlation matrix, one row for each name
    correlation: Annotated[tuple[Unbounded, ...], TUPLE_FROM_LIST] = ()
    statements: Texts = ()  # sentences about parameters that the data do not determine


@dataclass(frozen=True, slots=True)
class ReductionStep(FileRecord):
    """One round of the reduction: a parameter replaced by its mean over the gaps (II.D)."""

    frozen: str  # fixed parameter
    cost_before: FiniteNumber  # mean absolute deviation relative to the largest output, before and after
    cost_after: FiniteNumber
    # cost of fixing each parameter that was tried in this round
    candidates: Mapping[str, FiniteNumber] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Provenance(FileRecord):
    """Origin of a model."""

    version: str = ""  # version of anhyst that wrote the model
    seed: Whole | None = None  # seed of the search
    # measurement files with their hashes and column mappings
    sources: Annotated[tuple[Source, ...], TUPLE_FROM_LIST, Field(validation_alias="source")] = ()
    settings: Mapping[str, Setting] = field(default_factory=dict)  # settings of the identification


# ruff: noqa: RUF012 - pydantic gives every table its own copy of a default


def _accept_number(value: Any) -> Any:
    """Accept a number or a list of numbers; report any error as a single finding."""
    if is_number(value) or (isinstance(value, list) and value and all(map(is_number, value))):
        return value
    raise PydanticCustomError("not_a_number", "must be a finite number, or one for each node")


def _check_law(name: str) -> str:
    if reason := LAWS.explain_unusable(name):
        raise PydanticCustomError("unknown_choice", reason.replace("{", "(").replace("}", ")"))
    if name not in LAWS:
        law_names = [repr(law) for law in LAWS]
        raise PydanticCustomError(
            "unknown_choice", f"Input should be {', '.join(law_names[:-1])} or {law_names[-1]}"
        )
    return name


LawName = Annotated[str, AfterValidator(_check_law)]
Number = Annotated[float | list[float], PlainValidator(_accept_number)]


class QuantityTable(Table):
    """``[input]``, ``[output]``: measured quantity, its symbol and its SI unit."""

    quantity: str
    symbol: str
    unit: str


class ScheduleTable(QuantityTable):
    """``[schedule]``: the scheduling variable and its nodes."""

    nodes: list[FiniteFloat] = []


class CellsTable(Table):
    """``[cells]``: cells of a law with cells, with a row of weights for each threshold."""

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
    """``[layers]``: layers of solid iron."""

    count: int
    surface: FiniteFloat
    laminated: FiniteFloat = 0.0


class EddyCircuitTable(Table):
    """``[eddy_circuit]``: leakage flux and excess loss of the eddy currents."""

    leaky: FiniteFloat = 0.0
    delay: FiniteFloat = 0.0
    excess: FiniteFloat = 0.0


class ModelTable(Table):
    """The whole file, with keys without units."""

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
    eddy_circuit: EddyCircuitTable | None = None
    flux: FluxMap | None = None
    valid: ValidRange | None = None
    fit: FitFigures | None = None
    uncertainty: Uncertainty | None = None
    reduction: list[ReductionStep] = []
    provenance: Provenance = Provenance()


def model_table(law: Law | None) -> type[ModelTable]:
    """Return the table of the whole file with the parameters of a law."""
    if law is None:
        return ModelTable  # this table rejects the law
    fields: dict[str, Any] = {
        spec.name: (Number, ... if spec.default is None else spec.default)
        for spec in parameter_specs(law).values()
    }
    parameters = create_model("ParameterTable", __base__=Table, **fields)
    return create_model("ModelTable", __base__=ModelTable, parameters=(parameters, ...))


FORMAT = "anhyst-model"
VERSION = 1

Names = dict[str, tuple[str, str]]
"""Key without and with its unit, for each field of a table whose key contains a unit."""


def column(name: str, unit: str) -> str:
    """Return a key with its unit, such as ``k_A_per_m``."""
    return Quantity("", name, unit).column


def parameter_names(law: Law | None, drive: Quantity, output_quantity: Quantity) -> Names:
    """Return the keys of ``[parameters]`` for a law (if known), an input and an output."""
    power = output_map(output_quantity).power
    c_h_key = {"A": "c_H_per_m", "A/m": "c_H"}.get(drive.unit, f"c_H_A_per_m_{drive.unit}")
    ratio = (
        column(f"c_{output_quantity.symbol}", output_quantity.unit) + f"_per_T{power if power > 1 else ''}"
    )
    return {
        **{
            spec.name: (spec.name, column(spec.name, spec.unit) if spec.unit != "1" else spec.name)
            for spec in (law.parameters if law else ())
        },
        "rho": ("rho", "rho"),
        "c_H": ("c_H", c_h_key),
        "gamma": ("gamma", "gamma_A_s_per_m_T"),
        "c_out": (f"c_{output_quantity.symbol}", "c_B" if output_quantity.unit == "T" else ratio),
        "in_0": (f"{drive.symbol}_0", column(f"{drive.symbol}_0", drive.unit)),
        "out_0": (f"{output_quantity.symbol}_0", column(f"{output_quantity.symbol}_0", output_quantity.unit)),
    }


def section_names(
    law: Law | None, drive: Quantity, output_quantity: Quantity, schedule: Quantity | None
) -> dict[tuple[str, ...], Names]:
    """Return the keys with units of each table (``[[fit.loop]]`` as ``fit, loop``)."""
    deviations = {name: (name, column(name, output_quantity.unit)) for name in output_fields(FitFigures)}
    rate_name = f"{drive.symbol}_rate"
    ranges = {
        "input_rate": (rate_name, column(rate_name, f"{drive.unit}/s")),
        "input": (drive.symbol, drive.column),
        "output": (output_quantity.symbol, output_quantity.column),
    }
    nodes: Names = {}
    if schedule is not None:
        ranges["schedule"] = (schedule.symbol, schedule.column)
        nodes["nodes"] = ("nodes", column("nodes", schedule.unit))
    schedule_name = {"schedule": ranges["schedule"]} if schedule is not None else {}
    return {
        ("schedule",): nodes,
        ("parameters",): parameter_names(law, drive, output_quantity),
        ("cells",): {
            name: (name, column(name, "A/m")) for name in ("thresholds", "widths", "weights", "centres")
        },
        ("dynamics",): {
            "lag": ("lag", "lag_s"),
            "creep_times": ("creep_times", "creep_times_s"),
            "fastest": ("fastest", "fastest_Hz"),
        },
        ("eddy_circuit",): {
            "delay": ("delay", column("delay", "s")),
            "excess": ("excess", column("excess", "A/m")),
        },
        ("flux",): {
            name: (name, column(name, unit))
            for name, unit in (
                ("pole", "Wb_m/A"),
                ("fringe", "Wb/A"),
                ("gap_zero", "m"),
                ("leakage", "Wb/A"),
                ("leakage_slope", "Wb/A_m"),
                ("leakage_gap", "m"),
                ("armature_knots", "Wb"),
                ("armature_weights", "A/Wb2"),
                ("largest_flux", "Wb"),
                ("zeros", "Wb"),
                ("drifts", "Wb"),
            )
        },
        ("valid",): ranges,
        ("fit",): deviations,
        ("fit", "loop"): deviations | schedule_name,
    }


def find_field(key: str, names: Names) -> str | None:
    """Return the field that a key with a missing or wrong unit means, if any."""
    for name, (name_without_unit, full_name) in names.items():
        if key == full_name:
            continue
        if key in {name, name_without_unit} or (
            name_without_unit != full_name and key.startswith(f"{name_without_unit}_")
        ):
            return name
    return None
