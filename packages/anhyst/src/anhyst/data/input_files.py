"""Find the files and sidecar files that the reader of loops opens.

A folder is replaced by all data files in it, except text files that are not tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from anhyst.data.formats import FORMATS, open_table
from anhyst.data.formats.channels import is_number_or_mark
from anhyst.data.roles import MIN_LOOP_SAMPLES
from anhyst.data.sidecar import FileDescription, is_sidecar
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError


def list_input_files(paths: PathLike | Sequence[PathLike], sidecar: PathLike | None = None) -> list[Path]:
    """Return the files that `read_loops` reads for these arguments, including sidecars."""
    files = expand_folders(paths)
    if sidecar is not None:
        return [*files, Path(sidecar)]
    sidecars = [path.with_suffix(".toml") for path in files if path.suffix != ".toml"]
    return files + [path for path in sidecars if is_sidecar(path)]


def _as_path_list(paths: PathLike | Sequence[PathLike]) -> list[Path]:
    path_list = [paths] if not isinstance(paths, Sequence) or isinstance(paths, str) else list(paths)
    return list(map(Path, path_list))


def expand_folders(paths: PathLike | Sequence[PathLike]) -> list[Path]:
    """Return files, with each folder replaced by the tables in it."""
    files: list[Path] = []
    for path in _as_path_list(paths):
        if path.is_dir():
            data_files = [file for file in _data_files_in(path) if _may_be_table(file)]
            if not data_files:
                raise InputError(
                    f"{path}: this folder contains no {', '.join(FORMATS)} file", code="no-files"
                )
            files += data_files
        else:
            files.append(path)
    if not files:
        raise InputError("no files given: name at least one", code="no-files")
    return files


def _data_files_in(folder: Path) -> list[Path]:
    return sorted(file for file in folder.iterdir() if file.suffix.lower() in FORMATS)


def _may_be_table(path: Path) -> bool:
    """Whether a file in a folder can be a table: false for texts such as readme.txt."""
    if path.suffix.lower() != ".txt":
        return True
    try:
        rows = open_table(path).first_rows(MIN_LOOP_SAMPLES)
    except InputError as error:
        return error.code not in {"single-column", "no-table", "no-data", "empty-file"}
    return any(is_number_or_mark(field) for row in rows for field in row)


def note_skipped_files(paths: PathLike | Sequence[PathLike], files: Sequence[Path]) -> tuple[str, ...]:
    """Return notes about text files in folders that are not tables."""
    folders = [path for path in _as_path_list(paths) if path.is_dir()]
    texts = [file for folder in folders for file in _data_files_in(folder) if file not in files]
    return tuple(f"{text}: is left out, because it contains no table" for text in texts)


def find_sidecar(path: Path) -> FileDescription:
    """Return the description in the sidecar of a file; empty without a sidecar."""
    sidecar = path.with_suffix(".toml")
    has_sidecar = sidecar != path and is_sidecar(sidecar)
    return FileDescription.from_toml(sidecar) if has_sidecar else FileDescription()
