"""Write files and folders atomically, and find the folders of the package.

A file, a folder or a figure appears under its name only when it is complete. The module also writes
JSON, and finds the user's cache and the C sources.
"""

from __future__ import annotations

import errno
import json
import math
import os
import shutil
import stat
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from anhyst.support.errors import InputError, wrong_type

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PathLike = str | os.PathLike[str]


def check_path(value: object, argument: str, expected_text: str = "a path") -> PathLike:
    """Return a path, or raise an error that names the argument in the form ``"verb: argument"``."""
    if not isinstance(value, str | os.PathLike):
        raise wrong_type(argument, expected_text, value)
    if not os.fspath(value):
        raise InputError(f"{argument}: the path is empty", code="wrong-type", key=argument)
    return value


_WRITE_ADVICE = {
    errno.ENOSPC: "free some space",
    errno.EDQUOT: "free some space",
    errno.EFBIG: "raise the limit on file sizes",
    errno.ENOENT: "create the folder first",
    errno.EISDIR: "name a file in it",
    errno.ENAMETOOLONG: "shorten it",
}


def write_error(path: PathLike, error: OSError) -> InputError:
    """Return the error for a file that cannot be written: the reason and the remedy in one line."""
    advice = _WRITE_ADVICE.get(error.errno or 0, "choose another place")
    return InputError(
        f"{path}: cannot be written: {error.strerror or error}; {advice}",
        code="cannot-be-written",
        key=errno.errorcode.get(error.errno or 0, ""),
    )


def read_error(path: PathLike, error: OSError) -> InputError:
    """Return the error for a file that cannot be read, in one line."""
    if isinstance(error, FileNotFoundError):
        return InputError(f"{path}: no such file; check the path", code="no-such-file")
    return InputError(f"{path}: cannot be read: {error.strerror}; check the path", code="cannot-be-read")


@contextmanager
def atomic_writer(path: PathLike, check_draft: Callable[[Path], object] | None = None) -> Iterator[IO[str]]:
    """Open a text file that appears under its name only when it is complete.

    The text is written to a temporary file in the same folder, flushed to the disk and renamed.
    After any failure, including Ctrl-C, an older file of that name is unchanged, and the temporary
    file is removed. ``check_draft`` is called with the temporary file before the renaming. A device
    or a pipe is written directly.
    """
    with _open_draft(path) as draft:
        with draft.open("w", encoding="utf-8", newline="") as stream:
            yield stream
            _flush_to_disk(stream)
        if check_draft is not None and draft.is_file():
            check_draft(draft)


def write_bytes(path: PathLike, content: bytes) -> None:
    """Write a binary file atomically, as :func:`atomic_writer` does."""
    with binary_writer(path) as stream:
        stream.write(content)


@contextmanager
def binary_writer(path: PathLike) -> Iterator[IO[bytes]]:
    """Open a binary file as :func:`atomic_writer` does, for reading as well."""
    with _open_draft(path) as draft, draft.open("w+b") as stream:
        yield stream
        _flush_to_disk(stream)


@contextmanager
def _open_draft(path: PathLike) -> Iterator[Path]:
    """Yield a temporary path, and rename it to the final path if no error occurred."""
    target = Path(os.path.realpath(path))  # write through a link
    try:
        temporary = _temporary_path(target)
        if temporary is None:
            yield target
            return
        try:
            yield temporary
            if target.exists():
                temporary.chmod(target.stat().st_mode & 0o7777)
            temporary.replace(target)
        except BaseException:
            with suppress(OSError):
                temporary.unlink()
            raise
    except OSError as error:
        raise write_error(path, error) from error


def _flush_to_disk(stream: IO[Any]) -> None:
    """Flush a stream; write a regular file to the disk, so that a full disk is noticed."""
    stream.flush()
    if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
        os.fsync(stream.fileno())


def check_writable(path: PathLike, input_files: Iterable[PathLike] = ()) -> None:
    """Raise an error if a file cannot be written. Call this before long work."""
    target = Path(os.path.realpath(path))
    if any(target == Path(os.path.realpath(source)) for source in input_files):
        raise InputError(f"{path}: is read by this command; write to another file", code="writes-over-input")
    try:
        if (temporary := _temporary_path(target)) is not None:
            temporary.open("x").close()
            temporary.unlink()
    except OSError as error:
        raise write_error(path, error) from error


def _temporary_path(target: Path) -> Path | None:
    """Return the temporary path of a file; None for a device or a pipe."""
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if target.exists() and not target.is_file():
        return None
    return target.with_name(f".{target.name}.{os.getpid()}.part")


def cache_folder(kind: str) -> Path:
    """Return the cache folder for one kind of data, below ``XDG_CACHE_HOME`` or ``~/.cache``.

    A user without a home directory has no cache: the folder is below the null device, where no file
    exists.
    """
    try:
        all_caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:
        all_caches = Path(os.devnull)
    return all_caches / "anhyst" / kind


def relative_path(folder: Path, path: Path) -> str:
    """Return the path of a file relative to a folder; links in the paths are resolved."""
    resolved_path = os.path.join(os.path.realpath(path.parent), path.name)
    return Path(os.path.relpath(resolved_path, os.path.realpath(folder))).as_posix()


def core_folder() -> Path:
    """Return the folder of the C core, with ``include/``, ``src/`` and ``port/``."""
    marker = "include/anhyst/compensator/compensator.h"
    return shipped_folder("anhyst", "core", "_core/c", marker)


def contract_folder() -> Path:
    """Return the folder of the TOML tables that C and Python share."""
    return shipped_folder("anhyst", "contract", "_contract", "block.toml")


