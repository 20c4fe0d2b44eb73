"""TOML for a person: every key with what it is, with what it was guessed from, in round numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from anhyst.support.kinds import RIG_FORMAT
from anhyst.support.toml_text import toml_key, toml_value, with_comment

SMALL = 1e-2
"""Numbers below it are written in milli, micro and nano."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A key of a file."""

    key: str  # with its unit
    value: object  # anything that TOML has
    says: str  # what it is
    guess: str = ""  # from what the value was guessed; empty where it is known

    def lines(self) -> Iterator[str]:
        """Yield the lines of it."""
        note = self.says + (f"; guess: {self.guess}" if self.guess else "")
        if isinstance(self.value, list) and self.value and isinstance(self.value[0], Mapping):
            yield with_comment(f"{self.key} = [", note)
            for row in self.value:
                yield f"  {written(row)},"
            yield "]"
        else:
            yield with_comment(f"{self.key} = {written(self.value)}", note)


@dataclass(frozen=True, slots=True)
class FileSection:
    """A table of a file."""

    name: str  # with those above it, separated by points
    says: str  # what it is
    entries: Sequence[Entry] = field(default_factory=tuple)
    one_of: str = ""  # what tells it apart from the others of a list of tables, if it is in one


@dataclass(frozen=True, slots=True)
class Draft:
    """A file that a person edits."""

    head: str  # first comment: what it is and where it comes from; several lines are allowed
    entries: Sequence[Entry]  # above all tables
    sections: Sequence[FileSection]

    def text(self) -> str:
        """Return the file."""
        lines = [f"# {line}".rstrip() for line in self.head.splitlines()]
        lines += _lines(self.entries)
        for section in self.sections:
            name = f"[[{section.name}]]" if section.one_of else f"[{section.name}]"
            lines += ["", with_comment(name, section.says), *_lines(section.entries)]
        return "\n".join(lines) + "\n"

    def guesses(self) -> dict[str, str]:
        """Return what was guessed: key with its table, and from what."""
        named = [
            ("", self.entries),
            *((f"{section.one_of or section.name}.", section.entries) for section in self.sections),
        ]
        return {
            f"{table}{entry.key} = {written(entry.value)}": entry.guess
            for table, entries in named
            for entry in entries
            if entry.guess
        }


def written(value: object) -> str:
    """Write a value as TOML; small numbers in milli, micro and nano, and still to the last bit.

    >>> written([0.45e-3, 50e-9, 20.0])
    '[0.45e-3, 50e-9, 20.0]'
    """
    match value:
        case float() if 0.0 < abs(value) < SMALL:
            exponent = next(
                (power for power in (-3, -6, -9) if abs(value) >= 10.0 ** (power - 1)), -12
            )
            text = f"{value * 10.0**-exponent:.12g}e{exponent}"
            return text if float(text) == value else toml_value(value)
        case list():
            return f"[{', '.join(map(written, value))}]"
        case Mapping():
            inside = ", ".join(f"{toml_key(key)} = {written(item)}" for key, item in value.items())
            return f"{{ {inside} }}"
    return toml_value(value)


def _lines(entries: Iterable[Entry]) -> list[str]:
    return [line for entry in entries for line in entry.lines()]


ONE_TWO_FIVE = (1.0, 2.0, 5.0, 10.0)
_SLACK = 1e-9


def nearest(value: float, digits: int = 2) -> float:
    """Return the nearest number of so many digits."""
    return float(f"{value:.{digits - 1}e}")


def up(value: float, digits: int = 2) -> float:
    """Return the least number of so many digits that is not below a positive value."""
    return _shifted(value, digits, math.ceil, -_SLACK)


def down(value: float, digits: int = 2) -> float:
    """Return the largest number of so many digits that is not above a positive value."""
    return _shifted(value, digits, math.floor, _SLACK)


def step_up(value: float, steps: Sequence[float] = ONE_TWO_FIVE) -> float:
    """Return the least of 1, 2, 5, 10, 20, ... that is not below a positive value."""
    decade = math.floor(math.log10(value) + _SLACK)
    least = next(step for step in steps if step * (1.0 + _SLACK) >= value / 10.0**decade)
    return float(f"{least:g}e{decade}")


def step_down(value: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, ... that is not above a positive value."""
    decade = math.floor(math.log10(value) + _SLACK)
    share = value / 10.0**decade * (1.0 + _SLACK)
    return float(f"{max(step for step in ONE_TWO_FIVE if step <= share):g}e{decade}")


def _shifted(value: float, digits: int, whole: Callable[[float], int], slack: float) -> float:
    decade = math.floor(math.log10(value)) - digits + 1
    return float(f"{whole(value / 10.0**decade * (1.0 + slack))}e{decade}")


SEED = Entry("seed", 1, "of all noise")


def rig_entries(name: str, *more: Entry) -> list[Entry]:
    """Return what a rig file begins with."""
    return [
        Entry("format", RIG_FORMAT, "what this file is"),
        Entry("version", 2, "of the format"),
        Entry("name", name, "free text"),
        *more,
    ]


def loops_section(
    files: str | list[str], reading: Mapping[str, object], *more: Entry
) -> FileSection:
    """Return the table of the loops, and how they are read, where there is something to say."""
    entries = [Entry(key, value, "as given") for key, value in reading.items()]
    return FileSection(
        "loops",
        "all that the controller knows of the magnet",
        [Entry("files", files, "copies of what was given"), *entries, *more],
    )


def magnet_section(*entries: Entry) -> FileSection:
    """Return the table of the plant's magnet: what the loops do not say, the fit guesses."""
    iron = Entry("iron", "from loops", "fitted to the loops; what you know (turns, ...), it holds")
    says = "the plant: never the compensator's own law"
    name = Entry("name", "magnet", "free text")
    return FileSection("magnet", says, [name, *entries, iron], "magnet")


def sensor_section(of: str, says: str, entries: Sequence[Entry]) -> FileSection:
    """Return the table of a sensor."""
    return FileSection("sensor", says, [Entry("of", of, "what it reads"), *entries], f"{of}_sensor")


def case_section(kind: str, says: str, entries: Sequence[Entry]) -> FileSection:
    """Return the table of what is tried."""
    return FileSection("case", says, [Entry("kind", kind, "of the case"), *entries], kind)


def range_entries(unit: str, high: float, room: float) -> list[Entry]:
    """Return both ends of the range of a sensor of what goes from 0 to a largest value."""
    beyond = f"{100.0 * room:.0f} % of the largest beyond it"
    return [
        Entry(f"low_{unit}", -up(room * high), "range: least", beyond),
        Entry(f"high_{unit}", up((1.0 + room) * high), "range: most", beyond),
    ]


def noise_entry(key: str, noise: float, usual: float) -> Entry:
    """Return the noise of a sensor: what the loops show, or what is usual."""
    if noise > 0.0:
        return Entry(key, nearest(noise), "rms, as in the loops")
    return Entry(key, nearest(usual), "rms", "the loops show none")
