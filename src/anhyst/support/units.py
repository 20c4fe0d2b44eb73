"""Units and column headers: the only place where anything but SI is known.

A header names a quantity and its unit: ``I_A``, ``gap_mm``, ``H [kA/m]``, ``U (mV)``. Everything
behind this file is SI, except temperature, which stays in degrees Celsius (``T_C``).
"""

from __future__ import annotations

import difflib
import math
import re
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

MU_0 = 4.0e-7 * math.pi
"""Permeability of vacuum, H/m."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of the file boundary: ``si = value * scale + offset``."""

    symbol: str
    dimension: str
    si: str
    scale: float
    offset: float = 0.0

    def to_si(self, values: FloatArray) -> FloatArray:
        """Convert values in this unit to SI (temperature: degrees Celsius).

        Values that are SI already come back as they are, not copied.
        """
        if self.scale == 1.0 and self.offset == 0.0:
            return values
        # Dividing by 1000 gives the float nearest to what was written; times 0.001 does not.
        inverse = round(1.0 / self.scale)
        exact = inverse > 1 and math.isclose(inverse * self.scale, 1.0, rel_tol=1e-12)
        scaled = values / inverse if exact else values * self.scale
        return scaled + self.offset if self.offset else scaled

    def value_to_si(self, value: float) -> float:
        """Convert one value as `to_si` does."""
        return float(self.to_si(np.array([value]))[0])