def shipped_folder(package_name: str, repository_path: str, package_path: str, marker: str) -> Path:
    """Return a folder of the repository, or its copy in the installed package.

    ``repository_path`` is the folder in the repository, and ``package_path`` its copy inside the
    installed package ``package_name``. ``marker`` is a file that the folder must contain.
    """
    package = Path(sys.modules[package_name].__file__ or package_name).resolve().parent
    folders = [package / package_path]
    if package.parent.name == "src" and package.parents[2].name == "packages":
        folders.insert(0, package.parents[3] / repository_path)
    for folder in folders:
        if (folder / marker).exists():
            return folder
    raise InputError(
        f"{package}: the folder {package_path} is missing; install {package_name.replace('_', '-')} again",
        code="installation-incomplete",
    )


@contextmanager
def atomic_folder(out: PathLike, *, replace: bool = False) -> Iterator[Path]:
    """Yield a temporary folder; its content appears in the target only if no error occurred."""
    target = Path(os.path.realpath(out))
    if target.exists() and not target.is_dir():
        raise InputError(f"{out}: is a file; name a folder", code="is-a-file")
    replaces_folder = replace or not target.exists()
    draft = (target.parent if replaces_folder else target) / f".{target.name}.{os.getpid()}.part"
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        draft.mkdir()
        yield draft
        if replaces_folder:
            _replace_folder(draft, target)
        else:
            _move_files(draft, target)
    except OSError as error:
        if error.filename is None or str(error.filename).startswith(str(target.parent)):
            raise write_error(out, error) from error
        raise
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def write_files(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Write files into a folder, by their relative paths."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(to_bytes(content))


def check_folder_writable(out: PathLike, *, replace: bool = False) -> None:
    """Raise an error if a folder cannot be written as by `atomic_folder`. Call this before long work."""
    target = Path(os.path.realpath(out))
    try:
        if target.exists() and not target.is_dir():
            raise InputError(f"{out}: is a file; name a folder", code="is-a-file")
        folder = target if target.exists() and not replace else target.parent
        while not folder.exists():
            folder = folder.parent
        draft = folder / f".{target.name}.{os.getpid()}.part"
        draft.mkdir()
        draft.rmdir()
    except OSError as error:
        raise write_error(out, error) from error


def check_new(out: PathLike, names: Sequence[str]) -> None:
    """Raise an error if a file already exists in a folder. Call this before long work."""
    target = Path(out)
    check_folder_writable(out)
    for name in names:
        if (target / name).exists():
            raise InputError(
                f"{target / name}: is there already; remove it or name another folder", code="exists-already"
            )


def add_files(out: PathLike, texts: Mapping[str, str], copies: Mapping[str, Path]) -> None:
    """Add texts and copies of files to a folder: all or none. Existing files are not replaced."""
    check_new(out, [*texts, *{Path(name).parts[0] for name in copies}])
    with atomic_folder(out) as draft:
        write_files(draft, texts)
        for name, source in copies.items():
            (draft / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, draft / name)


def to_bytes(content: str | bytes) -> bytes:
    """Return the bytes of a file content; a text is encoded as UTF-8."""
    return content.encode() if isinstance(content, str) else content


def _replace_folder(draft: Path, target: Path) -> None:
    """Replace a folder with its temporary copy; restore the old folder if this fails."""
    old_folder = target.with_name(draft.name.removesuffix(".part") + ".old")
    if target.exists():
        target.rename(old_folder)
    try:
        draft.rename(target)
    except OSError:
        if old_folder.exists():
            old_folder.rename(target)
        raise
    shutil.rmtree(old_folder, ignore_errors=True)


def _move_files(draft: Path, target: Path) -> None:
    """Move files from a temporary folder into a folder that contains other files."""
    created_paths: list[Path] = []
    try:
        for file in sorted(path for path in draft.rglob("*") if path.is_file()):
            destination = target / file.relative_to(draft)
            for parent in reversed(destination.relative_to(target).parents[:-1]):
                if not (target / parent).exists():
                    (target / parent).mkdir()
                    created_paths.append(target / parent)
            if not destination.exists():
                created_paths.append(destination)
            file.replace(destination)
    except OSError:
        for destination in reversed(created_paths):
            if destination.is_dir():
                destination.rmdir()
            else:
                destination.unlink(missing_ok=True)
        raise


def check_picture(path: PathLike) -> None:
    """Raise an error if a picture cannot be written, because of its suffix or its folder."""
    if Path(path).suffix.lower() not in {".png", ".svg", ".pdf"}:
        raise InputError(
            f"{path}: a plot is written as .png, .svg or .pdf; change the ending", code="wrong-ending"
        )
    check_writable(path)


def write_figure(figure: Figure, path: PathLike) -> None:
    """Write a figure in the format that the suffix of the file names."""
    buffer = BytesIO()
    figure.savefig(buffer, format=Path(path).suffix[1:].lower(), dpi=150)
    write_bytes(path, buffer.getvalue())


def json_text(content: Mapping[str, Any]) -> str:
    """Return the text of a JSON file; NaN and infinity become null."""
    return json.dumps(to_json_value(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_json(path: PathLike, content: Mapping[str, Any]) -> None:
    """Write a JSON file atomically."""
    write_bytes(path, json_text(content).encode())


def to_json_value(value: Any) -> Any:
    """Convert a value to the types of JSON; NaN and infinity become None."""
    if isinstance(value, Mapping):
        return {str(key): to_json_value(item) for key, item in value.items()}
    if isinstance(value, str | Path):
        return str(value)
    if isinstance(value, Sequence):
        return [to_json_value(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
