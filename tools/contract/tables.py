"""Read the tables of contract/, for the generators of C, Python and documentation."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
CONTRACT = ROOT / "contract"

SIZES = {"u8": 1, "u16": 2, "u32": 4, "i16": 2, "i32": 4}

Entry = dict[str, Any]


def read(name: str) -> Entry:
    """Return one table of contract/."""
    table = tomllib.loads((CONTRACT / f"{name}.toml").read_text(encoding="utf-8"))
    _number_magnets(table)
    return table


def _number_magnets(table: Entry) -> None:
    """Append the number of a magnet to the names of its fields; `array` keeps the original name."""
    for value in table.values():
        for entry in value if isinstance(value, list) else [value]:
            if isinstance(entry, dict):
                if "number" in entry and "name" in entry and ("type" in entry or "format" in entry):
                    entry["array"] = entry["name"]
                    entry["name"] = f"{entry['name']}_{entry['number']}"
                _number_magnets(entry)


def total_bytes(fields: list[Entry]) -> int:
    """Return the total number of bytes of these fields."""
    return sum(SIZES[field["type"]] for field in fields)


def is_request(frame: Entry) -> bool:
    """Return whether the PC sends this frame."""
    return "answer" in frame


def link_enums(frames: Entry, signals: Entry) -> list[Entry]:
    """Return the lists of names with numbers that both ends of the link know."""
    return [*frames["enum"], {"name": "setting", "doc": "Settings.", "values": signals["setting"]}]


def enum_numbers(entry: Entry) -> list[int]:
    """Return the numbers that belong to the names of an enum."""
    return list(range(len(entry["values"])))


def flag_bits(entry: Entry) -> list[int]:
    """Return the bit values that belong to the names of flags."""
    return [1 << number for number in enum_numbers(entry)]


def word_size(word: Entry) -> int:
    """Return the number of words of an entry in a parameter block; a table needs one word."""
    return int(word.get("words", 2 if word["format"] == "single" else 1))
