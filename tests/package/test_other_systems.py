"""Test anhyst without features that only Linux has, by imitating Windows and macOS on Linux.

All other packages are imported first, unchanged. Then the test removes the features that the
imitated system lacks, and it imports and uses anhyst.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from anhyst_rigs.link.firmware import build
from tests.cli.command import anhyst
from tests.link.handmade import write_parameters
from tests.repository import ROOT
from tools.wheel import run

LOOPS = ROOT / "examples" / "electromagnet" / "loops.csv"

POSIX_ONLY = """
fchmod fchown fork forkpty getegid geteuid getgid getloadavg getpgid getpriority getuid
killpg lockf mkfifo nice openpty posix_spawn pread preadv pwrite pwritev setsid ttyname
uname wait3 wait4
""".split()  # noqa: SIM905
LINUX_ONLY = [
    "sched_getaffinity",
    "sched_setaffinity",
    "sched_setscheduler",
    "SCHED_RR",
    "SCHED_RESET_ON_FORK",
    "memfd_create",
    "sendfile",
]
SYSTEMS = {
    "win32": (["fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"], [*POSIX_ONLY, *LINUX_ONLY]),
    "darwin": ([], LINUX_ONLY),
}

LIBRARIES = """
import asyncio, concurrent.futures.process, importlib, multiprocessing, os, pkgutil, socket, sys
import subprocess, cmaes, jinja2, matplotlib.pyplot, numpy, pydantic, rich.console, rich.progress
import rich.table, scipy.interpolate, scipy.io, scipy.linalg, scipy.optimize, scipy.signal
import scipy.stats, typer
"""

OPTIONAL = """
import asammdf, capstone, control, distributed, elftools.elf.elffile, h5py, nptdms, orjson, pandas
import pyarrow.parquet, python_calamine, serial, starlette.applications, starlette.staticfiles
import starlette.websockets, unicorn, uvicorn, websockets
"""

PLAY = """
assert not any(name.startswith("anhyst") for name in sys.modules)
for name in {modules!r}:
    sys.modules[name] = None
for name in {functions!r}:
    if hasattr(os, name):
        delattr(os, name)
sys.platform = {platform!r}

import anhyst
"""

IMPORT_ALL = """
import anhyst_exchange
import anhyst_rigs
for part in (anhyst, anhyst_rigs, anhyst_exchange):
    print(part.__name__)
    for one in pkgutil.walk_packages(part.__path__, part.__name__ + "."):
        importlib.import_module(one.name)
        print(one.name)
"""

USE = """
from anhyst.cli.app import main
for words in {commands!r}:
    code = main(words)
    assert code == 0, (words, code)
"""

REFUSED = """
from pathlib import Path
from anhyst_rigs.link.firmware import check_compiler
from anhyst_rigs.link.virtual_boards import HOST_LINK, find_qemu
from anhyst.support.errors import InputError

print(HOST_LINK)
for what in (find_qemu, lambda: check_compiler("host")):
    try:
        what()
    except InputError as error:
        print(error)
