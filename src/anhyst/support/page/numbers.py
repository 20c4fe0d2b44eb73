"""Numbers as a reader wants them: few digits, a unit of the right size, no exponents in sight."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from anhyst.support.units import Quantity

MINUS = "\N{MINUS SIGN}"
NBSP = "\N{NO-BREAK SPACE}"
NOT_KNOWN = "\N{EN DASH}"

GREEK: Mapping[str, str] = MappingProxyType({"rho": "ρ", "alpha": "α", "gamma": "γ", "psi": "ψ"})

_PREFIXES = (("M", 1e6), ("k", 1e3), ("", 1.0), ("m", 1e-3), ("µ", 1e-6), ("n", 1e-9))
_PREFIXED = frozenset({"A", "A/m", "V", "N", "T", "Wb", "s", "Pa", "Hz"})
_WRITTEN = {"1": "", "degC": "°C"}
_SUPERSCRIPT = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


@dataclass(frozen=True, slots=True)
class Scale:
    """How values of one SI unit are shown: multiplied by ``factor``, followed by ``unit``."""

    factor: float
    unit: str

    def number(self, value: float | None, digits: int = 3, *, short: bool = False) -> str:
        """Text of an SI value without its unit; ``short`` drops zeros at its end."""
        return NOT_KNOWN if value is None else number(value * self.factor, digits, short=short)

    def show(self, value: float | None, digits: int = 3, *, short: bool = False) -> str:
        """Text of an SI value with its unit."""
        if value is None:
            return NOT_KNOWN
        return f"{self.number(value, digits, short=short)}{NBSP}{self.unit}".rstrip()

    def span(self, low: float, high: float, digits: int = 3) -> str:
        """Text of a range of SI values with its unit."""
        return f"{self.number(low, digits, short=True)} to {self.show(high, digits, short=True)}"

    def head(self, name: str) -> str:
        """Text for the head of a column or an axis: what it is, and the unit in brackets."""
        return f"{name} [{self.unit}]" if self.unit else name


def scale_of(unit: str, values: Iterable[float | None]) -> Scale:
    r"""Choose the unit in which values are easiest to read.

    >>> scale_of("m", [0.3e-3, 0.6e-3]).span(0.3e-3, 0.6e-3)
    '0.3 to 0.6\xa0mm'
    >>> scale_of("A/m", [55e3]).show(54997.2)
    '55.0\xa0kA/m'
    """
    largest = max((abs(v) for v in values if v is not None and math.isfinite(v)), default=0.0)
    if unit == "m":
        if largest >= 1.0:
            return Scale(1.0, "m")
        return Scale(1e3, "mm") if largest >= 0.05e-3 or largest == 0.0 else Scale(1e6, "µm")
    if unit not in _PREFIXED or largest == 0.0 or 0.1 <= largest < 5e3:
        return Scale(1.0, _WRITTEN.get(unit, unit))
    for prefix, size in _PREFIXES:
        if largest >= size:
            return Scale(1.0 / size, prefix + unit)
    return Scale(1e9, "n" + unit)


def scale_for(quantity: Quantity, values: Iterable[float | None]) -> Scale:
    """Choose the unit for values of a quantity; displacements below 1 mm come out in µm."""
    sizes = list(values)
    largest = max((abs(value) for value in sizes if value is not None), default=0.0)
    if quantity.name == "displacement" and 0.0 < largest < 1e-3:
        return Scale(1e6, "µm")
    return scale_of(quantity.unit, sizes)


def number(value: float, digits: int = 3, *, short: bool = False) -> str:
    """Write a number with so many significant digits, what is before the point always whole.

    >>> number(0.76436), number(1234.4), number(0.3), number(0.3, short=True), number(2.5e-7)
    ('0.764', '1234', '0.300', '0.3', '2.5×10⁻⁷')
    """
    if not math.isfinite(value):
        return NOT_KNOWN if math.isnan(value) else ("∞" if value > 0 else f"{MINUS}∞")
    if value == 0.0:
        return "0"
    scaled, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    power = int(exponent)  # of the rounded value: 9.996 has two digits before the point
    if not -5 <= power < 7:
        plain = scaled.rstrip("0").rstrip(".") if "." in scaled else scaled
        text = f"{plain}×10{str(power).translate(_SUPERSCRIPT)}"
    else:
        text = f"{value:.{max(0, digits - 1 - power)}f}"
        text = text.rstrip("0").rstrip(".") if short and "." in text else text
    return text.replace("-", MINUS)


def percent(share: float | None, digits: int = 2) -> str:
    r"""Write a share of one as a percentage.

    >>> percent(0.002622), percent(1.5), percent(float("inf"))
    ('0.26\xa0%', '150\xa0%', '∞\xa0%')
    """
    return NOT_KNOWN if share is None else f"{number(100.0 * share, digits)}{NBSP}%"


def with_deviation(value: float, deviation: float) -> str:
    """Write an estimate with its standard deviation, both to the digits that mean something.

    >>> with_deviation(1.747004, 0.141138), with_deviation(392.274, 7.2005)
    ('1.75 ± 0.14', '392.3 ± 7.2')
    >>> with_deviation(1.7, float("inf"))
    '1.70 ± ∞'
    """
    if not (math.isfinite(deviation) and math.isfinite(value)) or deviation <= 0.0:
        return f"{number(value)} ± {number(deviation)}"
    power = math.floor(math.log10(deviation))
    if not -6 <= power < 6:
        return f"{number(value)} ± {number(deviation, 2)}"
    decimals = max(0, 1 - power)
    rounded = round(value, decimals) + 0.0  # a negative zero becomes a plain one
    return f"{rounded:.{decimals}f} ± {deviation:.{decimals}f}".replace("-", MINUS)


def label(quantity: Quantity, scale: Scale) -> str:
    """Text for an axis: the quantity, its symbol and the unit it is shown in."""
    name = name_of(quantity)
    return scale.head(name if name == quantity.symbol else f"{name} {symbol_of(quantity)}")


def symbol_of(quantity: Quantity) -> str:
    """Give the symbol of a quantity, Greek where it is spelt out in files."""
    return GREEK.get(quantity.symbol, quantity.symbol)


def written(text: str) -> str:
    """Set a text of the model file as a reader expects it: minus signs, dots for products."""
    text = re.sub(r"(?<=\s)-(?=\d)", MINUS, text.replace("*", "·"))
    return re.sub(r"(?<=\d) (?=mm|°C|%)", NBSP, text)


def shown_at(quantity: Quantity, value: float) -> str:
    """Text for a value of the scheduling variable, such as ``gap 0.3 mm``."""
    return quantity.show(value).replace("-", MINUS)


def name_of(quantity: Quantity) -> str:
    """Name of a quantity in a sentence."""
    return quantity.name.replace("_", " ")
