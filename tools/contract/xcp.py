"""C and Python of what a master of XCP sees."""

from __future__ import annotations

from c_code import enum, guarded
from tables import Entry, numbers

PREAMBLE = '''"""What a master of XCP sees of a controller: areas of addresses, values, sizes.

Made by tools/contract from contract/xcp.toml and signals.toml: do not edit.
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple


class XcpValue(NamedTuple):
    """A value of four bytes; `of` names the signal whose full scale 1.0 is."""

    name: str
    format: str
    doc: str
    of: str = ""
    low: int = -(1 << 31)
    high: int = (1 << 31) - 1
    body: str = ""


def _values(rows: str) -> tuple[XcpValue, ...]:
    """Return the values of a table with rows ``name format | key=value | doc``."""
    values = []
    for row in re.split(r"\\n(?! )", rows.strip()):
        fixed, *others, doc = " ".join(row.split()).split(" | ")
        name, form = fixed.split()
        given: dict[str, Any] = dict(other.split("=") for other in others)
        given |= {key: int(given[key]) for key in ("low", "high") if key in given}
        values.append(XcpValue(name, form, doc, **given))
    return tuple(values)


'''


def map_header(xcp: Entry, signals: Entry) -> str:
    """Return map.h."""
    about = (
        "What a master of XCP sees: made by tools/contract from contract/xcp.toml and "
        "signals.toml. Do not edit."
    )
    sizes = [
        ("PACKET", "most bytes of a command, an answer and a sample", str(xcp["packet"])),
        ("LISTS", "lists of samples", str(xcp["lists"])),
        ("ODTS", "parts of lists", str(xcp["odts"])),
        ("ENTRIES", "signals in all lists together", str(xcp["entries"])),
        ("QUEUE", "bytes of samples that wait to be sent", str(xcp["queue"])),
        ("EVENT", "name of the event", f'"{xcp["event"]}"'),
    ]
    lines = [f"#define XCP_{name} {value} /* {doc} */" for name, doc, value in sizes]
    lines.append("#ifndef XCP_SECRET")
    lines.append(f"#define XCP_SECRET UINT32_C(0x{xcp['secret']:08X}) /* of the key for a seed */")
    lines.append("#endif")
    areas = {"doc": "Areas: the upper half of an address.", "values": xcp["area"]}
    inputs = {"doc": "What may be written.", "values": signals["input"]}
    parts = [
        "\n".join(lines),
        enum("XCP_AREA", areas, [area["number"] for area in xcp["area"]]),
        enum("XCP_INPUT", inputs, numbers(inputs)),
    ]
    return guarded("ANHYST_XCP_MAP_H", about, parts)


def row(value: Entry) -> str:
    """Return a value as a row of a table; a long description is on a line of its own."""
    given = [f"{key}={value[key]}" for key in ("of", "low", "high", "body") if key in value]
    line = " | ".join([f"{value['name']} {value['format']}", *given])
    whole = f"{line} | {value['doc']}"
    return whole if len(whole) <= 100 else f"{line}\n   | {value['doc']}"


def map_module(xcp: Entry, signals: Entry) -> str:
    """Return xcp_map.py."""
    rows = [
        f"PACKET = {xcp['packet']}",
        f"LISTS = {xcp['lists']}",
        f"ODTS = {xcp['odts']}",
        f"ENTRIES = {xcp['entries']}",
        f"SECRET = 0x{xcp['secret']:08X}",
        f'EVENT = "{xcp["event"]}"',
        "",
        f"HEARTBEAT_MS = {signals['heartbeat_ms']}",
        '"""Ceiling of the boards for settings in ticks."""',
        "",
        "AREAS = {",
        *(f'    "{area["name"]}": 0x{area["number"] << 16:08X},' for area in xcp["area"]),
        "}",
        '"""Address of the first byte of each area."""',
    ]
    for name in ("signal", "setting", "input"):
        rows += ["", f'{name.upper()}S = _values("""', *map(row, signals[name]), '""")']
    return PREAMBLE + "\n".join(rows) + "\n"
