"""Units and column headers. This is the only module that handles units other than SI.

A header names a quantity and its unit: ``I_A``, ``gap_mm``, ``H [kA/m]``, ``U (mV)``. All other
modules use SI units, with the exception of temperatures in degrees Celsius (``T_C``).
"""

from __future__ import annotations

import difflib
import math
import re
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.vocabulary import (
    QUANTITY_WORDS,
    RAW_UNITS,
    fold,
    has_qualifier,
    is_drive,
    is_formula,
    named_quantities,
    split_words,
    symbol_of_word,
)

MU_0 = 4.0e-7 * math.pi
"""Permeability of vacuum, H/m."""

STANDARD_GRAVITY_M_PER_S2 = 9.80665
"""Standard acceleration of gravity, which converts a mass to the force of its weight."""

_POUND_KG = 0.45359237
_WEIGHTS_KG = {"g": 1e-3, "kg": 1.0, "lb": _POUND_KG, "oz": _POUND_KG / 16.0}
_FORCES_KG = {"gf": 1e-3, "kgf": 1.0, "kp": 1.0, "lbf": _POUND_KG, "ozf": _POUND_KG / 16.0}


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit in a file: ``si = value * scale + offset``."""

    symbol: str
    dimension: str
    si: str
    scale: float
    offset: float = 0.0

    def to_si(self, values: FloatArray) -> FloatArray:
        """Convert values in this unit to SI (temperatures: degrees Celsius).

        Values in SI units are returned unchanged and are not copied.
        """
        if self.scale == 1.0 and self.offset == 0.0:
            return values
        # Division by 1000 gives the nearest float of the written value; multiplication by 0.001
        # does not.
        inverse_scale = round(1.0 / self.scale)
        has_exact_inverse = inverse_scale > 1 and math.isclose(inverse_scale * self.scale, 1.0, rel_tol=1e-12)
        scaled_values = values / inverse_scale if has_exact_inverse else values * self.scale
        return scaled_values + self.offset if self.offset else scaled_values

    def value_to_si(self, value: float) -> float:
        """Convert one value as `to_si` does."""
        return float(self.to_si(np.array([value]))[0])


_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "da": 10.0, "k": 1e3, "M": 1e6}


def _with_prefixes(unit: str, prefixes: str = "") -> dict[str, float]:
    """Return the scales of a unit without a prefix and with each of some prefixes."""
    return {unit: 1.0} | {prefix + unit: _PREFIXES[prefix] for prefix in prefixes.split()}


_UNIT_SCALES: dict[str, tuple[str, dict[str, float]]] = {
    "current": ("A", _with_prefixes("A", "u m k")),
    "field": (
        "A/m",
        _with_prefixes("A/m", "k M")
        | {"A/cm": 1e2, "A/mm": 1e3, "Oe": 1000.0 / (4.0 * math.pi), "kOe": 1e6 / (4.0 * math.pi)},
    ),
    "voltage": ("V", _with_prefixes("V", "u m k")),
    "force": (
        "N",
        _with_prefixes("N", "u m c da k M")
        | {unit: kg * STANDARD_GRAVITY_M_PER_S2 for unit, kg in (_FORCES_KG | _WEIGHTS_KG).items()},
    ),
    "flux_density": ("T", _with_prefixes("T", "u m") | {"G": 1e-4, "kG": 0.1}),
    "flux_linkage": ("Wb", _with_prefixes("Wb", "m u") | _with_prefixes("Vs", "m u")),
    "length": ("m", _with_prefixes("m", "c m u n") | {"in": 0.0254, "ft": 0.3048, "mil": 2.54e-5}),
    "time": ("s", _with_prefixes("s", "m u n") | {"min": 60.0, "h": 3600.0}),
    "moment": ("N_m", _with_prefixes("N_m")),
    "pressure": ("Pa", _with_prefixes("Pa", "k M") | {"bar": 1e5}),
    "frequency": ("Hz", _with_prefixes("Hz", "k")),
    "angle": ("rad", {"rad": 1.0, "deg": math.pi / 180.0}),
    "number": ("1", {"1": 1.0, "-": 1.0, "%": 0.01, "ppm": 1e-6, "um/m": 1e-6}),
}
"""For each dimension: its SI unit, and the scales of all its units."""

_TEMPERATURES = (
    Unit("degC", "temperature", "degC", 1.0),
    Unit("C", "temperature", "degC", 1.0),
    Unit("K", "temperature", "degC", 1.0, -273.15),
    Unit("degF", "temperature", "degC", 5.0 / 9.0, -160.0 / 9.0),
)

UNITS = MappingProxyType(
    {
        symbol: Unit(symbol, dimension, si, scale)
        for dimension, (si, members) in _UNIT_SCALES.items()
        for symbol, scale in members.items()
    }
    | {unit.symbol: unit for unit in _TEMPERATURES}
)
"""All units of headers, by symbol."""


MASS_UNITS = frozenset(_WEIGHTS_KG)
"""Units of mass, which are read as the force of the weight."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """The quantity of a column: its name, its symbol in headers and its SI unit."""

    name: str
    symbol: str
    unit: str

    @property
    def column(self) -> str:
        """Header of this quantity in SI, such as ``I_A``, ``H_A_per_m`` or ``T_C``."""
        if self.unit == "1":
            return self.symbol
        unit = "C" if self.unit == "degC" else self.unit.replace("/", "_per_")
        return f"{self.symbol}_{unit}"

    @property
    def words(self) -> str:
        """Name for a sentence, such as ``flux linkage``."""
        return self.name.replace("_", " ")

    @property
    def label(self) -> str:
        """Label of an axis, such as ``current I [A]``."""
        unit = "°C" if self.unit == "degC" else self.unit
        is_symbol = self.words == self.symbol
        return f"{self.words} [{unit}]" if is_symbol else f"{self.words} {self.symbol} [{unit}]"

    def show(self, value: float) -> str:
        """Return a value as text, lengths in mm: ``gap 0.3 mm``, ``temperature -15 °C``."""
        if self.unit == "m":
            return f"{self.words} {value * 1e3:.4g} mm"
        unit = {"degC": " °C", "1": ""}.get(self.unit, f" {self.unit}")
        return f"{self.words} {value:.4g}{unit}"


QUANTITIES = MappingProxyType(
    {
        quantity.name: quantity
        for quantity in (
            Quantity("current", "I", "A"),
            Quantity("field", "H", "A/m"),
            Quantity("voltage", "u", "V"),
            Quantity("sense_voltage", "u_sense", "V"),
            Quantity("force", "F", "N"),
            Quantity("thrust", "F_th", "N"),
            Quantity("flux_density", "B", "T"),
            Quantity("flux_linkage", "psi", "Wb"),
            Quantity("displacement", "x", "m"),
            Quantity("strain", "eps", "1"),
            Quantity("magnetostriction", "lambda", "1"),
            Quantity("gap", "gap", "m"),
            Quantity("temperature", "T", "degC"),
            Quantity("time", "t", "s"),
        )
    }
)
"""Quantities whose headers are understood without a declared unit, by name."""


def choose_display_unit(quantity: Quantity, largest_value: float) -> tuple[str, float]:
    """Return the display unit of values up to a size, and the factor from SI.

    >>> choose_display_unit(QUANTITIES["displacement"], 4e-5)
    ('µm', 1000000.0)
    """
    if quantity.unit == "m" and largest_value < 1e-3:
        return "µm", 1e6
    return ("ppm", 1e6) if quantity.unit == "1" and largest_value < 1e-2 else (quantity.unit, 1.0)


DRIVE_QUANTITIES = ("current", "field", "voltage")
"""Names of the quantities that can drive a loop, in the order of preference."""

GAP_ADVICE = "gaps count from contact, 0 and up"

LOOP_HEADER = "loop"
"""Header of the column that distinguishes loops."""

QUANTITY_DIMENSIONS = MappingProxyType(
    {
        "sense_voltage": "voltage",
        "displacement": "length",
        "gap": "length",
        "strain": "number",
        "magnetostriction": "number",
        "thrust": "force",
    }
)
"""Dimensions of quantities whose name is not the name of a dimension."""

_SYMBOLS = {quantity.symbol: name for name, quantity in QUANTITIES.items()} | {
    "i": "current",
    "U": "voltage",
    "Psi": "flux_linkage",
    "ψ": "flux_linkage",
    "Ψ": "flux_linkage",
}
_WORDS = {name: name for name in QUANTITIES} | {"air_gap": "gap", "airgap": "gap"}
_AMBIGUOUS_UNITS = frozenset({"in", "g", "h", "min", "ft"})
"""Units that can be another word: the end of ``u_in`` or ``I_min`` is a unit only if it has the
dimension of the name."""
_CHANNEL_WORDS = frozenset({"channel", "chan", "ch", "kanal", "kanaal", "canal", "canale", "voie",
                       "input", "eingang", "port", "analog", "sensor"})  # fmt: skip
"""Words after which a letter numbers a channel and is not a unit, such as ``Channel A``."""
_TIME_AXIS_NAMES = frozenset({"x", "t", "x-axis", "x_axis", "xaxis"})
"""Names of a clock if the unit is a unit of time."""
_NO_UNIT_MARK = "-"
"""Mark of recorders for a channel without a unit."""
_BRACKET_PATTERN = re.compile(
    r"^(?P<name>.*?)[\s_/]*[\[(<{]\s*(?P<unit>[^\[\]()<>{}]*(?:\([^()]*\))?)\s*[\])>}]$"
)
_INNER_BRACKET_PATTERN = re.compile(
    r"^(?P<name>[^\[(<{]+?)[\s_/]*[\[(<{](?P<unit>[^\])>}]+)[\])>}]\s*(?P<tail>.+)$"
)
"""A unit in brackets before other text, such as ``I [mA] (range 2 A)``."""
_UNSUPPORTED_UNIT_PATTERN = re.compile(
    r"\w\s*/\s*\(?([mk]?Nm|Nc?m+|[mk]?W|k?Ohm|Ω|rpm|[µun]?C|[kM]?V/[mc]?m)\)?$"
)
"""Units after a slash that no known quantity has."""
_PER_LENGTH_PATTERN = re.compile(r"^(.+?)[\s.·*]*(cm|mm|m|metre|meter)\s*\^?-1$")
"""A unit per length, such as ``A m^-1``."""


@dataclass(frozen=True, slots=True)
class Header:
    """A parsed column header."""

    text: str
    name: str
    quantity: Quantity | None
    unit: Unit | None
    problem: str | None = None
    stated: str = ""  # unit as written in brackets or in a row of units
    is_from_words: bool = False  # whether words of the name and the unit gave the quantity
    target: str | None = None  # name to which the user maps the column; None: not mapped
    scale: float | None = None  # value in our unit per unit in the file; None: not stated
    is_flipped: bool = False  # whether the sign is reversed
    conflict: tuple[str, ...] = ()  # two units that the header states for the same values

    def to_si(self, values: FloatArray) -> FloatArray:
        """Convert values of the column to SI with the scale, sign and unit of the column."""
        factor = (self.scale or 1.0) * (-1.0 if self.is_flipped else 1.0)
        scaled_values = values if factor == 1.0 else values * factor
        return scaled_values if self.unit is None else self.unit.to_si(scaled_values)

    @property
    def is_certain(self) -> bool:
        """Whether the user maps the column, or its name is a symbol of this module."""
        return self.target is not None or split_header(_strip_count(self.text))[0] == self.name

    @property
    def is_clock(self) -> bool:
        """Whether the column is a time, with or without a unit."""
        return self.quantity is not None and self.quantity.name == "time"

    @property
    def is_label(self) -> bool:
        """Whether the column distinguishes loops instead of measuring something."""
        return self.quantity is None

    @property
    def is_known(self) -> bool:
        """Whether the column contains one of the known quantities."""
        return self.quantity is not None and self.quantity.name in QUANTITIES


def find_unit(text: str) -> Unit | None:
    """Find a unit in any common spelling: ``A_per_m``, ``A.m-1``, ``µm``, ``V s``, ``Volts``.

    Symbols are case-sensitive (mN and MN differ), words are not.
    """
    normalised_text = text.strip().replace("µ", "u").replace("μ", "u").replace("°", "deg")
    normalised_text = normalised_text.replace("⁻¹", "^-1").replace("''", '"').replace('"', "in")
    normalised_text = re.sub(r"_per_|\s+per\s+", "/", normalised_text)
    normalised_text = _PER_LENGTH_PATTERN.sub(r"\1/\2", normalised_text)
    numerator, slash, denominator = normalised_text.partition("/")
    return UNITS.get(_normalise_symbol(numerator) + slash + _normalise_symbol(denominator))


def _normalise_symbol(text: str) -> str:
    """Return the symbol of a unit without a slash; other texts without blanks and points."""
    symbol = re.sub(r"[·*.\s]", "", text)
    return symbol if symbol in UNITS else symbol_of_word(text.strip(". ")) or symbol


def require_unit(text: str) -> Unit:
    """Find a unit, or raise an error."""
    unit = find_unit(text)
    if unit is None:
        raise InputError(_unknown_unit_text(text), code="unknown-unit")
    return unit


def _strip_count(text: str) -> str:
    """Return a header without the count that readers append to repeated names."""
    return re.sub(r"(?<=.)#[2-9]\d*$", "", text)


def parse_header(text: str, unit: str | None = None) -> Header:
    """Parse a column header. A count such as ``#2`` at its end distinguishes equal headers."""
    text = text.strip()
    return replace(_parse_text(_strip_count(text), unit), text=text)


