"""Which column of a table is input, output, time, loop label and scheduling variable."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from anhyst.data.hints import map_one, mapping
from anhyst.data.output_map import OUTPUT_MAPS
from anhyst.data.sidecar import FileDescription
from anhyst.support.errors import InputError
from anhyst.support.units import INPUTS, QUANTITIES, Header, Quantity, parse_header

_NO_SCHEDULE = "none"
_INPUT_EXAMPLES = "'I_A', 'H_A_per_m' or 'u_V'"
_OUTPUT_EXAMPLES = "'F_N', 'B_T', 'psi_Wb' or 'x_m'"


@dataclass(frozen=True, slots=True)
class Roles:
    """Indices of the columns that play a part."""

    input: int
    output: int
    time: int | None
    label: int | None
    fixed_label: str | None
    schedule: int | None  # column of the scheduling variable
    fixed: float | None  # or its value in the whole file, SI
    quantity: Quantity | None  # which it is; None if nothing is scheduled
    chosen: bool  # whether it was asked for by name
    idle: tuple[int, ...]  # columns without a part
    label_found: bool = False

    def with_label(self, label: int | None) -> Roles:
        """Return the same roles with a label that the data gave away; ``None`` changes nothing."""
        if label is None:
            return self
        idle = tuple(index for index in self.idle if index != label)
        return replace(self, label=label, idle=idle, label_found=True)

    def notes(self, headers: Sequence[Header]) -> list[str]:
        """Say what was found about the columns, and what was left."""
        remarks = []
        if self.label_found and self.label is not None:
            remarks.append(f"column '{headers[self.label].text}' tells the loops apart")
        if self.idle:
            idle = ", ".join(headers[index].text for index in self.idle)
            remarks.append(f"columns not used: {idle}")
        return remarks


def find_roles(
    place: str, headers: Sequence[Header], given: FileDescription, skip: Collection[int] = ()
) -> Roles:
    """Decide what each column is."""
    drive, answer = _pair(place, headers, skip)
    time = _only(place, headers, "time")
    label = _label(place, headers, given)
    fixed_label = _fixed_label(given.constants)
    if label is not None and fixed_label is not None:
        raise InputError(
            f"{place}: the loop label is both a column and a constant; keep one",
            code="column-and-constant",
        )
    schedule, fixed, quantity = _schedule(place, headers, given)
    used = {drive, answer, time, label, schedule}
    idle = tuple(
        index
        for index, header in enumerate(headers)
        if index not in used and header.text and header.text not in given.select
    )
    chosen = given.schedule is not None
    return Roles(drive, answer, time, label, fixed_label, schedule, fixed, quantity, chosen, idle)


def find_column(place: str, headers: Sequence[Header], name: str) -> int:
    """Index of a column by the header as it stands in the file."""
    for index, header in enumerate(headers):
        if header.text == name:
            return index
    raise InputError(
        f"{place}: has no column '{name}' ({_have(headers)})", code="no-such-column", key=name
    )


def with_file_name(path: Path, given: FileDescription) -> FileDescription:
    """Add the constants that the file's name holds, by the pattern ``file_name``."""
    if given.file_name is None:
        return given
    pieces = re.split(r"\{([^{}]+)\}", given.file_name)
    keys = pieces[1::2]
    pattern = "(.+)".join(re.escape(piece) for piece in pieces[::2])
    match = re.fullmatch(pattern, path.stem) or re.fullmatch(pattern, path.name)
    if not keys or match is None:
        raise InputError(
            f"{path}: the name does not fit file_name = '{given.file_name}'; a pattern is like "
            "'gd_T{T_C}C'",
            code="file-name-pattern",
            key="file_name",
        )
    constants: dict[str, float | str] = dict(given.constants)
    for key, text in zip(keys, match.groups(), strict=True):
        if parse_header(key).is_label:
            constants[key] = text
            continue
        try:
            constants[key] = float(text)
        except ValueError:
            raise InputError(
                f"{path}: '{text}' in the name is no number for {key}",
                code="file-name-pattern",
                key=key,
            ) from None
    return replace(given, constants=constants)


