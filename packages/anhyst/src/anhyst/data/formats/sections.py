"""Convert text files with several tables, or without times, to one table: LabVIEW and aixACCT.

The columns of Elmer's scalars, whose names are in a second file, are also found here.

The file is rewritten in memory as one table with the same line numbers, so that messages name the
correct line. Lines that are not data become blank. Each row gets its time and the label of its
table.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

from anhyst.data.formats.channels import MAX_BYTES, is_number, is_number_or_mark, parse_number
from anhyst.data.formats.encoding import detect_encoding
from anhyst.data.formats.preamble import Column, TextColumns, drop_empty_tail, normalise_unit, split_line
from anhyst.data.formats.stamps import second_of_day
from anhyst.support.errors import InputError

_LABVIEW_START = re.compile(rb"\s*LabVIEW Measurement", re.IGNORECASE)
_TABLE_TITLE = re.compile(r"\s*\[?(Table|Contour)\s+(\d+)\]?\s*:?\s*", re.IGNORECASE)
_ELMER_NAME = re.compile(r"^\s*\d+\s*:\s*(?:res\s*:\s*)?(.*\S)\s*$", re.M)
_ELMER_UNITS = (
    (re.compile(r"gap|position|displacement|stroke|\bx\b", re.I), "m"),
    (re.compile(r"flux|linkage|\bpsi\b", re.I), "Wb"),
    (re.compile(r"force", re.I), "N"),
    (re.compile(r"current|\bi_", re.I), "A"),
)
"""Units of Elmer's columns, by words of their names."""
_END_OF_HEADER = "***end_of_header***"


def join_sections(path: Path, head: bytes, content: bytes | None) -> tuple[bytes | None, TextColumns | None]:
    """Return a file as one table, and its columns; other files are unchanged."""
    if (names := _read_elmer_names(path)) is not None:
        return content, names
    start = (content[: len(head)] if content is not None else head).removeprefix(b"\xef\xbb\xbf")
    is_labview = _LABVIEW_START.match(start) is not None
    is_aixacct = re.search(rb"^\s*\[?Table\s+\d+\]?\s*:?\s*$", start, re.M | re.I) is not None
    if not is_labview and not is_aixacct:
        return content, None
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"{path}: is larger than {MAX_BYTES >> 30} GiB; cut it", code="too-large")
    file_content = path.read_bytes() if content is None else content
    lines = re.split(r"\r?\n", file_content.decode(detect_encoding(file_content), "replace"))
    sections, other_tables = (
        (_find_labview_segments(path, lines), []) if is_labview else _find_tables(path, lines)
    )
    if not sections:
        return content, None
    notes = [f"table {section.label} has other columns and is left out" for section in other_tables]
    rows, columns = _merge_sections(sections, len(lines), notes)
    return ("\n".join(rows) + "\n").encode(), columns


def _read_elmer_names(path: Path) -> TextColumns | None:
    """Return the columns that Elmer's `SaveScalars` names in a second file, which are in SI units."""
    names_path = path.with_name(f"{path.name}.names")
    text = names_path.read_text(encoding="utf-8", errors="replace") if names_path.is_file() else ""
    _, start, list_text = text.partition("Variables in columns of matrix")
    names = [match[1] for match in _ELMER_NAME.finditer(list_text)]
    units = [next((unit for words, unit in _ELMER_UNITS if words.search(name)), "") for name in names]
    columns = tuple(Column(*names_and_units) for names_and_units in zip(names, units, count(), strict=False))
    return TextColumns(0, None, len(columns), columns) if start and columns else None


@dataclass
class _Section:
    """One table: its label, its columns, and its rows by line."""

    label: str
    columns: list[Column]
    rows: dict[int, list[str]] = field(default_factory=dict)
    start: float = 0.0  # time of the first sample, s
    step: float = 0.0


