"""Parts of an HTML page, and the formatting of numbers on it.

All pages use one template and load nothing from elsewhere. Numbers have few digits and a unit of
suitable size.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from anhyst.support.units import Quantity

Tone = Literal["good", "warn", "bad", "info"]


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph."""

    text: str
    kind: str = "text"


@dataclass(frozen=True, slots=True)
class Note:
    """A sentence in a box; ``title`` states its kind in a word or two, independent of colour."""

    tone: Tone
    title: str
    text: str
    kind: str = "note"


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure: its SVG, its description in words, and the caption."""

    svg: str
    alt: str
    caption: str
    kind: str = "picture"


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table; ``bar``, 0 to 1, draws a bar of this relative length behind the text."""

    text: str
    strong: bool = False
    bar: float | None = None
    code: bool = False


Row = tuple[Cell, ...]

MAX_TABLE_LETTERS = 115
"""Maximum width of a table in letters, including the space between columns."""
_COLUMN_GAP_LETTERS = 2


@dataclass(frozen=True, slots=True)
class PageTable:
    """A table with a title. The first ``texts`` columns contain words, other columns numbers."""

    title: str
    head: tuple[str, ...]
    rows: tuple[Row, ...]
    caption: str = ""
    texts: int = 1
    kind: str = "table"

    @property
    def is_wide(self) -> bool:
        """Whether the table is wider than a page, so that it is set smaller and wrapped."""
        columns = zip(self.head, *([cell.text for cell in row] for row in self.rows), strict=True)
        return sum(max(map(len, column)) + _COLUMN_GAP_LETTERS for column in columns) > MAX_TABLE_LETTERS


@dataclass(frozen=True, slots=True)
class Items:
    """A list of sentences with a title."""

    title: str
    items: tuple[str, ...]
    kind: str = "items"


Block = Text | Note | Picture | PageTable | Items


@dataclass(frozen=True, slots=True)
class Section:
    """A section of a page; ``key`` is its anchor."""

    key: str
    title: str
    blocks: tuple[Block, ...] = field(default=())


def make_table(
    title: str, head: Sequence[str], rows: Sequence[Sequence[str | Cell]], caption: str = "", texts: int = 1
) -> PageTable:
    """Create a table of texts and cells."""
    cell_rows = tuple(tuple(cell if isinstance(cell, Cell) else Cell(cell) for cell in row) for row in rows)
    return PageTable(title, tuple(head), cell_rows, caption, texts)


TEMPLATE = "page.html.j2"
MAX_TILES = 3
"""Maximum number of figures at the head of a page."""


@dataclass(frozen=True, slots=True)
class Tile:
    """A large number at the head of a page, with its label."""

    value: str
    name: str
    detail: str


@dataclass(frozen=True, slots=True)
class Headline:
    """The head of a page, answer first: a verdict in words, at most :data:`MAX_TILES` figures, one picture.

    Notes on an error are shown before the verdict, other notes after the picture. The comparison is
    the first table of the page.
    """

    title: str
    description: str
    basis: str
    verdict: Note
    tiles: tuple[Tile, ...]
    picture: Picture | None
    comparison: PageTable | None
    validity: str
    notes: tuple[Note, ...] = ()


def render_page(
    head: Headline, sections: Sequence[Section | None], version: str, *, kind: str, source: str
) -> str:
    """Return the HTML text of a page; sections without content are omitted."""
    filled_sections = [section for section in sections if section is not None and section.blocks]
    return _load_template().render(
        head=head,
        sections=list(_pictures_first(head, filled_sections)),
        version=version,
        kind=kind,
        source=source,
    )


def _pictures_first(head: Headline, sections: Sequence[Section]) -> Iterator[Section]:
    """Yield the sections with pictures, one section with all their tables, and all other sections."""
    illustrated = [section for section in sections if any(isinstance(b, Picture) for b in section.blocks)]
    tables = [block for section in illustrated for block in section.blocks if isinstance(block, PageTable)]
    for section in illustrated:
        yield replace(section, blocks=tuple(b for b in section.blocks if not isinstance(b, PageTable)))
    if tables or head.comparison:
        yield Section("tables", "Tables", (*filter(None, [head.comparison]), *tables))
    yield from (section for section in sections if section not in illustrated)


@cache
def _load_template() -> Template:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(TEMPLATE)


MINUS = "\N{MINUS SIGN}"
NBSP = "\N{NO-BREAK SPACE}"
UNKNOWN_TEXT = "\N{EN DASH}"

GREEK_LETTERS: Mapping[str, str] = MappingProxyType({"rho": "ρ", "alpha": "α", "gamma": "γ", "psi": "ψ"})

_PREFIXES = (("M", 1e6), ("k", 1e3), ("", 1.0), ("m", 1e-3), ("µ", 1e-6), ("n", 1e-9))
_PREFIXABLE_UNITS = frozenset({"A", "A/m", "V", "N", "T", "Wb", "s", "Pa", "Hz"})
_DISPLAY_UNITS = {"1": "", "degC": "°C"}
_SUPERSCRIPT = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


@dataclass(frozen=True, slots=True)
class Scale:
    """Scale of displayed values: an SI value times ``factor``, followed by ``unit``."""

    factor: float
    unit: str

    def format(self, value: float | None, digits: int = 3, *, is_short: bool = False) -> str:
        """Return an SI value as text without its unit; ``short`` drops trailing zeros."""
        return (
            UNKNOWN_TEXT if value is None else format_number(value * self.factor, digits, is_short=is_short)
        )

    def format_with_unit(self, value: float | None, digits: int = 3, *, is_short: bool = False) -> str:
        """Return an SI value as text with its unit."""
        if value is None:
            return UNKNOWN_TEXT
        return f"{self.format(value, digits, is_short=is_short)}{NBSP}{self.unit}".rstrip()

    def format_range(self, low: float, high: float, digits: int = 3) -> str:
        """Return a range of SI values as text with its unit."""
        return f"{self.format(low, digits, is_short=True)} to {self.format_with_unit(high, digits, is_short=True)}"

    def heading(self, name: str) -> str:
        """Return the heading of a column or an axis: the name, and the unit in brackets."""
        return f"{name} [{self.unit}]" if self.unit else name


