"""Generate C from the tables: frames of the link, states and flags of a controller."""

from __future__ import annotations

import textwrap

from tables import SIZES, Entry, enum_numbers, flag_bits, is_request, link_enums, total_bytes

C_TYPES = {kind: f"{'' if kind[0] == 'i' else 'u'}int{kind[1:]}_t" for kind in SIZES}
SPDX = "/* SPDX-License-Identifier: Apache-2.0 */"


def block_comment(text: str, indent: str = "") -> str:
    """Return a text as a comment on separate lines."""
    return textwrap.fill(
        f"/* {text} */", 100, initial_indent=indent, subsequent_indent=f"{indent}   ", break_on_hyphens=False
    )


def integer_constant(value: int) -> str:
    """Return an integer constant whose type does not depend on the width of int."""
    return "INT32_MIN" if value == -(2**31) else f"INT32_C({value})"


def commented_line(code: str, doc: str) -> list[str]:
    """Return an indented line with its comment: after the code if it fits, otherwise above."""
    if not doc:
        return [f"  {code}"]
    if len(f"  {code} /* {doc} */") <= 100:
        return [f"  {code} /* {doc} */"]
    return [block_comment(doc, "  "), f"  {code}"]


def enum(prefix: str, entry: Entry, values: list[int]) -> str:
    """Return an enum whose constants are prefix_NAME."""
    lines = [block_comment(entry["doc"]), "enum {"]
    for item, value in zip(entry["values"], values, strict=True):
        lines += commented_line(f"{prefix}_{item['name'].upper()} = {value},", item.get("doc", ""))
    lines.append(f"  {prefix}_COUNT = {len(values)}")
    return "\n".join([*lines, "};"])


def struct(name: str, entry: Entry) -> str:
    """Return the struct of a frame's or record's fixed fields."""
    lines = ["typedef struct {"]
    arrays = fields_by_array(entry)
    for field in entry["fields"]:
        if "array" not in field:
            other_elements = arrays.get(field["name"], [])
            size = f"[{1 + len(other_elements)}]" if other_elements else ""
            doc = "; ".join([field["doc"], *(element["doc"] for element in other_elements)])
            lines += commented_line(f"{C_TYPES[field['type']]} {field['name']}{size};", doc)
    return "\n".join([*lines, f"}} {name};"])


def fields_by_array(entry: Entry) -> dict[str, list[Entry]]:
    """Return the fields that form an array for several magnets, by the array's name."""
    found: dict[str, list[Entry]] = {}
    for field in entry["fields"]:
        if "array" in field:
            found.setdefault(field["array"], []).append(field)
    return found


def field_access(field: Entry, variable: str, byte_offset: int, is_write: bool) -> str:
    """Return the statement that writes or reads one field."""
    kind = field["type"]
    is_signed = kind.startswith("i")
    wire_type = f"u{8 * SIZES[kind]}"
    if is_write:
        value = f"({C_TYPES[wire_type]}){variable}" if is_signed else variable
        return f"  link_put_{wire_type}(p + {byte_offset}, {value});"
    read_expression = f"link_get_{kind if is_signed else wire_type}(p + {byte_offset})"
    return f"  {variable} = {read_expression};"


def all_field_accesses(entry: Entry, is_write: bool) -> list[str]:
    """Return the statements that write or read all fixed fields."""
    byte_offset = 0
    lines = []
    arrays = fields_by_array(entry)
    for field in entry["fields"]:
        name = field.get("array", field["name"])
        element = f"[{field.get('number', 1) - 1}]" if name in arrays else ""
        lines.append(field_access(field, f"m->{name}{element}", byte_offset, is_write))
        byte_offset += SIZES[field["type"]]
    return lines


def field_code(frame: Entry) -> str:
    """Return the access to a frame with a single field, which needs no struct."""
    field = frame["fields"][0]
    name, c_type = field["name"], C_TYPES[field["type"]]
    if is_request(frame):
        head = f"static inline {c_type} link_get_{frame['name']}(const uint8_t *p)"
        body = f"return link_get_{field['type']}(p);"
    else:
        head = f"static inline void link_put_{frame['name']}(uint8_t *p, {c_type} {name})"
        body = field_access(field, name, 0, is_write=True).strip()
    return "\n".join([block_comment(f"{name}: {field['doc']}"), f"{head} {{ {body} }}"])


def frame_code(frame: Entry) -> str:
    """Return the size, the struct and the one access function that the controller needs."""
    name = f"link_{frame['name']}"
    parts = [f"#define LINK_SIZE_{frame['name'].upper()} {total_bytes(frame['fields'])}"]
    if len(frame["fields"]) == 1:
        parts.append(field_code(frame))
    elif frame["fields"]:
        parts.append(struct(name, frame))
        if is_request(frame):
            head = f"static inline void link_get_{frame['name']}({name} *m, const uint8_t *p)"
        else:
            head = f"static inline void link_put_{frame['name']}(uint8_t *p, const {name} *m)"
        body = all_field_accesses(frame, is_write=not is_request(frame))
        parts.append("\n".join([head, "{", *body, "}"]))
    return "\n".join(parts)


