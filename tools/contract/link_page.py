"""Generate the tables of docs/link.md."""

from __future__ import annotations

from tables import Entry, is_request

BEGIN = "<!-- made by tools/contract -->"
END = "<!-- end of what tools/contract made -->"


def list_fields(entry: Entry) -> str:
    """Return the fields in the order of their bytes."""
    names = [f"{field['name']} {field['type']}" for field in entry["fields"]]
    if tail := entry.get("tail"):
        names.append(f"{tail['name']} {tail['type']}...")
    return ", ".join(names) or "none"


def value_table(title: str, entry: Entry, shift: bool) -> list[str]:
    """Return the table of an enum, or of flags."""
    lines = ["", f"| number | {title} | meaning |", "| --- | --- | --- |"]
    for number, value in enumerate(entry["values"]):
        code = 1 << number if shift else number
        lines.append(f"| {code} | `{value['name']}` | {value['doc'] or '-'} |")
    return lines


def link_tables(frames: Entry, signals: Entry, controller: Entry) -> str:
    """Return the tables of docs/link.md."""
    lines = ["| type | request | payload | answer | meaning |", "| --- | --- | --- | --- | --- |"]
    requests = [frame for frame in frames["frame"] if is_request(frame)]
    answers = [frame for frame in frames["frame"] if not is_request(frame)]
    for item in requests:
        payload = list_fields(item)
        lines.append(
            f"| {item['type']:#04x} | `{item['name']}` | {payload} | `{item['answer']}` | {item['doc']} |"
        )
    lines += ["", "| type | answer | payload | meaning |", "| --- | --- | --- | --- |"]
    for item in answers:
        lines.append(f"| {item['type']:#04x} | `{item['name']}` | {list_fields(item)} | {item['doc']} |")
    lines += ["", "| setting | from | to | at the start | in run | meaning |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    for setting in signals["setting"]:
        start = setting.get("default", f"{setting.get('default_ms')} ms")
        writable_in_run = "yes" if setting["run"] else "no"
        lines.append(
            f"| `{setting['name']}` | {setting['low']} | {setting['high']} | {start} | "
            f"{writable_in_run} | {setting['doc']} |"
        )
    titles = {
        "phase": "phase of a position controller",
        "command": "command",
        "fault": "reason for a fault",
        "reason": "reason for a NAK",
    }
    for entry in [*controller["enum"], *frames["enum"]]:
        if entry["name"] in titles:
            lines += value_table(titles[entry["name"]], entry, shift=False)
    for entry in controller["flags"]:
        lines += value_table("bit of the flags", entry, shift=True)
    return "\n".join(lines)


def page_with_tables(text: str, tables: str) -> str:
    """Return the page with new tables; return it unchanged if it has no markers for them."""
    text_before, begin, after_begin = text.partition(BEGIN)
    _, end, text_after = after_begin.partition(END)
    if not begin or not end:
        return text
    return f"{text_before}{BEGIN}\n\n{tables}\n\n{END}{text_after}"
