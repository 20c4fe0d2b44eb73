"""Determine the role of each column of a table: input, output, time, schedule or label.

Names, units and the options of the user decide. If a role is missing or ambiguous, the error
proposes an option.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from anhyst.data.formats.channels import Texts, is_number
from anhyst.data.output_map import COIL_VOLTAGES, OUTPUT_MAPS
from anhyst.data.path import reversal_count
from anhyst.data.proposals import (
    advise_mapping,
    advise_unit_mapping,
    columns_without_unit,
    current_mapping,
    format_option,
    has_missing_unit,
    mapping_option,
    selection_option,
)
from anhyst.data.sidecar import FileDescription
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import DRIVE_QUANTITIES, MASS_UNITS, QUANTITIES, Header, Quantity, parse_header
from anhyst.support.vocabulary import named_quantities, split_words

_NO_SCHEDULE = "none"
_MOTION_OUTPUTS = frozenset({"displacement", "strain", "magnetostriction"})
_TURNS = frozenset({"turns", "sense_turns"})
"""Names of the constants that refer the voltage of a sense coil to the coil."""
_INPUT_EXAMPLES = "'I_A', 'H_A_per_m' or 'u_V'"
_OUTPUT_EXAMPLES = "'F_N', 'B_T', 'psi_Wb' or 'x_m'"


@dataclass(frozen=True, slots=True)
class Roles:
    """Indices of the columns by role, and the constants that replace columns."""

    input: int
    output: int
    time: int | None
    label: int | None
    constant_label: str | None
    schedule: int | None  # column of the scheduling variable
    schedule_constant: float | None  # constant value of the scheduling variable, SI units
    schedule_quantity: Quantity | None  # quantity of the scheduling variable, if any
    is_schedule_requested: bool  # whether the user named this quantity
    unused: tuple[int, ...]  # columns without a role
    is_label_inferred: bool = False  # whether the label column was found from the data

    def notes(self, headers: Sequence[Header]) -> list[str]:
        """Return notes about the interpretation of the columns and about unused columns."""
        remarks = []
        used_indices = (self.input, self.output, self.time, self.schedule)
        used_headers = [headers[index] for index in used_indices if index is not None]
        word_texts = [
            f"'{used_header.text}' as {used_header.quantity.name}"
            for used_header in used_headers
            if used_header.is_from_words and used_header.quantity
        ]
        if word_texts:
            remarks.append(f"recognised by word and unit: {', '.join(word_texts).replace('_', ' ')}")
        remarks += [text for header in used_headers for text in _describe_conversion(header)]
        if self.is_label_inferred and self.label is not None:
            remarks.append(f"column '{headers[self.label].text}' distinguishes the loops")
        if self.unused:
            unused_names = ", ".join(headers[index].text for index in self.unused)
            remarks.append(f"columns not used: {unused_names}")
        return remarks


def find_roles(
    source: str,
    headers: Sequence[Header],
    description: FileDescription,
    texts: Collection[int] = (),
    clocks: Callable[[], Collection[int]] = tuple,
) -> Roles:
    """Determine the role of each column.

    ``texts`` are the columns whose first field is not a number. ``clocks`` returns the columns with
    equal steps; it is only called to make a proposal.
    """
    time = _find_time(source, headers, texts)
    has_times = time is not None and headers[time].unit is not None
    voltage = _find_coil_voltage(source, headers, description) if has_times else None
    drive, output = voltage or _find_input_and_output(source, headers, lambda: {*texts, *clocks()})
    label = _find_label_column(source, headers, description)
    constants = description.constants
    constant_label = next((str(constants[key]) for key in constants if parse_header(key).is_label), None)
    if label is not None and constant_label is not None:
        raise InputError(
            f"{source}: the loop label is both a column and a constant; keep one", code="column-and-constant"
        )
    schedule, schedule_constant, quantity = _find_schedule(source, headers, description)
    used_indices = {drive, output, time, label, schedule}
    unused_indices = tuple(
        index
        for index, header in enumerate(headers)
        if index not in used_indices and header.text and header.text not in description.select
    )
    is_schedule_requested = description.schedule is not None
    return Roles(
        drive,
        output,
        time,
        label,
        constant_label,
        schedule,
        schedule_constant,
        quantity,
        is_schedule_requested,
        unused_indices,
    )


def find_column(source: str, headers: Sequence[Header], name: str) -> int:
    """Return the index of a column by its header in the file."""
    for index, header in enumerate(headers):
        if header.text == name:
            return index
    raise InputError(
        f"{source}: has no column '{name}' ({_list_columns(headers)})", code="no-such-column", key=name
    )


def _describe_conversion(header: Header) -> list[str]:
    """Return how the values of a column were converted to SI units."""
    name = f"column '{header.text}'"
    texts = []
    if header.unit is not None and header.unit.symbol in MASS_UNITS:
        texts.append(f"{name}: a mass is read as the force of its weight, 9.80665 m/s^2")
    if header.scale is not None:
        unit = header.unit.symbol if header.unit else ""
        texts.append(f"{name}: multiplied by {header.scale:g} to give {unit}".rstrip())
    if header.is_flipped:
        texts.append(f"{name}: its sign is reversed")
    if header.is_clock and header.unit is None:
        texts.append(
            f"{name}: is a clock without a unit: only the order of the samples is used; name it "
            "'t_s' or 't_ms' to use its times"
        )
    return texts


def _find_time(source: str, headers: Sequence[Header], texts: Collection[int]) -> int | None:
    """Return the index of the clock; a clock without a unit only gives the order of the samples."""
    clocks = [i for i, header in enumerate(headers) if header.is_clock and i not in texts]
    # A column 'time' takes precedence over words such as 'tout' or 'Seconds'.
    clocks = [i for i in clocks if not headers[i].is_from_words] or clocks
    has_units = [i for i in clocks if headers[i].unit is not None or headers[i].stated]
    if has_units or len(clocks) != 1:
        numbers = [header for i, header in enumerate(headers) if i in has_units]
        index = _find_only(source, numbers, "time")
        return None if index is None else has_units[index]
    return clocks[0]


def _find_input_and_output(
    source: str, headers: Sequence[Header], skip: Callable[[], Collection[int]]
) -> tuple[int, int]:
    """Return the indices of input and output; ask for all missing roles together."""
    drive_and_output = [
        _find_first(source, headers, names) for names in (DRIVE_QUANTITIES, tuple(OUTPUT_MAPS))
    ]
    drive, output = drive_and_output
    if drive is not None and output is not None:
        _ask_which_drives(source, headers, drive, output)
        return drive, output
    has_field = drive is not None and headers[drive].name == "H"
    outputs = ("flux_density", *OUTPUT_MAPS) if has_field else tuple(OUTPUT_MAPS)
    missing_quantities = [
        names
        for index, names in zip(drive_and_output, (DRIVE_QUANTITIES, outputs), strict=True)
        if index is None
    ]
    missing_role, examples = ("an output", _OUTPUT_EXAMPLES)
    if drive is None:
        missing_role, examples = ("an input", _INPUT_EXAMPLES)
    number_names = [f"'{header.text}'" for header in headers if is_number(header.text)]
    if number_names:
        raise InputError(
            f"{source}: numbers instead of names ({', '.join(number_names[:3])}): settings next to "
            "the data, or no header; delete these columns, or write a line of names above the data",
            code="names-missing",
        )
    raise InputError(
        f"{source}: has no column for {missing_role} ({_list_columns(headers)}); name it {examples}"
        f"{advise_mapping(headers, *missing_quantities, skip=skip())}{_advise_coil_voltage(headers)}",
        code="column-missing",
    )


def _find_coil_voltage(
    source: str, headers: Sequence[Header], description: FileDescription
) -> tuple[int, int] | None:
    """Return the indices of the current and of the coil's voltage, whose integral is the flux.

    ``None`` if a column can be another output, by its quantity, its unit or a word. A sense
    coil is preferred, because its voltage does not depend on the resistance.
    """
    voltages = _find_coil_voltages(headers)
    names = {header.quantity.name for header in headers if header.quantity is not None}
    if not voltages or not names.isdisjoint(OUTPUT_MAPS) or "current" not in names:
        return None
    if not any(header.target for header in voltages) and any(map(_can_be_output, headers)):
        return None
    current = _find_only(source, headers, "current")
    if current is None:
        return None
    sense_voltage, voltage = (_find_only(source, headers, name) for name in COIL_VOLTAGES)
    if voltage is not None and (sense_voltage is None or not _TURNS.issubset(description.constants)):
        return current, voltage
    return None if sense_voltage is None else (current, sense_voltage)


def _find_coil_voltages(headers: Sequence[Header]) -> list[Header]:
    return [header for header in headers if header.quantity is not None
            and header.quantity.name in COIL_VOLTAGES and header.problem is None]  # fmt: skip


def _can_be_output(header: Header) -> bool:
    """Whether a column that is not understood can be an output, by a word or by its unit."""
    if not named_quantities(header.name).isdisjoint(OUTPUT_MAPS):
        return True
    dimension = header.unit.dimension if header.unit is not None else ""
    return not header.is_known and dimension in {"voltage", *OUTPUT_MAPS}


def _advise_coil_voltage(headers: Sequence[Header]) -> str:
    """Return the remedy that would integrate a voltage; empty without a voltage."""
    voltages = _find_coil_voltages(headers)
    if not voltages or not any(header.quantity == QUANTITIES["current"] for header in headers):
        return ""
    if not any(header.is_clock and header.unit for header in headers):
        return f"; if '{voltages[0].text}' is the voltage of the coil, add the times in a column 't_s'"
    mapping = current_mapping(headers) | {voltages[0].text: "u_V"}
    return f"; if '{voltages[0].text}' is the voltage of the coil: {format_option('columns', mapping)}"


def _ask_which_drives(source: str, headers: Sequence[Header], drive: int, output_index: int) -> None:
    """Ask whether a voltage or a current drives a displacement or strain (piezo or coil)."""
    output, candidate = headers[output_index].quantity, headers[drive]
    voltages = [header for header in headers
             if header.quantity == QUANTITIES["voltage"] and not header.problem]  # fmt: skip
    is_moved = output is not None and output.name in _MOTION_OUTPUTS
    if not is_moved or not voltages or candidate.quantity != QUANTITIES["current"]:
        return
    if candidate.target is not None:
        return
    current_columns = current_mapping(headers)
    choices = [
        format_option("columns", current_columns | {text: ""}) for text in (candidate.text, voltages[0].text)
    ]
    raise InputError(
        f"{source}: '{voltages[0].text}' or '{candidate.text}' may drive '{headers[output_index].text}'; leave "
        f"one out: if the voltage drives, {choices[0]}; if the current drives, {choices[1]}",
        code="column-twice",
        key="current",
    )


def _find_first(source: str, headers: Sequence[Header], names: Sequence[str]) -> int | None:
    """Return the index of the first available quantity of a list.

    A word for a quantity does not take precedence over a doubtful column of a preferred quantity.
    """
    doubtful_names = [
        named_quantities(header.name) for header in headers if not header.is_known and header.stated
    ]
    for rank, name in enumerate(names):
        index = _find_only(source, headers, name)
        if index is None:
            continue
        is_doubted = any(not meanings.isdisjoint(names[:rank]) for meanings in doubtful_names)
        return None if headers[index].is_from_words and is_doubted else index
    return None


def _find_only(source: str, headers: Sequence[Header], name: str) -> int | None:
    """Return the index of the only usable column of a quantity; ``None`` if the table has none."""
    indices = [i for i, h in enumerate(headers) if h.quantity is not None and h.quantity.name == name]
    usable_indices = [index for index in indices if headers[index].problem is None]
    # Order of precedence: the user's mapping, the quantity's name, our symbols, words.
    mapped_indices = [index for index in usable_indices if headers[index].target is not None]
    by_full_name = [index for index in usable_indices if headers[index].text.lower() == name]
    symbols = [index for index in usable_indices if headers[index].is_certain]
    usable_indices = mapped_indices or by_full_name or symbols or usable_indices
    if len(usable_indices) > 1:
        texts = " and ".join(f"'{headers[index].text}'" for index in usable_indices)
        choices = " or ".join(selection_option(headers[index], headers) for index in usable_indices)
        raise InputError(
            f"{source}: columns {texts} are both {name}; state which one to use: {choices}",
            code="column-twice",
            key=name,
        )
    if indices and not usable_indices:
        header = headers[indices[0]]
        unit_faults = columns_without_unit(headers) if has_missing_unit(header) else []
        texts = ", ".join(f"'{fault.text}'" for fault in unit_faults if fault is not header)
        others_text = f"; {texts} have none either" if texts else ""
        raise InputError(
            f"{source}: column '{header.text}': {header.problem}{others_text}{advise_unit_mapping(header, headers)}",
            code="bad-header",
            key=header.text,
        )
    return usable_indices[0] if usable_indices else None


def _find_label_column(source: str, headers: Sequence[Header], description: FileDescription) -> int | None:
    if description.loop is not None:
        return find_column(source, headers, description.loop)
    indices = [index for index, header in enumerate(headers) if header.is_label]
    if len(indices) > 1:
        texts = " and ".join(f"'{headers[index].text}'" for index in indices)
        raise InputError(f"{source}: columns {texts} both label loops; leave one out", code="column-twice")
    return indices[0] if indices else None


def _constants_in_si(source: str, constants: Mapping[str, float | str]) -> dict[str, tuple[Quantity, float]]:
    """Return constants of the whole file in SI units, by the name of their quantity."""
    values: dict[str, tuple[Quantity, float]] = {}
    for key, value in constants.items():
        header = parse_header(key)
        if header.quantity is None:
            continue
        if header.problem:
            raise InputError(f"{source}: constant '{key}': {header.problem}", code="bad-constant", key=key)
        try:
            number = float(value)
        except ValueError:
            raise InputError(
                f"{source}: constant '{key}': '{value}' is not a number", code="bad-constant", key=key
            ) from None
        if header.unit:
            number = header.unit.value_to_si(number)
        values[header.quantity.name] = (header.quantity, number)
    return values


def turns_ratio(source: str, constants: Mapping[str, float | str]) -> float:
    """Return the turns of the coil over the turns of its sense coil, from the constants."""
    values = _constants_in_si(source, {name: constants.get(name, 0.0) for name in _TURNS})
    turns, sense_turns = (values[name][1] for name in ("turns", "sense_turns"))
    if turns <= 0.0 or sense_turns <= 0.0:
        raise InputError(
            f"{source}: the turns of the coil or of the sense coil are missing, or not above 0; state both: "
            '--constants "turns=260,sense_turns=20"',
            code="turns-missing",
            key="turns",
        )
    return turns / sense_turns


def _find_schedule(
    source: str, headers: Sequence[Header], description: FileDescription
) -> tuple[int | None, float | None, Quantity | None]:
    """Return the scheduling variable: the requested one, else the gap, else the temperature.

    The result is the index of a column or a constant value, and the quantity.
    """
    if description.schedule == _NO_SCHEDULE:
        return None, None, None
    constants = _constants_in_si(source, description.constants)
    for name in constants:
        if any(h.quantity is not None and h.quantity.name == name for h in headers):
            raise InputError(
                f"{source}: {name} is both a column and a constant; keep one",
                code="column-and-constant",
                key=name,
            )
    names = ["gap", "temperature"]
    if description.schedule is not None:
        names = [_schedule_name(description.schedule, headers)]
    for name in names:
        if name in constants:
            quantity, value = constants[name]
            return None, value, quantity
        matching_headers = [header for header in headers if header.quantity == QUANTITIES.get(name)]
        are_words = len(matching_headers) > 1 and all(header.is_from_words for header in matching_headers)
        if description.schedule is None and name == "temperature" and are_words:
            continue  # several words name a temperature, and none is requested, so none is used
        index = _find_only(source, headers, name)
        if index is not None:
            return index, None, headers[index].quantity
    if description.schedule is not None:
        raise InputError(
            f"{source}: has no column or constant '{description.schedule}' to schedule by "
            f"({_list_columns(headers)}){advise_mapping(headers, names) if names[0] in QUANTITIES else ''}",
            code="column-missing",
            key=description.schedule,
        )
    return None, None, None


def _schedule_name(schedule: str, headers: Sequence[Header]) -> str:
    """Return the name of the quantity that the user requests as scheduling variable."""
    for header in headers:
        if header.text == schedule and header.quantity is not None:
            return header.quantity.name
    quantity = parse_header(schedule).quantity
    return quantity.name if quantity is not None else schedule


def _list_columns(headers: Sequence[Header]) -> str:
    return "columns: " + ", ".join(header.text for header in headers)


Rows = NDArray[np.intp]

MIN_LOOP_SAMPLES = 6
"""Minimum number of samples of a loop."""
_MAX_RANGE_DIFFERENCE = 0.03
"""Maximum relative difference of the ranges of repeated cycles of one record."""


def can_be_label(header: Header, first_fields: Sequence[str]) -> bool:
    """Whether a column can label loops, by its header and its first `MIN_LOOP_SAMPLES` fields."""
    return (
        bool(header.name)
        and len(first_fields) == MIN_LOOP_SAMPLES
        and len(set(first_fields)) == 1
        and first_fields[0] != ""
    )


def find_label(
    source: str,
    headers: Sequence[Header],
    candidates: Mapping[int, Texts],
    drive: FloatArray,
    output: FloatArray,
    schedule: FloatArray | None,
) -> int | None:
    """Return the index of the column that is constant during each loop and changes between loops.

    Each of its values must occur in one run of rows at each scheduling value. The input must
    reverse in each run. The loops must differ in size; otherwise they are cycles of one record.
    """
    rows_of_label: dict[int, list[Rows]] = {}
    for index, column in candidates.items():
        loops = _label_runs(column, schedule)
        if loops is not None and _are_loops(loops, drive, output):
            rows_of_label[index] = loops
    for header in (headers[index] for index in rows_of_label if schedule is None):
        # As a label, a gap or a temperature would have no effect.
        alternative_option = f'if it is only a label: --loop "{header.text}"'
        if can_be_gap(header):
            ask_for_gap(source, header, headers, "gap", alternative_option)
        if header.unit is not None and header.unit.dimension == "temperature":
            ask_for_gap(source, header, headers, "temperature", alternative_option)
    if not rows_of_label:
        return None
    first_column = next(iter(rows_of_label))
    for index, loops in rows_of_label.items():
        if [rows[0] for rows in loops] != [rows[0] for rows in rows_of_label[first_column]]:
            names = [headers[position].text for position in (first_column, index)]
            raise InputError(
                f"{source}: columns '{names[0]}' and '{names[1]}' both can distinguish the loops; state "
                f'which one does: --loop "{names[0]}" or --loop "{names[1]}"',
                code="label-ambiguous",
            )
    return first_column


def _label_runs(column: Texts, schedule: FloatArray | None) -> list[Rows] | None:
    """Return the rows of each loop; ``None`` if a value has several runs at one scheduling value."""
    if np.count_nonzero(np.bincount(column.codes)) < 2:
        return None
    is_change = np.diff(column.codes) != 0
    is_label_change = is_change.copy()
    if schedule is not None:
        is_schedule_step = np.diff(schedule) != 0.0
        if np.count_nonzero(is_schedule_step) > schedule.size // MIN_LOOP_SAMPLES:
            schedule = None  # the schedule changes during the loops
        else:
            is_label_change &= ~is_schedule_step
            is_change |= is_schedule_step
    if not is_label_change.any():
        return None  # the label changes only with the schedule
    run_starts = np.flatnonzero(is_change) + 1
    if column.codes.size < MIN_LOOP_SAMPLES * (run_starts.size + 1):
        return None
    runs = np.split(np.arange(column.codes.size), run_starts)
    keys = {
        (int(column.codes[rows[0]]), None if schedule is None else float(schedule[rows[0]])) for rows in runs
    }
    return runs if len(keys) == len(runs) else None


def _are_loops(loops: list[Rows], drive: FloatArray, output: FloatArray) -> bool:
    spans = np.array([[np.ptp(drive[rows]), np.ptp(output[rows])] for rows in loops])
    if (spans[:, 0] == 0.0).any() or not (
        np.ptp(spans, axis=0) > _MAX_RANGE_DIFFERENCE * spans.max(axis=0)
    ).any():
        return False
    return all(reversal_count(drive[rows]) for rows in loops)


_GAP_NAMES = frozenset({"x", "y", "z", "s", "d", "g", "delta"})
_GAP_WORDS = frozenset(
    {"abstand", "distance", "dist", "standoff", "clearance", "afstand", "distanza", "distancia"}
)


def can_be_gap(header: Header) -> bool:
    """Whether a column can be a gap although its header does not say so, by its unit or name."""
    if header.unit is not None and header.unit.symbol != "-":
        return header.unit.dimension == "length"
    words = set(split_words(header.name))
    named_in_header = named_quantities(header.name)
    is_named = words <= _GAP_NAMES or words & _GAP_WORDS or named_in_header & {"gap", "displacement"}
    return bool(words) and not header.stated and bool(is_named)


def ask_for_gap(
    source: str, header: Header, headers: Sequence[Header], name: str = "gap", alternative: str = ""
) -> NoReturn:
    """Ask whether a column that is constant during each loop is the gap or another quantity."""
    option_without_header = format_option("columns", current_mapping(headers) | {header.text: ""})
    alternative = alternative or f"if it is not a gap: {option_without_header}"
    unit = "" if header.unit else ", in its unit such as gap_mm or gap_um"
    raise InputError(
        f"{source}: column '{header.text}' is constant in each loop; if it is the {name}, map it"
        f"{unit}: {mapping_option(header, name, headers)}; {alternative}",
        code="label-or-schedule",
        key=header.text,
    )
