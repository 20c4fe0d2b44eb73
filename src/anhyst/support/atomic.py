"""Files that are written whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from anhyst.support.errors import InputError

PathLike = str | os.PathLike[str]

_ADVICE = {
    errno.ENOSPC: "make room",
    errno.EDQUOT: "make room",
    errno.EFBIG: "raise the limit on file sizes",
    errno.ENOENT: "create the folder first",
    errno.EISDIR: "name a file in it",
    errno.ENAMETOOLONG: "shorten it",
}


def write_error(path: PathLike, error: OSError) -> InputError:
    """Say why a file could not be written and what to do, in one line."""
    advice = _ADVICE.get(error.errno or 0, "choose another place")
    return InputError(
        f"{path}: cannot be written: {error.strerror or error}; {advice}",
        code="cannot-be-written",
        key=errno.errorcode.get(error.errno or 0, ""),
    )


@contextmanager
def atomic_writer(
    path: PathLike, check: Callable[[Path], object] | None = None
) -> Iterator[IO[str]]:
    """Open a file that appears under its name only when it is complete.

    It is written beside its place under a temporary name, flushed to the disk and renamed. After
    any failure, ctrl-C included, what stood there before still stands there, and nothing else. A
    device or a pipe is written directly.
    """
    with _draft(path) as draft:
        with draft.open("w", encoding="utf-8", newline="") as stream:
            yield stream
            _to_disk(stream)
        if check is not None and draft.is_file():
            check(draft)


def write_bytes(path: PathLike, content: bytes) -> None:
    """Write a binary file, such as a picture, whole or not at all; as :func:`atomic_writer`."""
    with binary_writer(path) as stream:
        stream.write(content)


@contextmanager
def binary_writer(path: PathLike) -> Iterator[IO[bytes]]:
    """Open a binary file as :func:`atomic_writer`; it can be read too, to write headers last."""
    with _draft(path) as draft, draft.open("w+b") as stream:
        yield stream
        _to_disk(stream)


@contextmanager
def _draft(path: PathLike) -> Iterator[Path]:
    """Give the place to write to now, and put what was written where it belongs."""
    target = Path(os.path.realpath(path))  # a link keeps pointing where it points
    try:
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if target.exists() and not target.is_file():
            yield target
            return
        beside = _beside(target)
        try:
            yield beside
            if target.exists():
                beside.chmod(target.stat().st_mode & 0o7777)
            beside.replace(target)
        except BaseException:
            with suppress(OSError):
                beside.unlink()
            raise
    except OSError as error:
        raise write_error(path, error) from error


def _to_disk(stream: IO[Any]) -> None:
    """Have the disk itself say whether there was room; a device or a pipe cannot."""
    stream.flush()
    if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
        os.fsync(stream.fileno())


def check_writable(path: PathLike, reads: Iterable[PathLike] = ()) -> None:
    """Find out before long work whether a file can be written."""
    target = Path(os.path.realpath(path))
    if any(target == Path(os.path.realpath(source)) for source in reads):
        raise InputError(
            f"{path}: is read by this command; write to another file", code="writes-over-input"
        )
    try:
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if target.exists() and not target.is_file():
            return
        beside = _beside(target)
        beside.open("x").close()
        beside.unlink()
    except OSError as error:
        raise write_error(path, error) from error


def _beside(target: Path) -> Path:
    return target.with_name(f".{target.name}.{os.getpid()}.part")
