"""Make from firmware/link/frames.toml the link's C header, Python module and page, and the states.

What a controller does without a link, its states, commands, faults and flags, goes into headers of
the core and a Python module of their own. Without arguments the files are written; with ``--check``
nothing is written and the exit code is 1 if one of them is not what the table says.
"""

from __future__ import annotations

import sys
import textwrap
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "firmware" / "link" / "frames.toml"
HEADER = ROOT / "firmware" / "link" / "frames.h"
MODULE = ROOT / "src" / "anhyst" / "link" / "frames.py"
PAGE = ROOT / "docs" / "firmware.md"
CORE_STATES = ROOT / "core" / "include" / "anhyst" / "states.h"
CORE_FLAGS = ROOT / "core" / "include" / "anhyst" / "flags.h"
STATES = ROOT / "src" / "anhyst" / "control" / "states.py"

SIZES = {"u8": 1, "u16": 2, "u32": 4, "i16": 2, "i32": 4}
C_TYPES = {kind: f"{'' if kind[0] == 'i' else 'u'}int{kind[1:]}_t" for kind in SIZES}
CODES = {"u8": "B", "u16": "H", "u32": "I", "i16": "h", "i32": "i"}
BEGIN, END = "<!-- made by tools/frames.py -->", "<!-- end of what tools/frames.py made -->"

Entry = dict[str, Any]


def size_of(fields: list[Entry]) -> int:
    """Return the bytes of these fields."""
    return sum(SIZES[field["type"]] for field in fields)


def is_request(frame: Entry) -> bool:
    """Tell whether the PC sends this frame."""
    return "answer" in frame


def lists(table: Entry) -> list[Entry]:
    """Return every list of names with numbers: enums, then settings and signals."""
    settings = {"name": "setting", "doc": "Settings.", "values": table["setting"]}
    signals = {"name": "signal", "doc": "What can be recorded.", "values": table["signal"]}
    return [*table["enum"], settings, signals]


# --- C ------------------------------------------------------------------------------------------


def c_comment(text: str, indent: str = "") -> str:
    """Return the text as a comment of its own lines."""
    return textwrap.fill(
        f"/* {text} */",
        100,
        initial_indent=indent,
        subsequent_indent=f"{indent}   ",
        break_on_hyphens=False,
    )


def c_number(value: int) -> str:
    """Return an integer constant that means the same whatever the width of int."""
    return "INT32_MIN" if value == -(2**31) else f"INT32_C({value})"


def c_line(code: str, doc: str) -> list[str]:
    """Return an indented line with its comment, behind it where it fits, else above."""
    if not doc:
        return [f"  {code}"]
    if len(f"  {code} /* {doc} */") <= 100:
        return [f"  {code} /* {doc} */"]
    return [c_comment(doc, "  "), f"  {code}"]


def c_enum(prefix: str, entry: Entry, values: list[int]) -> str:
    """Return an enum whose constants are prefix_NAME."""
    lines = [c_comment(entry["doc"]), "enum {"]
    for item, value in zip(entry["values"], values, strict=True):
        lines += c_line(f"{prefix}_{item['name'].upper()} = {value},", item.get("doc", ""))
    lines.append(f"  {prefix}_COUNT = {len(values)}")
    return "\n".join([*lines, "};"])


def c_struct(name: str, entry: Entry) -> str:
    """Return the struct of a frame's or record's fixed fields."""
    lines = [c_comment(entry["doc"]), "typedef struct {"]
    for field in entry["fields"]:
        lines += c_line(f"{C_TYPES[field['type']]} {field['name']};", field["doc"])
    return "\n".join([*lines, f"}} {name};"])


def c_access(field: Entry, at: int, put: bool) -> str:
    """Return the statement that puts or gets one field."""
    kind, name = field["type"], field["name"]
    signed = kind.startswith("i")
    wide = f"u{8 * SIZES[kind]}"
    if put:
        value = f"({C_TYPES[wide]})m->{name}" if signed else f"m->{name}"
        return f"  link_put_{wide}(p + {at}, {value});"
    get = f"link_get_{kind if signed else wide}(p + {at})"
    return f"  m->{name} = {get};"


def c_body(entry: Entry, put: bool) -> list[str]:
    """Return the statements that put or get all fixed fields."""
    at = 0
    lines = []
    for field in entry["fields"]:
        lines.append(c_access(field, at, put))
        at += SIZES[field["type"]]
    return lines


