"""Run the real command line, and check its general rules."""

from __future__ import annotations

import atexit
import json
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from .warm import as_ordinary_user

COMMAND = (sys.executable, "-m", "anhyst.cli.app")
PATIENCE = 180.0
"""Time after which a command is regarded as hanging on a busy machine, s."""

_COLOUR = ("FORCE_COLOR", "NO_COLOR", "PY_COLORS", "CLICOLOR_FORCE", "GITHUB_ACTIONS", "COLUMNS")
ENVIRONMENT = {name: value for name, value in os.environ.items() if name not in _COLOUR}
# The work here is too small for threads: starting them would take a third of the time.
ENVIRONMENT |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

Result = subprocess.CompletedProcess[str]


def anhyst(
    *arguments: object,
    cwd: Path,
    variables: Mapping[str, str] = MappingProxyType({}),
    patience: float = PATIENCE,
    **options: Any,
) -> Result:
    """Run a command in a shell-like process without standard input.

    Environment variables are added to those of the tests. After `patience` seconds, the test fails.
    """
    return subprocess.run(
        [*COMMAND, *map(str, arguments)],
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=patience,
        env={**ENVIRONMENT, **variables},
        **options,
    )


def speaking(every: float, *arguments: object, cwd: Path, stderr: int = subprocess.PIPE) -> Result:
    """Run a command that reports its progress at a given interval instead of every minute."""
    script = (
        "import sys, anhyst.cli.shared as progress; from anhyst.cli.app import main; "
        f"progress.PROGRESS_INTERVAL_S = {every}; sys.exit(main())"
    )
    return subprocess.run(
        [sys.executable, "-c", script, *map(str, arguments)],
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
        check=False,
        timeout=PATIENCE,
        env=ENVIRONMENT,
    )


def shares_said(title: str, message: str) -> list[int]:
    """Return the percentages of the progress lines."""
    return [int(share) for share in re.findall(rf"^anhyst: {title}: (\d+) %, ", message, re.MULTILINE)]


def quick(
    *arguments: object,
    cwd: Path,
    ordinary: bool = False,
    file_size: int | None = None,
    patience: float = PATIENCE,
) -> Result:
    """Run a command in a process that has already imported the package; see `warm`.

    An ordinary user obeys permissions. The size of files can be limited. After `patience` seconds,
    the command is killed.
    """
    if not hasattr(os, "fork"):
        drop = as_ordinary_user() if ordinary else None
        return anhyst(*arguments, cwd=cwd, patience=patience, preexec_fn=drop)
    server = _server()
    assert server.stdin is not None
    assert server.stdout is not None
    words = list(map(str, arguments))
    request = {
        **{"arguments": words, "cwd": str(cwd), "patience": int(patience)},
        **{"ordinary": ordinary, "file_size": file_size},
    }
    print(json.dumps(request), file=server.stdin, flush=True)
    code, printed, message = json.loads(server.stdout.readline())
    return Result(words, code, printed, message)


@cache
def _server() -> subprocess.Popen[str]:
    script = Path(__file__).with_name("warm.py")
    server = subprocess.Popen(
        [sys.executable, script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT
    )
    atexit.register(server.communicate)
    return server


def start(*arguments: object, cwd: Path) -> subprocess.Popen[str]:
    """Start a command and return while it runs."""
    return subprocess.Popen(
        [*COMMAND, *map(str, arguments)],
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )


def unwrapped(text: str) -> str:
    """Return printed sentences without the line breaks of a narrow terminal."""
    return re.sub(r"\n {4,}", " ", text)


def contents(folder: Path) -> dict[str, bytes | None]:
    """Return the content of a folder, including hidden files; None for folders and pipes."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def refused(*arguments: object, cwd: Path, ordinary: bool = False, **options: Any) -> str:
    """Run a command that must reject its input: exit code 2, one line, all files unchanged.

    With options of :func:`anhyst`, it is started as a new process, otherwise as :func:`quick` does.

    Returns
    -------
    The line after ``anhyst: error:``.
    """
    before = contents(cwd)
    if options:
        result = anhyst(*arguments, cwd=cwd, **options)
    else:
        result = quick(*arguments, cwd=cwd, ordinary=ordinary)
    message = said_in_one_line(result)
    assert contents(cwd) == before
    return message


def said_in_one_line(result: Result) -> str:
    """Check that a command ended as for bad input; return its error line."""
    lines = result.stderr.splitlines()
    assert result.returncode == 2, result
    assert result.stdout == ""
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("anhyst: error: ")
    assert lines[0].isprintable()
    return lines[0].removeprefix("anhyst: error: ")
