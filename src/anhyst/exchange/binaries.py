"""The binaries of an FMU: its sources compiled by zig for each platform, without what they do not need."""

from __future__ import annotations

import importlib.util
import subprocess
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from anhyst.compilation.toolchain import zig_cc
from anhyst.support.jobs import cores
from anhyst.support.progress import Progress


@dataclass(frozen=True)
class Platform:
    """Where a binary runs: zig's target, the folder in FMI 2.0, the ending, what it is linked with."""

    target: str
    second: str
    ending: str
    links: tuple[str, ...]


# Left to itself, zig first compiles the start-up code of Windows and a run-time library for each
# processor, a minute and more. Sources that only compute, allocate and copy need neither: functions
# of C come from the system's own library, and a library without constructors has no entry.
_LINUX = ("-Wl,-z,defs", "-lc", "-lm")
_MACOS = ("-lc",)
_WINDOWS = (
    "-Wl,--no-entry",
    *(f"-lapi-ms-win-crt-{part}-l1-1-0" for part in ("heap", "math", "private", "string")),
)

PLATFORMS = {
    "x86_64-linux": Platform("x86_64-linux-gnu.2.17", "linux64", ".so", _LINUX),
    "aarch64-linux": Platform("aarch64-linux-gnu.2.17", "aarch64-linux", ".so", _LINUX),
    "x86_64-windows": Platform("x86_64-windows-gnu", "win64", ".dll", _WINDOWS),
    "x86_64-darwin": Platform("x86_64-macos", "darwin64", ".dylib", _MACOS),
    "aarch64-darwin": Platform("aarch64-macos", "aarch64-darwin", ".dylib", _MACOS),
}
"""By the names of FMI 3.0."""
PLATFORMS_ALL = tuple(PLATFORMS)

SAME_BITS = ("-ffp-contract=off",)
"""No product fused into a sum, as the core is compiled for Python."""


def compile_all(
    sources: Path, name: str, platforms: Sequence[str], progress: Progress | None
) -> dict[str, bytes]:
    """Compile all C of a folder to a library for each platform; return the libraries by platform."""
    compiler = zig_cc("fmu")
    files = sorted(path.relative_to(sources).as_posix() for path in sources.rglob("*.c"))

    def compile_one(platform: str) -> bytes:
        one = PLATFORMS[platform]
        binary = sources.with_name(f"{platform}-{name}") / f"{name}{one.ending}"
        binary.parent.mkdir()
        options = ["-target", one.target, "-std=c99", "-O2", *SAME_BITS, "-I.", "-Iinclude"]
        if one.links is _WINDOWS:  # without its start-up code, its headers have to be named
            options += ["-isystem", str(_headers_of_windows())]
        options += ["-shared", "-fPIC", "-s", "-nostdlib", "-o", str(binary)]
        command = [*compiler, *options, *files, *one.links]
        done = subprocess.run(command, cwd=sources, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"{one.target}: {done.stderr.strip()[-500:]}")
        return binary.read_bytes()

    found = {}
    with ThreadPoolExecutor(cores()) as pool:
        jobs: dict[Future[bytes], str] = {pool.submit(compile_one, one): one for one in platforms}
        for count, ready in enumerate(as_completed(jobs), start=1):
            found[jobs[ready]] = ready.result()
            if progress is not None:
                progress(count, len(platforms))
    return {one: found[one] for one in platforms}


def _headers_of_windows() -> Path:
    """Return where zig keeps the headers of C for Windows."""
    spec = importlib.util.find_spec("ziglang")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent / "lib" / "libc" / "include" / "any-windows-any"