_FAMILIES: tuple[tuple[str, str, tuple[tuple[str, float], ...]], ...] = (
    ("current", "A", (("A", 1.0), ("uA", 1e-6), ("mA", 1e-3), ("kA", 1e3))),
    (
        "field",
        "A/m",
        (
            ("A/m", 1.0),
            ("A/cm", 1e2),
            ("A/mm", 1e3),
            ("kA/m", 1e3),
            ("MA/m", 1e6),
            ("Oe", 1000.0 / (4.0 * math.pi)),
            ("kOe", 1e6 / (4.0 * math.pi)),
        ),
    ),
    ("voltage", "V", (("V", 1.0), ("uV", 1e-6), ("mV", 1e-3), ("kV", 1e3))),
    ("force", "N", (("N", 1.0), ("uN", 1e-6), ("mN", 1e-3), ("kN", 1e3))),
    ("flux_density", "T", (("T", 1.0), ("uT", 1e-6), ("mT", 1e-3), ("G", 1e-4), ("kG", 0.1))),
    (
        "flux_linkage",
        "Wb",
        (("Wb", 1.0), ("mWb", 1e-3), ("uWb", 1e-6), ("Vs", 1.0), ("mVs", 1e-3), ("uVs", 1e-6)),
    ),
    ("length", "m", (("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("um", 1e-6), ("nm", 1e-9))),
    ("time", "s", (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))),
    ("moment", "N_m", (("N_m", 1.0),)),
    ("pressure", "Pa", (("Pa", 1.0), ("kPa", 1e3), ("MPa", 1e6), ("bar", 1e5))),
    ("frequency", "Hz", (("Hz", 1.0), ("kHz", 1e3))),
    ("angle", "rad", (("rad", 1.0), ("deg", math.pi / 180.0))),
    ("number", "1", (("1", 1.0), ("-", 1.0), ("%", 0.01), ("ppm", 1e-6))),
)

_TEMPERATURES = (
    Unit("degC", "temperature", "degC", 1.0),
    Unit("C", "temperature", "degC", 1.0),
    Unit("K", "temperature", "degC", 1.0, -273.15),
)

UNITS = MappingProxyType(
    {
        symbol: Unit(symbol, dimension, si, scale)
        for dimension, si, members in _FAMILIES
        for symbol, scale in members
    }
    | {unit.symbol: unit for unit in _TEMPERATURES}
)
"""Every unit a header may carry, by its symbol."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """What a column measures: its name, its symbol in headers and its SI unit."""

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
    def label(self) -> str:
        """Text for an axis, such as ``current I [A]``."""
        unit = "°C" if self.unit == "degC" else self.unit
        name = self.name.replace("_", " ")
        return f"{name} [{unit}]" if name == self.symbol else f"{name} {self.symbol} [{unit}]"

    def show(self, value: float) -> str:
        """Text for a value, lengths in mm: ``gap 0.3 mm``, ``temperature -15 °C``."""
        name = self.name.replace("_", " ")
        if self.unit == "m":
            return f"{name} {value * 1e3:.4g} mm"
        unit = {"degC": " °C", "1": ""}.get(self.unit, f" {self.unit}")
        return f"{name} {value:.4g}{unit}"


QUANTITIES = MappingProxyType(
    {
        quantity.name: quantity
        for quantity in (
            Quantity("current", "I", "A"),
            Quantity("field", "H", "A/m"),
            Quantity("voltage", "u", "V"),
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
"""The quantities whose headers are understood without a declared unit, by name."""


def in_small_unit(quantity: Quantity, largest: float) -> tuple[str, float]:
    """Return the unit that values up to a size are shown in, and what to multiply SI by.

    >>> in_small_unit(QUANTITIES["displacement"], 4e-5), in_small_unit(QUANTITIES["force"], 4e-5)
    (('µm', 1000000.0), ('N', 1.0))
    """
    if quantity.unit == "m" and largest < 1e-3:
        return "µm", 1e6
    return ("ppm", 1e6) if quantity.unit == "1" and largest < 1e-2 else (quantity.unit, 1.0)


INPUTS = ("current", "field", "voltage")
"""Names of the quantities that drive a loop, first choice first."""

GAP_ADVICE = "gaps count from contact, 0 and up"

LABEL = "loop"
"""Header of the column that distinguishes loops."""

DIMENSIONS = MappingProxyType(
    {
        "displacement": "length",
        "gap": "length",
        "strain": "number",
        "magnetostriction": "number",
        "thrust": "force",
    }
)
"""Dimensions of quantities that are not their names."""

_SYMBOLS = {quantity.symbol: name for name, quantity in QUANTITIES.items()} | {
    "i": "current",
    "U": "voltage",
    "Psi": "flux_linkage",
    "ψ": "flux_linkage",
    "Ψ": "flux_linkage",
}
_WORDS = {name: name for name in QUANTITIES} | {"air_gap": "gap", "airgap": "gap"}
_NO_UNIT = "-"
"""What recorders write where nobody said a unit."""
_BRACKETS = re.compile(r"^(?P<name>.*?)[\s_]*[\[(]\s*(?P<unit>[^\[\]()]*(?:\([^()]*\))?)\s*[\])]$")


@dataclass(frozen=True, slots=True)
class Header:
    """A column header, understood."""

    text: str
    name: str
    quantity: Quantity | None
    unit: Unit | None
    problem: str | None = None

    @property
    def is_label(self) -> bool:
        """Whether the column distinguishes loops instead of measuring something."""
        return self.quantity is None

    @property
    def is_known(self) -> bool:
        """Whether the column holds one of the known quantities."""
        return self.quantity is not None and self.quantity.name in QUANTITIES


def find_unit(text: str) -> Unit | None:
    """Look a unit up, forgiving its spelling (``A_per_m``, ``µm``, ``°C``, ``V s``)."""
    plain = text.strip().replace("_per_", "/").replace("µ", "u").replace("μ", "u")
    plain = plain.replace("°", "deg").replace("·", "").replace("*", "").replace(" ", "")
    return UNITS.get(plain)


def unit_of(text: str) -> Unit:
    """Look a unit up or fail."""
    unit = find_unit(text)
    if unit is None:
        raise InputError(_unknown_unit(text), code="unknown-unit")
    return unit


def parse_header(text: str, unit: str | None = None) -> Header:
    """Understand a column header."""
    text = text.strip()
    name, written = split_header(text, unit)
    problem = _conflict(text, unit)
    if problem is not None:
        name, written = split_header(text)
    if name.lower() == LABEL:
        return Header(text, LABEL, None, None)
    known = _known(name)
    if problem is not None:
        return Header(text, name, known or Quantity(name, name, "1"), None, problem)
    header_unit = find_unit(written) if written else None
    if known is not None and known.unit == "1" and not written:
        header_unit = UNITS["1"]
    if known is None:
        free = Quantity(name, name, header_unit.si if header_unit else "1")
        problem = _unknown_unit(written) if written and not header_unit else None
        return Header(text, name, free, header_unit, problem)
    return Header(
        text, known.symbol, known, header_unit, _unit_problem(known, written, header_unit)
    )


def split_header(text: str, unit: str | None = None) -> tuple[str, str]:
    """Split a header into the name and the unit as written, empty if there is none.

    >>> split_header("H_A_per_m"), split_header("I [mA]"), split_header("I_A", "A")
    (('H', 'A_per_m'), ('I', 'mA'), ('I', 'A'))
    """
    text = text.strip()
    stated = (unit or "").strip(" []()")
    brackets = _BRACKETS.match(text)
    if brackets:
        name, written = brackets["name"].strip(), brackets["unit"].strip()
    else:
        name, written = _split(text.replace(" ", "_"))
    if not stated or (stated == _NO_UNIT and find_unit(written)):
        return name, written
    return (name, stated) if _same(find_unit(written), find_unit(stated)) else (text, stated)


def join_header(name: str, unit: str) -> str:
    """Return the header of a name and a unit: ``I_A``, or ``spindle torque [Nm]``."""
    if not unit:
        return name
    header = f"{name}_{unit.replace('/', '_per_')}"
    plain = find_unit(unit) is not None and _split(header)[0] == name and " " not in header
    return header if plain and not _BRACKETS.match(header) else f"{name} [{unit}]"


def _conflict(text: str, unit: str | None) -> str | None:
    """Say what is wrong with a name that holds another unit than the one that stands apart."""
    stated = (unit or "").strip(" []()")
    written = split_header(text)[1]
    own = find_unit(written) if written else None
    if not stated or stated == _NO_UNIT or own is None or _same(own, find_unit(stated)):
        return None
    return f"its name says {written}, its unit {stated}"


def _same(first: Unit | None, other: Unit | None) -> bool:
    return (
        first is not None
        and other is not None
        and (first.dimension, first.scale, first.offset)
        == (other.dimension, other.scale, other.offset)
    )


def _split(text: str) -> tuple[str, str]:
    """Split ``name_unit`` at the longest tail that is a unit, or after a known symbol."""
    parts = text.split("_")
    for cut in range(1, len(parts)):
        tail = "_".join(parts[cut:])
        if find_unit(tail) and tail not in {"1", "-", "%"}:
            return "_".join(parts[:cut]), tail
    if _known(text) is None and _known(parts[0]) is not None:
        return parts[0], "_".join(parts[1:])
    return text, ""


def _known(name: str) -> Quantity | None:
    key = _SYMBOLS.get(name) or _WORDS.get(name.lower().replace(" ", "_"))
    return QUANTITIES[key] if key else None


def _unit_problem(quantity: Quantity, written: str, unit: Unit | None) -> str | None:
    dimension = DIMENSIONS.get(quantity.name, quantity.name)
    examples = " or ".join(f"'{quantity.symbol}_{symbol}'" for symbol in _examples(dimension))
    if unit is None:
        if written:
            return f"{_unknown_unit(written)}; write {examples}"
        return f"has no unit; call it {examples}"
    if unit.dimension != dimension:
        kind = unit.dimension.replace("_", " ")
        name = quantity.name.replace("_", " ")
        return f"'{unit.symbol}' is a unit of {kind}, not of {name}; write {examples}"
    return None


def _examples(dimension: str) -> tuple[str, ...]:
    if dimension == "temperature":
        return ("C", "K")
    if dimension == "length":
        return ("m", "mm")
    symbols = [unit.symbol for unit in UNITS.values() if unit.dimension == dimension]
    return tuple(symbol.replace("/", "_per_") for symbol in symbols[:1])


def _unknown_unit(text: str) -> str:
    near = difflib.get_close_matches(text, UNITS, n=2, cutoff=0.5)
    hint = f" (did you mean {' or '.join(near)}?)" if near else ""
    return f"unknown unit '{text}'{hint}"