def c_frame(frame: Entry) -> str:
    """Return size, struct and the one access that the controller needs."""
    name = f"link_{frame['name']}"
    parts = [f"#define LINK_SIZE_{frame['name'].upper()} {size_of(frame['fields'])}"]
    if frame["fields"]:
        parts.append(c_struct(name, frame))
        if is_request(frame):
            head = f"static inline void link_get_{frame['name']}({name} *m, const uint8_t *p)"
        else:
            head = f"static inline void link_put_{frame['name']}(uint8_t *p, const {name} *m)"
        body = c_body(frame, put=not is_request(frame))
        parts.append("\n".join([head, "{", *body, "}"]))
    return "\n".join(parts)


def c_plant(record: Entry) -> str:
    """Return size, struct and access of a record of the plant's bus."""
    name, size = record["name"], size_of(record["fields"]) + 4
    parts = [f"#define LINK_SIZE_{name.upper()} {size}", c_struct(f"link_{name}", record)]
    words = range(0, size - 4, 4)
    if name == "plant_sample":
        check = " ^ ".join(f"link_get_u32(p + {at})" for at in [*words, size - 4])
        parts.append(
            "/* Whether the record is sound; fills it either way. */\n"
            f"static inline int link_get_{name}(link_{name} *m, const uint8_t *p)\n{{\n"
            + "\n".join(c_body(record, put=False))
            + f"\n  return ({check}) ==\n         LINK_PLANT_MAGIC;\n}}"
        )
    else:
        check = " ^ ".join(f"link_get_u32(p + {at})" for at in words)
        parts.append(
            f"static inline void link_put_{name}(uint8_t *p, const link_{name} *m)\n{{\n"
            + "\n".join(c_body(record, put=True))
            + f"\n  link_put_u32(p + {size - 4},\n               {check} ^ LINK_PLANT_MAGIC);\n}}"
        )
    return "\n".join(parts)


def header(table: Entry) -> str:
    """Return frames.h."""
    protocol, plant = table["protocol"], table["plant"]
    parts = [
        "/* SPDX-License-Identifier: Apache-2.0 */\n"
        "/* Frames of the link and records of the plant's bus: made by tools/frames.py from\n"
        "   frames.toml, which says what they mean. Do not edit. */\n"
        "/* clang-format off */\n"
        "#ifndef ANHYST_LINK_FRAMES_H\n#define ANHYST_LINK_FRAMES_H\n\n"
        '#include "link/bytes.h"\n\n'
        f"#define LINK_VERSION {protocol['version']}\n"
        f"#define LINK_PAYLOAD_MOST {protocol['payload_most']}\n"
        f"#define LINK_PLANT_MAGIC UINT32_C({plant['magic']:#010X})".replace("0X", "0x")
    ]
    types = [{"name": f["name"], "doc": f["doc"]} for f in table["frame"]]
    numbers = [frame["type"] for frame in table["frame"]]
    parts.append(c_enum("LINK_TYPE", {"doc": "Types of frames.", "values": types}, numbers))
    for entry in lists(table):
        if not entry.get("core"):
            count = range(len(entry["values"]))
            parts.append(c_enum(f"LINK_{entry['name'].upper()}", entry, list(count)))
    rows = [
        f"  {{{c_number(s['low'])}, {c_number(s['high'])}, {c_number(s['default'])}, "
        f"{int(s['run'])}}}, /* {s['name']} */"
        for s in table["setting"]
    ]
    parts.append(
        "/* Low, high, value at the start, whether it may be written in the state run. */\n"
        "#define LINK_SETTING_TABLE \\\n" + " \\\n".join(rows)
    )
    parts += [c_frame(frame) for frame in table["frame"]]
    parts += [c_plant(record) for record in plant["record"]]
    return "\n\n".join(parts) + "\n\n#endif\n"


def core_header(guard: str, about: str, entries: list[tuple[str, Entry, list[int]]]) -> str:
    """Return a header of the core: macros, prefix by prefix."""
    parts = [
        "/* SPDX-License-Identifier: Apache-2.0 */\n"
        f"{c_comment(about + ' Made by tools/frames.py from firmware/link/frames.toml.')}\n"
        f"/* clang-format off */\n#ifndef {guard}\n#define {guard}"
    ]
    for prefix, entry, values in entries:
        lines = [c_comment(entry["doc"])]
        for item, value in zip(entry["values"], values, strict=True):
            code = f"#define {prefix}_{item['name'].upper()} {value}U"
            doc = item.get("doc", "")
            if doc and len(f"{code} /* {doc} */") > 100:
                lines.append(c_comment(doc))
                doc = ""
            lines.append(f"{code} /* {doc} */" if doc else code)
        if entry["name"] != "flag":
            lines.append(f"#define {prefix}_COUNT {len(values)}U")
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n\n#endif\n"


