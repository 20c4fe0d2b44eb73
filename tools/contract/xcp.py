"""Generate the C header with the signals and areas that an XCP master sees."""

from __future__ import annotations

from c_code import enum, guarded
from tables import Entry, numbers


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
