"""The tables of contract/, and what the writers of C, Python and pages ask of them."""

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
    _number(table)
    return table


def _number(table: Entry) -> None:
    """Name what is of a further magnet by its number, as columns are; `array` keeps the bare name."""
    for value in table.values():
        for entry in value if isinstance(value, list) else [value]:
            if isinstance(entry, dict):
                if "number" in entry and "name" in entry and ("type" in entry or "format" in entry):
                    entry["array"] = entry["name"]
                    entry["name"] = f"{entry['name']}_{entry['number']}"
                _number(entry)


def size_of(fields: list[Entry]) -> int:
    """Return the bytes of these fields."""
    return sum(SIZES[field["type"]] for field in fields)


def is_request(frame: Entry) -> bool:
    """Return whether the PC sends this frame."""
    return "answer" in frame


def link_enums(frames: Entry, signals: Entry) -> list[Entry]:
    """Return the lists of names with numbers that both ends of the link know."""
    return [*frames["enum"], {"name": "setting", "doc": "Settings.", "values": signals["setting"]}]


def numbers(entry: Entry) -> list[int]:
    """Return the numbers of an enum's names."""
    return list(range(len(entry["values"])))


def bits(entry: Entry) -> list[int]:
    """Return the bits of a flag's names."""
    return [1 << number for number in numbers(entry)]


def word_size(word: Entry) -> int:
    """Return how many words it takes in a parameter block; a table is named by one."""
    return int(word.get("words", 2 if word["format"] == "single" else 1))