def plant_code(record: Entry) -> str:
    """Return the size, the struct and the access functions of a record on the plant's bus."""
    name, size = record["name"], total_bytes(record["fields"]) + 4
    size_line = f"#define LINK_SIZE_{name.upper()} {size}"
    parts = [size_line, block_comment(record["doc"]), struct(f"link_{name}", record)]
    words = range(0, size - 4, 4)
    if name == "plant_sample":
        check = " ^ ".join(f"link_get_u32(p + {byte_offset})" for byte_offset in [*words, size - 4])
        parts.append(
            "/* Returns whether the record is valid; fills it in any case. */\n"
            f"static inline int link_get_{name}(link_{name} *m, const uint8_t *p)\n{{\n"
            + "\n".join(all_field_accesses(record, is_write=False))
            + f"\n  return ({check}) == LINK_PLANT_MAGIC;\n}}"
        )
    else:
        check = " ^ ".join(f"link_get_u32(p + {at})" for at in words)
        parts.append(
            f"static inline void link_put_{name}(uint8_t *p, const link_{name} *m)\n{{\n"
            + "\n".join(all_field_accesses(record, is_write=True))
            + f"\n  link_put_u32(p + {size - 4}, {check} ^ LINK_PLANT_MAGIC);\n}}"
        )
    return "\n".join(parts)


def bus_header(plant: Entry) -> str:
    """Return the header that the plant uses for the records. It leaves out their check words."""
    parts = []
    for record in plant["record"]:
        prefix = f"ANHYST_BUS_{record['name'].removeprefix('plant_').upper()}"
        lines = [block_comment(record["doc"]), "enum {"]
        for field in record["fields"]:
            lines += commented_line(f"{prefix}_{field['name'].upper()},", field["doc"])
        parts.append("\n".join([*lines, f"  {prefix}_WORDS", "};"]))
    description = (
        "Records of 32-bit words that a virtual plant and a firmware exchange in each tick. Generated "
        "by tools/contract from contract/frames.toml."
    )
    return guarded_header("ANHYST_PLANT_BUS_WORDS_H", description, ["#include <stdint.h>", *parts])


def frames_header(frames: Entry, signals: Entry) -> str:
    """Return the contents of frames.h."""
    protocol, plant = frames["protocol"], frames["plant"]
    parts = [
        f"{SPDX}\n"
        "/* Frames of the link and records of the plant's bus. Generated by tools/contract from\n"
        "   contract/frames.toml and signals.toml, which describe them. Do not edit. */\n"
        "/* clang-format off */\n"
        "#ifndef ANHYST_LINK_FRAMES_H\n#define ANHYST_LINK_FRAMES_H\n\n"
        '#include "link/bytes.h"\n\n'
        f"#define LINK_VERSION {protocol['version']}\n"
        f"#define LINK_MAX_PAYLOAD {protocol['payload_most']}\n"
        f"#define LINK_PLANT_MAGIC UINT32_C({plant['magic']:#010X})".replace("0X", "0x")
    ]
    types = {"doc": "Types of frames.", "values": frames["frame"]}
    parts.append(enum("LINK_TYPE", types, [frame["type"] for frame in frames["frame"]]))
    received_frames = {
        "name": "signal",
        "doc": "Signals that can be read at every tick.",
        "values": signals["signal"],
    }
    parts += [
        enum(f"LINK_{entry['name'].upper()}", entry, enum_numbers(entry))
        for entry in [*link_enums(frames, signals), received_frames]
    ]
    rows = [
        f"  {{{integer_constant(setting['low'])}, {integer_constant(setting['high'])}, "
        f"{integer_constant(setting.get('default', 0))}, "
        f"{setting.get('default_ms', 0)}, {int(setting['run'])}}}, /* {setting['name']} */"
        for setting in signals["setting"]
    ]
    parts.append(
        "/* Lowest value, highest value, initial value, initial value of a time in ms (otherwise 0),\n"
        "   whether it can be written in the state run. */\n"
        "#define LINK_SETTING_TABLE \\\n" + " \\\n".join(rows)
    )
    parts += [frame_code(frame) for frame in frames["frame"]]
    parts += [plant_code(record) for record in plant["record"]]
    return "\n\n".join(parts) + "\n\n#endif\n"


def macros(prefix: str, entry: Entry, values: list[int]) -> list[str]:
    """Return the macros prefix_NAME of a list of names with numbers."""
    lines = [block_comment(entry["doc"])]
    for item, value in zip(entry["values"], values, strict=True):
        code, doc = f"#define {prefix}_{item['name'].upper()} {value}U", item.get("doc", "")
        if doc and len(f"{code} /* {doc} */") > 100:
            lines += [block_comment(doc), code]
        else:
            lines.append(f"{code} /* {doc} */" if doc else code)
    return lines


def guarded_header(guard: str, description: str, parts: list[str]) -> str:
    """Return a header with an include guard."""
    file_start = (
        f"{SPDX}\n{block_comment(description)}\n/* clang-format off */\n#ifndef {guard}\n#define {guard}"
    )
    return "\n\n".join([file_start, *parts]) + "\n\n#endif\n"


def states_header(controller: Entry) -> str:
    """Return the contents of states.h."""
    description = (
        "States, phases, faults and commands of a controller. Generated by tools/contract from "
        "contract/controller.toml."
    )
    parts = []
    for entry in controller["enum"]:
        prefix, values = f"ANHYST_{entry['name'].upper()}", enum_numbers(entry)
        lines = macros(prefix, entry, values)
        parts.append("\n".join([*lines, f"#define {prefix}_COUNT {len(values)}U"]))
    return guarded_header("ANHYST_STATES_H", description, parts)


def flags_header(controller: Entry) -> str:
    """Return the contents of flags.h."""
    description = (
        "Flags of a solve and of a tick, the same in every number format. Generated by "
        "tools/contract from contract/controller.toml."
    )
    parts = ["\n".join(macros("ANHYST", entry, flag_bits(entry))) for entry in controller["flags"]]
    return guarded_header("ANHYST_FLAGS_H", description, parts)