def _parse_text(text: str, unit: str | None) -> Header:
    """Parse the text of a column header without blanks around it."""
    name, unit_text = split_header(text, unit)
    problem, conflict = None, _find_conflict(text, unit)
    if conflict:
        problem = f"its name says {conflict[0]}, its unit {conflict[1]}"
        name, unit_text = split_header(split_header(text)[0] if unit is None else text)
    if name.lower() == LOOP_HEADER:
        return Header(text, LOOP_HEADER, None, None)
    quantity = _find_quantity(name)
    stated_unit = unit_text if unit or _BRACKET_PATTERN.match(text) or fold(unit_text) in RAW_UNITS else ""
    if not unit_text and (unsupported_match := _UNSUPPORTED_UNIT_PATTERN.search(text)):
        stated_unit = unsupported_match[1]
    axis_unit = find_unit(unit_text) or find_unit(unit_text.lower())
    if name.lower() in _TIME_AXIS_NAMES and axis_unit is not None and axis_unit.dimension == "time":
        quantity = QUANTITIES["time"]
    if name in {"lambda", "λ", "Λ"} and axis_unit is not None and axis_unit.dimension == "flux_linkage":
        quantity = QUANTITIES["flux_linkage"]
    if problem is not None:
        quantity = quantity or _quantity_from_words(name, find_unit(conflict[1])) or Quantity(name, name, "1")
        return Header(text, name, quantity, None, problem, stated_unit, conflict=conflict)
    is_gap = not unit_text and named_quantities(name) == {"gap"}
    if quantity is None and is_gap and not (has_qualifier(name) or is_formula(name)):
        quantity = QUANTITIES["gap"]
    if quantity is None and not unit_text:
        name_or_time, unit_text = _parse_clock(name)
        if name_or_time != name:
            unit_of_clock = find_unit(unit_text)
            problem = None if unit_of_clock else _describe_unit_problem(QUANTITIES["time"], "", None)
            return Header(text, name_or_time, QUANTITIES["time"], unit_of_clock, problem, is_from_words=True)
    header_unit = find_unit(unit_text) if unit_text else None
    if quantity is not None and quantity.unit == "1" and not unit_text:
        header_unit = UNITS["1"]
    if quantity is None and (quantity_by_words := _quantity_from_words(name, header_unit)) is not None:
        return Header(
            text,
            quantity_by_words.symbol,
            quantity_by_words,
            header_unit,
            stated=stated_unit,
            is_from_words=True,
        )
    if quantity is None:
        unknown_quantity = Quantity(name, name, header_unit.si if header_unit else "1")
        problem = _unknown_unit_text(unit_text) if unit_text and not header_unit else None
        return Header(text, name, unknown_quantity, header_unit, problem, stated_unit)
    problem = _describe_unit_problem(quantity, unit_text, header_unit)
    return Header(text, quantity.symbol, quantity, header_unit, problem, stated_unit)


