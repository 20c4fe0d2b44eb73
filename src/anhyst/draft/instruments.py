"""Tables that every rig file has: how loops are read, the magnet, ranges and noise of sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from anhyst.draft.text import Entry, FileSection, nearest, up


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


def noise_entry(key: str, found: float, usual: float) -> Entry:
    """Return the noise of a sensor: what the loops show, or what is usual."""
    if found > 0.0:
        return Entry(key, nearest(found), "rms, as in the loops")
    return Entry(key, nearest(usual), "rms", "the loops show none")
