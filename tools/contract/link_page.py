"""Generate the tables of docs/link.md."""

from __future__ import annotations

from tables import Entry, is_request

BEGIN = "<!-- made by tools/contract -->"
END = "<!-- end of what tools/contract made -->"


def fields_of(entry: Entry) -> str:
    """Return the fields in the order of their bytes."""
    names = [f"{field['name']} {field['type']}" for field in entry["fields"]]
    if tail := entry.get("tail"):
        names.append(f"{tail['name']} {tail['type']}...")
    return ", ".join(names) or "none"


def values_of(title: str, entry: Entry, shift: bool) -> list[str]:
    """Return the table of an enum, or of flags."""
    lines = ["", f"| number | {title} | meaning |", "| --- | --- | --- |"]
    for number, value in enumerate(entry["values"]):
        code = 1 << number if shift else number
        lines.append(f"| {code} | `{value['name']}` | {value['doc'] or '-'} |")
    return lines


def page(frames: Entry, signals: Entry, controller: Entry) -> str:
    """Return the tables of docs/link.md."""
    lines = ["| type | request | payload | answer | meaning |", "| --- | --- | --- | --- | --- |"]
    requests = [frame for frame in frames["frame"] if is_request(frame)]
    answers = [frame for frame in frames["frame"] if not is_request(frame)]
    for f in requests:
        payload = fields_of(f)
        lines.append(f"| {f['type']:#04x} | `{f['name']}` | {payload} | `{f['answer']}` | {f['doc']} |")
    lines += ["", "| type | answer | payload | meaning |", "| --- | --- | --- | --- |"]
    for f in answers:
        lines.append(f"| {f['type']:#04x} | `{f['name']}` | {fields_of(f)} | {f['doc']} |")
    lines += ["", "| setting | from | to | at the start | in run | meaning |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    for s in signals["setting"]:
        start = s.get("default", f"{s.get('default_ms')} ms")
        run = "yes" if s["run"] else "no"
        lines.append(f"| `{s['name']}` | {s['low']} | {s['high']} | {start} | {run} | {s['doc']} |")
    titles = {
        "phase": "phase of a position controller",
        "command": "command",
        "fault": "reason for a fault",
        "reason": "reason for a NAK",
    }
    for entry in [*controller["enum"], *frames["enum"]]:
        if entry["name"] in titles:
            lines += values_of(titles[entry["name"]], entry, shift=False)
    for entry in controller["flags"]:
        lines += values_of("bit of the flags", entry, shift=True)
    return "\n".join(lines)


def page_with_tables(text: str, tables: str) -> str:
    """Return the page with its tables generated again; unchanged if it has no place for them."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        return text
    return f"{before}{BEGIN}\n\n{tables}\n\n{END}{after}"