def _parse_clock(name: str) -> tuple[str, str]:
    """Return ``t`` and the unit, if known, of a column that can only be a clock; else the name."""
    unit = find_unit(name)
    if name.lower() == "tout":  # the clock of Simulink, in s
        return "t", "s"
    if unit is not None and unit.dimension == "time" and len(name) > len(unit.symbol):
        return "t", unit.symbol  # a column called 'Seconds'
    words = set(split_words(name))
    return ("t", "") if words and words <= QUANTITY_WORDS["time"] else (name, "")


def _quantity_from_words(name: str, unit: Unit | None) -> Quantity | None:
    """Return the only quantity that matches the words of a name and the unit, or None."""
    candidates = named_quantities(name) if unit is not None else set()
    matches = [key for key in candidates if unit and QUANTITY_DIMENSIONS.get(key, key) == unit.dimension]
    is_doubted = matches != ["time"] and (has_qualifier(name) or is_formula(name))
    if len(matches) != 1 or is_doubted:
        return None
    if matches == ["voltage"] and not is_drive(name):
        return None
    return QUANTITIES[matches[0]]


def split_header(text: str, unit: str | None = None) -> tuple[str, str]:
    """Split a header into the name and the unit as written; the unit is empty if there is none.

    >>> split_header("H_A_per_m"), split_header("I [mA]"), split_header("I_A", "A")
    (('H', 'A_per_m'), ('I', 'mA'), ('I', 'A'))
    """
    text = text.strip()
    stated_unit = (unit or "").strip(" []()")
    name, unit_text = _split_brackets(text)
    if not stated_unit or (stated_unit == _NO_UNIT_MARK and find_unit(unit_text)):
        return name, unit_text
    return (
        (name, stated_unit)
        if _is_same_unit(find_unit(unit_text), find_unit(stated_unit))
        else (text, stated_unit)
    )


