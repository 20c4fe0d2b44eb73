"""Objects of C files, kept in the user's cache: what was compiled before is only linked.

What is kept is found by a hash over the preprocessed text, the options and the compiler, so it is
never stale.

What an actuator is called in C.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path

from anhyst.support.atomic import cache_folder
from anhyst.support.errors import InputError
from anhyst.support.jobs import cores

MOST = 4000
"""Objects that are kept, of ten to a hundred kilobytes each; those not used for longest go."""

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
    identity = _identity(compiler[0])
    if identity is None:
        return [run([*compiler, *options, *search, *map(str, sources), *ending])]
    own = [*compiler, *(option for option in options if not option.startswith("-Wl,"))]
    command, key = [*own, *search], "\0".join([identity, *own])
    with (
        tempfile.TemporaryDirectory(prefix="anhyst-") as scratch,
        ThreadPoolExecutor(cores()) as pool,
    ):
        objects = [Path(scratch, f"{number}.o") for number in range(len(sources))]
        messages = list(pool.map(partial(_compile, command, key, run), sources, objects))
        return [*messages, run([*compiler, *options, *map(str, objects), *ending])]


def _identity(compiler: str) -> str | None:
    """Return what tells a compiler from others; None for zig's, which keeps objects itself."""
    program = None if compiler == sys.executable else shutil.which(compiler)
    if program is None:
        return None
    about = Path(program).stat()
    return f"{Path(program).resolve()} {about.st_size} {about.st_mtime_ns}"


def _compile(command: Sequence[str], key: str, run: Run, source: Path, target: Path) -> str:
    """Compile a source or take its object from the cache; return the compiler's messages."""
    text = target.with_suffix(".i")
    run([*command, "-E", "-P", str(source), "-o", str(text)])
    digest = hashlib.sha256(key.encode() + b"\0" + text.read_bytes()).hexdigest()
    kept = cache_folder("objects") / f"{digest}.o"
    with suppress(OSError):
        messages = kept.with_suffix(".txt").read_text(encoding="utf-8")
        shutil.copyfile(kept, target)
        kept.touch()
        return messages
    messages = run([*command, "-c", str(source), "-o", str(target)])
    with suppress(OSError):  # without a cache it is compiled each time
        _keep(kept, target.read_bytes(), messages)
    return messages


def _keep(kept: Path, content: bytes, messages: str) -> None:
    """Put an object into the cache, whole or not at all; the compiler's messages first."""
    kept.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".", dir=kept.parent) as draft:
        for target, part in ((kept.with_suffix(".txt"), messages.encode()), (kept, content)):
            Path(draft, target.name).write_bytes(part)
            Path(draft, target.name).replace(target)
    # Looking through all of them takes longer than most compilations.
    if kept.name.startswith("00"):
        for old in sorted(kept.parent.glob("*.o"), key=lambda path: path.stat().st_mtime)[:-MOST]:
            old.unlink(missing_ok=True)
            old.with_suffix(".txt").unlink(missing_ok=True)


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
