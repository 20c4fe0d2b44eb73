"""What was computed before from the same inputs, in the user's cache.

It is found by a hash over these inputs, this machine and all that computes: the sources of the
package, its binary, the libraries underneath. So it is never stale, and the same as if computed anew.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import shutil
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import scipy
from pydantic import BaseModel

from anhyst._core import _native
from anhyst.support.atomic import write_bytes
from anhyst.support.errors import InputError
from anhyst.support.folder import cache_folder

T = TypeVar("T")

MOST = 200
"""Results of a kind that are kept, of 10 to 100 kilobytes each; those not used for longest go."""

_SEAL = hashlib.sha256().digest_size


def kept(kind: str, make: Callable[[], T], *inputs: object) -> T:
    """Return what `make` makes of these inputs, from the cache where it was made before."""
    digest = hashlib.sha256(computed_with())
    _take(digest, inputs)
    path = cache_folder(kind) / digest.hexdigest()
    found: T | None = load(path)
    if found is None:
        found = make()
        with suppress(OSError, InputError):  # without a cache it is computed each time
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_bytes(path, sealed(found))
            forget(path.parent, MOST)
    return found


def sealed(value: object) -> bytes:
    """Return what is written of a value: a hash first, so that damage shows."""
    content = pickle.dumps(value)
    return hashlib.sha256(content).digest() + content


def load(place: Path) -> Any:
    """Return what is kept at a place, if it is there, undamaged and one's own; None otherwise."""
    try:
        if hasattr(os, "getuid"):
            owners = {path.stat().st_uid for path in (place, place.parent)}
            if owners != {os.getuid()}:
                return None
        content = place.read_bytes()
        os.utime(place)
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
    package = Path(__file__).resolve().parents[1]
    sources = (path for path in package.rglob("*.*") if path.suffix in {".py", ".j2", ".toml"})
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