def choose_scale(unit: str, values: Iterable[float | None]) -> Scale:
    r"""Choose the unit in which values are easiest to read.

    >>> choose_scale("m", [0.3e-3, 0.6e-3]).format_range(0.3e-3, 0.6e-3)
    '0.3 to 0.6\xa0mm'
    >>> choose_scale("A/m", [55e3]).format_with_unit(54997.2)
    '55.0\xa0kA/m'
    """
    largest_value = max((abs(v) for v in values if v is not None and math.isfinite(v)), default=0.0)
    if unit == "m":
        if largest_value >= 1.0:
            return Scale(1.0, "m")
        return Scale(1e3, "mm") if largest_value >= 0.05e-3 or largest_value == 0.0 else Scale(1e6, "µm")
    if unit not in _PREFIXABLE_UNITS or largest_value == 0.0 or 0.1 <= largest_value < 5e3:
        return Scale(1.0, _DISPLAY_UNITS.get(unit, unit))
    for prefix, size in _PREFIXES:
        if largest_value >= size:
            return Scale(1.0 / size, prefix + unit)
    return Scale(1e9, "n" + unit)


def quantity_scale(quantity: Quantity, values: Iterable[float | None]) -> Scale:
    """Choose the unit for values of a quantity; displacements below 1 mm are in µm."""
    listed_values = list(values)
    largest_value = max((abs(value) for value in listed_values if value is not None), default=0.0)
    if quantity.name == "displacement" and 0.0 < largest_value < 1e-3:
        return Scale(1e6, "µm")
    return choose_scale(quantity.unit, listed_values)


def format_number(value: float, digits: int = 3, *, is_short: bool = False) -> str:
    """Return a number with some significant digits; digits before the point are never rounded.

    >>> format_number(0.76436), format_number(1234.4), format_number(2.5e-7)
    ('0.764', '1234', '2.5×10⁻⁷')
    >>> format_number(0.3), format_number(0.3, is_short=True)
    ('0.300', '0.3')
    """
    if not math.isfinite(value):
        return UNKNOWN_TEXT if math.isnan(value) else ("∞" if value > 0 else f"{MINUS}∞")
    if value == 0.0:
        return "0"
    mantissa_text, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    exponent_value = int(exponent)  # exponent of the rounded value: 9.996 becomes 10.0
    if not -5 <= exponent_value < 7:
        mantissa = mantissa_text.rstrip("0").rstrip(".") if "." in mantissa_text else mantissa_text
        text = f"{mantissa}×10{str(exponent_value).translate(_SUPERSCRIPT)}"
    else:
        text = f"{value:.{max(0, digits - 1 - exponent_value)}f}"
        text = text.rstrip("0").rstrip(".") if is_short and "." in text else text
    return text.replace("-", MINUS)


def format_percent(share: float | None, digits: int = 2) -> str:
    r"""Return a fraction as a percentage.

    >>> format_percent(0.002622), format_percent(1.5), format_percent(float("inf"))
    ('0.26\xa0%', '150\xa0%', '∞\xa0%')
    """
    return UNKNOWN_TEXT if share is None else f"{format_number(100.0 * share, digits)}{NBSP}%"


def format_deviation(value: float, deviation: float) -> str:
    """Return an estimate and its standard deviation, with two significant digits of the latter.

    >>> format_deviation(1.747004, 0.141138), format_deviation(392.274, 7.2005)
    ('1.75 ± 0.14', '392.3 ± 7.2')
    >>> format_deviation(1.7, float("inf"))
    '1.70 ± ∞'
    """
    if not (math.isfinite(deviation) and math.isfinite(value)) or deviation <= 0.0:
        return f"{format_number(value)} ± {format_number(deviation)}"
    exponent = math.floor(math.log10(deviation))
    if not -6 <= exponent < 6:
        return f"{format_number(value)} ± {format_number(deviation, 2)}"
    decimals = max(0, 1 - exponent)
    rounded_value = round(value, decimals) + 0.0  # -0.0 becomes 0.0
    return f"{rounded_value:.{decimals}f} ± {deviation:.{decimals}f}".replace("-", MINUS)


def axis_label(quantity: Quantity, scale: Scale) -> str:
    """Return the label of an axis: the quantity, its symbol and the displayed unit."""
    name = quantity.words
    return scale.heading(name if name == quantity.symbol else f"{name} {display_symbol(quantity)}")


def display_symbol(quantity: Quantity) -> str:
    """Return the symbol of a quantity with Greek letters, which files spell out."""
    return GREEK_LETTERS.get(quantity.symbol, quantity.symbol)


def typeset(text: str) -> str:
    """Return a text with typographic minus signs, dots for products, and non-breaking spaces."""
    text = re.sub(r"(?<=\s)-(?=\d)", MINUS, text.replace("*", "·"))
    return re.sub(r"(?<=\d) (?=mm|°C|%)", NBSP, text)


def schedule_text(quantity: Quantity, value: float) -> str:
    """Return a value of the scheduling variable as text, such as ``gap 0.3 mm``."""
    return quantity.show(value).replace("-", MINUS)
