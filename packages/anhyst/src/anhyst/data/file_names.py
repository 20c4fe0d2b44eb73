"""Read gaps and other constants from file names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from anhyst.data.sidecar import FileDescription
from anhyst.support.errors import InputError
from anhyst.support.units import find_unit, parse_header
from anhyst.support.vocabulary import QUANTITY_WORDS


def add_constants_of_name(path: Path, description: FileDescription) -> FileDescription:
    """Add the constants that the pattern ``file_name`` finds in the name of the file."""
    if description.file_name is None:
        return description
    name_pieces = re.split(r"\{([^{}]+)\}", description.file_name)
    keys = name_pieces[1::2]
    pattern = "(.+)".join(re.escape(piece) for piece in name_pieces[::2])
    match = re.fullmatch(pattern, path.stem) or re.fullmatch(pattern, path.name)
    if not keys or match is None:
        raise InputError(
            f"{path}: the name does not fit file_name = '{description.file_name}'; a pattern is like "
            "'gd_T{T_C}C'",
            code="file-name-pattern",
            key="file_name",
        )
    constants: dict[str, float | str] = dict(description.constants)
    for key, text in zip(keys, match.groups(), strict=True):
        if parse_header(key).is_label:
            constants[key] = text
            continue
        try:
            constants[key] = float(text)
        except ValueError:
            raise InputError(
                f"{path}: '{text}' in the name is not a number for {key}", code="file-name-pattern", key=key
            ) from None
    return replace(description, constants=constants)


_GAP_WORD = rf"(?:{'|'.join(sorted(QUANTITY_WORDS['gap'], key=len, reverse=True))})"
_NUMBER_PATTERN = r"(?P<number>\d+(?:[.,p]\d+)?|0[_-]\d+)"
_UNIT_PATTERN = r"[ _]?(?P<unit>mm|um|µm|μm|micron|cm|mil|thou|inch)(?![a-z0-9])"
_GAP_PATTERN = re.compile(rf"{_GAP_WORD}[-_ =]*{_NUMBER_PATTERN}{_UNIT_PATTERN}", re.IGNORECASE)
_LENGTH_PATTERN = re.compile(rf"(?<![0-9.,]){_NUMBER_PATTERN}{_UNIT_PATTERN}", re.IGNORECASE)
_OTHER_LENGTH_WORDS = re.compile(
    r"(?:dicke|thick(?:ness)?|dia(?:meter)?|durchmesser|core|kern|wire|draht|sheet|blech|stack|"
    r"length|laenge|width|breite|height|hoehe|stroke|hub|ampl?(?:itude)?|range|sample|probe|"
    r"lam(?:ination)?|radius|rod|pole|step|speed|v|cable|kabel|lever|hebel|shaft|welle)[-_ =]*$|"
    r"[a-z]{2}$",
    re.IGNORECASE,
)
"""Words before a length that is not a gap, and type designations such as ``EM12mm``."""
_MAX_GAP_M = 0.02
"""Largest gap that is accepted without a word such as *gap* before it, m."""
_MAX_GAP_DIFFERENCE = 0.3
"""Maximum relative difference between the gap column and the gap in the file name."""


def find_gaps_in_names(paths: Sequence[Path]) -> dict[Path, float]:
    """Return the gap in each file name, m; empty unless each name contains a gap.

    If a name has no word for a gap, the names must contain several gaps and differ in numbers only.
    """
    gaps = {path: _find_gap_in_name(path.stem) for path in paths}
    known_gaps = {path: gap for path, gap in gaps.items() if gap is not None}
    if len(known_gaps) < len(gaps):
        return {}
    has_words = all(_GAP_PATTERN.search(path.stem) for path in paths)
    names_without_numbers = {re.sub(r"\d+", "", _LENGTH_PATTERN.sub("", path.stem)) for path in paths}
    return (
        known_gaps
        if has_words or (len(set(known_gaps.values())) > 1 and len(names_without_numbers) == 1)
        else {}
    )


def refuse_contradicting_gap(path: Path, measured_gaps: Sequence[float | None]) -> None:
    """Raise an error if the gap in the name of a file contradicts its gap column."""
    name_gap = _find_gap_in_name(path.stem) if _GAP_PATTERN.search(path.stem) else None
    gap = measured_gaps[0]
    if name_gap is None or gap is None or len(set(measured_gaps)) > 1:
        return
    if abs(gap - name_gap) > _MAX_GAP_DIFFERENCE * max(gap, name_gap):
        raise InputError(
            f"{path}: its name states a gap of {1e3 * name_gap:.4g} mm, its column {1e3 * gap:.4g} mm; "
            "correct the name, or if the column is correct: --schedule gap",
            code="gap-contradiction",
            key="gap",
        )


def describe_name_gaps(gaps: Mapping[Path, float]) -> str:
    """Return a note with the gaps that the file names contain."""
    texts = dict.fromkeys(f"{1e3 * gap:.4g} mm" for gap in sorted(gaps.values()))
    names = "file name" if len(gaps) == 1 else "file names"
    return f"gap taken from the {names}: {', '.join(texts)}"


def _find_gap_in_name(stem: str) -> float | None:
    """Return the gap in a file name, m: a length after a word for a gap, or the only length.

    >>> _find_gap_in_name("Messung_Spalt_0,5mm"), _find_gap_in_name("gap0p5mm_run3")
    (0.0005, 0.0005)
    >>> _find_gap_in_name("run_5") is None
    True
    """
    matches = list(_GAP_PATTERN.finditer(stem))
    if not matches:
        matches = [match for match in _LENGTH_PATTERN.finditer(stem) if _can_be_gap(stem, match)]
        if len(matches) != len(_LENGTH_PATTERN.findall(stem)):
            return None
    if len(matches) != 1:
        return None
    number_text, unit = matches[0]["number"], find_unit(matches[0]["unit"].lower())
    if unit is None or re.fullmatch(r"0\d+", number_text):
        return None  # 05 may be 5 or 0.5
    gap = unit.value_to_si(float(re.sub(r"[,p_-]", ".", number_text.lower())))
    return gap if gap <= _MAX_GAP_M or _GAP_PATTERN.search(stem) else None


def _can_be_gap(stem: str, match: re.Match[str]) -> bool:
    """Whether a length in a name can be a gap: no other word and no digits precede the length."""
    text_before, number = stem[: match.start()], match["number"]
    is_decimal = any(sign in number for sign in ".,p")
    if re.search(r"\d-$" if is_decimal else r"\d[-_]$", text_before) or "_" in number:
        return False
    return _OTHER_LENGTH_WORDS.search(text_before) is None