def _merge_sections(sections: list[_Section], count: int, notes: list[str]) -> tuple[list[str], TextColumns]:
    """Return one text with the rows of all tables at their line numbers.

    If there are several tables, a column ``loop`` distinguishes them.
    """
    text = [""] * count
    columns = sections[0].columns
    width = len(columns)
    if len(sections) > 1:
        columns = [*columns, Column("loop", "", width)]
    for section in sections:
        label_field = [section.label] if len(sections) > 1 else []
        for line, fields in section.rows.items():
            text[line] = "\t".join([*fields[:width], *[""] * (width - len(fields)), *label_field])
    first_line = min(min(section.rows) for section in sections)
    table = TextColumns(first_line, "\t", len(columns), tuple(columns), notes=tuple(notes), is_joined=True)
    return text, table


def _find_tables(path: Path, lines: list[str]) -> tuple[list[_Section], list[_Section]]:
    """Return the aixACCT tables with the most frequent columns, and the other tables.

    A table has a line such as ``Table 1``, settings, names with units, and numeric rows.
    """
    tables: list[_Section] = []
    label = ""
    for number, text in enumerate(lines):
        fields = drop_empty_tail(split_line(text, "\t"))
        if match := _TABLE_TITLE.fullmatch(text):
            label = match[2]
        elif len(fields) > 1 and is_number_or_mark(fields[0]):
            if tables and tables[-1].label == label:
                tables[-1].rows[number] = _check_field_count(path, number, fields, len(tables[-1].columns))
        elif len(fields) > 1 and "[" in text and not any(is_number(field) for field in fields):
            columns = [Column(name, "", position) for position, name in enumerate(fields)]
            tables.append(_Section(label, columns))
    tables = [section for section in tables if section.rows]
    if not tables:
        return [], []
    names = [tuple(column.name for column in section.columns) for section in tables]
    usual_names, _ = Counter(names).most_common(1)[0]
    sections = [
        section for section, section_names in zip(tables, names, strict=True) if section_names == usual_names
    ]
    if len({section.label for section in sections}) < len(sections):
        for number, section in enumerate(sections, start=1):
            section.label = str(number)
    return sections, [section for section in tables if section not in sections]


def _check_field_count(path: Path, number: int, fields: list[str], count: int) -> list[str]:
    """Return the fields of a row; raise an error unless there are ``count`` fields."""
    if len(fields) != count:
        raise InputError(
            f"{path}: line {number + 1}: has {len(fields)} fields where the header names {count} "
            "columns; complete or remove the line",
            code="fields-missing",
        )
    return fields


def _find_labview_segments(path: Path, lines: list[str]) -> list[_Section]:
    """Return the segments of a LabVIEW measurement file."""
    settings: dict[str, str] = {}
    data_line = len(lines)
    for number, text in enumerate(lines):
        key, _, value = re.sub(r"[\t,;]+", "\t", text.strip(), count=1).partition("\t")
        if key.strip().lower() == _END_OF_HEADER:
            data_line = number + 1
            break
        settings[key.strip().lower()] = value.strip()
    sign = {"comma": ",", "semicolon": ";"}.get(settings.get("separator", "tab").lower(), "\t")
    reader = _SegmentReader(path, sign, x_columns=settings.get("x_columns", "one").lower())
    for number in range(data_line, len(lines)):
        reader.feed(number, lines[number])
    return reader.finish()


