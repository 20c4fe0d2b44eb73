"""Words of column headers: quantities in six languages, and units that are written out.

The words and the unit of a column together decide the quantity: *tension* is a voltage in V and a
force in N. Accents and case are ignored. German and Dutch compounds are split.
"""

from __future__ import annotations

import re
import unicodedata

_WORD_LISTS = {
    "time": "time timestamp elapsed horizontal second seconds zeit temps tijd tempo tiempo",
    "current": "current strom courant intensite stroom corrente corriente intensidad amperage",
    "field": "field feldstarke magnetfeld champ campo veld veldsterkte",
    "voltage": "voltage spannung tension spanning tensione voltaggio voltaje",
    "force": "force load pull kraft effort kracht forza fuerza tension zugkraft",
    "flux_density": "induction induktion inductie induzione induccion flux fluss flusso flujo "
    "flussdichte fluxdichtheid b-field",
    "flux_linkage": "flux fluss flusso flujo linkage flussverkettung verkettung koppelflux",
    "displacement": "displacement position stroke travel weg verschiebung auslenkung hub "
    "deplacement course verplaatsing positie spostamento corsa posizione desplazamiento carrera "
    "posicion",
    "strain": "strain dehnung deformation rek deformazione deformacion",
    "gap": "gap airgap spalt luftspalt entrefer luchtspleet spleet traferro intraferro entrehierro",
    "temperature": "temperature temperatur temperatuur temperatura temp",
}
"""Words of each quantity, in lower case and without accents."""

QUANTITY_WORDS = {name: frozenset(words.split()) for name, words in _WORD_LISTS.items()}

_COMPOUND_ENDINGS = ("strom", "stroom", "spannung", "spanning", "kraft", "kracht", "spalt", "spleet",
             "zeit", "tijd", "temperatur", "temperatuur", "weg", "feldstarke", "fluss")  # fmt: skip
"""Words that end German and Dutch compounds, such as *Spulenstrom*."""

_DRIVE_WORDS = frozenset({"coil", "spule", "spulen", "bobine", "bobina", "spoel", "piezo", "actuator", "amplifier",
                     "aktor", "magnet", "drive", "input", "applied", "excitation", "u", "v", "in",
                     "of", "de", "la", "della", "del", "der"})  # fmt: skip
"""Words that can accompany a voltage that drives an actuator; others indicate a sensor signal."""

_QUALIFIER_WORDS = (
    "supply mains netz motor drift peak spitze spitzen max maximum maximal min minimum minimal mean avg average "
    "mittel mittelwert zero null nullpunkt offset tare tara error err fehler abweichung change aenderung "
    "anderung set setpoint soll sollwert nominal nom cmd command commanded kommando vorgabe ref reference referenz "
    "target demand ziel consigne limit limits grenz grenze grenzwert grens threshold schwelle trip preload "
    "vorlast vorspann noise rauschen std sigma stddev rms leak leakage leck raw roh rohwert digits range "
    "bereich alarm friction reibung reib residual tolerance toleranz total both double twice sum summe "
    "velocity rate speed geschwindigkeit density dichte stromdichte status flag index sample samples "
    "record number scan step steps extra length increment cycle direction branch delta diff "
    "differenz bias idle quiescent ruhe heater heiz earth inrush squared "
    "eff effective effektiv mmf ni turns durchflutung gewichts norm normalised normalized normiert"
)
"""Words that change the meaning of the quantity next to them, or that mark values as not measured.
"""

_MEASURED_WORDS = (
    "meas measured measurement actual act ist istwert mess messwert monitor mon probe coil spule spulen "
    "bobine bobina spoel magnet feedback fb mesure gemessen gemeten"
)
"""Words of a column with measured values."""

_SENSOR_WORDS = frozenset({"sensor", "sensors", "cell", "lc", "loadcell", "dms", "kmd", "messdose"})
"""Words of a column that comes from a sensor of the output."""

