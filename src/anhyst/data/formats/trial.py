"""A first reading in a process of its own: damaged files crash, hang and fill libraries in C.

The process has bounds on memory and on processor time. What it can read is then read here; what it
refuses is refused with its words.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path

from anhyst.data.formats.channel_table import ChannelTable
from anhyst.data.formats.channels import OpenTable
from anhyst.support.errors import InputError

SECONDS = 30.0
"""Of processor time, and one more for each 4 MB: reading takes a hundredth of that."""
_MEMORY = 4 << 30
"""Bytes of addresses, and twice the file; libraries reserve some that they never use."""
_REFUSED, _FULL = 2, 4
_ADVICE = "the file is damaged or made to do so: export it again"


class _Here:
    """Whether this process is the one that tries."""

    tries = False


def try_first(path: Path, opener: Callable[[Path, int], OpenTable]) -> None:
    """Read a file once in a process of its own; the same file is not tried twice.

    The opener is a function of a module: the process imports it by its name.
    """
    if _Here.tries or not path.is_file():
        return
    about = path.stat()
    name = f"{opener.__module__}:{opener.__name__}"
    if (refusal := _tried(path, name, about.st_mtime_ns, about.st_size, SECONDS)) is not None:
        text, code, key = refusal
        raise InputError(text, code=code, key=key)


@cache
def _tried(
    path: Path, opener: str, _changed: int, size: int, seconds: float
) -> tuple[str, str, str] | None:
    """Return why a file is refused: the text, code and key of the error."""
    limit = seconds + size / 4e6
    script = "from anhyst.data.formats.trial import read_here; read_here()"
    command = [sys.executable, "-P", "-c", script, str(path), opener, str(limit)]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
            # A machine may be busy: it is processor time that counts, and this where it cannot.
            timeout=20.0 * limit,
            check=False,
        )
    except subprocess.TimeoutExpired:
        done = None
    if done is not None and done.returncode == 0:
        return None
    if done is not None and done.returncode == _REFUSED:
        text, code, key = json.loads(done.stdout)
        return text, code, key
    if done is not None and done.returncode == _FULL:
        return f"{path}: needs more than {_MEMORY >> 30} GiB to be read; {_ADVICE}", "too-large", ""
    return f"{path}: crashes or hangs what reads it; {_ADVICE}", "reader-ended", ""


def read_here() -> None:
    """Read the file that the command line names, within bounds, and end with what came of it."""
    path, opener, seconds = Path(sys.argv[1]), sys.argv[2], float(sys.argv[3])
    stay_in_bounds(seconds, path.stat().st_size)
    pipe = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries print what they do not understand
    # Without the end of an interpreter, in which what a library left behind may crash.
    code, text = _read(path, opener)
    os.write(pipe, text.encode())
    os._exit(code)


def stay_in_bounds(seconds: float, size: int) -> None:
    """Try files in this process from now on: so much processor time, memory for a file's size."""
    _Here.tries = True
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        memory = _MEMORY + 2 * size
        for what, limit in (
            (resource.RLIMIT_CORE, 0),
            (resource.RLIMIT_CPU, int(time.process_time() + seconds) + 1),
            (resource.RLIMIT_AS, memory),
        ):
            resource.setrlimit(what, (limit, resource.getrlimit(what)[1]))


def _read(path: Path, opener: str) -> tuple[int, str]:
    module, _, name = opener.partition(":")
    try:
        table = getattr(import_module(module), name)(path, 1)
        if isinstance(table, ChannelTable):
            for channel in [*table.clocks, *table.file.channels]:
                table.file.read([channel])
        gc.collect()  # where a library has written beyond what is its own, this finds it
    except MemoryError:
        return _FULL, ""
    except InputError as error:
        return _REFUSED, json.dumps([str(error), error.code, error.key])
    except Exception:
        return 0, ""  # a fault of this package, to be seen where it is used
    return 0, ""
