"""Python of the tables: frames of the link, states and flags of a controller."""

from __future__ import annotations

import textwrap

from tables import Entry, bits, is_request, link_enums, numbers

CODES = {"u8": "B", "u16": "H", "u32": "I", "i16": "h", "i32": "i"}

PREAMBLE = '''"""What is said on the link and on the bus of a virtual plant.

Made by tools/contract from contract/frames.toml and signals.toml, which say what they mean: do not edit.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import ClassVar, NamedTuple, Self

'''

STATES_PREAMBLE = '''"""States, phases, faults, commands and flags of a controller.

Made by tools/contract from contract/controller.toml: do not edit.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag

'''

BASES = '''
@dataclass(frozen=True)
class Message:
    """A payload: fixed fields, then for some types a row of numbers."""

    TYPE: ClassVar[int]
    ANSWER: ClassVar[int]  # type of the answer to a request, else 0
    FIXED: ClassVar[struct.Struct]
    TAIL: ClassVar[str]

    def __init_subclass__(cls, code: int, form: str, answer: int = 0, tail: str = "") -> None:
        cls.TYPE, cls.ANSWER, cls.FIXED, cls.TAIL = code, answer, struct.Struct(form), tail

    def pack(self) -> bytes:
        """Return the payload; ValueError where a number does not fit."""
        values = [getattr(self, field.name) for field in fields(self)]
        tail = values.pop() if self.TAIL else b""
        form = f"<{len(tail)}{self.TAIL or 'B'}"
        try:
            return self.FIXED.pack(*values) + struct.pack(form, *tail)
        except struct.error as error:
            raise ValueError(f"{type(self).__name__}: {error}") from error

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """Return what the payload says; ValueError where its length is wrong."""
        fixed, rest = payload[: cls.FIXED.size], payload[cls.FIXED.size :]
        each = struct.calcsize(f"<{cls.TAIL}") if cls.TAIL else 0
        if len(fixed) != cls.FIXED.size or (len(rest) % each if each else len(rest)):
            raise ValueError(f"{cls.__name__}: {len(payload)} bytes of payload")
        values = list(cls.FIXED.unpack(fixed))
        if each:
            values.append(struct.unpack(f"<{len(rest) // each}{cls.TAIL}", rest))
        return cls(*values)


@dataclass(frozen=True)
class PlantRecord:
    """A record of the plant's bus: 32-bit words, the last one a check."""

    FIXED: ClassVar[struct.Struct]

    def __init_subclass__(cls, form: str) -> None:
        cls.FIXED = struct.Struct(form)

    def pack(self) -> bytes:
        """Return the record with its check."""
        body = self.FIXED.pack(*vars(self).values())
        return body + struct.pack("<I", _check(body))

    @classmethod
    def unpack(cls, record: bytes) -> Self:
        """Return what the record says; ValueError where length or check are wrong."""
        body = record[:-4]
        if len(body) != cls.FIXED.size or record[-4:] != struct.pack("<I", _check(body)):
            raise ValueError(f"{cls.__name__}: not a record of the plant's bus")
        return cls(*cls.FIXED.unpack(body))


def _check(body: bytes) -> int:
    check = PLANT_MAGIC
    for (word,) in struct.iter_unpack("<I", body):
        check ^= word
    return check
'''


def docstring(text: str, indent: str) -> str:
    """Return a docstring."""
    first, dot, more = text.partition(". ")
    first += dot.strip()
    if not more:
        return f'{indent}"""{first}"""'
    rest = textwrap.wrap(more, 100 - len(indent), break_on_hyphens=False)
    lines = [f'{indent}"""{first}', "", *(indent + line for line in rest), f'{indent}"""']
    return "\n".join(lines)


def enum_class(entry: Entry, base: str, values: list[int]) -> str:
    """Return an enum class; what a value means stands above it."""
    lines = [
        f"class {entry['name'].capitalize()}({base}):",
        docstring(entry["doc"], "    "),
        "",
    ]
    for item, value in zip(entry["values"], values, strict=True):
        note = f"  # {item['doc']}" if item.get("doc") else ""
        line = f"    {item['name'].upper()} = {value}"
        if len(line + note) > 100:
            lines.append(f"    # {item['doc']}")
            note = ""
        lines.append(line + note)
    return "\n".join(lines)


def dataclass_of(entry: Entry, name: str, base: str) -> str:
    """Return the dataclass of a frame or record, whose base says of what class it is."""
    tail = entry.get("tail")
    code = "<" + "".join(CODES[field["type"]] for field in entry["fields"])
    own = f', tail="{CODES[tail["type"]]}"' if tail else ""
    lines = [
        "@dataclass(frozen=True)",
        f'class {name}({base}, form="{code}"{own}):',
        docstring(entry["doc"], "    "),
    ]
    if entry["fields"] or tail:
        lines.append("")
    for field in entry["fields"]:
        note = f"  # {field['doc']}" if field["doc"] else ""
        lines.append(f"    {field['name']}: int{note}")
    if tail:
        lines.append(f"    {tail['name']}: tuple[int, ...]")
    return "\n".join(lines)


def class_name(frame: Entry) -> str:
    """Return the Python name of a frame."""
    words = "".join(word.capitalize() for word in frame["name"].split("_"))
    return words + ("Request" if is_request(frame) else "Answer")


def frames_module(frames: Entry, signals: Entry) -> str:
    """Return frames.py."""
    protocol, plant = frames["protocol"], frames["plant"]
    parts = [
        f"VERSION = {protocol['version']}\nPAYLOAD_MOST = {protocol['payload_most']}\n"
        f"PLANT_MAGIC = 0x{plant['magic']:08X}\n"
    ]
    parts += [f"{enum_class(e, 'IntEnum', numbers(e))}\n" for e in link_enums(frames, signals)]
    rows = [
        f"    Setting.{s['name'].upper()}: SettingRange({s['low']}, {s['high']}, "
        f"{s.get('default', 0)}, {s.get('default_ms', 0)}, {s['run']}),"
        for s in signals["setting"]
    ]
    parts.append(
        'class SettingRange(NamedTuple):\n    """What a setting may be."""\n\n'
        "    low: int\n    high: int\n    start: int\n"
        "    start_ms: int  # the same of a setting in ticks, else 0\n    while_running: bool\n"
    )
    parts.append("SETTINGS = {\n" + "\n".join(rows) + "\n}\n\n" + BASES)
    by_name = {frame["name"]: frame for frame in frames["frame"]}
    for frame in frames["frame"]:
        base = f"Message, code=0x{frame['type']:02X}"
        if is_request(frame):
            base += f", answer=0x{by_name[frame['answer']]['type']:02X}"
        parts.append(dataclass_of(frame, class_name(frame), base) + "\n")
    for record in plant["record"]:
        name = "".join(word.capitalize() for word in record["name"].split("_"))
        parts.append(dataclass_of(record, name, "PlantRecord") + "\n")
    names = [class_name(frame) for frame in frames["frame"] if not is_request(frame)]
    listed = "".join(f"        {name},\n" for name in names)
    parts.append(
        "ANSWERS: dict[int, type[Message]] = {\n    answer.TYPE: answer\n    for answer in (\n"
        f"{listed}    )\n}}\n"
    )
    return PREAMBLE + "\n\n".join(parts)


def states_module(controller: Entry) -> str:
    """Return states.py."""
    parts = [enum_class(entry, "IntEnum", numbers(entry)) for entry in controller["enum"]]
    parts += [enum_class(entry, "IntFlag", bits(entry)) for entry in controller["flags"]]
    return STATES_PREAMBLE + "\n" + "\n\n\n".join(parts) + "\n"