_RAW_UNIT_WORDS = (
    "count counts cts digit digits lsb adc raw inc incs increments steps pulses bits ticks au div code"
)
_QUALIFIERS = frozenset(_QUALIFIER_WORDS.split())
_MEASURED = frozenset(_MEASURED_WORDS.split())
RAW_UNITS = frozenset(_RAW_UNIT_WORDS.split())
"""Units of raw values, which have no physical unit yet."""

_FORMULA_PATTERN = re.compile(
    r"[*^|²³√×÷∫∂Δ]|^[-+]|^\d+\s*/|/\s*\d+(?:\.\d+)?$|[\s(]x\s?\d|^d[A-Z]\b|^d\w+\s*/\s*d\w+|"
    r"^(?P<symbol>[A-Za-z])\s*/\s*(?:(?P=symbol)\w+|[A-Za-z])$|"
    r"(?<![A-Za-z])(?:sqrt|log|log10|ln|lg|exp|abs|squared?)(?![A-Za-z])"
)
"""Signs of a name that is calculated from a quantity, such as ``2*F`` or ``I/Imax``."""
_NUMBER_PATTERN = r"(\d+(?:\.\d+)?)"
_PRODUCT_PATTERNS = (rf"{_NUMBER_PATTERN}\s*[*×]\s*[^*/^|]+", rf"[^*/^|]+[*×]\s*{_NUMBER_PATTERN}")
_QUOTIENT_PATTERN = rf"[^*/^|]+/\s*{_NUMBER_PATTERN}"

_PREFIXABLE_UNIT_WORDS = {
    "A": "amp amps ampere amperes",
    "V": "volt volts vdc",
    "N": "newton newtons",
    "T": "tesla teslas",
    "G": "gauss gs",
    "Oe": "oersted oersteds",
    "Wb": "weber webers",
    "Vs": "voltsecond voltseconds",
    "m": "metre metres meter meters metro metros metri",
    "s": "second seconds sec secs sekunde sekunden seconde secondes seconden secondo secondi "
    "segundo segundos",
    "Hz": "hertz",
    "Pa": "pascal pascals",
    "g": "gram grams gramme grammes gramm",
}
_PREFIX_LETTERS = {"nano": "n", "micro": "u", "mikro": "u", "milli": "m", "mili": "m", "centi": "c",
             "zenti": "c", "kilo": "k", "mega": "M", "": ""}  # fmt: skip
_OTHER_UNIT_WORDS = {
    "gf": "gramforce gramsforce gf",
    "kgf": "kilogramforce kilogramsforce kilopond kiloponds kgf",
    "kg": "kg",
    "lbf": "poundforce poundsforce lbf",
    "lb": "pound pounds lb lbs",
    "ozf": "ounceforce ouncesforce ozf",
    "oz": "ounce ounces oz",
    "daN": "decanewton decanewtons dekanewton",
    "in": "inch inches zoll pouce pouces",
    "kG": "kgs",
    "ft": "foot feet ft",
    "mil": "mil mils thou thous",
    "um": "micron microns",
    "min": "minute minutes minuten minuti minutos mins",
    "h": "hour hours",
    "ms": "msec msecs",
    "us": "usec usecs",
    "degC": "degc celsius degreecelsius degreescelsius gradcelsius degrecelsius degrescelsius",
    "K": "kelvin",
    "degF": "degf fahrenheit degreesfahrenheit",
    "%": "percent prozent",
}
_UNIT_WORDS = {
    prefix + word: letter + symbol
    for symbol, words in _PREFIXABLE_UNIT_WORDS.items()
    for word in words.split()
    for prefix, letter in _PREFIX_LETTERS.items()
} | {word: symbol for symbol, words in _OTHER_UNIT_WORDS.items() for word in words.split()}


def fold(text: str) -> str:
    """Return a text in lower case and without accents.

    >>> fold("Intensité")
    'intensite'
    """
    decomposed_text = unicodedata.normalize("NFKD", text)
    return "".join(letter for letter in decomposed_text if not unicodedata.combining(letter)).casefold()