def join_header(name: str, unit: str) -> str:
    """Return the header of a name and a unit: ``I_A``, or ``spindle torque [Nm]``."""
    if not unit:
        return name
    header = f"{name}_{unit.replace('/', '_per_')}"
    is_unambiguous = (
        find_unit(unit) is not None and _split_underscore(header)[0] == name and " " not in header
    )
    return header if is_unambiguous and not _BRACKET_PATTERN.match(header) else f"{name} [{unit}]"


def _split_brackets(text: str) -> tuple[str, str]:
    """Split a header at the brackets around its unit, or else as `_split_underscore` does."""
    bracket_match, inner_match = _BRACKET_PATTERN.match(text), _INNER_BRACKET_PATTERN.match(text)
    if bracket_match and find_unit(bracket_match["unit"]):
        name, unit_text = bracket_match["name"].strip(), bracket_match["unit"].strip()
        inner_name, inner_unit = _split_brackets(name) if name else ("", "")
        return (
            (inner_name, unit_text)
            if _is_same_unit(find_unit(inner_unit), find_unit(unit_text))
            else (name, unit_text)
        )
    if inner_match and find_unit(inner_match["unit"]):
        return f"{inner_match['name']} {inner_match['tail']}", inner_match["unit"].strip()
    if bracket_match:
        name, unit_text = bracket_match["name"].strip(), bracket_match["unit"].strip()
        inner_name, inner_unit = _split_underscore(name.replace(" ", "_"))
        return (f"{inner_name} ({unit_text})", inner_unit) if find_unit(inner_unit) else (name, unit_text)
    text_without_in = re.sub(r"\s+in\s+", " ", text)
    return _split_slash(text) or _split_underscore(text_without_in.replace(" ", "_"))