def _pair(place: str, headers: Sequence[Header], skip: Collection[int]) -> tuple[int, int]:
    """Find input and output; what is missing is asked for together."""
    pair = [_first(place, headers, names) for names in (INPUTS, tuple(OUTPUT_MAPS))]
    drive, answer = pair
    if drive is not None and answer is not None:
        return drive, answer
    field = drive is not None and headers[drive].name == "H"
    outputs = ("flux_density", *OUTPUT_MAPS) if field else tuple(OUTPUT_MAPS)
    missing = [names for index, names in zip(pair, (INPUTS, outputs), strict=True) if index is None]
    what, examples = ("an output", _OUTPUT_EXAMPLES)
    if drive is None:
        what, examples = ("an input", _INPUT_EXAMPLES)
    raise InputError(
        f"{place}: has no column for {what} ({_have(headers)}); name it {examples}"
        f"{mapping(headers, *missing, skip=skip)}",
        code="column-missing",
    )


def _first(place: str, headers: Sequence[Header], names: Sequence[str]) -> int | None:
    indices = (_only(place, headers, name) for name in names)
    return next((index for index in indices if index is not None), None)


def _only(place: str, headers: Sequence[Header], name: str) -> int | None:
    """Index of the one usable column of a quantity; ``None`` if the table has none."""
    indices = [
        i for i, h in enumerate(headers) if h.quantity is not None and h.quantity.name == name
    ]
    healthy = [index for index in indices if headers[index].problem is None]
    if len(healthy) > 1:
        texts = " and ".join(f"'{headers[index].text}'" for index in healthy)
        leave = f'--columns "{headers[healthy[1]].text}="'
        raise InputError(
            f"{place}: columns {texts} are both {name}; leave one out: {leave}",
            code="column-twice",
            key=name,
        )
    if indices and not healthy:
        header = headers[indices[0]]
        raise InputError(
            f"{place}: column '{header.text}': {header.problem}{map_one(header)}",
            code="bad-header",
            key=header.text,
        )
    return healthy[0] if healthy else None


def _label(place: str, headers: Sequence[Header], given: FileDescription) -> int | None:
    if given.loop is not None:
        return find_column(place, headers, given.loop)
    indices = [index for index, header in enumerate(headers) if header.is_label]
    if len(indices) > 1:
        texts = " and ".join(f"'{headers[index].text}'" for index in indices)
        raise InputError(
            f"{place}: columns {texts} both label loops; leave one out", code="column-twice"
        )
    return indices[0] if indices else None


def _fixed_label(constants: Mapping[str, float | str]) -> str | None:
    for key, value in constants.items():
        if parse_header(key).is_label:
            return str(value)
    return None


def _fixed_values(
    place: str, constants: Mapping[str, float | str]
) -> dict[str, tuple[Quantity, float]]:
    """Constants of the whole file in SI units, by the name of their quantity."""
    values: dict[str, tuple[Quantity, float]] = {}
    for key, value in constants.items():
        header = parse_header(key)
        if header.quantity is None:
            continue
        if header.problem:
            raise InputError(
                f"{place}: constant '{key}': {header.problem}", code="bad-constant", key=key
            )
        try:
            number = float(value)
        except ValueError:
            raise InputError(
                f"{place}: constant '{key}': '{value}' is no number", code="bad-constant", key=key
            ) from None
        if header.unit:
            number = header.unit.value_to_si(number)
        values[header.quantity.name] = (header.quantity, number)
    return values


def _schedule(
    place: str, headers: Sequence[Header], given: FileDescription
) -> tuple[int | None, float | None, Quantity | None]:
    """Find the scheduling variable: what was asked for, else the gap, else the temperature."""
    if given.schedule == _NO_SCHEDULE:
        return None, None, None
    fixed = _fixed_values(place, given.constants)
    for name in fixed:
        if any(h.quantity is not None and h.quantity.name == name for h in headers):
            raise InputError(
                f"{place}: {name} is both a column and a constant; keep one",
                code="column-and-constant",
                key=name,
            )
    names = ["gap", "temperature"] if given.schedule is None else [_meant(given.schedule, headers)]
    for name in names:
        if name in fixed:
            quantity, value = fixed[name]
            return None, value, quantity
        index = _only(place, headers, name)
        if index is not None:
            return index, None, headers[index].quantity
    if given.schedule is not None:
        raise InputError(
            f"{place}: has no column or constant '{given.schedule}' to schedule by "
            f"({_have(headers)}){mapping(headers, names) if names[0] in QUANTITIES else ''}",
            code="column-missing",
            key=given.schedule,
        )
    return None, None, None


def _meant(schedule: str, headers: Sequence[Header]) -> str:
    """Name of the quantity that a scheduling variable is asked for by."""
    for header in headers:
        if header.text == schedule and header.quantity is not None:
            return header.quantity.name
    quantity = parse_header(schedule).quantity
    return quantity.name if quantity is not None else schedule


def _have(headers: Sequence[Header]) -> str:
    return "columns: " + ", ".join(header.text for header in headers)