def symbol_of_word(text: str) -> str | None:
    """Return the symbol of a unit that is written out; None for other texts.

    >>> symbol_of_word("Kilo-Newtons"), symbol_of_word("mn")
    ('kN', None)
    """
    return _UNIT_WORDS.get(re.sub(r"[\s_-]", "", fold(text)))


def split_words(name: str) -> list[str]:
    """Return the words of a name, folded; CamelCase is split, and ends of compounds are added."""
    spaced_name = re.sub(r"(?<=[a-zà-ÿ])(?=[A-Z])", " ", name)
    words = re.findall(r"b-field|[a-z]+", fold(spaced_name).replace("b field", "b-field"))
    ends = [end for word in words for end in _COMPOUND_ENDINGS if word.endswith(end) and word != end]
    return words + ends


def named_quantities(name: str) -> set[str]:
    """Return the quantities that the words of a name can mean.

    >>> sorted(named_quantities("Spulenstrom 1")), sorted(named_quantities("Tension"))
    (['current'], ['force', 'voltage'])
    """
    words = set(split_words(name))
    return {quantity for quantity, quantity_words in QUANTITY_WORDS.items() if words & quantity_words}


def is_drive(name: str) -> bool:
    """Whether all words of a name fit a voltage that drives an actuator."""
    all_words = split_words(name)
    words = [word for word in all_words if word not in QUANTITY_WORDS["voltage"]]
    word_stems = [next((word.removesuffix(ending) for ending in _COMPOUND_ENDINGS if word.endswith(ending)), word)
             for word in words]  # fmt: skip
    return bool(all_words) and _DRIVE_WORDS.issuperset(word_stems)


def _word_parts(name: str) -> set[str]:
    """Return the words of a name, the parts of compounds, and ``max`` of ``Imax``."""
    words = set(split_words(name))
    words |= {part for word in words for ending in _COMPOUND_ENDINGS if ending in word
              for part in word.split(ending)}  # fmt: skip
    return words | {word[1:] for word in words if len(word) > 3 and word[0] in "ifubhx"}


def has_qualifier(name: str) -> bool:
    """Whether a word of a name changes the meaning of its quantity.

    >>> has_qualifier("Netzstrom"), has_qualifier("Flux density"), has_qualifier("Coil current")
    (True, False, False)
    """
    qualifiers = _word_parts(name) & _QUALIFIERS
    if QUANTITY_WORDS["flux_density"] & _word_parts(name):
        qualifiers -= {"density", "dichte"}
    return bool(qualifiers)


def is_measured(name: str) -> bool:
    """Whether a word of a name marks measured values."""
    return bool(_word_parts(name) & (_MEASURED | _SENSOR_WORDS))


def is_sensor(name: str) -> bool:
    """Whether a word of a name marks the signal of a sensor of the output."""
    return bool(_word_parts(name) & _SENSOR_WORDS)


def is_formula(name: str) -> bool:
    """Whether a name is calculated from a quantity, instead of naming the quantity itself.

    >>> is_formula("2*F"), is_formula("I/Imax"), is_formula("Strom/Current")
    (True, True, False)
    """
    return _FORMULA_PATTERN.search(name) is not None


def undo_formula(name: str) -> str:
    """Return the factor, as text, that undoes a formula in a column name.

    Return ``FACTOR`` if only the user knows the factor, and an empty text if no factor exists.

    >>> undo_formula("2*F"), undo_formula("F/10"), undo_formula("I/Imax"), undo_formula("F^2")
    ('0.5', '10', 'FACTOR', '')
    """
    spaced_name = name.replace("_", " ").strip()
    for pattern in _PRODUCT_PATTERNS:
        if (match := re.fullmatch(pattern, spaced_name)) and float(match[1]):
            return f"{1.0 / float(match[1]):.6g}"
    if match := re.fullmatch(_QUOTIENT_PATTERN, spaced_name):
        return match[1]
    if re.fullmatch(r"-\s*\w+", spaced_name):
        return "-1"
    formula = _FORMULA_PATTERN.search(spaced_name)
    return "FACTOR" if formula and (formula["symbol"] or re.search(r"[\s(]x\s?\d", spaced_name)) else ""
