"""Write the model file; :mod:`anhyst.model.actuator` describes the format and reads the file."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast, get_type_hints

import numpy as np

from anhyst.laws import LAWS
from anhyst.laws.cells import CellWeights
from anhyst.model import schema
from anhyst.model.model_data import ModelData
from anhyst.model.reader import read_as
from anhyst.support.atomic import PathLike, atomic_writer
from anhyst.support.errors import InputError
from anhyst.support.toml_file import FileRecord
from anhyst.support.toml_text import toml_key, toml_value
from anhyst.support.units import Quantity

FILE_COMMENT = """\
# Model of an actuator, written by anhyst. The file can be read, edited and compared. All values are SI,
# every key contains its unit (k_A_per_m is k in A/m), and every key is checked on reading.
"""
GAP_MAP_COMMENT = """
# Parameters that depend on the scheduling variable. "none": none; "scaling": c_H, which scales the
# field; "reluctance": rho, a gap in series with the iron; "circuit": rho, the output and the offsets;
# "free": any.
"""
HISTORY_COMMENT = """
# Default history before the first sample: "demagnetised"; "settled" (the drive is a cycle that was
# repeated until it closed); or "conditioned:0,2,0" (reversals of the input, starting from the
# demagnetised state).
"""
PARAMETERS_COMMENT = """
#     c_H * (input - offset) = H + rho * B / mu0 + gamma * dB/dt
#     output                 = c_out * B^power + offset        (power 2 for a force, otherwise 1)
# One number, or one for each node. Between nodes, a curve without overshoot; outside, linear
# extrapolation.
"""
CELLS_COMMENT = """
# Play cells of the iron: thresholds ascending from 0, and the contribution to the saturation of each
# threshold (row) and curve width (column). They replace the parameters of the populations.
"""
CENTRES_COMMENT = """\
# A curve with a centre above 0 is the mean of two curves, around the centre and its negative.
"""
DYNAMICS_COMMENT = """
# Dynamics: the lag from the input to the output; the time constants of the creep and their shares of
# the immediate output; and the cycle rate up to which the model was validated, 0 if unknown.
"""
LAYERS_COMMENT = """
# Solid iron: the number of layers, between which the field diffuses (gamma above); the share of the
# section in the layer at the surface; and the share of the path in sheets, which respond at once.
"""
EDDY_CIRCUIT_COMMENT = """
# Eddy currents of iron with a uniform field: the fraction of gamma in a ring with leakage flux, the
# delay of the flux inside the ring, and the excess field at a rate of the flux density of 1 T/s.
"""
FLUX_COMMENT = """
# Flux linkage of the coil, from which the force was derived: permeance of the gap x and of the leakage
# path, pole/(x + gap_zero) + fringe and leakage + leakage_slope*(x - leakage_gap), the curve of the
# saturating armature, sum of weight*max(flux - knot, 0)^2, and the uncertainty of the derived force,
# relative to the largest force, that about nine of ten magnets do not exceed.
"""
VALID_COMMENT = """
# Smallest and largest measured values, and the fastest change of the input if the loops have times.
# Outside, or 1.5 times as fast, results are computed and flagged.
"""
FIT_COMMENT = """
# Deviation of the model from its measurement: mean absolute, root mean square and largest. left_out:
# mean error at withheld schedule values, relative to the largest output, for each tried gap map.
# monotone: whether the output rises as the gap closes and as the drive rises.
"""
CROSS_VALIDATION_COMMENT = """
# Expected error between the measured schedule values: mean error relative to the largest output, its
# 90 % interval, and the error at each value withheld from the fit, from the selection of the map and
# from the decision about offsets. With left_out = "block", blocks of samples were withheld, and the
# figures are valid only for other samples of such loops.
"""
UNCERTAINTY_COMMENT = """
# Estimates and standard deviations of the fitted parameters; inf if the data do not determine them.
"""


def write_model(model: ModelData, path: PathLike) -> None:
    """Write a model to a file, completely or not at all; the draft is read back first."""
    text = model_text(model)

    def check(draft: Path) -> None:
        try:
            read_as(draft, ModelData)
        except InputError as error:
            reason = str(error).replace(str(draft), str(path))
            text = f"{reason}; such a file could not be read, so it was not written"
            raise InputError(text, code=error.code, key=error.key) from error

    with atomic_writer(path, check) as stream:
        stream.write(text)


def model_text(model: ModelData) -> str:
    """Return the text of the model file."""
    names = schema.section_names(model.operator_law, model.input, model.output, model.schedule)
    law_names = " or ".join(f'"{law}"' for law in LAWS)
    text = f"The hysteresis law, {law_names}. The parameters are valid only for this law."
    lines = textwrap.wrap(text, 100, initial_indent="# ", subsequent_indent="# ")
    table: dict[str, object] = {}
    sections = [
        FILE_COMMENT + _keys_text({"format": schema.FORMAT, "version": schema.VERSION, "name": model.name}),
        "\n" + "\n".join(lines) + "\n" + _keys_text({"law": model.law}),
        GAP_MAP_COMMENT + _keys_text({"gap_map": model.gap_map}),
        HISTORY_COMMENT + _keys_text({"history": str(model.history)}),
        "\n[input]\n" + _quantity_text(model.input),
        "\n[output]\n" + _quantity_text(model.output),
        _schedule_text(model),
        "\n[parameters]" + PARAMETERS_COMMENT + _parameters_text(model),
        _cells_text(model.cells) if model.cells else "",
    ]
    if dynamics := model.dynamics:
        times, shares = list(map(float, dynamics.times)), list(map(float, dynamics.shares))
        table = {"lag_s": float(dynamics.lag), "creep_times_s": times, "creep_shares": shares}
        sections.append(
            f"{DYNAMICS_COMMENT}[dynamics]\n" + _keys_text(table | {"fastest_Hz": float(dynamics.fastest)})
        )
    if layers := model.layers:
        surface_share, laminated_share = float(layers.surface), float(layers.laminated)
        table = {"count": layers.count, "surface": surface_share, "laminated": laminated_share}
        sections.append(f"{LAYERS_COMMENT}[layers]\n" + _keys_text(table))
    if circuit := model.eddy_circuit:
        table = {"leaky": circuit.leaky, "delay_s": circuit.delay, "excess_A_per_m": circuit.excess}
        sections.append(f"{EDDY_CIRCUIT_COMMENT}[eddy_circuit]\n" + _keys_text(table))
    if model.flux:
        sections.append(f"{FLUX_COMMENT}[flux]\n" + _record_text(model.flux, names["flux",]))
    if model.valid:
        sections.append(f"{VALID_COMMENT}[valid]\n" + _record_text(model.valid, names["valid",]))
    if model.fit:
        sections.append(_fit_text(model.fit, names))
    if model.uncertainty:
        sections.append(_uncertainty_text(model.uncertainty))
    if model.reduction:
        sections.append("\n# Reduction: the parameter fixed in each round, with the lowest cost.\n")
    sections += ["\n[[reduction]]\n" + _record_text(step) for step in model.reduction]
    if (provenance := model.provenance) != schema.Provenance():
        table = {"version": provenance.version, "seed": provenance.seed}
        sections.append("\n# Origin of the model.\n[provenance]\n" + _keys_text(table))
        if provenance.settings:
            sections.append("\n[provenance.settings]\n" + _keys_text(provenance.settings))
        for source in provenance.sources:
            table = {"path": source.path, "sha256": source.sha256}
            table["columns"] = dict(source.columns) or None
            sections.append("\n[[provenance.source]]\n" + _keys_text(table))
    return "".join(sections)


def _keys_text(table: Mapping[str, object]) -> str:
    """Return keys and values as text, without keys that have no value."""
    return "".join(
        f"{toml_key(key)} = {toml_value(value)}\n" for key, value in table.items() if value is not None
    )


def _quantity_text(quantity: Quantity) -> str:
    return _keys_text({"quantity": quantity.name, "symbol": quantity.symbol, "unit": quantity.unit})


def _schedule_text(model: ModelData) -> str:
    if model.schedule is None:
        return ""
    nodes = {schema.column("nodes", model.schedule.unit): list(model.nodes)} if model.nodes else {}
    return "\n[schedule]\n" + _quantity_text(model.schedule) + _keys_text(nodes)


def _parameters_text(model: ModelData) -> str:
    names = model.file_keys
    lines = []
    for name, spec in model.specs.items():
        value = model.parameters[name]
        value_text = toml_value(list(value) if isinstance(value, tuple) else value)
        lines.append((f"{names[name][1]} = {value_text}", spec.meaning))
    width = min(max(len(line) for line, _ in lines), 48)
    return "".join(f"{line:<{width}}  # {meaning}\n" for line, meaning in lines)


def _cells_text(cells: CellWeights) -> str:
    table = {
        "shape": cells.shape,
        schema.column("thresholds", "A/m"): cells.thresholds.tolist(),
        schema.column("widths", "A/m"): cells.widths.tolist(),
    }
    text = CELLS_COMMENT
    if cells.centres is not None:
        table[schema.column("centres", "A/m")] = cells.centres.tolist()
        text += CENTRES_COMMENT
    weights = f"{schema.column('weights', 'A/m')} = {_matrix_text(cells.weights.tolist())}\n"
    return f"{text}[cells]\n{_keys_text(table)}{weights}"


def _record_text(record: FileRecord, names: Mapping[str, tuple[str, str]] = MappingProxyType({})) -> str:
    """Return the keys of a record as text, without defaults and without its nested tables.

    Deviations get a comment with their percentage of the largest output. A scheduling variable has
    a name only if the model has a scheduling variable.
    """
    annotations = get_type_hints(type(record), include_extras=True)
    largest_output: float = getattr(record, "largest_output", 0.0)
    text = ""
    for field in fields(cast("Any", record)):
        value, key = getattr(record, field.name), names.get(field.name, ("", field.name))[1]
        if value in (None, field.default, {}) or _contains_tables(value):
            continue
        if field.name == "schedule" and field.name not in names:
            continue
        value_text = toml_value(_to_plain_value(value, is_whole=annotations[field.name] is schema.Whole))
        has_percentage = (
            field.name in schema.output_fields(type(record))
            and field.name != "largest_output"
            and largest_output
        )
        text += f"{toml_key(key)} = {value_text}"
        text += f"  # {100.0 * value / largest_output:.3g} %\n" if has_percentage else "\n"
    return text


def _contains_tables(value: object) -> bool:
    return isinstance(value, FileRecord) or (
        isinstance(value, tuple) and any(isinstance(item, FileRecord) for item in value)
    )


def _to_plain_value(value: Any, *, is_whole: bool = False) -> Any:
    """Return a value as a Python type; all numbers are floats unless `whole` is set."""
    match value:
        case str() | bool():
            return value
        case np.bool_():
            return bool(value)
        case Mapping():
            return {key: _to_plain_value(item) for key, item in value.items()}
        case tuple():
            return [_to_plain_value(item) for item in value]
    return int(value) if is_whole else float(value)


def _fit_text(fit: schema.FitFigures, names: Mapping[tuple[str, ...], schema.Names]) -> str:
    text = f"{FIT_COMMENT}[fit]\n" + _record_text(fit, names["fit",])
    if fit.cross_validation:
        text += f"{CROSS_VALIDATION_COMMENT}[fit.cross_validation]\n{_record_text(fit.cross_validation)}"
    for candidate in fit.candidates:
        text += f"\n[[fit.candidate]]\n{_record_text(candidate)}"
    for loop in fit.loops:
        text += "\n[[fit.loop]]\n" + _record_text(loop, names["fit", "loop"])
    return text


def _uncertainty_text(uncertainty: schema.Uncertainty) -> str:
    without_matrices = replace(uncertainty, correlation=(), statements=())
    text = f"{UNCERTAINTY_COMMENT}[uncertainty]\n{_record_text(without_matrices)}"
    if uncertainty.correlation:
        text += f"correlation = {_matrix_text(_to_plain_value(uncertainty.correlation))}\n"
    if uncertainty.statements:
        text += f"statements = {_matrix_text(uncertainty.statements)}\n"
    return text


def _matrix_text(rows: Iterable[Sequence[float] | str]) -> str:
    rows_text = "".join(f"    {toml_value(row)},\n" for row in rows)
    return f"[\n{rows_text}]"