class _SegmentReader:
    """Collects the segments of a LabVIEW measurement file line by line."""

    def __init__(self, path: Path, delimiter: str, x_columns: str) -> None:
        self.path, self.sign, self.kind = path, delimiter, x_columns
        self.segments: list[_Section] = []
        self.settings: dict[str, list[str]] = {}
        self.is_header = True
        self.expects_names = False

    def feed(self, number: int, text: str) -> None:
        """Process one line."""
        fields = split_line(text, self.sign)
        key = fields[0].lower()
        if not any(fields):
            return
        if key == _END_OF_HEADER:
            self.is_header, self.expects_names = False, True
        elif key == "channels" or (not self.is_header and key in {"samples", "date"}):
            self.settings = {key: fields[1:]}
            self.is_header = True
        elif self.expects_names or key == "x_value":
            self._start_segment(fields)
            self.is_header = self.expects_names = False
        elif self.is_header:
            self.settings[key] = fields[1:]
        else:
            self._add_row(number, fields)

    def finish(self) -> list[_Section]:
        """Return the segments; segments that continue in time are joined."""
        segments = [section for section in self.segments if section.rows]
        if not segments:
            raise InputError(
                f"{self.path}: has no samples below '***End_of_Header***'; export it again", code="no-data"
            )
        sections: list[_Section] = []
        end_time = float("-inf")
        for section in segments:
            times = self._segment_times(section)
            is_continued = sections and abs(times[0] - end_time) <= 0.5 * section.step
            if is_continued and section.columns == sections[-1].columns:
                sections[-1].rows |= section.rows
            else:
                section.label = str(len(sections) + 1)
                sections.append(section)
            end_time = times[-1] + section.step
        if any(section.columns != sections[0].columns for section in sections):
            raise InputError(
                f"{self.path}: its segments have different channels; export them as files",
                code="different-channels",
            )
        return sections

    def _start_segment(self, names: list[str]) -> None:
        if names and names[-1].lower() == "comment":
            names = names[:-1]
        names = drop_empty_tail(names)
        step = 2 if self.kind == "multi" else 1
        channels = names[1::step]
        units = self.settings.get("y_unit_label", [])
        if len(units) > len(channels):  # one field for the times of each channel
            units = units[::step]
        units = [*units, *[""] * len(channels)][: len(channels)]
        columns = [Column("t", "s", 0)]
        columns += [
            Column(name, normalise_unit(unit), position)
            for position, (name, unit) in enumerate(zip(channels, units, strict=True), start=1)
        ]
        time = second_of_day(next(iter(self.settings.get("time", [])), ""))
        start = self._shared_setting("x0") + (0.0 if math.isnan(time) else time)
        self.segments.append(_Section("", columns, start=start, step=self._shared_setting("delta_x")))

    def _shared_setting(self, key: str) -> float:
        """Return a setting that must be equal for all channels; 0 if it is missing."""
        values = [text.replace(",", ".") for text in self.settings.get(key, []) if text]
        numbers = {float(text) for text in values if is_number(text)}
        if len(numbers) > 1 and self.kind == "no":
            raise InputError(
                f"{self.path}: its channels have different {key} ({', '.join(values)}); export them "
                "with one clock, or with X_Columns = One",
                code="different-steps",
            )
        return numbers.pop() if len(numbers) == 1 else 0.0

    def _add_row(self, number: int, fields: list[str]) -> None:
        if not self.segments:
            return
        section = self.segments[-1]
        count = len(section.columns) - 1
        if self.kind == "multi":
            times, values = fields[0 : 2 * count : 2], fields[1 : 2 * count : 2]
            if len(set(times)) > 1:
                raise InputError(
                    f"{self.path}: line {number + 1}: its channels have different times "
                    f"({', '.join(times)}); export them with one clock, or with X_Columns = One",
                    code="different-times",
                )
        elif self.kind == "no" and fields[0]:  # without the blank field for the time
            times, values = [""], _check_field_count(self.path, number, fields, count)
        else:
            times, values = fields[:1], fields[1 : 1 + count]
            _check_field_count(self.path, number, values, count)
        section.rows[number] = [*times[:1], *values]

    def _segment_times(self, section: _Section) -> list[float]:
        """Return the first and last time of a segment; missing times are added to its rows."""
        start, step = section.start - self.segments[0].start, section.step
        if self.kind == "no":
            if step <= 0.0:
                raise InputError(
                    f"{self.path}: does not state Delta_X, so its samples have no time; export it with "
                    "X_Columns = One",
                    code="no-time-step",
                )
            for n, fields in enumerate(section.rows.values()):
                fields[0] = repr(start + n * step)
            return [start, start + (len(section.rows) - 1) * step]
        rows = list(section.rows.values())
        end_texts = (rows[0][0], rows[-1][0])
        return [parse_number(text) if is_number(text) else 0.0 for text in end_texts]
