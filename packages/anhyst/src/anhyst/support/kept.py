"""What was computed or compiled before from the same inputs, in the user's cache.

It is found by a hash over these inputs, this machine and all that computes: the sources of the
package, its binary, the libraries underneath; an object of C by the preprocessed text, the options and
the compiler. So it is never stale, and the same as if made anew.

Results of long work in a file that grows line by line, so that a stopped run goes on later; what an
actuator is called in C.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import platform
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import lru_cache, partial
from pathlib import Path
from typing import IO, Any, Self, TypeVar

import numpy as np
import scipy
from pydantic import BaseModel

from anhyst._core import _native
from anhyst.support.atomic import (
    PathLike,
    cache_folder,
    contract_folder,
    write_bytes,
    write_error,
)
from anhyst.support.errors import InputError
from anhyst.support.jobs import cores
from anhyst.support.registry import packages_that_add

T = TypeVar("T")

MOST = 200
"""Results of a kind that are kept, of 10 to 100 kilobytes each; those not used for longest go."""

_SEAL = hashlib.sha256().digest_size


def kept(kind: str, make: Callable[[], T], *inputs: object) -> T:
    """Return what `make` makes of these inputs, from the cache where it was made before."""
    digest = hashlib.sha256(computed_with())
    _take(digest, inputs)
    path = cache_folder(kind) / digest.hexdigest()
    value: T | None = load(path)
    if value is None:
        value = make()
        with suppress(OSError, InputError):  # without a cache it is computed each time
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_bytes(path, sealed(value))
            forget(path.parent, MOST)
    return value


def sealed(value: object) -> bytes:
    """Return what is written of a value: a hash first, so that damage shows."""
    content = pickle.dumps(value)
    return hashlib.sha256(content).digest() + content


def load(file: Path) -> Any:
    """Return what is kept at a place, if it is there, undamaged and one's own; None otherwise."""
    try:
        if hasattr(os, "getuid"):
            owners = {path.stat().st_uid for path in (file, file.parent)}
            if owners != {os.getuid()}:
                return None
        content = file.read_bytes()
        os.utime(file)
        seal, content = content[:_SEAL], content[_SEAL:]
        return pickle.loads(content) if hashlib.sha256(content).digest() == seal else None
    except (OSError, MemoryError, pickle.UnpicklingError, AttributeError, ImportError, ValueError):
        return None


def forget(folder: Path, most: int) -> None:
    """Leave those things in a folder that were used last."""
    known = [path for path in folder.iterdir() if not path.name.startswith(".")]
    for old in sorted(known, key=lambda path: path.stat().st_mtime)[:-most]:
        shutil.rmtree(old, ignore_errors=True) if old.is_dir() else old.unlink(missing_ok=True)


@lru_cache(maxsize=1)
def computed_with() -> bytes:
    """Return a hash of what computes here."""
    about = f"{platform.node()} {sys.version} {np.__version__} {scipy.__version__}"
    digest = hashlib.sha256(about.encode())
    places = {Path(__file__).resolve().parents[1], contract_folder(), *packages_that_add()}
    every = (
        path for place in places for path in (place.rglob("*.*") if place.is_dir() else [place])
    )
    sources = (path for path in every if path.suffix in {".py", ".j2", ".toml"})
    for path in (Path(_native.__file__), *sorted(sources)):
        digest.update(f"\0{path}\0".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.digest()


def _take(digest: Any, value: object) -> None:
    """Let a value count: equal ones alike, whatever else was made of them before."""
    digest.update(f"\0{type(value).__qualname__}\0".encode())
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype} {value.shape}".encode() + value.tobytes())
    elif isinstance(value, Enum | str | bytes | int | float | Path | None):
        digest.update(repr(value).encode())
    elif isinstance(value, BaseModel):
        _take(digest, dict(value))
    elif is_dataclass(value):
        _take(digest, {field.name: getattr(value, field.name) for field in fields(value)})
    elif isinstance(value, Mapping):
        _take(digest, tuple(value.items()))
    elif isinstance(value, tuple | list):
        for item in value:
            _take(digest, item)
        digest.update(f"\0{len(value)}".encode())
    else:
        raise TypeError(f"{type(value).__qualname__} has no contents that could be compared")