def _split_slash(text: str) -> tuple[str, str] | None:
    """Split ``NAME/UNIT``, ``NAME.UNIT`` and ``ImA``; None if the text has none of these forms."""
    splits = [
        (text[: separator_match.start()], text[separator_match.end() :])
        for separator_match in re.finditer("/", text)
    ]
    splits += [
        (text[: separator_match.start()], text[separator_match.end() :])
        for separator_match in re.finditer(r"\.", text)
    ]
    splits += [(sign, text.removeprefix(sign)) for sign in _SYMBOLS
              if text.startswith(sign) and len(text) > len(sign) + 1]  # fmt: skip
    unknown_split = None
    for name_text, unit_part in splits:
        name, unit_text = name_text.strip(" _"), unit_part.strip(" _")
        unit, quantity = find_unit(unit_text), _find_quantity(name)
        if unit is None or not name or find_unit(text) or not _can_end_with(name, unit):
            continue
        names = {quantity.name} if quantity else named_quantities(name)
        is_stroke, is_time = text[len(name_text)] == "/", name == "T" and unit.dimension == "time"
        if unit.dimension in {QUANTITY_DIMENSIONS.get(key, key) for key in names} or (is_time and is_stroke):
            return name, unit_text
        # 'J/T' is a name and a unit; 'F/A' and 'm/s' are ratios.
        is_named = len(unit_text) > 1 if quantity else find_unit(name) is None
        if unknown_split is None and is_stroke and is_named and unit_text != "1":
            unknown_split = name, unit_text
    return unknown_split