"""


def played(platform: str, script: str, cwd: Path, libraries: str = LIBRARIES) -> str:
    """Run a script on an imitated system; return its output."""
    modules, functions = SYSTEMS[platform]
    play = PLAY.format(modules=modules, functions=functions, platform=platform)
    completed = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", libraries + play + script],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )
    assert completed.returncode == 0, completed.stdout[-1000:] + completed.stderr[-3000:]
    return completed.stdout


@pytest.mark.slow
@pytest.mark.parametrize("platform", ["win32", pytest.param("darwin", marks=pytest.mark.campaign)])
def test_every_module_is_imported_on_another_system(platform: str, tmp_path: Path) -> None:
    found = played(platform, IMPORT_ALL, tmp_path, LIBRARIES + OPTIONAL).split()
    sources = (ROOT / "packages").glob("*/src/**/*.py")
    own = (path.relative_to(ROOT / "packages").parts[2:] for path in sources)
    modules = {".".join(one).removesuffix(".py").removesuffix(".__init__") for one in own}
    assert len(modules) > 300
    assert {*found} >= modules


@pytest.mark.slow
@pytest.mark.parametrize("platform", ["win32", pytest.param("darwin", marks=pytest.mark.campaign)])
def test_loops_become_a_model_and_c_on_another_system(platform: str, tmp_path: Path) -> None:
    (tmp_path / "demand.csv").write_text("F_N,gap_mm\n10,0.4\n80,0.4\n10,0.4\n")
    commands = [
        ["inspect", str(LOOPS)],
        ["identify", str(LOOPS), "--law", "effective-field", "--out", "model.toml"],
        ["invert", "model.toml", "demand.csv", "--history", "demagnetised", "--out", "current.csv"],
        ["compile", "model.toml", "--rate", "10000", "--out", "controller"],
    ]
    played(platform, USE.format(commands=commands), tmp_path)
    assert (tmp_path / "current.csv").stat().st_size > 0
    assert (tmp_path / "controller" / "DROP_IN.md").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("code_page", ["ascii", "cp1252"])
def test_characters_missing_in_a_code_page_stop_no_command(code_page: str, tmp_path: Path) -> None:
    variables = {"PYTHONIOENCODING": code_page, "PYTHONUTF8": "0"}
    completed = anhyst("inspect", LOOPS, cwd=tmp_path, variables=variables, encoding=code_page)
    assert (completed.returncode, completed.stderr) == (0, "")
    assert "16 loops" in completed.stdout


@pytest.mark.slow
def test_boards_that_windows_cannot_run_are_refused(tmp_path: Path) -> None:
    _, emulated, process = played("win32", REFUSED, tmp_path).splitlines()
    assert emulated.startswith("board qemu-mps2: runs on Linux and macOS, not on Windows; ")
    assert process.startswith("board host: runs on Linux and macOS, not on Windows; ")


@pytest.mark.slow
def test_the_firmware_is_reached_without_a_pseudo_terminal_on_macos(tmp_path: Path) -> None:
    assert played("darwin", REFUSED, tmp_path).split()[0] == "tcp:0"


@pytest.mark.slow
@pytest.mark.parametrize(
    "target", [pytest.param("x86_64-macos", marks=pytest.mark.campaign), "aarch64-macos"]
)
def test_the_firmware_compiles_for_macos(
    target: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler = tmp_path / "cc"
    compiler.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ziglang cc -target {target} "$@"\n')
    compiler.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    program = build("host", write_parameters(tmp_path / "compiled", 4000.0), tmp_path / "firmware")
    assert program.read_bytes()[:4] == b"\xcf\xfa\xed\xfe"


@pytest.mark.slow
@pytest.mark.depends("CMakeLists.txt", "core", "plant", "tools/wheel.py")
@pytest.mark.parametrize(
    ("target", "processor"), [("x86_64-windows-gnu", "AMD64"), ("aarch64-macos", "arm64")]
)
def test_core_and_plant_compile_without_a_warning_for(target: str, processor: str, tmp_path: Path) -> None:
    tools = Path(sys.executable).parent
    given = {
        "CMAKE_MAKE_PROGRAM": tools / "ninja",
        "CMAKE_SYSTEM_NAME": "Generic",
        "CMAKE_SYSTEM_PROCESSOR": processor,
        # A trial of the compiler would first build the libraries of that system, which takes
        # minutes.
        "CMAKE_C_COMPILER_ID_RUN": "ON",
        "CMAKE_C_COMPILER_ID": "Clang",
        "CMAKE_C_COMPILER_FORCED": "ON",
    }
    options = [f"-D{name}={value}" for name, value in given.items()]
    compiler = {"CC": f"{sys.executable} -m ziglang cc -target {target}"}
    run([str(tools / "cmake"), "-S", str(ROOT), "-B", str(tmp_path), "-GNinja", *options], None, compiler)
    run([str(tools / "ninja"), "-C", str(tmp_path)])
    assert (tmp_path / "libanhyst_plant.a").is_file()