class ResultsFile:
    """A file of JSON lines: a header that says what it belongs to, then one result a line.

    A last line that was cut off, by a full disk or a lost process, is dropped. Use it as a context.
    """

    def __init__(
        self,
        path: PathLike,
        header: Mapping[str, Any],
        key: str,
        fault: Callable[[Mapping[str, Any]], str | None],
    ) -> None:
        self.path = Path(path)
        self._key, self._fault = key, fault
        self.done: dict[int, dict[str, Any]] = {}
        if not self.path.exists():
            write_bytes(self.path, _line(header).encode())
        try:
            content = self.path.read_bytes()
            whole = content.rfind(b"\n") + 1
            self._read(content[:whole], header)
            if whole < len(content):
                os.truncate(self.path, whole)
            self._stream: IO[str] = self.path.open("a", encoding="utf-8", newline="")
        except OSError as error:
            raise write_error(self.path, error) from error

    def _read(self, content: bytes, header: Mapping[str, Any]) -> None:
        rows = content.splitlines()
        self._check(self._parse(rows[0], 1) if rows else {}, header)
        for number, row in enumerate(rows[1:], start=2):
            result = self._parse(row, number)
            wrong = self._fault(result)
            if wrong is not None:
                raise InputError(
                    f"{self.path}: line {number}: {wrong}; {_AGAIN}", code="damaged-results"
                )
            self.done[result[self._key]] = result

    def _parse(self, row: bytes, number: int) -> dict[str, Any]:
        try:
            entry = json.loads(row)
        except ValueError:
            entry = None
        if not isinstance(entry, dict):
            raise InputError(
                f"{self.path}: line {number}: cannot be read; {_OTHER}", code="damaged-results"
            )
        return entry

    def _check(self, kept_settings: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
        for name, value in settings.items():
            stored = kept_settings.get(name)
            if stored != json.loads(json.dumps(value)):
                text = f"is {_short(stored)} in the file and {_short(value)} now"
                raise InputError(
                    f"{self.path}: line 1: {name}: {text}, its results belong to something else; "
                    f"{_OTHER}",
                    code="other-results",
                    key=name,
                )

    def add(self, result: Mapping[str, Any]) -> None:
        """Append a result; it is on its way to the disk when this returns."""
        self.done[result[self._key]] = dict(result)
        try:
            self._stream.write(_line(result))
            self._stream.flush()
        except OSError as error:
            raise write_error(self.path, error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()


_OTHER = "name another file or remove this one"
_AGAIN = "remove this line, so that its work is done again, or name another file"


def _line(row: Mapping[str, Any]) -> str:
    return json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n"


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 24 else f"{text[:12]}..."


MOST_OBJECTS = 4000
"""Objects that are kept with their messages, of ten to a hundred kilobytes each."""

Run = Callable[[Sequence[str]], str]
"""Runs a compiler, refuses what it refuses, and returns what it complains about."""


def compile_and_link(
    compiler: Sequence[str],
    options: Sequence[str],
    search: Sequence[str],
    sources: Sequence[Path],
    ending: Sequence[str],
    run: Run,
) -> list[str]:
    """Compile what is not kept and link it all; return all complaints.

    `search` are macros and folders: they count by the text that they make. `ending` stands behind
    the objects, when they are linked.
    """
    program = shutil.which(compiler[0])
    if program is None or compiler[0] == sys.executable:  # zig's, which keeps objects itself
        return [run([*compiler, *options, *search, *map(str, sources), *ending])]
    about = Path(program).stat()
    identity = f"{Path(program).resolve()} {about.st_size} {about.st_mtime_ns}"
    own = [*compiler, *(option for option in options if not option.startswith("-Wl,"))]
    command, key = [*own, *search], "\0".join([identity, *own])
    with (
        tempfile.TemporaryDirectory(prefix="anhyst-") as scratch,
        ThreadPoolExecutor(cores()) as pool,
    ):
        objects = [Path(scratch, f"{number}.o") for number in range(len(sources))]
        messages = list(pool.map(partial(_compile, command, key, run), sources, objects))
        return [*messages, run([*compiler, *options, *map(str, objects), *ending])]


def _compile(command: Sequence[str], key: str, run: Run, source: Path, target: Path) -> str:
    """Compile a source or take its object from the cache; return the compiler's messages."""
    text = target.with_suffix(".i")
    run([*command, "-E", "-P", str(source), "-o", str(text)])
    digest = hashlib.sha256(key.encode() + b"\0" + text.read_bytes()).hexdigest()
    kept = cache_folder("objects") / f"{digest}.o"
    messages_at = kept.with_suffix(".txt")
    with suppress(OSError):
        messages = messages_at.read_text(encoding="utf-8")
        shutil.copyfile(kept, target)
        kept.touch()
        messages_at.touch()
        return messages
    messages = run([*command, "-c", str(source), "-o", str(target)])
    with suppress(OSError):  # without a cache it is compiled each time
        kept.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".", dir=kept.parent) as draft:
            # Each whole or not at all; the compiler's messages first.
            for place, part in ((messages_at, messages.encode()), (kept, target.read_bytes())):
                Path(draft, place.name).write_bytes(part)
                Path(draft, place.name).replace(place)
        # Looking through all of them takes longer than most compilations.
        if kept.name.startswith("00"):
            forget(kept.parent, 2 * MOST_OBJECTS)
    return messages


LONGEST = 31
UNNAMED = "actuator"

_NAME = re.compile(rf"[a-z][a-z0-9_]{{0,{LONGEST - 1}}}")


def c_name(text: str) -> str:
    """Return the nearest name that C takes, in small letters.

    >>> c_name("Magnet 3, upper"), c_name("2nd"), c_name("")
    ('magnet_3_upper', 'actuator_2nd', 'actuator')
    """
    words = re.findall(r"[a-z0-9]+", text.lower())
    if not words or words[0][0].isdigit():
        words.insert(0, UNNAMED)
    return "_".join(words)[:LONGEST].rstrip("_")


def check_name(name: str) -> None:
    """Refuse what cannot begin the names of an actuator's C."""
    if not _NAME.fullmatch(name):
        raise InputError(
            f"--name: '{name}' is no name; give up to {LONGEST} small letters, digits and "
            "underscores, a letter first",
            code="bad-name",
            key="--name",
        )
