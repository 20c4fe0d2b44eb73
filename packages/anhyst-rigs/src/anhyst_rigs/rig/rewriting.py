"""Rewrite a rig file with changed keys. Comments stay next to their keys."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from anhyst.support.atomic import PathLike, atomic_writer, check_writable, relative_path
from anhyst.support.toml_file import TomlFile
from anhyst.support.toml_text import KeyPath, split_comment, toml_key, toml_value, with_comment
from anhyst_rigs.rig.file import RigFile


def rewrite_rig(rig_path: PathLike, out: PathLike, changes: Mapping[KeyPath, Any], note: str) -> None:
    """Write a rig file with changed keys, and with a note as a comment at the top.

    Relative paths are adapted to the folder of the new file.
    """
    check_writable(out, [rig_path])
    file = TomlFile(rig_path)
    text = file.text.splitlines()
    last_keys = {line: key for key, line in file.lines.items()}  # last key in each inline table
    notes = {key: split_comment(text[line - 1]) for line, key in last_keys.items()}
    head_comments = [line for line in _head_comments(text) if line.startswith("#")]
    values = {**_relocated_paths(file, Path(rig_path), Path(out)), **changes}
    for path, value in values.items():
        file.content[str(path[0])][str(path[1])] = value
    head_comments = [*(f"# {line}".rstrip() for line in [*note.splitlines(), ""] if note), *head_comments]
    with atomic_writer(out) as stream:
        stream.write("\n".join([*head_comments, *_toml_lines(file.content, notes)]) + "\n")


def _relocated_paths(file: TomlFile, rig_path: Path, out: Path) -> dict[KeyPath, Any]:
    """Return the keys that name files, with paths relative to the folder of the new file."""

    def seen(name: str) -> str:
        return relative_path(out.parent, rig_path.parent / name)

    paths: dict[KeyPath, Any] = {}
    for path in (("loops", "files"), ("loops", "sidecar"), ("control", "calibration")):
        names = file.content.get(path[0], {}).get(path[1])
        if names is not None:
            paths[path] = [seen(file_name) for file_name in names] if isinstance(names, list) else seen(names)
    return paths


def _head_comments(text: list[str]) -> Iterator[str]:
    for line in text:
        if line.strip() and not line.startswith("#"):
            return
        yield line


def _toml_lines(content: Mapping[str, Any], notes: Mapping[KeyPath, tuple[str, str]]) -> Iterator[str]:
    order = [field.alias or name for name, field in RigFile.model_fields.items()]
    keys = sorted(content, key=lambda key: order.index(key) if key in order else len(order))
    for key in keys:
        if not _is_table(content[key]):
            yield from _entry_lines((key,), content[key], notes)
    for key in keys:
        value = content[key]
        if isinstance(value, Mapping):
            yield from _table_lines(f"[{key}]", (key,), value, notes)
        elif _is_table(value):
            for number, table in enumerate(value):
                yield from _table_lines(f"[[{key}]]", (key, number), table, notes)


def _table_lines(
    title: str, path: KeyPath, table: Mapping[str, Any], notes: Mapping[KeyPath, tuple[str, str]]
) -> Iterator[str]:
    yield ""
    yield _with_note(title, notes.get(path, ("", ""))[1])
    leading_keys = [key for key in ("name", "of", "kind", "mode") if key in table]
    commented_keys = [key for key in table if (*path, key, 0) in notes]
    for key in [*leading_keys, *(key for key in table if key not in (*leading_keys, *commented_keys))]:
        yield from _entry_lines((*path, key), table[key], notes)
    for key in commented_keys:
        for number, table_row in enumerate(table[key]):
            inner_title = f"[[{title.strip('[]')}.{key}]]"
            yield from _table_lines(inner_title, (*path, key, number), table_row, notes)


def _entry_lines(path: KeyPath, value: Any, notes: Mapping[KeyPath, tuple[str, str]]) -> Iterator[str]:
    comment_above, note = notes.get(path, ("", ""))
    key = toml_key(str(path[-1]))
    if _is_table(value):
        yield _with_note(f"{key} = [", note)
        yield from (f"  {toml_value(list_item)}," for list_item in value)
        yield "]"
    else:
        is_unchanged = bool(comment_above) and tomllib.loads(f"x = {comment_above}")["x"] == value
        yield _with_note(f"{key} = {comment_above if is_unchanged else toml_value(value)}", note)


def _with_note(text: str, note: str) -> str:
    return with_comment(text, note) if note else text


def _is_table(value: Any) -> bool:
    """Whether a value is a table or a list of tables."""
    rows = value if isinstance(value, list) else [value]
    return bool(rows) and all(isinstance(list_item, Mapping) for list_item in rows)