def _find_conflict(text: str, unit: str | None) -> tuple[str, ...]:
    """Return the two different units that a header states; empty if they do not differ."""
    stated_unit = (unit or "").strip(" []()")
    name, unit_text = split_header(text)
    if not stated_unit and _BRACKET_PATTERN.match(text):
        # The volts of 'I_A [V]' come from a sensor. The A of 'I_mA [A]' are a contradiction.
        inner_unit, outer_unit = find_unit(split_header(name)[1]), find_unit(unit_text)
        if (
            inner_unit
            and outer_unit
            and inner_unit.dimension == outer_unit.dimension
            and not _is_same_unit(inner_unit, outer_unit)
        ):
            return inner_unit.symbol, outer_unit.symbol
    name_unit = find_unit(unit_text) if unit_text else None
    if (
        not stated_unit
        or stated_unit == _NO_UNIT_MARK
        or name_unit is None
        or _is_same_unit(name_unit, find_unit(stated_unit))
    ):
        return ()
    return unit_text, stated_unit


def _is_same_unit(unit: Unit | None, other_unit: Unit | None) -> bool:
    if unit is None or other_unit is None:
        return False
    return replace(unit, symbol="") == replace(other_unit, symbol="")


def _split_underscore(text: str) -> tuple[str, str]:
    """Split ``name_unit`` at the longest ending that is a unit, or after a known symbol."""
    name_parts = text.split("_")
    for split_index in range(1, len(name_parts)):
        head, tail = "_".join(name_parts[:split_index]), "_".join(name_parts[split_index:])
        unit = find_unit(tail)
        if unit and tail not in {"1", "-", "%"} and _can_end_with(head, unit):
            return head.rstrip("_:,-") or head, tail
    if _find_quantity(text) is None and _find_quantity(name_parts[0]) is not None:
        return name_parts[0], "_".join(name_parts[1:])
    return text, ""


def _can_end_with(head: str, unit: Unit) -> bool:
    """Whether a name can end with this unit: not the A of 'Channel A', or the min of 'I_min'."""
    if head.lower() in _CHANNEL_WORDS:
        return False
    if unit.symbol not in _AMBIGUOUS_UNITS:
        return True
    quantity = _find_quantity(head)
    names = {quantity.name} if quantity else named_quantities(head)
    return unit.dimension in {QUANTITY_DIMENSIONS.get(name, name) for name in names}


def _find_quantity(name: str) -> Quantity | None:
    key = _SYMBOLS.get(name) or _WORDS.get(name.lower().replace(" ", "_"))
    return QUANTITIES[key] if key else None


def _describe_unit_problem(quantity: Quantity, unit_text: str, unit: Unit | None) -> str | None:
    dimension = QUANTITY_DIMENSIONS.get(quantity.name, quantity.name)
    examples = " or ".join(f"'{quantity.symbol}_{symbol}'" for symbol in _example_symbols(dimension))
    if unit is None:
        if unit_text:
            return f"{_unknown_unit_text(unit_text)}; write {examples}"
        return f"has no unit; call it {examples}"
    if unit.dimension != dimension:
        kind = unit.dimension.replace("_", " ")
        return f"'{unit.symbol}' is a unit of {kind}, not of {quantity.words}; write {examples}"
    return None


def _example_symbols(dimension: str) -> tuple[str, ...]:
    if dimension == "temperature":
        return ("C", "K")
    if dimension == "length":
        return ("m", "mm")
    symbols = [unit.symbol for unit in UNITS.values() if unit.dimension == dimension]
    return tuple(symbol.replace("/", "_per_") for symbol in symbols[:1])


def _unknown_unit_text(text: str) -> str:
    similar_symbols = difflib.get_close_matches(text, UNITS, n=2, cutoff=0.5)
    similar_text = f" (did you mean {' or '.join(similar_symbols)}?)" if similar_symbols else ""
    return f"unknown unit '{text}'{similar_text}"


def schedule_scale(quantity: Quantity | None) -> tuple[str, float]:
    """Return the heading of the scheduling variable and its display factor; lengths are in mm."""
    if quantity is None:
        return "", 1.0
    if quantity.unit == "m":
        return f"{quantity.symbol} mm", 1e3
    return f"{quantity.symbol} {quantity.unit}", 1.0


def key_in_words(key: str) -> str:
    """Return the key of a file as words, for prose: its name, and its unit in brackets.

    >>> key_in_words("iron_length_m"), key_in_words("resistance_ohm"), key_in_words("position_gain")
    ('iron length [m]', 'resistance [Ω]', 'position gain')
    """
    name, _, unit = key.rpartition("_")
    if unit not in _UNIT_SIGNS:
        name, unit = split_header(key)
    words = name.replace("_", " ")
    return f"{words} [{_UNIT_SIGNS.get(unit, unit)}]" if unit else words


_UNIT_SIGNS = {"ohm": "Ω", "percent": "%"}
"""Units of keys that no column of a measurement has."""
