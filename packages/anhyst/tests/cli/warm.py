"""Run commands in child processes that need not import the package first.

As a script, this module imports the package once. For each line ``{"arguments": [...], "cwd":
"...", ...}`` on its standard input, it forks. The child becomes the command, with its own standard
streams and exit code. The answer is a line with the exit code and the content of both streams.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import importlib.util
import json
import os
import signal
import sys
import tempfile
from collections.abc import Callable
from typing import IO, Any


def serve() -> None:
    """Answer requests until there are no more."""
    load()
    for line in sys.stdin:
        request = json.loads(line)
        print(json.dumps(run(request)), flush=True)


def load() -> None:
    """Import the modules of the commands, and exclude them from garbage collection."""
    names = [
        *("anhyst.cli.app", "anhyst.data.inspection", "anhyst.model.diff", "anhyst.identification"),
        *("anhyst.reports.page", "anhyst.model.predict_file", "anhyst.compilation"),
        *("anhyst.verification", "scipy.interpolate", "scipy.ndimage", "scipy.signal"),
        "matplotlib.backends.backend_agg",
    ]
    if importlib.util.find_spec("anhyst_rigs"):
        names += ["anhyst_rigs.reports.studies", "anhyst_rigs.study.bearing.simulate"]
        names += ["anhyst_rigs.draft.bearing"]
    for name in names:
        importlib.import_module(name)
    app = importlib.import_module("anhyst.cli.app")
    app.build_command(app.app)
    gc.collect()
    gc.freeze()


def run(request: dict[str, Any]) -> tuple[int, str, str]:
    """Run one command; return its exit code and the content of both streams."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if child == 0:
            limit(request)
            become(request["arguments"], request["cwd"], out, err)
        _, status = os.waitpid(child, 0)
        printed, message = (
            os.pread(stream.fileno(), os.fstat(stream.fileno()).st_size, 0).decode() for stream in (out, err)
        )
    return os.waitstatus_to_exitcode(status), printed, message


def limit(request: dict[str, Any]) -> None:
    """Apply the limits of a request to this process."""
    signal.alarm(request["patience"])
    if request["file_size"] is not None:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (request["file_size"],) * 2)
    drop = as_ordinary_user() if request["ordinary"] else None
    if drop is not None:
        drop()


def as_ordinary_user() -> Callable[[], None] | None:
    """Return a function that drops root's right to ignore permissions; None if not run as root."""
    if sys.platform != "linux" or os.geteuid() != 0:
        return None
    libc = ctypes.CDLL(None)

    def drop() -> None:
        header, held = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
        libc.capget(header, held)
        for capability in (1, 2):  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
            libc.prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP, for executed programs
            for place in (0, 1):  # effective, permitted
                held[place] &= ~(1 << capability)
        libc.capset(header, held)

    return drop


def become(arguments: list[str], cwd: str, out: IO[bytes], err: IO[bytes]) -> None:
    """Turn this process into a command; does not return."""
    from anhyst.cli.app import main

    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(out.fileno(), 1)
    os.dup2(err.fileno(), 2)
    os.chdir(cwd)
    sys.argv = ["anhyst", *arguments]
    code = main()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code)  # without the slow clean-up of all imported modules


if __name__ == "__main__":
    serve()