def core_enums(table: Entry) -> list[Entry]:
    """Return the enums that a controller without a link knows."""
    return [entry for entry in table["enum"] if entry.get("core")]


def core_states(table: Entry) -> str:
    """Return states.h."""
    about = "States, phases, faults and commands of a controller."
    entries = [
        (f"ANHYST_{e['name'].upper()}", e, list(range(len(e["values"])))) for e in core_enums(table)
    ]
    return core_header("ANHYST_STATES_H", about, entries)


def core_flags(table: Entry) -> str:
    """Return flags.h."""
    about = "Flags of a solve and of a tick, the same in every number format."
    entries = [
        ("ANHYST", entry, [1 << n for n in range(len(entry["values"]))]) for entry in table["flags"]
    ]
    return core_header("ANHYST_FLAGS_H", about, entries)


# --- Python -------------------------------------------------------------------------------------

PREAMBLE = '''"""What is said on the link and on the bus of a virtual plant.

Made by tools/frames.py from firmware/link/frames.toml, which says what they mean: do not edit.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import ClassVar, NamedTuple, Self

'''

STATES_PREAMBLE = '''"""States, phases, faults, commands and flags of a controller.

Made by tools/frames.py from firmware/link/frames.toml: do not edit.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag

'''

BASES = '''
@dataclass(frozen=True)
class Message:
    """A payload: fixed fields, then for some types a row of numbers."""

    TYPE: ClassVar[int]
    FIXED: ClassVar[struct.Struct]
    TAIL: ClassVar[str] = ""

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

    def pack(self) -> bytes:
        """Return the record with its check."""
        body = self.FIXED.pack(*(getattr(self, field.name) for field in fields(self)))
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


def py_doc(text: str, indent: str) -> str:
    """Return a docstring."""
    first, dot, more = text.partition(". ")
    first += dot.strip()
    if not more:
        return f'{indent}"""{first}"""'
    rest = textwrap.wrap(more, 100 - len(indent), break_on_hyphens=False)
    lines = [f'{indent}"""{first}', "", *(indent + line for line in rest), f'{indent}"""']
    return "\n".join(lines)


def py_enum(entry: Entry, base: str, values: list[int]) -> str:
    """Return an enum class; what a value means stands above it."""
    lines = [f"class {entry['name'].capitalize()}({base}):", py_doc(entry["doc"], "    "), ""]
    for item, value in zip(entry["values"], values, strict=True):
        note = f"  # {item['doc']}" if item.get("doc") else ""
        line = f"    {item['name'].upper()} = {value}"
        if len(line + note) > 100:
            lines.append(f"    # {item['doc']}")
            note = ""
        lines.append(line + note)
    return "\n".join(lines)


def py_class(entry: Entry, name: str, base: str, constants: list[str]) -> str:
    """Return the dataclass of a frame or record."""
    tail = entry.get("tail")
    code = "<" + "".join(CODES[field["type"]] for field in entry["fields"])
    lines = ["@dataclass(frozen=True)", f"class {name}({base}):", py_doc(entry["doc"], "    "), ""]
    lines += [f"    {constant}" for constant in constants]
    lines.append(f'    FIXED: ClassVar[struct.Struct] = struct.Struct("{code}")')
    if tail:
        lines.append(f'    TAIL: ClassVar[str] = "{CODES[tail["type"]]}"')
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


def module(table: Entry) -> str:
    """Return frames.py."""
    protocol, plant = table["protocol"], table["plant"]
    parts = [
        f"VERSION = {protocol['version']}\nPAYLOAD_MOST = {protocol['payload_most']}\n"
        f"PLANT_MAGIC = 0x{plant['magic']:08X}\n"
    ]
    parts += [
        py_enum(e, "IntEnum", list(range(len(e["values"])))) + "\n"
        for e in lists(table)
        if not e.get("core")
    ]
    rows = [
        f"    Setting.{s['name'].upper()}: SettingRange({s['low']}, {s['high']}, {s['default']}, "
        f"{s['run']}),"
        for s in table["setting"]
    ]
    parts.append(
        'class SettingRange(NamedTuple):\n    """What a setting may be."""\n\n'
        "    low: int\n    high: int\n    start: int\n    while_running: bool\n"
    )
    parts.append("SETTINGS = {\n" + "\n".join(rows) + "\n}\n\n" + BASES)
    by_name = {frame["name"]: frame for frame in table["frame"]}
    for frame in table["frame"]:
        constants = [f"TYPE: ClassVar[int] = 0x{frame['type']:02X}"]
        if is_request(frame):
            answer = by_name[frame["answer"]]["type"]
            constants.append(f"ANSWER: ClassVar[int] = 0x{answer:02X}")
        parts.append(py_class(frame, class_name(frame), "Message", constants) + "\n")
    for record in plant["record"]:
        name = "".join(word.capitalize() for word in record["name"].split("_"))
        parts.append(py_class(record, name, "PlantRecord", []) + "\n")
    names = [class_name(frame) for frame in table["frame"] if not is_request(frame)]
    listed = "".join(f"        {name},\n" for name in names)
    parts.append(
        "ANSWERS: dict[int, type[Message]] = {\n    answer.TYPE: answer\n    for answer in (\n"
        f"{listed}    )\n}}\n"
    )
    return PREAMBLE + "\n\n".join(parts)


def states(table: Entry) -> str:
    """Return states.py."""
    parts = [py_enum(e, "IntEnum", list(range(len(e["values"])))) for e in core_enums(table)]
    parts += [
        py_enum(e, "IntFlag", [1 << n for n in range(len(e["values"]))]) for e in table["flags"]
    ]
    return STATES_PREAMBLE + "\n" + "\n\n\n".join(parts) + "\n"


# --- the page -----------------------------------------------------------------------------------


def page_fields(entry: Entry) -> str:
    """Return the fields in the order of their bytes."""
    names = [f"{field['name']} {field['type']}" for field in entry["fields"]]
    if tail := entry.get("tail"):
        names.append(f"{tail['name']} {tail['type']}...")
    return ", ".join(names) or "none"


def page_values(title: str, entry: Entry, shift: bool) -> list[str]:
    """Return the table of an enum, or of flags."""
    lines = ["", f"| number | {title} | meaning |", "| --- | --- | --- |"]
    for number, value in enumerate(entry["values"]):
        code = 1 << number if shift else number
        lines.append(f"| {code} | `{value['name']}` | {value['doc'] or '-'} |")
    return lines


def page(table: Entry) -> str:
    """Return the tables of docs/firmware.md."""
    lines = ["| type | request | payload | answer | meaning |", "| --- | --- | --- | --- | --- |"]
    requests = [frame for frame in table["frame"] if is_request(frame)]
    answers = [frame for frame in table["frame"] if not is_request(frame)]
    for f in requests:
        payload = page_fields(f)
        lines.append(
            f"| {f['type']:#04x} | `{f['name']}` | {payload} | `{f['answer']}` | {f['doc']} |"
        )
    lines += ["", "| type | answer | payload | meaning |", "| --- | --- | --- | --- |"]
    for f in answers:
        lines.append(f"| {f['type']:#04x} | `{f['name']}` | {page_fields(f)} | {f['doc']} |")
    lines += ["", "| setting | from | to | at the start | in run | meaning |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    for s in table["setting"]:
        start = s["default"] or "rate/10"
        start = s["default"] if s["low"] <= s["default"] <= s["high"] else start
        run = "yes" if s["run"] else "no"
        lines.append(f"| `{s['name']}` | {s['low']} | {s['high']} | {start} | {run} | {s['doc']} |")
    titles = {
        "phase": "phase of a controller of position",
        "command": "command",
        "fault": "reason of a fault",
        "reason": "reason of a NAK",
    }
    for entry in table["enum"]:
        if entry["name"] in titles:
            lines += page_values(titles[entry["name"]], entry, shift=False)
    for entry in table["flags"]:
        lines += page_values("bit of the flags", entry, shift=True)
    return "\n".join(lines)


def page_with_tables(text: str, table: Entry) -> str:
    """Return the page's text with its tables made anew, or as it was where it has no place."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        return text
    return f"{before}{BEGIN}\n\n{page(table)}\n\n{END}{after}"


def main() -> int:
    """Write the files, or compare them."""
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    wanted = {
        HEADER: header(table),
        MODULE: module(table),
        CORE_STATES: core_states(table),
        CORE_FLAGS: core_flags(table),
        STATES: states(table),
    }
    if PAGE.exists():
        wanted[PAGE] = page_with_tables(PAGE.read_text(encoding="utf-8"), table)
    differ = [f for f, text in wanted.items() if not f.exists() or f.read_text("utf-8") != text]
    if sys.argv[1:] == ["--check"]:
        for file in differ:
            print(f"{file.relative_to(ROOT)} is not what frames.toml says: run tools/frames.py")
        return 1 if differ else 0
    for file in differ:
        file.write_text(wanted[file], encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
