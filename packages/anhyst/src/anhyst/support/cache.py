"""Cache of computed results and compiled C objects, in the user's cache folder.

The key of a result is a hash of its inputs, this machine and all code that computes: the sources of
the package, its binary, and the libraries. The key of a C object is a hash of the preprocessed
text, the options and the compiler. Therefore, a cached result is never stale, and equals a new one.

The module also writes the results of long work to a file line by line, so that a stopped run can
continue, and makes C identifiers from names.
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
from anhyst.support.atomic import PathLike, cache_folder, contract_folder, write_bytes, write_error
from anhyst.support.errors import InputError
from anhyst.support.jobs import core_count
from anhyst.support.registry import plugin_paths

T = TypeVar("T")

MAX_CACHED_RESULTS = 200
"""Maximum number of cached results of a kind, 10 to 100 kB each. The least recently used are
removed."""

_DIGEST_BYTES = hashlib.sha256().digest_size


def cached_result(kind: str, compute: Callable[[], T], *inputs: object) -> T:
    """Return the result of `compute` for these inputs, from the cache if possible."""
    digest = hashlib.sha256(code_digest())
    _update_digest(digest, inputs)
    path = cache_folder(kind) / digest.hexdigest()
    value: T | None = load_cached(path)
    if value is None:
        value = compute()
        with suppress(OSError, InputError):  # without a cache, the result is computed each time
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_bytes(path, pickle_with_digest(value))
            remove_oldest(path.parent, MAX_CACHED_RESULTS)
    return value


def pickle_with_digest(value: object) -> bytes:
    """Return a pickled value after its SHA-256 digest, which reveals damage."""
    content = pickle.dumps(value)
    return hashlib.sha256(content).digest() + content


def load_cached(file: Path) -> Any:
    """Return a cached value; None if it is missing, damaged, or owned by another user."""
    try:
        if hasattr(os, "getuid"):
            owners = {path.stat().st_uid for path in (file, file.parent)}
            if owners != {os.getuid()}:
                return None
        content = file.read_bytes()
        os.utime(file)
        stored_digest, content = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
        return pickle.loads(content) if hashlib.sha256(content).digest() == stored_digest else None
    except (OSError, MemoryError, pickle.UnpicklingError, AttributeError, ImportError, ValueError):
        return None


def remove_oldest(folder: Path, max_entries: int) -> None:
    """Remove all entries of a folder except the most recently used ones."""
    cached_paths = [path for path in folder.iterdir() if not path.name.startswith(".")]
    for old_path in sorted(cached_paths, key=lambda path: path.stat().st_mtime)[:-max_entries]:
        shutil.rmtree(old_path, ignore_errors=True) if old_path.is_dir() else old_path.unlink(missing_ok=True)


@lru_cache(maxsize=1)
def code_digest() -> bytes:
    """Return a hash of this machine and of all code that computes results."""
    versions = f"{platform.node()} {sys.version} {np.__version__} {scipy.__version__}"
    digest = hashlib.sha256(versions.encode())
    roots = {Path(__file__).resolve().parents[1], contract_folder(), *plugin_paths()}
    files = (path for root in roots for path in (root.rglob("*.*") if root.is_dir() else [root]))
    sources = (path for path in files if path.suffix in {".py", ".j2", ".toml"})
    for path in (Path(_native.__file__), *sorted(sources)):
        digest.update(f"\0{path}\0".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.digest()


def _update_digest(digest: Any, value: object) -> None:
    """Add the type and the content of a value to a digest. Equal values give equal digests."""
    digest.update(f"\0{type(value).__qualname__}\0".encode())
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype} {value.shape}".encode() + value.tobytes())
    elif isinstance(value, Enum | str | bytes | int | float | Path | None):
        digest.update(repr(value).encode())
    elif isinstance(value, BaseModel):
        _update_digest(digest, dict(value))
    elif is_dataclass(value):
        _update_digest(digest, {field.name: getattr(value, field.name) for field in fields(value)})
    elif isinstance(value, Mapping):
        _update_digest(digest, tuple(value.items()))
    elif isinstance(value, tuple | list):
        for item in value:
            _update_digest(digest, item)
        digest.update(f"\0{len(value)}".encode())
    else:
        raise TypeError(f"{type(value).__qualname__} has no contents that could be compared")


class ResultsFile:
    """A file of JSON lines: a header with the settings, then one result per line.

    An incomplete last line, which a full disk or a killed process leaves, is removed. Use it as a
    context manager, unless it is read only.
    """

    def __init__(
        self,
        path: PathLike,
        header: Mapping[str, Any],
        key: str,
        find_fault: Callable[[Mapping[str, Any]], str | None],
        *,
        is_read_only: bool = False,
    ) -> None:
        self.path, self._header = Path(path), header
        self._key, self._find_fault = key, find_fault
        self.done: dict[int, dict[str, Any]] = {}
        if not is_read_only and not self.path.exists():
            write_bytes(self.path, _json_line(header).encode())
        try:
            content = self.path.read_bytes()
            complete_bytes = content.rfind(b"\n") + 1
            self._read_results(content[:complete_bytes], header)
            if is_read_only:
                return
            if complete_bytes < len(content):
                os.truncate(self.path, complete_bytes)
            self._stream: IO[str] = self.path.open("a", encoding="utf-8", newline="")
        except OSError as error:
            raise write_error(self.path, error) from error

    def _read_results(self, content: bytes, header: Mapping[str, Any]) -> None:
        rows = content.splitlines()
        self._check_header(self._parse_line(rows[0], 1) if rows else {}, header)
        for number, row in enumerate(rows[1:], start=2):
            result = self._parse_line(row, number)
            fault = self._find_fault(result)
            if fault is None and result[self._key] in self.done:
                fault = f"{self._key}: {result[self._key]} is there twice"
            if fault is not None:
                raise InputError(
                    f"{self.path}: line {number}: {fault}; {_REMOVE_LINE_ADVICE}", code="damaged-results"
                )
            self.done[result[self._key]] = result

    def _parse_line(self, row: bytes, number: int) -> dict[str, Any]:
        try:
            parsed = json.loads(row)
        except ValueError:
            parsed = None
        if not isinstance(parsed, dict):
            raise InputError(
                f"{self.path}: line {number}: cannot be read; {_OTHER_FILE_ADVICE}", code="damaged-results"
            )
        return parsed

    def _check_header(self, stored_settings: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
        for name, value in settings.items():
            stored_value = stored_settings.get(name)
            if stored_value != json.loads(json.dumps(value)):
                text = f"is {_shorten_value(stored_value)} in the file and {_shorten_value(value)} now"
                raise InputError(
                    f"{self.path}: line 1: {name}: {text}, so that its results belong to another run; "
                    f"{_OTHER_FILE_ADVICE}",
                    code="other-results",
                    key=name,
                )

    def add(self, result: Mapping[str, Any]) -> None:
        """Append a result. When this method returns, the operating system has it."""
        self.done[result[self._key]] = dict(result)
        try:
            self._stream.write(_json_line(result))
            self._stream.flush()
        except OSError as error:
            raise write_error(self.path, error) from error

    def sort(self) -> None:
        """Rewrite the file in the order of the keys, which does not depend on the order of the work."""
        self._stream.close()
        rows = [self._header, *(self.done[number] for number in sorted(self.done))]
        write_bytes(self.path, "".join(map(_json_line, rows)).encode())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()


_OTHER_FILE_ADVICE = "name another file or remove this one"
_REMOVE_LINE_ADVICE = "remove this line, so that its work is done again, or name another file"


def _json_line(row: Mapping[str, Any]) -> str:
    return json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n"


def _shorten_value(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 24 else f"{text[:12]}..."


MAX_CACHED_OBJECTS = 4000
"""Maximum number of cached C objects with their messages, 10 to 100 kB each."""

RunCompiler = Callable[[Sequence[str]], str]
"""Function that runs a compiler, raises an error if it fails, and returns its warnings."""


def compile_and_link(
    compiler: Sequence[str],
    options: Sequence[str],
    include_options: Sequence[str],
    sources: Sequence[Path],
    link_options: Sequence[str],
    run: RunCompiler,
) -> list[str]:
    """Compile the sources whose objects are not cached, and link all; return all warnings.

    `include_options` are macros and folders. They enter the key of the cache only through the
    preprocessed text. `link_options` follow the objects on the command line of the linker.
    """
    program = shutil.which(compiler[0])
    if program is None or compiler[0] == sys.executable:  # zig, which has its own cache
        return [run([*compiler, *options, *include_options, *map(str, sources), *link_options])]
    program_stat = Path(program).stat()
    identity = f"{Path(program).resolve()} {program_stat.st_size} {program_stat.st_mtime_ns}"
    compile_command = [*compiler, *(option for option in options if not option.startswith("-Wl,"))]
    command, key = [*compile_command, *include_options], "\0".join([identity, *compile_command])
    with tempfile.TemporaryDirectory(prefix="anhyst-") as folder, ThreadPoolExecutor(core_count()) as pool:
        objects = [Path(folder, f"{number}.o") for number in range(len(sources))]
        messages = list(pool.map(partial(_compile_source, command, key, run), sources, objects))
        return [*messages, run([*compiler, *options, *map(str, objects), *link_options])]


def _compile_source(command: Sequence[str], key: str, run: RunCompiler, source: Path, target: Path) -> str:
    """Compile a source, or take its object from the cache; return the warnings of the compiler."""
    preprocessed = target.with_suffix(".i")
    run([*command, "-E", "-P", str(source), "-o", str(preprocessed)])
    digest = hashlib.sha256(key.encode() + b"\0" + preprocessed.read_bytes()).hexdigest()
    cached_object = cache_folder("objects") / f"{digest}.o"
    messages_path = cached_object.with_suffix(".txt")
    with suppress(OSError):
        messages = messages_path.read_text(encoding="utf-8")
        shutil.copyfile(cached_object, target)
        cached_object.touch()
        messages_path.touch()
        return messages
    messages = run([*command, "-c", str(source), "-o", str(target)])
    with suppress(OSError):  # without a cache, the object is compiled each time
        cached_object.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".", dir=cached_object.parent) as draft:
            # Each file is written atomically. The messages come first, because they are read first.
            for destination, content in (
                (messages_path, messages.encode()),
                (cached_object, target.read_bytes()),
            ):
                Path(draft, destination.name).write_bytes(content)
                Path(draft, destination.name).replace(destination)
        # Only one in 256 compilations cleans up, because listing the folder is slow.
        if cached_object.name.startswith("00"):
            remove_oldest(cached_object.parent, 2 * MAX_CACHED_OBJECTS)
    return messages


MAX_NAME_LETTERS = 31
DEFAULT_NAME = "actuator"

_NAME_PATTERN = re.compile(rf"[a-z][a-z0-9_]{{0,{MAX_NAME_LETTERS - 1}}}")


def c_name(text: str) -> str:
    """Return the nearest C identifier of a text, in lower case.

    >>> c_name("Magnet 3, upper"), c_name("2nd"), c_name("")
    ('magnet_3_upper', 'actuator_2nd', 'actuator')
    """
    words = re.findall(r"[a-z0-9]+", text.lower())
    if not words or words[0][0].isdigit():
        words.insert(0, DEFAULT_NAME)
    return "_".join(words)[:MAX_NAME_LETTERS].rstrip("_")


def check_c_name(name: str) -> None:
    """Raise an error if a text cannot be the prefix of C identifiers."""
    if not _NAME_PATTERN.fullmatch(name):
        raise InputError(
            f"--name: '{name}' is not a valid name; give up to {MAX_NAME_LETTERS} lower-case letters, digits "
            "and underscores, with a letter first",
            code="bad-name",
            key="--name",
        )
